"""Causes of what a fit leaves: looked for one after another, made good where that can be, and named where it cannot.

Another lamp makes the die's own picture at another place. Where residuals r of variance σ² are like the picture m moved
by s, chi² falls by

    (Σ r(x) m(x - s) / σ²)² / Σ m(x - s)² / σ²,

both sums convolutions; the best place is where its fit starts. Dust shades pixels, alike in all exposures, so that they
come out dark beyond any noise, a few together. A light that drifts gives each exposure a gain, fitted beside all else.
A fit explains its frames if chi² per pixel is that of noise, and if no row or column of pixels is off as a whole.

Notes:
    Noise is known no better than gain and read noise are: chi² may be off by :data:`NOISE_KNOWN`.
    Dust near the peak cannot be told from a lens that is wrong, and is not looked for there.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
import scipy
from scipy import ndimage

from maskfab.base.arrays import Floats, Mask
from maskfab.base.work import Progress, silent
from maskfab.camera.frames.merge import alone
from maskfab.camera.frames.stack import SIGMA_OF_MAD
from maskfab.camera.inspection.bench import FULL
from maskfab.camera.inspection.bench_search import gain_of_others, with_bench_and_terms
from maskfab.camera.inspection.diagnosis import CORE, NAMED, NEARLY_DARK, Cause, Suspect, suspects_of
from maskfab.camera.inspection.die_image import DieImage, Lamp, Pixels, Setting
from maskfab.camera.inspection.fit import (
    FIRST_TERMS,
    LIKELY,
    NOISE_KNOWN,
    Fit,
    Taken,
    expecting,
    fitted,
    frame_gains,
    judged,
    most_noise,
    with_frames,
)

_LEAST_NOISE = 0.8
"""Chi² per pixel below which the noise is another than gain and read noise say."""
_LAMP_GAIN = 40.0
"""Fall of chi², over the noise that is left, from which a lamp is looked at; the best of 1e5 places has 25."""
_LAMP_SHARE = 0.02
"""Share of what is left over, that a lamp must explain at least."""
_SEEN = 5.0
"""Standard errors from which another lamp's power is told."""
_NEAREST_PX, _LEAST_APART_PX = 3, 2
"""Pixels from the first light within which no other is looked for, and within which it is none: the first is wider."""
_BEYOND_PX = 8
_DARK = 6.0
"""Standard deviations by which dust is darker than the fit, of those that residuals have."""
_MOST_DUST = 0.08
_MOST_OF_IT = 0.5
"""Share of what is left over that lies at some pixels where their fault is the cause."""


@dataclass(frozen=True, eq=False)
class LeftOut:
    """Pixels of every grid that tell nothing of a die: brighter alone, darker alone, and shaded together."""

    hot: tuple[Mask, ...]
    dead: tuple[Mask, ...]
    dust: tuple[Mask, ...]

    @classmethod
    def none(cls, taken: Sequence[Taken]) -> LeftOut:
        """No pixel."""
        nowhere = tuple(np.zeros(capture.valid.shape, dtype=np.bool_) for capture in taken)
        return cls(nowhere, nowhere, nowhere)

    @property
    def together(self) -> tuple[Mask, ...]:
        """All of them."""
        return tuple(hot | dead | dust for hot, dead, dust in zip(self.hot, self.dead, self.dust, strict=True))

    @property
    def counts(self) -> dict[str, int]:
        """Numbers of each."""
        every = {"hot": self.hot, "dead": self.dead, "dust": self.dust}
        return {name: sum(int(mask.sum()) for mask in masks) for name, masks in every.items()}

    def alike(self, other: LeftOut) -> bool:
        """Whether the same pixels are left out."""
        return all((one == two).all() for one, two in zip(self.together, other.together, strict=True))

    def taken_from(self, taken: Sequence[Taken]) -> tuple[Taken, ...]:
        """Frames without them."""
        return tuple(capture.without(mask) for capture, mask in zip(taken, self.together, strict=True))


