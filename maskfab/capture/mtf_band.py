"""The MTF of a picture of a point light beside that of the picture that is expected, with the band that noise allows.

Both are taken of the same pixels in the same window, sampled as the sensor samples, so that window, aliasing and noise
are in both alike: what differs is the die, the lens, or the model of them.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from maskfab.base.arrays import Floats
from maskfab.capture.fit import Fit
from maskfab.capture.taken import Taken
from maskfab.units import UM_PER_MM

_DRAWS = 200
_CONFIDENCE = 0.95
_PARTED = 4.0
"""Standard deviations of the noise from which two neighbouring rings of frequencies are held to differ."""


@dataclass(frozen=True, eq=False)
class MtfBand:
    """MTF of one grid of pixels, mean and minimum over all directions.

    Attributes:
        colour: of the pixels.
        frequencies: middles of rings, cycles per millimetre of sensor, [n].
        measured: [2, n], mean and minimum over a ring.
        expected: [2, n], the same of the fitted die with the same noise, mean over draws of it.
        low, high: [2, n], between which 95 % of such draws lie.
        parted_per_mm: frequency from which the mean differs by more than noise lets it; None if it nowhere does.
    """

    colour: str
    frequencies: Floats
    measured: Floats
    expected: Floats
    low: Floats
    high: Floats
    parted_per_mm: float | None


def mtf_bands(taken: Sequence[Taken], fit: Fit, seed: int = 0) -> tuple[MtfBand, ...]:
    """One for each grid of pixels of a fit, on the same noise for equal seeds."""
    random = np.random.default_rng(seed)
    return tuple(_band(each, fit, k, random) for k, each in enumerate(taken))


def _band(taken: Taken, fit: Fit, place: int, random: np.random.Generator) -> MtfBand:
    expected = fit.predicted[place]
    sigma = np.where(taken.valid, taken.sigma, 0.0)
    seen = np.where(taken.valid, taken.light, expected)
    colour = taken.pixels.colour
    scale, beneath = fit.light[colour], fit.beneath[colour]
    step_um = abs(float(taken.pixels.x_um[1] - taken.pixels.x_um[0]))
    rings, frequencies = _rings(expected.shape, step_um)

    def curves(picture: Floats) -> Floats:
        modulus = abs(np.fft.rfft2((picture - beneath) / scale)).ravel()
        count = frequencies.size
        mean = np.bincount(rings, modulus, count + 1)[:count] / np.bincount(rings, minlength=count + 1)[:count]
        least = np.full(count + 1, np.inf)
        np.minimum.at(least, rings, modulus)
        return np.stack([mean, least[:count]])

    draws = np.stack([curves(expected + sigma * random.standard_normal(expected.shape)) for _ in range(_DRAWS)])
    measured = curves(seen)
    tail = (1 - _CONFIDENCE) / 2
    low, high = np.quantile(draws, [tail, 1 - tail], axis=0)
    mean, spread = draws.mean(axis=0), draws.std(axis=0)
    off = abs(measured[0] - mean[0]) > _PARTED * spread[0]
    both = np.flatnonzero(off[1:] & off[:-1])
    parted = float(frequencies[both[0]]) if both.size else None
    return MtfBand(colour, frequencies, measured, mean, low, high, parted)


def _rings(shape: tuple[int, ...], step_um: float) -> tuple[NDArray[np.intp], Floats]:
    """Number of the ring of every frequency of a real transform, the last one for all beyond; and their middles."""
    rows, columns = shape
    up, across = np.fft.fftfreq(rows)[:, None], np.fft.rfftfreq(columns)
    radius = np.hypot(up, across).ravel()
    width = 1 / min(rows, columns)
    count = int(0.5 / width)
    number = np.minimum(np.floor(radius / width).astype(np.intp), count)
    middles = np.bincount(number, radius, count + 1)[:count] / np.bincount(number, minlength=count + 1)[:count]
    return number, np.asarray(middles / step_um * UM_PER_MM)
