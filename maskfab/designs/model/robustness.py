r"""Restored PSNR of panels that are not quite the one designed: edges elsewhere, a stop off centre, other seeds.

A bias b moves every edge by b / 2. Cut into a core and strips of that width, a dot is clear or closed as a whole in
each of its 3 x 3 parts, which repeat from dot to dot. So at whole lags the biased panel's autocorrelation is exactly

    A(t) = sum over the parts of their area times the pairs of dots t apart in which both are clear,

and the surrogate asks for no others. Photographs are restored by the transfer of the panel as it is.

Means over a normal spread are those of its two points one standard deviation off, or of four for two directions, which
are exact up to third powers.

Notes:
    Corners stay sharp. Where clear dots only touch at a corner, a wider one joins them, a narrower one parts them.
    Where the stop lies beyond the map, cells are turned at random.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from itertools import product
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from maskfab.base.arrays import Floats, Mask
from maskfab.base.model import ORIENTATIONS, orient, side_by_side
from maskfab.base.units import NM_PER_UM

if TYPE_CHECKING:
    from maskfab.designs.model.panel_error import PupilError


TILINGS = 8
"""Random tilings whose PSNRs are compared: their standard deviation is known within a quarter."""
_OFF_CELLS = (1, 2)
_BIAS_UM = 0.1


@dataclass(frozen=True)
class Spread:
    """Standard deviations over the panels that are made.

    Attributes:
        bias_um: of the width of clear features.
        centre_um: of the stop's centre from the map's, along x and along y.
    """

    bias_um: float = 0.0
    centre_um: float = 0.0


EXACT = Spread()
"""Panels as they are designed."""


@dataclass(frozen=True)
class Varied:
    """PSNR where something is off by one standard deviation, by level, dB.

    Attributes:
        deviation_um: that deviation.
        psnr: at each of its points; of a bias, narrower and wider.
        loss: the panel's own PSNR less the mean over the spread; negative where it gains.
    """

    deviation_um: float
    psnr: tuple[tuple[float, ...], ...]
    loss: tuple[float, ...]


@dataclass(frozen=True)
class Robustness:
    """A panel's PSNR beside that of others like it, by level, dB.

    Attributes:
        psnr: of the panel; of a random tiling, that of the seed.
        tiling: standard deviation over random tilings of the opening; None for cells that are all alike, and where
            they hold several openings, or one at several places.
        off_centre: by how far the stop's centre lies off, um, the map's gain over the mean of random tilings, mean of
            four directions; from 0 on; empty without a map, and where ``tiling`` is None.
        bias, centre: over the spread; None where none is stated.
    """

    psnr: tuple[float, ...]
    tiling: tuple[float, ...] | None
    off_centre: dict[float, tuple[float, ...]]
    bias: Varied | None
    centre: Varied | None


def robustness(
    units: Mask, kinds: NDArray[np.int8], error: PupilError, *, spread: Spread, seed: int, periodic: bool, mapped: bool
) -> Robustness:
    """Appraise a panel.

    Args:
        units: bool [units, dots, dots].
        kinds: of the cells before the stop, 8 u + k for unit u under element k of D4, [cells, cells].
        error: of panels of such units.
        spread: over which means are taken.
        seed: of random tilings, and of cells beyond the map.
        periodic: every cell has the unit as it is.
        mapped: kinds are designed.
    """
    dots, pitch_um = error.dots, error.dots * error.lattice.dot_um
    draw = np.random.default_rng([seed, 2])
    off = [count * dots for count in _OFF_CELLS] if mapped and len(units) == 1 else []
    away = round(spread.centre_um / pitch_um * dots)
    pad = math.ceil(max([*off, away]) / dots)
    around = draw.integers(1 if periodic else ORIENTATIONS, size=tuple(side + 2 * pad for side in kinds.shape))
    around[pad : pad + len(kinds), pad : pad + len(kinds)] = kinds
    picture = laid_picture(units, around)

    def seen(y: int, x: int) -> Mask:
        side, start = error.inside.shape[0], pad * dots
        return picture[start + y : start + y + side, start + x : start + x + side]

    here = seen(0, 0)
    own = _psnr(error, here)
    tiling, off_centre = None, {}
    if not periodic and len(units) == 1:
        others = [
            _psnr(error, laid_picture(units, draw.integers(ORIENTATIONS, size=kinds.shape))) for _ in range(TILINGS)
        ]
        tiling = tuple(np.std(others, axis=0, ddof=1).tolist())
        for step in (0, *off) if mapped else ():
            places = sorted({(step, 0), (-step, 0), (0, step), (0, -step)})
            gains = _mean(_psnr(error, seen(*place)) for place in places) - np.mean(others, axis=0)
            off_centre[step / dots * pitch_um] = tuple(gains.tolist())
    bias = centre = None
    if spread.bias_um:
        bias = _varied(spread.bias_um, own, [_psnr(error, here, sign * spread.bias_um) for sign in (-1, 1)])
    if spread.centre_um:
        corners = product((-away, away), repeat=2)
        centre = _varied(away / dots * pitch_um, own, [_psnr(error, seen(*each)) for each in corners])
    return Robustness(own, tiling, off_centre, bias, centre)


def compared_bias_um(dot_nm: int) -> float:
    """Bias by which openings of such dots are compared: as a mask shop keeps it, and a quarter of a dot at most."""
    return min(_BIAS_UM, dot_nm / NM_PER_UM / 4)


def moved_by_bias(unit: Mask, kinds: NDArray[np.int8], error: PupilError, bias_um: float) -> float:
    """Decibels, weighted mean over the levels, by which a bias to either side moves the PSNR of a panel.

    Args:
        unit: bool [dots, dots].
        kinds: elements of D4 of the cells before the stop, [cells, cells].
        error: of panels of such units.
        bias_um: less than a dot.
    """
    picture = laid_picture(unit[None], kinds)
    narrow, wide = (np.dot(error.weights, _psnr(error, picture, sign * bias_um)) for sign in (-1, 1))
    return float(abs(wide - narrow) / 2)


def biased_table(error: PupilError, picture: Mask, bias_um: float) -> NDArray[np.float32]:
    """Autocorrelation, as :meth:`PupilError.table` has it, of a panel whose clear features are wider by the bias.

    Args:
        error: of panels of such dots.
        picture: bool [side, side] of the dots, those beyond the stop included.
        bias_um: less than a dot; negative narrows.
    """
    if bias_um == 0:
        return error.table(picture & error.inside)
    strip = abs(bias_um) / 2 / error.lattice.dot_um
    share = {-1: strip, 0: 1 - 2 * strip, 1: strip}
    grown = picture if bias_um > 0 else ~picture
    around = np.pad(grown, 1, mode="edge")
    total = np.zeros(1)
    for down, left in product(share, repeat=2):
        # A strip is taken over by what lies beside it.
        rows = around[1 : 1 + len(grown)] | around[1 - down : 1 - down + len(grown)]
        part = rows[:, 1:-1] | rows[:, 1 - left : 1 - left + grown.shape[1]]
        part = part if bias_um > 0 else ~part
        total = total + share[down] * share[left] * error.table(part & error.inside).astype(np.float64)
    return np.asarray(total, dtype=np.float32)


def _psnr(error: PupilError, picture: Mask, bias_um: float = 0.0) -> tuple[float, ...]:
    return error.psnr_of_table(biased_table(error, picture, bias_um))


def laid_picture(units: Mask, kinds: NDArray[np.integer]) -> Mask:
    """Dots of a panel, bool [rows dots, columns dots], of units [units, dots, dots] and kinds [rows, columns], 8 u + k
    for unit u under element k of D4."""
    patterns = np.stack([orient(unit, k) for unit in units for k in range(ORIENTATIONS)])
    return np.asarray(side_by_side(patterns[kinds]))


def _mean(values: Iterable[Sequence[float]]) -> Floats:
    return np.asarray(np.mean(list(values), axis=0))


def _varied(deviation_um: float, own: Sequence[float], found: list[tuple[float, ...]]) -> Varied:
    return Varied(deviation_um, tuple(found), tuple((np.array(own) - _mean(found)).tolist()))
