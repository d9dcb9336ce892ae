r"""The far field of polygons from their edges alone, which checks the matrix transform and shares nothing with it.

By the divergence theorem a clear region with boundary ∂Ω, taken counter-clockwise, has the field

    F(u, v) = i / (2π (u² + v²)) ∮ (u dy - v dx) exp(-2πi (ux + vy)),

and F(0, 0) is its area. The line integral is done by Gauss-Legendre nodes along the edges, and the sum over nodes at
all frequencies at once by a non-uniform Fourier transform of type 1 (finufft: Barnett, Magland, af Klinteberg 2019).
Edges along x or y whose lengths are whole multiples of one length l, as most of a raster's are, need a node for each l
and are exact: ∫ exp(-2πivy) dy along one is l sinc(vl) times the wave in its middle. They are transformed apart.

Near q = 0 the two sums cancel, and the division amplifies the transform's own error by perimeter / (2π q area), about a
hundred at the sampling of a PSF. As ∮ dx = ∮ dy = 0 and ∮ x dy = -∮ y dx is the area, the same integral is also

    F(u, v) = F(0, 0) + i / (2π (u² + v²)) ∮ (u dy - v dx) (exp(-iφ) - 1 + iφ),    φ = 2π (ux + vy),

in which nothing is left to cancel. It is summed node by node at the frequencies up to a quarter cycle over the region
along either axis, where it costs little; a PSF of the usual sampling asks for none of them but 0.

Notes:
    At most 33 x 33 frequencies are summed so. On a grid with more of them in that quarter cycle the next ones keep the
    transform's error, amplified as said.
    Millions of edges are taken by the quarter million, long ones by the million of nodes, so that their nodes do not
    all need memory at once.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property, lru_cache

import numpy as np

from maskfab.base.arrays import Complexes, Floats, Indices, expanded
from maskfab.base.errors import InternalError
from maskfab.base.model import frozen
from maskfab.optics.field.matrix import ParityField
from maskfab.optics.polynomials import gauss_legendre

EDGES_AT_A_TIME, _NODES_AT_A_TIME = 2**18, 2**20

_TRANSFORM_TOLERANCE = 1e-9
_NODE_TOLERANCE = 1e-10
_LONGEST_PIECE_CYCLES = 4.0
_RULES_PER_OCTAVE = 2
# About as many nodes as edges have, however short, and more for every cycle.
_FEWEST_NODES, _NODES_PER_CYCLE = 3, 3.5
# Nodes that it must save to transform edges of one length apart; how nearly lengths are one.
_LEAST_SAVED, _SAME_LENGTH_UM = 60_000, 1e-9
# A finer grid than the frequencies', as coarse as finufft takes: its transform costs more than spreading the nodes.
_UPSAMPLING = 1.25
_NEAR_CYCLES = 0.25
_MOST_NEAR = 16
# Few enough to stay in the processor's cache.
_PHASES_AT_A_TIME = 2**13
# Terms after which the series of sine and cosine have ended at an eighth of a turn.
_SERIES = 7


@dataclass(frozen=True, eq=False)
class _Nodes:
    """Quadrature nodes on edges, micrometres, and weighted parts of the line element, the clear side on its left.

    Attributes:
        length_um: of edges along x or y in whose middles the nodes are; 0 of nodes that stand for themselves.
    """

    points: Floats
    dx: Floats
    dy: Floats
    length_um: float = 0.0


@dataclass(frozen=True, eq=False)
class Boundary:
    """The boundary of a clear region.

    Attributes:
        edges_um: float64 [n, 4], x0, y0, x1, y1 of directed edges, the clear side on their left.
        area_um2: clear area.
        highest: highest frequency in cycles per micrometre at which the quadrature holds.
        starts: intp [k], first of the edges that have their nodes in memory at once.
        unit_um: side of most edges along x and y, which all of them together need but one node for each; 0 for none.
    """

    edges_um: Floats
    area_um2: float
    highest: float
    starts: Indices
    unit_um: float

    def field(self, step: float, count: int) -> Complexes:
        """The field on a square grid of frequencies centred on 0, complex [count, count], axes v and u.

        Args:
            step: distance between frequencies, cycles per micrometre.
            count: number of frequencies along each axis, odd.
        """
        middle = count // 2
        across = step * np.arange(-middle, middle + 1, dtype=np.float64)
        if across[-1] * np.sqrt(2) > self.highest * (1 + 1e-9):
            what = f"frequency {across[-1]:g} cycles/um is beyond the quadrature's {self.highest:g}"
            raise InternalError("MF901", what)
        extent = 2 * step * max(float(self.edges_um.max(initial=0.0)), -float(self.edges_um.min(initial=0.0)))
        # Frequencies on either side of 0 that are summed directly.
        reach = min(middle, int(_NEAR_CYCLES / extent) if extent > _NEAR_CYCLES / _MOST_NEAR else _MOST_NEAR)
        block = (slice(middle - reach, middle + reach + 1),) * 2
        up = across[middle:, None]
        half = np.zeros((middle + 1, count), dtype=np.complex128)
        for nodes in self._parts(0.0 if reach else self.unit_um):
            sums = _sums(nodes, step, count) if reach < middle else np.empty((count, count), dtype=np.complex128)
            sums[block] = _remainders(nodes, step, reach)
            # Sums of dy and of dx, twice, from those at opposite frequencies.
            here, opposite = sums[middle:], sums[middle::-1, ::-1].conj()
            share = np.sinc(nodes.length_um * across)
            half += (across * share[middle:, None]) * (here + opposite)
            half += 1j * (up * share) * (here - opposite)
        squared = across**2 + up**2
        squared[0, middle] = 1.0
        half *= 1j / (4 * np.pi) / squared
        field = np.concatenate([half[:0:-1, ::-1].conj(), half])
        field[block] += self.area_um2
        return field

    def parity(self, u: Floats, v: Floats) -> ParityField:
        """The field at frequencies along the axes, [nu] and [nv], none negative, summed node by node.

        Sums of cosines and sines tell it at all four signs, by real products.
        """
        # Of dy and dx; with cosine and sine along y, and along x.
        sums = np.zeros((2, 2, 2, v.size, u.size))
        for nodes in self._parts(0.0):
            for start in range(0, nodes.dx.size, _PHASES_AT_A_TIME):
                part = slice(start, start + _PHASES_AT_A_TIME)
                phases = (2 * np.pi * q[:, None] * nodes.points[k, part] for k, q in enumerate((u, v)))
                across, up = ((np.cos(phase), np.sin(phase)) for phase in phases)
                for k, weight in enumerate((nodes.dy[part], nodes.dx[part])):
                    for j, i in np.ndindex(2, 2):
                        sums[k, j, i] += (up[j] * weight) @ across[i].T
        squared = u**2 + v[:, None] ** 2
        share = 1 / (2 * np.pi * np.where(squared, squared, 1.0))
        along, aside = u * share, v[:, None] * share
        by_dy, by_dx = sums
        even_even = np.where(squared, along * by_dy[0, 1] - aside * by_dx[1, 0], self.area_um2)
        return ParityField(
            even_even,
            -along * by_dy[0, 0] - aside * by_dx[1, 1],
            along * by_dy[1, 1] + aside * by_dx[0, 0],
            -along * by_dy[1, 0] + aside * by_dx[0, 1],
            on_axis=bool(u[0] == 0),
        )

    def _parts(self, unit_um: float) -> Iterator[_Nodes]:
        if self.starts.size == 1 and unit_um == self.unit_um:
            yield from self._ready
            return
        for edges in np.split(self.edges_um, self.starts[1:]):
            yield from _boundary_nodes(edges, self.highest, unit_um)

    @cached_property
    def _ready(self) -> tuple[_Nodes, ...]:
        """Nodes of all edges, made once for all wavelengths."""
        return tuple(_boundary_nodes(self.edges_um, self.highest, self.unit_um))


def boundary(edges_um: Floats, area_um2: float, highest: float, edges_at_a_time: int = EDGES_AT_A_TIME) -> Boundary:
    """The boundary of a region, ready to be transformed.

    Args:
        edges_um: [n, 4] edges x0, y0, x1, y1 with the clear side on their left; they close up.
        highest: highest frequency that will be asked for, diagonals included, cycles per micrometre.
        edges_at_a_time: bounds the memory, as the number of nodes does; the field is the same to rounding.
    """
    span = edges_um[:, 2:].T - edges_um[:, :2].T
    nodes = _expected_nodes(span, highest)
    before = np.cumsum(nodes)
    part = np.stack([np.arange(len(edges_um)) // edges_at_a_time, before // _NODES_AT_A_TIME])
    starts = np.append(0, np.flatnonzero(np.diff(part).any(axis=0)) + 1)
    lengths, counts = np.unique(np.round(abs(span).sum(axis=0)[~span.all(axis=0)], 6), return_counts=True)
    unit_um = float(lengths[counts.argmax()]) if counts.size else 0.0
    pieces = _pieces(span, unit_um, highest)
    worthwhile = nodes[pieces > 0].sum() - pieces.sum() > _LEAST_SAVED
    return Boundary(frozen(edges_um), area_um2, highest, starts, unit_um if worthwhile else 0.0)


def _cycles(span: Floats, highest: float) -> Floats:
    """Most cycles along edges [2, n] where a square of frequencies has its corners at the highest one."""
    return np.asarray(abs(span).sum(axis=0) * (highest / np.sqrt(2)))


def _expected_nodes(span: Floats, highest: float) -> Floats:
    return _FEWEST_NODES + _NODES_PER_CYCLE * _cycles(span, highest)


def _pieces(span: Floats, unit_um: float, highest: float) -> Indices:
    """Into how many of a length each edge along x or y can be cut, [n]; 0 where it cannot, or has fewer nodes."""
    length = abs(span).sum(axis=0)
    if not unit_um:
        return np.zeros(length.size, dtype=np.intp)
    pieces: Indices = np.rint(length / unit_um).astype(np.intp)
    other = span.all(axis=0) | (abs(pieces * unit_um - length) > _SAME_LENGTH_UM)
    pieces[other | (pieces > _expected_nodes(span, highest))] = 0
    return pieces


def _sums(nodes: _Nodes, step: float, count: int) -> Complexes:
    """Sum of dy + i dx over the nodes, each times exp(-2πi (ux + vy)).

    Both strengths are real, so one transform B holds the sums of both: that of dy is (B(q) + B*(-q)) / 2, that of
    dx is (B(q) - B*(-q)) / 2i.
    """
    import finufft

    x, y = 2 * np.pi * step * nodes.points
    sums: Complexes = finufft.nufft2d1(
        y,
        x,
        nodes.dy + 1j * nodes.dx,
        (count, count),
        eps=_TRANSFORM_TOLERANCE,
        isign=-1,
        nthreads=1,
        upsampfac=_UPSAMPLING,
    )
    return sums


def _remainders(nodes: _Nodes, step: float, reach: int) -> Complexes:
    """Sum of dy + i dx over the nodes, each times exp(-iφ) - 1 + iφ, at reach frequencies on either side of 0.

    With g = exp(-iφ) - 1 + iφ and m = g - iφ along each axis, that of a sum of phases is g_x + g_y + m_x m_y.
    """
    total = np.zeros((2 * reach + 1,) * 2, dtype=np.complex128)
    if reach == 0:
        return total
    turns = 2 * np.pi * step * np.arange(1, reach + 1, dtype=np.float64)
    at_a_time = _PHASES_AT_A_TIME // reach
    for start in range(0, nodes.dx.size, at_a_time):
        part = slice(start, start + at_a_time)
        strength = nodes.dy[part] + 1j * nodes.dx[part]
        (past_x, whole_x), (past_y, whole_y) = (_past_linear(turns[:, None] * nodes.points[k, part]) for k in (0, 1))
        total += past_x @ strength + (past_y @ strength)[:, None]
        total += (whole_y * strength) @ whole_x.T
    return total


def _past_linear(phase: Floats) -> tuple[Complexes, Complexes]:
    """g = exp(-iφ) - 1 + iφ and m = exp(-iφ) - 1 to full precision at -φ, 0 and φ ≤ π/4, [2 k + 1, m] (DLMF 4.19)."""
    square = phase**2
    sine, cosine = np.ones_like(phase), np.ones_like(phase)
    for k in range(_SERIES, 0, -1):
        sine *= -square / ((2 * k + 2) * (2 * k + 3))
        sine += 1
        cosine *= -square / ((2 * k + 1) * (2 * k + 2))
        cosine += 1
    reach = len(phase)
    past = np.zeros((2 * reach + 1, phase.shape[1]), dtype=np.complex128)
    past[reach + 1 :].real = -square / 2 * cosine
    past[reach + 1 :].imag = square * phase / 6 * sine
    past[:reach] = past[:reach:-1].conj()
    whole = past.copy()
    whole[reach + 1 :].imag -= phase
    whole[:reach].imag += phase[::-1]
    return past, whole


def _boundary_nodes(edges: Floats, highest: float, unit_um: float) -> Iterator[_Nodes]:
    """The middles of all edges along x and y that are whole multiples of a length; Gauss-Legendre nodes on others."""
    start, span = edges[:, :2].T, edges[:, 2:].T - edges[:, :2].T
    pieces = _pieces(span, unit_um, highest)
    if unit_um:
        owner, number = expanded(pieces)
        across, up = span[:, owner] / pieces[owner]
        points = start[:, owner] + (number + 0.5) * np.stack([across, up])
        yield _Nodes(np.ascontiguousarray(points), across, up, unit_um)
        start, span = start[:, pieces == 0], span[:, pieces == 0]
    cycles = _cycles(span, highest)
    pieces = np.maximum(1, np.ceil(cycles / _LONGEST_PIECE_CYCLES)).astype(np.intp)
    if (pieces > 1).any():
        owner, number = expanded(pieces)
        span = span[:, owner] / pieces[owner]
        start = start[:, owner] + number * span
        cycles = cycles[owner] / pieces[owner]
    places, line = [], []
    # Edges of like length share a rule: most of a stop's rim is far shorter than a dot.
    shorter = _LONGEST_PIECE_CYCLES / np.maximum(cycles, 1e-12)
    finer = np.clip(np.floor(_RULES_PER_OCTAVE * np.log2(shorter)), 0, 8 * _RULES_PER_OCTAVE).astype(np.intp)
    for number_of_rule in np.flatnonzero(np.bincount(finer)):
        chosen = finer == number_of_rule
        nodes, weights = _rule(_LONGEST_PIECE_CYCLES / 2 ** (int(number_of_rule) / _RULES_PER_OCTAVE))
        along = span[:, chosen, None]
        places.append((start[:, chosen, None] + (nodes + 1) / 2 * along).reshape(2, -1))
        line.append((weights / 2 * along).reshape(2, -1))
    if line:
        dx, dy = np.concatenate(line, axis=1)
        yield _Nodes(np.concatenate(places, axis=1), dx, dy)


@lru_cache(maxsize=64)
def _rule(cycles: float) -> tuple[Floats, Floats]:
    """Nodes and weights of the shortest Gauss-Legendre rule that integrates that many cycles to the tolerance."""
    phase = np.pi * cycles
    for count in range(1, 32):
        nodes, weights = gauss_legendre(count)
        if abs(np.cos(phase * nodes) @ weights / 2 - np.sinc(phase / np.pi)) < _NODE_TOLERANCE:
            break
    return frozen(nodes), frozen(weights)
