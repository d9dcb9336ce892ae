r"""Tangential and sagittal MTF of an image point off the axis, from its PSF over a window.

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
from numpy.typing import NDArray

from maskfab.model import Psf

Floats = NDArray[np.float64]


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
