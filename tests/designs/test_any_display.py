"""Displays that nobody tuned: an opening that suits any map is found first, and there is always a design or a proof."""

from __future__ import annotations

import os
import re
import signal
from collections.abc import Iterator
from dataclasses import replace
from itertools import islice
from pathlib import Path

import numpy as np
import pytest
from asked_displays import DISPLAY, asked_display, job_of
from once import leaves
from sweeps import sweep

from maskfab import design as designed
from maskfab.api.designing import Design
from maskfab.base.errors import JobError
from maskfab.base.model import ORIENTATIONS, Tiling
from maskfab.base.work import Clock, ended_by_interrupt, silent
from maskfab.designs.design import design, display_of, section_of
from maskfab.designs.rules.constraints import Constraints
from maskfab.designs.rules.display_fit import Display, Wired, every_pair, of_display
from maskfab.designs.rules.families import bars, l_shapes
from maskfab.designs.search import held as search_held
from maskfab.designs.search.annealing import Ranked
from maskfab.designs.search.die_look import PROBED, DieLook
from maskfab.designs.search.guard import Guard
from maskfab.designs.search.held import finer, kinds_of_panel, require_held, start_of, straight_lines, thinned
from maskfab.designs.search.result import constraints_of
from maskfab.display.emitter_rules import Verdict
from maskfab.display.feasibility import display_rules, feasibility
from maskfab.display.free_area import meetings
from maskfab.display.wiring import wired_alike, wiring
from maskfab.job.read import read
from maskfab.mask.job import load_job
from maskfab.mask.opening_file import opening_text
from maskfab.mask.panels import CellMap, map_text
from maskfab.report.pages.design import Made

pytestmark = pytest.mark.usefixtures("bound_loosely")

DOT_NM = 8000
MAPPED = 'fit = true\nmap = "equal_light"\nfamilies = ["bars", "l_shapes"]'


