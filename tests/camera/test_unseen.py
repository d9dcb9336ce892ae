"""Restorers that solve for the light beyond the sensor's edge, against dense matrices and what cannot change."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache

import numpy as np
import pytest
import scipy.fft
from hypothesis import given, settings
from hypothesis import strategies as st

from maskfab.camera.imaging import Margin
from maskfab.camera.record import Noise, Record
from maskfab.camera.restorers import least_squares
from maskfab.camera.restorers.least_squares import Gradient, Seen, TotalVariation
from maskfab.camera.restorers.wiener import Wiener, prior
from maskfab.camera.scenes import dead_leaves, indoors
from maskfab.camera.scores import psnr
from maskfab.camera.stop_cells import lay
from maskfab.optics.restoration import wiener_filter

DARK = Noise(float("inf"), 0.0)
"""No noise at all."""


@dataclass(frozen=True, eq=False)
class Spread:
    """A blur by its point spread, an array around [0, 0] with a sum of 1."""

    points: np.ndarray

    def on(self, shape):
        wide = np.zeros(shape)
        reach = len(self.points) // 2
        across = np.arange(-reach, reach + 1)
        wide[np.ix_(across % shape[0], across % shape[1])] = self.points
        found = scipy.fft.rfft2(wide).astype(np.complex64)
        even = np.array_equal(self.points, self.points[::-1, ::-1])
        return np.repeat((found.real.copy() if even else found)[None], 3, axis=0)


def halo(width=12, share=0.5):
    """A sharp core in a wide halo."""
    across = np.arange(-width, width + 1)
    points = np.exp(-np.hypot(across[:, None], across) / (width / 3))
    points *= share / points.sum()
    points[width, width] += 1 - share
    return Spread(points)


def lopsided():
    points = np.random.default_rng(3).random((5, 5)) + 6 * np.eye(5)[2][:, None] * np.eye(5)[2]
    return Spread(points / points.sum())


@cache
def leaves(rows, columns):
    """Rectangles that fall on each other, soft by half a pixel, [3, rows, columns] within 0.1 to 0.9."""
    draw = np.random.default_rng(5)
    scene = np.full((3, rows, columns), 0.3, dtype=np.float32)
    for size in np.geomspace(rows / 2, 3, 80):
        high, wide = (size * draw.uniform(0.5, 1.5, 2)).astype(int) + 1
        top, left = draw.integers(rows), draw.integers(columns)
        scene[:, max(0, top - high) : top + high, max(0, left - wide) : left + wide] = draw.uniform(0.1, 0.9, (3, 1, 1))
    soft = (scene + np.roll(scene, 1, 1) + np.roll(scene, 1, 2) + np.roll(scene, (1, 1), (1, 2))) / 4
    soft.flags.writeable = False
    return soft


def taken(scene, blur, width, noise=DARK, ceiling=float("inf"), seed=0):
    """A record of the middle of a scene."""
    margin = Margin(scene.shape[1:], width)
    light = margin.blurred(scipy.fft.rfft2(scene, axes=(1, 2)), blur.on(margin.shape))
    draw = np.random.default_rng(seed).standard_normal(light.shape).astype(np.float32)
    values = light + draw * np.sqrt(noise.variance(light))
    return Record(np.minimum(values, np.float32(ceiling)).astype(np.float32), noise, ceiling), margin.sensor(scene)


def test_the_minimum_is_that_of_a_dense_matrix(monkeypatch):
    """Of direct sums over pixels, with weights, unknown pixels and a point spread without symmetry."""
    monkeypatch.setattr(least_squares, "_STALLED", 0.0)
    side, width, draw = 12, 3, np.random.default_rng(1)
    margin, points = Margin((side, side), width), lopsided().points
    at = np.arange(side)
    away = (at[:, None] - at + 2) % side  # from column to row, the middle of the spread at 2
    spread = np.pad(points, [(0, side - 5)] * 2)
    blur = spread[away[:, None, :, None], away[None, :, None, :]].reshape(side**2, side**2)
    inside = np.zeros((side, side), bool)
    inside[width:-width, width:-width] = True
    seen = blur[inside.ravel()]
    weight = draw.random(36) * (draw.random(36) > 0.2)
    values = draw.random(36)
    waves = np.exp(-2j * np.pi * np.outer(at, at) / side)
    waves = np.kron(waves, waves)
    nu = np.minimum(at, side - at) / side
    slopes = 0.05 * (nu[:, None] ** 2 + nu**2).ravel() / 0.01
    smooth = (waves.conj().T @ (slopes[:, None] * waves)).real / side**2
    wanted = np.linalg.solve(seen.T @ (weight[:, None] * seen) + smooth, seen.T @ (weight * values))

    found = Seen(
        margin,
        lopsided().on((side, side))[:1],
        values.reshape(1, 6, 6).astype(np.float32),
        weight.reshape(1, 6, 6).astype(np.float32),
    ).solve(np.float32(0.05) * prior((side, side)), np.zeros((1, side, side // 2 + 1), np.complex64))
    picture = scipy.fft.irfft2(found, s=(side, side), axes=(1, 2))[0]
    np.testing.assert_allclose(picture.ravel(), wanted, atol=2e-4)


@given(rows=st.integers(3, 12), columns=st.integers(3, 12), width=st.integers(0, 5), seed=st.integers(0, 99))
@settings(max_examples=15, deadline=None)
def test_back_is_the_adjoint_of_light(rows, columns, width, seed):
    draw = np.random.default_rng(seed)
    shape = rows + 2 * width + 3, columns + 2 * width + 3
    shape = shape[0] + shape[0] % 2, shape[1] + shape[1] % 2
    margin = Margin(shape, width)
    scene = draw.standard_normal((1, *shape)).astype(np.float32)
    light = draw.standard_normal(margin.sensor(scene).shape).astype(np.float32)
    seen = Seen(margin, lopsided().on(shape)[:1], light, np.ones_like(light))
    one = float((seen.light(scipy.fft.rfft2(scene, axes=(1, 2))) * light).sum())
    other = float((scene * scipy.fft.irfft2(seen.back(light), s=shape, axes=(1, 2))).sum())
    assert one == pytest.approx(other, abs=1e-4)


def test_where_nothing_is_unseen_it_is_the_wiener_filter():
    scene, blur = leaves(32, 48), lopsided()
    record, _ = taken(scene, blur, 0, Noise(1000.0, 5.0))
    filtered = wiener_filter(blur.on((32, 48)), np.float32(0.01) * prior((32, 48)))
    wanted = scipy.fft.irfft2(scipy.fft.rfft2(record.values, axes=(1, 2)) * filtered, axes=(1, 2))
    found = Gradient(width=0).prepare(record, blur)(0.01)
    np.testing.assert_allclose(found, wanted.clip(0, 1), atol=1e-5)
    seen = Seen(Margin((32, 48), 0), blur.on((32, 48))[:1], record.values[:1], np.ones((1, 32, 48), np.float32))
    other = seen.solve(np.float32(0.01) * prior((32, 48)), np.zeros((1, 32, 25), np.complex64))
    np.testing.assert_allclose(scipy.fft.irfft2(other, axes=(1, 2))[0], wanted[0], atol=1e-5)


@pytest.mark.parametrize("restorer", [Gradient(width=16), TotalVariation(width=16)])
def test_without_noise_an_invertible_blur_is_undone(restorer):
    """Even at the edge, up to what the light from outside leaves open."""
    scene = leaves(64, 96)
    record, true = taken(scene, halo(6, 0.3), 16)
    found = restorer.prepare(record, halo(6, 0.3))(1e-6)
    assert abs(found - true)[:, 8:-8, 8:-8].max() < 0.01
    assert psnr(found, true) > 40


@pytest.mark.parametrize(("restorer", "least"), [(Gradient(width=24), 0.2), (TotalVariation(width=24), 1.0)])
def test_a_halo_from_outside_is_told_from_the_scene_better_than_by_a_mirror(restorer, least):
    scene, blur = leaves(80, 96), halo(16, 0.6)
    record, true = taken(scene, blur, 24, Noise(20_000.0, 5.0))
    epsilons = (0.003, 0.01, 0.03)
    mirrored = Wiener(width=24).prepare(record, blur)
    solved = restorer.prepare(record, blur)
    best = max(psnr(mirrored(e), true) for e in epsilons)
    assert max(psnr(solved(e), true) for e in epsilons) > best + least


@pytest.mark.slow
@pytest.mark.parametrize("electrons", [300.0, 11_000.0])
def test_behind_a_display_neither_falls_behind_the_wiener_filter(electrons):
    opening = np.zeros((21, 21), bool)
    opening[:17, :6] = True
    display = lay("bar", opening)
    scene = indoors(dead_leaves(4))
    record, true = taken(scene.values, display, 256, Noise(electrons, 4.87))
    solved = [r.prepare(record, display) for r in (Wiener(), Gradient(), TotalVariation())]
    wiener, gradient, variation = (max(psnr(f(e), true) for e in (0.005, 0.015)) for f in solved)
    assert gradient > wiener - 0.02
    assert variation > wiener + 0.3


def test_no_strength_at_all_is_still_a_picture():
    record, true = taken(leaves(64, 64), halo(4), 16, Noise(1e8, 1.0))
    for restorer in (Gradient(width=16), TotalVariation(width=16)):
        assert psnr(restorer.prepare(record, halo(4))(0.0), true) > 30


def test_a_smooth_picture_comes_back_from_the_means_of_its_blocks():
    y, x = np.arange(64)[:, None] / 64, np.arange(96) / 96
    smooth = np.cos(2 * np.pi * (y + 0.1)) * np.cos(2 * np.pi * (2 * x + 0.2))[None] + 0.3
    spectrum = scipy.fft.rfft2(smooth[None].astype(np.float32), axes=(1, 2))
    means = smooth.astype(np.float32).reshape(1, 16, 4, 24, 4).mean(axis=(2, 4))
    finer = least_squares._finer(scipy.fft.rfft2(means, axes=(1, 2)), (64, 96), spectrum.shape)
    found = scipy.fft.irfft2(finer, s=(64, 96), axes=(1, 2))[0]
    np.testing.assert_allclose(found, smooth, atol=0.04)


def test_a_coarse_frame_first_changes_the_way_and_not_the_answer(monkeypatch):
    monkeypatch.setattr(least_squares, "_STALLED", 1e-7)
    monkeypatch.setattr(least_squares, "_COARSEST", 8)
    record, _ = taken(leaves(64, 64), halo(6), 16, Noise(2000.0, 5.0))
    found = Gradient(width=16).prepare(record, halo(6))(0.02)
    monkeypatch.setattr(least_squares, "_COARSEST", 1000)
    np.testing.assert_allclose(found, Gradient(width=16).prepare(record, halo(6))(0.02), atol=2e-3)


@pytest.mark.parametrize("axes", [(1,), (2,), (1, 2)])
def test_a_flipped_record_gives_the_flipped_scene(axes, monkeypatch):
    monkeypatch.setattr(least_squares, "_STALLED", 1e-8)
    record, _ = taken(leaves(56, 56), halo(4), 12, Noise(2000.0, 5.0))
    turned = Record(np.flip(record.values, axes).copy(), record.noise)
    found = [Gradient(width=12).prepare(r, halo(4))(0.02) for r in (record, turned)]
    np.testing.assert_allclose(np.flip(found[0], axes), found[1], atol=2e-4)


def test_total_variation_treats_rows_as_columns(monkeypatch):
    monkeypatch.setattr(least_squares, "_STALLED", 1e-8)
    record, _ = taken(leaves(64, 96), halo(), 16, Noise(2000.0, 5.0))
    turned = Record(record.values.transpose(0, 2, 1).copy(), record.noise)
    found = [TotalVariation(width=16).prepare(r, halo())(0.02) for r in (record, turned)]
    np.testing.assert_allclose(found[0].transpose(0, 2, 1), found[1], atol=1e-3)


@pytest.mark.parametrize("restorer", [Gradient(width=16), TotalVariation(width=16)])
def test_dimmer_light_in_as_much_less_noise_is_the_same_picture_dimmer(restorer):
    """So a strength means the same at every level of light."""
    record, _ = taken(leaves(64, 64), halo(), 16, Noise(500.0, 5.0))
    dim = Record(record.values / 4, Noise(2000.0, 5.0))
    np.testing.assert_allclose(dim.variance, record.variance / 16, rtol=1e-6)
    found = [restorer.prepare(r, halo())(0.02) for r in (record, dim)]
    below = found[0] < 0.999
    np.testing.assert_allclose(found[0][below] / 4, found[1][below], atol=2e-4)


def test_no_picture_nearby_has_less_total_variation_and_misfit(monkeypatch):
    monkeypatch.setattr(least_squares, "_TV_MOST_STEPS", 600)
    monkeypatch.setattr(least_squares, "_STILL", 0.0)
    record, _ = taken(0.2 + 0.5 * leaves(24, 24), halo(4), 0, Noise(1000.0, 3.0))
    blur, epsilon = halo(4).on((24, 24)), 0.02
    found = TotalVariation(width=0).prepare(record, halo(4))(epsilon).astype(np.float64)
    strength = 0.5 * np.sqrt(record.variance.mean()) * np.sqrt(7 * epsilon) / (0.2 * np.pi)

    def total(picture):
        light = scipy.fft.irfft2(scipy.fft.rfft2(picture, axes=(1, 2)) * blur, s=(24, 24), axes=(1, 2))
        slopes = [np.roll(picture, -1, axis) - picture for axis in (1, 2)]
        return ((light - record.values) ** 2).sum() / 2 + strength * np.sqrt((np.square(slopes)).sum((0, 1))).sum()

    draw, least = np.random.default_rng(0), total(found)
    changes = [draw.standard_normal(found.shape) * size for size in (1e-4, 1e-3, 1e-2)]
    changes += [record.values - found, found.mean(axis=(1, 2), keepdims=True) - found, found * 0 + 0.01]
    assert found.min() > 0  # nothing was cut off, which would move the minimum
    assert found.max() < 1
    assert all(total(found + share * change) > least * (1 - 1e-6) for change in changes for share in (1, 0.01, -0.01))


@dataclass(frozen=True, eq=False)
class Uneven(Record):
    """A record of which some pixels have a lower full well."""

    full: np.ndarray | None = None

    @property
    def clipped(self):
        return self.full


@pytest.mark.parametrize("restorer", [Gradient(width=16), TotalVariation(width=16)])
def test_full_wells_push_up_and_never_pull_down(restorer):
    full = np.random.default_rng(2).random((3, 64, 64)) < 0.2
    blur = halo(6, 0.3)
    low, high = (np.where(full, np.float32(level), np.float32(0.5)) for level in (0.2, 0.8))
    assert abs(restorer.prepare(Uneven(low, Noise(1e4, 5.0), full=full), blur)(0.003) - 0.5).max() < 0.03
    found = restorer.prepare(Uneven(high, Noise(1e4, 5.0), full=full), blur)(0.003)
    assert found[full].mean() > 0.75
    assert restorer.prepare(Record(low, Noise(1e4, 5.0)), blur)(0.003)[full].mean() < 0.4
    left = np.arange(64) < 32
    found = restorer.prepare(Uneven(np.where(left, low, high), Noise(1e4, 5.0), full=full), blur)(0.003)
    assert abs(found[:, :, :24][full[:, :, :24]] - 0.5).max() < 0.1
    assert found[:, :, 40:][full[:, :, 40:]].mean() > 0.75


@pytest.mark.parametrize("restorer", [Gradient(width=16), TotalVariation(width=16)])
def test_a_full_well_out_of_reach_changes_nothing(restorer):
    record, _ = taken(leaves(64, 64), halo(), 16, Noise(2000.0, 5.0))
    high = Record(record.values, record.noise, ceiling=10.0)
    np.testing.assert_array_equal(*(restorer.prepare(r, halo())(0.02) for r in (record, high)))


def test_a_well_that_hides_a_dim_scene_is_still_full():
    """All that is known of a lamp is that it is at least so bright; smoothness alone would make it dark."""
    scene = np.zeros((3, 64, 64), np.float32)
    scene[:, 30:34, 30:34] = 0.9
    record, _ = taken(scene, halo(4, 0.1), 16, Noise(20_000.0, 5.0), ceiling=0.2)
    found = Gradient(width=16).prepare(record, halo(4, 0.1))(0.01)
    assert found[record.clipped].min() > 0.15


def test_a_product_of_spectra_is_that_of_their_pictures_however_they_lie():
    rng = np.random.default_rng(1)
    one, other = rng.standard_normal((2, 3, 6, 8), dtype=np.float32)
    spectra = [np.fft.rfft2(each).astype(np.complex64) for each in (one, other)]
    found = {least_squares._dot(spectra[0], lie(spectra[1])) for lie in (np.ascontiguousarray, np.asfortranarray)}
    assert len(found) == 1
    assert found.pop() == pytest.approx(48 * float(np.vdot(one, other)), rel=1e-5)
