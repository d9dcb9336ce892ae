"""Polygons cut by the lens stop, as directed edges for the polygon transform."""

from __future__ import annotations

import numpy as np
from klayout import db

from maskfab.base.arrays import Floats, Ints, Mask
from maskfab.base.model import Box
from maskfab.base.units import NM_PER_UM, UM_PER_NM
from maskfab.job.camera import Stop

_RIM_VERTICES = 4096
_LARGEST_COORDINATE = 400_000_000
_ROW = 1 << 32


def edges_in_stop(
    shapes: db.Region | Ints, stop: Stop, centre_nm: tuple[float, float], *, apart: bool = False
) -> tuple[Floats, float]:
    """Boundary of shapes ∩ stop about the stop's centre.

    A circle becomes a regular polygon of 4096 sides and the circle's own area, an ellipse that polygon stretched;
    coordinates are refined to a fraction of a nanometre first, so that neither the sides nor their rounding shows at
    1e-8.

    Args:
        shapes: what is clear, in nanometres; see :func:`stop_box` for how much of it is needed. Either a region, or
            int64 [n, 4] disjoint boxes, of which only those that the stop cuts are turned into polygons.
        centre_nm: where the optical axis meets the plate, to half a nanometre.
        apart: whether polygons of a region are known not to overlap, so that they need not be merged.

    Returns:
        Edges [n, 4] in micrometres (x0, y0, x1, y1; clear side on the left) and the clear area in µm². Where two boxes
        touch that the stop holds, neither has an edge; where it cuts one both have, and cancel in any integral.
    """
    if isinstance(shapes, db.Region):
        return _polygon_edges(shapes if apart or shapes.is_merged() else shapes.merged(True, 1), stop, centre_nm)
    corners = shapes - np.tile(centre_nm, 2)
    inside, outside = whole_or_away(stop.scaled(NM_PER_UM, NM_PER_UM), *corners.T)
    cut = db.Region()
    low_x, low_y, high_x, high_y = stop_box(stop, centre_nm)
    near = np.clip(shapes[~inside & ~outside], (low_x, low_y, low_x, low_y), (high_x, high_y, high_x, high_y))
    for box in near.tolist():
        cut.insert(db.Box(*box))
    rim, rim_area = _cut_edges(cut, stop, centre_nm)
    middle = np.rint(centre_nm).astype(np.int64)
    x0, y0, x1, y1 = (shapes[inside] - np.tile(middle, 2)).T
    level, upright = _sides(y0, y1, x0, x1), _sides(x1, x0, y0, y1)[:, [1, 0, 3, 2]]
    whole = (np.concatenate([level, upright]) + np.tile(middle - centre_nm, 2)) * UM_PER_NM
    return np.concatenate([whole, rim]), rim_area + float((UM_PER_NM**2 * (x1 - x0) * (y1 - y0)).sum())


