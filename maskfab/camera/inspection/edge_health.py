"""Whether a picture's edge is one that light made: no sharpening, no tone curve, and even light.

Light is never negative, so the line spread of an optic is not, and its MTF stays at or below 1; the edge spread only
rises. Sharpening makes both otherwise: the spread overshoots the fields beside it.

An optic that is not decentred spreads light alike to both sides, so that the transfer function is real but for the
edge's own place. A tone curve stretches the dark side and squeezes the bright one, and light that bends across the
region adds to the bright side more than to the dark one: the phase that no shift of the edge explains tells both. So
does coma, of which the modulus is an MTF nevertheless; a picture does not tell them apart.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from maskfab.base.arrays import Complexes, Floats, Mask
from maskfab.base.model import Quantity
from maskfab.camera.inspection.edge_regions import FEWEST_LINES

_SURE = 5.0
"""Standard deviations beyond which noise explains nothing, of some hundred places at most."""

_LEAST = 0.01
"""Of the step, or of the MTF: less changes no frequency at which it is one half by more than a hundredth."""

_LEAST_OVERSHOOT = 0.004
"""Of the step: sharpening by a tenth of an unsharp mask does as much, and moves that frequency by a twentieth."""

_MOST_UNEVEN = 0.1
"""Light that changes by so much moves that frequency by a hundredth."""

_BLOCK_PX, _NEAR_PX = 1.0, 12.0
_ROUNDS = 8
_LIMIT_CY_PER_PX = 0.5


@dataclass(frozen=True)
class Excess:
    """A number that sound edges have only as far as noise makes it.

    Attributes:
        noise: one standard deviation.
        at_most: that alone is no fault.
    """

    name: str
    value: float
    noise: float
    at_most: float

    def quantity(self, die: str | None) -> Quantity:
        """Its row, held against what noise and the least that matters explain together."""
        limit = max(self.at_most, _SURE * self.noise)
        method = f"beyond {self.at_most:g} and {_SURE:g} standard deviations ({self.noise:.2g}) of noise it is a fault"
        return Quantity(self.name, self.value, method, limit=limit, passed=self.value <= limit, die=die)


def overshoot(knots_px: Floats, spread: Floats, noise_of_knot: float) -> Excess:
    """By how much the edge spread leaves the fields beside it, as a share of its step."""
    step = float(knots_px[1] - knots_px[0])
    block = max(1, round(_BLOCK_PX / step))
    near = abs(knots_px) <= _NEAR_PX
    mean = np.convolve(spread[near], np.full(block, 1 / block), "valid")
    rise = float(mean[-1] - mean[0])
    if rise < 0:
        mean = -mean
    middle = mean.size // 2
    # Both ends are means of as many knots; an overshoot falls again before the end of what is near.
    ends = max(1, mean.size // 8)
    bright = float(mean[middle:-ends].max() - mean[-ends:].mean())
    dark = float(mean[:ends].mean() - mean[ends:middle].min())
    noise = noise_of_knot / math.sqrt(block)
    share = max(0.0, (bright + dark) / 2 / abs(rise))
    return Excess("edge_overshoot", share, noise / abs(rise), _LEAST_OVERSHOOT)


def above_one(cycles_per_px: Floats, mtf: Floats, low: Floats) -> Excess:
    """By how much the MTF is above 1, where that is most for its band."""
    seen = (cycles_per_px > 0) & (cycles_per_px <= _LIMIT_CY_PER_PX)
    above, noise = (mtf - 1)[seen], ((mtf - low) / 2)[seen]
    at = int(np.argmax(above - _SURE * noise))
    return Excess("edge_mtf_above_one", max(0.0, float(above[at])), float(noise[at]), _LEAST)


def asymmetry(cycles_per_px: Floats, transfer: Complexes, deviation: Floats) -> Excess:
    """Imaginary part of a transfer function that no place of the edge explains, where it is most for its noise.

    Args:
        deviation: of noise across the phase, [n].
    """
    seen = (cycles_per_px > 0) & (cycles_per_px <= _LIMIT_CY_PER_PX)
    omega, otf, noise = 2 * np.pi * cycles_per_px[seen], transfer[seen], deviation[seen]
    shift = 0.0
    for _ in range(_ROUNDS):  # Gauss and Newton
        turned = otf * np.exp(1j * omega * shift)
        slope = np.where(abs(otf) > _SURE * noise, turned.real * omega, 0.0)
        shift -= float((turned.imag * slope).sum() / max(float((slope**2).sum()), 1e-300))
    rest = abs((otf * np.exp(1j * omega * shift)).imag)
    at = int(np.argmax(rest - _SURE * noise))
    return Excess("edge_asymmetry", float(rest[at]), float(noise[at]), _LEAST)


def uneven_light(values: Floats, bright: Mask, across: float) -> Excess:
    """Share by which the light changes over the region, along the edge or across it, whichever is more.

    Args:
        bright: samples of the bright field, [lines, samples].
        across: by which it changes across the edge.
    """
    counts = bright.sum(axis=1)
    lines = np.flatnonzero(counts)
    along, noise = 0.0, 0.0
    if lines.size >= FEWEST_LINES:
        mean = np.where(bright, values, 0.0).sum(axis=1)[lines] / counts[lines]
        fit = np.polynomial.Polynomial.fit(lines, mean, 2, w=np.sqrt(counts[lines]))(lines)
        along = float(np.ptp(fit) / mean.mean())
        noise = 3 / math.sqrt(lines.size) * float(np.std(mean - fit) / mean.mean())  # of the end of a parabola
    if along < abs(across):
        along, noise = abs(across), 0.0
    return Excess("edge_light_change", along, noise, _MOST_UNEVEN)


_CAUSES = {
    "edge_overshoot": "its sides overshoot, as sharpening makes them",
    "edge_mtf_above_one": "its MTF is above 1, which no light is: it was sharpened",
    "edge_asymmetry": "its sides are not alike, as a tone curve, light that bends, or coma makes them",
    "edge_light_change": "its light changes along it or across it",
}


def faults(quantities: Sequence[Quantity]) -> list[str]:
    """Words for every check of an edge that failed."""
    return [f"{_CAUSES[row.name]} ({row})" for row in quantities if row.name in _CAUSES and row.passed is False]
