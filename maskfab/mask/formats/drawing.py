"""Notes on how a drawing was read, kept with its layout: its unit, what became of its entities, and which layers hold
what no polygon can be made of."""

from __future__ import annotations

import json
from dataclasses import asdict, dataclass

from klayout import db

from maskfab.base.errors import SourceError

_KEY = "maskfab_drawing"


@dataclass(frozen=True)
class ReadAs:
    """Entities of one kind on one layer, each counted once however often placed; ``read_as`` "" if it is left out."""

    kind: str
    layer: str
    read_as: str
    count: int


@dataclass(frozen=True)
class LayerFault:
    """Reason for which a layer is refused once it is asked for: the parts of a SourceError."""

    layer: str
    code: str
    what: str
    cure: str


@dataclass(frozen=True)
class DrawingNotes:
    """Notes on one DXF.

    Attributes:
        unit_um: length of one unit of the drawing.
        unit_said_by: who states that; "" if nobody does, and it is assumed.
        gap_nm: the largest gap between ends of lines that were joined.
    """

    unit_um: float
    unit_said_by: str
    read_as: tuple[ReadAs, ...] = ()
    faults: tuple[LayerFault, ...] = ()
    gap_nm: float = 0.0


def note_drawing(layout: db.Layout, notes: DrawingNotes) -> None:
    """Keep the notes with the layout, for :func:`drawing_notes`."""
    layout.add_meta_info(db.LayoutMetaInfo(_KEY, json.dumps(asdict(notes)), "how the drawing was read"))


def drawing_notes(layout: db.Layout) -> DrawingNotes | None:
    """The notes on a DXF; None for files of other kinds."""
    kept = layout.meta_info_value(_KEY)
    if kept is None:
        return None
    told = json.loads(kept)
    read_as = tuple(ReadAs(**one) for one in told.pop("read_as"))
    faults = tuple(LayerFault(**one) for one in told.pop("faults"))
    return DrawingNotes(**told, read_as=read_as, faults=faults)


def drawn_unit_um(layout: db.Layout) -> float | None:
    """The unit that a DXF was read in; None of files of other kinds."""
    notes = drawing_notes(layout)
    return None if notes is None else notes.unit_um


def faulty_layers(layout: db.Layout) -> dict[str, LayerFault]:
    """Layers, by their names in capitals, of which not all can be read."""
    notes = drawing_notes(layout)
    return {} if notes is None else {fault.layer.upper(): fault for fault in reversed(notes.faults)}


def refuse_faulty(layout: db.Layout, info: db.LayerInfo) -> None:
    """Refuse a layer of which not all can be read. Raises SourceError MF310, MF311 or MF317."""
    fault = faulty_layers(layout).get(info.name.upper())
    if fault is not None:
        raise SourceError(fault.code, fault.what, cure=fault.cure)
