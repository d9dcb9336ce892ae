"""A written mask file against the plate that it was written from.

The file is read by a library that did not write it, and compared twice: with the layout, polygon by polygon, and with
the openings and orientations themselves, dot by dot, without the layout.

Differences too narrow to matter are told from faults by their width. A fracture into trapezoids rounds every corner
that it makes on a slanted edge to the grid, so that slivers narrower than a grid step are left out or drawn twice all
along it. A difference is a sliver if nothing is left of it once its outline is moved inwards by half the tolerance.

Dark data are compared as clear ones: what a plate's writable area has besides the chrome that a file draws. Biased data
are compared as they are, with the sized design and on lines half the bias beside those of the dots; then they are sized
back and compared as any file is: a bias taken off twice, or not at all, fails there, whatever sizes the design.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from klayout import db

from maskfab.base.arrays import Floats, Mask
from maskfab.base.model import CHROME, CLEAR, LAYERS, NOTE, Box, Die, Gauge, Layer, Plate, Point, Quantity
from maskfab.base.units import NM_PER_UM
from maskfab.mask.dots import corner_touches, die_edges_nm, die_raster
from maskfab.mask.figures import CUT, DRAWN_LAYERS
from maskfab.mask.formats.content import rounding_nm
from maskfab.mask.layout import layer_info, region
from maskfab.mask.marks import bounding_box
from maskfab.mask.raster import coverage, placed_boxes
from maskfab.mask.writer import biased_data, written_of

MOST_SIFTED = 100_000
"""Differing polygons above which none is looked at: such a file has faults."""

_FINEST = 1000
_LARGEST = 2**30
_SLACK = 2
"""Units of the refined grid by which moved outlines may be off."""

_STEPS = 8


@dataclass(frozen=True, eq=False)
class Sifted:
    """Differing area by its width.

    Attributes:
        widest_nm: no sliver is wider; 0 if there is none. Of polygons of up to a millimetre this and the tolerance are
            kept to 4 pm, of larger ones to the same share of their size.
    """

    faults: db.Region
    slivers: db.Region
    widest_nm: float = 0.0


def sift(differing: db.Region, tolerance_nm: float) -> Sifted:
    """Tell slivers from faults, polygon by polygon."""
    if tolerance_nm <= 0 or differing.count() > MOST_SIFTED:
        return Sifted(differing, db.Region())
    faults, slivers = db.Region(), db.Region()
    widest = 0.0
    for polygon in differing.each():
        if not _vanishes(polygon, tolerance_nm):
            faults.insert(polygon)
            continue
        slivers.insert(polygon)
        if not _vanishes(polygon, widest):
            widest = _width(polygon, widest, tolerance_nm)
    return Sifted(faults, slivers, widest)


def _vanishes(polygon: db.Polygon, width_nm: float) -> bool:
    finer, box = _finer(polygon), polygon.bbox()
    grown = polygon.moved(-box.left, -box.bottom).transformed(db.ICplxTrans(float(finer)))
    return bool(db.Region(grown).sized(-math.ceil(width_nm * finer / 2) - _SLACK).is_empty())


def _finer(polygon: db.Polygon) -> int:
    box = polygon.bbox()
    return max(1, min(_FINEST, _LARGEST // max(1, int(box.width()), int(box.height()))))


def _width(polygon: db.Polygon, low: float, high: float) -> float:
    """Upper bound of a polygon's width, by bisection between two widths, at one of which it vanishes."""
    for _ in range(_STEPS):
        middle = (low + high) / 2
        low, high = (low, middle) if _vanishes(polygon, middle) else (middle, high)
    # It vanishes by whole steps, of which the last may reach beyond.
    finer = _finer(polygon)
    return 2 * (math.ceil(high * finer / 2) + _SLACK) / finer


def cleared(read: db.Layout, plate: Plate) -> db.Layout:
    """A layout whose layer CLEAR is what the chrome of another leaves of the writable area; other layers are as there.

    Nothing is left in hierarchy on that layer, for a file from elsewhere may draw chrome in any cell.
    """
    half = plate.writable_nm // 2
    clear = db.Region(db.Box(-half, -half, half, half)) - _drawn(read, CHROME) + _drawn(read, CUT)
    return _with_clear(read, clear.merged(True, 1))


def named_chrome(read: db.Layout) -> None:
    """Call what a file without layers draws chrome: its reader takes it for what is clear."""
    index = read.find_layer(layer_info(CLEAR))
    if index is not None:
        read.set_info(index, layer_info(CHROME))


