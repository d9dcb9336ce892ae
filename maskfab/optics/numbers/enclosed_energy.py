r"""Energy inside circles and squares on the sensor, from samples of a PSF.

A PSF holds no frequency above B. The indicator of a region, low-passed by any φ̂ that is 1 up to B and 0 beyond
1/h - B, then has the same integral against it, and the sum over samples at distance h is that integral exactly:

    ∫_region PSF d²x = h² Σ_n PSF(nh) W(nh),    Ŵ(ν) = φ̂(ν) x transform of the indicator.

The transform of a disc of radius r is r J1(2πrν) / ν (Goodman 2.1.6), that of a square a product of sincs.

Notes:
    W reaches a little beyond its region, by about 1 / (1/h - 2B): what the window cuts off of it is bounded by the
    energy outside the window times the largest |W| there. Close to the window's rim, or for samples too coarse to
    leave room between B and 1/h - B, whole samples are counted instead; that is wrong by at most the energy of the
    pixels that the rim crosses (for points: of the two next to it on either side). The smaller bound decides, and is
    the uncertainty.
"""

from __future__ import annotations

import math

import numpy as np
import scipy
from numpy.polynomial.legendre import leggauss

from maskfab.base.arrays import Floats
from maskfab.errors import JobError
from maskfab.model import Psf, Quantity
from maskfab.optics.image.psf import pixel_sum_error

# erfc(4) / 2 is 8e-9: how far φ̂ is from 1 and 0 at the ends of its slope.
_SLOPE = 4.0
_FINER = 12
_FILTER_ERROR = 2e-7
_NODES_PER_CYCLE = 4


def encircled_energy(psf: Psf, radius_um: float, highest: float, die: str | None = None) -> Quantity:
    """Share of all transmitted energy within a circle about the axis; what lies outside the window counts as outside.

    Args:
        psf: any kind; its pixels, if it has such, are taken as they are.
        radius_um: at most half the window.
        highest: the PSF's highest frequency in any direction, cycles per micrometre of sensor: D / (λf) of the
            shortest wavelength for a round stop, √2 times that for a square one.
        die: whose number this is.

    Raises:
        JobError: MF104 for a radius that is not positive or reaches beyond the window.
    """
    _check(psf, radius_um, "radius")
    value, uncertainty = _energy_in_circle(psf, radius_um, highest)
    return Quantity(
        "encircled_energy",
        value,
        f"energy within {radius_um:g} um of the axis over all transmitted energy, window or not",
        detail=f"{radius_um:g} um",
        uncertainty=uncertainty,
        die=die,
        wavelength_nm=psf.wavelength_nm,
    )


def halo_energy(psf: Psf, radius_um: float, highest: float, die: str | None = None) -> Quantity:
    """Share of all transmitted energy farther than a radius from the axis, outside the window included.

    Args and errors: as for :func:`encircled_energy`.
    """
    _check(psf, radius_um, "radius")
    value, uncertainty = _energy_in_circle(psf, radius_um, highest)
    return Quantity(
        "halo_energy",
        1 - value,
        f"energy farther than {radius_um:g} um from the axis over all transmitted energy; of that, "
        f"{1 - psf.energy_in_window:.3g} lies outside the window",
        detail=f"{radius_um:g} um",
        uncertainty=uncertainty,
        die=die,
        wavelength_nm=psf.wavelength_nm,
    )


def ensquared_energy(psf: Psf, side_um: float, highest: float, die: str | None = None) -> Quantity:
    """Share of all transmitted energy within a square about the axis, sides along the pixels.

    For pixel means and an odd number of whole pixels this is a plain sum, and as good as they are.

    Args:
        psf: any kind.
        side_um: at most the window's side.
        highest: the PSF's highest frequency along an axis, D / (λf) of the shortest wavelength.
        die: whose number this is.

    Raises:
        JobError: MF104 for a side that is not positive or wider than the window.
    """
    _check(psf, side_um / 2, "half side")
    value, uncertainty = _energy_in_square(psf, side_um, highest)
    return Quantity(
        "ensquared_energy",
        value,
        f"energy within a square of {side_um:g} um about the axis over all transmitted energy, window or not",
        detail=f"{side_um:g} um",
        uncertainty=uncertainty,
        die=die,
        wavelength_nm=psf.wavelength_nm,
    )


def _check(psf: Psf, reach_um: float, name: str) -> None:
    half = psf.step_um * psf.values.shape[0] / 2
    if not 0 < reach_um <= half * (1 + 1e-9):
        raise JobError(
            "MF104",
            f"the {name} {reach_um:g} um is not between 0 and half the window, {half:g} um",
            cure="Widen camera.window or ask for less",
        )


def _axis(psf: Psf) -> Floats:
    half = psf.values.shape[0] // 2
    return psf.step_um * np.arange(-half, half + 1, dtype=np.float64)


