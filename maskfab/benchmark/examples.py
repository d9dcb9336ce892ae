"""Small panels, pupils and cameras with nothing left to chance, which the hard cases and the tests share."""

from __future__ import annotations

from typing import Literal

import numpy as np
from klayout import db

from maskfab.base.arrays import Mask
from maskfab.model import Camera, Opening, Panel, Stop, Tiling
from maskfab.optics.pupil.aperture import panel_aperture
from maskfab.optics.pupil.pupil import Pupil, cut
from maskfab.plate.tiling import orientations
from maskfab.units import NM_PER_UM


def noise(dots: int, share: float, seed: int) -> Mask:
    """An opening without any symmetry, bool [dots, dots]: each dot clear with that probability, the first for sure."""
    mask = np.random.default_rng(seed).random((dots, dots)) < share
    mask[0, 0] = True
    return mask


def panel(mask: Mask, *, dot_nm: int = 8000, gutter_nm: int = 0, cells: int = 4, seed: int | None = None) -> Panel:
    """Cells x cells of an opening, tiled periodically without a seed and randomly with one."""
    tiling = Tiling.PERIODIC if seed is None else Tiling.RANDOM
    chosen = orientations(tiling, cells, cells, seed)
    return Panel(Opening("case", mask, dot_nm), dot_nm, gutter_nm, chosen, tiling, seed)


def pupil(laid_out: Panel, stop: Stop) -> Pupil:
    """The pupil that a stop about the panel's middle leaves."""
    return cut(panel_aperture(laid_out, stop.diameter_um / 2), stop)


def camera(
    diameter_um: float = 400.0,
    shape: Literal["circle", "square"] = "circle",
    wavelengths: tuple[float, ...] = (530.0,),
    window_um: float = 128.0,
) -> Camera:
    """A camera of 10 mm focal length and 2 um pixels."""
    return Camera(10_000.0, Stop(shape, diameter_um), wavelengths, 2.0, window_um)


def clear_region(laid_out: Panel) -> db.Region:
    """The panel's clear dots as merged polygons about its middle, in nanometres, straight from the aperture's grid."""
    aperture = panel_aperture(laid_out)
    x, y = (np.rint(NM_PER_UM * lattice.edges_um()).astype(int).tolist() for lattice in (aperture.x, aperture.y))
    found = db.Region()
    for j, i in zip(*np.nonzero(aperture.transmission), strict=True):
        found.insert(db.Box(x[i], y[j], x[i + 1], y[j + 1]))
    return found.merged(True, 1)
