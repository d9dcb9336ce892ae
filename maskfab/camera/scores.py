"""Scores of restored pictures against the true ones, and paired gains of designs over one of them.

PSNR, SSIM and S-CIELAB are of code values. SSIM (Wang, Bovik, Sheikh, Simoncelli 2004) has Gaussian weights of 1.5
pixels out to 5, K1 = 0.01, K2 = 0.03, population covariances, white 1, and is the mean over channels and all pixels at
least 5 from the edge. S-CIELAB (see :mod:`maskfab.display.eye`) is the difference in CIELAB after the eye's blur, for a
viewer to whom a pixel is a minute of arc: the finest that an eye of full acuity tells apart. The picture is mirrored
beyond its edges.
"""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any

import numpy as np
import scipy

from maskfab.base.arrays import Floats, Singles
from maskfab.base.quantities import columns
from maskfab.base.units import decimals_of
from maskfab.camera.imaging import LARGE
from maskfab.camera.scenes import Photograph
from maskfab.display.eye import OPPONENT_OF_RGB, gains
from maskfab.optics.colour import delta_e_1976, lab_of_linear_srgb, light_of_code

_SIGMA, _REACH = 1.5, 5
_C1, _C2 = 0.01**2, 0.03**2
PIXELS_PER_DEGREE = 60.0
"""For S-CIELAB."""
_AT_ONCE = 1 << 18


def psnr(restored: Singles, truth: Singles) -> float:
    """10 log10 of 1 over the mean squared difference, in dB, over everything; infinite for equal pictures."""
    parts = ((..., strip, slice(None)) for strip in _strips(truth.shape))
    squares = (float(np.square(restored[part] - truth[part]).sum(dtype=np.float64)) for part in parts)
    error = math.fsum(squares) / truth.size
    return float("inf") if error == 0 else float(-10 * np.log10(error))


@dataclass(frozen=True, eq=False)
class Truth:
    """A true picture, and what SSIM and S-CIELAB need of it, strip by strip; of a large one nothing is kept."""

    values: Singles
    _local: dict[int, tuple[Singles, Singles]] = field(default_factory=dict, init=False, repr=False)

    @property
    def _large(self) -> bool:
        return bool(self.values[0].size > LARGE)

    @cached_property
    def _kept_lab(self) -> Floats:
        return seen(self.values)

    def ssim(self, restored: Singles) -> Singles:
        """The map of SSIM, [3, rows - 10, columns - 10]."""
        planes, rows, columns = restored.shape
        similarity = np.empty((planes, rows - 2 * _REACH, columns - 2 * _REACH), dtype=np.float32)
        for strip in _strips(similarity.shape):
            lines = slice(strip.start, strip.stop + 2 * _REACH)
            true, picture = self.values[:, lines], restored[:, lines]
            true_mean, true_variance = self._moments(lines)
            mean = _blur(picture)
            product = mean * true_mean
            covariance = _blur(picture * true) - product
            square = mean * mean
            variance = _blur(picture * picture) - square
            luminance = (2 * product + _C1) / (square + true_mean * true_mean + _C1)
            contrast = (2 * covariance + _C2) / (variance + true_variance + _C2)
            similarity[:, strip] = (luminance * contrast)[:, _REACH:-_REACH, _REACH:-_REACH]
        return similarity

    def delta_e(self, restored: Singles) -> Floats | Singles:
        """The colour difference of S-CIELAB at every pixel, [rows, columns]; about 2.3 is just noticeable."""
        if not self._large:
            return delta_e_1976(seen(restored), self._kept_lab)
        difference = np.empty(restored.shape[1:], dtype=np.float32)
        pictures = [_opponents(picture) for picture in (restored, self.values)]
        for strip in _strips(restored.shape):
            difference[strip] = delta_e_1976(*(_lab(picture[:, strip]) for picture in pictures))
        return difference

    def _moments(self, lines: slice) -> tuple[Singles, Singles]:
        moments = self._local.get(lines.start)
        if moments is None:
            true = self.values[:, lines]
            mean = _blur(true)
            moments = mean, _blur(true * true) - mean * mean
            if not self._large:
                self._local[lines.start] = moments
        return moments


def seen(values: Singles) -> Floats:
    """CIE L*a*b* of code values [3, rows, columns] after the eye's blur, [rows, columns, 3]."""
    return _lab(_opponents(values))


def _opponents(values: Singles) -> Singles:
    """Luminance, red-green and blue-yellow of code values after the eye's blur, [3, rows, columns]."""
    _, rows, columns = values.shape
    opponents = np.empty(values.shape, dtype=np.float32)
    weights = OPPONENT_OF_RGB.astype(np.float32)
    for strip in _strips(values.shape):
        opponents[:, strip] = np.tensordot(weights, light_of_code(values[:, strip]), axes=1)
    # A cosine transform mirrors the picture; its k-th term has k / 2n cycles per pixel.
    y, x = np.arange(rows)[:, None] / (2 * rows), np.arange(columns) / (2 * columns)
    for plane in opponents:
        plane[:] = scipy.fft.dctn(plane, workers=1)
    for strip in _strips(values.shape):
        opponents[:, strip] *= gains(PIXELS_PER_DEGREE * np.hypot(y[strip], x))
    for plane in opponents:
        plane[:] = scipy.fft.idctn(plane, workers=1)
    return opponents


