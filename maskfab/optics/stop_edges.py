"""Polygons cut by the lens stop, as directed edges for the polygon transform."""

from __future__ import annotations

import numpy as np
from klayout import db

from maskfab.base.arrays import Floats, Ints, Mask, expanded
from maskfab.base.model import Box
from maskfab.base.units import NM_PER_UM, UM_PER_NM
from maskfab.job.camera import Stop

_RIM_VERTICES = 4096
_LARGEST_COORDINATE = 400_000_000
_ROW, _MET_PER_SECOND = 1 << 32, 1e8


def edges_in_stop(
    shapes: db.Region | Ints, stop: Stop, centre_nm: tuple[float, float], *, apart: bool = False
) -> tuple[Floats, float]:
    """Boundary of shapes ∩ stop about the stop's centre.

    A circle becomes a regular polygon of 4096 sides and the circle's own area, an ellipse that polygon stretched.
    Before a stop with corners coordinates are refined to a fraction of a nanometre, so that their rounding does not
    show at 1e-8; the area before a round one is exact.

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
        merged = shapes if apart or shapes.is_merged() else shapes.merged(True, 1)
        if not stop.round:
            return _polygon_edges(merged, stop, centre_nm)
        return _in_round_stop((region_edges(merged) - np.tile(centre_nm, 2)) * UM_PER_NM, stop)
    corners = shapes - np.tile(centre_nm, 2)
    inside, outside = whole_or_away(stop.scaled(NM_PER_UM, NM_PER_UM), *corners.T)
    near = shapes[~inside & ~outside]
    if stop.round:
        corners = (near - np.tile(centre_nm, 2)) * UM_PER_NM
        sides = ((0, 1, 2, 1), (2, 1, 2, 3), (2, 3, 0, 3), (0, 3, 0, 1))
        rim, rim_area = _in_round_stop(np.concatenate([corners[:, side] for side in sides]), stop)
    else:
        low_x, low_y, high_x, high_y = stop_box(stop, centre_nm)
        near = np.clip(near, (low_x, low_y, low_x, low_y), (high_x, high_y, high_x, high_y))
        rim, rim_area = _cut_edges(db.Region([db.Box(*box) for box in near.tolist()]), stop, centre_nm)
    middle = np.rint(centre_nm).astype(np.int64)
    x0, y0, x1, y1 = (shapes[inside] - np.tile(middle, 2)).T
    level, upright = _sides(y0, y1, x0, x1), _sides(x1, x0, y0, y1)[:, [1, 0, 3, 2]]
    whole = (np.concatenate([level, upright]) + np.tile(middle - centre_nm, 2)) * UM_PER_NM
    return np.concatenate([whole, rim]), rim_area + float((UM_PER_NM**2 * (x1 - x0) * (y1 - y0)).sum())


def region_edges(region: db.Region) -> Floats:
    """Edges [n, 4] of x0, y0, x1, y1 in database units, what a region holds on the left of each."""
    # KLayout has it on the right.
    corners = (c for e in region.edges().each() for c in (e.x2, e.y2, e.x1, e.y1))
    return np.fromiter(corners, dtype=np.float64).reshape(-1, 4)


def sweep_s(region: db.Region) -> tuple[float, float]:
    """About how long a sweep over raw edges takes, along x and along y; it looks at all that are side by side."""
    edges, box = region_edges(region), region.bbox()
    along_x, along_y = abs(edges[:, 2:] - edges[:, :2]).sum(axis=0).tolist()
    each = len(edges) / _MET_PER_SECOND
    return each * along_x / max(1, box.width()), each * along_y / max(1, box.height())


def _in_round_stop(edges_um: Floats, stop: Stop) -> tuple[Floats, float]:
    """Boundary and area of disjoint polygons inside a circle or an ellipse; of a hole's, turned, they are taken off."""
    half = np.array(stop.sides_um) / 2
    edges, area = _in_disc(edges_um / np.tile(half, 2), 1.0)
    if stop.inner_share:
        hole, dark = _in_disc(edges, stop.inner_share)
        edges, area = np.concatenate([edges, hole[:, [2, 3, 0, 1]]]), area - dark
    return edges * np.tile(half, 2), area * float(half.prod())


