"""Rules on widths and spaces, which the mask writer sets: corners, clear runs, closed runs."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np

from maskfab.base.arrays import Mask
from maskfab.drc.raster_rules import corner_touches, smallest_runs
from maskfab.optimiser.rules.rule import Conflict, Rule

if TYPE_CHECKING:
    from maskfab.optimiser.rules.constraints import Constraints


def _kisses(constraints: Constraints, unit: Mask) -> str | None:
    if inside := corner_touches(unit):
        return f"{inside} corners touch inside the cell"
    touch = _kiss_beside(constraints, unit[None])
    return "corners of neighbouring cells can touch" if touch else None


def _among_neighbours(constraints: Constraints) -> bool:
    return bool(constraints["kissing"] == "neighbours")


def _kiss_beside(constraints: Constraints, units: Mask) -> bool:
    apart = constraints.gutter_nm > 0 or not _among_neighbours(constraints)
    return not apart and _kiss_across(constraints.turned(units))


def _kiss_across(turned: Mask) -> bool:
    """Whether cells [kinds, dots, dots] without a gutter, any beside any, can touch at corners along a border or where
    four meet."""
    for here, there in ((turned[:, :, -1], turned[:, :, 0]), (turned[:, -1], turned[:, 0])):
        low, high = here[:, None, :-1], here[:, None, 1:]
        across_low, across_high = there[None, :, :-1], there[None, :, 1:]
        rising = low & across_high & ~high & ~across_low
        falling = high & across_low & ~low & ~across_high
        if bool((rising | falling).any()):
            return True
    # Around a vertex: lower left, lower right, upper left and upper right cell, with the corner each has there.
    corners = [set(turned[:, y, x].tolist()) for y, x in ((-1, -1), (-1, 0), (0, -1), (0, 0))]
    rising_four = all(value in each for value, each in zip((True, False, False, True), corners, strict=True))
    falling_four = all(value in each for value, each in zip((False, True, True, False), corners, strict=True))
    return rising_four or falling_four


def _narrow(constraints: Constraints, unit: Mask) -> str | None:
    least, wanted = smallest_runs(unit).clear, constraints["min_feature_dots"]
    return f"a clear width of {least:g} dots, least {wanted}" if least < wanted else None


def _by_width(constraints: Constraints) -> Conflict | None:
    """No opening of the count is so wide everywhere, or the cell is narrower."""
    least, count, dots = constraints["min_feature_dots"], constraints.clear_dots, constraints.dots
    if count and least > dots:
        return Conflict(("min_feature_dots",), f"a clear width of {least} dots in a cell of {dots} x {dots}")
    # A row that is not closed holds a run, hence `least` columns of runs, hence `least` rows of `least` dots; any
    # further row or column adds a run.
    if 0 < count < least**2 or least**2 < count < least * (least + 1):
        return Conflict(
            ("clear_dots", "min_feature_dots"),
            f"openings of no width below {least} dots have {least**2}, or at least {least * (least + 1)} clear "
            f"dots, not {count}",
        )
    return None


def _close(constraints: Constraints, unit: Mask) -> str | None:
    least, wanted = min(smallest_runs(unit).opaque, _space(constraints, unit[None])), constraints["min_space_dots"]
    return f"a space of {least:g} dots, least {wanted}" if least < wanted else None


def _close_beside(constraints: Constraints, units: Mask) -> bool:
    return bool(_space(constraints, units) < constraints["min_space_dots"])


def _space(constraints: Constraints, units: Mask) -> float:
    """Least closed run in dots that crosses a border between cells [kinds, dots, dots]; inf where there is none."""
    turned, gutter = constraints.turned(units), constraints.gutter_nm / constraints.dot_nm
    least = math.inf
    for cells in (turned, turned.transpose(0, 2, 1)):
        used = cells.any(axis=2)
        first = np.where(used, cells.argmax(axis=2), np.inf)
        last = np.where(used, cells[:, :, ::-1].argmax(axis=2), np.inf)
        runs = last[:, None] + gutter + first[None]
        least = min(least, float(runs[runs > 0].min(initial=np.inf)))
    return least


KISSING = Rule("kissing", "", _kisses, beside=_kiss_beside, one_place=_among_neighbours)
FEATURE = Rule("min_feature_dots", "dots", _narrow, proof=_by_width, counted=True)
SPACE = Rule("min_space_dots", "dots", _close, beside=_close_beside, one_place=lambda _: True)
