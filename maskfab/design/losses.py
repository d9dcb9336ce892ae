"""What a good opening is: losses that a pupil full of oriented cells is judged by.

Kept apart from the way to a good opening (relax.py): a loss knows no gain, no schedule and no threshold.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
import torch
from numpy.typing import NDArray

from maskfab.design.autocorrelation import Autocorrelation, autocorrelation
from maskfab.design.objective import Objective
from maskfab.errors import JobError
from maskfab.model import Stop
from maskfab.units import NM_PER_UM

MAX_SIDE = 4096  # dots across the stop; one step then takes seconds and a gigabyte


def cells_across(stop: Stop, dots: int, dot_nm: int) -> int:
    """Cells along the side of the smallest square of cells that covers the stop."""
    return math.ceil(stop.diameter_um * NM_PER_UM / (dots * dot_nm) - 1e-9)


def stop_dots(stop: Stop, side: int, dot_nm: int) -> NDArray[np.bool_]:
    """Dots whose middles lie inside the stop, bool [side, side]; the stop is centred on the square of dots."""
    away_um = np.abs(np.arange(side) - (side - 1) / 2) * dot_nm / NM_PER_UM
    radius_um = stop.diameter_um / 2
    if stop.shape == "square":
        inside = away_um <= radius_um
        return np.asarray(inside[:, None] & inside[None, :])
    return np.asarray(away_um[:, None] ** 2 + away_um[None, :] ** 2 <= radius_um**2)


@dataclass(frozen=True, eq=False)
class Invertibility(Objective):
    """How well the worst spatial frequencies survive a Wiener filter, with photons counted.

    The OTF at the frequency nu is the pupil's autocorrelation AC at the lag lambda f nu (Goodman, Introduction to
    Fourier Optics, 6.4). With it

        O = AC / (clear area of the bare stop x target open ratio),  H = O^2 / (O^2 + epsilon),
        loss = -mean of the smallest ``worst_fraction`` of H,

    over all lags of at least one dot up to half a cycle per sensor pixel (Yang & Sankaranarayanan 2021, equation 9
    and L_inv; thirty percent is meant where the text once says ten).

    O is divided by the light that a pattern of the target's open ratio passes, not by the PSF's own sum. With the
    latter a grey filter is free of charge: its O is that of the bare stop however dark it is, holes of the open ratio
    r have r times that on average, and the optimum is uniform grey. With photons counted, grey of the share r has
    r times the bare stop's O as well; all it keeps is its evenness, which binarisation takes away.

    Good for worst cases whatever the picture. It knows neither the picture's spectrum nor the sensor's edge: for
    photographs use :class:`maskfab.design.expected_error.ExpectedError`.

    Attributes:
        correlation: autocorrelation of the stop filled with oriented cells, far enough for these lags.
        lags: per wavelength, int64 flat indices into the autocorrelation table: integer lags of a half plane (the
            other half is its mirror image).
        light: clear area of the stop, in dots, x target open ratio: AC(0) of an opening that meets the target.
        epsilon: noise-to-signal ratio of the Wiener filter.
        worst_fraction: share of the lags that counts.
        own_sum: divide by the PSF's own sum, AC(0), as published, so that darkness is free; its optimum is grey.
    """

    correlation: Autocorrelation
    lags: tuple[torch.Tensor, ...]
    light: float
    epsilon: float
    worst_fraction: float
    own_sum: bool = False

    def of_table(self, table: torch.Tensor, unit: torch.Tensor) -> torch.Tensor:
        """The loss from the unit's autocorrelation table; a scalar between -1 and 0."""
        autocorrelation = table.flatten()
        light = autocorrelation[0] if self.own_sum else self.light
        worst = []
        for lags in self.lags:
            otf = autocorrelation.index_select(0, lags) / light
            kept = otf**2 / (otf**2 + self.epsilon)
            count = math.ceil(self.worst_fraction * lags.numel())
            worst.append(torch.topk(kept, count, largest=False, sorted=False).values.mean())
        return -torch.stack(worst).mean()

    @property
    def table(self) -> int:
        """Columns of the autocorrelation table; so many that no lag wraps."""
        return self.correlation.size

    def autocorrelation(self, cell: torch.Tensor) -> torch.Tensor:
        """Autocorrelation of the pupil, float [rows of lags, table]; lag (y, x), y >= 0, at [y, x % table]."""
        table: torch.Tensor = self.correlation(cell)
        return table

    def pupil(self, cell: torch.Tensor) -> torch.Tensor:
        """The stop filled with oriented cells, float [rows x dots, columns x dots]."""
        return self.correlation.pupil(cell)