def _drawn(layout: db.Layout, layer: Layer, *store: db.DeepShapeStore) -> db.Region:
    index = layout.find_layer(layer_info(layer))
    return db.Region() if index is None else db.Region(layout.top_cell().begin_shapes_rec(index), *store)


_NM2_PER_UM2 = NM_PER_UM**2
_FEW_POLYGONS = 30_000
"""Told one by one in a tenth of a second."""


@dataclass(frozen=True)
class Difference:
    """Where a file departs from the plate: nearest die or mark, and lower left corner of the first such polygon."""

    owner: str
    layer: Layer
    area_um2: float
    first_nm: Point

    def __str__(self) -> str:
        x, y = (value / NM_PER_UM for value in self.first_nm)
        return f"{self.owner}: {self.area_um2:g} um^2 differ on {self.layer.name}, first at ({x:.3f}, {y:.3f}) um"


@dataclass(frozen=True)
class DieCheck:
    """One die of the file.

    Attributes:
        xor_area_um2: area on written layers that only one of file and design covers.
        wrong_dots: grid cells whose share of clear differs from what opening and orientations say; None if not asked.
        corner_touches: vertices at which two clear dots meet by a corner only; None if not asked.
    """

    name: str
    xor_area_um2: float
    wrong_dots: int | None
    corner_touches: int | None


@dataclass(frozen=True)
class CdCheck:
    """One gauge: its target, the clear length along it in the design, and that in the file."""

    gauge: Gauge
    drawn_nm: int
    read_nm: int

    @property
    def delta_nm(self) -> int:
        """File minus design."""
        return self.read_nm - self.drawn_nm


@dataclass(frozen=True, eq=False)
class RoundTrip:
    """Result of reading a file back.

    Attributes:
        layout: its content; the file's only top cell is the plate.
        polygons: polygons on written layers, all references counted.
        rounding_nm: largest distance by which a coordinate of the file was off the nanometre grid.
        differences: one for each die or mark and layer that differs; empty if all is well.
        differing: all that only one of file and plate makes clear, merged.
        slivers: of that, what is no wider than the tolerance and so no difference.
        data: rows of biased data before they are sized back; all else is of them sized back.
        judged: rows of the second derivation, of :mod:`maskfab.mask.judge`.
        alike: whether every layer has the design's polygons in the design's cells: two such files draw the same.
    """

    path: Path
    layout: db.Layout
    polygons: int
    drawn_polygons: int
    rounding_nm: float
    differences: tuple[Difference, ...]
    dies: tuple[DieCheck, ...]
    cds: tuple[CdCheck, ...]
    differing: db.Region
    slivers: Sifted
    data: tuple[Quantity, ...] = ()
    judged: tuple[Quantity, ...] = ()
    alike: bool = False

    @property
    def xor_area_um2(self) -> float:
        """Area of the plate that only one of file and design covers."""
        return sum(difference.area_um2 for difference in self.differences)

    def quantities(self) -> tuple[Quantity, ...]:
        """Rows of report.json: of the plate first, then of the dies, then of either by the second derivation."""
        return (*self._of_plate(), *self._of_dies(), *self.judged)

    def _of_plate(self) -> Iterator[Quantity]:
        name = self.path.name
        yield from (row for row in self.data if row.die is None)
        where = "; ".join(map(str, self.differences))
        against = f"{name}, read independently, XOR with the design" + (f": {where}" if where else "")
        yield _asked("readback_xor_area", self.xor_area_um2, 0.0, against)
        yield _asked("polygons", self.polygons, self.drawn_polygons, f"counted in {name}, every reference followed")
        for cd in self.cds:
            method = f"clear length along the {cd.gauge.axis} gauge in {name}; drawn {cd.drawn_nm} nm, "
            method += f"difference {cd.delta_nm:+d} nm"
            yield _asked(f"cd_{cd.gauge.name.removeprefix('cd_')}", cd.read_nm, cd.gauge.target_nm, method)

    def _of_dies(self) -> Iterator[Quantity]:
        yield from (row for row in self.data if row.die is not None)
        name = self.path.name
        for die in self.dies:
            method = f"{name}, read independently, XOR with the design within the die"
            yield _asked("readback_xor_area", die.xor_area_um2, 0.0, method, die.name)
            if die.wrong_dots is not None:
                method = f"clear share of every dot in {name} against the opening and its orientations"
                yield _asked("readback_wrong_dots", die.wrong_dots, 0, method, die.name)
            if die.corner_touches is not None:
                method = f"vertices of {name} at which two clear dots meet by a corner only"
                yield Quantity("corner_touches", die.corner_touches, method, die=die.name)