def _lab(opponents: Singles) -> Floats:
    return lab_of_linear_srgb(np.tensordot(opponents.astype(np.float64), np.linalg.inv(OPPONENT_OF_RGB), axes=(0, 1)))


def _strips(shape: tuple[int, ...]) -> list[slice]:
    """Rows of a picture [..., rows, columns], so many at once that they take little memory."""
    rows, columns = shape[-2:]
    step = max(1, _AT_ONCE // columns)
    return [slice(start, min(rows, start + step)) for start in range(0, rows, step)]


def inner(picture: Singles, trim: int) -> Singles:
    """A picture, or a map of SSIM, without ``trim`` elements at each edge."""
    return picture[:, trim:-trim, trim:-trim] if trim else picture


def _blur(values: Singles) -> Singles:
    across = np.arange(-_REACH, _REACH + 1)
    weight = np.exp(-(across**2) / (2 * _SIGMA**2))
    weight /= weight.sum()
    lines = scipy.ndimage.correlate1d(values, weight, axis=1, mode="nearest")
    return np.asarray(scipy.ndimage.correlate1d(lines, weight, axis=2, mode="nearest"))


MEAN_OVER_NOISE = "the mean over the noise, in closed form, of every second row of 512 or more"
"""Meaning of a PSNR that is not drawn."""
CONFIDENCE = 0.95
NORMAL_95 = 1.959964
"""Standard errors of a normal number to either side that hold 95 %."""


@dataclass(frozen=True)
class MeanDifference:
    """Mean of differences over photographs, with its 95 % interval by Student's t.

    Attributes:
        half_width: of the interval, NaN for fewer than two photographs.

    Notes:
        The interval holds the mean over all photographs of the kind in 95 % of all draws of so many, if differences are
        about normal (Student, Biometrika 6, 1, 1908). Of another kind of photographs it says nothing.
    """

    mean: float
    half_width: float
    count: int

    @classmethod
    def of(cls, differences: Sequence[float]) -> MeanDifference:
        """From one difference for every photograph."""
        count = len(differences)
        mean = math.fsum(differences) / count
        if count < 2:
            return cls(mean, math.nan, count)
        from scipy.special import stdtrit  # slow to load, for pages that only name the confidence

        variance = math.fsum((difference - mean) ** 2 for difference in differences) / (count - 1)
        quantile = float(stdtrit(count - 1, (1 + CONFIDENCE) / 2))
        return cls(mean, quantile * math.sqrt(variance / count), count)

    @property
    def tie(self) -> bool:
        """Whether the interval holds 0, or is not known: nobody can tell which is better."""
        return not abs(self.mean) > self.half_width

    def told(self, unit: str = "dB", digits: int = 2) -> str:
        """In words: mean with its sign, any interval, any tie, to decimals the interval allows, so many at most."""
        if math.isnan(self.half_width):
            return f"{self.mean:+z.{digits}f} {unit}".rstrip()
        shown = max(0, min(digits, decimals_of(self.half_width) if self.half_width else digits))
        told = [f"{self.mean:+z.{shown}f}", f"± {self.half_width:.{shown}f}"]
        return " ".join([*told, *([unit] if unit else []), *(["tie"] if self.tie else [])])


@dataclass(frozen=True)
class Score:
    """One design, level of light, scene and restorer.

    Attributes:
        level_db: signal-to-noise ratio of white behind the published display.
        delta_e, delta_e_inner: mean colour difference of S-CIELAB, NaN likewise; about 2.3 is just noticeable.
        chosen: restorer that was chosen, where ``restorer`` says that one was.
        drawn: whether PSNR and ε are of one draw of the noise; otherwise of the mean over it, see
            :mod:`maskfab.camera.expected`. SSIM and colours are always of a draw.
    """

    design: str
    level_db: float
    scene: str
    epsilon: float
    psnr: float
    ssim: float
    psnr_inner: float
    ssim_inner: float
    delta_e: float = math.nan
    delta_e_inner: float = math.nan
    restorer: str = "wiener"
    chosen: str = ""
    drawn: bool = True


@dataclass(frozen=True)
class Gain:
    """Mean gain of a design over another at one level behind one restorer: PSNR in dB, SSIM, and fall of S-CIELAB."""

    design: str
    level_db: float
    restorer: str
    psnr: MeanDifference
    psnr_inner: MeanDifference
    ssim: MeanDifference
    delta_e: MeanDifference

    def to_dict(self) -> dict[str, Any]:
        """Plain data; a single photograph has no interval."""
        means = {key: getattr(self, key) for key in ("psnr", "psnr_inner", "ssim", "delta_e")}
        return {
            "design": self.design,
            "level_db": self.level_db,
            "restorer": self.restorer,
            "scenes": self.psnr.count,
            **{
                key: {
                    "mean": score.mean,
                    "half_width_95": None if math.isnan(score.half_width) else score.half_width,
                    "tie": score.tie,
                }
                for key, score in means.items()
            },
        }


@dataclass(frozen=True)
class ScoreTable:
    """Scores by design, level, restorer and scene."""

    scores: tuple[Score, ...]

    @cached_property
    def _by_case(self) -> dict[tuple[str, float, str, str], Score]:
        return {(score.design, score.level_db, score.restorer, score.scene): score for score in self.scores}

    @property
    def noise_told(self) -> list[str]:
        """A sentence on which scores are means over the noise and which are drawn; none where all are drawn."""
        drawn = {f"that of {score.design} at {score.level_db:g} dB": None for score in self.scores if score.drawn}
        if all(score.drawn for score in self.scores):
            return []
        others = ", ".join([*drawn, "pictures", "all other scores"])
        return [f"PSNR is {MEAN_OVER_NOISE}; {others} are of one draw of it."]

    def regret(self, chosen: Score) -> float:
        """Decibels by which the photograph's best restorer is better than what was chosen; worse where below 0."""
        case = chosen.design, chosen.level_db, chosen.scene
        own = [score for score in self.scores if (score.design, score.level_db, score.scene) == case]
        return max(score.psnr for score in own if not score.chosen) - chosen.psnr

    def winners(self, scores: Sequence[Score]) -> str:
        """The restorer of scores of one case; where each was chosen, how often, and by how much others were better."""
        chosen = Counter(score.chosen for score in scores if score.chosen)
        if not chosen:
            return scores[0].restorer
        regret = sum(map(self.regret, scores)) / len(scores)
        listed = ", ".join(f"{count} {name}" for name, count in chosen.items())
        return f"{scores[0].restorer}: {listed}; regret {regret:.2f} dB"

    def gains(self, reference: str) -> tuple[Gain, ...]:
        """Paired gains of every other design over the reference, behind the same restorer."""
        cases: dict[tuple[str, float, str], list[tuple[Score, Score]]] = {}
        for score in self.scores:
            if score.design != reference:
                pair = score, self._by_case[reference, score.level_db, score.restorer, score.scene]
                cases.setdefault((score.design, score.level_db, score.restorer), []).append(pair)
        return tuple(
            Gain(
                *case,
                MeanDifference.of([one.psnr - other.psnr for one, other in pairs]),
                MeanDifference.of([one.psnr_inner - other.psnr_inner for one, other in pairs]),
                MeanDifference.of([one.ssim - other.ssim for one, other in pairs]),
                MeanDifference.of([other.delta_e - one.delta_e for one, other in pairs]),
            )
            for case, pairs in cases.items()
        )

    def to_dict(self, reference: str) -> dict[str, Any]:
        """Scores, with their regret where a restorer was chosen, and gains over the reference, as plain data."""
        return {
            "scores": [vars(score) | ({"regret": self.regret(score)} if score.chosen else {}) for score in self.scores],
            "gains": [gain.to_dict() for gain in self.gains(reference)],
        }

    def lines(self, reference: str) -> list[str]:
        """Means of every design, level and restorer, and their gains over the reference, as lines of text."""
        rows = [("die", "level", "restorer", "PSNR", "inner", "SSIM", "S-CIELAB", f"gain over {reference}", "inner")]
        gains = {(gain.design, gain.level_db, gain.restorer): gain for gain in self.gains(reference)}
        for case in dict.fromkeys((score.design, score.level_db, score.restorer) for score in self.scores):
            own = [score for score in self.scores if (score.design, score.level_db, score.restorer) == case]
            keys = ("psnr", "psnr_inner", "ssim", "delta_e")
            mean = [sum(getattr(score, key) for score in own) / len(own) for key in keys]
            gain = gains.get(case)
            gain_texts = ("", "") if gain is None else (gain.psnr.told(), gain.psnr_inner.told())
            design, level, _ = case
            rows.append(
                (
                    design,
                    f"{level:.4g} dB",
                    self.winners(own),
                    f"{mean[0]:.2f} dB",
                    f"{mean[1]:.2f} dB",
                    f"{mean[2]:.3f}",
                    f"{mean[3]:.2f}",
                    *gain_texts,
                )
            )
        return columns(rows)


@dataclass(frozen=True)
class Crop:
    """Rows and columns in the middle of the sensor, in pixels."""

    rows: int
    columns: int

    def of(self, picture: Singles) -> Singles:
        """That part of a picture [3, rows, columns], a copy."""
        rows, columns = picture.shape[1:]
        top, left = (rows - self.rows) // 2, (columns - self.columns) // 2
        return picture[:, top : top + self.rows, left : left + self.columns].copy()


@dataclass(frozen=True, eq=False)
class Shot:
    """A restored photograph through a design: part of it, float32 [3, rows, columns] of code values, row 0 on top."""

    score: Score
    picture: Singles


def truth_of(scene: Photograph, crop: Crop) -> Singles:
    """The crop of the scene itself."""
    return crop.of(scene.margin.sensor(scene.values))
