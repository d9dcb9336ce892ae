"""The optics of a die from the polygons that were read back, against the optics of its design.

A plate is seen as the lens sees it: its chrome side, or, through the glass, the mirror image of that.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from functools import partial
from typing import TYPE_CHECKING

import numpy as np
from klayout import db

from maskfab.base.arrays import Floats
from maskfab.base.errors import InternalError
from maskfab.base.model import Box, Die, DieOptics, Mtf, Plate, Psf, Quantity, Tiling
from maskfab.base.units import NM_PER_UM
from maskfab.base.work import Progress, silent
from maskfab.job.camera import Camera
from maskfab.job.process import UNSTATED, MaskBlank
from maskfab.mask.raster import Shapes, aperture_in_stop, axis_nm, coverage, lines_nm, read_aperture
from maskfab.optics import metrics
from maskfab.optics.energy import order_quantities
from maskfab.optics.exact_psf import ExactPsf, sampled_field
from maskfab.optics.field.matrix import SampledField
from maskfab.optics.field.polygons import Boundary, boundary
from maskfab.optics.film_lags import lit_lags
from maskfab.optics.lags import AxisLags, LagTable, axis_lags, lag_table
from maskfab.optics.mtf import edge_spread, longest_lag_um, presampled_mtf
from maskfab.optics.outline_lags import OutlineLags
from maskfab.optics.psf import (
    Leak,
    ReadyPupil,
    image_scale_um2,
    pixel_margin,
    pixel_psf,
    point_step_um,
    psf_norm_um6,
    within,
)
from maskfab.optics.pupil import Aperture, Pupil, cut, panel_aperture
from maskfab.optics.scene.model_bar import bar_of_pupil
from maskfab.optics.side_lobes import first_side_lobe, peak_to_side_lobe
from maskfab.optics.stop_edges import edges_in_stop

if TYPE_CHECKING:
    from maskfab.mask.job import Job


def through_glass(job: Job) -> bool:
    """Whether the plate stands with its chrome away from the lens."""
    return job.blank.glass is not None and job.blank.glass.chrome == "away"


def sees_mirrored(job: Job) -> bool:
    """Whether the lens sees the design as in a mirror: a plate that was ordered for the other side."""
    return through_glass(job) != job.spec.mirrored


def plate_as_seen(job: Job, plate: Plate) -> Plate:
    """A plate as its files draw it, seen from the lens."""
    if not through_glass(job):
        return plate
    from maskfab.mask.composition import mirrored  # slow to load, and of plates alone

    return mirrored(plate)


def layout_as_seen(job: Job, layout: db.Layout) -> db.Layout:
    """A file of the plate that was read, seen from the lens."""
    if not through_glass(job):
        return layout
    seen = layout.dup()
    seen.transform(db.Trans.M90)
    return seen


def view_rows(job: Job) -> Iterator[Quantity]:
    """From where the optics are seen, of a job that says anything of it."""
    if job.blank.glass is None and not job.spec.mirrored:
        return
    side = "through the glass" if through_glass(job) else "the chrome side"
    reads = "mirrored" if sees_mirrored(job) else "as drawn"
    method = "PSFs and photographs are of the plate as the lens sees it, by plate.glass.chrome and [order]"
    if job.blank.glass is None:
        method += "; assumed, for the job states no glass: the chrome is towards the lens"
    yield Quantity("lens_view", f"{side}; the design reads {reads}", method)


READBACK_LIMIT = 1e-6
READBACK_ERROR = 4 * metrics.AREA_ERROR
"""Of the difference of two PSFs: a squared field errs by twice its area, its norm once, the transform by the rest."""
INVARIANT_LIMIT_ROUND = 1e-3
INVARIANT_LIMIT_SQUARE = 1e-6

POLYGON_ERROR = 1e-8
"""Share of all light by which a PSF of polygons may err within its window, its transform and the stop's sides."""

_SHARES = frozenset({"psf_energy_in_window", "ensquared_energy", "halo_energy"})


@dataclass(frozen=True, eq=False)
class Measured:
    """PSFs (of the polygons at points, then of pixels, by wavelength), MTFs, what is told of them, and the field."""

    psfs: tuple[Psf, ...]
    mtfs: tuple[Mtf, ...]
    quantities: tuple[Quantity, ...]
    sampled: SampledField


def measure(die: Die, camera: Camera, shapes: Shapes, blank: MaskBlank = UNSTATED) -> DieOptics:
    """PSF, MTF, invariants and the difference to the design, at every wavelength of the camera.

    Args:
        blank: what the plate is made of; a leak whose phase is stated is part of every number.
        shapes: everything clear in front of the stop as read back, in plate coordinates: a merged region, or disjoint
            boxes, see :func:`maskfab.mask.layout.clear_shapes`.
    """
    return measure_with_pupil(die, camera, shapes, blank)[0]