@dataclass(frozen=True, eq=False)
class Explanation:
    """Frames as far as they could be explained.

    Attributes:
        suspects: faults that may be behind what is left, the likeliest first.
        factor: root of chi² per pixel, before a fault was taken off.
        mended: whether all else is told of frames without the likeliest fault, and explained.
    """

    image: DieImage
    taken: tuple[Taken, ...]
    fit: Fit
    left_out: LeftOut
    suspects: tuple[Suspect, ...]
    cause: Cause | None
    factor: float
    mended: bool = False

    @property
    def most(self) -> float:
        """The most of it that noise allows."""
        return math.sqrt(most_noise(self.fit))

    def width(self, *kinds: str) -> tuple[str, float, float] | None:
        """Name and full width of what smooths the picture, of a bell at half its height, and its standard error."""
        for name, variance in self.fit.setting.bench:
            if name in kinds and variance:
                width = FULL[name] * math.sqrt(variance)
                return name, width, width * self.fit.errors[name] / (2 * variance)
        return None


def explained(
    image: DieImage,
    taken: Sequence[Taken],
    fit: Fit,
    progress: Progress = silent,
    *,
    electrons_per_count: float = 1.0,
) -> Explanation:
    """The best explanation of frames by a die, its lens, a light of some width, another lamp, dust and drift.

    Where a fault of one pattern is behind what is left, all else is told of frames without it.
    """
    told = _explained(image, taken, fit, progress, electrons_per_count)
    if told.cause is None:
        return told
    # Of a fit that has not yet made a lens's errors of it, a fault is told better.
    early = suspects_of(image, taken, fit, electrons_per_count)
    suspects = max((early, list(told.suspects)), key=lambda each: each[0].share if each else 0.0)
    fault = suspects[0] if suspects else None
    if fault is None or fault.gain < NAMED or not fault.explains:
        return told
    told = replace(told, suspects=tuple(suspects), cause=fault.cause)
    if not fault.effect:
        return told
    taken = expecting(image, fault.taken_off(taken), fit.setting)
    start = fitted(image, taken, _fresh(fit.setting), progress)
    # What a fault did to short exposures had been taken for a light that drifts.
    taken, start = _with_gains(image, expecting(image, taken, start.setting), start, progress)
    again = _explained(image, taken, start, progress, electrons_per_count)
    return replace(again, suspects=told.suspects, cause=told.cause, factor=told.factor, mended=again.cause is None)


def _explained(
    image: DieImage, taken: Sequence[Taken], fit: Fit, progress: Progress, electrons_per_count: float
) -> Explanation:
    whole, taken, left_out = tuple(taken), tuple(taken), LeftOut.none(taken)
    for turn in range(2):
        # What is left out is told anew: a fit that was off may have made it of what it did not know.
        whole = expecting(image, whole, fit.setting)
        lone = _lone(whole, fit)
        taken, fit, found = _without(image, whole, taken, fit, replace(lone, dust=left_out.dust), left_out, progress)
        lit = False
        if not turn or fit.chi2 / fit.freedom > most_noise(fit):
            image, taken, fit, lit = _with_lamp(image, taken, fit, progress)
        if not turn and not lit:
            # Before dust: what a light that is no point or a die off the axis leaves is dark in places, too.
            taken, fit = _with_bench(image, taken, fit, progress)
        whole = expecting(image, whole, fit.setting)
        now = replace(lone, dust=_dark(lone.taken_from(whole), fit))
        taken, fit, shaded = _without(image, whole, taken, fit, now, replace(lone, dust=left_out.dust), progress)
        left_out = now
        if lit or shaded or (turn and found):
            taken, fit = _with_bench(image, taken, fit, progress)
        elif turn:
            break
        if fit.setting.lamp is not None and not _is_lamp(fit, math.inf, _LEAST_APART_PX * image.camera.pixel_um):
            fit = fitted(image, taken, replace(_fresh(fit.setting), lamp=None), progress)
    taken, fit = _with_gains(image, taken, fit, progress)
    suspects = tuple(suspects_of(image, taken, fit, electrons_per_count))
    cause = _left(image, taken, fit, suspects)
    fit, factor = with_frames(image, taken, fit), math.sqrt(fit.chi2 / fit.freedom)
    return Explanation(image, taken, fit, left_out, suspects, cause, factor)


