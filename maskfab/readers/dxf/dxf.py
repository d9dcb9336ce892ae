"""Open lines, curves and other shapes of a text DXF that are no closed polygons, found before a reader interprets them.

Readers of DXF turn arcs into chords, leave splines out, and take open lines for paths without width, each without a
word. A mask has polygons only, so such drawings are refused and named. What is drawn out of sight, and what on the grid
and what beside it, is found on the way.
"""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass
from pathlib import Path

from klayout import db

from maskfab.errors import SourceError
from maskfab.geometry.shape_limits import MOST_LAYERS, too_many_layers
from maskfab.model import CHROME, CLEAR
from maskfab.readers.dxf.entities import Unseen
from maskfab.readers.dxf.grid import DrawingGrid
from maskfab.readers.dxf.text_entities import Entity, entities

# klayout's mode "automatic" takes all closed lines for paths without width as soon as there is one SOLID or HATCH, and
# modes 3 and 4 take what two polygons share, or one has within another, away from both. Mode 2 makes each closed line
# a polygon of its own, and only leaves lines alone that return to their start without being said to be closed.
POLYLINE_MODE = 2

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


@dataclass(frozen=True)
class DrawingFacts:
    """Facts from the text of a drawing that klayout does not report.

    Attributes:
        rounding_nm: the largest distance by which a coordinate is moved to the nanometre grid.
        repeated_vertices: vertices that then repeat the one before.
    """

    rounding_nm: float
    repeated_vertices: int


def look_through(path: Path, data: bytes, nm_per_unit: float) -> DrawingFacts:
    """Refuse a drawing with open lines, curves or fills, or out of sight; on other layers if nothing lies on CLEAR.

    Args:
        path: the file, for errors.
        data: its content, a text DXF.
        nm_per_unit: length of one unit of the drawing.

    Raises:
        SourceError: MF303 blocks that contain themselves or are lacking, MF310 open lines or fills, MF311 arcs,
            splines and bulges, MF313 too many layers, MF317 shapes in paper space, on frozen layers, invisible, or out
            of the plane.
    """
    found: Counter[tuple[str, str, str]] = Counter()
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
            found[(*fault, layer)] += 1
        else:
            grid.add(entity)

    def counts(layer: str) -> bool:
        return not clear_drawn or layer in _COUNTING

    _refuse_blocks(path, grid)
    _refuse_unseen(path, unseen.told(counts, grid.drawing(counts)))
    _refuse_faults(path, {key: count for key, count in found.items() if counts(key[2])})
    return DrawingFacts(grid.rounding_nm(counts), grid.repeated_vertices(counts))


def _refuse_faults(path: Path, faults: dict[tuple[str, str, str], int]) -> None:
    if faults:
        told = [f"{count} x {what} on layer {layer!r}" for (_, what, layer), count in sorted(faults.items())]
        raise SourceError(
            max(code for code, _, _ in faults),
            f"{path.name} draws {', '.join(told[:6])}; a mask has closed polygons only",
            where=str(path),
            cure="Close its lines, take its points out, and turn curves into polygons in the program that drew them",
        )


def _refuse_unseen(path: Path, told: list[str]) -> None:
    if told:
        raise SourceError(
            "MF317",
            f"{path.name} draws {', '.join(told[:6])}; a mask contains visible shapes of model space only",
            where=str(path),
            cure="Delete what is not part of the mask, draw the rest flat in model space, and show all its layers",
        )


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
