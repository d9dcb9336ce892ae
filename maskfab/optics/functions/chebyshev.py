"""Chebyshev nodes of the first kind, cos θ_k with θ_k = π (k + 1/2) / n: interpolation by them, and its degree."""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np

from maskfab.base.arrays import Floats


def node_angles(count: int) -> Floats:
    """θ_k, float64 [count], ascending."""
    return np.pi * (np.arange(count, dtype=np.float64) + 0.5) / count


def lagrange_polynomials(apart: Floats) -> Floats:
    """The nodes' Lagrange polynomials (Berrut and Trefethen, SIAM Review 46 (2004) 501, 4.2).

    Args:
        apart: float64 [..., count], how far places are from the nodes in order of θ, on any scale; overwritten.

    Returns:
        float64 [..., count], laid out in memory as the argument is.
    """
    angles = node_angles(apart.shape[-1])
    apart[apart == 0] = np.finfo(np.float64).tiny
    # Over what they are made of: fresh memory costs more than the quotients.
    np.divide(np.where(np.arange(angles.size) % 2, -1.0, 1.0) * np.sin(angles), apart, out=apart)
    apart /= apart.sum(axis=-1, keepdims=True)
    return apart


def wave_degree(phase: float, tolerance: float, place: Callable[[Floats], Floats] = lambda y: y) -> int:
    """The highest Chebyshev coefficient of a wave that reaches the tolerance.

    Args:
        phase: of the wave at the ends of the interval, radians; at the middle it is 0.
        tolerance: against the wave's height of 1; rounding adds about 1e-17 times the phase to coefficients.
        place: odd, from [-1, 1] onto itself; of the wave exp(i phase place(y)).
    """
    # Above the phase coefficients fall as those of a plane wave do, 2 J_n (DLMF 10.12.2, 10.19.8), or sooner.
    orders = int(phase + 16 * (phase / 2 + 1) ** (1 / 3)) + 24
    half = 2 ** math.ceil(math.log2(orders))
    wave = phase * place(np.cos(np.pi * np.arange(half + 1, dtype=np.float64) / half))
    # The real part is even in y and the imaginary one odd, so that none of their coefficients meet in the sum.
    size = 2 * abs(np.fft.irfft(np.cos(wave) + np.sin(wave))[:half])
    return int(np.flatnonzero(size >= tolerance)[-1])
