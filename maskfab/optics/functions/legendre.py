"""Legendre polynomials and their integrals, for many places at once; an order is a block of memory."""

from __future__ import annotations

import numpy as np

from maskfab.base.arrays import Floats


def legendre(xi: Floats, orders: int) -> Floats:
    """P_0, P_1, ... at each place, [orders, ...], by DLMF 18.9.1; exactly ±1 at the ends of [-1, 1]."""
    values = np.ones((orders, *xi.shape))
    values[1:2] = xi
    for n in range(1, orders - 1):
        raised = xi * values[n]
        np.subtract(raised, values[n - 1], out=values[n + 1])
        values[n + 1] *= n / (n + 1)
        values[n + 1] += raised
    return values


def legendre_integrals(xi: Floats, orders: int) -> Floats:
    """Integrals of P_0, P_1, ... from -1 to each place, [orders, ...]: (P_{p+1} - P_{p-1}) / (2p + 1), DLMF 14.10.5."""
    values = legendre(xi, orders + 1)
    integral = np.empty((orders, *xi.shape))
    np.add(xi, 1, out=integral[0])
    for p in range(1, orders):
        np.subtract(values[p + 1], values[p - 1], out=integral[p])
        integral[p] /= 2 * p + 1
    return integral
