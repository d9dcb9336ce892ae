"""Aperture of a file: the clear share of every interval of a grid, from the polygons read.

An interval that the stop cuts holds the share of what the stop leaves of it: what lies beyond changes nothing.
"""

from __future__ import annotations

from typing import TypeAlias

import numpy as np
from klayout import db
from numpy.typing import NDArray

from maskfab.base.arrays import Floats, Ints
from maskfab.geometry.raster import coverage, outline_coverage
from maskfab.geometry.stop import edges_in_stop, stop_box, whole_or_away
from maskfab.model import Box, Die, Stop
from maskfab.optics.pupil.aperture import Aperture, Lattice, covered_aperture, zeros
from maskfab.units import NM_PER_UM

Shapes: TypeAlias = db.Region | Ints

_WHOLE = 1e-8
"""Share of an interval within the stop to which the stop's polygon and its grid tell what is clear."""

_ROWS_AT_A_TIME = 64


def axis_nm(die: Die) -> tuple[float, float]:
    """Where the optical axis meets the plate: the middle of the panel."""
    x0, y0, x1, y1 = die.box_nm
    return (x0 + x1) / 2, (y0 + y1) / 2


def light_box(die: Die, stop: Stop) -> Box:
    """The part of a plate whose shapes the stop of a die sees, and the rest of every dot that it cuts."""
    return stop_box(stop, axis_nm(die), die.panel.dot_nm)


def sees_light(die: Die, stop: Stop, shapes: Shapes) -> bool:
    """Whether any of these shapes, in nanometres of the plate, is clear before the stop of a die."""
    axis = axis_nm(die)
    if not isinstance(shapes, db.Region):
        inside, outside = whole_or_away(stop.scaled(NM_PER_UM, NM_PER_UM), *(shapes - np.tile(axis, 2)).T)
        if inside.any():
            return True
        shapes = shapes[~outside]
    return edges_in_stop(shapes, stop, axis)[1] > 0


def read_aperture(x: Lattice, y: Lattice, covered: Floats) -> Aperture:
    """An aperture from the share of every interval that is clear, [ny, nx].

    Where every interval is clear or dark, none varies within, and zeros that take no memory spare a pass over them.
    """
    if ((covered == 0) | (covered == 1)).all():
        return Aperture(x, y, covered, zeros((covered.shape[0], covered.shape[1])))
    return covered_aperture(x, y, covered)


def aperture_in_stop(
    x: Lattice, y: Lattice, shapes: Shapes, edges_um: Floats, stop: Stop, axis: tuple[float, float]
) -> Aperture:
    """Aperture before a stop, on lattices about its axis.

    Args:
        x, y: the lattices.
        shapes: what is clear, in nanometres of the plate, as far as the stop at least.
        edges_um: the same cut by the stop, see :func:`maskfab.geometry.stop.edges_in_stop`.
        stop: what cuts it.
        axis: of the lattices, in nanometres of the plate.
    """
    lines = x.edges_um(), y.edges_um()
    covered = coverage(shapes, *lines_nm(x, y, axis))
    row, column = _grey_beyond(covered, stop, *lines)
    if row.size:
        of_stop, _ = edges_in_stop(db.Region(db.Box(*stop_box(stop, (0.0, 0.0)))), stop, (0.0, 0.0))
        clear, whole = (outline_coverage(edges, *lines)[row, column] for edges in (edges_um, of_stop))
        share = np.clip(clear / np.where(whole > 0, whole, 1.0), 0.0, 1.0)
        share[clear < _WHOLE] = 0.0
        share[whole - clear < _WHOLE] = 1.0
        covered[row, column] = share
    covered.flags.writeable = False
    return read_aperture(x, y, covered)


def lines_nm(x: Lattice, y: Lattice, axis: tuple[float, float]) -> tuple[Floats, Floats]:
    """The lines of lattices in nanometres of the plate; whole numbers but for rounding are made so."""
    along_x, along_y = (centre + NM_PER_UM * lattice.edges_um() for centre, lattice in zip(axis, (x, y), strict=True))
    return _on_grid(along_x), _on_grid(along_y)


def edge_distances(shapes: db.Region, stop: Stop, axis: tuple[float, float]) -> tuple[set[int], bool]:
    """Twice the distances from the axis, in nanometres, of the edges before the stop that lie along x or y.

    Returns:
        The distances, twice because an axis may lie between two nanometres; and whether other edges are there, too.
    """
    ends = (value for edge in shapes.edges().each() for value in (edge.x1, edge.y1, edge.x2, edge.y2))
    edges = np.fromiter(ends, dtype=np.int64).reshape(-1, 4)
    edges *= 2
    edges -= np.tile([round(2 * centre) for centre in axis], 2)
    start, span = edges[:, :2].astype(np.float64), (edges[:, 2:] - edges[:, :2]).astype(np.float64)
    along = np.clip(-(start * span).sum(axis=1) / np.maximum((span**2).sum(axis=1), 1.0), 0.0, 1.0)
    nearest = start + along[:, None] * span
    if stop.round:
        seen = edges[np.hypot(*nearest.T) < NM_PER_UM * stop.diameter_um - 1]
    else:
        low, high = np.minimum(edges[:, :2], edges[:, 2:]), np.maximum(edges[:, :2], edges[:, 2:])
        seen = edges[((low < NM_PER_UM * stop.diameter_um - 1) & (high > 1 - NM_PER_UM * stop.diameter_um)).all(axis=1)]
    upright, level = seen[:, 0] == seen[:, 2], seen[:, 1] == seen[:, 3]
    distances = {*map(abs, seen[upright, 0].tolist()), *map(abs, seen[level, 1].tolist())}
    return distances, not bool((upright | level).all())


def _grey_beyond(covered: Floats, stop: Stop, x_um: Floats, y_um: Floats) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
    """Rows and columns of intervals that are clear in part and reach beyond a centred stop.

    Of foreign polygons most intervals may be clear in part, so they are looked at a few rows at a time.
    """
    found = []
    for start in range(0, len(covered), _ROWS_AT_A_TIME):
        some = covered[start : start + _ROWS_AT_A_TIME]
        row, column = np.nonzero((some > 0) & (some < 1))
        row += start
        sides = (x_um[column], y_um[row], x_um[column + 1], y_um[row + 1])
        inside, _ = whole_or_away(stop.scaled(NM_PER_UM, NM_PER_UM), *(NM_PER_UM * side for side in sides))
        found.append((row[~inside], column[~inside]))
    row, column = (np.concatenate(each) for each in zip(*found, strict=True))
    return row, column


def _on_grid(edges_nm: Floats) -> Floats:
    whole = np.rint(edges_nm)
    return np.where(abs(edges_nm - whole) < 1e-4, whole, edges_nm)
