r"""Objects at a finite distance: in focus they scale the PSF, out of focus they put a parabola of phase on the pupil.

A thin lens images an object at distance z at z' = f z / (z - f). With the sensor at d, the image distance of whatever
the camera is focused on, the openings in the stop's plane are seen at frequencies u = x / (λ d), with the phase

    W(r) = ½ r² (1/d - 1/z') / λ     waves                                        (Goodman, Fourier Optics, 6.4.1)

which is r²/2λ times the difference of the object's and the focus' reciprocal distances. Within Fresnel's approximation
this is exact, and W = 0 in focus.

Notes:
    A PSF in focus at z is that at infinity stretched by d/f = 1 + f/(z - f). The change looks small, but it moves a
    speckle at radius r by r f/z, and speckle is λf/D wide: a point PSF of a wide stop is a different one long before
    its envelope is. Pixels wider than the speckle, and comparisons after stretching back, are far kinder.
    Fresnel's approximation drops D⁴/(64 λ d³)-sized phases of lens and path; they are the lens's to correct.
"""

from __future__ import annotations

import math

import numpy as np

from maskfab.base.arrays import Floats
from maskfab.errors import JobError
from maskfab.model import Camera, Psf
from maskfab.optics.pupil.stop_shape import Waves, stop_strehl
from maskfab.optics.wavefront.mean_over_tilings import MeanPsf, phase_error
from maskfab.units import UM_PER_NM


def image_distance_um(focal_um: float, object_um: float) -> float:
    """Distance behind a thin lens at which an object in front of it is imaged: f z / (z - f); f for one at infinity.

    Raises:
        JobError: MF104 for an object that is not beyond the focal length, and so has no real image.
    """
    if math.isinf(object_um) and object_um > 0:
        return focal_um
    if not object_um > focal_um:
        raise JobError(
            "MF104",
            f"an object {object_um:g} um from a lens of focal length {focal_um:g} um has no real image",
            cure="Move it beyond the focal length",
        )
    return focal_um * object_um / (object_um - focal_um)


def defocus_waves(camera: Camera, wavelength_nm: float, object_um: float, focus_um: float) -> Waves:
    """The phase of an object at one distance while the camera is focused at another, as a function of x, y in um.

    Raises:
        JobError: MF104 for a distance within the focal length.
    """
    curvature = 1 / image_distance_um(camera.focal_um, focus_um) - 1 / image_distance_um(camera.focal_um, object_um)
    factor = curvature / (2 * wavelength_nm * UM_PER_NM)

    def path(x_um: Floats, y_um: Floats) -> Floats:
        return np.asarray(factor * (x_um**2 + y_um**2))

    return path


def edge_defocus_waves(camera: Camera, wavelength_nm: float, object_um: float, focus_um: float) -> float:
    """The phase at the rim of a round stop (the middle of a square one's sides) in waves; negative beyond the focus."""
    radius = np.array(camera.stop.diameter_um / 2)
    return float(defocus_waves(camera, wavelength_nm, object_um, focus_um)(radius, np.zeros(())))


def clear_stop_strehl(waves_at_rim: float) -> float:
    """Strehl ratio of a clear round stop defocused by that many waves at its rim: sinc²(W) (Born and Wolf, 8.8.2)."""
    return float(np.sinc(waves_at_rim) ** 2)


def defocus_error(
    camera: Camera, wavelength_nm: float, object_um: float, focus_um: float = math.inf, mean: MeanPsf | None = None
) -> float:
    """Estimated relative L2 error of the PSF if the defocus is left out (:func:`ensemble.phase_error`).

    Args:
        camera: lens and stop.
        wavelength_nm: the line.
        object_um, focus_um: distances of the object and of what is in focus.
        mean: of the tiling; without it the answer is the most that any tiling shows, and needs no PSF.

    Raises:
        JobError: MF104 for a distance within the focal length.
    """
    edge = edge_defocus_waves(camera, wavelength_nm, object_um, focus_um)
    if camera.stop.shape == "circle":
        return phase_error(mean, clear_stop_strehl(edge))
    blur = defocus_waves(camera, wavelength_nm, object_um, focus_um)
    return phase_error(mean, stop_strehl(camera.stop, blur, 32 + 4 * math.ceil(abs(edge))))


def stretch_sensitivity(psf: Psf) -> float:
    """Relative L2 change of a PSF per relative stretch, ‖2 I + x·∇I‖ / ‖I‖ over its window.

    The derivative of I(x / m) / m² by m at m = 1. Gradients are spectral, which band-limited samples allow: with n
    samples h apart, n odd, the weight of the k-th beside is (-1)^k π / (nh sin(πk/n)) (L. N. Trefethen, Spectral
    Methods in MATLAB, 2000, chapter 3).

    Notes:
        The window's edges wrap round in the spectral gradient; it matters only if the PSF is not small there.
    """
    count = psf.values.shape[0]
    offset = psf.step_um * (np.arange(count, dtype=np.float64) - count // 2)
    beside = np.arange(1, count)
    weight = np.zeros(count)
    weight[1:] = np.where(beside % 2, -np.pi, np.pi) / (count * psf.step_um * np.sin(np.pi * beside / count))
    place = np.arange(count)
    slope = weight[place[:, None] - place]
    change = 2 * psf.values + (psf.values @ slope.T) * offset + offset[:, None] * (slope @ psf.values)
    return float(np.linalg.norm(change) / np.linalg.norm(psf.values))


def scale_error(psf: Psf, camera: Camera, object_um: float) -> float:
    """Estimated relative L2 error of the PSF, over its window, if an object in focus is taken to be at infinity.

    Proportional to the stretch δ = f / (z - f) at first, levelling at sqrt(2), where nothing is alike any more:
    sqrt(2 (1 - exp(-(κδ)² / 2))) with κ from :func:`stretch_sensitivity`. One PSF, at infinity, serves every distance.

    Args:
        psf: at infinity, sampled at points; of one averaged over pixels too wide for its speckle the gradients alias,
            and the answer comes out up to twice too high.
        camera: lens.
        object_um: distance of the object.

    Raises:
        JobError: MF104 for an object within the focal length.
    """
    stretch = image_distance_um(camera.focal_um, object_um) / camera.focal_um - 1
    return math.sqrt(-2 * math.expm1(-((stretch_sensitivity(psf) * stretch) ** 2) / 2))


def nearest_object_um(psf: Psf, camera: Camera, error: float) -> float:
    """The shortest distance at which :func:`scale_error` stays below ``error``: nearer, depth matters.

    Args:
        psf: at infinity.
        camera: lens.
        error: relative L2, in (0, 1).

    Raises:
        JobError: MF104 for an error outside that range.
    """
    if not 0 < error < 1:
        raise JobError("MF104", f"an error of {error:g} is outside 0 to 1", cure="Give a ratio: 0.05 for 5 %")
    stretch = math.sqrt(-2 * math.log1p(-(error**2) / 2)) / stretch_sensitivity(psf)
    return camera.focal_um * (1 + 1 / stretch)
