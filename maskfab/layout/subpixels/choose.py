r"""Where a pixel's light comes from, and which colour goes where so that random orientations show least.

An emitter pattern whose luminance centroid lies off the pixel's centre moves the light about when pixels are turned at
random, which the eye sees as grain; its contrast grows with the centroid's distance from its mean over orientations.
"""

from __future__ import annotations

from collections.abc import Iterable
from itertools import permutations

import numpy as np
from numpy.typing import NDArray

from maskfab.model import ORIENTATIONS, Emitters, orient

Labels = NDArray[np.int8]

LUMINANCE_SHARES = (0.2126, 0.7152, 0.0722)
"""Of red, green and blue in white of the sRGB primaries (ITU-R BT.709)."""


def luminance_centroid(emitters: Emitters, pitch_nm: int) -> tuple[float, float]:
    """Offset (x, y) of the light's centroid from the pixel's centre, in pixels; every colour sends its share of white.

    Colours without area send nothing; (0, 0) if there is none at all.
    """
    labels = emitters.labels
    n = labels.shape[0]
    total, moment = 0.0, np.zeros(2)
    for colour, share in enumerate(LUMINANCE_SHARES, 1):
        place = np.argwhere(labels == colour)
        if place.size:
            total += share
            moment += share * (place.mean(axis=0) + 0.5 - n / 2)
    if not total:
        return 0.0, 0.0
    y, x = moment / total * emitters.cell_nm / pitch_nm
    return float(x), float(y)


def wander(emitters: Emitters, pitch_nm: int, elements: Iterable[int] = range(ORIENTATIONS)) -> float:
    """Root mean square distance of the centroid from its mean over equally likely orientations, in pixels."""
    places = np.array(
        [luminance_centroid(Emitters(orient(emitters.labels, k), emitters.cell_nm), pitch_nm) for k in elements]
    )
    return float(np.sqrt(((places - places.mean(axis=0)) ** 2).sum(axis=1).mean()))


def best_colours(
    candidates: Iterable[Labels], cell_nm: int, pitch_nm: int, ratio: tuple[float, float, float], footprint_cells: float
) -> Emitters | None:
    """The placement, and the colours for its three areas, with the centroid nearest to the pixel's centre.

    Args:
        candidates: placements, int8 [n, n] with three areas numbered 1 to 3 in any order.
        cell_nm: side of their cells.
        pitch_nm: of the pixel, gutter included.
        ratio: relative areas of red, green and blue.
        footprint_cells: least area per colour over its ratio, in cells; what falls short in an order is left out.
    """
    found: list[tuple[float, int, Labels]] = []
    for number, labels in enumerate(candidates):
        areas = np.array([(labels == k).sum() for k in (1, 2, 3)])
        for order in permutations((1, 2, 3)):
            coloured = np.array([0, *order], dtype=np.int8)[labels]
            held = np.array([areas[order.index(k)] for k in (1, 2, 3)]) / ratio
            if held.min() >= footprint_cells - 1e-9:
                offset = np.hypot(*luminance_centroid(Emitters(coloured, cell_nm), pitch_nm))
                found.append((round(float(offset), 12), number, coloured))
    if not found:
        return None
    return Emitters(min(found, key=lambda each: each[:2])[2], cell_nm)
