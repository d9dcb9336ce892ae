"""Number of lines that stand for a band of light in a point PSF, by the error of each number.

Notes:
    The PSF in a window is smooth in the wavelength, so the error of Gauss nodes falls fast once the speckle at the
    window's edge moves by less than its size from one line to the next; before, lines buy little.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence

import numpy as np

from maskfab.base.arrays import Floats
from maskfab.errors import InternalError
from maskfab.model import Camera
from maskfab.optics.field.methods import PRUNED, FieldTask, admissible
from maskfab.optics.field.parity import SampledField
from maskfab.optics.image.psf import cutoff, image_scale_um2
from maskfab.optics.image.spectrum import Band, Spectrum, line_spectrum
from maskfab.optics.light.rays import RAYS_ERROR, Rays, beyond
from maskfab.optics.pupil.pupil import Pupil

BAND_SAFETY = 2.0
_MOST_LINES = 512
_LEAST_SAMPLES = 64


def band_lines(band: Band, count: int) -> Spectrum:
    """A band as so many lines: one at its mean wavelength, or four in each panel of :meth:`Band.quadrature`."""
    if count == 1:
        return line_spectrum([band.centroid_nm], name=band.name)
    return band.quadrature(count // 4)


def band_errors(pupil: Pupil, camera: Camera, bands: Sequence[Band]) -> dict[int, float]:
    """The error of replacing every band by 1, 4, 8, ... lines: relative L2 of the PSF in the window against the most
    tried, of the worst band; empty without bands.

    The PSF is looked at along rays to all sides of the window, as dense at its edge as places along a ray, three of
    which or more fall on the width of its sharpest orders; a place stands for its part of the window. Twice the lines
    are tried until doubling changes less than the rays' own error, or there are 512; the last has nothing to be
    compared with and is left out. A band that stood still earlier than others keeps its last error for more lines.
    """
    if not bands:
        return {}
    half, shortest_nm = camera.window_um / 2, min(band.range_nm[0] for band in bands)
    samples = max(_LEAST_SAMPLES, math.ceil(1.5 * half * cutoff(camera, shortest_nm)))
    slopes = (np.arange(samples, dtype=np.float64) + 0.5) / samples
    rays, own = _rays(pupil, half / image_scale_um2(camera, shortest_nm), slopes)
    # Evenly in the angle whose cosine it is, places see the peak on the axis, where even ones hardly do.
    count = math.ceil(np.pi / 2 * samples)
    angle = np.pi * (np.arange(count, dtype=np.float64) + 0.5) / count
    place = half * (1 - np.cos(angle)) / 2
    root = np.sqrt(place * np.sin(angle))[:, None]

    def seen(spectrum: Spectrum) -> Floats:
        """The PSF, weighted with the root of the area that a place stands for."""
        scales = np.array([image_scale_um2(camera, float(line)) for line in spectrum.wavelengths_nm])
        found = rays.combined(place, scales, spectrum.weights / scales**2)
        found *= root
        return found

    found = [_errors(band, seen, own) for band in bands]
    return {count: max(each.get(count, each[max(each)]) for each in found) for count in max(found, key=len)}


def _rays(pupil: Pupil, highest: float, slopes: Floats) -> tuple[Rays, float]:
    """A pupil's intensity along rays up to a frequency along the axes, and the error of what it shows."""
    reach = [float(abs(axis.edges_um()).max()) for axis in (pupil.x, pupil.y)]
    sides = pupil.stop.sides_um
    farthest = max(sides) / math.sqrt(2) if pupil.stop.round else sum(sides) / 2
    # The step of a discrete transform suits one wavelength only.
    path = next(
        path for path in admissible(FieldTask.of(pupil, highest * slopes, highest * slopes)) if path is not PRUNED
    )
    end = (beyond(farthest, highest),) * 2
    sampled = SampledField.of(path.prepare(pupil, *end, "double").field, (reach[0], reach[1]), end)
    return Rays.of(sampled, farthest, highest, slopes), path.error["double"] + RAYS_ERROR


def _errors(band: Band, seen: Callable[[Spectrum], Floats], own: float) -> dict[int, float]:
    found: dict[int, Floats] = {}
    for count in (1, *(4 * 2**k for k in range(20))):
        found[count] = seen(band_lines(band, count))
        size = float(np.linalg.norm(found[count]))
        if count > 4 and (2 * count > _MOST_LINES or np.linalg.norm(found[count] - found[count // 2]) < own * size):
            errors = {n: float(np.linalg.norm(found[n] - found[count])) / size for n in found}
            return {n: BAND_SAFETY * (error + own) for n, error in errors.items() if n != count}
    raise InternalError("MF901", "a band was doubled without end")
