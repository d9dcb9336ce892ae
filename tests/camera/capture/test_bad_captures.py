"""Captures that no measurement can be made of: refused with their code, or CANNOT TELL with its cause."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from capture_simulator import Dots, Optics, Sensor, Stack, picture, srgb8
from optics_cases import camera, noise, panel

from maskfab.base.errors import SourceError
from maskfab.camera.frames.frame import frame_of_array, same_sensor
from maskfab.camera.frames.merge import merged
from maskfab.camera.frames.stack import light_place, window_middle
from maskfab.camera.inspection.die_verdict import Answer
from maskfab.camera.inspection.measurement import measured
from maskfab.optics.spectrum import line_spectrum

CAMERA = camera(diameter_um=800.0, window_um=128.0)
DIES = {name: panel(noise(8, 0.45, seed), cells=14, seed=5) for name, seed in (("ONE", 3), ("OTHER", 4))}
OPTICS = Optics(800.0, CAMERA.focal_um, CAMERA.pixel_um, 64, {530.0: 1.0})
LIGHT = {"-": line_spectrum([530.0])}
NOISE = {"electrons_per_count": 1.3, "read_noise_e": 4.87}


@pytest.fixture(scope="module")
def light():
    return picture(Dots.of(DIES["ONE"]), OPTICS)


def told(frames, dies=("ONE", "OTHER"), **given):
    light_place(frames, 64)
    merging = merged(frames, **NOISE)
    return measured(merging, {name: DIES[name] for name in dies}, CAMERA, LIGHT, others=DIES, priced=False, **given)


def refused(code, work):
    with pytest.raises(SourceError) as caught:
        work()
    assert caught.value.code == code, caught.value
    assert caught.value.cure
    return caught.value


def test_frames_of_two_cameras_are_refused(light):
    one, two, *_ = Stack(light).frames(0)
    said = refused("MF331", lambda: same_sensor([replace(one, camera="A"), replace(two, camera="B")]))
    assert "camera" in said.what


def test_frames_of_two_dies_in_one_stack_tell_nothing(light):
    other = picture(Dots.of(DIES["OTHER"]), OPTICS)
    frames = Stack([light, light, other, other]).frames(0)
    found = told(frames)
    assert (found.verdict.answer, found.verdict.cause) == (Answer.CANNOT_TELL, "drift")


def test_frames_upside_down_are_told(light):
    frames = Stack(light).frames(0)
    flipped = [replace(each, counts=each.counts[::-1].copy()) for each in frames]
    found = told([*frames[:2], *flipped[2:]])
    assert (found.verdict.answer, found.verdict.cause) == (Answer.CANNOT_TELL, "drift")
    found = told(flipped)
    assert (found.verdict.answer, found.verdict.cause) == (Answer.CANNOT_TELL, "wrong setting")
    assert "not flipped" in found.verdict.next_step


def test_a_crop_through_the_peak_is_refused(light):
    frames = [replace(each, counts=each.counts[:, 30:].copy()) for each in Stack(light).frames(0)]
    refused("MF337", lambda: window_middle(light_place(frames, 32), frames[0], 32))


def test_codes_of_a_display_are_refused(light):
    codes = srgb8(light / light.max())
    refused("MF330", lambda: frame_of_array(codes, "codes"))
    refused("MF330", lambda: frame_of_array(257 * codes.astype(np.uint16), "codes"))


@pytest.mark.slow
def test_a_curve_that_is_not_linear_is_no_answer(light):
    """Codes of sRGB that were written as counts of 16 bits, each its own: nothing of the file tells."""
    frames = Stack(light, (1.0,), peak_e=4e4).frames(0)
    shares = np.clip((frames[0].counts - 512) / 65023, 0, 1)
    bent = 512 + 65023 * np.where(shares <= 0.0031308, 12.92 * shares, 1.055 * shares ** (1 / 2.4) - 0.055)
    found = told([replace(frames[0], counts=np.rint(bent).astype(np.float32))], ("ONE",))
    assert found.verdict.answer is Answer.CANNOT_TELL
    assert found.verdict.factor > 5
    assert not {"captured_cd_bias", "captured_term"} & {each.name for each in found.quantities}


def test_a_black_level_that_is_not_stated_is_refused_of_a_stack_and_tells_nothing_of_a_frame(light):
    frames = [replace(each, black=(0.0,)) for each in Stack(light).frames(0)]
    said = refused("MF333", lambda: told(frames))
    assert "--black 5" in said.cure
    found = told(frames[:1])
    assert (found.verdict.answer, found.verdict.cause) == (Answer.CANNOT_TELL, "wrong noise")


def test_a_lamp_wider_than_the_window_is_refused():
    frames = Stack(np.full((64, 64), 1e-3), (1.0, 4.0)).frames(0)
    refused("MF334", lambda: told(frames))


def test_one_frame_alone_is_measured(light):
    found = told(Stack(light, (4.0,)).frames(0))
    assert found.verdict.answer is Answer.ACCEPT
    assert found.drifts == (1.0,)


def test_stacks_that_are_full_or_dark_are_refused_before_any_fit(light):
    sensor = Sensor(white=4095.0)
    refused("MF334", lambda: told(Stack(light, times=(1.0, 2.0), beneath_e=1e5, sensor=sensor).frames(0)))
    refused("MF334", lambda: told(Stack(0 * light + 1e-9, peak_e=1e-3, beneath_e=0.0).frames(0)))


def test_a_centre_that_is_full_in_all_frames_is_refused_before_any_fit(light, monkeypatch):
    monkeypatch.setattr("maskfab.camera.inspection.measurement.identified", None)
    said = refused("MF334", lambda: told(Stack(light, peak_e=2e4, sensor=Sensor(white=8000.0)).frames(0)))
    assert "at the centre of the light are full in all 4 frames" in said.what
    assert "four times shorter than 1.tif" in said.cure


def test_a_full_well_below_the_stated_white_is_refused(light):
    sensor = Sensor(full_well_e=2e4)
    said = refused("MF333", lambda: told(Stack(light, peak_e=1e4, sensor=sensor).frames(0)))
    assert "--white 15" in said.cure


def test_another_die_than_was_asked_for_is_named(light):
    said = refused("MF339", lambda: told(Stack(light).frames(0), ("OTHER",)))
    assert said.cure == "This is die ONE: name it (--die ONE)"
