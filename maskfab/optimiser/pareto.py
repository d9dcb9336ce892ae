"""Restored photographs against emitters: of all shapes of several sizes, those that none betters in both.

Every shape is judged by its expected restored PSNR; the footprint, the largest that red, green and blue all reach, is
measured from the best PSNR downwards, and only where a bound leaves room above all that were measured before. So the
curve of each number of clear dots is exact among all shapes judged; footprints are those of rectangles and straight
cuts, which crooked emitters may exceed.
"""

from __future__ import annotations

import os
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import chain

import numpy as np
from numpy.typing import NDArray

from maskfab.camera.photo_camera import F1, PhotoCamera
from maskfab.camera.photographs import Photograph
from maskfab.camera.protocol import LEVELS
from maskfab.display.emitters.across_borders import border_margin
from maskfab.display.emitters.emitter_rules import EmitterGrid, EmitterRules, grid_of
from maskfab.display.emitters.free_area import free_region
from maskfab.display.emitters.freeform import guillotine
from maskfab.display.emitters.rectangles import rectangle_footprints
from maskfab.errors import InputError, JobError
from maskfab.jobfile import ParetoSection, SearchSection
from maskfab.model import ORIENTATIONS, Opening, Tiling
from maskfab.optimiser.clock import Clock
from maskfab.optimiser.model.expected_psnr import surrogate
from maskfab.optimiser.result import Facts, by_level, camera_facts, constraints_of, origin
from maskfab.optimiser.rules.constraints import Constraints
from maskfab.optimiser.rules.discrete import ExpectedPsnr, Ranked, anneal, scan
from maskfab.optimiser.rules.families import FAMILIES
from maskfab.progress import Progress, silent
from maskfab.units import NM_PER_UM

Mask = NDArray[np.bool_]
Floats = NDArray[np.float64]

_BATCH = 64
_ROUNDING = 1e-9


@dataclass(frozen=True, eq=False)
class JudgedOpening:
    """An opening with both of its numbers.

    Attributes:
        shape: the family, size and place it came from, or the name of an opening that was given.
        unit: bool [dots, dots], True is clear, row 0 the lowest.
        value: expected restored PSNR in dB, weighted mean over the levels.
        psnr: the same by level.
        footprint: share of the pixel that each colour covers, mean over the emitters' ratio.
    """

    shape: str
    unit: Mask
    value: float
    psnr: tuple[float, ...]
    footprint: float

    @property
    def clear_dots(self) -> int:
        return int(self.unit.sum())

    @property
    def open_ratio(self) -> float:
        return self.clear_dots / self.unit.size


@dataclass(frozen=True, eq=False)
class FrontCurve:
    """Results of the openings of one number of clear dots.

    Attributes:
        clear_dots: in every one of them.
        front: those that no other betters in both numbers, PSNR falling and footprint rising; of equal ones the first.
        evaluated: openings whose PSNR was computed.
        measured: of these, how many had their footprint measured; the bound ruled out the others.
        complete: whether the budget sufficed.
        refusal: why there is no opening of so many dots, where ``front`` is empty.
    """

    clear_dots: int
    front: tuple[JudgedOpening, ...]
    evaluated: int
    measured: int
    complete: bool
    refusal: str | None = None


@dataclass(frozen=True, eq=False)
class Pareto:
    """Result of a sweep.

    Attributes:
        curves: one for each number of clear dots, rising.
        best: those of all curves that no other betters in both numbers, PSNR falling.
        compared: the openings given, judged alike, in their order.
        dot_nm: side of a dot.
    """

    curves: tuple[FrontCurve, ...]
    best: tuple[JudgedOpening, ...]
    compared: tuple[JudgedOpening, ...]
    dot_nm: int

    def gain_db(self, other: JudgedOpening) -> float | None:
        """Gain of the best PSNR found over that of an opening, at no less footprint and no more clear dots; None where
        nothing found has either."""
        rivals = [
            each.value
            for curve in self.curves
            for each in curve.front
            if each.clear_dots <= other.clear_dots and each.footprint >= other.footprint - _ROUNDING
        ]
        return max(rivals) - other.value if rivals else None


