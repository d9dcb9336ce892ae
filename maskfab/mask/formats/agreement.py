"""Two readings of one layout held against each other: what two libraries draw otherwise is refused, with the place.

Nothing is merged where both have the same elements in the same cells, which is soon told from both as streams of
GDSII. Otherwise the shapes of each cell and layer are laid over each other, and its references are held against each
other by their places.

Readers may rightly differ by what they round. Corners of polygons are whole numbers in a file, and must agree to the
last of them. The sides of a path are half a width away from its points: each reader puts their corners on its grid, no
farther than 0.71 nm, so that slivers of up to two units are left out. Round ends are polygons of 32 sides for
klayout, which stand out from the circle by r (1 / cos (pi / 32) - 1) at their corners.
"""

from __future__ import annotations

import math
from collections.abc import Collection, Mapping
from dataclasses import dataclass
from itertools import product
from pathlib import Path
from typing import TypeAlias

import numpy as np
from klayout import db

from maskfab.base.arrays import Ints
from maskfab.base.errors import SourceError
from maskfab.base.units import NM_PER_UM
from maskfab.mask.layout import DBU_UM, LIBRARY_END

_FROM_CIRCLE = 1 / math.cos(math.pi / 32) - 1
_ROUNDED_NM = 1
_MOST_COPIES = 2_000_000
_WIDE = 1 << 31
_NOWHERE = np.empty((0, 2), dtype=np.int64)
_Key: TypeAlias = tuple[str | float, ...]

_MOST_WRITTEN = 5_000_000
"""Shapes; of so many a stream takes a third of a gigabyte."""

_LARGEST_NUMBER = 0xFFFF
_STRUCTURE, _ELEMENT_END, _TEXT = b"\x00\x1c\x05\x02" + bytes(24), b"\x00\x04\x11\x00", b"\x00\x04\x0c\x00"
"""BGNSTR without times, ENDEL, TEXT."""


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
    scale = float(to_nanometres(klayout).dbu / DBU_UM)
    infos = [*gdstk.layer_infos(), *(info for info in klayout.layer_infos() if gdstk.find_layer(info) is None)]
    for name in _unlike(klayout, gdstk, repeated, scale):
        for info in infos:
            drawn, read = _drawn(klayout, name, info, repeated), _drawn(gdstk, name, info, repeated)
            one = db.Region() if drawn is None else db.Region(drawn).transformed(db.ICplxTrans(scale))
            other = db.Region() if read is None else db.Region(read)
            unlike = _slack(klayout, info, drawn, scale).without(one ^ other)
            if unlike.area() > 0:  # a shape without area may be left in it
                areas = [region.merged().area() / NM_PER_UM**2 for region in (one, other)]
                raise _disagree(
                    path,
                    f"layer {info} of cell {name} covers {areas[0]:.10g} um^2 for klayout and {areas[1]:.10g} um^2 for "
                    f"gdstk; they differ in the box {_um(unlike.bbox().p1)} to {_um(unlike.bbox().p2)} um",
                )
        placed, others = _placed(klayout, name, repeated, scale), _placed(gdstk, name, repeated, 1)
        for key in sorted(placed.keys() | others.keys()):
            far = _far(placed.get(key, _NOWHERE), others.get(key, _NOWHERE))
            if len(far):
                raise _disagree(
                    path,
                    f"cell {name} places {key[0]} where only one of klayout and gdstk does, at {len(far)} points, "
                    f"first at {_um(db.Point(*far[0].tolist()))} um",
                )


def _disagree(path: Path, what: str) -> SourceError:
    cure = "Look at that place (maskfab verify FILE --readers), and write it as GDSII of boundaries where it was drawn"
    return SourceError("MF316", f"{path.name}: two readers disagree: {what}", where=str(path), cure=cure)


def _um(point: db.Point) -> str:
    return f"({point.x / NM_PER_UM:g}, {point.y / NM_PER_UM:g})"


def to_nanometres(layout: db.Layout) -> db.Layout:
    """The layout itself, in nanometres where its own unit is a number of them."""
    scale = layout.dbu / DBU_UM
    if abs(scale - round(scale)) <= 1e-9 * scale:
        if round(scale) > 1:
            layout.transform(db.ICplxTrans(float(round(scale))))
        layout.dbu = DBU_UM
    return layout


