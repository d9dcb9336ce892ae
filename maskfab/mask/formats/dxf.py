"""DXF read by klayout, once its entities have shown that nothing is left out, hidden or taken for what it is not.

Readers of DXF turn arcs into chords, leave splines out, take open lines for paths without width, and round to their
grid, each without a word. A plot shows paper space or the model but not both, and neither frozen layers nor what is
invisible; readers take all of it for one drawing, and look at shapes that stand upright from the side. A mask has
polygons only, in model space, in its plane and in sight: other drawings are refused and named. Entities are found in
the bytes of the text, fast enough for any plate, and with them the offsets of coordinates from the nanometre grid.

Written by :mod:`maskfab.mask.formats.dxf_writer`, which loads ezdxf.
"""

from __future__ import annotations

import math
import re
from array import array
from collections import Counter, defaultdict
from collections.abc import Callable, Iterator
from graphlib import CycleError, TopologicalSorter
from pathlib import Path

import numpy as np
from klayout import db

from maskfab.base.arrays import Floats
from maskfab.base.errors import SourceError
from maskfab.base.model import CHROME, CLEAR
from maskfab.base.units import UM_PER_INCH, UM_PER_UNIT
from maskfab.job.values import FileFormat
from maskfab.mask.formats.content import UNIT_KEY, note_rounding, number_layers, read_with_klayout
from maskfab.mask.formats.format import Format, Source, Version
from maskfab.mask.layout import (
    DBU_UM,
    MOST_CELLS,
    MOST_LAYERS,
    LeftOut,
    check_limits,
    count_shapes,
    is_empty,
    note_left_out,
    too_many_cells,
    too_many_layers,
)
from maskfab.mask.sandbox import damaged, wrong_kind

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

# Comments (group 999) may come before the first section.
_TEXT_DXF_START = re.compile(rb"(?:\xef\xbb\xbf)?(?:\s*999[ \t]*\r?\n[^\n]*\n)*\s*0\s*\r?\n\s*SECTION\s*\r?\n")
# R12 has no unit; a drawing of maskfab's own says it in its first comment.
_DRAWN_IN_MM = re.compile(rb"\s*999[ \t]*\r?\nUnits: 1 drawing unit = 1 millimetre\r?\n")
_BINARY_DXF_MAGIC = b"AutoCAD Binary DXF"
_BLOCK = re.compile(rb"\n[ \t]*0[ \t]*\r?\n[ \t]*BLOCK[ \t]*\r?\n")

# klayout's mode "automatic" takes all closed lines for paths without width as soon as there is one SOLID or HATCH, and
# modes 3 and 4 take what two polygons share, or one has within another, away from both. Mode 2 makes each closed line
# a polygon of its own, and only leaves lines alone that return to their start without being said to be closed.
_POLYLINE_MODE = 2


def read_dxf(path: Path, unit_um: float | None = None) -> db.Layout:
    """A text DXF as a layout; arguments and errors as of :func:`maskfab.mask.formats.table.read_layout`."""
    data = path.read_bytes()
    said = _checked_dxf_unit(path, data)
    if any(count > MOST_CELLS for count, _ in enumerate(_BLOCK.finditer(data), 1)):
        raise too_many_cells(path)
    if unit_um is None:
        if said and said not in _UM_PER_DXF_UNIT:
            what = f"{path.name} is drawn in unit {said} of $INSUNITS"
            raise SourceError("MF308", what, where=str(path), cure="Draw it in mm or um, or state its --unit")
        unit_um = _UM_PER_DXF_UNIT.get(said, 1.0)
    rounding_nm, repeated_vertices = look_through(path, data, unit_um / DBU_UM)
    options = db.LoadLayoutOptions()
    options.dxf_dbu = DBU_UM
    options.dxf_unit = unit_um
    options.dxf_polyline_mode = _POLYLINE_MODE
    in_units = f"is read in units of {unit_um:g} um"
    try:
        layout = read_with_klayout(path, options)
    except SourceError as error:
        if "overflow" not in error.what:
            raise
        what = f"{path.name} reaches beyond 2.1 m"
        raise SourceError("MF313", what, where=str(path), cure=f"State its --unit: it {in_units}") from error
    if any(not info.name and info.layer < 0 for info in layout.layer_infos()):
        raise damaged(path, "something in it is drawn on no layer")
    close_lines(layout)
    empty = _drop_empty(layout)
    if empty and count_shapes(layout) == 0:
        what = f"{path.name}: none of its {empty} polygons has an area once they are rounded to the nanometre"
        raise SourceError("MF309", what, where=str(path), cure=f"State its --unit: it {in_units}")
    number_layers(layout)
    try:
        check_limits(layout, path)
    except SourceError as error:
        if error.code == "MF312" and rounding_nm == 0:
            raise
        # Too large, or crossing itself once it is rounded to the grid: that is what a wrong unit looks like.
        cure = f"{error.cure}, or state its --unit: it {in_units}"
        raise SourceError(error.code, error.what, where=error.where, cure=cure) from None
    layout.add_meta_info(db.LayoutMetaInfo(UNIT_KEY, unit_um, "length of one unit of the drawing"))
    note_rounding(layout, rounding_nm)
    note_left_out(layout, LeftOut(repeated_vertices, empty))
    return layout


