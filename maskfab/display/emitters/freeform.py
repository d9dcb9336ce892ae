"""Three emitters of any shape: the best that two straight cuts leave, then moves of crooked borders.

The first cut leaves one part for one emitter, the second divides the rest; each part takes its largest connected shape
of the least width. A part that grows cannot lose area, so the best place of a cut is where the two sides balance, and
it is found by halving. A search over crooked borders then starts from several such cuts.
"""

from __future__ import annotations

import bisect
import math
import random
from collections.abc import Callable, Iterable, Iterator
from dataclasses import replace
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from maskfab.display.emitters.across_borders import border_margin, facing_squares
from maskfab.display.emitters.emitter_rules import EmitterGrid
from maskfab.display.emitters.rectangles import Ratio, Window, orders
from maskfab.display.emitters.squares import Squares

Shapes = tuple[int, int, int]
"""Squares of red, green and blue."""

_SHAPES_AT_HAND = 32
"""Shapes whose areas a search remembers: most moves leave one shape as it was."""


def guillotine(region: NDArray[np.bool_], grid: EmitterGrid, ratio: Ratio) -> tuple[float, NDArray[np.int8]]:
    """The best emitters of any shape with straight cuts between them.

    Args:
        region: bool [n, n] cells in which an emitter may lie.
        grid: the gap between colours and the least width, in cells.
        ratio: relative areas of red, green and blue.

    Returns:
        The least of area_k / ratio_k in cells (0 if three do not fit), and int8 [n, n] labels 1 to 3, trimmed to it.
    """
    squares = Squares.of(region, grid.min_width, grid.colour_gap)
    best, shapes = _Cuts(squares, ratio).best()
    return best, _labels(squares, trim(squares, shapes, ratio, best))


def polish(
    region: NDArray[np.bool_],
    grid: EmitterGrid,
    ratio: Ratio,
    start: NDArray[np.int8] | None = None,
    *,
    orientations: Iterable[int] | None = None,
    moves: int = 10_000,
    seed: int = 0,
    enough: float = math.inf,
) -> tuple[float, NDArray[np.int8]]:
    """Emitters with crooked borders: one grows by a patch, the others give way and then grow wherever they can.

    Starts from the best cuts of each kind, and from ``start``. The same seed gives the same answer; the answer is never
    worse than any of the starts.

    Args:
        region, grid, ratio: as for ``guillotine``.
        start: int8 [n, n] labels of a placement that keeps the rules, tried as well.
        orientations: those in use, if the emitters shall keep the gap to those of neighbouring pixels too; the
            region is then one without a margin.
        moves: in all; shared between the starts.
        seed: of the random patches.
        enough: stop once area_k / ratio_k has reached this for every colour.

    Returns:
        As ``guillotine``.
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
        found, candidate = _anneal(squares, ratio, first, share, random.Random(seed + i), enough)
        if found > best:
            best, shapes = found, candidate
    return best, _labels(squares, trim(squares, shapes, ratio, best))


def cut_triples(squares: Squares, least: float, most: int) -> Iterator[Shapes]:
    """The three largest shapes between two straight cuts, for every place of both cuts that leaves each large enough.

    Args:
        squares: of the region in which an emitter may lie.
        least: cells that each shape must have.
        most: places of each cut that are tried, evenly over those that are large enough.
    """
    return _Cuts(squares, (1.0, 1.0, 1.0)).every(least, most)


def shaved(squares: Squares, shape: int, towards: tuple[float, float], count: int, target: int) -> int:
    """The shape less about ``count`` cells from one side, connected and of the least width; itself if it spares none.

    Args:
        squares: any with the width and the cells of the shape's.
        shape: squares of one emitter.
        towards: (y, x) direction of the side; the axis along which it is longer says which side, the other at which
            end of the side's outermost line to begin.
        count: cells to take off at most, more where the width asks for it.
        target: cells that must be left.
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


def _labels(squares: Squares, shapes: Shapes) -> NDArray[np.int8]:
    labels = np.zeros((squares.cells, squares.cells), dtype=np.int8)
    for k, shape in enumerate(shapes):
        labels[squares.picture(shape)] = k + 1
    return labels


