"""What a file from elsewhere does to light, die by die, against the design."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import replace

import numpy as np
from klayout import db

from maskfab.geometry.region import clear_shapes, coverage, region
from maskfab.geometry.stop import edges_in_stop, stop_box
from maskfab.model import CLEAR, Box, Camera, Die, Mtf, Plate, Quantity
from maskfab.optics import metrics
from maskfab.optics.aperture import Lattice
from maskfab.optics.mtf import longest_lag_um
from maskfab.optics.otf import lag_table
from maskfab.optics.pupil import cut
from maskfab.validate.optics import (
    INVARIANT_LIMIT_ROUND,
    READBACK_LIMIT,
    Measured,
    axis_nm,
    measure,
    measure_pupils,
    read_aperture,
    stop_boundary,
)

_FINEST_GRID = 1000
_TOLD_OF_LIKE = frozenset({"stop_open_ratio", "readback_psf_difference"})
_TOLD_OF_UNLIKE = frozenset({"auc_radial_min", "mtf50", "mtf30", "mtf10", "peak_strehl", "psf_energy_in_window"})


def optics_of_like(die: Die, camera: Camera, design: db.Layout, laid: db.Layout, equal: bool) -> Iterator[Quantity]:
    """The PSF and MTF of a die of a file that is the design, or nearly.

    Args:
        die: the die.
        camera: what looks through it.
        design: the plate's layout.
        laid: the file, lying as the design does.
        equal: whether the file is the design throughout this die.
    """
    bare = _bare(die)
    box = stop_box(camera.stop, axis_nm(die))
    shapes = clear_shapes(laid, box)
    if shapes.is_empty() if isinstance(shapes, db.Region) else not len(shapes):
        yield Quantity(
            "optics", "", "dark", "", "nothing is clear before the stop", limit="ok", passed=False, die=die.name
        )
        return
    found = measure(bare, camera, shapes)
    yield from (quantity for quantity in found.quantities if quantity.name in _TOLD_OF_LIKE)
    expected = found if equal else measure(bare, camera, clear_shapes(design, box))
    alike = "; the polygons are the same" if equal else ""
    yield from _mtf_differences(found.mtfs, expected.mtfs, die.name, alike)


def optics_of_unlike(plate: Plate, camera: Camera, design: db.Layout, read: db.Layout) -> Iterator[Quantity]:
    """The PSF and MTF of whatever a file has before the stop, where the dies should be, or else in its own middle."""
    dark = True
    for die in plate.dies:
        axis = axis_nm(die)
        box = stop_box(camera.stop, axis)
        found = _measured(read, box, axis, camera, die.panel.dot_nm, die.name)
        if found is None:
            continue
        dark = False
        yield from found.quantities
        expected = measure(_bare(die), camera, clear_shapes(design, box))
        yield from _mtf_differences(found.mtfs, expected.mtfs, die.name, "")
    if not dark:
        return
    middle = region(read, CLEAR).bbox().center()
    axis = float(middle.x), float(middle.y)
    dot_nm = min(die.panel.dot_nm for die in plate.dies)
    found = _measured(read, stop_box(camera.stop, axis), axis, camera, dot_nm, None)
    where = f"the middle of the file, ({middle.x / 1e3:g}, {middle.y / 1e3:g}) um, for it has nothing where dies are"
    if found is None:
        yield Quantity(
            "optics", "", "dark", "", f"nothing is clear before the stop at {where}", limit="ok", passed=False
        )
        return
    yield from (replace(each, method=f"{each.method}; at {where}") for each in found.quantities)


def _bare(die: Die) -> Die:
    return replace(die, panel=replace(die.panel, tracks=()))


def _measured(
    read: db.Layout, box: Box, axis: tuple[float, float], camera: Camera, dot_nm: int, name: str | None
) -> Measured | None:
    """The optics of polygons of any kind about an axis; None where nothing is clear before the stop."""
    shapes = region(read, CLEAR, box)
    edges, area = edges_in_stop(shapes, camera.stop, axis)
    if area <= 0:
        return None
    lattice, exact = _lattice(shapes, box, axis, camera, dot_nm)
    x, y = (np.round(1e3 * lattice.edges_um() + centre, 6) for centre in axis)
    pupil = cut(read_aperture(lattice, lattice, coverage(shapes, x, y)), camera.stop)
    table = lag_table(pupil, longest_lag_um(camera))
    raster = f"of a raster of {lattice.dot_um:g} um"

    def difference(error: float, wavelength: float) -> Quantity:
        method = f"relative L2 between the polygons' PSF and that {raster}"
        return Quantity("raster_psf_difference", "δ", error, "1", method, die=name, wavelength_nm=wavelength)

    outline = stop_boundary(edges, area, camera)
    found = measure_pupils(pupil, pupil, table, outline, camera, INVARIANT_LIMIT_ROUND, difference, name)
    told = [metrics.stop_open_ratio(area, camera, name, "area of the file's polygons inside the stop over the stop's")]
    about = f"; {raster}, on which every edge lies" if exact else f"; {raster}, finer than which nothing is resolved"
    for quantity in found.quantities:
        if quantity.name in _TOLD_OF_UNLIKE:
            told.append(replace(quantity, method=quantity.method + about, limit=None, passed=None))
        elif quantity.name == "raster_psf_difference":
            told.append(quantity)
    return replace(found, quantities=tuple(told))


def _lattice(
    shapes: db.Region, box: Box, axis: tuple[float, float], camera: Camera, largest_nm: int
) -> tuple[Lattice, bool]:
    """A grid about the axis on which all edges lie, if one is coarse enough, else a fine one; and which of them."""
    x, y = (2 * centre for centre in axis)
    rim = {2 * each - centre for each, centre in zip(box, (x, y, x, y), strict=True)}
    steps = set()
    slanted = False
    for edge in shapes.edges().each():
        slanted = slanted or (edge.x1 != edge.x2 and edge.y1 != edge.y2)
        steps |= {abs(2 * edge.x1 - x), abs(2 * edge.y1 - y)}
    # Half nanometres, for the middle of a die may lie between two.
    step = math.gcd(*(int(each) for each in steps - {abs(each) for each in rim}))
    diameter_nm = 1e3 * camera.stop.diameter_um
    finest = math.ceil(2 * diameter_nm / _FINEST_GRID)
    exact = not slanted and (step == 0 or step >= min(finest, 2 * largest_nm))
    if not exact:
        step = min(finest, 2 * largest_nm)
    elif step == 0:
        step = 2 * largest_nm
    dot_um = step / max(1, math.ceil(step / (2 * largest_nm))) / 2e3
    count = 2 * math.ceil(diameter_nm / 1e3 / dot_um / 2)
    return Lattice(-count * dot_um / 2, count, 1, dot_um, dot_um), exact


def _mtf_differences(found: tuple[Mtf, ...], expected: tuple[Mtf, ...], name: str, alike: str) -> Iterator[Quantity]:
    for one, other in zip(found, expected, strict=True):
        difference = max(float(np.abs(one.cuts[way] - other.cuts[way]).max()) for way in one.cuts)
        yield Quantity(
            "mtf_difference",
            "ΔM",
            difference,
            "1",
            f"largest difference of any cut of the MTF to the design's{alike}",
            limit=READBACK_LIMIT,
            passed=difference <= READBACK_LIMIT,
            die=name,
            wavelength_nm=one.wavelength_nm,
        )
