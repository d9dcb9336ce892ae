r"""Point spread functions: the field's intensity on the sensor, at points or averaged over pixels.

The intensity at sensor position x is |F(x / (λf))|² / ((λf)² E), with E the transmitted energy, so that it integrates
to 1 over the whole sensor plane (Parseval): what lies outside the window is missing from the window's sum, not hidden.

It holds no frequency above B = D / (λf), so samples closer than 1 / (2B) say all about it, averages over pixels
included: a short symmetric filter w with Σ w_n cos(2πν n h) = sinc(νp) for all |ν| <= B turns samples at distance h
into means over pixels of side p, exactly but for the residual of that equation.
"""

from __future__ import annotations

import math
from functools import lru_cache

import numpy as np

from maskfab.base.arrays import Floats
from maskfab.model import Camera, Psf
from maskfab.optics.field.methods import FieldTask, admissible, field
from maskfab.optics.field.parity import ParityField
from maskfab.optics.image.leak import Leak
from maskfab.optics.pupil.pupil import Pupil
from maskfab.units import UM_PER_NM

_OVERSAMPLING = 1.15
FILTER_TOLERANCE = 1e-10
"""Largest error of the pixel filter's transfer function, which is sinc(νp)."""


def image_scale_um2(camera: Camera, wavelength_nm: float) -> float:
    """λf in square micrometres: sensor position divided by it is spatial frequency in cycles per micrometre."""
    return wavelength_nm * UM_PER_NM * camera.focal_um


def cutoff(camera: Camera, wavelength_nm: float) -> float:
    """Highest frequency of the intensity along an axis, in cycles per micrometre of sensor: D / (λf)."""
    return camera.stop.diameter_um / image_scale_um2(camera, wavelength_nm)


def point_step_um(camera: Camera) -> float:
    """The largest whole fraction of a pixel that samples the PSF at every wavelength, with 15 % to spare."""
    highest = max(cutoff(camera, wavelength) for wavelength in camera.wavelengths_nm)
    return camera.pixel_um / math.ceil(camera.pixel_um * 2 * highest * _OVERSAMPLING)


def odd_samples(width_um: float, step_um: float) -> int:
    """Number of samples, odd with one on the axis, that fit a window of that width."""
    return 2 * int((width_um / step_um - 1) / 2 + 1e-9) + 1


def point_psf(pupil: Pupil, camera: Camera, wavelength_nm: float, margin: int = 0) -> Psf:
    """Intensity at points ``point_step_um`` apart over the camera's window, and ``margin`` points beyond it."""
    frequency = _frequencies(camera, wavelength_nm, margin)
    return _point_psf(field(pupil, frequency, frequency), pupil, camera, wavelength_nm)


def point_psfs(pupil: Pupil, camera: Camera, margin: int = 0, leak: Leak | None = None) -> list[Psf]:
    """PSFs at every wavelength of the camera, the pupil made ready once, by the cheapest path that takes it.

    With a leak the pupil is that of the openings of a binary mask, and the film's light is added.
    """
    frequencies = [_frequencies(camera, wavelength, margin) for wavelength in camera.wavelengths_nm]
    widest = max(frequencies, key=lambda frequency: float(frequency[-1]))
    tasks = [FieldTask.of(pupil, frequency, frequency) for frequency in frequencies]
    # A step that suits a transform at one wavelength does not at another.
    path = next(
        path
        for path in admissible(FieldTask.of(pupil, widest, widest))
        if all(path.refusal(task) is None for task in tasks)
    )
    prepared = path.prepare(pupil, float(widest[-1]), float(widest[-1]), "double")
    return [
        _point_psf(prepared.field(frequency, frequency), pupil, camera, wavelength)
        if leak is None
        else _leaking_psf(prepared.field(frequency, frequency), pupil, camera, wavelength, frequency, leak)
        for frequency, wavelength in zip(frequencies, camera.wavelengths_nm, strict=True)
    ]


def _frequencies(camera: Camera, wavelength_nm: float, margin: int) -> Floats:
    step = point_step_um(camera)
    reach = odd_samples(camera.window_um, step) // 2 + margin
    return step * np.arange(reach + 1, dtype=np.float64) / image_scale_um2(camera, wavelength_nm)


def _point_psf(quadrant: ParityField, pupil: Pupil, camera: Camera, wavelength_nm: float) -> Psf:
    scale = image_scale_um2(camera, wavelength_nm)
    values = quadrant.intensity()
    values /= scale**2 * pupil.energy_um2
    values.flags.writeable = False
    return Psf(values, point_step_um(camera), wavelength_nm, "point")


