r"""The expected error of a restored picture far from the sensor's edge: the surrogate's formula without the leak.

For a transfer H real and at least 0, a scene of power P = c f^-p and the filter H/(H² + R), R = ε (f/0.1)²,

    E = mean over frequencies of  σ² H²/(H² + R)² + P R²/(H² + R)²

(Wiener 1949; the sum of what the filter makes of the noise and of what it holds back). H is sampled at every whole lag
within the square of frequencies, so E is a mean over lags. The lags and their weights have the symmetry of the square,
so the lags 0 <= y <= x are enough.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import scipy.fft
from numpy.typing import NDArray

from maskfab.base.arrays import Floats
from maskfab.camera.restorers.wiener import PRIOR_CY_PER_PX
from maskfab.camera.transfer import CellGrid, OpenStop
from maskfab.model import ORIENTATIONS, orient
from maskfab.optimiser.model.expected_psnr import Surrogate
from maskfab.optimiser.model.taking import PixelNoise


@dataclass(frozen=True, eq=False)
class Interior:
    """The lags 0 <= y <= x within the square of frequencies, and all that no opening changes at them.

    Attributes:
        lattice: of the cells behind the stop.
        lags: int64 [2, m], y and x in dots.
        count: [m], lags of the whole plane that each stands for: 1, 4 or 8.
        weight: [m], share of the square of frequencies; sums to 1.
        stop: [m], the open stop's autocorrelation, 1 at lag 0.
        pixel: [m], the pixel's sinc at them.
        folded: [m], what sampling folds back at them from a uniform grey panel.
        power: [m], P at them, white is 1.
        inverse_prior: [m], (f / 0.1)².
        noise: of the photographs' pixels.
        strengths: ε to choose from.
        per_cycle: lag in dots that belongs to one cycle per pixel.
        stop_dots: dots within the stop.
        stop_table: [2 n - 1, 2 n - 1], the open stop's autocorrelation at every lag, lag 0 in the middle; the panel
            has n dots along its side.
    """

    lattice: CellGrid
    lags: NDArray[np.int64]
    count: Floats
    weight: Floats
    stop: Floats
    pixel: Floats
    folded: Floats
    power: Floats
    inverse_prior: Floats
    noise: PixelNoise
    strengths: tuple[float, ...]
    per_cycle: float
    stop_dots: float
    stop_table: Floats

    @property
    def dots(self) -> int:
        """Along the unit's side."""
        return self.lattice.dots

    @property
    def levels(self) -> tuple[float, ...]:
        """Of light, dB."""
        return self.noise.taking.levels

    def decibels(self, level: float, error: float) -> float:
        """The PSNR that a mean squared error stands for at a level of light."""
        return float(-10 * np.log10(max(error, 1e-30))) + self.noise.added_db(level)

    def transfer(self, modulation: Floats, grey: float) -> Floats:
        """H of a pupil's autocorrelation [..., m], 1 at lag 0, folded as that of a panel of transmittance ``grey``."""
        return np.asarray(modulation * self.pixel + grey * self.folded)

    def psnr(
        self, modulation: Floats, open_share: float, grey: float, levels: Sequence[float] | None = None
    ) -> tuple[float, ...]:
        """The PSNR of E in dB at each level, each with its best ε.

        Args:
            modulation: the pupil's autocorrelation at the lags, 1 at lag 0, [m] or [images, m] to take the mean over.
            open_share: clear share of the stop, for the light.
            grey: modulation between far dots, which sampling folds back.
            levels: of light; None for the photographs' own.
        """
        squared = np.atleast_2d(self.transfer(modulation, grey)) ** 2
        asked, errors = self.levels if levels is None else levels, []
        for epsilon in self.strengths:
            regular = epsilon * self.inverse_prior
            filtered = 1 / (squared + regular) ** 2
            noise = float(((squared * filtered) @ self.weight).mean())
            bias = float((filtered @ (self.weight * self.power * regular**2)).mean())
            errors.append([self.noise.variance(level, open_share) * noise + bias for level in asked])
        return tuple(self.decibels(level, error) for level, error in zip(asked, np.min(errors, axis=0), strict=True))

    def of_unit(
        self, unit: NDArray[np.bool_], *, periodic: bool = False, levels: Sequence[float] | None = None
    ) -> tuple[float, ...]:
        """Expected PSNR in dB of a unit [dots, dots] turned at random, or as it is in every cell."""
        y, x = self.lags
        images = [(y, x), (-y, x), (x, y), (-x, y)] if periodic else [(y, x)]
        table = unit_modulation(unit, periodic=periodic)
        far = np.maximum(abs(y), abs(x)) >= self.dots
        size = 2 * self.dots
        rows = []
        for v, u in images:
            near = table[1][v % size, u % size]
            rows.append(self.stop * np.where(far, table[0][v % self.dots, u % self.dots], near))
        return self.psnr(np.stack(rows), float(unit.mean()), float(unit.mean()), levels)


