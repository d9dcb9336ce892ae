"""The best of several restorers, chosen without the truth."""

from __future__ import annotations

import re
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import pytest
import scipy.fft
import scipy.ndimage
from once import leaves

from maskfab.camera.imaging import Margin
from maskfab.camera.record import Noise, Record, Restorer
from maskfab.camera.restorers.choice import COUNTED, Choice, Judge, expected_errors, mixed
from maskfab.camera.restorers.dct import Dct
from maskfab.camera.restorers.wiener import Wiener
from maskfab.camera.scores import psnr
from maskfab.optics.colour import code_of_light

WIDTH = 64
NOISE = Noise(2000.0, 4.87)
MARGIN = Margin((256, 320), WIDTH)


@dataclass(frozen=True)
class Halo:
    """A sharp point in a wide Gaussian halo, of standard deviations in pixels; 0 takes the halo away."""

    share: float = 0.5
    sharp: float = 0.8
    wide: float = 12.0

    def on(self, shape):
        y, x = scipy.fft.fftfreq(shape[0])[:, None], scipy.fft.rfftfreq(shape[1])
        sharp, wide = (np.exp(-2 * (np.pi * s) ** 2 * (y**2 + x**2)) for s in (self.sharp, self.wide))
        one = (1 - self.share) * sharp + self.share * wide
        return np.broadcast_to(one, (3, *one.shape)).astype(np.float32)


@dataclass(frozen=True)
class Ghosts:
    """Five points in a row, 8 pixels apart."""

    def on(self, shape):
        y, x = scipy.fft.fftfreq(shape[0])[:, None], scipy.fft.rfftfreq(shape[1])
        row = (1 + 1.4 * np.cos(16 * np.pi * x) + 0.8 * np.cos(32 * np.pi * x)) / 3.2
        one = row * np.exp(-((np.pi * 0.8) ** 2) * (y**2 + x**2))
        return np.broadcast_to(one, (3, *one.shape)).astype(np.float32)


@dataclass(frozen=True)
class Stripes:
    """Passes no detail across of a period from 4 to 8 pixels."""

    def on(self, shape):
        y, x = scipy.fft.fftfreq(shape[0])[:, None], scipy.fft.rfftfreq(shape[1])
        one = np.exp(-2 * (np.pi * 0.6) ** 2 * (y**2 + x**2)) * ((x < 1 / 8) | (x > 1 / 4))
        return np.broadcast_to(one, (3, *one.shape)).astype(np.float32)


@dataclass(frozen=True)
class Changed:
    """Changes another restorer's pictures, as a network may that has learned the wrong thing."""

    name: str
    by: Restorer
    change: Callable[[np.ndarray], np.ndarray]

    def prepare(self, record, blur):
        restored = self.by.prepare(record, blur)
        return lambda epsilon: np.clip(self.change(restored(epsilon)), 0, 1).astype(np.float32)


def hallucinated(picture):
    """Detail where edges are, but of a period of 5.5 pixels, of which the stripes pass nothing."""
    across = np.arange(picture.shape[2], dtype=np.float32)
    edges = scipy.ndimage.gaussian_filter(np.abs(np.diff(picture, axis=2, append=0)), (0, 8, 8))
    return picture + 2 * edges * np.sin(2 * np.pi * across / 5.5)


def softened(picture):
    return scipy.ndimage.gaussian_filter(picture, (0, 1.5, 1.5))


