"""Spherical Bessel functions, the transforms of Legendre polynomials, all orders at once.

Upwards the recurrence keeps its accuracy below the argument, downwards above it (DLMF 3.6(ii), 10.51.1).
"""

from __future__ import annotations

import numpy as np

from maskfab.base.arrays import Floats


def spherical_bessel(argument: Floats, orders: int) -> Floats:
    """j_0, j_1, ... at arguments that are not negative, [orders, ...], each to about 1e-16."""
    found = np.empty((orders, *argument.shape))
    large = argument >= orders
    found[:, large] = _upwards(argument[large], orders)
    found[:, ~large] = _downwards(argument[~large], orders)
    return found


def spherical_bessel_bounds(argument: Floats, orders: int) -> Floats:
    """z^n / (2n + 1)!!, [orders, ...], no less than j_n at this and lesser arguments, and close above them."""
    odd = 2.0 * np.arange(1, orders).reshape(-1, *(1 for _ in argument.shape)) + 1
    return np.cumprod(np.concatenate([np.ones((1, *argument.shape)), argument / odd]), axis=0)


def _upwards(z: Floats, orders: int) -> Floats:
    found = np.empty((max(orders, 2), *z.shape))
    found[0] = np.sin(z) / z
    found[1] = (found[0] - np.cos(z)) / z
    for n in range(1, orders - 1):
        found[n + 1] = (2 * n + 1) / z * found[n] - found[n - 1]
    return found[:orders]


def _downwards(z: Floats, orders: int) -> Floats:
    """Miller's algorithm on j_n / (z^n / (2n + 1)!!), which neither overflows nor vanishes as z does."""
    # So far above the orders, a wrong start has no effect left on them.
    last = orders + int(16 * (orders / 2 + 1) ** (1 / 3)) + 8
    square = z**2
    ratio = np.ones((last + 2, *z.shape))
    for n in range(last, 0, -1):
        ratio[n - 1] = ratio[n] - square * (ratio[n + 1] / ((2 * n + 1) * (2 * n + 3)))
    found = spherical_bessel_bounds(z, last + 2) * ratio
    # The sum of (2n + 1) j_n² is 1 (DLMF 10.60.12), and above the argument no j_n is negative.
    found /= np.sqrt(np.tensordot(2 * np.arange(last + 2) + 1, found**2, 1))
    return found[:orders]
