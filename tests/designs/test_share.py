"""Share of the pixel and pixels to a circuit: the rule on drawn curves, and points of a small display."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from asked_displays import DISPLAY, job_of
from hypothesis import given
from hypothesis import strategies as st

import maskfab as mf
from maskfab.base.errors import JobError
from maskfab.base.model import Opening, Panel, Tiling
from maskfab.base.work import Clock
from maskfab.base.workers import EVERY_CORE
from maskfab.designs import design
from maskfab.designs.design import share_curve_of, with_choice
from maskfab.designs.search import search
from maskfab.designs.search.share import COARSER_DB, ERROR_DB, WITHIN_DB, ShareCurve, SharePoint, counts_of
from maskfab.display.eye_and_life import Limited
from maskfab.job.read import read


def point(dots: int, sharing: int, value: float, *broken: str) -> SharePoint:
    numbers = tuple(Limited(name, 2.0, None, 1.0, False, "") for name in broken)
    return SharePoint(dots, 10, sharing, 1, "bar", value, numbers=numbers)


VALUES = st.lists(st.floats(10, 30), min_size=1, max_size=8)


@given(alone=VALUES, shared=VALUES)
def test_the_choice_keeps_its_rule_whatever_the_curve(alone, shared):
    points = [point(k + 1, n, value) for n, own in ((1, alone), (4, shared)) for k, value in enumerate(own)]
    curve = ShareCurve(tuple(points))
    best = curve.best
    own = alone if best.sharing == 1 else shared
    assert best.value >= max(own) - WITHIN_DB
    assert all(value < max(own) - WITHIN_DB for value in own[: best.clear_dots - 1])
    knees = [min((v for v in values if v >= max(values) - WITHIN_DB), key=values.index) for values in (alone, shared)]
    assert (best.sharing == 4) == (knees[1] >= knees[0] + COARSER_DB)
    low, high = curve.interval
    assert low <= best.share <= high


def test_a_share_that_breaks_a_limit_or_fits_nothing_is_not_chosen():
    points = (point(10, 1, 20.0), point(20, 1, 25.0, "grain"), SharePoint(30, 10, 1))
    curve = ShareCurve(points, over=18.0)
    assert curve.best is points[0]
    assert curve.gain_db(curve.best) == pytest.approx(2.0)
    kept_by_none = ShareCurve(points[1:])
    assert kept_by_none.best is points[1]
    assert "none keeps them" in kept_by_none.told
    assert "none keeps them" not in curve.told
    assert ShareCurve(points[2:]).best is None


def test_the_interval_is_of_shares_that_an_error_might_choose():
    values = [20.0, 24.4, 24.55, 25.0]
    curve = ShareCurve(tuple(point(10 * (k + 1), 1, value) for k, value in enumerate(values)))
    assert curve.best.clear_dots == 30
    assert curve.interval == (0.2, 0.4)
    assert 24.4 >= 25 - WITHIN_DB - ERROR_DB > 20
    assert "20% to 40%" in curve.told


BOXES = """
[circuits]
gap = "2 um"
gap_to_opening = "2 um"
boxes = [{ name = "all of it", width = "30 um", height = "24 um" }]

