"""A foreign mask file held against a job: orientation, offset, scale and tone, differences, and the optics of its dies.

Whatever is wrong with how the file lies is undone first, and told, so that everything else can be compared.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Literal

import numpy as np
from klayout import db

from maskfab.base.errors import JobError, SourceError
from maskfab.base.files import suffix_of
from maskfab.base.model import CLEAR, Box, Die, Mtf, Plate, Quantity
from maskfab.base.units import NM_PER_UM
from maskfab.base.work import Progress, silent
from maskfab.findings.drawings import drawing_quantities
from maskfab.findings.optics import (
    INVARIANT_LIMIT_ROUND,
    READBACK_LIMIT,
    Measured,
    lit_pupils,
    measure,
    measure_pupils,
    stop_boundary,
)
from maskfab.job.camera import Camera
from maskfab.job.process import UNSTATED, MaskBlank
from maskfab.job.sections import LimitsSection
from maskfab.mask.comparison.alignment import (
    Alignment,
    LayersRead,
    StatedLayers,
    align,
    clear_only,
    draws,
    in_drawn_unit,
)
from maskfab.mask.comparison.faults import (
    Known,
    asked,
    drawn_figures,
    named_cells,
    reach,
    rules_of_like,
    rules_of_unlike,
    slanted,
)
from maskfab.mask.comparison.roundtrip import CdCheck, RoundTrip, clear_length_nm, compare_layout
from maskfab.mask.formats.content import array_drift, moved_nm, rounding_nm
from maskfab.mask.formats.picture import IMAGE_SUFFIXES, read_picture
from maskfab.mask.formats.table import layout_format, read_layout
from maskfab.mask.layout import (
    DBU_UM,
    clear_box,
    clear_shapes,
    count_shapes,
    layer_info,
    left_out,
    plate_layout,
    region,
    weight,
)
from maskfab.mask.plate_rules import judged
from maskfab.mask.process_limits import allow
from maskfab.mask.raster import aperture_in_stop, axis_nm, edge_distances, light_box, sees_light
from maskfab.mask.sandbox import SHAPES_PER_SECOND
from maskfab.optics import metrics
from maskfab.optics.psf import Leak, pixel_margin
from maskfab.optics.pupil import Lattice, cut
from maskfab.optics.stop_edges import edges_in_stop, stop_box

MOST_SEEN_ALONE = 50_000
"""Shapes before a stop whose optics are measured though they are not the design's."""

_FINEST_GRID = 1000
_TOLD_OF_LIKE = frozenset({"stop_open_ratio", "readback_psf_difference"})
_TOLD_OF_UNLIKE = frozenset({"auc_radial_min", "mtf50", "mtf30", "mtf10", "peak_strehl", "psf_energy_in_window"})


