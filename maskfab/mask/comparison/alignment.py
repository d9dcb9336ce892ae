"""Alignment of a mask file with a design: mirrored, turned, shifted, in another unit or tone; and its layers.

A few windows of the design, the middle and a corner of every die and the marks, are held against the same places of
the file under every trial of the eight symmetries of the square, the units that programs mistake for each other, the
shifts that bring outlines onto each other, and both tones. The trial that differs least is what the file is.

What is drawn in inches and read in micrometres is rounded to a grid that is 25 400 times too coarse. So it does not do
to scale what was read: the file is read once more, in the unit that makes it as large as the design. Before all that
one layer of the file is taken for what is clear, and what its other layers hold is told.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path

from klayout import db

from maskfab.base.errors import SourceError
from maskfab.base.model import CLEAR, LAYERS, Layer, Plate, Quantity
from maskfab.base.units import NM_PER_UM, UM_PER_UNIT
from maskfab.mask.figures import CUT
from maskfab.mask.formats.content import find_cell, find_layer, layer_label, layer_names
from maskfab.mask.formats.drawing import drawn_unit_um
from maskfab.mask.layout import clear_box, count_texts, layer_info, left_out, note_left_out, region, weight

UNLIKE = 0.5
"""Share of the windows' clear area that differs, from which on a file is not the design in any position."""

_BETTER = 0.5
_MOST_WINDOWS = 24
_MOST_MARKS = 8
_FEW_SHAPES, _MORE, _MOST_HALVED = 100, 4, 2
_LARGEST_WEIGHT = 16
"""Of one shape: a file of the other tone may be one polygon with a hole for every dot."""
_LARGEST = 2**31 - 1
_CELLS = 3
_UNITS = {
    25.4: "drawn in millimetres, taken for inches",
    1 / 25.4: "drawn in inches, taken for millimetres",
    1000.0: "1000 times too large",
    1 / 1000.0: "1000 times too small",
    25400.0: "drawn in micrometres, taken for inches",
    1 / 25400.0: "drawn in inches, taken for micrometres",
    10.0: "10 times too large",
    0.1: "10 times too small",
}
_TURNS = {
    "r90": "turned by 90 degrees counter-clockwise",
    "r180": "turned by 180 degrees",
    "r270": "turned by 90 degrees clockwise",
    "m90": "mirrored left to right, as seen through the plate",
    "m0": "mirrored top to bottom",
    "m45": "mirrored at the rising diagonal, x and y exchanged",
    "m135": "mirrored at the falling diagonal",
}


@dataclass(frozen=True)
class Alignment:
    """Orientation, offset, scale and tone that align a file with the design.

    Attributes:
        turn: klayout's number of the symmetry that is applied to the file: quarter turns, plus 4 if mirrored at the
            x axis before.
        shift_nm: added afterwards.
        inverted: whether what the file draws is chrome; its tone is inverted within the file's own outline.
        differing: share of the clear area in the windows that then still differs.
        unit_scale: what the file's unit was multiplied by when it was read again in the one that it was drawn in.
    """

    turn: int
    scale: float
    shift_nm: tuple[int, int]
    inverted: bool
    differing: float
    unit_scale: float = 1.0
    unit: str = ""

    @property
    def trans(self) -> db.ICplxTrans:
        """From the file to the plate."""
        return _trans(self.turn, self.scale, self.shift_nm)

    @property
    def alike(self) -> bool:
        """Whether the file is the design at all."""
        return self.differing < UNLIKE

    def faults(self, *, positioned: bool = True, dark: bool = False) -> tuple[str, ...]:
        """Deviations of the file from the design's position, orientation, scale and tone; empty if there are none.

        Args:
            positioned: False for files that do not say where they lie, in which a shift is no fault.
            dark: whether the file is meant to draw what is opaque.
        """
        if not self.alike:
            return (f"unlike the design, {self.differing:.0%} of which differs in every position",)
        said: list[str] = []
        kind = str(db.Trans(self.turn % 4, self.turn >= 4, 0, 0).inverted()).split()[0]
        if kind in _TURNS:
            said.append(_TURNS[kind])
        if self.scale != 1 or self.unit_scale != 1:
            drawn = 1 / (self.scale * self.unit_scale)
            what = next((_UNITS[unit] for unit in _UNITS if abs(drawn / unit - 1) < 1e-9), f"scaled by {drawn:g}")
            said.append(f"{what} (state --unit {self.unit})" if self.unit else what)
        if self.inverted != dark:
            where = "opaque" if self.inverted else "clear"
            said.append(f"of the other tone, drawn where the design is {where}")
        if positioned and self.shift_nm != (0, 0):
            placed = self.trans.inverted().disp
            x, y = (round(value, 3) / NM_PER_UM for value in (placed.x, placed.y))
            said.append(f"shifted by ({x:g}, {y:g}) um" + (" after that" if said else ""))
        return tuple(said)


