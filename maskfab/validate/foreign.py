"""A mask file that maskfab did not write, against a job: how it lies, what differs where, and what that does to light.

Whatever is wrong with how the file lies is undone first, and told, so that everything else can be compared.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from klayout import db

from maskfab.errors import JobError, SourceError
from maskfab.export.figures import CUT
from maskfab.geometry.drc.flat import flat_results, merged
from maskfab.geometry.drc.layout import drawn_polygons
from maskfab.geometry.drc.results import RuleResult
from maskfab.geometry.drc.rules import DesignRules
from maskfab.geometry.reading import find_cell, find_layer, read_layout, rounding_nm
from maskfab.geometry.reading_image import IMAGE_SUFFIXES, read_picture
from maskfab.geometry.reading_limits import count_shapes, left_out
from maskfab.geometry.region import DBU_UM, clear_shapes, layer_info, plate_layout, region
from maskfab.geometry.stop import stop_box
from maskfab.model import CLEAR, Camera, Die, DieOptics, Plate, Quantity
from maskfab.progress import Progress, silent
from maskfab.spec import LimitsSection
from maskfab.units import NM_PER_UM
from maskfab.validate.alignment import Alignment, align
from maskfab.validate.features import smallest_features
from maskfab.validate.optics import READBACK_LIMIT, axis_nm, measure
from maskfab.validate.roundtrip import RoundTrip, compare

MOST_INVERTED = 2_000_000
_MOST_PLACES = 2000
_TOLD_PLACES = 4


@dataclass(frozen=True)
class How:
    """How a file is to be read where it does not say so itself.

    Attributes:
        layer: what is clear; CLEAR or the only layer if None.
        cell: the plate's cell; the only top cell if None.
        dots_per_um: pixels of an image in a micrometre; what its tags say if None.
    """

    layer: str | None = None
    cell: str | None = None
    dots_per_um: float | None = None


@dataclass(frozen=True, eq=False)
class Foreign:
    """A file held against a design.

    Attributes:
        path: the file.
        alignment: how it lies.
        trip: the comparison once it lies as the design does; None where it is not the design at all.
        quantities: everything that is told.
    """

    path: Path
    alignment: Alignment
    trip: RoundTrip | None
    quantities: tuple[Quantity, ...]


def only_die(plate: Plate, name: str) -> Plate:
    """The plate with one die and nothing else.

    Raises:
        JobError: MF105 if there is no such die.
    """
    dies = tuple(die for die in plate.dies if die.name == name)
    if not dies:
        raise JobError(
            "MF105",
            f"there is no die {name!r}",
            where="--die",
            cure=f"Use one of {', '.join(die.name for die in plate.dies)}",
        )
    return replace(plate, dies=dies, furniture=(), gauges=(), notes=())


def check_foreign(
    plate: Plate,
    camera: Camera,
    limits: LimitsSection,
    path: Path,
    how: How | None = None,
    progress: Progress = silent,
) -> Foreign:
    """Read a file and compare it with a plate: position, tone, geometry, CDs, rules, and the optics of every die.

    Args:
        plate: the design, or one die of it, see :func:`only_die`.
        camera: what looks through it.
        limits: the job's; features are judged by them, or by the design's own smallest.
        path: the file, of any kind that :func:`read_layout` or :func:`read_picture` reads.
        how: what the file does not say itself.
        progress: told where the work stands.

    Raises:
        SourceError: MF301 to MF316 if the file cannot be read as it stands.
    """
    progress("read", 0, 1)
    read = _read(path, how or How())
    design = _clear_only(plate_layout(plate), None, None, path)
    progress("align", 0, 1)
    alignment = align(plate, design, read)
    positioned = path.suffix.lower() not in IMAGE_SUFFIXES
    quantities = [*_of_file(path, read), _lies(path, alignment, positioned)]
    if not alignment.alike:
        return Foreign(path, alignment, None, tuple(quantities))
    laid = _laid(plate, read, alignment, path)
    progress("compare", 0, 1)
    trip = compare(plate, design, laid, path)
    quantities += _of_geometry(trip)
    progress("rules", 0, 1)
    quantities += _of_rules(plate, design, trip, limits)
    for done, die in enumerate(plate.dies):
        progress("optics", done, len(plate.dies))
        quantities += _of_optics(die, camera, design, laid, trip)
    progress("optics", len(plate.dies), len(plate.dies))
    return Foreign(path, alignment, trip, tuple(quantities))


def _read(path: Path, how: How) -> db.Layout:
    if path.suffix.lower() in IMAGE_SUFFIXES:
        return read_picture(path, how.dots_per_um)
    return _clear_only(read_layout(path), how.layer, how.cell, path)


def _clear_only(layout: db.Layout, layer: str | None, cell: str | None, path: Path) -> db.Layout:
    """One top cell with what is clear, on the layer CLEAR, and nothing else; notes about the file stay."""
    try:
        root, info = find_cell(layout, cell), find_layer(layout, layer)
    except SourceError as error:
        raise SourceError(error.code, error.what, where=str(path), cure=error.cure) from None
    for index in [each.cell_index() for each in layout.top_cells() if each.cell_index() != root.cell_index()]:
        _drop_above(layout, index, root.cell_index())
    cut = layout.find_layer(layer_info(CUT))
    if layer is None and cut is not None and not root.bbox(cut).empty():
        exposed = (region(layout, info) - region(layout, CUT)).merged(True, 1)
        layout.flatten(root.cell_index(), -1, True)
        root.shapes(layout.find_layer(info)).clear()
        root.shapes(layout.find_layer(info)).insert(exposed)
    kept = layout.find_layer(info)
    for index in layout.layer_indexes():
        if index != kept:
            layout.delete_layer(index)
    layout.set_info(kept, layer_info(CLEAR))
    return layout


def _drop_above(layout: db.Layout, index: int, kept: int) -> None:
    """Delete a top cell and everything below it that is neither a cell nor part of it."""
    if kept not in layout.cell(index).called_cells():
        layout.prune_cell(index, -1)
        return
    below = list(layout.cell(index).each_child_cell())
    layout.delete_cell(index)
    for child in below:
        if child != kept and layout.is_valid_cell_index(child) and layout.cell(child).is_top():
            _drop_above(layout, child, kept)


def _laid(plate: Plate, read: db.Layout, alignment: Alignment, path: Path) -> db.Layout:
    """The file as it would be if it lay as the design does; within the slot if the plate is one die alone."""
    identity = alignment.turn == 0 and alignment.scale == 1 and alignment.shift_nm == (0, 0)
    alone = not plate.furniture and len(plate.dies) == 1
    index = read.find_layer(layer_info(CLEAR))
    if alignment.inverted:
        if count_shapes(read) > MOST_INVERTED:
            raise SourceError(
                "MF313",
                f"{path.name} is of the other tone, and has over {MOST_INVERTED} shapes to invert",
                where=str(path),
                cure="Invert it where it was made, or verify one die at a time",
            )
        drawn = region(read, CLEAR)
        clear = (db.Region(drawn.bbox()) - drawn).merged(True, 1)
        top = read.create_cell("INVERTED")
        top.shapes(index).insert(clear)
        for other in [each.cell_index() for each in read.top_cells() if each.cell_index() != top.cell_index()]:
            read.prune_cell(other, -1)
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
    yield Quantity("rounding", "", rounding_nm(read), "nm", f"largest distance of a coordinate of {name} to the grid")
    for what, count, method, judged in (
        ("empty_polygons", noted.empty_polygons, f"polygons of {name} without area", True),
        ("repeated_vertices", noted.repeated_vertices, f"vertices of {name} that repeat the one before", True),
        ("approximated_curves", noted.curves, f"circles of {name} made polygons within 1 nm", False),
        ("grey_pixels", noted.grey_pixels, f"pixels of {name} that are neither black nor white", True),
    ):
        yield Quantity(what, "", count, "", method, limit=0 if judged else None, passed=count == 0 if judged else None)


def _lies(path: Path, alignment: Alignment, positioned: bool) -> Quantity:
    faults = alignment.faults(positioned=positioned)
    right = "as the design"
    method = f"{path.name} held against the design in every position, unit and tone"
    if faults and alignment.alike:
        method += "; undone for everything that follows"
    return Quantity("lies", "", " and ".join(faults) or right, "", method, limit=right, passed=not faults)


def _of_geometry(trip: RoundTrip) -> Iterator[Quantity]:
    name = trip.path.name
    shown = [str(difference) for difference in trip.differences[:_TOLD_PLACES]]
    more = len(trip.differences) - len(shown)
    where = ": " + "; ".join(shown) + (f" and {more} more" if more else "") if shown else ""
    yield Quantity(
        "xor_area",
        "A_xor",
        trip.xor_area_um2,
        "um^2",
        f"area that only one of {name} and the design makes clear{where}",
        limit=0.0,
        passed=trip.xor_area_um2 == 0,
    )
    drawn_alike = {"readback_xor_area", "polygons"}
    for quantity in trip.quantities():
        # How many polygons draw the same area is the drawer's affair.
        if quantity.die is not None or quantity.name not in drawn_alike:
            yield quantity


def _of_rules(plate: Plate, design: db.Layout, trip: RoundTrip, limits: LimitsSection) -> Iterator[Quantity]:
    """Features that are too small and that the design does not have; they can only lie where something differs."""
    rules, stated = _rules(plate, limits)
    places = _places(design, trip.layout, rules.reach_nm)
    looked = places[:_MOST_PLACES]
    found, expected = (_broken(layout, looked, rules) for layout in (trip.layout, design))
    by_name = {result.rule: result for result in expected}
    beyond = f"; only the first {_MOST_PLACES} places that differ were looked at" if len(places) > len(looked) else ""
    for result in found:
        before = by_name[result.rule].count
        at = ", ".join(f"({box[0] / 1e3:g}, {box[1] / 1e3:g})" for box in result.places[:_TOLD_PLACES])
        worst = f"; the smallest is {result.value} nm, at {at} um" if result.count else ""
        yield Quantity(
            f"rule_{result.rule}",
            "",
            result.count,
            "",
            f"places narrower than {result.limit} nm, {stated}, where {trip.path.name} differs from the design, which "
            f"has {before} there{worst}{beyond}",
            limit=before,
            passed=result.count <= before,
        )


def _rules(plate: Plate, limits: LimitsSection) -> tuple[DesignRules, str]:
    """Width and space by the job's limits, else by the smallest features of the design itself."""
    stated = "the limit of the job"
    width, space = limits.min_feature, limits.min_space
    if width is None or space is None:
        stated = "the limit of the job or the smallest of the design"
        own = [smallest_features(die) for die in plate.dies]
        smallest = [[pair[k].value for pair in own] for k in (0, 1)]
        floats = [[value for value in values if isinstance(value, float)] for values in smallest]
        width = width if width is not None else min(floats[0], default=None)
        space = space if space is not None else min(floats[1], default=None)
    whole = [None if value is None else max(1, round(value * NM_PER_UM)) for value in (width, space)]
    return DesignRules(min_width_nm=whole[0], min_space_nm=whole[1]), stated


