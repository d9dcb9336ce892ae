r"""PSF and MTF of image points over the field: behind a gap as shifts, tangential and sagittal cuts, and deblurring.

The optics' transfer is the transform of the point PSF (Goodman, Fourier Optics, 6.3),

    O(ν) = s² Σ_n I(x_n) exp(-2πi ν·x_n),

whose samples, s apart, are finer than its bandwidth asks for; times the pixel's own it is the presampled MTF. I holds
all light over all space, so |O| is exact but for the light outside the window.

Notes:
    What lies outside the window can add to |O| or take from it no more than its energy.
"""

from __future__ import annotations

import math

import numpy as np
import scipy

from maskfab.base.arrays import Floats
from maskfab.model import Camera, Psf
from maskfab.optics.pupil.aperture import Aperture
from maskfab.optics.wavefront.panel_gap import Place, shifted_psf


def field_places(reach_um: float, points: int = 5) -> tuple[tuple[Place, ...], ...]:
    """Image points on a square grid from -reach to reach, [y][x]; odd ``points`` have one on the axis."""
    across = np.linspace(-reach_um, reach_um, points)
    return tuple(tuple((float(x), float(y)) for x in across) for y in across)


def psf_over_field(
    openings: Aperture, camera: Camera, wavelength_nm: float, gap_um: float, places: tuple[tuple[Place, ...], ...]
) -> tuple[tuple[Psf, ...], ...]:
    """Point PSFs at image points, the gap as a shift; in the order of ``places``.

    Raises:
        JobError: MF104 for a gap that is no distance, MF114 if the panel does not cover the stop from every point.
    """
    return tuple(tuple(shifted_psf(openings, camera, wavelength_nm, gap_um, place) for place in row) for row in places)


def residual_blur(psf: Psf, centre: Psf, noise_to_signal: float) -> Floats:
    """Residue of a PSF after Wiener deblurring with another: its samples' share of the energy, float64 [n, n].

    Both are normalised to sum 1, as a camera's own calibration would have it.
    """
    sizes = [scipy.fft.next_fast_len(2 * n, real=True) for n in psf.values.shape]
    seen, assumed = (scipy.fft.rfft2(each.values / each.values.sum(), sizes) for each in (psf, centre))
    restored = scipy.fft.irfft2(seen * assumed.conj() / (abs(assumed) ** 2 + noise_to_signal), sizes)
    half = [n // 2 for n in psf.values.shape]
    rolled: Floats = np.roll(restored, half, axis=(0, 1))[: psf.values.shape[0], : psf.values.shape[1]]
    return rolled


def deblurring_residual(psf: Psf, centre: Psf, noise_to_signal: float) -> float:
    """Relative L2 distance of a residual blur from the one that the centre PSF itself would have left."""
    own = residual_blur(centre, centre, noise_to_signal)
    return float(np.linalg.norm(residual_blur(psf, centre, noise_to_signal) - own) / np.linalg.norm(own))


def tangential_cut(frequency: Floats, azimuth_rad: float) -> tuple[Floats, Floats]:
    """ν_x and ν_y of the tangential MTF of an image point at an azimuth (from the x axis, counter-clockwise).

    Its lines are tangents to circles about the optical axis, so its frequencies run along the radius (ISO 9334).
    """
    return frequency * math.cos(azimuth_rad), frequency * math.sin(azimuth_rad)


def sagittal_cut(frequency: Floats, azimuth_rad: float) -> tuple[Floats, Floats]:
    """ν_x and ν_y of the sagittal MTF: its lines run along the radius, its frequencies across it (ISO 9334)."""
    return -frequency * math.sin(azimuth_rad), frequency * math.cos(azimuth_rad)


def window_modulation(psf: Psf, nu_x: Floats, nu_y: Floats) -> tuple[Floats, float]:
    """|O| of a point PSF about the middle of its window, and the bound on its absolute error by the light outside.

    Args:
        psf: at points; that on pixels is sampled too coarsely.
        nu_x, nu_y: float64 [n], cycles per micrometre.

    Returns:
        Values, float64 [n], and the share of the energy outside the window.
    """
    count = psf.values.shape[0]
    place = psf.step_um * (np.arange(count, dtype=np.float64) - count // 2)
    along_x, along_y = (np.exp(-2j * np.pi * np.outer(nu, place)) for nu in (nu_x, nu_y))
    transform = np.einsum("nj,ji,ni->n", along_y, psf.values, along_x, optimize=True)
    return psf.step_um**2 * abs(transform), max(0.0, 1 - psf.energy_in_window)
