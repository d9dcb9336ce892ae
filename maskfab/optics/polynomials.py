"""Polynomials, their transforms and Gauss rules, in the forms that the optics needs and scipy does not have.

Legendre polynomials and their integrals are for many places at once; an order is a block of memory. Chebyshev nodes are
those of the first kind, cos θ_k with θ_k = π (k + 1/2) / n. Spherical Bessel functions, the transforms of Legendre
polynomials, are all orders at once: upwards the recurrence keeps its accuracy below the argument, downwards above it
(DLMF 3.6(ii), 10.51.1).

A Gauss rule for the weight at hand has few nodes that integrate polynomials as exactly as many points do. For points
x_j of weights w_j >= 0 there are n nodes and weights that sum every polynomial of degree 2n - 1 alike. They are the
eigenvalues of the n x n Jacobi matrix of the polynomials that are orthogonal on the points, and the points' whole
weight times the squares of the eigenvectors' first entries (G. H. Golub, J. H. Welsch, Math. Comp. 23, 221, 1969); the
matrix follows by Stieltjes' procedure, which is stable for the few nodes wanted here (W. Gautschi, Orthogonal
Polynomials, 2.2.3). However narrow a peak of the weight, it is met.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from functools import lru_cache

import numpy as np
from numpy.polynomial.legendre import leggauss

from maskfab.base.arrays import Floats, Indices

_TINY = float(np.finfo(np.float64).tiny)


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


@lru_cache(maxsize=64)
def gauss_legendre(count: int) -> tuple[Floats, Floats]:
    """Nodes, ascending, and weights of the rule on [-1, 1], kept for the next call; read-only."""
    nodes, weights = leggauss(count)
    nodes.flags.writeable = weights.flags.writeable = False
    return nodes, weights


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
    apart[apart == 0] = _TINY
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


_LARGE, _NODES, _TERMS = 25.0, 16, 16


def bessel_1(argument: Floats) -> Floats:
    """J_1 at arguments that are not negative, to about 1e-15.

    Below 25 the mean of sin(z sin θ) sin θ at midpoints (DLMF 10.9.2), which is exact to J_63(z); above it Hankel's
    expansion (DLMF 10.17.3), of which terms fall to exp(-2z).
    """
    values = np.empty(argument.shape)
    small = argument < _LARGE
    sines = np.sin((np.arange(_NODES) + 0.5) * np.pi / (2 * _NODES))
    values[small] = np.sin(argument[small][..., None] * sines) @ sines / _NODES
    z = argument[~small]
    ratios = [(4 - (2 * k - 1) ** 2) / (8 * k) for k in range(1, _TERMS)]
    series = np.cumprod([1.0, *ratios]) * np.where(np.arange(_TERMS) // 2 % 2, -1, 1)
    even, odd = (np.polynomial.polynomial.polyval(1 / z**2, series[first::2]) for first in (0, 1))
    phase = z - 3 * np.pi / 4
    values[~small] = np.sqrt(2 / np.pi / z) * (even * np.cos(phase) - odd / z * np.sin(phase))
    return values


def spherical_bessel(argument: Floats, orders: int) -> Floats:
    """j_0, j_1, ... at arguments that are not negative, [orders, ...], each to about 1e-16."""
    values = np.empty((orders, *argument.shape))
    large = argument >= orders
    values[:, large] = _upwards(argument[large], orders)
    values[:, ~large] = _downwards(argument[~large], orders)
    return values


def spherical_bessel_bounds(argument: Floats, orders: int) -> Floats:
    """z^n / (2n + 1)!!, [orders, ...], no less than j_n at this and lesser arguments, and close above them."""
    odd = 2.0 * np.arange(1, orders).reshape(-1, *(1 for _ in argument.shape)) + 1
    return np.cumprod(np.concatenate([np.ones((1, *argument.shape)), argument / odd]), axis=0)


def _upwards(z: Floats, orders: int) -> Floats:
    values = np.empty((max(orders, 2), *z.shape))
    values[0] = np.sin(z) / z
    values[1] = (values[0] - np.cos(z)) / z
    for n in range(1, orders - 1):
        values[n + 1] = (2 * n + 1) / z * values[n] - values[n - 1]
    return values[:orders]


def _downwards(z: Floats, orders: int) -> Floats:
    """Miller's algorithm on j_n / (z^n / (2n + 1)!!), which neither overflows nor vanishes as z does."""
    # So far above the orders, a wrong start has no effect left on them.
    last = orders + int(16 * (orders / 2 + 1) ** (1 / 3)) + 8
    square = z**2
    ratio = np.ones((last + 2, *z.shape))
    for n in range(last, 0, -1):
        ratio[n - 1] = ratio[n] - square * (ratio[n + 1] / ((2 * n + 1) * (2 * n + 3)))
    values = spherical_bessel_bounds(z, last + 2) * ratio
    # The sum of (2n + 1) j_n² is 1 (DLMF 10.60.12), and above the argument no j_n is negative.
    values /= np.sqrt(np.tensordot(2 * np.arange(last + 2) + 1, values**2, 1))
    return values[:orders]


def gauss_rules(places: Floats, weights: Floats, starts: Indices, nodes: int) -> tuple[Floats, Floats]:
    """A Gauss rule for each of several runs of points.

    Args:
        places: float64 [k], the runs one behind the other.
        weights: float64 [k], not negative; in every run some are positive.
        starts: intp [r], ascending, the first 0: where each run begins.

    Returns:
        Places, ascending, and weights, float64 [r, nodes] each. A run that has fewer points than nodes, or whose points
        rounding does not tell apart, has nodes of weight 0 besides.
    """
    sizes = np.diff(np.append(starts, places.size))

    def over_runs(values: Floats) -> Floats:
        return np.asarray(np.add.reduceat(values, starts))

    lowest, highest = np.minimum.reduceat(places, starts), np.maximum.reduceat(places, starts)
    middle, half = (lowest + highest) / 2, np.maximum((highest - lowest) / 2, _TINY)
    at = (places - np.repeat(middle, sizes)) / np.repeat(half, sizes)
    before, here = np.zeros_like(at), np.ones_like(at)
    norm = mass = over_runs(weights)
    jacobi = np.zeros((starts.size, nodes, nodes))
    for k in range(nodes):
        seen = norm > 0
        mean = np.divide(over_runs(weights * at * here**2), norm, out=np.zeros_like(norm), where=seen)
        jacobi[:, k, k] = mean
        if k == nodes - 1:
            break
        # Monic polynomials: p[k + 1] = (x - mean[k]) p[k] - ratio[k] p[k - 1].
        ratio = np.zeros_like(norm) if k == 0 else jacobi[:, k, k - 1] ** 2
        before, here = here, (at - np.repeat(mean, sizes)) * here - np.repeat(ratio, sizes) * before
        after = over_runs(weights * here**2)
        coupling = np.sqrt(np.divide(after, norm, out=np.zeros_like(norm), where=seen))
        jacobi[:, k, k + 1] = jacobi[:, k + 1, k] = coupling
        norm = after
    roots, vectors = np.linalg.eigh(jacobi)
    # Rounding must not carry a node beyond the points.
    places = np.clip(middle[:, None] + half[:, None] * roots, lowest[:, None], highest[:, None])
    return places, mass[:, None] * vectors[:, 0, :] ** 2