def measure_with_bar(die: Die, camera: Camera, shapes: Shapes, blank: MaskBlank = UNSTATED) -> DieOptics:
    """:func:`measure`, and how far the PSF may be from the truth by what is not modelled."""
    found, pupil, sampled = measure_with_pupil(die, camera, shapes, blank)
    return replace(found, quantities=(*found.quantities, *bar_of_pupil(pupil, camera, blank, die.name, sampled)))


def measure_with_pupil(
    die: Die, camera: Camera, shapes: Shapes, blank: MaskBlank
) -> tuple[DieOptics, Pupil, SampledField]:
    """:func:`measure`, and the pupil of the design with its field."""
    stop = camera.stop
    edges, area = edges_in_stop(shapes, stop, axis_nm(die))
    if area <= 0:
        what = f"read back, the mask file has nothing clear before the stop of the die {die.name}, where the design has"
        raise InternalError("MF324", what, where=die.name, cure="Please report this with the job file")
    outline = stop_boundary(edges, area, camera)
    leak = Leak.of(blank, stop)
    pupil, design_pupil, lit = _pupils(die, camera, shapes, edges, leak)

    limit = INVARIANT_LIMIT_SQUARE if stop.shape == "square" else INVARIANT_LIMIT_ROUND
    quantities = [
        Quantity("open_ratio", die.panel.open_ratio, "clear share of one cell of the design, exact", die=die.name),
        metrics.stop_open_ratio(
            area, camera, die.name, "area of the read-back polygons inside the stop over the stop's"
        ),
        metrics.mtf_volume(lit.table, area, die.name, limit, leak),
    ]
    if die.panel.tiling is Tiling.PERIODIC:
        quantities += order_quantities(die.panel, die.name)
    found = measure_pupils(pupil, design_pupil, lit, outline, camera, limit, partial(_difference, die.name), die.name)
    return DieOptics(die, found.psfs, found.mtfs, (*quantities, *found.quantities)), design_pupil, found.sampled


def _pupils(
    die: Die, camera: Camera, shapes: Shapes, edges_um: Floats, leak: Leak | None
) -> tuple[Pupil, Pupil, LitPupils]:
    """Pupils of what was read and of the design, one object where they are the same; and the lags."""
    stop = camera.stop
    designed = panel_aperture(die.panel, stop.diameter_um / 2)
    read = aperture_in_stop(designed.x, designed.y, shapes, edges_um, stop, axis_nm(die))
    pupil = cut(read, stop)
    design_pupil = pupil if np.array_equal(read.transmission, designed.transmission) else cut(designed, stop)
    # Of a wide stop each of these takes hundreds of megabytes.
    del designed, read
    return pupil, design_pupil, lit_pupils(pupil, leak, camera)


def measure_pupils(
    read: Pupil,
    design: Pupil | None,
    lit: LitPupils,
    outline: Boundary,
    camera: Camera,
    limit: float,
    difference: Callable[[float, float], Quantity],
    die: str | None = None,
    progress: Progress = silent,
) -> Measured:
    """Everything that is told at each wavelength, and the colours, of a die and of a foreign mask alike.

    Args:
        read: the pupil that was read.
        design: the pupil that the polygons are held against, and whose points are told of. None where there is none:
            then they are held against ``read``, a raster of them, and what is told of points and pixels is their own.
        lit: the lags of ``read``, its leak included.
        difference: makes a quantity of the polygons' difference to the design and the wavelength.
    """
    table, leak, lags = lit.table, lit.leak, lit.axis_lags
    margin = pixel_margin(camera)
    lines = camera.wavelengths_nm
    progress("optics", 0, len(lines))
    ready = ReadyPupil.of(read, camera, margin)
    read_psfs = matrix_psfs = ready.psfs(leak)
    matrix = read if design is None else design
    if matrix is not read:
        ready = ReadyPupil.of(matrix, camera, margin)
        matrix_psfs = ready.psfs(leak)
    sampled = sampled_field(outline, camera) if design is None else sampled_field(matrix, camera, ready.prepared)
    del ready  # of a wide stop hundreds of megabytes
    psfs: list[Psf] = []
    mtfs: list[Mtf] = []
    quantities: list[Quantity] = []
    for wavelength, matrix_psf, read_psf in zip(lines, matrix_psfs, read_psfs, strict=True):
        of_matrix = within(matrix_psf, camera)
        if design is None:
            wide = polygon_psf(outline, camera, matrix_psf, leak)
            points = polygons = within(wide, camera)
            pixels = pixel_psf(wide, camera)
        else:
            points, polygons = of_matrix, polygon_psf(outline, camera, of_matrix, leak)
            pixels = pixel_psf(read_psf, camera)
        error = metrics.relative_difference(polygons, of_matrix)
        mtf = presampled_mtf(table, camera, wavelength)
        seen = ExactPsf.of(points, outline if design is None else matrix, camera, leak, sampled)
        psfs += [polygons, pixels]
        mtfs.append(mtf)
        quantities += [
            *metrics.mtf_quantities(mtf, camera.pixel_um, die),
            metrics.energy_in_window(pixels, camera, error if design is not None else 0.0, die),
            *metrics.strehl_quantities(of_matrix, camera, matrix.energy_um2, outline.area_um2, die, limit, leak),
            difference(error, wavelength),
            *metrics.aliasing_quantities(lags, table, mtf, camera, die),
            *metrics.restoration_quantities(table, camera, wavelength, die),
            *metrics.shape_quantities(seen, pixels, camera, die),
            first_side_lobe(seen, die),
        ]
        if wavelength == camera.middle_nm:
            quantities.append(peak_to_side_lobe(seen, die))
        progress("optics", len(mtfs), len(lines))
    edges = [edge_spread(lags, table, camera, wavelength) for wavelength in lines] if len(lines) == 3 else []
    quantities += metrics.colour_quantities([psf for psf in psfs if psf.kind == "pixel"], die, edges)
    if design is None:
        quantities = [_of_polygons(quantity) for quantity in quantities]
    return Measured(tuple(psfs), tuple(mtfs), tuple(quantities), sampled)