@dataclass(frozen=True, eq=False)
class Footprints:
    """Largest footprints behind openings of one grid, and a bound on them.

    Attributes:
        rules: the display maker's.
        dots: along the cell's side.
        dot_nm: side of a dot.
        orientations: elements of D4 in use; any two may be neighbours.

    Raises:
        JobError: MF117, MF118 from :attr:`grid` where the rules do not suit the pixel.
    """

    rules: EmitterRules
    dots: int
    dot_nm: int
    orientations: tuple[int, ...] = tuple(range(ORIENTATIONS))

    @cached_property
    def grid(self) -> EmitterGrid:
        """Cells on which the rules are whole numbers."""
        nothing = Opening("unit", np.zeros((self.dots, self.dots), dtype=np.bool_), self.dot_nm)
        return grid_of(nothing, self.dot_nm, 0, self.rules)

    def __call__(self, unit: Mask) -> float:
        """Footprint of rectangles or straight cuts, as :class:`maskfab.optimiser.rules.constraints.Constraints` judges
        it.
        """
        found = rectangle_footprints(
            unit[None],
            self.grid,
            self.rules.ratio,
            orientations=self.orientations,
            margin=border_margin(self.grid),
            max_aspect=self.rules.max_aspect,
        )
        cells, _ = guillotine(self._regions(unit), self.grid, self.rules.ratio)
        return max(float(found[0]), cells * self._share)

    def bounds(self, units: Mask) -> Floats:
        """Upper bounds of the footprint that leave the gap across borders free, in some 30 us each.

        An emitter swept by the gap along x and y grows from an area a to at least (sqrt(a) + gap)^2, by Brunn and
        Minkowski; swept emitters of different colours share nothing, and lie where the free squares of the least width
        are swept.

        Args:
            units: bool [k, dots, dots].

        Returns:
            float [k], share of the pixel.
        """
        width, gap = self.grid.min_width, self.grid.colour_gap
        squares = _windowed(self._regions(units), width, np.logical_and)
        area = _swept(squares, width + gap).sum(axis=(1, 2)).astype(np.float64)
        root = sum(part**0.5 for part in self.rules.ratio)
        # Areas of ratio_k x, which sum to 3 x: 3 x + 2 gap root sqrt(x) + 3 gap^2 = area.
        rest = np.maximum(area - 3 * gap**2, 0)
        side = (np.sqrt((gap * root) ** 2 + 3 * rest) - gap * root) / 3
        return np.asarray(side**2 * self._share)

    @property
    def _share(self) -> float:
        return (self.grid.cell_nm / self.grid.pitch_nm) ** 2

    def _regions(self, units: Mask) -> Mask:
        return free_region(units, self.grid, self.orientations, margin=border_margin(self.grid))


def non_dominated(values: Sequence[float], footprints: Sequence[float]) -> tuple[int, ...]:
    """Indices of the pairs that no other pair betters: at least as much of both, and more of one.

    Of equal pairs the first stands for all. The values fall and the footprints rise along what is returned.
    """
    order = sorted(range(len(values)), key=lambda k: (-values[k], -footprints[k], k))
    kept: list[int] = []
    for k in order:
        if not kept or footprints[k] > footprints[kept[-1]]:
            kept.append(k)
    return tuple(kept)


def rules_of(
    section: SearchSection, compared: Sequence[Opening] = (), emitters: EmitterRules | None = None
) -> Constraints:
    """Constraints of a sweep's openings; refuses, at no cost, what a sweep would refuse before it starts.

    Args:
        section, compared, emitters: as for :func:`sweep`.

    Raises:
        JobError: MF104, MF106, MF107 for numbers; MF105 for an opening on another grid; MF117, MF118 for the emitters'
            rules.
    """
    rules = constraints_of(section, emitters=emitters)
    for opening in compared:
        if (opening.dots, opening.dot_nm) != (rules.dots, rules.dot_nm):
            raise JobError(
                "MF105",
                f"the opening {opening.name!r} has {opening.dots} dots of {opening.dot_nm / NM_PER_UM:g} um a side, "
                f"[design] {rules.dots} of {rules.dot_nm / NM_PER_UM:g} um",
                where="pareto.compare",
                cure="Compare openings on the grid of [design]",
            )
    _ = _footprints(rules).grid
    return rules


