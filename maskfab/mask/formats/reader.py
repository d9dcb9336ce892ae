"""Mask files read back through a library that did not write them.

GDSII and OASIS are written by klayout, so gdstk reads them; DXF is written by ezdxf, so klayout reads it; Gerber is
read by gerbonara; CIF is read twice, by :mod:`maskfab.mask.formats.cif` and by klayout, which must agree. Whichever it
is, the answer is a hierarchical klayout layout in nanometres. Pictures of masks have a module of their own,
:mod:`maskfab.mask.formats.picture`, for they need to be told how large a pixel is.
"""

from __future__ import annotations

import math
import os
import re
from collections.abc import Callable, Iterator, Sequence
from graphlib import CycleError, TopologicalSorter
from pathlib import Path
from typing import Any

import numpy as np
from klayout import db
from numpy.typing import NDArray

from maskfab.base.errors import JobError, SourceError
from maskfab.base.model import CLEAR, LAYERS
from maskfab.base.units import UM_PER_INCH, UM_PER_UNIT
from maskfab.mask.formats.cif import LABEL, LayerKey, cif_content
from maskfab.mask.formats.dxf_entities import POLYLINE_MODE, close_lines, look_through
from maskfab.mask.formats.gdsii import refuse_many_blocks, refuse_many_in_gdsii
from maskfab.mask.formats.gdstk_process import CellArrays, cell_content
from maskfab.mask.formats.gerber import read_gerber
from maskfab.mask.formats.picture import IMAGE_SUFFIXES
from maskfab.mask.layout import (
    DBU_UM,
    ROUNDING_KEY,
    LeftOut,
    check_limits,
    check_size,
    count_shapes,
    is_empty,
    is_plain,
    layer_info,
    left_out,
    note_left_out,
    outlines_layout,
    refuse_long,
)
from maskfab.mask.sandbox import PATIENCE_S, read_apart, unusable

_LARGEST_NM = 2**31 - 1
_MOST_COPIES = 10_000_000
_MANY_COPIES = 64
_AT_ONCE = 10_000
_BYTES_PER_SECOND = 3e4
_ON_GRID_NM = 1e-6
_CYCLE = "topological_sort"
_UNIT_KEY = "maskfab_unit_um"

# $INSUNITS to micrometres (DXF reference, HEADER section); 0 stands for no unit.
_UM_PER_DXF_UNIT = {
    2: 12 * UM_PER_INCH,
    8: 0.0254,
    14: 1e5,
    **{
        code: UM_PER_UNIT[unit]
        for code, unit in {1: "in", 4: "mm", 5: "cm", 6: "m", 9: "mil", 12: "nm", 13: "um"}.items()
    },
}
"""Micrometres of $INSUNITS: feet, microinches and decimetres besides units that have a name here."""

_GDSII_MAGIC = b"\x00\x06\x00\x02"
_OASIS_MAGIC = b"%SEMI-OASIS\r\n"
# Comments (group 999) may come before the first section.
_TEXT_DXF_START = re.compile(rb"(?:\xef\xbb\xbf)?(?:\s*999[ \t]*\r?\n[^\n]*\n)*\s*0\s*\r?\n\s*SECTION\s*\r?\n")
# R12 has no unit; a drawing of maskfab's own says it in its first comment.
_DRAWN_IN_MM = re.compile(rb"\s*999[ \t]*\r?\nUnits: 1 drawing unit = 1 millimetre\r?\n")
_BINARY_DXF_MAGIC = b"AutoCAD Binary DXF"
_CIF_LABEL = re.compile(rf";\s*{LABEL.pattern};".encode())
_SHAPES_ALONE = db.LayoutDiff.BoxesAsPolygons | db.LayoutDiff.NoLayerNames | db.LayoutDiff.NoProperties


