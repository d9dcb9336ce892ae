"""Numbers of a PSF: energy inside circles and squares, streaks, colour fringes, and diffraction orders.

**Energy** inside a circle or a square is a sum of whole pixels, wrong by at most what the pixels hold that the rim
crosses; of a square of whole pixels by no more than the pixels' own means.

Notes:
    Samples of a real, dark-and-clear pupil's PSF are symmetric about the axis and nowhere above its value there.
    All sums use that the PSF's samples are closer than 1 / (2B): then sums against smooth weights are integrals.

**Diffraction orders** are closed forms of the transform of one cell. A periodic panel of pitch T sends the share

    η_mn = |M(m/T, n/T)|² / T⁴                                   (Goodman, Fourier Optics, 4.4.3, for any cell)

of the light that falls on it into the order (m, n), M being the transform of one cell's amplitude. Over all orders
this adds up to the open ratio (Parseval), so η_mn over the open ratio is the share of the transmitted light. The
wavelength only sets where an order goes, to (m, n) λf / T on the sensor, not how strong it is.
"""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np

from maskfab.base.arrays import Complexes, Floats
from maskfab.base.errors import InternalError, JobError
from maskfab.base.model import Panel, Psf, Quantity
from maskfab.job.camera import Camera, Stop
from maskfab.optics.field.matrix import direct_field
from maskfab.optics.psf import image_scale_um2, pixel_sum_error
from maskfab.optics.pupil import cut, panel_aperture


