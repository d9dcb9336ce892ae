"""Transmission of wires over each dot that they cross: mean amplitude and mean power, exact for upright outlines."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from maskfab.base.arrays import Floats
from maskfab.errors import JobError
from maskfab.model import ORIENTATIONS, Panel, Polygon, orient


def veil(panel: Panel) -> tuple[Floats, Floats]:
    """Mean amplitude and mean power over each dot behind the wires, float64 [8, dots, dots] by orientation.

    A wire passes the amplitude sqrt(transmission) where it lies, once for each track however its outlines overlap;
    different tracks multiply.

    Raises:
        JobError: MF120 if an outline has an edge that is neither horizontal nor vertical.
    """
    lines = panel.cell_size.dot_edges_nm
    drawn = [track for track in panel.tracks if track.transmission < 1]
    points = [np.array(polygon).ravel() for track in drawn for polygon in track.polygons]
    cuts = np.concatenate([lines, *points, *(panel.pitch_nm - each for each in points)])
    # The same cuts in x and y, and mirrored, so that a turn is a turn of the array.
    edges = np.unique(cuts[(cuts >= lines[0]) & (cuts <= lines[-1])])
    middle = (edges[1:] + edges[:-1]) / 2
    shares = np.diff(edges) / panel.dot_nm
    starts = np.searchsorted(edges, lines[:-1])
    power = np.ones((ORIENTATIONS, middle.size, middle.size))
    for track in drawn:
        covered = np.zeros(power.shape[1:], dtype=np.bool_)
        for polygon in track.polygons:
            covered |= _inside(polygon, middle)
        for k in range(ORIENTATIONS):
            power[k][orient(covered, k) if track.turns else covered] *= track.transmission
    area = shares[:, None] * shares
    amplitude, mean_power = (
        np.add.reduceat(np.add.reduceat(values * area, starts, axis=1), starts, axis=2)
        for values in (np.sqrt(power), power)
    )
    return amplitude, mean_power


def _inside(polygon: Polygon, middle: Floats) -> NDArray[np.bool_]:
    """Whether points of a square grid lie in a polygon: an odd number of its upright edges to their right."""
    inside = np.zeros((middle.size, middle.size), dtype=np.bool_)
    for (x0, y0), (x1, y1) in zip(polygon, (*polygon[1:], polygon[0]), strict=True):
        if x0 != x1 and y0 != y1:
            raise JobError(
                "MF120",
                f"a wire's edge from ({x0}, {y0}) to ({x1}, {y1}) nm is neither horizontal nor vertical",
                where="wires",
                cure="Draw wires with horizontal and vertical edges",
            )
        if x0 == x1:
            inside ^= ((middle > min(y0, y1)) & (middle < max(y0, y1)))[:, None] & (middle < x0)
    return inside
