"""Clocks of the stages of a design within its budget: each leaves those after it their time.

What a stage takes is told in judgements of one opening, whose time is measured here and now: a slow machine, or one
that others work on, is slow in all of them alike.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

from maskfab.base.arrays import Mask
from maskfab.clock import Clock

NO_BOUNDS = "The budget leaves no time to prove bounds: no headroom is told."

_PROBES = 3
# Measured at 21 and 88 dots, and half as much again.
_BATCH, _FIRST_MAP, _MAP, _PRICES, _FIT, _BOUNDS = 64, 400, 4500, 400, 1800, 4500
# Shares of the time left that a map, and bounds with what is like them, take at most.
_MOST_MAP, _MOST_BOUNDS = 0.25, 0.4


@dataclass(frozen=True)
class Stages:
    """Clocks of stages.

    Attributes:
        search: of scan, annealing, shortlist or descent.
        map: of the map.
        bounded: whether there is time for bounds, appraisals and alternatives.
        bounds_s: seconds that they take.
    """

    search: Clock
    map: Clock
    bounded: bool = True
    bounds_s: float = 0.0

    @classmethod
    def of(
        cls, judge: Callable[[Mask], object], unit: Mask, clock: Clock, *, mapped: bool = False, fitted: bool = False
    ) -> Stages:
        """By the time that judging one opening takes.

        Args:
            judge: of openings.
            unit: one of them, bool [dots, dots].
            clock: of the whole budget.
            mapped: whether a map is designed.
            fitted: whether a display must fit.

        Raises:
            JobError: MF150 for a clock that refuses what it cannot keep.
        """
        if clock.budget_s is None:
            return cls(clock, clock)
        judge(unit)
        begun = clock.spent
        for _ in range(_PROBES):
            judge(unit)
        each = (clock.spent - begun) / _PROBES
        needed = each * (_PRICES + _FIRST_MAP * mapped + _FIT * fitted)
        clock.require(needed + _BATCH * each, "the first openings", "budget")
        left = clock.left() or 0.0
        bounds = each * _BOUNDS
        bounded = bounds <= _MOST_BOUNDS * left
        after = needed + bounds * bounded
        design = min(_MOST_MAP * left, each * _MAP) * mapped
        return cls(clock.before(after + design), clock.before(after), bounded, bounds)
