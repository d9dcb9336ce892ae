"""Answers about a display: what is refused, how lengths move to one grid, and the job that is written."""

from __future__ import annotations

import math
import re
import tomllib
from dataclasses import replace

import numpy as np
import pytest

from maskfab.base.errors import JobError
from maskfab.base.model import Opening, Panel, Tiling
from maskfab.base.units import UM_PER_INCH
from maskfab.display.circuits import place_circuits
from maskfab.display.emitter_rules import MOST_CELLS, EmitterRules, Verdict, grid_of
from maskfab.display.feasibility import rules_of
from maskfab.job.brief import RULES, Brief, job_text, modules, snapped
from maskfab.job.read import validate
from maskfab.mask.opening_file import parse_opening

CAMERA = {"camera": "phone_main"}
PHONE = {"dpi": "400", **CAMERA}
LAPTOP = {"dpi": "220 dpi", "camera": "laptop", "lux": "300 lux"}
CAR = {"pitch": "150 dpi", "camera": "car_cabin", "lux": "100 lux"}


def test_lengths_that_moved_share_no_better_grid():
    """Once these had moved, 33 dots were better than the 28 that they had moved to."""
    rules = {"gap_to_opening": "16.02 um", "colour_gap": "15.46 um", "min_width": "8 um"}
    answers = {"pitch": "64.283 um", "camera": "phone_wide_pixel", "open": "0.108", "lines": "6", **rules}
    made = snapped(Brief.of(answers))
    again = snapped(made.brief)
    assert (again.dots, again.brief, again.moves) == (made.dots, made.brief, ())


def _grid(made):
    """The grid on which the display is judged, as its room finds it."""
    brief = made.brief
    rules = EmitterRules(*(round(getattr(brief, key) * 1000) for key in RULES))
    opening = Opening("x", np.eye(made.dots, dtype=bool), round(1000 * made.dot_um))
    return grid_of(opening, round(1000 * made.dot_um), 0, rules)


def test_answers_that_share_a_grid_stay_as_they_are():
    asked = {"gap_to_opening": "4 um", "colour_gap": "8 um", "min_width": "8 um"}
    made = snapped(Brief.of({"pitch": "168 um", "camera": "paper", **asked}))
    assert (made.brief.pitch, made.dots, made.cell_nm) == (168.0, 21, 4000)
    assert made.moves == ()


def test_a_phone_moves_by_less_than_a_percent_and_says_so():
    made = snapped(Brief.of(PHONE))
    (pitch,) = [move for move in made.moves if move.name == "pitch"]
    assert str(pitch) == "pitch 63.5 um -> 63 um, -0.8%: whole cells of 3 um"
    assert _grid(made).pitch_nm == round(1000 * made.brief.pitch) == 63_000


RULES_OF_4 = {"gap_to_opening": "4 um", "colour_gap": "8 um", "min_width": "8 um"}


@pytest.mark.parametrize(
    "answers",
    [{"pitch": "138.6 um", **RULES_OF_4, **CAMERA}, {"pitch": "139 um", **RULES_OF_4, **CAMERA}, PHONE, LAPTOP, CAR],
)
def test_lengths_that_are_told_to_have_a_finer_grid_are_given_it(answers):
    made = snapped(Brief.of(answers))
    dots, dot_um = re.search(r"near, (\d+) dots of ([\d.]+) um", made.finer).groups()
    lengths = dict(re.findall(r'(\w+) = "([\d.]+ um)"', made.finer))
    again = snapped(
        Brief.of(
            {
                **{key: value for key, value in answers.items() if key != "dpi"},
                "pitch": f"{made.brief.pitch} um",
                **lengths,
            }
        )
    )
    assert again.dots == int(dots) >= 1.25 * made.dots
    assert again.dot_um == pytest.approx(float(dot_um))
    assert f"# {made.finer}\n" in job_text(made)
    assert "not estimated" in made.finer


def test_a_pitch_one_per_cent_off_is_told_the_finer_grid_beside_it():
    made = snapped(Brief.of({"pitch": "138.6 um", **RULES_OF_4, **CAMERA}))
    assert made.dots == 23
    assert '35 dots of 4 um beside 23 dots of 6 um: answer pitch = "140 um" (+1.0%)' in made.finer


@pytest.mark.parametrize("seed", range(60))
def test_any_sensible_display_moves_a_little_to_a_grid_and_then_no_more(seed):
    draw = np.random.default_rng(seed)
    pitch = draw.uniform(40, 300)
    camera = draw.choice([name for name, module in modules().items() if module.stop_um > 4 * pitch])
    rules = {key: f"{draw.uniform(0.02, 0.13) * pitch:.3f} um" for key in RULES}
    brief = Brief.of({"pitch": f"{pitch:.3f} um", **rules, "camera": camera, "open": f"{draw.uniform(0.05, 0.3):.3f}"})
    made = snapped(brief)
    grid = _grid(made)
    assert grid.cells <= MOST_CELLS
    assert made.dots * round(1000 * made.dot_um) == round(1000 * made.brief.pitch)
    assert 16 <= made.dots <= 64
    assert abs(made.brief.pitch / brief.pitch - 1) <= 0.01 + 1e-9
    for key in RULES:
        asked, got = getattr(brief, key), getattr(made.brief, key)
        # A rule of a grid of whole nanometres is asked to the nanometre.
        assert -1e-3 < got - asked <= max(0.1 * asked, brief.pitch / 100) + 1e-3
    again = snapped(made.brief)
    assert (again.dots, again.brief, again.moves) == (made.dots, made.brief, ())


