"""Free area for emitters in a pixel: closed, and far enough from this pixel's opening and from its neighbours'."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np
from numpy.typing import NDArray

from maskfab.display.emitters.emitter_rules import EmitterGrid
from maskfab.errors import JobError
from maskfab.model import ORIENTATIONS, orient

EVERY = tuple(range(ORIENTATIONS))


def free_region(
    mask: NDArray[np.bool_], grid: EmitterGrid, orientations: Iterable[int] = EVERY, *, margin: int = 0
) -> NDArray[np.bool_]:
    """The cells in which an emitter may lie, whichever of the orientations the pixel and its neighbours have.

    A neighbour's opening counts where the gap is wider than the gutter. As emitters turn with their opening, what
    matters is the neighbour's orientation relative to this pixel's, and the union over all that can occur is exact
    for panels in which any two orientations meet.

    Args:
        mask: bool [..., dots, dots] openings, True is clear; leading axes are a batch.
        grid: the pixel's cells and its rules in cells.
        orientations: those in use.
        margin: cells kept free along each side, for rules between emitters of neighbouring pixels.

    Returns:
        bool [..., n, n] on the grid's cells.

    Raises:
        JobError: MF117 if the mask is not the one that the grid was made for.
    """
    clear = np.repeat(np.repeat(np.asarray(mask, dtype=np.bool_), grid.per_dot, axis=-2), grid.per_dot, axis=-1)
    n = grid.cells
    if clear.shape[-2:] != (n, n):
        raise JobError(
            "MF117",
            f"an opening of {mask.shape[-2]} x {mask.shape[-1]} dots of {grid.per_dot} cells is not the pixel of "
            f"{n} x {n} cells",
            where="emitters",
            cure="Make the grid from this opening",
        )
    over = max(0, grid.to_opening - grid.gutter)
    if over == 0:
        taken = _grown(clear, grid.to_opening)
    else:
        taken = _grown(_with_neighbours(clear, over, grid.gutter, relative_orientations(orientations)), grid.to_opening)
        rim = over + grid.gutter
        taken = taken[..., rim : rim + n, rim : rim + n]
    free = ~taken
    if margin > 0:
        inner = np.zeros((n, n), dtype=np.bool_)
        inner[margin : n - margin, margin : n - margin] = True
        free &= inner
    return free


def relative_orientations(orientations: Iterable[int]) -> tuple[int, ...]:
    """Orientations of neighbours relative to a pixel's own, for all pairs of the orientations."""
    marks = np.arange(9).reshape(3, 3)
    used = tuple(sorted(set(orientations)))
    return tuple(
        k
        for k in EVERY
        if any(np.array_equal(orient(orient(marks, k), own), orient(marks, other)) for own in used for other in used)
    )


def _with_neighbours(
    clear: NDArray[np.bool_], depth: int, gutter: int, orientations: tuple[int, ...]
) -> NDArray[np.bool_]:
    """The pixel with a rim: an empty gutter, then the outermost cells of all its eight neighbours."""
    n = clear.shape[-1]
    around = np.zeros_like(clear)
    batch = clear.reshape(-1, n, n)
    for k in orientations:
        turned = np.stack([orient(one, k) for one in batch])
        around |= turned.reshape(clear.shape)
    depth = min(depth, n)
    rim = depth + gutter
    whole = np.zeros((*clear.shape[:-2], n + 2 * rim, n + 2 * rim), dtype=np.bool_)
    below, own = (slice(0, depth), slice(n - depth, n)), (slice(rim, rim + n), slice(0, n))
    places: tuple[tuple[slice, slice], ...] = (below, own, (slice(rim + n + gutter, None), slice(0, depth)))
    for to_y, from_y in places:
        for to_x, from_x in places:
            whole[..., to_y, to_x] = around[..., from_y, from_x]
    whole[..., rim : rim + n, rim : rim + n] = clear
    return whole


def _grown(clear: NDArray[np.bool_], gap: int) -> NDArray[np.bool_]:
    """All cells within ``gap`` cells of a clear one along both axes."""
    grown = clear.copy()
    for axis in (-2, -1):
        source = np.moveaxis(grown.copy(), axis, 0)
        target = np.moveaxis(grown, axis, 0)
        for step in range(1, min(gap, len(source) - 1) + 1):
            target[step:] |= source[:-step]
            target[:-step] |= source[step:]
    return grown
