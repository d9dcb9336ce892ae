"""DXF read by klayout where it holds polygons and shifted blocks alone, and else by ezdxf in a process of its own.

Readers of DXF turn arcs into chords as coarse as they like, leave splines out, take open lines for paths without width,
place blocks of unequal scales by one of them, and round to their grid, each without a word. So entities are found in
the bytes of the text first, fast enough for any plate: what is out of sight, and whether there is anything that klayout
might take for what it is not. Such drawings are read by :mod:`maskfab.mask.formats.dxf_process`, and both readers must
have found as many entities.

Written by :mod:`maskfab.mask.formats.dxf_writer`, which loads ezdxf.
"""

from __future__ import annotations

import re
from array import array
from collections import Counter, defaultdict
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from graphlib import CycleError, TopologicalSorter
from pathlib import Path

import numpy as np
from klayout import db

from maskfab.base.arrays import Floats
from maskfab.base.errors import SourceError
from maskfab.base.model import CHROME, CLEAR, LAYERS
from maskfab.base.units import NM_PER_UM, UM_PER_INCH, UM_PER_UNIT
from maskfab.job.values import FileFormat
from maskfab.mask.formats.content import (
    STEP_NM,
    Conversion,
    has_shapes,
    listed,
    note_rounding,
    number_layers,
    read_with_klayout,
    rounding_nm,
)
from maskfab.mask.formats.drawing import DrawingNotes, LayerFault, ReadAs, drawing_notes, note_drawing
from maskfab.mask.formats.dxf_process import PASSED_OVER, Drawing, Fault
from maskfab.mask.formats.dxf_scan import IN_PAPER_SPACE, Entity, entities, hiding, out_of_sight
from maskfab.mask.formats.format import Format, Source, Version
from maskfab.mask.formats.gdstk_process import cell_content
from maskfab.mask.layout import (
    DBU_UM,
    MOST_CELLS,
    MOST_LAYERS,
    LeftOut,
    check_limits,
    count_shapes,
    drawn_areas,
    is_empty,
    layer_info,
    left_out,
    note_left_out,
    placed_cells,
    too_many_cells,
    too_many_layers,
)
from maskfab.mask.process_limits import allow
from maskfab.mask.sandbox import PATIENCE_S, damaged, read_apart, unusable, wrong_kind

_UM_PER_DXF_UNIT = {
    2: 12 * UM_PER_INCH,
    8: 0.0254,
    14: 1e5,
    **{
        code: UM_PER_UNIT[unit]
        for code, unit in {1: "in", 4: "mm", 5: "cm", 6: "m", 9: "mil", 12: "nm", 13: "um"}.items()
    },
}
"""Micrometres of $INSUNITS (DXF reference, HEADER section), 0 for no unit: some besides those that have a name here."""

# Comments (group 999) may come before the first section.
_TEXT_DXF_START = re.compile(rb"(?:\xef\xbb\xbf)?(?:\s*999[ \t]*\r?\n[^\n]*\n)*\s*0\s*\r?\n\s*SECTION\s*\r?\n")
# R12 has no unit; a drawing of maskfab's own says it in its first comment.
_OWN_UNIT = re.compile(rb"\s*999[ \t]*\r?\nUnits: 1 drawing unit = 1 (micro|milli)metre\r?\n")
_BINARY_DXF_MAGIC = b"AutoCAD Binary DXF"
_HEADED = re.compile(rb"\s*2[ \t]*\r?\n[ \t]*HEADER")
_BLOCK = re.compile(rb"\n[ \t]*0[ \t]*\r?\n[ \t]*BLOCK[ \t]*\r?\n")

# klayout's mode "automatic" takes all closed lines for paths without width as soon as there is one SOLID or HATCH, and
# modes 3 and 4 take what two polygons share, or one has within another, away from both. Mode 2 makes each closed line
# a polygon of its own, and only leaves lines alone that return to their start without being said to be closed.
_POLYLINE_MODE = 2
_BYTES_PER_SECOND = 1e5
_NUMBERS = re.compile(r"L?(\d{1,6})(?:[D.](\d{1,6}))?")
_CORNERS_PER_SECOND, _MEMORY_PER_CORNER = 200_000, 64
_SAME_AREA, _OFF_GRID_NM = 1e-9, 1.5
"""Share by which equal sums of areas differ; and by how far two roundings of one corner."""