def sweep(
    pareto: ParetoSection,
    section: SearchSection,
    scenes: Sequence[Photograph],
    *,
    compared: Sequence[Opening] = (),
    emitters: EmitterRules | None = None,
    camera: PhotoCamera = F1,
    budget_s: float | None = None,
    workers: int | None = None,
    progress: Progress = silent,
) -> Pareto:
    """Judge every shape of every size, and keep what is best for some footprint.

    Args:
        pareto: sizes of openings, and how much to anneal.
        section: grid, tiling, families, weights and rules; a least footprint among the rules cuts the curves there.
        scenes: photographs whose spectrum and edges count.
        compared: openings on the same grid, judged as if laid in the same tiling.
        emitters: their rules; by default those that [design] takes, 8 um between colours and two dots of width.
        camera: that looks through the panel.
        budget_s: stop after about this time; every size has its share of it, and at least 64 shapes.
        workers: threads; by default as many as there are processors.
        progress: told where the work stands.

    Raises:
        JobError, OpeningError: as :func:`rules_of`; the first size's own error, MF123, MF203 or MF204, if no size has
            any opening.
    """
    rules = rules_of(section, compared, emitters)
    periodic = section.tiling is Tiling.PERIODIC
    footprints = _footprints(rules)
    progress("photographs", 0, 1)
    objective = ExpectedPsnr(
        surrogate(scenes, section.dots, dot_nm=rules.dot_nm, camera=camera), periodic, LEVELS, section.weights or ()
    )
    progress("photographs", 1, 1)
    work = _Sweep(pareto, section, objective, footprints, rules, workers or os.cpu_count() or 1, progress)
    counts = sorted(set(pareto.clear_dots))
    clock = Clock(budget_s)
    curves: list[FrontCurve] = []
    refusals: list[InputError] = []
    for done, count in enumerate(counts):
        try:
            curves.append(work.curve(count, Clock(clock.left(1 / (len(counts) - done)))))
        except InputError as refusal:
            refusals.append(refusal)
            curves.append(FrontCurve(count, (), 0, 0, complete=True, refusal=f"{refusal.code} {refusal.what}"))
    if len(refusals) == len(counts):
        raise refusals[0]
    every = [each for curve in curves for each in curve.front]
    best = tuple(every[k] for k in non_dominated([e.value for e in every], [e.footprint for e in every]))
    given = tuple(work.judged(opening.name, opening.mask, footprints(opening.mask)) for opening in compared)
    return Pareto(tuple(curves), best, given, rules.dot_nm)


def openings(
    found: Pareto, section: SearchSection, command: str, camera: PhotoCamera = F1
) -> dict[str, tuple[JudgedOpening, Opening]]:
    """Every opening on a curve with its provenance, by its name: the job's, the clear dots and its place in the curve.

    Args:
        found: by a sweep.
        section: of that sweep.
        command: how a user repeats it.
        camera: of that sweep.
    """
    named: dict[str, tuple[JudgedOpening, Opening]] = {}
    for curve in found.curves:
        for place, each in enumerate(curve.front, start=1):
            name = f"{section.name[:14]}_{curve.clear_dots}_{place}"
            facts: Facts = {
                **origin(section, command, camera_facts(camera)),
                "shape": each.shape,
                **by_level("expected_psnr", each.psnr, LEVELS),
                "footprint": round(each.footprint, 6),
                "evaluated": curve.evaluated,
            }
            named[name] = each, Opening(name, each.unit, found.dot_nm, facts)
    return named


def _footprints(rules: Constraints) -> Footprints:
    return Footprints(rules.emitters, rules.dots, rules.dot_nm, rules.orientations)