def _drop_empty(layout: db.Layout) -> int:
    """Take polygons without area out, and count them."""
    dropped = 0
    for layer in layout.layer_indexes():
        for cell in layout.each_cell():
            shapes = cell.shapes(layer)
            flat = [polygon for polygon in shapes.each(db.Shapes.SPolygons) if polygon.area() == 0]
            for shape in [polygon for polygon in flat if is_empty(polygon.polygon)]:
                shapes.erase(shape)
                dropped += 1
    return dropped


def _checked_dxf_unit(path: Path, data: bytes) -> int:
    """$INSUNITS, 0 if the file does not say, of a text DXF that begins with a section and ends with EOF."""
    if data.startswith(_BINARY_DXF_MAGIC):
        raise SourceError("MF308", f"{path.name} is binary DXF", where=str(path), cure="Save it as text DXF")
    if not _TEXT_DXF_START.match(data):
        raise wrong_kind(path, "DXF")
    if data[-64:].split()[-2:] != [b"0", b"EOF"]:
        raise damaged(path, "it ends without EOF")
    header = data[: data.find(b"ENDSEC")]
    said = re.search(rb"\$INSUNITS\s+70\s+(\d{1,4})\s", header)
    if said is None and _DRAWN_IN_MM.match(data):
        return 4
    return int(said[1]) if said else 0


_LINES = {"POLYLINE", "LWPOLYLINE"}
_SHAPELESS = {
    "TEXT", "MTEXT", "ATTRIB", "ATTDEF", "VERTEX", "SEQEND", "BLOCK", "ENDBLK", "SECTION", "ENDSEC", "VIEWPORT",
}  # fmt: skip
_HARMLESS = _SHAPELESS | {"INSERT", "SOLID"}
_OPEN = {"LINE", "POINT", "3DFACE", "TRACE", "LEADER", "MLINE", "RAY", "XLINE", "HATCH", "REGION", "3DSOLID", "MESH"}
# Shapes on layer 0 of a block are drawn on the layer of its reference, and those on CUT may be taken out of CLEAR.
_DATA = {CLEAR.name, CHROME.name}
_COUNTING = {*_DATA, "CUT", "0"}
_CLOSED = 1
_CURVE_FITTED = 2 | 4


def look_through(path: Path, data: bytes, nm_per_unit: float) -> tuple[float, int]:
    """Refuse a drawing with open lines, curves or fills, or out of sight; on other layers if nothing lies on CLEAR.

    Args:
        nm_per_unit: length of one unit of the drawing.

    Returns:
        The largest distance (nm) by which klayout moves a coordinate to the nanometre grid, and the number of vertices
        that then repeat the one before: it reports neither.

    Raises:
        SourceError: MF303 blocks that contain themselves or are lacking, MF310 open lines or fills, MF311 arcs,
            splines and bulges, MF313 too many layers, MF317 shapes in paper space, on frozen layers, invisible, or out
            of the plane.
    """
    faults: Counter[tuple[str, str, str]] = Counter()
    clear_drawn = False
    grid, unseen, layers = DrawingGrid(nm_per_unit), Unseen(), set[str]()
    for entity in entities(data):
        is_entry = entity.kind == "LAYER"
        layers.add(entity.text(2) if is_entry else entity.layer)
        if len(layers) > MOST_LAYERS:
            raise too_many_layers(path)
        if is_entry:
            unseen.add_layer(entity)
            continue
        if entity.kind not in _SHAPELESS:
            unseen.add(entity)
        layer = entity.layer
        clear_drawn = clear_drawn or layer in _DATA
        fault = _fault(entity)
        if fault:
            faults[(*fault, layer)] += 1
        else:
            grid.add(entity)

    def counts(layer: str) -> bool:
        return not clear_drawn or layer in _COUNTING

    _refuse_blocks(path, grid)
    _refuse_unseen(path, unseen.hidden_shapes(counts, grid.drawing(counts)))
    _refuse_faults(path, {key: count for key, count in faults.items() if counts(key[2])})
    return grid.rounding_nm(counts), grid.repeated_vertices(counts)