def read_dxf(path: Path, unit_um: float | None = None) -> db.Layout:
    """A text DXF as a layout; arguments and errors as of :func:`maskfab.mask.formats.table.read_layout`."""
    data = path.read_bytes()
    said_um, said_by = _stated_unit(path, data, unit_um)
    if any(count > MOST_CELLS for count, _ in enumerate(_BLOCK.finditer(data), 1)):
        raise too_many_cells(path)
    seen = look_through(path, data, said_um / DBU_UM)
    del data
    cure = f"tate its --unit: it is read in units of {said_um:g} um"
    try:
        layout = (_read_plain if seen.plain else _read_apart)(path, said_um, seen)
    except SourceError as error:
        if "overflow" not in error.what and "2.1 m" not in error.what:
            raise
        raise SourceError("MF313", f"{path.name} reaches beyond 2.1 m", where=str(path), cure=f"S{cure}") from error
    empty = left_out(layout).empty_polygons
    if empty and count_shapes(layout) == 0:
        what = f"{path.name}: none of its {empty} polygons has an area once they are rounded to the nanometre"
        raise SourceError("MF309", what, where=str(path), cure=f"S{cure}")
    try:
        check_limits(layout, path)
    except SourceError as error:
        if error.code == "MF312" and rounding_nm(layout) == 0:
            raise
        # Too large, or crossing itself once it is rounded to the grid: that is what a wrong unit looks like.
        raise SourceError(error.code, error.what, where=error.where, cure=f"{error.cure}, or s{cure}") from None
    notes = drawing_notes(layout)
    assert notes is not None
    note_drawing(layout, replace(notes, unit_um=said_um, unit_said_by=said_by))
    return layout


def _alone(read: Callable[[Path, float, Seen], db.Layout], path: Path, unit_um: float | None = None) -> db.Layout:
    """A text DXF as one reader alone has it, whatever it draws."""
    data = path.read_bytes()
    said_um, _ = _stated_unit(path, data, unit_um)
    return read(path, said_um, look_through(path, data, said_um / DBU_UM))


def _stated_unit(path: Path, data: bytes, unit_um: float | None) -> tuple[float, str]:
    """Micrometres of a unit of a text DXF that begins with a section and ends with EOF, and who states that."""
    if data.startswith(_BINARY_DXF_MAGIC):
        raise SourceError("MF308", f"{path.name} is binary DXF", where=str(path), cure="Save it as text DXF")
    if not _TEXT_DXF_START.match(data):
        raise wrong_kind(path, "DXF")
    # Some programs fill the last block of a file up, as for tapes and CP/M.
    if data[-1024:].rstrip(b"\0\x1a \t\r\n").split()[-2:] != [b"0", b"EOF"]:
        raise damaged(path, "it ends without EOF")
    if unit_um is not None:
        return unit_um, "--unit"
    found = re.search(rb"\$INSUNITS\s+70\s+(\d{1,4})\s", data[: data.find(b"ENDSEC")])
    said = 0 if found is None else int(found[1])
    if said in _UM_PER_DXF_UNIT:
        return _UM_PER_DXF_UNIT[said], "$INSUNITS"
    if said:
        what = f"{path.name} is drawn in unit {said} of $INSUNITS"
        raise SourceError("MF308", what, where=str(path), cure="Draw it in mm or um, or state its --unit")
    own = _OWN_UNIT.match(data)
    return (1.0, "") if own is None else (1e3 if own[1] == b"milli" else 1.0, "its first comment")


# --- what the text of a drawing shows --------------------------------------------------------------------------------