def align(plate: Plate, design: db.Layout, read: db.Layout) -> Alignment:
    """The simplest alignment, of those that differ least, of a file of one top cell; only CLEAR of both counts."""
    windows = [window for window in _windows(plate, design) if not window.clear.is_empty()]
    whole, file_box = (clear_box(layout) for layout in (design, read))
    if file_box.empty() or not windows:
        return Alignment(0, 1.0, (0, 0), False, 1.0)
    best = Alignment(0, 1.0, (0, 0), False, _differing(read, file_box, windows, _trans(0, 1.0, (0, 0)), False))
    if best.differing == 0:
        return best
    for turn in (0, 4, 1, 2, 3, 5, 6, 7):
        for scale in _scales(whole, file_box, turn):
            if not _within_reach(file_box, scale):
                continue
            turned = file_box.transformed(_trans(turn, scale, (0, 0)))
            for inverted in (False, True):
                for shift in _shifts(plate, whole, turned, inverted):
                    trial = _trans(turn, scale, shift)
                    differing = _differing(read, file_box, windows, trial, inverted, best.differing * _BETTER)
                    if differing < best.differing * _BETTER:
                        best = Alignment(turn, scale, shift, inverted, differing)
                        if differing == 0:
                            return best
    return best


def _within_reach(box: db.Box, scale: float) -> bool:
    """Whether a box far from the origin has coordinates once it is enlarged, with room for a shift."""
    farthest = max(abs(box.left), abs(box.bottom), abs(box.right), abs(box.top))
    return bool(farthest * scale < _LARGEST / 2)


@dataclass(frozen=True, eq=False)
class _Window:
    """A place of the design.

    Attributes:
        most: shapes of a file that are looked at there; of more, only the middle is: a wrong scale shows whole files.
    """

    box: db.Box
    clear: db.Region
    most: int


