"""Small panels and cameras that the optics tests share."""

from __future__ import annotations

import numpy as np
from klayout import db
from numpy.typing import NDArray

from maskfab.layout.tiling import orientations
from maskfab.model import Camera, Opening, Panel, Stop, Tiling
from maskfab.optics.aperture import panel_aperture
from maskfab.optics.pupil import Pupil, cut


def camera(
    diameter_um: float = 400.0,
    shape: str = "circle",
    wavelengths: tuple[float, ...] = (530.0,),
    window_um: float = 128.0,
) -> Camera:
    return Camera(10_000.0, Stop("square" if shape == "square" else "circle", diameter_um), wavelengths, 2.0, window_um)


def panel(
    mask: NDArray[np.bool_], *, dot_nm: int = 8000, gutter_nm: int = 0, cells: int = 4, seed: int | None = None
) -> Panel:
    tiling = Tiling.PERIODIC if seed is None else Tiling.RANDOM
    opening = Opening("case", mask, dot_nm)
    return Panel(opening, dot_nm, gutter_nm, orientations(tiling, cells, cells, seed), tiling, seed)


def pupil(laid_out: Panel, stop: Stop) -> Pupil:
    return cut(panel_aperture(laid_out, stop.diameter_um / 2), stop)


def clear_region(laid_out: Panel) -> db.Region:
    """The panel's clear dots as merged polygons about its middle, in nanometres, straight from the aperture's grid."""
    aperture = panel_aperture(laid_out)
    x, y = (np.rint(1e3 * lattice.edges_um()).astype(int).tolist() for lattice in (aperture.x, aperture.y))
    found = db.Region()
    for j, i in zip(*np.nonzero(aperture.transmission), strict=True):
        found.insert(db.Box(x[i], y[j], x[i + 1], y[j + 1]))
    return found.merged(True, 1)


def noise(dots: int, share: float, seed: int) -> NDArray[np.bool_]:
    mask = np.random.default_rng(seed).random((dots, dots)) < share
    mask[0, 0] = True
    return mask
