r"""Errors that the exposures of a stack show among themselves: what their merged picture's noise does not know.

A light that moves between two exposures, or a focus that drifts, leaves a merged picture that belongs to no setting.
Each exposure is therefore asked for a setting of its own, by one Gauss-Newton step from that of all:

    d_k = I_k⁻¹ g_k,     g_k = Jᵀ (y_k - a_k m) a_k / v_k,     I_k = Jᵀ J a_k² / v_k,     Σ I_k = I,

y_k the electrons of exposure k, m the fitted light, a_k the time, v_k the variance that the model lets expect. Where
the d_k of a value scatter by more than their noise I_k⁻¹, there is a variance τ² between exposures; the most likely
one, the mean being unknown (H. D. Patterson, R. Thompson, Biometrika 58 (1971) 545), is taken. The fit, which moves by
I⁻¹ Σ I_k d_k, then errs beside Fisher's I⁻¹ by

    I⁻¹ (Σ I_k τ² I_k) I⁻¹.

Notes:
    Frames drawn anew, the usual bootstrap, would state the errors of another measurement: the exposures of a stack hold
    very different parts of the information, and every third draw of five lacks the longest. Of equal exposures both
    tell the same.
    Lights and backgrounds are values like any other, so a lamp that drifts counts where it bends the picture.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
import scipy.special

from maskfab.base.arrays import Floats
from maskfab.capture.die_image import DieImage
from maskfab.capture.fit import Fit
from maskfab.capture.merge import Plane
from maskfab.capture.taken import Taken, colours_of

LEAST_FRAMES = 3
_PROVEN = 2.71
"""Twice the logarithm of the odds from which scatter is more than noise, which comes about in one of twenty values."""
_FINEST, _TRIED = 1e-2, 100
"""Least variance that is tried, in that of the noise of the best exposure, and how many up to the most."""
_LEAST_FREEDOM = 2.0
"""Degrees of freedom below which Student's quantiles would say that nothing is known."""
_RIDGE = 1e-9
"""Share of all information that is lent to each exposure, so that one which tells nothing is merely weak."""
_NORMAL_95 = 1.959964


def with_frames(image: DieImage, taken: Sequence[Taken], found: Fit) -> Fit:
    """The fit with the scatter between exposures in its errors, where there are three or more.

    Args:
        image: of the die.
        taken: what was fitted, merged of exposures.
        found: the fit.
    """
    planes = [each.plane for each in taken if each.plane is not None]
    if len(planes) < len(taken) or len(planes[0].exposures) < LEAST_FRAMES:
        return found
    frames = _frames(taken, planes, image.slopes(found.setting), image.pictures(found.setting), found)
    if len(frames) < LEAST_FRAMES:
        return found
    size = found.setting.values.size
    return replace(found, between=_between(frames, found.inflation)[:size, :size])


@dataclass(frozen=True, eq=False)
class _Frame:
    """Equations of one exposure for a step of setting, lights and backgrounds from where the fit is."""

    gradient: Floats
    information: Floats


def _frames(
    taken: Sequence[Taken],
    planes: Sequence[Plane],
    slopes: Sequence[Sequence[Floats]],
    pictures: Sequence[Floats],
    found: Fit,
) -> list[_Frame]:
    """Every exposure that tells anything."""
    colours, size = colours_of(taken), found.setting.values.size
    total = size + 2 * len(colours)
    gradients, informations = (np.zeros((len(planes[0].exposures), total, *rest)) for rest in ((), (total,)))
    for k, (each, plane) in enumerate(zip(taken, planes, strict=True)):
        colour = colours.index(each.pixels.colour)
        own = [*range(size), size + 2 * colour, size + 2 * colour + 1]
        light = found.light[each.pixels.colour]
        every = np.stack([*(light * slope[k] for slope in slopes), pictures[k], np.ones(each.light.shape)], axis=-1)
        for place, exposure in enumerate(plane.exposures):
            kept = each.valid & exposure.usable
            per_light = exposure.scale * plane.share[kept]
            expected = per_light * found.predicted[k][kept]
            weight = 1 / np.sqrt(np.maximum(expected, 0.0) + exposure.dark)
            columns = every[kept] * (weight * per_light)[:, None]
            gradients[place][own] += columns.T @ (weight * (exposure.electrons[kept] - expected))
            informations[place][np.ix_(own, own)] += columns.T @ columns
    return [_Frame(*each) for each in zip(gradients, informations, strict=True) if each[1].any()]


def _between(frames: Sequence[_Frame], inflation: float) -> Floats:
    """Covariance of the fit by what differs from exposure to exposure."""
    whole = sum(frame.information for frame in frames)
    # Values are of very different size.
    unit = 1 / np.sqrt(np.diag(whole))
    scaled = [unit[:, None] * frame.information * unit for frame in frames]
    covariance = np.linalg.pinv(sum(scaled), hermitian=True)
    lent = _RIDGE * np.eye(unit.size)
    inverses = [np.linalg.inv(each + lent) for each in scaled]
    steps = np.stack([inverse @ (unit * frame.gradient) for inverse, frame in zip(inverses, frames, strict=True)])
    noise = inflation**2 * np.stack([np.diag(inverse) for inverse in inverses])
    spread = np.array([_variance_between(steps[:, k], noise[:, k]) for k in range(unit.size)])
    moved = [covariance @ each for each in scaled]
    found = sum(each @ (spread[:, None] * each.T) for each in moved)
    return np.asarray(unit[:, None] * found * unit)


def _variance_between(values: Floats, noise: Floats) -> float:
    """Variance of values of their own, beside that of the noise of each: the most likely, 0 where it is not proven.

    It is enlarged so that 1.96 errors hold 95 % although few exposures tell it.
    """
    reach = float(np.ptp(values))
    tried = np.concatenate([[0.0], np.geomspace(_FINEST * noise.min(), max(reach**2, noise.min()), _TRIED)])
    weights = 1 / (noise + tried[:, None])
    total = weights.sum(axis=1)
    mean = weights @ values / total
    scatter = np.sum(weights * (values - mean[:, None]) ** 2, axis=1)
    likelihood = np.sum(np.log(weights), axis=1) - np.log(total) - scatter
    best = int(likelihood.argmax())
    if likelihood[best] - likelihood[0] < _PROVEN:
        return 0.0
    freedom = np.sum((tried[best] * weights[best]) ** 2) - 1
    quantile = float(scipy.special.stdtrit(max(_LEAST_FREEDOM, float(freedom)), 0.975))
    return float(tried[best]) * (quantile / _NORMAL_95) ** 2
