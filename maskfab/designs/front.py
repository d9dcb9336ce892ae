"""Designs for a display, and what they trade: light, restored photographs, emitters, wires and grain.

Every shape is judged by its expected restored PSNR. From the best downwards, to half a decibel below it, its
footprint and the lines that pass it are measured, and only where a bound leaves room for a quarter of a percent of
the pixel above all that were measured before. So each curve is exact, to that step, among all shapes judged;
footprints are those of rectangles and straight cuts, which crooked emitters may exceed. What is on a curve is then
laid on the panel of a die, with its map, and held against the display by the check itself. Beside the best of a curve
stand designs of its light with more of it in the middle of the stop.
"""

from __future__ import annotations

import math
import time
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from itertools import chain
from types import MappingProxyType
from typing import TYPE_CHECKING, TypeVar

import numpy as np

from maskfab.base.arrays import Mask
from maskfab.base.cell_size import CellSize
from maskfab.base.errors import InputError, JobError
from maskfab.base.extras import require
from maskfab.base.model import ORIENTATIONS, Opening
from maskfab.base.processes import ALONE, Call, SerialExecutor
from maskfab.base.units import NM_PER_UM
from maskfab.base.work import NO_END, Clock, Progress, silent
from maskfab.base.workers import EVERY_CORE, Workers
from maskfab.camera.scenes import Photograph
from maskfab.camera.stop_cells import F1, PhotoCamera, lattice
from maskfab.designs.design import densest, require_closed
from maskfab.designs.maps.light import Graded, Middle, graded, laid, middles
from maskfab.designs.maps.orientation_map import FIRST_STEPS, DesignedMap, MapMode, design_map
from maskfab.designs.maps.shares import Denser
from maskfab.designs.model.appraisal import compared_bias_um, moved_by_bias
from maskfab.designs.model.statistics import F1_SETTINGS, CaptureSettings
from maskfab.designs.rules.constraints import Constraints
from maskfab.designs.rules.display_fit import OF_THE_EYE, Display, Footprints, footprints_of, misfit, of_display
from maskfab.designs.rules.families import FAMILIES, Candidate
from maskfab.designs.search.annealing import ExpectedPsnr, Ranked, anneal, scan
from maskfab.designs.search.panel_map import map_of
from maskfab.designs.search.question import MAP_LEAK_SCENES, Judges
from maskfab.designs.search.result import (
    Alternatives,
    Prices,
    alternatives,
    asked_of,
    constraints_of,
    made_for_line,
    prices,
)
from maskfab.designs.search.scan import PRICED, allowed
from maskfab.display.emitted_light import TELEPHONE_UM, Viewing
from maskfab.display.turned_grain import turned_grain
from maskfab.job.sections import ParetoSection, SearchSection
from maskfab.mask.panels import CellMap
from maskfab.optics.tiling import orientations

if TYPE_CHECKING:
    from maskfab.designs.model.panel_error import PupilError


T = TypeVar("T")

Uneven = tuple[tuple[str, float | str], ...]
"""Keys of [design] that share light unevenly, the one that tells how much last."""

ROUNDING = 1e-9
"""Shares of a pixel that differ by less are equal."""

_BATCH = 64

_MIDDLES = 12
"""Densities of the middle that are looked at, evenly between one opening's and the most that emitters leave."""

_LESS_GRAIN = 0.001

_STEP = 0.0025
"""Footprints count as more from so much of the pixel on: less is no reason for another design."""

_DEPTH_DB = 0.5
"""Openings whose PSNR is so far below the best that the display fits are not looked at: fewer dots do better there."""


