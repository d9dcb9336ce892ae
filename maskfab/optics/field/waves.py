"""Waves that the matrix transforms are made of, and the few nodes that stand for many frequencies or sources.

**Waves** are cosines and sines of 2πux. A lattice repeats, so the waves of its intervals are products of a few coarse
and a few fine ones (addition theorem, DLMF 4.21.2), and the interval's own transform, w sinc(uw), goes into the fine
ones.

Notes:
    A phase of thousands of cycles has lost its digits by the time a single-precision cosine sees it. Phases are
    therefore counted in cycles and reduced to half a cycle in double precision, whatever the precision of the result.

**Nodes of frequency** give a field at all frequencies of a window from few of them. Light from within X of the axis
makes a field that is smooth in frequency: up to U it holds about 2UX + a few independent waves of either parity, often
far fewer than a window has samples. Its values at as many nodes u_k give all others by interpolation, without a
factorisation.

Polynomials in u waste π/2 of their nodes, crowded at the ends of [-U, U]. In y = sin(γu/U) / sin γ the Chebyshev nodes
y_k = cos θ_k are spaced nearly evenly in u (Kosloff and Tal-Ezer, J. Comput. Phys. 104 (1993) 457). A polynomial
through a function f of either parity at 2r nodes ±y_k is, with barycentric weights w_k = (-1)^k sin θ_k,

    even: Σ_k w_k y_k f(y_k) / (y² - y_k²) / D(y),   odd: Σ_k w_k y f(y_k) / (y² - y_k²) / D(y),
    D(y) = Σ_k w_k y_k / (y² - y_k²)      (Berrut and Trefethen, SIAM Review 46 (2004) 501, folded about 0).

Notes:
    The fastest wave, that of the outermost source, needs the most nodes: its own Chebyshev coefficients in y say how
    many.

**Nodes of place** take light from anywhere on an interval. On an interval of half width h the wave exp(-2πiux) is a
polynomial in x up to rounding, of a degree little above 2π|u|h: its Chebyshev coefficients are 2 (-i)^n J_n(2πuh)
(Jacobi and Anger, DLMF 10.12.2), and J_n falls faster than any power beyond n = 2πuh. Interpolation between Chebyshev
nodes x_k therefore carries any source s on the interval,

    ∫ s(x) exp(-2πiux) dx = Σ_k exp(-2πi u x_k) ∫ s(x) l_k(x) dx    with l_k the node's Lagrange polynomial,

at every frequency up to the one that the nodes were chosen for.

Notes:
    The sources of a row of nodes alternate in sign if a strong source lies outside the interval; none may.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property, lru_cache
from typing import Any, Literal

import numpy as np
from numpy.polynomial.legendre import legvander
from numpy.typing import NDArray

from maskfab.base.arrays import Floats
from maskfab.base.errors import InternalError
from maskfab.optics.polynomials import gauss_legendre, lagrange_polynomials, node_angles, wave_degree
from maskfab.optics.pupil import Lattice

Reals = NDArray[np.floating[Any]]
Precision = Literal["double", "single"]

_SYMMETRY = 1e-9
_FEWEST_SPLIT = 32


@dataclass(frozen=True, eq=False)
class Positions:
    """Sources along one axis, at every sum of a coarse and a fine position, fine ones running fastest.

    Attributes:
        coarse_um, fine_um: float64 [a], [b].
        width_um: float64 [b] or [1] widths of uniform intervals centred on the sources, by fine position; None if the
            sources are points.
        first: how many of the sums to leave out at the beginning.
        count: how many to keep from there.
    """

    coarse_um: Floats
    fine_um: Floats
    width_um: Floats | None
    first: int
    count: int

    @property
    def reach_um(self) -> float:
        """Largest distance from the axis at which light enters."""
        if not self.count:
            return 0.0
        coarse, fine = divmod(self.first + self.count - 1, self.fine_um.size)
        outermost = float(self.coarse_um[coarse] + self.fine_um[fine])
        return outermost if self.width_um is None else outermost + float(self.width_um.max()) / 2

    def waves(self, frequency: Floats, precision: Precision) -> tuple[Reals, Reals]:
        """Cosine and sine transforms of the sources, [count, frequencies] each; ``frequency`` in cycles per µm."""
        cosine, sine = (wave[:, None, :] for wave in _waves(self.coarse_um, frequency, precision))
        fine_cosine, fine_sine = _waves(self.fine_um, frequency, precision)
        if self.width_um is not None:
            size = self.width_um[:, None] * np.sinc(self.width_um[:, None] * frequency)
            size = size.astype(real_type(precision), copy=False)
            fine_cosine, fine_sine = fine_cosine * size, fine_sine * size
        even, odd = cosine * fine_cosine, sine * fine_cosine
        even -= sine * fine_sine
        odd += cosine * fine_sine
        part = slice(self.first, self.first + self.count)
        return even.reshape(-1, frequency.size)[part], odd.reshape(-1, frequency.size)[part]


def point_sources(position_um: Floats) -> Positions:
    """Point sources anywhere."""
    return Positions(np.zeros(1), position_um, None, 0, position_um.size)


def right_half(lattice: Lattice) -> Positions:
    """The intervals of a symmetric lattice right of the axis, intervals - intervals // 2 of them.

    An interval that straddles the axis comes first among them.
    """
    if not is_symmetric(lattice):
        raise InternalError("MF901", "the parity split needs a lattice that is symmetric about the axis")
    if not lattice.has_gutter:
        total = lattice.cells * lattice.dots
        half, count = total // 2, total - total // 2
        block = int(np.ceil(np.sqrt(count)))
        start = lattice.start_um + (half + 0.5) * lattice.dot_um
        coarse = start + block * lattice.dot_um * np.arange(-(-count // block), dtype=np.float64)
        fine = lattice.dot_um * np.arange(block, dtype=np.float64)
        return Positions(coarse, fine, np.array([lattice.dot_um]), 0, count)
    stride = lattice.dots + 1
    total = lattice.cells * stride - 1
    half = total // 2
    cell, first = divmod(half, stride)
    coarse = lattice.start_um + lattice.pitch_um * np.arange(cell, lattice.cells, dtype=np.float64)
    edges = np.append(lattice.dot_um * np.arange(stride, dtype=np.float64), lattice.pitch_um)
    return Positions(coarse, (edges[1:] + edges[:-1]) / 2, np.diff(edges), first, total - half)


def is_symmetric(lattice: Lattice) -> bool:
    """Whether a lattice is its own mirror image about the axis."""
    return abs(lattice.start_um + lattice.length_um / 2) <= _SYMMETRY * lattice.length_um


def real_type(precision: Precision) -> type[np.float64] | type[np.float32]:
    """The number type of a precision."""
    return np.float64 if precision == "double" else np.float32


def reduced_cycles(position_um: Floats, frequency: Floats) -> Floats:
    """Cycles of the waves at the positions, less whole ones, [positions, frequencies] in [-1/2, 1/2]."""
    cycles: Floats = position_um[:, None] * frequency
    cycles -= np.rint(cycles)
    return cycles


def _waves(position_um: Floats, frequency: Floats, precision: Precision) -> tuple[Reals, Reals]:
    """Cosine and sine of 2πux, [positions, frequencies]; evenly spaced frequencies are split into coarse and fine."""
    count = frequency.size
    block = int(np.sqrt(count))
    if count < _FEWEST_SPLIT or not is_even(frequency):
        return _waves_of(position_um, frequency, precision)
    steps = (frequency[-1] - frequency[0]) / (count - 1) * np.arange(block, dtype=np.float64)
    cosine, sine = (wave[:, :, None] for wave in _waves_of(position_um, frequency[::block], precision))
    fine_cosine, fine_sine = (wave[:, None, :] for wave in _waves_of(position_um, steps, precision))
    even, odd = cosine * fine_cosine, sine * fine_cosine
    even -= sine * fine_sine
    odd += cosine * fine_sine
    shape = (position_um.size, -1)
    return even.reshape(shape)[:, :count], odd.reshape(shape)[:, :count]


def _waves_of(position_um: Floats, frequency: Floats, precision: Precision) -> tuple[Reals, Reals]:
    phase = (2 * np.pi * reduced_cycles(position_um, frequency)).astype(real_type(precision), copy=False)
    return np.cos(phase), np.sin(phase)


def is_even(frequency: Floats) -> bool:
    """Whether frequencies are evenly spaced up to rounding."""
    even = np.linspace(frequency[0], frequency[-1], frequency.size)
    return bool(abs(frequency - even).max() <= 4 * np.finfo(np.float64).eps * abs(frequency).max())


# Coefficients of the fastest wave that may be dropped; those of other waves are far smaller.
_DROPPED = {"double": 1e-13, "single": 1e-8}


@dataclass(frozen=True)
class FrequencyNodes:
    """Nodes between 0 and the highest frequency, mirror images at negative frequencies implied.

    Attributes:
        highest: frequency in cycles per micrometre.
        stretch: γ, what makes the nodes even: polynomials in u at 0, evenly spaced at π / 2.
        count: r, how many.
    """

    highest: float
    stretch: float
    count: int
    precision: Precision

    @cached_property
    def frequency(self) -> Floats:
        """float64 [count], descending: a field is strongest near 0, and small terms are best summed first."""
        nodes = self.highest * _unmapped(np.cos(node_angles(self.count) / 2), self.stretch)
        nodes.flags.writeable = False
        return nodes

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


@lru_cache(maxsize=64)
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


NODE_TOLERANCE = 1e-13
"""Chebyshev coefficients of a wave, below which they are dropped: this share of the source is lost at most."""

_SPARE_NODES = 2


@dataclass(frozen=True)
class Nodes:
    """Chebyshev nodes of the first kind on an interval."""

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
        nodes, weights = gauss_legendre(quadrature)
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


@lru_cache(maxsize=256)
def node_count(width_um: float, highest: float) -> int:
    """The fewest nodes whose interpolation of exp(-2πiux) errs by about the tolerance on an interval that wide."""
    return wave_degree(np.pi * width_um * highest, NODE_TOLERANCE) + _SPARE_NODES
