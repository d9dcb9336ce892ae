"""The optical numbers of a report, each with its unit, method and error."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from maskfab.base.arrays import Floats
from maskfab.base.errors import JobError
from maskfab.base.model import Mtf, Psf, Quantity
from maskfab.base.units import UM_PER_MM
from maskfab.job.camera import Camera
from maskfab.optics.colour import JUST_NOTICEABLE
from maskfab.optics.energy import colour_distance, energy_normalised_strehl, ensquared_energy, halo_energy, streak_index
from maskfab.optics.exact_psf import ExactPsf
from maskfab.optics.lags import AxisLags, LagTable
from maskfab.optics.mtf import (
    LEVELS,
    PHASES,
    AliasedMtf,
    EdgeSpread,
    area_under_radial_min,
    cy_per_pixel,
    edge_colour_difference,
    edge_in_window,
    frequency_at,
    phase_spread,
)
from maskfab.optics.psf import Leak, cutoff, image_scale_um2, pixel_sum_error
from maskfab.optics.restoration import noise_gain, sensor_square, worst_wiener
from maskfab.optics.spectrum import Spectrum

NOISE_TO_SIGNAL = 0.015
"""The noise-to-signal ratio ε of the Wiener quantities."""

_WIENER_SAMPLES = 128
_CORE_PIXELS = 5
_ROUNDING = 1e-15
_HALO_UM = 25.0
_STREAK_UM = (10.0, 50.0)
# Of a colour's number, the error with which it still ranks designs; and what is too small to matter.
_LARGEST_BAR, _LEAST_DISTANCE = 0.15, 0.01

FASTEST_PARAXIAL = 1.4
"""The f-number below which a user is told that the model is paraxial: there the PSF of an open stop is off by 3 %.

That of an aplanatic lens in unpolarised light (B. Richards and E. Wolf, Proc. R. Soc. A 253, 358, 1959) is off Airy's,
energies equal, by 0.052 to 0.056 / F² from f/2.5 to f/0.8.
"""

AREA_ERROR = 1e-8
"""Relative error of an area inside the stop; the polygon that stands for a round stop has 4096 sides.