def invertibility(
    *,
    dots: int,
    dot_nm: int,
    orientations: NDArray[np.int8],
    stop: Stop,
    focal_um: float,
    wavelengths_nm: tuple[float, ...],
    pixel_um: float,
    target: float,
    epsilon: float,
    worst_fraction: float,
) -> Invertibility:
    """The invertibility loss of cells of ``dots`` dots in front of one camera.

    Args:
        dots: dots along a cell's side.
        dot_nm: side of one dot.
        orientations: int8 [rows, columns], elements of D4; the square of cells is centred on the stop and covers it.
        stop: lens aperture.
        focal_um: focal length.
        wavelengths_nm: lines; each counts equally.
        pixel_um: side of a sensor pixel.
        target: open ratio at which O(0) = 1.
        epsilon: noise-to-signal ratio of the Wiener filter.
        worst_fraction: share of the lags that counts.

    Raises:
        JobError: MF104 if no lag of a dot or more is below half a cycle per pixel; MF115 if the stop is too many dots.
    """
    rows, columns = orientations.shape
    side = max(rows, columns) * dots
    if side > MAX_SIDE:
        raise JobError(
            "MF115",
            f"the stop of {stop.diameter_um:g} um is {side} dots of {dot_nm / NM_PER_UM:g} um across; the limit is "
            f"{MAX_SIDE}",
            where="camera.stop",
            cure="Design with a smaller stop, or with fewer dots per pitch",
        )
    inside = stop_dots(stop, side, dot_nm)[:, : columns * dots]
    reaches = [_nyquist_lag(wavelength, focal_um, pixel_um, dot_nm, side) for wavelength in wavelengths_nm]
    correlation = autocorrelation(dots, orientations, inside, math.floor(max(reaches)))
    return Invertibility(
        correlation=correlation,
        lags=tuple(torch.from_numpy(lags_within(reach, correlation.size)) for reach in reaches),
        light=float(inside.sum() * target),
        epsilon=epsilon,
        worst_fraction=worst_fraction,
    )


def _nyquist_lag(wavelength_nm: float, focal_um: float, pixel_um: float, dot_nm: int, side: int) -> float:
    """Lag in dots of half a cycle per sensor pixel, no longer than the stop: beyond it no pattern passes anything."""
    lag = wavelength_nm * focal_um / (2 * pixel_um) / dot_nm
    if lag < 1:
        raise JobError(
            "MF104",
            f"half a cycle per pixel of {pixel_um:g} um is a lag of {lag:.3g} dots at {wavelength_nm:g} nm; it must be "
            "at least 1",
            where="camera.pixel",
            cure="Use smaller dots, or a smaller sensor pixel",
        )
    return min(lag, side - 1.0)


def lags_within(reach: float, table: int) -> NDArray[np.int64]:
    """Flat table indices of the integer lags with 0 < |lag| <= reach in the half plane y > 0, or y = 0 and x > 0."""
    whole = math.floor(reach)
    y, x = np.mgrid[0 : whole + 1, -whole : whole + 1]
    wanted = (x**2 + y**2 <= reach**2) & ((y > 0) | (x > 0))
    return np.asarray(y[wanted] * table + x[wanted] % table, dtype=np.int64)
