"""Number of lines that stand for a band of light in a point PSF, by the error of each number.

Notes:
    The PSF in a window is smooth in the wavelength, so the error of Gauss nodes falls fast once the speckle at the
    window's edge moves by less than its size from one line to the next; before, lines buy little.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from maskfab.errors import InternalError
from maskfab.model import Camera
from maskfab.optics.field.methods import PRUNED, Task, admissible, precise_enough
from maskfab.optics.field.parity import SampledField
from maskfab.optics.image.psf import cutoff, image_scale_um2
from maskfab.optics.image.spectrum import Band, Spectrum, lines
from maskfab.optics.pupil.pupil import Pupil

Floats = NDArray[np.float64]

BAND_SAFETY = 2.0
_MOST_LINES = 512
_LEAST_SAMPLES = 64


def band_lines(band: Band, count: int) -> Spectrum:
    """A band as so many lines: one at its mean wavelength, or four in each panel of :meth:`Band.quadrature`."""
    if count == 1:
        return lines([band.centroid_nm], name=band.name)
    return band.quadrature(count // 4)


def band_errors(pupil: Pupil, camera: Camera, band: Band, target: float) -> dict[int, float]:
    """The error of replacing a band by 1, 4, 8, ... lines: relative L2 of the PSF in the window against the most tried.

    The PSF is looked at on an even grid, three of whose samples or more fall on the width of its sharpest orders. Twice
    the lines are tried until doubling changes less than ``target``, or there are 512; the last has nothing to be
    compared with and is left out.
    """
    half, (shortest_nm, _) = camera.window_um / 2, band.range_nm
    samples = max(_LEAST_SAMPLES, math.ceil(1.5 * half * cutoff(camera, shortest_nm)))
    place = half / samples * (np.arange(samples, dtype=np.float64) + 0.5)
    shortest = image_scale_um2(camera, shortest_nm)
    # The step of a discrete transform suits one wavelength only.
    task = Task.of(pupil, place / shortest, place / shortest)
    path = next(path for path in admissible(task) if path is not PRUNED)
    precision, own = precise_enough([path], target)
    highest = (float(place[-1] / shortest),) * 2
    prepared = path.prepare(pupil, *highest, precision)
    reach = [float(abs(axis.edges_um()).max()) for axis in (pupil.x, pupil.y)]
    sampled = SampledField.of(prepared.field, (reach[0], reach[1]), highest, precision)

    def seen(spectrum: Spectrum) -> Floats:
        """Half of the window, which the other half mirrors."""
        total = np.zeros((2, samples, samples))
        for line, share in zip(spectrum.wavelengths_nm, spectrum.weights, strict=True):
            scale = image_scale_um2(camera, float(line))
            total += share / scale**2 * np.stack(sampled.field(place / scale, place / scale).quadrants())
        return total

    found: dict[int, Floats] = {}
    for count in (1, *(4 * 2**k for k in range(20))):
        found[count] = seen(band_lines(band, count))
        size = float(np.linalg.norm(found[count]))
        if count > 4 and (
            2 * count > _MOST_LINES or BAND_SAFETY * np.linalg.norm(found[count] - found[count // 2]) < target * size
        ):
            errors = {n: float(np.linalg.norm(found[n] - found[count])) / size for n in found}
            return {n: BAND_SAFETY * (error + own) for n, error in errors.items() if n != count}
    raise InternalError("MF901", "a band was doubled without end")