What goes with the square of an area errs by twice as much.
"""


def fast_lens(camera: Camera) -> tuple[Quantity, ...]:
    """A note beside a model bar, without a verdict, on a lens that is faster than f/1.4; none for a slower one."""
    f_number = camera.focal_um / camera.stop.diameter_um
    if f_number >= FASTEST_PARAXIAL:
        return ()
    return (
        Quantity(
            "fast_lens",
            f"f/{f_number:.3g}",
            f"above f/{FASTEST_PARAXIAL:g} the scalar, paraxial model that every number here rests on leaves out the "
            "vector field and the sine condition; model_vector_field and model_tangent_for_sine in the model bar say "
            "how much",
        ),
    )


_FIXED_BY = ("the open ratio", "the mean amplitude, the film's leak included,")
_VOLUME_BY = ("the open ratio", "mean amplitude² over mean intensity, the film's leak included,")


def stop_open_ratio(clear_um2: float, camera: Camera, die: str | None, method: str, off_um2: float = 0.0) -> Quantity:
    """Share of the stop that is clear; ``off_um2`` bounds what outlines that were moved on reading add or take."""
    ratio, off = clear_um2 / camera.stop.area_um2, off_um2 / camera.stop.area_um2
    return Quantity("stop_open_ratio", ratio, method, uncertainty=AREA_ERROR * ratio + off, die=die)


def mtf_quantities(mtf: Mtf, pixel_um: float, die: str | None) -> list[Quantity]:
    """AUC of the radial minimum, and the frequencies at which the radial mean falls to 50, 30 and 10 %.

    The frequencies are given in cycles per millimetre of sensor, then in cycles per pixel of side ``pixel_um``.
    """
    falls = [falls_to(mtf, level, die) for level in LEVELS]
    return [auc_radial_min(mtf, die), *falls, *(_per_pixel(quantity, pixel_um) for quantity in falls)]


def auc_radial_min(mtf: Mtf, die: str | None) -> Quantity:
    """Area under the radial minimum, as a mean over its frequencies."""
    return Quantity(
        "auc_radial_min",
        area_under_radial_min(mtf),
        "mean of the radial minimum of the presampled MTF from 0 to half a cycle per pixel, from the lag table",
        uncertainty=mtf.minimum_uncertainty,
        die=die,
        wavelength_nm=mtf.wavelength_nm,
    )


def falls_to(mtf: Mtf, level: float, die: str | None) -> Quantity:
    """Frequency at which the radial mean falls to a level, in per cent, about which the MTF knows it on exact radii."""
    frequency, error = frequency_at(mtf, level / 100) or (None, None)
    return Quantity(
        f"mtf{level:g}",
        frequency,
        f"first frequency at which the mean over directions of the presampled MTF falls to {level:g} %; none: "
        f"not before {mtf.frequency_cy_per_mm[-1]:g} cy/mm",
        uncertainty=error,
        die=die,
        wavelength_nm=mtf.wavelength_nm,
    )


def _per_pixel(quantity: Quantity, pixel_um: float) -> Quantity:
    value, error = (
        None if number is None else float(cy_per_pixel(np.array(number), pixel_um))
        for number in (quantity.value, quantity.uncertainty)
    )
    return replace(
        quantity,
        name=f"{quantity.name}_per_pixel",
        value=value,
        uncertainty=error,
        method=f"{quantity.name} times the pixel of {pixel_um:g} um; 0.5 is the highest frequency that pixels hold",
    )


def energy_in_window(psf: Psf, camera: Camera, difference: float, die: str | None) -> Quantity:
    """Share of all transmitted energy inside the PSF's window.

    Args:
        camera: for the highest frequency, with which the pixels' own error grows.
    """
    width = psf.step_um * psf.values.shape[0]
    return Quantity(
        "psf_energy_in_window",
        psf.energy_in_window,
        f"sum of the pixel-integrated PSF over {width:g} um x {width:g} um; the rest lies outside",
        uncertainty=difference + pixel_sum_error(psf, cutoff(camera, psf.wavelength_nm)),
        die=die,
        wavelength_nm=psf.wavelength_nm,
    )


def strehl_quantities(
    psf: Psf,
    camera: Camera,
    energy_um2: float,
    area_um2: float,
    die: str | None,
    limit: float,
    leak: Leak | None = None,
) -> list[Quantity]:
    """Peak intensity against the clear stop's, and its distance from the square of the open ratio, which fixes it.

    Where the film leaks τ, the mean amplitude η + τ (1 - η) stands for the open ratio.

    Args:
        psf: sampled at points, its middle on the axis.
        energy_um2: clear area inside the stop by which the PSF was normalised, the leak aside.
        area_um2: clear area inside the stop from another source than the PSF.
    """
    scale = image_scale_um2(camera, psf.wavelength_nm)
    stop = camera.stop
    middle = psf.values.shape[0] // 2
    passed_um2 = energy_um2 if leak is None else leak.energy_um2(energy_um2)
    strehl = float(psf.values[middle, middle]) * scale**2 * passed_um2 / stop.area_um2**2
    field_um2 = area_um2 if leak is None else abs(leak.field_integral_um2(area_um2))
    error = abs(strehl / (field_um2 / stop.area_um2) ** 2 - 1)
    return [
        Quantity(
            "peak_strehl",
            strehl,
            f"peak of the PSF over that of the open stop; {_FIXED_BY[leak is not None]} alone fixes it, so it ranks no "
            "design",
            uncertainty=2 * AREA_ERROR * strehl,
            die=die,
            wavelength_nm=psf.wavelength_nm,
        ),
        Quantity(
            "strehl_invariant_error",
            error,
            f"peak Strehl of the matrix path against {_FIXED_BY[leak is not None]} squared, from the polygons' area",
            uncertainty=2 * AREA_ERROR * (1 + error),
            limit=limit,
            passed=error <= limit,
            die=die,
            wavelength_nm=psf.wavelength_nm,
        ),
    ]


def mtf_volume(table: LagTable, area_um2: float, die: str | None, limit: float, leak: Leak | None = None) -> Quantity:
    """Volume under the two-dimensional MTF over that of the open stop, which the open ratio fixes.

    The integral of the normalised autocorrelation of a binary pupil is its clear area, for the open stop the stop's,
    and their ratio is the open ratio. Where the film leaks, the square of the mean amplitude over the mean intensity
    stands for it.
    """
    expected = area_um2 if leak is None else leak.volume_um2(area_um2)
    error = abs(table.volume_um2 / expected - 1)
    return Quantity(
        "mtf_volume_invariant_error",
        error,
        f"volume under the 2-D MTF from the lag table against {_VOLUME_BY[leak is not None]} from the polygons' area",
        uncertainty=max(AREA_ERROR, table.floor),
        limit=limit,
        passed=error <= limit,
        die=die,
    )


def aliasing_quantities(
    lags: tuple[AxisLags, AxisLags], table: LagTable, mtf: Mtf, camera: Camera, die: str | None
) -> list[Quantity]:
    """Difference between the MTF sampled once per pixel and the presampled one, and its variation with phase.

    Args:
        table: of the same pupil; gives energy and error bound.
        mtf: presampled, of the same table; gives frequencies and wavelength.
    """
    aliased = aliased_cuts(lags, table, mtf, camera)
    # From the same lags as the aliases, or their errors would count as aliasing.
    nu, scale = mtf.frequency_cy_per_mm * 1e-3, image_scale_um2(camera, mtf.wavelength_nm)
    presampled = np.concatenate([abs(axis.at(scale * nu)) * np.sinc(nu * camera.pixel_um) for axis in lags])
    presampled /= table.energy_um2
    spread = phase_spread(aliased, presampled, die)
    aside, turned = _alias_errors(lags, table, mtf, camera)
    # Beyond the cutoff the lags of dots that the stop cuts hold some light that is none.
    turned = turned + np.where(np.tile(nu < cutoff(camera, mtf.wavelength_nm), 2), _ROUNDING, presampled)
    change = aliased.highest - aliased.lowest
    return [
        replace(
            spread,
            method="aliased, unlike the other MTFs: "
            + spread.method.removesuffix("the cut")
            + "horizontal and vertical",
            uncertainty=_of_largest(abs(aliased.values - presampled).max(axis=(0, 1)), aside + turned),
            wavelength_nm=mtf.wavelength_nm,
        ),
        Quantity(
            "mtf_phase_range",
            float(change.max()),
            "aliased: largest change of the MTF of pixel samples with the sub-pixel phase, over the horizontal and "
            f"vertical frequencies up to half a cycle per pixel, {PHASES} x {PHASES} phases",
            uncertainty=_of_largest(change, 2 * aside + turned),
            die=die,
            wavelength_nm=mtf.wavelength_nm,
        ),
    ]


def _of_largest(values: Floats, errors: Floats) -> float:
    largest = float(values.max())
    return max(float((values + errors).max()) - largest, largest - float((values - errors).max()))


def _aliases(mtf: Mtf, camera: Camera) -> tuple[Floats, Floats, Floats]:
    """Orders [k], the frequencies that fold onto those of an MTF, and the pixel's transfer there, [k, n]."""
    nu, highest = mtf.frequency_cy_per_mm * 1e-3, cutoff(camera, mtf.wavelength_nm)
    last = math.ceil((highest + float(nu[-1])) * camera.pixel_um)
    orders = np.arange(-last, last + 1, dtype=np.float64)
    alias = nu + orders[:, None] / camera.pixel_um
    return orders, alias, np.where(abs(alias) < highest, np.sinc(alias * camera.pixel_um), 0.0)


