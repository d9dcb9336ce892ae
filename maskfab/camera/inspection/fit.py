"""A die's stand and what its writer did to it, from a picture of a point light behind it: estimates and their errors.

Captured light is taken as pixels in micrometres about the light, and their noise. Weighted least squares go by
Gauss-Newton steps, damped where one would not better the fit. The light of each colour and what lies beneath it are
solved for beside all else. Errors are those of Fisher's information, inflated by the root of chi² per pixel where the
model falls short of the noise.

What exposures of a stack show among themselves their merged picture's noise does not know: a light that moves between
two exposures, or a focus that drifts, leaves a merged picture that belongs to no setting. Each exposure is therefore
asked for a setting of its own, by one Gauss-Newton step from that of all:

    d_k = I_k⁻¹ g_k,     g_k = Jᵀ (y_k - a_k m) a_k / v_k,     I_k = Jᵀ J a_k² / v_k,     Σ I_k = I,

y_k the electrons of exposure k, m the fitted light, a_k the time, v_k the variance that the model lets expect. Where
the d_k of a value scatter by more than their noise I_k⁻¹, there is a variance τ² between exposures; the most likely
one, the mean being unknown (H. D. Patterson, R. Thompson, Biometrika 58 (1971) 545), is taken. The fit, which moves by
I⁻¹ Σ I_k d_k, then errs beside Fisher's I⁻¹ by

    I⁻¹ (Σ I_k τ² I_k) I⁻¹.

The MTF of the picture stands beside that of the picture that is expected, with the band that noise allows. Both are
taken of the same pixels in the same window, sampled as the sensor samples, so that window, aliasing and noise are in
both alike: what differs is the die, the lens, or the model of them.

Notes:
    Frames drawn anew, the usual bootstrap, would state the errors of another measurement: the exposures of a stack hold
    very different parts of the information, and every third draw of five lacks the longest. Of equal exposures both
    tell the same.
    Lights and backgrounds are values like any other, so a lamp that drifts counts where it bends the picture.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
import scipy.special

from maskfab.base.arrays import Floats, Indices, Mask
from maskfab.base.units import UM_PER_MM
from maskfab.base.work import Progress, silent
from maskfab.camera.frames.merge import Merged, Plane
from maskfab.camera.inspection.die_image import DEFOCUS, DieImage, Pixels, Setting
from maskfab.camera.scores import NORMAL_95

_NEAR = 3


@dataclass(frozen=True, eq=False)
class Taken:
    """Signal of the pixels of one grid, with its noise.

    Attributes:
        light: their signal, [rows, columns], in any one unit of light.
        plane: that knows the noise of other light than was measured; None where sigma is the truth.
    """

    pixels: Pixels
    light: Floats
    sigma: Floats
    valid: Mask
    plane: Plane | None = None

    def expecting(self, light: Floats) -> Taken:
        """This signal with the noise of a model's light, and what that leaves clear of full.

        Noise of what was measured favours what came out dark, and so does what was measured of full pixels.
        """
        if self.plane is None:
            return self
        plane = self.plane.expecting(light)
        sigma = np.where(plane.valid, np.sqrt(plane.variance(light)), np.inf)
        return replace(self._merged(plane), sigma=np.asarray(sigma))

    def without(self, left_out: Mask) -> Taken:
        """This signal without some pixels."""
        valid = self.valid & ~left_out
        plane = self.plane and replace(self.plane, valid=valid)
        return replace(self, valid=valid, sigma=np.where(valid, self.sigma, np.inf), plane=plane)

    def rescaled(self, gains: Floats) -> Taken:
        """This signal of exposures whose times, [frames], are longer by factors."""
        if self.plane is None:
            return self
        return self._merged(self.plane.rescaled(self.plane.scales * gains))

    def _merged(self, plane: Plane) -> Taken:
        return replace(self, light=plane.electrons_per_s, sigma=plane.sigma, valid=plane.valid, plane=plane)

    def within(self, half_um: float) -> Taken:
        """The pixels that lie no farther than so from the middle along both axes."""
        columns, rows = (abs(axis) <= half_um for axis in (self.pixels.x_um, self.pixels.y_um))
        held = np.ix_(rows, columns)
        pixels = Pixels(self.pixels.colour, self.pixels.x_um[columns], self.pixels.y_um[rows])
        return Taken(pixels, self.light[held], self.sigma[held], self.valid[held])


def taken_of(merged: Merged, pixel_um: float, middle: tuple[float, float]) -> tuple[Taken, ...]:
    """Every colour of merged exposures, seen from a place among their pixels."""
    taken = []
    for plane in merged.planes:
        rows, columns = plane.electrons_per_s.shape
        row = plane.first[0] + plane.step * np.arange(rows) - middle[0]
        column = plane.first[1] + plane.step * np.arange(columns) - middle[1]
        pixels = Pixels(plane.colour, np.asarray(pixel_um * column), np.asarray(-pixel_um * row))
        taken.append(Taken(pixels, plane.electrons_per_s, plane.sigma, plane.valid, plane))
    return tuple(taken)


def brightest(planes: Sequence[Plane]) -> tuple[float, float]:
    """Row and column of the centre of the light, to about a pixel: that of what is above half of the peak's height."""
    best: tuple[float, tuple[float, float]] = (-np.inf, (0.0, 0.0))
    for plane in planes:
        light = np.where(plane.valid, plane.electrons_per_s, 0.0)
        row, column = np.unravel_index(int(light.argmax()), light.shape)
        peak = float(light[row, column])
        if peak > best[0]:
            top, left = max(0, int(row) - _NEAR), max(0, int(column) - _NEAR)
            near = light[top : int(row) + _NEAR + 1, left : int(column) + _NEAR + 1]
            weights = np.where(near >= peak / 2, near, 0.0)
            rows, columns = np.indices(weights.shape)
            total = weights.sum()
            place = (
                plane.first[0] + plane.step * (top + float((weights * rows).sum() / total)),
                plane.first[1] + plane.step * (left + float((weights * columns).sum() / total)),
            )
            best = (peak, place)
    return best[1]


