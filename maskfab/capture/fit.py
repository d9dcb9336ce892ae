"""A die's stand and what its writer did to it, from a picture of a point light behind it: estimates and their errors.

Weighted least squares by Gauss-Newton steps, damped where one would not better the fit. The light of each colour and
what lies beneath it are solved for beside all else. Errors are those of Fisher's information, inflated by the root of
chi² per pixel where the model falls short of the noise; what exposures show among themselves is added to a fit later.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from maskfab.base.arrays import Floats
from maskfab.capture.die_field import DEFOCUS
from maskfab.capture.die_image import DieImage, Setting
from maskfab.capture.taken import Taken, colours_of
from maskfab.progress import Progress, silent

_MOST_STEPS = 30
_SETTLED = 0.02
"""Share of its standard error by which no value moves any more in a fit that is done."""
_CURVED = 5.0
"""Standard errors by which a value must move for slopes to be made anew: within them they are straight."""
_NEAR = 0.5
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
        setting: the estimate.
        covariance: of its values, float64 [n, n], for the noise alone.
        light: of every colour, in the unit of the signal: what a sensor without ends would take.
        beneath: signal of every colour that is there without the light.
        chi2: sum of squared residuals, each over its standard deviation.
        freedom: pixels less all that was solved for.
        residuals: of every grid of pixels, in standard deviations, 0 where a pixel does not count.
        predicted: of every grid, in the unit of the signal.
        steps: that were tried.
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
        found = np.sqrt(variance if self.between is None else variance + np.diag(self.between))
        return dict(zip(self.setting.names, found.tolist(), strict=True))

    def scatters(self, name: str) -> bool:
        """Whether exposures tell a value so differently that its error is larger by a hundredth or more."""
        at = self.setting.names.index(name)
        noise = self.inflation**2 * self.covariance[at, at]
        return self.between is not None and bool(self.between[at, at] > _COUNTS * noise)


def fitted(image: DieImage, taken: Sequence[Taken], start: Setting, progress: Progress = silent) -> Fit:
    """The best setting that is downhill from a start; its terms are the start's.

    Args:
        image: of the die, one way round; its pixels are those of ``taken``.
        taken: what the camera took.
        start: with every term that is to be found, 0 where nothing is known.
        progress: told after every step.
    """
    pictures = image.pictures(start)
    here, damping, since, slopes = judged(taken, pictures, start), _FIRST_DAMPING, math.inf, []
    for step in range(1, _MOST_STEPS + 1):
        progress("fit", step, _MOST_STEPS)
        noise = math.sqrt(max(1.0, here.chi2 / here.freedom))
        if since > _CURVED * noise:
            slopes, since, damping = image.slopes(start), 0.0, min(damping, _FIRST_DAMPING)
        now = normal_equations(taken, pictures, slopes)
        if now.away(now.covariance @ now.gradient) < _SETTLED * noise:
            if since <= _NEAR * noise:
                break
            since = math.inf
            continue
        change = _step(now, damping)
        tried = start.at(start.values + change)
        seen = image.pictures(tried)
        there = judged(taken, seen, tried)
        if there.chi2 <= here.chi2:
            start, here, pictures, damping = tried, there, seen, max(_LEAST_DAMPING, damping * _EASIER)
            since += now.away(change)
        elif since > 0:
            since = math.inf
        elif damping < _HOPELESS and now.gain(range(start.values.size)) > _WORTH * noise**2:
            damping *= _HARDER
        else:
            break
    progress("fit", _MOST_STEPS, _MOST_STEPS)
    return replace(here, covariance=normal_equations(taken, pictures, slopes).covariance, steps=step)


def with_terms(image: DieImage, taken: Sequence[Taken], found: Fit, progress: Progress = silent) -> Fit:
    """The fit with more of the lens's errors, each of which brings the residuals nearer to the noise than chance would.

    Which they are is told from slopes at the fit that is given, and once more where those led.
    """
    for _ in range(_ROUNDS):
        wanted = _demanded(image, taken, found)
        if not wanted:
            break
        terms = (*found.setting.terms, *((term, 0.0) for term in wanted))
        found = fitted(image, taken, replace(found.setting, terms=terms), progress)
    return _without_needless(image, taken, found, progress)


def _without_needless(image: DieImage, taken: Sequence[Taken], found: Fit, progress: Progress) -> Fit:
    """The fit without terms that, once all are found, do not bring their price: far away slopes ask for many."""
    price = _PRICE * max(1.0, found.chi2 / found.freedom)
    worth = {f"z{term}" for term in FIRST_TERMS}
    worth |= {
        name
        for name, value, variance in zip(
            found.setting.names, found.setting.values, np.diag(found.covariance), strict=True
        )
        if value**2 > price * variance
    }
    kept = tuple(each for each in found.setting.terms if f"z{each[0]}" in worth)
    dropped = len(found.setting.terms) - len(kept)
    if not dropped:
        return found
    fewer = fitted(image, taken, replace(found.setting, terms=kept), progress)
    return fewer if fewer.chi2 - found.chi2 < price * dropped else found


def gain_of_terms(image: DieImage, taken: Sequence[Taken], found: Fit) -> float:
    """By how much chi² would fall at most if all of the lens's errors were fitted that a fit lacks."""
    now, asked = _with_all(image, taken, found)
    known = range(found.setting.values.size)
    return now.gain(range(len(known) + len(asked))) - now.gain(known)


def _with_all(image: DieImage, taken: Sequence[Taken], found: Fit) -> tuple[NormalEquations, list[int]]:
    """The equations of a step of a fit together with the terms that it lacks, and those."""
    known = {term for term, _ in found.setting.terms}
    asked = [term for term in _MORE_TERMS if term not in known]
    at = replace(found.setting, terms=(*found.setting.terms, *((term, 0.0) for term in asked)))
    return normal_equations(taken, image.pictures(at), image.slopes(at)), asked


