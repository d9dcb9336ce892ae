"""A bench that is otherwise than its job states is fitted with the die, and said, of captures by other optics."""

from __future__ import annotations

import numpy as np
import pytest
from capture_simulator import MOSAIC, Dots, Optics, Stack, flat_band, lamp_picture, mosaic, picture
from optics_cases import camera, noise, panel

from maskfab.camera.frames.merge import merged
from maskfab.camera.inspection.bench import OF_PUPIL, STEPS
from maskfab.camera.inspection.die_image import DieImage, Pixels, Setting
from maskfab.camera.inspection.die_verdict import Answer, Promise
from maskfab.camera.inspection.measurement import measured
from maskfab.optics.spectrum import line_spectrum

BIAS_UM, SIDE = 0.3, 48
DIE = panel(noise(8, 0.45, 3), cells=14, seed=5)
COLOURS = {"R": 610.0, "G": 530.0, "B": 470.0}


def optics(diameter_um=800.0, lines=None, **more):
    return Optics(diameter_um, 1e4, 2.0, SIDE, lines or {530.0: 1.0}, **more)


def told(light, colours=None, *, priced=False):
    frames = Stack(light, pattern=MOSAIC if colours else None).frames(2)
    lines = colours or {"-": 530.0}
    before = camera(800.0, wavelengths=tuple(lines.values()), window_um=2.0 * SIDE)
    return measured(
        merged(frames, electrons_per_count=1.3, read_noise_e=4.87),
        {"ONE": DIE},
        before,
        {colour: line_spectrum([line]) for colour, line in lines.items()},
        promise=Promise(ordered_um=1.5),
        priced=priced,
    )


def holds(found, name, truth):
    number = next(each for each in found.quantities if each.name == name)
    return abs(number.value - truth) < 1.7 * number.uncertainty


def sure(found):
    assert found.verdict.answer is Answer.ACCEPT, found.verdict.line
    return holds(found, "captured_cd_bias", BIAS_UM)


@pytest.fixture(scope="module")
def dots():
    return Dots.of(DIE).grown(BIAS_UM)


def test_a_die_off_the_axis_is_found_where_it_stands(dots):
    """It left several times the noise, and nobody centres a plate to a micrometre."""
    found = told(picture(dots.moved(-23.0, 31.0), optics()))
    assert sure(found)
    assert holds(found, "captured_die_x", -23.0)
    assert holds(found, "captured_die_y", 31.0)
    assert any("The die's middle lies -23" in each for each in found.sentences)


def test_a_lens_far_out_of_focus_is_told(dots):
    """It was refused as light of no die: slopes in focus lead to the wrong side."""
    found = told(picture(dots, optics(terms={4: -0.22})))
    assert sure(found)
    assert abs(dict(found.fit.setting.terms)[4] + 0.22) < 0.01


def test_the_edge_of_a_die_within_the_stop_is_said_as_that(dots):
    """Features were told to be micrometres wider."""
    found = told(picture(dots.moved(120.0, 0.0), optics()))
    assert sure(found)
    assert any("The die's edge lies within the stop, by 72 um" in each for each in found.sentences)


def test_a_line_that_is_a_band_and_a_lamp_that_is_a_disc_are_told_as_they_are(dots):
    wide = told(picture(dots, optics(lines=flat_band(530.0, 30.0))))
    assert sure(wide)
    assert holds(wide, "captured_bandwidth", 30.0)
    lit = told(lamp_picture(dots, optics(), 10.0), priced=True)
    assert {each.of for each in lit.costs} >= {"bias_um"}
    assert sure(lit)
    assert holds(lit, "captured_light_width", 10.0)


def test_a_stop_of_another_size_is_told(dots):
    found = told(picture(dots, optics(808.0)))
    assert sure(found)
    assert holds(found, "captured_stop_diameter", 808.0)


@pytest.mark.slow
def test_a_barrel_that_cuts_the_light_is_told_beside_errors_of_the_lens(dots):
    found = told(picture(dots, optics(terms={5: 0.03, 11: -0.03}, barrel=(-200.0, -80.0, 480.0))))
    assert sure(found)
    depth = 400 + np.hypot(200, 80) - 480
    assert holds(found, "captured_vignetting_x", depth * 200 / np.hypot(200, 80))


def test_colours_that_focus_apart_are_told_of_a_mosaic(dots):
    waves = 0.06
    lights = {
        colour: picture(dots, optics(lines={line: 1.0}, terms={4: waves * (line - 610) / 100 * 610 / line}))
        for colour, line in COLOURS.items()
    }
    found = told(mosaic(lights), COLOURS)
    assert sure(found)
    assert holds(found, "captured_axial_colour", waves)


@pytest.mark.parametrize("name", [*OF_PUPIL[:3], "lateral_x_um", "axial_waves"])
def test_slopes_of_the_bench_are_those_of_pictures(name):
    axis = 2.0 * (np.arange(21) - 10)
    light = {colour: line_spectrum([line]) for colour, line in COLOURS.items()}
    before = camera(400.0, wavelengths=tuple(COLOURS.values()))
    image = DieImage.of(DIE, 1, before, light, [Pixels(colour, axis, -axis) for colour in COLOURS])
    at = Setting(bias_um=0.2, terms=((4, 0.1),), bench=((name, 1.0 if name in OF_PUPIL else 0.03),))
    step = 0.2 * STEPS[name]
    ahead, behind = (image.pictures(at.beside({name: dict(at.bench)[name] + sign * step})) for sign in (1, -1))
    slope = image.slopes(at)[at.names.index(name)]
    for one, other, told_slope in zip(ahead, behind, slope, strict=True):
        expected = (one - other) / (2 * step)
        assert np.linalg.norm(told_slope - expected) < 0.03 * np.linalg.norm(expected) + 1e-9
