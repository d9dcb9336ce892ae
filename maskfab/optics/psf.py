"""Point spread functions: the field's intensity on the sensor, at points or averaged over pixels.

The intensity at sensor position x is |F(x / (λf))|² / ((λf)² E), with E the transmitted energy, so that it integrates
to 1 over the whole sensor plane (Parseval): what lies outside the window is missing from the window's sum, not hidden.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.polynomial.legendre import leggauss
from numpy.typing import NDArray

from maskfab.model import Camera, Psf
from maskfab.optics.field import parity_field
from maskfab.optics.pupil import Pupil

Floats = NDArray[np.float64]

_PIXEL_TOLERANCE = 1e-7


def image_scale_um2(camera: Camera, wavelength_nm: float) -> float:
    """λf in square micrometres: sensor position divided by it is spatial frequency in cycles per micrometre."""
    return wavelength_nm * 1e-3 * camera.focal_um


def point_step_um(camera: Camera) -> float:
    """The largest whole fraction of a pixel that samples the PSF at every wavelength without aliasing.

    The intensity holds frequencies up to D / (λf), so the step is at most λf / (2D).
    """
    nyquist = min(image_scale_um2(camera, w) for w in camera.wavelengths_nm) / (2 * camera.stop.diameter_um)
    return camera.pixel_um / math.ceil(camera.pixel_um / nyquist)


def odd_samples(width_um: float, step_um: float) -> int:
    """How many samples, an odd number with one on the axis, fit a window of that width."""
    return 2 * int((width_um / step_um - 1) / 2 + 1e-9) + 1


def point_psf(pupil: Pupil, camera: Camera, wavelength_nm: float) -> Psf:
    """Intensity at points ``point_step_um`` apart over the camera's window."""
    step = point_step_um(camera)
    scale = image_scale_um2(camera, wavelength_nm)
    frequency = step * np.arange(odd_samples(camera.window_um, step) // 2 + 1, dtype=np.float64) / scale
    intensity = parity_field(pupil, frequency, frequency).intensity()
    return Psf(intensity / (scale**2 * pupil.energy_um2), step, wavelength_nm, "point")


def pixel_psf(pupil: Pupil, camera: Camera, wavelength_nm: float) -> Psf:
    """Intensity averaged over square pixels, one of them centred on the axis, over the camera's window.

    Gauss-Legendre nodes within each pixel are folded into the transform; their number follows from the highest
    frequency that the stop lets through.
    """
    scale = image_scale_um2(camera, wavelength_nm)
    nodes, weights = leggauss(_nodes_per_pixel(camera, scale))
    pixels = odd_samples(camera.window_um, camera.pixel_um)
    half = pixels // 2
    centres = camera.pixel_um * np.arange(-half, half + 1, dtype=np.float64)
    positions = (centres[:, None] + nodes * camera.pixel_um / 2).ravel()
    quadrant = positions[positions > -1e-9 * camera.pixel_um] / scale
    if nodes.size % 2:
        quadrant[0] = 0.0
    intensity = parity_field(pupil, quadrant, quadrant).intensity()
    cells = intensity.reshape(pixels, nodes.size, pixels, nodes.size)
    averaged = np.einsum("iajb,a,b->ij", cells, weights / 2, weights / 2, optimize=True)
    return Psf(averaged / (scale**2 * pupil.energy_um2), camera.pixel_um, wavelength_nm, "pixel")


def _nodes_per_pixel(camera: Camera, scale_um2: float) -> int:
    """The fewest Gauss-Legendre nodes that integrate the fastest cosine over a pixel to 1e-7."""
    phase = np.pi * camera.stop.diameter_um * camera.pixel_um / scale_um2
    for count in range(2, 64):
        nodes, weights = leggauss(count)
        if abs(np.cos(phase * nodes) @ weights / 2 - np.sinc(phase / np.pi)) < _PIXEL_TOLERANCE:
            return count
    return 64
