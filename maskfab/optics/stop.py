"""Properties of a stop's shape alone: its loss when moved, its Strehl ratio under a phase, its field when clear.

The field is a closed form:

    ellipse     π/4 w h 2 J₁(πq)/(πq),  q² = (wu)² + (hv)²                      (Goodman, Fourier Optics, 2.1)
    rectangle   w h sinc(wu) sinc(hv)
    polygon     i / (2π (u² + v²)) Σ (u Δy - v Δx) sinc(uΔx + vΔy) exp(-2πi (u x̄ + v ȳ)) over its sides

An annulus is an ellipse less another.
"""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np

from maskfab.base.arrays import Complexes, Floats, Mask
from maskfab.job.camera import Stop
from maskfab.optics.polynomials import bessel_1, gauss_legendre

Waves = Callable[[Floats, Floats], Floats]
"""Optical path over wavelength at points x, y in micrometres, any one shape."""
_DIRECTIONS = 720
_NODES = 64


def inside(stop: Stop, x_um: Floats, y_um: Floats) -> Mask:
    """Whether places lie in the stop, its edge included but for a polygon's; any shapes that broadcast."""
    if stop.outline_um:
        crossings = np.zeros(np.broadcast(x_um, y_um).shape, dtype=np.intp)
        for (px, py), (qx, qy) in sides(stop):
            if py != qy:
                passed = ((py <= y_um) != (qy <= y_um)) & (x_um > px + (y_um - py) * ((qx - px) / (qy - py)))
                crossings += passed
        return np.asarray(crossings % 2 == 1)
    width, height = stop.sides_um
    if not stop.round:
        return np.asarray((abs(x_um) <= width / 2) & (abs(y_um) <= height / 2))
    radius = stop.diameter_um / 2
    squared = (x_um * (stop.diameter_um / width)) ** 2 + (y_um * (stop.diameter_um / height)) ** 2
    return np.asarray((squared <= radius**2) & (squared >= (radius * stop.inner_share) ** 2))


def stop_dots(stop: Stop, side: int, dot_um: float) -> Mask:
    """Dots whose middles lie in the stop, bool [side, side], the stop centred on the square of dots.

    Whole dots serve the design, which compares openings; :func:`maskfab.optics.pupil.cut` cuts dots exactly.
    """
    place_um = (np.arange(side, dtype=np.float64) - (side - 1) / 2) * dot_um
    return inside(stop, place_um, place_um[:, None])


def perimeter_um(stop: Stop) -> float:
    """Length of the stop's edge, the inner one included.

    Ramanujan's second formula errs by less than 4e-4 even for a slit (Q. J. Math. 45, 350, 1914).
    """
    if not stop.round:
        return sum(math.dist(p, q) for p, q in sides(stop))
    a, b = (side / 2 for side in stop.sides_um)
    h = 3 * ((a - b) / (a + b)) ** 2
    return math.pi * (a + b) * (1 + h / (10 + math.sqrt(4 - h))) * (1 + stop.inner_share)


def widest_um(stop: Stop) -> float:
    """The most area that the stop loses per distance that it is moved: its edge seen from the side, inner ones too."""
    if stop.round:
        return stop.diameter_um * (1 + stop.inner_share)
    across = np.array([(qx - px, qy - py) for (px, py), (qx, qy) in sides(stop)])
    angle = np.pi * np.arange(_DIRECTIONS) / _DIRECTIONS
    return float(abs(across @ np.stack([np.cos(angle), np.sin(angle)])).sum(axis=0).max() / 2)


def edge_points(stop: Stop, count: int) -> tuple[Floats, Floats, Floats]:
    """Places along the stop's edge, outward normals [n, 2] each, and the length that each stands for, [n].

    There are about ``count`` of them, twice as many where there is an inner edge, whose normals point to the axis.
    """
    if not stop.round:
        places, normals, lengths = [], [], []
        for (px, py), (qx, qy) in sides(stop):
            length = math.hypot(qx - px, qy - py)
            points = math.ceil(count * length / perimeter_um(stop))
            along = ((np.arange(points) + 0.5) / points)[:, None]
            places.append(np.array([px, py]) + along * np.array([qx - px, qy - py]))
            normals.append(np.full((points, 2), (qy - py, px - qx)) / length)
            lengths.append(np.full(points, length / points))
        return np.concatenate(places), np.concatenate(normals), np.concatenate(lengths)
    angle = 2 * np.pi * (np.arange(count) + 0.5) / count
    turn = np.stack([np.cos(angle), np.sin(angle)], axis=1)
    width, height = stop.sides_um
    across = turn * np.array([height, width]) * (np.pi / count)
    length_um = np.hypot(*across.T)
    place, outward = turn * np.array([width, height]) / 2, across / length_um[:, None]
    if not stop.inner_share:
        return place, outward, length_um
    return (
        np.concatenate([place, stop.inner_share * place]),
        np.concatenate([outward, -outward]),
        np.concatenate([length_um, stop.inner_share * length_um]),
    )