def _asked(name: str, value: float, asked: float, method: str, die: str | None = None) -> Quantity:
    """A row that passes with exactly what was asked for."""
    return Quantity(name, value, method, limit=asked, passed=value == asked, die=die)


def compare_layout(
    plate: Plate,
    design: db.Layout,
    read: db.Layout,
    path: Path,
    *,
    dots: bool = True,
    drawn_polygons: int | None = None,
    layer_names: Mapping[str, str] | None = None,
    tolerance_nm: float = 0.0,
    dots_prove: bool = False,
) -> RoundTrip:
    """Comparison of a layout that was read already, which has one top cell.

    What a layer CUT holds is taken from CLEAR before anything is compared, and chrome from the writable area. What
    differs on the layer CLEAR and is no wider than ``tolerance_nm`` is told apart, and no difference.

    Args:
        design: its :func:`maskfab.mask.layout.plate_layout`.
        read: the file's content; it is changed.
        dots: also compare every dot of every die, about a second for 10 000 cells.
        drawn_polygons: how many polygons were written, as an account of figures says; those of the design by default.
        layer_names: names in a DXF by names of the model; layers that it left out are not compared.
        dots_prove: whether no polygons are compared within a die whose every dot is clear or dark throughout as its
            opening says, for which one that differs by a square nanometre is not: a file without cells has millions of
            edges there.
    """
    _settle(read, layer_names)
    polygons = _written(read, _counts(read))
    chrome = read.find_layer(layer_info(CHROME)) is not None
    if chrome:
        read = cleared(read, plate)
    compared = [layer for layer in LAYERS if layer is not NOTE and (layer_names is None or layer.name in layer_names)]
    by_dots = [_compare_dots(die, read, tolerance_nm) if dots else None for die in plate.dies]
    alike = [die for die, check in zip(plate.dies, by_dots, strict=True) if check and check[0] and dots_prove]
    further = tuple(_further_layers(read))
    differing: dict[Layer, db.Region] = {}
    same = not further and _alike(design, read, compared)
    if not same:
        in_design, in_read = _counts(design), _counts(read)
        differing = {
            layer: db.Region()
            if layer is not CLEAR and _same_polygons((design, in_design), (read, in_read), layer)
            else _xor(design, read, layer, alike if layer is CLEAR else ())
            for layer in (*compared, *further)
        }
    clear = differing.get(CLEAR, db.Region())
    sifted = sift(clear, tolerance_nm)
    differing[CLEAR] = sifted.faults
    differences = tuple(
        difference for layer, shapes in differing.items() for difference in _named(plate, layer, shapes)
    )
    return RoundTrip(
        path=path,
        layout=read,
        polygons=polygons,
        drawn_polygons=_written(design, _counts(design)) if drawn_polygons is None else drawn_polygons,
        rounding_nm=rounding_nm(read),
        differences=differences,
        dies=tuple(_check_die(die, check, differing) for die, check in zip(plate.dies, by_dots, strict=True)),
        cds=tuple(
            CdCheck(gauge, clear_length_nm(design, gauge), clear_length_nm(read, gauge)) for gauge in plate.gauges
        ),
        differing=clear,
        slivers=sifted,
        alike=same and not chrome and len(compared) == len(LAYERS) - 1,
    )


def clear_length_nm(layout: db.Layout, gauge: Gauge) -> int:
    """Clear length along a gauge, measured on the merged region of the layer CLEAR."""
    (x, y), reach = gauge.centre_nm, gauge.reach_nm
    dx, dy = (reach, 0) if gauge.axis == "x" else (0, reach)
    probe = db.Edge(x - dx, y - dy, x + dx, y + dy)
    around = _exposed(layout, (x - dx - 1, y - dy - 1, x + dx + 1, y + dy + 1))
    return int(db.Edges(probe).inside_part(around).length())


