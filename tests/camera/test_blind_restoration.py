"""Photographs restored by a PSF that may be wrong: none is worse than the record, and a wrong die is told.

Records come from a simulator that shares no optics with the package; scenes are drawn.
"""

from __future__ import annotations

from functools import cache

import numpy as np
import pytest
from capture_simulator import Dots, Optics, picture, srgb8
from PIL import Image
from scipy import ndimage, signal

import maskfab as mf
from maskfab.camera.blur import MeasuredBlur
from maskfab.camera.die_transfer import die_transfer
from maskfab.camera.explained import EXPLAINED, FOREIGN, UNSURE, explain
from maskfab.camera.noise_spectrum import noise_of, whitened
from maskfab.camera.panel_power import Comparison
from maskfab.camera.panel_spectrum import Seen, Shape
from maskfab.camera.photo import Photo, Stated, estimated_noise, read_photo, restored_light
from maskfab.camera.record import Noise, Record
from maskfab.camera.restorers.choice import restored
from maskfab.camera.restorers.wiener import Wiener
from maskfab.camera.scenes import dead_leaves
from maskfab.optics.colour import light_of_code

LINES = (610.0, 530.0, 470.0)
LENS = {"stop": "2 mm", "pixel": "4 um", "wavelengths": ["610 nm", "530 nm", "470 nm"], "window": "400 um"}
SIDE, PIXELS, ROOM = 256, 193, 96
READ_E = 4.87
KINDS = ("scale", "turn", "die", "focus", "noise", "smoothed", "8 bits", "jpeg")
LEVELS = (400.0, 3000.0, 20000.0)


@cache
def dies():
    """Panels that differ in opening or tiling, all about as clear."""
    draw = np.random.default_rng(7)
    scattered = np.zeros(441, dtype=np.bool_)
    scattered[draw.permutation(441)[:100]] = True
    bar = mf.Opening.bar(dots=21, size=(5, 18), pitch="168 um")
    loose = mf.Opening.of(scattered.reshape(21, 21), pitch="168 um")
    return {
        "bars": mf.Panel.tile(bar, "random", seed=1, size="2.4 mm"),
        "stripes": mf.Panel.tile(bar, "periodic", size="2.4 mm"),
        "scattered": mf.Panel.tile(loose, "random", seed=2, size="2.4 mm"),
        "lattice": mf.Panel.tile(loose, "periodic", size="2.4 mm"),
    }


@cache
def designed(die, stop="2 mm"):
    """Its transfer as designed."""
    return die_transfer(die, dies()[die], mf.Camera("10 mm", **{**LENS, "stop": stop}).model)


@cache
def spread(die, scale=1.0, turn=0.0, waves=0.0, pixels=PIXELS, stop_um=2000.0):
    """The true PSF of three colours, [3, pixels, pixels], the sum of each 1; two samples along a pixel to turn it."""
    optics = [
        Optics(
            stop_um,
            1e4 * scale,
            2.0 if turn else 4.0,
            2 * pixels if turn else pixels,
            {line: 1.0},
            {4: waves * 530 / line} if waves else {},
        )
        for line in LINES
    ]
    found = np.stack([picture(Dots.of(dies()[die]), each) for each in optics])
    if turn:
        turned = ndimage.rotate(found, turn, axes=(1, 2), reshape=False, order=3)
        found = turned.reshape(3, pixels, 2, pixels, 2).sum(axis=(2, 4))
    return found / found.sum(axis=(1, 2), keepdims=True)


_EXPLAINED = {}


def explained_once(seen, blur, noise, rivals=None, *, coded=False):
    """What explains a record, found once by the same blur."""
    key = seen.values.tobytes(), seen.noise, id(blur), tuple(rivals or ()), coded
    if key not in _EXPLAINED:
        # The blur is kept too, lest another be told by its number.
        _EXPLAINED[key] = blur, explain(seen, blur, noise, rivals or {}, coded=coded)
    return _EXPLAINED[key][1]


@pytest.fixture(autouse=True)
def asked_once(monkeypatch):
    monkeypatch.setattr("maskfab.camera.photo.explain", explained_once)


@cache
def scene(number):
    values = dead_leaves(number, 512, 512).values[:, : SIDE + 2 * ROOM, : SIDE + 2 * ROOM]
    return light_of_code(values)


