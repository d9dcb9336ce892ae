r"""Upper bound on the gain of any layout with as many clear dots over a designed map, cut cells counted.

A map's light is its own: cells that the stop cuts hold what they were turned to hold. The theorem of
:mod:`maskfab.optimiser.bounds.error_bound` for all layouts counts pairs of cells, so it holds for any number of clear
dots within the stop: whole cells hold c each, cut ones at most c and at most their dots inside, and the rest of the
light lies in the cut ones. That includes every map of one unit, of every one of its mirror images and of other units of
c dots.

The frame's error is at least σ² · noise + bias without the frequencies below 1/16 cycle per pixel, where the leak
counts, which is at least 0 (:mod:`maskfab.optimiser.bounds.frame_bound`); the best filter at each frequency, within
what the protocol's ε span there, is better than that of any ε.

Notes:
    Proven for what sampling folds back from a grey panel of the same light, as all bounds here are; a realised panel's
    error has its own in it, so beside that the limit is one of the model.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from maskfab.base.arrays import Floats
from maskfab.errors import JobError
from maskfab.optimiser.bounds.error_bound import block_error, blocks, wiener_cost
from maskfab.optimiser.model.expected_psnr import Surrogate
from maskfab.optimiser.model.interior import Interior, interior

_STEPS = 30
_NODES = 32
"""Of A; twice as many change the limit of 100 dots of 441 by less than 0.03 dB."""
_FAINT = 0.1
_LOW = 1 / 16
"""Cycles per pixel below which, on both axes, the leak takes the bias's place."""


@dataclass(frozen=True)
class MapGap:
    """A layout beside its bound.

    Attributes:
        level_db: levels of light in dB.
        open_share: of the stop, the layout's own.
        limit: dB, no layout of as many dots in each whole cell and as much light has a higher PSNR.
        head_room: dB, what at most could be gained over the layout; not below 0.
    """

    level_db: tuple[float, ...]
    open_share: float
    limit: tuple[float, ...]
    head_room: tuple[float, ...]


def map_gap(
    estimate: Surrogate,
    pupil: Floats,
    clear_dots: int,
    psnr: Sequence[float],
    *,
    levels: Sequence[float] | None = None,
) -> MapGap:
    """A panel that is laid, beside what its clear dots and its light allow.

    Args:
        estimate: of the scenes.
        pupil: of :func:`maskfab.camera.transfer.lay`, 0 outside the stop.
        clear_dots: of every whole cell.
        psnr: dB at each level, as :class:`maskfab.optimiser.model.layout_error.PupilError` finds it for the pupil.
        levels: of light; None for the surrogate's own.

    Raises:
        JobError: MF122 for a pupil of other dots than the surrogate's panel.
    """
    side = estimate.lattice.side
    if pupil.shape != (side, side):
        raise JobError(
            "MF122",
            f"the panel has the shape {pupil.shape}, the surrogate's {side} x {side}",
            where="pupil",
            cure="Lay it with the surrogate's dots",
        )
    inner, levels = interior(estimate), estimate.levels if levels is None else levels
    share = float(pupil.sum() / inner.stop_dots)
    limit = tuple(layout_bound(framed(inner), clear_dots / estimate.dots**2, level, share) for level in levels)
    room = tuple(max(0.0, most - have) for most, have in zip(limit, psnr, strict=True))
    return MapGap(tuple(levels), share, limit, room)


def framed(inner: Interior) -> Interior:
    """The lags without what the filter holds back at low frequencies, where the leak counts instead."""
    low = np.abs(inner.lags).max(axis=0) / inner.per_cycle < _LOW
    return replace(inner, power=np.where(low, 0.0, inner.power))


def layout_bound(inner: Interior, ratio: float, level: float, open_share: float) -> float:
    """dB that no layout reaches.

    Args:
        inner: of the camera; its power says what counts.
        ratio: clear share of each whole cell; no cut cell holds more dots.
        level: of light, dB.
        open_share: clear share of the stop.
    """
    faintest = float(inner.stop.min())
    # No lag has more pairs of clear dots than of dots, of which the stop passes the share that is clear.
    most = 1 / (faintest if faintest > _FAINT else open_share)
    nodes, cost = wiener_cost(inner, inner.noise.variance(level, open_share), open_share, most, _NODES)
    around = blocks(inner, ratio, cut_cells=True, open_share=open_share)
    found = block_error(inner, nodes, cost, around, open_share, moving=True, steps=_STEPS)[0]
    return inner.decibels(level, found)
