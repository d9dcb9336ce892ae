r"""Light whose noise grows with it, as numbers whose noise does not: the generalised Anscombe transform.

n electrons counted with read noise of variance s² become

    z = 2 √(n + 3/8 + s²),

of variance about 1 whatever their mean (Starck, Murtagh, Bijaoui, Image Processing and Data Analysis, 1998, 2.4).
A mean D of such numbers is brought back, without the bias that the root has, by

    n = D²/4 + √(3/2) / (4 D) - 11 / (8 D²) + 5 √(3/2) / (8 D³) - 1/8 - s²

(Mäkitalo, Foi, IEEE Trans. Image Process. 20, 2697, 2011, for s = 0; 22, 91, 2013, for any).
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from maskfab.camera.record import Noise

Singles = NDArray[np.float32]

_DARK = 3 / 8


def stabilised(light: Singles, noise: Noise) -> Singles:
    """Light in units of white, any shape, as numbers with noise of variance 1; 0 from 3/8 + s² electrons below dark."""
    counted = light * np.float32(noise.electrons)
    counted += np.float32(_DARK + _read(noise))
    np.sqrt(np.maximum(counted, 0, out=counted), out=counted)
    counted *= 2
    return np.asarray(counted)


def unbiased(stable: Singles, noise: Noise) -> Singles:
    """The light, in units of white, of which ``stable`` is the mean of :func:`stabilised`."""
    inverse = 1 / np.maximum(stable, np.float32(2 * _DARK**0.5))  # below, the series turns back
    root = np.float32(1.5**0.5)
    series = ((5 / 8 * root * inverse - np.float32(11 / 8)) * inverse + root / 4) * inverse
    counted = 1 / (4 * inverse * inverse) + series - np.float32(1 / 8 + _read(noise))
    return np.asarray(counted / np.float32(noise.electrons))


def _read(noise: Noise) -> float:
    """s², in electrons."""
    return noise.floor * noise.electrons**2