def colours_of(taken: Sequence[Taken]) -> tuple[str, ...]:
    """Colours of the pixels, each once, sorted."""
    return tuple(sorted({capture.pixels.colour for capture in taken}))


_MOST_STEPS = 15
_SETTLED = 0.02
"""Share of its standard error by which no value moves any more in a fit that is done."""
_CURVED = 5.0
"""Standard errors by which a value must move for slopes to be made anew: within them they are straight."""
_FIT_NEAR = 0.5
"""Standard errors from where slopes were made within which a fit may end: beyond, they lead a little beside it."""
_WORTH = 0.5
"""Gain in chi² below which no smaller step is tried where one failed: a symmetric die in focus has no slope with
defocus, and steps along it fail for ever."""
_FIRST_DAMPING, _HARDER, _EASIER, _LEAST_DAMPING, _HOPELESS = 1e-3, 10.0, 0.1, 1e-6, 1e6
FIRST_TERMS = (DEFOCUS,)
_MORE_TERMS = tuple(range(5, 22))
"""Noll's numbers of what may be wrong with a lens beside defocus, to the fifth order along the radius."""
_PRICE = 2 * math.log(len(_MORE_TERMS))
"""Gain in chi² that a term must bring: the risk inflation criterion (D. P. Foster and E. I. George, Ann. Stat. 22,
1947, 1994), which allows for the best of so many candidates looking good by chance."""
_ROUNDS = 2
_NOISE_ROUNDS = 3
"""Noise of measured light makes lights too dim, and the noise that is expected of them too small."""
_COUNTS = 0.02
"""Share of the noise's variance from which scatter between exposures is worth telling."""


@dataclass(frozen=True, eq=False)
class Fit:
    """A die's setting as a camera saw it.

    Attributes:
        covariance: of its values, float64 [n, n], for the noise alone.
        light: of every colour, in the unit of the signal: what a sensor without ends would take.
        residuals: of every grid of pixels, in standard deviations, 0 where a pixel does not count.
        predicted: of every grid, in the unit of the signal.
        between: [n, n] what the scatter from exposure to exposure adds to the covariance; None where it is not known.
    """

    setting: Setting
    covariance: Floats
    light: dict[str, float]
    beneath: dict[str, float]
    chi2: float
    freedom: int
    residuals: tuple[Floats, ...]
    predicted: tuple[Floats, ...]
    steps: int
    between: Floats | None = None

    @property
    def inflation(self) -> float:
        """Factor on the noise's standard errors: the root of chi² per degree of freedom, where that is above 1."""
        return math.sqrt(max(1.0, self.chi2 / self.freedom))

    @property
    def errors(self) -> dict[str, float]:
        """Standard error of every value: of inflated noise, and of what differs from exposure to exposure."""
        variance = self.inflation**2 * np.diag(self.covariance)
        errors = np.sqrt(variance if self.between is None else variance + np.diag(self.between))
        return dict(zip(self.setting.names, errors.tolist(), strict=True))

    def scatters(self, name: str) -> bool:
        """Whether exposures tell a value so differently that its error is larger by a hundredth or more."""
        at = self.setting.names.index(name)
        noise = self.inflation**2 * self.covariance[at, at]
        return self.between is not None and bool(self.between[at, at] > _COUNTS * noise)


