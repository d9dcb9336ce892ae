r"""Cosines and sines of 2πux, the waves that the matrix transforms are made of.

A lattice repeats, so the waves of its intervals are products of a few coarse and a few fine ones (addition theorem,
DLMF 4.21.2), and the interval's own transform, w sinc(uw), goes into the fine ones.

Notes:
    A phase of thousands of cycles has lost its digits by the time a single-precision cosine sees it. Phases are
    therefore counted in cycles and reduced to half a cycle in double precision, whatever the precision of the result.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from maskfab.base.arrays import Floats
from maskfab.errors import InternalError
from maskfab.optics.pupil.aperture import Lattice

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
        kept = slice(self.first, self.first + self.count)
        return even.reshape(-1, frequency.size)[kept], odd.reshape(-1, frequency.size)[kept]


def point_sources(position_um: Floats) -> Positions:
    """Point sources anywhere."""
    return Positions(np.zeros(1), position_um, None, 0, position_um.size)


def right_half(lattice: Lattice) -> Positions:
    """The intervals of a symmetric lattice right of the axis, intervals - intervals // 2 of them.

    An interval that straddles the axis comes first among them.

    Raises:
        InternalError: MF901 if the lattice is not symmetric about the axis.
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
    length = (lattice.cells - 1) * lattice.pitch_um + lattice.dots * lattice.dot_um
    return abs(lattice.start_um + length / 2) <= _SYMMETRY * length


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
