"""Width of the light that a plate was captured with: told by what residuals ask for, and taken into the fit.

Such a light makes the picture of a point, smoothed. Errors of the lens widen a picture, too; left out, a wide light
comes out as many errors that the lens does not have, and as a CD bias. So a width is taken in before further terms if
it explains more than all of those together, and after them if residuals ask for it still.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from maskfab.capture.die_image import DieImage
from maskfab.capture.fit import Fit, fitted, gain_of_terms, normal_equations, with_terms
from maskfab.capture.taken import Taken
from maskfab.progress import Progress, silent

FWHM = math.sqrt(8 * math.log(2))
"""Of a Gaussian, in standard deviations."""
_LEAST_PX = 0.5
"""Least full width that is told: the charge of a pixel spreads as far."""
_DEMANDED = 25.0
"""Fall of chi², over the noise that is left, from which a light is wider than a point."""
_EXPLAINED = 0.25
"""Share of what is left over that a width must explain: of a model that is wrong otherwise it explains little."""
_APART_PX = 0.25
_TURNS, _ROUNDS, _SETTLED = 3, 4, 0.3


@dataclass(frozen=True)
class LightWidth:
    """Full width at half maximum of a light, as its picture without a plate would have it on the sensor.

    Attributes:
        um: the width.
        error_um: its standard error, inflated as the fit's.
    """

    um: float
    error_um: float


@dataclass(frozen=True, eq=False)
class _Step:
    """Where residuals would take the square of a light's width, um².

    Attributes:
        change: of it.
        error: one standard error, inflated as the fit's.
        gain: fall of chi² that it brings.
        noise: chi² per pixel, 1 or more.
        left_over: chi² beyond that of noise.
        covariance: of the fit's values, the width not being known.
    """

    change: float
    error: float
    gain: float
    noise: float
    left_over: float
    covariance: NDArray[np.float64]

    @property
    def demanded(self) -> bool:
        """Whether it widens the light, and not by chance."""
        return self.change > 0 and self.gain > max(_DEMANDED * self.noise, _EXPLAINED * self.left_over)

    @property
    def settled(self) -> bool:
        """Whether it is small against its error."""
        return abs(self.change) < _SETTLED * self.error


def with_width_and_terms(
    image: DieImage, taken: Sequence[Taken], fit: Fit, progress: Progress = silent
) -> tuple[DieImage, Fit, LightWidth | None]:
    """The image in light as wide as residuals ask for, the fit of it with further terms, and that width.

    Args:
        image: of the die, in light of a point.
        taken: what the camera took.
        fit: of it, with few terms.
        progress: told after every step of a fit.

    Returns:
        The width is None of a point as far as residuals tell, and below half a pixel.
    """
    step = _step(image, taken, fit)
    if step.demanded and step.gain > gain_of_terms(image, taken, fit):
        image, fit, step = _widened(image, taken, fit, step, progress)
    fit = with_terms(image, taken, fit, progress)
    step = _step(image, taken, fit)
    for _ in range(_TURNS):
        if not (step.demanded or (image.light_um and not step.settled)):
            break
        image, fit, _ = _widened(image, taken, fit, step, progress)
        fit = with_terms(image, taken, fit, progress)
        step = _step(image, taken, fit)
    if not image.light_um:
        return image, fit, None
    fit, width = replace(fit, covariance=step.covariance), FWHM * image.light_um
    if width < _LEAST_PX * image.camera.pixel_um:
        return image, fit, None
    return image, fit, LightWidth(width, FWHM * step.error / (2 * image.light_um))


def _widened(
    image: DieImage, taken: Sequence[Taken], fit: Fit, step: _Step, progress: Progress
) -> tuple[DieImage, Fit, _Step]:
    for _ in range(_ROUNDS):
        image = replace(image, light_um=math.sqrt(max(0.0, image.light_um**2 + step.change)))
        fit = fitted(image, taken, fit.setting, progress)
        step = _step(image, taken, fit)
        if step.settled:
            break
    return image, fit, step


def _step(image: DieImage, taken: Sequence[Taken], fit: Fit) -> _Step:
    """A step along the square of the width together with all that is fitted."""
    pictures, slopes = image.pictures(fit.setting), image.slopes(fit.setting)
    apart = (_APART_PX * image.camera.pixel_um) ** 2
    farther = replace(image, light_um=math.sqrt(image.light_um**2 + apart)).pictures(fit.setting)
    by_square = [(a - b) / apart for a, b in zip(farther, pictures, strict=True)]
    now = normal_equations(taken, pictures, [*slopes, by_square])
    known = range(len(slopes))
    change = float((now.covariance @ now.gradient)[-1])
    error = fit.inflation * math.sqrt(float(now.covariance[-1, -1]))
    gain = now.gain(range(len(slopes) + 1)) - now.gain(known)
    noise, left_over = max(1.0, fit.chi2 / fit.freedom), fit.chi2 - fit.freedom
    return _Step(change, error, gain, noise, left_over, now.covariance[:-1, :-1])