def _energy_in_circle(psf: Psf, radius: float, highest: float) -> tuple[float, float]:
    axis, area = _axis(psf), psf.step_um**2
    distance = np.hypot(axis[:, None], axis)
    # A cell whose middle is farther from the rim than half its diagonal is not crossed.
    crossed = abs(distance - radius) < psf.step_um / math.sqrt(2)
    counted = float(psf.values[distance <= radius].sum() * area), float(psf.values[crossed].sum() * area)
    if not _room(psf, highest) or psf.kind == "pixel":
        return counted
    half = (psf.values.shape[0] / 2) * psf.step_um
    fine = np.arange(0.0, math.sqrt(2) * half + psf.step_um, psf.step_um / _FINER)
    weights = _disc_weights(fine, radius, psf.step_um, highest)
    weight = scipy.interpolate.CubicSpline(fine, weights)(distance)
    outside = max(0.0, 1 - psf.energy_in_window)
    rounding = _FILTER_ERROR + outside * float(abs(weights[fine >= half - psf.step_um]).max())
    return min((float((psf.values * weight).sum() * area), rounding), counted, key=lambda pair: pair[1])


def _energy_in_square(psf: Psf, side: float, highest: float) -> tuple[float, float]:
    axis, area = _axis(psf), psf.step_um**2
    inside = abs(axis) <= side / 2
    # A cell of pixel means is crossed or not; a point stands for no cell, so the next two on either side count as well:
    # where the rim runs along a dark fringe, what is missed lies beside it.
    reach = psf.step_um * (0.5 * (1 - 1e-9) if psf.kind == "pixel" else 1.5)
    outer, inner = abs(axis) < side / 2 + reach, abs(axis) <= side / 2 - reach
    total, most, least = (float(psf.values[np.ix_(part, part)].sum() * area) for part in (inside, outer, inner))
    counted = total, most - least
    if psf.kind == "pixel" or not _room(psf, highest):
        # Whole pixels cross nothing, and err as their means do.
        return counted[0], counted[1] + (pixel_sum_error(psf, highest) if psf.kind == "pixel" else 0.0)
    half = (psf.values.shape[0] / 2) * psf.step_um
    fine = np.arange(0.0, 2 * half, psf.step_um / 4)
    weight = _box_weights(axis, side, psf.step_um, highest)
    beyond = abs(_box_weights(fine[fine >= half - psf.step_um], side, psf.step_um, highest)).max()
    uncertainty = _FILTER_ERROR + max(0.0, 1 - psf.energy_in_window) * float(beyond) * float(abs(weight).max())
    return min((float(weight @ psf.values @ weight * area), uncertainty), counted, key=lambda pair: pair[1])


def _room(psf: Psf, highest: float) -> bool:
    """Whether 1/h - B exceeds B by enough for a low-pass filter in between."""
    return 1 / psf.step_um > 2.1 * highest


def _low_pass(frequency: Floats, step: float, highest: float) -> Floats:
    """1 up to ``highest``, 0 beyond 1 / step - highest, smooth in between."""
    end = 1 / step - highest
    middle, half = (highest + end) / 2, (end - highest) / 2
    return np.asarray(scipy.special.erfc(_SLOPE * (frequency - middle) / half) / 2)


def _nodes(step: float, highest: float, reach: float) -> tuple[Floats, Floats]:
    """Gauss-Legendre nodes over the filter's band, enough for waves over ``reach`` micrometres."""
    end = 1 / step - highest
    nodes, weights = leggauss(64)
    panels = max(1, math.ceil(end * reach * _NODES_PER_CYCLE / nodes.size))
    edges = np.linspace(0.0, end, panels + 1)
    half = np.diff(edges)[:, None] / 2
    return ((edges[:-1, None] + half) + half * nodes).ravel(), (half * weights).ravel()


def _disc_weights(distance: Floats, radius: float, step: float, highest: float) -> Floats:
    """W for a disc: 2π ∫ φ̂(ν) r J1(2πrν) J0(2πρν) dν."""
    nu, weights = _nodes(step, highest, radius + float(distance.max()))
    amplitude = 2 * np.pi * radius * weights * _low_pass(nu, step, highest) * scipy.special.j1(2 * np.pi * radius * nu)
    result = np.empty_like(distance)
    for start in range(0, distance.size, 512):
        part = slice(start, start + 512)
        result[part] = scipy.special.j0(2 * np.pi * distance[part, None] * nu) @ amplitude
    return result


def _box_weights(position: Floats, side: float, step: float, highest: float) -> Floats:
    """W along one axis for an interval: 2 ∫ φ̂(ν) a sinc(aν) cos(2πνx) dν."""
    nu, weights = _nodes(step, highest, side / 2 + float(abs(position).max(initial=0.0)))
    amplitude = 2 * weights * _low_pass(nu, step, highest) * side * np.sinc(side * nu)
    return np.asarray(np.cos(2 * np.pi * position[:, None] * nu) @ amplitude)