def _windows(plate: Plate, design: db.Layout) -> Iterator[_Window]:
    boxes: list[db.Box] = []
    for die in plate.dies:
        x0, y0, x1, y1 = die.box_nm
        reach = min(_CELLS * die.panel.pitch_nm, x1 - x0)
        x, y = (x0 + x1) // 2, (y0 + y1) // 2
        boxes.append(db.Box(x0 - reach // 2, y0 - reach // 2, x0 + reach // 2, y0 + reach // 2))
        boxes.append(db.Box(x - reach // 2, y - reach // 2, x + reach // 2, y + reach // 2))
    marks = [
        db.Polygon([db.Point(*point) for point in polygon]).bbox()
        for mark in plate.marks
        if mark.layer is CLEAR
        for polygon in mark.polygons
    ]
    step = max(1, len(marks) // _MOST_MARKS)
    boxes = [*boxes[: _MOST_WINDOWS - _MOST_MARKS], *(mark.enlarged(1000, 1000) for mark in marks[::step])]
    index = design.find_layer(layer_info(CLEAR))
    for box in boxes[:_MOST_WINDOWS]:
        shapes = db.Region(design.top_cell().begin_shapes_rec_overlapping(index, box))
        clear = (shapes & db.Region(box)).merged()
        yield _Window(box, clear, _FEW_SHAPES + _MORE * sum(-(-polygon.num_points() // 4) for polygon in clear.each()))


def _trans(turn: int, scale: float, shift: tuple[int, int]) -> db.ICplxTrans:
    return db.ICplxTrans(scale, 90.0 * (turn % 4), turn >= 4, *shift)


def _scales(whole: db.Box, file_box: db.Box, turn: int) -> list[float]:
    """The scales worth a try: none, and the one that makes both outlines equally large."""
    width, height = (file_box.height(), file_box.width()) if turn % 2 else (file_box.width(), file_box.height())
    if not width or not height:
        return [1.0]
    x, y = whole.width() / width, whole.height() / height
    if abs(x / y - 1) > 0.01 or abs(x - 1) < 1e-4:
        return [1.0]
    return [1.0, next((1 / unit for unit in _UNITS if abs(x * unit - 1) < 0.01), x)]


def likely_unit_scale(alignment: Alignment, design: db.Layout, read: db.Layout) -> float:
    """Scale by which a mistaken unit makes the coordinates too small; 1 if none was.

    What is rounded far too coarsely is unlike the design in every unit; then its outline tells.
    """
    if alignment.alike:
        scales = [alignment.scale]
    else:
        whole, file_box = (clear_box(layout) for layout in (design, read))
        scales = [] if file_box.empty() else [scale for turn in (0, 1) for scale in _scales(whole, file_box, turn)]
    return next((1 / unit for scale in scales for unit in _UNITS if abs(scale * unit - 1) < 1e-9), 1.0)


def _shifts(plate: Plate, whole: db.Box, turned: db.Box, inverted: bool) -> list[tuple[int, int]]:
    """The shifts worth a try: none, outline onto outline, and origins that single dies are drawn about."""
    shifts = [(0, 0)]
    targets = [whole] if not inverted else [whole, *(db.Box(*die.box_nm) for die in plate.dies)]
    for target in targets:
        shifts.append((target.left - turned.left, target.bottom - turned.bottom))
        # Twice the middle keeps half a nanometre whole.
        shifts.append(
            (
                (target.left + target.right - turned.left - turned.right) // 2,
                (target.bottom + target.top - turned.bottom - turned.top) // 2,
            )
        )
    if len(plate.dies) == 1:
        x0, y0, x1, y1 = plate.dies[0].box_nm
        shifts += [(x0, y0), ((x0 + x1) // 2, (y0 + y1) // 2)]
    return list(dict.fromkeys(shifts))


def _differing(
    read: db.Layout, file_box: db.Box, windows: list[_Window], trans: db.ICplxTrans, inverted: bool, enough: float = 2.0
) -> float:
    """Share of the clear area in all windows that differs; given up as soon as it is more than ``enough``."""
    index = read.find_layer(layer_info(CLEAR))
    back = trans.inverted()
    frame = db.Region(file_box.transformed(trans))
    clear = sum(window.clear.area() for window in windows)
    differing = 0.0
    for window in windows:
        box, place = _part_of_few(window, read, index, back)
        if box.empty():
            return max(enough, 1.0)
        shapes = db.Region(read.top_cell().begin_shapes_rec_overlapping(index, place)) & db.Region(place)
        here = db.Region(box)
        drawn = shapes.merged().transformed(trans) & here
        if inverted:
            drawn = (here & frame) - drawn
        differing += (drawn ^ (window.clear & here)).area() * window.box.area() / box.area()
        if differing > enough * clear:
            break
    return float(differing / clear)


def _part_of_few(window: _Window, read: db.Layout, index: int, back: db.ICplxTrans) -> tuple[db.Box, db.Box]:
    """The middle of a window with few enough shapes, and where it lies in the file; empty where there are far more."""
    box = window.box
    for _ in range(_MOST_HALVED + 1):
        place = box.transformed(back).enlarged(1, 1)
        shapes = read.top_cell().begin_shapes_rec_overlapping(index, place)
        if weight(shapes, window.most, _LARGEST_WEIGHT) <= window.most:
            return box, place
        box = box.enlarged(-(box.width() // 4), -(box.height() // 4))
    return db.Box(), db.Box()


_NAMES = {um: unit for unit, um in UM_PER_UNIT.items() if unit.isascii()}


def in_drawn_unit(
    plate: Plate, design: db.Layout, read: db.Layout, alignment: Alignment, again: Callable[[float], db.Layout]
) -> tuple[db.Layout, Alignment]:
    """The file in the unit that it was drawn in, ``again`` (of a unit in um) if need be, and how it then lies."""
    unit_um = drawn_unit_um(read)
    if unit_um is None:
        return read, alignment
    scale = likely_unit_scale(alignment, design, read)
    meant = next((name for length, name in _NAMES.items() if abs(unit_um * scale / length - 1) < 1e-9), None)
    if scale == 1 or meant is None:
        return read, alignment
    reread = again(unit_um * scale)
    realigned = align(plate, design, reread)
    if not realigned.alike or realigned.scale != 1:
        return read, alignment
    return reread, replace(realigned, unit_scale=scale, unit=meant)


_TOLD = 8
_UNTOLD = (
    "mask houses do not unless they are told so: name one in [export] shop that takes holes on a layer of their own, "
    "or say --layer"
)


@dataclass(frozen=True)
class StatedLayers:
    """Layers as the job states them: their names at the house, and whether it takes holes as :data:`CUT`."""

    names: Mapping[str, str] = field(default_factory=dict)
    cut: bool = False

    def info(self, layer: Layer) -> db.LayerInfo:
        """The layer as a file may call it."""
        return db.LayerInfo(layer.number, layer.datatype, self.names.get(layer.name, layer.name))


@dataclass(frozen=True)
class LayersRead:
    """Layers that were read as clear.

    Attributes:
        clear: the layer, as it is called in the file; empty for files that have no layers.
        wanted: the one that the job orders.
        meant: whether it is that one, or was stated.
        taken_out: whether what :data:`CUT` holds was taken out of it.
        others: further layers with shapes that neither the job has for people nor the user passes over.
        passed_over: further layers with shapes of which nothing is looked at, and need not be.
    """

    clear: str = ""
    wanted: str = ""
    meant: bool = True
    taken_out: bool = False
    others: tuple[str, ...] = ()
    passed_over: tuple[str, ...] = ()

    def quantities(self, name: str, ordered: StatedLayers) -> Iterator[Quantity]:
        """Rows of a verdict on the file of that name."""
        if self.clear:
            method = f"what is clear is read from layer {self.clear} of {name}; the job orders {self.wanted}"
            cure = "; say --layer if the house is told so"
            said = method + ("" if self.meant else cure)
            yield Quantity("layer", self.clear, said, limit=self.wanted, passed=self.meant)
        if self.taken_out:
            cut = f"{CUT.number}/{CUT.datatype}"
            method = f"{name} has shapes on {cut}, which are taken out of what is clear for all that follows, as "
            method += "the job's mask house does" if ordered.cut else _UNTOLD
            limit = cut if ordered.cut else "none"
            yield Quantity("layer_taken_out", cut, method, limit=limit, passed=ordered.cut)
        if self.others:
            method = f"layers of {name} with shapes that the job has not: {_listed(self.others)}; the house may write "
            method += "them: take them out, or say --ignore if it is told not to"
            yield Quantity("other_layers", len(self.others), method, limit=0, passed=False)
        if self.passed_over:
            method = f"layers of {name} with shapes of which nothing is looked at, for they are not written: "
            yield Quantity("passed_over", len(self.passed_over), method + _listed(self.passed_over))


def clear_only(
    layout: db.Layout,
    path: Path,
    layer: str | None = None,
    cell: str | None = None,
    ignored: tuple[str, ...] = (),
    ordered: StatedLayers | None = None,
) -> LayersRead:
    """Leave one top cell with what is clear, on the layer CLEAR, and nothing else; notes about the file stay.

    Without a stated layer, what lies on the layer CUT is taken out of it, as a house does that is told to.

    Args:
        layout: what was read; it is changed.
        ignored: layers that are not written, by number or name.

    Raises:
        SourceError: MF305 to MF309 if cell or layer are not there, or could be several.
    """
    ordered = ordered or StatedLayers()
    try:
        root, info = find_cell(layout, cell), find_layer(layout, layer or _called(layout, ordered.info(CLEAR)))
    except SourceError as error:
        raise SourceError(error.code, error.what, where=str(path), cure=error.cure) from None
    for index in [item.cell_index() for item in layout.top_cells() if item.cell_index() != root.cell_index()]:
        _drop_above(layout, index, root.cell_index())
    cut = layout.find_layer(layer_info(CUT))
    taken_out = layer is None and cut is not None and not root.bbox(cut).empty()
    if taken_out:
        exposed = (region(layout, info) - region(layout, CUT)).merged(True, 1)
        layout.flatten(root.cell_index(), -1, True)
        root.shapes(layout.find_layer(info)).clear()
        root.shapes(layout.find_layer(info)).insert(exposed)
    clear = layout.find_layer(info)
    for_people = [ordered.info(item) for item in LAYERS if not item.written]
    others: list[str] = []
    passed_over: list[str] = []
    for item in layout.layer_infos():
        if item.is_equivalent(info) or (taken_out and item.is_equivalent(layer_info(CUT))):
            continue
        if draws(layout, layout.find_layer(item)):
            fine = any(item.is_equivalent(one) for one in for_people) or bool(layer_names(item) & {*ignored})
            (passed_over if fine else others).append(layer_label(item))
    note_left_out(layout, replace(left_out(layout), texts=count_texts(layout, clear)))
    for index in layout.layer_indexes():
        if index != clear:
            layout.delete_layer(index)
    wanted = ordered.info(CLEAR)
    meant = layer is not None or info.is_equivalent(wanted)
    layout.set_info(clear, layer_info(CLEAR))
    return LayersRead(
        layer_label(info), layer_label(wanted), meant, taken_out, tuple(sorted(others)), tuple(sorted(passed_over))
    )


def draws(layout: db.Layout, index: int) -> bool:
    """Whether anything but texts lies on a layer below the top cell."""
    polygons = layout.top_cell().begin_shapes_rec(index)
    polygons.shape_flags = db.Shapes.SRegions
    polygons.reset()
    return not polygons.at_end()


def _called(layout: db.Layout, info: db.LayerInfo) -> str | None:
    named = any(item.layer < 0 and item.name == info.name for item in layout.layer_infos())
    return str(info.name) if named else None


def _drop_above(layout: db.Layout, index: int, root: int) -> None:
    """Delete a top cell and everything below it that is neither a cell nor part of it."""
    if root not in layout.cell(index).called_cells():
        layout.prune_cell(index, -1)
        return
    below = list(layout.cell(index).each_child_cell())
    layout.delete_cell(index)
    for child in below:
        if child != root and layout.is_valid_cell_index(child) and layout.cell(child).is_top():
            _drop_above(layout, child, root)


def _listed(names: tuple[str, ...]) -> str:
    return ", ".join(names[:_TOLD]) + (", ..." if len(names) > _TOLD else "")
