"""A stack: frames of one light by one sensor that differ in their exposure time, judged before they are merged.

Light beside a pixel, which tells its level without its own noise.

Where the one light of a stack lies on the sensor, to crop the frames about it.

Electrons per count by photon transfer, from frames that are equal but for their noise.

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
from scipy import ndimage

from maskfab.base.arrays import Floats, Singles
from maskfab.base.errors import SourceError
from maskfab.camera.capture.frames import Frame, same_sensor

_PILED_UP = 8
_WELL_ABOVE_BLACK = 100
_SHORTEST, _LONGEST = 1e-7, 1e5


def check_stack(frames: Sequence[Frame]) -> None:
    """Refuse frames that cannot be merged.

    One frame needs no time; several need times that differ.

    Raises:
        SourceError: MF331 of unlike sensors, MF332 times missing, all equal or of no camera, MF333 pixels that are full
            below the white level, MF334 without frames.
    """
    if not frames:
        raise SourceError("MF334", "there are no frames", cure="Give one or more")
    same_sensor(frames)
    if len(frames) > 1:
        _check_times(frames)
    _check_white(frames)


def _check_times(frames: Sequence[Frame]) -> None:
    missing = [frame.name for frame in frames if frame.exposure_s is None]
    if missing:
        raise SourceError(
            "MF332",
            f"{len(missing)} of {len(frames)} frames state no exposure time, the first of them {missing[0]}",
            where=missing[0],
            cure="Give all times, such as --times '1 ms' --times '4 ms', in the order of the files",
        )
    times = [frame.exposure_s for frame in frames if frame.exposure_s is not None]
    if len(set(times)) == 1:
        raise SourceError(
            "MF332",
            f"all {len(frames)} frames have an exposure of {times[0]:g} s; a stack needs times that differ",
            where=frames[0].name,
            cure="Give the true times, or a single frame; two equal frames tell the gain",
        )
    if not all(_SHORTEST <= time <= _LONGEST for time in times):
        raise SourceError(
            "MF332",
            f"times from {min(times):g} s to {max(times):g} s; the limits are {_SHORTEST:g} s and {_LONGEST:g} s",
            where=frames[0].name,
            cure="Give times with their unit",
        )


def _check_white(frames: Sequence[Frame]) -> None:
    """Two exposures that end at one count, below white, are full there: of light they would end at two."""
    seen: dict[float, str] = {}
    for frame in frames:
        top = float(frame.counts.max())
        piled = np.count_nonzero(frame.counts == np.float32(top)) >= _PILED_UP
        if not (max(frame.black) + _WELL_ABOVE_BLACK < top < frame.white and piled):
            continue
        if top in seen:
            raise SourceError(
                "MF333",
                f"{seen[top]} and {frame.name} both end at {top:g} counts, which many pixels have, below the white "
                f"level of {frame.white:g}",
                where=frame.name,
                cure=f"State the true white level, such as --white {top:g}",
            )
        seen[top] = frame.name


_AROUND = np.array([[1.0, 1.0, 1.0], [1.0, 0.0, 1.0], [1.0, 1.0, 1.0]])


def mean_beside(values: Floats, usable: NDArray[np.bool_]) -> Floats:
    """Mean of each pixel's eight neighbours of its colour, the pixel itself left out.

    Args:
        values: [rows, columns] of one colour.
        usable: which of them count; 0 where none of a pixel's neighbours does.
    """
    total = ndimage.convolve(np.where(usable, values, 0.0), _AROUND, mode="constant")
    count = ndimage.convolve(usable.astype(np.float64), _AROUND, mode="constant")
    found: Floats = np.divide(total, count, out=np.zeros_like(total), where=count > 0.5)
    return found


_SPOT = 9
"""Pixels along the square whose mean is compared."""
_SEEN = 8.0
_MAD = 1.4826
_SECOND = 0.05
_PAIRED = 5
"""Pixels within which an order lies where its pair says: their place is that of the light to a pixel or two."""


def light_place(frames: Sequence[Frame], side: int) -> tuple[int, int]:
    """Row and column of the brightest spot, that of undiffracted light, within some pixels.

    Args:
        frames: a stack; long exposures tell faint light, short ones what is brightest in it.
        side: pixels of the crop that is to be taken about it.

    Raises:
        SourceError: as :func:`check_stack`; MF334 without a spot above noise, MF338 if another spot outside the crop
            has a twentieth of its light or more, and none lies as far on the other side.
    """
    check_stack(frames)
    ordered = sorted(frames, key=lambda frame: frame.exposure_s or 0.0)
    shortest = _spots(ordered[0])
    seen = shortest if len(frames) == 1 else np.sum([_spots(frame) for frame in ordered], axis=0)
    row, column = (int(each) for each in np.unravel_index(int(seen.argmax()), seen.shape))
    if not seen[row, column] > _level(seen):
        raise SourceError(
            "MF334",
            f"no spot of {_SPOT} x {_SPOT} pixels is {_SEEN:g} standard deviations above the others",
            where=frames[0].name,
            cure="Expose longer, or point the camera at the light",
        )
    outside = _unpaired(shortest, row, column)
    outside[max(0, row - side // 2) : row + side // 2, max(0, column - side // 2) : column + side // 2] = -np.inf
    other = np.unravel_index(int(outside.argmax()), seen.shape)
    share = float(outside[other] / shortest[row, column])
    if seen[other] > _level(seen) and shortest[other] > _level(shortest) and share > _SECOND:
        raise SourceError(
            "MF338",
            f"a second light at row {other[0]}, column {other[1]} has {share:.2g} of the light at row {row}, column "
            f"{column}; outside the crop of {side} pixels at most {_SECOND:g} is allowed",
            where=frames[0].name,
            cure="Cover the other light, or crop so many pixels that all of it is held",
        )
    return row, column


def _unpaired(spots: Singles, row: int, column: int) -> Singles:
    """Spots less what lies as far on the other side of a place: orders of diffraction come in pairs, lamps do not.

    Where the other side is beyond the frame nothing can be said, and nothing is left.
    """
    rows, columns = spots.shape
    there = np.ix_(2 * row - np.arange(rows), 2 * column - np.arange(columns))
    held = [(index >= 0) & (index < length) for index, length in zip(there, spots.shape, strict=True)]
    paired = ndimage.maximum_filter(spots, _PAIRED)[there[0].clip(0, rows - 1), there[1].clip(0, columns - 1)]
    return np.asarray(np.where(held[0] & held[1], spots - paired, -np.inf), dtype=np.float32)


def _spots(frame: Frame) -> Singles:
    """Mean light of the square about each pixel, in units of white, [rows, columns]."""
    light = np.zeros(frame.shape, dtype=np.float32)
    top = frame.white if np.isfinite(frame.white) else float(frame.counts.max())
    for place, lattice in enumerate(frame.lattices):
        black = frame.black[place]
        values = (lattice.of(frame.counts).astype(np.float32) - np.float32(black)) / np.float32(max(top - black, 1e-30))
        light[lattice.first[0] :: lattice.step, lattice.first[1] :: lattice.step] += _unspiked(values)
    return np.asarray(ndimage.uniform_filter(light, _SPOT, mode="constant"))


def _unspiked(values: Singles) -> Singles:
    """No pixel brighter than the brightest of its eight neighbours: a hot one alone makes no spot."""
    rows, columns = values.shape
    padded = np.pad(values, 1, constant_values=-np.inf)
    beside = np.full_like(values, -np.inf)
    for down in range(3):
        for right in range(3):
            if (down, right) != (1, 1):
                np.maximum(beside, padded[down : down + rows, right : right + columns], out=beside)
    return np.minimum(values, beside)


def _level(spots: Singles) -> float:
    """Above which a spot is no noise."""
    middle = float(np.median(spots))
    return middle + _SEEN * _MAD * float(np.median(np.abs(spots - middle)))


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
