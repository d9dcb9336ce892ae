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

import numpy as np
from numpy.polynomial.legendre import leggauss
from numpy.typing import NDArray

from maskfab.errors import InternalError

Floats = NDArray[np.float64]
Complexes = NDArray[np.complex128]

_TRANSFORM_TOLERANCE = 1e-9
_NODE_TOLERANCE = 1e-10
_LONGEST_PIECE_CYCLES = 2.0


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
        along_x, along_y = self._sums(step, count)
        u, v = across[None, :], across[:, None]
        squared = u**2 + v**2
        squared[count // 2, count // 2] = 1.0
        field: Complexes = 1j / (2 * np.pi * squared) * (u * along_y - v * along_x)
        field[count // 2, count // 2] = self.area_um2
        return field

    def _sums(self, step: float, count: int) -> tuple[Complexes, Complexes]:
        """Sums of dx and of dy over the nodes, each times exp(-2πi (ux + vy)).

        Both strengths are real, so either sum at -q is the conjugate of that at q, and one transform of dy + i dx holds
        them both.
        """
        import finufft

        x, y = 2 * np.pi * step * self.points
        both: Complexes = finufft.nufft2d1(
            y, x, self.dy + 1j * self.dx, (count, count), eps=_TRANSFORM_TOLERANCE, isign=-1, nthreads=1
        )
        mirrored = both[::-1, ::-1].conj()
        return (both - mirrored) / 2j, (both + mirrored) / 2


def boundary(edges_um: Floats, area_um2: float, highest: float) -> Boundary:
    """Gauss-Legendre nodes on directed edges.

    Args:
        edges_um: [n, 4] edges x0, y0, x1, y1 with the clear side on their left.
        area_um2: clear area.
        highest: highest frequency that will be asked for, diagonals included, cycles per micrometre.
    """
    points, dx, dy = _boundary_nodes(edges_um, highest)
    return Boundary(np.ascontiguousarray(points.T), dx, dy, area_um2, highest)


def _boundary_nodes(edges: Floats, highest: float) -> tuple[Floats, Floats, Floats]:
    """Quadrature nodes on the edges, [m, 2], with the weighted components dx and dy of the line element, [m]."""
    length = np.hypot(edges[:, 2] - edges[:, 0], edges[:, 3] - edges[:, 1])
    pieces = np.maximum(1, np.ceil(length * highest / _LONGEST_PIECE_CYCLES)).astype(np.intp)
    owner = np.repeat(np.arange(len(edges)), pieces)
    number = np.arange(owner.size) - np.repeat(np.cumsum(pieces) - pieces, pieces)
    start, step = edges[owner, :2], (edges[owner, 2:] - edges[owner, :2]) / pieces[owner, None]
    start = start + number[:, None] * step
    cycles = length[owner] / pieces[owner] * highest
    points, dx, dy = [], [], []
    # Edges of like length share a rule: most of a stop's rim is far shorter than a dot.
    finer = np.clip(np.ceil(np.log2(_LONGEST_PIECE_CYCLES / np.maximum(cycles, 1e-12))), 0, 8)
    for halvings in np.unique(finer):
        chosen = finer == halvings
        nodes, weights = leggauss(_nodes(_LONGEST_PIECE_CYCLES / 2**halvings))
        share = (nodes + 1) / 2
        points.append((start[chosen, None] + share[:, None] * step[chosen, None]).reshape(-1, 2))
        dx.append((step[chosen, 0, None] * weights / 2).ravel())
        dy.append((step[chosen, 1, None] * weights / 2).ravel())
    return np.concatenate(points), np.concatenate(dx), np.concatenate(dy)


def _nodes(cycles: float) -> int:
    """The fewest Gauss-Legendre nodes that integrate that many cycles of a cosine to the tolerance."""
    phase = np.pi * cycles
    for count in range(2, 32):
        nodes, weights = leggauss(count)
        if abs(np.cos(phase * nodes) @ weights / 2 - np.sinc(phase / np.pi)) < _NODE_TOLERANCE:
            return count
    return 32
