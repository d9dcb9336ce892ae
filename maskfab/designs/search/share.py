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

from maskfab.base.arrays import Mask
from maskfab.base.model import Panel, Tiling
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
"""By which photographed gains of a curve may differ from those of the design that is searched at its share. Expected
ones rise too fast with the share: by 0.2 dB at a tenth of the pixel and 1 to 2 dB at half, most where few pixels lie
before the stop."""
_CUT = " Time ran out before all shares were tried: with a longer budget another may be chosen."
SHARINGS = (1, 2, 4)
"""Pixels to a circuit, fewer first."""
_SHARES = (0.2, 0.4, 0.3, 0.5, 0.1, 0.6, 0.45, 0.35, 0.55, 0.25, 0.65, 0.15)
"""Of the pixel, coarse steps first, so that a clock leaves out fine ones."""
_MOST_SHAPES, _JUDGED = 900, 100
"""Shapes of a share that bounds are asked of, of thousands; and that are judged."""
_WALKED, _LOOKED = 24, 4
"""Of those, the best ones, whose rules are asked; and of which the display is placed as the check places it."""
_AT_ONCE, _LEAST = 2, 4
"""Shares that are looked at side by side; and that no clock leaves out."""
_OF_A_KIND = 3
"""Places of a shape that are asked."""
_ACROSS = 24
"""Pixels along a side of the die on which it is placed."""


@dataclass(frozen=True, eq=False)
class SharePoint:
    """The best opening of a share that a display was found to fit.

    Attributes:
        sharing: pixels that share a circuit.
        across: pixels of the display around along one of these; 1 where none is left out.
        shape: empty where none was found.
        value: restored PSNR before a map, dB: expected, weighted mean over the levels, or photographed at one; not a
            number where there is none.
        error_db: half width of the interval of the gain, of photographs; None of an estimate.
        alike: whether lines were found only where all cells lie alike.
        footprint: share of the pixel that the least of the colours can cover, drawn straight.
        numbers: of the eye and of life, beside their limits.
        unit: bool [dots, dots]; None where none was found.
    """

    clear_dots: int
    dots: int
    sharing: int
    across: int = 1
    shape: str = ""
    value: float = math.nan
    alike: bool = False
    footprint: float = 0.0
    numbers: tuple[Limited, ...] = ()
    unit: Mask | None = None
    error_db: float | None = None

    @property
    def share(self) -> float:
        """Of the pixel that is clear."""
        return self.clear_dots / self.dots**2

    @property
    def zone(self) -> str:
        """Words on what is shared and left out."""
        if self.across > 1:
            return f"{self.across**2 - 1} of {self.across**2} pixels left out"
        return "a circuit for every pixel" if self.sharing == 1 else f"{self.sharing} pixels to a circuit"

    @property
    def panel_key(self) -> tuple[int, bool, bytes] | None:
        """Of its panel, which points of several levels may share; None where there is none."""
        return None if self.unit is None else (self.across, self.alike, self.unit.tobytes())

    @property
    def holds(self) -> bool:
        """Whether a display fits it and keeps its limits."""
        return bool(self.shape) and kept(self.numbers)


