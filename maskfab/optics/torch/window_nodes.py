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

import math
from dataclasses import dataclass

import numpy as np
import scipy
from numpy.typing import NDArray

from maskfab.errors import InternalError
from maskfab.optics.field.interpolation import frequency_nodes
from maskfab.optics.torch.phasors import cosines_and_sines

Floats = NDArray[np.float64]

NODE_TOLERANCE = 1e-12
"""Error of a sum over the nodes, as a share of the sum at frequency 0."""

# Singular directions that a Gauss-Newton step leaves alone; without them it overshoots, and then comes in fast.
_CUTOFFS = (1e-6, 1e-6, 1e-8, *[1e-13] * 9)
_TRIES = 3
_STILL = 1e-6  # cycles from the axis to the end below which zeros are those of rounding
_GRID = 16  # points per cycle in the search for zeros


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
    """The fewest nodes with the same sums, or the samples themselves if these are as few or waves do not turn.

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
    if cycles < _STILL:
        return samples
    abscissa, share = _half_rule(int(1.3 * cycles) + 40)
    frequency, root = abscissa * highest / 2, np.sqrt(share)
    waves = cosines_and_sines(frequency, position_um)[0] * root[:, None] * np.sqrt(samples.weight)
    # Squares of singular values, which the tolerance asks for, need no singular value decomposition.
    square, left = np.linalg.eigh(waves @ waves.T)
    few = int((square > tolerance * square[-1]).sum())
    for count in range(few, few + _TRIES):
        if count >= min(waves.shape):
            break
        place = _zeros(frequency, left[:, -1 - count] * root, float(position_um[-1]), cycles)
        if place.size == count:
            nodes, error = _refined(place, samples, highest, tolerance)
            # Between the frequencies it was measured at the error may be a little more.
            if error <= 0.8 * tolerance:
                return nodes
    return samples


def _half_rule(count: int) -> tuple[Floats, Floats]:
    """Positive nodes and weights of the Gauss-Legendre rule of 2 ``count`` nodes, descending.

    Tricomi's guess and two of Newton's steps: the eigenvalues that numpy takes cost more than all else here.
    """
    degree = 2 * count
    angle = np.pi * (4 * np.arange(1, count + 1) - 1) / (4 * degree + 2)
    node = (1 - (degree - 1) / (8 * degree**3)) * np.cos(angle)
    for _ in range(2):
        value = scipy.special.eval_legendre(degree, node)
        slope = degree * (scipy.special.eval_legendre(degree - 1, node) - node * value) / (1 - node**2)
        weight = 2 / ((1 - node**2) * slope**2)
        node = node - value / slope
    return node, weight


def _zeros(frequency: Floats, coefficient: Floats, reach_um: float, cycles: float) -> Floats:
    """Zeros of the sum of waves from the axis to just outside the window, by chords and Newton's method."""
    block = math.isqrt(int(_GRID * cycles) + 200) + 1
    step = reach_um * (1 + 5e-4) / (block**2 - 1)
    # At sums of coarse and fine places the waves are products (DLMF 4.21.2), and no table of them is needed.
    coarse, fine = (
        cosines_and_sines(spread * step * np.arange(block, dtype=np.float64), frequency) for spread in (block, 1)
    )
    value = ((coefficient * coarse[0]) @ fine[0].T - (coefficient * coarse[1]) @ fine[1].T).ravel()
    before = np.flatnonzero(value[:-1] * value[1:] < 0)
    zero: Floats = step * (before - value[before] / (value[before + 1] - value[before]))
    for _ in range(2):
        even, odd = cosines_and_sines(frequency, zero)
        zero = zero + coefficient @ even / ((2 * np.pi * frequency * coefficient) @ odd)
    return zero


def _refined(place: Floats, samples: WindowNodes, highest: float, tolerance: float) -> tuple[WindowNodes, float]:
    """Positions and weights after Gauss-Newton steps, the best of them, and its error."""
    # The sums are waves of frequency themselves, from within the window.
    frequency = frequency_nodes(float(samples.position_um[-1]), highest, "double").frequency
    wanted = cosines_and_sines(frequency, samples.position_um)[0] @ samples.weight
    even, odd = cosines_and_sines(frequency, place)
    weight, total = _least_squares(even, wanted, _CUTOFFS[-1]), samples.weight.sum()
    best, least = samples, np.inf
    for cutoff in _CUTOFFS:
        missing = wanted - even @ weight
        error = float(np.abs(missing).max() / total)
        if error < least:
            # Of waves that hardly turn two nodes tell more than enough, and a step may let them pass each other.
            order = np.argsort(place)
            best, least = WindowNodes(place[order], weight[order]), error
        if error <= tolerance / 2:
            break
        slope = np.concatenate([even, -2 * np.pi * frequency[:, None] * odd * weight], axis=1)
        step = _least_squares(slope, missing, cutoff)
        weight, place = weight + step[: place.size], place + step[place.size :]
        even, odd = cosines_and_sines(frequency, place)
    return best, least


def _least_squares(matrix: Floats, wanted: Floats, cutoff: float) -> Floats:
    """By pivoted QR, which takes a third of the time of singular values."""
    solution: Floats = scipy.linalg.lstsq(matrix, wanted, cond=cutoff, lapack_driver="gelsy", check_finite=False)[0]
    return solution
