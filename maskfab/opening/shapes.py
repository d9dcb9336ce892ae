"""Openings drawn by rule: a slit, alternating blobs, discs on a diamond lattice.

Each shape is a family that grows from its centres, so a count of clear dots selects one member of it. Symmetry
makes dots clear in groups; a count that would split a group is refused, never rounded. Shapes are pure functions
of their parameters and return bool masks [dots, dots], row 0 lowest.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from maskfab.base.arrays import Mask
from maskfab.errors import JobError, OpeningError
from maskfab.opening.clear_dots import closed
from maskfab.opening.decode import MAX_DOTS

Level = NDArray[np.float64]


def stripe(dots: int, width_dots: int, clear_dots: int | None = None) -> Mask:
    """A vertical slit, centred; where the parities differ, half a dot left of or below the centre.

    Args:
        dots: dots along the cell's side.
        width_dots: width of the slit.
        clear_dots: its area; without it the slit runs through the whole cell.

    Raises:
        JobError: MF104 if the slit is wider than the cell or not at least one dot wide.
        OpeningError: MF203 closed, MF204 if the area is no multiple of the width, or more than the full slit.
    """
    _check_range("dots", dots, 1, MAX_DOTS)
    _check_range("width_dots", width_dots, 1, dots)
    full = dots * width_dots
    clear = full if clear_dots is None else clear_dots
    if clear % width_dots or not 0 < clear <= full:
        raise _unreachable("stripe", clear, dots, np.arange(width_dots, full + 1, width_dots))
    height = clear // width_dots
    left, bottom = (dots - width_dots) // 2, (dots - height) // 2
    mask = np.zeros((dots, dots), dtype=np.bool_)
    mask[bottom : bottom + height, left : left + width_dots] = True
    return mask


def blobs(dots: int, clear_dots: int, *, size_ratio: float = 0.7, aspect: float = 1.25, exponent: float = 4.0) -> Mask:
    """Four blobs at half the pitch, as the gaps of a P-OLED display: two large ones and two small ones, crosswise.

    A blob is a superellipse |x/a|^exponent + |y/b|^exponent <= 1: exponent 2 is an ellipse, large ones near a
    rectangle. Large blobs lie (width = aspect x height), small ones stand, so that the cell has no fourfold symmetry.

    Args:
        dots: dots along the cell's side.
        clear_dots: clear dots of all four blobs.
        size_ratio: side of a small blob over that of a large one, 0 to 1; 0 leaves out the small ones.
        aspect: the longer side of a blob over its shorter one, 1 to 4.
        exponent: 1 (rhombus) to 64 (rectangle).

    Raises:
        JobError: MF104 for a parameter out of its range.
        OpeningError: MF203 closed, MF204 if no member of the family has that count.
    """
    _check_range("dots", dots, 1, MAX_DOTS)
    _check_range("size_ratio", size_ratio, 0.0, 1.0)
    _check_range("aspect", aspect, 1.0, 4.0)
    _check_range("exponent", exponent, 1.0, 64.0)
    large = [(0.25, 0.25), (0.75, 0.75)]
    small = [(0.25, 0.75), (0.75, 0.25)] if size_ratio else []
    stretch = float(np.sqrt(aspect))
    levels = [
        _superellipse(_offset(dots, x), _offset(dots, y), size * wide, size / wide, exponent)
        for centres, size, wide in ((large, 1.0, stretch), (small, size_ratio, 1 / stretch))
        for x, y in centres
    ]
    return _grown("blobs", np.minimum.reduce(levels), clear_dots)


def diamond_discs(dots: int, clear_dots: int) -> Mask:
    """Two equal discs per cell, at its corner and its centre: a square lattice turned by 45 degrees.

    Args:
        dots: dots along the cell's side.
        clear_dots: clear dots of both discs.

    Raises:
        JobError: MF104 if the cell has no dots.
        OpeningError: MF203 closed, MF204 if no radius has that count.
    """
    _check_range("dots", dots, 1, MAX_DOTS)
    levels = [_superellipse(_offset(dots, c), _offset(dots, c), 1.0, 1.0, 2.0) for c in (0.0, 0.5)]
    return _grown("diamond", np.minimum.reduce(levels), clear_dots)


def _offset(dots: int, centre: float) -> NDArray[np.float64]:
    """Distance of each dot's middle from a centre (a fraction of the pitch), the short way round the cell."""
    away: NDArray[np.float64] = np.abs(np.arange(dots) + 0.5 - centre * dots)
    return np.asarray(np.minimum(away, dots - away))


def _superellipse(x: NDArray[np.float64], y: NDArray[np.float64], a: float, b: float, exponent: float) -> Level:
    """Growth at which a blob of half axes proportional to a, b reaches each dot's middle, [y, x]."""
    total: Level = (x[None, :] / a) ** exponent + (y[:, None] / b) ** exponent
    return np.asarray(total ** (1 / exponent), dtype=np.float64)


def _grown(shape: str, level: Level, clear_dots: int) -> Mask:
    """The dots of the lowest levels, exactly ``clear_dots`` of them."""
    # Equal levels must tie, although they come from differently rounded sums.
    rank = np.unique(np.round(level, 9), return_inverse=True)[1].reshape(level.shape)
    reachable = np.cumsum(np.bincount(rank.ravel()))
    if clear_dots not in reachable:
        raise _unreachable(shape, clear_dots, level.shape[0], reachable)
    return np.asarray(rank <= np.searchsorted(reachable, clear_dots))


def _unreachable(shape: str, clear_dots: int, dots: int, reachable: NDArray[np.int_]) -> OpeningError:
    total = dots * dots
    if clear_dots <= 0:
        return closed(clear_dots, total, where="clear_dots", cure=f"The smallest is {reachable[0]} dots")
    nearest = reachable[np.argsort(np.abs(reachable - clear_dots), kind="stable")[:2]]
    named = " or ".join(f"{n} (open ratio {n / total:.4f})" for n in sorted(int(n) for n in nearest))
    return OpeningError(
        "MF204",
        f"{shape}: {clear_dots} of {total} dots (open ratio {clear_dots / total:.4f}) cannot be reached with these "
        "parameters",
        where="clear_dots",
        cure=f"The nearest are {named} clear dots",
    )


def _check_range(name: str, value: float, low: float, high: float) -> None:
    if not low <= value <= high:  # also refuses NaN
        raise JobError(
            "MF104",
            f"{name} = {value} must lie between {low} and {high}",
            where=name,
            cure=f"Choose {name} in that range",
        )