@dataclass(frozen=True, eq=False)
class ShareCurve:
    """Points of a display, and the one that is chosen.

    Attributes:
        points: by sharing, then by share.
        over: restored PSNR of what gains are over, dB, as the points'; None where that is the point of the smallest
            share.
        complete: whether every share was looked at, and as long as it takes.
    """

    points: tuple[SharePoint, ...]
    over: float | None = None
    complete: bool = True

    @cached_property
    def best(self) -> SharePoint | None:
        """The point that the rule chooses, among all that fit where none keeps its limits; None where none fits.

        Estimates flatter few large pixels, so that pixels are left out only where photographs say so.
        """
        best: SharePoint | None = None
        for level in sorted({(point.sharing, point.across) for point in self.points}, key=_finest):
            point = None if level[1] > 1 and not self.photographed else self._knee(WITHIN_DB, level)
            if point is not None and (best is None or point.value >= best.value + COARSER_DB):
                best = point
        return best

    @property
    def fitting(self) -> list[SharePoint]:
        """Points with an opening that a display fits."""
        return [point for point in self.points if point.shape]

    @property
    def interval(self) -> tuple[float, float]:
        """Shares from which and up to which the rule might choose, for the error of gains."""
        assert self.best is not None
        ends = [self._knee(WITHIN_DB + error, (self.best.sharing, self.best.across)) for error in (ERROR_DB, -ERROR_DB)]
        low, high = (self.best.share if point is None else point.share for point in ends)
        return low, high

    @property
    def told(self) -> str:
        """The choice and its rule, in a sentence."""
        return self.told_as("chosen")

    def told_as(self, done: str) -> str:
        """The rule and what becomes of its choice, such as "chosen", in a sentence."""
        best, (low, high) = self.best, self.interval
        assert best is not None
        range_ = "" if low == high else f" ({low:.0%} to {high:.0%} for gains {ERROR_DB:g} dB off)"
        zone, rule = "", f"the smallest share within {WITHIN_DB:g} dB of the best that fits and keeps its limits"
        if len({(point.sharing, point.across) for point in self.points}) > 1:
            zone = f" and {best.zone}"
            rule += f", and fewer circuits, or pixels, only where they gain {COARSER_DB:g} dB"
        rule += "" if best.holds else "; but none keeps them on a small die without a map"
        return (
            f"Of {len(self.fitting)} displays that fit, {best.share:.0%} of the pixel clear{range_}{zone}: {done} as "
            f"{rule}.{'' if self.complete else _CUT}"
        )

    @property
    def photographed(self) -> bool:
        """Whether gains are of photographs, and no estimates."""
        return any(point.error_db is not None for point in self.points)

    @property
    def best_first(self) -> list[SharePoint]:
        """Points that fit, by how far they lie below the best of their level."""
        most: dict[str, float] = {}
        for point in self.fitting:
            most[point.zone] = max(point.value, most.get(point.zone, -math.inf))
        return sorted(self.fitting, key=lambda point: most[point.zone] - point.value)

    def gain_db(self, point: SharePoint) -> float:
        """Expected gain of a point."""
        first = min(self.fitting, key=lambda one: one.clear_dots)
        return point.value - (first.value if self.over is None else self.over)

    def _knee(self, within_db: float, level: tuple[int, int]) -> SharePoint | None:
        held = [point for point in self.fitting if point.holds] or self.fitting
        seen = [point for point in held if point.error_db is not None] or held
        fitting = [point for point in seen if (point.sharing, point.across) == level]
        most = max((point.value for point in fitting), default=0.0)
        near = [point for point in fitting if point.value >= most - within_db]
        return min(near, key=lambda point: point.clear_dots, default=None)


def _finest(level: tuple[int, int]) -> tuple[int, int]:
    """In whose order levels are tried: by circuits for an area, and with all pixels first."""
    sharing, across = level
    return sharing * across**2, across


@dataclass(frozen=True, eq=False)
class Zone:
    """Displays of one pitch over the camera.

    Attributes:
        displays: alike but for the pixels that share a circuit, the fewest first.
        expected: judge of openings of this pitch.
        across: pixels of the display around along one of these.
    """

    displays: tuple[Display, ...]
    section: SearchSection
    expected: ExpectedPsnr
    across: int = 1


def counts_of(dots: int) -> list[int]:
    """Clear dots of the shares that are looked at, in their order, in pixels of so many dots along a side."""
    return list(dict.fromkeys(max(1, round(share * dots**2)) for share in _SHARES))


def share_curve(
    zones: Sequence[Zone],
    *,
    stated: int = 0,
    over: float | None = None,
    clock: Clock,
    executor: SerialExecutor = ALONE,
    progress: Progress = silent,
) -> ShareCurve:
    """The curve of a display.

    Args:
        stated: clear dots that are looked at besides, where no pixel is left out; 0 for none.
        over: expected restored PSNR of what gains are over, dB.
        clock: shares that it leaves no time for are left out.

    Raises:
        JobError: MF117, MF118 for rules that suit no pixel.
    """
    points = _of_count(zones[0], stated, clock) if stated else []
    # So many at a time, however many processes there are, so that what is left out does not depend on them.
    steps = range(0, max(len(counts_of(zone.section.dots)) for zone in zones), _AT_ONCE)
    for step in steps:
        progress("shares of the pixel", step, steps.stop)
        if step >= _LEAST and clock.over:
            break
        asked = [
            (held, count)
            for zone in zones
            for count in counts_of(zone.section.dots)[step : step + _AT_ONCE]
            if count != stated and (held := _able(zone, count, points)).displays
        ]
        tasks = executor.run_all([Call(_of_count, partial(tuple, (*given, clock))) for given in asked])
        points += chain.from_iterable(task.result() for task in tasks)
    progress("shares of the pixel", steps.stop, steps.stop)
    points.sort(key=lambda point: (*_finest((point.sharing, point.across)), point.clear_dots))
    return ShareCurve(tuple(points), over, complete=not clock.over)