@dataclass(frozen=True, eq=False)
class LitPupils:
    """The lags of what passes light: of the openings, and of the film if its leak is stated (else None)."""

    table: LagTable
    axis_lags: tuple[AxisLags, AxisLags]
    leak: Leak | None


def lit_pupils(pupil: Pupil, leak: Leak | None, camera: Camera, outline: OutlineLags | None = None) -> LitPupils:
    """The lags that the camera needs."""
    reach = longest_lag_um(camera)
    if leak is not None:
        return LitPupils(*lit_lags(pupil, leak, reach), leak)
    table = lag_table(pupil, reach, outline)
    return LitPupils(table, axis_lags(pupil, table.energy_um2), None)


def _of_polygons(quantity: Quantity) -> Quantity:
    """A share of light with what the polygons' own transform may add to its error."""
    if quantity.name not in _SHARES or quantity.uncertainty is None:
        return quantity
    return replace(quantity, uncertainty=quantity.uncertainty + POLYGON_ERROR)


def stop_boundary(edges_um: Floats, area_um2: float, camera: Camera, margin: int = 0) -> Boundary:
    """Quadrature on polygons cut by the stop for the camera's window and a margin of points, at every wavelength."""
    finest = min(image_scale_um2(camera, wavelength) for wavelength in camera.wavelengths_nm)
    reach_um = camera.window_um / 2 + margin * point_step_um(camera)
    return boundary(edges_um, area_um2, np.sqrt(2) * reach_um / finest)


def polygon_psf(outline: Boundary, camera: Camera, like: Psf, leak: Leak | None = None) -> Psf:
    """The PSF of polygons cut by the stop, and of the film round them, on the grid of another PSF sampled at points."""
    scale, count = image_scale_um2(camera, like.wavelength_nm), like.values.shape[0]
    field, energy = outline.field(like.step_um / scale, count), outline.area_um2
    if leak is not None:
        axis = like.step_um / scale * np.arange(-(count // 2), count // 2 + 1, dtype=np.float64)
        field, energy = leak.field(field, axis, axis), leak.energy_um2(energy)
    intensity = (field.real**2 + field.imag**2) / psf_norm_um6(scale, energy)
    return Psf(intensity, like.step_um, like.wavelength_nm, "point")


def reach_box(die: Die, reach_um: float) -> Box:
    """The part of a die's panel within a distance from the axis along x and y, as a box of whole nanometres."""
    x, y = axis_nm(die)
    reach = NM_PER_UM * reach_um
    x0, y0, x1, y1 = die.box_nm
    return (
        max(x0, math.floor(x - reach)), max(y0, math.floor(y - reach)),
        min(x1, math.ceil(x + reach)), min(y1, math.ceil(y + reach)),
    )  # fmt: skip


def read_openings(die: Die, shapes: Shapes, reach_um: float) -> Aperture:
    """Openings read back, as far as a distance from the axis, on the design's own grid.

    Args:
        die: the design; beyond its panel nothing is clear.
        shapes: everything clear there, as for :func:`measure`.
        reach_um: half the side of the square that is wanted.
    """
    designed = panel_aperture(die.panel, reach_um)
    return read_aperture(designed.x, designed.y, coverage(shapes, *lines_nm(designed.x, designed.y, axis_nm(die))))


def _difference(die: str, difference: float, wavelength: float) -> Quantity:
    return Quantity(
        "readback_psf_difference",
        difference,
        "relative L2 between the PSF of the read-back polygons (edges, NUFFT) and the design's (matrix)",
        uncertainty=READBACK_ERROR,
        limit=READBACK_LIMIT,
        passed=difference <= READBACK_LIMIT,
        die=die,
        wavelength_nm=wavelength,
    )
