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
from dataclasses import dataclass, field, replace
from enum import StrEnum
from functools import cached_property

import numpy as np
from scipy import ndimage

from maskfab.base.arrays import Floats, Indices, Mask
from maskfab.camera.inspection.die_image import DieImage
from maskfab.camera.inspection.fit import LIKELY, NOISE_KNOWN, Fit, Taken, colours_of, with_lacking_terms


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
    INTERVAL = "interval holds the limit"
    UNKNOWN = "not in the model"


NAMED, _AHEAD = 40.0, 12.0
"""Growth of twice the log-likelihood from which a fault is named, and by which it must be ahead of the next."""
_MUCH_OF_IT = 0.35
"""Share of what is left over, that a fault must explain: it changes the noise, too."""
_MOST_UNLIKE = 0.05
"""Deviation of pixels' response beyond which it is no sensor's: a wrong picture looks like that, too."""
_DARK, _FLAT, _DIMMER = (
    "a dark frame as long as the longest exposure (--dark)",
    "frames of even light (--flat)",
    "the same stack at a quarter of the light",
)
_SHOWN_IN: Mapping[Cause, str] = {
    **dict.fromkeys((Cause.BLACK, Cause.HOT, Cause.ROWS, Cause.COLUMNS), _DARK),
    **dict.fromkeys((Cause.RESPONSE, Cause.DEAD, Cause.DUST, Cause.SHADING), _FLAT),
    **dict.fromkeys((Cause.GAMMA, Cause.SOFT_CLIP), _DIMMER),
    Cause.GLARE: "a stack of the light without the plate",
}
"""The frame that shows a fault alone, or in a pattern that no other has: level, lines and points of a dark frame."""


@dataclass(frozen=True)
class Suspect:
    """A fault that may be behind what a fit leaves.

    Attributes:
        value, error: its strength with one standard error, in the unit that its words say.
        gain: growth of twice the logarithm of the likelihood, less the price of its values.
        share: of what all readings leave over chi² beyond noise, that the fault explains.
        effect: electrons that it adds to every reading, [grids][frames, rows, columns]; none of what has no pattern.
    """

    cause: Cause
    value: float
    error: float
    gain: float
    share: float = 0.0
    effect: tuple[Floats, ...] = field(default=(), repr=False)

    @property
    def one_value(self) -> bool:
        """Whether it is one pattern, and not the sum of what pixels or lines have of their own."""
        return self.cause not in (Cause.RESPONSE, Cause.ROWS, Cause.COLUMNS, Cause.DUST, Cause.DEAD)

    def beats(self, other: Suspect) -> bool:
        """Whether it is told from another."""
        return self is not other and self.gain > other.gain + _AHEAD

    @property
    def explains(self) -> bool:
        """Whether it explains most of what readings leave over."""
        unlike = self.cause is Cause.RESPONSE and self.value > _MOST_UNLIKE
        return not unlike and self.share > _MUCH_OF_IT

    def taken_off(self, taken: Sequence[Taken]) -> tuple[Taken, ...]:
        """Frames without its effect."""
        mended = []
        for capture, effect in zip(taken, self.effect, strict=True):
            assert capture.plane is not None  # of a stack
            exposed = replace(capture.plane.exposed, electrons=capture.plane.exposed.electrons - effect)
            mended.append(replace(capture, plane=replace(capture.plane, exposed=exposed)).rescaled(np.ones(1)))
        return tuple(mended)


def deciding_frame(suspects: Sequence[Suspect]) -> str | None:
    """The frame that tells the likeliest fault from the next; None if there is none."""
    return _SHOWN_IN.get(suspects[0].cause) if len(suspects) > 1 else None


_Every = Sequence[Floats]
"""Values of all readings, [grids][frames, rows, columns]."""


