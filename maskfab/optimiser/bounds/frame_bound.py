r"""A proven limit of the surrogate itself: of the whole frame, what leaks in from the sensor's edge included.

:mod:`maskfab.optimiser.model.interior` takes every lag and follows the spectrum's power law down to the lowest
frequency.

The surrogate (:mod:`maskfab.optimiser.model.expected_psnr`) takes a sample of the lags, and below 1/16 cycle per pixel
it puts the leak in place of the law. For the number that it returns, at its own lags and weights,

    E(ε) = σ² · noise(A) + bias(A) + leak(A, ε),    leak >= 0,

so the least of σ² · noise + bias over all A that an opening of c dots can have bounds E(ε), and the least of these over
the protocol's ε bounds what the surrogate returns. That least is bounded by :func:`residue_error`, whose theorem needs
of the lags only that those of one residue share one number, not that they are all there.

Turned at random, A has the symmetry of the square, and lags that it maps to each other are added up. A repeated unit's
has only A(-t) = A(t): mirror images are kept apart there, as the sample does not hold them equally.

Where few openings have c dots, all are tried instead, leak and all (:mod:`maskfab.optimiser.bounds.every_opening`).

Notes:
    The leak is a mean of squares, hence the 0, and all that a design loses by leaking counts as head-room, though even
    the most compact opening leaks. With the leak goes all that the filter holds back at low frequencies, and the dual
    may let them vanish to save their noise: without any leak, the best unit found lies 0.7 dB below at 24 dB, 0.2 at 32
    and 0.1 at 40, for 100 of 441.

    Other lower limits of the leak were sought. Wherever it was looked at, it is convex in A, and descent over all that
    the dual allows, leak included, ends 0.02 to 0.6 dB above the best opening of 4 x 4 dots; but that convexity is not
    proved. What is: were the record mirrored without end, which changed the leak by 3 % at most, it would be diagonal
    in cosine waves, each (y / H)² for a y linear in A, which is at least y² over the chord of H². For H from 0 to 1
    that saves an eighth to a third of the slack at 4 x 4 dots, and next to nothing at 21 x 21, where low frequencies
    may vanish.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from maskfab.optimiser.bounds.every_opening import best_of_every_opening, few_openings
from maskfab.optimiser.bounds.residue_bound import residue_errors, residues
from maskfab.optimiser.model.expected_psnr import Surrogate
from maskfab.optimiser.model.interior import Interior


def sampled(estimate: Surrogate, inner: Interior, *, periodic: bool) -> Interior:
    """The surrogate's own lags, with no power where the leak counts instead.

    Args:
        estimate: of the scenes.
        inner: of the same, by :func:`maskfab.optimiser.model.interior.interior`.
        periodic: keep every lag of the upper half plane; otherwise only 0 <= y <= x, mirror images added up.
    """
    lags = estimate.lags if periodic else np.sort(abs(estimate.lags), axis=0)
    kept, first, place = np.unique(lags, axis=1, return_index=True, return_inverse=True)
    place = place.ravel()
    weight = np.bincount(place, estimate.weight).astype(np.float64)
    y, x = kept
    if periodic:
        count = np.where((y == 0) & (x == 0), 1.0, 2.0)
    else:
        count = np.where(y == x, 4.0, 8.0) / np.where(y == 0, 2, 1)
        count[(y == 0) & (x == 0)] = 1
    return replace(
        inner,
        lags=kept,
        count=count,
        weight=weight,
        stop=np.maximum(estimate.clear[first], 0),
        pixel=np.ones(len(first)),
        folded=estimate.folded[first],
        power=np.bincount(place, estimate.signal) / weight,
        inverse_prior=estimate.inverse_prior[first],
    )


def frame_bound(
    estimate: Surrogate,
    inner: Interior,
    clear_dots: int,
    *,
    periodic: bool = False,
    levels: Sequence[float] | None = None,
) -> tuple[float, ...]:
    """dB at each level; for no unit of this clear count the surrogate returns more.

    Args:
        estimate: of the scenes.
        inner: of the same.
        clear_dots: of the unit, at least 1.
        periodic: the unit is repeated; otherwise turned at random.
        levels: of light; None for the surrogate's own.
    """
    levels = estimate.levels if levels is None else levels
    if few_openings(estimate.dots, clear_dots):
        return best_of_every_opening(estimate, clear_dots, periodic=periodic, levels=levels)
    ratio = clear_dots / estimate.dots**2
    own = sampled(estimate, inner, periodic=periodic)
    classes = residues(own, periodic=periodic, mirrored=not periodic)
    variance = [own.noise.variance(level, ratio) for level in levels]
    least = residue_errors(own, classes, ratio, variance, periodic=periodic)
    # Brighter light has less noise for every unit and ε, so what bounds the error there bounds it in dimmer light.
    least = [max(e for e, v in zip(least, variance, strict=True) if v <= own_v) for own_v in variance]
    return tuple(own.decibels(level, v) for level, v in zip(levels, least, strict=True))
