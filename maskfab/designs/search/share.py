"""Share of the pixel that is clear, and pixels that share a circuit: restored photographs against what a display pays.

Shares are looked at in steps of a twentieth of the pixel. At each, shapes of the section's families are judged, thinned
to few places, and from the best downwards the first is taken that the display fits: with circuits of its own for every
pixel, then with circuits that two and four pixels share. Its emitters are placed on a die and seen as the check sees
them. So every point of the curve is a display that fits; a search finds openings of the same share a little better.

One rule chooses: as many circuits as can be, and of these the smallest share within half a decibel of the best that
keeps its limits; fewer circuits must gain a whole decibel more. A larger share costs emitters, and so life.
"""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cached_property, partial
from itertools import chain, islice

import numpy as np

from maskfab.base.model import Panel
from maskfab.base.processes import ALONE, Call, SerialExecutor
from maskfab.base.work import Clock, Progress, silent
from maskfab.designs.rules.constraints import Constraints
from maskfab.designs.rules.display_fit import Display, Wired, footprints_of, misfit
from maskfab.designs.rules.families import Candidate, kind
from maskfab.designs.search.annealing import ExpectedPsnr, Ranked
from maskfab.designs.search.held import kinds_of_panel, roomiest, shapes_of, straight_lines, thinned
from maskfab.designs.search.result import constraints_of
from maskfab.display.eye_and_life import Limited, judgement, kept
from maskfab.display.feasibility import Feasibility, feasibility
from maskfab.job.sections import SearchSection

WITHIN_DB, COARSER_DB = 0.5, 1.0
"""Restored photographs that are given away for a smaller share; and that must be gained for half the circuits."""
ERROR_DB = 0.15
"""By which gains of a curve may differ from those of the design that is searched at its share."""
SHARINGS = (1, 2, 4)
_STEP, _LEAST, _MOST = 0.05, 0.10, 0.65
_MOST_SHAPES, _JUDGED = 900, 100
"""Shapes of a share that bounds are asked of, of thousands; and that are judged."""
_WALKED, _LOOKED = 24, 4
"""Of those, the best ones, whose rules are asked; and of which the display is placed as the check places it."""
_AT_ONCE = 2
"""Shares that are looked at side by side."""
_OF_A_KIND = 3
"""Places of a shape that are asked."""
_ACROSS = 24
"""Pixels along a side of the die on which it is placed."""


@dataclass(frozen=True, eq=False)
class SharePoint:
    """The best opening of a share that a display was found to fit.

    Attributes:
        sharing: pixels that share a circuit.
        shape: empty where none was found.
        value: expected restored PSNR before a map, dB, weighted mean over the levels; not a number where there is none.
        alike: whether lines were found only where all cells lie alike.
        footprint: share of the pixel that the least of the colours can cover, drawn straight.
        numbers: of the eye and of life, beside their limits.
    """

    clear_dots: int
    dots: int
    sharing: int
    shape: str = ""
    value: float = math.nan
    alike: bool = False
    footprint: float = 0.0
    numbers: tuple[Limited, ...] = ()

    @property
    def share(self) -> float:
        """Of the pixel that is clear."""
        return self.clear_dots / self.dots**2

    @property
    def holds(self) -> bool:
        """Whether a display fits it and keeps its limits."""
        return bool(self.shape) and kept(self.numbers)


