"""Rows on how a drawing was read: its unit, what became of its entities, and how far outlines are from its own."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

from klayout import db

from maskfab.base.model import Quantity
from maskfab.base.units import NM_PER_UM
from maskfab.mask.formats.content import listed
from maskfab.mask.formats.drawing import ReadAs, drawing_notes

_MOST_VERTICES = 200_000


def drawing_quantities(layout: db.Layout, name: str) -> Iterator[Quantity]:
    """Rows of a DXF of that name: its unit (um) and numbers of entities by what they were read as; none of others."""
    notes = drawing_notes(layout)
    if notes is None:
        return
    unit = f"{notes.unit_um:g} um"
    method = f"one unit of {name} is {unit}, as {notes.unit_said_by} states"
    if not notes.unit_said_by:
        method, unit = (
            f"{name} states no unit: one is taken for {unit}; say --unit if it is another",
            f"{unit}, assumed",
        )
    yield Quantity("drawing_unit", unit, method)
    read = [one for one in notes.read_as if one.read_as]
    yield Quantity("entities_read", _count(read), f"entities of {name} that are read, {_told(read)}")
    passed = [one for one in notes.read_as if not one.read_as]
    if passed:
        method = f"entities of {name} of which a mask shows nothing, {_told(passed)}"
        yield Quantity("entities_left_out", _count(passed), method)
    if notes.faults:
        method = f"layers of {name} of which not all can be read, and nothing is computed: "
        yield Quantity("layers_not_read", len(notes.faults), method + listed([one.layer for one in notes.faults]))
    if notes.gap_nm:
        method = f"largest gap between ends of lines of {name} that were joined to outlines"
        yield Quantity("largest_gap", notes.gap_nm, method)


def parity_quantities(drawn: db.Region, name: str) -> Iterator[Quantity]:
    """Area that houses read otherwise which fill by parity, where outlines of a drawing lie within each other.

    Args:
        drawn: polygons as they are drawn, in nanometres; of too many nothing is said.
    """
    polygons = list(drawn.each())
    if not 1 < sum(polygon.num_points() for polygon in polygons) <= _MOST_VERTICES:
        return
    by_parity = db.EdgeProcessor().simple_merge_p2p(polygons, False, True, 0)
    within = drawn.merged(False, 1).area() - sum(polygon.area() for polygon in by_parity)
    if within > 0:
        method = (
            f"area within an even number of outlines of {name}, as an island in a frame, before the stop; it is read "
        )
        method += "as clear, as each outline by itself is, and who fills by parity leaves it opaque"
        yield Quantity("area_by_parity", within / NM_PER_UM**2, method)


def _count(entities: Sequence[ReadAs]) -> int:
    return sum(one.count for one in entities)


def _told(entities: Sequence[ReadAs]) -> str:
    told = [
        f"{one.count} {one.kind} on {one.layer}" + (f" as {one.read_as}" if one.read_as else "")
        for one in sorted(entities, key=lambda one: (one.layer, one.kind, one.read_as))
    ]
    return f"references followed once: {listed(told)}" if told else "of which there are none"