[display]
"""
CHOSEN = ("clear_dots = 25\n", "clear_dots = 0\n")


@pytest.fixture(scope="module")
def small(tmp_path_factory):
    """A curve of a small display, whose circuits are placed, in a map that is not designed."""
    folder = tmp_path_factory.mktemp("share")
    path = job_of(folder, CHOSEN, more=BOXES + DISPLAY)
    spec = read(path)
    curve = share_curve_of(spec, where=str(path))
    return path, spec, with_choice(spec, curve, str(path)), curve


def test_points_fit_by_the_check_itself_and_more_circuits_are_never_better(small):
    _, _, _, curve = small
    found = {(one.sharing, one.clear_dots): one for one in curve.points if one.shape}
    assert {sharing for sharing, _ in found} == {1, 2, 4} or min(sharing for sharing, _ in found) > 1
    for (sharing, dots), one in found.items():
        more = found.get((1, dots))
        assert more is None or one.value >= more.value - 1e-9, (sharing, dots)
        assert one.footprint >= 0.1


def test_the_design_of_the_chosen_share_is_found_and_told(small):
    path, _, chosen, curve = small
    designed = mf.design(path)
    assert designed.passed
    assert designed.opening.clear_dots == chosen.design.clear_dots == curve.best.clear_dots
    assert any(note == curve.told for note in designed.notes)
    told = [note for note in designed.notes if "sharing = " in note]
    assert len(told) == (curve.best.sharing > 1)
    assert not any("[lives]" in note for note in designed.notes)


def test_one_process_finds_what_two_find(small):
    path, spec, _, curve = small
    with EVERY_CORE.executor(2) as executor:
        other = share_curve_of(spec, where=str(path), executor=executor)
    assert [(one.sharing, one.clear_dots, one.shape, one.value) for one in other.points if one.shape] == [
        (one.sharing, one.clear_dots, one.shape, one.value) for one in curve.points if one.shape
    ]
    assert other.best.clear_dots == curve.best.clear_dots


def test_a_clock_that_is_over_leaves_the_smallest_shares(small):
    path, spec, _, curve = small
    short = share_curve_of(spec, where=str(path), clock=Clock(0.0))
    assert 0 < len(short.points) < len(curve.points)
    assert not short.complete


def test_without_a_map_every_cell_is_laid_by_the_tiling_that_is_asked_for(small):
    path, spec, _, curve = small
    assert not any(one.alike for one in curve.points)
    alike = spec.model_copy(update={"design": spec.design.model_copy(update={"tiling": Tiling.PERIODIC})})
    other = share_curve_of(alike, where=str(path), clock=Clock(0.0))
    assert {one.alike for one in other.points if one.shape} == {True}


def test_the_point_of_the_curve_is_laid_where_the_search_finds_no_die_that_holds_its_own(small, monkeypatch):
    path, spec, _, curve = small
    monkeypatch.setattr(design, "share_curve_of", lambda *_, **__: curve)
    usual, asked = search.search, []

    def refusing(question):
        asked.append(question.begin)
        if question.begin is None:
            raise JobError("MF123", "none fits", cure="Ask for less")
        return usual(question)

    monkeypatch.setattr(search, "search", refusing)
    designed = design.design(spec, "", where=str(path))
    assert (asked[0], designed.shape) == (None, curve.best.shape)
    assert np.array_equal(designed.opening.mask, curve.best.unit)


def test_gains_are_over_a_panel_as_it_is_tiled(small):
    path, spec, _, _ = small
    slit = np.zeros((11, 11), dtype=np.bool_)
    slit[:10, 4:6] = True
    cells = np.zeros((2, 2), dtype=np.int8)
    over = {}
    for tiling in (Tiling.PERIODIC, Tiling.RANDOM):
        panel = Panel(Opening("slit", slit, 8000), 8000, 0, cells, tiling, 0)
        over[tiling] = share_curve_of(spec, where=str(path), over=panel, clock=Clock(0.0)).over
    assert over[Tiling.RANDOM] > over[Tiling.PERIODIC] + 0.5


def test_pixels_to_a_circuit_that_another_key_says_are_not_chosen(tmp_path):
    path = job_of(tmp_path, CHOSEN, more=BOXES.replace('gap = "2', 'shared_by = 4\ngap = "2', 1) + DISPLAY)
    spec = read(path)
    curve = share_curve_of(spec, where=str(path), clock=Clock(0.0))
    assert {one.sharing for one in curve.points} == {4}
    assert with_choice(spec, curve, str(path)).display.sharing is None
    assert "circuit" not in curve.told.partition(":")[0]


def test_no_more_pixels_are_left_out_of_a_display_whose_pitch_leaves_some_out(tmp_path):
    path = job_of(tmp_path, CHOSEN, more=BOXES + 'normal = "44 um"\n' + DISPLAY)
    curve = share_curve_of(read(path), where=str(path), coarser=True, clock=Clock(0.0))
    assert {one.across for one in curve.points} == {1}


@pytest.mark.parametrize(
    ("edits", "said"),
    [
        ((CHOSEN, ("fit = true\n", "")), "without fit = true"),
        ((("clear_dots = 25\n", "clear_dots = 0\ndensity = 0.4\n"),), "density"),
    ],
)
def test_nothing_is_chosen_where_nothing_limits_it(tmp_path, edits, said):
    with pytest.raises(JobError, match=said) as refused:
        mf.design(job_of(tmp_path, *edits))
    assert refused.value.code == "MF105"


def test_a_display_that_fits_no_share_is_refused(tmp_path):
    huge = BOXES.replace("30 um", "80 um").replace("24 um", "80 um")
    with pytest.raises(JobError, match="any share") as refused:
        mf.design(job_of(tmp_path, CHOSEN, more=huge))
    assert refused.value.code == "MF123"


def test_counts_are_of_shares_and_never_none():
    for dots in (1, 3, 11, 42):
        counts = np.array(counts_of(dots))
        assert counts.min() >= 1
        assert counts.max() <= 0.66 * dots**2 + 1


def test_pixels_are_left_out_only_where_photographs_say_so():
    whole, left = point(10, 4, 20.0), replace(point(10, 1, 24.0), across=2)
    assert ShareCurve((whole, left)).best is whole
    seen = replace(left, error_db=0.2)
    assert ShareCurve((whole, seen)).best is seen
    # A gain below a decibel is not worth coarser pixels.
    shown = replace(whole, error_db=0.2)
    assert ShareCurve((shown, replace(seen, value=20.9))).best is shown


def test_photographs_go_to_the_best_of_every_level_first():
    points = (point(10, 1, 20.0), point(20, 1, 25.0), point(10, 4, 21.0), point(20, 4, 30.0))
    curve = ShareCurve(points)
    assert [one.value for one in curve.best_first] == [25.0, 30.0, 20.0, 21.0]
    # What was photographed alone is chosen among.
    assert ShareCurve((*points[:3], replace(points[3], error_db=0.3))).best.value == 30.0