def _places(design: db.Layout, laid: db.Layout, reach_nm: int) -> list[db.Box]:
    """Boxes round all that differs, wide enough for every rule."""
    store = db.DeepShapeStore()
    deep = [
        db.Region(layout.top_cell().begin_shapes_rec(layout.find_layer(layer_info(CLEAR))), store)
        for layout in (design, laid)
    ]
    differing = db.Region(list((deep[0] ^ deep[1]).each()))
    differing.size(2 * reach_nm)
    return [polygon.bbox() for polygon in differing.merged().each()]


def _broken(layout: db.Layout, places: Sequence[db.Box], rules: DesignRules) -> tuple[RuleResult, ...]:
    index = layout.find_layer(layer_info(CLEAR))
    shapes = db.Region()
    for box in places:
        shapes += db.Region(layout.top_cell().begin_shapes_rec_overlapping(index, box))
    part = db.Layout()
    part.dbu = DBU_UM
    here = part.layer(layer_info(CLEAR))
    part.create_cell("PLACES").shapes(here).insert(shapes)
    return flat_results(merged(shapes), drawn_polygons(part, [here]), rules, _TOLD_PLACES)


def _of_optics(die: Die, camera: Camera, design: db.Layout, laid: db.Layout, trip: RoundTrip) -> Iterator[Quantity]:
    bare = replace(die, panel=replace(die.panel, tracks=()))
    box = stop_box(camera.stop, axis_nm(die))
    shapes = clear_shapes(laid, box)
    if shapes.is_empty() if isinstance(shapes, db.Region) else not len(shapes):
        yield Quantity(
            "optics", "", "dark", "", "nothing is clear before the stop", limit="ok", passed=False, die=die.name
        )
        return
    found = measure(bare, camera, shapes)
    yield from (
        quantity for quantity in found.quantities if quantity.name in {"stop_open_ratio", "readback_psf_difference"}
    )
    equal = next(check.xor_area_um2 for check in trip.dies if check.name == die.name) == 0
    expected = found if equal else measure(bare, camera, clear_shapes(design, box))
    for line, difference in zip(camera.wavelengths_nm, _mtf_differences(found, expected), strict=True):
        yield Quantity(
            "mtf_difference",
            "ΔM",
            difference,
            "1",
            "largest difference of any cut of the MTF to the design's"
            + ("; the polygons are the same" if equal else ""),
            limit=READBACK_LIMIT,
            passed=difference <= READBACK_LIMIT,
            die=die.name,
            wavelength_nm=line,
        )


def _mtf_differences(found: DieOptics, expected: DieOptics) -> Iterator[float]:
    for one, other in zip(found.mtfs, expected.mtfs, strict=True):
        yield max(float(np.abs(one.cuts[name] - other.cuts[name]).max()) for name in one.cuts)
