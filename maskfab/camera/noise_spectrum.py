"""Noise of a record by frequency: whether a camera or a coder has smoothed or sharpened it, and a record that is not.

Of a sensor's noise every frequency holds as much. After a filter, a tone curve and a coder that is so no longer, and
who takes it for white sharpens what is left of it. Squares of 16 pixels with the least power below 0.15 cycles
per pixel hold hardly any light that varies, and tell the spectrum of the noise beyond,

    N(f) = N(0) exp(b (2 f)² + c (2 f)⁴)        (as M. Lebrun, M. Colom, J.-M. Morel, Image Processing On Line 5, 1,
                                                 2015, take calm blocks for noise that depends on frequency).

Where that is not level, record and blur are filtered by W = √(N(0) / N(f)), and the noise is white again: a restored
picture is what it was, whoever restores it.

Notes:
    A mosaic's interpolation correlates noise too. That follows from its filters, and restorers allow for it.
    Where all of a photograph is as rough as its noise, it is taken for noisier than it is.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import scipy
from numpy.typing import NDArray

from maskfab.base.arrays import Floats, Singles
from maskfab.camera.imaging import Blur, Margin, Transfer
from maskfab.camera.record import Record

_BLOCK, _CALM, _FEWEST = 16, 0.03, 16
_COARSE, _FINE, _FARTHEST = 0.15, 0.24, 0.7
"""Cycles per pixel below which light tells calm blocks, and between which noise is fitted."""
_LEVEL, _OFF = 2.0, 1.5
"""Ratio of powers from which noise is not white, and of levels from which it is not as stated."""
_MOST = 4.0
_WIDTH = 64
ENOUGH = 2_000_000
"""Pixels of a colour that tell its noise."""


def tapered_power(blocks: Singles) -> Floats:
    """Periodogram of squares [n, side, side] under Hann's window, per pixel, [n, side, side / 2 + 1]."""
    side = blocks.shape[1]
    along = 0.5 - 0.5 * np.cos(2 * np.pi * np.arange(side) / side)
    taper = along[:, None] * along
    level = (blocks * taper).sum(axis=(1, 2), keepdims=True) / taper.sum()
    power = np.square(abs(scipy.fft.rfft2((blocks - level) * taper, axes=(1, 2), workers=1)))
    return np.asarray(power / np.square(taper).sum())


@dataclass(frozen=True)
class NoiseSpectrum:
    """Noise of a colour by frequency: N(0), and b and c."""

    level: float
    bend: tuple[float, float] = (0.0, 0.0)

    @property
    def white(self) -> bool:
        """Whether every frequency holds as much."""
        return self.bend == (0.0, 0.0)

    def on(self, f: Floats) -> Floats:
        """N at frequencies in cycles per pixel."""
        square = np.square(2 * np.minimum(f, _FARTHEST))
        return np.asarray(self.level * np.exp(self.bend[0] * square + self.bend[1] * square**2))

    @property
    def ratio(self) -> float:
        """The largest over the least N up to half a cycle per pixel."""
        power = self.on(np.linspace(0, 0.5, 26))
        return float(power.max() / power.min())


def noise_of(record: Record, *, stated: bool = False) -> tuple[tuple[NoiseSpectrum, ...], tuple[str, ...]]:
    """Noise of every colour, and sentences where it is not as the record says.

    Args:
        record: of at least 128 pixels along a side.
        stated: whether its noise was stated: then calm blocks may hold light, as long as their finest detail does not.
    """
    means = _mean_variance(record)
    white = tuple(NoiseSpectrum(mean) for mean in means)
    if record.interpolated:
        return white, ()
    some = replace(record, values=np.stack([some_rows(plane, _BLOCK) for plane in record.values]))
    variance = some.noise.variance(np.maximum(some.values, 0))
    found = [_calm(*colour) for colour in zip(some.values, variance, some.clipped, strict=True)]
    ratio = float(np.exp(np.mean([math.log(one.ratio) for one in found])))
    finest = float(np.exp(np.mean([math.log(one.on(np.linspace(0.45, _FARTHEST, 8)).mean()) for one in found])))
    if stated and 1 / _OFF < finest < _OFF:
        return white, ()
    if ratio > _LEVEL:
        said = f"its noise was smoothed or sharpened: power by frequency differs by a factor of {ratio:.2g}"
        bent = tuple(NoiseSpectrum(mean * one.level, one.bend) for mean, one in zip(means, found, strict=True))
        return bent, (said,)
    # As far as it is white, its mean over all frequencies that were fitted is its level.
    levels = [float(one.on(np.linspace(_FINE, 0.5, 16)).mean()) for one in found]
    level = float(np.exp(np.mean(np.log(levels))))
    if not 1 / _OFF < level < _OFF:
        said = f"its calmest parts have {level:.2g} times the noise that was stated or estimated: that is taken"
        return tuple(NoiseSpectrum(mean * one) for mean, one in zip(means, levels, strict=True)), (said,)
    return white, ()


