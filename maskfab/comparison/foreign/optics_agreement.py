"""Optics of a foreign file, die by die, against the design."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import replace

import numpy as np
from klayout import db

from maskfab.geometry.plate_layout import clear_box, clear_shapes, layer_info, region
from maskfab.geometry.shape_limits import weight
from maskfab.geometry.stop import edges_in_stop, stop_box
from maskfab.measurement.apertures import aperture_in_stop, axis_nm, edge_distances, light_box, sees_light
from maskfab.measurement.optics import (
    INVARIANT_LIMIT_ROUND,
    READBACK_LIMIT,
    Measured,
    lit_pupils,
    measure,
    measure_pupils,
    stop_boundary,
)
from maskfab.model import CLEAR, Box, Camera, Die, MaskBlank, Mtf, Plate, Quantity
from maskfab.optics.image.leak import Leak
from maskfab.optics.image.psf import pixel_margin
from maskfab.optics.numbers import metrics
from maskfab.optics.pupil.aperture import Lattice
from maskfab.optics.pupil.pupil import cut
from maskfab.units import NM_PER_UM

MOST_SEEN_ALONE = 50_000
"""Shapes before a stop whose optics are measured though they are not the design's."""

_FINEST_GRID = 1000
_TOLD_OF_LIKE = frozenset({"stop_open_ratio", "readback_psf_difference"})
_TOLD_OF_UNLIKE = frozenset({"auc_radial_min", "mtf50", "mtf30", "mtf10", "peak_strehl", "psf_energy_in_window"})


def optics_of_like(
    die: Die, camera: Camera, blank: MaskBlank, design: db.Layout, laid: db.Layout, equal: bool
) -> Iterator[Quantity]:
    """The PSF and MTF of a die of a file that is the design, or nearly.

    Args:
        die: the die.
        camera: what looks through it.
        blank: what the plate is made of.
        design: the plate's layout.
        laid: the file, lying as the design does.
        equal: whether the file is the design all over the stop.
    """
    bare = _bare(die)
    box = light_box(die, camera.stop)
    # A layout in cells is seen through faster than one without, where both are the same.
    shapes = clear_shapes(design if equal else laid, box)
    if not sees_light(die, camera.stop, shapes):
        yield Quantity("optics", "dark", "nothing is clear before the stop", limit="ok", passed=False, die=die.name)
        return
    found = measure(bare, camera, shapes, blank)
    yield from (quantity for quantity in found.quantities if quantity.name in _TOLD_OF_LIKE)
    expected = found if equal else measure(bare, camera, clear_shapes(design, box), blank)
    alike = "; the polygons are the same" if equal else ""
    yield from _mtf_differences(found.mtfs, expected.mtfs, die.name, alike)


def optics_of_unlike(
    plate: Plate, camera: Camera, blank: MaskBlank, design: db.Layout, read: db.Layout
) -> Iterator[Quantity]:
    """The PSF and MTF of whatever a file has before the stop, where the dies should be, or else in its own middle."""
    dark = True
    for die in plate.dies:
        if _too_many(read, stop_box(camera.stop, axis_nm(die), die.panel.dot_nm)):
            dark = False
            yield _not_measured(die.name)
            continue
        found = _measured(read, axis_nm(die), camera, blank, die.panel.dot_nm, die.name)
        if found is None:
            continue
        dark = False
        yield from found.quantities
        expected = measure(_bare(die), camera, clear_shapes(design, light_box(die, camera.stop)), blank)
        yield from _mtf_differences(found.mtfs, expected.mtfs, die.name, "")
    if not dark:
        return
    middle = clear_box(read).center()
    axis = float(middle.x), float(middle.y)
    dot_nm = min(die.panel.dot_nm for die in plate.dies)
    if _too_many(read, stop_box(camera.stop, axis, dot_nm)):
        yield _not_measured(None)
        return
    found = _measured(read, axis, camera, blank, dot_nm, None)
    x, y = middle.x / NM_PER_UM, middle.y / NM_PER_UM
    where = f"the middle of the file, ({x:g}, {y:g}) um, for it has nothing where dies are"
    if found is None:
        yield Quantity("optics", "dark", f"nothing is clear before the stop at {where}", limit="ok", passed=False)
        return
    yield from (replace(each, method=f"{each.method}; at {where}") for each in found.quantities)