_LINES = {"POLYLINE", "LWPOLYLINE"}
_SHAPELESS = {
    "TEXT", "MTEXT", "ATTRIB", "ATTDEF", "VERTEX", "SEQEND", "BLOCK", "ENDBLK", "SECTION", "ENDSEC", "VIEWPORT",
}  # fmt: skip
_HARMLESS = _SHAPELESS | {"SOLID"}
# Shapes on layer 0 of a block are drawn on the layer of its reference, and those on CUT may be taken out of CLEAR.
_DATA = {CLEAR.name, CHROME.name}
_COUNTING = {*_DATA, "CUT", "0"}
_CLOSED = 1
_TILTING = frozenset({b"210", b"220", b"230"})
_TURNING = _TILTING | {b"41", b"42", b"44", b"45", b"50", b"102"}
"""Attributes that place a block at another scale or angle, or by steps, or clip it by what a dictionary says."""


@dataclass(frozen=True)
class Seen:
    """A drawing by the text of its entities.

    Attributes:
        plain: whether it has polygons and shifted blocks alone.
        rounding_nm: of a plain one, the largest distance by which klayout moves a coordinate to the nanometre grid.
        repeated_vertices: that then repeat the one before; klayout reports neither.
        clear_drawn: whether something lies on a layer that a plate writes, so that others do not count.
        hidden: layers, and what lies out of sight there, in words.
        drawn: number of entities by their block in capitals, kind and layer, without those in paper space.
        areas_nm2: of a plain one, the sums of areas and of lengths (nm) on each layer, every reference followed.
    """

    plain: bool
    rounding_nm: float
    repeated_vertices: int
    clear_drawn: bool
    hidden: tuple[tuple[str, str], ...]
    drawn: Counter[tuple[str, str, str]]
    areas_nm2: Mapping[str, tuple[float, float]] = field(default_factory=dict)

    def counts(self, layer: str) -> bool:
        """Whether a layer is one that matters."""
        return not self.clear_drawn or layer.upper() in _COUNTING


def look_through(path: Path, data: bytes, nm_per_unit: float) -> Seen:
    """Look at the entities of a drawing before anything reads it.

    Args:
        nm_per_unit: length of one unit of the drawing.

    Raises:
        SourceError: MF303 blocks that contain themselves or are lacking, MF313 too many layers, MF317 shapes in paper
            space, on frozen layers, invisible, or out of the plane, on layers that count if some is CLEAR.
    """
    clear_drawn = False
    start = _TEXT_DXF_START.match(data)
    plain = start is not None and _HEADED.match(data, start.end()) is not None
    grid, layers, hidden_layers = DrawingGrid(nm_per_unit), set[str](), dict[str, str]()
    drawn = Counter[tuple[str, str, str, str, str]]()
    for entity in entities(data):
        is_entry = entity.kind == "LAYER"
        layers.add(entity.text(2) if is_entry else entity.layer)
        if len(layers) > MOST_LAYERS:
            raise too_many_layers(path)
        if is_entry:
            hidden_layers[entity.text(2).upper()] = hiding(entity)
            continue
        placed = entity.text(2).upper() if entity.kind == "INSERT" else ""
        block = (entity.block or "").upper()
        drawn[block, entity.kind, entity.layer, placed, out_of_sight(entity)] += 1 + len(entity.copies) // 2
        clear_drawn = clear_drawn or (entity.kind not in _SHAPELESS and entity.layer.upper() in _DATA)
        plain = plain and _is_plain(entity, nm_per_unit)
        grid.add(entity)
    _refuse_blocks(path, grid)
    seen = Seen(False, 0.0, 0, clear_drawn, (), _in_model(drawn))
    used, unseen = grid.drawing(seen.counts), Counter[tuple[str, str]]()
    for (_, kind, layer, placed, why), count in drawn.items():
        where = hidden_layers.get(layer.upper(), "")
        if (why or where) and kind not in _SHAPELESS and (not placed or placed in used):
            unseen[f"{kind}{why} on {where}layer {layer!r}", layer] += count
    hidden = tuple((layer, f"{count} x {what}") for (what, layer), count in sorted(unseen.items()))
    if seen.clear_drawn and (counting := [what for layer, what in hidden if seen.counts(layer)]):
        raise _unseen(path, counting)
    names = [*layers, *grid.defined]
    alike = len({name.upper() for name in names}) == len({*names}) and grid.named <= grid.defined
    if not plain or hidden or not alike or not all(map(_is_plain_name, names)):
        return replace(seen, hidden=hidden)
    rounding_nm, repeated, areas = grid.measured(seen.counts)
    return replace(seen, plain=True, rounding_nm=rounding_nm, repeated_vertices=repeated, areas_nm2=areas)


