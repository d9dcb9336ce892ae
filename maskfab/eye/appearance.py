"""Appearance of a display from a distance, to be shown magnified to a reader.

S-CIELAB's own filtered picture is a step of a calculation: its luminance channel takes away a part of the surround, and
grey is not zero in its opponent channels, so that black and white edges come out tinted. Here the luminance passes the
two narrow Gaussians of that model's luminance channel, and what a colour has beyond grey passes its red-green channel:
greys stay grey, and colour is blurred more than lightness, as the eye blurs them.
"""

from __future__ import annotations

import numpy as np

from maskfab.base.arrays import Floats
from maskfab.eye.fourier_light import Series
from maskfab.eye.scielab import GAUSSIANS, HIGHEST_CPD, carrying
from maskfab.eye.viewing import Viewing
from maskfab.optics.numbers.colour import LUMINANCE


def appearance(spectrum: Series, viewing: Viewing) -> Floats:
    """Linear light [y, x, 3] after the eye's blur, row 0 the lowest, on samples that carry all of it.

    Args:
        spectrum: up to :data:`~maskfab.eye.scielab.HIGHEST_CPD`.
        viewing: where the eye is.
    """
    radius = spectrum.radius_cpd
    lightness, colour = _gain(GAUSSIANS[0][:2], radius), _gain(GAUSSIANS[1], radius)
    grey = np.broadcast_to(LUMINANCE, (3, 3))
    light = spectrum.filtered(lambda _: lightness, grey).values(carrying(HIGHEST_CPD, viewing))
    rest = spectrum.filtered(lambda _: colour, np.eye(3) - grey).values(carrying(HIGHEST_CPD, viewing))
    return np.moveaxis(light + rest, 0, -1)


def _gain(gaussians: tuple[tuple[float, float], ...], radius_cpd: Floats) -> Floats:
    passed = sum(weight * np.exp(-((np.pi * spread * radius_cpd) ** 2)) for weight, spread in gaussians)
    return np.asarray(passed / sum(weight for weight, _ in gaussians))
