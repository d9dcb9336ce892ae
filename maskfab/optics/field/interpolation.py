r"""A field at all frequencies of a window from few of them.

Light from within X of the axis makes a field that is smooth in frequency: up to U it holds about 2UX + a few
independent waves of either parity, often far fewer than a window has samples. Its values at as many nodes u_k give all
others by interpolation, without a factorisation.

Polynomials in u waste π/2 of their nodes, crowded at the ends of [-U, U]. In y = sin(γu/U) / sin γ the Chebyshev nodes
y_k = cos θ_k are spaced nearly evenly in u (Kosloff and Tal-Ezer, J. Comput. Phys. 104 (1993) 457). A polynomial
through a function f of either parity at 2r nodes ±y_k is, with barycentric weights w_k = (-1)^k sin θ_k,

    even: Σ_k w_k y_k f(y_k) / (y² - y_k²) / D(y),   odd: Σ_k w_k y f(y_k) / (y² - y_k²) / D(y),
    D(y) = Σ_k w_k y_k / (y² - y_k²)      (Berrut and Trefethen, SIAM Review 46 (2004) 501, folded about 0).

Notes:
    The fastest wave, that of the outermost source, needs the most nodes: its own Chebyshev coefficients in y say how
    many.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from maskfab.base.arrays import Floats
from maskfab.optics.field.waves import Precision, Reals, real_type
from maskfab.optics.functions.chebyshev import lagrange_polynomials, node_angles, wave_degree

# Coefficients of the fastest wave that may be dropped; those of other waves are far smaller.
_DROPPED = {"double": 1e-13, "single": 1e-8}


@dataclass(frozen=True)
class FrequencyNodes:
    """Nodes between 0 and the highest frequency, mirror images at negative frequencies implied.

    Attributes:
        highest: frequency in cycles per micrometre.
        stretch: γ, what makes the nodes even: polynomials in u at 0, evenly spaced at π / 2.
        count: r, how many.
        precision: of the interpolation.
    """

    highest: float
    stretch: float
    count: int
    precision: Precision

    @cached_property
    def frequency(self) -> Floats:
        """float64 [count], descending: a field is strongest near 0, and small terms are best summed first."""
        return self.highest * _unmapped(np.cos(node_angles(self.count) / 2), self.stretch)

    def interpolation(self, frequency: Floats) -> Reals:
        """Matrix from values at the nodes to those at frequencies, of even and of odd functions, [2, count, n]."""
        # From the rounded nodes, at which the values are taken, not from their angles.
        y, nodes = self._mapped(frequency), self._mapped(self.frequency)[:, None]
        apart = (y - nodes) * (y + nodes)
        # In 2 y² - 1 the nodes are Chebyshev's, all of them.
        even = lagrange_polynomials(apart.T).T
        return np.stack([even, even * y / nodes]).astype(real_type(self.precision), copy=False)

    def _mapped(self, frequency: Floats) -> Floats:
        y: Floats = np.sin(self.stretch / self.highest * frequency) / np.sin(self.stretch)
        return y


def frequency_nodes(reach_um: float, highest: float, precision: Precision) -> FrequencyNodes:
    """As few nodes as carry light from within ``reach_um`` of the axis up to the highest frequency.

    More stretch asks for fewer nodes until the map's own singularity, at y = 1 / sin γ, is felt.
    """
    phase, tolerance = 2 * np.pi * reach_um * highest, _DROPPED[precision]
    roughly = 2 * phase / np.pi + 2 * np.sqrt(phase) + 20
    stretch = float(np.arcsin(1 / np.cosh(2 * np.log(tolerance) / roughly)))
    degree = wave_degree(phase, tolerance, lambda y: _unmapped(y, stretch))
    return FrequencyNodes(highest, stretch, degree // 2 + 1, precision)


def _unmapped(y: Floats, stretch: float) -> Floats:
    place: Floats = np.arcsin(np.sin(stretch) * y) / stretch
    return place