def _refuse_faults(path: Path, faults: dict[tuple[str, str, str], int]) -> None:
    if faults:
        drawn = [f"{count} x {what} on layer {layer!r}" for (_, what, layer), count in sorted(faults.items())]
        raise SourceError(
            max(code for code, _, _ in faults),
            f"{path.name} draws {', '.join(drawn[:6])}; a mask has closed polygons only",
            where=str(path),
            cure="Close its lines, take its points out, and turn curves into polygons in the program that drew them",
        )


def _refuse_unseen(path: Path, hidden: list[str]) -> None:
    if hidden:
        what = f"{path.name} draws {', '.join(hidden[:6])}; a mask contains visible shapes of model space only"
        cure = "Delete what is not part of the mask, draw the rest flat in model space, and show all its layers"
        raise SourceError("MF317", what, where=str(path), cure=cure)


def _refuse_blocks(path: Path, grid: DrawingGrid) -> None:
    cycle, lacking = grid.cycle(), grid.lacking()
    if cycle:
        through = f", through {', '.join(repr(name) for name in cycle[1:-1])}" if len(cycle) > 2 else ""
        what, cure = f"block {cycle[0]!r} contains itself{through}", "Take one of these references out"
    elif lacking:
        what = f"it places blocks that it lacks: {', '.join(lacking[:12])}"
        cure = "Write it again with every block that it places"
    else:
        return
    raise SourceError("MF303", f"{path.name}: {what}", where=str(path), cure=cure)


def close_lines(layout: db.Layout) -> None:
    """Make polygons of lines without width that end where they began; a SOLID beside them changes nothing."""
    for layer in layout.layer_indexes():
        for cell in layout.each_cell():
            shapes = cell.shapes(layer)
            for shape in list(shapes.each(db.Shapes.SPaths)):
                points = list(shape.each_point())
                if shape.path_width == 0 and len(points) > 3 and points[0] == points[-1]:
                    shapes.replace(shape, db.Polygon(points[:-1]))


def _fault(entity: Entity) -> tuple[str, str] | None:
    kind = entity.kind
    if kind in _HARMLESS:
        return None
    if kind in _OPEN:
        return "MF310", kind
    if kind not in _LINES:
        return "MF311", kind
    if entity.bulges:
        return "MF311", f"{kind} with bulges"
    flags = int(entity.number(70))
    if flags & _CURVE_FITTED:
        return "MF311", f"{kind} fitted by curves"
    if not flags & _CLOSED and entity.width == 0 and not _returns(entity):
        return "MF310", f"open {kind}"
    return None


def _returns(entity: Entity) -> bool:
    """Whether a line ends where it began, which closes it as well as its flag does."""
    xs, ys = entity.points()
    return len(xs) > 3 and len(ys) == len(xs) and (xs[0], ys[0]) == (xs[-1], ys[-1])


_PAPER = ("*PAPER_SPACE", "$PAPER_SPACE")
_FROZEN = 1
_HIDING = frozenset({b"60", b"67", b"210", b"220", b"230"})
_IN_PLANE = 1e-9
"""Directions are written with so many digits that those along z are closer to it."""


