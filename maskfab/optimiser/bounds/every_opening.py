"""The best that the surrogate returns for any opening of one clear count, found by trying them all.

Where few openings have that count, no proof beats looking: openings that the tiling makes alike are tried once, and the
leak, which is most of the work and at least nothing, only of those that could be the best without it.
"""

from __future__ import annotations

from collections.abc import Sequence
from itertools import combinations
from math import comb

import numpy as np
from numpy.typing import NDArray

from maskfab.model import ORIENTATIONS, orient
from maskfab.optimiser.model.expected_psnr import Surrogate

_MOST_OPENINGS = 20_000
"""All of 4 x 4 dots, whatever their clear count, are at most 12 870."""


def few_openings(dots: int, clear_dots: int) -> bool:
    """Whether all openings of so many clear dots, in a unit of so many along its side, can be tried."""
    return comb(dots**2, clear_dots) <= _MOST_OPENINGS


def best_of_every_opening(
    estimate: Surrogate, clear_dots: int, *, periodic: bool, levels: Sequence[float]
) -> tuple[float, ...]:
    """dB at each level of the best opening, as the surrogate returns it.

    Args:
        estimate: of the scenes.
        clear_dots: of the unit, at least 1.
        periodic: the unit is repeated; otherwise turned at random.
        levels: of light.
    """
    units = distinct_openings(estimate.dots, clear_dots, periodic=periodic)
    share = clear_dots / estimate.dots**2
    leakless = [estimate.leakless_errors(unit, periodic=periodic) for unit in units]
    known: dict[int, tuple[float, ...]] = {}
    best = []
    for k, level in enumerate(levels):
        least = np.array([errors(level, share).min() for errors in leakless])
        found = -np.inf
        for place in least.argsort():
            if estimate.decibels(level, float(least[place])) <= found:
                break
            if place not in known:
                known[place] = estimate(units[place], periodic=periodic, levels=levels)
            found = max(found, known[place][k])
        best.append(found)
    return tuple(best)


def distinct_openings(dots: int, clear_dots: int, *, periodic: bool) -> NDArray[np.bool_]:
    """[openings, dots, dots]: one of all those that the surrogate cannot tell apart.

    Turned at random, a unit is any of its eight orientations; repeated, it can begin anywhere, and its autocorrelation
    is that of its half turn.
    """
    places = np.array(list(combinations(range(dots**2), clear_dots)))
    cells = np.arange(dots**2).reshape(dots, dots)
    if periodic:
        moved = [np.roll(cells, (v, u), axis=(0, 1)) for v in range(dots) for u in range(dots)]
        images = moved + [each[::-1, ::-1] for each in moved]
    else:
        images = [orient(cells, k) for k in range(ORIENTATIONS)]
    openings = np.zeros((len(places), dots**2), dtype=np.bool_)
    np.put_along_axis(openings, places, values=True, axis=1)
    packed = np.packbits(openings, axis=1)
    # Of openings in dictionary order, each is told by its place.
    order = np.lexsort(packed.T[::-1])
    named = _words(packed[order])
    first = np.arange(len(order))
    for image in images:
        moved_words = _words(np.packbits(openings[order][:, image.ravel()], axis=1))
        first = np.minimum(first, np.searchsorted(named, moved_words))
    tried: NDArray[np.bool_] = openings[order][first == np.arange(len(order))]
    return tried.reshape(-1, dots, dots)


def _words(packed: NDArray[np.uint8]) -> NDArray[np.bytes_]:
    """Rows of bytes as one value each; they have one length, so that zeros cut off at the end tell no two alike."""
    return np.ascontiguousarray(packed).view(f"S{packed.shape[1]}").ravel()
