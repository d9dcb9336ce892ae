"""The method "search": scan families, anneal the best, lay it out with a map, and report the gain.

A checkpoint holds the scan once it is whole, and the annealing at every so many evaluations; the map is designed again.
A run that goes on from it ends byte for byte where an uninterrupted one does. A budget of time ends the scan early,
then the annealing; what it has cut short depends on the clock, and the notes say so.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from maskfab.base.arrays import Mask
from maskfab.base.errors import JobError
from maskfab.base.model import Opening, Panel, Tiling
from maskfab.base.work import Progress
from maskfab.camera.stop_cells import FEWEST_CELLS, CellGrid
from maskfab.designs.maps.orientation_map import MapMode
from maskfab.designs.model.appraisal import (
    Robustness,
    SceneConditions,
    Spread,
    appraise_over,
    cells_across,
    compared_bias_um,
    designed_panel,
    moved_by_bias,
    robustness,
)
from maskfab.designs.rules.constraints import Constraints
from maskfab.designs.rules.display_fit import DieFit
from maskfab.designs.search.annealing import ExpectedPsnr, Ranked
from maskfab.designs.search.die_look import DieLook
from maskfab.designs.search.panel_map import Mapped, mapped, named
from maskfab.designs.search.question import Judges, Prepared, Question, for_any_map, prepare
from maskfab.designs.search.result import (
    NO_BOUNDS,
    Account,
    Alternatives,
    Designed,
    Facts,
    SceneDesign,
    alternatives,
    appraised,
    asked_of,
    by_level,
    made_for_line,
    of_prices,
    prices,
    stopped,
)
from maskfab.designs.search.scan import Best, annealed, annealed_without, begun, scanned
from maskfab.designs.search.shortlist import Listed, shortlisted
from maskfab.job.sections import SearchSection
from maskfab.mask.panels import CellMap, DieSeeds, shifted
from maskfab.optics.tiling import orientations

if TYPE_CHECKING:
    from maskfab.designs.model.panel_error import PupilError


_RIVALS = 2
"""Other kinds of openings that are told of beside the chosen one, however short the time was."""


def search(question: Question) -> Designed:
    """Search as the question's section says.

    Raises:
        JobError, OpeningError: MF104, MF106, MF107, MF135 for numbers; MF121 for scenes without a spectrum; MF123,
            MF203, MF204 for rules that no opening keeps, or that cannot be shown to hold at several places in a cell;
            MF115 for a map of too many cells, or of cells of too many dots.
        SourceError, OutputError: MF303, MF304, MF401 for the checkpoint.
    """
    ready = prepare(question)
    state, listed = _shapes(ready)
    chosen, laid, fit = _first_that_fits(ready, listed)
    state = replace(state, best=chosen.shape)
    laid, fit, seeds = _with_seeds(laid, fit)
    return _designed(ready, state, chosen.rules, laid, fit, seeds)


def _shapes(ready: Prepared) -> tuple[Best, tuple[Listed, ...]]:
    """The best shapes of a scan and its annealing, and those that get a map, the best first."""
    question, section, rules, stages = ready.question, ready.section, ready.rules, ready.stages
    expected, progress, store = ready.judges.expected, question.progress, question.kept
    state = (
        scanned(section, rules, expected, stages.search, store, progress, ready.start, executor=question.executor)
        if question.begin is None
        else begun(question.begin, section, rules, expected, progress)
    )
    state = annealed(state, section, rules, expected, stages.search, store, progress)
    if ready.panel is None or section.map is None or not for_any_map(section):
        return state, (Listed(state.best, rules),)
    return shortlisted(
        state,
        section.shortlist,
        ready.panel,
        rules,
        stages.search,
        progress,
        judge=expected,
        mode=MapMode(section.map),
        seed=section.drawn_seed,
        positions=section.positions,
        start=ready.start,
        executor=question.executor,
    )


def _designed(
    ready: Prepared, state: Best, rules: Constraints, laid: Mapped, fit: DieFit | None, seeds: Facts
) -> Designed:
    """Appraise what was found, as far as there is time, and put it together."""
    question, section, expected = ready.question, ready.section, ready.judges.expected
    clock, levels, errors = question.clock, question.settings.levels, ready.map_judges
    # Costs of the eye's rules take half a second for each opening, which no budget leaves.
    dear = clock.budget_s is not None and not {"grain", "delta_e"}.isdisjoint(rules.active)
    priced = prices(state.looked, expected, rules) if state.looked and not dear else None
    psnr, appraisal, head_room, gap, notes = laid.psnr, Facts(), None, None, (*state.notes, *laid.notes)
    short = not ready.stages.bounded or not clock.affords(ready.stages.bounds_s)
    if psnr is None and short:
        notes += (NO_BOUNDS,)
    elif psnr is None:
        question.progress("bounds", 0, 1)
        psnr, appraisal, head_room, gap = appraised(ready.judges.estimate, laid.unit, periodic=expected.periodic)
        question.progress("bounds", 1, 1)
    if psnr is None or (expected.distances and laid.psnr is None):
        psnr = expected.by_level(laid.unit)
    robust = None if short else _appraised(section, laid, errors.in_focus, question.spread)
    near = None if short else _alternatives(section, state, laid, rules, expected, errors.in_focus)
    seen = question.seen
    scene = None if seen is None or short else over_scene(section, laid, rules.dot_nm, errors, seen)
    if seen is not None and short:
        notes += ("The scene counts in the search; with a longer budget its conditions are told apart.",)
    facts: Facts = {
        **ready.made,
        "shape": state.best.name,
        **appraisal,
        **by_level("expected_psnr", psnr, levels),
        "evaluated": state.evaluated,
        **seeds,
        **({} if priced is None else of_prices(priced)),
    }
    account = _account(section, state, rules, laid)
    if question.price_rules and rules.active and section.anneal and state.looked:
        account = replace(account, without=annealed_without(state, section, rules, expected, question.progress))
    return Designed(
        Opening(section.name, laid.unit, rules.dot_nm, facts),
        state.best.name,
        psnr,
        head_room,
        state.evaluated,
        priced,
        laid.cells,
        laid.designed,
        laid.head_room,
        gap,
        None if laid.outer is None else Opening(named(section, "_outer"), laid.outer, rules.dot_nm, facts),
        (*_few_cells(ready.room, section), *notes, *(() if ready.look is None else ready.look.notes(fit))),
        state.cut or laid.cut,
        shortfall=None if ready.start is None else ready.start.shortfall,
        camera=made_for_line(question.camera, question.settings, seen),
        levels=levels,
        robust=robust,
        fit=fit,
        scene=scene,
        account=account,
        alternatives=near,
        rivals=tuple(one for one in state.held if one.unit is not state.best.unit)[:_RIVALS],
    )


def _first_that_fits(ready: Prepared, listed: Sequence[Listed]) -> tuple[Listed, Mapped, DieFit | None]:
    """The first of a list whose panel holds the display on a die, if one must; MF123 where none does."""
    alike = (replace(one, alike=True) for one in listed if one.guard is not None)
    for chosen in (*listed, *alike):
        laid = mapped(ready, chosen)
        fit = _fit(ready.look, laid, chosen.rules, ready.question.progress)
        if chosen.guard is None or fit is None or fit.why is None:
            break
    _require_fit(fit, laid)
    return chosen, laid, fit


def _fit(look: DieLook | None, laid: Mapped, rules: Constraints, progress: Progress) -> DieFit | None:
    """The display on dies of the panel, if one must fit; that of two openings was found with them."""
    if look is None or laid.outer is not None:
        return laid.fit
    return look(laid.unit, rules.dot_nm, laid.cells, progress)


def _require_fit(fit: DieFit | None, laid: Mapped) -> None:
    """Refuse a display that fits no die that was tried. Raises JobError MF123."""
    if fit is None or fit.why is None:
        return
    seeds = f"seed {min(fit.failed)}" if len(fit.failed) == 1 else f"seeds {min(fit.failed)} to {max(fit.failed)}"
    own = "" if laid.cells is None else " with its own map"
    what = (
        f"the display fits the opening on a panel turned at random, and not on a die of {fit.across} x "
        f"{fit.across} pixels{own}, {seeds}: {fit.why}"
    )
    cure = "Design with another tiling_seed, with fewer lines, or without a map"
    raise JobError("MF123", what, where="design.fit", cure=cure)


def _with_seeds(laid: Mapped, fit: DieFit | None) -> tuple[Mapped, DieFit | None, Facts]:
    """The panel whose map names the seeds of dies that were tried, if one failed; without a map, the opening does."""
    if fit is None or fit.seed is None or not fit.failed:
        return laid, fit, {}
    facts: Facts = dict(DieSeeds((fit.seed,), tuple(fit.failed)).facts)
    if laid.cells is None:
        return laid, fit, facts
    return replace(laid, cells=replace(laid.cells, provenance={**laid.cells.provenance, **facts})), fit, {}


def _appraised(section: SearchSection, laid: Mapped, error: PupilError, spread: Spread) -> Robustness:
    seed, shape = section.drawn_seed, (error.cells, error.cells)
    kinds = orientations(section.tiling, *shape, seed) if laid.designed is None else laid.designed.orientations
    units = [laid.unit, laid.outer] if laid.outer is not None else [laid.unit]
    if laid.designed is not None and laid.designed.shifts:
        units = [shifted(laid.unit, shift) for shift in laid.designed.shifts]
    return robustness(
        np.stack(units),
        kinds,
        error,
        spread=spread,
        seed=seed,
        periodic=section.tiling is Tiling.PERIODIC,
        mapped=laid.designed is not None,
    )


def _alternatives(
    section: SearchSection, state: Best, laid: Mapped, rules: Constraints, expected: ExpectedPsnr, error: PupilError
) -> Alternatives | None:
    """Openings within reach of the one that is laid; None for a panel of two, and where none was judged in dB."""
    if laid.outer is not None or not state.near:
        return None
    seed, shape = section.drawn_seed, (error.cells, error.cells)
    # One tiling for all, so that openings are compared and not tilings.
    kinds = orientations(section.tiling, *shape, seed)
    own = state.best.value if np.array_equal(laid.unit, state.best.unit) else expected(laid.unit)
    bias_um = compared_bias_um(rules.dot_nm)

    def moved(unit: Mask) -> float:
        return moved_by_bias(unit, kinds, error, bias_um)

    return alternatives(Ranked(state.best.name, laid.unit, own), state.near, rules, moved=moved, bias_um=bias_um)


def _few_cells(room: CellGrid, section: SearchSection) -> tuple[str, ...]:
    if room.cells >= FEWEST_CELLS or section.tiling is Tiling.PERIODIC or section.map is not None:
        return ()
    return (
        f"Only {room.cells} x {room.cells} cells lie behind the stop: one random layout of them may restore 2 dB "
        "better or worse than is expected of all.",
    )


def _account(section: SearchSection, state: Best, rules: Constraints, laid: Mapped) -> Account:
    among = f" among shapes of the families {', '.join(section.families)}"
    among = " from a start of one's own" if state.best.name.startswith("start") else among
    stages = state.stages
    if section.joint and not laid.cut:
        stages = (*stages, ("rounds of opening and map, at most", section.joint))
    return Account(
        f"search for the most expected restored PSNR{among}",
        section.seed,
        stages,
        "expected restored PSNR, dB, weighted mean over the levels",
        state.bettered,
        stopped(state.cut or laid.cut),
        section.tiling,
        section.drawn_seed,
        asked_of(rules),
        priced_among=len(state.looked),
    )


def over_scene(section: SearchSection, laid: Mapped, dot_nm: int, judges: Judges, seen: SceneConditions) -> SceneDesign:
    """Appraise a panel in every condition."""
    errors = judges.by_distance or (judges.in_focus,)
    seed, across = section.drawn_seed, cells_across(seen.camera, seen.scene, judges.room)

    def panel(given: CellMap | None) -> Panel:
        return designed_panel(
            laid.unit, dot_nm, tiling=section.tiling, seed=seed, across=across, given=given, outer=laid.outer
        )

    appraisal = appraise_over(panel(laid.cells), seen, errors)
    if laid.cells is None or laid.outer is not None:
        return SceneDesign(seen, appraisal, None)
    drawn = orientations(section.tiling, judges.room.cells, judges.room.cells, seed)
    return SceneDesign(seen, appraisal, appraise_over(panel(CellMap("random", drawn)), seen, errors))
