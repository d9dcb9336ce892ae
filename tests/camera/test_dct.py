"""Noise taken out before the blur is undone: what stays, what goes, and what it does to restored pictures."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import pytest
import scipy.fft
import scipy.ndimage
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.lib.stride_tricks import sliding_window_view
from once import leaves

from maskfab.base import resources
from maskfab.camera.imaging import Margin
from maskfab.camera.protocol import EPSILONS, F1, evaluate
from maskfab.camera.record import Noise, Record, interpolated
from maskfab.camera.restorers.dct import Dct, denoised, mosaic_noise
from maskfab.camera.restorers.wiener import Wiener
from maskfab.camera.scores import psnr
from maskfab.camera.sensor import record_light
from maskfab.camera.stop_cells import lay
from maskfab.job.camera import Sensor
from maskfab.mask.opening_file import load_opening

DIM = Noise(273.0, 4.87)


@dataclass(frozen=True)
class Soft:
    """A Gaussian point spread, standard deviation in pixels."""

    width: float = 1.0

    def on(self, shape):
        y, x = scipy.fft.fftfreq(shape[0])[:, None], scipy.fft.rfftfreq(shape[1])
        one = np.exp(-2 * (np.pi * self.width) ** 2 * (y**2 + x**2))
        return np.broadcast_to(one, (3, *one.shape)).astype(np.float32)


def taken(light, noise, seed=0):
    draw = np.random.default_rng(seed)
    counted = draw.poisson(light * noise.electrons) + noise.read_noise * draw.standard_normal(light.shape)
    return np.asarray(counted / noise.electrons, dtype=np.float32)


@pytest.mark.parametrize("light", [0.02, 0.1, 0.5])
def test_a_flat_field_keeps_its_mean_and_loses_its_noise(light):
    flat = np.full((3, 96, 128), light)
    values = taken(flat, DIM)
    calm = denoised(Record(values, DIM))
    sigma = float(np.sqrt(DIM.variance(np.float32([light])))[0])
    # Colours are worked on together, so their mean is what is kept; 4 standard errors, and the inverse's own bias.
    assert float(calm.mean(dtype=np.float64)) == pytest.approx(light, abs=4 * sigma / np.sqrt(flat.size) + 0.02 * sigma)
    assert calm.std() < 0.12 * values.std()


def test_what_has_no_noise_comes_back():
    scene = np.random.default_rng(3).random((3, 40, 72)).astype(np.float32)
    np.testing.assert_allclose(denoised(Record(scene, Noise(1e9, 0.0))), scene, atol=2e-5)


def test_turned_mirrored_and_recoloured_records_give_turned_mirrored_and_recoloured_light():
    """All windows are taken, so no direction is preferred; red and blue may change places, green may not."""
    values = taken(np.broadcast_to(np.linspace(0.05, 0.9, 80) ** 2, (3, 61, 80)), DIM)
    calm = denoised(Record(values, DIM))
    for change in (
        lambda a: a[:, ::-1],
        lambda a: a[:, :, ::-1],
        lambda a: a.transpose(0, 2, 1),
        lambda a: a[::-1],
    ):
        np.testing.assert_allclose(denoised(Record(np.ascontiguousarray(change(values)), DIM)), change(calm), atol=2e-5)


def test_a_part_far_from_its_edges_does_not_know_how_large_the_record_is():
    """Whatever strips the rows are worked on in; two passes of windows reach 14 pixels."""
    values = taken(np.broadcast_to(np.linspace(0.05, 0.9, 64), (3, 150, 64)), DIM)
    part = denoised(Record(values[:, 21:121], DIM))
    np.testing.assert_allclose(part[:, 14:-14], denoised(Record(values, DIM))[:, 35:107], atol=2e-5)


@settings(max_examples=15)
@given(st.integers(8, 45), st.integers(8, 45), st.floats(0, 1), st.integers(0, 99))
def test_any_size_stays_finite_and_near_the_light(rows, columns, light, seed):
    flat = np.full((3, rows, columns), light)
    calm = denoised(Record(taken(flat, DIM, seed), DIM))
    assert calm.shape == flat.shape
    sigma = float(np.sqrt(DIM.variance(np.float32([light])))[0])
    assert abs(calm - light).max() < 5 * sigma


@pytest.mark.parametrize("electrons", [273.0, 10024.0])
def test_restored_leaves_are_better_in_bright_light_and_in_dim(electrons):
    noise, blur, scene = Noise(electrons, 4.87), Soft(), leaves(1, 320, 320).values
    margin = Margin((320, 320), 64)
    blurred = margin.blurred(scipy.fft.rfft2(scene), blur.on((320, 320)))
    record, true = Record(taken(np.maximum(blurred, 0), noise), noise), margin.sensor(scene)
    plain, calm = Wiener(64).prepare(record, blur), Dct(Wiener(64)).prepare(record, blur)
    best, better = (max(psnr(restored(e), true) for e in EPSILONS[::2]) for restored in (plain, calm))
    assert better > best + 0.4


def test_a_full_well_stays_full_and_nothing_becomes_undefined():
    ceiling = 0.5
    values = np.minimum(taken(np.broadcast_to(np.linspace(0, 1, 200), (3, 150, 200)), DIM), np.float32(ceiling))
    record = Record(values, DIM, ceiling)
    seen = []

    class Then:
        name = "then"

        def prepare(self, calm, blur):
            seen.append(calm)
            return lambda epsilon: calm.values

    picture = Dct(Then()).prepare(record, Soft())(0.01)
    assert np.isfinite(picture).all()
    assert record.clipped.mean() > 0.4
    np.testing.assert_array_equal(seen[0].values[record.clipped], np.float32(ceiling))


def test_noise_of_an_interpolated_mosaic_is_what_draws_of_it_have():
    """White noise of variance 1, interpolated, in the cosine transforms of all windows."""
    seen = np.random.default_rng(5).standard_normal((400, 400)).astype(np.float32)
    opponent = np.tensordot(scipy.fft.dct(np.eye(3), norm="ortho", axis=0), interpolated(seen), axes=1)
    windows = sliding_window_view(opponent[:, 4:-4, 4:-4], (8, 8), axis=(1, 2))[:, ::3, ::3]
    drawn = np.square(scipy.fft.dctn(windows, axes=(3, 4), norm="ortho")).mean(axis=(1, 2))
    np.testing.assert_allclose(drawn, mosaic_noise(), rtol=0.12, atol=0.01)


@pytest.mark.parametrize("electrons", [273.0, 1600.0])
def test_noise_that_interpolation_made_coarse_is_taken_out_too(electrons):
    light = np.maximum(scipy.ndimage.gaussian_filter(leaves(1, 192, 192).values, (0, 1, 1)), 0)
    record = record_light(Sensor(mosaic="rggb"), light, electrons, 1)
    honest, as_white = (psnr(denoised(replace(record, interpolated=known)), light) for known in (True, False))
    assert honest > as_white + 0.3


@pytest.mark.slow
@pytest.mark.parametrize(("opening", "least_db"), [("fits_88", 0.4), ("toled", -0.05)])
@pytest.mark.parametrize("level", [24, 40])
def test_a_scene_behind_a_panel_gains_and_behind_a_display_loses_nothing(opening, least_db, level):
    mask = load_opening(resources.path("layouts") / "openings" / f"{opening}.toml").mask
    die = lay(opening, mask, np.zeros((24, 24), dtype=np.int8) if opening == "toled" else None)
    scenes = [leaves(1)]
    table = evaluate([die], scenes, scenes, [level], protocol=F1, details=False, restorers=(Wiener(), Dct()))
    plain, calm = (next(s.psnr for s in table.scores if s.restorer == name) for name in ("wiener", "dct+wiener"))
    assert calm > plain + least_db