def fitted(image: DieImage, taken: Sequence[Taken], start: Setting, progress: Progress = silent) -> Fit:
    """The best setting that is downhill from a start, which has every term to be fit, 0 where nothing is known."""
    pictures = image.pictures(start)
    here, damping, since, slopes = judged(taken, pictures, start), _FIRST_DAMPING, math.inf, []
    for step in range(1, _MOST_STEPS + 1):
        progress("fit", step, _MOST_STEPS)
        noise = math.sqrt(max(1.0, here.chi2 / here.freedom))
        if since > _CURVED * noise:
            slopes, since, damping = image.slopes(start), 0.0, min(damping, _FIRST_DAMPING)
        now = normal_equations(taken, pictures, slopes)
        if now.sigma_distance(now.covariance @ now.gradient) < _SETTLED * noise:
            if since <= _FIT_NEAR * noise:
                break
            since = math.inf
            continue
        # A value that changes nothing, as the place of a lamp without light, has no information.
        diagonal = np.diag(np.maximum(np.diag(now.information), 1e-300))
        change = np.asarray(np.linalg.solve(now.information + damping * diagonal, now.gradient))
        tried = start.at(start.values + change)
        seen = image.pictures(tried)
        there = judged(taken, seen, tried)
        if there.chi2 <= here.chi2:
            start, here, pictures, damping = tried, there, seen, max(_LEAST_DAMPING, damping * _EASIER)
            since += now.sigma_distance(change)
        elif since > 0:
            since = math.inf
        elif damping < _HOPELESS and now.gain(range(start.values.size)) > _WORTH * noise**2:
            damping *= _HARDER
        else:
            break
    progress("fit", _MOST_STEPS, _MOST_STEPS)
    return replace(here, covariance=normal_equations(taken, pictures, slopes).covariance, steps=step)


def with_terms(image: DieImage, taken: Sequence[Taken], fit: Fit, progress: Progress = silent) -> Fit:
    """The fit with more of the lens's errors, each of which brings the residuals nearer to the noise than chance would.

    Which they are is told from slopes at the fit that is given, and once more where those led.
    """
    for _ in range(_ROUNDS):
        wanted = _demanded(image, taken, fit)
        if not wanted:
            break
        terms = (*fit.setting.terms, *((term, 0.0) for term in wanted))
        fit = fitted(image, taken, replace(fit.setting, terms=terms), progress)
    return _drop_insignificant(image, taken, fit, progress)


def _drop_insignificant(image: DieImage, taken: Sequence[Taken], fit: Fit, progress: Progress) -> Fit:
    """The fit without terms that, once all are fit, do not bring their price: far away slopes ask for many."""
    price = _PRICE * max(1.0, fit.chi2 / fit.freedom)
    worth = {f"z{term}" for term in FIRST_TERMS}
    worth |= {
        name
        for name, value, variance in zip(fit.setting.names, fit.setting.values, np.diag(fit.covariance), strict=True)
        if value**2 > price * variance
    }
    terms = tuple(term for term in fit.setting.terms if f"z{term[0]}" in worth)
    dropped = len(fit.setting.terms) - len(terms)
    if not dropped:
        return fit
    fewer = fitted(image, taken, replace(fit.setting, terms=terms), progress)
    return fewer if fewer.chi2 - fit.chi2 < price * dropped else fit


LIKELY = 5.0
"""Standard deviations by which a measure of noise may be off by chance."""
NOISE_KNOWN = 0.03


def most_noise(fit: Fit) -> float:
    """The most that chi² per pixel is where noise alone is left; noise is known no better than gain is."""
    return 1 + NOISE_KNOWN + LIKELY * math.sqrt(2 / fit.freedom)


def with_lacking_terms(at: Setting) -> Setting:
    """A setting with all of the lens's errors, 0 where it says nothing of them."""
    present = {term for term, _ in at.terms}
    return replace(at, terms=(*at.terms, *((term, 0.0) for term in _MORE_TERMS if term not in present)))


