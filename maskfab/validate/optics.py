"""The optics of a die from the polygons that were read back, against the optics of its design."""

from __future__ import annotations

from typing import TypeAlias

import numpy as np
from klayout import db
from numpy.typing import NDArray

from maskfab.geometry.region import coverage
from maskfab.geometry.stop import edges_in_stop
from maskfab.model import Camera, Die, DieOptics, Mtf, Psf, Quantity, Tiling
from maskfab.optics import metrics
from maskfab.optics.aperture import Aperture, Lattice, covered_aperture, panel_aperture, zeros
from maskfab.optics.mtf import longest_lag_um, presampled_mtf
from maskfab.optics.orders import order_quantities
from maskfab.optics.otf import lag_table
from maskfab.optics.polygons import Boundary, boundary
from maskfab.optics.psf import image_scale_um2, pixel_margin, pixel_psf, point_psfs, within
from maskfab.optics.psf_metrics import peak_to_side_lobe
from maskfab.optics.pupil import cut

Floats = NDArray[np.float64]
Shapes: TypeAlias = db.Region | NDArray[np.int64]

READBACK_LIMIT = 1e-6
INVARIANT_LIMIT_ROUND = 1e-3
INVARIANT_LIMIT_SQUARE = 1e-6


def measure(die: Die, camera: Camera, shapes: Shapes) -> DieOptics:
    """PSF, MTF, invariants and the difference to the design, at every wavelength of the camera.

    Args:
        die: the design.
        camera: what looks through it.
        shapes: everything clear in front of the stop as read back, in plate coordinates: a merged region, or disjoint
            boxes, see :func:`maskfab.geometry.region.clear_shapes`.
    """
    stop = camera.stop
    designed = panel_aperture(die.panel, stop.diameter_um / 2)
    read = _read_aperture(die, designed, shapes)
    pupil = cut(read, stop)
    design_pupil = pupil if np.array_equal(read.transmission, designed.transmission) else cut(designed, stop)
    edges, area = edges_in_stop(shapes, stop, axis_nm(die))
    outline = stop_boundary(edges, area, camera)
    table = lag_table(pupil, longest_lag_um(camera))
    lags = metrics.axis_lags(pupil, table.energy_um2)
    margin = pixel_margin(camera)

    limit = INVARIANT_LIMIT_ROUND if stop.shape == "circle" else INVARIANT_LIMIT_SQUARE
    quantities = [
        Quantity(
            "open_ratio", "ρ", die.panel.open_ratio, "1", "clear share of one cell of the design, exact", die=die.name
        ),
        metrics.stop_open_ratio(
            area, camera, die.name, "area of the read-back polygons inside the stop over the stop's"
        ),
        metrics.mtf_volume(table, area, die.name, limit),
    ]
    if die.panel.tiling is Tiling.PERIODIC:
        quantities += order_quantities(die.panel, die.name)
    psfs: list[Psf] = []
    mtfs: list[Mtf] = []
    designed_psfs = point_psfs(design_pupil, camera, margin)
    read_psfs = designed_psfs if pupil is design_pupil else point_psfs(pupil, camera, margin)
    for wavelength, designed_psf, read_psf in zip(camera.wavelengths_nm, designed_psfs, read_psfs, strict=True):
        points = within(designed_psf, camera)
        polygons = polygon_psf(outline, camera, points)
        difference = metrics.relative_difference(polygons, points)
        pixels = pixel_psf(read_psf, camera)
        mtf = presampled_mtf(table, camera, wavelength)
        psfs += [polygons, pixels]
        mtfs.append(mtf)
        quantities += [
            *metrics.mtf_quantities(mtf, camera.pixel_um, die.name),
            metrics.energy_in_window(pixels, difference, die.name),
            *metrics.strehl_quantities(points, camera, design_pupil.energy_um2, area, die.name, limit),
            _difference(difference, die.name, wavelength),
            *metrics.aliasing_quantities(lags, table, mtf, camera, die.name),
            *metrics.restoration_quantities(table, camera, wavelength, die.name),
            *metrics.shape_quantities(points, pixels, camera, die.name),
        ]
        if wavelength == middle_nm(camera):
            quantities.append(peak_to_side_lobe(points, die.name))
    quantities += metrics.colour_quantities([psf for psf in psfs if psf.kind == "pixel"], die.name)
    return DieOptics(die, tuple(psfs), tuple(mtfs), tuple(quantities))


def middle_nm(camera: Camera) -> float:
    """The wavelength that stands for all of them where a number is too dear to find at each."""
    return camera.wavelengths_nm[len(camera.wavelengths_nm) // 2]


def stop_boundary(edges_um: Floats, area_um2: float, camera: Camera) -> Boundary:
    """Quadrature on polygons cut by the stop, good for the camera's window at every wavelength."""
    finest = min(image_scale_um2(camera, wavelength) for wavelength in camera.wavelengths_nm)
    return boundary(edges_um, area_um2, camera.window_um / np.sqrt(2) / finest)


def polygon_psf(outline: Boundary, camera: Camera, like: Psf) -> Psf:
    """The PSF of polygons cut by the stop, on the grid of another PSF sampled at points."""
    scale = image_scale_um2(camera, like.wavelength_nm)
    field = outline.field(like.step_um / scale, like.values.shape[0])
    intensity = (field.real**2 + field.imag**2) / (scale**2 * outline.area_um2)
    return Psf(intensity, like.step_um, like.wavelength_nm, "point")


def axis_nm(die: Die) -> tuple[float, float]:
    """Where the optical axis meets the plate: the middle of the panel."""
    x0, y0, x1, y1 = die.box_nm
    return (x0 + x1) / 2, (y0 + y1) / 2


def _read_aperture(die: Die, designed: Aperture, shapes: Shapes) -> Aperture:
    """What was read back, as the exact share of every interval of the design's grid that is clear."""
    x, y = (
        centre + 1e3 * lattice.edges_um()
        for centre, lattice in zip(axis_nm(die), (designed.x, designed.y), strict=True)
    )
    return read_aperture(designed.x, designed.y, coverage(shapes, _on_grid(x), _on_grid(y)))


def read_aperture(x: Lattice, y: Lattice, covered: Floats) -> Aperture:
    """An aperture from the share of every interval that is clear, [ny, nx].

    Where every interval is clear or dark, none varies within, and zeros that take no memory spare a pass over them.
    """
    if ((covered == 0) | (covered == 1)).all():
        return Aperture(x, y, covered, zeros((covered.shape[0], covered.shape[1])))
    return covered_aperture(x, y, covered)


def _on_grid(edges_nm: Floats) -> Floats:
    """Edges that are whole nanometres but for rounding, made so; others are left alone."""
    whole = np.rint(edges_nm)
    return np.where(abs(edges_nm - whole) < 1e-4, whole, edges_nm)


def _difference(difference: float, die: str, wavelength: float) -> Quantity:
    return Quantity(
        "readback_psf_difference",
        "δ",
        difference,
        "1",
        "relative L2 between the PSF of the read-back polygons (edges, NUFFT) and the design's (matrix)",
        uncertainty=1e-8,
        limit=READBACK_LIMIT,
        passed=difference <= READBACK_LIMIT,
        die=die,
        wavelength_nm=wavelength,
    )
