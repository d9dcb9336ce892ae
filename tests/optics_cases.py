"""Small panels and cameras that the optics tests share with the hard cases, and PSFs of one effect alone."""

from __future__ import annotations

import math

import numpy as np

from maskfab.base.model import Psf
from maskfab.base.units import UM_PER_NM
from maskfab.job.camera import Camera
from maskfab.optics.field.matrix import parity_field
from maskfab.optics.gap import shift_um, shifted_pupil
from maskfab.optics.phase import (
    PhasedPupil,
    Wavefront,
    defocus_waves,
    image_distance_um,
    phased,
    phased_psf,
    window_frequency,
)
from maskfab.optics.psf import odd_samples, point_psf, point_step_um
from maskfab.optics.pupil import Pupil
from maskfab.trials.hard_cases import clear_region, noise
from maskfab.trials.hard_cases import example_camera as camera
from maskfab.trials.hard_cases import example_panel as panel
from maskfab.trials.hard_cases import example_pupil as pupil

__all__ = [
    "aberrated",
    "aberrated_psf",
    "camera",
    "clear_region",
    "defocused_psf",
    "focused_psf",
    "noise",
    "panel",
    "pupil",
]


def focused_psf(pupil: Pupil, camera: Camera, wavelength_nm: float, object_um: float, margin: int = 0) -> Psf:
    """Point PSF of an object in focus, on the samples of the one at infinity
    (:func:`maskfab.optics.psf.point_psf`).

    Raises:
        JobError: MF104 for an object within the focal length.
    """
    step = point_step_um(camera)
    scale = wavelength_nm * UM_PER_NM * image_distance_um(camera.focal_um, object_um)
    reach = odd_samples(camera.window_um, step) // 2 + margin
    frequency = step * np.arange(reach + 1, dtype=np.float64) / scale
    intensity = parity_field(pupil, frequency, frequency).intensity()
    return Psf(intensity / (scale**2 * pupil.energy_um2), step, wavelength_nm, "point")


def defocused_psf(
    pupil: Pupil,
    camera: Camera,
    wavelength_nm: float,
    object_um: float,
    focus_um: float = math.inf,
    *,
    tolerance: float = 1e-6,
    margin: int = 0,
) -> Psf:
    """Point PSF of an object while the camera is focused elsewhere, on the samples of the one at infinity.

    Args:
        pupil: openings inside the stop.
        camera: lens, stop and window.
        wavelength_nm: the line.
        object_um: distance of the object from the lens; may be infinite.
        focus_um: distance of what is in focus; may be infinite.
        tolerance: largest L2 error of the field in the window, relative to all energy.
        margin: points beyond the window.

    Raises:
        JobError: MF104 for a distance within the focal length, MF115 for a defocus too strong for the tolerance.
    """
    distance = image_distance_um(camera.focal_um, focus_um)
    waves = defocus_waves(camera, wavelength_nm, object_um, focus_um)
    highest = window_frequency(camera, wavelength_nm, distance) + margin * point_step_um(camera) / (
        wavelength_nm * UM_PER_NM * distance
    )
    source = phased(pupil, waves, highest, tolerance)
    return phased_psf(source, camera, wavelength_nm, distance_um=distance, margin=margin)


def aberrated(
    pupil: Pupil, wavefront: Wavefront, wavelength_nm: float, highest: float, tolerance: float = 1e-6
) -> PhasedPupil:
    """A pupil behind an aberrated lens.

    Args:
        pupil: openings inside the stop.
        wavefront: the lens's error.
        wavelength_nm: the line.
        highest: highest frequency along either axis that will be asked for, cycles per micrometre.
        tolerance: largest relative L2 error of the field below it.

    Raises:
        JobError: MF115 if the wavefront is too steep for that error.
    """
    return phased(pupil, wavefront.waves(pupil.stop, wavelength_nm), highest, tolerance)


def aberrated_psf(
    pupil: Pupil, wavefront: Wavefront, camera: Camera, wavelength_nm: float, tolerance: float = 1e-6
) -> Psf:
    """Point PSF of a pupil behind an aberrated lens, over the camera's window.

    Raises:
        JobError: MF115 if the wavefront is too steep for that error.
    """
    highest = window_frequency(camera, wavelength_nm)
    return phased_psf(aberrated(pupil, wavefront, wavelength_nm, highest, tolerance), camera, wavelength_nm)


def shifted_psf(openings, camera, wavelength_nm, gap_um, image_um=(0.0, 0.0)):
    """Point PSF about an image point, the gap as a shift of the openings only."""
    return point_psf(shifted_pupil(openings, camera.stop, shift_um(camera, gap_um, image_um)), camera, wavelength_nm)
