"""Power of a record by frequency: what a panel lets pass of a scene whose own spectrum is smooth, and noise.

A scene's power spectrum P is smooth: it falls as a power of f, alike in all directions but for a few lowest harmonics
(Field, J. Opt. Soc. Am. A 4, 2379, 1987). A panel's |H|² is not, so that a record shows the panel's structure,

    S(ν) = |H(ν)|² P(ν) + N(ν),

with N of the noise. P is fitted to the record's periodogram I by Whittle's likelihood,

    L = - sum over ν of log S + I / S        (P. Whittle, Ark. Mat. 2, 423, 1953),

once with |H|² and once without, and the gain of L is what the record says of the panel. Both are fitted, as what is
wide in |H|² would else pass for the scene's. Of a Gaussian scene mean and deviation of that gain follow from S.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property, lru_cache
from typing import Any

import numpy as np
import scipy
from numpy.typing import NDArray
from scipy import ndimage

from maskfab.base.arrays import Floats, Singles
from maskfab.camera.imaging import Blur, Transfer
from maskfab.camera.noise_spectrum import NoiseSpectrum, tapered_power

LARGEST = 512
"""Pixels along a side of what is looked at, from the record's middle."""
_KNOTS = np.log(np.array([0.004, 0.008, 0.016, 0.03, 0.06, 0.12, 0.25, 0.6]) / 0.1)
_RADIAL = len(_KNOTS)
_BEND = np.diff(np.eye(_RADIAL), 2, axis=0)
_SECTORS, _PER_OCTAVE = 12, 4
_STIFF, _ROUND = 2.0, 2.0
"""Weights of second differences over the knots, and of directions, squared."""
_POINTS, _LOW_POINTS = 12000, 2500
_SEARCHED = 0.15
"""Cycles per pixel of the largest square up to which settings are searched for: beyond, the steps would miss them."""
_LEAST_PASSED = 1e-12
_FEWEST = 200
_SEEN = 0.22
"""Share of the signal in a frequency's power from which it counts."""
_ROUNDS, _FARTHEST_STEP, _STILL = 30, 2.0, 0.1
"""Steps of a fit, the largest, and the gain of log-likelihood below which it stands still."""
_OF_LEVEL, _OF_BEND, _FARTHEST_OFF = (0.2,), (0.3, 0.3, 0.3), 2.0
"""Standard deviations of the logarithms of noise: its level, and its change along f² and f⁴."""
_TAPER = np.array([0.032, 0.25, 0.72, 1, 0.72, 0.25, 0.032])
_TAPER = _TAPER / _TAPER.sum()
"""Power of Hann's window at halves of a bin."""


def smooth_spectrum(f: Floats, cos: Floats, sin: Floats, values: Floats) -> Floats:
    """exp of a line over the knots of log f, and harmonics of the direction, whose cosine and sine are given."""
    slope = np.log(np.maximum(f, 1e-4) / 0.1)
    total = np.interp(slope, _KNOTS, values[:_RADIAL])
    level, tilt = values[_RADIAL : _RADIAL + 4], values[_RADIAL + 4 :]
    double_cos, double_sin = cos * cos - sin * sin, 2 * cos * sin
    angular = (double_cos, double_sin, double_cos**2 - double_sin**2, 2 * double_cos * double_sin)
    for wave, one, other in zip(angular, level, tilt, strict=True):
        total += wave * (one + other * slope)
    return np.asarray(np.exp(total))


def _basis(f: Floats, cos: Floats, sin: Floats) -> Floats:
    """Logarithms of :func:`smooth_spectrum` for each of its values alone, [n, values]."""
    eye = np.eye(_RADIAL + 8)
    return np.stack([np.log(smooth_spectrum(f, cos, sin, row)) for row in eye], axis=1)


@dataclass(frozen=True, eq=False)
class Plane:
    """Frequencies of a square's half plane that count, and bins of them."""

    side: int
    use: NDArray[np.bool_]
    y: Floats
    x: Floats
    f: Floats
    cos: Floats
    sin: Floats
    bins: NDArray[np.int64]
    counts: Floats
    basis: Floats
    squares: Floats

    def means(self, values: Floats) -> Floats:
        """Over every bin, of [n]."""
        return np.asarray(np.bincount(self.bins, values) / self.counts)

    def smooth(self, values: Floats) -> Floats:
        """:func:`smooth_spectrum` at the frequencies that count."""
        return smooth_spectrum(self.f, self.cos, self.sin, values)


