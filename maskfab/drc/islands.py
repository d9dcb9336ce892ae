"""Connected areas of one tone over a whole panel, without ever drawing the panel, and those too small to write."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import find_objects, label
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from maskfab.base.arrays import Floats, Ints
from maskfab.drc.cells import PanelCells
from maskfab.drc.results import Found, Repeated, expanded, joined, listed


@dataclass(frozen=True, eq=False)
class Parts:
    """The connected parts of every distinct cell, numbered through.

    Attributes:
        labels: int64 [held, n, n], part of each dot; -1 where the tone is the other.
        owners: int64 [parts], the cell that has it.
        areas_nm2: float64 [parts].
        boxes_nm: int64 [parts, 4], from the cell's corner.
        inner: bool [parts], whether it stays clear of the cell's border.
    """

    labels: Ints
    owners: Ints
    areas_nm2: Floats
    boxes_nm: Ints
    inner: NDArray[np.bool_]


@dataclass(frozen=True, eq=False)
class Islands:
    """Connected areas that reach from cell to cell, and those that do not.

    Attributes:
        parts: what they are composed of.
        cells: int64 [nodes], the cell (row-major) of every part that meets its cell's border, panel-wide.
        nodes: int64 [nodes], that part.
        islands: int64 [nodes], the island it belongs to.
        outside: the island that is the surroundings of the panel.
    """

    parts: Parts
    cells: Ints
    nodes: Ints
    islands: Ints
    outside: int

    @cached_property
    def alone(self) -> NDArray[np.bool_]:
        """bool [nodes], whether a part is an island by itself."""
        alone: NDArray[np.bool_] = (self._sizes[self.islands] == 1) & (self.islands != self.outside)
        return alone

    @cached_property
    def joined(self) -> tuple[Ints, Ints]:
        """Indices of the parts of islands of several, island by island and by cell in each, and where each begins."""
        many = np.flatnonzero((self._sizes[self.islands] > 1) & (self.islands != self.outside))
        order = many[np.argsort(self.islands[many], kind="stable")]
        numbers = self.islands[order]
        return order, np.flatnonzero(np.diff(numbers, prepend=-1))

    @cached_property
    def _sizes(self) -> Ints:
        return np.bincount(self.islands)


def parts(cells: PanelCells, *, clear: bool) -> Parts:
    """Parts joined along sides; corners that kiss stay apart."""
    rasters = cells.clear if clear else ~cells.clear
    edges, widths = cells.edges_nm, np.diff(cells.edges_nm).astype(np.float64)
    labels = np.full(rasters.shape, -1, dtype=np.int64)
    owners: list[int] = []
    boxes: list[list[int]] = []
    areas: list[Floats] = []
    for code, raster in enumerate(rasters):
        numbered, count = label(raster)
        labels[code][raster] = numbered[raster] - 1 + len(owners)
        owners += [code] * count
        dots_nm2 = np.outer(widths, widths).ravel()
        sums = np.bincount(numbered.ravel(), weights=dots_nm2, minlength=count + 1)
        areas.append(sums[1:].astype(np.float64))
        for ys, xs in find_objects(numbered):
            boxes.append([int(edges[k]) for k in (xs.start, ys.start, xs.stop, ys.stop)])
    inner = np.ones(len(owners), dtype=np.bool_)
    for side in (labels[:, 0], labels[:, -1], labels[:, :, 0], labels[:, :, -1]):
        inner[side[side >= 0]] = False
    return Parts(
        labels,
        np.array(owners, dtype=np.int64),
        np.concatenate([np.zeros(0), *areas]),
        np.array(boxes, dtype=np.int64).reshape(-1, 4),
        inner,
    )


def islands(cells: PanelCells, *, clear: bool) -> Islands:
    """The islands of one tone; the panel lies in chrome."""
    found = parts(cells, clear=clear)
    codes, (rows, columns) = cells.codes, cells.codes.shape
    outer = np.flatnonzero(~found.inner)
    # Parts are numbered cell by cell, so those of one cell that meet its border are consecutive among all such.
    rank = np.cumsum(~found.inner) - 1
    many = np.bincount(found.owners[outer], minlength=len(cells.held))
    first_of_code = np.cumsum(many) - many
    lengths = many[codes.ravel()]
    base = np.cumsum(lengths) - lengths
    node_cells = np.repeat(np.arange(codes.size), lengths)
    nodes = outer[expanded(first_of_code[codes.ravel()], lengths)]
    local = rank - first_of_code[found.owners]
    index = np.arange(codes.size).reshape(rows, columns)
    ends = [np.zeros((2, 0), dtype=np.int64)]
    for low, high, last, start in (
        (index[:, :-1], index[:, 1:], found.labels[:, :, -1], found.labels[:, :, 0]),
        (index[:-1], index[1:], found.labels[:, -1], found.labels[:, 0]),
    ):
        ends.append(_joints(codes.ravel(), low.ravel(), high.ravel(), last, start, local, base))
    outside = len(nodes)
    if not clear:
        for border, side in (
            (index[:, 0], found.labels[:, :, 0]),
            (index[:, -1], found.labels[:, :, -1]),
            (index[0], found.labels[:, 0]),
            (index[-1], found.labels[:, -1]),
        ):
            touching = side[codes.ravel()[border]]
            met = touching >= 0
            here = np.broadcast_to(base[border][:, None], touching.shape)[met] + local[touching[met]]
            ends.append(np.stack([here, np.full_like(here, outside)]))
    one, two = np.concatenate(ends, axis=1)
    graph = coo_array((np.ones(one.size, dtype=np.int8), (one, two)), shape=(outside + 1, outside + 1))
    _, belongs = connected_components(graph, directed=False)
    return Islands(found, node_cells, nodes, belongs[:-1].astype(np.int64), int(belongs[-1]))


def _joints(codes: Ints, low: Ints, high: Ints, last: Ints, start: Ints, local: Ints, base: Ints) -> Ints:
    """int64 [2, joints]: nodes that meet across the border of neighbouring cells, found once for each pair of codes."""
    kinds = int(codes.max()) + 1
    pairs, which = np.unique(codes[low] * kinds + codes[high], return_inverse=True)
    lefts, rights, many = [], [], []
    for pair in pairs.tolist():
        a, b = last[pair // kinds], start[pair % kinds]
        both = (a >= 0) & (b >= 0)
        met = np.unique(np.stack([local[a[both]], local[b[both]]]), axis=1)
        lefts.append(met[0])
        rights.append(met[1])
        many.append(met.shape[1])
    if not many:
        return np.zeros((2, 0), dtype=np.int64)
    lengths = np.array(many, dtype=np.int64)
    where = expanded((np.cumsum(lengths) - lengths)[which], lengths[which])
    times = lengths[which]
    one = np.repeat(base[low], times) + np.concatenate(lefts)[where]
    two = np.repeat(base[high], times) + np.concatenate(rights)[where]
    return np.stack([one, two])


def small_islands(cells: PanelCells, islands: Islands, limit_nm2: int, most: int) -> Found:
    """Islands of less than an area; the panel's surroundings are none."""
    parts = islands.parts
    small = np.flatnonzero(parts.inner & (parts.areas_nm2 < limit_nm2))
    inner = Repeated(
        cells.codes.ravel(), cells.origins_nm, parts.owners[small], parts.boxes_nm[small], parts.areas_nm2[small]
    )
    small = np.flatnonzero(~parts.inner & (parts.areas_nm2 < limit_nm2))
    alone = Repeated(
        islands.nodes[islands.alone],
        cells.origins_nm[islands.cells[islands.alone]],
        small,
        parts.boxes_nm[small],
        parts.areas_nm2[small],
    )
    order, starts = islands.joined
    if not order.size:
        return joined([inner.found(most), alone.found(most)], most)
    nodes = islands.nodes[order]
    # Sums of whole numbers stay exact in float64 up to 9e15 nm², a square of 95 mm.
    areas = np.add.reduceat(parts.areas_nm2[nodes], starts)
    boxes = parts.boxes_nm[nodes] + np.tile(cells.origins_nm[islands.cells[order]], 2)
    low, high = np.minimum.reduceat(boxes[:, :2], starts), np.maximum.reduceat(boxes[:, 2:], starts)
    below = areas < limit_nm2
    across = listed(np.concatenate([low, high], axis=1)[below], areas[below], most)
    return joined([inner.found(most), alone.found(most), across], most)
