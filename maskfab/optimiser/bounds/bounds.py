r"""Proven bounds and ideals for all openings of one clear count, to be printed beside a design.

Two numbers are bounded: the expected PSNR far from the sensor's edge, and the surrogate's own, of the whole frame, in
which what leaks in from the edge counts for at least nothing, unless so few openings have that count that the best of
all is known. Theorems and proofs:
:mod:`maskfab.optimiser.bounds.error_bound`, :mod:`maskfab.optimiser.bounds.residue_bound`,
:mod:`maskfab.optimiser.bounds.frame_bound`, :mod:`maskfab.optimiser.bounds.auc_bound`; of designed maps,
:mod:`maskfab.optimiser.bounds.map_bound`.

Notes:
    That autocorrelations are positive semidefinite tightens the bound on the PSNR by at most 0.002 dB (100 of 441 dots,
    at the best ε), for 0.7 s per ε and level; it is left out there and kept in the bound on the area.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from maskfab.base.arrays import Floats
from maskfab.camera.transfer import at_lags, pupil_autocorrelation
from maskfab.errors import OpeningError
from maskfab.opening.clear_dots import require_clear_dots
from maskfab.optimiser.bounds.auc_bound import auc_bound, rings
from maskfab.optimiser.bounds.every_opening import few_openings
from maskfab.optimiser.bounds.frame_bound import frame_bound
from maskfab.optimiser.bounds.map_bound import layout_bound
from maskfab.optimiser.bounds.residue_bound import residue_errors, residues
from maskfab.optimiser.model.expected_psnr import Surrogate
from maskfab.optimiser.model.interior import Interior, interior

_MOST_DOTS_OF_LP = 25


@dataclass(frozen=True)
class Bounds:
    """Upper bounds that no opening can exceed, at each level of light.

    Attributes:
        level_db: levels of light in dB.
        clear_dots: of the unit.
        periodic: the unit is repeated; otherwise turned at random.
        psnr: dB, no unit tiled so has a higher expected interior PSNR.
        frame: dB, no unit tiled so has a higher expected PSNR of the whole frame, as the surrogate returns it.
        any_layout: dB, nor has any panel with as many clear dots in each whole cell, however each is drawn and turned,
            and whatever the cells that the stop cuts hold; None if it was not asked for.
        grey: dB, a neutral filter that passes as much light, which is also the open stop exposed as briefly.
        open_stop: dB, a clear stop of the area that is clear.
        auc: no unit has a larger expected area under the radial minimum of the blue MTF; None above 25 dots a side,
            where its linear programme takes minutes.
        method: how each was found, and under which assumptions it holds.
    """

    level_db: tuple[float, ...]
    clear_dots: int
    periodic: bool
    psnr: tuple[float, ...]
    frame: tuple[float, ...]
    any_layout: tuple[float, ...] | None
    grey: tuple[float, ...]
    open_stop: tuple[float, ...]
    auc: float | None
    method: tuple[str, ...]


@dataclass(frozen=True)
class Gap:
    """Distance of a design from its bounds.

    Attributes:
        bounds: for its clear count and tiling.
        psnr: dB, its expected interior PSNR at each level.
        head_room: dB, what at most could be gained in the interior; not below 0.
        psnr_frame: dB, what the surrogate returns for it.
        head_room_frame: dB, what at most could be gained there; not below 0.
        auc: its expected area under the radial minimum of the blue MTF.
    """

    bounds: Bounds
    psnr: tuple[float, ...]
    head_room: tuple[float, ...]
    psnr_frame: tuple[float, ...]
    head_room_frame: tuple[float, ...]
    auc: float


def bounds(
    estimate: Surrogate,
    clear_dots: int,
    *,
    periodic: bool = False,
    levels: Sequence[float] | None = None,
    any_layout: bool = True,
) -> Bounds:
    """Bounds for units of the surrogate's size, its scenes and its camera.

    Args:
        estimate: of the scenes, by :func:`maskfab.optimiser.model.expected_psnr.surrogate`.
        clear_dots: of the unit.
        periodic: the unit is repeated; otherwise turned at random.
        levels: of light; None for the surrogate's own.
        any_layout: find the bound on designed maps too.

    Raises:
        OpeningError: MF203 if no dot is clear; MF204 if there are more than the unit has.
        JobError: MF104 for a level that there is not.
    """
    total = estimate.dots**2
    require_clear_dots(clear_dots, total, where="clear_dots")
    levels = estimate.levels if levels is None else levels
    estimate.noise.taking.require(levels)
    inner = interior(estimate)
    ratio = clear_dots / total
    grey_light = [inner.psnr(a, ratio, g, levels) for a, g in ((inner.stop, 1.0), (_smaller_stop(inner, ratio), 0.0))]
    grey, small = grey_light
    variances = [inner.noise.variance(level, ratio) for level in levels]
    errors = residue_errors(inner, residues(inner, periodic=periodic), ratio, variances, periodic=periodic)
    found = tuple(inner.decibels(level, error) for level, error in zip(levels, errors, strict=True))
    whole = frame_bound(estimate, inner, clear_dots, periodic=periodic, levels=levels)
    area = None
    if estimate.dots <= _MOST_DOTS_OF_LP:
        area = auc_bound(rings(estimate.dots, room=estimate.lattice), clear_dots, periodic=periodic)
    method = [
        "psnr: Lagrangian dual over lag residues, least over the protocol's ε; cut cells as whole ones",
        "frame: the best of all openings of so many dots"
        if few_openings(estimate.dots, clear_dots)
        else "frame: the same at the surrogate's own lags; the leak is at least 0",
        "auc: linear programme's dual, positive semidefinite" if not periodic else "auc: linear programme's dual",
    ]
    free = None
    if any_layout:
        free = tuple(layout_bound(inner, ratio, level, ratio) for level in levels)
        method.append(
            "any_layout: Lagrangian dual over blocks of lags, best filter within ε at each frequency, cut cells counted"
        )
    return Bounds(tuple(levels), clear_dots, periodic, found, whole, free, grey, small, area, tuple(method))


def optimality_gap(
    estimate: Surrogate,
    unit: NDArray[np.bool_],
    *,
    periodic: bool = False,
    levels: Sequence[float] | None = None,
    known: Bounds | None = None,
) -> Gap:
    """A unit beside the bounds of its clear count.

    Args:
        estimate: of the scenes.
        unit: bool [dots, dots].
        periodic: it is repeated; otherwise turned at random.
        levels: of light; None for the surrogate's own.
        known: bounds found before for this estimate; used if clear count, tiling and levels are the same.

    Raises:
        OpeningError: MF201 if it is not of the surrogate's size, and as :func:`bounds`.
    """
    n = estimate.dots
    if unit.shape != (n, n):
        raise OpeningError("MF201", f"the unit has the shape {unit.shape}", where="unit", cure=f"Give {n} x {n} dots")
    levels = estimate.levels if levels is None else levels
    clear = int(unit.sum())
    fits = known is not None and (known.clear_dots, known.periodic, known.level_db) == (clear, periodic, tuple(levels))
    limit = known if fits and known is not None else bounds(estimate, clear, periodic=periodic, levels=levels)
    reached = interior(estimate).of_unit(unit, periodic=periodic, levels=levels)
    whole = estimate(unit, periodic=periodic, levels=levels)
    area = rings(n, room=estimate.lattice).of_unit(unit, periodic=periodic)
    return Gap(limit, reached, _room(limit.psnr, reached), whole, _room(limit.frame, whole), area)


def _room(most: tuple[float, ...], have: tuple[float, ...]) -> tuple[float, ...]:
    return tuple(max(0.0, a - b) for a, b in zip(most, have, strict=True))


def _smaller_stop(inner: Interior, ratio: float) -> Floats:
    """Autocorrelation at the lags of a clear round stop of ``ratio`` times the area."""
    side = (len(inner.stop_table) + 1) // 2
    distance = (np.arange(side) - (side - 1) / 2) ** 2
    square = distance[:, None] + distance
    # As many dots as are clear, nearest to the axis first.
    area = max(1, round(ratio * inner.lattice.stop.sum()))
    clear = (square <= np.partition(square.ravel(), area - 1)[area - 1]).astype(np.float64)
    table = pupil_autocorrelation(clear)
    y, x = inner.lags
    return np.asarray(np.maximum(at_lags(table, y, x), 0) / table[side - 1, side - 1])