def read_layout(path: Path, unit_um: float | None = None) -> db.Layout:
    """A mask file as a hierarchical layout; database unit 1 nm, layers of the plate under their numbers and names.

    Coordinates off the nanometre grid are rounded, and the largest rounding is kept for :func:`rounding_nm`. The unit
    of a DXF is kept for :func:`drawn_unit_um`.

    Args:
        path: ``.gds .gdsii .gds2 .oas .oasis .cif .dxf .gbr .ger``.
        unit_um: one unit of a DXF; what $INSUNITS says if None, and one micrometre if that says nothing.

    Raises:
        JobError: MF105 a unit is stated for a file that states its own.
        SourceError: MF301 missing, MF302 empty, MF303 truncated or damaged, MF304 not what its suffix says,
            MF308 of a kind that is not read, MF310 and MF311 drawn with open lines or curves, MF312 a polygon that
            crosses itself, MF313 too large, MF315 a command of Gerber or CIF that is not read, MF316 too slow to read,
            MF317 a DXF that draws out of sight.
    """
    if unit_um is not None and path.suffix.lower() != ".dxf":
        raise JobError(
            "MF105",
            f"{path.name} is not a DXF; only the unit of a DXF can be stated",
            where="--unit",
            cure="Leave out --unit: other formats state their own",
        )
    reader = _READERS.get(path.suffix.lower())
    if reader is None:
        raise SourceError(
            "MF308",
            f"{path.name} has the suffix {path.suffix!r}; maskfab reads {' '.join((*_READERS, *IMAGE_SUFFIXES))}",
            where=str(path),
            cure="Convert it to GDSII, OASIS, DXF, Gerber, CIF or a picture",
        )
    if not os.path.isfile(path):
        raise SourceError(
            "MF301", f"there is no file {path.name}", where=str(path), cure="Give the path of an existing file"
        )
    if path.stat().st_size == 0:
        raise SourceError("MF302", f"{path.name} holds 0 bytes", where=str(path), cure="Export or copy the file again")
    if path.suffix.lower() == ".dxf":
        return _read_dxf(path, unit_um)
    layout = reader(path)
    check_limits(layout, path)
    return layout


def rounding_nm(layout: db.Layout) -> float:
    """The largest distance by which a coordinate was moved to the nanometre grid when the layout was read."""
    return float(layout.meta_info_value(ROUNDING_KEY) or 0.0)


def drawn_unit_um(layout: db.Layout) -> float | None:
    """The unit that a DXF was read in; None of files of other kinds."""
    stated = layout.meta_info_value(_UNIT_KEY)
    return None if stated is None else float(stated)


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
            raise SourceError(
                "MF305", f"the layout has {len(tops)} top cells: {_listed(tops)}", cure="Give --cell one of these"
            )
        return layout.top_cell()
    found = layout.cell(cell)
    if found is None:
        raise SourceError("MF307", f"no cell {cell!r}; top cells: {_listed(tops)}", cure="Give --cell one of these")
    return found


def find_layer(layout: db.Layout, layer: str | None = None) -> db.LayerInfo:
    """The layer that is meant by ``"1/0"``, ``"1"`` (datatype 0) or a DXF layer's name.

    None stands for 1/0, or CLEAR in DXF, if that holds shapes, and else for the only layer that does.

    Raises:
        SourceError: MF306, with the layers that are there, if the layer is not or if None could mean several.
    """
    used = [info for info in sorted(layout.layer_infos(), key=layer_label) if _has_shapes(layout, info)]
    there = _listed([layer_label(info) for info in used]) or "none with shapes"
    if layer is None:
        clear = layer_info(CLEAR)
        usual = [info for info in used if info.is_equivalent(clear)]
        if usual or len(used) == 1:
            return (usual or used)[0]
        raise SourceError(
            "MF306", f"the layout has no layer {layer_label(clear)}; layers: {there}", cure="Give --layer one of these"
        )
    for info in layout.layer_infos():
        if layer in layer_names(info):
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


def _has_shapes(layout: db.Layout, info: db.LayerInfo) -> bool:
    index = layout.find_layer(info)
    return any(not cell.shapes(index).is_empty() for cell in layout.each_cell())


def _listed(names: list[str], most: int = 12) -> str:
    return ", ".join(names[:most]) + (f" and {len(names) - most} more" if len(names) > most else "")


def _damaged(path: Path, what: str) -> SourceError:
    return SourceError("MF303", f"{path.name}: {what}", where=str(path), cure="Write or copy it again")


def _wrong_kind(path: Path, kind: str) -> SourceError:
    return SourceError("MF304", f"{path.name} is not a {kind} file", where=str(path), cure="Give it its true suffix")