def _xor(design: db.Layout, read: db.Layout, layer: Layer, alike: Sequence[Die] = ()) -> db.Region:
    """Symmetric difference of two layouts, merged; compared in hierarchy, for most cells are alike.

    Where dies are known to be alike, only what lies between them is compared. A file without references is compared as
    it is drawn: the search for cells in it would take longer than they save.
    """
    if alike:
        around = db.Region(
            [(layout.top_cell().bbox() + db.Box(*alike[0].box_nm)) for layout in (design, read)]
        ).merged()
        places = around - db.Region([db.Box(*die.box_nm) for die in alike])
        return (_within(design, layer, places) ^ _within(read, layer, places)).merged(True, 1)
    store = db.DeepShapeStore() if read.top_cell().child_instances() else None
    one, other = (_drawn_regions(layout, layer, store) for layout in (design, read))
    # A region in hierarchy dies with its store, so what differs is copied out of it.
    return db.Region(list((one ^ other).each())).merged(True, 1)


def _alike(design: db.Layout, read: db.Layout, layers: Sequence[Layer]) -> bool:
    """Whether two layouts draw some layers with the same polygons in the same cells, which is soon told.

    Dies and marks may have cells of their own or stand in the top cell, whose name does not count. A file that places
    more there than the design may take long to spread out.
    """
    planned, placed = (sum(place.size() for place in layout.top_cell().each_inst()) for layout in (design, read))
    if not 0 < placed <= planned:
        return False
    copies = []
    for copy in (design.dup(), read.dup()):
        ignored = {copy.find_layer(layer_info(layer)) for layer in set(LAYERS).difference(layers)}
        for index in copy.layer_indexes():
            if index in ignored or copy.top_cell().bbox(index).empty():
                copy.delete_layer(index)
        copy.top_cell().flatten(1, True)
        copy.rename_cell(copy.top_cell().cell_index(), "TOP")
        copies.append(copy)
    diff = db.LayoutDiff
    return bool(diff().compare(*copies, diff.Silent | diff.BoxesAsPolygons | diff.NoProperties | diff.NoLayerNames, 0))


def _same_polygons(
    design: tuple[db.Layout, Mapping[int, int]], read: tuple[db.Layout, Mapping[int, int]], layer: Layer
) -> bool:
    """Whether two layouts draw a layer with the same polygons, which are few enough to be told one by one.

    Those of wires reach across a die, and take long to be laid over each other. Layouts come with their counts.
    """
    drawn: list[list[db.Polygon]] = []
    for layout, counts in (design, read):
        index = layout.find_layer(layer_info(layer))
        if index is None or counts[index] > _FEW_POLYGONS:
            return False
        whole = db.Region(layout.top_cell().begin_shapes_rec(index))
        whole.merged_semantics = False
        drawn.append(sorted(whole.each()))
    return drawn[0] == drawn[1]


def _settle(read: db.Layout, names: Mapping[str, str] | None) -> None:
    """Give layers that a DXF only names the numbers of the model."""
    for layer in DRAWN_LAYERS:
        index = read.find_layer(db.LayerInfo((names or {}).get(layer.name, layer.name)))
        if index is not None:
            read.set_info(index, layer_info(layer))


def _further_layers(read: db.Layout) -> Iterator[Layer]:
    planned = [layer_info(layer) for layer in DRAWN_LAYERS]
    for info in read.layer_infos():
        index = read.find_layer(info)
        drawn = index is not None and not read.top_cell().bbox(index).empty()
        if drawn and not any(info.is_equivalent(own) for own in planned):
            name = info.name or f"{info.layer}/{info.datatype}"
            yield Layer(name, info.layer, info.datatype, True, "found in the file; the plate has no such layer")


def _exposed(layout: db.Layout, box_nm: Box) -> db.Region:
    clear = region(layout, CLEAR, box_nm)
    return clear if layout.find_layer(layer_info(CUT)) is None else clear - region(layout, CUT, box_nm)


def _drawn_regions(layout: db.Layout, layer: Layer, store: db.DeepShapeStore | None) -> db.Region:
    """Exposed shapes of a layout, in hierarchy if there is a store to hold it."""
    deep = () if store is None else (store,)
    drawn, cut = _drawn(layout, layer, *deep), layer is CLEAR and layout.find_layer(layer_info(CUT)) is not None
    return drawn - _drawn(layout, CUT, *deep) if cut else drawn


def _within(layout: db.Layout, layer: Layer, places: db.Region) -> db.Region:
    drawn = []
    for part in (layer, CUT) if layer is CLEAR else (layer,):
        index = layout.find_layer(layer_info(part))
        if index is None:
            drawn.append(db.Region())
        else:
            drawn.append(db.Region(db.RecursiveShapeIterator(layout, layout.top_cell(), index, places, True)))
    return (drawn[0] - drawn[1] if len(drawn) > 1 and not drawn[1].is_empty() else drawn[0]) & places


