"""Data out of which a writer's bias has been taken, so that the plate comes out as designed.

A writer whose clear widths come out wider by a bias gets clear shapes that are narrower by it: every edge is moved by
half of it, square corners stay square. Across cells too, for an opening may run on into the next cell.

Sized are the dies and :data:`SIZED` marks whose outlines run along x and y. Titles, labels, the map of the dies, stars
and marks of an extent stay as drawn: sizing has no exact way back for slanted outlines, and an extent is to be kept.
"""

from __future__ import annotations

from klayout import db

from maskfab.errors import JobError
from maskfab.geometry.plate_layout import simple_polygon
from maskfab.model import Furniture, Plate
from maskfab.units import NM_PER_UM

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
