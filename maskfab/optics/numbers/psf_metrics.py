r"""Numbers of a PSF's shape: side lobes, streaks, colour fringes, and the Strehl ratio that no shape can change.

Notes:
    Samples of a real, dark-and-clear pupil's PSF are symmetric about the axis and nowhere above its value there.
    All sums use that the PSF's samples are closer than 1 / (2B): then sums against smooth weights are integrals.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from maskfab.base.arrays import Floats
from maskfab.errors import InternalError, JobError
from maskfab.model import Camera, Psf, Quantity
from maskfab.optics.image.psf import image_scale_um2

# Below it a maximum is rounding noise.
_FAINTEST = 1e-12
_STREAK_ORDERS = 18


def peak_to_side_lobe(psf: Psf, die: str | None = None) -> Quantity:
    """Peak over the brightest side lobe, a side lobe being any other local maximum; None if the window has none."""
    lobes = _side_lobes(psf)
    peak = _peak(psf)
    value = uncertainty = None
    where = "none inside the window"
    if lobes.size:
        best = lobes[np.argmax(lobes[:, 1])]
        value = peak / float(best[1])
        uncertainty = value * float(best[2] / best[1])
        where = f"the brightest is {best[0]:.4g} um from the axis"
    return Quantity(
        "peak_to_side_lobe",
        value,
        f"peak over the brightest other local maximum, refined by a parabola through 3 x 3 samples; {where}",
        uncertainty=uncertainty,
        die=die,
        wavelength_nm=psf.wavelength_nm,
    )


def first_side_lobe(psf: Psf, die: str | None = None) -> Quantity:
    """Distance of the side lobe nearest to the axis; None if the window has none."""
    lobes = _side_lobes(psf)
    nearest = float(lobes[:, 0].min()) if lobes.size else None
    return Quantity(
        "first_side_lobe",
        nearest,
        "distance from the axis of the nearest other local maximum, refined by a parabola through 3 x 3 samples",
        uncertainty=None if nearest is None else psf.step_um / 2,
        die=die,
        wavelength_nm=psf.wavelength_nm,
    )


def brightest_side_lobe(psf: Psf, die: str | None = None) -> Quantity:
    """Distance of the brightest side lobe from the axis; None if the window has none."""
    lobes = _side_lobes(psf)
    place = float(lobes[np.argmax(lobes[:, 1]), 0]) if lobes.size else None
    return Quantity(
        "brightest_side_lobe",
        place,
        "distance from the axis of the brightest other local maximum, refined by a parabola through 3 x 3 samples",
        uncertainty=None if place is None else psf.step_um / 2,
        die=die,
        wavelength_nm=psf.wavelength_nm,
    )


def streak_index(psf: Psf, inner_um: float, outer_um: float, die: str | None = None) -> Quantity:
    """Starburst: brightest direction of the tail over the mean of all directions.

    The tail is weighted by sin² from the inner to the outer radius, and its angular distribution is smoothed by a
    Fejér kernel in twice the angle, 10° wide and nowhere negative: 1 for a rotationally symmetric PSF, 19 for a tail
    that is a single line.

    Args:
        psf: sampled or averaged over pixels.
        inner_um, outer_um: the annulus, at most half the window.
        die: whose number this is.

    Raises:
        JobError: MF104 for an annulus that is empty, reaches beyond the window, or holds no light.
    """
    half = psf.step_um * (psf.values.shape[0] // 2)
    if not 0 <= inner_um < outer_um <= half * (1 + 1e-9):
        raise JobError(
            "MF104",
            f"the annulus {inner_um:g} um to {outer_um:g} um is not an ascending pair between 0 and {half:g} um",
            cure="Widen camera.window or choose smaller radii",
        )
    axis = _axis(psf)
    x, y = np.meshgrid(axis, axis)
    radius = np.hypot(x, y)
    within = (radius > inner_um) & (radius < outer_um)
    weight = np.sin(np.pi * (radius[within] - inner_um) / (outer_um - inner_um)) ** 2
    # Twice the angle, because opposite directions are alike.
    turn = np.exp(-2j * np.arctan2(y[within], x[within]))
    tail = psf.values[within] * weight
    if not tail.sum() > 0:
        raise JobError(
            "MF104",
            f"no light falls between {inner_um:g} um and {outer_um:g} um",
            cure="Choose an annulus that contains samples with light",
        )
    # The same radial profile, cut into rings as fine as samples can hold, has no direction but what sampling gives it.
    ring = np.rint(radius[within] / psf.step_um).astype(np.intp)
    there = np.unique(ring)
    means = np.bincount(ring, tail)[there] / np.bincount(ring)[there]
    profile = np.interp(radius[within] / psf.step_um, there, means)
    rings = profile * (1 + np.cos(2 * np.pi * radius[within] / (2.3 * psf.step_um)))
    value, uniform = _brightest_direction(tail, turn), _brightest_direction(rings, turn)
    return Quantity(
        "streak_index",
        value,
        f"brightest direction over the mean of all, energy between {inner_um:g} um and {outer_um:g} um weighted by "
        "sin² of the radius, directions smoothed over 10 degrees; 1 is round, 19 a single line",
        uncertainty=value * (uniform - 1),
        die=die,
        wavelength_nm=psf.wavelength_nm,
    )


def energy_normalised_strehl(psf: Psf, camera: Camera, die: str | None = None) -> Quantity:
    """Peak per unit of transmitted energy against the open stop's: the open ratio fixes it, whatever the design."""
    if psf.kind != "point":
        raise InternalError("MF901", "a Strehl ratio was asked of pixel means")
    scale = image_scale_um2(camera, psf.wavelength_nm)
    value = _peak(psf) * scale**2 / camera.stop.area_um2
    return Quantity(
        "energy_normalised_strehl",
        value,
        "peak of the PSF, energies equal, over that of the open stop: the open ratio fixes it, so it ranks no design",
        uncertainty=1e-8,
        die=die,
        wavelength_nm=psf.wavelength_nm,
    )


