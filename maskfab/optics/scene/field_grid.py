"""PSFs over the field behind a gap, and what is left of each after deblurring with the one on the axis."""

from __future__ import annotations

import numpy as np
import scipy
from numpy.typing import NDArray

from maskfab.model import Camera, Psf
from maskfab.optics.pupil.aperture import Aperture
from maskfab.optics.wavefront.panel_gap import Place, shifted_psf

Floats = NDArray[np.float64]


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
