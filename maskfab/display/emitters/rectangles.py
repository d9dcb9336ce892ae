"""The three largest rectangles, a gap apart, in a region: exact.

Any three axis-parallel rectangles that are pairwise a gap apart have a straight cut of that width between one and the
other two: if no vertical cut existed, at least two of the three pairs would overlap in x; if no horizontal one, at
least two in y; so some pair would overlap in both. The two that are left have a cut of their own. So the optimum is
the best choice of two straight cuts, and the only windows that a rectangle must be known for are strips across the
pixel and windows in its four corners: tables of (n + 1)^2 entries, made in n^3 steps.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from maskfab.display.emitters.emitter_rules import EmitterGrid
from maskfab.display.emitters.free_area import EVERY, free_region

Ratio = tuple[float, float, float]
Window = tuple[int, int, int, int]
"""Cells y0 to y1 and x0 to x1, the upper ends excluded."""

_BATCH = 64
"""Regions that go through together: their tables stay in the processor's cache."""


@dataclass(frozen=True, eq=False)
class WindowTable:
    """Area in cells of the largest allowed rectangle in each window that touches two or more sides of the pixel.

    Attributes:
        columns: int16 [k, n + 1, n + 1]; [x0, x1] is the strip of columns x0 to x1 over the full height.
        rows: int16 [k, n + 1, n + 1]; [y0, y1] is the strip of rows y0 to y1 over the full width.
        corners: int16 [k, 2, 2, n + 1, n + 1]; [upper, right, h, w] is the h x w window in that corner of the pixel.
    """

    columns: NDArray[np.int16]
    rows: NDArray[np.int16]
    corners: NDArray[np.int16]


def window_table(regions: NDArray[np.bool_], min_width: int, max_aspect: float = math.inf) -> WindowTable:
    """The largest rectangle in every strip and every corner window.

    Args:
        regions: bool [k, n, n] cells in which a rectangle may lie.
        min_width: shortest side of a rectangle, in cells.
        max_aspect: longest over shortest side.
    """
    both = np.stack([regions, regions.swapaxes(-1, -2)], axis=1)
    strips = _strips(both, min_width, max_aspect)
    flipped = np.stack(
        [
            np.stack([regions, regions[..., ::-1]], axis=1),
            np.stack([regions[..., ::-1, :], regions[..., ::-1, ::-1]], axis=1),
        ],
        axis=1,
    )
    ends = _rectangles_ending(flipped, min_width, max_aspect)
    corners = np.zeros((*ends.shape[:-2], ends.shape[-2] + 1, ends.shape[-1] + 1), dtype=np.int16)
    corners[..., 1:, 1:] = np.maximum.accumulate(np.maximum.accumulate(ends, axis=-1), axis=-2)
    return WindowTable(strips[:, 0], strips[:, 1], corners)


def three_rectangles(
    region: NDArray[np.bool_], grid: EmitterGrid, ratio: Ratio, *, max_aspect: float = math.inf
) -> tuple[float, NDArray[np.int8]]:
    """The three rectangles with the largest smallest area relative to the ratio; exact.

    At minimum width w, 0 proves that no three emitters of any shape fit: each would hold a w x w square.

    Args:
        region: bool [n, n] cells in which an emitter may lie.
        grid: the gap between colours and the least width, in cells.
        ratio: relative areas of red, green and blue.
        max_aspect: longest over shortest side of a rectangle.

    Returns:
        The least of area_k / ratio_k in cells (0 if three do not fit), and int8 [n, n] labels 1 to 3, whole lines
        beyond it trimmed off; all 0 if three do not fit.
    """
    labels = np.zeros(region.shape, dtype=np.int8)
    table = window_table(region[None], grid.min_width, max_aspect)
    best = 0.0
    order: tuple[int, ...] = ()
    windows: tuple[Window, ...] = ()
    for permutation in orders(ratio):
        for values, cut in _cuts(table, region.shape[-1], grid.colour_gap, tuple(ratio[k] for k in permutation)):
            at = int(values[0].argmax())
            if values[0].flat[at] > best:
                best = float(values[0].flat[at])
                windows, order = cut(*divmod(at, values.shape[-1])), permutation
    for k, window in zip(order, windows, strict=False):
        y0, y1, x0, x1 = _largest_in(region, window, grid.min_width, max_aspect)
        y1, x1 = _trimmed(y0, y1, x0, x1, best * ratio[k], grid.min_width, max_aspect)
        labels[y0:y1, x0:x1] = k + 1
    return best, labels


