"""ACCEPT, REJECT or CANNOT TELL of captures from a simulator that shares no optics with the fit."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from camera.capture.captured_dies import BLACK, GAIN, READ_NOISE, exposed
from capture_simulator import Dots, Optics, Sensor, Stack, picture
from diagnosis_table import COLOUR, GREY
from diagnosis_table import named as names_of
from diagnosis_table import told as of_bench
from measure_table import KINDS, verdicts
from once import once
from optics_cases import camera, noise, panel

import maskfab as mf
from maskfab.base.errors import SourceError
from maskfab.camera.frames.merge import merged
from maskfab.camera.inspection.diagnosis import Cause, Suspect, deciding_frame
from maskfab.camera.inspection.die_image import DieImage, Lamp, Pixels, Setting
from maskfab.camera.inspection.die_verdict import Answer, Promise
from maskfab.camera.inspection.die_verdict import strength as strength_words
from maskfab.camera.inspection.measurement import measured
from maskfab.optics.spectrum import line_spectrum
from maskfab.report.pages.measured import capture_document, capture_page

CAMERA = camera(diameter_um=800.0, window_um=128.0)
DIES = {name: panel(noise(8, 0.45, seed), cells=14, seed=5) for name, seed in (("ONE", 3), ("OTHER", 4))}
LIGHT = {"-": line_spectrum([530.0])}
OPTICS = Optics(800.0, CAMERA.focal_um, CAMERA.pixel_um, 64, {530.0: 1.0})
BIAS_UM, LAMP_UM = 0.1, (20.0, -31.0)
FINDINGS = {"captured_cd_bias", "captured_turn", "captured_scale", "captured_term"}


@pytest.fixture(scope="module")
def die():
    return Dots.of(DIES["ONE"]).grown(BIAS_UM)


@pytest.fixture(scope="module")
def light(die):
    return picture(die, OPTICS)


@pytest.fixture
def seen_once():
    """For tests that judge one capture by several promises."""
    with once(*(f"maskfab.camera.inspection.measurement.{name}" for name in ("identified", "explained"))):
        yield


def told(stack, tolerance_um=0.25):
    merging = merged(stack.frames(7), electrons_per_count=1.3, read_noise_e=4.87)
    return measured(merging, DIES, CAMERA, LIGHT, promise=Promise(ordered_um=tolerance_um), priced=False)


def value(found, name):
    return next(each for each in (*found.quantities, *found.if_numbers) if each.name == name)


def holds(found, name, truth):
    each = value(found, name)
    return abs(each.value - truth) < 1.7 * each.uncertainty


@pytest.mark.usefixtures("seen_once")
@pytest.mark.parametrize(("tolerance_um", "answer"), [(0.25, "ACCEPT"), (0.05, "REJECT"), (0.1, "CANNOT TELL")])
def test_a_width_is_accepted_rejected_or_its_interval_holds_the_limit(light, tolerance_um, answer):
    found = told(Stack(light), tolerance_um)
    assert found.verdict.line.startswith(f"{answer}: ")
    assert holds(found, "captured_cd_bias", BIAS_UM)
    stated = {each.name for each in found.quantities}
    assert (FINDINGS & stated == set()) == (answer == "CANNOT TELL")
    assert value(found, "captured_cd_bias").passed is {"ACCEPT": True, "REJECT": False, "CANNOT TELL": None}[answer]
    if answer == "CANNOT TELL":
        assert found.verdict.cause == Cause.INTERVAL
        assert any(sentence.startswith("CD +0.") for sentence in found.if_sentences)
        assert not any(sentence.startswith("CD") for sentence in found.sentences)


def test_a_second_lamp_is_found_with_its_power_and_place_and_drawn(die, light):
    found = told(Stack(light + 0.02 * picture(die, OPTICS, LAMP_UM)))
    assert found.verdict.answer is Answer.ACCEPT
    lamp = value(found, "captured_lamp")
    assert abs(lamp.value / 0.02 - 1) < 0.05
    assert holds(found, "captured_lamp", 0.02)
    assert (value(found, "captured_lamp_x").value, value(found, "captured_lamp_y").value) == pytest.approx(
        LAMP_UM, abs=0.05
    )
    assert holds(found, "captured_cd_bias", BIAS_UM)
    assert any(sentence.startswith("A second lamp of 2.0") for sentence in found.sentences)
    document = capture_document(found, "0" * 64, ())
    assert document["lamp"]["share"] == lamp.value
    page = capture_page(found, document, ("A note.",))
    assert "Marked in blue: a second lamp" in page
    order = [found.verdict.line, "<figure", "What to do next", "Numbers", "Appendix", "A note."]
    assert [page.index(word) for word in order] == sorted(page.index(word) for word in order)


def test_a_lamp_and_its_slopes_are_those_of_the_die_s_picture_moved():
    axis = CAMERA.pixel_um * (np.arange(41) - 20.0)
    image = DieImage.of(DIES["ONE"], 0, CAMERA, LIGHT, [Pixels("-", axis, -axis)], 60.0)
    at = Setting(0.4, -0.3, 0.004, 2e-4, 0.1, ((4, 0.06),), Lamp(11.0, -17.0, 0.3))
    (both,), (alone,) = image.pictures(at), image.pictures(replace(at, lamp=None))
    (moved,) = image.pictures(replace(at, lamp=None, x_um=11.4, y_um=-17.3))
    assert both == pytest.approx(alone + 0.3 * moved, abs=1e-15)
    steps = np.array([0.02, 0.02, 1e-3, 1e-4, 1e-2, 0.02, 0.02, 1e-3, 1e-3])
    for k, slope in enumerate(image.slopes(at)):
        change = np.zeros(steps.size)
        change[k] = steps[k]
        (ahead,), (behind,) = image.pictures(at.at(at.values + change)), image.pictures(at.at(at.values - change))
        expected = (ahead - behind) / (2 * steps[k])
        assert np.linalg.norm(slope[0] - expected) < 3e-2 * np.linalg.norm(expected), at.names[k]


def test_dust_is_left_out(light):
    dust = np.ones((64, 64))
    dust[20:24, 30:34] = 0.6
    found = told(Stack(light, dust=dust))
    assert found.verdict.answer is Answer.ACCEPT
    assert found.explained.left_out.dust[0][20:24, 30:34].all()
    assert found.explained.left_out.counts["dust"] < 100
    assert holds(found, "captured_cd_bias", BIAS_UM)
    assert value(found, "captured_misfit").value == pytest.approx(1, abs=0.1)


def test_gains_of_exposures_are_fitted_and_widen_the_interval(light):
    drift = (1.0, 1.03, 0.97, 1.02)
    found = told(Stack(light, drift=drift))
    assert found.drifts == pytest.approx(np.array(drift) / 1.02, abs=0.02)
    assert holds(found, "captured_cd_bias", BIAS_UM)
    assert "Light of exposures differs" in " ".join(found.sentences)


def test_full_pixels_and_what_they_spill_over_are_left_out(light):
    well = 3e4
    sensor = Sensor(full_well_e=well, white=float(np.rint((well - 25) / 1.3 + 512)))
    found = told(Stack(light, sensor=sensor))
    assert found.verdict.answer is Answer.ACCEPT
    assert holds(found, "captured_cd_bias", BIAS_UM)


def test_a_die_that_the_job_does_not_have_is_not_taken_for_another_lamp():
    """Of its picture a lamp explained a little, and the verdict spoke of lights."""
    cells = (mf.Opening.bar(dots=7, size=size, pitch="56 um") for size in ((5, 3), (3, 3)))
    right, wrong = (mf.Panel.tile(cell, "random", seed=1 + 8 * k, size="1.12 mm") for k, cell in enumerate(cells))
    seen = merged(Stack(picture(Dots.of(wrong), OPTICS)).frames(1), electrons_per_count=1.3, read_noise_e=4.87)
    with pytest.raises(SourceError, match="like none of the dies BAR"):
        measured(seen, {"BAR": right}, CAMERA, LIGHT, priced=False)


def test_rows_with_offsets_are_told_nothing_of(light):
    found = told(Stack(light, sensor=Sensor(banding_e=6.0)))
    assert (found.verdict.answer, found.verdict.cause) == (Answer.CANNOT_TELL, Cause.ROWS)
    assert not FINDINGS & {each.name for each in (*found.quantities, *found.if_numbers)}
    assert len(found.sentences) == 1


@pytest.mark.parametrize(
    ("bench", "kind", "strength", "named"),
    [
        (GREY, "black", 3.0, "black level"),
        (GREY, "gamma", 0.015, "tone curve"),
        (GREY, "glare", 0.012, "glare"),
        (GREY, "shading", 0.06, "lens shading"),
        (GREY, "response", 0.03, "unlike pixels"),
        (GREY, "columns", 5.0, "columns"),
        (GREY, "hot", 60.0, "hot pixels"),
        (GREY, "dead", 0.003, "dead pixels"),
        (GREY, "second lamp", 0.01, "second lamp"),
        (GREY, "flicker", 0.03, "drift"),
        (COLOUR, "black", 3.0, "black level"),
        (COLOUR, "hot", 60.0, "hot pixels"),
        (COLOUR, "second lamp", 0.01, "second lamp"),
        (COLOUR, "columns", 5.0, "columns"),
    ],
    ids=lambda value: ("grey" if value is GREY else "colour") if value in (GREY, COLOUR) else None,
)
def test_faults_are_named_on_any_sensor_and_no_width_is_told_wrong(bench, kind, strength, named):
    found = of_bench(bench, kind, strength, 5)
    assert named in names_of(found)
    stated = [each for each in (*found.quantities, *found.if_numbers) if each.name == "captured_cd_bias"]
    assert all(abs(each.value - BIAS_UM) < 2 * each.uncertainty for each in stated)
    if found.verdict.answer is Answer.CANNOT_TELL:
        first = found.suspects[0]
        assert strength_words(first) in found.verdict.reason
        assert found.explained.mended == bool(stated)


def test_the_frame_that_tells_two_likely_faults_apart_is_asked_for():
    black, rows, glare = (Suspect(cause, 1.0, 0.1, 90.0) for cause in (Cause.BLACK, Cause.ROWS, Cause.GLARE))
    assert "dark frame" in deciding_frame([black, glare])
    assert "dark frame" in deciding_frame([rows, black])
    assert "without the plate" in deciding_frame([glare, black])
    assert deciding_frame([black]) is None


@pytest.mark.slow
def test_two_more_lamps_are_told_nothing_of(die, light):
    both = light + 0.02 * picture(die, OPTICS, LAMP_UM) + 0.015 * picture(die, OPTICS, (-33.0, 14.0))
    found = told(Stack(both))
    assert (found.verdict.answer, found.verdict.cause) == (Answer.CANNOT_TELL, Cause.LAMP)
    assert found.verdict.factor > 5
    assert "times the noise" in found.verdict.reason


def test_waves_are_those_of_the_line_that_is_named(monkeypatch):
    """Told in waves of the camera's 610 nm, 0.05 waves of 530 nm were 0.043."""
    monkeypatch.setattr("maskfab.camera.inspection.measurement.costs", lambda *_: [])
    bar = mf.Opening.bar(dots=7, size=(5, 3), pitch="56 um")
    tiled = mf.Panel.tile(bar, "random", seed=1, size="1.12 mm")
    seen = mf.Camera("10 mm", stop="800 um", pixel="2 um", window="128 um", wavelengths=["610 nm", "530 nm", "470 nm"])
    light = picture(Dots.of(tiled), replace(OPTICS, terms={4: 0.05}))
    frames = [each.counts.astype(np.uint16) for each in Stack(light).frames(1)]
    found = mf.measure(
        frames, tiled, seen, line="530 nm", times=["1 ms", "4 ms", "16 ms", "64 ms"], gain=1.3, read_noise=4.87,
        black=512, window=64,
    )  # fmt: skip
    assert "in waves of 530 nm" in " ".join((*found.found.sentences, *found.found.if_sentences))
    defocus = value(found.found, "captured_term")
    assert abs(defocus.value - 0.05) < 1.7 * defocus.uncertainty < 0.005


