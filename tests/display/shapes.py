"""Grids, and regions with a known answer, for the tests of placements."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from scipy import ndimage

from maskfab.display.emitter_rules import EmitterGrid

ALIKE = (1.0, 1.0, 1.0)
PUBLISHED = Path(__file__).parents[3] / "shared" / "reference" / "data" / "published_masks"


def cells(n, width=1, gap=0, *, to_opening=0, gutter=0, per_dot=1):
    """A grid of micrometre cells."""
    return EmitterGrid(n, 1000, per_dot, gutter * 1000, to_opening, gap, width)


def published(name):
    """bool dots of a mask of the paper's authors."""
    path = PUBLISHED / f"{name}.png"
    if not path.exists():
        pytest.skip(f"{path.name}, which carries no licence, is not beside this checkout")
    import OpenImageIO as oiio  # noqa: N813

    return np.asarray(oiio.ImageBuf(str(path)).get_pixels(oiio.UINT8))[..., 0] > 127


def bar(n, dots, start):
    """A slit of so many columns over the full height."""
    mask = np.zeros((n, n), dtype=bool)
    mask[:, start : start + dots] = True
    return mask


def spiral(turns, width):
    """A corridor of this width with walls as wide, that winds inwards."""
    y = x = 0
    coarse = np.zeros((4 * turns + 1, 4 * turns + 1), dtype=bool)
    dy, dx = 0, 1
    coarse[0, 0] = True
    blocked = 0
    while blocked < 2:
        v, u = y + dy, x + dx
        w, t = v + dy, u + dx
        inside = 0 <= v < len(coarse) and 0 <= u < len(coarse)
        ahead = 0 <= w < len(coarse) and 0 <= t < len(coarse) and coarse[w, t]
        if inside and not ahead and not coarse[v, u]:
            y, x, blocked = v, u, 0
            coarse[y, x] = True
        else:
            dy, dx, blocked = dx, -dy, blocked + 1
    return np.kron(coarse, np.ones((width, width), dtype=bool))


def broken_rules(labels, region, grid, ratio=ALIKE, least=0.0):
    """What is wrong with a placement, found without the code that made it; empty if it keeps all rules."""
    wrong = []
    if (labels[~region] != 0).any():
        wrong.append("outside the region")
    for k in (1, 2, 3):
        own = labels == k
        if own.sum() < least * ratio[k - 1] - 1e-9:
            wrong.append(f"{k} too small")
        # Opened by the square and held together by shifts of it.
        w = grid.min_width
        parts, count = ndimage.label(_places(own, w))
        if not any(np.array_equal(_covered(parts == part, w), own) for part in range(1, count + 1)):
            wrong.append(f"{k} not of width {w} or not in one piece")
        near = ndimage.maximum_filter(own, 2 * grid.colour_gap + 1, mode="constant")
        if ((labels != 0) & ~own & near).any():
            wrong.append(f"{k} too near to another")
    return wrong


def _places(region, width):
    n = len(region)
    places = np.zeros_like(region)
    for y in range(n - width + 1):
        for x in range(n - width + 1):
            places[y, x] = region[y : y + width, x : x + width].all()
    return places


def _covered(places, width):
    covered = np.zeros_like(places)
    for y, x in np.argwhere(places):
        covered[y : y + width, x : x + width] = True
    return covered