class Unseen:
    """Entities that draw or place something out of sight, collected one by one."""

    def __init__(self) -> None:
        self._layers: dict[str, str] = {}
        self._drawn: Counter[tuple[str, str, str, str]] = Counter()

    def add_layer(self, entry: Entity) -> None:
        """Take an entry of the table of layers, which may stand behind what is drawn on it."""
        if int(entry.number(70)) & _FROZEN:
            self._layers[entry.text(2).upper()] = "the frozen "
        elif entry.number(62) < 0:
            self._layers[entry.text(2).upper()] = "the switched-off "

    def add(self, entity: Entity) -> None:
        """Take an entity that draws, or places a block."""
        placed = entity.text(2) if entity.kind == "INSERT" else ""
        self._drawn[entity.kind, entity.layer, placed, _out_of_sight(entity)] += 1 + len(entity.copies) // 2

    def hidden_shapes(self, counts: Callable[[str], bool], drawing: set[str]) -> list[str]:
        """With the reason, in words."""
        unseen: Counter[str] = Counter()
        for (kind, layer, placed, why), count in self._drawn.items():
            hidden = self._layers.get(layer.upper(), "")
            if (why or hidden) and (placed in drawing if placed else counts(layer)):
                unseen[f"{kind}{why} on {hidden}layer {layer!r}"] += count
        return [f"{count} x {what}" for what, count in sorted(unseen.items())]


def _out_of_sight(entity: Entity) -> str:
    if (entity.block or "").upper().startswith(_PAPER):
        return " in paper space"
    if not entity.says(_HIDING):
        return ""
    if entity.number(67) == 1:
        return " in paper space"
    if entity.number(60) == 1:
        return " made invisible"
    x, y, z = entity.number(210), entity.number(220), entity.number(230, 1.0)
    if not math.hypot(x, y) < _IN_PLANE * abs(z):
        return " out of the plane"
    return ""


_ON_GRID_NM = 1e-4
"""Decimals of inches and millimetres are written with so many digits that what is on the grid lies closer to it."""

_ELSEWHERE = 4 | 8
"""Flags of a block whose content is another file's, or is laid over from there."""

_SPREADING = frozenset({b"41", b"42", b"44", b"45", b"70", b"71"})
"""Attributes that make an array of a reference, or place its block at another scale."""

_DRAWING = "\n"
"""Stands for the drawing itself; no name of a block ends a line."""


class DrawingGrid:
    """The coordinates of a drawing, collected entity by entity, in nanometres."""

    def __init__(self, nm_per_unit: float) -> None:
        self._scale = nm_per_unit
        self._lines: dict[tuple[str, str], _Lines] = defaultdict(_Lines)
        self._bases: dict[str, tuple[float, float]] = {}
        self._placed: dict[str, dict[str, _Places]] = defaultdict(lambda: defaultdict(_Places))

    def add(self, entity: Entity) -> None:
        """Take the coordinates of an entity that draws, places or begins a block; others have none that count."""
        block = _DRAWING if entity.block is None else entity.block
        if entity.kind == "BLOCK" and not int(entity.number(70)) & _ELSEWHERE:
            self._bases[block] = entity.number(10), entity.number(20)
        elif entity.kind == "INSERT":
            self._placed[block][entity.text(2)].add(entity)
        elif entity.kind == "SOLID":
            xs, ys = ([entity.number(axis + corner) for corner in (0, 1, 3, 2)] for axis in (10, 20))
            self._lines[block, entity.layer].add(xs, ys)
        elif entity.kind in {"LWPOLYLINE", "POLYLINE"}:
            xs, ys = entity.points()
            if entity.width > 0:
                xs, ys = self._outline(xs, ys, entity.width)
            self._lines[block, entity.layer].add(xs, ys)

    def _outline(self, xs: list[float], ys: list[float], width: float) -> tuple[list[float], list[float]]:
        # In nanometres, for klayout takes points within a hundred-thousandth of its unit for the same.
        spine = [db.DPoint(x * self._scale, y * self._scale) for x, y in zip(xs, ys, strict=False)]
        hull = list(db.DPath(spine, width * self._scale).polygon().each_point_hull())
        return [point.x / self._scale for point in hull], [point.y / self._scale for point in hull]

    def cycle(self) -> list[str]:
        """Names of blocks each of which contains the next, the last the first; empty if there are none."""
        try:
            TopologicalSorter(self._graph()).prepare()
        except CycleError as error:
            names: list[str] = error.args[1][::-1]
            return names
        return []

    def lacking(self) -> list[str]:
        """Blocks that are placed and not there, by their exact names."""
        placed = set().union(*self._placed.values())
        return sorted(placed - self._bases.keys())

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

    def rounding_nm(self, counts: Callable[[str], bool]) -> float:
        """The largest distance by which klayout moves a coordinate, seen in the drawing."""
        own: dict[str, float] = {}
        for (block, layer), lines in self._lines.items():
            if counts(layer):
                values = np.concatenate(lines.points())
                own[block] = max(own.get(block, 0.0), self._rounding(values))
        # A block that draws nothing that counts has no rounding at all, and where it is placed does not count.
        roundings_nm: dict[str, float] = {}
        for block in TopologicalSorter(self._graph()).static_order():
            roundings = [own[block]] if block in own else []
            for name, places in self._placed.get(block, {}).items():
                if name in roundings_nm:
                    roundings += [self._rounding(np.array(places.coordinates)), places.largest * roundings_nm[name]]
            if roundings:
                roundings_nm[block] = max(*roundings, self._rounding(np.array(self._bases.get(block, (0.0, 0.0)))))
        return roundings_nm.get(_DRAWING, 0.0)

    def repeated_vertices(self, counts: Callable[[str], bool]) -> int:
        """Vertices that lie on the one before once they are rounded; a line may end where it began."""
        return sum(lines.repeated(self._scale) for (_, layer), lines in self._lines.items() if counts(layer))

    def _rounding(self, values: Floats) -> float:
        scaled = _scaled(values, self._scale)
        scaled = scaled[np.isfinite(scaled)]
        largest = float(np.abs(scaled - np.rint(scaled)).max(initial=0.0))
        return largest if largest > _ON_GRID_NM else 0.0