@lru_cache(maxsize=2)
def plane_of(side: int) -> Plane:
    """Frequencies of a square of so many pixels, kept."""
    fy, fx = np.broadcast_arrays(scipy.fft.fftfreq(side)[:, None], scipy.fft.rfftfreq(side)[None])
    rows, columns = abs(np.round(fy * side)), np.round(fx * side)
    last = side // 2 - 1
    use = (np.hypot(fy, fx) > 2.5 / side) & (rows > 1) & (columns > 1) & (rows < last) & (columns < last)
    y, x = fy[use], fx[use]
    f = np.hypot(y, x)
    sector = np.minimum(((np.arctan2(y, x) / np.pi + 0.5) * _SECTORS).astype(int), _SECTORS - 1)
    _, bins = np.unique((np.log2(f * side) * _PER_OCTAVE).astype(int) * _SECTORS + sector, return_inverse=True)
    counts = np.bincount(bins).astype(np.float64)

    def means(table: Floats) -> Floats:
        return np.stack([np.bincount(bins, column) / counts for column in table.T], axis=1)

    cos, sin = x / f, y / f
    return Plane(side, use, y, x, f, cos, sin, bins, counts, means(_basis(f, cos, sin)), means(_squares(f)))


def _squares(f: Floats) -> Floats:
    """Logarithms of noise by the factors of its level and its bend, [n, 3]."""
    return np.stack([np.ones_like(f), (2 * f) ** 2, (2 * f) ** 4], axis=1)


def _likeliest(
    seen: Floats,
    passed: Floats,
    dark: Floats,
    counts: Floats,
    basis: Floats,
    *,
    stiff: float = _STIFF,
    squares: Floats | None = None,
    spread: Sequence[float] = (),
) -> Floats:
    """Values of a smooth spectrum that is likeliest, then logarithms of noise's factors, [rows, values].

    Args:
        seen: power in every bin, [rows, bins].
        passed: share of the scene's that passes.
        dark: noise.
        counts: frequencies in each bin.
        basis: :func:`_basis` of the bins.
        squares: logarithms of noise by its factors, [bins, factors], which have standard deviations of ``spread``.
    """
    table = basis if squares is None else np.concatenate([basis, squares], axis=1)
    size = basis.shape[1]
    keep = np.diag([0.0] * _RADIAL + [2 * _ROUND] * (size - _RADIAL) + [1 / known**2 for known in spread])
    keep[:_RADIAL, :_RADIAL] = 2 * stiff * _BEND.T @ _BEND

    def parts(values: Floats) -> tuple[Floats, Floats, Floats]:
        light, floor = (
            np.exp(part @ of.T) for part, of in ((values[:, :size], basis), (values[:, size:], table[:, size:]))
        )
        total = passed * light + dark * floor
        bent = ((values @ keep) * values).sum(axis=1) / 2
        return passed * light / total, total, (counts * (np.log(total) + seen / total)).sum(axis=1) + bent

    def solved(moved: Floats, pull: Floats) -> Floats:
        normal = moved.transpose(0, 2, 1) @ (counts[:, None] * moved) + keep
        return np.asarray(np.linalg.solve(normal, pull[:, :, None])[:, :, 0])

    # Fisher's scoring, from the logarithms of what is above the noise; a step that makes it worse is shortened.
    above = np.log(np.maximum(seen - dark, 0.05 * seen) / passed)
    only = np.broadcast_to(table * (np.arange(table.shape[1]) < size), (len(seen), *table.shape))
    values = solved(only, (counts * above) @ (table * (np.arange(table.shape[1]) < size)))
    signal, total, now = parts(values)
    for _ in range(_ROUNDS):
        moved = np.concatenate([signal[:, :, None] * basis, (1 - signal)[:, :, None] * table[:, size:]], axis=2)
        step = solved(moved, ((counts * (seen / total - 1))[:, None] @ moved)[:, 0] - values @ keep)
        step *= np.minimum(1, _FARTHEST_STEP / np.maximum(abs(step).max(axis=1, keepdims=True), 1e-12))
        while (worse := parts(values + step)[2] > now + 1e-6).any():
            step[worse] /= 4
        values, before = values + step, now
        signal, total, now = parts(values)
        if (before - now).max() < _STILL:
            break
    return np.asarray(values)


def smoothed(plane: Plane, values: Floats) -> Floats:
    """Values of the smooth spectrum that is nearest to positive numbers [n]."""
    power = np.maximum(plane.means(values), 1e-9)
    ones, none = np.ones((1, power.size)), np.full((1, power.size), 1e-12)
    return np.asarray(_likeliest(power[None], ones, none, plane.counts, plane.basis, stiff=0.5)[0])