def _demanded(image: DieImage, taken: Sequence[Taken], fit: Fit) -> list[int]:
    """Terms that a fit lacks, the one that brings most first."""
    at = with_lacking_terms(fit.setting)
    now = normal_equations(taken, image.pictures(at), image.slopes(at))
    old = fit.setting.values.size
    asked = [term for term, _ in at.terms[len(fit.setting.terms) :]]
    held, left = list(range(old)), list(range(old, at.values.size))
    noise = max(1.0, (fit.chi2 - now.gain([*held, *left])) / fit.freedom)
    chosen: list[int] = []
    while left:
        gains = [now.gain([*held, term]) for term in left]
        best = int(np.argmax(gains))
        if gains[best] - now.gain(held) < _PRICE * noise:
            break
        held.append(left.pop(best))
        chosen.append(asked[held[-1] - old])
    return chosen


@dataclass(frozen=True, eq=False)
class NormalEquations:
    """The equations of a step, light and background solved for: half of chi²'s slope downhill, Fisher's information."""

    gradient: Floats
    information: Floats

    @cached_property
    def covariance(self) -> Floats:
        return np.asarray(np.linalg.pinv(self.information, hermitian=True), dtype=np.float64)

    def gain(self, values: Sequence[int]) -> float:
        """Fall of chi² if only these values are moved."""
        part = np.ix_(values, values)
        gradient = self.gradient[np.asarray(values)]
        return float(gradient @ np.linalg.pinv(self.information[part], hermitian=True) @ gradient)

    def sigma_distance(self, change: Floats) -> float:
        """The largest change of a value, in its standard errors."""
        errors = np.sqrt(np.diag(self.covariance))
        return float(np.max(np.divide(abs(change), errors, out=np.zeros_like(errors), where=errors > 0)))


def normal_equations(
    taken: Sequence[Taken], pictures: Sequence[Floats], slopes: Sequence[Sequence[Floats]]
) -> NormalEquations:
    """The equations of a step from pictures along slopes, [values][grids of pixels]."""
    size = len(slopes)
    gradient, information = np.zeros(size), np.zeros((size, size))
    for colour in colours_of(taken):
        mine, signal, base, solution = _solved(taken, pictures, colour)
        light = float(solution[0])
        rest = signal - base @ solution
        columns = np.stack([light * _weighed(taken, mine, slope) for slope in slopes], axis=1)
        columns -= base @ np.linalg.lstsq(base, columns, rcond=None)[0]
        gradient += columns.T @ rest
        information += columns.T @ columns
    return NormalEquations(gradient, information)


def judged(taken: Sequence[Taken], pictures: Sequence[Floats], at: Setting) -> Fit:
    """Chi² of pictures, light and background solved for; nothing is told of the setting's errors."""
    light, beneath, residuals, predicted = {}, {}, [np.zeros(0)] * len(taken), [np.zeros(0)] * len(taken)
    chi2, count = 0.0, 0
    for colour in colours_of(taken):
        mine, signal, base, solution = _solved(taken, pictures, colour)
        light[colour], beneath[colour] = map(float, solution)
        chi2 += float(np.sum((signal - base @ solution) ** 2))
        count += signal.size - 2
        for k in mine:
            predicted[k] = solution[0] * pictures[k] + solution[1]
            residuals[k] = np.where(taken[k].valid, (taken[k].light - predicted[k]) / taken[k].sigma, 0.0)
    size = at.values.size
    return Fit(at, np.zeros((size, size)), light, beneath, chi2, count - size, tuple(residuals), tuple(predicted), 0)


def _solved(
    taken: Sequence[Taken], pictures: Sequence[Floats], colour: str
) -> tuple[list[int], Floats, Floats, Floats]:
    """A colour's light and what lies beneath it: places of its grids, weighed signal, base [pixels, 2], and both."""
    mine = [k for k, capture in enumerate(taken) if capture.pixels.colour == colour]
    signal = _weighed(taken, mine, [capture.light for capture in taken])
    ones = _weighed(taken, mine, [np.ones(capture.light.shape) for capture in taken])
    base = np.stack([_weighed(taken, mine, pictures), ones], axis=1)
    return mine, signal, base, np.asarray(np.linalg.lstsq(base, signal, rcond=None)[0], dtype=np.float64)