@dataclass(frozen=True, eq=False)
class ShareCurve:
    """Points of a display, and the one that is chosen.

    Attributes:
        points: by sharing, then by share.
        over: expected restored PSNR of what gains are over, dB, mean over the levels; None where that is the point of
            the smallest share.
        complete: whether every share was looked at.
    """

    points: tuple[SharePoint, ...]
    over: float | None = None
    complete: bool = True

    @cached_property
    def best(self) -> SharePoint | None:
        """The point that the rule chooses; None where no display fits any share."""
        best: SharePoint | None = None
        for sharing in SHARINGS:
            point = self._knee(WITHIN_DB, sharing)
            if point is not None and (best is None or point.value >= best.value + COARSER_DB):
                best = point
        return best

    @property
    def interval(self) -> tuple[float, float]:
        """Shares from which and up to which the rule might choose, for the error of gains."""
        assert self.best is not None
        ends = [self._knee(WITHIN_DB + error, self.best.sharing) for error in (ERROR_DB, -ERROR_DB)]
        low, high = (self.best.share if point is None else point.share for point in ends)
        return low, high

    @property
    def told(self) -> str:
        """The choice and its rule, in a sentence."""
        best, (low, high) = self.best, self.interval
        assert best is not None
        shared = "a circuit for every pixel" if best.sharing == 1 else f"{best.sharing} pixels to a circuit"
        fitting = [point for point in self.points if point.shape]
        range_ = "" if low == high else f" ({low:.0%} to {high:.0%} for gains {ERROR_DB:g} dB off)"
        return (
            f"Of {len(fitting)} displays that fit, {best.share:.0%} of the pixel clear{range_} and {shared} were "
            f"chosen: the smallest share within {WITHIN_DB:g} dB of the best that fits and keeps its limits, and fewer "
            f"circuits only where they gain {COARSER_DB:g} dB."
        )

    def gain_db(self, point: SharePoint) -> float:
        """Expected gain of a point."""
        first = min((one for one in self.points if one.shape), key=lambda one: one.clear_dots)
        return point.value - (first.value if self.over is None else self.over)

    def largest(self, sharing: int) -> SharePoint | None:
        """The point of the largest share that was found to fit."""
        return max(self._fitting(sharing), key=lambda point: point.clear_dots, default=None)

    def _fitting(self, sharing: int) -> list[SharePoint]:
        return [point for point in self.points if point.sharing == sharing and point.holds]

    def _knee(self, within_db: float, sharing: int) -> SharePoint | None:
        fitting = self._fitting(sharing)
        most = max((point.value for point in fitting), default=0.0)
        near = [point for point in fitting if point.value >= most - within_db]
        return min(near, key=lambda point: point.clear_dots, default=None)


def counts_of(dots: int) -> list[int]:
    """Clear dots of the shares that are looked at, in pixels of so many dots along a side."""
    return sorted({max(1, round(share * dots**2)) for share in np.arange(_LEAST, _MOST + _STEP / 2, _STEP)})


def share_curve(
    displays: Sequence[Display],
    section: SearchSection,
    expected: ExpectedPsnr,
    *,
    stated: int = 0,
    over: float | None = None,
    clock: Clock,
    executor: SerialExecutor = ALONE,
    progress: Progress = silent,
) -> ShareCurve:
    """The curve of a display.

    Args:
        displays: alike but for the pixels that share a circuit, the fewest first.
        stated: clear dots that are looked at before all others; 0 for none.
        over: expected restored PSNR of what gains are over, dB.
        clock: shares that it leaves no time for are left out.

    Raises:
        JobError: MF117, MF118 for rules that suit no pixel.
    """
    counts = [count for count in counts_of(section.dots) if count != stated]
    # Two at a time, however many processes there are, so that what is left out does not depend on them.
    waves = [[stated]] * bool(stated) + [counts[k : k + _AT_ONCE] for k in range(0, len(counts), _AT_ONCE)]
    points: list[SharePoint] = []
    able = list(displays)
    for done, wave in enumerate(waves):
        progress("shares of the pixel", done, len(waves))
        if points and clock.over:
            break
        asked = [(tuple(able), section.model_copy(update={"clear_dots": count}), expected, clock) for count in wave]
        tasks = executor.run_all([Call(_of_count, partial(tuple, given)) for given in asked])
        found = [task.result() for task in tasks]
        points += chain.from_iterable(found)
        if wave == [stated]:
            continue
        # Where nothing was found, nothing larger is looked for.
        able = [display for display, *own in zip(able, *found, strict=True) if any(point.shape for point in own)]
        if not able:
            break
    progress("shares of the pixel", len(waves), len(waves))
    points.sort(key=lambda point: (point.sharing, point.clear_dots))
    return ShareCurve(tuple(points), over, complete=not able or not clock.over)


