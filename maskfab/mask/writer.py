"""Shapes as a writer makes them of drawn ones, corners rounded by its beam and edges moved by its bias; and data out of
which the bias has been taken, so that the plate comes out as designed.

Corners of either kind are rounded by the corner radius, then what is clear grows by half the CD bias all round. Dots
that only share a corner have no one written shape. Two readings bound what a writer makes of them: ``fused``, one
shape whose neck the rounding opens to 2 (√2 - 1) r + bias, and ``open``, each dot rounded apart with a gap of
2 (√2 - 1) r - bias between them, where that is positive.

A writer whose clear widths come out wider by a bias gets clear shapes that are narrower by it: every edge is moved by
half of it, across cells too, and square corners stay square. Sized are the dies and :data:`SIZED` marks whose outlines
run along x and y. Titles, labels, the map of the dies, stars and marks of an extent stay as drawn: sizing has no exact
way back for slanted outlines, and an extent is to be kept.

Notes:
    Arcs are the sides of regular polygons of 64, whose radius is chosen so that a rounded corner loses what a circle
    takes from it, (1 - π/4) r²; no point of the outline is farther than :func:`sagitta_um` from the circle's.
    Without a radius corners stay sharp under a bias, as they do where a Manhattan shape is sized; with one they are
    sized as arcs, to the radius r + bias / 2 on the outside of a clear shape and r - bias / 2 on its inside.
"""

from __future__ import annotations

from dataclasses import dataclass
from enum import StrEnum

import numpy as np
from klayout import db
from numpy.typing import NDArray

from maskfab.base.arrays import Floats, Mask
from maskfab.base.errors import JobError
from maskfab.base.model import Mark, Panel, Plate, frozen
from maskfab.base.units import NM_PER_UM
from maskfab.job.process import Process
from maskfab.mask.layout import drawn_region
from maskfab.mask.raster import coverage

SIZED = ("cd", "resolution", "fiducial", "alignment", "parity", "code")
"""Kinds of marks whose widths count."""
_SQUARE = 2
"""KLayout's way of sizing in which right angles stay sharp."""


def biased_data(clear: db.Region, plate: Plate, bias_nm: int) -> db.Region:
    """Clear shapes as data, merged, kissing corners apart; the writer widens by an even bias, marks as drawn."""
    return _resized(clear, plate, -bias_nm)


def written_of(data: db.Region, plate: Plate, bias_nm: int) -> db.Region:
    """Shapes that the writer makes of biased data, exactly those of :func:`biased_data` where no gap was closed."""
    return _resized(data, plate, bias_nm)


def check_bias(plate: Plate, bias_nm: int, where: str = "process.cd_bias") -> None:
    """Refuse a bias at which shapes vanish from the data, or gaps between them close.

    Raises:
        JobError: MF127 for the first die, gutter or mark that does not bear it.
    """
    reach, cure = abs(bias_nm), 'let the house make it good: order.bias = "house"'
    data = f"data biased by {bias_nm / NM_PER_UM:g} um"
    for die in plate.dies:
        for name, length in (("dots", die.panel.dot_nm), ("a gutter", die.panel.gutter_nm or reach + 1)):
            if length <= reach:
                raise JobError(
                    "MF127",
                    f"{data} need {name} of more than {reach / NM_PER_UM:g} um, and die {die.name} has "
                    f"{length / NM_PER_UM:g} um",
                    where=f"{where}, die {die.name}",
                    cure=f"Use larger dots, a wider gutter or none, or {cure}",
                )
    marks = sum((drawn_region(mark.polygons) for mark in plate.marks if _sized(mark)), start=db.Region())
    lost = _moved(_moved(marks, -bias_nm), bias_nm) ^ marks
    if not lost.is_empty():
        what = f"{data} lose a mark or close a gap of one at {_place(lost)}"
        raise JobError("MF127", what, where=where, cure=f"Use larger dots, after which marks are sized, or {cure}")
    rooms = db.Region([db.Box(*die.box_nm).enlarged(reach, reach) for die in plate.dies])
    near = rooms.merged(False, 2) + (rooms & (marks + _kept(plate))) + (_moved(marks, 2 * reach) & _kept(plate))
    if not near.is_empty():
        what = f"{data} need more than {reach / NM_PER_UM:g} um between dies and marks, at {_place(near)} there is less"
        raise JobError("MF127", what, where=where, cure=f"Leave more room between dies and marks, or {cure}")


def _place(region: db.Region) -> str:
    box = min((polygon.bbox() for polygon in region.each()), key=lambda polygon: (polygon.bottom, polygon.left))
    return f"({box.left / NM_PER_UM:.3f}, {box.bottom / NM_PER_UM:.3f}) um"


def _resized(shapes: db.Region, plate: Plate, by_nm: int) -> db.Region:
    unsized = _kept(plate)
    return (_moved(shapes - unsized, by_nm) + (shapes & unsized)).merged(True, 1)