def _weighed(taken: Sequence[Taken], mine: Sequence[int], pictures: Sequence[Floats]) -> Floats:
    """Values of the pixels of some grids that count, each over its standard deviation."""
    inverse = 1 / np.concatenate([taken[k].sigma[taken[k].valid] for k in mine])
    return np.asarray(inverse * np.concatenate([pictures[k][taken[k].valid] for k in mine]))


def expecting(image: DieImage, taken: Sequence[Taken], at: Setting) -> tuple[Taken, ...]:
    """Pixels with the noise of the light that a setting lets expect, in place of that of what was measured."""
    pictures = image.pictures(at)
    for _ in range(_NOISE_ROUNDS):
        expected = judged(taken, pictures, at).predicted
        taken = [capture.expecting(light) for capture, light in zip(taken, expected, strict=True)]
    return tuple(taken)


LEAST_FRAMES = 3
_PROVEN = 2.71
"""Twice the logarithm of the odds from which scatter is more than noise, which comes about in one of twenty values."""
_FINEST, _TRIED = 1e-2, 100
"""Least variance that is tried, in that of the noise of the best exposure, and how many up to the most."""
_LEAST_FREEDOM = 2.0
"""Degrees of freedom below which Student's quantiles would say that nothing is known."""
_RIDGE = 1e-9
"""Share of all information that is lent to each exposure, so that one which tells nothing is merely weak."""


def with_frames(image: DieImage, taken: Sequence[Taken], fit: Fit) -> Fit:
    """The fit with the scatter between exposures in its errors, where there are three or more."""
    frames = [frame for frame in _frames(image, taken, fit) if frame.information.any()]
    if len(frames) < LEAST_FRAMES:
        return fit
    size = fit.setting.values.size
    return replace(fit, between=_between(frames, fit.inflation)[:size, :size])


@dataclass(frozen=True, eq=False)
class Gains:
    """Light of each exposure over what its time says, told together with the setting.

    Attributes:
        step: [values] by which the setting moves.
        covariance: [values, values] of the setting, these gains not being known.
        factors: [frames] 1 where light and time agree, and of what tells nothing; of the most light, 1 in the mean.
        errors: [frames] one standard error of each, for the noise alone.
    """

    step: Floats
    covariance: Floats
    factors: Floats
    errors: Floats


def frame_gains(image: DieImage, taken: Sequence[Taken], fit: Fit) -> Gains | None:
    """A gain for each exposure, fitted beside all else by one step; None of a single one.

    Along the direction in which a frame's own light grows nothing is asked of it: its information is that of the rest.
    """
    frames, size, colours = _frames(image, taken, fit), fit.setting.values.size, colours_of(taken)
    along = np.zeros(size + 2 * len(colours))
    along[size:] = [value for colour in colours for value in (fit.light[colour], fit.beneath[colour])]
    told = [frame.information @ along for frame in frames]
    bends = [float(along @ each) for each in told]
    if sum(bend > 0 for bend in bends) < 2:
        return None
    gradient, information = np.zeros(along.size), np.zeros((along.size, along.size))
    for frame, each, bend in zip(frames, told, bends, strict=True):
        if bend > 0:
            gradient += frame.gradient - each * float(along @ frame.gradient) / bend
            information += frame.information - np.outer(each, each) / bend
    unit = 1 / np.sqrt(np.diag(sum(frame.information for frame in frames)))
    covariance = unit[:, None] * np.linalg.pinv(unit[:, None] * information * unit, 1e-12, hermitian=True) * unit
    step = covariance @ gradient
    factors, errors = np.ones(len(frames)), np.full(len(frames), np.inf)
    for place, (frame, each, bend) in enumerate(zip(frames, told, bends, strict=True)):
        if bend > 0:
            factors[place] += float(along @ frame.gradient - each @ step) / bend
            errors[place] = math.sqrt(1 / bend + float(each @ covariance @ each) / bend**2)
    return Gains(step[:size], covariance[:size, :size], factors / factors[int(np.argmax(bends))], errors)


