r"""Light from anywhere on an interval, moved to a few nodes of it.

On an interval of half width h the wave exp(-2πiux) is a polynomial in x up to rounding, of a degree little above
2π|u|h: its Chebyshev coefficients are 2 (-i)^n J_n(2πuh) (Jacobi and Anger, DLMF 10.12.2), and J_n falls faster than
any power beyond n = 2πuh. Interpolation between Chebyshev nodes x_k therefore carries any source s on the interval,

    ∫ s(x) exp(-2πiux) dx = Σ_k exp(-2πi u x_k) ∫ s(x) l_k(x) dx    with l_k the node's Lagrange polynomial,

at every frequency up to the one that the nodes were chosen for.

Notes:
    The sources of a row of nodes alternate in sign if a strong source lies outside the interval; none may.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.polynomial.legendre import leggauss, legvander

from maskfab.base.arrays import Floats
from maskfab.optics.functions.chebyshev import lagrange_polynomials, node_angles, wave_degree

NODE_TOLERANCE = 1e-13
"""Chebyshev coefficients of a wave, below which they are dropped: this share of the source is lost at most."""

_SPARE_NODES = 2


@dataclass(frozen=True)
class Nodes:
    """Chebyshev nodes of the first kind on an interval.

    Attributes:
        low_um, high_um: the interval.
        count: how many nodes.
    """

    low_um: float
    high_um: float
    count: int

    @property
    def position_um(self) -> Floats:
        """float64 [count], ascending; mirror images of each other about the middle."""
        return (self.low_um + self.high_um) / 2 + (self.high_um - self.low_um) / 2 * -np.cos(node_angles(self.count))

    def moments(self, low_um: Floats, high_um: Floats, orders: int, quadrature: int) -> Floats:
        """Strengths of the nodes from Legendre profiles on parts of the interval.

        Args:
            low_um, high_um: [k] ends of the parts.
            orders: number of profiles.
            quadrature: Gauss-Legendre nodes on each part; ``orders`` + 2 or more.

        Returns:
            float64 [k, orders, count]: (2 p + 1) ∫ P_p l_n dx over the part, l_n the nodes' Lagrange polynomials.
            Moments of a transmission, means of it times P_p, times these are its sources at the nodes.
        """
        nodes, weights = leggauss(quadrature)
        across = (high_um - low_um)[:, None]
        x = (low_um + high_um)[:, None] / 2 + across / 2 * nodes
        local = (2 * x - self.low_um - self.high_um) / (self.high_um - self.low_um)
        profile = (legvander(nodes, orders - 1) * weights[:, None] / 2 * (2 * np.arange(orders) + 1)).T
        polynomials = lagrange_polynomials(local[..., None] + np.cos(node_angles(self.count)))
        moments: Floats = profile @ polynomials
        moments *= across[:, :, None]
        return moments


def nodes_for(low_um: float, high_um: float, highest: float) -> Nodes:
    """As many nodes as an interval needs for frequencies up to ``highest``, in cycles per micrometre."""
    return Nodes(low_um, high_um, node_count(high_um - low_um, highest))


def node_count(width_um: float, highest: float) -> int:
    """The fewest nodes whose interpolation of exp(-2πiux) errs by about the tolerance on an interval that wide."""
    return wave_degree(np.pi * width_um * highest, NODE_TOLERANCE) + _SPARE_NODES