def _moved(shapes: db.Region, by_nm: int) -> db.Region:
    """Shapes whose widths are larger by an even number of nanometres."""
    half = by_nm // 2
    return shapes.merged(True, 1).sized(half, half, _SQUARE).merged(True, 1)


def _kept(plate: Plate) -> db.Region:
    unsized = db.Region()
    for mark in plate.marks:
        if mark.layer.written and not _sized(mark):
            unsized += drawn_region(mark.polygons)
    return unsized.merged(True, 1)


def _sized(mark: Mark) -> bool:
    return mark.layer.written and mark.kind in SIZED and bool(drawn_region(mark.polygons).non_rectilinear().is_empty())


ARC_SIDES = 64
CONFIGURATIONS = 16
UNITS_PER_UM = 16_000
"""Corners are made on a grid of 1/16 nm, so that its rounding does not show beside the sides of the arcs."""

_ROUGHEST, _LONGEST = 1 / 12, 1 / 4
"""Root mean square and correlation length of rough edges over a dot's side: three of the one on either side of a line
leave half of it, and the halo of an edge is then known to a seventh."""
_SIDES = ((0, 1), (1, 1), (0, -1), (1, -1))


class Reading(StrEnum):
    """Outcome of touching corners in writing."""

    FUSED = "fused"
    OPEN = "open"


@dataclass(frozen=True, eq=False)
class WrittenCorner:
    """The tile around one vertex of a grid of dots as written, half a dot along each side.

    Coordinates are micrometres from the vertex. The clear side is on the left of directed edges x0, y0, x1, y1.

    Attributes:
        outline_um: float64 [n, 4] edges between clear and dark.
        border_um: float64 [m, 4] edges of what is clear along the right, upper, left and lower side of the tile.
        shares: float64 [k, k] clear share of each of k x k parts of the tile, lowest row first.
        region: the clear part of the tile, in units of 1 / :data:`UNITS_PER_UM`.
    """

    outline_um: Floats
    border_um: tuple[Floats, Floats, Floats, Floats]
    area_um2: float
    shares: Floats
    region: db.Region


def sagitta_um(process: Process, arc_sides: int = ARC_SIDES) -> float:
    """Largest distance between the outline of an arc and its circle, in micrometres; 0 without a corner radius."""
    if process.corner_radius_um == 0:
        return 0.0
    furthest = _equal_area(arc_sides) / np.cos(np.pi / arc_sides) - 1
    return float(furthest * (process.corner_radius_um + abs(process.cd_bias_um) / 2))


def check_process(process: Process, panel: Panel, where: str = "") -> None:
    """Refuse what cannot be written on dots as small as a panel's.

    Raises:
        JobError: MF127 where the corners of a dot meet (radius + |bias| / 2 above half a dot), where cells grow into
            each other across their gutter, or where edges are too rough for the dots.
    """
    radius, bias = process.corner_radius_um, process.cd_bias_um
    reach, dot = radius + abs(bias) / 2, panel.dot_nm / NM_PER_UM
    if 2 * reach > dot * (1 + 1e-12) or -bias >= dot:
        what = (
            f"corners of radius {radius:g} um and edges moved by {bias / 2:g} um need dots of {2 * reach:g} um, "
            f"these are {dot:g} um"
        )
        raise JobError("MF127", what, where=where, cure=f"Use larger dots, or {_bearable(process, panel)}")
    gutter = panel.gutter_nm / NM_PER_UM
    if 0 < gutter <= bias:
        what = f"a CD bias of {bias:g} um closes the gutter of {gutter:g} um between the cells"
        raise JobError("MF127", what, where=where, cure=f"Use a gutter of more than {bias:g} um, or a smaller bias")
    rough, narrowest = process.roughness, min(dot, gutter or dot)
    if rough is not None and (rough.sigma_um > narrowest * _ROUGHEST or rough.correlation_um > dot * _LONGEST):
        raise JobError(
            "MF127",
            f"edges that are rough by {rough.sigma_um:g} um over {rough.correlation_um:g} um are not independent of "
            f"each other on dots of {dot:g} um" + (f" beside gutters of {gutter:g} um" if gutter else ""),
            where=where,
            cure=f"Use a sigma of at most {narrowest * _ROUGHEST:.3g} um and a correlation of at most "
            f"{dot * _LONGEST:g} um, or larger dots",
        )


def _bearable(process: Process, panel: Panel) -> str:
    """The largest process that a panel's dots and gutters allow, in words."""
    dot, gutter, bias = panel.dot_nm / NM_PER_UM, panel.gutter_nm / NM_PER_UM, process.cd_bias_um
    if abs(bias) < dot:
        return f"a corner radius of at most {(dot - abs(bias)) / 2:g} um"
    most = min(dot, gutter) if gutter else dot
    together = "; its size and twice the corner radius are together at most a dot" if process.corner_radius_um else ""
    return f"a cd_bias of more than {-dot:g} um and less than {most:g} um{together}"