def _first_bytes(path: Path, count: int) -> bytes:
    with path.open("rb") as file:
        return file.read(count)


# --- GDSII and OASIS -----------------------------------------------------------------------------------------------


def _read_gdsii(path: Path) -> db.Layout:
    if _first_bytes(path, 4) != _GDSII_MAGIC:
        raise _wrong_kind(path, "GDSII")
    refuse_many_in_gdsii(path)
    return _through_gdstk(path, "read_gds")


def _read_oasis(path: Path) -> db.Layout:
    if _first_bytes(path, len(_OASIS_MAGIC)) != _OASIS_MAGIC:
        raise _wrong_kind(path, "OASIS")
    return _through_gdstk(path, "read_oas")


def _through_gdstk(path: Path, function: str) -> db.Layout:
    # gdstk takes truncated files for whole ones and dies of some damaged ones. So klayout, which raises, looks first,
    # and gdstk reads in a process of its own, where a warning is a failure too: it means that something is left out.
    # A few bytes of OASIS can make klayout fill all memory with copies of one shape: there the process looks first.
    # Which cells contain themselves klayout does not say: there gdstk goes on, and they are found in its answer.
    first = None
    if function != "read_oas":
        try:
            first = count_shapes(_checked_by_klayout(path))
        except SourceError as error:
            if _CYCLE not in error.what:
                raise
    seconds = PATIENCE_S + path.stat().st_size / _BYTES_PER_SECOND
    content = _read_cells(path, function, seconds)
    try:
        second = _Conversion(path).layout(content)
    except (TypeError, ValueError, OverflowError, RuntimeError) as error:
        # Text that is none and numbers that fit no integer pass gdstk.
        raise _damaged(path, f"it holds values that cannot be used ({error})") from error
    shapes = count_shapes(_checked_by_klayout(path)) if first is None else first, count_shapes(second)
    # Each reader leaves out records that the other knows, and only klayout drops polygons without area.
    if shapes[0] != shapes[1] and not left_out(second).empty_polygons:
        raise SourceError(
            "MF316",
            f"{path.name} holds {shapes[0]} shapes for klayout and {shapes[1]} for gdstk",
            where=str(path),
            cure="Write it with boundaries and paths only",
        )
    return second


def _read_cells(path: Path, function: str, seconds: float) -> list[dict[str, Any]]:
    script = Path(__file__).with_name("gdstk_process.py")
    found = read_apart(path, script, function, kind=tuple[CellArrays, ...], seconds=seconds)
    try:
        return [cell_content(each) for each in found]
    except ValueError as error:
        raise unusable(path, error) from error


def _checked_by_klayout(path: Path) -> db.Layout:
    layout = _read_with_klayout(path, db.LoadLayoutOptions())
    check_size(layout, path)
    return layout


def _read_with_klayout(path: Path, options: db.LoadLayoutOptions, content: bytes | None = None) -> db.Layout:
    """The file, or in its place the content that is left of it."""
    options.warn_level = 0
    layout = db.Layout()
    try:
        if content is None:
            layout.read(str(path), options)
        else:
            layout.read_bytes(content, options)
        _look_at_names(layout)
    except (RuntimeError, UnicodeDecodeError) as error:
        no_text = isinstance(error, UnicodeDecodeError) or "UnicodeDecodeError" in str(error)
        reason = "a name in it is no text" if no_text else str(error).split(", in file")[0]
        raise _damaged(path, reason) from error
    return layout


def _look_at_names(layout: db.Layout) -> None:
    """Ask for every name once: those that are no text cannot be had, and would stop whoever asks later."""
    for info in layout.layer_infos():
        str(info.name)
    for cell in layout.each_cell():
        str(cell.name)


