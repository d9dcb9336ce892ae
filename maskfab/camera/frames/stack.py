"""A stack: frames of one light by one sensor that differ in their exposure time, judged before they are merged.

Where its one light lies on the sensor is told, to crop the frames about it, and electrons per count by photon transfer,
from frames that are equal but for their noise. The variance of a pixel over equal frames is that of its light and that
of the dark,

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

import numpy as np
from scipy import ndimage

from maskfab.base.arrays import Floats, Mask, Singles
from maskfab.base.errors import SourceError
from maskfab.camera.frames.frame import Frame, same_sensor

_PILED_UP = 8
_PLATEAU = 0.01
"""Share of their height within which pixels of a plateau lie: that of a full well is as noisy as reading is."""
_FLOOR_SHARE, _GROWS, _APART = 0.2, 0.1, 3.0
"""Part of the darkest pixels that is a floor, share of the growth of light below which it is none, and times apart."""
_LEAST_FLOOR_COUNTS = 16.0
_WELL_ABOVE_BLACK = 100
_SHORTEST, _LONGEST = 1e-7, 1e5


def check_stack(frames: Sequence[Frame]) -> None:
    """Refuse frames that cannot be merged.

    One frame needs no time; several need times that differ.
    """
    if not frames:
        raise SourceError("MF334", "there are no frames", cure="Give one or more")
    same_sensor(frames)
    if len(frames) > 1:
        _check_times(frames)
        _check_black(frames)
    _check_white(frames)


def _check_times(frames: Sequence[Frame]) -> None:
    missing = [frame.name for frame in frames if frame.exposure_s is None]
    if missing:
        what = f"{len(missing)} of {len(frames)} frames state no exposure time, the first of them {missing[0]}"
        cure = "Give all times, such as --times '1 ms' --times '4 ms', in the order of the files"
        raise SourceError("MF332", what, where=missing[0], cure=cure)
    times = [frame.exposure_s for frame in frames if frame.exposure_s is not None]
    if len(set(times)) == 1:
        what = f"all {len(frames)} frames have an exposure of {times[0]:g} s; a stack needs times that differ"
        cure = "Give the true times, or a single frame; two equal frames tell the gain"
        raise SourceError("MF332", what, where=frames[0].name, cure=cure)
    if not all(_SHORTEST <= time <= _LONGEST for time in times):
        what = f"times from {min(times):g} s to {max(times):g} s; the limits are {_SHORTEST:g} s and {_LONGEST:g} s"
        raise SourceError("MF332", what, where=frames[0].name, cure="Give times with their unit")


def _check_white(frames: Sequence[Frame]) -> None:
    """Two exposures that end at one count, below white, are full there: of light they would end at two."""
    seen: dict[float, str] = {}
    for frame in frames:
        top, black = float(frame.counts.max()), max(frame.black)
        piled = np.count_nonzero(frame.counts >= top - _PLATEAU * (top - black)) >= _PILED_UP
        if not (black + _WELL_ABOVE_BLACK < top < frame.white and piled):
            continue
        before = next((name for other, name in seen.items() if abs(other - top) <= _PLATEAU * (top - black)), None)
        if before is not None:
            what = (
                f"{before} and {frame.name} both end at {top:g} counts, near which many pixels lie, below the white "
                f"level of {frame.white:g}"
            )
            cure = f"State the true white level, such as --white {math.floor((1 - _PLATEAU) * top):g}"
            raise SourceError("MF333", what, where=frame.name, cure=cure)
        seen[top] = frame.name


def _check_black(frames: Sequence[Frame]) -> None:
    """Floors that are alike in times that are not are no light: of light they would grow with the time."""
    timed = sorted((frame for frame in frames if frame.exposure_s), key=lambda frame: frame.exposure_s or 0.0)
    if len(timed) < 2 or (timed[-1].exposure_s or 0.0) < _APART * (timed[0].exposure_s or 1.0):
        return
    short, long = (float(np.quantile(frame.counts, _FLOOR_SHARE)) - max(frame.black) for frame in (timed[0], timed[-1]))
    ratio = (timed[-1].exposure_s or 0.0) / (timed[0].exposure_s or 1.0)
    if long + max(timed[-1].black) >= timed[-1].white:
        return
    if short > _LEAST_FLOOR_COUNTS and abs(long / short - 1) < _GROWS * (ratio - 1):
        level = _level_of_no_light(timed[0], timed[-1], ratio)
        what = (
            f"the darkest pixels of {timed[0].name} and {timed[-1].name} have {short:.0f} and {long:.0f} counts above "
            f"black, although the times are {timed[0].exposure_s:g} s and {timed[-1].exposure_s:g} s"
        )
        cure = f"State the black level, such as --black {level:.0f}"
        raise SourceError("MF333", what, where=timed[0].name, cure=cure)


def _level_of_no_light(short: Frame, long: Frame, ratio: float) -> float:
    """Counts to which darker pixels of two exposures lead, the one longer by a factor, in their mean: quantiles of
    noise and of few levels lie below it."""
    dark = long.counts <= np.median(long.counts)
    return float((ratio * short.counts[dark].mean() - long.counts[dark].mean()) / (ratio - 1))


_AROUND = np.array([[1.0, 1.0, 1.0], [1.0, 0.0, 1.0], [1.0, 1.0, 1.0]])


def mean_beside(values: Floats, usable: Mask) -> Floats:
    """Mean of each pixel's ``usable`` ones of its eight neighbours of its colour, itself left out; 0 where none is."""
    total = ndimage.convolve(np.where(usable, values, 0.0), _AROUND, mode="constant")
    count = ndimage.convolve(usable.astype(np.float64), _AROUND, mode="constant")
    return np.asarray(np.divide(total, count, out=np.zeros_like(total), where=count > 0.5), dtype=np.float64)


