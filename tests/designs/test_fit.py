"""Designs under the rules of a display: they are judged by the check itself, and what comes out fits."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from asked_displays import DISPLAY, JOB, job_of
from once import leaves

from maskfab.base.errors import JobError
from maskfab.base.model import ORIENTATIONS, Panel, Tiling
from maskfab.designs.design import check_possible, design, display_notes, display_of
from maskfab.designs.rules.constraints import Constraints
from maskfab.designs.rules.display_fit import Display, fitting_die, of_display
from maskfab.designs.rules.families import bars
from maskfab.designs.search.result import constraints_of
from maskfab.display.emitter_rules import Verdict
from maskfab.display.feasibility import DisplayRules, Feasibility, display_rules, feasibility
from maskfab.display.wiring import wiring
from maskfab.job.read import read
from maskfab.mask.job import load_job
from maskfab.mask.opening_file import opening_text
from maskfab.mask.panels import CellMap, map_text
from maskfab.optics.tiling import orientations
from maskfab.report.pages.design import designed_document
from maskfab.report.text import designed_lines

pytestmark = pytest.mark.usefixtures("bound_loosely")


def test_the_rule_is_the_check_itself_and_the_quick_one_is_no_laxer(tmp_path: Path) -> None:
    spec = read(job_of(tmp_path, ("lines = 2", "lines = 4")))
    asked = Display.of(DisplayRules.of(spec.emitters, None, spec.wires), Tiling.RANDOM, 0, 5, 5)
    rules = Constraints(25, dots=11, dot_nm=8000, **of_display(asked))
    verdicts = []
    for bar in list(bars(11, 25))[::92]:
        found = feasibility(asked.panel(bar.unit, 8000), asked.rules)
        verdicts.append(found.verdict is Verdict.FITS)
        assert (not rules.violations(bar.unit)) == verdicts[-1]
        assert not rules.allows(bar.unit) or verdicts[-1]
    assert len(set(verdicts)) == 2


@pytest.mark.slow
def test_what_is_designed_for_a_display_fits_in_the_job_that_holds_it(tmp_path: Path, monkeypatch) -> None:
    monkeypatch.setattr("maskfab.camera.scenes.bundled", lambda count=4: (leaves(1),))
    path = job_of(tmp_path, more=DISPLAY)
    found = design(read(path), "a test", where=str(path))
    assert found.prices is not None
    assert [each.rule for each in found.prices.each] == ["circuits", "emitters", "wires"]
    (tmp_path / "small.toml").write_text(opening_text(found.opening))
    job = load_job(path)
    answer = feasibility(job.plate().dies[0].panel, display_rules(job))
    assert answer.verdict is Verdict.FITS
    assert found.prices.together >= 0


@pytest.mark.slow
def test_two_openings_and_their_map_fit_the_display_in_the_job_that_holds_them(tmp_path: Path, monkeypatch) -> None:
    monkeypatch.setattr("maskfab.camera.scenes.bundled", lambda count=4: (leaves(1),))
    monkeypatch.setattr("maskfab.designs.search.panel_map._KICKS", 0)
    asked = ("fit = true", 'fit = true\nmap = "equal_light"\nshortlist = 1\ndensity = 0.31'), ("lines = 2", "lines = 7")
    path = job_of(tmp_path, *asked, more=DISPLAY.replace('tiling = "random"', 'tiling = "map"\nmap = "small_map.toml"'))
    text = path.read_text().replace("seed = 0", 'seed = 0\nothers = ["small_outer.toml"]')
    path.write_text(text.replace('die_size = "0.62 mm"', 'die_size = "0.53 mm"'))
    found = design(read(path), "a test", where=str(path))
    assert found.outer is not None
    assert found.cells is not None
    (tmp_path / "small.toml").write_text(opening_text(found.opening))
    (tmp_path / "small_outer.toml").write_text(opening_text(found.outer))
    (tmp_path / "small_map.toml").write_text(map_text(found.cells))
    job = load_job(path)
    (die,) = job.plate().dies
    answer = feasibility(die.panel, display_rules(job))
    assert answer.verdict is Verdict.FITS
    assert answer.share >= 0.1
    assert not (die.panel.common.mask & emitters_on_dots(answer.emitters, 11)).any()
    # As many lines as the design says pass, and not one more.
    lines = found.cells.provenance["lines"]
    demand = display_rules(job).wires
    verdicts = [
        wiring(die.panel, die.panel.common, replace(demand, lines=count)).verdict for count in (lines, lines + 1)
    ]
    assert lines >= 7
    assert [each is Verdict.FITS for each in verdicts] == [True, False]


def emitters_on_dots(emitters, dots):
    per_dot = len(emitters.labels) // dots
    return (emitters.labels > 0).reshape(dots, per_dot, dots, per_dot).any(axis=(1, 3))


def test_beyond_a_map_of_two_openings_cells_hold_either(tmp_path: Path) -> None:
    """As a job lays them out: the die on which a design is checked is the one that is made."""
    spec = read(job_of(tmp_path))
    asked = Display.of(DisplayRules.of(spec.emitters, None, spec.wires), Tiling.RANDOM, 3, 4, 12)
    dense, sparse = (np.arange(121).reshape(11, 11) < count for count in (40, 9))
    drawn = asked.die(dense, 8000, None, sparse).orientations
    around = asked.die(dense, 8000, CellMap("map", np.zeros((4, 4), dtype=np.int8)), sparse).orientations
    assert set((drawn // ORIENTATIONS).ravel().tolist()) == {0, 1}
    outside = np.ones_like(drawn, dtype=np.bool_)
    outside[4:8, 4:8] = False
    assert np.array_equal(drawn[outside], around[outside])


def test_a_density_and_emitters_that_are_more_than_a_pixel_are_refused_at_once(tmp_path: Path) -> None:
    asked = ("fit = true", 'fit = true\nmap = "equal_light"\nshortlist = 1\ndensity = 0.75')
    path = job_of(tmp_path, asked)
    with pytest.raises(
        JobError, match=r"MF123.*25\.0%.*10\.0% are 5\.0% .*design\.density.*30\.0% of the pixel closed"
    ):
        check_possible(read(path), where=str(path))


def test_a_display_that_no_opening_can_hold_is_refused_with_a_proof(tmp_path: Path) -> None:
    path = job_of(tmp_path, ("required = 0.1", "required = 0.26"), ('colour_gap = "8 um"', 'colour_gap = "16 um"'))
    told = r"MF123 no opening keeps the emitters of \[emitters\]: even a pixel without an opening.*design\.fit"
    with pytest.raises(JobError, match=told):
        check_possible(read(path), where=str(path))


def test_a_design_must_fit_some_display(tmp_path: Path) -> None:
    text = JOB[: JOB.index("[emitters]")]
    path = tmp_path / "job.toml"
    path.write_text(text)
    with pytest.raises(JobError, match=r"MF105.*no display.*design\.fit.*\[emitters\]"):
        check_possible(read(path), where=str(path))


def test_a_display_that_a_design_need_not_fit_is_named(tmp_path: Path) -> None:
    told = display_notes(read(job_of(tmp_path, ("fit = true", ""))))
    assert told == ("The opening need not fit [emitters], [wires], for [design] does not say fit = true.",)
    assert display_notes(read(job_of(tmp_path))) == ()


def test_lines_that_close_more_than_the_count_leaves_are_refused_with_the_most_dots(tmp_path: Path) -> None:
    told = r"MF123 no opening keeps the lines of \[wires\] and clear_dots.*78 um of the 88 um.*no more than 17 dots"
    path = job_of(tmp_path, ("lines = 2", "lines = 13"))
    with pytest.raises(JobError, match=told):
        check_possible(read(path), where=str(path))
    path = job_of(tmp_path, ("lines = 2", "lines = 13"), ("clear_dots = 25", "clear_dots = 17"))
    check_possible(read(path), where=str(path))


def test_a_symmetry_that_no_shape_has_is_refused_with_those_that_some_have(tmp_path: Path) -> None:
    path = job_of(
        tmp_path,
        ("fit = true", 'families = ["bars"]\nrules = { symmetry = "d4" }'),
        ("clear_dots = 25", "clear_dots = 33"),
    )
    with pytest.raises(
        JobError, match=r"MF123 none of the \d+ shapes of 33.*bars has the symmetry d4; some have mirror"
    ):
        check_possible(read(path), where=str(path))


def test_what_the_closed_area_cannot_hold_is_told_with_what_is_missing(tmp_path: Path) -> None:
    closed = (11**2 - 25) * 64
    for old, new, need, what in (
        ("required = 0.1", "required = 0.3", 0.9 * 88**2, "emitters"),
        ('circuit = "800 um^2"', 'circuit = "2100 um^2"', 3 * 2100, "circuits"),
    ):
        path = job_of(tmp_path, (old, new))
        missing = f"need {need - closed:.0f} um\\^2 more than the {closed} um\\^2"
        with pytest.raises(
            JobError,
            match=rf"MF123 no opening keeps the {what} of \[emitters\] and clear_dots.*{missing}",
        ):
            check_possible(read(path), where=str(path))


def test_a_pixel_without_an_opening_is_judged_once(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = job_of(tmp_path)
    spec = read(path)
    judged: list[int] = []
    whole = Display.without_wires

    def counted(self: Display, panel: Panel) -> Feasibility | None:
        judged.append(panel.opening.clear_dots)
        return whole(self, panel)

    monkeypatch.setattr(Display, "without_wires", counted)
    rules = constraints_of(spec.design, display=display_of(spec, str(path)))
    for _ in range(3):
        rules.require_possible()
    assert judged == [0]


def test_a_design_without_a_display_asks_its_shapes_for_nothing(tmp_path: Path) -> None:
    path = job_of(tmp_path, ("fit = true", ""))
    check_possible(read(path), where=str(path))


FIVE = ("lines = 2", "lines = 5")


def shown(folder: Path) -> Display:
    display = display_of(read(job_of(folder, FIVE)), "job")
    assert display is not None
    return display


def unit() -> np.ndarray:
    """An opening that five lines pass on some dies of 12 x 12 pixels, and not on others."""
    return next(bar.unit for bar in bars(11, 25) if bar.name == "bar 5x5 at (1, 6)")


def test_the_first_seed_is_taken_whose_die_the_check_itself_finds_to_fit(tmp_path: Path) -> None:
    display = shown(tmp_path)
    fit = fitting_die(display, unit(), 8000)
    assert fit.seed is not None
    assert fit.seed > 0
    assert list(fit.failed) == list(range(fit.seed))
    for seed in range(fit.seed + 1):
        drawn = display.panel(unit(), 8000, orientations(display.tiling, 12, 12, seed))
        answer = feasibility(drawn, display.rules)
        assert answer is not None
        assert (answer.verdict is Verdict.FITS) == (seed == fit.seed)
        if seed < fit.seed:
            assert answer.wiring is not None
            assert answer.wiring.failed is not None
            assert fit.failed[seed] == answer.wiring.failed.statement


def test_beyond_a_map_alone_seeds_are_tried_and_none_for_a_map_that_fails_itself(tmp_path: Path) -> None:
    display = replace(shown(tmp_path), seed=0)
    held, fails = CellMap("map", np.zeros((4, 4), dtype=np.int8)), shown(tmp_path).die(unit(), 8000, None).orientations
    around = fitting_die(display, unit(), 8000, held)
    assert around.seed is not None
    own = fitting_die(replace(display, across=14), unit(), 8000, CellMap("map", fails))
    assert (own.seed, list(own.failed)) == (None, [0])
    # The map is the whole die: no seed changes it.
    whole = fitting_die(display, unit(), 8000, CellMap("map", fails))
    assert (whole.seed, list(whole.failed)) == (None, [0])


def test_a_job_without_a_plate_has_dies_like_those_that_ship_and_one_with_a_plate_its_own(tmp_path: Path) -> None:
    layouts = Path(__file__).parents[2] / "layouts"
    dies = {die.name: die.panel.orientations.shape for die in load_job(layouts / "upc12.toml").plate().dies}
    for name, die in (("design_fits_gutter", "GUT8_M150"), ("design_fits_300", "FITS_M300")):
        shipped = display_of(read(layouts / f"{name}.toml"), "job")
        assert shipped is not None
        assert (shipped.across, shipped.across) == dies[die]
    own = display_of(read(job_of(tmp_path, more=DISPLAY)), "job")
    usual = display_of(read(job_of(tmp_path)), "job")
    assert own is not None
    assert usual is not None
    assert (own.across, usual.across) == (7, int(2.1 * 512 / 88))


def test_a_design_tells_the_die_that_it_fits_and_the_seed_to_state(tmp_path: Path, monkeypatch) -> None:
    monkeypatch.setattr("maskfab.camera.scenes.bundled", lambda count=4: (leaves(1),))
    monkeypatch.setattr("maskfab.designs.search.die_look.fitting_die", lambda *_, **__: fit)
    fit = fitting_die(shown(tmp_path), unit(), 8000)
    path = job_of(tmp_path, ("fit = true", 'fit = true\nfamilies = ["bars"]'))
    found = design(read(path), "a test", where=str(path))
    told = "\n".join(designed_lines(found, ()))
    assert f"fits a die of 12 x 12 pixels, 1.056 mm, with seed {fit.seed} of its tiling" in told
    assert f"state seed = {fit.seed} in its [[die]]" in told
    document = designed_document(found, {"opening": path}, ())["fit"]
    assert document == {
        "pixels": [12, 12],
        "regular_beyond": False,
        "side_um": 1056.0,
        "seed": fit.seed,
        "failed": [{"seed": seed, "why": why} for seed, why in fit.failed.items()],
        "seconds": round(fit.seconds, 3),
    }
    fit = replace(fit, seed=None)
    with pytest.raises(JobError, match=r"MF123.*not on a die of 12 x 12 pixels, seed.*lines along"):
        design(read(path), "a test", where=str(path))
