"""Two readings of one layout held against each other: what two libraries draw otherwise is refused, with the place.

Nothing is merged where both have the same elements in the same cells, which is soon told from both as streams of
GDSII. Otherwise the shapes of each cell and layer are laid over each other, and whole top cells only where something is
placed otherwise.

Readers may rightly differ by what they round. Corners of polygons are whole numbers in a file, and must agree to the
last of them. The sides of a path are half a width away from its points: each reader puts their corners on its grid, no
farther than 0.71 nm, so that slivers of up to two units are left out. Round ends are polygons of 32 sides for
klayout, which stand out from the circle by r (1 / cos (pi / 32) - 1) at their corners.
"""

from __future__ import annotations

import math
from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TypeAlias

import numpy as np
from klayout import db

from maskfab.base.errors import SourceError
from maskfab.base.units import NM_PER_UM
from maskfab.mask.layout import DBU_UM, LIBRARY_END

_FROM_CIRCLE = 1 / math.cos(math.pi / 32) - 1
_ROUNDED_NM = 1
_MOST_COPIES = 1_000_000
_MOST_WRITTEN = 5_000_000
"""Shapes; of so many a stream takes a third of a gigabyte."""

_LARGEST_NUMBER = 0xFFFF
_STRUCTURE, _ELEMENT_END, _TEXT = b"\x00\x1c\x05\x02" + bytes(24), b"\x00\x04\x11\x00", b"\x00\x04\x0c\x00"
"""BGNSTR without times, ENDEL, TEXT."""

_Pair: TypeAlias = tuple[str, db.LayerInfo, db.Region, db.Region, "_Slack"]
"""Name of a cell, layer, what each of two readers draws there, and what may differ."""


@dataclass(frozen=True, eq=False)
class _Slack:
    """Half the width of slivers that mean nothing, and around some paths, for their round ends."""

    nm: int
    paths: db.Region
    around_nm: int

    def without(self, unlike: db.Region) -> db.Region:
        """The rest of what differs, which means something."""
        rest = unlike.sized(-self.nm) if self.nm else unlike
        if rest.is_empty() or self.paths.is_empty():
            return rest
        around = self.paths.extents(self.around_nm)
        return (rest - around) + (rest & around).sized(-self.around_nm)


def refuse_unlike(path: Path, klayout: db.Layout, gdstk: db.Layout, repeated: Collection[int] = ()) -> None:
    """Refuse a file of which klayout and gdstk draw different shapes.

    Args:
        klayout: in the unit of the file; its layers and unit become those of the other.
        gdstk: in nanometres.
        repeated: cells of that by their indices that hold one repeated shape of the cell which places them.

    Raises:
        SourceError: MF316 with layer, cell, box and both areas.
    """
    for cell, layer, one, other, slack in _pairs(klayout, gdstk, repeated, _in_terms_of(klayout, gdstk)):
        unlike = slack.without(one ^ other)
        if unlike.area() > 0:  # a shape without area may be left in it
            areas = [region.merged().area() / NM_PER_UM**2 for region in (one, other)]
            box = unlike.bbox()
            left, bottom, right, top = (side / NM_PER_UM for side in (box.left, box.bottom, box.right, box.top))
            what = (
                f"{path.name}: two readers disagree: layer {layer} of cell {cell} covers {areas[0]:.10g} um^2 for "
                f"klayout and {areas[1]:.10g} um^2 for gdstk; they differ in the box ({left:g}, {bottom:g}) to "
                f"({right:g}, {top:g}) um"
            )
            cure = "Open it where it was drawn, compare that place, and write it as GDSII of boundaries"
            raise SourceError("MF316", what, where=str(path), cure=cure)


def _in_terms_of(one: db.Layout, other: db.Layout) -> float:
    """Give a layout the layers and, where its grid has no finer steps, the unit of another; what it is still off by."""
    for info in other.layer_infos():
        index = next((at for at, own in _layers(one).items() if own.is_equivalent(info)), None)
        if index is None:
            one.layer(info)
        else:
            one.set_info(index, info)
    return float(to_nanometres(one).dbu / DBU_UM)