def _calm(plane: Singles, variance: Singles, clipped: NDArray[np.bool_]) -> NoiseSpectrum:
    """Noise of one colour in units of its variance, by its calmest blocks, else as expected; full pixels have none."""
    blocks, expected = (squares(values, _BLOCK) for values in (plane, variance))
    light, expected = blocks.mean(axis=(1, 2)), expected.mean(axis=(1, 2))
    telling = (np.ptp(blocks, axis=(1, 2)) > 0) & ~squares(clipped, _BLOCK).any(axis=(1, 2))
    if not telling.any():
        return NoiseSpectrum(1.0)
    lit = telling & (light >= np.quantile(light[telling], 0.1))
    power = tapered_power(blocks[lit]) / np.maximum(expected[lit], 1e-14)[:, None, None]
    f = np.hypot(scipy.fft.fftfreq(_BLOCK)[:, None], scipy.fft.rfftfreq(_BLOCK))
    order = np.argsort(power[:, f < _COARSE].mean(axis=1))
    calm = power[order[: max(_FEWEST, int(_CALM * len(order)))]].mean(axis=0)
    far = (f > _FINE) & (f < _FARTHEST)
    square = np.square(2 * f[far])
    table = np.stack([np.ones_like(square), square, square**2], axis=1)
    level, *bend = np.linalg.lstsq(table, np.log(np.maximum(calm[far], 1e-9)), rcond=None)[0].tolist()
    return NoiseSpectrum(math.exp(level), (bend[0], bend[1]))


def some_rows(plane: Singles, side: int) -> Singles:
    """Whole strips of so many rows, evenly apart, of a plane [rows, columns]; all of one that is not large."""
    strips = plane[: len(plane) // side * side].reshape(-1, side, plane.shape[1])
    return np.asarray(strips[:: max(1, plane.size // ENOUGH)].reshape(-1, plane.shape[1]))


def squares(plane: NDArray[Any], side: int) -> Floats:
    """The whole squares of so many pixels that a plane [rows, columns] holds, [n, side, side]."""
    rows, columns = (length // side * side for length in plane.shape)
    blocks = plane[:rows, :columns].reshape(rows // side, side, columns // side, side)
    return np.asarray(blocks.transpose(0, 2, 1, 3).reshape(-1, side, side), dtype=np.float64)


def _whitening(noise: Sequence[NoiseSpectrum], shape: tuple[int, int]) -> Singles:
    """W at the frequencies of ``rfft2``, [3, rows, half]."""
    y, x = (
        np.square(2 * each).astype(np.float32) for each in (scipy.fft.fftfreq(shape[0]), scipy.fft.rfftfreq(shape[1]))
    )
    square = np.minimum(y[:, None] + x, np.float32((2 * _FARTHEST) ** 2))
    factors = np.empty((len(noise), *square.shape), dtype=np.float32)
    for one, factor in zip(noise, factors, strict=True):
        first, second = np.float32(one.bend[0]), np.float32(one.bend[1])
        np.exp((square * second + first) * square * np.float32(-0.5), out=factor)
        np.clip(factor, 1 / _MOST, _MOST, out=factor)
    return factors


@dataclass(frozen=True, eq=False)
class WhitenedBlur:
    """Blur of a record whose noise was made white."""

    blur: Blur
    noise: tuple[NoiseSpectrum, ...]

    def on(self, shape: tuple[int, int]) -> Transfer:
        transfer = self.blur.on(shape)
        if all(one.white for one in self.noise):
            return transfer
        return np.asarray(transfer * _whitening(self.noise, shape))


def whitened(record: Record, noise: Sequence[NoiseSpectrum]) -> Record:
    """The record with noise that every frequency holds as much of, of the level that was told."""
    before = _mean_variance(record)
    factor = float(np.exp(np.mean(np.log([one.level / mean for one, mean in zip(noise, before, strict=True)]))))
    values = record.values
    if not all(one.white for one in noise):
        margin, values = Margin.around(values, _WIDTH), np.empty_like(values)
        below = np.nextafter(np.float32(record.ceiling), np.float32(-np.inf))
        for colour, one in enumerate(noise):
            seen = record.values[colour : colour + 1]
            even = margin.blurred(margin.mirrored(seen), _whitening([one], margin.shape))
            values[colour] = np.where(seen >= np.float32(record.ceiling), seen, np.minimum(even, below))[0]
    return replace(record, values=np.ascontiguousarray(values, dtype=np.float32), noise=record.noise.times(factor))


def _mean_variance(record: Record) -> list[float]:
    """Of every colour; colour by colour, as a large record's takes as much memory as itself."""
    return [float(record.noise.variance(plane).mean(dtype=np.float64)) for plane in record.values]
