"""Content of mask files as layouts: what readers of every format share, and what is asked of a layout that was read.

What is read apart or by grammar comes as cells in arrays, and becomes a layout of klayout here; what klayout itself
reads is looked through for names that are no text. A layout that was read is asked for a cell, a layer, its unit and
its rounding.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from graphlib import CycleError, TopologicalSorter
from pathlib import Path
from typing import Any

import numpy as np
from klayout import db

from maskfab.base.arrays import Floats, Ints
from maskfab.base.errors import SourceError
from maskfab.base.model import CLEAR, LAYERS
from maskfab.mask.formats.drawing import drawing_notes, drawn_unit_um, faulty_layers, refuse_faulty
from maskfab.mask.layout import (
    DBU_UM,
    ROUNDING_KEY,
    LeftOut,
    is_empty,
    is_plain,
    layer_info,
    left_out,
    note_left_out,
    outlines_layout,
    refuse_long,
)
from maskfab.mask.sandbox import damaged

_LARGEST_NM = 2**31 - 1
_MOST_COPIES = 10_000_000
_MANY_COPIES = 64
_AT_ONCE = 10_000
_ON_GRID_NM = 1e-6
_FROM_CURVE_NM = 1.0
"""Of chords, before their ends go to the grid."""

STEP_NM = 1e-3
"""Distance of the last copy of an array from the grid that comes from a division, not from its steps."""

_DRIFT_KEY = "maskfab_drift"


def listed(names: Sequence[str], most: int = 12) -> str:
    """The first names of many."""
    return ", ".join(names[:most]) + (f" and {len(names) - most} more" if len(names) > most else "")


def note_rounding(layout: db.Layout, rounding_nm: float) -> None:
    """Keep the largest distance by which a coordinate was moved to the nanometre grid for :func:`rounding_nm`."""
    layout.add_meta_info(db.LayoutMetaInfo(ROUNDING_KEY, rounding_nm, "largest rounding to the nanometre grid"))


def rounding_nm(layout: db.Layout) -> float:
    """The largest distance by which a coordinate was moved to the nanometre grid when the layout was read."""
    return float(layout.meta_info_value(ROUNDING_KEY) or 0.0)


def array_drift(layout: db.Layout) -> tuple[float, str]:
    """Distance (nm) of the last copy of an array from a whole number of nanometres a step, the largest; and which."""
    drift, which = layout.meta_info_value(_DRIFT_KEY) or (0.0, "")
    return float(drift), str(which)


def moved_nm(layout: db.Layout) -> float:
    """Distance of an outline from the one that a file draws, at most: by rounding, by chords of what is round, and by
    gaps that were closed."""
    rounded, notes = math.sqrt(2) * rounding_nm(layout), drawing_notes(layout)
    if left_out(layout).curves:
        rounded = _FROM_CURVE_NM + max(rounded, math.sqrt(0.5))
    return rounded + (0.0 if notes is None else notes.gap_nm)


def find_cell(layout: db.Layout, cell: str | None = None) -> db.Cell:
    """The cell of that name, or the only top cell.

    Raises:
        SourceError: MF305 if no cell is named and there is more than one top cell, MF307 if there is no such cell,
            MF309 if the layout has no cell at all.
    """
    tops = sorted(top.name for top in layout.top_cells())
    if not tops:
        raise SourceError("MF309", "the layout has no cell", cure="Export it again with at least one cell")
    if cell is None:
        if len(tops) > 1:
            what = f"the layout has {len(tops)} top cells: {listed(tops)}"
            raise SourceError("MF305", what, cure="Give --cell one of these")
        return layout.top_cell()
    named = layout.cell(cell)
    if named is None:
        raise SourceError("MF307", f"no cell {cell!r}; top cells: {listed(tops)}", cure="Give --cell one of these")
    return named


def find_layer(layout: db.Layout, layer: str | None = None) -> db.LayerInfo:
    """The layer that is meant by ``"1/0"``, ``"1"`` (datatype 0) or a DXF layer's name.

    None stands for 1/0, or CLEAR in DXF, if that holds shapes, and else for the only layer that does. Names of DXF are
    the same in capitals and small letters.

    Raises:
        SourceError: MF306, with the layers that are there, if the layer is not or if None could mean several; MF310,
            MF311 or MF317 for one of a drawing of which not all can be read.
    """
    info = _found_layer(layout, layer)
    refuse_faulty(layout, info)
    return info


def _found_layer(layout: db.Layout, layer: str | None) -> db.LayerInfo:
    faulty = faulty_layers(layout)
    used = [
        info
        for info in sorted(layout.layer_infos(), key=layer_label)
        if has_shapes(layout, info) or info.name.upper() in faulty
    ]
    there = listed([layer_label(info) for info in used]) or "none with shapes"
    if layer is None:
        clear = layer_info(CLEAR)
        usual = [info for info in used if info.is_equivalent(clear)]
        if usual or len(used) == 1:
            return (usual or used)[0]
        what = f"the layout has no layer {layer_label(clear)}; layers: {there}"
        raise SourceError("MF306", what, cure="Give --layer one of these")
    drawn = drawn_unit_um(layout) is not None
    for info in layout.layer_infos():
        if layer in layer_names(info) or (drawn and layer.upper() == info.name.upper()):
            return info
    raise SourceError("MF306", f"the layout has no layer {layer!r}; layers: {there}", cure="Give --layer one of these")


def layer_names(info: db.LayerInfo) -> set[str]:
    """All that a layer may be called: its name, its numbers, and its number alone if its datatype is 0."""
    names = {info.name} if info.name else set()
    if info.layer >= 0:
        names.add(f"{info.layer}/{info.datatype}")
        if info.datatype == 0:
            names.add(str(info.layer))
    return names


def layer_label(info: db.LayerInfo) -> str:
    """Numbers and name of a layer, as far as it has them."""
    numbers = f"{info.layer}/{info.datatype}" if info.layer >= 0 else ""
    return " ".join(part for part in (numbers, info.name) if part)


def has_shapes(layout: db.Layout, info: db.LayerInfo) -> bool:
    """Whether anything lies on a layer, in whatever cell."""
    index = layout.find_layer(info)
    return any(not cell.shapes(index).is_empty() for cell in layout.each_cell())


def read_with_klayout(path: Path, options: db.LoadLayoutOptions, content: bytes | None = None) -> db.Layout:
    """The file, or in its place the content that is left of it."""
    options.warn_level = 0
    layout = db.Layout()
    try:
        if content is None:
            layout.read(str(path), options)
        else:
            layout.read_bytes(content, options)
        # Names that are no text cannot be had, and would stop whoever asks later.
        for named in (*layout.layer_infos(), *layout.each_cell()):
            str(named.name)
    except (RuntimeError, UnicodeDecodeError) as error:
        no_text = isinstance(error, UnicodeDecodeError) or "UnicodeDecodeError" in str(error)
        reason = "a name in it is no text" if no_text else str(error).split(", in file")[0]
        raise damaged(path, reason) from error
    return layout


def number_layers(layout: db.Layout) -> None:
    """Give layers that have the name of one of the plate's, in whatever letters, and no more, its numbers."""
    plate = {layer.name: layer for layer in LAYERS}
    for info in layout.layer_infos():
        if info.is_named() and info.name.upper() in plate:
            layout.set_info(layout.find_layer(info), layer_info(plate[info.name.upper()]))