def to_nanometres(layout: db.Layout) -> db.Layout:
    """The layout itself, in nanometres where its own unit is a number of them."""
    scale = layout.dbu / DBU_UM
    if abs(scale - round(scale)) <= 1e-9 * scale:
        if round(scale) > 1:
            layout.transform(db.ICplxTrans(float(round(scale))))
        layout.dbu = DBU_UM
    return layout


def _layers(layout: db.Layout) -> Mapping[int, db.LayerInfo]:
    return {index: layout.get_info(index) for index in layout.layer_indexes()}


def _pairs(one: db.Layout, other: db.Layout, repeated: Collection[int], scale: float) -> Iterator[_Pair]:
    names = (
        {cell.name for cell in one.each_cell()},
        {cell.name for cell in other.each_cell() if cell.cell_index() not in repeated},
    )
    infos = {info.to_s(): info for layout in (one, other) for info in layout.layer_infos()}
    layers = [(info, one.find_layer(info), other.find_layer(info)) for info in infos.values()]
    if scale == 1 and names[0] == names[1]:
        written = _elements(one), _elements(_spread(other, repeated))
        unlike = sorted(name for name in names[0] if not _same(*(elements.get(name) for elements in written)))
        del written
        for name in unlike:
            for info, first, second in layers:
                regions = _own(one.cell(name), first, ()), _own(other.cell(name), second, repeated)
                yield name, info, *regions, _slack([one.cell(name)], first, 0)
        if all(_placed(one.cell(name), ()) == _placed(other.cell(name), repeated) for name in unlike):
            return
    tops = {top.name for layout in (one, other) for top in layout.top_cells()}
    levels = max((top.hierarchy_levels() for layout in (one, other) for top in layout.top_cells()), default=0)
    for name in sorted(tops):
        for info, first, second in layers:
            drawn, read = (
                db.Region() if layout.cell(name) is None or index is None
                else db.Region(layout.cell(name).begin_shapes_rec(index))
                for layout, index in ((one, first), (other, second))
            )  # fmt: skip
            if scale != 1:
                drawn = drawn.transformed(db.ICplxTrans(scale))
            rounded = math.ceil(max(1, scale) * _ROUNDED_NM) + (0 if scale == 1 else levels)
            yield name, info, drawn, read, _slack(list(one.each_cell()), first, rounded, one.cell(name), scale)


def _elements(layout: db.Layout) -> Mapping[str, bytes]:
    """The elements of each cell as records of GDSII; nothing of a layout that is too large to write."""
    cells, infos = list(layout.each_cell()), layout.layer_infos()
    shapes = sum(cell.shapes(index).size() for cell in cells for index in layout.layer_indexes())
    if shapes > _MOST_WRITTEN or any(max(info.layer, info.datatype) > _LARGEST_NUMBER for info in infos):
        return {}
    options = db.SaveLayoutOptions()
    options.format, options.write_context_info, options.gds2_write_timestamps = "GDS2", False, False
    # Where a structure begins, so does the record of its name: length, kind, text.
    named = bytes(layout.write_bytes(options)).removesuffix(LIBRARY_END).split(_STRUCTURE)[1:]
    ends = [int.from_bytes(text[:2]) for text in named]
    return {text[4:end].rstrip(b"\0").decode("latin-1"): text[end:] for text, end in zip(named, ends, strict=True)}


def _same(one: bytes | None, other: bytes | None) -> bool:
    """Whether two cells have the same elements, in whatever order, and however often each."""
    if one is None or other is None or one == other:
        return one is not None and one == other
    kinds = [{part for part in cell.split(_ELEMENT_END) if not part.startswith(_TEXT)} for cell in (one, other)]
    return kinds[0] == kinds[1]