def _in_disc(edges: Floats, radius: float) -> tuple[Floats, float]:
    """Boundary of polygons inside a circle, and their area there, whose arcs are not replaced by chords.

    Edges that share a corner find it on the same side of the circle, so that as many leave the disc as enter it.
    """
    start, end = edges[:, :2], edges[:, 2:]
    span = end - start
    from_in, to_in = ((point**2).sum(axis=1) < radius**2 for point in (start, end))
    # Where the middle is nearest, in shares of the edge, and half of the chord; edges may be far longer than the disc.
    square = np.maximum((span**2).sum(axis=1), np.finfo(float).tiny)
    nearest = -(start * span).sum(axis=1) / square
    chord = radius**2 - (start[:, 0] * end[:, 1] - start[:, 1] * end[:, 0]) ** 2 / square
    held = from_in | to_in | ((chord > 0) & (nearest > 0) & (nearest < 1))
    start, end, span, nearest = start[held], end[held], span[held], nearest[held]
    enters, leaves, chord = ~from_in[held], ~to_in[held], np.sqrt(np.maximum(chord, 0) / square)[held]
    first, last = (
        (start + np.clip(nearest + sign * chord, 0, 1)[:, None] * span)[met]
        for sign, met in ((-1, enters), (1, leaves))
    )
    start[enters], end[leaves] = first, last
    met = np.concatenate([last, first])
    angle = np.arctan2(met[:, 1], met[:, 0]) % (2 * np.pi)
    order = np.argsort(angle)
    angle, change = angle[order], np.where(order < len(last), 1, -1)
    ends = np.append(angle, angle[0] + 2 * np.pi) if angle.size else np.array([0.0, 2 * np.pi])
    widest = int(np.argmax(np.diff(ends)))
    # Off the middle, where masks have no edges by symmetry.
    probe = ends[widest] + 0.382 * (ends[widest + 1] - ends[widest])
    x, y = radius * np.cos(probe), radius * np.sin(probe)
    above, above_end = edges[:, 1] > y, edges[:, 3] > y
    x0, y0, x1, y1 = edges[above != above_end].T
    right = x0 + (y - y0) * ((x1 - x0) / (y1 - y0)) > x
    turns = np.cumsum(change) if angle.size else np.zeros(1)
    clear = turns - turns[widest] + np.sign(y1 - y0)[right].sum() > 0
    begins, stops = ends[:-1][clear], ends[1:][clear]
    area = float((start[:, 0] * end[:, 1] - end[:, 0] * start[:, 1]).sum() + radius**2 * (stops - begins).sum()) / 2
    return np.concatenate([np.hstack([start, end]), _rim_edges(begins, stops, radius)]), area


def _rim_edges(begin: Floats, end: Floats, radius: float) -> Floats:
    """Chords [n, 4] of arcs, from angles to angles; corners between are as far out as leaves the area what it is."""
    turn = 2 * np.pi / _RIM_VERTICES
    first, last = (np.floor(begin / turn - 0.5) + 1), np.ceil(end / turn - 0.5)
    corners = np.maximum(last - first, 0).astype(np.intp) + 2
    arc, number = expanded(corners)
    angle = (first[arc] + number - 0.5) * turn
    out = np.full(arc.size, radius * np.sqrt(turn / np.sin(turn)))
    for at_end, place in ((number == 0, begin), (number == corners[arc] - 1, end)):
        angle[at_end], out[at_end] = place, radius
    points = np.stack([out * np.cos(angle), out * np.sin(angle)], axis=1)
    within = np.flatnonzero(arc[1:] == arc[:-1])
    return np.hstack([points[within], points[within + 1]])


def _sides(forth: Ints, back: Ints, start: Ints, end: Ints) -> Ints:
    """Sides of boxes along one axis, int64 [n, 4] of start, line, end and line; what runs both ways is gone.

    Lines lie less than half a metre from 0.
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
    edges = (region_edges(whole) - np.tile(centre_nm, 2)) * UM_PER_NM
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
    cut = cut_by_stop(local, stop, NM_PER_UM * scale)
    cut.merge()
    per_um = UM_PER_NM / scale
    return region_edges(cut) * per_um, cut.area() * per_um**2


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


def cut_by_stop(region: db.Region, stop: Stop, per_um: float) -> db.Region:
    """A region about the origin cut by the stop, swept over along the axis on which fewer edges are side by side."""
    (across, up), cutter = sweep_s(region), stop_region(stop, per_um)
    if up <= across:
        return region & cutter
    return (region.transformed(db.Trans.M45) & cutter.transformed(db.Trans.M45)).transformed(db.Trans.M45)


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
    (far_x, near_x), (far_y, near_y) = (far_and_near(low, high) for low, high in ((x0, x1), (y0, y1)))
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


def far_and_near(low: Floats, high: Floats) -> tuple[Floats, Floats]:
    """The largest and the least distance from 0 along one axis."""
    far, near = np.maximum(abs(low), abs(high)), np.minimum(abs(low), abs(high))
    return far, np.where((low < 0) & (high > 0), 0.0, near)