def optics_of_like(
    die: Die, camera: Camera, blank: MaskBlank, design: db.Layout, laid: db.Layout, equal: bool
) -> Iterator[Quantity]:
    """The PSF and MTF of a die of a file that is the design, or nearly."""
    bare = _bare(die)
    box = light_box(die, camera.stop)
    # A layout in cells is seen through faster than one without, where both are the same.
    shapes = clear_shapes(design if equal else laid, box)
    if not sees_light(die, camera.stop, shapes):
        yield Quantity("optics", "dark", "nothing is clear before the stop", limit="ok", passed=False, die=die.name)
        return
    measured = measure(bare, camera, shapes, blank)
    yield from (quantity for quantity in measured.quantities if quantity.name in _TOLD_OF_LIKE)
    expected = measured if equal else measure(bare, camera, clear_shapes(design, box), blank)
    alike = "; the polygons are the same" if equal else ""
    yield from _mtf_differences(measured.mtfs, expected.mtfs, die.name, alike)


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
        measured = _measured(read, axis_nm(die), camera, blank, die.panel.dot_nm, die.name)
        if measured is None:
            continue
        dark = False
        yield from measured.quantities
        expected = measure(_bare(die), camera, clear_shapes(design, light_box(die, camera.stop)), blank)
        yield from _mtf_differences(measured.mtfs, expected.mtfs, die.name, "")
    if not dark:
        return
    middle = clear_box(read).center()
    axis = float(middle.x), float(middle.y)
    dot_nm = min(die.panel.dot_nm for die in plate.dies)
    if _too_many(read, stop_box(camera.stop, axis, dot_nm)):
        yield _not_measured(None)
        return
    measured = _measured(read, axis, camera, blank, dot_nm, None)
    x, y = middle.x / NM_PER_UM, middle.y / NM_PER_UM
    where = f"the middle of the file, ({x:g}, {y:g}) um, for it has nothing where dies are"
    if measured is None:
        yield Quantity("optics", "dark", f"nothing is clear before the stop at {where}", limit="ok", passed=False)
        return
    yield from (replace(quantity, method=f"{quantity.method}; at {where}") for quantity in measured.quantities)


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
    lit = lit_pupils(pupil, leak, camera)
    raster = f"of a raster of {lattice.dot_um:g} um"

    def difference(error: float, wavelength: float) -> Quantity:
        method = f"relative L2 between the polygons' PSF and that {raster}"
        return Quantity("raster_psf_difference", error, method, die=name, wavelength_nm=wavelength)

    outline = stop_boundary(edges, area, camera, pixel_margin(camera))
    measured = measure_pupils(pupil, None, lit, outline, camera, INVARIANT_LIMIT_ROUND, difference, name)
    quantities = [
        metrics.stop_open_ratio(
            area,
            camera,
            name,
            "area of the file's polygons inside the stop over the stop's",
            shapes.perimeter() * moved_nm(read) / NM_PER_UM**2,
        )
    ]
    about = f"; {raster}, on which every edge lies" if exact else f"; {raster}, finer than which nothing is resolved"
    for quantity in measured.quantities:
        if quantity.name in _TOLD_OF_UNLIKE:
            quantities.append(replace(quantity, method=quantity.method + about, limit=None, passed=None))
        elif quantity.name == "raster_psf_difference":
            quantities.append(quantity)
    return replace(measured, quantities=tuple(quantities))


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


def _mtf_differences(curves: tuple[Mtf, ...], expected: tuple[Mtf, ...], name: str, alike: str) -> Iterator[Quantity]:
    for one, other in zip(curves, expected, strict=True):
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


MOST_INVERTED = 2_000_000
_SECONDS_PER_DIE = 2
"""That its optics may take of the processor, see :mod:`maskfab.mask.sandbox`; they take one."""

_MOST_DRIFT_NM = 1.0
"""A step of the grid: a copy that is off by more is on another place of it."""

_TOLD_PLACES = 4
_MOST_TOLERATED = 0.01


@dataclass(frozen=True)
class How:
    """Reading options of a file where it does not state them itself.

    Attributes:
        layer: what is clear; CLEAR or the only layer if None.
        cell: the plate's cell; the only top cell if None.
        dots_per_um: pixels of an image in a micrometre; what its tags say if None.
        unit_um: one unit of a DXF; what its header says if None.
        ignored: layers that are not written, though they hold shapes.
        dark: whether what the file draws is chrome, and the rest clear.
        tolerance_nm: differences no wider than this are slivers, and no fault.
    """

    layer: str | None = None
    cell: str | None = None
    dots_per_um: float | None = None
    unit_um: float | None = None
    ignored: tuple[str, ...] = ()
    dark: bool = False
    tolerance_nm: float = 0.0


@dataclass(frozen=True, eq=False)
class Foreign:
    """A file held against a design.

    Attributes:
        trip: the comparison once it lies as the design does; None where it is not the design at all.
    """

    path: Path
    alignment: Alignment
    trip: RoundTrip | None
    quantities: tuple[Quantity, ...]
    layers: LayersRead

    @property
    def dark(self) -> bool:
        """Whether what the file draws was found to be what is opaque."""
        return self.alignment.inverted


