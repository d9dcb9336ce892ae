r"""Grain: the unevenness of an even field when neighbouring pixels are turned differently.

Derivation of the formula. Let every pixel send its luminance, on average over the wavelength of slow grain, from one
point: the luminance-weighted centroid of its emitters, off the pixel's centre by c_j (in pixels) for pixel j. To first
order in f c the transform of the field is that of the lattice, which the eye does not see, plus

    -2 pi i sum_j (f . d_j) exp(-2 pi i f . r_j),     d_j = c_j - mean of c.

The mean offset moves the whole picture and makes no grain. For independent orientations the terms add in power, and
turning by 90 degrees or a mean over directions gives E[(f . d)^2] = f^2 E[|d|^2] / 2. So with the pixel as unit of
length, and mean luminance 1,

    PSD(f) = (2 pi f)^2 |c|^2 / 2,                        |c|^2 = E[|d|^2],
    rms^2  = integral from 0 to F of PSD(f) 2 pi f df = (2 pi)^3 |c|^2 F^4 / 8,
    rms    = (2 pi)^1.5 / sqrt(8) F^2 |c| = 5.568 (F / ppd)^2 |c|

for F cycles per degree and ppd pixels per degree. Next come terms of order (f c)^2 and the emitters' own extent: below
about |c| = 0.02 pixel they are as large as the first.
"""

from __future__ import annotations

import math

import numpy as np

from maskfab.base.arrays import Floats
from maskfab.eye.display_light import emitters_of
from maskfab.eye.fourier_light import Series
from maskfab.eye.viewing import Viewing
from maskfab.model import ORIENTATIONS, Emitters, Panel, orient
from maskfab.optics.numbers.centroid import luminance_centroid
from maskfab.optics.numbers.colour import LUMINANCE

SLOW_CPD = 10.0
"""Grain slower than this many cycles per degree is what the eye sees best."""
FINE_CPD = 30.0
"""Grain finer than this is lost to most eyes."""

CONSTANT: float = (2 * math.pi) ** 1.5 / math.sqrt(8)


def centroids(panel: Panel) -> tuple[Floats, float]:
    """Mean (x, y) of the centroids of a panel's pixels off their centres, and their rms distance from it, in pixels.

    The mean moves the whole picture; the rms is |c| of the formula: 0 if all pixels have one orientation, the length of
    the centroid's offset if all eight are equally frequent.

    Raises:
        JobError: MF121, MF119 for emitters that cannot be shown.
    """
    places = np.array(
        [
            luminance_centroid(Emitters(orient(emitters.labels, turn), emitters.cell_nm), panel.pitch_nm)
            for emitters in emitters_of(panel)
            for turn in range(ORIENTATIONS)
        ]
    )
    used = np.bincount(panel.orientations.ravel(), minlength=len(places))
    share = used / used.sum()
    mean = share @ places
    return mean, float(math.sqrt(share @ ((places - mean) ** 2).sum(axis=1)))


def predicted_rms(offset_px: float, viewing: Viewing, highest_cpd: float = SLOW_CPD) -> float:
    """rms luminance contrast from 0 to ``highest_cpd`` of a flat white field of independently turned pixels."""
    return float(CONSTANT * (highest_cpd / viewing.pixels_per_degree) ** 2 * offset_px)


def measured_rms(spectrum: Series, low_cpd: float, high_cpd: float) -> float:
    """rms luminance contrast of light between two frequencies, the lower one excluded.

    Args:
        spectrum: of a flat field, up to ``high_cpd`` or more.
        low_cpd, high_cpd: the band, cycles per degree.
    """
    luminance = np.tensordot(LUMINANCE, spectrum.coefficients, axes=1)
    mean = luminance[len(spectrum.y_cpd) // 2, 0].real
    inside = (spectrum.radius_cpd > low_cpd) & (spectrum.radius_cpd <= high_cpd)
    # A column x > 0 stands for its conjugate at -x too.
    times = np.where(spectrum.x_cpd > 0, 2.0, 1.0)
    power = (np.abs(luminance) ** 2 * times)[inside].sum()
    return float(math.sqrt(power) / mean)