def _spread(layout: db.Layout, repeated: Collection[int]) -> db.Layout:
    """A layout whose repeated shapes stand in the cells that repeat them."""
    among = set(repeated)
    if not among:
        return layout
    spread = layout.dup()
    for cell in spread.each_cell():
        instances = [instance for instance in cell.each_inst() if instance.cell_index in among]
        if not instances or sum(instance.size() for instance in instances) > _MOST_WRITTEN:
            continue
        for index in spread.layer_indexes():
            drawn = db.Region()
            drawn.merged_semantics = False
            drawn.insert(_shapes(cell, index, among, itself=False))
            cell.shapes(index).insert(drawn)
        for instance in instances:
            instance.delete()
    return spread


def _own(cell: db.Cell, layer: int | None, repeated: Collection[int]) -> db.Region:
    """Shapes of a cell, and those that it repeats."""
    return db.Region() if layer is None else db.Region(_shapes(cell, layer, repeated))


def _shapes(cell: db.Cell, layer: int, repeated: Collection[int], *, itself: bool = True) -> db.RecursiveShapeIterator:
    shapes = cell.begin_shapes_rec(layer)
    within = set(cell.each_child_cell())
    shapes.max_depth = 1 if within & set(repeated) else 0
    shapes.min_depth = 0 if itself else 1
    if shapes.max_depth:
        shapes.unselect_cells(sorted(within - set(repeated)))
    return shapes


def _slack(
    cells: Sequence[db.Cell], layer: int | None, nm: int, top: db.Cell | None = None, scale: float = 1.0
) -> _Slack:
    """Half the width of slivers that paths of some cells may leave in the first one itself, or in all of a top cell."""
    paths = [] if layer is None else [path for cell in cells for path in cell.shapes(layer).each(db.Shapes.SPaths)]
    radius = max((path.path_width / 2 for path in paths if path.round_path), default=0.0)
    around = db.Region()
    if radius:
        shapes = (top or cells[0]).begin_shapes_rec(layer)
        shapes.shape_flags = db.Shapes.SPaths
        shapes.max_depth = shapes.max_depth if top else 0
        around = db.Region(shapes).transformed(db.ICplxTrans(scale))
        around.merged_semantics = False
    return _Slack(max(nm, _ROUNDED_NM if paths else 0), around, math.ceil(radius * scale * _FROM_CIRCLE / 2 + 1))


def count_curves(layout: db.Layout) -> int:
    """Paths with round ends, and circles, which klayout takes for such paths of one point."""
    return sum(
        path.round_path
        for cell in layout.each_cell()
        for layer in layout.layer_indexes()
        for path in cell.shapes(layer).each(db.Shapes.SPaths)
    )


def _placed(cell: db.Cell, repeated: Collection[int]) -> Mapping[tuple[object, ...], bytes]:
    """Where a cell places others: by the other's name and how it is turned, all places; long arrays as they are."""
    places: dict[tuple[object, ...], list[np.ndarray[tuple[int, int], np.dtype[np.int64]]]] = {}
    for instance in cell.each_inst():
        if instance.cell_index in repeated:
            continue
        turn, to = instance.cplx_trans, instance.trans.disp
        key: tuple[object, ...] = instance.cell.name, turn.is_mirror(), round(turn.mag, 9), round(turn.angle, 6) % 360
        steps = (instance.a, max(1, instance.na)), (instance.b, max(1, instance.nb))
        points = np.array([[to.x, to.y]], dtype=np.int64)
        if instance.size() > _MOST_COPIES:
            key += tuple((step.x, step.y, times) for step, times in steps)
        else:
            for step, times in steps:
                along = np.arange(times)[:, None] * np.array([step.x, step.y], dtype=np.int64)
                points = (points[:, None] + along).reshape(-1, 2)
        places.setdefault(key, []).append(points)
    return {key: np.unique(np.concatenate(points), axis=0).tobytes() for key, points in places.items()}