def only_die(plate: Plate, name: str) -> Plate:
    """The plate with one die and nothing else. Raises JobError MF105 if there is no such die."""
    dies = tuple(die for die in plate.dies if die.name == name)
    if not dies:
        what = f"there is no die {name!r}"
        raise JobError("MF105", what, where="--die", cure=f"Use one of {', '.join(die.name for die in plate.dies)}")
    return replace(plate, dies=dies, marks=(), gauges=(), notes=())


def check_foreign(
    plate: Plate,
    camera: Camera,
    limits: LimitsSection,
    path: Path,
    how: How | None = None,
    progress: Progress = silent,
    *,
    blank: MaskBlank = UNSTATED,
    max_vertices: int | None = None,
    ordered: StatedLayers | None = None,
) -> Foreign:
    """Read a file and compare it with a plate: position, tone, geometry, CDs, rules, and the optics of every die.

    Args:
        plate: the design, or one die of it, see :func:`only_die`.
        limits: the job's; the whole file keeps them, or is no worse than the design by the design's own smallest.
        max_vertices: of a polygon, as the job draws them; None where it leaves that open.

    Raises:
        SourceError: MF301 to MF318 if the file cannot be read as it stands; MF309 if nothing of it is clear.
        JobError: MF104 for a tolerance that would hide faults.
    """
    progress("read", 0, 1)
    how, ordered = how or How(), ordered or StatedLayers()
    largest = min(die.panel.dot_nm for die in plate.dies) * _MOST_TOLERATED
    if how.tolerance_nm > largest:
        what = f"a tolerance of {how.tolerance_nm:g} nm is more than {largest:g} nm, a hundredth of the smallest dot"
        cure = "Give a smaller one; 1 nm is enough for data fractured into trapezoids"
        raise JobError("MF104", what, where="--tolerance", cure=cure)
    read, layers = _read(path, how, ordered)
    if not draws(read, read.find_layer(layer_info(CLEAR))):
        cure = "Name the layer that is clear with --layer, or export it again"
        raise SourceError("MF309", f"nothing of {path.name} is clear", where=str(path), cure=cure)
    design = plate_layout(plate)
    clear_only(design, path)
    allow(count_shapes(design) / SHAPES_PER_SECOND)
    progress("align", 0, 1)
    alignment = align(plate, design, read)
    read, alignment = in_drawn_unit(
        plate, design, read, alignment, lambda unit_um: _read(path, replace(how, unit_um=unit_um), ordered)[0]
    )
    quantities = [*layers.quantities(path.name, ordered), _lies(plate, path, alignment, how), *_of_file(path, read)]
    quantities += named_cells(read)
    if not alignment.alike:
        progress("rules", 0, 1)
        wanted = asked(plate, limits)
        quantities += [*rules_of_unlike(read, wanted), *drawn_figures(read, path, max_vertices), slanted(read, None)]
        quantities.append(reach(plate, clear_box(read), 1.0))
        allow(_SECONDS_PER_DIE * len(plate.dies))
        progress("optics", 0, 1)
        quantities += optics_of_unlike(plate, camera, blank, design, read)
        return Foreign(path, alignment, None, tuple(quantities), layers)
    wanted, box = asked(plate, limits, alignment.scale), clear_box(read).transformed(alignment.trans)
    simple = alignment.scale == 1 and not alignment.inverted
    # What is turned over, or scaled and rounded, is no longer drawn as the file draws it.
    drawn = [] if simple else list(drawn_figures(read, path, max_vertices))
    _turn_over(read, alignment, path)
    cds = _own_cds(plate, design, read, alignment)
    laid = _laid(plate, read, alignment)
    progress("compare", 0, 1)
    trip = compare_layout(plate, design, laid, path, tolerance_nm=how.tolerance_nm, dots_prove=True)
    quantities += _of_geometry(replace(trip, cds=cds), limits, how.tolerance_nm)
    progress("rules", 0, 1)
    quantities += rules_of_like(plate, design, laid, trip.slivers.faults, wanted)
    if simple:
        tolerated = Known(design, trip.differing, how.tolerance_nm)
        drawn = list(drawn_figures(laid, path, max_vertices, tolerated))
    quantities += [*drawn, slanted(laid, design), reach(plate, box, wanted.size)]
    for done, die in enumerate(plate.dies):
        allow(_SECONDS_PER_DIE)
        progress("optics", done, len(plate.dies))
        equal = (trip.differing & db.Region(db.Box(*light_box(die, camera.stop)))).is_empty()
        quantities += optics_of_like(die, camera, blank, design, laid, equal)
    progress("optics", len(plate.dies), len(plate.dies))
    return Foreign(path, alignment, trip, tuple(quantities), layers)


