r"""Electrons per count by photon transfer, from frames that are equal but for their noise.

The variance of a pixel over equal frames is that of its light and that of the dark,

    var = mean / K + var_dark        in counts, K in electrons per count

(J. R. Janesick, Photon Transfer, SPIE 2007, 5), so K is the inverse slope of variances against means. What differs from
pixel to pixel but not from frame to frame, such as a pixel's own sensitivity or the picture itself, is not in it.

Notes:
    Pixels differ in their means by noise too, which flattens a line of least squares. So the line is that of
    instrumental variables: weights and moments take the light beside a pixel for its own, whose noise is another.
    Light that drifts from frame to frame is divided out.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import groupby

import numpy as np
from numpy.typing import NDArray

from maskfab.base.arrays import Floats
from maskfab.capture.beside import mean_beside
from maskfab.capture.frames import Frame, same_sensor
from maskfab.errors import SourceError

_LEVELS = 32
_OUTLYING = 6.0
_JUMP = 12.0
"""Of the usual deviation from the mean."""
_ROUNDS = 4
_SINGULAR = 1e-9
_LEAST_FLOOR = 1e-6
"""Of the dark, in counts squared: a variance below 0 is none."""
_WORST = 0.1
"""Standard error of a gain, of itself, beyond which it is refused."""
_FLAT = "Give two equal dark frames too, or frames of a surface that is bright and dark in places"


@dataclass(frozen=True)
class Gain:
    """Gain and read noise of a sensor, each with one standard error.

    Attributes:
        electrons_per_count: K.
        error: of it.
        read_noise_e: in electrons, without what rounding to counts adds.
        read_noise_error_e: of it.
        misfit: chi² per degree of freedom of the line; errors are larger by its root where it is above 1.
        samples: variances of pixels that were used.
    """

    electrons_per_count: float
    error: float
    read_noise_e: float
    read_noise_error_e: float
    misfit: float
    samples: int


@dataclass(frozen=True, eq=False)
class _Pixels:
    """Pixels of one colour over equal frames; the variance of each is expected to be slope x light + floor x dark.

    Attributes:
        light: [pixels] mean counts above black.
        beside: [pixels] that of each one's neighbours.
        variance: [pixels] of the counts.
        dark: [pixels] by how much noise of the dark counts, after drift is divided out.
        freedom: [pixels] frames, less one.
    """

    light: Floats
    beside: Floats
    variance: Floats
    dark: Floats
    freedom: Floats

    def of(self, kept: NDArray[np.bool_]) -> _Pixels:
        """Those of them that are kept."""
        return _Pixels(*(each[kept] for each in self._columns()))

    def expected(self, slope: float, floor: float) -> Floats:
        """Variance that the light beside each pixel lets one expect."""
        return np.asarray(np.maximum(slope * self.beside, 0.0) + floor * self.dark)

    @classmethod
    def joined(cls, groups: Sequence[_Pixels]) -> _Pixels:
        """All pixels of several groups."""
        return cls(*(np.concatenate(each) for each in zip(*(group._columns() for group in groups), strict=True)))

    def _columns(self) -> tuple[Floats, ...]:
        return self.light, self.beside, self.variance, self.dark, self.freedom


def photon_transfer(frames: Sequence[Frame], dark: Sequence[Frame] = ()) -> Gain:
    """Gain from two or more equal frames; several groups of one exposure time each give one line.

    Args:
        frames: with equal light and, in each group, equal exposure.
        dark: two or more equal frames without light, which fix the line at its foot.

    Raises:
        SourceError: MF331 frames of unlike sensors, MF335 if there are no two equal frames, or no light that the gain
            could be told from.
    """
    if not frames:
        raise _unknown("there are no frames", "Give two equal frames of an evenly lit surface")
    same_sensor([*frames, *dark])
    if len(dark) == 1:
        raise _unknown("one dark frame has no variance to tell", "Give two equal dark frames, or none")
    lit = [pixels for group in _equal(frames) for pixels in _colours(group, dark=False)]
    if not lit:
        raise _unknown(
            f"no two of {len(frames)} frames have one exposure time",
            "Give two equal frames, taken one after the other",
        )
    whole = all((frame.counts == np.rint(frame.counts)).all() for frame in frames)
    return _line(_Pixels.joined([*lit, *(_colours(dark, dark=True) if dark else ())]), steps=1 / 12 if whole else 0.0)


def _equal(frames: Sequence[Frame]) -> Iterator[list[Frame]]:
    def time(frame: Frame) -> float:
        return -1.0 if frame.exposure_s is None else frame.exposure_s

    for _, group in groupby(sorted(frames, key=time), key=time):
        equal = list(group)
        if len(equal) > 1:
            yield equal


def _colours(frames: Sequence[Frame], *, dark: bool) -> Iterator[_Pixels]:
    """Pixels of each colour, none that is full in any frame."""
    full = np.any([frame.full for frame in frames], axis=0)
    for place, lattice in enumerate(frames[0].lattices):
        usable = ~full[lattice.first[0] :: lattice.step, lattice.first[1] :: lattice.step]
        stack = np.stack([lattice.of(frame.counts).astype(np.float64) - frame.black[place] for frame in frames])
        if usable.any():
            yield _in_the_dark(stack[:, usable]) if dark else _in_light(stack, usable)


def _in_light(stack: Floats, usable: NDArray[np.bool_]) -> _Pixels:
    factors = _factors(stack, usable)
    # Pixels that jump, or were hit, would be taken for drift.
    even = stack / factors[:, None, None]
    mean = even.mean(axis=0)
    root = np.sqrt(1 + np.maximum(mean_beside(mean, usable), 0.0))
    off = np.abs(even - mean).max(axis=0) / root
    factors = _factors(stack, usable & (off <= _JUMP * np.median(off[usable])))
    even = stack / factors[:, None, None]
    mean, variance = even.mean(axis=0), even.var(axis=0, ddof=1)[usable]
    brighter, ones = float((1 / factors).mean()), np.ones(len(variance))
    light, beside = mean[usable] * brighter, mean_beside(mean, usable)[usable] * brighter
    return _Pixels(light, beside, variance, float((1 / factors**2).mean()) * ones, (len(stack) - 1) * ones)


def _factors(stack: Floats, usable: NDArray[np.bool_]) -> Floats:
    """Light of each frame in that of their mean."""
    sums = stack[:, usable].sum(axis=1)
    if not (sums > 0).all():
        raise _unknown("a frame has no light above black", "Give frames with light, or state their black level")
    return np.asarray(sums / sums.mean())


def _in_the_dark(stack: Floats) -> _Pixels:
    variance = stack.var(axis=0, ddof=1)
    none, ones = np.zeros(len(variance)), np.ones(len(variance))
    return _Pixels(none, none, variance, ones, (len(stack) - 1) * ones)


def _line(pixels: _Pixels, steps: float) -> Gain:
    """Weighted line through the variances, outliers left out once the line is known."""
    # From totals, which need no weights.
    slope = float(pixels.variance.sum() / max(float(pixels.light.sum()), _LEAST_FLOOR))
    floor = max(float(np.median(pixels.variance[pixels.beside <= np.quantile(pixels.beside, 0.1)])), _LEAST_FLOOR)
    for turn in range(_ROUNDS):
        expected = pixels.expected(slope, floor)
        if turn:
            pixels = pixels.of(pixels.variance <= _OUTLYING**2 * expected)
            expected = pixels.expected(slope, floor)
        weights = pixels.freedom / (2 * expected**2)
        moments, columns = (np.stack([each, pixels.dark]) for each in (pixels.beside, pixels.light))
        normal = (moments * weights) @ columns.T
        if abs(np.linalg.det(normal)) <= _SINGULAR * abs(normal[0, 0] * normal[1, 1]):
            raise _unknown("all pixels have the same light", _FLAT)
        inverse = np.linalg.inv(normal)
        slope, floor = (float(each) for each in inverse @ ((moments * weights) @ pixels.variance))
        if slope <= 0:
            raise _unknown("noise does not grow with light", "Give equal frames with more light")
        floor = max(floor, _LEAST_FLOOR)
    covariance = inverse @ ((moments * weights) @ moments.T) @ inverse.T
    misfit = _misfit(pixels, slope, floor)
    error_slope, error_floor = (float(each) for each in np.sqrt(np.diag(covariance) * max(misfit, 1.0)))
    if not error_slope < _WORST * slope:
        raise _unknown(f"its standard error is {100 * error_slope / slope:.0f} %, above {100 * _WORST:.0f} %", _FLAT)
    alone = max(floor - steps, _LEAST_FLOOR)
    gain, read_noise = 1 / slope, math.sqrt(alone) / slope
    from_floor = min(error_floor / (2 * math.sqrt(alone)), math.sqrt(error_floor)) / slope
    return Gain(
        electrons_per_count=gain,
        error=gain * error_slope / slope,
        read_noise_e=read_noise,
        read_noise_error_e=math.hypot(from_floor, read_noise * error_slope / slope),
        misfit=misfit,
        samples=len(pixels.light),
    )


def _misfit(pixels: _Pixels, slope: float, floor: float) -> float:
    """chi² per degree of freedom of the mean variances of some levels of light."""
    expected = pixels.expected(slope, floor)
    parts = np.array_split(np.argsort(expected, kind="stable"), min(_LEVELS, len(expected)))
    off = [
        (pixels.variance[part] - slope * pixels.light[part] - floor * pixels.dark[part]).sum() ** 2
        / (2 * expected[part] ** 2 / pixels.freedom[part]).sum()
        for part in parts
    ]
    return float(sum(off) / max(len(off) - 2, 1))


def _unknown(what: str, cure: str) -> SourceError:
    return SourceError("MF335", f"the gain is not told by these frames: {what}", cure=cure)