def _with_bench(
    image: DieImage, taken: tuple[Taken, ...], fit: Fit, progress: Progress
) -> tuple[tuple[Taken, ...], Fit]:
    """The fit with bench and lens, and the noise that it lets expect."""
    taken = expecting(image, taken, fit.setting)
    fit = with_bench_and_terms(image, taken, fitted(image, taken, fit.setting, progress), progress)
    return taken, fit


def _without(
    image: DieImage,
    whole: tuple[Taken, ...],
    taken: tuple[Taken, ...],
    fit: Fit,
    now: LeftOut,
    before: LeftOut,
    progress: Progress,
) -> tuple[tuple[Taken, ...], Fit, bool]:
    """Frames without some pixels and their fit, where other ones than before are left out; and whether they are."""
    if now.alike(before):
        return taken, fit, False
    taken = now.taken_from(whole)
    return taken, fitted(image, taken, _fresh(fit.setting), progress), True


def _fresh(setting: Setting) -> Setting:
    """A setting that knows of places and focus alone: the rest may be the doing of what is now left out."""
    terms = tuple(pair for pair in setting.terms if pair[0] in FIRST_TERMS)
    return Setting(setting.x_um, setting.y_um, terms=terms, lamp=setting.lamp, bench=setting.bench)


def _with_lamp(
    image: DieImage, taken: tuple[Taken, ...], fit: Fit, progress: Progress
) -> tuple[DieImage, tuple[Taken, ...], Fit, bool]:
    """The fit with another lamp, if one explains more than the lens's errors together; and whether it does."""
    if fit.setting.lamp is not None:
        return image, taken, fit, False
    lamp, gain = _lamp(image, taken, fit)
    noise, left_over = max(1.0, fit.chi2 / fit.freedom), fit.chi2 - fit.freedom
    if lamp is None or gain < max(_LAMP_GAIN * noise, _LAMP_SHARE * left_over):
        return image, taken, fit, False
    likelier = max((each.gain for each in suspects_of(image, taken, fit, 1.0) if each.one_value), default=0.0)
    if gain < max(gain_of_others(image, taken, fit), likelier):
        return image, taken, fit, False
    off_um = max(abs(lamp.x_um), abs(lamp.y_um)) + _NEAREST_PX * image.camera.pixel_um
    wide = DieImage.of(image.panel, image.way_round, image.camera, image.light, image.pixels, off_um)
    with_lamp = fitted(wide, taken, replace(_fresh(fit.setting), lamp=lamp), progress)
    if with_lamp.chi2 > fit.chi2 - _LAMP_GAIN or not _is_lamp(
        with_lamp, off_um, _LEAST_APART_PX * image.camera.pixel_um
    ):
        return image, taken, fit, False
    taken = expecting(wide, taken, with_lamp.setting)
    return wide, taken, judged(taken, wide.pictures(with_lamp.setting), with_lamp.setting), True


def _is_lamp(fit: Fit, off_um: float, apart_um: float) -> bool:
    """Whether a lamp has light, less than the first, and has stayed where it can be pictured, apart from that."""
    lamp = fit.setting.lamp
    if lamp is None or not 0 < lamp.share < 1 or max(abs(lamp.x_um), abs(lamp.y_um)) > off_um:
        return False
    return math.hypot(lamp.x_um, lamp.y_um) > apart_um and lamp.share > _SEEN * fit.errors["lamp_share"]