@dataclass(frozen=True)
class Known:
    """Gives pictures that are made beforehand, of the part that is shown as of the whole."""

    name: str
    whole: np.ndarray

    def prepare(self, record, blur):
        left = [(have - want) // 2 for have, want in zip(self.whole.shape[1:], record.values.shape[1:], strict=True)]
        rows, columns = (slice(a, a + n) for a, n in zip(left, record.values.shape[1:], strict=True))
        return lambda epsilon: self.whole[:, rows, columns].copy()


@pytest.fixture(scope="module")
def true():
    return MARGIN.sensor(leaves(1, 256, 320).values)


def draws(shape):
    return np.random.default_rng(4).standard_normal(shape, dtype=np.float32)


def taken(blur=None, noise=NOISE, seed=0):
    """A record of leaves that go on beyond the sensor."""
    blur = blur or Halo()
    seen = np.maximum(MARGIN.blurred(scipy.fft.rfft2(leaves(1, 256, 320).values), blur.on(MARGIN.shape)), 0)
    draw = np.random.default_rng(seed)
    counted = draw.poisson(seen * noise.electrons) + noise.read_noise * draw.standard_normal(seen.shape)
    return Record(np.asarray(counted / noise.electrons, dtype=np.float32), noise)


@pytest.mark.parametrize("electrons", [300.0, 10000.0])
def test_of_many_strengths_the_one_chosen_is_nearly_the_best(true, electrons):
    record, blur = taken(noise=Noise(electrons, 4.87)), Halo()
    restorers, steps = [Wiener(WIDTH), Dct(Wiener(WIDTH))], (1e-4, 1e-3, 1e-2, 1e-1, 1.0)
    chosen = Choice(restorers, width=WIDTH, steps=steps).restore(record, blur, {"wiener": 1.0, "dct+wiener": 5.0})
    prepared = [r.prepare(record, blur) for r in restorers]
    scores = [
        psnr(restored(e), true) for restored, most in zip(prepared, (1, 5), strict=True) for e in most * np.array(steps)
    ]
    assert psnr(chosen.picture, true) > max(scores) - 0.2
    assert max(scores) - min(scores) > 5
    assert max(chosen.shares, key=chosen.shares.get) == chosen.name
    assert sum(chosen.shares.values()) == pytest.approx(1)


@pytest.mark.parametrize(("light", "coded"), [(0.3, False), (0.3, True), (0.05, True)])
def test_two_that_err_apart_are_mixed_and_the_mean_is_better_than_either(light, coded):
    """Noise of their own on either side of the truth; where light is coded, so is the mean."""
    whole = np.full((3, 128, 192), light, dtype=np.float32)
    one, other = (whole * (1 + np.float32(0.2) * np.random.default_rng(k).standard_normal(whole.shape)) for k in (5, 6))
    restorers = [Known("one", one.astype(np.float32)), Known("other", other.astype(np.float32))]
    record = Record(whole + np.sqrt(NOISE.variance(whole)) * draws(whole.shape), NOISE)
    found = Choice(restorers, width=WIDTH, coded=coded).restore(record, Halo(0.0, sharp=0.0), {"one": 0, "other": 0})
    assert found.shares["one"] == pytest.approx(0.5, abs=0.15)
    # Who reads of one restorer is told of the other.
    first, second = sorted(found.shares, key=found.shares.get, reverse=True)
    assert re.fullmatch(rf"\d+ % {first} and \d+ % {second}", found.makers)
    scored = code_of_light if coded else np.asarray
    wanted = found.shares["one"] * scored(one) + found.shares["other"] * scored(other)
    np.testing.assert_allclose(scored(found.picture), wanted, atol=1e-4)
    assert psnr(scored(found.picture), scored(whole)) > psnr(scored(one), scored(whole)) + 2


def test_shares_are_those_of_the_least_error_of_a_mean_and_of_two_restorers():
    """Errors of 1 and 1.2 whose difference has the mean square 1; a third is the first at another strength."""
    a, b = (Known(name, np.zeros((3, 1, 1))) for name in "ab")
    apart = np.array([[0, 1, 2], [1, 0, 1], [2, 1, 0]], dtype=float)
    tried = [(a, 1.0), (b, 1.0), (a, 2.0)]
    shares = mixed(np.array([1.0, 1.2, 1.1]), apart / COUNTED, tried)
    assert shares == {0: pytest.approx(0.6), 1: pytest.approx(0.4)}
    assert mixed(np.array([1.0, 9.0, 9.0]), apart, tried) == {0: 1.0}


def test_the_criterion_is_the_mean_squared_error_less_a_number_that_is_the_same_for_all(true):
    """Pictures off the truth by known amounts, in frequencies that the blur passes."""
    smooth = scipy.fft.idctn(scipy.fft.dctn(true, axes=(1, 2)) * (np.arange(192) < 9), axes=(1, 2)).astype(np.float32)
    wave = np.sin(np.arange(192, dtype=np.float32) / 9) * np.float32(0.1)
    off = {"true": 0 * wave, "wave": wave, "half": wave / 2, "bright": wave * 0 + np.float32(0.05)}
    restorers = [Known(name, true + change) for name, change in off.items()] + [Known("smooth", smooth)]
    found = Choice(restorers, width=WIDTH).restore(taken(), Halo(), dict.fromkeys([r.name for r in restorers], 0.0))
    assert found.name == "true"
    for name, change in off.items():
        wanted = float(np.square(change[24:-24]).mean())
        assert found.criteria[name] - found.criteria["true"] == pytest.approx(wanted, rel=0.15, abs=1e-5)


def test_where_light_is_coded_an_error_in_the_dark_counts_as_it_is_seen(true):
    """The same scene with a dim half: 0.01 off in the dim half is more code values than 0.015 in the other."""
    half = np.arange(192) < 96
    light = true * np.where(half, np.float32(0.1), np.float32(1))
    record = Record(light + np.sqrt(NOISE.variance(light)) * draws(light.shape), NOISE)
    known = {"dim": light + np.float32(0.01) * half, "bright": light + np.float32(0.015) * ~half}
    restorers, none = [Known(name, whole) for name, whole in known.items()], dict.fromkeys(known, 0.0)
    plain, coded = (
        Choice(restorers, width=WIDTH, coded=c).restore(record, Halo(0.0, sharp=0.0), none) for c in (False, True)
    )
    assert (plain.name, coded.name) == ("dim", "bright")
    cut = (slice(None), slice(24, -24), slice(24, -24))
    error = {k: np.square(code_of_light(p[cut]) - code_of_light(light[cut])).mean() for k, p in known.items()}
    told = coded.criteria["dim"] - coded.criteria["bright"]
    assert told == pytest.approx(error["dim"] - error["bright"], rel=0.3)


def test_what_explains_the_record_by_a_wrong_edge_does_not_win(true):
    """Ghosts 8 and 16 pixels off, as behind a grating: mirrored edges explain them wrongly, best with little ε."""
    blur, steps = Ghosts(), (1e-5, 1e-4, 1e-3, 1e-2, 1e-1)
    record = taken(blur, Noise(1e4, 4.87))
    restored = Wiener(WIDTH).prepare(record, blur)
    scores = [psnr(restored(e), true) for e in steps]
    chosen = Choice([Wiener(WIDTH)], width=WIDTH, steps=steps).restore(record, blur, {"wiener": 1.0})
    assert psnr(chosen.picture, true) > max(scores) - 0.2


def test_bright_light_from_beyond_the_sensor_speaks_for_no_picture():
    """A dim scene in bright surroundings, whose halo reaches the part that is judged: too bright is as wrong as dim."""
    blur, noise = Halo(share=0.6), Noise(1e4, 4.87)
    scene = np.full((3, 256, 320), 0.9, dtype=np.float32)
    light = MARGIN.sensor(scene)
    light[:] = 0.1 * MARGIN.sensor(leaves(1, 256, 320).values)
    seen = np.maximum(MARGIN.blurred(scipy.fft.rfft2(scene), blur.on(MARGIN.shape)), 0)
    record = Record(seen + np.sqrt(noise.variance(seen)) * draws(seen.shape), noise)
    judge = Judge.of(record, blur, np.random.default_rng(0), WIDTH)
    inner = light[:, judge.left : -judge.left, judge.left : -judge.left]
    bright, true, dim = (judge.error(judge.seen(inner + np.float32(off)), np.float32(1)) for off in (0.02, 0, -0.02))
    assert bright - true == pytest.approx(0.02**2, rel=0.18)
    assert dim - true == pytest.approx(0.02**2, rel=0.18)


@pytest.mark.parametrize("change", [hallucinated, softened])
def test_what_invents_detail_or_takes_it_away_loses_to_what_does_not(true, change):
    """Less noise where the record speaks makes up for nothing that is wrong where it is silent."""
    record, blur = taken(Stripes(), Noise(300.0, 4.87)), Stripes()
    wrong, honest = Changed("wrong", Dct(Wiener(WIDTH)), change), Wiener(WIDTH)
    assert psnr(honest.prepare(record, blur)(0.06), true) > psnr(wrong.prepare(record, blur)(0.5), true) + 1
    found = Choice([wrong, honest], width=WIDTH).restore(record, blur, {"wrong": 0.5, "wiener": 0.06})
    assert found.name == "wiener"


def test_the_noise_of_what_a_record_tells_is_known():
    """Of differences between pictures, over records with noise of their own."""
    margin, told = Margin((192, 208), WIDTH), []
    scene = leaves(1, 192, 208).values
    light, clean = margin.sensor(scene), np.maximum(margin.blurred(scipy.fft.rfft2(scene), Halo().on((192, 208))), 0)
    off = [0, 0.02 * draws(light.shape), scipy.ndimage.gaussian_filter(light, (0, 2, 2)) - light]
    for seed in range(100, 116):
        draw = np.random.default_rng(seed)
        noise = np.sqrt(NOISE.variance(clean)) * draw.standard_normal(clean.shape, dtype=np.float32)
        judge = Judge.of(Record(clean + noise, NOISE), Halo(), draw, WIDTH)
        inner = (slice(None), slice(judge.left, -judge.left), slice(judge.left, -judge.left))
        seen = [judge.seen((light + each)[inner]) for each in off]
        told.append([judge.error(each, np.float32(1)) for each in seen])
    covariance = judge.covariance(seen, np.float32(1))
    differ = np.array([[1, -1, 0], [0, -1, 1]])
    deviation = np.sqrt(np.diag(differ @ covariance @ differ.T))
    assert deviation == pytest.approx(np.std(np.array(told) @ differ.T, axis=0, ddof=1), rel=0.4)


def test_the_record_counts_by_its_noise():
    """Exact it alone decides, silent the imagined record does, and between them the mean by their precisions."""
    imagined, passed, told = np.array([2.0, 2.0]), np.array([1.5, 1.0]), np.array([0.5, 0.4])
    scatter = 2 * 0.4**2
    for noise in (0.0, scatter, 1e9):
        found = expected_errors(told, np.eye(2) * noise / 2, imagined, passed)
        wanted = (0.1 - 0.5) * scatter / (scatter + noise)
        assert found[0] - found[1] == pytest.approx(wanted, rel=1e-6, abs=1e-9)


def test_the_same_again_and_hardly_another_with_another_parting(true):
    record, blur = taken(), Halo()
    restorers, epsilons = [Wiener(WIDTH), Dct(Wiener(WIDTH))], {"wiener": 0.02, "dct+wiener": 0.03}
    first, again, other = (Choice(restorers, seed, WIDTH).restore(record, blur, epsilons) for seed in (0, 0, 1))
    assert first.criteria == again.criteria
    np.testing.assert_array_equal(first.picture, again.picture)
    assert first.name == other.name == "dct+wiener"
    gap = [c.criteria["wiener"] - c.criteria["dct+wiener"] for c in (first, other)]
    assert gap[0] == pytest.approx(gap[1], rel=0.2)


def test_the_winner_restores_the_record_as_it_is():
    record, blur = taken(), Halo()
    chosen = Choice([Wiener(WIDTH)], width=WIDTH).restore(record, blur, {"wiener": 0.02})
    np.testing.assert_array_equal(chosen.picture, Wiener(WIDTH).prepare(record, blur)(0.02))
    assert chosen.criteria == {}


def test_a_few_full_wells_do_not_turn_the_judgement(true):
    record = taken()
    record = Record(np.minimum(record.values, np.float32(0.7)), NOISE, 0.7)
    known = {"true": true, "dim": true - np.float32(0.05), "bright": true + np.float32(0.05)}
    restorers = [Known(name, whole) for name, whole in known.items()]
    found = Choice(restorers, width=WIDTH).restore(record, Halo(), dict.fromkeys(known, 0.0)).criteria
    wanted = 0.05**2 * (1 - record.clipped[:, 24:-24, 24:-24].mean())
    for name in ("dim", "bright"):
        assert found[name] - found["true"] == pytest.approx(wanted, rel=0.2)


def test_pixels_that_a_full_well_cut_off_are_not_judged(true):
    record = taken()
    record = Record(np.minimum(record.values, np.float32(0.4)), NOISE, 0.4)
    assert 0.05 < record.clipped.mean() < 0.9
    dark, off = np.where(record.clipped, 0, true), np.where(record.clipped, true, 0)
    known = {"true": true, "dark": dark, "off": off}
    restorers = [Known(name, whole) for name, whole in known.items()]
    found = Choice(restorers, width=WIDTH).restore(record, Halo(), dict.fromkeys(known, 0.0))
    assert found.criteria["dark"] == found.criteria["true"] < found.criteria["off"]
    assert np.isfinite(list(found.criteria.values())).all()
