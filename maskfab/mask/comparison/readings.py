"""A mask file as each of its readers has it alone: how much every one draws on each layer, and where.

Readings are told, not judged: :func:`maskfab.mask.formats.table.read_layout` refuses what two readers draw otherwise.
"""

from __future__ import annotations

from dataclasses import dataclass
from importlib import metadata
from pathlib import Path

from klayout import db

from maskfab.base.errors import InputError
from maskfab.mask.formats.agreement import to_nanometres
from maskfab.mask.formats.table import layout_format


@dataclass(frozen=True)
class LayerReading:
    """Shapes of one layer below one top cell, every reference followed.

    Attributes:
        shapes: polygons, boxes and paths.
        layer: its numbers, as in ``"1/0"``, or the name of one without.
        area_um2: of all of them merged.
        box_um: left, bottom, right, top.
    """

    cell: str
    layer: str
    shapes: int
    area_um2: float
    box_um: tuple[float, float, float, float]


@dataclass(frozen=True)
class Reading:
    """A file by one reader.

    Attributes:
        refused: why it reads nothing, in words; empty if it does.
    """

    reader: str
    version: str
    layers: tuple[LayerReading, ...] = ()
    refused: str = ""


def readings(path: Path, unit_um: float | None = None) -> tuple[Reading, ...]:
    """A layout by each of its readers alone; nothing of formats that are read by one.

    Args:
        unit_um: one unit of a DXF, as of :func:`maskfab.mask.formats.table.read_layout`.
    """
    form, found = layout_format(path), list[Reading]()
    for package, read in () if form is None else form.readers:
        version = metadata.version(package)
        try:
            layout = to_nanometres(read(path) if unit_um is None else read(path, unit_um))
            found.append(Reading(package, version, _layers(layout)))
        except InputError as error:
            found.append(Reading(package, version, refused=str(error)))
    return tuple(found)


def _layers(layout: db.Layout) -> tuple[LayerReading, ...]:
    store, rows = db.DeepShapeStore(), list[LayerReading]()
    for top in sorted(layout.top_cells(), key=lambda cell: str(cell.name)):
        for info in sorted(layout.layer_infos(), key=_label):
            index = layout.find_layer(info)
            if top.bbox(index).empty():
                continue
            shapes, drawn = db.Region(top.begin_shapes_rec(index), store), db.Region(top.begin_shapes_rec(index))
            drawn.merged_semantics = False
            box = shapes.bbox().to_dtype(layout.dbu)
            count, area = drawn.count(), shapes.merged().area() * layout.dbu**2
            rows.append(LayerReading(top.name, _label(info), count, area, (box.left, box.bottom, box.right, box.top)))
    return tuple(rows)


def _label(info: db.LayerInfo) -> str:
    return f"{info.layer}/{info.datatype}" if info.layer >= 0 else str(info.name)
