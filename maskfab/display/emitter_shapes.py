"""Shapes of three emitters in a region: rectangles, shapes between straight cuts, and crooked borders.

**Rectangles** are exact. Any three axis-parallel rectangles that are pairwise a gap apart have a straight cut of that
width between one and the other two: if no vertical cut existed, at least two of the three pairs would overlap in x; if
no horizontal one, at least two in y; so some pair would overlap in both. The two that are left have a cut of their own.
So the optimum is the best choice of two straight cuts, and the only windows that a rectangle must be known for are
strips across the pixel and windows in its four corners: tables of (n + 1)^2 entries, made in n^3 steps.

**Straight cuts** leave shapes of any form. The first cut leaves one part for one emitter, the second divides the rest;
each part takes its largest connected shape of the least width. A part that grows cannot lose area, so the best place of
a cut is where the two sides balance, and it is found by halving.

**Crooked borders** are searched for by moves that start from several such cuts.
"""

from __future__ import annotations

import bisect
import itertools
import math
import random
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass, replace
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from maskfab.base.arrays import Floats, Labels, Mask
from maskfab.display.emitter_rules import EmitterGrid
from maskfab.display.free_area import EVERY, Squares, border_margin, facing_squares, free_region

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


def window_table(regions: Mask, min_width: int, max_aspect: float = math.inf) -> WindowTable:
    """The largest rectangle in every strip and every corner window of ``regions``, bool [k, n, n]."""
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
    region: Mask, grid: EmitterGrid, ratio: Ratio, *, max_aspect: float = math.inf
) -> tuple[float, Labels]:
    """The three rectangles with the largest smallest area relative to the ratio; exact.

    At minimum width w, 0 proves that no three emitters of any shape fit: each would hold a w x w square.

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
    masks: Mask,
    grid: EmitterGrid,
    ratio: Ratio,
    *,
    orientations: Iterable[int] = EVERY,
    margin: int = 0,
    max_aspect: float = math.inf,
) -> Floats:
    """The footprint of the three largest rectangles behind each of many openings, for optimisers.

    Args:
        masks: bool [k, dots, dots] openings, True is clear.
        ratio: relative areas of red, green and blue, which sum to 3.
        orientations: those in use; they matter where the gap to an opening is wider than the gutter.

    Returns:
        float [k] mean share of the pixel, gutter included, per colour; of the smallest relative to its ratio.
    """
    used = tuple(orientations)
    areas = np.zeros(len(masks))
    for start in range(0, len(masks), _BATCH):
        part = slice(start, start + _BATCH)
        regions = free_region(masks[part], grid, used, margin=margin)
        table = window_table(regions, grid.min_width, max_aspect)
        for permutation in orders(ratio):
            for values, _ in _cuts(table, grid.cells, grid.colour_gap, tuple(ratio[k] for k in permutation)):
                np.maximum(areas[part], values.max(axis=(1, 2)), out=areas[part])
    return areas * (grid.cell_nm / grid.pitch_nm) ** 2


def orders(ratio: Ratio) -> list[tuple[int, ...]]:
    """The orders of the colours, those left out that differ only by colours of equal area."""
    seen: dict[tuple[float, ...], tuple[int, ...]] = {}
    for order in itertools.permutations(range(3)):
        seen.setdefault(tuple(ratio[k] for k in order), order)
    return list(seen.values())


def _cuts(
    table: WindowTable, n: int, gap: int, ratio: tuple[float, ...]
) -> Iterator[tuple[Floats, Callable[[int, int], tuple[Window, Window, Window]]]]:
    """Every pair of cuts: [k, i, j] smallest of three areas relative to the ratio, and the windows of cuts i, j."""
    left = n - gap + 1
    if left <= 0:
        return
    a, b, c = ratio
    columns, rows = table.columns, table.rows

    def least(first: NDArray[np.int16], second: NDArray[np.int16], third: NDArray[np.int16]) -> Floats:
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
                return (turned((0, n, *near), across), turned((0, j, *far), across), turned((j + gap, n, *far), across))

            yield least(single[..., None], lower, upper), windows


def _sides(length: int, n: int, min_width: int, max_aspect: float) -> tuple[int, int]:
    # The slack keeps a limit such as 1.4 from losing 7 x 5 to rounding.
    longest = n if math.isinf(max_aspect) else min(n, math.floor(max_aspect * length + 1e-9))
    shortest = 0 if math.isinf(max_aspect) else math.ceil(length / max_aspect - 1e-9)
    return max(min_width, shortest), longest if length >= min_width else -1


def _runs(regions: Mask, axis: int) -> NDArray[np.int16]:
    """Number of free cells in a row that end at each cell, along an axis."""
    runs = np.moveaxis(regions.astype(np.int16), axis, 0)
    for i in range(1, len(runs)):
        runs[i] += runs[i] * runs[i - 1]
    return np.moveaxis(runs, 0, axis)


def _strips(regions: Mask, min_width: int, max_aspect: float) -> NDArray[np.int16]:
    """[..., x0, x1] area of the largest rectangle between columns x0 and x1."""
    n = regions.shape[-1]
    # Columns first: the minimum over neighbouring columns then runs along whole rows of memory.
    runs = np.ascontiguousarray(np.moveaxis(_runs(regions, -2), -1, 0))
    heights = runs.copy()
    areas = np.zeros((*regions.shape[:-2], n + 1, n + 1), dtype=np.int16)
    diagonal = np.arange(n + 1)
    for width in range(1, n + 1):
        if width > 1:
            heights = np.minimum(heights[:-1], runs[width - 1 :])
        at, to = diagonal[: n + 1 - width], diagonal[width:]
        area = np.maximum(areas[..., at, to - 1], areas[..., at + 1, to])
        shortest, longest = _sides(width, n, min_width, max_aspect)
        if longest >= shortest:
            tallest = np.moveaxis(np.minimum(heights.max(axis=-1), longest), 0, -1)
            area = np.maximum(area, np.where(tallest >= shortest, tallest * np.int16(width), 0))
        areas[..., at, to] = area
    return areas


def _rectangles_ending(regions: Mask, min_width: int, max_aspect: float) -> NDArray[np.int16]:
    """[..., y, x] area of the largest rectangle whose upper right cell this is."""
    n = regions.shape[-1]
    runs = np.ascontiguousarray(np.moveaxis(_runs(regions, -1), -2, 0))
    widths = runs.copy()
    areas = np.zeros_like(runs)
    for height in range(1, n + 1):
        if height > 1:
            widths = np.minimum(widths[:-1], runs[height - 1 :])
        shortest, longest = _sides(height, n, min_width, max_aspect)
        if longest >= shortest:
            capped = np.minimum(widths, longest) if longest < n else widths
            area = capped * np.int16(height)
            area[capped < shortest] = 0
            np.maximum(areas[height - 1 :], area, out=areas[height - 1 :])
    return np.moveaxis(areas, 0, -2)


def _largest_in(region: Mask, window: Window, min_width: int, max_aspect: float) -> Window:
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


Shapes = tuple[int, int, int]
"""Squares of red, green and blue."""

_SHAPES_AT_HAND = 32
"""Shapes whose areas a search remembers: most moves leave one shape as it was."""


def guillotine(region: Mask, grid: EmitterGrid, ratio: Ratio) -> tuple[float, Labels]:
    """The best emitters of any shape with straight cuts between them.

    Returns:
        The least of area_k / ratio_k in cells (0 if three do not fit), and int8 [n, n] labels 1 to 3, trimmed to it.
    """
    squares = Squares.of(region, grid.min_width, grid.colour_gap)
    best, shapes = _Cuts(squares, ratio).best()
    return best, labelled(squares, trim(squares, shapes, ratio, best))


def polish(
    region: Mask,
    grid: EmitterGrid,
    ratio: Ratio,
    start: Labels | None = None,
    *,
    orientations: Iterable[int] | None = None,
    moves: int = 10_000,
    seed: int = 0,
    enough: float = math.inf,
) -> tuple[float, Labels]:
    """Emitters with crooked borders: one grows by a patch, the others give way and then grow wherever they can.

    Starts from the best cuts of each kind, and from ``start``. The same seed gives the same answer; the answer is never
    worse than any of the starts.

    Args:
        start: int8 [n, n] labels of a placement that keeps the rules, tried as well.
        orientations: those in use, if the emitters shall keep the gap to those of neighbouring pixels too; the
            region is then one without a margin.
        enough: stop once area_k / ratio_k has reached this for every colour.
    """
    squares = cut = Squares.of(region, grid.min_width, grid.colour_gap)
    margin = 0 if orientations is None else border_margin(grid)
    if orientations is not None and margin:
        squares = facing_squares(region, grid, orientations)
        n = grid.cells
        cut = replace(cut, free=cut.free & cut.window(margin, n - margin, margin, n - margin))
    starts = _Cuts(cut, ratio).each()
    if start is not None:
        a, b, c = (squares.largest(squares.among(start == k)) for k in (1, 2, 3))
        starts.append((_least(squares, (a, b, c), ratio), (a, b, c)))
    starts = sorted((s for s in starts if s[0] > 0), key=lambda s: -s[0])
    if not starts:
        return 0.0, np.zeros(region.shape, dtype=np.int8)
    best, shapes = starts[0]
    # The better a start, the longer it is worked on.
    weights = [0.6**i for i in range(len(starts))]
    for i, (_, first) in enumerate(starts):
        if best >= enough:
            break
        share = math.ceil(moves * weights[i] / sum(weights))
        value, candidate = _anneal(squares, ratio, first, share, random.Random(seed + i), enough)
        if value > best:
            best, shapes = value, candidate
    return best, labelled(squares, trim(squares, shapes, ratio, best))


def cut_triples(squares: Squares, least: float, most: int) -> Iterator[Shapes]:
    """The three largest shapes between two straight cuts, each at up to ``most`` places where all are large enough."""
    return _Cuts(squares, (1.0, 1.0, 1.0)).every(least, most)


def shaved(squares: Squares, shape: int, towards: tuple[float, float], count: int, target: int) -> int:
    """The shape less about ``count`` cells from one side, connected and of the least width; itself if it spares none.

    Args:
        towards: (y, x) direction of the side; the axis along which it is longer says which side, the other at which
            end of the side's outermost line to begin.
        count: cells to take off at most, more where the width asks for it.
    """
    ys, xs = np.nonzero(squares.picture(shape))
    y, x = (ys if towards[0] < 0 else -ys), (xs if towards[1] < 0 else -xs)
    order = np.lexsort((x, y) if abs(towards[0]) >= abs(towards[1]) else (y, x))
    while count > 0:
        left = np.zeros((squares.cells, squares.cells), dtype=np.bool_)
        left[ys[order[count:]], xs[order[count:]]] = True
        rest = squares.largest(squares.among(left))
        if rest and squares.area(rest) >= target:
            return rest
        count //= 2
    return shape


def _least(squares: Squares, shapes: Shapes, ratio: Ratio) -> float:
    return min(squares.area(shape) / part for shape, part in zip(shapes, ratio, strict=True))


def labelled(squares: Squares, shapes: Shapes) -> Labels:
    """Colours 1 to 3 of the cells that three shapes cover, int8 [n, n]; 0 for none."""
    labels = np.zeros((squares.cells, squares.cells), dtype=np.int8)
    for k, shape in enumerate(shapes):
        labels[squares.picture(shape)] = k + 1
    return labels


def proved_shapes(squares: Squares, labels: Labels) -> Shapes | None:
    """Squares of three colours of cells; None where these break a rule: they lie within the region, each cell within a
    square of its colour, and squares of two colours come no nearer than the gap."""
    if labels.dtype != np.int8 or labels.shape != (squares.cells, squares.cells):
        return None
    red, green, blue = shapes = [squares.among(labels == colour) for colour in (1, 2, 3)]
    if any(shape & ~squares.free for shape in shapes) or not np.array_equal(
        labels, labelled(squares, (red, green, blue))
    ):
        return None
    near = (
        squares.near(red) & (green | blue) or squares.near(green) & (red | blue) or squares.near(blue) & (red | green)
    )
    return None if near else (red, green, blue)


class _Cuts:
    """The largest shapes on the sides of straight cuts, each window looked at once."""

    def __init__(self, squares: Squares, ratio: Ratio) -> None:
        self.squares = squares
        self.ratio = ratio
        self._seen: dict[Window, tuple[int, int]] = {}

    def best(self) -> tuple[float, Shapes]:
        """The best over all cuts, and its shapes; 0 if there is none."""
        best, windows = 0.0, None
        for order in orders(self.ratio):
            for axis in (0, 1):
                for single_last in (False, True):
                    value, where = self._three(order, axis, single_last, (0, 1), best)
                    if value > best:
                        best, windows = value, where
        return (best, self._shapes(windows)) if windows else (0.0, (0, 0, 0))

    def each(self) -> list[tuple[float, Shapes]]:
        """The best of each kind of cut: direction of the first, side of the single emitter, direction of the second."""
        by_windows = {}
        for order in orders(self.ratio):
            for axis in (0, 1):
                for single_last in (False, True):
                    for second in (0, 1):
                        value, windows = self._three(order, axis, single_last, (second,), 0.0)
                        if windows:
                            by_windows[windows] = (value, self._shapes(windows))
        return list(by_windows.values())

    def every(self, least: float, most: int) -> Iterator[Shapes]:
        """Pairs of cuts whose three shapes have the least area each, thinned out to so many places per cut."""
        n = self.squares.cells

        def places(window: Window, axis: int) -> list[tuple[Window, Window]]:
            low, high = window[2 * axis] + 1, window[2 * axis + 1] - 1
            both = [_cut(window, axis, cut, self.squares.gap) for cut in range(low, high + 1)]

            def large(side: Window) -> bool:
                return self._area(side) >= least

            # A part that grows cannot lose area: both conditions hold on one side of some place.
            first = bisect.bisect_left(both, True, key=lambda sides: large(sides[0]))
            last = bisect.bisect_left(both, True, lo=first, key=lambda sides: not large(sides[1]))
            chosen = np.unique(np.linspace(first, last - 1, min(most, last - first)).round().astype(int))
            return [both[i] for i in chosen]

        for axis in (0, 1):
            for lower, upper in places((0, n, 0, n), axis):
                for alone, rest, seconds in ((lower, upper, (0, 1)), (upper, lower, (1 - axis,))):
                    for second in seconds:
                        for one, other in places(rest, second):
                            yield self._shapes((alone, one, other))

    def _largest(self, window: Window) -> tuple[int, int]:
        """The largest shape in a window, and its area."""
        if window not in self._seen:
            shape = self.squares.largest(self.squares.window(*window) & self.squares.free)
            self._seen[window] = shape, self.squares.area(shape)
        return self._seen[window]

    def _shapes(self, windows: tuple[Window, Window, Window]) -> Shapes:
        a, b, c = (self._largest(window)[0] for window in windows)
        return a, b, c

    def _area(self, window: Window) -> int:
        return self._largest(window)[1]

    def _three(
        self, order: tuple[int, ...], axis: int, single_last: bool, seconds: tuple[int, ...], above: float
    ) -> tuple[float, tuple[Window, Window, Window] | None]:
        """The best first cut along an axis, if it is better than ``above``; windows by colour."""
        n = self.squares.cells
        single, first, second = order
        whole = (0, n, 0, n)
        best, windows = above, None

        def sides(cut: int) -> tuple[float, float]:
            nonlocal best, windows
            lower, upper = _cut(whole, axis, cut, self.squares.gap)
            alone, rest = (upper, lower) if single_last else (lower, upper)
            one = self._area(alone) / self.ratio[single]
            if one <= best:
                return one, math.inf
            two, pair = 0.0, None
            for direction in seconds:
                value, where = self._two(rest, direction, self.ratio[first], self.ratio[second], max(best, two))
                if where:
                    two, pair = value, where
            if pair and min(one, two) > best:
                best = min(one, two)
                placed = {single: alone, first: pair[0], second: pair[1]}
                windows = placed[0], placed[1], placed[2]
            return one, two

        if single_last:
            _balance(1, n - 1, lambda cut: sides(cut)[::-1])
        else:
            _balance(1, n - 1, sides)
        return best, windows

    def _two(
        self, window: Window, axis: int, first: float, second: float, above: float
    ) -> tuple[float, tuple[Window, Window] | None]:
        best, windows = above, None

        def sides(cut: int) -> tuple[float, float]:
            nonlocal best, windows
            lower, upper = _cut(window, axis, cut, self.squares.gap)
            one = self._area(lower) / first
            if one <= best:
                return one, math.inf
            two = self._area(upper) / second
            if min(one, two) > best:
                best, windows = min(one, two), (lower, upper)
            return one, two

        low, high = window[2 * axis], window[2 * axis + 1]
        _balance(low + 1, high - 1, sides)
        return best, windows


def _cut(window: Window, axis: int, cut: int, gap: int) -> tuple[Window, Window]:
    y0, y1, x0, x1 = window
    if axis == 0:
        return (y0, cut, x0, x1), (min(cut + gap, y1), y1, x0, x1)
    return (y0, y1, x0, cut), (y0, y1, min(cut + gap, x1), x1)


def _balance(low: int, high: int, sides: Callable[[int], tuple[float, float]]) -> None:
    """Calls ``sides`` where the best smaller of (rising, falling) must be: at the crossing and one before it."""
    while low <= high:
        middle = (low + high) // 2
        rising, falling = sides(middle)
        if rising >= falling:
            high = middle - 1
        else:
            low = middle + 1


def _anneal(
    squares: Squares, ratio: Ratio, shapes: Shapes, moves: int, rng: random.Random, enough: float
) -> tuple[float, Shapes]:
    """Push and grow, with a temperature that falls from cells to a tenth of one."""
    area = lru_cache(_SHAPES_AT_HAND)(squares.area)
    state, near = _grown(squares, area, ratio, list(shapes), [squares.near(shape) for shape in shapes])
    areas = [area(shape) for shape in state]
    score = _score(areas, ratio)
    best, best_state = min(a / r for a, r in zip(areas, ratio, strict=True)), state
    hot = max(1.0, 0.06 * best)
    for move in range(moves):
        if best >= enough:
            break
        temperature = hot * (0.1 / hot) ** (move / moves)
        smallest = min(range(3), key=lambda k: areas[k] / ratio[k])
        grows = smallest if rng.random() < 0.7 else rng.randrange(3)
        pushed = _pushed(squares, state, near, grows, rng)
        if pushed is None:
            continue
        trial, new_near = _grown(squares, area, ratio, *pushed)
        new_areas = [area(shape) for shape in trial]
        new = _score(new_areas, ratio)
        if new >= score or rng.random() < math.exp((new - score) / temperature):
            state, near, areas, score = trial, new_near, new_areas, new
            least = min(a / r for a, r in zip(areas, ratio, strict=True))
            if least > best:
                best, best_state = least, state
    return best, (best_state[0], best_state[1], best_state[2])


def _score(areas: list[int], ratio: Ratio) -> float:
    """The smallest counts; what the larger ones have to spare breaks ties."""
    low, middle, high = sorted(a / r for a, r in zip(areas, ratio, strict=True))
    return low + 0.5 * middle + 0.5 * high


def _pushed(
    squares: Squares, state: list[int], near: list[int], grows: int, rng: random.Random
) -> tuple[list[int], list[int]] | None:
    """One shape takes a patch beside it; the others lose what is then too near, and their smaller pieces."""
    own = state[grows]
    border = squares.beside(own) & squares.free & ~own
    if not border:
        return None
    shift = rng.randrange(border.bit_length())
    above = border >> shift
    bit = (above & -above) << shift if above else border & -border
    patch = bit
    size = rng.choice((0, 0, 0, 0, 1, 2))
    if size:
        patch = squares.reach(bit, squares.around(bit, size) & squares.free)
    close = squares.near(patch)
    trial, new_near = list(state), list(near)
    # What is near to a union is the union of what is near to its parts.
    trial[grows], new_near[grows] = own | patch, near[grows] | close
    for k in range(3):
        if k != grows and state[k] & close:
            trial[k] = squares.without(state[k], close)
            if not trial[k]:
                return None
            new_near[k] = squares.near(trial[k])
    return trial, new_near


def _grown(
    squares: Squares, area: Callable[[int], int], ratio: Ratio, state: list[int], near: list[int]
) -> tuple[list[int], list[int]]:
    """Each shape, the smallest first, takes all that it can reach without coming too near to the others."""
    state, near = list(state), list(near)
    for k in sorted(range(3), key=lambda k: area(state[k]) / ratio[k]):
        grown = squares.reach(state[k], squares.free & ~(near[k - 1] | near[k - 2]))
        if grown != state[k]:
            near[k] |= squares.near(grown & ~state[k])
            state[k] = grown
    return state, near


def trim(squares: Squares, shapes: Shapes, ratio: Ratio, least: float) -> Shapes:
    """The shapes with what they have beyond ``least * ratio`` cells taken off, as far as their width allows."""
    a, b, c = (_trimmed_cells(squares, shape, least * part) for shape, part in zip(shapes, ratio, strict=True))
    return a, b, c


def _trimmed_cells(squares: Squares, shape: int, wanted: float) -> int:
    """Cells taken off the outermost rows and columns: whole ones, then parts of one, as many as can be."""
    target = math.ceil(wanted - 1e-9)
    area = squares.area(shape)
    while shape and area > target:
        smaller = min((_without_ends(squares, shape, side, target) for side in range(4)), key=squares.area)
        if squares.area(smaller) >= area:
            break
        shape, area = smaller, squares.area(smaller)
    return shape


def _without_ends(squares: Squares, shape: int, side: int, target: int) -> int:
    """The shape less as many cells as it can spare, in order from one side of the pixel."""
    cells = squares.picture(shape)
    ys, xs = np.nonzero(cells)
    major, minor = (ys, xs) if side % 2 == 0 else (xs, ys)
    order = np.lexsort((minor, major if side < 2 else -major))
    low, high, best = 1, len(order) - target, shape
    while low <= high:
        count = (low + high) // 2
        left = cells.copy()
        left[ys[order[:count]], xs[order[:count]]] = False
        rest = squares.largest(squares.among(left))
        if squares.area(rest) >= target:
            best, low = rest, count + 1
        else:
            high = count - 1
    return best
