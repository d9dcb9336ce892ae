r"""The far field of polygons from their edges alone, which checks the matrix transform and shares nothing with it.

By the divergence theorem a clear region with boundary ∂Ω, taken counter-clockwise, has the field

    F(u, v) = i / (2π (u² + v²)) ∮ (u dy - v dx) exp(-2πi (ux + vy)),

and F(0, 0) is its area. The line integral is done by Gauss-Legendre nodes along the edges, and the sum over nodes at
all frequencies at once by a non-uniform Fourier transform of type 1 (finufft: Barnett, Magland, af Klinteberg 2019).

Notes:
    The two sums cancel near q = 0, where the division amplifies the transform's own error by perimeter / (q area).
    At the sampling of a PSF that factor is about a hundred, which leaves 1e-7 of the field at the few samples there.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from numpy.polynomial.legendre import leggauss
from numpy.typing import NDArray

from maskfab.errors import InternalError
from maskfab.model import frozen

Floats = NDArray[np.float64]
Complexes = NDArray[np.complex128]

_TRANSFORM_TOLERANCE = 1e-9
_NODE_TOLERANCE = 1e-10
_LONGEST_PIECE_CYCLES = 4.0
_RULES_PER_OCTAVE = 2
# A finer grid than the frequencies', as coarse as finufft takes: its transform costs more than spreading the nodes.
_UPSAMPLING = 1.25


@dataclass(frozen=True, eq=False)
class Boundary:
    """The boundary of a clear region as quadrature nodes.

    Attributes:
        points: float64 [2, m], x and y in micrometres.
        dx, dy: float64 [m], weighted components of the line element, the clear side on its left.
        area_um2: clear area.
        highest: highest frequency in cycles per micrometre at which the quadrature holds.
    """

    points: Floats
    dx: Floats
    dy: Floats
    area_um2: float
    highest: float

    def field(self, step: float, count: int) -> Complexes:
        """The field on a square grid of frequencies centred on 0, complex [count, count], axes v and u.

        Args:
            step: distance between frequencies, cycles per micrometre.
            count: number of frequencies along each axis, odd.

        Raises:
            InternalError: MF901 if the grid goes beyond ``highest``.
        """
        across = step * np.arange(-(count // 2), count // 2 + 1, dtype=np.float64)
        if across[-1] * np.sqrt(2) > self.highest * (1 + 1e-9):
            raise InternalError(
                "MF901", f"frequency {across[-1]:g} cycles/um is beyond the quadrature's {self.highest:g}"
            )
        u, v = across[None, :], across[:, None]
        turned = u - 1j * v
        turned[count // 2, count // 2] = 1.0
        half = self._sums(step, count)
        half *= 1j / (4 * np.pi) / turned
        field: Complexes = half + half[::-1, ::-1].conj()
        field[count // 2, count // 2] = self.area_um2
        return field

    def _sums(self, step: float, count: int) -> Complexes:
        """Sum of dy + i dx over the nodes, each times exp(-2πi (ux + vy)).

        Both strengths are real, so one transform B holds the sums of both: that of dy is (B(q) + B*(-q)) / 2, that of
        dx is (B(q) - B*(-q)) / 2i, and the field is half + its mirror image's conjugate, half = iB / 4π(u - iv).
        """
        import finufft

        x, y = 2 * np.pi * step * self.points
        sums: Complexes = finufft.nufft2d1(
            y,
            x,
            self.dy + 1j * self.dx,
            (count, count),
            eps=_TRANSFORM_TOLERANCE,
            isign=-1,
            nthreads=1,
            upsampfac=_UPSAMPLING,
        )
        return sums


def boundary(edges_um: Floats, area_um2: float, highest: float) -> Boundary:
    """Gauss-Legendre nodes on directed edges.

    Args:
        edges_um: [n, 4] edges x0, y0, x1, y1 with the clear side on their left.
        area_um2: clear area.
        highest: highest frequency that will be asked for, diagonals included, cycles per micrometre.
    """
    points, dx, dy = _boundary_nodes(edges_um, highest)
    return Boundary(points, dx, dy, area_um2, highest)


def _boundary_nodes(edges: Floats, highest: float) -> tuple[Floats, Floats, Floats]:
    """Quadrature nodes on the edges, [2, m], with the weighted components dx and dy of the line element, [m]."""
    start, span = edges[:, :2].T, edges[:, 2:].T - edges[:, :2].T
    cycles = np.hypot(*span) * highest
    pieces = np.maximum(1, np.ceil(cycles / _LONGEST_PIECE_CYCLES)).astype(np.intp)
    if (pieces > 1).any():
        owner = np.repeat(np.arange(len(edges)), pieces)
        number = np.arange(owner.size) - np.repeat(np.cumsum(pieces) - pieces, pieces)
        span = span[:, owner] / pieces[owner]
        start = start[:, owner] + number * span
        cycles = cycles[owner] / pieces[owner]
    points, line = [], []
    # Edges of like length share a rule: most of a stop's rim is far shorter than a dot.
    shorter = _LONGEST_PIECE_CYCLES / np.maximum(cycles, 1e-12)
    finer = np.clip(np.floor(_RULES_PER_OCTAVE * np.log2(shorter)), 0, 8 * _RULES_PER_OCTAVE).astype(np.intp)
    for number_of_rule in np.flatnonzero(np.bincount(finer)):
        chosen = finer == number_of_rule
        nodes, weights = _rule(_LONGEST_PIECE_CYCLES / 2 ** (int(number_of_rule) / _RULES_PER_OCTAVE))
        along = span[:, chosen, None]
        points.append((start[:, chosen, None] + (nodes + 1) / 2 * along).reshape(2, -1))
        line.append((weights / 2 * along).reshape(2, -1))
    dx, dy = np.concatenate(line, axis=1)
    return np.concatenate(points, axis=1), dx, dy


@lru_cache(maxsize=64)
def _rule(cycles: float) -> tuple[Floats, Floats]:
    """Nodes and weights of the shortest Gauss-Legendre rule that integrates that many cycles to the tolerance."""
    phase = np.pi * cycles
    for count in range(1, 32):
        nodes, weights = leggauss(count)
        if abs(np.cos(phase * nodes) @ weights / 2 - np.sinc(phase / np.pi)) < _NODE_TOLERANCE:
            break
    return frozen(nodes), frozen(weights)