class _Conversion:
    """The content of a file (see :mod:`maskfab.mask.formats.gdstk_process`) as a klayout layout."""

    def __init__(self, path: Path, named: Sequence[db.LayerInfo] = ()) -> None:
        """``named`` are the layers of a format without numbers: the content has their places, and datatypes 0."""
        self._path = path
        self._rounding = 0.0
        self._copies = 0
        self._repeated_vertices = 0
        self._empty_polygons = 0
        self._layout = db.Layout()
        self._layout.dbu = DBU_UM
        self._layers: dict[tuple[int, int], int] = {
            (each.number, each.datatype): self._layout.layer(layer_info(each)) for each in LAYERS
        }
        self._layers |= {(place, 0): self._layout.layer(info) for place, info in enumerate(named)}
        self._cells: dict[str, db.Cell] = {}

    def layout(self, content: list[dict[str, Any]]) -> db.Layout:
        for cell in content:
            if cell["name"] in self._cells:
                raise _damaged(self._path, f"it has two cells {cell['name']!r}")
            self._cells[cell["name"]] = self._layout.create_cell(cell["name"])
        self._refuse_cycles(content)
        for cell in content:
            self._fill(cell, self._cells[cell["name"]])
        info = db.LayoutMetaInfo(ROUNDING_KEY, self._rounding, "largest rounding to the nanometre grid")
        self._layout.add_meta_info(info)
        note_left_out(self._layout, LeftOut(self._repeated_vertices, self._empty_polygons))
        return self._layout

    def _refuse_cycles(self, content: list[dict[str, Any]]) -> None:
        graph = {cell["name"]: {reference[0] for reference in cell["references"]} for cell in content}
        lacking = sorted(set().union(*graph.values()) - graph.keys())
        if lacking:
            raise _damaged(self._path, f"it places cells that it lacks: {_listed(lacking)}")
        try:
            TopologicalSorter(graph).prepare()
        except CycleError as error:
            raise _damaged(self._path, f"cell {error.args[1][0]!r} contains itself") from error

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

    def _draw(
        self, name: str, polygons: dict[str, Any], ends: NDArray[np.int64], which: range, target: db.Cell
    ) -> None:
        """Draw polygons of those numbers, of which the corners of each end before ``ends`` in the array of all."""
        sizes = polygons["sizes"][which.start : which.stop]
        corners = self._on_grid(polygons["corners"][ends[which.start] - sizes[0] : ends[which.stop - 1]])
        at_once = is_plain(corners, sizes)
        at_once[[each - which.start for each in polygons["repetitions"] if each in which]] = False
        number, datatype = polygons["layers"][which.start : which.stop].astype(np.uint64).T
        layers, owners = np.unique(number << 32 | datatype, return_inverse=True)
        indices = [self._layer(*divmod(each, 1 << 32)) for each in layers.tolist()]
        drawing = outlines_layout(corners[np.repeat(at_once, sizes)], sizes[at_once], owners[at_once])
        for info in drawing.layer_infos():
            target.shapes(indices[info.layer]).insert(drawing.top_cell().shapes(drawing.find_layer(info)))
        stops = np.cumsum(sizes)
        for k in np.flatnonzero(~at_once).tolist():
            own = corners[stops[k] - sizes[k] : stops[k]]
            self._draw_one(name, own, indices[owners[k]], polygons["repetitions"].get(which.start + k), target)

    def _draw_one(self, name: str, corners: NDArray[np.int64], layer: int, repetition: Any, target: db.Cell) -> None:
        shape = db.Polygon([db.Point(x, y) for x, y in corners.tolist()])
        if shape.num_points() < len(corners):
            self._repeated_vertices += int((corners == np.roll(corners, 1, axis=0)).all(1).sum())
        if is_empty(shape):
            self._empty_polygons += 1
        elif isinstance(repetition, tuple) and repetition[0] * repetition[1] > _MANY_COPIES:
            # One placement of a cell of its own instead of as many polygons.
            repeated = self._layout.create_cell(f"{name}_REPEATED")
            repeated.shapes(layer).insert(shape)
            target.insert(self._array(repeated.cell_index(), db.Trans(), repetition))
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
            yield self._array(index, turn, repetition)
        else:
            for dx, dy in self._offsets(repetition):
                yield db.CellInstArray(index, (db.Trans if straight else db.ICplxTrans)(dx, dy) * turn)

    def _array(self, index: int, turn: Any, repetition: tuple[Any, ...]) -> db.CellInstArray:
        self._refuse_standing(repetition)
        columns, rows, vectors = repetition
        a, b = self._integers(vectors)
        return db.CellInstArray(index, turn, db.Vector(*a), db.Vector(*b), columns, rows)

    def _refuse_standing(self, repetition: tuple[Any, ...]) -> None:
        """klayout takes copies that lie on each other for one, where there is no step between them."""
        columns, rows, vectors = repetition
        moves = np.rint(vectors).any(axis=1)
        if (columns > 1 and not moves[0]) or (rows > 1 and not moves[1]):
            raise SourceError(
                "MF316",
                f"{self._path.name} has an array of {columns} x {rows} with steps of 0 nm: some readers take its "
                "copies for one",
                where=str(self._path),
                cure="Place each copy once, at its own position",
            )

    def _offsets(self, repetition: Any) -> list[list[int]]:
        if repetition is None:
            return [[0, 0]]
        if isinstance(repetition, tuple):
            self._refuse_standing(repetition)
            columns, rows, vectors = repetition
            self._count_copies(columns * rows)
            repetition = np.mgrid[0:columns, 0:rows].reshape(2, -1).T @ vectors
        else:
            self._count_copies(len(repetition))
        return self._integers(repetition)

    def _count_copies(self, count: int) -> None:
        self._copies += count
        if self._copies > _MOST_COPIES:
            raise SourceError(
                "MF313",
                f"{self._path.name} repeats single shapes over {_MOST_COPIES} times",
                where=str(self._path),
                cure="Repeat cells instead of shapes",
            )

    def _integers(self, values: NDArray[np.float64]) -> list[list[int]]:
        integers: list[list[int]] = self._on_grid(values).tolist()
        return integers

    def _on_grid(self, values: NDArray[np.float64]) -> NDArray[np.int64]:
        """The values on the nanometre grid."""
        if not (np.abs(values) <= _LARGEST_NM).all():  # NaN included
            raise _damaged(self._path, "a coordinate lies beyond 2.1 m")
        nearest = np.rint(values)
        rounding = float(np.abs(values - nearest).max(initial=0.0))
        if rounding > _ON_GRID_NM:
            self._rounding = max(self._rounding, rounding)
        return nearest.astype(np.int64)