def _unlike(one: db.Layout, other: db.Layout, repeated: Collection[int], scale: float) -> list[str]:
    """Cells that are not written alike."""
    names = {cell.name for cell in one.each_cell()}
    names |= {cell.name for cell in other.each_cell() if cell.cell_index() not in repeated}
    if scale != 1:
        return sorted(names)
    written, spread = _elements(one), _elements(_spread(other, repeated))
    return sorted(name for name in names if not _same(written.get(name), spread.get(name)))


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
    layout: db.Layout, name: str, info: db.LayerInfo, repeated: Collection[int]
) -> db.RecursiveShapeIterator | None:
    """Shapes of a layer in a cell, and those that it repeats."""
    cell, index = layout.cell(name), layout.find_layer(info)
    if cell is None or index is None:
        return None
    shapes, within = cell.begin_shapes_rec(index), set(cell.each_child_cell())
    shapes.max_depth = 0 if within.isdisjoint(repeated) else 1
    shapes.unselect_cells(sorted(within.difference(repeated)))
    return shapes


def _slack(layout: db.Layout, info: db.LayerInfo, shapes: db.RecursiveShapeIterator | None, scale: float) -> _Slack:
    """Half the width of slivers that may be left by paths among some shapes, or by another unit."""
    rounded_nm, paths = 0 if scale == 1 else math.ceil(scale) * _ROUNDED_NM, db.Region()
    if shapes is not None:
        shapes.shape_flags = db.Shapes.SPaths
        paths = db.Region(shapes).transformed(db.ICplxTrans(scale))
    if paths.is_empty():
        return _Slack(rounded_nm, paths, 0)
    index = layout.find_layer(info)
    every = (path for cell in layout.each_cell() for path in cell.shapes(index).each(db.Shapes.SPaths))
    radius = max((path.path_width / 2 for path in every if path.round_path), default=0.0) * scale
    paths.merged_semantics = False
    return _Slack(
        max(rounded_nm, _ROUNDED_NM), paths if radius else db.Region(), math.ceil(radius * _FROM_CIRCLE / 2 + 1)
    )


def _placed(layout: db.Layout, name: str, repeated: Collection[int], scale: float) -> Mapping[_Key, Ints]:
    """Points [n, 2] at which a cell places others, by their names and how they are turned; long arrays by steps."""
    places: dict[_Key, list[Ints]] = {}
    cell = layout.cell(name)
    for instance in () if cell is None else cell.each_inst():
        if instance.cell_index in repeated:
            continue
        turn, to = instance.cplx_trans, instance.trans.disp
        key: _Key = instance.cell.name, turn.is_mirror(), round(turn.mag, 9), round(turn.angle, 6) % 360
        points, steps = np.array([[to.x, to.y]]), [(instance.a, instance.na), (instance.b, instance.nb)]
        for step, times in ((step, times) for step, times in steps if times > 1):
            if instance.size() > _MOST_COPIES:
                key += times, round(step.x * scale), round(step.y * scale)
            else:
                points = (points[:, None] + np.arange(times)[:, None] * np.array([step.x, step.y])).reshape(-1, 2)
        places.setdefault(key, []).append(np.rint(points * scale).astype(np.int64))
    return {key: np.concatenate(points) for key, points in places.items()}


def _far(one: Ints, other: Ints) -> Ints:
    """Points of either that are none of the other, nor beside one by a nanometre, which readers round otherwise."""
    far = []
    for points, others in ((one, other), (other, one)):
        known, rest = others[:, 0] * _WIDE + others[:, 1], points
        for dx, dy in product((0, -1, 1), repeat=2):
            rest = rest[~np.isin((rest[:, 0] + dx) * _WIDE + rest[:, 1] + dy, known)]
        far.append(rest)
    return np.concatenate(far)


def count_curves(layout: db.Layout) -> int:
    """Paths with round ends, and circles, which klayout takes for such paths of one point."""
    return sum(
        path.round_path
        for cell in layout.each_cell()
        for layer in layout.layer_indexes()
        for path in cell.shapes(layer).each(db.Shapes.SPaths)
    )