@dataclass(frozen=True, eq=False)
class _Sweep:
    """The work for one size of openings after the other."""

    pareto: ParetoSection
    section: SearchSection
    objective: ExpectedPsnr
    footprints: Footprints
    rules: Constraints
    workers: int
    progress: Progress

    def judged(self, shape: str, unit: Mask, footprint: float) -> JudgedOpening:
        psnr = self.objective.surrogate(unit, periodic=self.objective.periodic, levels=self.objective.levels)
        weights = self.objective.weights
        return JudgedOpening(shape, unit, float(np.dot(psnr, weights) / sum(weights)), psnr, footprint)

    def curve(self, count: int, clock: Clock) -> FrontCurve:
        rules = replace(self.rules, clear_dots=count)
        rules.require_possible()
        section = self.section
        shapes = list(chain.from_iterable(FAMILIES[name](section.dots, count) for name in section.families))
        found = scan(
            shapes,
            self.objective,
            rules.without("footprint"),
            turned_alike=not self.objective.periodic,
            budget_s=clock.left(),
            workers=self.workers,
            progress=lambda _, done, total: self.progress(f"{count} clear dots: shapes", done, total),
        )
        best, measured = self._steps(found.ranked, count)
        wanted = rules["footprint"]
        if wanted is not None:
            best = [each for each in best if each.footprint >= wanted - _ROUNDING]
        if not best:
            raise JobError(
                "MF123",
                f"none of {found.evaluated} openings of {count} clear dots leaves room for {wanted or 0:.1%} of each "
                "colour",
                where="design.rules.footprint",
                cure="Lower it, or add families",
            )
        evaluated, complete = found.evaluated, found.complete
        if self.pareto.anneal and complete:
            more, walked, complete = self._annealed(best, rules, clock)
            best, evaluated, measured = [*best, *more], evaluated + walked, measured + len(more)
        kept = non_dominated([each.value for each in best], [each.footprint for each in best])
        return FrontCurve(count, tuple(best[k] for k in kept), evaluated, measured, complete)

    def _steps(self, ranked: Sequence[Ranked], count: int) -> tuple[list[JudgedOpening], int]:
        """Those with more footprint than all of a better PSNR, and how many footprints were measured."""
        steps: list[JudgedOpening] = []
        measured, widest = 0, 0.0
        for done, (each, bound) in enumerate(self._bounded(ranked)):
            if done % _BATCH == 0:
                self.progress(f"{count} clear dots: emitters", done, len(ranked))
            if steps and bound <= widest + _ROUNDING:
                continue
            footprint = self.footprints(each.unit)
            measured += 1
            if not steps or footprint > widest + _ROUNDING:
                steps.append(self.judged(each.name, each.unit, footprint))
                widest = footprint
        self.progress(f"{count} clear dots: emitters", len(ranked), len(ranked))
        return steps, measured

    def _bounded(self, ranked: Sequence[Ranked]) -> Iterator[tuple[Ranked, float]]:
        for start in range(0, len(ranked), _BATCH):
            part = ranked[start : start + _BATCH]
            bounds = self.footprints.bounds(np.stack([each.unit for each in part]))
            yield from zip(part, bounds.tolist(), strict=True)

    def _annealed(
        self, steps: Sequence[JudgedOpening], rules: Constraints, clock: Clock
    ) -> tuple[list[JudgedOpening], int, bool]:
        """Better openings from places spread over the steps, each with no less footprint than where it started."""
        last = len(steps) - 1
        places = sorted({round(k * last / max(1, self.pareto.points - 1)) for k in range(self.pareto.points)})
        found: list[JudgedOpening] = []
        walked, complete = 0, True
        for done, place in enumerate(places):
            start = steps[place]
            stage = f"{rules.clear_dots} clear dots: annealing at step {place + 1}"
            self.progress(stage, 0, self.pareto.anneal)
            walk = anneal(
                start.unit,
                self.objective,
                rules.asking(footprint=max(0.0, start.footprint - _ROUNDING)),
                evaluations=self.pareto.anneal,
                seed=self.section.seed,
                budget_s=clock.left(1 / (len(places) - done)),
                progress=lambda _, done, total, stage=stage: self.progress(stage, done, total),  # type: ignore[misc]
            )
            self.progress(stage, walk.state.evaluations, self.pareto.anneal)
            walked += walk.state.evaluations
            complete = complete and (walk.complete or walk.stuck)
            if walk.value > start.value:
                found.append(self.judged(f"{start.shape}, annealed", walk.unit, self.footprints(walk.unit)))
        return found, walked, complete


def _windowed(cells: Mask, width: int, both: np.ufunc) -> Mask:
    """[k, n - width + 1, n - width + 1]: all (``logical_and``) or any of the ``width`` x ``width`` cells from there."""
    for axis in (1, 2):
        parts = np.lib.stride_tricks.sliding_window_view(cells, width, axis=axis)
        cells = np.asarray(both.reduce(parts, axis=-1))
    return cells


def _swept(places: Mask, width: int) -> Mask:
    """Cells under squares of that width whose lowest, leftmost cells are the places."""
    around = np.pad(places, ((0, 0), (width - 1, width - 1), (width - 1, width - 1)))
    return _windowed(around, width, np.logical_or)