class _Cuts:
    """The largest shapes on the sides of straight cuts, each window looked at once."""

    def __init__(self, squares: Squares, ratio: Ratio) -> None:
        self.squares = squares
        self.ratio = ratio
        self._areas: dict[Window, int] = {}

    def best(self) -> tuple[float, Shapes]:
        """The best over all cuts, and its shapes; 0 if there is none."""
        best, windows = 0.0, None
        for order in orders(self.ratio):
            for axis in (0, 1):
                for single_last in (False, True):
                    found, where = self._three(order, axis, single_last, (0, 1), best)
                    if found > best:
                        best, windows = found, where
        return (best, self._shapes(windows)) if windows else (0.0, (0, 0, 0))

    def each(self) -> list[tuple[float, Shapes]]:
        """The best of each kind of cut: direction of the first, side of the single emitter, direction of the second."""
        found = {}
        for order in orders(self.ratio):
            for axis in (0, 1):
                for single_last in (False, True):
                    for second in (0, 1):
                        value, windows = self._three(order, axis, single_last, (second,), 0.0)
                        if windows:
                            found[windows] = (value, self._shapes(windows))
        return list(found.values())

    def every(self, least: float, most: int) -> Iterator[Shapes]:
        """All pairs of cuts whose three shapes have the least area each, thinned out to so many places per cut."""
        n = self.squares.cells
        seen: dict[Window, int] = {}

        def shape(window: Window) -> int:
            if window not in seen:
                seen[window] = self.squares.largest(self.squares.window(*window) & self.squares.free)
                self._areas[window] = self.squares.area(seen[window])
            return seen[window]

        def places(window: Window, axis: int) -> list[tuple[Window, Window]]:
            low, high = window[2 * axis] + 1, window[2 * axis + 1] - 1
            both = [_cut(window, axis, cut, self.squares.gap) for cut in range(low, high + 1)]

            def large(side: Window) -> bool:
                shape(side)
                return self._areas[side] >= least

            # A part that grows cannot lose area: both conditions hold on one side of some place.
            first = bisect.bisect_left(both, True, key=lambda each: large(each[0]))
            last = bisect.bisect_left(both, True, lo=first, key=lambda each: not large(each[1]))
            kept = np.unique(np.linspace(first, last - 1, min(most, last - first)).round().astype(int))
            return [both[i] for i in kept]

        for axis in (0, 1):
            for lower, upper in places((0, n, 0, n), axis):
                for alone, rest, seconds in ((lower, upper, (0, 1)), (upper, lower, (1 - axis,))):
                    for second in seconds:
                        for one, other in places(rest, second):
                            yield shape(alone), shape(one), shape(other)

    def _shapes(self, windows: tuple[Window, Window, Window]) -> Shapes:
        a, b, c = (self.squares.largest(self.squares.window(*window) & self.squares.free) for window in windows)
        return a, b, c

    def _area(self, window: Window) -> int:
        area = self._areas.get(window)
        if area is None:
            squares = self.squares
            area = self._areas[window] = squares.area(squares.largest(squares.window(*window) & squares.free))
        return area

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
    best, kept = min(a / r for a, r in zip(areas, ratio, strict=True)), state
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
                best, kept = least, state
    return best, (kept[0], kept[1], kept[2])


def _score(areas: list[int], ratio: Ratio) -> float:
    """The smallest counts; what the larger ones have to spare breaks ties."""
    low, middle, high = sorted(a / r for a, r in zip(areas, ratio, strict=True))
    return low + 0.5 * middle + 0.5 * high


def _pushed(
    squares: Squares, state: list[int], near: list[int], grows: int, rng: random.Random
) -> tuple[list[int], list[int]] | None:
    """One shape takes a patch beside it; the others lose what is then too near, and their smaller pieces.

    Args:
        near: what lies too near to each shape; returned for the new ones.
    """
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
    """Each shape, the smallest first, takes all that it can reach without coming too near to the others.

    Args:
        area: of a shape in cells.
        near: what lies too near to each shape; returned for the new ones.
    """
    state, near = list(state), list(near)
    for k in sorted(range(3), key=lambda k: area(state[k]) / ratio[k]):
        grown = squares.reach(state[k], squares.free & ~(near[k - 1] | near[k - 2]))
        if grown != state[k]:
            near[k] |= squares.near(grown & ~state[k])
            state[k] = grown
    return state, near


def trim(squares: Squares, shapes: Shapes, ratio: Ratio, least: float) -> Shapes:
    """The shapes with what they have beyond ``least * ratio`` cells taken off, as far as their width allows."""
    a, b, c = (_trimmed(squares, shape, least * part) for shape, part in zip(shapes, ratio, strict=True))
    return a, b, c


def _trimmed(squares: Squares, shape: int, wanted: float) -> int:
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
