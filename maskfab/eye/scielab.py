r"""S-CIELAB: how different two pictures look from where they are looked at.

Zhang and Wandell, "A spatial extension of CIELAB for digital color-image reproduction", SID Symposium Digest 27 (1996)
and Journal of the SID 5 (1997): the light is split into a luminance and two opponent-colour channels (Poirson and
Wandell), each is blurred by a sum of Gaussians k exp(-(r/s)^2) whose spreads s are degrees of visual angle, and the
result is compared in CIELAB. The weights k are scaled to sum to 1 in each channel, so an even field keeps its colour.

The Fourier transform of exp(-(r/s)^2) / (pi s^2) is exp(-(pi s f)^2): here the blur is that product, exact, and no
kernel is cut off. The picture repeats beyond its edges.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from maskfab.base.arrays import Floats
from maskfab.eye.display_light import EmittedLight
from maskfab.eye.fourier_light import Series, series
from maskfab.eye.viewing import Viewing
from maskfab.model import frozen
from maskfab.optics.numbers.colour import XYZ_OF_RGB, delta_e_1976, lab_of_linear_srgb

# Luminance, red-green, blue-yellow; from CIE XYZ.
_OPPONENT_OF_XYZ = ((0.279, 0.72, -0.107), (-0.449, 0.29, -0.077), (0.086, -0.59, 0.501))
OPPONENT_OF_RGB = frozen(np.array(_OPPONENT_OF_XYZ) @ XYZ_OF_RGB)
"""Of linear sRGB, [3, 3]."""
GAUSSIANS: tuple[tuple[tuple[float, float], ...], ...] = (
    ((0.921, 0.0283), (0.105, 0.133), (-0.108, 4.336)),
    ((0.531, 0.0392), (0.330, 0.494)),
    ((0.488, 0.0536), (0.371, 0.386)),
)
"""Weight and spread in degrees of each Gaussian, channel by channel."""

_FLOOR = 1e-12
HIGHEST_CPD = math.sqrt(-math.log(_FLOOR)) / (math.pi * 0.0283)
"""Above this no channel passes more than 1e-12 (59.1 cycles per degree)."""


@dataclass(frozen=True, eq=False)
class ColourDifference:
    """Difference of two pictures.

    Attributes:
        delta_e: float64 [y, x] CIE 1976 colour difference; about 2.3 is just noticeable.
        colour: float64 [y, x] its part in a* and b* alone.
    """

    delta_e: Floats
    colour: Floats

    @property
    def mean(self) -> float:
        return float(self.delta_e.mean())

    @property
    def worst_twentieth(self) -> float:
        """The 95th percentile of the colour difference."""
        return float(np.quantile(self.delta_e, 0.95))

    @property
    def fringe(self) -> float:
        """The largest difference in a* and b*: at an edge between greys, its colour fringe."""
        return float(self.colour.max())


def see(light: EmittedLight, viewing: Viewing) -> Floats:
    """CIE L*a*b* of light after the eye's blur, [y, x, 3] against the white of sRGB, row 0 the lowest.

    Samples lie as :func:`carrying` says, so that they hold all that the eye passes.
    """
    return of_series(series(light, viewing, HIGHEST_CPD), viewing)


def of_series(spectrum: Series, viewing: Viewing) -> Floats:
    """S-CIELAB response from a Fourier series that reaches up to :data:`HIGHEST_CPD`."""
    samples = carrying(HIGHEST_CPD, viewing)
    blurred = spectrum.filtered(gains, OPPONENT_OF_RGB).values(samples)
    rgb = np.moveaxis(np.tensordot(np.linalg.inv(OPPONENT_OF_RGB), blurred, axes=1), 0, -1)
    return lab_of_linear_srgb(rgb)


def colour_difference(first: Floats, second: Floats) -> ColourDifference:
    """The colour difference at every sample of two pictures [y, x, 3] in L*a*b*."""
    return ColourDifference(delta_e_1976(first, second), np.asarray(np.linalg.norm((first - second)[..., 1:], axis=-1)))


def gains(radius_cpd: Floats) -> Floats:
    """Transmission of each channel, [3, ...] of cycles per degree [...]; 1 at 0."""
    return np.stack(
        [
            sum(weight * np.exp(-((np.pi * spread * radius_cpd) ** 2)) for weight, spread in channel)
            / sum(weight for weight, _ in channel)
            for channel in GAUSSIANS
        ]
    )


def carrying(highest_cpd: float, viewing: Viewing) -> int:
    """Fewest samples along a pixel that carry frequencies up to ``highest_cpd``, and at least two."""
    return max(2, math.floor(2 * highest_cpd / viewing.pixels_per_degree) + 1)