def stop_nodes(stop: Stop, count: int = _NODES) -> tuple[Floats, Floats, Floats]:
    """Places x, y and weights whose sums are integrals over the stop; weights of a polygon may be negative.

    Args:
        count: of Gauss-Legendre nodes along each of two coordinates: along the sides of a rectangle; radius and angle
            of an ellipse; distance from the axis and along the edge for each side of a polygon.
    """
    nodes, weights = gauss_legendre(count)
    unit, weights = (nodes + 1) / 2, weights / 2
    half_x, half_y = (side / 2 for side in stop.sides_um)
    if stop.outline_um:
        parts = [
            (
                unit[:, None] * (px + unit * (qx - px)),
                unit[:, None] * (py + unit * (qy - py)),
                (unit * weights)[:, None] * weights * (px * qy - qx * py),
            )
            for (px, py), (qx, qy) in sides(stop)
        ]
        x, y, weight = (np.concatenate([part[k].ravel() for part in parts]) for k in range(3))
        return x, y, weight
    if not stop.round:
        x, y = np.broadcast_arrays(half_x * nodes, half_y * nodes[:, None])
        return x.ravel(), y.ravel(), (stop.area_um2 * weights[:, None] * weights).ravel()
    angle = np.pi * np.arange(2 * count) / count
    ring = np.sqrt(stop.inner_share**2 + (1 - stop.inner_share**2) * unit)[:, None]
    x, y = half_x * ring * np.cos(angle), half_y * ring * np.sin(angle)
    weight = np.broadcast_to(stop.area_um2 * weights[:, None] / angle.size, x.shape)
    return x.ravel(), y.ravel(), weight.ravel()


def stop_strehl(stop: Stop, waves: Waves, count: int = _NODES) -> float:
    """Strehl ratio of the clear stop under a phase in waves: the square of the mean of exp(2πi W)."""
    x, y, weight = stop_nodes(stop, count)
    return min(1.0, float(abs(weight @ np.exp(2j * np.pi * waves(x, y)) / stop.area_um2) ** 2))


def sides(stop: Stop) -> list[tuple[tuple[float, float], tuple[float, float]]]:
    """Ends of the straight sides, counter-clockwise; none of a round stop."""
    corners = stop.corners_um
    return list(zip(corners, (*corners[1:], *corners[:1]), strict=True))


# Cycles over a polygon below which its sides cancel: there the mean over it is a series in the moments.
_FEWEST_CYCLES = 1e-4


def clear_field(stop: Stop, u: Floats, v: Floats) -> Complexes:
    """The field at frequencies in cycles per micrometre, any shapes that broadcast; in square micrometres.

    Notes:
        Below 1e-4 cycles over a polygon its field is its area and the first moments' phase, to 1e-7 of the area.
    """
    u, v = np.broadcast_arrays(u, v)
    if stop.outline_um:
        total = np.zeros(u.shape, dtype=np.complex128)
        middle = np.zeros(2)
        for (px, py), (qx, qy) in sides(stop):
            dx, dy = qx - px, qy - py
            turn = np.exp(-1j * np.pi * (u * (px + qx) + v * (py + qy)))
            total += (u * dy - v * dx) * np.sinc(u * dx + v * dy) * turn
            middle += np.array([px + qx, py + qy]) * (px * qy - qx * py) / (6 * stop.area_um2)
        squared = u**2 + v**2
        near = squared < (_FEWEST_CYCLES / stop.diameter_um) ** 2
        smooth = stop.area_um2 * np.exp(-2j * np.pi * (u * middle[0] + v * middle[1]))
        return np.where(near, smooth, 1j * total / (2 * np.pi * np.where(near, 1.0, squared)))
    width, height = stop.sides_um
    if not stop.round:
        return (width * height * np.sinc(width * u) * np.sinc(height * v)).astype(np.complex128)
    outer = _ellipse_field(width, height, u, v)
    share = stop.inner_share
    inner = _ellipse_field(width * share, height * share, u, v) if share else 0.0
    return (outer - inner).astype(np.complex128)


def _ellipse_field(width: float, height: float, u: Floats, v: Floats) -> Floats:
    q = np.pi * np.hypot(width * u, height * v)
    safe = np.where(q > 0, q, 1.0)
    return np.asarray(np.pi / 4 * width * height * np.where(q > 0, 2 * bessel_1(safe) / safe, 1.0))
