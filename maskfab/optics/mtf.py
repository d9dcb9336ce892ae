"""Cuts and radial statistics of the presampled MTF: optics x sensor pixel, before any sampling can alias it."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from maskfab.model import Camera, Mtf
from maskfab.optics.otf import LagTable
from maskfab.optics.psf import image_scale_um2

Floats = NDArray[np.float64]

RINGS = 147
"""Radii from 0 to half a cycle per pixel; as many as the published curves have at 470 nm."""


def presampled_mtf(table: LagTable, camera: Camera, wavelength_nm: float) -> Mtf:
    """MTF from 0 to half a cycle per pixel along four directions, and its radial mean, minimum and maximum.

    Radial statistics are taken over rings one sample wide of a square grid of frequencies, the corners left out. The
    pixel is a full square, so its transfer is sinc(ν_x p) sinc(ν_y p).
    """
    step = 0.5 / camera.pixel_um / (RINGS - 1)
    axis = step * np.arange(RINGS, dtype=np.float64)
    across, up = np.meshgrid(np.concatenate([-axis[:0:-1], axis]), axis)
    ring = np.rint(np.hypot(across, up) / step).astype(np.intp)
    # Opposite frequencies are alike; of those on the horizontal axis one side counts.
    inside = (ring < RINGS) & ((up > 0) | (across >= 0))
    values = _modulation(table, camera, wavelength_nm, across[inside], up[inside])
    ring = ring[inside]
    low, high = np.full(RINGS, np.inf), np.full(RINGS, -np.inf)
    np.minimum.at(low, ring, values)
    np.maximum.at(high, ring, values)
    mean = np.bincount(ring, values) / np.bincount(ring)
    slant, none = axis / np.sqrt(2), np.zeros(RINGS)
    cuts = {
        "horizontal": _modulation(table, camera, wavelength_nm, axis, none),
        "vertical": _modulation(table, camera, wavelength_nm, none, axis),
        "diagonal": _modulation(table, camera, wavelength_nm, slant, slant),
        "antidiagonal": _modulation(table, camera, wavelength_nm, -slant, slant),
        "radial_mean": mean,
        "radial_min": low,
        "radial_max": high,
    }
    return Mtf(axis * 1e3, cuts, wavelength_nm, table.uncertainty)


def longest_lag_um(camera: Camera) -> float:
    """The largest lag that :func:`presampled_mtf` asks for at any of the camera's wavelengths."""
    return max(image_scale_um2(camera, w) for w in camera.wavelengths_nm) * 0.5 / camera.pixel_um


def area_under_radial_min(mtf: Mtf) -> float:
    """Mean of the radial minimum over its samples from 0 to half a cycle per pixel (the AUC of the literature)."""
    return float(mtf.cuts["radial_min"].mean())


def frequency_at(mtf: Mtf, cut: str, level: float) -> float | None:
    """The first frequency, in cy/mm, at which a cut falls below a level; None if it stays above to the end."""
    values = mtf.cuts[cut]
    below = np.flatnonzero(values < level)
    if not below.size:
        return None
    k = int(below[0])
    share = (values[k - 1] - level) / (values[k - 1] - values[k])
    return float(mtf.frequency_cy_per_mm[k - 1] + share * (mtf.frequency_cy_per_mm[k] - mtf.frequency_cy_per_mm[k - 1]))


def _modulation(table: LagTable, camera: Camera, wavelength_nm: float, nu_x: Floats, nu_y: Floats) -> Floats:
    """|OTF| x pixel at frequencies in cycles per micrometre of sensor."""
    scale = image_scale_um2(camera, wavelength_nm)
    optics = abs(table.otf(scale * nu_x, scale * nu_y))
    return np.asarray(optics * np.sinc(nu_x * camera.pixel_um) * np.sinc(nu_y * camera.pixel_um))