def _of_count(
    displays: Sequence[Display], section: SearchSection, expected: ExpectedPsnr, clock: Clock
) -> list[SharePoint]:
    """The point of each display."""
    shapes = shapes_of(section.families, section.dots, section.clear_dots, _MOST_SHAPES)
    ranked: dict[bool, list[Ranked]] = {}
    points: list[SharePoint] = []
    for display in displays:
        found, rules = None, constraints_of(section, display=display)
        kinds = () if rules.conflict() is not None else kinds_of_panel(rules, crooked=False)
        for held in kinds:
            # How circuits are shared changes nothing of the order.
            alike = held["emitters"].wired is Wired.REGULAR
            if alike not in ranked:
                ranked[alike] = _ranked(shapes, held, replace(expected, periodic=alike or expected.periodic))
            if (found := _first(display, held, ranked[alike], clock)) is not None:
                break
        nothing = points[-1] if points else SharePoint(section.clear_dots, section.dots, 1)
        points.append(replace(found or nothing, sharing=display.rules.zone.sharing))
    return points


def _ranked(shapes: Sequence[Candidate], rules: Constraints, expected: ExpectedPsnr) -> list[Ranked]:
    """Shapes that bounds leave, beside which straight lines pass where any do, by what they restore."""
    roomy, display = roomiest(shapes, rules), rules["emitters"]
    asked = display.rules.wires
    if not roomy:
        return []
    passing = np.full(len(roomy), display.opaque_lines)
    if asked is not None:
        units, turned = np.stack([shape.unit for shape in roomy]), display.wired is not Wired.REGULAR
        passing = straight_lines(units, rules.dot_nm, asked.rules, turned=turned)
    straight = [shape for shape, lines in zip(roomy, passing, strict=True) if lines >= display.opaque_lines]
    # Where none pass straight, those with most room are asked.
    likely = thinned(straight, _JUDGED)[: 2 * _JUDGED] or roomy[:_JUDGED]
    ranked = [Ranked(shape.name, shape.unit, expected(shape.unit)) for shape in likely]
    return sorted(ranked, key=lambda one: -one.value)


def _first(display: Display, held: Constraints, ranked: Sequence[Ranked], clock: Clock) -> SharePoint | None:
    """The first shape whose display fits on a small die."""
    looked, alike = 0, held["emitters"].wired is Wired.REGULAR
    for shape in islice(_few_of_a_kind(ranked), _WALKED):
        if looked >= _LOOKED or (looked and clock.over):
            break
        if not held.allows(shape.unit):
            continue
        looked += 1
        panel = display.small_die(shape.unit, held.dot_nm, _ACROSS, alike=alike)
        # Emitters that look even take seconds to place, so that they are placed where others do not keep the limits.
        for largest in (False, True):
            answer = feasibility(panel, display.rules, largest=largest)
            if answer is None or misfit(answer) is not None:
                break
            point = _seen(shape, replace(panel, emitters=answer.emitters), answer, display, held)
            if point.holds or largest:
                return point
    return None


def _seen(shape: Ranked, lit: Panel, answer: Feasibility, display: Display, held: Constraints) -> SharePoint:
    """The point of a panel with emitters; life is that of emitters as large as straight ones can be."""
    rules, dots = display.rules, held.dots
    judged = judgement(lit, rules.eye, rules.emitters, rules.light)
    most = max(answer.share, footprints_of(held, rules.emitters)(shape.unit))
    longer = (most / answer.share) ** rules.light.ageing_exponent
    lives = [replace(one, value=one.value * longer) if one.name == "life" else one for one in judged.lives]
    numbers, alike = (*judged.looks, *lives), held["emitters"].wired is Wired.REGULAR
    return SharePoint(held.clear_dots, dots, rules.zone.sharing, shape.name, shape.value, alike, most, numbers)


def _few_of_a_kind(shapes: Iterable[Ranked]) -> Iterator[Ranked]:
    """Shapes in their order, of each family and size the first ones alone."""
    seen: Counter[tuple[str, int, int]] = Counter()
    for shape in shapes:
        size = kind(shape.name, shape.unit)
        seen[size] += 1
        if seen[size] <= _OF_A_KIND:
            yield shape