# --- CIF -----------------------------------------------------------------------------------------------------------


def _read_cif(path: Path) -> db.Layout:
    # klayout passes over what it does not know, over calls of symbols that are not there and over the place of a call
    # that stands alone; and it ends the process where symbols contain themselves. So the grammar comes first.
    content = cif_content(path)
    conversion = _Conversion(path, [_cif_layer(key) for key in content.layers])
    by_grammar = conversion.layout(content.cells)
    options = db.LoadLayoutOptions()
    options.cif_dbu = DBU_UM
    by_klayout = _read_with_klayout(path, options, re.sub(_CIF_LABEL, b";", path.read_bytes()))
    _number_layers(by_klayout)
    for info in by_grammar.layer_infos():
        by_klayout.layer(info)
    # Off the grid each rounds in a way of its own, and klayout keeps polygons without area.
    exact = not rounding_nm(by_grammar) and not left_out(by_grammar).empty_polygons
    if exact and not db.LayoutDiff().compare(by_grammar, by_klayout, _SHAPES_ALONE):
        raise SourceError(
            "MF316",
            f"{path.name} shows other polygons to klayout than its grammar says",
            where=str(path),
            cure="Write it with plain polygons, and call one symbol outside of all others, unmoved",
        )
    return by_grammar


def _cif_layer(key: LayerKey) -> db.LayerInfo:
    ours = (
        each for each in LAYERS if key.name == each.name or (key.number, key.datatype) == (each.number, each.datatype)
    )
    layer = next(ours, None)
    if layer is not None:
        return layer_info(layer)
    return db.LayerInfo(key.name) if key.name else db.LayerInfo(key.number, key.datatype)


# --- DXF -----------------------------------------------------------------------------------------------------------


