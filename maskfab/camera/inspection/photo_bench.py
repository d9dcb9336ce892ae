"""A known die and its camera as ordinary photographs tell them: width, focus, turn and scale, together.

A record's power spectrum is S = |H|² P + N, see :mod:`maskfab.camera.panel_spectrum`: P of a scene, smooth, N of noise.
|H|² has the structure of the die, which moves with all that is not known of it. Of squares k of photographs, each with
a scene of its own,

    L(θ) = - Σ_k Σ_ν log S_k + I_k / S_k        (P. Whittle, Ark. Mat. 2, 423, 1953)

is climbed by Fisher's scoring, scenes and noise fitted beside θ: of slopes D = ∂ log S / ∂θ what smooth scenes could do
themselves is projected out, so that

    step = F⁻¹ g,    F = Σ_k Dᵀ D,    g = Σ_k Σ_ν D (I / S - 1).

Scenes are not Gaussian, nor quite smooth, so errors are those of the sandwich F⁻¹ (Σ g gᵀ) F⁻¹ (P. J. Huber, 1967),
g summed over the squares of a photograph, by Student's quantile for as many photographs; never less than F⁻¹, and more
where the log-likelihood is less than photographs of the fitted bench would have.

|H|² of a picture that is turned and stretched is that of the die, read elsewhere. A width moves it little: what writers
keep, :data:`WIDTH_KNOWN_UM`, is told to the fit beforehand, so that it does not run off along what it cannot see.

Notes:
    |H|² of a mask in focus and of one as far before it as behind it are one: of defocus the size alone is told.
    A wider pixel, motion and a soft scene are smooth, and pass for the scene's own.
    The die is taken to stand in the middle of the stop; squares see none of its halo beyond half their side.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np
import scipy
import scipy.special

from maskfab.base.arrays import Floats, Singles
from maskfab.base.work import Progress, silent
from maskfab.camera.inspection.die_image import BIAS, DEFOCUS, DieImage, Pixels, Setting
from maskfab.camera.noise_spectrum import NoiseSpectrum
from maskfab.camera.panel_spectrum import Sample, Seen, warped
from maskfab.camera.scores import NORMAL_95

SIDE = 256
"""Pixels along the side of a square."""
_PSF_SIDE, _LEAST_POWER, _CLEAR = 384, 1e-9, 1.0
WIDTH_KNOWN_UM = 0.5
"""Standard deviation of widths that is told beforehand."""
_MOST_SQUARES = 12
"""Of a photograph."""
_FOCI = (0.0, 0.06, 0.12, 0.2, 0.3, 0.45)
"""Waves of defocus that are tried."""
TURN, SCALE, FOCUS = "turn_rad", "scale", f"z{DEFOCUS}"
_STEPS = {TURN: 1e-3, SCALE: 1e-3, BIAS: 0.1, FOCUS: 0.01}
_FARTHEST = {TURN: 0.02, SCALE: 0.02, BIAS: 0.5, FOCUS: 0.1}
"""Of a value in one step of the fit."""
_ROUNDS, _SETTLED, _LEAST_STEP = 6, 0.1, 0.05


@dataclass(frozen=True, eq=False)
class PhotoBench:
    """A die and its camera as photographs tell them.

    Attributes:
        values: turn, counter-clockwise as it is seen, radians; scale, CD bias in um, and modulus of the defocus in
            waves of the camera's first line.
        errors: half of what holds 95 %, of each value that was fitted.
        gain: log-likelihood over scenes without a panel.
        expected, deviation: of photographs of this very bench.
        squares: that were looked at.
    """

    image: DieImage
    values: dict[str, float]
    errors: dict[str, float]
    gain: float
    expected: float
    deviation: float
    squares: int
    _model: _Model

    def structure(self) -> tuple[Floats, Floats]:
        """Power of green light over that of scenes and noise, and |H|², mean over squares, [SIDE, SIDE / 2 + 1].

        Rows from half a cycle per pixel downwards in the picture to half one upwards; nan where nothing is told.
        """
        total, fitted = (np.zeros((SIDE, SIDE // 2 + 1)) for _ in range(2))
        count = np.zeros(total.shape)
        for sample in (sample for samples in self._model.photographs for sample in samples):
            factor = self._model.factor(sample, self.values)
            scene, dark = sample.parts(factor)
            clear = factor[1] * scene[1] > _CLEAR * dark[1]
            rows, columns = np.rint(sample.y[clear] * SIDE), np.rint(sample.x[clear] * SIDE)
            at = rows.astype(int) + SIDE // 2, columns.astype(int)
            np.add.at(total, at, ((sample.power[1] - dark[1]) / scene[1])[clear])
            np.add.at(fitted, at, factor[1][clear])
            np.add.at(count, at, 1)
        with np.errstate(invalid="ignore"):
            return np.asarray(total / count), np.asarray(fitted / count)

    @property
    def setting(self) -> Setting:
        """The die's stand, the light in the middle."""
        return _setting(self.values)


