r"""Autocorrelation of the amplitude behind a stop, one that carries a phase included.

    O(ν) = C(λdν) / C(0),    C(s) = ∫∫ a(r) a*(r + s) d²r                       (Goodman, Fourier Optics, 6.3)

is the transform of the point spread, exp(-2πi ν·x) its kernel. It is real only if the point spread is the same turned
by 180 degrees, as behind every mask that only dims.

Notes:
    Dots that the stop cuts enter with their mean amplitude, and lag 0 with all energy, as in
    :mod:`maskfab.optics.image.lag_table`, which knows their shapes too and no phase.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
import scipy.fft
from numpy.typing import NDArray

from maskfab.model import Stop, frozen
from maskfab.optics.image.lag_table import correlated, dot_blocks
from maskfab.optics.pupil.aperture import Aperture, Lattice
from maskfab.optics.pupil.pupil import share_inside
from maskfab.optics.pupil.stop_shape import Waves
from maskfab.optics.wavefront.panel_gap import StopField, turned

Table = NDArray[np.float32] | NDArray[np.complex64]
Amplitudes = NDArray[np.float64] | NDArray[np.complex64]


@dataclass(frozen=True, eq=False)
class StopAmplitude:
    """The amplitude behind a stop, dot by dot.

    Attributes:
        x, y: lattices of the dots.
        dots: float64, or complex64 with a phase, [cells y, dots y, cells x, dots x], the mean over each.
        energy_um2: integral of its squared modulus.
    """

    x: Lattice
    y: Lattice
    dots: Amplitudes
    energy_um2: float

    def __post_init__(self) -> None:
        object.__setattr__(self, "dots", frozen(self.dots))

    @classmethod
    def of(cls, openings: Aperture, stop: Stop, waves: Waves | None = None) -> StopAmplitude:
        """Openings cut by a centred stop, with a phase that is constant over each dot, as in its middle.

        Raises:
            JobError: MF104 for a phase that is not finite; MF115 where it turns by more than an eighth of a wave from
                one dot to the next.
        """
        x, y = openings.x, openings.y
        share = share_inside(x, y, stop)
        energy = np.diff(y.edges_um()) @ ((openings.transmission**2 + openings.variance) * share)
        dots = dot_blocks(x, y, openings.transmission * share)
        if waves is not None:
            inside = dot_blocks(x, y, share) > 0
            flat = inside.reshape(inside.shape[0] * inside.shape[1], -1)
            turn = turned(waves, _middles(x), _middles(y), flat)
            dots = (dots * turn.reshape(dots.shape)).astype(np.complex64)
        return cls(x, y, dots, float(energy @ np.diff(x.edges_um())))


@dataclass(frozen=True, eq=False)
class AmplitudeLags:
    """C(s) / C(0) at every cell lag and dot lag.

    Attributes:
        x, y: lattices of the dots.
        sizes: lags of cells and dots, along y and along x.
        table: float32, or complex64 with a phase, [lags y, lags x], negative ones wrapped round; lag 0 first.
    """

    x: Lattice
    y: Lattice
    sizes: tuple[tuple[int, int], tuple[int, int]]
    table: Table

    @classmethod
    def of(cls, amplitude: StopAmplitude) -> AmplitudeLags:
        """By FFT over cells and dots at once."""
        dots = amplitude.dots
        sizes = [int(scipy.fft.next_fast_len(2 * n - 1)) if n > 1 else 1 for n in dots.shape]
        scale = amplitude.x.dot_um * amplitude.y.dot_um / amplitude.energy_um2
        if dots.dtype == np.complex64:
            table: Table = _from_power(_power(dots, sizes))
            table *= np.float32(scale)
        else:
            table = (scale * correlated(np.asarray(dots, dtype=np.float64), sizes)).astype(np.float32)
        table = table.reshape(sizes[0] * sizes[1], sizes[2] * sizes[3])
        table[0, 0] = 1
        return cls(amplitude.x, amplitude.y, ((sizes[0], sizes[1]), (sizes[2], sizes[3])), table)

    @classmethod
    def across_gap(cls, field: StopField) -> AmplitudeLags:
        """The change by diffraction over a gap: C with it less C without, over C(0) with it.

        A free wave keeps its autocorrelation, so the change is small and smooth where both parts are neither: samples
        tell it far better than either.
        """
        count, sample = field.amplitude.shape[0], field.sample_um
        size = int(scipy.fft.next_fast_len(2 * count - 1))
        lattice = Lattice(-count * sample / 2, count, 1, sample, sample)
        power = _power(field.amplitude, [size, size])
        power -= _power(field.shadow, [size, size])
        table = _from_power(power)
        table *= np.float32(sample**2 / field.energy_um2)
        table[0, 0] = 1 - field.shadow_um2 / field.energy_um2
        return cls(lattice, lattice, ((size, 1), (size, 1)), table)


def _power(amplitude: NDArray[Any], sizes: list[int]) -> NDArray[np.float32]:
    spectrum = scipy.fft.fftn(amplitude.astype(np.complex64, copy=False), sizes, workers=1)
    power = spectrum.real**2
    power += spectrum.imag**2
    return np.asarray(power)


def _from_power(power: NDArray[np.float32]) -> NDArray[np.complex64]:
    """The inverse transform of |A|² is the sum of a*(r) a(r + s); the forward one is that of the opposite lag."""
    return np.asarray(scipy.fft.fftn(power, norm="forward", workers=1))


def _middles(lattice: Lattice) -> NDArray[np.float64]:
    edges, index = lattice.edges_um(), lattice.dot_index().ravel()
    return np.asarray((edges[index] + edges[index + 1]) / 2)