def _alias_errors(lags: tuple[AxisLags, AxisLags], table: LagTable, mtf: Mtf, camera: Camera) -> tuple[Floats, Floats]:
    """Errors [2 n] of an aliased MTF less the presampled one: by what folds onto it, and by what it folds onto."""
    orders, alias, pixel = _aliases(mtf, camera)
    scale, own = image_scale_um2(camera, mtf.wavelength_nm), orders == 0
    aside, turned = [], []
    for axis in lags:
        error = abs(pixel) * axis.error_at(scale * alias, table)
        aside.append(error[~own].sum(axis=0))
        parts = abs(axis.at(scale * alias) / table.energy_um2 * pixel)
        others = parts[~own].sum(axis=0)
        turned.append(error[own][0] * 2 * others / np.maximum(np.maximum(parts[own][0], others), np.finfo(float).tiny))
    return np.concatenate(aside), np.concatenate(turned)


def aliased_cuts(lags: tuple[AxisLags, AxisLags], table: LagTable, mtf: Mtf, camera: Camera) -> AliasedMtf:
    """The aliased MTF of pixel means along x, then along y, at the frequencies of a presampled one.

    A pixel's sinc is zero at whole cycles per pixel, so on either axis only aliases along that axis are left, and lags
    along it are all they need: the values are those of :func:`maskfab.optics.mtf.aliased_mtf` without the
    lags of the whole plane. For the same reason the samples sum to 1 whatever the phase.
    """
    nu, scale = mtf.frequency_cy_per_mm * 1e-3, image_scale_um2(camera, mtf.wavelength_nm)
    orders, alias, pixel = _aliases(mtf, camera)
    phase = np.arange(PHASES, dtype=np.float64) / PHASES
    turn = np.exp(2j * np.pi * phase[:, None] * orders)
    along_x, along_y = (abs(turn @ (axis.at(scale * alias) / table.energy_um2 * pixel)) for axis in lags)
    shape = (PHASES, PHASES, along_x.shape[1])
    values = np.concatenate([np.broadcast_to(along_x[None], shape), np.broadcast_to(along_y[:, None], shape)], axis=-1)
    none = np.zeros_like(nu)
    frequency = UM_PER_MM * np.stack([np.concatenate([nu, none]), np.concatenate([none, nu])])
    uncertainty = float(abs(pixel).sum(axis=0).max()) * table.coarse_uncertainty
    return AliasedMtf(frequency, values, phase, "pixel", uncertainty)