def _demanded(image: DieImage, taken: Sequence[Taken], found: Fit) -> list[int]:
    """Terms that a fit lacks, the one that brings most first."""
    now, asked = _with_all(image, taken, found)
    old = found.setting.values.size
    held, left = list(range(old)), list(range(old, old + len(asked)))
    noise = max(1.0, (found.chi2 - now.gain([*held, *left])) / found.freedom)
    chosen: list[int] = []
    while left:
        gains = [now.gain([*held, each]) for each in left]
        best = int(np.argmax(gains))
        if gains[best] - now.gain(held) < _PRICE * noise:
            break
        held.append(left.pop(best))
        chosen.append(asked[held[-1] - old])
    return chosen


@dataclass(frozen=True, eq=False)
class NormalEquations:
    """The equations of a step: information about values once light and background are solved for.

    Attributes:
        gradient: [values] half of that of chi², downhill.
        information: [values, values] Fisher's.
    """

    gradient: Floats
    information: Floats

    @cached_property
    def covariance(self) -> Floats:
        return np.asarray(np.linalg.pinv(self.information, hermitian=True), dtype=np.float64)

    def gain(self, values: Sequence[int]) -> float:
        """By how much chi² falls if only these values are moved."""
        part = np.ix_(values, values)
        gradient = self.gradient[np.asarray(values)]
        return float(gradient @ np.linalg.pinv(self.information[part], hermitian=True) @ gradient)

    def away(self, change: Floats) -> float:
        """The largest change of a value, in its standard errors."""
        return float(np.max(abs(change) / np.sqrt(np.diag(self.covariance))))


def _step(now: NormalEquations, damping: float) -> Floats:
    diagonal = np.diag(np.diag(now.information))
    return np.asarray(np.linalg.solve(now.information + damping * diagonal, now.gradient))


def normal_equations(
    taken: Sequence[Taken], pictures: Sequence[Floats], slopes: Sequence[Sequence[Floats]]
) -> NormalEquations:
    """The equations of a step from pictures along slopes, [values][grids of pixels]."""
    size = len(slopes)
    gradient, information = np.zeros(size), np.zeros((size, size))
    for colour in colours_of(taken):
        mine = [k for k, each in enumerate(taken) if each.pixels.colour == colour]
        weigh = _Weighed.of([taken[k] for k in mine])
        picture = weigh([pictures[k] for k in mine])
        base = np.stack([picture, weigh.ones], axis=1)
        solution = np.linalg.lstsq(base, weigh.signal, rcond=None)[0]
        light = float(solution[0])
        rest = weigh.signal - base @ solution
        columns = np.stack([light * weigh([slope[k] for k in mine]) for slope in slopes], axis=1)
        columns -= base @ np.linalg.lstsq(base, columns, rcond=None)[0]
        gradient += columns.T @ rest
        information += columns.T @ columns
    return NormalEquations(gradient, information)


def judged(taken: Sequence[Taken], pictures: Sequence[Floats], at: Setting) -> Fit:
    """Chi² of pictures, light and background solved for; nothing is told of the setting's errors."""
    light, beneath, residuals, predicted = {}, {}, [np.zeros(0)] * len(taken), [np.zeros(0)] * len(taken)
    chi2, count = 0.0, 0
    for colour in colours_of(taken):
        mine = [k for k, each in enumerate(taken) if each.pixels.colour == colour]
        weigh = _Weighed.of([taken[k] for k in mine])
        base = np.stack([weigh([pictures[k] for k in mine]), weigh.ones], axis=1)
        found = np.linalg.lstsq(base, weigh.signal, rcond=None)[0]
        light[colour], beneath[colour] = map(float, found)
        chi2 += float(np.sum((weigh.signal - base @ found) ** 2))
        count += weigh.signal.size - 2
        for k in mine:
            predicted[k] = found[0] * pictures[k] + found[1]
            residuals[k] = np.where(taken[k].valid, (taken[k].light - predicted[k]) / taken[k].sigma, 0.0)
    size = at.values.size
    return Fit(at, np.zeros((size, size)), light, beneath, chi2, count - size, tuple(residuals), tuple(predicted), 0)


def expecting(image: DieImage, taken: Sequence[Taken], at: Setting) -> tuple[Taken, ...]:
    """Pixels with the noise of the light that a setting lets expect, in place of that of what was measured."""
    pictures = image.pictures(at)
    for _ in range(_NOISE_ROUNDS):
        expected = judged(taken, pictures, at).predicted
        taken = [each.expecting(light) for each, light in zip(taken, expected, strict=True)]
    return tuple(taken)


@dataclass(frozen=True, eq=False)
class _Weighed:
    """The pixels of a colour that count, each over its standard deviation."""

    valid: tuple[NDArray[np.bool_], ...]
    inverse: Floats
    signal: Floats

    @classmethod
    def of(cls, taken: Sequence[Taken]) -> _Weighed:
        valid = tuple(each.valid for each in taken)
        inverse = 1 / np.concatenate([each.sigma[each.valid] for each in taken])
        return cls(valid, inverse, inverse * np.concatenate([each.light[each.valid] for each in taken]))

    @property
    def ones(self) -> Floats:
        return self.inverse

    def __call__(self, pictures: Sequence[Floats]) -> Floats:
        values = [picture[kept] for picture, kept in zip(pictures, self.valid, strict=True)]
        return np.asarray(self.inverse * np.concatenate(values))