def _fine_power(transfer: Transfer) -> Floats:
    """|H|² as a tapered square sees it, of H on twice its frequencies, [3, rows, half]."""
    power = np.square(abs(transfer)).astype(np.float64)
    power = ndimage.convolve1d(power, _TAPER, axis=1, mode="wrap")
    opposite = power[:, -np.arange(power.shape[1]) % power.shape[1]]
    wide = np.concatenate([opposite[:, :, 3:0:-1], power, opposite[:, :, -2:-5:-1]], axis=2)
    return np.asarray(ndimage.convolve1d(wide, _TAPER, axis=2)[:, :, 3:-3])


def warped(grid: NDArray[Any], y: Floats, x: Floats, scale: float, turn: float) -> NDArray[Any]:
    """Values [3, rows, half] of a real picture's transform at frequencies turned and scaled, [3, *y.shape]."""
    rows, odd = grid.shape[1], np.iscomplexobj(grid)
    along, across = scale * math.cos(turn), scale * math.sin(turn)
    up, right = along * y + across * x, along * x - across * y
    right = (right + 0.5) % 1 - 0.5
    negative = right < 0
    places = np.stack([np.where(negative, -up, up) % 1 * rows, abs(right) * rows])

    def at(values: NDArray[Any]) -> Floats:
        return np.stack([ndimage.map_coordinates(one, places, order=1, mode="grid-wrap") for one in values])

    if not odd:
        return at(grid)
    return at(grid.real) + 1j * np.where(negative, -1, 1) * at(grid.imag)


def turned(cos: Floats, sin: Floats, turn: float) -> tuple[Floats, Floats]:
    """Directions as :func:`warped` turns frequencies."""
    return math.cos(turn) * cos - math.sin(turn) * sin, math.cos(turn) * sin + math.sin(turn) * cos


@dataclass(frozen=True, eq=False)
class Shape:
    """A blur's transfer and the smooth part of its power, as a square of some pixels sees them."""

    transfer: Transfer
    power: Floats
    smooth: tuple[Floats, ...]

    @classmethod
    def of(cls, blur: Blur, plane: Plane) -> Shape:
        transfer = blur.on((2 * plane.side, 2 * plane.side))
        power = _fine_power(transfer)
        at = warped(power, plane.y, plane.x, 1.0, 0.0)
        return cls(transfer, power, tuple(smoothed(plane, one) for one in at))


@dataclass(frozen=True, eq=False)
class Sample:
    """Frequencies at which a record's power is compared with what a panel would make of a smooth scene.

    Attributes:
        power, noise: [3, n].
        bins, counts: bin of each frequency, and frequencies of each bin.
        table: :func:`_basis` at each, [n, values]; ``basis`` its means over bins.
        squares: logarithms of noise at each by its factors, whose standard deviations are ``spread``, [n, factors].
        smooth: spectrum that fits without a panel, [3, n].
    """

    y: Floats
    x: Floats
    f: Floats
    cos: Floats
    sin: Floats
    power: Floats
    noise: Floats
    bins: NDArray[np.int64]
    counts: Floats
    table: Floats
    basis: Floats
    squares: Floats
    spread: tuple[float, ...]
    smooth: Floats

    @classmethod
    def of(cls, plane: Plane, power: Floats, noise: Sequence[NoiseSpectrum], at: NDArray[np.int64]) -> Sample:
        """Of a record's power at the frequencies of a plane that count, [3, all]."""
        f, cos, sin = plane.f[at], plane.cos[at], plane.sin[at]
        _, bins = np.unique(plane.bins[at], return_inverse=True)
        table, dark = _basis(f, cos, sin), np.stack([one.on(f) for one in noise])
        counts = np.bincount(bins).astype(np.float64)
        basis = _means(bins, counts, table.T).T
        spread = _OF_LEVEL if all(one.white for one in noise) else _OF_BEND
        squares = _squares(f)[:, : len(spread)]
        known = plane.y[at], plane.x[at], f, cos, sin, power[:, at], dark, bins, counts, table, basis, squares, spread
        bare = cls(*known, dark)
        return replace(bare, smooth=bare.fitted(np.ones_like(dark)))

    def fitted(self, factor: Floats) -> Floats:
        """Spectrum S that is likeliest where the scene's is smooth, and of the scene so much passes, [3, n]."""
        scene, dark = self.parts(factor)
        return factor * scene + dark

    def parts(self, factor: Floats) -> tuple[Floats, Floats]:
        """That scene's spectrum, and the noise."""
        values, off = np.split(self.scene(factor), [self.table.shape[1]], axis=1)
        return np.exp(values @ self.table.T), self.noise * np.exp(off @ self.squares.T)

    def scene(self, factor: Floats) -> Floats:
        """Values of that scene's spectrum, and of noise's factors, [3, values]."""
        passed, seen, dark = (_means(self.bins, self.counts, each) for each in (factor, self.power, self.noise))
        passed = np.maximum(passed, _LEAST_PASSED)
        squares = _means(self.bins, self.counts, self.squares.T).T
        return _likeliest(seen, passed, dark, self.counts, self.basis, squares=squares, spread=self.spread)

    def gain(self, factor: Floats) -> float:
        """Log-likelihood that a panel which lets so much pass gains over none."""
        return float(_gains(self.power, self.smooth, self.fitted(factor)).sum())

    def told(self, factor: Floats, truth: Floats) -> tuple[float, float]:
        """Mean and standard deviation of :meth:`gain` of a record with a Gaussian scene of a true spectrum."""
        of_truth = replace(self, power=truth)
        smooth, panel = of_truth.fitted(np.ones_like(truth)), of_truth.fitted(factor)
        return float(_gains(truth, smooth, panel).sum()), float(np.linalg.norm(truth * (1 / smooth - 1 / panel)))

    def scatter(self, factor: Floats) -> float:
        """Standard deviation of :meth:`gain` by the record: colours and neighbouring frequencies vary together."""
        panel = self.fitted(factor)
        off = ((self.power - panel) * (1 / self.smooth - 1 / panel)).sum(axis=0)
        return float(np.linalg.norm(np.bincount(self.bins, off)))