def _in_model(drawn: Counter[tuple[str, str, str, str, str]]) -> Counter[tuple[str, str, str]]:
    shown = Counter[tuple[str, str, str]]()
    for (block, kind, layer, _, why), count in drawn.items():
        if why != IN_PAPER_SPACE:
            shown[block, kind, layer] += count
    return shown


def _is_plain(entity: Entity, nm_per_unit: float) -> bool:
    if entity.kind == "INSERT":
        return not entity.says(_TURNING) or _is_shifted(entity, nm_per_unit)
    if entity.kind not in _LINES:
        return entity.kind in _HARMLESS and not entity.says(_TILTING)
    if entity.says(_TILTING) or not entity.plain_line:
        return False
    flags = int(entity.number(70))
    # Lines of 128 dash across their corners, which shows in dashes alone.
    return not flags & ~(_CLOSED | 128) and (bool(flags & _CLOSED) or _returns(entity))


def _is_shifted(entity: Entity, nm_per_unit: float) -> bool:
    """Whether a block is shifted only, by whole nanometres along an array: klayout rounds one step, and adds it up."""
    if entity.says(_TILTING) or entity.says(frozenset({b"102"})) or entity.number(50) != 0:
        return False
    for step, count in ((44, 70), (45, 71)):
        off = entity.number(step) * nm_per_unit % 1.0
        if not (entity.number(count, 1.0) - 1) * min(off, 1 - off) <= STEP_NM:
            return False
    return entity.number(41, 1.0) == entity.number(42, 1.0) == 1


def _is_plain_name(name: str) -> bool:
    """Whether all readers take a name for the same: ASCII, and no code of a character."""
    return name.isascii() and "\\U+" not in name.upper()


def _refuse_blocks(path: Path, grid: DrawingGrid) -> None:
    cycle, lacking = grid.cycle(), grid.lacking()
    if cycle:
        through = f", through {', '.join(repr(name) for name in cycle[1:-1])}" if len(cycle) > 2 else ""
        what, cure = f"block {cycle[0]!r} contains itself{through}", "Take one of these references out"
    elif lacking:
        what = f"it places blocks that it lacks: {', '.join(lacking[:12])}"
        cure = "Write it again with every block that it places, and those of other files bound to it (XREF, Bind)"
    else:
        return
    raise SourceError("MF303", f"{path.name}: {what}", where=str(path), cure=cure)


def _returns(entity: Entity) -> bool:
    """Whether a line ends where it began, which closes it as well as its flag does."""
    xs, ys = entity.points()
    return len(xs) > 3 and len(ys) == len(xs) and (xs[0], ys[0]) == (xs[-1], ys[-1])


# --- both ways to read it --------------------------------------------------------------------------------------------


def _read_plain(path: Path, unit_um: float, seen: Seen) -> db.Layout:
    options = db.LoadLayoutOptions()
    options.dxf_dbu = DBU_UM
    options.dxf_unit = unit_um
    options.dxf_polyline_mode = _POLYLINE_MODE
    layout = read_with_klayout(path, options)
    if any(not info.name and info.layer < 0 for info in layout.layer_infos()):
        raise damaged(path, "something in it is drawn on no layer")
    empty = _tidy(layout)
    if seen.plain:
        _refuse_other_areas(path, layout, seen)
    number_layers(layout)
    note_rounding(layout, seen.rounding_nm)
    note_left_out(layout, LeftOut(seen.repeated_vertices, empty))
    counts = Counter[tuple[str, str]]()
    for (_, kind, on), count in seen.drawn.items():
        if kind in PASSED_OVER or kind in _LINES or kind == "SOLID":
            counts[kind, on] += count
    read_as = (
        ReadAs(*key, "" if key[0] in PASSED_OVER else "polygons", count) for key, count in sorted(counts.items())
    )
    note_drawing(layout, DrawingNotes(0.0, "", tuple(read_as)))
    return layout