def _frames(image: DieImage, taken: Sequence[Taken], fit: Fit) -> list[NormalEquations]:
    """Every exposure's equations for values and for light and background of each colour; none of what is no stack."""
    planes = [capture.plane for capture in taken if capture.plane is not None]
    if len(planes) < len(taken):
        return []
    slopes, pictures = image.slopes(fit.setting), image.pictures(fit.setting)
    colours, size = colours_of(taken), fit.setting.values.size
    total = size + 2 * len(colours)
    gradients, informations = (np.zeros((len(planes[0].scales), total, *rest)) for rest in ((), (total,)))
    for k, (capture, plane) in enumerate(zip(taken, planes, strict=True)):
        colour = colours.index(capture.pixels.colour)
        own = [*range(size), size + 2 * colour, size + 2 * colour + 1]
        light = fit.light[capture.pixels.colour]
        every = np.stack([*(light * slope[k] for slope in slopes), pictures[k], np.ones(capture.light.shape)], axis=-1)
        exposed = plane.exposed
        for place, scale in enumerate(plane.scales.tolist()):
            clear = capture.valid & exposed.usable[place]
            per_light = scale * plane.share[clear]
            expected = per_light * fit.predicted[k][clear]
            weight = 1 / np.sqrt(np.maximum(expected, 0.0) + exposed.dark[place])
            columns = every[clear] * (weight * per_light)[:, None]
            gradients[place][own] += columns.T @ (weight * (exposed.electrons[place][clear] - expected))
            informations[place][np.ix_(own, own)] += columns.T @ columns
    return [NormalEquations(*pair) for pair in zip(gradients, informations, strict=True)]


def _between(frames: Sequence[NormalEquations], inflation: float) -> Floats:
    """Covariance of the fit by what differs from exposure to exposure."""
    whole = sum(frame.information for frame in frames)
    # Values are of very different size.
    unit = 1 / np.sqrt(np.diag(whole))
    scaled = [unit[:, None] * frame.information * unit for frame in frames]
    covariance = np.linalg.pinv(sum(scaled), hermitian=True)
    lent = _RIDGE * np.eye(unit.size)
    inverses = [np.linalg.inv(precision + lent) for precision in scaled]
    steps = np.stack([inverse @ (unit * frame.gradient) for inverse, frame in zip(inverses, frames, strict=True)])
    noise = inflation**2 * np.stack([np.diag(inverse) for inverse in inverses])
    spread = np.array([_variance_between(steps[:, k], noise[:, k]) for k in range(unit.size)])
    moved = [covariance @ precision for precision in scaled]
    between = sum(move @ (spread[:, None] * move.T) for move in moved)
    return np.asarray(unit[:, None] * between * unit)


def _variance_between(values: Floats, noise: Floats) -> float:
    """Variance of values of their own beside their noise, raised so that 1.96 errors hold 95 %; 0 where not proven."""
    reach = float(np.ptp(values))
    tried = np.concatenate([[0.0], np.geomspace(_FINEST * noise.min(), max(reach**2, noise.min()), _TRIED)])
    weights = 1 / (noise + tried[:, None])
    total = weights.sum(axis=1)
    mean = weights @ values / total
    scatter = np.sum(weights * (values - mean[:, None]) ** 2, axis=1)
    likelihood = np.sum(np.log(weights), axis=1) - np.log(total) - scatter
    best = int(likelihood.argmax())
    if likelihood[best] - likelihood[0] < _PROVEN:
        return 0.0
    freedom = np.sum((tried[best] * weights[best]) ** 2) - 1
    quantile = float(scipy.special.stdtrit(max(_LEAST_FREEDOM, float(freedom)), 0.975))
    return float(tried[best]) * (quantile / NORMAL_95) ** 2


_DRAWS = 200
_CONFIDENCE = 0.95
_PARTED = 4.0
"""Standard deviations of the noise from which two neighbouring rings of frequencies are held to differ."""


@dataclass(frozen=True, eq=False)
class MtfBand:
    """MTF of one grid of pixels, mean and minimum over all directions.

    Attributes:
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
    return tuple(_band(capture, fit, k, random) for k, capture in enumerate(taken))


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


def _rings(shape: tuple[int, ...], step_um: float) -> tuple[Indices, Floats]:
    """Number of the ring of every frequency of a real transform, the last one for all beyond; and their middles."""
    rows, columns = shape
    up, across = np.fft.fftfreq(rows)[:, None], np.fft.rfftfreq(columns)
    radius = np.hypot(up, across).ravel()
    width = 1 / min(rows, columns)
    count = int(0.5 / width)
    number = np.minimum(np.floor(radius / width).astype(np.intp), count)
    middles = np.bincount(number, radius, count + 1)[:count] / np.bincount(number, minlength=count + 1)[:count]
    return number, np.asarray(middles / step_um * UM_PER_MM)
