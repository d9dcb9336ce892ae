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
from collections.abc import Collection, Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TypeAlias

from klayout import db

from maskfab.base.errors import SourceError
from maskfab.base.units import NM_PER_UM
from maskfab.mask.layout import DBU_UM, LIBRARY_END

_FROM_CIRCLE = 1 / math.cos(math.pi / 32) - 1
_ROUNDED_NM = 1
_MOST_WRITTEN = 5_000_000
"""Shapes; of so many a stream takes a third of a gigabyte."""

_LARGEST_NUMBER = 0xFFFF
_STRUCTURE, _ELEMENT_END, _TEXT = b"\x00\x1c\x05\x02" + bytes(24), b"\x00\x04\x11\x00", b"\x00\x04\x0c\x00"
_REFERENCES = b"\x00\x04\x0a\x00", b"\x00\x04\x0b\x00"
"""BGNSTR without times, ENDEL, TEXT; SREF and AREF."""

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
        klayout: in the unit of the file, which becomes that of the other where it is a number of them.
        gdstk: in nanometres.
        repeated: cells of that by their indices that hold one repeated shape of the cell which places them.

    Raises:
        SourceError: MF316 with layer, cell, box and both areas.
    """
    for cell, layer, one, other, slack in _pairs(klayout, gdstk, repeated):
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


def to_nanometres(layout: db.Layout) -> db.Layout:
    """The layout itself, in nanometres where its own unit is a number of them."""
    scale = layout.dbu / DBU_UM
    if abs(scale - round(scale)) <= 1e-9 * scale:
        if round(scale) > 1:
            layout.transform(db.ICplxTrans(float(round(scale))))
        layout.dbu = DBU_UM
    return layout


def _pairs(one: db.Layout, other: db.Layout, repeated: Collection[int]) -> Iterator[_Pair]:
    scale = float(to_nanometres(one).dbu / DBU_UM)
    names = {cell.name for cell in one.each_cell()}
    infos = [*other.layer_infos(), *(info for info in one.layer_infos() if other.find_layer(info) is None)]

    def pair(name: str, info: db.LayerInfo, rounded_nm: int, cells: Collection[int] | None) -> _Pair:
        drawn, read = _drawn(one, name, info, cells), _drawn(other, name, info, cells)
        first = db.Region() if drawn is None else db.Region(drawn).transformed(db.ICplxTrans(scale))
        second = db.Region() if read is None else db.Region(read)
        return name, info, first, second, _slack(one, info, drawn, rounded_nm, scale)

    if scale == 1 and names == {cell.name for cell in other.each_cell() if cell.cell_index() not in repeated}:
        written, spread = _elements(one), _elements(_spread(other, repeated))
        unlike = [name for name in sorted(names) if name not in written or written[name] != spread.get(name)]
        kinds = [(name, _kinds(written.get(name)), _kinds(spread.get(name))) for name in unlike]
        del written, spread
        for name in (name for name, first, second in kinds if first is None or first != second):
            yield from (pair(name, info, 0, repeated) for info in infos)
        if all(first and second and first[0] == second[0] for _, first, second in kinds):
            return
    tops = {top.name: top.hierarchy_levels() for layout in (one, other) for top in layout.top_cells()}
    for name, levels in sorted(tops.items()):
        rounded_nm = _ROUNDED_NM if scale == 1 else math.ceil(max(1, scale)) * _ROUNDED_NM + levels
        yield from (pair(name, info, rounded_nm, None) for info in infos)


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


def _kinds(cell: bytes | None) -> tuple[set[bytes], set[bytes]] | None:
    """References and shapes of a cell, in whatever order, and however often each; None of one that is not written."""
    if cell is None:
        return None
    parts = {part for part in cell.split(_ELEMENT_END) if not part.startswith(_TEXT)}
    placed = {part for part in parts if part.startswith(_REFERENCES)}
    return placed, parts - placed


def _spread(layout: db.Layout, repeated: Collection[int]) -> db.Layout:
    """A layout whose repeated shapes stand in the cells that repeat them."""
    spread = layout.dup() if repeated else layout
    for cell in spread.each_cell() if repeated else ():
        instances = [instance for instance in cell.each_inst() if instance.cell_index in repeated]
        if not instances or sum(instance.size() for instance in instances) > _MOST_WRITTEN:
            continue
        for info in spread.layer_infos():
            drawn, shapes = db.Region(), _drawn(spread, cell.name, info, repeated)
            assert shapes is not None  # cell and layer are there
            shapes.min_depth, drawn.merged_semantics = 1, False
            drawn.insert(shapes)
            cell.shapes(spread.find_layer(info)).insert(drawn)
        for instance in instances:
            instance.delete()
    return spread


def _drawn(
    layout: db.Layout, name: str, info: db.LayerInfo, repeated: Collection[int] | None
) -> db.RecursiveShapeIterator | None:
    """Shapes of a layer in a cell: its own and those that it repeats, or all below it if these are None."""
    cell, index = layout.cell(name), layout.find_layer(info)
    if cell is None or index is None:
        return None
    shapes = cell.begin_shapes_rec(index)
    if repeated is not None:
        within = set(cell.each_child_cell())
        shapes.max_depth = 0 if within.isdisjoint(repeated) else 1
        shapes.unselect_cells(sorted(within.difference(repeated)))
    return shapes


def _slack(
    layout: db.Layout, info: db.LayerInfo, shapes: db.RecursiveShapeIterator | None, rounded_nm: int, scale: float
) -> _Slack:
    """Half the width of slivers that paths among some shapes may leave."""
    if shapes is None:
        return _Slack(rounded_nm, db.Region(), 0)
    shapes.shape_flags = db.Shapes.SPaths
    paths, index = db.Region(shapes), layout.find_layer(info)
    if paths.is_empty():
        return _Slack(rounded_nm, paths, 0)
    every = (path for cell in layout.each_cell() for path in cell.shapes(index).each(db.Shapes.SPaths))
    radius = max((path.path_width / 2 for path in every if path.round_path), default=0.0) * scale
    paths = paths.transformed(db.ICplxTrans(scale)) if radius else db.Region()
    paths.merged_semantics = False
    return _Slack(max(rounded_nm, _ROUNDED_NM), paths, math.ceil(radius * _FROM_CIRCLE / 2 + 1))


def count_curves(layout: db.Layout) -> int:
    """Paths with round ends, and circles, which klayout takes for such paths of one point."""
    return sum(
        path.round_path
        for cell in layout.each_cell()
        for layer in layout.layer_indexes()
        for path in cell.shapes(layer).each(db.Shapes.SPaths)
    )