@dataclass(frozen=True, eq=False)
class JudgedOpening:
    """An opening with its numbers.

    Attributes:
        shape: the family, size and place it came from, or the name of an opening that was given.
        unit: bool [dots, dots], True is clear, row 0 the lowest.
        value: expected restored PSNR in dB of cells that are turned at random, or all alike where the panel is
            periodic; weighted mean over the levels of light.
        psnr: the same by level.
        footprint: share of the pixel that each colour covers, mean over the emitters' ratio.
        lines: most opaque lines, of the numbers that were asked about, that cross every pixel each way.
    """

    shape: str
    unit: Mask
    value: float
    psnr: tuple[float, ...]
    footprint: float
    lines: int

    @property
    def clear_dots(self) -> int:
        return int(self.unit.sum())

    @property
    def open_ratio(self) -> float:
        return self.clear_dots / self.unit.size

    def betters(self, other: JudgedOpening) -> bool:
        """Whether it has at least as much of everything, and more of one."""
        mine, its = ((o.value, o.footprint, o.lines) for o in (self, other))
        return all(a >= b for a, b in zip(mine, its, strict=True)) and mine != its


@dataclass(frozen=True, eq=False)
class FrontPoint:
    """A design that fits: an opening, or two, on a panel, with emitters and wires.

    Attributes:
        judged: the opening; of two, the one on whose panel it passes as much light.
        units: bool [1 or 2, dots, dots], what is laid, the denser one first.
        uneven: keys of [design] that ask for light shared unevenly, with their values; none for one opening.
        footprint: share of the pixel that each colour covers, mean over the emitters' ratio, alike in all cells.
        lines: most opaque lines, of the numbers that were asked about, that cross every pixel each way.
        mapped: expected restored PSNR in dB by level on its panel, whose map had one descent; None without a map.
        value: of what is laid: weighted mean over the levels, mapped if there is a map.
        grain: rms luminance contrast of an even white field up to 10 cycles per degree, seen from 300 mm, pixels
            turned at random.
        centroid_px: distance of the light's centroid from the pixel's middle, pixels.
    """

    judged: JudgedOpening
    shape: str
    units: Mask
    uneven: Uneven
    footprint: float
    lines: int
    mapped: tuple[float, ...] | None
    value: float
    cells: CellMap | None
    grain: float
    centroid_px: float = 0.0

    @property
    def psnr(self) -> tuple[float, ...]:
        """Expected restored PSNR in dB by level, of what is laid."""
        return self.judged.psnr if self.mapped is None else self.mapped

    @property
    def densest(self) -> float:
        """Clear share of the densest cells; of one opening, its open ratio."""
        return float(self.units[0].mean())

    def betters(self, other: FrontPoint) -> bool:
        """Whether it has at least as much of everything that is wanted and as little grain, and is better in one."""
        mine, its = ((p.value, p.footprint, p.lines, -p.grain) for p in (self, other))
        return all(a >= b for a, b in zip(mine, its, strict=True)) and mine != its


@dataclass(frozen=True, eq=False)
class FrontCurve:
    """The designs of one number of clear dots.

    Attributes:
        front: of one opening, PSNR falling; none that was judged betters one of them in PSNR, footprint and lines.
        denser: at the same light, of denser cells and sparser ones.
        evaluated: shapes whose PSNR was computed.
        measured: those whose footprint and lines were measured too.
        left_out: openings that none betters either, between those of ``front``; a curve holds only so many.
        misfits: why openings that none betters are not in ``front``: what their display's check says of the die.
        refusal: why there is no design of so many dots, where ``front`` is empty.
        asked: parts of the display that every design holds, the least of each, with what it asks.
        prices: what these cost among the shapes judged; None where there is no design, and where the budget is over.
        alternatives: openings of nearly the PSNR of the best of ``front``; None as ``prices``.
    """

    clear_dots: int
    front: tuple[FrontPoint, ...]
    denser: tuple[FrontPoint, ...]
    evaluated: int
    measured: int
    left_out: int
    misfits: tuple[str, ...]
    complete: bool
    refusal: str | None = None
    asked: Mapping[str, str] = field(default_factory=lambda: MappingProxyType({}))
    prices: Prices | None = None
    priced_among: int = 0
    alternatives: Alternatives | None = None

    @property
    def points(self) -> tuple[FrontPoint, ...]:
        """Designs of one opening, then those of two."""
        return (*self.front, *self.denser)