def _setting(values: Mapping[str, float]) -> Setting:
    terms = ((DEFOCUS, values[FOCUS]),)
    return Setting(turn_rad=values[TURN], scale=values[SCALE], bias_um=values[BIAS], terms=terms)


def squares_of(values: Singles) -> list[Singles]:
    """Squares of a record [3, rows, columns] side by side, those in its middle first, a dozen at most."""
    rows, columns = values.shape[1:]
    places = [
        (top, left)
        for top in range((rows % SIDE) // 2, rows - SIDE + 1, SIDE)
        for left in range((columns % SIDE) // 2, columns - SIDE + 1, SIDE)
    ]
    places.sort(key=lambda place: math.hypot(place[0] - (rows - SIDE) / 2, place[1] - (columns - SIDE) / 2))
    return [values[:, top : top + SIDE, left : left + SIDE] for top, left in places[:_MOST_SQUARES]]


def square_pixels(pixel_um: float) -> list[Pixels]:
    """Pixels about the light, of red, green and blue, on which a PSF is made: more than a square sees of lags."""
    axis = pixel_um * (np.arange(_PSF_SIDE, dtype=np.float64) - _PSF_SIDE // 2)
    return [Pixels(colour, axis, -axis) for colour in "RGB"]


def photo_bench(
    image: DieImage, photographs: Sequence[tuple[Singles, Sequence[NoiseSpectrum]]], progress: Progress = silent
) -> PhotoBench | None:
    """Fit a die and its camera to photographs; None where too little is seen in them.

    Args:
        image: of the die as it stands, on :func:`square_pixels`.
        photographs: records [3, rows, columns] of light, row 0 the top, and the spectra of their noise.
    """
    seen = [[Seen.of(square, noise) for square in squares_of(values)] for values, noise in photographs]
    model = _Model(image, tuple(samples for each in seen if (samples := tuple(one.at for one in each if one.enough))))
    if not model.photographs:
        return None
    best, gain = dict.fromkeys(_STEPS, 0.0), -math.inf
    for done, waves in enumerate(_FOCI):
        progress("foci", done, len(_FOCI))
        tried = dict.fromkeys(_STEPS, 0.0) | {FOCUS: waves}
        if (found := model.gain(tried)) > gain:
            best, gain = tried, found
    for done in range(_ROUNDS):
        progress("fit", done, _ROUNDS)
        step, errors, _ = model.step(best)
        share = min(1.0, *(_FARTHEST[name] / max(abs(by), 1e-12) for name, by in step.items()))
        while share > _LEAST_STEP:
            tried = best | {name: best[name] + share * by for name, by in step.items()}
            if (found := model.gain(tried)) > gain:
                break
            share /= 2
        else:
            break
        best, gain = tried, found
        if max(abs(by) * share / errors[name] for name, by in step.items()) < _SETTLED:
            break
    progress("fit", _ROUNDS, _ROUNDS)
    _, least, scores = model.step(best)
    expected, deviation = model.expected(best)
    values = best | {FOCUS: abs(best[FOCUS])}
    squares, gain = sum(map(len, model.photographs)), model.likelihood(best)
    # Where photographs show less of the die than they would if all else were as it is fitted.
    short = max(1.0, (expected - gain) / deviation)
    errors = {name: short * error for name, error in _errors(least, scores).items()}
    return PhotoBench(image, values, errors, gain, expected, deviation, squares, model)


def _errors(least: Mapping[str, float], scores: Sequence[Mapping[str, float]]) -> dict[str, float]:
    """Halves of what holds 95 %: by how steps that photographs would take alone scatter, Fisher's at least."""
    count = len(scores)
    student = float(scipy.special.stdtrit(max(1, count - 1), 0.975))
    errors = {}
    for name, error in least.items():
        scatter = math.sqrt(sum(each[name] ** 2 for each in scores) * count / max(1, count - 1))
        errors[name] = max(NORMAL_95 * error, student * scatter)
    return errors


def _tapered(psf: Floats) -> Floats:
    """|H|² as a square under Hann's window sees it: of the PSF's lags those that the window has.

    Returns:
        [4 SIDE, 2 SIDE + 1].
    """
    whole = 4 * SIDE
    hann = np.sin(np.pi * np.arange(SIDE) / SIDE) ** 2
    window = np.correlate(hann, hann, "full")
    lags = np.zeros(whole)
    lags[np.arange(1 - SIDE, SIDE)] = window / window.max()
    power = np.square(abs(scipy.fft.rfft2(psf, (whole, whole), workers=1)))
    alike = scipy.fft.irfft2(power, (whole, whole), workers=1) * lags[:, None] * lags
    return np.asarray(scipy.fft.rfft2(alike, workers=1).real)


@dataclass(frozen=True, eq=False)
class _Model:
    """Samples of every photograph's squares, and what a die lets pass."""

    image: DieImage
    photographs: tuple[tuple[Sample, ...], ...]
    _kept: dict[tuple[float, float], Floats] = field(default_factory=dict, repr=False)

    def powers(self, bias_um: float, waves: float) -> Floats:
        """|H|² of the die in its own place as tapered squares see it, [3, 4 SIDE, half]; kept."""
        key = bias_um, waves
        if key not in self._kept:
            while len(self._kept) > len(_STEPS):
                self._kept.pop(next(iter(self._kept)))
            pictures = self.image.pictures(Setting(bias_um=bias_um, terms=((DEFOCUS, waves),)))
            self._kept[key] = np.stack([_tapered(picture / picture.sum()) for picture in pictures])
        return self._kept[key]

    def factor(self, sample: Sample, values: Mapping[str, float]) -> Floats:
        """Share of a scene's power that passes, [3, n]."""
        powers = self.powers(values[BIAS], values[FOCUS])
        at = sample.y, sample.x, 1 / (1 + values[SCALE]), values[TURN]
        return np.asarray(np.maximum(warped(powers, *at), _LEAST_POWER))

    def likelihood(self, values: Mapping[str, float]) -> float:
        """Gain of log-likelihood over scenes without a panel."""
        every = (sample for samples in self.photographs for sample in samples)
        return sum(sample.gain(self.factor(sample, values)) for sample in every)

    def gain(self, values: Mapping[str, float]) -> float:
        """That gain, less what speaks against a width beforehand."""
        return self.likelihood(values) - (values[BIAS] / WIDTH_KNOWN_UM) ** 2 / 2

    def expected(self, values: Mapping[str, float]) -> tuple[float, float]:
        """Mean and standard deviation of the gain of photographs of these values."""
        mean, variance = 0.0, 0.0
        for sample in (sample for samples in self.photographs for sample in samples):
            factor = self.factor(sample, values)
            expected, deviation = sample.told(factor, sample.fitted(factor))
            mean, variance = mean + expected, variance + max(deviation, sample.scatter(factor)) ** 2
        return mean, math.sqrt(variance)

    def step(self, values: Mapping[str, float]) -> tuple[dict[str, float], dict[str, float], list[dict[str, float]]]:
        """Fisher's step, errors by his information, and the part of every photograph in the step.

        In focus, where no slope with defocus tells anything, of all else.
        """
        names = tuple(name for name in _STEPS if name != FOCUS or abs(values[FOCUS]) > _STEPS[FOCUS])
        information, scores = np.zeros((len(names),) * 2), []
        for samples in self.photographs:
            score = np.zeros(len(names))
            for sample in samples:
                part, more = self._scored(sample, values, names)
                score, information = score + part, information + more
            scores.append(score)
        known, at = np.zeros(len(names)), names.index(BIAS)
        information[at, at] += WIDTH_KNOWN_UM**-2
        known[at] = -values[BIAS] / WIDTH_KNOWN_UM**2
        inverse = np.linalg.inv(information)
        step, errors = inverse @ (sum(scores) + known), np.sqrt(np.diag(inverse))

        def named(each: Floats) -> dict[str, float]:
            return dict(zip(names, each.tolist(), strict=True))

        return named(step), named(errors), [named(inverse @ score) for score in scores]

    def _scored(self, sample: Sample, values: Mapping[str, float], names: Sequence[str]) -> tuple[Floats, Floats]:
        """Score and information of a square, what smooth scenes could do taken out."""
        factor = self.factor(sample, values)
        scene, dark = sample.parts(factor)
        total = factor * scene + dark
        slopes = []
        for name in names:
            ahead = self.factor(sample, {**values, name: values[name] + _STEPS[name]})
            slopes.append((ahead - factor) / _STEPS[name])
        score, information = np.zeros(len(names)), np.zeros((len(names),) * 2)
        for colour, whole in enumerate(total):
            signal = factor[colour] * scene[colour] / whole
            moved = np.stack([slope[colour] * scene[colour] / whole for slope in slopes], axis=1)
            smooth = np.concatenate([signal[:, None] * sample.table, (1 - signal)[:, None] * sample.squares], axis=1)
            moved -= smooth @ np.linalg.lstsq(smooth, moved, rcond=None)[0]
            information += moved.T @ moved
            score += moved.T @ (sample.power[colour] / whole - 1)
        return score, information
