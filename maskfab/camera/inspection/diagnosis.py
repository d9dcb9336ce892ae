"""Faults of sensor, lamp and lens that leave in frames what a die does not explain, each as one value, by likelihood.

Readings of all exposures are held against the fit's, reading by reading: y = μ + θ d + noise of variance v, where d is
what a fault does to them for each unit of itself. All that a fit may move (the die's stand, its width, the lens's
errors, light and background of every colour, a gain for each exposure) is projected out of d, so that

    θ = Σ d (y - μ) / v / Σ d² / v,    and chi² falls by    θ² Σ d² / v        (C. R. Rao's score test, 1948).

A fault that differs from pixel to pixel, or from row to row, is a variance: of groups g with scores s_g and
information I_g, whose effects are normal of deviation σ, twice the logarithm of the likelihood grows by

    Σ σ² s_g² / (1 + σ² I_g) - log(1 + σ² I_g),

which pays for every group that it explains. Few pixels far off pay for their choice among all of them. So all faults
are in one currency, and the largest growth names the fault.

Notes:
    One step from where the fit stands: a fault that is very strong is told a little too weak.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from enum import StrEnum

import numpy as np
from scipy import ndimage

from maskfab.base.arrays import Floats, Indices
from maskfab.camera.inspection.die_image import DieImage
from maskfab.camera.inspection.fit import Fit, Taken, colours_of, with_all_terms
from maskfab.camera.inspection.identity import FWHM


class Cause(StrEnum):
    """Reason for which frames tell nothing of a die."""

    LAMP = "second lamp"
    DUST = "dust"
    DRIFT = "drift"
    SATURATION = "saturation"
    DIE = "wrong die"
    SETTING = "wrong setting"
    NOISE = "wrong noise"
    ROWS = "rows"
    COLUMNS = "columns"
    BLACK = "black level"
    GAMMA = "tone curve"
    SOFT_CLIP = "soft clip"
    RESPONSE = "unlike pixels"
    HOT = "hot pixels"
    DEAD = "dead pixels"
    SHADING = "lens shading"
    GLARE = "glare"
    LAMP_SIZE = "size of the lamp"
    BANDWIDTH = "bandwidth of the light"
    INTERVAL = "interval holds the limit"
    UNKNOWN = "not in the model"


NAMED, _AHEAD = 40.0, 12.0
"""Growth of twice the log-likelihood from which a fault is named, and by which it must be ahead of the next."""
_MOST_OF_IT = 0.5
"""Share of what is left over, that a fault must explain."""
_MOST_UNLIKE = 0.05
"""Deviation of pixels' response beyond which it is no sensor's: a wrong picture looks like that, too."""
DARK, FLAT, DIMMER, OPEN, COVERED, FILTERED, AGAIN = (
    "a dark frame as long as the longest exposure (--dark)",
    "frames of even light (--flat)",
    "the same stack at a quarter of the light",
    "a stack of the light without the plate",
    "a frame with the point light covered",
    "a stack through a narrow filter",
    "the same stack once more",
)
_SHOWS: Mapping[Cause, tuple[str, ...]] = {
    Cause.BLACK: (DARK,),
    Cause.HOT: (DARK,),
    Cause.ROWS: (DARK, AGAIN),
    Cause.COLUMNS: (DARK, AGAIN),
    Cause.RESPONSE: (FLAT,),
    Cause.DEAD: (FLAT,),
    Cause.DUST: (FLAT,),
    Cause.SHADING: (FLAT,),
    Cause.GAMMA: (DIMMER,),
    Cause.SOFT_CLIP: (DIMMER,),
    Cause.DRIFT: (AGAIN,),
    Cause.LAMP: (COVERED, OPEN),
    Cause.GLARE: (OPEN,),
    Cause.LAMP_SIZE: (OPEN,),
    Cause.BANDWIDTH: (FILTERED,),
}
"""Frames in which every fault shows."""


@dataclass(frozen=True)
class Suspect:
    """A fault that may be behind what a fit leaves.

    Attributes:
        value, error: its strength with one standard error, in the unit that its words say.
        gain: growth of twice the logarithm of the likelihood, less the price of its values.
    """

    cause: Cause
    value: float
    error: float
    gain: float

    @property
    def one_value(self) -> bool:
        """Whether it is one pattern, and not the sum of what pixels or lines have of their own."""
        return self.cause not in (Cause.RESPONSE, Cause.ROWS, Cause.COLUMNS, Cause.DUST, Cause.DEAD)

    def beats(self, other: Suspect) -> bool:
        """Whether it is told from another."""
        return self is not other and self.gain > other.gain + _AHEAD

    def explains(self, left_over: float) -> bool:
        """Whether it explains most of what a fit leaves over, chi² beyond noise."""
        unlike = self.cause is Cause.RESPONSE and self.value > _MOST_UNLIKE
        return not unlike and self.gain > _MOST_OF_IT * left_over


def deciding_frame(suspects: Sequence[Suspect]) -> str | None:
    """The frame that shows one of the two likeliest faults and not the other; None if there is none."""
    if len(suspects) < 2:
        return None
    one, other = (_SHOWS.get(each.cause, ()) for each in suspects[:2])
    return next((frame for frame in (*one, *other) if (frame in one) != (frame in other)), None)


@dataclass(frozen=True, eq=False)
class _Readings:
    """Every reading of every exposure that counts, [n]: what is left of it, and where it was taken.

    Attributes:
        rest: over its standard deviation.
        weight: inverse of that, per electron.
        expected: electrons by the fit.
        per_light: electrons for each unit of the merged light.
        pixel: number of its place among all pixels of all grids.
        known: [n, m] what a fit may move, orthonormal.
    """

    rest: Floats
    weight: Floats
    expected: Floats
    per_light: Floats
    frame: Indices
    pixel: Indices
    known: Floats

    def free(self, columns: Floats) -> Floats:
        """Weighed columns [n, k] of electrons without what a fit may move."""
        weighed = columns * self.weight[:, None]
        return np.asarray(weighed - self.known @ (self.known.T @ weighed))

    def suspect(self, cause: Cause, columns: Floats, *, positive: bool = True, scale: float = 1.0) -> Suspect:
        """A fault of one value, the first column's, or of some that belong together."""
        free = self.free(columns)
        information = free.T @ free
        score = free.T @ self.rest
        covariance = np.linalg.pinv(information, hermitian=True)
        value = covariance @ score
        gain = float(score @ value)
        if positive and value[0] < 0:
            gain = 0.0
        price = 2.0 * (columns.shape[1] - 1)
        return Suspect(cause, scale * float(value[0]), scale * math.sqrt(covariance[0, 0]), gain - price)

    def varied(self, cause: Cause, effect: Floats, groups: Indices) -> Suspect:
        """A fault that differs from group to group, of a deviation."""
        weighed = effect * self.weight
        score, information = np.bincount(groups, weighed * self.rest), np.bincount(groups, weighed**2)
        held = information > 0
        score, information = score[held], information[held]
        usual = 1 / math.sqrt(float(np.median(information)))
        tried = usual * np.geomspace(0.02, 50, 80)
        bent = 1 + tried[:, None] ** 2 * information
        growth = np.sum(tried[:, None] ** 2 * score**2 / bent - np.log(bent), axis=1)
        best = int(growth.argmax())
        curved = np.sum((information / bent[best]) ** 2) / 2
        return Suspect(cause, float(tried[best]), float(1 / math.sqrt(curved) / (2 * tried[best])), float(growth[best]))


