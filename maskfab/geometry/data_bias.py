"""Data out of which a writer's bias has been taken, so that the plate comes out as designed.

A writer whose clear widths come out wider by a bias gets clear shapes that are narrower by it: every edge is moved by
half of it, square corners stay square. Across cells too, for an opening may run on into the next cell.

Sized are the dies and :data:`SIZED` marks whose outlines run along x and y. Titles, labels, the map of the dies, stars
and marks of an extent stay as drawn: sizing has no exact way back for slanted outlines, and an extent is to be kept.
"""

from __future__ import annotations

import numpy as np
from klayout import db
from numpy.typing import NDArray

from maskfab.errors import JobError
from maskfab.geometry.die_grid import die_edges_nm, die_raster
from maskfab.geometry.plate_layout import simple_polygon
from maskfab.model import Die, Furniture, Plate
from maskfab.units import NM_PER_UM

Floats = NDArray[np.float64]
Mask = NDArray[np.bool_]

SIZED = ("cd", "resolution", "fiducial", "alignment", "parity", "code")
"""Kinds of marks whose widths count."""
_SQUARE = 2
"""KLayout's way of sizing in which right angles stay sharp."""


def biased_data(clear: db.Region, plate: Plate, bias_nm: int) -> db.Region:
    """Clear shapes as data, merged with kissing corners apart.

    Args:
        clear: everything that should come out clear on the plate, in plate nanometres.
        plate: whose marks tell what is left as drawn.
        bias_nm: by which the writer makes clear widths wider; even, negative narrows.
    """
    return _resized(clear, plate, -bias_nm)


def written_of(data: db.Region, plate: Plate, bias_nm: int) -> db.Region:
    """Shapes that the writer makes of biased data, exactly those of :func:`biased_data` where no gap was closed."""
    return _resized(data, plate, bias_nm)


def biased_raster(die: Die, bias_nm: int) -> tuple[Floats, Floats, Mask]:
    """A die in biased data, without polygons: lines along x and y, and which parts between them are clear.

    A line between two dots becomes two, half the bias to either side of it; what lies between them is clear if both
    dots are (positive bias: shapes shrink), or if one is (negative: they grow), and so along x and then along y.

    Returns:
        float64 [nx + 1] and [ny + 1] lines in plate nanometres, bool [ny, nx].
    """
    clear = np.pad(die_raster(die), 1)
    x, y = die_edges_nm(die)
    clear, x = _between(clear, x, bias_nm)
    turned, y = _between(clear.T, y, bias_nm)
    return x, y, turned.T


def check_bias(plate: Plate, bias_nm: int, where: str = "process.cd_bias") -> None:
    """Refuse a bias at which shapes vanish from the data, or gaps between them close.

    Raises:
        JobError: MF127 for the first die, gutter or mark that does not bear it.
    """
    reach, cure = abs(bias_nm), 'let the house make it good: order.bias = "house"'
    told = f"data biased by {bias_nm / NM_PER_UM:g} um"
    for die in plate.dies:
        for name, length in (("dots", die.panel.dot_nm), ("a gutter", die.panel.gutter_nm or reach + 1)):
            if length <= reach:
                raise JobError(
                    "MF127",
                    f"{told} need {name} of more than {reach / NM_PER_UM:g} um, and die {die.name} has "
                    f"{length / NM_PER_UM:g} um",
                    where=f"{where}, die {die.name}",
                    cure=f"Use larger dots, a wider gutter or none, or {cure}",
                )
    marks = sum((_region(mark) for mark in plate.furniture if _sized(mark)), start=db.Region())
    lost = _moved(_moved(marks, -bias_nm), bias_nm) ^ marks
    if not lost.is_empty():
        what = f"{told} lose a mark or close a gap of one at {_place(lost)}"
        raise JobError("MF127", what, where=where, cure=f"Use larger dots, after which marks are sized, or {cure}")
    rooms = db.Region([db.Box(*die.box_nm).enlarged(reach, reach) for die in plate.dies])
    near = rooms.merged(False, 2) + (rooms & (marks + _kept(plate))) + (_moved(marks, 2 * reach) & _kept(plate))
    if not near.is_empty():
        what = f"{told} need more than {reach / NM_PER_UM:g} um between dies and marks, at {_place(near)} there is less"
        raise JobError("MF127", what, where=where, cure=f"Leave more room between dies and marks, or {cure}")


def _place(region: db.Region) -> str:
    box = min((each.bbox() for each in region.each()), key=lambda each: (each.bottom, each.left))
    return f"({box.left / NM_PER_UM:.3f}, {box.bottom / NM_PER_UM:.3f}) um"


def _resized(shapes: db.Region, plate: Plate, by_nm: int) -> db.Region:
    kept = _kept(plate)
    return (_moved(shapes - kept, by_nm) + (shapes & kept)).merged(True, 1)


def _moved(shapes: db.Region, by_nm: int) -> db.Region:
    """Shapes whose widths are larger by an even number of nanometres."""
    half = by_nm // 2
    return shapes.merged(True, 1).sized(half, half, _SQUARE).merged(True, 1)


def _kept(plate: Plate) -> db.Region:
    """Written marks that stay as they are drawn."""
    kept = db.Region()
    for mark in plate.furniture:
        if mark.layer.written and not _sized(mark):
            kept += _region(mark)
    return kept.merged(True, 1)


def _sized(mark: Furniture) -> bool:
    return mark.layer.written and mark.kind in SIZED and bool(_region(mark).non_rectilinear().is_empty())


def _region(mark: Furniture) -> db.Region:
    return db.Region([db.Polygon(simple_polygon(each)) for each in mark.polygons])


def _between(clear: Mask, lines_nm: Floats, bias_nm: int) -> tuple[Mask, Floats]:
    """Columns with those between them; ``clear`` has one more on either side than the lines bound."""
    # A line along which nothing changes, such as between two halves of a gutter, would be crossed by its neighbours.
    edges = (clear[:, 1:] != clear[:, :-1]).any(axis=0)
    columns = clear[:, np.concatenate([[True], edges])]
    lines, half = lines_nm[edges], abs(bias_nm) / 2
    joined = np.logical_and if bias_nm > 0 else np.logical_or
    parts = np.empty((clear.shape[0], 2 * columns.shape[1] - 1), dtype=bool)
    parts[:, ::2] = columns
    parts[:, 1::2] = joined(columns[:, :-1], columns[:, 1:])
    return parts[:, 1:-1], np.stack([lines - half, lines + half], axis=1).ravel()
