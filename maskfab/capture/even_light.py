r"""Light that is not quite even across an edge: told apart from light that the optics spreads, and taken out.

Light that grows by a share g per pixel tilts either field in proportion to its own level. Light that an optic spreads
falls alike on both sides of an edge, for its point spread is alike on opposite sides, and tilts both fields equally. Of
the slopes s of the two fields

    g = (s_bright - s_dark) / (e_bright - e_dark)

is therefore the light's alone. Here e is the slope of x times the edge spread, by which growing light changes it: the
field's level and, where the field itself is tilted, its slope times its distance.
"""

from __future__ import annotations

import math

import numpy as np

from maskfab.base.arrays import Floats, Mask
from maskfab.capture.oversampled import NormalSums

# Fields are what lies beyond this share of the reach; slopes below so many standard errors are none.
_FIELD, _SURE = 0.5, 4.0


def noise_about(sums: NormalSums, spread: Floats, distance_px: Floats, values: Floats, used: Mask) -> float:
    """One robust standard deviation of samples about the edge spread.

    Args:
        sums, spread: of the edge.
        distance_px, values, used: of the samples, [lines, samples].
    """
    rest = values[used] - np.interp(distance_px[used], sums.knots_px, spread)
    return 1.4826 * float(np.median(abs(rest)))


def light_slope(sums: NormalSums, spread: Floats, distance_px: Floats, values: Floats, used: Mask) -> float:
    """Share by which the light grows per pixel along the edge's normal; 0 where noise explains it.

    Args:
        sums, spread: of the edge.
        distance_px, values, used: of the samples, [lines, samples]; black is 0.
    """
    half = float(sums.knots_px[-1])
    noise = noise_about(sums, spread, distance_px, values, used)
    slopes, effects, variance = [], [], 0.0
    for side in (-1.0, 1.0):
        field = used & (side * distance_px > _FIELD * half)
        place, light = distance_px[field], values[field]
        about = place - place.mean()
        power = float(about @ about)
        slopes.append(float(about @ light) / power)
        effects.append(float(light.mean()) + slopes[-1] * float(place.mean()))
        variance += noise**2 / power
    tilt = slopes[1] - slopes[0]
    return tilt / (effects[1] - effects[0]) if abs(tilt) > _SURE * math.sqrt(variance) else 0.0
