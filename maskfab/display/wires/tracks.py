"""Wires as polygons: straight ones in the gutters, crooked ones through closed area, transparent ones across.

Everything along x lies on the lower metal and everything along y on the upper, in every orientation, so pixels meet
without vias.
"""

from __future__ import annotations

from collections.abc import Iterable
from typing import Literal

import numpy as np
from klayout import db
from numpy.typing import NDArray

from maskfab.display.wires.flow import Direction, Net
from maskfab.display.wires.gutter import WireRules
from maskfab.display.wires.routing import RoutingGrid
from maskfab.model import Polygon, Track

Axis = Literal["x", "y"]
_AXES: dict[Direction, Axis] = {"vertical": "y", "horizontal": "x"}


def gutter_tracks(pitch_nm: int, gutter_nm: int, count: int, rules: WireRules) -> tuple[Track, ...]:
    """``count`` lines along each axis, centred in the gutters; a pixel draws its half of each gutter."""
    step = rules.line_nm + rules.space_nm
    # Of a gutter centred on the pixel's border at 0, what reaches into this pixel, and into the one before.
    starts = [round((number - (count - 1) / 2) * step - rules.line_nm / 2) for number in range(count)]
    bars = []
    for start in starts:
        for low in (start, start + pitch_nm):
            bounded = max(low, 0), min(low + rules.line_nm, pitch_nm)
            if bounded[0] < bounded[1]:
                bars.append(bounded)
    across = tuple(_box(0, low, pitch_nm, high) for low, high in bars)
    upright = tuple(_box(low, 0, high, pitch_nm) for low, high in bars)
    return (Track("gutter", "x", across, False), Track("gutter", "y", upright, False)) if bars else ()


def routed_track(
    grid: RoutingGrid, direction: Direction, places: Iterable[int], pitch_nm: int, rules: WireRules
) -> Track:
    """One line for each port, along free nodes from border to border; port i comes out as port i."""
    ports = np.array(sorted(places), dtype=np.intp)
    paths = Net(grid.free, direction).paths(ports)
    polygons = tuple(_line(path, grid.places_nm, direction, pitch_nm, rules.line_nm) for path in paths)
    return Track("line", _AXES[direction], polygons, True)


def transparent_tracks(pitch_nm: int, width_nm: int, transmission: float) -> tuple[Track, Track]:
    """A transparent wire along each axis through the middle of every pixel."""
    low = (pitch_nm - width_nm) // 2
    return (
        Track("transparent", "x", (_box(0, low, pitch_nm, low + width_nm),), False, transmission),
        Track("transparent", "y", (_box(low, 0, low + width_nm, pitch_nm),), False, transmission),
    )


def _line(
    path: NDArray[np.intp], places_nm: NDArray[np.int64], direction: Direction, pitch_nm: int, width_nm: int
) -> Polygon:
    """The outline of a line along nodes (row, column), drawn on to both borders."""
    points = [(int(places_nm[column]), int(places_nm[row])) for row, column in path]
    (x0, y0), (x1, y1) = points[0], points[-1]
    ends = ((x0, 0), (x1, pitch_nm)) if direction == "vertical" else ((0, y0), (pitch_nm, y1))
    whole = [db.Point(*point) for point in (ends[0], *points, ends[1])]
    outline = db.Path(whole, width_nm).simple_polygon()
    return tuple((point.x, point.y) for point in outline.each_point())


def _box(x0: int, y0: int, x1: int, y1: int) -> Polygon:
    return (x0, y0), (x1, y0), (x1, y1), (x0, y1)