def halo_energy(psf: Psf, radius_um: float, die: str | None = None) -> Quantity:
    """Share of all transmitted energy farther than a radius from the axis, outside the window included.

    Args:
        radius_um: at most half the window.

    Raises:
        JobError: MF104 for a radius that is not positive or reaches beyond the window.
    """
    _check(psf, radius_um, "radius")
    axis, area = _axis(psf), psf.step_um**2
    distance = np.hypot(axis[:, None], axis)
    # A cell whose middle is farther from the rim than half its diagonal is not crossed.
    crossed = abs(distance - radius_um) < psf.step_um / math.sqrt(2)
    value, uncertainty = (float(psf.values[cells].sum() * area) for cells in (distance <= radius_um, crossed))
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

    For an odd number of whole pixels this is a plain sum, and as good as they are.

    Args:
        side_um: at most the window's side.

    Raises:
        JobError: MF104 for a side that is not positive or wider than the window.
    """
    _check(psf, side_um / 2, "half side")
    axis, area = _axis(psf), psf.step_um**2
    # Whole pixels cross nothing, and err as their means do.
    rims = (side_um / 2 + by * psf.step_um * (1 - 1e-9) for by in (0.0, 0.5, -0.5))
    value, most, least = (
        float(psf.values[np.ix_(part, part)].sum() * area) for part in (abs(axis) <= rim for rim in rims)
    )
    uncertainty = most - least + pixel_sum_error(psf, highest)
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
        what = f"the {name} {reach_um:g} um is not between 0 and half the window, {half:g} um"
        raise JobError("MF104", what, cure="Widen camera.window or ask for less")


def _axis(psf: Psf) -> Floats:
    half = psf.values.shape[0] // 2
    return psf.step_um * np.arange(-half, half + 1, dtype=np.float64)


_STREAK_ORDERS = 18
# Of the area by which a PSF is normalised, relative.
_AREA_ERROR = 1e-8


def streak_index(psf: Psf, inner_um: float, outer_um: float, die: str | None = None) -> Quantity:
    """Starburst: brightest direction of the tail over the mean of all directions.

    The tail is weighted by sin² from the inner to the outer radius, and its angular distribution is smoothed by a
    Fejér kernel in twice the angle, 10° wide and nowhere negative: 1 for a rotationally symmetric PSF, 19 for a tail
    that is a single line.

    Args:
        inner_um, outer_um: the annulus, at most half the window.

    Raises:
        JobError: MF104 for an annulus that is empty, reaches beyond the window, or holds no light.
    """
    half = psf.step_um * (psf.values.shape[0] // 2)
    if not 0 <= inner_um < outer_um <= half * (1 + 1e-9):
        what = f"the annulus {inner_um:g} um to {outer_um:g} um is not an ascending pair between 0 and {half:g} um"
        raise JobError("MF104", what, cure="Widen camera.window or choose smaller radii")
    axis = _axis(psf)
    x, y = np.meshgrid(axis, axis)
    radius = np.hypot(x, y)
    within = (radius > inner_um) & (radius < outer_um)
    weight = np.sin(np.pi * (radius[within] - inner_um) / (outer_um - inner_um)) ** 2
    # Twice the angle, because opposite directions are alike.
    turn = np.exp(-2j * np.arctan2(y[within], x[within]))
    tail = psf.values[within] * weight
    if not tail.sum() > 0:
        what = f"no light falls between {inner_um:g} um and {outer_um:g} um"
        raise JobError("MF104", what, cure="Choose an annulus that contains samples with light")
    # The same radial profile, cut into rings as fine as samples can hold, has no direction but what sampling gives it.
    ring = np.rint(radius[within] / psf.step_um).astype(np.intp)
    counts = np.bincount(ring)
    there = np.flatnonzero(counts)
    means = np.bincount(ring, tail)[there] / counts[there]
    profile = np.interp(radius[within] / psf.step_um, there, means)
    rings = profile * (1 + np.cos(2 * np.pi * radius[within] / (2.3 * psf.step_um)))
    value, uniform = _brightest_directions(np.stack([tail, rings]), turn).tolist()
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
        uncertainty=_AREA_ERROR * value,
        die=die,
        wavelength_nm=psf.wavelength_nm,
    )


def colour_distance(first: Psf, second: Psf, die: str | None = None) -> Quantity:
    """Half the integral of |difference| of two colours' pixel PSFs: the share of light that falls elsewhere, 0 to 1.

    Light outside the window, a share p of one colour and q of the other, adds between |p - q| / 2 and (p + q) / 2: the
    middle of both is told, and half of what lies between them is the error.
    """
    if first.values.shape != second.values.shape or not math.isclose(first.step_um, second.step_um):
        raise InternalError("MF901", "two PSFs on different grids were compared")
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


def _brightest_directions(tails: Floats, turn: Complexes) -> Floats:
    """Largest over mean of angular distributions [k, n], from their moments under a Fejér kernel."""
    order = np.arange(1, _STREAK_ORDERS + 1)
    moments, power = np.empty((len(tails), order.size), dtype=np.complex128), np.ones_like(turn)
    for k in range(order.size):
        power *= turn
        moments[:, k] = (tails @ power.view(np.float64).reshape(-1, 2)).view(np.complex128)[:, 0]
    relative = moments / tails.sum(axis=1)[:, None] * (1 - order / (_STREAK_ORDERS + 1))
    angle = np.linspace(0, 2 * np.pi, 720, endpoint=False)
    return np.asarray(1 + 2 * (relative @ np.exp(1j * order[:, None] * angle)).real.max(axis=1))


def order_efficiencies(panel: Panel, highest: int) -> Floats:
    """η_mn as shares of the incident light, [2 h + 1, 2 h + 1] over n and m from -h to h.

    Args:
        panel: all its cells in one orientation.
        highest: largest |m| and |n|, at least 0.

    Raises:
        JobError: MF104 for a negative order.
    """
    if highest < 0:
        raise JobError("MF104", f"the highest order {highest} is negative", cure="Give 0 or more")
    if (panel.orientations != panel.orientations[0, 0]).any():
        raise InternalError("MF901", "diffraction orders were asked of a panel whose cells differ in orientation")
    cell = replace(panel, orientations=panel.orientations[:1, :1])
    pitch = panel.cell_size.pitch_um
    frequency = np.arange(-highest, highest + 1, dtype=np.float64) / pitch
    field = direct_field(cut(panel_aperture(cell), Stop("square", pitch)), frequency, frequency)
    return np.asarray(abs(field) ** 2 / pitch**4)


def order_quantities(panel: Panel, die: str | None = None) -> tuple[Quantity, ...]:
    """The zero order and the sum of the lowest five, each as a share of the incident and of the transmitted light."""
    share = order_efficiencies(panel, 1)
    zero = float(share[1, 1])
    five = zero + float(share[0, 1] + share[2, 1] + share[1, 0] + share[1, 2])
    rounding = 1e-12
    named = (("order_zero", zero, "zero order"), ("orders_lowest_five", five, "orders (0,0), (±1,0) and (0,±1)"))
    quantities = []
    for name, value, what in named:
        for light, whole in (("incident", 1.0), ("transmitted", panel.open_ratio)):
            quantities.append(
                Quantity(
                    f"{name}_{light}",
                    value / whole,
                    f"{what} of the periodic panel as a share of the {light} light, |M(m/T, n/T)|²/T⁴ from the cell's "
                    "transform",
                    uncertainty=rounding,
                    die=die,
                )
            )
    return tuple(quantities)
