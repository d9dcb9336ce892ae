"""Which die a camera looked through, and which way round it stood, by likelihood, in light of what width.

In focus a die and the same die turned by 180 degrees make one picture, for the transmission of a mask is real; out of
focus one makes the other's picture on the other side of the focus. So of eight ways round four are told apart.

A die that is out of focus, or off the axis, is looked for with its defocus or place before it is fitted.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
import scipy

from maskfab.base.arrays import Floats
from maskfab.base.model import Panel
from maskfab.base.work import Progress, silent
from maskfab.camera.inspection.bench import CUT_BEND
from maskfab.camera.inspection.bench_search import cut_found, place_found
from maskfab.camera.inspection.die_image import DEFOCUS, DieImage, Setting, gathered
from maskfab.camera.inspection.fit import FIRST_TERMS, Fit, Taken, colours_of, fitted, judged, most_noise
from maskfab.job.camera import Camera
from maskfab.optics.spectrum import Spectrum

WAYS_ROUND = (0, 1, 4, 5)
"""Elements of D4 that are told apart; each stands for itself and for itself turned by 180 degrees."""
_REACH_UM = 45.0
"""Half the side of what is looked at first: a small turn or stretch moves nothing there by a speckle."""
_FOCUSED, _SEARCHED, _SEARCHED_CUT = 12, 6, 3
"""Hypotheses whose defocus is looked for, their place before the stop, and what cuts their light."""
_WIDEST_DEFOCUS, _FINEST_DEFOCUS = 0.15, 0.03
"""Steps in waves by which it is looked for, from wide to fine."""
_FAR_BELOW = 0.2
_LENS = tuple(range(4, 12))
"""Errors of the lens that are fitted at once where something cuts its light: the search for that knows of none."""
_FITTED = 3
"""Hypotheses that are fitted whole, the most likely first."""
_HOPELESS = 400.0
"""Difference of chi² in the middle, over the noise there, from which a hypothesis is not fitted whole."""
_NOWHERE = Setting()
CERTAIN = 25.0
"""Difference of chi², each over the noise that the best fit leaves, from which a die is told from another: odds of a
quarter of a million."""


@dataclass(frozen=True)
class Hypothesis:
    """A die that may have stood before the camera."""

    die: str
    way_round: int


@dataclass(frozen=True, eq=False)
class Identified:
    """The most likely die.

    Attributes:
        ahead: of every other hypothesis, by how much its chi² is above the best one's, over the noise that the best
            fit leaves; ascending. Those that were not fitted whole are judged by the middle of the picture alone.
    """

    best: Hypothesis
    fit: Fit
    ahead: tuple[tuple[Hypothesis, float], ...]

    @property
    def certain(self) -> bool:
        return not self.ahead or self.ahead[0][1] >= CERTAIN

    @property
    def rivals(self) -> tuple[Hypothesis, ...]:
        """Hypotheses that are not told from the best."""
        return tuple(hypothesis for hypothesis, margin in self.ahead if margin < CERTAIN)


def identified(
    panels: Mapping[str, Panel],
    camera: Camera,
    light: Mapping[str, Spectrum],
    taken: Sequence[Taken],
    progress: Progress = silent,
) -> Identified:
    """Find the die, and the way round, that best explains what a camera took.

    Args:
        panels: of the dies that it may be, by name; those that are not square are tried as drawn and mirrored alone.
    """

    def seen(colour: str) -> float:
        mine = [capture for capture in taken if capture.pixels.colour == colour]
        return sum(
            float(np.sum((capture.light[capture.valid] / capture.sigma[capture.valid]) ** 2)) for capture in mine
        )

    # The colour that has taken most light over its noise: one line tells dies apart as well as three.
    chosen = max(colours_of(taken), key=seen)
    taken = [capture for capture in taken if capture.pixels.colour == chosen]
    middle = [capture.within(_REACH_UM) for capture in taken]
    mine = {colour: light[colour] for colour in colours_of(taken)}
    few = {colour: gathered(lines, camera, _REACH_UM) for colour, lines in mine.items()}

    def imaged(die: Hypothesis) -> DieImage:
        return DieImage.of(panels[die.die], die.way_round, camera, few, [capture.pixels for capture in middle])

    placed: list[tuple[float, Hypothesis, Setting]] = []
    noise = math.inf
    for done, (name, panel) in enumerate(panels.items(), start=1):
        square = panel.orientations.shape[0] == panel.orientations.shape[1]
        for way in WAYS_ROUND:
            if way % 2 and not square:
                continue
            setting, chi2, freedom = _placed(imaged(Hypothesis(name, way)), middle)
            noise = min(noise, chi2 / freedom)
            placed.append((chi2, Hypothesis(name, way), setting))
        progress("dies", done, len(panels))
    noise = max(1.0, noise)
    placed.sort(key=lambda case: case[0])
    for search, count in ((_focused, _FOCUSED), (place_found, _SEARCHED), (cut_found, _SEARCHED_CUT)):
        for k, (middling, each, stood) in enumerate(placed[:count]):
            least = min(chi2 for chi2, _, _ in placed)
            # As long as no die explains the middle, the one that is nearest may be the wrong one.
            explained = middling - least > _HOPELESS * noise and least < _FAR_BELOW * middling
            if explained and search is not _focused:
                continue
            there = imaged(each)
            setting = search(there, middle, stood)
            if setting != stood:
                setting, chi2, freedom = _placed(there, middle, setting)
                placed[k] = chi2, each, setting
                noise = max(1.0, min(noise, chi2 / freedom))
        placed.sort(key=lambda case: case[0])
    whole: list[tuple[Hypothesis, Fit]] = []
    for first, (middling, each, setting) in enumerate(placed[:_FITTED]):
        if first and middling - placed[0][0] > _HOPELESS * noise:
            break
        there = imaged(each)
        # A fit of the middle takes little, and leaves one of the whole few steps.
        terms = _LENS if CUT_BEND in dict(setting.bench) else FIRST_TERMS
        known = dict(setting.terms)
        near = fitted(there, middle, replace(setting, terms=tuple((term, known.get(term, 0.0)) for term in terms)))
        image = DieImage.of(panels[each.die], each.way_round, camera, mine, [t.pixels for t in taken])
        whole.append((each, fitted(image, taken, near.setting, progress)))
    whole.sort(key=lambda pair: pair[1].chi2)
    best, fit = whole[0]
    left = fit.inflation**2
    ahead = [(hypothesis, (other.chi2 - fit.chi2) / left) for hypothesis, other in whole[1:]]
    tried = {hypothesis for hypothesis, _ in whole}
    own = next(chi2 for chi2, hypothesis, _ in placed if hypothesis == best)
    ahead += [(hypothesis, max(0.0, chi2 - own) / noise) for chi2, hypothesis, _ in placed if hypothesis not in tried]
    return Identified(best, fit, tuple(sorted(ahead, key=lambda pair: pair[1])))


def _placed(image: DieImage, taken: Sequence[Taken], setting: Setting = _NOWHERE) -> tuple[Setting, float, int]:
    """The place of the light that fits best, to a tenth of a pixel, and chi² there."""
    for _ in range(2):
        pictures = image.pictures(setting)
        across, up = _shift(taken, pictures)
        setting = replace(setting, x_um=setting.x_um + across, y_um=setting.y_um + up)
    fit = judged(taken, image.pictures(setting), setting)
    return setting, fit.chi2, fit.freedom


def _focused(image: DieImage, taken: Sequence[Taken], setting: Setting) -> Setting:
    """A setting with the defocus that steps to either side lead to; as it was where that explains the picture.

    In focus the slope with defocus is none, or leads to the wrong side.
    """
    fit = judged(taken, image.pictures(setting), setting)
    if fit.chi2 / fit.freedom <= most_noise(fit):
        return setting
    best, least, waves, step = setting, fit.chi2, 0.0, _WIDEST_DEFOCUS
    while step >= _FINEST_DEFOCUS:
        tried = [
            (_placed(image, taken, replace(setting, terms=((DEFOCUS, there),))), there)
            for there in (waves - step, waves + step)
        ]
        (near, chi2, _), there = min(tried, key=lambda pair: pair[0][1])
        if chi2 < least:
            best, least, waves = near, chi2, there
        else:
            step /= 2
    return best


def _shift(taken: Sequence[Taken], pictures: Sequence[Floats]) -> tuple[float, float]:
    """Shift of pictures in x and y for the best correlation with what was taken, micrometres."""
    totals = []
    for capture, picture in zip(taken, pictures, strict=True):
        # The root evens out the noise, so that the peak does not drown what tells dies apart.
        seen = np.sqrt(np.clip(np.where(capture.valid, capture.light, 0.0), 0, None))
        expected = np.sqrt(np.clip(picture, 0, None))
        # It has no move at [rows - 1, columns - 1].
        correlation = scipy.signal.correlate(seen - seen.mean(), expected - expected.mean(), method="fft")
        y, x = np.unravel_index(int(correlation.argmax()), correlation.shape)
        step_x = float(capture.pixels.x_um[1] - capture.pixels.x_um[0])
        step_y = float(capture.pixels.y_um[1] - capture.pixels.y_um[0])
        across = step_x * (x - (picture.shape[1] - 1) + _summit(correlation[y, max(0, x - 1) : x + 2]))
        up = step_y * (y - (picture.shape[0] - 1) + _summit(correlation[max(0, y - 1) : y + 2, x]))
        totals.append((float(correlation.max()), across, up))
    weights = np.array([weight for weight, _, _ in totals])
    return tuple(float(weights @ np.array([total[k] for total in totals]) / weights.sum()) for k in (1, 2))  # type: ignore[return-value]


def _summit(values: Floats) -> float:
    """Place of the top of a parabola through three values, from the middle one; 0 where there are fewer."""
    if values.size < 3:
        return 0.0
    bend = values[0] - 2 * values[1] + values[2]
    return 0.0 if bend >= 0 else float((values[0] - values[2]) / (2 * bend))
