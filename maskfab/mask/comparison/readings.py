"""A mask file as each of its readers has it alone: how much every one draws on each layer, where, and what differs.

Readings are told, not judged: :func:`maskfab.mask.formats.table.read_layout` refuses what two readers draw otherwise,
and is itself the last of the readers.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from importlib import metadata
from pathlib import Path

import numpy as np
from klayout import db

from maskfab.base import __version__
from maskfab.base.arrays import Floats
from maskfab.base.errors import InputError
from maskfab.base.units import NM_PER_UM
from maskfab.mask.formats.agreement import to_nanometres
from maskfab.mask.formats.table import layout_format, read_layout

OURS = "maskfab"
"""Reader whose answer every other verb takes: what the others agree on, or a refusal."""
_SQUARES = 480
"""Along the longer side of a view."""
_MOST_VIEWS = 6


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
    """A file by one reader; ``refused`` says why it reads nothing, empty if it does."""

    reader: str
    version: str
    layers: tuple[LayerReading, ...] = ()
    refused: str = ""


@dataclass(frozen=True, eq=False)
class View:
    """One layer below one top cell, on a grid of squares.

    Attributes:
        box_um: of the grid: left, bottom, right, top.
        drawn: share of each square that the first reader draws, [y, x], row 0 the lowest.
        unlike: share that some other reader has otherwise.
        unlike_um2: all that some other reader has otherwise.
        unlike_um: box about that, left, bottom, right, top; None where there is nothing.
        slivers: whether that is nowhere wider than two roundings.
    """

    cell: str
    layer: str
    box_um: tuple[float, float, float, float]
    drawn: Floats
    unlike: Floats
    unlike_um2: float
    unlike_um: tuple[float, float, float, float] | None
    slivers: bool


@dataclass(frozen=True, eq=False)
class Readings:
    """A file by all its readers: ``alike`` but for chords and rounding; views of layers, those that differ first."""

    readings: tuple[Reading, ...]
    alike: bool
    views: tuple[View, ...] = field(default=(), repr=False)


_Drawn = Mapping[tuple[str, str], tuple[db.Region, int]]
"""Shapes of a reader, merged, and how many these were, by top cell and layer."""


def readings(path: Path, unit_um: float | None = None) -> Readings:
    """A layout by each of its readers alone, and as maskfab takes it.

    Args:
        unit_um: one unit of a DXF, as of :func:`maskfab.mask.formats.table.read_layout`.

    Raises:
        SourceError: MF308 for a file that no reader of layouts reads, MF301 or MF302 for none or an empty one.
    """
    form, found, drawn = layout_format(path), list[Reading](), list[_Drawn]()
    if form is None or not path.is_file() or not path.stat().st_size:
        read_layout(path, unit_um)
    readers = () if form is None else form.readers
    for package, read in (*readers, (OURS, read_layout)):
        version = __version__ if package == OURS else metadata.version(package)
        try:
            shapes = _drawn(to_nanometres(read(path) if unit_um is None else read(path, unit_um)))
        except InputError as error:
            found.append(Reading(package, version, refused=str(error)))
            continue
        found.append(Reading(package, version, tuple(_told(*key, *held) for key, held in shapes.items())))
        drawn.append(shapes)
    views = sorted(_views(drawn), key=lambda view: -view.unlike_um2)
    agreed = form is not None and form.agreed
    alike = not any(each.refused for each in found) and (agreed or all(view.slivers for view in views))
    return Readings(tuple(found), alike, tuple(views[:_MOST_VIEWS]))


def _drawn(layout: db.Layout) -> _Drawn:
    store, found = db.DeepShapeStore(), dict[tuple[str, str], tuple[db.Region, int]]()
    for top in sorted(layout.top_cells(), key=lambda cell: str(cell.name)):
        for info in sorted(layout.layer_infos(), key=_label):
            index = layout.find_layer(info)
            shapes = db.Region(top.begin_shapes_rec(index))
            shapes.merged_semantics = False
            merged = db.Region()
            merged.merged_semantics = False  # it is merged already, and would be again for every question
            merged.insert(db.Region(top.begin_shapes_rec(index), store).merged())  # flat, beyond its store
            merged.transform(db.ICplxTrans(layout.dbu * NM_PER_UM))
            if not merged.is_empty():  # of texts alone, say
                found[top.name, _label(info)] = merged, shapes.count()
    return found


def _told(cell: str, layer: str, merged: db.Region, shapes: int) -> LayerReading:
    return LayerReading(cell, layer, shapes, merged.area() / NM_PER_UM**2, _box_um(merged.bbox()))


def _box_um(box: db.Box) -> tuple[float, float, float, float]:
    return tuple(side / NM_PER_UM for side in (box.left, box.bottom, box.right, box.top))


def _views(drawn: list[_Drawn]) -> Iterator[View]:
    for key in sorted(set().union(*drawn)):
        first, *others = (each[key][0] if key in each else db.Region() for each in drawn)
        unlike, shapes = db.Region(), set(first.each())
        for other in others:
            if set(other.each()) != shapes:
                unlike += first ^ other
        unlike.merge()
        box = (first + unlike).bbox()
        step = max(1, math.ceil(max(box.width(), box.height()) / _SQUARES))
        columns, rows = (math.ceil(side / step) for side in (box.width(), box.height()))
        shown, otherwise = (
            np.array(region.rasterize(box.p1, db.Vector(step, step), columns, rows)) / step**2
            for region in (first, unlike)
        )
        grid = _box_um(db.Box(box.left, box.bottom, box.left + step * columns, box.bottom + step * rows))
        about = None if unlike.is_empty() else _box_um(unlike.bbox())
        slivers = bool(unlike.sized(-1).is_empty())
        yield View(*key, grid, shown, otherwise, unlike.area() / NM_PER_UM**2, about, slivers)


def _label(info: db.LayerInfo) -> str:
    return f"{info.layer}/{info.datatype}" if info.layer >= 0 else str(info.name)