def _refuse_other_areas(path: Path, layout: db.Layout, seen: Seen) -> None:
    """Refuse a drawing of which klayout makes other areas than its text says. Raises SourceError MF316."""
    placed, top = placed_cells(layout), layout.top_cells()
    found: dict[str, float] = defaultdict(float)
    for info in layout.layer_infos():
        # Layers called like numbers lose their names: those are compared together.
        name = info.name.upper() if info.name.upper() in seen.areas_nm2 else ""
        areas = drawn_areas(layout, layout.find_layer(info), placed)
        found[name] += sum(areas[cell.cell_index()] for cell in top)
    said = {name: both for name, both in seen.areas_nm2.items() if name in found}
    rest = [both for name, both in seen.areas_nm2.items() if name not in found]
    said[""] = sum(area for area, _ in rest), sum(length for _, length in rest)
    for name, (area, length_nm) in said.items():
        rounded_nm2 = length_nm * _OFF_GRID_NM if seen.rounding_nm else 0.0
        if abs(found[name] - area) > _SAME_AREA * max(found[name], area) + rounded_nm2:
            told = f"{area / NM_PER_UM**2:.9g} um^2 by its text and {found[name] / NM_PER_UM**2:.9g} um^2 for klayout"
            cure = "Open it in the program that drew it, mend what its audit finds (AUDIT), and save it again"
            what = f"{path.name} draws polygons of {told} on layer {name!r}"
            raise SourceError("MF316", what, where=str(path), cure=cure)


def _read_apart(path: Path, unit_um: float, seen: Seen) -> db.Layout:
    seconds = PATIENCE_S + path.stat().st_size / _BYTES_PER_SECOND
    script = Path(__file__).with_name("dxf_process.py")
    drawing: Drawing = read_apart(path, script, repr(unit_um / DBU_UM), kind=Drawing, seconds=seconds)
    _refuse_different(path, seen, drawing)
    plate = {layer.name: layer_info(layer) for layer in LAYERS}
    named = [plate.get(name.upper()) or _numbered(name, drawing.layers) for name in drawing.layers]
    # A circle of a few bytes has thousands of corners, which take their time.
    corners = sum(cell[1][0].size for cell in drawing.cells) // 2
    allow(corners / _CORNERS_PER_SECOND, _MEMORY_PER_CORNER * corners)
    try:
        layout = Conversion(path, named).layout([cell_content(cell) for cell in drawing.cells])
    except (ValueError, TypeError, OverflowError, RuntimeError) as error:
        raise unusable(path, error) from error
    note_left_out(layout, replace(left_out(layout), curves=drawing.curves))
    note_rounding(layout, max(rounding_nm(layout), drawing.rounding_nm))
    faults = _faults(path, layout, seen, drawing.faults)
    note_drawing(layout, DrawingNotes(0.0, "", drawing.read_as, faults, drawing.gap_nm))
    return layout


def _numbered(name: str, names: Sequence[str]) -> db.LayerInfo:
    """A layer with the numbers that klayout gives one of its name, if no other has them."""

    def numbers(of: str) -> tuple[int, int] | None:
        told = _NUMBERS.fullmatch(of)
        return None if told is None else (int(told[1]), int(told[2] or 0))

    own = numbers(name)
    if own is None or sum(numbers(other) == own for other in names) > 1:
        return db.LayerInfo(name)
    return db.LayerInfo(*own, name)


