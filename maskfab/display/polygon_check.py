"""Emitters, circuits and lines measured again from their polygons, by KLayout's own geometry.

A placement is measured on a tile in which every pair of neighbours meets, lines across a panel on the whole panel.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from functools import lru_cache
from operator import sub
from typing import TypeAlias

import numpy as np
from klayout import db

from maskfab.base.arrays import Labels
from maskfab.base.model import CIRCUIT, CLEAR, EMITTERS, ORIENTATIONS, Layer, Panel, Point, Polygon, orient
from maskfab.display.circuit_boxes import BoxRules
from maskfab.display.emitter_rules import EmitterRules
from maskfab.display.free_area import meetings
from maskfab.display.panel_lines import PanelLines
from maskfab.display.pixel_lines import WireRules
from maskfab.mask.layout import simple_polygon
from maskfab.mask.outlines import unit_shapes

SQUARE = 2
"""Sized with this mode an edge keeps its square corners, so that sizes are Chebyshev distances."""
_Tile: TypeAlias = Sequence[tuple[int, Point]]
"""Contents and positions (column, row) of cells."""
_Pair: TypeAlias = tuple[int, int, Point]
# Pairs stand so far apart, in pixels, that no rule reaches from one to the next.
_APART, _COLUMNS = 4, 16
_BLOCK = 8
"""Cells along a side of the middle of a panel."""


@dataclass(frozen=True)
class Violation:
    """Violation of a rule.

    Attributes:
        area_um2: of what breaks it, on the whole tile.
        place_nm: of the first such area on the tile.
        outlines: of these areas in a pixel of orientation 0, its lower left corner the origin; empty without one.
    """

    rule: str
    area_um2: float
    place_nm: tuple[int, int]
    outlines: tuple[Polygon, ...] = ()


def violations(panel: Panel, rules: EmitterRules) -> tuple[Violation, ...]:
    """Every rule that the emitters of a panel break, on a tile that holds all pairs of neighbours of the panel.

    Gaps are tested by growing one shape by the gap and looking for what it covers of the other, widths by shrinking and
    growing back; gaps are exact, widths to 1 nm.
    """
    return _on_tiles(panel, lambda cells: _broken_by_emitters(panel, rules, cells))


def _broken_by_emitters(panel: Panel, rules: EmitterRules, cells: _Tile) -> tuple[Violation, ...]:
    single = [(cell, (_APART * number, 0)) for number, cell in enumerate(dict.fromkeys(cell for cell, _ in cells))]
    regions, alone = _regions(panel, cells, (CLEAR, *EMITTERS)), _regions(panel, single, EMITTERS)
    frame, own_frame = _frame(panel, cells), _frame(panel, single)

    def by_cell(layer: Layer, breaks: Callable[[db.Region, db.Region], db.Region]) -> db.Region:
        # Cells that keep a rule each by itself keep it together: squares that cover each cover all.
        found = breaks(alone[layer], own_frame)
        return found if found.is_empty() else breaks(regions[layer], frame)

    def narrow(shape: db.Region, _: db.Region) -> db.Region:
        # Doubled, so that half a width is a whole number too, and a nanometre short, so that what is exactly wide
        # enough does not vanish.
        doubled, half = shape.transformed(db.ICplxTrans(2.0)), rules.min_width_nm - 1
        opened = doubled.sized(-half, SQUARE).sized(half, SQUARE)
        return (doubled - opened).transformed(db.ICplxTrans(0.5))

    broken = [("emitter outside its pixel", by_cell(layer, sub)) for layer in EMITTERS]
    clear, gap_nm = regions[CLEAR], rules.gap_to_opening_nm
    taken = clear.sized(gap_nm, SQUARE)
    for layer in EMITTERS:
        # One region grown tells for all colours whether there is anything to look for.
        none = (taken & regions[layer]).is_empty()
        close = db.Region() if none else regions[layer].sized(gap_nm, SQUARE) & clear
        broken.append((f"gap from {layer.name.lower()} to openings", close))
        broken.append((f"width of {layer.name.lower()}", by_cell(layer, narrow)))
    red, green, blue = EMITTERS
    grown = {layer: regions[layer].sized(rules.colour_gap_nm, SQUARE) for layer in (red, green)}
    for one, other in ((red, green), (red, blue), (green, blue)):
        shared = grown[one] & regions[other]
        broken.append((f"gap between {one.name.lower()} and {other.name.lower()}", shared))
    upright = _upright(panel, cells)
    return tuple(told_of(rule, shapes, upright) for rule, shapes in broken if shapes.area())


def circuit_violations(panel: Panel, rules: BoxRules) -> tuple[Violation, ...]:
    """Every rule that the boxes of a panel's circuits break, on the tile of :func:`violations`.

    Every rectangle on the tile must be a box of a stated size, so that boxes that touch are told too. Without a gap
    they may touch, and the area that they cover must be the sum of theirs.
    """
    return _on_tiles(panel, lambda cells: _broken_by_circuits(panel, rules, cells))


def _broken_by_circuits(panel: Panel, rules: BoxRules, cells: _Tile) -> tuple[Violation, ...]:
    regions = _regions(panel, cells, (CLEAR, CIRCUIT))
    clear, drawn = regions[CLEAR], regions[CIRCUIT]
    sizes = {tuple(sorted((kind.width_nm, kind.height_nm))) for kind in rules.kinds}
    close, strange = db.Region(), db.Region()
    if rules.gap_nm:
        close = drawn.space_check(rules.gap_nm, False, db.Region.Square).polygons()
        for shape in drawn.each():
            box = shape.bbox()
            if not shape.is_box() or tuple(sorted((box.width(), box.height()))) not in sizes:
                strange.insert(shape)
    elif drawn.area() != len(cells) * sum(box.area_nm2 for box in panel.circuits):
        strange = drawn
    broken = [
        ("circuit outside its pixel", drawn - _frame(panel, cells)),
        ("gap from circuits to openings", drawn.sized(rules.to_opening_nm, SQUARE) & clear),
        ("gap between boxes of circuits", close),
        ("size of boxes of circuits", strange),
    ]
    upright = _upright(panel, cells)
    return tuple(told_of(rule, shapes, upright) for rule, shapes in broken if shapes.area())


def _frame(panel: Panel, cells: _Tile) -> db.Region:
    return db.Region([_pixel(panel, place) for _, place in cells])


def _upright(panel: Panel, cells: _Tile) -> db.Box | None:
    """The first pixel of orientation 0 on a tile; None if it has none."""
    return next((_pixel(panel, place) for cell, place in cells if cell == 0), None)


def _pixel(panel: Panel, place: tuple[int, int]) -> db.Box:
    (column, row), pitch = place, panel.pitch_nm
    return db.Box(column * pitch, row * pitch, (column + 1) * pitch, (row + 1) * pitch)


def left_of_emitters(panel: Panel, rules: EmitterRules, growth_nm: int) -> tuple[float, float, float]:
    """Red, green and blue area of a panel's emitters that keeps its gap to openings all of whose edges have moved.

    In the middle of the panel, where every pixel has all of its neighbours; as a share of what the emitters have there.

    Args:
        growth_nm: by which every edge of the openings has moved outwards; negative inwards.
    """
    held, pitch = _middle(panel), panel.pitch_nm
    rows, columns = held.shape
    cells = [(int(cell), (column, row)) for (row, column), cell in np.ndenumerate(held)]
    regions = _regions(panel, cells, (CLEAR, *EMITTERS))
    taken = regions[CLEAR].sized(rules.gap_to_opening_nm + growth_nm, SQUARE)
    frame = db.Region(db.Box(pitch, pitch, (columns - 1) * pitch, (rows - 1) * pitch))
    drawn = [regions[layer] & frame for layer in EMITTERS]
    red, green, blue = ((colour - taken).area() / max(1, colour.area()) for colour in drawn)
    return red, green, blue


def _middle(panel: Panel) -> Labels:
    """Orientations of the middle cells of a panel and a ring of neighbours round them; a narrow panel is repeated."""
    cells = panel.orientations
    first, size = zip(*((max(0, (extent - _BLOCK) // 2), min(extent, _BLOCK)) for extent in cells.shape), strict=True)
    around = [
        (np.arange(-1, many + 1) + at) % extent for at, many, extent in zip(first, size, cells.shape, strict=True)
    ]
    return np.asarray(cells[np.ix_(*around)])


def told_of(rule: str, shapes: db.Region, pixel: db.Box | None = None) -> Violation:
    """Violation by some shapes; outlined within a pixel, if one is given."""
    outlines: tuple[Polygon, ...] = ()
    if pixel is not None:
        inside = (shapes & db.Region(pixel)).moved(-pixel.left, -pixel.bottom)
        outlines = tuple(tuple((p.x, p.y) for p in polygon.each_point_hull()) for polygon in inside.merged().each())
    box = shapes.bbox()
    return Violation(rule, shapes.merged().area() / 1e6, (box.left, box.bottom), outlines)


def whole_panel(panel: Panel, wanted: Sequence[Layer]) -> dict[Layer, db.Region]:
    """Everything that the cells of a panel draw on some layers, its lower left corner the origin."""
    cells = [(int(cell), (column, row)) for (row, column), cell in np.ndenumerate(panel.orientations)]
    return _regions(panel, cells, wanted)


def _on_tiles(panel: Panel, broken: Callable[[_Tile], tuple[Violation, ...]]) -> tuple[Violation, ...]:
    """Rules broken on the tile of all pairs, which is not looked at where none is on that of unlike ones."""
    pairs = _pairs(panel)
    return broken(_tile(panel, pairs)) if broken(_tile(panel, _unlike(pairs))) else ()


def _unlike(pairs: Iterable[_Pair]) -> list[_Pair]:
    """Pairs of which none is another that is turned or mirrored as a whole, and so keeps the same rules."""
    return list({_first_turned(pair): pair for pair in pairs}.values())


@lru_cache(maxsize=2048)
def _first_turned(pair: _Pair) -> bytes:
    """A key of all pairs that are one and the same, turned or mirrored."""
    one, other, (right, up) = pair
    corners, drawn = np.arange(4).reshape(2, 2), []
    for first, second, x, y in ((one, other, right, up), (other, one, -right, -up)):
        tile = np.full((3, 2, 3, 2), -1)
        for cell, row, column in ((first, 1, 1), (second, 1 + y, 1 + x)):
            tile[row, :, column] = cell // ORIENTATIONS * 4 + orient(corners, cell % ORIENTATIONS)
        drawn += [orient(tile.reshape(6, 6), turn).tobytes() for turn in range(ORIENTATIONS)]
    return min(drawn)


def _pairs(panel: Panel) -> list[_Pair]:
    """Contents of the cells of every pair that meets, and the step (columns, rows) from the first to the second."""
    if panel.others:
        cells = panel.orientations
        pairs = [
            (int(one), int(other), step)
            for step, (low, high) in {
                (1, 0): (cells[:, :-1], cells[:, 1:]),
                (0, 1): (cells[:-1], cells[1:]),
                (1, 1): (cells[:-1, :-1], cells[1:, 1:]),
                (-1, 1): (cells[:-1, 1:], cells[1:, :-1]),
            }.items()
            for one, other in sorted(set(zip(low.ravel().tolist(), high.ravel().tolist(), strict=True)))
        ]
    else:
        beside, across = meetings(panel.orientations)
        pairs = [(*pair, step) for step, meeting in (((1, 0), beside), ((1, 1), across)) for pair in sorted(meeting)]
    return pairs


def _tile(panel: Panel, pairs: Sequence[_Pair]) -> _Tile:
    """Pairs, each by itself; a panel of one cell has none."""
    placed = []
    for number, (one, other, (right, up)) in enumerate(pairs):
        column, row = _APART * (number % _COLUMNS) + 1, _APART * (number // _COLUMNS)
        placed += [(one, (column, row)), (other, (column + right, row + up))]
    return placed or [(int(panel.orientations[0, 0]), (1, 0))]


def _regions(panel: Panel, cells: _Tile, wanted: Sequence[Layer]) -> dict[Layer, db.Region]:
    layout = db.Layout()
    layers = {layer: layout.layer(layer.number, layer.datatype) for layer in wanted}
    top = layout.create_cell("TILE")
    units: dict[int, int] = {}
    pitch = panel.pitch_nm
    for cell, (column, row) in cells:
        if cell not in units:
            unit = layout.create_cell(f"UNIT_{cell}")
            units[cell] = unit.cell_index()
            for layer, polygons in unit_shapes(panel, cell).items():
                if layer in layers:
                    for polygon in polygons:
                        unit.shapes(layers[layer]).insert(simple_polygon(polygon))
        top.insert(db.CellInstArray(units[cell], db.Trans(column * pitch, row * pitch)))
    return {layer: db.Region(top.begin_shapes_rec(index)).merged() for layer, index in layers.items()}


def line_violations(panel: Panel, laid: Sequence[PanelLines], rules: WireRules) -> tuple[Violation, ...]:
    """Every rule that lines break: their width, the space between and within them, their distance to openings.

    Distances are Chebyshev's, and lines that touch are told as lines that are not apart. Space is measured from edge to
    edge: KLayout compares a polygon with each that its box meets, edge by edge, and boxes of lines meet most others'.
    """
    clear = whole_panel(panel, (CLEAR,))[CLEAR]
    beside = db.Box(0, 0, *panel.size_nm).enlarged(panel.pitch_nm)
    broken = []
    for lines in laid:
        drawn = db.Region(lines.polygons(rules.line_nm))
        count, drawn = drawn.count(), drawn.merged()
        broken += [
            ("line far outside the panel", db.Region() if drawn.bbox().inside(beside) else drawn - db.Region(beside)),
            ("clearance of lines", drawn.sized(rules.clearance_nm, SQUARE) & clear),
            ("width of lines", drawn.width_check(rules.line_nm).polygons()),
            ("space between lines", drawn.edges().space_check(rules.space_nm, False, db.Region.Square).polygons()),
            ("lines that touch", drawn if drawn.count() != count else db.Region()),
        ]
    return tuple(told_of(rule, shapes) for rule, shapes in broken if not shapes.is_empty())