def _lamp(image: DieImage, taken: Sequence[Taken], fit: Fit) -> tuple[Lamp | None, float]:
    """The place and power of another lamp to about a pixel, and the fall of chi² that it brings."""
    shape = taken[0].valid.shape
    if any(capture.valid.shape != shape for capture in taken):
        return None, 0.0
    steps = [abs(float(capture.pixels.x_um[1] - capture.pixels.x_um[0])) for capture in taken]
    beyond = [math.ceil(_BEYOND_PX * image.camera.pixel_um / step) for step in steps]
    wide = [_widened(capture.pixels, more) for capture, more in zip(taken, beyond, strict=True)]
    pictures = image.on(wide).pictures(replace(fit.setting, lamp=None))
    alike, power = np.zeros(()), np.zeros(())
    for k, capture in enumerate(taken):
        light = fit.light[capture.pixels.colour]
        weights = np.where(capture.valid, capture.sigma**-2.0, 0.0)
        rest = np.where(capture.valid, capture.light - fit.predicted[k], 0.0) * weights
        # Moved pictures are those of the window's pixels, so both sums are correlations.
        alike = alike + light * scipy.signal.correlate(pictures[k], rest, "valid", "fft")
        power = power + light**2 * scipy.signal.correlate(pictures[k] ** 2, weights, "valid", "fft")
    gain = np.where((alike > 0) & (power > 0), alike**2 / np.maximum(power, 1e-300), 0.0)
    middle = [(side - 1) // 2 for side in gain.shape]
    rows, columns = (np.arange(side) - at for side, at in zip(gain.shape, middle, strict=True))
    gain[np.hypot(rows[:, None], columns) * steps[0] < _NEAREST_PX * image.camera.pixel_um] = 0
    row, column = np.unravel_index(int(gain.argmax()), gain.shape)
    # The picture at an index is that moved the other way; rows run downwards.
    x_um, y_um = -steps[0] * float(columns[column]), steps[0] * float(rows[row])
    return Lamp(x_um, y_um, float(alike[row, column] / power[row, column])), float(gain[row, column])


def _widened(pixels: Pixels, beyond: int) -> Pixels:
    """A grid of pixels that goes on to either side by its own length and some more."""

    def longer(axis: Floats) -> Floats:
        more = axis.size // 2 + beyond
        return np.asarray(axis[0] + (axis[1] - axis[0]) * np.arange(-more, axis.size + more))

    return Pixels(pixels.colour, longer(pixels.x_um), longer(pixels.y_um))


def _lone(taken: Sequence[Taken], fit: Fit) -> LeftOut:
    """Pixels that alone are off the fit, as hot and dead ones are; a lamp shows in many together, and so does dust."""
    hot, dead = [], []
    for capture, predicted in zip(taken, fit.predicted, strict=True):
        above = np.where(capture.valid, capture.light - predicted, 0.0)
        beyond = alone(above, capture.sigma, capture.valid) & (predicted < CORE * predicted.max())
        hot.append(beyond & (above > 0))
        dead.append(beyond & (above < -NEARLY_DARK * predicted))
    return replace(LeftOut.none(taken), hot=tuple(hot), dead=tuple(dead))


def _dark(taken: Sequence[Taken], fit: Fit, core: float = CORE) -> tuple[Mask, ...]:
    """Pixels that are darker than the fit beyond any noise, with their neighbours; none if they are too many."""
    masks = []
    for capture, predicted in zip(taken, fit.predicted, strict=True):
        residual = np.where(capture.valid, (capture.light - predicted) / capture.sigma, 0.0)
        seen = residual[capture.valid]
        spread = max(1.0, SIGMA_OF_MAD * float(np.median(abs(seen - np.median(seen)))))
        open_to = capture.valid & (predicted < core * predicted.max())
        # Thin dust shows in nine pixels together where it does not in any of them.
        box, count = (ndimage.uniform_filter(each, 3) * 9 for each in (residual, capture.valid.astype(np.float64)))
        together = box / np.sqrt(np.maximum(count, 1.0))
        dark = open_to & (np.minimum(residual, together) < -_DARK * spread)
        masks.append(np.asarray(ndimage.binary_dilation(dark, np.ones((3, 3))) & open_to))
    share = sum(int(mask.sum()) for mask in masks) / sum(int(capture.valid.sum()) for capture in taken)
    return tuple(masks) if share <= _MOST_DUST else tuple(np.zeros_like(mask) for mask in masks)


def _with_gains(
    image: DieImage, taken: tuple[Taken, ...], fit: Fit, progress: Progress
) -> tuple[tuple[Taken, ...], Fit]:
    """Frames merged again by gains that the fit tells, and the fit whose errors know of theirs."""
    first = frame_gains(image, taken, fit)
    if first is None:
        return taken, fit
    taken = tuple(capture.rescaled(first.factors) for capture in taken)
    setting = fit.setting.at(fit.setting.values + first.step)
    taken = expecting(image, taken, setting)
    fit = fitted(image, taken, setting, progress)
    last = frame_gains(image, taken, fit)
    if last is not None:
        fit = replace(fit, covariance=last.covariance)
    return taken, fit


def _left(image: DieImage, taken: Sequence[Taken], fit: Fit, suspects: Sequence[Suspect]) -> Cause | None:
    """Cause of what a fit leaves, None where it is noise."""
    misfit = fit.chi2 / fit.freedom
    first = suspects[0] if suspects else None
    # Pixels that differ by no more than noise bend no width.
    harmless = first is not None and first.cause is Cause.RESPONSE and misfit <= most_noise(fit)
    if first is not None and first.gain >= NAMED and first.explains and not harmless:
        return first.cause
    if misfit > most_noise(fit):
        # Beside the peak a lens that is wrong may look like dust, so such pixels are not left out.
        if holds_most(fit, _dark(taken, fit, math.inf)):
            return Cause.DUST
        # What is left of a picture of another kind is like the die's own, moved, for a small part only.
        like_another = _lamp(image, taken, fit)[1] > _MOST_OF_IT * (fit.chi2 - fit.freedom)
        return Cause.LAMP if like_another else Cause.UNKNOWN
    if _unlike_frames(taken, fit):
        return Cause.DRIFT
    return Cause.NOISE if misfit < _LEAST_NOISE else None


def _unlike_frames(taken: Sequence[Taken], fit: Fit) -> bool:
    """Whether any exposure is another picture than all of them together, in which the longest counts most."""
    planes = [capture.plane for capture in taken if capture.plane is not None]
    if len(planes) < len(taken) or len(planes[0].scales) < 2:
        return False
    for place, scale in enumerate(planes[0].scales.tolist()):
        chi2, count = 0.0, 0
        for capture, plane, predicted in zip(taken, planes, fit.predicted, strict=True):
            clear = capture.valid & plane.exposed.usable[place]
            expected = scale * plane.share[clear] * predicted[clear]
            off = plane.exposed.electrons[place][clear] - expected
            chi2 += float(np.sum(off**2 / (np.maximum(expected, 0.0) + plane.exposed.dark[place])))
            count += int(clear.sum())
        # Of few electrons squares scatter more than those of normal noise.
        if count and chi2 / count > max(1.0, fit.chi2 / fit.freedom) + NOISE_KNOWN + LIKELY * math.sqrt(3 / count):
            return True
    return False


def holds_most(fit: Fit, masks: Sequence[Mask]) -> bool:
    """Whether most of what a fit leaves over lies at some pixels of its grids."""
    parts = zip(fit.residuals, masks, strict=True)
    over = sum(float(np.sum(residual[mask] ** 2) - mask.sum()) for residual, mask in parts)
    return over > _MOST_OF_IT * (fit.chi2 - fit.freedom) > 0
