"""A die as its own grid of dots and gutters, which needs no polygons."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy import sparse

from maskfab.base.arrays import Floats
from maskfab.model import Die, side_by_side

# Shares of pixels that are whole but for rounding become whole.
_DIGITS = 12


def die_edges_nm(die: Die) -> tuple[Floats, Floats]:
    """Grid lines of a die along x and y: the borders of all its dots, cells and gutters."""
    rows, columns = die.panel.orientations.shape
    (x0, y0), cell = die.origin_nm, die.panel.cell_size.edges_nm
    x, y = (
        np.append((np.arange(n)[:, None] * die.panel.pitch_nm + cell[:-1]).ravel(), n * die.panel.pitch_nm)
        for n in (columns, rows)
    )
    return (x + x0).astype(np.float64), (y + y0).astype(np.float64)


def die_raster(die: Die) -> NDArray[np.bool_]:
    """Raster of a die, bool [y, x], from opening and orientations, on the grid of :func:`die_edges_nm`."""
    panel = die.panel
    pad = 1 if panel.gutter_nm else 0
    variants = np.pad(panel.patterns, ((0, 0), (pad, pad), (pad, pad)))
    return side_by_side(variants[panel.orientations])


def pixel_overlaps(edges: Floats, pixels: Floats) -> sparse.csr_array:
    """Share of every pixel that lies in every interval, float64 [pixels, intervals].

    With the rows of two axes, ``pixel_overlaps(y) @ raster @ pixel_overlaps(x).T`` is the share of every pixel that
    is clear.

    Args:
        edges: ascending borders of the intervals.
        pixels: ascending borders of the pixels, in the same unit.
    """
    cuts = np.union1d(edges, pixels)
    cuts = cuts[(cuts >= max(edges[0], pixels[0])) & (cuts <= min(edges[-1], pixels[-1]))]
    shape = (pixels.size - 1, edges.size - 1)
    if cuts.size < 2:
        return sparse.csr_array(shape)
    middles = (cuts[:-1] + cuts[1:]) / 2
    rows = np.searchsorted(pixels, middles, side="right") - 1
    columns = np.searchsorted(edges, middles, side="right") - 1
    shares = np.round(np.diff(cuts) / np.diff(pixels)[rows], _DIGITS)
    return sparse.csr_array((shares, (rows, columns)), shape=shape)