@pytest.mark.parametrize(
    ("answers", "code", "names"),
    [
        ({"pitch": "84 um"}, "MF151", "63.5 um.*84 um"),
        ({"emitters": "85 %", "open": "20 %"}, "MF151", "emitters = 85.0%.*open = 20.0%"),
        ({"lines": "20"}, "MF151", "lines = 20 .*pitch = 63.5 um"),
        ({"open": "60 %", "lines": "4"}, "MF151", "open = 60.0%.*lines = 4"),
        ({"min_width": "70 um"}, "MF151", "min_width = 70 um.*pitch = 63.5 um"),
        ({"colour_gap": "40 um"}, "MF151", "colour_gap = 40 um.*pitch"),
        ({"pitch": "4 mm"}, "MF151", "stop is 2532 um, and pitch = 4000 um"),
        ({"camera": "fone_main"}, "MF105", "fone_main.*did you mean 'phone_main'.*laptop".replace("did", "[Dd]id")),
        ({"camera": "car"}, "MF105", "'car'.*Did you mean 'car_cabin'"),
        ({"camera": "4 mm f/0.4 1.4 um"}, "MF131", "stop of 10000 um"),
        ({"camera": "4 mm f/-2 1.4 um"}, "MF105", "no camera"),
        ({"camera": {"focal": "4", "f_number": 2.0, "pixel": "1 um"}}, "MF103", "camera"),
        ({"camera": {"focal": "4 mm", "f_number": 2.0}}, "MF105", "pixel"),
        ({"camera": {"title": "a\nb = 3", "focal": "4 mm", "f_number": 2.0, "pixel": "1 um"}}, "MF105", "title"),
        ({"lux": "0.0001 lux"}, "MF141", "electrons.*read noise of 5.*lux or more"),
        ({"lux": "200"}, "MF103", "lux"),
        ({"lux": "-3 lux"}, "MF104", "lux"),
        ({"lux": "20000 lux", "time": "100 ms"}, "MF141", "a pixel holds 6000.*ms or less"),
        ({"delta_e": "-1"}, "MF104", "delta_e"),
        ({"grain": 0.0}, "MF104", "grain"),
        ({"life": "-3 %"}, "MF104", "life"),
        ({"delta_e": "small"}, "MF105", "delta_e"),
        ({"distance": "300"}, "MF103", "distance"),
        ({"pitch": "63"}, "MF103", "pitch"),
        ({"pitch": "-63 um"}, "MF104", "pitch"),
        ({"emitters": "120 %"}, "MF104", "emitters"),
        ({"lines": "two"}, "MF105", "lines"),
        ({"lines": "0"}, "MF104", "lines"),
        ({"layout": "hexagon"}, "MF105", "layout"),
        ({"time": "33"}, "MF103", "time"),
        ({"picth": "63 um"}, "MF102", "picth"),
        ({"name": "a b"}, "MF110", "name"),
    ],
)
def test_answers_that_cannot_be_are_refused_by_name(answers, code, names):
    with pytest.raises(JobError, match=f"(?s){code} .*{names}" if code != "MF102" else f"{code} .*{names}"):
        Brief.of({**(PHONE if "pitch" not in answers or "84 um" in answers.values() else CAMERA), **answers})


@pytest.mark.parametrize("answers", [{"lines": "12"}, {"emitters": "85 %"}])
def test_a_share_that_nobody_states_refuses_nothing(answers):
    brief = Brief.of({**PHONE, **answers})
    made = snapped(brief)
    assert made.clear_dots / made.dots**2 == pytest.approx(brief.slit, abs=0.02)
    assert brief.slit + brief.emitters <= 1
    assert "open = " not in job_text(made)


def test_a_pitch_and_a_camera_must_be_answered():
    with pytest.raises(JobError, match=r"MF105 no answer says pitch and camera.*the answers are pitch, camera, layout"):
        Brief.of({"lines": "2"})
    assert Brief.of({**PHONE, "pitch": "63.6 um"}).pitch == 63.6


def test_the_light_that_would_do_does():
    with pytest.raises(JobError) as refused:
        Brief.of({**PHONE, "lux": "0.001 lux"})
    enough = float(refused.value.cure.split("Give ")[1].split(" lux")[0])
    brief = Brief.of({**PHONE, "lux": f"{1.05 * enough} lux"})
    assert brief.camera.white(brief.lux, brief.time_s, brief.slit) >= brief.camera.read_noise