def _named(plate: Plate, layer: Layer, differing: db.Region) -> Iterator[Difference]:
    """The differing polygons by the die or mark that each lies in or nearest to."""
    if differing.is_empty():
        return
    boxes: dict[str, list[Box]] = {die.name: [die.box_nm] for die in plate.dies}
    for mark in plate.marks:
        if mark.layer == layer and mark.polygons:
            boxes[mark.name] = [bounding_box([polygon]) for polygon in mark.polygons]
    owners = [name for name, parts in boxes.items() for _ in parts]
    table = np.array([box for parts in boxes.values() for box in parts], dtype=np.int64).reshape(-1, 4)
    areas: dict[str, int] = {}
    firsts: dict[str, Point] = {}
    for polygon in differing.each():
        box = polygon.bbox()
        gap_x = np.maximum(0, np.maximum(table[:, 0] - box.right, box.left - table[:, 2]))
        gap_y = np.maximum(0, np.maximum(table[:, 1] - box.top, box.bottom - table[:, 3]))
        owner = owners[int(np.argmin(np.hypot(gap_x, gap_y)))] if owners else plate.name
        areas[owner] = areas.get(owner, 0) + polygon.area()
        corner = box.left, box.bottom
        firsts[owner] = min(firsts.get(owner, corner), corner, key=lambda point: (point[1], point[0]))
    for owner, area in areas.items():
        yield Difference(owner, layer, area / _NM2_PER_UM2, firsts[owner])


def _compare_dots(die: Die, read: db.Layout, tolerance_nm: float) -> tuple[bool, int, int]:
    """One die dot by dot: whether it is the design's, how many dots are wrong, and where corners only touch."""
    clear, designed = _read_raster(die, read), die_raster(die)
    alike = np.array_equal(clear, designed)
    # As much as slivers along all four sides of a dot make of it.
    slack = 4 * tolerance_nm / die.panel.dot_nm
    wrong = 0 if alike else np.count_nonzero(abs(clear - designed) > slack)
    return alike, int(wrong), corner_touches(clear > 0.5)


def _check_die(die: Die, dots: tuple[bool, int, int] | None, differing: dict[Layer, db.Region]) -> DieCheck:
    box = db.Region(db.Box(*die.box_nm))
    xor_area = sum((shapes & box).area() for shapes in differing.values() if not shapes.is_empty()) / _NM2_PER_UM2
    wrong, touches = dots[1:] if dots else (None, None)
    return DieCheck(die.name, xor_area, wrong, touches)


def _read_raster(die: Die, read: db.Layout) -> Floats:
    index = None if read.find_layer(layer_info(CUT)) is not None else read.find_layer(layer_info(CLEAR))
    boxes = None if index is None else placed_boxes(read.top_cell(), index, db.Box(*die.box_nm))
    return coverage(_exposed(read, die.box_nm) if boxes is None else boxes, *die_edges_nm(die))


def _written(layout: db.Layout, counts: Mapping[int, int]) -> int:
    wanted = [layout.find_layer(layer_info(layer)) for layer in DRAWN_LAYERS if layer.written]
    return sum(counts[index] for index in wanted if index is not None)


def _counts(layout: db.Layout) -> dict[int, int]:
    times = dict.fromkeys(layout.each_cell_top_down(), 0)
    times[layout.top_cell().cell_index()] = 1
    for index, placed in times.items():
        for instance in layout.cell(index).each_inst():
            times[instance.cell_index] += placed * instance.size()
    layers = layout.layer_indexes()
    totals = dict.fromkeys(layers, 0)
    for index, placed in times.items():
        shapes = layout.cell(index)
        for layer in layers:
            totals[layer] += placed * shapes.shapes(layer).size()
    return totals