def taken(number, kernels, white_e, seed):
    """A record and the truth behind it, [3, SIDE, SIDE]."""
    draw, light = np.random.default_rng(seed), scene(number)
    seen = np.stack([signal.fftconvolve(*pair, mode="same") for pair in zip(light, kernels, strict=True)])
    inner = (slice(None), slice(ROOM, -ROOM), slice(ROOM, -ROOM))
    clean = np.maximum(seen[inner], 0)
    counted = draw.poisson(clean * white_e) + READ_E * draw.standard_normal(clean.shape)
    return (counted / white_e).astype(np.float32), light[inner]


def photographed(record, white_e, noise=1.0):
    """A record as a photograph whose noise was stated, so many times what it is."""
    told = Noise(white_e / noise**2, READ_E / noise)
    return Photo("p", "", Record(record, told), (1.0, 1.0, 1.0), np.eye(3), (), noise_stated=True)


def psnr(found, light):
    """In linear light after the best gain, without 32 pixels at each edge."""
    found, light = (np.clip(values[:, 32:-32, 32:-32].astype(np.float64), 0, 1) for values in (found, light))
    gain = (found * light).sum() / np.square(found).sum()
    return -10 * np.log10(np.square(gain * found - light).mean())


def coded(values, tmp_path, name):
    """The photograph that a camera would have written as codes of 8 bits."""
    codes = srgb8(values).transpose(1, 2, 0)
    path = tmp_path / f"photo.{name}"
    Image.fromarray(codes).save(path, **({"quality": 88} if name == "jpg" else {}))
    return read_photo(path, Stated())


