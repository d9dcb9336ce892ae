"""Polygons cut by the lens stop, as directed edges for the polygon transform."""

from __future__ import annotations

import numpy as np
from klayout import db
from numpy.typing import NDArray

from maskfab.model import Box, Stop

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]

_RIM_VERTICES = 4096
_LARGEST_COORDINATE = 2_000_000_000


def edges_in_stop(shapes: db.Region | Ints, stop: Stop, centre_nm: tuple[float, float]) -> tuple[Floats, float]:
    """Boundary of shapes ∩ stop about the stop's centre.

    The circle becomes a regular polygon of 4096 sides and the circle's own area; coordinates are refined to a
    fraction of a nanometre first, so that neither the sides nor their rounding shows at 1e-7.

    Args:
        shapes: what is clear, in nanometres; see :func:`stop_box` for how much of it is needed. Either a region, or
            int64 [n, 4] disjoint boxes, of which only those that the stop cuts are turned into polygons.
        stop: the lens stop.
        centre_nm: where the optical axis meets the plate, to half a nanometre.

    Returns:
        Edges [n, 4] in micrometres (x0, y0, x1, y1; clear side on the left) and the clear area in µm². Where two boxes
        touch, both their edges are there; they cancel in any integral along the boundary.
    """
    if isinstance(shapes, db.Region):
        return _cut_edges(shapes & db.Region(db.Box(*stop_box(stop, centre_nm))), stop, centre_nm)
    corners = shapes - np.tile(centre_nm, 2)
    far = np.maximum(abs(corners[:, :2]), abs(corners[:, 2:]))
    near = np.where(corners[:, :2] * corners[:, 2:] < 0, 0.0, np.minimum(abs(corners[:, :2]), abs(corners[:, 2:])))
    reach = stop.diameter_um * 500
    if stop.shape == "circle":
        # Sides of the polygon that stands for the circle come this much closer to its middle.
        inside = np.hypot(*far.T) < reach * np.cos(np.pi / _RIM_VERTICES) - 1
        outside = np.hypot(*near.T) > reach * (1 + 1 / _RIM_VERTICES) + 1
    else:
        inside, outside = far.max(axis=1) <= reach, near.max(axis=1) >= reach
    cut = db.Region()
    for box in shapes[~inside & ~outside].tolist():
        cut.insert(db.Box(*box))
    rim, rim_area = _cut_edges(cut, stop, centre_nm)
    x0, y0, x1, y1 = corners[inside].T * 1e-3
    sides = [(x0, y0, x1, y0), (x1, y0, x1, y1), (x1, y1, x0, y1), (x0, y1, x0, y0)]
    whole = np.concatenate([np.stack(side, axis=1) for side in sides])
    return np.concatenate([whole, rim]), rim_area + float(((x1 - x0) * (y1 - y0)).sum())


def _cut_edges(region: db.Region, stop: Stop, centre_nm: tuple[float, float]) -> tuple[Floats, float]:
    scale = 2 * max(1, min(50, int(_LARGEST_COORDINATE / (1.1 * stop.diameter_um * 1e3))))
    whole = [int(np.floor(c)) for c in centre_nm]
    local = region.moved(-whole[0], -whole[1])
    local.transform(db.ICplxTrans(float(scale)))
    local.move(*(round((w - c) * scale) for w, c in zip(whole, centre_nm, strict=True)))
    cut = local & db.Region(_stop_polygon(stop, scale))
    cut.merge()
    per_um = 1e-3 / scale
    # KLayout has the clear side on the right of an edge, the field formula on the left.
    corners = (c for e in cut.edges().each() for c in (e.x2, e.y2, e.x1, e.y1))
    return np.fromiter(corners, dtype=np.float64).reshape(-1, 4) * per_um, cut.area() * per_um**2


def stop_box(stop: Stop, centre_nm: tuple[float, float], margin_nm: int = 0) -> Box:
    """A square of whole nanometres that holds the stop, a little more, and a margin."""
    reach = int(stop.diameter_um * 505) + 1 + margin_nm
    x, y = (round(c) for c in centre_nm)
    return x - reach, y - reach, x + reach, y + reach


def _stop_polygon(stop: Stop, scale: int) -> db.Polygon:
    half = stop.diameter_um / 2 * 1e3 * scale
    if stop.shape == "square":
        return db.Polygon(db.Box(round(-half), round(-half), round(half), round(half)))
    turn = 2 * np.pi / _RIM_VERTICES
    equal_area = half * np.sqrt(turn / np.sin(turn))
    angle = turn * (np.arange(_RIM_VERTICES) + 0.5)
    corners = zip(np.rint(equal_area * np.cos(angle)), np.rint(equal_area * np.sin(angle)), strict=True)
    return db.Polygon([db.Point(int(px), int(py)) for px, py in corners])