def _scaled(values: Floats, scale: float) -> Floats:
    """Coordinates in database units; who reads the polygons refuses those that are too large for any."""
    with np.errstate(over="ignore"):
        return values * scale


class _Places:
    """References to one block in another.

    Attributes:
        coordinates: of all of them, and the steps of arrays.
        largest: how many times as large as it is drawn the block is placed at most.
    """

    def __init__(self) -> None:
        self.coordinates, self.largest = array("d"), 0.0

    def add(self, reference: Entity) -> None:
        self.coordinates.append(reference.number(10))
        self.coordinates.append(reference.number(20))
        self.coordinates.extend(reference.copies)
        larger = 1.0
        if reference.says(_SPREADING):
            larger = max(abs(reference.number(41, 1.0)), abs(reference.number(42, 1.0)))
            for step, count in ((44, 70), (45, 71)):
                if abs(reference.number(count, 1.0)) > 1:
                    self.coordinates.append(reference.number(step))
        self.largest = max(self.largest, larger)


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

    def points(self) -> tuple[Floats, Floats]:
        return np.array(self._x), np.array(self._y)

    def repeated(self, scale: float) -> int:
        x, y = (np.rint(_scaled(values, scale)) for values in self.points())
        same = (x[1:] == x[:-1]) & (y[1:] == y[:-1])
        # Between the last vertex of a line and the first of the next there is no edge.
        same[np.array(self._last[:-1], dtype=np.int64)] = False
        return int(same.sum())


# Most of a plate are vertices, which belong to their polyline.
_ENTITY = re.compile(rb"(?:^|\n)[ \t]*0[ \t]*\r?\n[ \t]*(?!(?i:vertex)[ \t]*\r?\n)((?:3D)?[A-Za-z][^\r\n]*)\r?(?=\n)")
_SECTION = re.compile(rb"\s*2[ \t]*\r?\n[ \t]*(\w+)")
_DRAWN = {b"BLOCKS", b"ENTITIES"}
_TAG = re.compile(rb"\n[ \t]*(\d{1,4})[ \t]*\r?\n[ \t]*([^\r\n]*)")
# Layer, block, x and y of a reference that says no more: a random die has thousands.
_PLAIN = re.compile(
    rb"(?:\n *(?:5|330|100)\r?\n[^\n]*)*\n *8\r?\n([^\r\n]*)\r?(?:\n *100\r?\n[^\n]*)*"
    rb"\n *2\r?\n([^\r\n]*)\r?\n *10\r?\n([^\r\n]*)\r?\n *20\r?\n([^\r\n]*)\r?(?:\n *30\r?\n[^\n]*)?"
)


