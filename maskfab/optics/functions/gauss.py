r"""Gauss quadrature for the weight at hand: few nodes that integrate polynomials as exactly as many points do.

For points x_j of weights w_j >= 0 there are n nodes and weights that sum every polynomial of degree 2n - 1 alike. They
are the eigenvalues of the n x n Jacobi matrix of the polynomials that are orthogonal on the points, and the points'
whole weight times the squares of the eigenvectors' first entries (G. H. Golub, J. H. Welsch, Math. Comp. 23, 221,
1969); the matrix follows by Stieltjes' procedure, which is stable for the few nodes wanted here (W. Gautschi,
Orthogonal Polynomials, 2.2.3). However narrow a peak of the weight, it is met.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from maskfab.base.arrays import Floats


def gauss_rules(places: Floats, weights: Floats, starts: NDArray[np.intp], nodes: int) -> tuple[Floats, Floats]:
    """A Gauss rule for each of several runs of points.

    Args:
        places: float64 [k], the runs one behind the other.
        weights: float64 [k], not negative; in every run some are positive.
        starts: intp [r], ascending, the first 0: where each run begins.
        nodes: of every rule.

    Returns:
        Places, ascending, and weights, float64 [r, nodes] each. A run that has fewer points than nodes, or whose points
        rounding does not tell apart, has nodes of weight 0 besides.
    """
    sizes = np.diff(np.append(starts, places.size))

    def over_runs(values: Floats) -> Floats:
        return np.asarray(np.add.reduceat(values, starts))

    lowest, highest = np.minimum.reduceat(places, starts), np.maximum.reduceat(places, starts)
    middle, half = (lowest + highest) / 2, np.maximum((highest - lowest) / 2, np.finfo(float).tiny)
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
    found, vectors = np.linalg.eigh(jacobi)
    # Rounding must not carry a node beyond the points.
    places = np.clip(middle[:, None] + half[:, None] * found, lowest[:, None], highest[:, None])
    return places, mass[:, None] * vectors[:, 0, :] ** 2
