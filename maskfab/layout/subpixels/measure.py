"""A placement measured again from its polygons, by KLayout's own geometry, on a tile in which every pair meets."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from klayout import db
from numpy.typing import NDArray

from maskfab.geometry.region import simple_polygon
from maskfab.geometry.unit import unit_shapes
from maskfab.layout.subpixels.borders import meetings
from maskfab.layout.subpixels.rules import EmitterRules
from maskfab.model import CLEAR, EMITTERS, Panel

# Sized with this mode an edge keeps its square corners, so that sizes are Chebyshev distances.
_SQUARE = 2
_TILE = 32


@dataclass(frozen=True)
class Violation:
    """What breaks a rule: which one, the area in question, and where, in nanometres on the tile."""

    rule: str
    area_um2: float
    place_nm: tuple[int, int]


def violations(panel: Panel, rules: EmitterRules) -> tuple[Violation, ...]:
    """Every rule that the emitters of a panel break, on a tile whose pixels meet in all the pairs of the panel's.

    Gaps are tested by growing one shape by the gap and looking for what it covers of the other, widths by shrinking and
    growing back; gaps are exact, widths to 1 nm.
    """
    tile = _tile(panel.orientations)
    regions = _regions(panel, tile)
    clear, colours = regions[CLEAR], [regions[layer] for layer in EMITTERS]
    wide = panel.pitch_nm
    frame = db.Region(db.Box(0, 0, wide * tile.shape[1], wide * tile.shape[0]))
    found = [_found("emitter outside its panel", shape - frame) for shape in colours]
    for name, shape in zip(("red", "green", "blue"), colours, strict=True):
        grown = shape.sized(rules.gap_to_opening_nm, _SQUARE)
        found.append(_found(f"gap from {name} to openings", grown & clear))
        # Doubled, so that half a width is a whole number too, and a nanometre short, so that what is exactly wide
        # enough does not vanish.
        doubled, half = shape.transformed(db.ICplxTrans(2.0)), rules.min_width_nm - 1
        opened = doubled.sized(-half, _SQUARE).sized(half, _SQUARE)
        found.append(_found(f"width of {name}", (doubled - opened).transformed(db.ICplxTrans(0.5))))
    for one, other in ((0, 1), (0, 2), (1, 2)):
        close = colours[one].sized(rules.colour_gap_nm, _SQUARE) & colours[other]
        found.append(_found(f"gap between {EMITTERS[one].name.lower()} and {EMITTERS[other].name.lower()}", close))
    return tuple(each for each in found if each is not None)


def _found(rule: str, shapes: db.Region) -> Violation | None:
    area = shapes.merged().area()
    if not area:
        return None
    box = shapes.bbox()
    return Violation(rule, area / 1e6, (box.left, box.bottom))


def _tile(orientations: NDArray[np.int8]) -> NDArray[np.int8]:
    """A part of the map, or all of it, in which the same pairs meet."""
    wanted = meetings(orientations)
    rows, columns = orientations.shape
    side = _TILE
    while side < max(rows, columns):
        part = orientations[:side, :side]
        if meetings(part) == wanted:
            return part
        side *= 2
    return orientations


def _regions(panel: Panel, tile: NDArray[np.int8]) -> dict[object, db.Region]:
    layout = db.Layout()
    layers = {layer: layout.layer(layer.number, layer.datatype) for layer in (CLEAR, *EMITTERS)}
    top = layout.create_cell("TILE")
    units = {}
    for cell in np.unique(tile).tolist():
        unit = layout.create_cell(f"UNIT_{cell}")
        for layer, polygons in unit_shapes(panel, cell).items():
            if layer in layers:
                for polygon in polygons:
                    unit.shapes(layers[layer]).insert(simple_polygon(polygon))
        units[cell] = unit.cell_index()
    for row, line in enumerate(tile.tolist()):
        for column, cell in enumerate(line):
            top.insert(db.CellInstArray(units[cell], db.Trans(column * panel.pitch_nm, row * panel.pitch_nm)))
    return {layer: db.Region(top.begin_shapes_rec(index)).merged() for layer, index in layers.items()}