@dataclass(frozen=True, eq=False)
class Pareto:
    """Result of a sweep.

    Attributes:
        curves: one for each number of clear dots, rising.
        compared: the openings given, judged alike, in their order.
        lines: numbers of lines that were asked about, rising.
        kept: rules of [design] that every opening keeps.
        limits: of the eye, by the name of the rule; designs of a denser middle that is sought need not keep them.
    """

    curves: tuple[FrontCurve, ...]
    compared: tuple[JudgedOpening, ...]
    dot_nm: int
    levels: tuple[float, ...]
    lines: tuple[int, ...]
    designed_for: str
    seed: int
    kept: tuple[str, ...] = ()
    limits: Mapping[str, float] = field(default_factory=lambda: MappingProxyType({}))

    @property
    def points(self) -> tuple[FrontPoint, ...]:
        """Designs of all curves."""
        return tuple(point for curve in self.curves for point in curve.points)

    @property
    def best(self) -> tuple[FrontPoint, ...]:
        """Designs that no other betters, whatever their clear dots."""
        return tuple(point for point in self.points if not any(other.betters(point) for other in self.points))

    def gain_db(self, other: JudgedOpening) -> float | None:
        """Gain of the best opening found over another, both unmapped, at no less footprint, no fewer lines and no more
        clear dots; None where nothing found has them."""
        rivals = [
            point.judged.value
            for point in self.points
            if point.judged.clear_dots <= other.clear_dots
            and point.judged.footprint >= other.footprint - ROUNDING
            and point.judged.lines >= other.lines
        ]
        return max(rivals) - other.value if rivals else None


def sweep(
    pareto: ParetoSection,
    section: SearchSection,
    scenes: Sequence[Photograph],
    display: Display,
    *,
    compared: Sequence[Opening] = (),
    camera: PhotoCamera = F1,
    settings: CaptureSettings = F1_SETTINGS,
    clock: Clock = NO_END,
    workers: Workers = EVERY_CORE,
    progress: Progress = silent,
) -> Pareto:
    """Judge every shape of every size, and keep the designs that none betters.

    Args:
        display: that every design must hold: its least footprint, its circuits, and the numbers of lines asked about.
        compared: openings on the same grid, judged as if laid in the same tiling.
        settings: of the photographs that openings are compared by.
        clock: of the budget; every size has its share of it, and at least 64 shapes. How long maps and dies take is
            measured, and fewer points are laid where it leaves no time for all.

    Raises:
        MissingPackageError: MF152 without torch.
        JobError, OpeningError: as :func:`rules_of` and :func:`lines_of`; the first size's own error, MF123, MF203 or
            MF204, if no size has any design.
    """
    require("design", what="a front of designs")
    rules, lines = rules_of(section, display, compared), lines_of(pareto, display)
    room = lattice(section.dots, rules.dot_nm, camera=camera)
    progress("photographs", 0, 1)
    objective = Judges(section, scenes, room, settings).expected
    panels = Judges(section, scenes, room, settings, leak_scenes=MAP_LEAK_SCENES)
    error = None if section.map is None else panels.in_focus
    progress("photographs", 1, 1)
    footprints = footprints_of(rules, display.rules.emitters)
    counts = sorted(set(pareto.clear_dots))
    curves: list[FrontCurve] = []
    refusals: list[InputError] = []
    many = workers.at_once(pareto.points)
    with workers.executor(many) as executor:
        work = _Sweep(
            pareto, section, objective, panels, error, footprints, rules, display, lines, many, executor, progress
        )
        for done, count in enumerate(counts):
            try:
                curves.append(work.curve(count, clock.part(1 / (len(counts) - done))))
            except InputError as refusal:
                refusals.append(refusal)
                curves.append(FrontCurve(count, (), (), 0, 0, 0, (), True, f"{refusal.code} {refusal.what}"))
    if len(refusals) == len(counts):
        raise refusals[0]
    given = tuple(work.given(opening) for opening in compared)
    return Pareto(
        tuple(curves),
        given,
        rules.dot_nm,
        settings.levels,
        lines,
        made_for_line(camera, settings),
        section.seed,
        rules.without(*of_display(display), *OF_THE_EYE).active,
        MappingProxyType({name: rules[name] for name in OF_THE_EYE if name in rules.active}),
    )