_CORE = 0.1
_KNEES = (0.4, 0.55, 0.7, 0.85)
_ALONE_PIXELS, _NEARLY_DARK = 2, 0.4


def suspects_of(image: DieImage, taken: Sequence[Taken], fit: Fit, electrons_per_count: float) -> list[Suspect]:
    """Faults by how well they explain what a fit leaves, the likeliest first; none of frames that are no stack.

    Args:
        fit: of these frames, near enough for its slopes.
    """
    readings = _readings(image, taken, fit)
    if readings is None:
        return []
    found = [
        *_of_counts(readings, taken, electrons_per_count),
        *_of_pixels(readings, taken, fit),
        *_of_light(readings, image, taken, fit),
    ]
    best: dict[Cause, Suspect] = {}
    for each in sorted(found, key=lambda suspect: -suspect.gain):
        best.setdefault(each.cause, each)
    return [each for each in best.values() if each.gain > 0]


def _readings(image: DieImage, taken: Sequence[Taken], fit: Fit) -> _Readings | None:
    planes = [capture.plane for capture in taken if capture.plane is not None]
    if len(planes) < len(taken):
        return None
    slopes, pictures = with_all_terms(image, fit)
    colours, parts, known, first = colours_of(taken), [], [], 0
    frames = len(planes[0].scales)
    for k, (capture, plane) in enumerate(zip(taken, planes, strict=True)):
        colour, light = colours.index(capture.pixels.colour), fit.light[capture.pixels.colour]
        every = np.stack([*(light * slope[k] for slope in slopes)], axis=-1)
        own = np.zeros((*capture.light.shape, 2 * len(colours)))
        own[..., 2 * colour], own[..., 2 * colour + 1] = pictures[k], 1.0
        columns = np.concatenate([every, own], axis=-1)
        numbers = first + np.arange(capture.light.size).reshape(capture.light.shape)
        first += capture.light.size
        for place, scale in enumerate(plane.scales.tolist()):
            clear = capture.valid & plane.exposed.usable[place]
            per_light = scale * plane.share[clear]
            expected = per_light * fit.predicted[k][clear]
            weight = 1 / np.sqrt(np.maximum(expected, 0.0) + plane.exposed.dark[place])
            rest = weight * (plane.exposed.electrons[place][clear] - expected)
            parts.append((rest, weight, expected, per_light, np.full(rest.size, place), numbers[clear]))
            gains = np.zeros((rest.size, frames))
            gains[:, place] = expected
            known.append(np.concatenate([columns[clear] * per_light[:, None], gains], axis=1) * weight[:, None])
    rest, weight, expected, per_light, frame, pixel = (np.concatenate(each) for each in zip(*parts, strict=True))
    every = np.concatenate(known)
    every /= np.maximum(np.linalg.norm(every, axis=0), 1e-300)
    # A basis of what may be moved, by its Gram matrix: of many readings and few columns.
    values, vectors = np.linalg.eigh(every.T @ every)
    held = values > 1e-10 * values[-1]
    basis = every @ (vectors[:, held] / np.sqrt(values[held]))
    rest = rest - basis @ (basis.T @ rest)
    return _Readings(rest, weight, expected, per_light, frame, pixel, basis)