def _too_many(read: db.Layout, box_nm: Box) -> bool:
    shapes = read.top_cell().begin_shapes_rec_overlapping(read.find_layer(layer_info(CLEAR)), db.Box(*box_nm))
    return weight(shapes, MOST_SEEN_ALONE) > MOST_SEEN_ALONE


def _not_measured(name: str | None) -> Quantity:
    method = f"not measured: before the stop are more than {MOST_SEEN_ALONE} shapes of a file that is not the design"
    return Quantity("optics", "not measured", method, limit="ok", passed=False, die=name)


def _bare(die: Die) -> Die:
    return replace(die, panel=replace(die.panel, tracks=()))


def _measured(
    read: db.Layout, axis: tuple[float, float], camera: Camera, blank: MaskBlank, dot_nm: int, name: str | None
) -> Measured | None:
    """The optics of polygons of any kind about an axis; None where nothing is clear before the stop."""
    shapes = region(read, CLEAR, stop_box(camera.stop, axis, dot_nm))
    edges, area = edges_in_stop(shapes, camera.stop, axis)
    if area <= 0:
        return None
    lattice, exact = _lattice(shapes, axis, camera, dot_nm)
    aperture = aperture_in_stop(lattice, lattice, shapes, edges, camera.stop, axis)
    pupil, leak = cut(aperture, camera.stop), Leak.of(blank, camera.stop)
    lit = lit_pupils(pupil, () if leak is None else leak.pupils(aperture), leak, camera)
    raster = f"of a raster of {lattice.dot_um:g} um"

    def difference(error: float, wavelength: float) -> Quantity:
        method = f"relative L2 between the polygons' PSF and that {raster}"
        return Quantity("raster_psf_difference", error, method, die=name, wavelength_nm=wavelength)

    outline = stop_boundary(edges, area, camera, pixel_margin(camera))
    found = measure_pupils(pupil, None, lit, outline, camera, INVARIANT_LIMIT_ROUND, difference, name)
    told = [metrics.stop_open_ratio(area, camera, name, "area of the file's polygons inside the stop over the stop's")]
    about = f"; {raster}, on which every edge lies" if exact else f"; {raster}, finer than which nothing is resolved"
    for quantity in found.quantities:
        if quantity.name in _TOLD_OF_UNLIKE:
            told.append(replace(quantity, method=quantity.method + about, limit=None, passed=None))
        elif quantity.name == "raster_psf_difference":
            told.append(quantity)
    return replace(found, quantities=tuple(told))


def _lattice(shapes: db.Region, axis: tuple[float, float], camera: Camera, largest_nm: int) -> tuple[Lattice, bool]:
    """A grid about the axis on which all edges lie, if one is coarse enough, else a fine one; and which of them."""
    # Half nanometres, for the middle of a die may lie between two.
    distances, slanted = edge_distances(shapes, camera.stop, axis)
    step = math.gcd(*distances)
    diameter_nm = NM_PER_UM * camera.stop.diameter_um
    finest = math.ceil(2 * diameter_nm / _FINEST_GRID)
    exact = not slanted and (step == 0 or step >= min(finest, 2 * largest_nm))
    if not exact:
        step = min(finest, 2 * largest_nm)
    elif step == 0:
        step = 2 * largest_nm
    dot_um = step / max(1, math.ceil(step / (2 * largest_nm))) / 2e3
    count = 2 * math.ceil(diameter_nm / NM_PER_UM / dot_um / 2)
    return Lattice(-count * dot_um / 2, count, 1, dot_um, dot_um), exact


def _mtf_differences(found: tuple[Mtf, ...], expected: tuple[Mtf, ...], name: str, alike: str) -> Iterator[Quantity]:
    for one, other in zip(found, expected, strict=True):
        difference = max(float(np.abs(one.cuts[way] - other.cuts[way]).max()) for way in one.cuts)
        yield Quantity(
            "mtf_difference",
            difference,
            f"largest difference of any cut of the MTF to the design's{alike}",
            limit=READBACK_LIMIT,
            passed=difference <= READBACK_LIMIT,
            die=name,
            wavelength_nm=one.wavelength_nm,
        )