@dataclass(frozen=True, eq=False)
class _Readings:
    """Every reading of every exposure: what is left of those that count, [n], and where they were taken.

    Attributes:
        clear: which readings count.
        expected: electrons by the fit.
        per_light: electrons for each unit of the merged light.
        rest: what is left over its standard deviation, [n].
        weight: inverse of that, per electron, [n].
        frame, pixel: numbers of the exposure, and of the place among all pixels of all grids, [n].
        known: [n, m] what a fit may move, orthonormal.
    """

    clear: tuple[Mask, ...]
    expected: tuple[Floats, ...]
    per_light: tuple[Floats, ...]
    rest: Floats
    weight: Floats
    frame: Indices
    pixel: Indices
    known: Floats

    @cached_property
    def light(self) -> Floats:
        """Electrons that are expected of readings that count, none below 0."""
        return np.maximum(self.flat(self.expected), 0.0)

    @cached_property
    def left_over(self) -> float:
        """Chi² beyond the most that noise allows."""
        count = self.rest.size
        most = count * (1 + NOISE_KNOWN) + LIKELY * math.sqrt(2 * count)
        return max(0.0, float(np.sum(self.rest**2)) - most)

    def share(self, gain: float) -> float:
        """Of that, what a fault explains; 1 where noise is all that is left."""
        return gain / max(self.left_over, gain, 1e-9)

    def flat(self, every: _Every) -> Floats:
        """Of readings that count, [n]."""
        return np.concatenate([values[clear] for values, clear in zip(every, self.clear, strict=True)])

    def suspect(self, cause: Cause, effects: Sequence[_Every], *, positive: bool = True, scale: float = 1.0) -> Suspect:
        """A fault of one value, the first effect's, or of some that belong together."""
        weighed = np.stack([self.flat(effect) for effect in effects], axis=1) * self.weight[:, None]
        free = weighed - self.known @ (self.known.T @ weighed)
        score = free.T @ self.rest
        covariance = np.linalg.pinv(free.T @ free, hermitian=True)
        value = covariance @ score
        gain = 0.0 if positive and value[0] < 0 else float(score @ value) - 2.0 * (len(effects) - 1)
        added = tuple(
            np.asarray(sum(v * each for v, each in zip(value, grid, strict=True)))
            for grid in zip(*effects, strict=True)
        )
        error = scale * math.sqrt(covariance[0, 0])
        return Suspect(cause, scale * float(value[0]), error, gain, self.share(gain), added)

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
        error, gain = float(1 / math.sqrt(curved) / (2 * tried[best])), float(growth[best])
        return Suspect(cause, float(tried[best]), error, gain, self.share(gain))


CORE = 0.1
"""Share of the peak, from which nothing is taken for dust, or for a pixel of its own."""
NEARLY_DARK = 0.6
"""Share of the light that is missing, from which a pixel is dead."""
_SKIRT_PX, _SKIRT_ENDS = 2.0, 100.0
"""Pixels within which a skirt is level, and how many times as far it reaches."""
_KNEES, _FEWEST_CLIPPED = (0.4, 0.55, 0.7, 0.85), 4
_ALONE_PIXELS = 2


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
        _glare(readings, image, taken, fit),
    ]
    best: dict[Cause, Suspect] = {}
    for each in sorted(found, key=lambda suspect: -suspect.gain):
        best.setdefault(each.cause, each)
    return [each for each in best.values() if each.gain > 0]


def _readings(image: DieImage, taken: Sequence[Taken], fit: Fit) -> _Readings | None:
    planes = [capture.plane for capture in taken if capture.plane is not None]
    if len(planes) < len(taken):
        return None
    every = with_lacking_terms(fit.setting)
    slopes, pictures = image.slopes(every), image.pictures(every)
    colours, frames, first = colours_of(taken), len(planes[0].scales), 0
    parts, known = [], []
    clears: list[Mask] = []
    expecteds: list[Floats] = []
    per_lights: list[Floats] = []
    for k, (capture, plane) in enumerate(zip(taken, planes, strict=True)):
        colour, light = colours.index(capture.pixels.colour), fit.light[capture.pixels.colour]
        own = np.zeros((*capture.light.shape, 2 * len(colours)))
        own[..., 2 * colour], own[..., 2 * colour + 1] = pictures[k], 1.0
        columns = np.concatenate([np.stack([light * slope[k] for slope in slopes], axis=-1), own], axis=-1)
        per_light = plane.scales[:, None, None] * plane.share
        expected, clear = per_light * fit.predicted[k], capture.valid & plane.exposed.usable
        weights = 1 / np.sqrt(np.maximum(expected, 0.0) + plane.exposed.dark[:, None, None])
        rest = weights * (plane.exposed.electrons - expected)
        place, row, column = np.nonzero(clear)
        gains = np.zeros((place.size, frames))
        gains[np.arange(place.size), place] = expected[clear]
        weight = weights[clear]
        known.append(
            np.concatenate([columns[row, column] * per_light[clear][:, None], gains], axis=1) * weight[:, None]
        )
        parts.append((rest[clear], weight, place, first + row * capture.light.shape[1] + column))
        first += capture.light.size
        clears.append(clear)
        expecteds.append(expected)
        per_lights.append(per_light)
    rest, weight, frame, pixel = (np.concatenate(each) for each in zip(*parts, strict=True))
    moved = np.concatenate(known)
    moved /= np.maximum(np.linalg.norm(moved, axis=0), 1e-300)
    # A basis of what may be moved, by its Gram matrix: of many readings and few columns.
    values, vectors = np.linalg.eigh(moved.T @ moved)
    held = values > 1e-10 * values[-1]
    basis = moved @ (vectors[:, held] / np.sqrt(values[held]))
    rest = rest - basis @ (basis.T @ rest)
    return _Readings(tuple(clears), tuple(expecteds), tuple(per_lights), rest, weight, frame, pixel, basis)