@pytest.fixture
def one_scene(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("maskfab.camera.scenes.bundled", lambda count=4: (leaves(1),))


@pytest.fixture
def few_tried(monkeypatch: pytest.MonkeyPatch) -> None:
    """Fewer openings judged before a kind of panel is said to have none, which takes most of the time."""
    monkeypatch.setattr(search_held, "_TRIED", 24)
    monkeypatch.setattr(search_held, "_TRIED_OF_FEWER", 8)


def rules_of(display: Display, clear_dots: int = 25) -> Constraints:
    return Constraints(clear_dots, dots=11, dot_nm=DOT_NM, **of_display(display))


def test_any_two_orientations_meet_in_the_panel_that_stands_for_all_maps() -> None:
    assert meetings(every_pair()) == meetings(np.random.default_rng(1).integers(ORIENTATIONS, size=(90, 90)))


@pytest.mark.parametrize("lines", sweep([3, 2, 4], 1))
def test_an_opening_that_suits_any_map_is_wired_on_every_panel(lines: int) -> None:
    display = asked_display(lines=lines, across=6)
    before_map = display.wired_as(Wired.ANY_MAP)
    assert display.rules.wires is not None
    kept = [bar.unit for bar in list(bars(11, 25))[::9] if before_map.unwired(bar.unit, DOT_NM) is None]
    refused = [bar.unit for bar in list(bars(11, 25))[::9] if before_map.unwired(bar.unit, DOT_NM) is not None]
    assert kept
    assert refused
    for seed in range(4):
        cells = np.random.default_rng(seed).integers(ORIENTATIONS, size=(5 + seed, 9)).astype(np.int8)
        for unit in kept:
            panel = display.panel(unit, DOT_NM, cells)
            wires = wiring(panel, panel.opening, display.rules.wires)
            assert (wires.verdict, wires.laid) == (Verdict.FITS, None)


def test_straight_lines_are_lines_that_are_drawn() -> None:
    display = asked_display(lines=9)
    wires = display.rules.wires
    assert wires is not None
    shapes = [bar.unit for bar in list(bars(11, 25))[::7]]
    for unit, straight in zip(shapes, straight_lines(np.stack(shapes), DOT_NM, wires.rules, turned=True), strict=True):
        panel = display.panel(unit, DOT_NM, every_pair())
        # One more may be counted than the one grid of nodes of all lines has room for.
        assert min(wired_alike(panel, panel.opening, wires).lines) >= straight - 1


def test_a_guarded_map_never_leaves_what_the_lines_pass() -> None:
    display = asked_display(lines=5, across=8)
    unit = next(bar.unit for bar in bars(11, 25) if bar.name == "bar 5x5 at (1, 6)")
    guard = Guard(display, unit, DOT_NM)
    drawn = [np.random.default_rng(seed).integers(ORIENTATIONS, size=(12, 12)).astype(np.int8) for seed in range(6)]
    broken = [cells for cells in drawn if not guard(cells)]
    assert len(broken) > 0
    for cells in broken:
        mended = guard.mended(cells)
        assert guard(mended)
        assert 0 < (mended != cells).sum() < cells.size / 4
    passing = next(cells for cells in drawn if guard(cells))
    assert np.array_equal(guard.mended(passing), passing)


def test_a_start_suits_any_map_or_cells_laid_alike(few_tried: None) -> None:
    clock, families = Clock(), ("bars",)
    easy = start_of(rules_of(asked_display(lines=2)), families, clock)
    assert easy is not None
    assert easy.any_map
    assert easy.shortfall is None
    assert easy.guard(easy.first.unit) is None
    tight = start_of(rules_of(asked_display(lines=7)), families, clock)
    assert tight is not None
    assert tight.rules.allows(tight.first.unit)
    assert start_of(rules_of(asked_display(lines=20), 3), families, clock) is None


def test_many_shapes_are_thinned_evenly_and_what_lies_between_the_best_comes_back() -> None:
    every = [*bars(21, 100), *l_shapes(21, 100)]
    few = thinned(every, most=400)
    assert 100 < len(few) <= 400
    assert {shape.name.partition(" at ")[0] for shape in few} == {shape.name.partition(" at ")[0] for shape in every}
    assert thinned(every, most=len(every)) == every
    judged = [Ranked(shape.name, shape.unit, -number) for number, shape in enumerate(few)]
    between = finer(every, judged, kinds=1)
    assert between
    assert {shape.name.partition(" at ")[0] for shape in between} == {judged[0].name.partition(" at ")[0]}
    assert not {shape.name for shape in between} & {shape.name for shape in few}


def test_a_mapped_design_fits_whatever_the_seed_and_size_of_its_die(tmp_path: Path, one_scene: None) -> None:
    path = job_of(tmp_path, ("fit = true", MAPPED), more=DISPLAY)
    found = design(read(path), "a test", where=str(path), clock=Clock(3.0))
    assert found.cells is not None
    assert found.cells.beyond == 0
    assert found.shortfall is None
    (tmp_path / "small.toml").write_text(opening_text(found.opening))
    (tmp_path / "map.toml").write_text(map_text(found.cells))
    for size, seed in (("0.62 mm", 0), ("0.62 mm", 5), ("1.8 mm", 3)):
        text = path.read_text().replace("0.62 mm", size).replace("seed = 0", f"seed = {seed}")
        (tmp_path / "die.toml").write_text(text.replace('tiling = "random"', 'tiling = "map"\nmap = "map.toml"'))
        job = load_job(tmp_path / "die.toml")
        answer = feasibility(job.plate().dies[0].panel, display_rules(job))
        assert answer is not None
        assert answer.verdict is Verdict.FITS


@pytest.mark.usefixtures("few_tried")
def test_a_display_that_holds_fewer_dots_gets_a_design_of_these_and_says_why(tmp_path: Path, one_scene: None) -> None:
    path = job_of(tmp_path, ("fit = true", MAPPED), ("lines = 2", "lines = 13"))
    # A clock that refuses nothing, for a loaded machine too.
    found = Design(design(read(path), "a test", where=str(path), clock=Clock(2.0)), Made("hash", 0.0, 0.0))
    assert not found.passed
    assert found.found.shortfall is not None
    assert found.found.shortfall.held == found.opening.clear_dots <= 17
    assert found.found.shortfall.proof is not None
    assert "no more than 17 dots are clear" in found.found.shortfall.proof
    assert "25 clear dots do not fit" in found.to_dict()["shortfall"]["told"]
    assert found.fit is not None
    assert found.fit.why is None


@pytest.fixture
def interruptible() -> Iterator[None]:
    """Python's own handler, which a test run in the background has not."""
    before = signal.signal(signal.SIGINT, signal.default_int_handler)
    yield
    signal.signal(signal.SIGINT, before)


def test_the_first_ctrl_c_keeps_the_best_so_far(tmp_path: Path, one_scene: None, interruptible: None) -> None:
    path = job_of(tmp_path, ("fit = true", MAPPED))
    stages: list[str] = []

    def interrupted(stage: str, done: int, total: int) -> None:
        if not stages:
            os.kill(os.getpid(), signal.SIGINT)
        stages.append(stage)

    found = designed(path, progress=interrupted)
    assert found.found.cut
    assert found.fit is not None
    assert found.fit.why is None
    assert any("Ctrl-C ended" in note for note in found.notes)
    assert signal.getsignal(signal.SIGINT) is signal.default_int_handler
    with ended_by_interrupt(clock := Clock()):
        os.kill(os.getpid(), signal.SIGINT)
        assert clock.over
        with pytest.raises(KeyboardInterrupt):
            os.kill(os.getpid(), signal.SIGINT)


def test_a_periodic_display_asks_for_no_map() -> None:
    assert asked_display(lines=2, tiling=Tiling.PERIODIC).wired is Wired.TILING


@pytest.mark.parametrize("lines", sweep([7, 2], 1))
def test_lines_counted_beside_many_openings_leave_out_none_that_can_be_wired(lines: int) -> None:
    """Every kind of panel, by its own exact answer."""
    shapes = [*islice(bars(11, 25), 0, None, 6), *islice(l_shapes(11, 25), 0, None, 80)]
    units = np.stack([shape.unit for shape in shapes])
    for held in kinds_of_panel(rules_of(asked_display(lines=lines)), crooked=False):
        display = held["emitters"]
        most = display.lines_beside(units, held.dot_nm)
        wired = [display.unwired(unit, held.dot_nm) is None for unit in units]
        assert all(passing >= display.opaque_lines for passing, fits in zip(most, wired, strict=True) if fits)
        assert lines == 2 or (most < display.opaque_lines).any()


@pytest.mark.usefixtures("few_tried")
def test_dots_that_do_not_fit_are_refused_before_any_photograph_with_the_most_that_do(tmp_path: Path) -> None:
    path, stages = job_of(tmp_path, ("lines = 2", "lines = 12")), list[str]()
    with pytest.raises(JobError, match=r"MF123 25 dots do not fit: none of the \d+ shapes of .*; (\d+) do") as refusal:
        design(read(path), "a test", where=str(path), progress=lambda stage, *_: stages.append(stage))
    assert not any(stage.startswith(("photographs", "scan")) for stage in stages)
    most = int(re.search(r"clear_dots = (\d+)", refusal.value.cure)[1])
    # What is told to fit keeps the rules, and the search finds it.
    fewer = job_of(tmp_path, ("lines = 2", "lines = 12"), ("clear_dots = 25", f"clear_dots = {most}"))
    require_held(constraints_of(section_of(read(fewer), "x"), display=display_of(read(fewer), "x")), ("bars",), Clock())


def test_a_die_that_there_is_no_time_for_is_looked_at_in_part_and_that_is_told(tmp_path: Path) -> None:
    display = display_of(read(job_of(tmp_path)), "job")
    assert display is not None
    unit = np.zeros((11, 11), dtype=np.bool_)
    unit[4:7, 4:7] = True
    whole = DieLook.of(display, Clock(), unit, DOT_NM)
    assert whole(unit, DOT_NM, None, silent).across == display.across == 12
    assert whole.notes(whole(unit, DOT_NM, None, silent)) == ()
    large = replace(display, across=60)
    # A second for each pixel, and 200 s: 14 x 14 pixels.
    look = DieLook(large, Clock(200.5, now=lambda: 0.0), pixel_s=1.0)
    fit = look(unit, DOT_NM, None, silent)
    assert (fit.across, fit.why) == (14, None)
    assert look.notes(fit) == ("The budget left time to look at 14 x 14 of the die's 60 x 60 pixels.",)
    # The map is looked at whole, and without time as much as was measured on.
    cells = CellMap("map", np.zeros((20, 20), dtype=np.int8))
    assert look(unit, DOT_NM, cells, silent).across == 20
    assert replace(look, clock=Clock(0.0, now=lambda: 0.0))(unit, DOT_NM, None, silent).across == PROBED
    measured = DieLook.of(large, Clock(60.0), unit, DOT_NM)
    assert measured.seconds == pytest.approx(measured.pixel_s * 3600)
    assert measured.pixel_s > 0
