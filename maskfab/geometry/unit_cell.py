"""Shapes of one cell of a panel on every layer: openings, emitters, wires, gutter and black matrix."""

from __future__ import annotations

from collections.abc import Mapping
from typing import NamedTuple

from maskfab.geometry.polygonize import outline
from maskfab.model import (
    BLACK,
    CLEAR,
    EMITTERS,
    GUTTER,
    ORIENTATIONS,
    VEIL,
    WIRES,
    Layer,
    Panel,
    Point,
    Polygon,
    Track,
    orient,
    refined,
)


class UnitKey(NamedTuple):
    """Key of a unit cell: equal for two cells that are drawn once."""

    opening: str
    mask: bytes
    dot_nm: int
    gutter_nm: int
    orientation: int
    emitters: tuple[bytes, int] | None
    tracks: tuple[Track, ...]


def unit_key(panel: Panel, cell: int) -> UnitKey:
    """The key of what a cell of a panel draws."""
    opening = panel.openings[cell // ORIENTATIONS]
    drawn = panel.emitters
    emitters = None if drawn is None else (drawn.labels.tobytes(), drawn.cell_nm)
    mask, orientation = opening.mask.tobytes(), cell % ORIENTATIONS
    return UnitKey(opening.name, mask, panel.dot_nm, panel.gutter_nm, orientation, emitters, panel.tracks)


def unit_name(panel: Panel, cell: int) -> tuple[str, str]:
    """Stem and suffix of a unit's name: the opening's, and ``_D<dot>_G<gutter>_R<orientation>``."""
    opening = panel.openings[cell // ORIENTATIONS]
    return opening.name, f"_D{panel.dot_nm}_G{panel.gutter_nm}_R{cell % ORIENTATIONS}"


def unit_shapes(panel: Panel, cell: int) -> Mapping[Layer, tuple[Polygon, ...]]:
    """Simple, hole-free outlines by layer; the cell's lower left corner, gutter included, is the origin.

    Emitters turn with their opening, and so do the tracks that say so. The gutter and the black matrix (what neither
    passes light nor emits) are drawn where emitters or wires are; a panel of openings alone has only these.
    """
    orientation, half = cell % ORIENTATIONS, panel.gutter_nm // 2
    shapes = {CLEAR: outline(panel.pattern(cell), panel.dot_nm, (half, half))}
    if panel.emitters is None and not panel.tracks:
        return shapes
    for track in panel.tracks:
        # A quarter turn lays a wire along the other axis, and so on the other metal: no pixel needs a via to the next.
        upper = (track.axis == "y") != (track.turns and orientation % 2 == 1)
        layer = VEIL if track.transmission else WIRES[upper]
        shapes[layer] = (*shapes.get(layer, ()), *oriented_track(track, panel.pitch_nm, orientation))
    dark, side = ~panel.pattern(cell), panel.dot_nm
    if panel.emitters is not None:
        labels, side = orient(panel.emitters.labels, orientation), panel.emitters.cell_nm
        for colour, layer in enumerate(EMITTERS, 1):
            shapes[layer] = outline(labels == colour, side, (half, half))
        dark = refined(dark, panel.dot_nm // side) & (labels == 0)
    shapes[BLACK] = outline(dark, side, (half, half))
    if half:
        shapes[GUTTER] = _ring(panel.pitch_nm, half)
    return {layer: polygons for layer, polygons in shapes.items() if polygons}


def oriented_track(track: Track, pitch_nm: int, orientation: int) -> tuple[Polygon, ...]:
    """A track's outlines in a cell of that orientation, as :func:`maskfab.model.orient` turns its opening."""
    if not track.turns:
        return track.polygons
    return tuple(tuple(_turned(point, pitch_nm, orientation) for point in polygon) for polygon in track.polygons)


def _turned(point: Point, pitch_nm: int, orientation: int) -> Point:
    x, y = point
    if orientation >= 4:
        x = pitch_nm - x
    for _ in range(orientation % 4):
        x, y = pitch_nm - y, x
    return x, y


def _ring(pitch: int, half: int) -> tuple[Polygon, ...]:
    """The gutter's share of a cell as four bars that do not overlap."""
    inner = pitch - half
    bars = [(0, 0, pitch, half), (0, inner, pitch, pitch), (0, half, half, inner), (inner, half, pitch, inner)]
    return tuple(((x0, y0), (x1, y0), (x1, y1), (x0, y1)) for x0, y0, x1, y1 in bars)