def _read(path: Path, how: How, ordered: StatedLayers) -> tuple[db.Layout, LayersRead]:
    if path.suffix.lower() in IMAGE_SUFFIXES and how.unit_um is None:
        return read_picture(path, how.dots_per_um), LayersRead()
    layout = read_layout(path, how.unit_um)
    layers = clear_only(layout, path, how.layer, how.cell, how.ignored, ordered)
    form = layout_format(path)
    return layout, replace(layers, clear="") if form is not None and form.layers == "one" else layers


def _turn_over(read: db.Layout, alignment: Alignment, path: Path) -> None:
    """Draw what the file leaves out, within its own outline, if it is of the other tone."""
    if not alignment.inverted:
        return
    if count_shapes(read) > MOST_INVERTED:
        what = f"{path.name} is of the other tone, and has over {MOST_INVERTED} shapes to invert"
        cure = "Invert it where it was made, or verify one die at a time"
        raise SourceError("MF313", what, where=str(path), cure=cure)
    drawn = region(read, CLEAR)
    clear = (db.Region(drawn.bbox()) - drawn).merged(True, 1)
    top = read.create_cell("INVERTED")
    top.shapes(read.find_layer(layer_info(CLEAR))).insert(clear)
    for other in [cell.cell_index() for cell in read.top_cells() if cell.cell_index() != top.cell_index()]:
        read.prune_cell(other, -1)


def _own_cds(plate: Plate, design: db.Layout, read: db.Layout, alignment: Alignment) -> tuple[CdCheck, ...]:
    back = alignment.trans.inverted()
    quantities = []
    for gauge in plate.gauges:
        centre = back.trans(db.Point(*gauge.centre_nm))
        across: Literal["x", "y"] = "x" if (gauge.axis == "x") == (alignment.turn % 2 == 0) else "y"
        reach_nm = round(gauge.reach_nm / alignment.scale)
        there = replace(gauge, centre_nm=(centre.x, centre.y), axis=across, reach_nm=reach_nm)
        quantities.append(CdCheck(gauge, clear_length_nm(design, gauge), clear_length_nm(read, there)))
    return tuple(quantities)


def _laid(plate: Plate, read: db.Layout, alignment: Alignment) -> db.Layout:
    """The file as it would be if it lay as the design does; within the slot if the plate is one die alone."""
    identity = alignment.turn == 0 and alignment.scale == 1 and alignment.shift_nm == (0, 0)
    alone = not plate.marks and len(plate.dies) == 1
    if not identity:
        old, top = read.top_cell().cell_index(), read.create_cell("ALIGNED")
        straight = alignment.scale == 1
        turn = db.Trans(alignment.turn % 4, alignment.turn >= 4, *alignment.shift_nm) if straight else alignment.trans
        top.insert(db.CellInstArray(old, turn))
    if alone:
        (x, y), half = plate.dies[0].centre_nm, plate.dies[0].slot_nm // 2
        old = read.top_cell().cell_index()
        clipped = read.clip(old, db.Box(x - half, y - half, x + half, y + half))
        part = db.Layout()
        part.dbu = DBU_UM
        part.layer(layer_info(CLEAR))
        part.create_cell("DIE").copy_tree(read.cell(clipped))
        return part
    return read


