"""The method "search": scan families, anneal the best, lay it out with a map, and report the gain.

A checkpoint holds the scan once it is whole, and the annealing at every so many evaluations; the map is designed again.
A run that goes on from it ends byte for byte where an uninterrupted one does. A budget of time ends the scan early,
then the annealing; what it has cut short depends on the clock, and the notes say so.

A scan judges openings turned at random. A map gains most where the halo that it can take away is strongest, and thick
shapes gain more than slender ones, so the best under a map need not be the best of the scan. The best shapes that
differ in family or size are each given one descent of a map, and the best of these goes on.

Judges in focus are a surrogate, and the error of panels by it. Over the distances of a scene the mean over one of each
for every distance counts, each photograph restored by its own blur.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cached_property, partial
from itertools import islice
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from maskfab.base.arrays import Floats, Mask
from maskfab.base.errors import JobError
from maskfab.base.files import Kept
from maskfab.base.model import ORIENTATIONS, Opening, Panel, Tiling
from maskfab.base.processes import ALONE, Call, SerialExecutor
from maskfab.base.work import NO_END, Clock, Progress, silent
from maskfab.camera.lens import F1, FEWEST_CELLS, CellGrid, PhotoCamera, lattice
from maskfab.camera.scenes import Photograph
from maskfab.designs.maps.alternation import joint, laid, require_places
from maskfab.designs.maps.light import Graded, clustered, graded, most_dots
from maskfab.designs.maps.orientation_map import FIRST_STEPS, DesignedMap, MapMode, design_map, require_size
from maskfab.designs.maps.shares import Denser
from maskfab.designs.model.appraisal import (
    EXACT,
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
from maskfab.designs.model.expected_psnr import Surrogate, surrogate_of
from maskfab.designs.model.layouts_bound import layout_gap
from maskfab.designs.model.limits import rings
from maskfab.designs.model.panel_judgement import MeanPanelError, PanelError
from maskfab.designs.model.statistics import F1_SETTINGS, CaptureSettings, SceneStatistics, scene_statistics
from maskfab.designs.rules.constraints import Constraints
from maskfab.designs.rules.display_fit import OF_THE_EYE, DieFit, Display
from maskfab.designs.rules.families import Candidate, kind
from maskfab.designs.search.annealing import ExpectedPsnr, Objective, Ranked, anneal, nearest
from maskfab.designs.search.die_look import DieLook
from maskfab.designs.search.guard import Guard
from maskfab.designs.search.held import EASE, Start, require_held, start_of
from maskfab.designs.search.result import (
    NO_BOUNDS,
    Account,
    Alternatives,
    Designed,
    Facts,
    Prices,
    SceneDesign,
    Stages,
    alternatives,
    appraised,
    asked_of,
    by_level,
    camera_facts,
    constraints_of,
    made_for_line,
    of_prices,
    origin,
    prices,
    run_key,
    stopped,
)
from maskfab.designs.search.scan import Best, allowed, annealed, annealed_without, begun, first_shape, scanned
from maskfab.job.sections import SearchSection
from maskfab.mask.panels import CellMap, DieSeeds, shifted
from maskfab.optics.tiling import orientations

if TYPE_CHECKING:
    from maskfab.designs.model.panel_error import PupilError


_LONGEST_NAME = 24


_AUC_EVALUATIONS = 4000


_AUC_TEMPERATURE = (0.001, 0.00001)


MAP_LEAK_SCENES = 8
"""Scenes whose leak a map is designed on: on fewer it fits the very edges of those, and gains a tenth of a decibel less
on any others."""


_KICKS = 3


_QUICK_FIELDS = 16
"""Fields of a quick map of an opening that a display fits: they bring most of the gain."""


_RIVALS = 2
"""Other kinds of openings that are told of beside the chosen one, however short the time was."""


_WORSE_DB = 0.25
"""Openings that much worse, turned at random, are tried under no quick map: maps differ by less."""


_BESIDE, _ASKED, _BETTER_DB = 2, 60, 0.01
"""Kinds of openings whose lines depend on the map that are tried, of so many that are better by so much."""


_MOST_GUARDED = 32
"""Cells along a side of a map up to which it is looked after at every step: of 60, a look takes half a second."""


_MOST_WORK = 60_000_000
"""Dots of all pupils together that a map of a display is judged by, once its first steps are made."""


@dataclass(frozen=True, eq=False)
class Judges:
    """Judges of a search's openings and panels, each made when it is first asked for.

    Attributes:
        seen: conditions of the scene; None where nothing of it must be modelled.

    Raises:
        JobError: MF121 for scenes without a spectrum; MF104, MF105 for weights that are none, when a judge is made.
    """

    section: SearchSection
    scenes: Sequence[Photograph]
    room: CellGrid
    settings: CaptureSettings
    seen: SceneConditions | None = None
    leak_scenes: int = 2

    @cached_property
    def estimate(self) -> Surrogate:
        """Surrogate of openings, in focus."""
        return surrogate_of(self._statistics, self.room)

    @cached_property
    def expected(self) -> ExpectedPsnr:
        """Judge of openings, over the distances of the scene."""
        periodic = self.section.tiling is Tiling.PERIODIC
        return ExpectedPsnr(
            self.estimate, periodic, self.settings.levels, self.section.weights or (), self._at_distances
        )

    @cached_property
    def in_focus(self) -> PupilError:
        """Judge of panels, in focus."""
        from maskfab.designs.model.panel_error import pupil_error

        return pupil_error(self.estimate, weights=self.section.weights)

    @cached_property
    def by_distance(self) -> tuple[PupilError, ...]:
        """Judges of panels at the distances of the scene; none where light has no phase nor scale of its own there."""
        from maskfab.designs.model.panel_error import pupil_error

        return tuple(pupil_error(estimate, weights=self.section.weights) for estimate in self._at_distances)

    @property
    def panel(self) -> PanelError:
        """Judge of panels, over the distances of the scene."""
        return MeanPanelError(self.by_distance) if self.by_distance else self.in_focus

    @cached_property
    def _statistics(self) -> SceneStatistics:
        return scene_statistics(self.scenes, leak_scenes=self.leak_scenes, settings=self.settings)

    @cached_property
    def _at_distances(self) -> tuple[Surrogate, ...]:
        if self.seen is None or not self.seen.turns_light:
            return ()
        room, line = self.seen.behind(self.room), self.room.camera.middle_nm
        phases = (self.seen.waves(distance, line) for distance in self.seen.distances_um)
        # Code values and light lie apart by what they do in focus, so that distances compare as their errors do.
        return tuple(
            replace(surrogate_of(self._statistics, room, waves), noise=self.estimate.noise) for waves in phases
        )


@dataclass(frozen=True, eq=False)
class Mapped:
    """A panel's opening and its map.

    Attributes:
        unit: bool [dots, dots]; of two, the denser one.
        cells, designed: the map; None where none was asked for.
        outer: the sparser one of two, bool [dots, dots].
        psnr: expected restored PSNR in dB by level of a panel of two; one is judged without its panel, and has None.
        head_room: by level, dB that no layout of as much light in every cell can gain over the map; None without one,
            for groups, over several distances, of many dots, and where the budget leaves no time for bounds.
        cut: the budget cut it short.
        fit: of the display on a die, for a panel of two that must hold one.
    """

    unit: Mask
    cells: CellMap | None = None
    designed: DesignedMap | None = None
    outer: Mask | None = None
    psnr: tuple[float, ...] | None = None
    head_room: tuple[float, ...] | None = None
    notes: tuple[str, ...] = ()
    cut: bool = False
    fit: DieFit | None = None


def search(
    section: SearchSection,
    scenes: Sequence[Photograph],
    command: str,
    progress: Progress = silent,
    *,
    camera: PhotoCamera = F1,
    settings: CaptureSettings = F1_SETTINGS,
    display: Display | None = None,
    spread: Spread = EXACT,
    seen: SceneConditions | None = None,
    clock: Clock = NO_END,
    checkpoint: Path | None = None,
    price_rules: bool = False,
    begin: Mask | None = None,
    executor: SerialExecutor = ALONE,
) -> Designed:
    """Search as the section says.

    Args:
        display: that the opening must hold; None for any or none.
        spread: over which the panel is appraised.
        clock: ends every stage in time for those after it; bounds, appraisals and alternatives are left out where
            they would take most of what is left.
        checkpoint: file to go on from, and to keep.
        price_rules: anneal once more without each rule, beyond the budget.
        begin: opening that the search begins at in place of a scan of families, bool [dots, dots].
        executor: shares with others what takes long: the judging of shapes, quick maps and bounds.

    Raises:
        JobError, OpeningError: MF104, MF106, MF107, MF135 for numbers; MF121 for scenes without a spectrum; MF123,
            MF203, MF204 for rules that no opening keeps, or that cannot be shown to hold at several places in a cell;
            MF115 for a map of too many cells, or of cells of too many dots.
        SourceError, OutputError: MF303, MF304, MF401 for the checkpoint.
    """
    rules = constraints_of(section, display=display)
    room = _room_of(section, rules, camera)
    section, rules, start = started(section, rules, display, clock, progress, begun=begin is not None)
    progress("photographs", 0, 1)
    judges = Judges(section, scenes, room, settings, seen)
    expected = judges.expected
    progress("photographs", 1, 1)
    panels = judges if section.map is None else replace(judges, leak_scenes=MAP_LEAK_SCENES)
    # Made before the stages have their time, for it takes some.
    panel = None if section.map is None else panels.panel
    stages, look = _stages(section, rules, expected, display, start, clock)
    made_for = camera_facts(camera, settings, seen)
    store = (
        None
        if checkpoint is None
        else Kept(
            checkpoint,
            run_key(section, scenes, *made_for.values(), *(() if begin is None else (begin.tobytes(),))),
        )
    )
    if section.objective == "auc":
        state = _by_auc(section, rules, room, stages.search, progress)
    else:
        state = (
            scanned(section, rules, expected, stages.search, store, progress, start, executor=executor)
            if begin is None
            else begun(begin, section, rules, expected, progress)
        )
        state = annealed(state, section, rules, expected, stages.search, store, progress)
    listed: tuple[Listed, ...] = (Listed(state.best, rules),)
    if panel is not None and section.map is not None and for_any_map(section):
        state, listed = shortlisted(
            state,
            section.shortlist,
            panel,
            rules,
            stages.search,
            progress,
            judge=expected,
            mode=MapMode(section.map),
            seed=map_seed(section),
            positions=section.positions,
            start=start,
            executor=executor,
        )

    def of_count(clear_dots: int) -> Iterator[Mask]:
        other, sought = section.model_copy(update={"clear_dots": clear_dots}), section.density == "search"
        held = rules.on_any_map.without(*OF_THE_EYE) if sought else rules
        return allowed(other, replace(held, clear_dots=clear_dots), expected, stages.map, progress, once=sought)

    made = origin(section, command, made_for)

    def lay(chosen: Listed) -> Mapped:
        return mapped(
            section,
            chosen.shape.unit,
            chosen.rules,
            judges.estimate,
            panel,
            made,
            of_count,
            stages.map,
            progress,
            groups=None if section.cluster is None else groups_of(panels, section.cluster, rules.dot_nm),
            bounded=stages.bounded,
            guard=chosen.guard,
            begun=chosen.begun,
            alike=chosen.alike,
            executor=executor,
        )

    chosen, laid, fit = _first_that_fits(listed, lay, look, progress)
    state, rules = replace(state, best=chosen.shape), chosen.rules
    facts: Facts = {**made, "shape": state.best.name}
    laid, fit, seeds = _with_seeds(laid, fit)
    priced = _priced(state, expected, rules, clock)
    psnr, appraisal, head_room, gap, notes = laid.psnr, Facts(), None, None, (*state.notes, *laid.notes)
    short = not stages.bounded or not clock.affords(stages.bounds_s)
    if psnr is None and short:
        notes += (NO_BOUNDS,)
    elif psnr is None:
        progress("bounds", 0, 1)
        psnr, appraisal, head_room, gap = appraised(judges.estimate, laid.unit, periodic=expected.periodic)
        progress("bounds", 1, 1)
    if psnr is None or (expected.distances and laid.psnr is None):
        psnr = expected.by_level(laid.unit)
    robust = None if short else _appraised(section, laid, panels.in_focus, spread)
    near = None if short else _alternatives(section, state, laid, rules, expected, panels.in_focus)
    scene = None if seen is None or short else over_scene(section, laid, rules.dot_nm, panels, seen)
    if seen is not None and short:
        notes += ("The scene counts in the search; with a longer budget its conditions are told apart.",)
    facts |= {
        **appraisal,
        **by_level("expected_psnr", psnr, settings.levels),
        "evaluated": state.evaluated,
        **seeds,
        **({} if priced is None else of_prices(priced)),
    }
    account = _account(section, state, rules, laid)
    if price_rules and rules.active and section.anneal and state.looked:
        account = replace(account, without=annealed_without(state, section, rules, expected, progress))
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
        None if laid.outer is None else Opening(_named(section, "_outer"), laid.outer, rules.dot_nm, facts),
        (*_few_cells(room, section), *notes, *(() if look is None else look.notes(fit))),
        state.cut or laid.cut,
        shortfall=None if start is None else start.shortfall,
        camera=made_for_line(camera, settings, seen),
        levels=settings.levels,
        robust=robust,
        fit=fit,
        scene=scene,
        account=account,
        alternatives=near,
        rivals=tuple(one for one in state.held if one.unit is not state.best.unit)[:_RIVALS],
    )


def _priced(state: Best, judge: Objective, rules: Constraints, clock: Clock) -> Prices | None:
    """Costs of the rules among openings that were looked at in dB; those of the eye take half a second for each, which
    no budget leaves."""
    dear = clock.budget_s is not None and not {"grain", "delta_e"}.isdisjoint(rules.active)
    return prices(state.looked, judge, rules) if state.looked and not dear else None


@dataclass(frozen=True, eq=False)
class Listed:
    """An opening that a map is designed for.

    Attributes:
        rules: that it keeps; of a display, in the kind of panel that suits it.
        guard: of its map; None where no map breaks what it must hold.
        alike: whether all cells are laid alike, for want of another map in which lines are found.
        begun: its quick map to go on from; None where there is none.
    """

    shape: Ranked
    rules: Constraints
    guard: Guard | None = None
    begun: DesignedMap | None = None
    alike: bool = False


def shortlisted(
    state: Best,
    most: int,
    error: PanelError,
    rules: Constraints,
    clock: Clock,
    progress: Progress,
    *,
    judge: Objective,
    mode: MapMode,
    seed: int,
    positions: int = 1,
    start: Start | None = None,
    executor: SerialExecutor = ALONE,
) -> tuple[Best, tuple[Listed, ...]]:
    """The openings of a list as quick maps rank them, the best first, and the search with that as its best.

    Where a display is held, openings round which lines run alike are on the list, and beside these the best of those
    whose lines depend on the map; maps then go on from the quick ones. Of equals the earlier is the better.

    Args:
        state: its best is on the list, then those that were looked at, best first.
        most: openings on the list; 1 leaves everything as it is.
        error: of panels of such units; the levels weigh in it as they do in the scan.
        clock: no further map is begun or compared when its time is over.
        judge: of openings whose cells are turned at random.
        mode, seed, positions: of :func:`maskfab.designs.maps.orientation_map.design_map`.
        start: of a search for a display; None for any other.

    Raises:
        JobError: as ``design_map``.
    """
    if start is not None:
        # Where pupils are large, maps take their time: the best opening alone has it.
        most = min(most, max(1, _MOST_WORK // (_QUICK_FIELDS * error.lattice.side**2)))
    listed = _listed(state, most, rules, judge, start)
    if len(listed) < 2:
        return state, listed
    # A random map's light differs by chance, and more of it is no merit of a shape: all have what is expected.
    count = int(listed[0].shape.unit.sum())
    light = round(float(error.inside.sum()) * count / error.dots**2)

    quick_map = partial(
        design_map,
        error=error,
        mode=mode,
        seed=seed,
        kicks=0,
        positions=positions,
        light=light,
        steps=None if start is None else _QUICK_FIELDS,
    )

    def call(one: Listed) -> Call[DesignedMap | None]:
        # No rule is asked where the unit stays in its place.
        made = partial(quick_map, one.shape.unit, **({"allows": one.rules.allows} if positions > 1 else {}))
        return Call(_in_time, lambda: (made, clock))

    calls = [call(one) for one in listed]
    maps: list[DesignedMap] = []
    for quick in executor.run_alike(calls, lambda done: progress("shortlist", done, len(listed))):
        if quick is None:
            break
        maps.append(quick)
    cut = len(maps) < len(listed)
    notes = [f"{clock.ender} ended the shortlist after {len(maps)} of {len(listed)} quick maps."] if cut else []
    values = [float(np.dot(error.weights, quick.psnr)) for quick in maps]
    order = sorted(range(len(values)), key=lambda k: (-values[k], k)) or [0]
    first, best = listed[0].shape, listed[order[0]].shape
    if order[0]:
        better = values[order[0]] - values[0]
        turned = "" if listed[order[0]].guard else ", which is the better one turned at random"
        notes.append(f"Under quick maps, {best.name} restores {better:.3f} dB better than {first.name}{turned}.")
    found = replace(
        state,
        best=replace(best, value=best.value if start is not None else state.best.value),
        notes=(*state.notes, *notes),
        cut=state.cut or cut,
        stages=(*state.stages, ("quick maps", len(values))),
    )
    if start is None or not maps:
        return found, (replace(listed[order[0]], shape=found.best),)
    return found, tuple(replace(listed[k], begun=maps[k]) for k in order)


def _in_time(made: Callable[..., DesignedMap], clock: Clock) -> DesignedMap | None:
    """A map for which there is time; one that was ended early is not compared with others."""
    if clock.over:
        return None
    quick = made(clock=clock)
    return None if clock.over else quick


def _listed(state: Best, most: int, rules: Constraints, judge: Objective, start: Start | None) -> tuple[Listed, ...]:
    shapes = [Candidate(state.best.name, state.best.unit), *state.looked]
    if start is None:
        kinds = different(shapes, rules, most)
        return tuple(Listed(Ranked(one.name, one.unit, state.best.value), rules) for one in kinds)
    own = []
    for one in different(shapes, rules, most):
        value = judge(one.unit)
        if value >= state.best.value - _WORSE_DB:
            own.append(Listed(Ranked(one.name, one.unit, value), rules, start.guard(one.unit)))
    if not start.any_map or most < 2:
        return tuple(own)
    better = (Candidate(one.name, one.unit) for one in state.near if one.value >= state.best.value + _BETTER_DB)
    laid = start.laid_alike
    for one in different(islice(better, _ASKED), laid.rules, _BESIDE):
        own.append(Listed(Ranked(one.name, one.unit, judge(one.unit)), laid.rules, laid.guard(one.unit)))
    return tuple(own)


def different(candidates: Iterable[Candidate], rules: Constraints, most: int) -> tuple[Candidate, ...]:
    """At most so many that keep the rules: of every family and size, turned or not, the first."""
    first: dict[tuple[str, int, int], Candidate] = {}
    for shape in candidates:
        if len(first) >= most:
            break
        key = kind(shape.name, shape.unit)
        if key not in first and rules.allows(shape.unit):
            first[key] = shape
    return tuple(first.values())


def mapped(
    section: SearchSection,
    unit: Mask,
    rules: Constraints,
    estimate: Surrogate,
    error: PanelError | None,
    facts: Facts,
    find: Callable[[int], Iterable[Mask]],
    clock: Clock,
    progress: Progress,
    groups: Judges | None = None,
    *,
    bounded: bool = True,
    guard: Guard | None = None,
    begun: DesignedMap | None = None,
    alike: bool = False,
    executor: SerialExecutor = ALONE,
) -> Mapped:
    """Lay the unit out as the section says.

    Args:
        unit: bool [dots, dots].
        estimate: of the scenes.
        error: of panels, the same scenes; None where no map is wanted.
        find: gives openings of so many clear dots, the best first, for a panel of two.
        clock: a map whose time is over is taken as it is after its first steps, which bring most of the gain.
        groups: of groups of pixels; None unless they share their light.
        bounded: prove what no other map gains.
        begun: map to go on from; None starts at the random one.

    Raises:
        JobError: MF115 for a map of too many cells, or of cells of too many dots; MF123 for openings that break the
            rules beside one another, or at the places that they were to be moved to.
    """
    if section.map is None or error is None:
        return Mapped(unit)
    mode, seed = MapMode(section.map), map_seed(section)
    kicks = 0 if clock.over else 1 if rules["emitters"] else _KICKS
    notes = ("Time ran out: each map got one pass of its search.",) if clock.over else ()
    if section.density is not None:
        asked = Denser(section.density, section.outer_dots)
        kept = rules.on_any_map if asked.sought else rules
        made = graded(unit, error, asked, find, constraints=kept, seed=seed, kicks=kicks, progress=progress)
        pupil = error.laid(made.units, made.designed.orientations)
        room = _head_room(estimate, error, pupil, executor) if bounded else None
        return _of_two(section, made, error, facts, "middle", notes, room)
    if groups is not None:
        most = most_dots(section)
        made = clustered(
            unit,
            error,
            most,
            find,
            groups.expected,
            groups.panel,
            constraints=rules,
            seed=seed,
            kicks=kicks,
            progress=progress,
        )
        return _of_two(section, made, error, facts, "pixels of a group", notes)
    limit = max(FIRST_STEPS, _MOST_WORK // error.lattice.side**2)
    lay_out = partial(
        joint,
        unit,
        error,
        rules,
        rounds=section.joint if guard is None else 0,
        seed=seed,
        mode=mode,
        positions=section.positions,
        clock=clock,
        progress=progress,
    )
    if alike:
        start = np.zeros((error.cells, error.cells), dtype=np.int8)
        both = lay_out(kicks=0, start=start, holds=lambda cells: not cells.any(), steps=1)
    else:
        both = lay_out(
            kicks=kicks,
            start=None if begun is None else begun.orientations,
            shifts=() if begun is None else begun.shifts,
            steps=limit if rules["emitters"] else None,
        )
    if guard is not None and not guard(both.designed.orientations):
        mended = guard.mended(both.designed.orientations)
        steps = limit if error.cells <= _MOST_GUARDED else FIRST_STEPS
        both = lay_out(kicks=0, start=mended, holds=guard, steps=steps)
    cut = f"{clock.ender} ended the map after {both.designed.fields} steps of its last descent."
    notes = (cut,) if clock.over else ()
    if alike:
        notes = (*notes, "In no other map that was designed were all lines found: all cells are laid alike.")
    room = _head_room(estimate, error, laid(both.unit, both.designed, error), executor) if bounded else None
    facts = {**facts, **({} if room is None else by_level("head_room", room, error.levels))}
    cells = map_of(section, error, both.designed, facts)
    return Mapped(both.unit, cells, both.designed, head_room=room, notes=notes, cut=clock.over)


def for_any_map(section: SearchSection) -> bool:
    """Whether a map of one opening is designed, by photographs."""
    return (
        section.map is not None
        and section.objective == "restored"
        and (section.density, section.cluster) == (None, None)
    )


def _room_of(section: SearchSection, rules: Constraints, camera: PhotoCamera) -> CellGrid:
    """The cells before the stop, refused where no map of them can be designed as asked."""
    room = lattice(section.dots, rules.dot_nm, camera=camera)
    if section.map is not None:
        require_size(room)
    if section.positions > 1:
        require_places(rules)
    return room


def started(
    section: SearchSection,
    rules: Constraints,
    display: Display | None,
    clock: Clock,
    progress: Progress,
    *,
    begun: bool = False,
) -> tuple[SearchSection, Constraints, Start | None]:
    """The section and its rules as the search goes on with them, and the first opening that a display fits.

    That is sought where a map of one opening is designed; elsewhere openings are asked as they come, unless none fits
    of those that a scan would judge. There is no scan where the search has ``begun`` at an opening.

    Raises:
        JobError, OpeningError: MF123, MF203, MF204 for rules that contradict each other, and for a display that was
            found to fit openings of no number of dots.
    """
    if display is None or not for_any_map(section):
        rules.require_possible()
        if display is not None and not begun and section.objective == "restored":
            require_held(rules, section.families, clock, progress)
        return section, rules, None
    start = start_of(rules, section.families, clock, progress)
    if start is None:
        rules.require_possible()
        what = f"no opening of 1 to {section.clear_dots} clear dots was found beside which the display fits"
        raise JobError("MF123", what, where="design.fit", cure=EASE)
    counted = {"clear_dots": start.rules.clear_dots, "families": start.families}
    return section.model_copy(update=counted), start.rules, start


def map_seed(section: SearchSection) -> int:
    """Seed of the random map that a map starts from."""
    return section.seed if section.tiling_seed is None else section.tiling_seed


def _head_room(
    estimate: Surrogate, error: PanelError, pupil: Floats, executor: SerialExecutor
) -> tuple[float, ...] | None:
    """Decibels by level that no layout of as much light in every cell gains; None where no bound is known."""
    # What bounds a panel in focus bounds no mean over distances.
    gap = None if isinstance(error, MeanPanelError) else layout_gap(estimate, pupil, executor=executor)
    return None if gap is None else gap.head_room


def _of_two(
    section: SearchSection,
    made: Graded,
    error: PanelError,
    facts: Facts,
    denser: str,
    notes: tuple[str, ...],
    room: tuple[float, ...] | None = None,
) -> Mapped:
    facts = {
        **facts,
        **by_level("graded_gain_db", made.gain_db, error.levels),
        "emitter_share_uniform": round(made.uniform_share, 4),
        "emitter_share": round(made.share, 4),
        "emitter_life_ratio": round(made.life_ratio, 4),
    }
    price = (
        f"The display pays for the denser {denser}: emitters, alike in all cells, of {made.share:.1%} of the pixel in "
        f"each colour instead of {made.uniform_share:.1%}, which live {made.life_ratio:.2f} as long at equal luminance."
    )
    if made.denser_cells:
        facts["denser_cells"] = made.denser_cells
        inner, outer = (int(unit.sum()) for unit in made.units)
        price = f"{made.denser_cells} cells behind the stop hold {inner} dots, the others {outer}. {price}"
    if made.grain is not None:
        facts["slow_grain"] = round(made.grain, 4)
        price += f" The slow grain of an even field is {made.grain:.3f}, its pixels turned at random."
    if made.lines is not None:
        facts["lines"] = made.lines
        price += f" {made.lines} lines each way pass both openings."
    facts |= {} if room is None else by_level("head_room", room, error.levels)
    cells = map_of(section, error, made.designed, facts)
    dense, sparse = made.units
    notes, cut = (*notes, price), bool(notes)
    return Mapped(dense, cells, made.designed, sparse, made.designed.psnr, room, notes, cut=cut, fit=made.fit)


def map_of(section: SearchSection, error: PanelError, designed: DesignedMap, facts: Facts) -> CellMap:
    """A designed map under its name, with its provenance added to that of its opening."""
    light = round(designed.clear_dots / designed.start_clear_dots - 1, 5) + 0.0
    facts = {
        **facts,
        "mode": designed.mode.value,
        **by_level("gain_db", designed.gain_db, error.levels),
        "light": light,
    }
    # Round it lies a regular display, of the opening that lies at its rim: wires go straight on, and none is drawn.
    beyond = 0 if designed.shifts else int(designed.orientations.max()) // ORIENTATIONS * ORIENTATIONS
    return CellMap(_named(section, "_map"), designed.orientations, facts, designed.shifts, beyond)


def _named(section: SearchSection, part: str) -> str:
    """Name of a part of a design, no longer than names are."""
    return section.name[: _LONGEST_NAME - len(part)] + part


def groups_of(panels: Judges, side: int, dot_nm: int) -> Judges:
    """Judges of groups, so many pixels along a side, by the same photographs as those of single pixels."""
    room = lattice(side * panels.section.dots, dot_nm, camera=panels.room.camera)
    require_size(room)
    return replace(panels, room=room)


def _by_auc(section: SearchSection, rules: Constraints, room: CellGrid, clock: Clock, progress: Progress) -> Best:
    """The best blue AUC; where it breaks the rules, annealed from the nearest that keeps them."""
    from maskfab.designs.search.mtf_exchange import best_for_auc

    periodic = section.tiling is Tiling.PERIODIC
    unit = best_for_auc(
        section.dots,
        section.clear_dots,
        periodic=periodic,
        seed=section.seed,
        steps=section.anneal or None,
        room=room,
        progress=progress,
    )
    figure, notes, evaluated, cut = rings(section.dots, room=room), [], 1, False

    def area(mask: Mask) -> float:
        return figure.of_unit(mask, periodic=periodic)

    if broken := sorted(rules.broken(unit)):
        free = area(unit)
        walked = anneal(
            nearest(unit, rules, seed=section.seed),
            area,
            rules,
            evaluations=section.anneal or _AUC_EVALUATIONS,
            seed=section.seed,
            temperature=_AUC_TEMPERATURE,
            clock=clock,
            progress=progress,
        )
        unit, evaluated, cut = walked.unit, 2 + walked.state.evaluations, not (walked.complete or walked.stuck)
        notes.append(
            f"The best for AUC, {free:.4f}, breaks {', '.join(broken)}; annealed for {walked.state.evaluations} "
            f"evaluations from the nearest opening found that keeps them, to {walked.value:.4f}."
        )
    best = Ranked(f"auc {area(unit):.4f}", unit, area(unit))
    return Best(best, (), evaluated, tuple(notes), cut, stages=(("openings judged", evaluated),))


def _first_that_fits(
    listed: Sequence[Listed],
    lay: Callable[[Listed], Mapped],
    look: DieLook | None,
    progress: Progress,
) -> tuple[Listed, Mapped, DieFit | None]:
    """The first of a list whose panel holds the display on a die, if one must; only guarded maps may fail to.

    Raises:
        JobError: MF123 where none does.
    """
    alike = (replace(one, alike=True) for one in listed if one.guard is not None)
    for chosen in (*listed, *alike):
        laid = lay(chosen)
        fit = _fit(look, laid, chosen.rules, progress)
        if chosen.guard is None or fit is None or fit.why is None:
            break
    _require_fit(fit, laid)
    return chosen, laid, fit


def _stages(
    section: SearchSection,
    rules: Constraints,
    expected: ExpectedPsnr,
    display: Display | None,
    start: Start | None,
    clock: Clock,
) -> tuple[Stages, DieLook | None]:
    """Clocks of the stages of a design, and the look at a die that ends it, if a display must fit one.

    Raises:
        JobError: MF150 as :meth:`maskfab.designs.search.result.Stages.of`.
    """
    unit = first_shape(section)
    first = unit if start is None else start.first.unit
    look = None if display is None else DieLook.of(display, clock, first, rules.dot_nm)
    die_s = 0.0 if look is None else look.seconds
    mapped, fitted = section.map is not None, look is not None
    return Stages.of(expected, unit, clock, mapped=mapped, fitted=fitted, die_s=die_s), look


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
    seed, shape = map_seed(section), (error.cells, error.cells)
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
    seed, shape = map_seed(section), (error.cells, error.cells)
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
    by_auc = section.objective == "auc"
    wanted = "area under the radial minimum of the blue MTF" if by_auc else "expected restored PSNR"
    among = "" if by_auc else f" among shapes of the families {', '.join(section.families)}"
    among = " from a start of one's own" if state.best.name.startswith("start") else among
    stages = state.stages
    if section.joint and not laid.cut:
        stages = (*stages, ("rounds of opening and map, at most", section.joint))
    return Account(
        f"search for the most {wanted}{among}",
        section.seed,
        stages,
        "" if by_auc else "expected restored PSNR, dB, weighted mean over the levels",
        state.bettered,
        stopped(state.cut or laid.cut),
        section.tiling,
        map_seed(section),
        asked_of(rules),
        priced_among=len(state.looked),
    )


def over_scene(section: SearchSection, laid: Mapped, dot_nm: int, judges: Judges, seen: SceneConditions) -> SceneDesign:
    """Appraise a panel in every condition.

    Raises:
        JobError: as :func:`maskfab.designs.model.appraisal.appraise_over`.
    """
    errors = judges.by_distance or (judges.in_focus,)
    seed, across = map_seed(section), cells_across(seen.camera, seen.scene, judges.room)

    def panel(given: CellMap | None) -> Panel:
        return designed_panel(
            laid.unit, dot_nm, tiling=section.tiling, seed=seed, across=across, given=given, outer=laid.outer
        )

    appraisal = appraise_over(panel(laid.cells), seen, errors)
    if laid.cells is None or laid.outer is not None:
        return SceneDesign(seen, appraisal, None)
    drawn = orientations(section.tiling, judges.room.cells, judges.room.cells, seed)
    return SceneDesign(seen, appraisal, appraise_over(panel(CellMap("random", drawn)), seen, errors))