def _of_counts(readings: _Readings, taken: Sequence[Taken], electrons_per_count: float) -> Iterator[Suspect]:
    """Faults of how light becomes counts."""
    expected, ones = np.maximum(readings.expected, 0.0), np.ones_like(readings.expected)
    yield readings.suspect(Cause.BLACK, ones[:, None], positive=False, scale=1 / electrons_per_count)
    most = max(float(plane.exposed.full.max()) for plane in (capture.plane for capture in taken) if plane is not None)
    brightest = float(expected.max())
    most = most if math.isfinite(most) else brightest
    bent = expected * np.log(np.maximum(expected, 1.0) / most)
    yield readings.suspect(Cause.GAMMA, bent[:, None], positive=False)
    for knee in _KNEES:
        over = -(np.maximum(expected / brightest - knee, 0.0) ** 2) * brightest
        if over.any():
            yield readings.suspect(Cause.SOFT_CLIP, over[:, None], scale=(1 - knee) ** 2)


def _of_pixels(readings: _Readings, taken: Sequence[Taken], fit: Fit) -> Iterator[Suspect]:
    """Faults of single pixels, rows and columns."""
    expected, pixel = np.maximum(readings.expected, 0.0), readings.pixel
    x, y = (
        np.concatenate(
            [np.broadcast_to(axis, each.light.shape).ravel() for axis, each in zip(axes, taken, strict=True)]
        )
        for axes in ([each.pixels.x_um for each in taken], [each.pixels.y_um[:, None] for each in taken])
    )
    rows, columns = (np.unique(np.round(axis, 3), return_inverse=True)[1][pixel] for axis in (y, x))
    frames = int(readings.frame.max()) + 1
    for cause, lines in ((Cause.ROWS, rows), (Cause.COLUMNS, columns)):
        ones = np.ones_like(expected)
        yield readings.varied(cause, ones, lines)
        yield readings.varied(cause, ones, lines * frames + readings.frame)
    yield readings.varied(Cause.RESPONSE, expected, pixel)
    far_x, far_y = x[pixel], y[pixel]
    reach = max(float(abs(far_x).max()), float(abs(far_y).max()))
    shade = [(far_x**2 + far_y**2) / reach**2, far_x / reach, far_y / reach]
    yield readings.suspect(Cause.SHADING, -expected[:, None] * np.stack(shade, axis=1), positive=False)
    yield from _few(readings, taken, fit)


