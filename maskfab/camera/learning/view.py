r"""The view that a network has of a record: two restored pictures and the noise, on a scale of even errors.

The first picture, of total variation, is what it mends: it lets edges go on across the gaps of the transfer, and knows
of light from outside the sensor. The second, of the Wiener filter on calm light, has textures that the first lacks.

Light x is shown as x^(1/2.2), which is nearly its code value, so that errors count as they are scored. A power keeps
the scale: where f scales, x → f(x^(1/2.2))^2.2 scales too.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from maskfab.base.arrays import Singles
from maskfab.camera.record import Record
from maskfab.camera.restorers.dct import Dct
from maskfab.camera.restorers.restorer import Blur
from maskfab.camera.restorers.tv import TotalVariation

PLANES = 7
"""Of two pictures, and of the noise."""
EXPONENT = 2.2
"""Of light over what is shown: nearly the curve of sRGB."""
_VARIATION = 0.015
"""ε of total variation, whose penalty follows the noise by itself."""


@dataclass(frozen=True)
class View:
    """The way in which the records of a camera are shown.

    Attributes:
        strengths: ε of the second picture, by the electrons of white that it suits.
    """

    strengths: Mapping[float, float]

    def planes(self, record: Record, blur: Blur) -> Singles:
        """All that is shown of a record, float32 [7, rows, columns]: two pictures, and the noise of mean light."""
        nearest = min(self.strengths, key=lambda electrons: abs(math.log(electrons / record.noise.electrons)))
        edges = TotalVariation().prepare(record, blur)(_VARIATION)
        textures = Dct().prepare(record, blur)(self.strengths[nearest])
        noise = np.full_like(edges[:1], math.sqrt(float(record.variance.mean(dtype=np.float64))))
        return shown(np.concatenate([edges, textures, noise]))


def shown(light: Singles) -> Singles:
    """Light of any shape as it is shown; below 0 there is none."""
    return np.asarray(np.maximum(light, 0) ** np.float32(1 / EXPONENT))


def light_of(planes: Singles) -> Singles:
    """The light that is shown so."""
    return np.asarray(np.maximum(planes, 0) ** np.float32(EXPONENT))