def _able(zone: Zone, clear_dots: int, points: Sequence[SharePoint]) -> Zone:
    """The zone with those of its displays beside which no smaller opening was found not to fit."""
    none = {(point.sharing, point.across) for point in points if not point.shape and point.clear_dots < clear_dots}
    held = (display for display in zone.displays if (display.rules.zone.sharing, zone.across) not in none)
    return replace(zone, displays=tuple(held))


def _of_count(zone: Zone, clear_dots: int, clock: Clock) -> list[SharePoint]:
    """The point of each display."""
    section = zone.section.model_copy(update={"clear_dots": clear_dots})
    shapes = shapes_of(section.families, section.dots, clear_dots, _MOST_SHAPES)
    ranked: dict[bool, list[Ranked]] = {}
    nothing = SharePoint(clear_dots, section.dots, 1, zone.across)
    points: list[SharePoint] = []
    for display in zone.displays:
        found, rules = None, constraints_of(section, display=display)
        # Without a map nothing but the tiling that is asked for will be laid.
        kinds = (rules,) if section.map is None else kinds_of_panel(rules, crooked=False)
        for held in () if rules.conflict() is not None else kinds:
            # How circuits are shared changes nothing of the order.
            alike = _alike(held)
            if alike not in ranked:
                ranked[alike] = _ranked(shapes, held, replace(zone.expected, periodic=alike or zone.expected.periodic))
            # With more circuits the last one holds, too: only better ones are asked.
            last = points[-1] if points and points[-1].shape else None
            better = [one for one in ranked[alike] if last is None or one.value > last.value]
            if (found := _first(display, held, better, clock)) is not None:
                break
        found = found or (points[-1] if points else nothing)
        points.append(replace(found, sharing=display.rules.zone.sharing, across=zone.across))
    return points


def _ranked(shapes: Sequence[Candidate], rules: Constraints, expected: ExpectedPsnr) -> list[Ranked]:
    """Shapes that bounds leave, beside which straight lines pass where any do, by what they restore."""
    roomy, display = roomiest(shapes, rules), rules["emitters"]
    asked = display.rules.wires
    if not roomy:
        return []
    passing = np.full(len(roomy), display.opaque_lines)
    if asked is not None:
        units = np.stack([shape.unit for shape in roomy])
        passing = straight_lines(units, rules.dot_nm, asked.rules, turned=not _alike(rules))
    straight = [shape for shape, lines in zip(roomy, passing, strict=True) if lines >= display.opaque_lines]
    # Where none pass straight, those with most room are asked.
    likely = thinned(straight, _JUDGED)[: 2 * _JUDGED] or roomy[:_JUDGED]
    ranked = [Ranked(shape.name, shape.unit, expected(shape.unit)) for shape in likely]
    return sorted(ranked, key=lambda one: -one.value)


def _first(display: Display, held: Constraints, ranked: Sequence[Ranked], clock: Clock) -> SharePoint | None:
    """The first shape whose display fits on a small die."""
    looked, alike = 0, _alike(held)
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
    numbers = (*judged.looks, *lives)
    return SharePoint(
        held.clear_dots, dots, rules.zone.sharing, 1, shape.name, shape.value, _alike(held), most, numbers, shape.unit
    )


def _alike(rules: Constraints) -> bool:
    """Whether all cells of the display's panel are laid alike."""
    display: Display = rules["emitters"]
    return display.wired is Wired.REGULAR or (display.wired is Wired.TILING and display.tiling is Tiling.PERIODIC)


def _few_of_a_kind(shapes: Iterable[Ranked]) -> Iterator[Ranked]:
    """Shapes in their order, of each family and size the first ones alone."""
    seen: Counter[tuple[str, int, int]] = Counter()
    for shape in shapes:
        size = kind(shape.name, shape.unit)
        seen[size] += 1
        if seen[size] <= _OF_A_KIND:
            yield shape
