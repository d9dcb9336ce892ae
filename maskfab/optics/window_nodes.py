r"""Fewer samples of a window than it has, for the same sums: Gauss nodes for waves up to a highest frequency.

A PSF holds no spatial frequency above D/(λf), so with a wave of frequency ν its samples are waves of up to
γ = D/(λf) + ν. Sums of these over a window's samples x_k, with positive counts c_k, are sums over about half as many
nodes as the waves have independent values (Beylkin & Monzón, Appl. Comput. Harmon. Anal. 12, 2002),

    Σ_k c_k cos(2πγ x_k) = Σ_j w_j cos(2πγ z_j)    for all γ up to the highest:

the z are the zeros, inside the window, of a function of half that band which is as good as nothing on all samples. That
is the singular vector of the waves of half the band that has a singular value below the root of the tolerance.
A few Gauss-Newton steps on positions and weights remove what rounding did to it.

Notes:
    A window of 257 samples half a micrometre apart becomes 139 nodes, for a 4 mm stop at 530 nm and 10 mm.
    Products of two odd waves, sin x sin, are cosines as well, so the nodes serve both parities.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.polynomial.legendre import leggauss
from numpy.typing import NDArray

from maskfab.errors import InternalError

Floats = NDArray[np.float64]

NODE_TOLERANCE = 1e-12
"""Error of a sum over the nodes, as a share of the sum at frequency 0."""

_STEPS = 10
_TRIES = 3
_GRID = 48  # points per cycle in the search for zeros


@dataclass(frozen=True, eq=False)
class WindowNodes:
    """Where to sample one axis of a symmetric window, and how much each sample counts.

    Attributes:
        position_um: float64 [k], from the axis outwards, ascending.
        weight: float64 [k]; half a window's sums are made of these, so a sample on the axis weighs 1/2.
    """

    position_um: Floats
    weight: Floats


def every_position(position_um: Floats) -> WindowNodes:
    """All samples of the half window as they are.

    Raises:
        InternalError: MF901 for a negative position.
    """
    if position_um.min() < 0:
        raise InternalError("MF901", "positions of half a window must not be negative")
    return WindowNodes(position_um, np.where(position_um == 0, 0.5, 1.0))


def window_nodes(position_um: Floats, highest: float, tolerance: float = NODE_TOLERANCE) -> WindowNodes:
    """The fewest nodes with the same sums, or the samples themselves where nodes would be no fewer.

    Args:
        position_um: non-negative positions of the samples, [n], ascending.
        highest: highest frequency γ, in cycles per micrometre of sensor: that of the PSF, the pupil's width / (λf),
            and that of the wave it is multiplied with, together.
        tolerance: largest error of a sum, as a share of the sum at frequency 0.

    Raises:
        InternalError: MF901 for a negative position or frequency.
    """
    samples = every_position(position_um)
    if highest < 0:
        raise InternalError("MF901", f"the highest frequency of a window is {highest:g}; it must not be negative")
    cycles = highest * float(position_um[-1])
    abscissa, share = leggauss(2 * (int(1.3 * cycles) + 40))
    half = abscissa > 0
    frequency, root = abscissa[half] * highest / 2, np.sqrt(share[half])
    waves = _waves(frequency, position_um) * root[:, None] * np.sqrt(samples.weight)
    left, size, _ = np.linalg.svd(waves, full_matrices=False)
    few = int((size**2 > tolerance * size[0] ** 2).sum())
    for count in range(few, few + _TRIES):
        if count >= min(position_um.size, size.size):
            break
        place = _zeros(frequency, left[:, count] * root, float(position_um[-1]), cycles)
        if place.size == count:
            nodes, error = _refined(place, samples, highest, cycles, tolerance)
            if error <= tolerance:
                return nodes
    return samples


def _waves(frequency: Floats, position_um: Floats) -> Floats:
    cycles = frequency[:, None] * position_um
    waves: Floats = np.cos(2 * np.pi * (cycles - np.rint(cycles)))
    return waves


def _zeros(frequency: Floats, coefficient: Floats, reach_um: float, cycles: float) -> Floats:
    """Zeros of the sum of waves from the axis to just outside the window, by chords and Newton's method."""
    grid = np.linspace(0.0, reach_um * (1 + 5e-4), int(_GRID * cycles) + 200)
    value = coefficient @ _waves(frequency, grid)
    before = np.flatnonzero(value[:-1] * value[1:] < 0)
    zero: Floats = grid[before] - value[before] * (grid[1] - grid[0]) / (value[before + 1] - value[before])
    for _ in range(3):
        phase = 2 * np.pi * frequency[:, None] * zero
        zero = zero + coefficient @ np.cos(phase) / ((2 * np.pi * frequency * coefficient) @ np.sin(phase))
    return zero


def _refined(
    place: Floats, samples: WindowNodes, highest: float, cycles: float, tolerance: float
) -> tuple[WindowNodes, float]:
    """Positions and weights after Gauss-Newton steps, the best of them, and its error."""
    # Chebyshev points lie closest where the sums are hardest to match, at the highest frequency; the sums are even.
    many = int(4 * cycles) + 80
    frequency = highest * np.cos(np.pi * (np.arange(many) + 0.5) / (2 * many))
    wanted, total = _waves(frequency, samples.position_um) @ samples.weight, samples.weight.sum()
    weight: Floats = np.asarray(np.linalg.lstsq(_waves(frequency, place), wanted, rcond=1e-15)[0], dtype=np.float64)
    best, least = samples, np.inf
    for _ in range(_STEPS):
        waves = _waves(frequency, place)
        missing = wanted - waves @ weight
        error = float(np.abs(missing).max() / total)
        if error < least:
            best, least = WindowNodes(place, weight), error
        if error <= tolerance / 10:
            break
        angular = 2 * np.pi * frequency[:, None]
        slope = np.concatenate([waves, -angular * np.sin(angular * place) * weight], axis=1)
        step = np.linalg.lstsq(slope, missing, rcond=1e-13)[0]
        weight, place = weight + step[: place.size], place + step[place.size :]
    return best, least