@pytest.mark.slow
def test_no_draw_of_any_fault_is_judged_wrongly():
    tables = [verdicts(kind, 23) for kind in KINDS]
    assert sum(sum(each.answers.values()) for each in tables) >= 200
    assert [each.wrong for each in tables] == [[]] * len(KINDS)
    for each in tables:
        assert not each.missed
        assert all(abs(share - 1) < 0.05 for share in each.lamps)
        for name, held in each.covered.items():
            assert np.mean(held) > 0.9 - 1.65 * np.sqrt(0.09 / len(held)), (each.kind, name)


def test_a_sensor_of_three_colours_is_measured(die):
    """The die is told by one colour, and fitted to all."""
    lines = {"R": 610.0, "G": 530.0, "B": 470.0}
    seen = {colour: picture(die, replace(OPTICS, lines={line: 1.0})) for colour, line in lines.items()}
    rows, columns = np.indices(seen["G"].shape)
    mosaic = np.choose(rows % 2 + columns % 2, [seen["R"], seen["G"], seen["B"]])
    frames = [
        replace(frame, pattern=("RG", "GB"), black=(BLACK,) * 4)
        for frame in exposed(mosaic, (1.0, 8.0, 64.0), 2e4, seed=3)
    ]
    merging = merged(frames, electrons_per_count=GAIN, read_noise_e=READ_NOISE)
    light = {colour: line_spectrum([line]) for colour, line in lines.items()}
    found = measured(merging, DIES, CAMERA, light, promise=Promise(ordered_um=0.25), priced=False)
    assert found.identified.best.die == "ONE"
    assert holds(found, "captured_cd_bias", BIAS_UM)
    assert found.verdict.answer is Answer.ACCEPT
