"""A plate and its drawing as a mask house takes them: layers, marks, grid, cells and styles.

Where no two figures may share a piece of edge, marks are cut open by narrow bars of chrome, as stencils are."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np
from klayout import db

from maskfab.base.model import CLEAR, Box, Die, Mark, Plate, Point
from maskfab.base.units import NM_PER_MM, NM_PER_UM, to_nm
from maskfab.job.order import Tone
from maskfab.job.sections import DRAWING_KEYS, ExportSection, JobSpec
from maskfab.job.shop import Shop
from maskfab.job.values import MASK_FORMATS, MEASURED_FORMATS, FileFormat
from maskfab.mask.composition import lies_on, snapped
from maskfab.mask.figures import MAX_VERTICES, Figures, Hierarchy, PolygonOptions, Shapes
from maskfab.mask.formats.format import DrawingStyle
from maskfab.mask.formats.table import FORMATS
from maskfab.mask.layout import drawn_region, file_references
from maskfab.mask.layout import references as references_in
from maskfab.mask.marks import bounding_box, plate_template
from maskfab.mask.outlines import Holes, hull_points, simple_pieces

_BAR_NM = 4_000
_MOST_TIMES = 8


def stencilled(mark: Mark, holes: Holes, narrowest_nm: int = 0) -> Mark:
    """The mark with chrome bars across whatever would have to be cut.

    Every hole is opened by a bar, and every place where an outline touches itself. Holes that have a layer of their own
    need that only where something clear stands in them, for the figure that is subtracted would have a hole itself.

    Args:
        narrowest_nm: the narrowest space that the house writes; bars are twice as wide, and at least 4 um.

    Returns:
        The mark itself where nothing has to be cut.
    """
    whole = drawn_region(mark.polygons).merged(True, 1)
    sound, cut = db.Region(), db.Region()
    for polygon in whole.each():
        alone = db.Region(polygon)
        hull = db.Polygon(list(polygon.each_point_hull()))
        filled = db.Region(hull)
        touching = next(simple_pieces(filled)).num_points() != hull.num_points()
        inhabited = polygon.holes() > 0 and (holes != "layer" or not ((whole - alone) & filled).is_empty())
        (cut if touching or inhabited else sound).insert(polygon)
    if cut.is_empty():
        return mark
    half = max(_BAR_NM // 2, narrowest_nm)
    for _ in range(_MOST_TIMES):
        shared = inner_edges(db.Region(list(simple_pieces(cut))))
        if shared.is_empty():
            break
        cut = (cut - shared.extended(half, half, half, half, False)).merged(True, 1)
    drawn = sorted(
        map(hull_points, [*simple_pieces(cut), *simple_pieces(sound)]), key=lambda points: [(y, x) for x, y in points]
    )
    return replace(mark, polygons=tuple(drawn))


def inner_edges(drawn: db.Region) -> db.Edges:
    """Where two polygons of a region, taken as they were put in, share a piece of edge; told from either side."""
    whole = drawn.merged()
    raw = drawn.dup()
    raw.merged_semantics = False
    edges = raw.edges()
    edges.merged_semantics = False
    shared = edges.inside_part(whole)
    # Or the two sides, which run in opposite directions, cancel.
    shared.merged_semantics = False
    return shared


def references(figures: Figures) -> int:
    """References of the file, an array counting once, or its definitions, whichever are more."""
    if figures.options.hierarchy != "cells":
        return 0
    outer = len(figures.dies) + len(figures.marks)
    return max(figures.account.references, figures.account.definitions) + outer


def longest(figures: Figures) -> int:
    """Vertices of the figure that has most."""
    counts = [len(polygon) for shapes in _drawn(figures) for polygons in shapes.values() for polygon in polygons]
    counts += [int(polygon.num_points()) for region in figures.merged.values() for polygon in region.each()]
    return max(counts, default=0)


def flashes(figures: Figures) -> int:
    """Rectangles that a pattern generator exposes for the whole plate, every reference followed.

    Outlines are cut into horizontal bars; slanted strokes of letters count as the trapezoids they are cut into, so
    the true number is not smaller.
    """
    total = sum(_all_bars(mark.shapes) for mark in figures.marks)
    total += sum(int(region.decompose_trapezoids_to_region().count()) for region in figures.merged.values())
    for die in figures.dies:
        for grid in die.grids:
            held, times = np.unique(grid.index, return_counts=True)
            bars = (_all_bars(figures.cells[grid.cells[number]]) for number in held.tolist())
            total += sum(count * bar for count, bar in zip(times.tolist(), bars, strict=True))
    return total


def _all_bars(shapes: Shapes) -> int:
    drawn = (drawn_region(polygons) for layer, polygons in shapes.items() if layer.written)
    return sum(int(region.decompose_trapezoids_to_region().count()) for region in drawn)


@dataclass(frozen=True)
class Shared:
    """Pieces of edge that figures of a die or a mark share.

    Attributes:
        owner: the die or mark, such as ``die HOLE``.
        cell: the cell in which they lie; empty where figures are merged across cells.
        length_nm: of all of them, each told once; in a cell, of one of its references.
        first_nm: an end of one, in coordinates of the cell, or of the plate where there is none.
    """

    owner: str
    cell: str
    length_nm: int
    first_nm: Point


def shared_edges(figures: Figures) -> tuple[Shared, ...]:
    """Where written figures share a piece of edge, as those do that were cut at a hole; dies first."""
    users = {name: f"die {die.name}" for die in reversed(figures.dies) for grid in die.grids for name in grid.cells}
    named = {name: (users[name], shapes) for name, shapes in figures.cells.items()}
    named |= {mark.name: (f"mark {mark.name}", mark.shapes) for mark in figures.marks}
    shared: list[Shared] = []
    for name, (owner, shapes) in named.items():
        for layer, polygons in shapes.items():
            if layer.written:
                edges = _edges(drawn_region(polygons))
                shared += [_shared(owner, name, edges)] if edges is not None else []
    for region in figures.merged.values():
        edges = _edges(region.dup())
        shared += _by_owner(figures, edges) if edges is not None else []
    return tuple(shared)


def cut_cells(figures: Figures) -> tuple[str, ...]:
    """Cells and marks of which some written figures share a piece of edge; the top cell where they are merged."""
    return tuple(sorted({shared.cell or figures.top for shared in shared_edges(figures)}))


def _by_owner(figures: Figures, edges: db.Edges) -> Iterator[Shared]:
    """Edges of figures that are merged across cells, by the die or else the mark that they lie in."""
    boxes: dict[str, Box] = {f"die {die.name}": die.box_nm for die in figures.plate.dies}
    for mark in figures.plate.marks:
        if mark.layer.written and mark.polygons:
            boxes[f"mark {mark.name}"] = bounding_box(mark.polygons)
    for owner, box in boxes.items():
        inside = edges.inside_part(db.Region(db.Box(*box).enlarged(1, 1)))
        inside.merged_semantics = False
        if not inside.is_empty():
            yield _shared(owner, "", inside)


def _shared(owner: str, cell: str, edges: db.Edges) -> Shared:
    first = min((min(edge.p1, edge.p2) for edge in edges.each()), key=lambda point: (point.y, point.x))
    return Shared(owner, cell, int(edges.length()) // 2, (first.x, first.y))


def _edges(drawn: db.Region) -> db.Edges | None:
    """The edges that figures share, from either side; None where there are none, which is quickly told."""
    merged = drawn.merged(True, 1).perimeter()
    drawn.merged_semantics = False
    return inner_edges(drawn) if drawn.perimeter() > merged else None


def facing_dots(die: Die) -> int:
    """Pairs of dots, clear in two neighbouring cells of a die, that meet by a side for want of a gutter."""
    panel = die.panel
    if panel.gutter_nm:
        return 0
    held, codes = np.unique(panel.orientations, return_inverse=True)
    codes = codes.reshape(panel.orientations.shape)
    dots = np.stack([panel.pattern(cell) for cell in held.tolist()]).astype(np.int64)
    across = dots[:, :, -1] @ dots[:, :, 0].T
    along = dots[:, -1, :] @ dots[:, 0, :].T
    return int(across[codes[:, :-1], codes[:, 1:]].sum() + along[codes[:-1], codes[1:]].sum())


def _drawn(figures: Figures) -> Iterator[Shapes]:
    for shapes in (*figures.cells.values(), *(mark.shapes for mark in figures.marks)):
        yield {layer: polygons for layer, polygons in shapes.items() if layer.written}


def fitted(plate: Plate, shop: Shop, tone: Tone = "clear") -> Plate:
    """The plate with nothing that is not written, and with the corner squares that the house asks for.

    Outlines, notes, emitters, wires and circuits are for people who look at the design; a house that converts every
    layer would expose them. Clear marks of dark data are holes themselves, so that none of theirs can have a layer of
    its own.
    """
    dies = tuple(replace(die, panel=replace(die.panel, emitters=None, tracks=(), circuits=())) for die in plate.dies)
    marks = tuple(mark for mark in plate.marks if mark.layer.written)
    bare = replace(plate, dies=dies, marks=(*marks, *_corner_squares(shop)), notes=())
    return suited(bare, shop, "bisect" if tone == "dark" else shop.polygons.holes)


def suited(plate: Plate, shop: Shop, holes: Holes) -> Plate:
    """The plate with marks of maskfab's own that the house can take; whoever wrote the job could not change them.

    Where no two figures may share a piece of edge, marks are stencils; where the house's grid is coarser than 1 nm and
    the dies lie on it, so do the marks.
    """
    marks = list(plate.marks)
    if shop.polygons.shared_boundaries is False:
        narrowest = round((shop.limits.min_space_um or shop.limits.min_feature_um or 0) * NM_PER_UM)
        marks = [stencilled(mark, holes, narrowest) if mark.layer.written else mark for mark in marks]
    grid, drawn = kept_grid_nm(plate, shop), replace(plate, marks=tuple(marks))
    return snapped(drawn, grid) if grid > 1 else drawn


def kept_grid_nm(plate: Plate, shop: Shop) -> int:
    """The coarsest of the house's grids on which every dot of every die lies; 1 nm where it asks for none.

    A job's own data grid comes first, and then 1 nm, where the house has them.
    """
    grids = [grid for grid in shop.limits.grid_nm or () if all(lies_on(die, grid) for die in plate.dies)]
    if plate.snapped is not None and plate.snapped.grid_nm in grids:
        return plate.snapped.grid_nm
    return 1 if 1 in grids else max(grids, default=1)


@dataclass(frozen=True)
class Blank:
    """The blank as stated in a job; thickness of chrome and of glass, None where unsaid or without a template."""

    chrome_nm: float | None
    glass_nm: int | None


def blank_of(spec: JobSpec) -> Blank:
    """The blank of a job: its chrome by [export], its glass by the template of its plate."""
    template = None if spec.plate is None or spec.plate.template is None else plate_template(spec.plate.template)
    chrome = (spec.export or ExportSection()).chrome
    return Blank(chrome * NM_PER_UM, None if template is None else to_nm(template.thickness))


def ordered_blank(spec: JobSpec) -> Blank:
    """The blank that an order asks for: as :func:`blank_of`, of the glass that [order] or [plate.glass] states."""
    plain, order = blank_of(spec), spec.order
    glass = None if spec.plate is None or spec.plate.glass is None else spec.plate.glass.thickness_um
    stated = glass if order is None or order.thickness is None else order.thickness
    return plain if stated is None else replace(plain, glass_nm=round(stated * NM_PER_UM))


def drawing_style(plate: Plate, shop: Shop | None) -> DrawingStyle:
    """A house's requirements for drawings beyond their polygons; the unit is text only in formats where it takes text.

    Text and the header's extents keep to what the house asks the drawing to span, or to what it can write if that is
    less than the blank. A drawing that must span an extent exactly has its unit as text only where the header has none.
    """
    if shop is None:
        return DrawingStyle()
    taken, extent, area = shop.text.allowed_in, extent_nm(shop), shop.plate.plot_area_mm
    frame: Box | None = None
    if extent is not None:
        frame = _centred(*extent)
    elif area is not None and min(area) * NM_PER_MM < plate.blank_nm:
        frame = _centred(*(min(round(side * NM_PER_MM), plate.blank_nm) for side in area))
    texted: list[Literal["R12", "R2010"]] = ["R12"] if taken is None or "dxf_r12" in taken else []
    if extent is None and (taken is None or "dxf_r2010" in taken):
        texted.append("R2010")
    names = shop.layer_names if shop.names.layers else None
    return DrawingStyle(names, shop.accepts.drawing_unit or "um", tuple(texted), frame)


def _centred(width: int, height: int) -> Box:
    return -width // 2, -height // 2, width - width // 2, height - height // 2


def extent_nm(shop: Shop) -> tuple[int, int] | None:
    """Width and height that a drawing for the house spans exactly, in nanometres; None if it may span what it likes."""
    asked = shop.plate.extent_mm
    return None if asked is None else (round(asked[0] * NM_PER_MM), round(asked[1] * NM_PER_MM))


def written_box(plate: Plate) -> Box:
    """Bounding box of everything written: marks and whole panels, in plate nanometres; all 0 for an empty plate."""
    boxes = [die.box_nm for die in plate.dies]
    for mark in plate.marks:
        if mark.layer.written:
            boxes += [bounding_box([polygon]) for polygon in mark.polygons]
    if not boxes:
        return 0, 0, 0, 0
    table = np.array(boxes, dtype=np.int64)
    (x0, y0), (x1, y1) = table[:, :2].min(axis=0).tolist(), table[:, 2:].max(axis=0).tolist()
    return x0, y0, x1, y1


def drawing_options(
    plate: Plate, shop: Shop, hierarchy: Hierarchy | None = None, tone: Tone = "clear"
) -> PolygonOptions:
    """Drawing options for a house: those of its profile, and otherwise as close to cells as possible.

    Two pixels go into a cell, or all references are resolved, only where the house allows no more references; openings
    are merged across cells only where it forbids figures that share a piece of edge and those of two cells do, as the
    chrome of dark data always does. A ``hierarchy`` that is given stays, whatever the house would need.
    """
    rules = shop.polygons
    touching = hierarchy is None and rules.shared_boundaries is False
    touching = touching and (tone == "dark" or any(facing_dots(die) for die in plate.dies))
    options = PolygonOptions(
        hierarchy=hierarchy or ("merged" if touching else rules.hierarchy),
        max_vertices=min(rules.max_vertices, shop.limits.max_vertices or MAX_VERTICES, MAX_VERTICES),
        holes=rules.holes,
        corners="joined" if rules.self_touching else "apart",
        notes="none",
        tone=tone,
    )
    most = shop.limits.max_references
    if most is None or options.hierarchy != "cells" or file_references(plate) <= most:
        return options
    if file_references(plate, paired=True) <= most:
        return replace(options, max_references=max(references_in(die, paired=True) for die in plate.dies))
    return options if hierarchy else replace(options, hierarchy="flat")


def as_ordered(options: PolygonOptions, spec: JobSpec) -> PolygonOptions:
    """Drawing options under a job's [order]: its tone, and data out of which it has the bias taken."""
    bias = spec.data_bias_nm
    if not bias:
        return replace(options, tone=spec.tone)
    return replace(options, tone=spec.tone, bias_nm=bias, hierarchy="merged", max_references=None)


