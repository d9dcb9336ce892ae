"""Width of the light that a plate was captured with: a fit takes it for a point, and a wide one blurs what it sees.

A Gaussian of variance s over the sensor changes a picture by ½ s ∇² at first, which is one more column beside those of
the fit: its gain in chi², all else being free, says whether the light is wide, at the price of a term of the lens.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from maskfab.capture.die_image import DieImage
from maskfab.capture.fit import TERM_PRICE, Fit, judged, normal_equations
from maskfab.capture.taken import Taken

FWHM = math.sqrt(8 * math.log(2))
"""Of a Gaussian, in standard deviations."""
_FIRST_PX, _LEAST_PX = 0.25, 0.5
"""Standard deviation, pixels, from which widths are first told, and least full width that is: charge spreads as far."""
_ROUNDS, _STEP, _MOST, _SETTLED = 12, 0.05, 4.0, 0.01


@dataclass(frozen=True)
class LightWidth:
    """Full width at half maximum of a light, as its picture without a plate would have it on the sensor.

    Attributes:
        um: the width.
        error_um: its standard error, by the noise times the root of chi² per pixel that the width leaves.
    """

    um: float
    error_um: float


def light_width(image: DieImage, taken: Sequence[Taken], found: Fit) -> LightWidth | None:
    """The light's width, if it is wider than half a pixel and residuals tell; None of a point.

    Args:
        image: of the die.
        taken: what was fitted.
        found: the fit, its terms included.
    """
    at, pixel_um = found.setting, image.camera.pixel_um
    wide = replace(image, light_um=_FIRST_PX * pixel_um)
    slopes, pictures = image.slopes(at), image.pictures(at)
    change = [(a - b) / wide.light_um**2 for a, b in zip(wide.pictures(at), pictures, strict=True)]
    now = normal_equations(taken, pictures, [*slopes, change])
    held = [*range(len(slopes))]
    both = now.gain([*held, len(held)])
    noise = max(1.0, (found.chi2 - both) / found.freedom)
    variance = float((now.covariance @ now.gradient)[-1])
    if variance <= 0 or both - now.gain(held) < TERM_PRICE * noise:
        return None
    # Values that the fit bent for want of a width go back along with it.
    for _ in range(_ROUNDS):
        wide, wider = (replace(image, light_um=math.sqrt(factor * variance)) for factor in (1.0, 1 + _STEP))
        pictures = wide.pictures(at)
        change = [(a - b) / (_STEP * variance) for a, b in zip(wider.pictures(at), pictures, strict=True)]
        now = normal_equations(taken, pictures, [*wide.slopes(at), change])
        step = now.covariance @ now.gradient
        at = at.at(at.values + step[:-1])
        last, variance = variance, float(np.clip(variance + step[-1], variance / _MOST, variance * _MOST))
        if abs(variance - last) < _SETTLED * variance:
            break
    width = FWHM * math.sqrt(variance)
    if width < _LEAST_PX * pixel_um:
        return None
    noise = max(1.0, judged(taken, wide.pictures(at), at).chi2 / found.freedom)
    error = math.sqrt(noise * now.covariance[-1, -1])
    return LightWidth(width, width * error / (2 * variance))