def _read_dxf(path: Path, unit_um: float | None = None) -> db.Layout:
    data = path.read_bytes()
    said = _checked_dxf_unit(path, data)
    refuse_many_blocks(path, data)
    if unit_um is None:
        if said and said not in _UM_PER_DXF_UNIT:
            what = f"{path.name} is drawn in unit {said} of $INSUNITS"
            raise SourceError("MF308", what, where=str(path), cure="Draw it in mm or um, or state its --unit")
        unit_um = _UM_PER_DXF_UNIT.get(said, 1.0)
    drawn = look_through(path, data, unit_um / DBU_UM)
    options = db.LoadLayoutOptions()
    options.dxf_dbu = DBU_UM
    options.dxf_unit = unit_um
    options.dxf_polyline_mode = POLYLINE_MODE
    in_units = f"is read in units of {unit_um:g} um"
    try:
        layout = _read_with_klayout(path, options)
    except SourceError as error:
        if "overflow" not in error.what:
            raise
        raise SourceError(
            "MF313", f"{path.name} reaches beyond 2.1 m", where=str(path), cure=f"State its --unit: it {in_units}"
        ) from error
    if any(not info.name and info.layer < 0 for info in layout.layer_infos()):
        raise _damaged(path, "something in it is drawn on no layer")
    close_lines(layout)
    empty = _drop_empty(layout)
    if empty and count_shapes(layout) == 0:
        raise SourceError(
            "MF309",
            f"{path.name}: none of its {empty} polygons has an area once they are rounded to the nanometre",
            where=str(path),
            cure=f"State its --unit: it {in_units}",
        )
    _number_layers(layout)
    try:
        check_limits(layout, path)
    except SourceError as error:
        if error.code == "MF312" and drawn.rounding_nm == 0:
            raise
        # Too large, or crossing itself once it is rounded to the grid: that is what a wrong unit looks like.
        cure = f"{error.cure}, or state its --unit: it {in_units}"
        raise SourceError(error.code, error.what, where=error.where, cure=cure) from None
    layout.add_meta_info(db.LayoutMetaInfo(_UNIT_KEY, unit_um, "length of one unit of the drawing"))
    info = db.LayoutMetaInfo(ROUNDING_KEY, drawn.rounding_nm, "largest rounding to the nanometre grid")
    layout.add_meta_info(info)
    note_left_out(layout, LeftOut(drawn.repeated_vertices, empty))
    return layout


def _number_layers(layout: db.Layout) -> None:
    """Give layers that have the name of one of the plate's, and no more, its numbers."""
    for layer in LAYERS:
        index = layout.find_layer(db.LayerInfo(layer.name))
        if index is not None:
            layout.set_info(index, layer_info(layer))


def _drop_empty(layout: db.Layout) -> int:
    """Take polygons without area out, and count them."""
    dropped = 0
    for layer in layout.layer_indexes():
        for cell in layout.each_cell():
            shapes = cell.shapes(layer)
            flat = [each for each in shapes.each(db.Shapes.SPolygons) if each.area() == 0]
            for shape in [each for each in flat if is_empty(each.polygon)]:
                shapes.erase(shape)
                dropped += 1
    return dropped


def _checked_dxf_unit(path: Path, data: bytes) -> int:
    """$INSUNITS, 0 if the file does not say, of a text DXF that begins with a section and ends with EOF."""
    if data.startswith(_BINARY_DXF_MAGIC):
        raise SourceError("MF308", f"{path.name} is binary DXF", where=str(path), cure="Save it as text DXF")
    if not _TEXT_DXF_START.match(data):
        raise _wrong_kind(path, "DXF")
    if data[-64:].split()[-2:] != [b"0", b"EOF"]:
        raise _damaged(path, "it ends without EOF")
    header = data[: data.find(b"ENDSEC")]
    said = re.search(rb"\$INSUNITS\s+70\s+(\d{1,4})\s", header)
    if said is None and _DRAWN_IN_MM.match(data):
        return 4
    return int(said[1]) if said else 0


GERBER_SUFFIXES = frozenset({".gbr", ".ger"})
"""Suffixes of files without layers."""

_READERS: dict[str, Callable[[Path], db.Layout]] = {
    **dict.fromkeys((".gds", ".gdsii", ".gds2"), _read_gdsii),
    **dict.fromkeys((".oas", ".oasis"), _read_oasis),
    ".cif": _read_cif,
    ".dxf": _read_dxf,
    **dict.fromkeys(sorted(GERBER_SUFFIXES), read_gerber),
}

LAYOUT_SUFFIXES = frozenset(_READERS)
"""Suffixes of the files that :func:`read_layout` reads."""