def _few(readings: _Readings, taken: Sequence[Taken], fit: Fit) -> Iterator[Suspect]:
    """Few pixels that stand out: too bright, nearly dark, or shaded together."""
    size = sum(capture.light.size for capture in taken)
    rate = _by_pixel(readings, readings.per_light, size)
    shaded = _by_pixel(readings, np.maximum(readings.expected, 0.0), size)
    limit = math.sqrt(2 * math.log(size)) + 1
    gains = dict.fromkeys((Cause.HOT, Cause.DEAD, Cause.DUST), 0.0)
    found: dict[Cause, list[float]] = {cause: [] for cause in gains}
    first = 0
    for capture, predicted in zip(taken, fit.predicted, strict=True):
        part = slice(first, first + capture.light.size)
        first += capture.light.size
        (bright, above), (dark, below) = (
            tuple(values[part].reshape(capture.light.shape) for values in each) for each in (rate, shaded)
        )
        beside = predicted < _CORE * predicted.max()
        for mask, up in ((bright > limit, True), (dark < -limit, False)):
            labels, count = ndimage.label(mask & beside)
            sizes = np.bincount(labels.ravel())
            for number in range(1, count + 1):
                spot = labels == number
                growth = float(np.sum((bright if up else dark)[spot] ** 2 - limit**2))
                cause = Cause.HOT if up else Cause.DUST
                if not up and sizes[number] <= _ALONE_PIXELS and float(below[spot].mean()) < _NEARLY_DARK - 1:
                    cause = Cause.DEAD
                if up and sizes[number] > _ALONE_PIXELS:
                    continue
                gains[cause] += growth
                found[cause] += (above if up else -below)[spot].tolist()
    for cause, values in found.items():
        if values:
            # Of a picture that is wrong, bright and dark spots come together.
            against = gains[Cause.HOT] if cause is not Cause.HOT else gains[Cause.DUST] + gains[Cause.DEAD]
            yield Suspect(cause, float(len(values)), 0.0, gains[cause] - against)


def _by_pixel(readings: _Readings, effect: Floats, size: int) -> tuple[Floats, Floats]:
    """Of every pixel by all its readings: how many standard errors an effect is from 0, and how strong it is."""
    weighed = effect * readings.weight
    score = np.bincount(readings.pixel, weighed * readings.rest, size)
    information = np.bincount(readings.pixel, weighed**2, size)
    strength = np.divide(score, information, out=np.zeros(size), where=information > 0)
    return strength * np.sqrt(information), strength


_SPREAD_PX = 0.5
_SCALED = 0.004


def _of_light(readings: _Readings, image: DieImage, taken: Sequence[Taken], fit: Fit) -> Iterator[Suspect]:
    """Faults of the lamp and of the way of its light."""
    setting = fit.setting

    def column(values: Sequence[Floats]) -> Floats:
        every = np.concatenate(
            [(fit.light[one.pixels.colour] * each).ravel() for one, each in zip(taken, values, strict=True)]
        )
        return np.asarray(readings.per_light * every[readings.pixel])

    skirts = []
    for capture in taken:
        far2 = (capture.pixels.x_um - setting.x_um) ** 2 + (capture.pixels.y_um[:, None] - setting.y_um) ** 2
        skirts.append(1 / (far2 / image.camera.pixel_um**2 + 4.0) / (2 * math.pi * math.log(100)))
    yield readings.suspect(Cause.GLARE, column(skirts)[:, None])
    here = image.pictures(setting)
    apart = (_SPREAD_PX * image.camera.pixel_um) ** 2
    wider = replace(image, light_um=math.sqrt(image.light_um**2 + apart)).pictures(setting)
    size = readings.suspect(Cause.LAMP_SIZE, column([b - a for a, b in zip(here, wider, strict=True)])[:, None])
    yield replace(
        size, value=FWHM * math.sqrt(apart * max(size.value, 0.0)), error=_of_root(size, FWHM * math.sqrt(apart))
    )
    ahead, behind = (image.pictures(replace(setting, scale=setting.scale + sign * _SCALED)) for sign in (1, -1))
    bent = [(a + b) / 2 - c for a, b, c in zip(ahead, behind, here, strict=True)]
    band = readings.suspect(Cause.BANDWIDTH, column(bent)[:, None])
    unit = FWHM * _SCALED * float(image.camera.wavelengths_nm[0])
    yield replace(band, value=unit * math.sqrt(max(band.value, 0.0)), error=_of_root(band, unit))


def _of_root(square: Suspect, unit: float) -> float:
    """Standard error of a root in a unit, of its square's."""
    return unit * square.error / (2 * math.sqrt(max(square.value, square.error, 1e-12)))