def case(number, tmp_path):
    """A photograph, the blur that it is said to have, the record, the truth and what is wrong."""
    kind, draw = KINDS[number % len(KINDS)], np.random.default_rng(1000 + number)
    names = list(dies())
    die = names[number // len(KINDS) % len(names)]
    white_e = LEVELS[number // (len(KINDS) * len(names)) % len(LEVELS)]
    of_scene = 1 + number % 5
    noise, blur, setting = 1.0, designed(die), {}
    if kind == "scale":
        setting = {"scale": float(draw.choice([0.95, 0.975, 1.025, 1.05]))}
    if kind == "turn":
        setting = {"turn": float(draw.choice([-3.0, -1.5, 1.5, 3.0]))}
    if kind == "die":
        blur = designed(str(draw.choice([name for name in names if name != die])))
    if kind == "focus":
        setting = {"waves": 0.25}
        blur = MeasuredBlur(spread(die, waves=-0.25), (PIXELS // 2.0, PIXELS // 2.0), ())
    if kind == "noise":
        noise = float(draw.choice([1 / 4, 1 / 2, 2, 4]))
    record, light = taken(of_scene, spread(die, **setting), white_e, number)
    if kind == "smoothed":
        record = ndimage.gaussian_filter(record, (0, 0.7, 0.7))
    if kind in ("8 bits", "jpeg"):
        photo = coded(record, tmp_path, "png" if kind == "8 bits" else "jpg")
    else:
        photo = photographed(record, white_e, noise)
    return photo, blur, photo.record.values, light, f"{kind} {die} {white_e:g} {setting} scene {of_scene}"


def gained(number, tmp_path):
    """Decibels of the restored picture above the record, the verdict, and what is wrong."""
    photo, blur, record, light, words = case(number, tmp_path)
    _, won, found, _ = restored_light(photo, blur, (Wiener(),), chosen=False, epsilon=None, bin=False)
    return psnr(won.picture, light) - psnr(record, light), found.verdict, words


# Of another die, and out of focus: they lost up to 3 dB while the PSF was trusted or its halo taken for the record's.
@pytest.mark.parametrize("number", [50, pytest.param(75, marks=pytest.mark.slow)])
def test_a_restored_photograph_is_no_worse_than_the_record(number, tmp_path):
    gain, verdict, words = gained(number, tmp_path)
    assert gain >= -0.1, (words, verdict)


@pytest.mark.slow
def test_no_restored_photograph_of_200_is_worse_than_the_record(tmp_path):
    results = [gained(number, tmp_path) for number in range(200)]
    assert min(gain for gain, *_ in results) >= -0.1, min(results)
    wrong = [verdict for number, (_, verdict, _) in enumerate(results) if KINDS[number % len(KINDS)] == "die"]
    assert wrong.count(FOREIGN) >= 0.7 * len(wrong)


def test_a_wrong_die_is_told_and_the_right_one_is_not_refused():
    record, _ = taken(2, spread("bars"), 20000.0, 1)
    seen = Record(record, Noise(20000.0, READ_E))
    noise, said = noise_of(seen, stated=True)
    right, wrong = (explained_once(seen, designed(die), noise) for die in ("bars", "scattered"))
    assert not said
    assert right.verdict == EXPLAINED
    assert (right.setting.scale, right.setting.turn) == pytest.approx((1.0, 0.0), abs=0.02)
    assert wrong.verdict == FOREIGN
    # Another die of the job is named where it explains more.
    beaten = explain(seen, designed("stripes"), noise, {"bars": designed("bars")})
    assert (beaten.verdict, beaten.rival and beaten.rival[0]) == (FOREIGN, "bars")


def test_a_stop_of_few_cells_is_told_by_structure_as_wide_as_a_scenes():
    """What is wide in |H|² once passed for the scene's: 0.1 to 0.2 of it was found behind the right die."""
    record, light = taken(2, spread("scattered", stop_um=1600.0), 20000.0, 1)
    seen = Record(record, Noise(20000.0, READ_E))
    noise, _ = noise_of(seen, stated=True)
    right, wrong = (explain(seen, designed(die, "1.6 mm"), noise) for die in ("scattered", "bars"))
    assert (right.verdict, wrong.verdict) == (EXPLAINED, FOREIGN)
    assert right.share > 0.8
    assert right.setting.gain == pytest.approx(right.power.expected, abs=3 * right.power.deviation)
    assert right.power.told > 0.95
    assert f"with {100 * right.power.told:.0f} %" in right.sentence
    # The strength of the scene behind the blur: that of the record alone lost up to 10 dB.
    blur, spectrum = designed("scattered", "1.6 mm"), Seen.of(record, noise)
    restorer = Wiener().prepare(seen, blur)
    best = max(psnr(restorer(epsilon), light) for epsilon in np.geomspace(1e-4, 1, 13))
    strength = Comparison(spectrum, Shape.of(blur, spectrum.plane)).strength()
    assert psnr(restorer(strength), light) > best - 0.5


def test_a_photograph_that_could_tell_nothing_refuses_nothing_and_names_no_die():
    record, _ = taken(4, spread("bars"), 10.0, 1)
    seen = Record(record, Noise(10.0, READ_E))
    noise, _ = noise_of(seen, stated=True)
    found = explain(seen, designed("bars"), noise, {"lattice": designed("lattice")})
    assert found.power.told < 0.9
    assert (found.verdict, found.rival) == (UNSURE, None)


@pytest.mark.parametrize("asked", [{"trust": True, "epsilon": None}, {"epsilon": 0.01}])
def test_a_psf_is_undone_as_it_is_said_to_be_if_trusted_or_a_strength_is_given(asked):
    """Behind another die: the same picture as by the restorer alone, and a verdict that says so."""
    record, _ = taken(2, spread("bars"), 20000.0, 1)
    photo = photographed(record, 20000.0)
    wrong = designed("scattered")
    _, won, found, _ = restored_light(photo, wrong, (Wiener(),), chosen=False, bin=False, **asked)
    alone = restored(photo.record, wrong, (Wiener(),), asked["epsilon"])
    np.testing.assert_array_equal(won.picture, alone.picture)
    assert found.verdict == FOREIGN
    assert found.trusted
    assert "undone as it is said to be" in found.sentence
    assert any("--trust" in step for step in found.advice)


def test_a_photograph_without_a_display_stays_as_it_was_taken():
    """While the PSF was trusted this lost 14 dB; light below 0 tells it, whatever the scene's spectrum."""
    record, light = taken(3, np.pad(np.ones((3, 1, 1)), ((0, 0), (96, 96), (96, 96))), 3000.0, 5)
    photo = photographed(record, 3000.0)
    _, won, found, _ = restored_light(photo, designed("bars"), (Wiener(),), chosen=False, epsilon=None, bin=False)
    assert found.verdict == FOREIGN
    assert found.wrong[0] > 0.05
    assert psnr(won.picture, light) >= psnr(record, light) - 0.1


def test_behind_the_right_die_nothing_is_given_away():
    record, light = taken(2, spread("bars"), 20000.0, 1)
    photo = photographed(record, 20000.0)
    safe, trusting = (
        restored_light(photo, designed("bars"), (Wiener(),), chosen=False, epsilon=None, bin=False, trust=trust)[1]
        for trust in (False, True)
    )
    assert psnr(safe.picture, light) > psnr(record, light) + 3
    assert psnr(safe.picture, light) > psnr(trusting.picture, light) - 1.5


def test_scale_and_turn_are_found():
    record, _ = taken(2, spread("scattered", scale=1.03, turn=2.0, pixels=129), 20000.0, 2)
    seen = Record(record, Noise(20000.0, READ_E))
    found = explain(seen, designed("scattered"), noise_of(seen, stated=True)[0]).setting
    # A picture that is larger has lower frequencies.
    assert found.scale == pytest.approx(1.03, abs=0.008)
    assert abs(np.degrees(found.turn)) == pytest.approx(2.0, abs=0.4)


@pytest.mark.parametrize("factor", [1 / 4, 4.0])
def test_noise_that_is_stated_wrong_is_told(factor):
    record, _ = taken(4, spread("bars"), 3000.0, 3)
    noise, said = noise_of(Record(record, Noise(3000.0 / factor**2, READ_E / factor)), stated=True)
    true = Noise(3000.0, READ_E).variance(np.maximum(record, 0)).mean(axis=(1, 2))
    assert said
    assert [one.level for one in noise] == pytest.approx(list(true), rel=0.5)


@pytest.mark.parametrize("full", [0.5, 0.3])
def test_what_is_full_does_not_pass_for_calm(full):
    """Once the calmest blocks were those of a white sky, and noise a billionth of what it was."""
    record, _ = taken(4, spread("bars"), 3000.0, 5)
    cut, known = np.minimum(record, full).astype(np.float32), Noise(3000.0, READ_E)
    found, said = noise_of(Record(cut, known, ceiling=full))
    assert (cut == np.float32(full)).mean() > 0.05
    assert not said
    assert [one.level for one in found] == pytest.approx(known.variance(np.maximum(cut, 0)).mean(axis=(1, 2)).tolist())


def test_a_picture_without_anything_in_it_is_restored_without_a_warning():
    seen = Record(np.full((3, 256, 256), 0.2, dtype=np.float32), Noise(1e7, 0.0))
    found = explain(seen, designed("bars"), noise_of(seen)[0])
    assert all(np.isfinite(one.level) for one in found.noise)
    assert np.isfinite(found.strength)


def test_smoothed_noise_is_told_by_its_spectrum_and_made_white():
    record, _ = taken(4, spread("bars"), 300.0, 4)
    smooth = ndimage.gaussian_filter(record, (0, 0.7, 0.7))
    seen = Record(smooth, estimated_noise(list(smooth)))
    noise, said = noise_of(seen)
    assert "smoothed" in said[0]
    for f in (0.1, 0.2, 0.3):
        passed = np.exp(-((2 * np.pi * f * 0.7) ** 2))
        true = Noise(300.0, READ_E).variance(np.maximum(record, 0)).mean() * passed
        assert noise[1].on(np.array([f]))[0] == pytest.approx(true, rel=0.5)
    again, _ = noise_of(whitened(seen, noise))
    # Nothing is raised more than fourfold.
    assert max(one.ratio for one in again) < max(one.ratio for one in noise) / 5


def test_a_photograph_smaller_than_the_psf_crops_it_and_says_what_light_that_loses():
    kernels = spread("bars")
    blur, said = MeasuredBlur(kernels, (96.0, 96.0), ()).within(129, 129)
    assert blur.kernels.shape == (3, 129, 129)
    assert blur.centre == (64.0, 64.0)
    assert blur.kernels.sum(axis=(1, 2)) == pytest.approx(1)
    lost = 1 - kernels[:, 32:161, 32:161].sum(axis=(1, 2)).mean()
    assert f"{100 * lost:.2g} % of its light" in said[0]