def restoration_quantities(table: LagTable, camera: Camera, wavelength_nm: float, die: str | None) -> list[Quantity]:
    """Worst restored contrast of a Wiener filter, and its noise amplification."""
    line = Spectrum(np.array([wavelength_nm]), np.ones(1), f"{wavelength_nm:g} nm")
    square = sensor_square(table, camera, line, _WIENER_SAMPLES)
    return [worst_wiener(square, NOISE_TO_SIGNAL, die), noise_gain(square, NOISE_TO_SIGNAL, die)]


def shape_quantities(seen: ExactPsf, pixels: Psf, camera: Camera, die: str | None) -> list[Quantity]:
    """Core, halo and streaks of one wavelength's PSF; cheap, so fit for every wavelength.

    Core and halo are counted in whole pixels, the others found between points. Radii that a small window cannot hold
    shrink to it; what it cannot tell at all is None.

    Args:
        seen: sampled at points over the window, and the field itself.
    """
    points = seen.samples
    highest = cutoff(camera, points.wavelength_nm)
    core = min(_CORE_PIXELS, pixels.values.shape[0]) * pixels.step_um
    return [
        ensquared_energy(pixels, core, highest, die),
        _closer_halo(halo_of(pixels, die), seen, pixels),
        _streaks(points, die),
        energy_normalised_strehl(points, camera, die),
    ]


def _closer_halo(halo: Quantity, seen: ExactPsf, pixels: Psf) -> Quantity:
    """The halo with the error of counting whole pixels, as the field itself tells it."""
    inside, error = seen.in_circle(min(_HALO_UM, pixels.step_um * pixels.values.shape[0] / 2))
    return replace(halo, uncertainty=abs(1 - inside - float(halo.value or 0.0)) + error)


def halo_of(psf: Psf, die: str | None) -> Quantity:
    """The halo's share of a PSF's energy, as for :func:`shape_quantities`."""
    half = psf.step_um * psf.values.shape[0] / 2
    return halo_energy(psf, min(_HALO_UM, half), die)


def holds_halo(window_um: float) -> bool:
    """Whether a camera's window is as wide as the radius beyond which the halo is counted, not less."""
    return window_um / 2 >= _HALO_UM


def colour_quantities(pixels: Sequence[Psf], die: str | None, edges: Sequence[EdgeSpread] = ()) -> list[Quantity]:
    """Differences of three colours, longest wavelength red, shortest blue; nothing for any other number of them.

    Args:
        pixels: averaged over pixels, one of each colour.
        edges: an edge in each colour; none where only the window tells it.
    """
    if len(pixels) != 3:
        return []
    blue, _, red = sorted(pixels, key=lambda psf: psf.wavelength_nm)
    blue_edge, green_edge, red_edge = sorted(edges or map(edge_in_window, pixels), key=lambda edge: edge.wavelength_nm)
    return [
        _if_known(colour_distance(red, blue, die), _LEAST_DISTANCE),
        _if_known(edge_colour_difference(red_edge, green_edge, blue_edge, die), JUST_NOTICEABLE),
    ]


def _if_known(quantity: Quantity, least: float) -> Quantity:
    """The quantity; without its value if the error bar is a large part of that, and of the least that counts."""
    value, error = quantity.value, quantity.uncertainty or 0.0
    if not isinstance(value, float) or error <= max(_LARGEST_BAR * value, least):
        return quantity
    reason = f"; not told, for its error would be {error:.2g} of {value:.2g}: widen camera.window"
    return replace(quantity, value=None, uncertainty=None, method=quantity.method + reason)


def _streaks(points: Psf, die: str | None) -> Quantity:
    half = points.step_um * (points.values.shape[0] // 2)
    outer = min(_STREAK_UM[1], half)
    inner = min(_STREAK_UM[0], outer / 2)
    try:
        return streak_index(_middle_part(points, outer), inner, outer, die)
    except JobError as problem:  # a window of a few samples, or a dark one
        return Quantity("streak_index", None, problem.what, die=die, wavelength_nm=points.wavelength_nm)  # fmt: skip


def _middle_part(psf: Psf, reach_um: float) -> Psf:
    """The samples of a PSF up to a distance from the axis, along x and y."""
    middle = psf.values.shape[0] // 2
    reach = min(middle, math.ceil(reach_um / psf.step_um - 1e-9))
    part = slice(middle - reach, middle + reach + 1)
    return Psf(psf.values[part, part], psf.step_um, psf.wavelength_nm, psf.kind)


def relative_difference(measured: Psf, reference: Psf) -> float:
    """Relative L2 distance of two PSFs on one grid."""
    return float(np.linalg.norm(measured.values - reference.values) / np.linalg.norm(reference.values))
