"""Light that drifts from one exposure to the next, from the pixels that both of them see.

The ratio of two exposures is that of sums over their common pixels, weighted by the light beside each: weights that
knew a pixel's own noise would favour what came out bright. Pixels are left out near full by the sum of both exposures:
given the sum of two Poisson numbers their ratio is what it is without, given one of them it is not.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from maskfab.base.arrays import Floats
from maskfab.capture.beside import mean_beside
from maskfab.errors import SourceError

_PROVEN = 3.0
"""Standard errors from 1 beyond which a drift is taken out; less is noise, and would be put in."""
_CLEAR = 0.9
"""Of full, up to which a pixel is used."""
_TOLD = 0.25
_MOST = 2.0


@dataclass(frozen=True, eq=False)
class Exposed:
    """One colour in all exposures.

    Attributes:
        electrons: [frames, rows, columns], the level of the dark taken off.
        usable: of the same shape, what is not full.
        dark: [frames] variance without light, in electrons squared.
        full: [frames] electrons of a full pixel; infinite where white is not known.
    """

    electrons: Floats
    usable: NDArray[np.bool_]
    dark: Floats
    full: Floats


@dataclass(frozen=True)
class Drift:
    """Light of one exposure in that of the longest.

    Attributes:
        factor: as it is told by the pixels that both see.
        error: of it; infinite where they tell nothing.
        taken_out: by how much the exposure is divided, 1 where no drift is proven.
    """

    factor: float
    error: float
    taken_out: float


def drifts(colours: Sequence[Exposed], times_s: Sequence[float], names: Sequence[str]) -> tuple[Drift, ...]:
    """Drift of each exposure against the longest, from each to the next shorter.

    Raises:
        SourceError: MF332 if the light of two exposures differs by more than a factor of two, which no lamp drifts.
    """
    order = sorted(range(len(times_s)), key=lambda each: -times_s[each])
    found = {order[0]: Drift(1.0, 0.0, 1.0)}
    for longer, shorter in pairwise(order):
        ratio, error = _ratio(colours, times_s, longer, shorter)
        before = found[longer]
        if not error < _TOLD:
            found[shorter] = Drift(before.taken_out, math.inf, before.taken_out)
            continue
        factor = before.factor * ratio
        total = factor * math.hypot(error, 0.0 if math.isinf(before.error) else before.error / before.factor)
        off = max(ratio, 1 / ratio) if ratio > 0 else math.inf
        if off > _MOST * (1 + _PROVEN * error):
            raise SourceError(
                "MF332",
                f"{names[shorter]} has {ratio:.3g} times the light of {names[longer]} for their times of "
                f"{times_s[shorter]:g} s and {times_s[longer]:g} s; a lamp drifts by less than {_MOST:g}",
                where=names[shorter],
                cure="State the true times with --times, in the order of the files",
            )
        found[shorter] = Drift(factor, total, factor if abs(factor - 1) > _PROVEN * total else 1.0)
    return tuple(found[each] for each in range(len(times_s)))


def _ratio(colours: Sequence[Exposed], times_s: Sequence[float], longer: int, shorter: int) -> tuple[float, float]:
    """Light of the shorter exposure in that of the longer, and its standard error; infinite where there is none."""
    sums, variances = np.zeros(2), np.zeros(2)
    times = times_s[longer], times_s[shorter]
    for colour in colours:
        both = colour.electrons[longer] + colour.electrons[shorter]
        clear = both < _CLEAR * colour.full[longer] * (1 + times[1] / times[0])
        common = colour.usable[longer] & colour.usable[shorter] & clear
        rate = np.maximum(mean_beside(colour.electrons[longer] / times[0], common), 0.0)
        weights = np.where(common, rate / (rate + colour.dark[shorter] / times[1]), 0.0)
        for place, frame in enumerate((longer, shorter)):
            sums[place] += (weights * colour.electrons[frame]).sum() / times[place]
            noise = rate * times[place] + colour.dark[frame]
            variances[place] += (weights**2 * noise).sum() / times[place] ** 2
    if not (sums > 0).all():
        return 1.0, math.inf
    return float(sums[1] / sums[0]), float(np.sqrt((variances / sums**2).sum()))