def written_formats(section: ExportSection, shop: Shop | None) -> tuple[FileFormat, ...]:
    """The formats that a job writes: those it asks for, or else its house's first.

    The optics of a job are measured from a layout, so that one comes first even for a house that takes none.
    """
    if section.formats is not None:
        return section.formats
    if shop is None:
        return MASK_FORMATS
    layouts = [form for form in shop.formats if form in MEASURED_FORMATS]
    return (layouts[0],) if layouts else (MASK_FORMATS[0], shop.formats[0])


def written_options(plate: Plate, section: ExportSection, shop: Shop | None, tone: Tone = "clear") -> PolygonOptions:
    """Drawing options of a job: its own, with the house's preferences as defaults.

    Holes on a layer of their own are left to packages, for a job's optics are measured from one layer. Notes are text
    unless the house takes none in a format that is written.
    """
    stated = {key: value for key in DRAWING_KEYS if (value := getattr(section, key)) is not None}
    if shop is None:
        return PolygonOptions(**stated)
    house = drawing_options(plate, shop, section.hierarchy, tone)
    holes, taken = "bisect" if house.holes == "layer" else house.holes, shop.text.allowed_in
    noted = (form for form in written_formats(section, shop) if FORMATS[form].notes)
    lettered = taken is None or all(form in taken for form in noted)
    return replace(house, **{"holes": holes, "notes": "text" if lettered else "polygons", **stated})


def _corner_squares(shop: Shop) -> tuple[Mark, ...]:
    extent, side_um = extent_nm(shop), shop.plate.corner_square_um
    if extent is None or side_um is None:
        return ()
    side, (x, y) = round(side_um * NM_PER_UM), (extent[0] // 2, extent[1] // 2)
    corners = {"SW": (-x, -y), "SE": (x - side, -y), "NW": (-x, y - side), "NE": (x - side, y - side)}
    squares = {
        name: ((x0, y0), (x0, y0 + side), (x0 + side, y0 + side), (x0 + side, y0)) for name, (x0, y0) in corners.items()
    }
    return tuple(Mark(f"CORNER_{name}", "outline", CLEAR, (square,)) for name, square in squares.items())