class Conversion:
    """The content of a file (see :mod:`maskfab.mask.formats.gdstk_process`) as a klayout layout."""

    def __init__(self, path: Path, named: Sequence[db.LayerInfo] = ()) -> None:
        """``named`` are the layers of a format without numbers: the content has their places, and datatypes 0."""
        self._path = path
        self._rounding = 0.0
        self._drift = 0.0, ""
        self._copies = 0
        self._repeated_vertices = 0
        self._empty_polygons = 0
        self._layout = db.Layout()
        self._layout.dbu = DBU_UM
        self._layers: dict[tuple[int, int], int] = {
            (layer.number, layer.datatype): self._layout.layer(layer_info(layer)) for layer in LAYERS
        }
        self._layers |= {(place, 0): self._layout.layer(info) for place, info in enumerate(named)}
        self._cells: dict[str, db.Cell] = {}
        self.repeated: set[int] = set()
        """Cells that hold one shape of the cell which places them."""

    def layout(self, content: list[dict[str, Any]]) -> db.Layout:
        for cell in content:
            if cell["name"] in self._cells:
                raise damaged(self._path, f"it has two cells {cell['name']!r}")
            self._cells[cell["name"]] = self._layout.create_cell(cell["name"])
        self._refuse_cycles(content)
        for cell in content:
            self._fill(cell, self._cells[cell["name"]])
        note_rounding(self._layout, self._rounding)
        note_left_out(self._layout, LeftOut(self._repeated_vertices, self._empty_polygons))
        self._layout.add_meta_info(db.LayoutMetaInfo(_DRIFT_KEY, list(self._drift), "steps of arrays off the grid"))
        return self._layout

    def _refuse_cycles(self, content: list[dict[str, Any]]) -> None:
        graph = {cell["name"]: {reference[0] for reference in cell["references"]} for cell in content}
        lacking = sorted(set().union(*graph.values()) - graph.keys())
        if lacking:
            raise damaged(self._path, f"it places cells that it lacks: {listed(lacking)}")
        try:
            TopologicalSorter(graph).prepare()
        except CycleError as error:
            raise damaged(self._path, f"cell {error.args[1][0]!r} contains itself") from error

    def _fill(self, source: dict[str, Any], target: db.Cell) -> None:
        # Many vertices and all origins in one array each: a flat die has a million polygons, a random one ten thousand
        # references.
        polygons = source["polygons"]
        refuse_long(int(polygons["sizes"].max(initial=0)), self._path)
        ends = np.cumsum(polygons["sizes"])
        for start in range(0, len(ends), _AT_ONCE):
            self._draw(source["name"], polygons, ends, range(start, min(start + _AT_ONCE, len(ends))), target)
        for text, origin, layer, texttype, repetition in source["labels"]:
            ((x, y),) = self._integers(np.array([origin]))
            shapes = target.shapes(self._layer(layer, texttype))
            for dx, dy in self._offsets(repetition):
                shapes.insert(db.Text(text, db.Trans(x + dx, y + dy)))
        references = source["references"]
        origins = self._integers(np.array([reference[1] for reference in references]).reshape(-1, 2))
        for reference, (x, y) in zip(references, origins, strict=True):
            for instance in self._instances(reference, x, y):
                target.insert(instance)

    def _draw(self, name: str, polygons: dict[str, Any], ends: Ints, which: range, target: db.Cell) -> None:
        """Draw polygons of those numbers, of which the corners of each end before ``ends`` in the array of all."""
        sizes = polygons["sizes"][which.start : which.stop]
        corners = self._on_grid(polygons["corners"][ends[which.start] - sizes[0] : ends[which.stop - 1]])
        at_once = is_plain(corners, sizes)
        at_once[[entry - which.start for entry in polygons["repetitions"] if entry in which]] = False
        number, datatype = polygons["layers"][which.start : which.stop].astype(np.uint64).T
        layers, owners = np.unique(number << 32 | datatype, return_inverse=True)
        indices = [self._layer(*divmod(entry, 1 << 32)) for entry in layers.tolist()]
        drawing = outlines_layout(corners[np.repeat(at_once, sizes)], sizes[at_once], owners[at_once])
        for info in drawing.layer_infos():
            target.shapes(indices[info.layer]).insert(drawing.top_cell().shapes(drawing.find_layer(info)))
        stops = np.cumsum(sizes)
        for k in np.flatnonzero(~at_once).tolist():
            own = corners[stops[k] - sizes[k] : stops[k]]
            self._draw_one(name, own, indices[owners[k]], polygons["repetitions"].get(which.start + k), target)

    def _draw_one(self, name: str, corners: Ints, layer: int, repetition: Any, target: db.Cell) -> None:
        shape = db.Polygon([db.Point(x, y) for x, y in corners.tolist()])
        if shape.num_points() < len(corners):
            self._repeated_vertices += int((corners == np.roll(corners, 1, axis=0)).all(1).sum())
        if is_empty(shape):
            self._empty_polygons += 1
        elif isinstance(repetition, tuple) and repetition[0] * repetition[1] > _MANY_COPIES:
            # One placement of a cell of its own instead of as many polygons.
            repeated = self._layout.create_cell(f"{name}_REPEATED")
            self.repeated.add(repeated.cell_index())
            repeated.shapes(layer).insert(shape)
            for placed in self._array(repeated.cell_index(), db.Trans(), repetition):
                target.insert(placed)
        else:
            for dx, dy in self._offsets(repetition):
                target.shapes(layer).insert(shape.moved(dx, dy) if dx or dy else shape)

    def _layer(self, number: int, datatype: int) -> int:
        key = number, datatype
        if key not in self._layers:
            self._layers[key] = self._layout.layer(number, datatype)
        return self._layers[key]

    def _instances(self, reference: tuple[Any, ...], x: int, y: int) -> Iterator[db.CellInstArray]:
        name, _, radians, magnification, mirrored, repetition = reference
        index = self._cells[name].cell_index()
        quarters = radians / (math.pi / 2)
        straight = magnification == 1.0 and abs(quarters - round(quarters)) < 1e-9
        if straight:
            turn: Any = db.Trans(round(quarters) % 4, mirrored, x, y)
        else:
            turn = db.ICplxTrans(magnification, math.degrees(radians), mirrored, x, y)
        if repetition is None:
            yield db.CellInstArray(index, turn)
        elif isinstance(repetition, tuple):
            yield from self._array(index, turn, repetition, reference[1])
        else:
            for dx, dy in self._offsets(repetition):
                yield db.CellInstArray(index, (db.Trans if straight else db.ICplxTrans)(dx, dy) * turn)

    def _array(
        self, index: int, turn: Any, repetition: tuple[Any, ...], origin: Sequence[float] = (0.0, 0.0)
    ) -> Iterator[db.CellInstArray]:
        """Copies of a cell; one by one, each on its own place, along steps off the grid, whose rounding would add up.

        So too where there is no step: klayout would take the copies that lie on each other for one.
        """
        places, steps = np.array([origin], dtype=np.float64), [(db.Vector(), 1)]
        for times, step in zip(repetition[:2], repetition[2], strict=True):
            nearest = np.rint(step)
            astray = (times - 1) * float(np.abs(step - nearest).max())
            if astray > STEP_NM:
                which = f"copy {times} of cell {self._layout.cell_name(index)} in an array"
                self._drift = max(self._drift, (astray, which))
            if times > 1 and (not nearest.any() or astray > STEP_NM):
                self._count_copies(times * len(places))
                places = (places[:, None] + np.arange(times)[:, None] * step).reshape(-1, 2)
            elif times > 1:
                steps.append((db.Vector(*self._integers(step)), times))
        at = turn.disp
        for x, y in self._integers(places) if len(places) > 1 else [[at.x, at.y]]:
            placed = type(turn)(x - at.x, y - at.y) * turn
            (a, columns), (b, rows) = steps[-2:] if len(steps) > 1 else (steps[0], steps[0])
            yield db.CellInstArray(index, placed, a, b, columns, rows)

    def _offsets(self, repetition: Any) -> list[list[int]]:
        if repetition is None:
            return [[0, 0]]
        if isinstance(repetition, tuple):
            columns, rows, vectors = repetition
            self._count_copies(columns * rows)
            repetition = np.mgrid[0:columns, 0:rows].reshape(2, -1).T @ vectors
        else:
            self._count_copies(len(repetition))
        return self._integers(repetition)

    def _count_copies(self, count: int) -> None:
        self._copies += count
        if self._copies > _MOST_COPIES:
            what = f"{self._path.name} repeats single shapes over {_MOST_COPIES} times"
            raise SourceError("MF313", what, where=str(self._path), cure="Repeat cells instead of shapes")

    def _integers(self, values: Floats) -> list[Any]:
        integers: list[Any] = self._on_grid(values).tolist()
        return integers

    def _on_grid(self, values: Floats) -> Ints:
        """The values on the nanometre grid."""
        if not (np.abs(values) <= _LARGEST_NM).all():  # NaN included
            raise damaged(self._path, "a coordinate lies beyond 2.1 m")
        nearest = np.rint(values)
        rounding = float(np.abs(values - nearest).max(initial=0.0))
        if rounding > _ON_GRID_NM:
            self._rounding = max(self._rounding, rounding)
        return nearest.astype(np.int64)