def _refuse_different(path: Path, seen: Seen, drawing: Drawing) -> None:
    """Refuse a drawing of which one of both readers leaves something out. Raises SourceError MF316."""
    found = Counter({(block, kind): count for block, kind, count in drawing.counted})
    read, said = {block for block, _ in found}, Counter[tuple[str, str]]()
    for (block, kind, _), count in seen.drawn.items():
        if block in read:
            said[block, kind] += count
    for block, kind in sorted({*found, *said}):
        one, other = said[block, kind], found[block, kind]
        if one != other and kind not in PASSED_OVER | _SHAPELESS:
            where = f"block {block!r}" if block else "the drawing itself"
            what = f"{path.name} has {one} {kind} in {where} by its text and {other} for ezdxf"
            cure = "Open it in the program that drew it, mend what its audit finds (AUDIT), and save it again"
            raise SourceError("MF316", what, where=str(path), cure=cure)


def _faults(path: Path, layout: db.Layout, seen: Seen, found: Sequence[Fault]) -> tuple[LayerFault, ...]:
    """Layers of which not all could be read, unless one of them is what is meant: that is refused at once."""
    errors: dict[str, SourceError] = {}
    for layer in dict.fromkeys([*(layer for layer, _ in seen.hidden), *(fault.layer for fault in found)]):
        hidden = [what for at, what in seen.hidden if at.upper() == layer.upper()]
        drawn = [fault for fault in found if fault.layer.upper() == layer.upper()]
        errors[layer] = _unseen(path, hidden) if hidden else _unreadable(path, drawn)
    meant = [error for layer, error in errors.items() if seen.clear_drawn and seen.counts(layer)]
    faulty = {layer.upper() for layer in errors}
    whole = [info for info in layout.layer_infos() if info.name.upper() not in faulty and has_shapes(layout, info)]
    if meant or (errors and not whole):
        raise (meant or list(errors.values()))[0]
    return tuple(LayerFault(layer, error.code, error.what, error.cure) for layer, error in errors.items())


def _unreadable(path: Path, faults: Sequence[Fault]) -> SourceError:
    drawn = [
        f"{one.count} x {one.kind} on layer {one.layer!r}" + (f" ({one.place})" if one.place else "")
        for one in sorted(faults, key=lambda one: (one.code, one.kind))
    ]
    code, what = max(one.code for one in faults), f"{path.name} draws {listed(drawn, 6)}; a mask has areas only"
    return SourceError(code, what, where=str(path), cure=_CURES[code])


_CURES = {
    "MF303": "Mend or delete them in the program that drew them, or name another --layer",
    "MF310": "Join lines whose ends do not meet (PEDIT, Join, with a fuzz distance), delete construction lines and "
    "points, or name another --layer",
    "MF311": "Turn them into closed polylines in the program that drew them, or name another --layer",
    "MF317": "Draw them flat in model space (FLATTEN), or name another --layer",
}


def _unseen(path: Path, hidden: Sequence[str]) -> SourceError:
    what = f"{path.name} draws {listed(hidden, 6)}; a mask contains visible shapes of model space only"
    cure = "Delete what is not part of the mask, draw the rest flat in model space, and show all its layers"
    return SourceError("MF317", what, where=str(path), cure=cure)


def _tidy(layout: db.Layout) -> int:
    """Make polygons of lines without width that end where they began, which a SOLID beside them does not change; take
    polygons without area out, and count them."""
    dropped = 0
    for shapes in (cell.shapes(layer) for layer in layout.layer_indexes() for cell in layout.each_cell()):
        for shape in list(shapes.each(db.Shapes.SPaths)):
            points = list(shape.each_point())
            if shape.path_width == 0 and len(points) > 3 and points[0] == points[-1]:
                shapes.replace(shape, db.Polygon(points[:-1]))
        flat = [polygon for polygon in shapes.each(db.Shapes.SPolygons) if polygon.area() == 0]
        for shape in [polygon for polygon in flat if is_empty(polygon.polygon)]:
            shapes.erase(shape)
            dropped += 1
    return dropped