def _sides(forth: Ints, back: Ints, start: Ints, end: Ints) -> Ints:
    """Sides of boxes that lie along one axis, int64 [n, 4] of start, line, end and line; what runs both ways is gone.

    Args:
        forth, back: lines along which a box has a side from start to end, and one from end to start, each less than
            half a metre from 0.
    """
    lines, ends = np.concatenate([forth, forth, back, back]), np.concatenate([start, end, end, start])
    # A bit tells what begins from what ends, so that whole numbers are sorted by themselves.
    begins = np.repeat([1, 0, 1, 0], len(start))
    place, begins = np.divmod(np.sort((lines * _ROW + ends) * 2 + begins), 2)
    first = np.flatnonzero(np.diff(place, prepend=np.iinfo(np.int64).min))
    place, count = place[first], np.cumsum(np.add.reduceat(2 * begins - 1, first)) if first.size else first
    turns = np.flatnonzero(np.diff(count, prepend=0))
    place, count = place[turns], count[turns]
    along = np.repeat(np.flatnonzero(count), np.abs(count[count != 0]))
    line = (place[along] + _ROW // 2) // _ROW
    low, high = place[along] - line * _ROW, place[along + 1] - line * _ROW
    sides = np.column_stack([low, line, high, line])
    return np.where((count[along] > 0)[:, None], sides, sides[:, [2, 1, 0, 3]])


def _polygon_edges(merged: db.Region, stop: Stop, centre_nm: tuple[float, float]) -> tuple[Floats, float]:
    """Edges of disjoint polygons; only those that the stop may cut are cut, for a boolean of all takes far longer."""
    boxes = (polygon.bbox() for polygon in merged.each())
    ends = np.fromiter((end for box in boxes for end in (box.left, box.bottom, box.right, box.top)), dtype=np.int64)
    inside, outside = whole_or_away(stop.scaled(NM_PER_UM, NM_PER_UM), *(ends.reshape(-1, 4) - np.tile(centre_nm, 2)).T)
    whole, near = db.Region(), db.Region()
    for polygon, held, away in zip(merged.each(), inside.tolist(), outside.tolist(), strict=True):
        if not away:
            (whole if held else near).insert(polygon)
    whole.merged_semantics = False
    # KLayout has the clear side on the right of an edge, the field formula on the left.
    corners = (c for e in whole.edges().each() for c in (e.x2, e.y2, e.x1, e.y1))
    edges = (np.fromiter(corners, dtype=np.float64).reshape(-1, 4) - np.tile(centre_nm, 2)) * UM_PER_NM
    rim, rim_area = _cut_edges(near & cutting_box(stop, centre_nm), stop, centre_nm)
    # A region's area is told in whole square nanometres of every polygon, of which slanted ones have halves.
    area = sum(polygon.area2() for polygon in whole.each()) / 2e6
    return np.concatenate([edges, rim]), area + rim_area


def _cut_edges(region: db.Region, stop: Stop, centre_nm: tuple[float, float]) -> tuple[Floats, float]:
    # As fine as booleans bear: corners of a small stop lie nanometres apart, and their rounding shows in its area.
    scale = 2 * max(1, int(_LARGEST_COORDINATE / (1.1 * stop.diameter_um * NM_PER_UM)))
    whole = [int(np.floor(c)) for c in centre_nm]
    local = region.moved(-whole[0], -whole[1])
    local.transform(db.ICplxTrans(float(scale)))
    local.move(*(round((w - c) * scale) for w, c in zip(whole, centre_nm, strict=True)))
    cut = local & stop_region(stop, NM_PER_UM * scale)
    cut.merge()
    per_um = UM_PER_NM / scale
    # KLayout has the clear side on the right of an edge, the field formula on the left.
    corners = (c for e in cut.edges().each() for c in (e.x2, e.y2, e.x1, e.y1))
    return np.fromiter(corners, dtype=np.float64).reshape(-1, 4) * per_um, cut.area() * per_um**2


def stop_box(stop: Stop, centre_nm: tuple[float, float], margin_nm: int = 0) -> Box:
    """A square of whole nanometres that holds the stop, a little more, and a margin."""
    reach = int(stop.diameter_um * 505) + 1 + margin_nm
    x, y = (round(c) for c in centre_nm)
    return x - reach, y - reach, x + reach, y + reach


def cutting_box(stop: Stop, centre_nm: tuple[float, float]) -> db.Region:
    """A square in which polygons have coordinates that bear a finer grid.

    Its sides are as far from the stop as they can be: they cut slanted edges at whole nanometres, and so turn them.
    """
    return db.Region(db.Box(*stop_box(stop, centre_nm, int(stop.diameter_um * NM_PER_UM / 2))))


def stop_region(stop: Stop, per_um: float) -> db.Region:
    """The stop about the origin, in so many database units per micrometre."""
    if not stop.round:
        return db.Region(_polygon(np.array(stop.corners_um) * per_um))
    turn = 2 * np.pi / _RIM_VERTICES
    angle = turn * (np.arange(_RIM_VERTICES) + 0.5)
    half = np.array(stop.sides_um) / 2 * per_um
    rim = half * np.sqrt(turn / np.sin(turn)) * np.stack([np.cos(angle), np.sin(angle)], axis=1)
    outline = db.Region(_polygon(rim))
    return outline - db.Region(_polygon(rim * stop.inner_share)) if stop.inner_share else outline


def _polygon(corners: Floats) -> db.Polygon:
    return db.Polygon([db.Point(int(px), int(py)) for px, py in np.rint(corners)])


def whole_or_away(stop: Stop, x0: Floats, y0: Floats, x1: Floats, y1: Floats) -> tuple[Mask, Mask]:
    """Which boxes the region that stands for a stop surely holds, and which lie surely outside.

    Args:
        stop: the stop, scaled to nanometres.
        x0, y0, x1, y1: ends of boxes about the stop's middle, in nanometres, of shapes that broadcast.
    """
    if stop.outline_um:
        corners = np.array(stop.outline_um)
        middle_x, middle_y, half_x, half_y = (x0 + x1) / 2, (y0 + y1) / 2, (x1 - x0) / 2, (y1 - y0) / 2
        shape = np.broadcast(middle_x, middle_y, half_x, half_y).shape
        met, within = np.zeros(shape, dtype=np.bool_), np.zeros(shape, dtype=np.bool_)
        for (px, py), (qx, qy) in zip(corners, np.roll(corners, -1, axis=0), strict=True):
            length = np.hypot(qx - px, qy - py)
            across, up = (qx - px) / length, (qy - py) / length
            # Box and side are apart if they are so along an axis or along the side's normal.
            off_x, off_y = middle_x - (px + qx) / 2, middle_y - (py + qy) / 2
            met |= (
                (abs(off_x) < half_x + abs(qx - px) / 2 + 1)
                & (abs(off_y) < half_y + abs(qy - py) / 2 + 1)
                & (abs(off_x * up - off_y * across) < half_x * abs(up) + half_y * abs(across) + 1)
            )
            if py != qy:
                within ^= ((py <= middle_y) != (qy <= middle_y)) & (
                    middle_x > px + (middle_y - py) * ((qx - px) / (qy - py))
                )
        return within & ~met, ~within & ~met
    (far_x, near_x), (far_y, near_y) = (_far_and_near(low, high) for low, high in ((x0, x1), (y0, y1)))
    width, height = stop.sides_um
    if not stop.round:
        inside = (far_x <= width / 2) & (far_y <= height / 2)
        return np.asarray(inside), np.asarray((near_x >= width / 2) | (near_y >= height / 2))
    across, up = stop.diameter_um / width, stop.diameter_um / height
    far, near = np.hypot(far_x * across, far_y * up), np.hypot(near_x * across, near_y * up)
    # Sides of the polygon that stands for the circle come this much closer to its middle.
    low, high = np.cos(np.pi / _RIM_VERTICES), 1 + 1 / _RIM_VERTICES
    reach, hole = stop.diameter_um / 2, stop.diameter_um / 2 * stop.inner_share
    slack = max(across, up)
    inside, outside = far < reach * low - slack, near > reach * high + slack
    if hole:
        inside, outside = inside & (near > hole * high + slack), outside | (far < hole * low - slack)
    return np.asarray(inside), np.asarray(outside)


def _far_and_near(low: Floats, high: Floats) -> tuple[Floats, Floats]:
    """The largest and the least distance from 0 along one axis."""
    far, near = np.maximum(abs(low), abs(high)), np.minimum(abs(low), abs(high))
    return far, np.where((low < 0) & (high > 0), 0.0, near)