def _leaking_psf(
    quadrant: ParityField, pupil: Pupil, camera: Camera, wavelength_nm: float, frequency: Floats, leak: Leak
) -> Psf:
    found = leak.field(quadrant.amplitude(), np.concatenate([-frequency[:0:-1], frequency]))
    scale = image_scale_um2(camera, wavelength_nm)
    values = (found.real**2 + found.imag**2) / (scale**2 * leak.energy_um2(pupil.energy_um2))
    return Psf(values, point_step_um(camera), wavelength_nm, "point")


def pixel_psf(points: Psf, camera: Camera) -> Psf:
    """Means over square pixels, one of them centred on the axis, over the camera's window.

    Args:
        points: sampled at ``point_step_um`` with a margin of at least :func:`pixel_margin`.
        camera: gives the pixel and the window.
    """
    weights = _pixel_filter(camera.pixel_um, points.step_um, cutoff(camera, points.wavelength_nm))
    reach = weights.size // 2
    stride = round(camera.pixel_um / points.step_um)
    half = odd_samples(camera.window_um, camera.pixel_um) // 2
    middle = points.values.shape[0] // 2
    centres = middle + stride * np.arange(-half, half + 1)
    gather = np.zeros((centres.size, points.values.shape[0]))
    gather[np.arange(centres.size)[:, None], centres[:, None] + np.arange(-reach, reach + 1)] = weights
    return Psf(gather @ points.values @ gather.T, camera.pixel_um, points.wavelength_nm, "pixel")


def pixel_sum_error(pixels: Psf, highest: float) -> float:
    """Bound of what the pixel filter adds to an energy that pixel means are summed to.

    Along an axis a sum over n pixels weighs the filter's error at ν by p |sin(πnνp) / sin(πνp)|, whose integral over
    1/p is Lebesgue's constant, below 1.3 + 0.41 ln n, and a transfer function is nowhere above 1.

    Args:
        pixels: the means; their number along a side is taken for n.
        highest: the PSF's highest frequency along an axis, cycles per micrometre of sensor.
    """
    periods = math.ceil(2 * highest * pixels.step_um) + 1
    return 2 * FILTER_TOLERANCE * periods * (1.3 + 0.41 * math.log(pixels.values.shape[0]))


def pixel_margin(camera: Camera) -> int:
    """Number of points beyond the window that the pixel filter needs at every wavelength."""
    step = point_step_um(camera)
    inside = odd_samples(camera.window_um, step) // 2
    pixels = round(camera.pixel_um / step) * (odd_samples(camera.window_um, camera.pixel_um) // 2)
    sizes = [_pixel_filter(camera.pixel_um, step, cutoff(camera, w)).size // 2 for w in camera.wavelengths_nm]
    return max(0, pixels + max(sizes) - inside)


def within(points: Psf, camera: Camera) -> Psf:
    """A PSF without its margin."""
    surplus = (points.values.shape[0] - odd_samples(camera.window_um, points.step_um)) // 2
    if surplus == 0:
        return points
    inner = points.values[surplus:-surplus, surplus:-surplus]
    return Psf(inner, points.step_um, points.wavelength_nm, points.kind)


@lru_cache(maxsize=64)
def _pixel_filter(pixel_um: float, step_um: float, highest: float) -> Floats:
    """Weights [2 n + 1] that average samples ``step_um`` apart over a pixel, for frequencies up to ``highest``.

    The samples' plain mean, and least squares on the band for what it lacks, which taps about the pixel's rim make up;
    they grow until the worst error anywhere in the band is below the tolerance.
    """
    steps = round(pixel_um / step_um)
    beyond, error = 2, np.inf
    while error >= FILTER_TOLERANCE:
        last = steps // 2 + beyond
        band = np.linspace(0.0, highest, max(801, 8 * last))
        tap = np.arange(last + 1)
        weights = np.where(2 * tap < steps, 1.0, np.where(2 * tap == steps, 0.5, 0.0)) / steps
        basis = 2 * np.cos(2 * np.pi * band[:, None] * step_um * tap)
        basis[:, 0] = 1.0
        lacking = np.sinc(band * pixel_um) - basis @ weights
        rim = basis[:, max(0, last - 2 * beyond) :]
        # Beyond working precision more taps only grow; the pseudo-inverse keeps them small.
        solution = np.linalg.lstsq(rim, lacking, rcond=1e-13)[0]
        error = abs(rim @ solution - lacking).max()
        weights[-solution.size :] += solution
        beyond += 4
    both: Floats = np.concatenate([weights[:0:-1], weights])
    both.flags.writeable = False
    return both