_ON_GRID_NM = 1e-4
"""Decimals of inches and millimetres are written with so many digits that what is on the grid lies closer to it."""

_ELSEWHERE = 4 | 8
"""Flags of a block whose content is another file's, or is laid over from there."""

_DRAWING = "\n"
"""Stands for the drawing itself; no name of a block ends a line."""


class DrawingGrid:
    """Coordinates and blocks of a drawing, collected entity by entity; names of blocks in capitals.

    Attributes:
        defined, named: names of blocks where they are drawn, and where they are placed, as they are written.
    """

    def __init__(self, nm_per_unit: float) -> None:
        self._scale = nm_per_unit
        self._lines: dict[tuple[str, str], _Lines] = defaultdict(_Lines)
        self._bases: dict[str, tuple[float, float]] = {}
        self._placed: dict[str, dict[str, array[float]]] = defaultdict(lambda: defaultdict(lambda: array("d")))
        self._times: dict[str, dict[tuple[str, str], float]] = defaultdict(lambda: defaultdict(float))
        self.defined, self.named = set[str](), set[str]()

    def add(self, entity: Entity) -> None:
        """Take the coordinates of an entity that draws, places or begins a block; others have none that count."""
        block = _DRAWING if entity.block is None else entity.block.upper()
        if entity.kind == "BLOCK" and not int(entity.number(70)) & _ELSEWHERE:
            self._bases[block] = entity.number(10), entity.number(20)
            self.defined.add(entity.text(2))
        elif entity.kind == "INSERT":
            name = entity.text(2)
            self.named.add(name)
            placed = self._placed[block][name.upper()]
            placed.extend((entity.number(10), entity.number(20)))
            placed.extend(entity.copies)
            columns, rows = (max(1.0, abs(entity.number(code, 1.0))) for code in (70, 71))
            self._times[block][name.upper(), entity.layer.upper()] += (1 + len(entity.copies) // 2) * columns * rows
        elif entity.kind == "SOLID":
            xs, ys = ([entity.number(axis + corner) for corner in (0, 1, 3, 2)] for axis in (10, 20))
            self._lines[block, entity.layer].add(xs, ys)
        elif entity.kind in _LINES:
            self._lines[block, entity.layer].add(*entity.points())
        elif entity.kind not in _SHAPELESS:
            self._lines[block, entity.layer].add([], [])

    def cycle(self) -> list[str]:
        """Names of blocks each of which contains the next, the last the first; empty if there are none."""
        try:
            TopologicalSorter(self._graph()).prepare()
        except CycleError as error:
            names: list[str] = error.args[1][::-1]
            return names
        return []

    def lacking(self) -> list[str]:
        """Blocks that are placed and not there."""
        return sorted(name for name in self.named if name.upper() not in self._bases)

    def _graph(self) -> dict[str, set[str]]:
        return {
            _DRAWING: set(),
            **{block: set() for block in self._bases},
            **{block: set(placed) for block, placed in self._placed.items()},
        }

    def drawing(self, counts: Callable[[str], bool]) -> set[str]:
        """Names of the blocks that draw something that counts, or place a block that does."""
        blocks = {block for block, layer in self._lines if counts(layer)}
        for block in TopologicalSorter(self._graph()).static_order():
            if not blocks.isdisjoint(self._placed.get(block, ())):
                blocks.add(block)
        return blocks - {_DRAWING}

    def measured(self, counts: Callable[[str], bool]) -> tuple[float, int, dict[str, tuple[float, float]]]:
        """Largest distance by which klayout moves a coordinate (nm), vertices that then repeat the one before, and sums
        of the areas (nm^2) and of the lengths (nm) of all outlines on each layer, by its name in capitals.

        Areas follow every reference; what a block has on layer 0 lies on the layer of that. A block that draws nothing
        that counts has no rounding at all, and where it is placed does not count.
        """
        own: dict[str, dict[str, Floats]] = defaultdict(lambda: defaultdict(lambda: np.zeros(3)))
        roundings_nm, repeated = dict[str, float](), 0
        for (block, layer), lines in self._lines.items():
            measured, rounding_nm = lines.measured(self._scale)
            own[block][layer.upper()] += measured
            if counts(layer):
                roundings_nm[block] = max(roundings_nm.get(block, 0.0), rounding_nm)
                repeated += int(measured[2])
        for block in TopologicalSorter(self._graph()).static_order():
            for (name, on), times in self._times.get(block, {}).items():
                for layer, sums in own.get(name, {}).items():
                    own[block][on if layer == "0" else layer] += times * sums
            for name in self._placed.get(block, {}).keys() & roundings_nm.keys():
                places_nm = _rounding_nm(np.array(self._placed[block][name]), self._scale)
                roundings_nm[block] = max(roundings_nm.get(block, 0.0), places_nm, roundings_nm[name])
            if block in roundings_nm:
                base_nm = _rounding_nm(np.array(self._bases.get(block, (0.0, 0.0))), self._scale)
                roundings_nm[block] = max(roundings_nm[block], base_nm)
        areas = {layer: (float(sums[0]), float(sums[1])) for layer, sums in own[_DRAWING].items()}
        return roundings_nm.get(_DRAWING, 0.0), repeated, areas


def _rounding_nm(values: Floats, scale: float) -> float:
    """Who reads the polygons refuses coordinates that are too large for any."""
    with np.errstate(over="ignore", invalid="ignore"):
        off = np.abs(values * scale - np.rint(values * scale))
    largest = float(off.max(initial=0.0, where=np.isfinite(off)))
    return largest if largest > _ON_GRID_NM else 0.0


class _Lines:
    """Vertices of many lines, one after the other."""

    def __init__(self) -> None:
        self._x, self._y, self._last = array("d"), array("d"), array("q")

    def add(self, xs: list[float], ys: list[float]) -> None:
        count = min(len(xs), len(ys))
        self._x.extend(xs[:count])
        self._y.extend(ys[:count])
        if count:
            self._last.append(len(self._x) - 1)

    def measured(self, scale: float) -> tuple[Floats, float]:
        """Sums of the areas of all lines, on the grid, of their lengths along both axes, and of vertices that repeat
        others; and the largest distance to the grid."""
        ends = np.array(self._last, dtype=np.int64)
        if not len(ends):
            return np.zeros(3), 0.0
        with np.errstate(over="ignore", invalid="ignore"):
            drawn = np.array([np.array(self._x), np.array(self._y)])
            x, y = np.rint(drawn * scale)
            starts, after = np.append(0, ends[:-1] + 1), np.arange(1, len(x) + 1)
            after[ends] = starts
            # About each line's first corner, so that nothing is lost in large products.
            counts = np.diff(np.append(starts, len(x)))
            u, v = (values - np.repeat(values[starts], counts) for values in (x, y))
            areas = np.abs(np.add.reduceat(u * v[after] - u[after] * v, starts)) / 2
            steps = np.abs(u[after] - u) + np.abs(v[after] - v)
            # A line may end where it began.
            repeated = np.count_nonzero(np.delete(steps, ends) == 0)
            return np.array([areas.sum(), steps.sum(), repeated]), _rounding_nm(drawn, scale)


def _format(name: FileFormat, version: Version) -> Format:
    def write(of: Source, to: Path) -> None:
        from maskfab.mask.formats.dxf_writer import write_dxf

        write_dxf(of.figures, to, version, of.comments, of.settings.drawing)

    return Format(
        name,
        f"DXF {version}",
        f"_{version}.dxf",
        write_plate=write,
        read=read_dxf,
        readers=(("klayout", partial(_alone, _read_plain)), ("ezdxf", partial(_alone, _read_apart))),
        suffixes=(".dxf",),
        layers="named",
        notes=True,
        takes_unit=True,
        reading="fork",
    )


FORMATS = (_format("dxf_r12", "R12"), _format("dxf_r2010", "R2010"))
