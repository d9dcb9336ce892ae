"""Nothing that is written on a plate may lie on a die, on another mark, or outside the writable area."""

from __future__ import annotations

from collections.abc import Sequence

from klayout import db

from maskfab.errors import JobError
from maskfab.model import Box, Die, Furniture
from maskfab.plate.marks.drawing import bounding_box, box_at
from maskfab.units import NM_PER_UM


def check_clearances(dies: Sequence[Die], furniture: Sequence[Furniture], writable_nm: int, *, where: str) -> None:
    """Compare the slots of the dies and the bounding boxes of all marks that are written.

    Raises:
        JobError: MF108 if one leaves the writable area, MF126 if two overlap.
    """
    boxes = [(f"die {die.name!r}", box_at(die.centre_nm, (die.slot_nm, die.slot_nm))) for die in dies]
    boxes += [
        (f"mark {mark.name!r}", bounding_box(mark.polygons))
        for mark in furniture
        if mark.layer.written and mark.polygons
    ]
    _check_inside(boxes, writable_nm, where)
    region = db.Region([db.Box(*box) for _, box in boxes])
    shared = region.merged(False, 2)
    if shared.is_empty():
        return
    place = next(shared.each()).bbox()
    one, other, *_ = (name for name, box in boxes if db.Box(*box).overlaps(place))
    x, y = place.left / NM_PER_UM, place.bottom / NM_PER_UM
    raise JobError(
        "MF126",
        f"{one} and {other} overlap at ({x:g}, {y:g}) um",
        where=where,
        cure="Use smaller or fewer dies, a closer die_pitch, or a larger plate",
    )


def _check_inside(boxes: Sequence[tuple[str, Box]], writable_nm: int, where: str) -> None:
    half = writable_nm // 2
    for name, (x0, y0, x1, y1) in boxes:
        over = max(-half - x0, -half - y0, x1 - half, y1 - half)
        if over > 0:
            raise JobError(
                "MF108",
                f"{name} leaves the writable area of {writable_nm / NM_PER_UM:g} um by {over / NM_PER_UM:g} um",
                where=where,
                cure="Use smaller or fewer dies, a closer die_pitch, or a larger plate",
            )