def _means(bins: NDArray[np.int64], counts: Floats, rows: Floats) -> Floats:
    """Over every bin, of [rows, n]."""
    return np.stack([np.bincount(bins, row) for row in rows]) / counts


def _gains(power: Floats, smooth: Floats, panel: Floats) -> Floats:
    """Log-likelihood of each frequency by one spectrum over that by another."""
    return np.asarray(np.log(smooth / panel) + power * (1 / smooth - 1 / panel))


@dataclass(frozen=True, eq=False)
class Seen:
    """A record's spectrum at the plane's frequencies, [3, n], and where signal stands above the noise."""

    plane: Plane
    noise: tuple[NoiseSpectrum, ...]
    power: Floats
    counted: NDArray[np.int64]

    @classmethod
    def of(cls, square: Singles, noise: Sequence[NoiseSpectrum]) -> Seen:
        plane = plane_of(square.shape[1])
        found, signal, kept = [], [], []
        for power, dark in zip(tapered_power(square), noise, strict=True):
            spread = _OF_LEVEL if dark.white else _OF_BEND
            at = power[plane.use]
            values, off = np.split(
                _likeliest(
                    plane.means(at)[None], np.ones((1, plane.counts.size)), plane.means(dark.on(plane.f))[None],
                    plane.counts, plane.basis, squares=plane.squares[:, : len(spread)], spread=spread,
                )[0],
                [plane.basis.shape[1]],
            )  # fmt: skip
            # A picture that holds nothing at all would have no noise either.
            change = np.pad(np.clip(off, -_FARTHEST_OFF, _FARTHEST_OFF), (0, 3 - len(off)))
            now = NoiseSpectrum(dark.level * math.exp(change[0]), (dark.bend[0] + change[1], dark.bend[1] + change[2]))
            light = plane.smooth(values)
            found.append(at)
            signal.append(light / (light + now.on(plane.f)))
            kept.append(now)
        counted = np.flatnonzero((np.square(signal).mean(axis=0) > _SEEN**2) & (plane.f < 0.5))
        some = np.random.default_rng(0).permutation(counted)[:_POINTS]
        return cls(plane, tuple(kept), np.array(found), some)

    @cached_property
    def at(self) -> Sample:
        """Those where there is signal, or some of them."""
        return Sample.of(self.plane, self.power, self.noise, self.counted)

    @cached_property
    def everywhere(self) -> Sample:
        """Some of all frequencies."""
        every = np.random.default_rng(0).permutation(self.plane.f.size)[:_POINTS]
        return Sample.of(self.plane, self.power, self.noise, every)

    @cached_property
    def low(self) -> Sample:
        """Some low frequencies of these."""
        return Sample.of(self.plane, self.power, self.noise, self._low)

    @cached_property
    def _low(self) -> NDArray[np.int64]:
        return self.counted[self.plane.f[self.counted] < _SEARCHED * LARGEST / self.plane.side][:_LOW_POINTS]

    @property
    def enough(self) -> bool:
        """Whether there are frequencies enough to tell anything."""
        return self._low.size >= _FEWEST
