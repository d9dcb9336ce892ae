"""Displays by what was found for a pixel: as found they pass; what was composed or drawn otherwise fails by name."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from asked_jobs import GUTTER, LETTER, RANDOM, asked_job

from maskfab.base.model import Emitters, Panel
from maskfab.base.work import silent
from maskfab.display import wiring
from maskfab.display.feasibility import displays
from maskfab.mask import outlines
from maskfab.mask.comparison.files import read_back
from maskfab.mask.houses.files import files_of_job
from maskfab.mask.houses.profiles import load_shop
from maskfab.mask.judge import awake
from maskfab.mask.judge.awake import missing
from maskfab.mask.judge.verdict import asked, judged
from maskfab.runs.plate_files import draw_files

DISPLAY = """
[emitters]
colour_gap = "2 um"
min_width = "4 um"
required = 0.05
[circuits]
boxes = [{ name = "a", width = "7 um", height = "3 um", count = 2 }, { name = "b", width = "4 um", height = "4 um" }]
gap = "1 um"
gap_to_opening = "1 um"
[wires]
line = "1 um"
space = "1 um"
clearance = "1 um"
lines = 2
"""
PLAIN = 'blank = "5 in"\nwritable = "100 mm"'
ONE = {"dies": (RANDOM,), "plate": PLAIN}
STATED = LETTER.replace("#", ".").replace("......", "RR..GG", 1)[:-6] + "...BBB"
"""Emitters in rows that the opening leaves closed."""


def made_of(job):
    built = displays(job)
    return built, draw_files(job, built.plate, displays=built.displays)


def opinion(job, built, plate=None):
    made = draw_files(job, plate or built.plate, displays=built.displays)
    return [row for row in judged(made.figures.layout(), "drawn", made.asked) if row.name == "judged_display"]


def words(rows):
    return "; ".join(row.method.partition("rules say")[2] for row in rows if not row.passed)


@pytest.fixture(scope="module")
def job():
    return asked_job(**ONE, more=DISPLAY)


@pytest.fixture(scope="module")
def built(job):
    return displays(job)


TRANSPARENT = DISPLAY + 'transparent = "2 um"\n'
JOBS = {
    "turned, with a gutter": {"dies": (RANDOM, GUTTER), "plate": PLAIN},
    "odd sizes, mirrored": {
        "dies": (GUTTER, RANDOM),
        "size": "0.501 mm",
        "more": '[order]\nparity = "wrong reading"\n',
    },
    "dark, narrowed, through the glass": {
        "dies": (RANDOM,),
        "more": '[order]\ntone = "dark"\nchrome = "down"\nbias = "data"\n[process]\ncd_bias = "0.2 um"\n',
    },
    "flat": {"dies": (RANDOM,), "more": '[export]\nhierarchy = "flat"\n'},
    "pairs of cells": {"dies": (RANDOM,), "more": "[export]\nmax_references = 60\n"},
    "a sheet beside pixels": {"dies": ('tiling = "hexagonal"\nseed = 2', 'tiling = "paper4"\nseed = 1')},
    "a data grid": {"dies": (RANDOM,), "more": '[export]\ngrid = "100 nm"\n'},
    "two openings": {"dies": ('tiling = "random"\nseed = 1\nothers = ["M"]',)},
    "a transparent wire": {**ONE, "display": TRANSPARENT},
    "shared circuits": {**ONE, "display": DISPLAY.replace("[wires]", "shared_by = 3\n[wires]")},
    "emitters of the opening": {**ONE, "edits": [(f"{LETTER}\n'''", f"{LETTER}\n'''\nemitters = '''\n{STATED}\n'''")]},
}


@pytest.mark.parametrize("kind", JOBS)
def test_displays_as_found_pass_however_they_are_drawn(kind):
    stated = dict(JOBS[kind])
    more = stated.pop("display", DISPLAY) + stated.pop("more", "")
    job = asked_job(**stated, more=more)
    built = displays(job)
    rows = opinion(job, built)
    assert words(rows) == ""
    assert [row.die for row in rows] == [die.name for die in job.spec.die]


def composed(built, change):
    """The plate, its panels changed, and lines across its dies as they are."""
    return replace(built.plate, dies=tuple(replace(die, panel=change(die.panel)) for die in built.plate.dies))


def relabelled(change):
    def changed(panel: Panel) -> Panel:
        return replace(panel, emitters=Emitters(change(panel.emitters.labels), panel.emitters.cell_nm))

    return changed


def exchanged(labels):
    return np.array([0, 3, 2, 1], dtype=np.int8)[labels]


def shortened(labels):
    row, column = np.argwhere(labels == 3)[0]
    cut = labels.copy()
    cut[row, column] = 0
    return cut


def boxes_at(x, y):
    def changed(panel: Panel) -> Panel:
        step = np.array([x, y, x, y])
        moved = (replace(box, box_nm=tuple((np.array(box.box_nm) + step).tolist())) for box in panel.circuits)
        return replace(panel, circuits=tuple(moved))

    return changed


def wires_at(x, y, axes="xy"):
    def changed(panel: Panel) -> Panel:
        return replace(
            panel,
            tracks=tuple(
                replace(track, polygons=tuple(tuple((px + x, py + y) for px, py in ring) for ring in track.polygons))
                if track.axis in axes
                else track
                for track in panel.tracks
            ),
        )

    return changed


COMPOSED = {
    "red and blue exchanged": (relabelled(exchanged), "RED is what should be BLUE"),
    "an emitter a piece short": (relabelled(shortened), "BLUE has another shape in cell 0, 0 from the lower left, and"),
    "no emitters": (lambda panel: replace(panel, emitters=None), "GREEN is missing"),
    "circuits a box short": (lambda panel: replace(panel, circuits=panel.circuits[1:]), "CIRCUIT: 8 of 9 boxes"),
    "circuits aside": (boxes_at(5000, 0), "CIRCUIT lies"),
    "wires aside": (wires_at(3000, 0), "from its place in cell"),
    "a wire short": (
        lambda panel: replace(
            panel, tracks=tuple(replace(track, polygons=track.polygons[1:]) for track in panel.tracks)
        ),
        "WIRE2 has another shape",
    ),
}


@pytest.mark.parametrize("fault", COMPOSED)
def test_displays_composed_otherwise_than_found_fail_by_name(fault, job, built):
    change, said = COMPOSED[fault]
    found = words(opinion(job, built, composed(built, change)))
    assert said in found


def test_wires_of_cells_that_lie_alike_are_told_by_how_far_they_are_off():
    job = asked_job(dies=('tiling = "periodic"',), plate=PLAIN, more=DISPLAY)
    built = displays(job)
    found = words(opinion(job, built, composed(built, wires_at(3000, 0))))
    assert "WIRE2 lies +3000 nm along x and +0 nm along y from its place" in found
    found = words(opinion(job, built, composed(built, boxes_at(0, -5000))))
    assert "CIRCUIT lies +0 nm along x and -5000 nm along y from its place" in found


@pytest.mark.parametrize(
    ("name", "change", "said"),
    [
        ("EMITTERS", lambda layers: layers[::-1], "RED is what should be BLUE"),
        ("WIRES", lambda layers: layers[::-1], "WIRE1 is what should be WIRE2"),
        (
            "orient",
            lambda true: lambda cell, turn: cell if cell.dtype == np.int8 else true(cell, turn),
            "RED is not turned",
        ),
    ],
)
def test_what_draws_them_otherwise_fails_by_name(name, change, said, job, built, monkeypatch):
    outlines._shapes.cache_clear()
    monkeypatch.setattr(outlines, name, change(getattr(outlines, name)))
    try:
        assert said in words(opinion(job, built))
    finally:
        outlines._shapes.cache_clear()


def answered(built, **parts):
    """Findings that claim to be whole, and a plate composed from them."""
    (name, found), (die,) = next(iter(built.displays.items())), built.plate.dies
    found = replace(found, **parts)
    panel = replace(die.panel, emitters=found.emitters, tracks=found.wiring.tracks, circuits=found.circuits.boxes)
    return replace(built, plate=replace(built.plate, dies=(replace(die, panel=panel),)), displays={name: found})


def wrong_answers(built):
    (found,) = built.displays.values()
    boxes, wires = found.circuits.boxes, found.wiring.tracks
    labels, cell = found.emitters.labels, found.emitters.cell_nm
    over = replace(boxes[0], box_nm=(8000, 8000, 8000 + 7000, 8000 + 3000))
    thin = tuple(
        replace(wire, polygons=tuple(tuple((2 * x // 3, 2 * y // 3) for x, y in ring) for ring in wire.polygons))
        for wire in wires
    )
    fewer = tuple(replace(wire, polygons=wire.polygons[1:]) for wire in wires)
    near = labels.copy()
    row, column = np.argwhere(labels == 1)[0]
    near[row, column + 1] = 2
    little = np.where((labels == 3) & (np.cumsum(labels == 3).reshape(labels.shape) > 3), 0, labels).astype(np.int8)
    yield {"circuits": replace(found.circuits, boxes=boxes[1:])}, "CIRCUIT: 8 of 9 boxes of their sizes in cell"
    yield {"circuits": replace(found.circuits, boxes=(over, *boxes[1:]))}, "CIRCUIT is over what is clear"
    yield {"circuits": replace(found.circuits, boxes=(*boxes, boxes[0]))}, "CIRCUIT: 9 of 9 boxes of their sizes"
    yield {"wiring": replace(found.wiring, tracks=thin)}, "is narrower than 1 um"
    yield {"wiring": replace(found.wiring, tracks=fewer)}, "wires beside each other, not 2 for each of 10 pixels"
    yield {"emitters": Emitters(near, cell)}, "RED and GREEN are less than 2 um apart"
    yield {"emitters": Emitters(little, cell)}, "of a pixel, and 0.05 are asked for"


@pytest.mark.parametrize("number", range(7))
def test_findings_that_break_the_jobs_own_rules_fail_by_name(number, job, built):
    parts, said = list(wrong_answers(built))[number]
    assert said in words(opinion(job, answered(built, **parts)))


def test_emitters_that_an_opening_states_are_those_of_its_text():
    job = asked_job(**JOBS["emitters of the opening"], more=DISPLAY)
    built = displays(job)
    (found,) = built.displays.values()
    other = Emitters(exchanged(found.emitters.labels), found.emitters.cell_nm)
    assert "RED is what should be BLUE" in words(opinion(job, answered(built, emitters=other)))


def test_every_file_that_shows_a_display_owes_a_row_on_it(tmp_path):
    formats = '[export]\nformats = ["gdsii", "oasis", "dxf_r12", "gerber", "cif", "svg"]\n'
    job = asked_job(**ONE, more=DISPLAY + formats)
    built, made = made_of(job)
    spoilt = draw_files(job, composed(built, relabelled(exchanged)), displays=built.displays)
    for good, files in ((True, made), (False, spoilt)):
        for product in files.products:
            product.write(tmp_path / product.name)
        rows = read_back(files, tmp_path, silent).quantities
        own = [row for row in rows if row.name == "judged_display"]
        assert {row.method.partition(":")[0].rpartition(".")[2] for row in own} == {"gds", "oas", "dxf", "cif"}
        assert {row.passed for row in own} == {good}
        assert {row.name for row in rows if row.passed is False} == (set() if good else {"judged_display"})
        caught = [row for row in rows if row.name == "judged_planted"]
        assert all("a wire moved by 1 nm" in row.method and row.passed for row in caught)
        assert len(caught) == good
    assert missing((), ["a.gds"], ["D0"], ["a.gds"])[-1] == "a.gds: judged_display of D0"
    assert len(missing((), ["a.gbr"], ["D0"], ["a.gds"])) == 3


@pytest.mark.parametrize("display", [DISPLAY, DISPLAY.partition("[wires]")[0]])
def test_the_display_on_which_a_fault_is_tried_passes_without_it(display):
    job = asked_job(**ONE, more=display)
    _, made = made_of(job)
    tried = replace(made.asked, displays=(made.asked.displays[0].wires_or_emitters,))
    drawn = awake._reduced(made.figures.layout(), tried, 0, tried.displays[0].shown)
    assert all(row.passed for row in judged(drawn, "drawn", tried))
    assert awake.planted(made.figures.layout(), "drawn", made.asked).passed


@pytest.fixture
def laid(monkeypatch):
    """No wires with which every pixel is drawn alike, so that all are laid across the die."""

    def none(panel, opening, demand, wanted, *, whole):
        return wiring.Wiring(demand.lines, 0, (0, 0), 0, None, None, ())

    monkeypatch.setattr(wiring, "_alike", none)


@pytest.mark.usefixtures("laid")
@pytest.mark.parametrize("more", ["", '[export]\ngrid = "100 nm"\n[order]\nparity = "wrong reading"\n'])
def test_wires_across_a_die_are_held_against_lines_as_they_were_laid(more):
    job = asked_job(**ONE, more=DISPLAY + more)
    built = displays(job)
    assert words(opinion(job, built)) == ""
    marks = [mark for mark in built.plate.marks if mark.kind == "wires"]
    assert len(marks) == 2
    for mark, metal in zip(marks, ("WIRE1", "WIRE2"), strict=True):
        aside = replace(mark, polygons=tuple(tuple((x, y + 3000) for x, y in ring) for ring in mark.polygons))
        plate = replace(built.plate, marks=tuple(aside if each is mark else each for each in built.plate.marks))
        said = f"{metal} lies +0 nm along x and +3000 nm along y from its place"
        assert said in words(opinion(job, built, plate))


@pytest.mark.usefixtures("laid")
def test_wires_across_a_die_follow_the_grid_of_a_house():
    job = asked_job(**ONE, more=DISPLAY.replace('space = "1 um"', 'space = "1.01 um"'))
    built = displays(job)
    shop = load_shop("pog")
    shop = shop.model_copy(update={"limits": shop.limits.model_copy(update={"grid_nm": (40,)})})
    made = files_of_job(built.plate, job.spec, [], shop)
    answers = draw_files(job, built.plate, displays=built.displays).asked.displays
    plan = asked(job.spec, shop, answers={"D0": answers[0].answer})
    rows = judged(made.figures.layout(), "drawn", plan)
    assert plan.displays[0].grid == 40
    assert [row.name for row in rows if not row.passed] == []