def _of_counts(readings: _Readings, taken: Sequence[Taken], electrons_per_count: float) -> Iterator[Suspect]:
    """Faults of how light becomes counts."""
    lights = [np.maximum(each, 0.0) for each in readings.expected]
    ones = [np.ones_like(each) for each in lights]
    yield readings.suspect(Cause.BLACK, [ones], positive=False, scale=1 / electrons_per_count)
    brightest = float(readings.light.max())
    most = max(float(capture.plane.exposed.full.max()) for capture in taken if capture.plane is not None)
    most = most if math.isfinite(most) else brightest
    bent = [each * np.log(np.maximum(each, 1.0) / most) for each in lights]
    yield readings.suspect(Cause.GAMMA, [bent], positive=False)
    for knee in _KNEES:
        if (readings.light > knee * brightest).sum() >= _FEWEST_CLIPPED:
            over = [-(np.maximum(each / brightest - knee, 0.0) ** 2) * brightest for each in lights]
            yield readings.suspect(Cause.SOFT_CLIP, [over], scale=(1 - knee) ** 2)


def _of_pixels(readings: _Readings, taken: Sequence[Taken], fit: Fit) -> Iterator[Suspect]:
    """Faults of single pixels, rows and columns."""
    far = [np.broadcast_arrays(each.pixels.x_um, each.pixels.y_um[:, None]) for each in taken]
    x, y = (np.concatenate([each[axis].ravel() for each in far]) for axis in (0, 1))
    rows, columns = (np.unique(np.round(axis, 3), return_inverse=True)[1][readings.pixel] for axis in (y, x))
    frames = int(readings.frame.max()) + 1
    for cause, lines in ((Cause.ROWS, rows), (Cause.COLUMNS, columns)):
        ones = np.ones_like(readings.rest)
        yield readings.varied(cause, ones, lines)
        yield readings.varied(cause, ones, lines * frames + readings.frame)
    yield readings.varied(Cause.RESPONSE, readings.light, readings.pixel)
    reach = max(float(abs(x).max()), float(abs(y).max()))
    shades = [(((across**2 + up**2) / reach**2), across / reach, up / reach) for across, up in far]
    effects = [
        [-expected * shade[k] for expected, shade in zip(readings.expected, shades, strict=True)] for k in range(3)
    ]
    yield readings.suspect(Cause.SHADING, effects, positive=False)
    yield from _few(readings, taken, fit)


def _few(readings: _Readings, taken: Sequence[Taken], fit: Fit) -> Iterator[Suspect]:
    """Few pixels that stand out: too bright, nearly dark, or shaded together."""
    every = sum(capture.light.size for capture in taken)
    bright, _ = _by_pixel(readings, readings.flat(readings.per_light), every)
    dark, strength = _by_pixel(readings, readings.light, every)
    limit = math.sqrt(2 * math.log(every)) + 1
    gains = dict.fromkeys((Cause.HOT, Cause.DEAD, Cause.DUST), 0.0)
    pixels = dict.fromkeys(gains, 0)
    first = 0
    for capture, predicted in zip(taken, fit.predicted, strict=True):
        part = slice(first, first + capture.light.size)
        first = part.stop
        above, below, shade = (each[part].reshape(capture.light.shape) for each in (bright, -dark, strength))
        beside = predicted < CORE * predicted.max()
        for cause, off in ((Cause.HOT, above), (Cause.DUST, below)):
            labels, count = ndimage.label((off > limit) & beside)
            for number in range(1, count + 1):
                spot = labels == number
                size = int(np.count_nonzero(spot))
                if size > _ALONE_PIXELS and cause is Cause.HOT:
                    continue
                dead = cause is Cause.DUST and size <= _ALONE_PIXELS and float(shade[spot].mean()) < -NEARLY_DARK
                kind = Cause.DEAD if dead else cause
                gains[kind] += float(np.sum(off[spot] ** 2 - limit**2))
                pixels[kind] += size
    for cause, size in pixels.items():
        if size:
            # Of a picture that is wrong, bright and dark spots come together.
            against = gains[Cause.HOT] if cause is not Cause.HOT else gains[Cause.DUST] + gains[Cause.DEAD]
            gain = gains[cause] - against
            yield Suspect(cause, float(size), 0.0, gain, readings.share(gain))


def _by_pixel(readings: _Readings, effect: Floats, size: int) -> tuple[Floats, Floats]:
    """Of every pixel by all its readings: how many standard errors an effect is from 0, and how strong it is."""
    weighed = effect * readings.weight
    score = np.bincount(readings.pixel, weighed * readings.rest, size)
    information = np.bincount(readings.pixel, weighed**2, size)
    strength = np.divide(score, information, out=np.zeros(size), where=information > 0)
    return strength * np.sqrt(information), strength


def _glare(readings: _Readings, image: DieImage, taken: Sequence[Taken], fit: Fit) -> Suspect:
    """Light in a skirt that falls with the square of the distance."""
    setting, effect = fit.setting, []
    for capture, per_light in zip(taken, readings.per_light, strict=True):
        far2 = (capture.pixels.x_um - setting.x_um) ** 2 + (capture.pixels.y_um[:, None] - setting.y_um) ** 2
        skirt = 1 / (far2 / image.camera.pixel_um**2 + _SKIRT_PX**2) / (2 * math.pi * math.log(_SKIRT_ENDS))
        effect.append(fit.light[capture.pixels.colour] * per_light * skirt)
    return readings.suspect(Cause.GLARE, [effect])