def colour_distance(first: Psf, second: Psf, die: str | None = None) -> Quantity:
    """Half the integral of |difference| of two colours' pixel PSFs: the share of light that falls elsewhere, 0 to 1.

    Light outside the window, a share p of one colour and q of the other, adds between |p - q| / 2 and (p + q) / 2: the
    middle of both is told, and half of what lies between them is the error.

    Raises:
        InternalError: MF901 if they do not share a grid.
    """
    _same_grid(first, second)
    within = 0.5 * float(abs(first.values - second.values).sum()) * first.step_um**2
    outside = [max(0.0, 1 - psf.energy_in_window) for psf in (first, second)]
    return Quantity(
        "colour_distance",
        within + max(outside) / 2,
        f"half the integral of the absolute difference of the PSFs at {first.wavelength_nm:g} nm and "
        f"{second.wavelength_nm:g} nm; of their light {outside[0]:.2g} and {outside[1]:.2g} lie outside the window, "
        "which bounds what they add",
        uncertainty=min(outside) / 2,
        die=die,
    )


def _peak(psf: Psf) -> float:
    middle = psf.values.shape[0] // 2
    return float(psf.values[middle, middle])


def _axis(psf: Psf) -> Floats:
    half = psf.values.shape[0] // 2
    return psf.step_um * np.arange(-half, half + 1, dtype=np.float64)


def _same_grid(first: Psf, second: Psf) -> None:
    if first.values.shape != second.values.shape or not math.isclose(first.step_um, second.step_um):
        raise InternalError("MF901", "two PSFs on different grids were compared")


def _side_lobes(psf: Psf) -> Floats:
    """Distance, height and uncertainty of the height of every side lobe, [k, 3]."""
    values, middle = psf.values, psf.values.shape[0] // 2
    found = values > _FAINTEST * values[middle, middle]
    found[middle, middle] = False
    found[[0, -1]] = found[:, [0, -1]] = False
    across = np.maximum(np.maximum(values[:, :-2], values[:, 1:-1]), values[:, 2:])
    found[1:-1, 1:-1] &= values[1:-1, 1:-1] >= np.maximum(np.maximum(across[:-2], across[1:-1]), across[2:])
    row, column = np.nonzero(found)
    if not row.size:
        return np.empty((0, 3))
    near = np.stack([[values[row + j, column + i] for i in (-1, 0, 1)] for j in (-1, 0, 1)])
    slope = np.stack([near[1, 2] - near[1, 0], near[2, 1] - near[0, 1]], axis=-1) / 2
    across = (near[2, 2] + near[0, 0] - near[2, 0] - near[0, 2]) / 4
    curve_x, curve_y = near[1, 2] + near[1, 0] - 2 * near[1, 1], near[2, 1] + near[0, 1] - 2 * near[1, 1]
    curvature = np.stack([np.stack([curve_x, across], -1), np.stack([across, curve_y], -1)], -1)
    # Along a ring the curvature all but vanishes; its pseudo-inverse moves across the ring only.
    move = -np.einsum("kij,kj->ki", np.linalg.pinv(curvature, rcond=1e-2, hermitian=True), slope)
    move = np.where((abs(move) <= 1).all(axis=1, keepdims=True), move, 0.0)
    gain = np.einsum("ki,ki->k", slope, move) / 2
    distance = psf.step_um * np.hypot(row - middle + move[:, 1], column - middle + move[:, 0])
    lobe = near[1, 1]
    return np.stack([distance, lobe + gain, abs(gain) + 1e-15 * values[middle, middle]], axis=-1)


def _brightest_direction(tail: Floats, turn: NDArray[np.complex128]) -> float:
    """Largest over mean of an angular distribution, from its moments under a Fejér kernel."""
    order = np.arange(1, _STREAK_ORDERS + 1)
    moments, power = [], np.ones_like(turn)
    for _ in order:
        power = power * turn
        moments.append((tail * power).sum())
    relative = np.array(moments) / tail.sum() * (1 - order / (_STREAK_ORDERS + 1))
    angle = np.linspace(0, 2 * np.pi, 720, endpoint=False)
    return float(1 + 2 * (relative @ np.exp(1j * order[:, None] * angle)).real.max())