def rectangle_footprints(
    masks: NDArray[np.bool_],
    grid: EmitterGrid,
    ratio: Ratio,
    *,
    orientations: Iterable[int] = EVERY,
    margin: int = 0,
    max_aspect: float = math.inf,
) -> NDArray[np.float64]:
    """The footprint of the three largest rectangles behind each of many openings, for optimisers.

    Args:
        masks: bool [k, dots, dots] openings, True is clear.
        grid: as for a single opening.
        ratio: relative areas of red, green and blue, which sum to 3.
        orientations: those in use; they matter where the gap to an opening is wider than the gutter.
        margin: cells kept free along each side.
        max_aspect: longest over shortest side of a rectangle.

    Returns:
        float [k] mean share of the pixel, gutter included, per colour; of the smallest relative to its ratio.
    """
    used = tuple(orientations)
    found = np.zeros(len(masks))
    for start in range(0, len(masks), _BATCH):
        part = slice(start, start + _BATCH)
        regions = free_region(masks[part], grid, used, margin=margin)
        table = window_table(regions, grid.min_width, max_aspect)
        for permutation in orders(ratio):
            for values, _ in _cuts(table, grid.cells, grid.colour_gap, tuple(ratio[k] for k in permutation)):
                np.maximum(found[part], values.max(axis=(1, 2)), out=found[part])
    return found * (grid.cell_nm / grid.pitch_nm) ** 2


def orders(ratio: Ratio) -> list[tuple[int, ...]]:
    """The orders of the colours, those left out that differ only by colours of equal area."""
    seen: dict[tuple[float, ...], tuple[int, ...]] = {}
    for order in itertools.permutations(range(3)):
        seen.setdefault(tuple(ratio[k] for k in order), order)
    return list(seen.values())


def _cuts(
    table: WindowTable, n: int, gap: int, ratio: tuple[float, ...]
) -> Iterator[tuple[NDArray[np.float64], Callable[[int, int], tuple[Window, Window, Window]]]]:
    """Every pair of cuts: [k, i, j] smallest of three areas relative to the ratio, and the windows of cuts i, j."""
    left = n - gap + 1
    if left <= 0:
        return
    a, b, c = ratio
    columns, rows = table.columns, table.rows

    def least(first: NDArray[np.int16], second: NDArray[np.int16], third: NDArray[np.int16]) -> NDArray[np.float64]:
        return np.minimum(np.minimum(first / a, second / b), third / c)

    def turned(window: Window, across: bool) -> Window:
        y0, y1, x0, x1 = window
        return (x0, x1, y0, y1) if across else window

    for strips, across in ((columns, False), (rows, True)):
        yield (
            least(strips[:, 0, :left, None], strips[:, gap:, :left], strips[:, None, gap:, n]),
            lambda i, j, s=across: (  # type: ignore[misc]
                turned((0, n, 0, i), s),
                turned((0, n, i + gap, j), s),
                turned((0, n, j + gap, n), s),
            ),
        )
        corners = table.corners.transpose(0, 2, 1, 4, 3) if across else table.corners
        # i: width of the two on the far side; j: height of the lower of them.
        for right in (1, 0):
            single = strips[:, 0, left - 1 :: -1] if right else strips[:, gap:, n]
            lower = corners[:, 0, right, :left, :left].swapaxes(-1, -2)
            upper = corners[:, 1, right, left - 1 :: -1, :left].swapaxes(-1, -2)

            def windows(i: int, j: int, right: int = right, across: bool = across) -> tuple[Window, Window, Window]:
                near = (0, n - gap - i) if right else (i + gap, n)
                far = (n - i, n) if right else (0, i)
                return (
                    turned((0, n, *near), across),
                    turned((0, j, *far), across),
                    turned((j + gap, n, *far), across),
                )

            yield least(single[..., None], lower, upper), windows


