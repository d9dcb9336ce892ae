r"""MTF of a sampled picture: the aliased modulation transfer, and its change with the sub-pixel phase.

Samples h((n + φ) p) of a PSF with transfer function O have the discrete transform

    A(ν; φ) = Σ_k O(ν + k/p) exp(2πi k·φ),                      (Poisson summation; Goodman, Fourier Optics, 2.4)

k running over all whole vectors. O ends at D / (λf), so the sum is finite and exact. The aliased MTF is
|A(ν; φ)| / |A(0; φ)|, what one computes from sampled values that were scaled to sum 1. It is no property of the optics
alone: for that, see :mod:`maskfab.optics.image.mtf`.

Notes:
    A(0; φ) is the sum of the samples and can be small or zero if a PSF without pixels is sampled too coarsely; a
    pixel's own sinc has its zeros at all k/p, so for pixel means the sum is 1 whatever the phase.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Literal

import numpy as np

from maskfab.base.arrays import Floats
from maskfab.errors import JobError
from maskfab.model import Camera, Quantity, frozen
from maskfab.optics.image.lag_table import LagTable
from maskfab.optics.image.psf import cutoff
from maskfab.optics.image.spectrum import Spectrum, pixel_transfer, polychromatic_otf
from maskfab.units import UM_PER_MM

PHASES = 16
"""Sub-pixel phases along each axis; 0 and half a pixel, where symmetric PSFs have their extremes, are among them."""


@dataclass(frozen=True, eq=False)
class AliasedMtf:
    """The MTF of a PSF sampled once per pixel; aliased, unlike :class:`maskfab.model.Mtf`.

    Attributes:
        frequency_cy_per_mm: float64 [2, n], x and y component.
        values: float64 [phases y, phases x, n].
        phases: float64 [phases], offset of the PSF from the pixels' grid, in pixels.
        sampled: ``point`` values, or ``pixel`` means over full square pixels.
        uncertainty: bound on the absolute error of any value.
    """

    frequency_cy_per_mm: Floats
    values: Floats
    phases: Floats
    sampled: Literal["point", "pixel"]
    uncertainty: float

    def __post_init__(self) -> None:
        for name in ("frequency_cy_per_mm", "values", "phases"):
            object.__setattr__(self, name, frozen(getattr(self, name)))

    @property
    def lowest(self) -> Floats:
        """Smallest value over all phases, [n]."""
        return np.asarray(self.values.min(axis=(0, 1)))

    @property
    def highest(self) -> Floats:
        """Largest value over all phases, [n]."""
        return np.asarray(self.values.max(axis=(0, 1)))


def aliased_mtf(
    table: LagTable,
    camera: Camera,
    spectrum: Spectrum,
    nu_x: Floats,
    nu_y: Floats,
    *,
    sampled: Literal["point", "pixel"] = "pixel",
    phases: int = PHASES,
) -> AliasedMtf:
    """The aliased MTF at every sub-pixel phase.

    Args:
        table: lags up to the stop's diameter; one of shorter reach does not hold the aliases.
        camera: gives focal length, stop and pixel.
        spectrum: the light.
        nu_x, nu_y: float64 [n], cycles per micrometre of sensor.
        sampled: whether the PSF is sampled at points or averaged over pixels first.
        phases: how many along each axis.

    Raises:
        JobError: MF104 if there is no phase, or if the samples of some phase sum to nothing.
        InternalError: MF901 if the table's reach is short.
    """
    if phases < 1:
        raise JobError("MF104", f"{phases} sub-pixel phases are too few", cure="Give 1 phase or more")
    wanted_x, wanted_y = np.append(nu_x, 0.0), np.append(nu_y, 0.0)
    orders_x, orders_y = (_orders(camera, spectrum, nu) for nu in (wanted_x, wanted_y))
    alias_x = wanted_x + orders_x[:, None] / camera.pixel_um
    alias_y = wanted_y + orders_y[:, None] / camera.pixel_um
    nu_xy = np.broadcast_arrays(alias_x, alias_y[:, None, :])
    values = _transfer(table, camera, spectrum, nu_xy[0], nu_xy[1], sampled)
    phase = np.arange(phases, dtype=np.float64) / phases
    turn_x, turn_y = (np.exp(2j * np.pi * phase[:, None] * orders) for orders in (orders_x, orders_y))
    sums = abs(np.einsum("al,bk,lkn->abn", turn_y, turn_x, values, optimize=True))
    total = sums[..., -1:]
    aliases = orders_x.size * orders_y.size
    if total.min() <= aliases * max(table.coarse_uncertainty, 1e-12):
        raise JobError(
            "MF104",
            f"samples {camera.pixel_um:g} um apart can sum to nothing, so their MTF has no scale",
            cure="Average over pixels, or sample finer",
        )
    uncertainty = 2 * aliases * table.coarse_uncertainty / float(total.min())
    frequency = UM_PER_MM * np.stack([np.asarray(nu_x), np.asarray(nu_y)])
    return AliasedMtf(frequency, sums[..., :-1] / total, phase, sampled, uncertainty)


def phase_spread(aliased: AliasedMtf, presampled: Floats, die: str | None = None) -> Quantity:
    """Largest distance, over frequencies and phases, of the aliased MTF from the presampled one.

    Args:
        aliased: see :func:`aliased_mtf`.
        presampled: float64 [n], the MTF with the same pixel but before sampling, at the same frequencies.
        die: whose number this is.
    """
    distance = abs(aliased.values - presampled).max()
    return Quantity(
        "mtf_aliasing",
        float(distance),
        f"largest distance of the aliased MTF ({aliased.sampled} samples) from the presampled one over "
        f"{aliased.phases.size} x {aliased.phases.size} sub-pixel phases and the frequencies of the cut",
        uncertainty=aliased.uncertainty,
        die=die,
    )


def cy_per_pixel(frequency_cy_per_mm: Floats, pixel_um: float) -> Floats:
    """Cycles per pixel of a frequency on the sensor."""
    return np.asarray(frequency_cy_per_mm * pixel_um * 1e-3)


def _orders(camera: Camera, spectrum: Spectrum, nu: Floats) -> Floats:
    """Every k for which ν + k/p may lie below the cutoff."""
    highest = cutoff(camera, float(spectrum.wavelengths_nm.min()))
    last = math.ceil((highest + abs(nu).max()) * camera.pixel_um)
    return np.arange(-last, last + 1, dtype=np.float64)


def _transfer(
    table: LagTable,
    camera: Camera,
    spectrum: Spectrum,
    nu_x: Floats,
    nu_y: Floats,
    sampled: Literal["point", "pixel"],
) -> Floats:
    """Transfer function before sampling, zero beyond the cutoff along either axis."""
    highest = cutoff(camera, float(spectrum.wavelengths_nm.min()))
    within = (abs(nu_x) < highest) & (abs(nu_y) < highest)
    values = np.zeros(nu_x.shape)
    kept_x, kept_y = nu_x[within], nu_y[within]
    values[within] = _sum_of_lines(table, camera, spectrum, kept_x, kept_y)
    return values * pixel_transfer(camera, nu_x, nu_y) if sampled == "pixel" else values


def _sum_of_lines(table: LagTable, camera: Camera, spectrum: Spectrum, nu_x: Floats, nu_y: Floats) -> Floats:
    """Polychromatic OTF at frequencies that are beyond the cutoff of some lines."""
    total = np.zeros(nu_x.shape)
    for wavelength, weight in zip(spectrum.wavelengths_nm, spectrum.weights, strict=True):
        highest = cutoff(camera, float(wavelength))
        seen = (abs(nu_x) < highest) & (abs(nu_y) < highest)
        line = Spectrum(np.array([wavelength]), np.ones(1), spectrum.name)
        total[seen] += weight * polychromatic_otf(table, camera, line, nu_x[seen], nu_y[seen])
    return total