def _of_file(path: Path, read: db.Layout) -> Iterator[Quantity]:
    noted = left_out(read)
    name = path.name
    # GDSII and OASIS label cells so; who sets text in a drawing may well mean it to be seen.
    is_dxf = suffix_of(path) == ".dxf"
    yield Quantity("rounding", rounding_nm(read), f"largest distance of a coordinate of {name} to the grid")
    drift_nm, which = array_drift(read)
    if which:
        method = f"{which} of {name} is {drift_nm:.3g} nm off steps of whole nanometres, which add up"
        yield Quantity("array_drift", drift_nm, method, limit=_MOST_DRIFT_NM, passed=drift_nm <= _MOST_DRIFT_NM)
    yield from drawing_quantities(read, name)
    for what, count, method, wrong in (
        ("empty_polygons", noted.empty_polygons, f"polygons of {name} without area", True),
        ("repeated_vertices", noted.repeated_vertices, f"vertices of {name} that repeat the one before", True),
        ("approximated_curves", noted.curves, f"curves of {name} made polygons within 1 nm", False),
        ("texts", noted.texts, f"texts of {name} on its clear layer, of which a mask shows nothing", is_dxf),
        ("grey_pixels", noted.grey_pixels, f"pixels of {name} that are neither black nor white", True),
    ):
        yield Quantity(what, count, method, limit=0 if wrong else None, passed=count == 0 if wrong else None)


def _lies(plate: Plate, path: Path, alignment: Alignment, how: How) -> Quantity:
    positioned = path.suffix.lower() not in IMAGE_SUFFIXES
    faults = alignment.faults(positioned=positioned, dark=how.dark)
    right = "as the design"
    method = f"{path.name} held against the design in every position, unit and tone"
    if alignment.unit:
        method += f"; read again in {alignment.unit}, before anything is rounded, as for all that follows"
    elif not alignment.alike and len(plate.dies) > 1:
        method += "; a file of one die alone is verified with --die"
    elif faults and alignment.alike:
        method += "; undone for all that follows, save for sizes, which are the file's own, and how it is drawn"
    if alignment.alike and alignment.inverted != how.dark:
        method += "; say --tone if the house is told that what is drawn is " + ("clear" if how.dark else "opaque")
    return Quantity("lies", " and ".join(faults) or right, method, limit=right, passed=not faults)


def _of_geometry(trip: RoundTrip, limits: LimitsSection, tolerance_nm: float) -> Iterator[Quantity]:
    name, slivers = trip.path.name, trip.slivers
    shown = [str(difference) for difference in trip.differences[:_TOLD_PLACES]]
    more = len(trip.differences) - len(shown)
    where = ": " + "; ".join(shown) + (f" and {more} more" if more else "") if shown else ""
    than = f" in parts wider than {tolerance_nm:g} nm" if tolerance_nm else ""
    yield Quantity(
        "xor_area",
        trip.xor_area_um2,
        f"area that only one of {name} and the design makes clear{than}{where}",
        limit=0.0,
        passed=trip.xor_area_um2 == 0,
    )
    if tolerance_nm:
        area = slivers.slivers.area() / NM_PER_UM**2
        widest = f", the widest of at most {slivers.widest_nm:.3g} nm" if area else ""
        method = f"area that only one of {name} and the design makes clear in {slivers.slivers.count()} slivers of up "
        yield Quantity("sliver_area", area, method + f"to {tolerance_nm:g} nm, as --tolerance allows{widest}")
    drawn_alike = {"readback_xor_area", "polygons"}
    for quantity in trip.quantities():
        # How many polygons draw the same area is the drawer's affair.
        if quantity.die is not None or quantity.name not in drawn_alike:
            yield judged(_tolerated(quantity, tolerance_nm), limits)


def _tolerated(quantity: Quantity, tolerance_nm: float) -> Quantity:
    """A CD that is as far off as the tolerance lets an edge be passes."""
    off, limit = quantity.value, quantity.limit
    if not quantity.name.startswith("cd_") or not isinstance(off, int) or not isinstance(limit, int):
        return quantity
    return replace(quantity, passed=abs(off - limit) <= tolerance_nm)
