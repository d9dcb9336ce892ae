r"""Light whose noise grows with it, as numbers whose noise does not: the generalised Anscombe transform.

n electrons counted with read noise of variance s² become

    z = 2 √(n + 3/8 + s²),

of variance about 1 whatever their mean (Starck, Murtagh, Bijaoui, Image Processing and Data Analysis, 1998, 2.4).
A mean D of such numbers is brought back, without the bias that the root has, by

    n = D²/4 + √(3/2) / (4 D) - 11 / (8 D²) + 5 √(3/2) / (8 D³) - 1/8 - s²

(Mäkitalo, Foi, IEEE Trans. Image Process. 20, 2697, 2011, for s = 0; 22, 91, 2013, for any).

Of merged exposures light has another noise beyond every full well. There the root of that noise goes on from where the
last one ended.
"""

from __future__ import annotations

import numpy as np

from maskfab.base.arrays import Singles
from maskfab.camera.record import MergedNoise, Noise

_DARK = 3 / 8


def stabilised(light: Singles, noise: Noise | MergedNoise) -> Singles:
    """Light in units of white, any shape, as numbers with noise of variance 1; 0 from 3/8 + s² electrons below dark."""
    (top, first), *brighter = noise.zones
    if not brighter:
        return _root(light, first)
    stable = _root(np.minimum(light, np.float32(top)), first)
    for ceiling, zone in brighter:
        start = np.asarray(top, dtype=np.float32)
        stable += _root(np.clip(light, start, np.float32(ceiling)), zone) - _root(start, zone)
        top = ceiling
    return stable


def unbiased(stable: Singles, noise: Noise | MergedNoise) -> Singles:
    """The light, in units of white, of which ``stable`` is the mean of :func:`stabilised`."""
    (top, first), *brighter = noise.zones
    light = _light(stable, first)
    for ceiling, zone in brighter:
        start = np.asarray(top, dtype=np.float32)
        end = stabilised(start, noise)
        beyond = stable >= end
        light[beyond] = _light(stable[beyond] + (_root(start, zone) - end), zone)
        top = ceiling
    return light


def _root(light: Singles, noise: Noise) -> Singles:
    counted = light * np.float32(noise.electrons)
    counted += np.float32(_DARK + _read(noise))
    return np.asarray(2 * np.sqrt(np.maximum(counted, 0)))


def _light(stable: Singles, noise: Noise) -> Singles:
    inverse = 1 / np.maximum(stable, np.float32(2 * _DARK**0.5))  # below, the series turns back
    root = np.float32(1.5**0.5)
    series = ((5 / 8 * root * inverse - np.float32(11 / 8)) * inverse + root / 4) * inverse
    counted = 1 / (4 * inverse * inverse) + series - np.float32(1 / 8 + _read(noise))
    return np.asarray(counted / np.float32(noise.electrons))


def _read(noise: Noise) -> float:
    """s², in electrons."""
    return noise.floor * noise.electrons**2
