"""Areas of rectangles inside a stop and its shifted copy, in closed form.

A stop is a unit disc or a square of side 2 about the origin, stretched along x and y; an annulus is the difference of
two discs.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from maskfab.base.arrays import Floats
from maskfab.model import Stop

# So many rectangles stay in the fastest cache.
_AT_A_TIME = 4_096


def has_closed_form(stop: Stop) -> bool:
    """Whether the areas of this module are known for a stop: for all but polygons."""
    return not stop.outline_um


def apart(stop: Stop, lag_x_um: Floats, lag_y_um: Floats) -> NDArray[np.bool_]:
    """Whether a stop moved by lags surely shares nothing with itself."""
    width, height = stop.sides_um
    x, y = lag_x_um / width, lag_y_um / height
    return np.asarray(x**2 + y**2 >= 1 if stop.round else np.maximum(abs(x), abs(y)) >= 1)


def shared_area(stop: Stop, box_um: Floats, lag_um: Floats) -> Floats:
    """Area of rectangles inside a stop and inside the stop moved back by a lag.

    Args:
        stop: see :func:`has_closed_form`.
        box_um: float64 [4, n], x0, x1, y0, y1.
        lag_um: float64 [2, n], x, y.
    """
    width, height = stop.sides_um
    unit = np.array([2 / width, 2 / height])
    lag = lag_um * unit[:, None]
    box = box_um * np.repeat(unit, 2)[:, None]
    if not stop.round:
        low = np.maximum(box[::2], np.maximum(-1, -1 - lag))
        high = np.minimum(box[1::2], np.minimum(1, 1 - lag))
        return np.asarray(np.clip(high - low, 0.0, None).prod(axis=0) * (width * height / 4))
    share = stop.inner_share
    pairs = [(1.0, 1.0), (1.0, share), (share, 1.0), (share, share)] if share else [(1.0, 1.0)]
    area = np.zeros(box.shape[1])
    for own, moved in pairs:
        area += (1 if own == moved else -1) * _in_both_discs(box, lag, own, moved)
    return area * (width * height / 4)


def _in_both_discs(box: Floats, lag: Floats, own_radius: float, moved_radius: float) -> Floats:
    """Area of rectangles inside a disc about the origin and another that lies a lag behind.

    The circle of the larger power bounds a point, so on either side of the circles' radical axis it is a single one.
    """
    area, split = np.empty(box.shape[1]), []
    for start in range(0, area.size, _AT_A_TIME):
        some = slice(start, start + _AT_A_TIME)
        power = _power(lag[:, some], own_radius, moved_radius)
        area[some], is_split = _in_bounding_disc(box[:, some], lag[:, some], power, own_radius, moved_radius)
        split.append(start + np.flatnonzero(is_split))
    if split:
        k = np.concatenate(split)
        power = _power(lag[:, k], own_radius, moved_radius)
        area[k] = _on_the_axis(box[:, k], lag[:, k], power, own_radius, moved_radius)
    return area


def _power(lag: Floats, own_radius: float, moved_radius: float) -> Floats:
    """Half of what the moved circle's power of the origin is over the own one's."""
    power: Floats = ((lag**2).sum(axis=0) + own_radius**2 - moved_radius**2) / 2
    return power


def _in_bounding_disc(
    box: Floats, lag: Floats, power: Floats, own_radius: float, moved_radius: float
) -> tuple[Floats, NDArray[np.bool_]]:
    """Area of rectangles inside the disc that bounds their middle, and whether the radical axis splits them."""
    height = (box[0] + box[1]) / 2 * lag[0] + (box[2] + box[3]) / 2 * lag[1] + power
    beyond = height >= 0
    radius = np.where(beyond, moved_radius, own_radius)
    area = _in_disc((box + np.repeat(lag * beyond, 2, axis=0)) / radius)
    area *= radius**2
    reach = (abs(lag[0]) * (box[1] - box[0]) + abs(lag[1]) * (box[3] - box[2])) / 2
    return area, abs(height) < reach


def _in_disc(sides: Floats) -> Floats:
    """Area of rectangles [4, n] inside a unit disc: what lies above their bottoms, less what lies above their tops.

    Between the same ends, a line below the axis has as much of the disc below it as its mirror image above.
    """
    lines = np.clip(sides[2:], -1.0, 1.0)
    # No line is at -0.
    lines += 0.0
    chord = _height(lines)
    ends = np.clip(sides[:2, None], -chord, chord)
    integral = _integral(ends)
    beyond = integral[1] - integral[0]
    beyond -= abs(lines) * (ends[1] - ends[0])
    bottom, top = np.copysign(beyond, lines)
    area: Floats = bottom - top
    across = np.flatnonzero((lines[0] < 0) & (lines[1] >= 0))
    left, right = _integral(np.clip(sides[:2, across], -1.0, 1.0))
    area[across] += 2 * (right - left)
    return area


def _height(place: Floats) -> Floats:
    """Of a unit circle above its axis."""
    height = 1 - place
    height *= 1 + place
    return np.sqrt(height, out=height)


def _integral(place: Floats) -> Floats:
    """Of the height, from 0."""
    integral = _height(place)
    integral *= place
    integral += np.arcsin(place)
    integral *= 0.5
    return integral


def _on_the_axis(box: Floats, lag: Floats, power: Floats, own_radius: float, moved_radius: float) -> Floats:
    """The overlap where the radical axis splits rectangles, into two polygons with a single circle each."""
    x, y = box[[0, 1, 1, 0]], box[[2, 2, 3, 3]]
    height = x * lag[0] + y * lag[1] + power
    moved_x, moved_y = _beside(x, y, height, lag)
    moved = _disc_area(moved_x + lag[0], moved_y + lag[1], moved_radius)
    return moved + _disc_area(*_beside(x, y, -height, -lag), own_radius)


def _beside(x: Floats, y: Floats, height: Floats, normal: Floats) -> tuple[Floats, Floats]:
    """Polygons [2 v, n] that are corners [v, n] clipped to where a height that rises along a normal is not negative.

    Corners on the other side are moved onto the line: what that adds runs along it forth and back, and encloses none.
    """
    slope = (normal**2).sum(axis=0)
    back = np.minimum(height, 0.0) / slope
    following = _next(height)
    crosses = (height >= 0) != (following >= 0)
    share = height / np.where(crosses, height - following, 1.0)

    def clipped(corner: Floats, along: Floats) -> Floats:
        kept = corner - back * along
        between = np.where(crosses, corner + share * (_next(corner) - corner), kept)
        return np.stack([kept, between], axis=1).reshape(2 * len(corner), -1 if corner.size else 0)

    return clipped(x, normal[0]), clipped(y, normal[1])


def _disc_area(x: Floats, y: Floats, radius: float) -> Floats:
    """Area inside a disc about the origin of polygons [v, n]: over every side, its triangle with the origin."""
    span_x, span_y = _next(x) - x, _next(y) - y
    a, b = span_x**2 + span_y**2, x * span_x + y * span_y
    root2 = b**2 - a * (x**2 + y**2 - radius**2)
    meets = (root2 > 0) & (a > 0)
    root, scale = np.sqrt(np.where(meets, root2, 0.0)), np.where(meets, a, 1.0)
    first, last = (np.where(meets, np.clip((sign * root - b) / scale, 0.0, 1.0), 0.0) for sign in (-1, 1))
    in_x, in_y, out_x, out_y = x + first * span_x, y + first * span_y, x + last * span_x, y + last * span_y
    sectors = _angle(x, y, in_x, in_y) + _angle(out_x, out_y, _next(x), _next(y))
    result: Floats = (radius**2 * sectors + in_x * out_y - in_y * out_x).sum(axis=0) / 2
    return result


def _next(values: Floats) -> Floats:
    return np.concatenate([values[1:], values[:1]])


def _angle(x0: Floats, y0: Floats, x1: Floats, y1: Floats) -> Floats:
    return np.arctan2(x0 * y1 - y0 * x1, x0 * x1 + y0 * y1)