def _sides(length: int, n: int, min_width: int, max_aspect: float) -> tuple[int, int]:
    """Shortest and longest other side of a rectangle with a side of this length."""
    # The slack keeps a limit such as 1.4 from losing 7 x 5 to rounding.
    longest = n if math.isinf(max_aspect) else min(n, math.floor(max_aspect * length + 1e-9))
    shortest = 0 if math.isinf(max_aspect) else math.ceil(length / max_aspect - 1e-9)
    return max(min_width, shortest), longest if length >= min_width else -1


def _runs(regions: NDArray[np.bool_], axis: int) -> NDArray[np.int16]:
    """Number of free cells in a row that end at each cell, along an axis."""
    runs = np.moveaxis(regions.astype(np.int16), axis, 0)
    for i in range(1, len(runs)):
        runs[i] += runs[i] * runs[i - 1]
    return np.moveaxis(runs, 0, axis)


def _strips(regions: NDArray[np.bool_], min_width: int, max_aspect: float) -> NDArray[np.int16]:
    """[..., x0, x1] area of the largest rectangle between columns x0 and x1."""
    n = regions.shape[-1]
    # Columns first: the minimum over neighbouring columns then runs along whole rows of memory.
    runs = np.ascontiguousarray(np.moveaxis(_runs(regions, -2), -1, 0))
    heights = runs.copy()
    found = np.zeros((*regions.shape[:-2], n + 1, n + 1), dtype=np.int16)
    diagonal = np.arange(n + 1)
    for width in range(1, n + 1):
        if width > 1:
            heights = np.minimum(heights[:-1], runs[width - 1 :])
        at, to = diagonal[: n + 1 - width], diagonal[width:]
        area = np.maximum(found[..., at, to - 1], found[..., at + 1, to])
        shortest, longest = _sides(width, n, min_width, max_aspect)
        if longest >= shortest:
            tallest = np.moveaxis(np.minimum(heights.max(axis=-1), longest), 0, -1)
            area = np.maximum(area, np.where(tallest >= shortest, tallest * np.int16(width), 0))
        found[..., at, to] = area
    return found


def _rectangles_ending(regions: NDArray[np.bool_], min_width: int, max_aspect: float) -> NDArray[np.int16]:
    """[..., y, x] area of the largest rectangle whose upper right cell this is."""
    n = regions.shape[-1]
    runs = np.ascontiguousarray(np.moveaxis(_runs(regions, -1), -2, 0))
    widths = runs.copy()
    found = np.zeros_like(runs)
    for height in range(1, n + 1):
        if height > 1:
            widths = np.minimum(widths[:-1], runs[height - 1 :])
        shortest, longest = _sides(height, n, min_width, max_aspect)
        if longest >= shortest:
            capped = np.minimum(widths, longest) if longest < n else widths
            area = capped * np.int16(height)
            area[capped < shortest] = 0
            np.maximum(found[height - 1 :], area, out=found[height - 1 :])
    return np.moveaxis(found, 0, -2)


def _largest_in(region: NDArray[np.bool_], window: Window, min_width: int, max_aspect: float) -> Window:
    y0, y1, x0, x1 = window
    inside = np.zeros_like(region)
    inside[y0:y1, x0:x1] = region[y0:y1, x0:x1]
    ends = _rectangles_ending(inside[None], min_width, max_aspect)[0]
    y, x = divmod(int(ends.argmax()), region.shape[-1])
    for height in range(1, y + 2):
        width, rest = divmod(int(ends[y, x]), height)
        if rest == 0 and width <= x + 1 and inside[y + 1 - height : y + 1, x + 1 - width : x + 1].all():
            shortest, longest = _sides(height, region.shape[-1], min_width, max_aspect)
            if shortest <= width <= longest:
                return y + 1 - height, y + 1, x + 1 - width, x + 1
    raise AssertionError("the table holds a rectangle that the region does not")


def _trimmed(y0: int, y1: int, x0: int, x1: int, area: float, min_width: int, max_aspect: float) -> tuple[int, int]:
    """Upper ends of the rectangle of least area, in the same corner, that is still large enough and allowed."""
    smallest = (y1 - y0) * (x1 - x0)
    ends = y1, x1
    for height in range(min_width, y1 - y0 + 1):
        width = max(min_width, math.ceil(area / height - 1e-9))
        shortest, longest = _sides(height, x1 - x0, min_width, max_aspect)
        width = max(width, shortest)
        if width <= longest and height * width < smallest:
            smallest, ends = height * width, (y0 + height, x0 + width)
    return ends