_SPOT = 9
"""Pixels along the square whose mean is compared."""
_SEEN = 8.0
SIGMA_OF_MAD = 1.4826
"""Standard deviation of normal numbers, in medians of the modulus of their distance from the median."""
_SECOND = 0.05
_PAIRED = 5
"""Pixels within which an order lies where its pair says: their place is that of the light to a pixel or two."""


def light_place(frames: Sequence[Frame], side: int) -> tuple[int, int]:
    """Row and column of the brightest spot, that of undiffracted light, within some pixels.

    Args:
        side: pixels of the crop that is to be taken about it.

    Raises:
        SourceError: as :func:`check_stack`; MF334 without a spot above noise, MF338 if another spot outside the crop
            has a twentieth of its light or more, and none lies as far on the other side.
    """
    check_stack(frames)
    ordered = sorted(frames, key=lambda frame: frame.exposure_s or 0.0)
    shortest = _spots(ordered[0])
    seen = shortest if len(frames) == 1 else np.sum([_spots(frame) for frame in ordered], axis=0)
    row, column = map(int, np.unravel_index(int(seen.argmax()), seen.shape))
    if not seen[row, column] > _level(seen):
        what = f"no spot of {_SPOT} x {_SPOT} pixels is {_SEEN:g} standard deviations above the others"
        raise SourceError("MF334", what, where=frames[0].name, cure="Expose longer, or point the camera at the light")
    # Orders of diffraction come in pairs, lamps do not: a spot counts less what lies as far on the other side of the
    # light. Where that is beyond the frame nothing can be said, and nothing is left.
    rows, columns = shortest.shape
    there = np.ix_(2 * row - np.arange(rows), 2 * column - np.arange(columns))
    inside = [(index >= 0) & (index < length) for index, length in zip(there, shortest.shape, strict=True)]
    paired = ndimage.maximum_filter(shortest, _PAIRED)[there[0].clip(0, rows - 1), there[1].clip(0, columns - 1)]
    outside = np.asarray(np.where(inside[0] & inside[1], shortest - paired, -np.inf), dtype=np.float32)
    outside[max(0, row - side // 2) : row + side // 2, max(0, column - side // 2) : column + side // 2] = -np.inf
    other = np.unravel_index(int(outside.argmax()), seen.shape)
    share = float(outside[other] / shortest[row, column])
    if seen[other] > _level(seen) and shortest[other] > _level(shortest) and share > _SECOND:
        what = (
            f"a second light at row {other[0]}, column {other[1]} has {share:.2g} of the light at row {row}, column "
            f"{column}; outside the crop of {side} pixels at most {_SECOND:g} is allowed"
        )
        cure = "Cover the other light, or crop so many pixels that all of it is held"
        raise SourceError("MF338", what, where=frames[0].name, cure=cure)
    return row, column


def window_middle(place: tuple[int, int], frame: Frame, side: int) -> tuple[int, int]:
    """Row and column about which a square of ``side`` pixels lies in a frame, a place near its middle.

    Where the frame ends the square is moved, by up to a quarter of itself.
    """
    row, column = (min(max(at, side // 2), length - side // 2) for at, length in zip(place, frame.shape, strict=True))
    if max(abs(row - place[0]), abs(column - place[1])) > side // 4:
        nearest = min(min(at, length - at) for at, length in zip(place, frame.shape, strict=True))
        what = (
            f"the light lies {nearest} pixels from the edge of {frame.name}, and a window of {side} pixels needs "
            f"{side // 4}"
        )
        cure = "Put the light nearer the middle of the picture, or ask for a smaller window"
        raise SourceError("MF337", what, where=frame.name, cure=cure)
    return row, column


def _spots(frame: Frame) -> Singles:
    """Mean light of the square about each pixel, in units of white, [rows, columns]."""
    light = np.zeros(frame.shape, dtype=np.float32)
    top = frame.white if np.isfinite(frame.white) else float(frame.counts.max())
    for place, lattice in enumerate(frame.lattices):
        black = frame.black[place]
        values = (lattice.of(frame.counts).astype(np.float32) - np.float32(black)) / np.float32(max(top - black, 1e-30))
        lattice.at(light)[...] += _unspiked(values)
    return np.asarray(ndimage.uniform_filter(light, _SPOT, mode="constant"))


def _unspiked(values: Singles) -> Singles:
    """No pixel brighter than the brightest of its eight neighbours: a hot one alone makes no spot."""
    beside = ndimage.maximum_filter(values, footprint=_AROUND > 0, mode="constant", cval=-np.inf)
    return np.asarray(np.minimum(values, beside))


def _level(spots: Singles) -> float:
    """Above which a spot is no noise."""
    middle = float(np.median(spots))
    return middle + _SEEN * SIGMA_OF_MAD * float(np.median(np.abs(spots - middle)))


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
        read_noise_e: in electrons, without what rounding to counts adds.
        misfit: chi² per degree of freedom of the line; errors are larger by its root where it is above 1.
    """

    electrons_per_count: float
    error: float
    read_noise_e: float
    read_noise_error_e: float
    misfit: float
    samples: int


@dataclass(frozen=True, eq=False)
class _Pixels:
    """Pixels of one colour over equal frames; the variance of each is expected to be slope x light + floor x dark."""

    light: Floats
    beside: Floats
    variance: Floats
    dark: Floats
    freedom: Floats

    def of(self, part: Mask) -> _Pixels:
        return _Pixels(*(column[part] for column in self._columns()))

    def expected(self, slope: float, floor: float) -> Floats:
        """Variance that the light beside each pixel lets one expect."""
        return np.asarray(np.maximum(slope * self.beside, 0.0) + floor * self.dark)

    @classmethod
    def joined(cls, groups: Sequence[_Pixels]) -> _Pixels:
        return cls(*(np.concatenate(columns) for columns in zip(*(group._columns() for group in groups), strict=True)))

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
    times = [-1.0 if frame.exposure_s is None else frame.exposure_s for frame in frames]
    equal = [[frame for frame, time in zip(frames, times, strict=True) if time == level] for level in sorted({*times})]
    lit = [pixels for group in equal if len(group) > 1 for pixels in _colours(group, dark=False)]
    if not lit:
        raise _unknown(
            f"no two of {len(frames)} frames have one exposure time",
            "Give two equal frames, taken one after the other",
        )
    steps = 1 / 12 if all(frame.whole for frame in frames) else 0.0
    return _line(_Pixels.joined([*lit, *(_colours(dark, dark=True) if dark else ())]), steps)


def _colours(frames: Sequence[Frame], *, dark: bool) -> Iterator[_Pixels]:
    full = np.any([frame.full for frame in frames], axis=0)
    for place, lattice in enumerate(frames[0].lattices):
        usable = ~lattice.at(full)
        stack = np.stack([frame.signal(place) for frame in frames])
        if usable.any() and dark:
            none, ones = np.zeros(usable.sum()), np.ones(usable.sum())
            yield _Pixels(none, none, stack[:, usable].var(axis=0, ddof=1), ones, (len(stack) - 1) * ones)
        elif usable.any():
            yield _in_light(stack, usable)


def _in_light(stack: Floats, usable: Mask) -> _Pixels:
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


def _factors(stack: Floats, usable: Mask) -> Floats:
    sums = stack[:, usable].sum(axis=1)
    if not (sums > 0).all():
        raise _unknown("a frame has no light above black", "Give frames with light, or state their black level")
    return np.asarray(sums / sums.mean())


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
        moments, columns = (np.stack([light, pixels.dark]) for light in (pixels.beside, pixels.light))
        normal = (moments * weights) @ columns.T
        if abs(np.linalg.det(normal)) <= _SINGULAR * abs(normal[0, 0] * normal[1, 1]):
            raise _unknown("all pixels have the same light", _FLAT)
        inverse = np.linalg.inv(normal)
        slope, floor = map(float, inverse @ ((moments * weights) @ pixels.variance))
        if slope <= 0:
            raise _unknown("noise does not grow with light", "Give equal frames with more light")
        floor = max(floor, _LEAST_FLOOR)
    covariance = inverse @ ((moments * weights) @ moments.T) @ inverse.T
    misfit = _misfit(pixels, slope, floor)
    error_slope, error_floor = map(float, np.sqrt(np.diag(covariance) * max(misfit, 1.0)))
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
    """Chi² per degree of freedom of the mean variances of some levels of light."""
    expected = pixels.expected(slope, floor)
    parts = np.array_split(np.argsort(expected, kind="stable"), min(_LEVELS, len(expected)))
    off = [
        (pixels.variance[part] - slope * pixels.light[part] - floor * pixels.dark[part]).sum() ** 2
        / (2 * expected[part] ** 2 / pixels.freedom[part]).sum()
        for part in parts
    ]
    return float(sum(off) / max(len(off) - 2, 1))


def require_gain(electrons_per_count: float, read_noise_e: float, where: str = "") -> None:
    """Refuse a gain or a read noise that no sensor has (MF335)."""
    if not (0 < electrons_per_count < np.inf and 0 <= read_noise_e < np.inf):
        what = f"a gain of {electrons_per_count:g} electrons per count with a read noise of {read_noise_e:g} electrons"
        raise SourceError("MF335", what, where=where, cure="Give a gain above 0 and a read noise of 0 or more")


def _unknown(what: str, cure: str) -> SourceError:
    return SourceError("MF335", f"the gain is not told by these frames: {what}", cure=cure)