def test_a_bright_scene_is_exposed_for_less_time():
    dim, bright = (Brief.of({**PHONE, "lux": f"{lux} lux"}) for lux in (200, 20_000))
    assert dim.time_s == dim.camera.time
    assert bright.camera.white(bright.lux, bright.time_s, 0.65) == pytest.approx(0.8 * 6000, rel=1e-2)
    stated = Brief.of({**PHONE, "lux": "20000 lux", "open": "20 %"})
    assert stated.camera.white(stated.lux, stated.time_s, 0.2072) == pytest.approx(0.8 * 6000, rel=1e-2)


def test_every_camera_of_the_list_has_numbers_and_a_source():
    assert {"phone_main", "phone_front", "tablet", "laptop", "car_cabin", "paper"} <= modules().keys()
    assert modules()["paper"].stop_um == 4000
    for name, module in modules().items():
        assert "Judgement: " in module.source, name
        assert 500 < module.stop_um < 10_000
        assert module.read_noise < module.well / 100


def test_numbers_stand_for_a_camera():
    module = Brief.of({**PHONE, "camera": "4.38 mm f/1.73 1.4 um"}).camera
    assert (module.focal, module.pixel, module.stop_um) == (4380, 1.4, modules()["phone_main"].stop_um)
    assert module.well == round(3400 * 1.4**2)


@pytest.mark.parametrize(
    "answers", [PHONE, LAPTOP, {**CAR, "open": "15 %"}, {"pitch": "168 um", "camera": "paper", "sharing": "2"}]
)
def test_the_job_is_read_as_it_was_answered(answers):
    stated = {**answers, "delta_e": "2", "life": "40 %", "layout": "delta", "house": "generic-chrome"}
    made = snapped(Brief.of(stated))
    text = job_text(made)
    assert text == job_text(snapped(Brief.of(stated)))
    spec = validate(tomllib.loads(text), where="job.toml")
    assert spec.design.clear_dots == (made.clear_dots if "open" in answers else 0)
    assert spec.display.sharing == made.brief.sharing
    assert spec.emitters.required == pytest.approx(made.brief.emitters / 3, rel=1e-3)
    assert spec.exposure.luminance == pytest.approx(made.brief.lux / math.pi, rel=1e-5)
    assert spec.plate.die_size >= 1.25 * spec.camera.stop.diameter_um
    plain = parse_opening(spec.openings["as_is"])
    assert plain.clear_dots == made.clear_dots
    assert plain.cell_size.pitch_nm == round(1000 * made.brief.pitch)
    assert spec.export.shop == "generic-chrome"
    assert (spec.looks.delta_e, spec.looks.grain, spec.looks.reference, spec.lives.life) == (2.0, None, "delta", 0.4)
    assert spec.looks.distance == made.brief.distance
    # Whole rows of dots above and below the slit, in which the lines cross.
    closed_um = (plain.dots - plain.mask.any(axis=1).sum()) * made.dot_um
    assert closed_um >= made.brief.crossing_um


def test_the_name_of_a_house_is_one_text_of_the_job_whatever_is_in_it():
    name = 'a" b\n[camera] \\'
    spec = tomllib.loads(job_text(snapped(Brief.of({"pitch": "63 um", "camera": "phone_main", "house": name}))))
    assert spec["export"] == {"shop": name}


def test_gap_and_field_are_asked_and_stand_in_the_job_as_what_is_not_modelled():
    assert (Brief.of(PHONE).gap, Brief.of(PHONE).field) == (800.0, None)
    brief = Brief.of({**PHONE, "gap": "1.2 mm", "field": "30 deg"})
    text = job_text(snapped(brief))
    assert "scene" not in tomllib.loads(text)
    stated = "\n".join(line[2:] for line in text.splitlines() if re.match(r"# (\[scene\]|gap =|field =)", line))
    scene = validate({**tomllib.loads(text), **tomllib.loads(stated)}, where="job").scene
    assert (scene.gap, scene.field) == (1200.0, "30 deg")
    assert Brief.of({"device": "galaxy_z_fold_3", "camera": "2.4 mm"}).field == "40 deg"


def test_dots_per_inch_are_of_the_inch():
    assert Brief.of({**CAMERA, "dpi": "200"}).pitch == UM_PER_INCH / 200


@pytest.mark.parametrize("answers", [PHONE, LAPTOP, CAR, {"pitch": "46 um", "camera": "phone_main"}])
def test_the_pixel_around_holds_the_circuits_that_it_is_given(answers):
    made = snapped(Brief.of(answers))
    spec = validate(tomllib.loads(job_text(made)), where="job.toml")
    boxes = rules_of(spec, spec.emitters, "job.toml").boxes
    side_nm = round(1000 * spec.display.normal)
    closed = Opening("closed", np.zeros((1, 1), dtype=bool), side_nm)
    panel = Panel(closed, side_nm, 0, np.zeros((1, 1), dtype=np.int8), Tiling.PERIODIC, None)
    assert place_circuits(panel, closed, replace(boxes, shared_by=1)).verdict is Verdict.FITS
    # No larger than a panel on sale has them, nor than a third of the pixel.
    assert made.brief.circuit_um2 <= min(1985, made.brief.pitch**2 / 3)
    assert boxes.area_um2 / boxes.held < made.brief.circuit_um2