def written_region(
    drawn: db.Region, process: Process, reading: Reading, units_per_um: float = 1000.0, arc_sides: int = ARC_SIDES
) -> db.Region:
    """Drawn polygons as a writer exposes them.

    Args:
        reading: what becomes of corners that only touch.
        units_per_um: units of the region's coordinates in a micrometre.
        arc_sides: sides of a whole circle.

    Returns:
        A merged region in the same units. Without radius and bias it is the drawn one, merged: polygons that touch in
        a corner are one in the fused reading and several in the open one. An edge shorter than two radii has its
        corners rounded by less; :func:`check_process` refuses panels with such edges.
    """
    apart = reading is Reading.OPEN
    written = drawn.merged(apart, 1)
    if process.corner_radius_um > 0:
        inner, outer = (
            units_per_um * _rounding(process.corner_radius_um, growth, arc_sides)
            for growth in (-process.cd_bias_um / 2, process.cd_bias_um / 2)
        )
        written = written.rounded_corners(inner, outer, arc_sides)
    growth = round(process.cd_bias_um / 2 * units_per_um)
    if growth:
        written = written.merged(apart, 1).sized(growth, growth, 2)
    return written.merged(apart, 1)


def written_corners(
    dot_um: float, process: Process, reading: Reading, parts: int, arc_sides: int = ARC_SIDES
) -> tuple[WrittenCorner, ...]:
    """The written shape round a vertex for each of the 16 ways in which the four dots that meet there can be clear.

    Wherever radius and bias reach less than half a dot, these tiles laid side by side are the written shape of any
    panel: what happens at a vertex depends on the four dots round it alone, across the borders of cells too.

    Args:
        parts: k of :attr:`WrittenCorner.shares`.

    Returns:
        By configuration, the sum of 1, 2, 4, 8 for lower left, lower right, upper left, upper right clear.
    """
    dot = dot_um * UNITS_PER_UM
    far, half = round(4 * dot), round(dot / 2)
    tile = db.Region(db.Box(-half, -half, half, half))
    quadrants = [db.Box(min(x, 0), min(y, 0), max(x, 0), max(y, 0)) for y in (-far, far) for x in (-far, far)]
    corners = []
    for configuration in range(CONFIGURATIONS):
        drawn = db.Region()
        for bit, quadrant in enumerate(quadrants):
            if configuration >> bit & 1:
                drawn.insert(quadrant)
        written = (written_region(drawn, process, reading, UNITS_PER_UM, arc_sides) & tile).merged(True, 1)
        corners.append(_corner(written, half, parts))
    return tuple(corners)


def configurations(clear: Mask) -> NDArray[np.uint8]:
    """Which of the four dots round every vertex are clear, uint8 [ny + 1, nx + 1]; beyond the array all is dark.

    Args:
        clear: bool [..., ny, nx], row 0 lowest.
    """
    sides = [(0, 0)] * (clear.ndim - 2) + [(1, 1), (1, 1)]
    dots = np.pad(clear.astype(np.uint8), sides)
    below, above = dots[..., :-1, :], dots[..., 1:, :]
    left, right = slice(None, -1), slice(1, None)
    vertices: NDArray[np.uint8] = (
        below[..., left] + 2 * below[..., right] + 4 * above[..., left] + 8 * above[..., right]
    )
    return vertices


def _corner(written: db.Region, half: int, parts: int) -> WrittenCorner:
    # KLayout has the clear side on the right of an edge.
    flat = (c for e in written.edges().each() for c in (e.x2, e.y2, e.x1, e.y1))
    edges = np.fromiter(flat, dtype=np.float64).reshape(-1, 4)
    along = [(edges[:, axis] == sign * half) & (edges[:, axis + 2] == sign * half) for axis, sign in _SIDES]
    right, upper, left, lower = (frozen(edges[side] / UNITS_PER_UM) for side in along)
    lines = np.linspace(-half, half, parts + 1)
    return WrittenCorner(
        outline_um=frozen(edges[~np.any(along, axis=0)] / UNITS_PER_UM),
        border_um=(right, upper, left, lower),
        area_um2=written.area() / UNITS_PER_UM**2,
        shares=frozen(coverage(written, lines, lines)),
        region=written,
    )


def _rounding(radius: float, growth: float, arc_sides: int) -> float:
    """Radius of the polygon that, once its arc has grown, takes as much from a right angle as the grown circle."""
    grown = radius + growth
    return radius if grown <= 0 else grown * _equal_area(arc_sides) - growth


def _equal_area(arc_sides: int) -> float:
    """Radius of a polygon's inscribed circle over that of the circle that takes as much from a right angle."""
    taken = 1 - arc_sides / 4 * np.tan(np.pi / arc_sides)
    return float(np.sqrt((1 - np.pi / 4) / taken))