class Entity:
    """One thing that is drawn; a vertex belongs to its polyline.

    Args:
        kind: its name, such as ``LWPOLYLINE``.
        block: name of the block that it is drawn in; None in the drawing itself.

    Attributes:
        layer: its layer; ``0``, in a block that of the reference, if it does not say.
        copies: x and y of further references that differ from this one in nothing else.
    """

    __slots__ = ("_first", "_tags", "block", "copies", "kind", "layer")

    def __init__(self, kind: str, block: str | None, body: bytes) -> None:
        self.kind = kind
        self.block = block
        # Group codes and values stay bytes: a plate has millions of them, and few are looked at.
        self._tags: list[tuple[bytes, bytes]] = _TAG.findall(body)
        self._first = dict(reversed(self._tags))
        self.layer = self.text(8, "0")
        self.copies = array("d")

    def says(self, codes: frozenset[bytes]) -> bool:
        """Whether it has a value under any of these group codes: most have none that change how they are placed."""
        return not codes.isdisjoint(self._first)

    @property
    def width(self) -> float:
        """Width of a line, its first where it has several."""
        if b"40" not in self._first and b"43" not in self._first:
            return 0.0
        return next(number_of(value) for code, value in self._tags if code in {b"43", b"40"})

    @property
    def bulges(self) -> bool:
        """Whether an edge of a line is an arc."""
        return b"42" in self._first and any(code == b"42" and number_of(value) != 0 for code, value in self._tags)

    def text(self, code: int, default: str = "") -> str:
        """The first value under a group code."""
        said = self._first.get(b"%d" % code)
        return default if said is None else said.decode("latin-1").strip()

    def number(self, code: int, default: float = 0.0) -> float:
        """The first value under a group code; 0 if it is no number."""
        said = self._first.get(b"%d" % code)
        return default if said is None else number_of(said)

    def points(self) -> tuple[list[float], list[float]]:
        """x and y of all vertices of a line, in units of the drawing."""
        tags = self._tags
        if self.kind == "POLYLINE":  # its own 10 and 20 are dummies
            tags = tags[next((place for place, tag in enumerate(tags) if tag[0] == b"0"), len(tags)) :]
        xs = [value for code, value in tags if code == b"10"]
        ys = [value for code, value in tags if code == b"20"]
        return _numbers(xs), _numbers(ys)


def number_of(text: bytes) -> float:
    """A value as a number; 0 if it is none, or has no end."""
    try:
        value = float(text)
    except ValueError:
        return 0.0
    return value if math.isfinite(value) else 0.0


def _numbers(texts: list[bytes]) -> list[float]:
    try:
        return list(map(float, texts))
    except ValueError:
        return [number_of(text) for text in texts]


def entities(data: bytes) -> Iterator[Entity]:
    """Every entity of the sections BLOCKS and ENTITIES, BLOCK and ENDBLK among them, and every LAYER of the tables."""
    section = b""
    block: str | None = None
    previous: tuple[str, int] | None = None
    alike: dict[tuple[bytes, bytes], Entity] = {}
    for match in _ENTITY.finditer(data):
        kind = match[1].decode("latin-1").rstrip(" \t").upper()
        if (
            previous is not None
            and previous[0] == "INSERT"
            and (plain := _PLAIN.fullmatch(data, previous[1], match.start()))
        ):
            layer, name, x, y = plain.groups()
            if (layer, name) in alike:
                alike[layer, name].copies.extend((number_of(x), number_of(y)))
            else:
                alike[layer, name] = Entity("INSERT", block, data[previous[1] : match.start()])
        elif previous is not None:
            yield from alike.values()
            alike.clear()
            entity = Entity(previous[0], block, data[previous[1] : match.start()])
            if entity.kind == "BLOCK":
                block = entity.block = entity.text(2)
            elif entity.kind == "ENDBLK":
                block = None
            yield entity
        previous = None
        if kind == "SECTION":
            said = _SECTION.match(data, match.end())
            section = b"" if said is None else said[1].upper()
            block = None
        elif section in _DRAWN or (section == b"TABLES" and kind == "LAYER"):
            previous = kind, match.end()
    yield from alike.values()


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
        readers=(("klayout", read_dxf),),
        suffixes=(".dxf",),
        layers="named",
        notes=True,
        takes_unit=True,
        reading="fork",
    )


FORMATS = (_format("dxf_r12", "R12"), _format("dxf_r2010", "R2010"))
