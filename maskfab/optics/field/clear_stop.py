r"""The field of the stop itself, clear, in closed form.

    ellipse     π/4 w h 2 J₁(πq)/(πq),  q² = (wu)² + (hv)²                      (Goodman, Fourier Optics, 2.1)
    rectangle   w h sinc(wu) sinc(hv)
    polygon     i / (2π (u² + v²)) Σ (u Δy - v Δx) sinc(uΔx + vΔy) exp(-2πi (u x̄ + v ȳ)) over its sides

An annulus is an ellipse less another.
"""

from __future__ import annotations

import numpy as np
import scipy

from maskfab.base.arrays import Complexes, Floats
from maskfab.model import Stop
from maskfab.optics.pupil.stop_shape import sides

# Cycles over a polygon below which its sides cancel: there the mean over it is a series in the moments.
_FEWEST_CYCLES = 1e-4


def clear_field(stop: Stop, u: Floats, v: Floats) -> Complexes:
    """The field at frequencies in cycles per micrometre, any shapes that broadcast; in square micrometres.

    Notes:
        Below 1e-4 cycles over a polygon its field is its area and the first moments' phase, to 1e-7 of the area.
    """
    u, v = np.broadcast_arrays(u, v)
    if stop.outline_um:
        return _polygon_field(stop, u, v)
    width, height = stop.sides_um
    if not stop.round:
        return (width * height * np.sinc(width * u) * np.sinc(height * v)).astype(np.complex128)
    outer = _ellipse_field(width, height, u, v)
    share = stop.inner_share
    inner = _ellipse_field(width * share, height * share, u, v) if share else 0.0
    return (outer - inner).astype(np.complex128)


def _ellipse_field(width: float, height: float, u: Floats, v: Floats) -> Floats:
    q = np.pi * np.hypot(width * u, height * v)
    known = np.where(q > 0, q, 1.0)
    return np.asarray(np.pi / 4 * width * height * np.where(q > 0, 2 * scipy.special.j1(known) / known, 1.0))


def _polygon_field(stop: Stop, u: Floats, v: Floats) -> Complexes:
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