def rules_of(section: SearchSection, display: Display, compared: Sequence[Opening] = ()) -> Constraints:
    """Constraints of a sweep's openings; refuses, at no cost, what a sweep would refuse before it starts.

    Raises:
        JobError: MF104, MF106, MF107 for numbers; MF105 for an opening on another grid; MF117, MF118 for the emitters'
            rules.
    """
    rules = constraints_of(section, display=display)
    for opening in compared:
        if (opening.dots, opening.dot_nm) != (rules.dots, rules.dot_nm):
            what = (
                f"the opening {opening.name!r} has {opening.dots} dots of {opening.dot_nm / NM_PER_UM:g} um a side, "
                f"[design] {rules.dots} of {rules.dot_nm / NM_PER_UM:g} um"
            )
            raise JobError("MF105", what, where="pareto.compare", cure="Compare openings on the grid of [design]")
    return rules


def lines_of(pareto: ParetoSection, display: Display, *, where: str = "pareto.lines") -> tuple[int, ...]:
    """Numbers of lines that a sweep asks about, rising. Raises JobError MF105 for lines without the rules of any."""
    wires = display.rules.wires
    if pareto.lines is None:
        return (0 if wires is None else wires.lines,)
    if wires is None and any(pareto.lines):
        what = "the job has no [wires], whose rules lines keep"
        raise JobError("MF105", what, where=where, cure="Add [wires], or remove lines")
    return tuple(sorted(set(pareto.lines)))


def require_uneven(pareto: ParetoSection, section: SearchSection, display: Display, *, where: str = "pareto") -> None:
    """Refuse denser pixels that no design of a sweep can have.

    Raises:
        JobError: MF105 without a map; MF104 for no more dots than those of any curve; MF123 where emitters need more
            than the denser pixels leave closed.
    """
    least = min(pareto.clear_dots)
    for uneven in _uneven(pareto):
        key, value = uneven[-1]
        if section.map is None:
            what = f"{key} needs a map"
            raise JobError("MF105", what, where=f"{where}.{key}", cure='Add map = "equal_light" to [design]')
        if isinstance(value, str):
            continue
        if value <= least / section.dots**2:
            what = f"{key} = {value:g} is not above the {least} clear dots of any curve"
            raise JobError("MF104", what, where=f"{where}.{key}", cure="Ask for more in the denser pixels")
        require_closed(1 - value, display.rules.emitters.required, f"{key} = {value:g}", where=f"{where}.{key}")


def _uneven(pareto: ParetoSection) -> list[Uneven]:
    """Ways to share light unevenly that a sweep tries, as keys of [design]."""
    return [(("density", share),) for share in sorted(set(pareto.density), key=lambda one: (one == "search", one))]