def unit_modulation(unit: NDArray[np.bool_], *, periodic: bool = False) -> tuple[Floats, Floats]:
    """Mean autocorrelation of the tiled unit over that of the stop, cut cells left out.

    Returns:
        [n, n] at lags of n dots and more along an axis, by lag modulo n; [2n, 2n] at shorter lags, modulo 2n.
    """
    n = len(unit)
    turned = np.stack([orient(unit, k) for k in range(1 if periodic else ORIENTATIONS)]).astype(np.float64)
    wide = scipy.fft.rfft2(turned, (2 * n, 2 * n))
    spread = (abs(wide) ** 2).mean(axis=0) - abs(wide.mean(axis=0)) ** 2
    mean = scipy.fft.rfft2(turned.mean(axis=0))
    circular = scipy.fft.irfft2(abs(mean) ** 2, (n, n)) / unit.sum()
    linear = scipy.fft.irfft2(spread, (2 * n, 2 * n)) / unit.sum()
    return circular, np.tile(circular, (2, 2)) + linear


def interior(estimate: Surrogate) -> Interior:
    """The interior part of a surrogate, at every lag instead of its sample of them, low frequencies included."""
    distance = 0.1 * np.sqrt(np.maximum(estimate.inverse_prior - 1e-12, 0))
    farthest = int(np.argmax(distance))
    per_cycle = float(np.hypot(*estimate.lags[:, farthest]) / distance[farthest])
    # The surrogate's power is exactly c f^-p where it is not 0.
    known = np.flatnonzero(estimate.signal)
    ends = known[np.argmin(distance[known])], known[np.argmax(distance[known])]
    logs = [(np.log(distance[i]), np.log(estimate.signal[i] / estimate.weight[i])) for i in ends]
    slope = (logs[1][1] - logs[0][1]) / (logs[1][0] - logs[0][0])
    longest = int(per_cycle / 2)
    y, x = (v.ravel() for v in np.mgrid[0 : longest + 1, 0 : longest + 1])
    kept = y <= x
    y, x = y[kept], x[kept]
    count = np.where(y == x, 4.0, 8.0) / np.where(y == 0, 2, 1)
    count[0] = 1
    open_stop = OpenStop.of(estimate.lattice, estimate.lattice.camera.middle_nm, per_cycle)
    frequency = np.hypot(y, x) / per_cycle
    power = np.exp(logs[0][1] + slope * (np.log(np.maximum(frequency, 1e-3)) - logs[0][0]))
    return Interior(
        estimate.lattice,
        np.stack([y, x]),
        count,
        count / count.sum(),
        open_stop.at(y, x),
        np.sinc(y / per_cycle) * np.sinc(x / per_cycle),
        open_stop.folded(y / per_cycle, x / per_cycle),
        power,
        (frequency / PRIOR_CY_PER_PX) ** 2 + 1e-12,
        estimate.noise,
        estimate.strengths,
        per_cycle,
        open_stop.dots,
        open_stop.table,
    )
