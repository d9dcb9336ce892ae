r"""An MTF from an oversampled edge spread, and the band about it that resampled lines give.

    MTF(ν) = |F(ν)| / F(0),    F(ν) = Σ_k w(x_k) (e_{k+1} - e_k) exp(-2πi ν x_k) / passed(ν)

Steps 6 to 9 of the slanted-edge method of ISO 12233: differences, window, transform, correction for the differences.

Noise adds its own power to |F|²; the variance over resampled lines (Efron's bootstrap of pairs) is subtracted. That
variance along the phase of F also gives the band: the moduli under which the observed one is neither among the
smallest nor the largest 2.5 %, which is Rice's law, and holds where the MTF is as small as the noise, too.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy import special

from maskfab.base.arrays import Floats
from maskfab.capture.edge_window import window
from maskfab.capture.oversampled import NormalSums, passed

CONFIDENCE = 0.95
RESAMPLES = 400

# Moduli from so many standard deviations on are as good as normal.
_NORMAL = 8.0


def mtf_with_band(
    sums: NormalSums, spread: Floats, frequency_cy_per_px: Floats, half_px: float, seed: int
) -> tuple[Floats, Floats, Floats]:
    """MTF, and the ends of its pointwise band, [n] each.

    Args:
        sums: of the lines across the edge.
        spread: the edge spread at the knots, of all lines.
        frequency_cy_per_px: 0 first.
        half_px: reach of the window.
        seed: of the resamples.
    """
    between = sums.knots_px[:-1] + sums.step_px / 2
    waves = np.exp(-2j * np.pi * frequency_cy_per_px[:, None] * between) * window(between, half_px)
    waves /= passed(frequency_cy_per_px, sums.step_px)[:, None]

    def transfer(spreads: Floats) -> NDArray[np.complex128]:
        found = np.diff(spreads) @ waves.T
        return np.asarray(found / found[:, :1].real)

    lines = len(sums.diagonal)
    drawn = np.random.default_rng(seed).multinomial(lines, np.full(lines, 1 / lines), RESAMPLES)
    (own,) = transfer(spread[None])
    size = abs(own)
    turned = transfer(sums.spreads(drawn.astype(np.float64))) * np.exp(-1j * np.angle(own))
    # A knot seen by n samples has a mean whose variance a resample of them tells by (n - 1) / n.
    seen = max(2.0, float(np.median(sums.diagonal.sum(axis=0) * 1.5)))
    along, across = (part.var(axis=0, ddof=1) * seen / (seen - 1) for part in (turned.real, turned.imag))
    mtf = np.sqrt(np.maximum(size**2 - along - across, 0))
    mtf[0] = 1.0
    low, high = rice_interval(size, np.sqrt(along))
    return mtf, low, high


def rice_interval(size: Floats, deviation: Floats) -> tuple[Floats, Floats]:
    """Moduli of a complex number under which an observed modulus is not unlikely, by Rice's law.

    Args:
        size: observed moduli, [n].
        deviation: of the noise of the real part, [n]; 0 where there is none.

    Returns:
        Ends of the :data:`CONFIDENCE` interval; both are 0 where noise alone is seldom so small.
    """
    tail = (1 - CONFIDENCE) / 2
    sigmas = size / np.where(deviation > 0, deviation, np.nan)
    few = np.where(sigmas < _NORMAL, sigmas, np.nan)
    far = sigmas - 0.5 / sigmas
    ends = []
    for share, sign in ((1 - tail, -1.0), (tail, 1.0)):
        # The noncentral chi-square at which the observed square is that quantile; none if 0 already has less.
        beside = few**2
        possible = special.chdtr(2.0, beside) > share
        near = np.sqrt(special.chndtrinc(np.where(possible, beside, np.nan), 2.0, share))
        near = np.where(possible, near, 0.0)
        found = np.where(sigmas < _NORMAL, near, far + sign * special.ndtri(1 - tail)) * deviation
        ends.append(np.where(deviation > 0, found, size))
    return ends[0], ends[1]