@dataclass(frozen=True, eq=False)
class _Sweep:
    """The work for one size of openings after the other."""

    pareto: ParetoSection
    section: SearchSection
    objective: ExpectedPsnr
    panels: Judges
    error: PupilError | None
    footprints: Footprints
    rules: Constraints
    display: Display
    lines: tuple[int, ...]
    workers: int
    executor: SerialExecutor
    progress: Progress

    def curve(self, count: int, clock: Clock) -> FrontCurve:
        rules = replace(self.rules, clear_dots=count)
        self._holding(rules, 0.0, self.lines[0]).require_possible()
        section = self.section
        shapes = list(chain.from_iterable(FAMILIES[name](section.dots, count) for name in section.families))
        shapes_judged = scan(
            shapes,
            self.objective,
            rules.without(*of_display(self.display), *OF_THE_EYE),
            turned_alike=not self.objective.periodic,
            clock=clock,
            executor=self.executor,
            progress=lambda _, done, total: self.progress(f"{count} clear dots: shapes", done, total),
        )
        steps, measured = self._steps(shapes_judged.ranked, count)
        if not steps:
            what = (
                f"the display fits none of {shapes_judged.evaluated} openings of {count} clear dots, with "
                f"{self.display.rules.emitters.required:.1%} of the pixel for each colour and {self.lines[0]} lines"
            )
            cure = "Ask for less of the display, or add families"
            raise JobError("MF123", what, where="pareto.clear_dots", cure=cure)
        evaluated, complete = shapes_judged.evaluated, shapes_judged.complete
        # What follows is measured on the best opening, and the annealing ends in time for it.
        point_s = 0.0 if clock.budget_s is None else self._seconds(steps[0])
        after_s = point_s * min(self.pareto.points, len(steps))
        if self.pareto.anneal and complete:
            more, walked, complete = self._annealed(steps, rules, clock.before(after_s))
            steps, evaluated, measured = [*steps, *more], evaluated + walked, measured + len(more)
        best = sorted((s for s in steps if not any(o.betters(s) for o in steps)), key=lambda opening: -opening.value)
        left = clock.left()
        most = self.pareto.points if left is None or not point_s else int(min(self.pareto.points, left / point_s))
        chosen = spread(best, max(1, most))
        points, misfits = self._laid(chosen, count, FIRST_STEPS if clock.over else None)
        if not points:
            what = f"the display fits openings of {count} clear dots, and none on the panel of a die: {misfits[0]}"
            cure = "Ask for less of the display, or for another tiling_seed"
            raise JobError("MF123", what, where="pareto.clear_dots", cure=cure)
        uneven = () if clock.over else tuple(_uneven(self.pareto))
        denser, unlike = self._denser(best[0], rules, uneven, clock)
        left_out = len(best) - len(chosen)
        complete = complete and len(uneven) == len(_uneven(self.pareto))
        curve = FrontCurve(count, points, denser, evaluated, measured, left_out, (*misfits, *unlike), complete)
        return curve if clock.over else self._beside(curve, rules, shapes_judged.ranked, steps)

    def _beside(
        self, curve: FrontCurve, rules: Constraints, ranked: Sequence[Ranked], steps: Sequence[JudgedOpening]
    ) -> FrontCurve:
        """The curve with what its display costs, and with openings of nearly the PSNR of its best."""
        held = self._holding(rules, 0.0, self.lines[0])
        display = held.only(*of_display(self.display))
        # Shapes below the best that fits decide nothing, nor do those of an annealing, which keeps the display.
        best = next(step for step in steps if any(step.unit is shape.unit for shape in ranked))
        better = [shape for shape in ranked if shape.value > best.value][:PRICED]
        judged = [*better, Ranked(best.shape, best.unit, best.value)]
        worth = {shape.unit.tobytes(): shape.value for shape in judged}
        candidates = [Candidate(shape.name, shape.unit) for shape in judged]
        first = curve.front[0].judged
        visited = [*ranked, *(Ranked(step.shape, step.unit, step.value) for step in steps)]
        return replace(
            curve,
            asked=asked_of(display),
            prices=prices(candidates, lambda unit: worth[unit.tobytes()], display),
            priced_among=len(judged),
            alternatives=alternatives(
                Ranked(first.shape, first.unit, first.value), visited, held, moved=self._moved, bias_um=self._bias_um
            ),
        )

    @property
    def _bias_um(self) -> float:
        return compared_bias_um(self.rules.dot_nm)

    def _moved(self, unit: Mask) -> float:
        error = self.panels.in_focus
        kinds = orientations(self.section.tiling, error.cells, error.cells, self.section.drawn_seed)
        return moved_by_bias(unit, kinds, error, self._bias_um)

    def given(self, opening: Opening) -> JudgedOpening:
        footprint = self.footprints(opening.mask)
        lines = [0, *(count for count in self.lines if self._wired(opening.mask, count))]
        return self._judged(opening.name, opening.mask, footprint, max(lines))

    def _judged(self, shape: str, unit: Mask, footprint: float, lines: int) -> JudgedOpening:
        psnr = self.objective.by_level(unit)
        return JudgedOpening(shape, unit, self._weighted(psnr), psnr, footprint, lines)

    def _weighted(self, psnr: Sequence[float]) -> float:
        weights = self.objective.weights
        return float(np.dot(psnr, weights) / sum(weights))

    def _asked(self, footprint: float, lines: int) -> Display:
        """The display with room for emitters that were found, and so many lines."""
        return self.display.asking(required=max(self.display.rules.emitters.required, footprint), lines=lines)

    def _holding(self, rules: Constraints, footprint: float, lines: int) -> Constraints:
        return rules.without(*of_display(self.display)).asking(**of_display(self._asked(footprint, lines)))

    def _wired(self, unit: Mask, lines: int) -> bool:
        return self._asked(0.0, lines).unwired(unit, self.rules.dot_nm) is None

    def _steps(self, ranked: Sequence[Ranked], count: int) -> tuple[list[JudgedOpening], int]:
        """Those with more footprint, for some number of lines, than all of a better PSNR; how many were measured."""
        least = self.display.rules.emitters.required - ROUNDING
        widest = dict.fromkeys(self.lines, 0.0)
        steps: list[JudgedOpening] = []
        measured = 0
        for done, (shape, bound) in enumerate(self._bounded(ranked)):
            if done % _BATCH == 0:
                self.progress(f"{count} clear dots: emitters and wires", done, len(ranked))
            if steps and shape.value < steps[0].value - _DEPTH_DB:
                break
            if bound < least or bound <= min(widest.values()) + _STEP:
                continue
            footprint = self.footprints(shape.unit)
            measured += 1
            better = [lines for lines in self.lines if footprint > widest[lines] + (_STEP if widest[lines] else 0.0)]
            if footprint < least or not better or self.display.crowded(shape.unit, self.rules.dot_nm) is not None:
                continue
            passed = None
            for lines in better:
                if not self._wired(shape.unit, lines):
                    break
                passed, widest[lines] = lines, footprint
            if passed is not None:
                steps.append(self._judged(shape.name, shape.unit, footprint, passed))
        self.progress(f"{count} clear dots: emitters and wires", len(ranked), len(ranked))
        return steps, measured

    def _bounded(self, ranked: Sequence[Ranked]) -> Iterator[tuple[Ranked, float]]:
        for start in range(0, len(ranked), _BATCH):
            part = ranked[start : start + _BATCH]
            bounds = self.footprints.bounds(np.stack([shape.unit for shape in part]))
            yield from zip(part, bounds.tolist(), strict=True)

    def _annealed(
        self, steps: Sequence[JudgedOpening], rules: Constraints, clock: Clock
    ) -> tuple[list[JudgedOpening], int, bool]:
        """Better openings from places spread over the steps, each with no less footprint and lines than its start."""
        starts = spread(steps, self.pareto.points)
        better: list[JudgedOpening] = []
        walked, complete = 0, True
        for done, start in enumerate(starts):
            stage = f"{rules.clear_dots} clear dots: annealing {done + 1} of {len(starts)}"
            self.progress(stage, 0, self.pareto.anneal)
            walk = anneal(
                start.unit,
                self.objective,
                self._holding(rules, max(0.0, start.footprint - ROUNDING), start.lines),
                evaluations=self.pareto.anneal,
                seed=self.section.seed,
                clock=clock.part(1 / (len(starts) - done)),
                progress=lambda _, done, total, stage=stage: self.progress(stage, done, total),  # type: ignore[misc]
            )
            self.progress(stage, walk.state.evaluations, self.pareto.anneal)
            walked += walk.state.evaluations
            complete = complete and (walk.complete or walk.stuck)
            if walk.value > start.value:
                name = f"{start.shape}, annealed"
                better.append(self._judged(name, walk.unit, self.footprints(walk.unit), start.lines))
        return better, walked, complete

    def _laid(
        self, chosen: Sequence[JudgedOpening], count: int, steps: int | None
    ) -> tuple[tuple[FrontPoint, ...], tuple[str, ...]]:
        """Those that fit on the panel of a die, and why others do not."""
        stage = f"{count} clear dots: maps and dies"
        self.progress(stage, 0, len(chosen))
        alone = replace(self, executor=ALONE, progress=silent)
        calls = [Call(_Sweep._lay, partial(tuple, (alone, one, steps))) for one in chosen]
        return _parted(self.executor.run_alike(calls, lambda done: self.progress(stage, done, len(chosen))))

    def _seconds(self, judged: JudgedOpening) -> float:
        """Time to lay an opening, its map and its die, with as many at once as there are processors."""
        begun = time.monotonic()
        self._lay(judged, FIRST_STEPS)
        return (time.monotonic() - begun) / self.workers

    def _lay(self, judged: JudgedOpening, steps: int | None) -> FrontPoint | str:
        designed = self._mapped(judged.unit, steps)
        cells = None
        if designed is not None and self.error is not None:
            cells = map_of(self.section, self.error, designed, {})
        psnr = None if designed is None else designed.psnr
        value = judged.value if psnr is None else self._weighted(psnr)
        shape, units = judged.shape, judged.unit[None]
        return self._shown(
            FrontPoint(judged, shape, units, (), judged.footprint, judged.lines, psnr, value, cells, 0.0)
        )

    def _shown(self, point: FrontPoint) -> FrontPoint | str:
        """The design with its grain on a die, or why it does not fit that."""
        least = 0.0 if sought(point.uneven) else self.display.rules.keep * point.footprint - ROUNDING
        held = self._asked(least, point.lines)
        outer = None if len(point.units) == 1 else point.units[1]
        answer = held.on(held.die(point.units[0], self.rules.dot_nm, point.cells, outer))
        why = misfit(answer)
        if why is not None:
            return f"{point.shape}: {why}"
        pitch_um = CellSize(self.rules.dots, self.rules.dot_nm).pitch_um
        viewing, away, grain = Viewing(pitch_um, TELEPHONE_UM), 0.0, 0.0
        if answer is not None and answer.emitters is not None:
            used = np.unique(held.cells % ORIENTATIONS).tolist()
            away, grain = math.hypot(*answer.centroid_px), turned_grain(answer.emitters, viewing, elements=used)
        return replace(point, grain=grain, centroid_px=away)

    def _denser(
        self, uniform: JudgedOpening, rules: Constraints, asked: Sequence[Uneven], clock: Clock
    ) -> tuple[tuple[FrontPoint, ...], tuple[str, ...]]:
        """Designs of an opening's light shared unevenly, each for the most lines that pass; why others fail."""
        every: list[FrontPoint | str] = []
        for uneven in asked:
            if sought(uneven):
                every += self._middles(uniform, rules, clock)
                continue
            made: FrontPoint | str = ""
            for lines in reversed(self.lines):
                made = self._of_two(uniform, rules, uneven, lines, clock)
                if isinstance(made, FrontPoint):
                    break
            every.append(made)
        return _parted(every)

    def _of_two(
        self, uniform: JudgedOpening, rules: Constraints, uneven: Uneven, lines: int, clock: Clock
    ) -> FrontPoint | str:
        held = self._holding(rules, 0.0, lines)

        def find(count: int) -> Iterator[Mask]:
            section = self.section.model_copy(update={"clear_dots": count})
            return allowed(section, replace(held, clear_dots=count), self.objective, clock, self._told(count))

        assert self.error is not None
        seed, progress = self.section.drawn_seed, self._told(uniform.clear_dots)
        density = float(uneven[-1][1])
        try:
            middle = Denser(density)
            made = graded(uniform.unit, self.error, middle, find, constraints=held, seed=seed, progress=progress)
        except InputError as refusal:
            return f"density {density:g}, {lines} lines: {refusal.code} {refusal.what}"
        shape = "{} dots in the middle, {} beyond".format(*(int(unit.sum()) for unit in made.units))
        return self._of_graded(made, uniform, shape, uneven, lines)

    def _of_graded(
        self, made: Graded, uniform: JudgedOpening, shape: str, uneven: Uneven, lines: int
    ) -> FrontPoint | str:
        assert self.error is not None
        cells, psnr = map_of(self.section, self.error, made.designed, {}), made.designed.psnr
        value = self._weighted(psnr)
        return self._shown(FrontPoint(uniform, shape, made.units, uneven, made.share, lines, psnr, value, cells, 0.0))

    def _middles(self, uniform: JudgedOpening, rules: Constraints, clock: Clock) -> Iterator[FrontPoint | str]:
        """Middles of every density that the display's most lines leave, gain against grain; why others fail."""
        assert self.error is not None
        lines, seed, progress = self.lines[-1], self.section.drawn_seed, self._told(uniform.clear_dots)
        held = self._holding(rules, 0.0, lines).on_any_map.without(*OF_THE_EYE)

        def find(count: int) -> Iterator[Mask]:
            section = self.section.model_copy(update={"clear_dots": count})
            rules_of_count = replace(held, clear_dots=count)
            return allowed(section, rules_of_count, self.objective, clock, progress, once=True)

        closed = math.floor(self.rules.dots**2 * (1 - 3 * self.display.rules.emitters.required))
        most = densest(self.section.model_copy(update={"clear_dots": uniform.clear_dots}), held, closed + 1)
        counts = sorted(set(np.linspace(uniform.clear_dots, most, _MIDDLES + 1)[1:].round().astype(int).tolist()))
        asked = Denser("search")
        try:
            looked = middles(
                uniform.unit, self.error, asked, find, constraints=held, counts=counts, seed=seed, progress=progress
            )
        except InputError as refusal:
            yield f"density search, {lines} lines: {refusal.code} {refusal.what}"
            return
        for one in spread(stair(looked), self.pareto.points):
            uneven: Uneven = (("outer_dots", one.shares.sparse), ("density", one.shares.dense / self.rules.dots**2))
            shape = f"{one.shares.dense} dots in {int(one.shares.denser.sum())} cells, {one.shares.sparse} beyond"
            try:
                made = laid(uniform.unit, self.error, [(one.units, one.shares)], held, seed, 0, progress)
            except InputError as refusal:
                yield f"{shape}: {refusal.code} {refusal.what}"
                continue
            yield self._of_graded(made, uniform, shape, uneven, lines)

    def _told(self, count: int) -> Progress:
        return lambda stage, done, total: self.progress(f"{count} clear dots: {stage}", done, total)

    def _mapped(self, unit: Mask, steps: int | None) -> DesignedMap | None:
        if self.section.map is None or self.error is None:
            return None
        mode, seed = MapMode(self.section.map), self.section.drawn_seed
        return design_map(unit, self.error, mode=mode, seed=seed, kicks=0, steps=steps)


def _parted(every: Iterable[FrontPoint | str]) -> tuple[tuple[FrontPoint, ...], tuple[str, ...]]:
    """Designs, and why others fail."""
    made = list(every)
    return tuple(one for one in made if isinstance(one, FrontPoint)), tuple(one for one in made if isinstance(one, str))


def sought(uneven: Uneven) -> bool:
    """Whether a search finds the density, or found it."""
    return any(key == "outer_dots" or value == "search" for key, value in uneven)


def stair(looked: Sequence[Middle]) -> tuple[Middle, ...]:
    """Those of the best value first whose grain is less than that of all before; least differences count as none."""
    kept: list[Middle] = []
    for one in sorted(looked, key=lambda one: -one.value):
        if not kept or one.grain < kept[-1].grain - _LESS_GRAIN:
            kept.append(one)
    return tuple(kept)


def spread(every: Sequence[T], most: int) -> tuple[T, ...]:
    """At most so many of a curve, its ends among them: evenly along it, PSNR falling."""
    last = len(every) - 1
    if len(every) <= most:
        return tuple(every)
    places = sorted({round(k * last / max(1, most - 1)) for k in range(most)})
    return tuple(every[k] for k in places)