def compare_biased(
    plate: Plate,
    design: db.Layout,
    read: db.Layout,
    path: Path,
    bias_nm: int,
    *,
    dots: bool = True,
    drawn_polygons: int | None = None,
    layer_names: Mapping[str, str] | None = None,
) -> RoundTrip:
    """Comparison of a layout of biased data; arguments as of :func:`maskfab.mask.comparison.roundtrip.compare_layout`.

    Returns:
        The comparison of the layout sized back, which is its ``layout``; polygons are counted in the data.
    """
    sized = biased_data(region(design, CLEAR), plate, bias_nm)
    raw = compare_layout(
        plate,
        _with_clear(design, sized),
        read,
        path,
        dots=False,
        drawn_polygons=drawn_polygons,
        layer_names=layer_names,
    )
    data = region(raw.layout, CLEAR) - region(raw.layout, CUT)
    back = compare_layout(
        plate,
        design,
        _with_clear(raw.layout, written_of(data, plate, bias_nm)),
        path,
        dots=dots,
        layer_names=layer_names,
    )
    return replace(
        back,
        polygons=raw.polygons,
        drawn_polygons=raw.drawn_polygons,
        rounding_nm=raw.rounding_nm,
        differences=back.differences or raw.differences,
        data=tuple(_rows(plate, raw, data, bias_nm, dots=dots)),
        alike=False,
    )


def biased_raster(die: Die, bias_nm: int) -> tuple[Floats, Floats, Mask]:
    """A die in biased data, without polygons: lines along x and y, and which parts between them are clear.

    A line between two dots becomes two, half the bias to either side of it; what lies between them is clear if both
    dots are (positive bias: shapes shrink), or if one is (negative: they grow), and so along x and then along y.

    Returns:
        float64 [nx + 1] and [ny + 1] lines in plate nanometres, bool [ny, nx].
    """
    clear = np.pad(die_raster(die), 1)
    x, y = die_edges_nm(die)
    clear, x = _between(clear, x, bias_nm)
    turned, y = _between(clear.T, y, bias_nm)
    return x, y, turned.T


def _with_clear(layout: db.Layout, clear: db.Region) -> db.Layout:
    """A layout whose layer CLEAR holds these shapes instead of all that is clear, in its top cell."""
    changed = layout.dup()
    for layer in (CLEAR, CHROME, CUT):
        index = changed.find_layer(layer_info(layer))
        if index is not None:
            changed.delete_layer(index)
    changed.top_cell().shapes(changed.layer(layer_info(CLEAR))).insert(clear)
    return changed


def _rows(plate: Plate, raw: RoundTrip, data: db.Region, bias_nm: int, *, dots: bool) -> Iterator[Quantity]:
    name, bias = raw.path.name, bias_nm / NM_PER_UM
    yield Quantity(
        "data_bias",
        -bias,
        f"of clear widths in the data of {name}, whose writer changes them by {bias:+g} um. What was read is sized "
        "back: all other numbers are of the plate as it comes out",
    )
    method = f"{name}, read independently, XOR with the design sized by {-bias:+g} um per width"
    yield _asked("data_xor_area", raw.xor_area_um2, 0.0, method)
    widths = [cd.read_nm - (cd.gauge.target_nm - bias_nm) for cd in raw.cds]
    if widths:
        worst = max(widths, key=abs)
        words = f"largest of all CD structures in {name}, against their targets less the bias"
        yield _asked("data_width_error", worst, 0, words)
    for die in plate.dies if dots else ():
        wrong = _wrong_parts(die, data, bias_nm)
        words = f"parts between the biased lines of the dots in {name}, clear otherwise than the opening says"
        yield _asked("data_wrong_parts", wrong, 0, words, die.name)


def _wrong_parts(die: Die, data: db.Region, bias_nm: int) -> int:
    x, y, clear = biased_raster(die, bias_nm)
    reach = abs(bias_nm)
    inside = data & db.Region(db.Box(*die.box_nm).enlarged(reach, reach))
    if min(x.size, y.size) < 2:
        return 0 if inside.is_empty() else 1
    return int(np.count_nonzero(coverage(inside, x, y) != clear))


def _between(clear: Mask, lines_nm: Floats, bias_nm: int) -> tuple[Mask, Floats]:
    """Columns with those between them; ``clear`` has one more on either side than the lines bound."""
    # A line along which nothing changes, such as between two halves of a gutter, would be crossed by its neighbours.
    edges = (clear[:, 1:] != clear[:, :-1]).any(axis=0)
    columns = clear[:, np.concatenate([[True], edges])]
    lines, half = lines_nm[edges], abs(bias_nm) / 2
    joined = np.logical_and if bias_nm > 0 else np.logical_or
    parts = np.empty((clear.shape[0], 2 * columns.shape[1] - 1), dtype=bool)
    parts[:, ::2] = columns
    parts[:, 1::2] = joined(columns[:, :-1], columns[:, 1:])
    return parts[:, 1:-1], np.stack([lines - half, lines + half], axis=1).ravel()
