"""Whether three emitters fit behind an opening, and which colour goes where so that random orientations show least.

Answers are what was found, what is proved impossible, and what is not known. An emitter pattern whose luminance
centroid lies off the pixel's centre moves the light about when pixels are turned at random, which the eye sees as
grain; its contrast grows with the centroid's distance from its mean over orientations.
"""

from __future__ import annotations

import bisect
import heapq
import math
from collections.abc import Callable, Iterable
from dataclasses import dataclass, replace
from functools import lru_cache
from itertools import permutations

import numpy as np

from maskfab.base.arrays import Labels, Mask
from maskfab.base.model import ORIENTATIONS, Emitters, Opening, orient, refined
from maskfab.base.units import NM_PER_UM
from maskfab.display.emitter_rules import Certificate, EmitterGrid, EmitterRules, Footprint, Proof, Verdict, grid_of
from maskfab.display.emitter_shapes import (
    Ratio,
    Shapes,
    cut_triples,
    guillotine,
    labelled,
    polish,
    proved_shapes,
    shaved,
    three_rectangles,
)
from maskfab.display.footprint_bound import upper_bound
from maskfab.display.free_area import Squares, border_margin, borders, facing_squares, free_region, three_facing_squares
from maskfab.display.kept_layouts import origin_of, shipped
from maskfab.optics.colour import LUMINANCE, luminance_centroid

_ROUNDING = 1e-9
_MOVES = 4_000
"""More find nothing larger on the shipped openings, and take three times as long."""


def footprint(
    opening: Opening,
    dot_nm: int,
    gutter_nm: int,
    orientations: Iterable[int],
    rules: EmitterRules,
    *,
    largest: bool = False,
) -> Footprint:
    """The largest three emitters that were found behind an opening, and a bound that none exceeds.

    It fits if a placement of the required footprint was found. It does not fit only if there is a proof: no three
    squares of the least width, or a bound below what is required. Else the answer is unknown, between the two numbers.
    Where the gap between colours is wider than the gutter, rectangles and straight cuts keep half the difference free
    along each side, which makes every neighbour legal; crooked borders and proofs do without that margin. Both hold for
    panels in which any two of the orientations meet, and for shapes on the grid's cells.

    Args:
        largest: work on the placement even if a smaller one answers the question.

    Raises:
        JobError: MF117 if a rule is wider than the pixel, MF118 if the grid is too fine.
    """
    grid = grid_of(opening, dot_nm, gutter_nm, rules)
    return _footprint(opening.mask.tobytes(), grid, tuple(orientations), rules, largest)


@lru_cache(maxsize=16)
def _footprint(dots: bytes, grid: EmitterGrid, used: tuple[int, ...], rules: EmitterRules, largest: bool) -> Footprint:
    """Answer about the dots of an opening; dies of one opening ask for the same."""
    mask = np.frombuffer(dots, np.bool_).reshape(grid.cells // grid.per_dot, -1)
    cell = (grid.cell_nm / grid.pitch_nm) ** 2
    needed = rules.required / cell
    margin = border_margin(grid)
    widest = free_region(mask, grid, used)
    region = free_region(mask, grid, used, margin=margin) if margin else widest
    rectangles, labels = three_rectangles(region, grid, rules.ratio, max_aspect=rules.max_aspect)
    method, kept = "rectangles", False
    best = rectangles
    if best == 0:
        none = three_squares(widest, grid)
        if none is None and margin:
            none, labels = _across_borders(widest, grid, used)
            best, method = min((labels == k + 1).sum() / rules.ratio[k] for k in range(3)), "three squares"
        if none is not None:
            return Footprint(Verdict.DOES_NOT_FIT, None, 0.0, 0.0, 0.0, none, "none")
    bound, certificate = upper_bound(widest, grid, rules.ratio, required=needed if needed > 0 else None)
    free, shapes = guillotine(region, grid, rules.ratio)
    if free > best:
        best, labels, method = free, shapes, "straight cuts"
    if 0 < best < bound and (largest or best < needed - _ROUNDING <= bound):
        enough = math.inf if largest else needed - _ROUNDING
        # With neighbours to look at, a move on a grid twice as fine takes four times as long.
        moves = round(_MOVES * min(1, (42 / grid.cells) ** 2)) if margin else _MOVES
        crooked, shapes, kept = _crooked(widest, grid, rules.ratio, labels, used, moves, enough)
        if crooked > best:
            best, labels, method = crooked, shapes, "crooked borders"
        else:
            kept = False
    # A bound may be computed by floating point: what was found is never above it.
    bound = max(bound, best)
    if best > 0 and best >= needed - _ROUNDING:
        verdict = Verdict.FITS
    elif bound < needed - _ROUNDING:
        verdict = Verdict.DOES_NOT_FIT
    else:
        verdict = Verdict.UNKNOWN
    placed = Emitters(labels, grid.cell_nm, kept) if best > 0 else None
    return Footprint(
        verdict, placed, best * cell, bound * cell, rectangles * cell, certificate, method if placed else "none"
    )


def _crooked(
    region: Mask, grid: EmitterGrid, ratio: Ratio, start: Labels, used: tuple[int, ...], moves: int, enough: float
) -> tuple[float, Labels, bool]:
    """Footprint in cells and labels of emitters with crooked borders, and whether they came with the program."""

    def cells(labels: Labels) -> float:
        return min(float((labels == k).sum()) / part for k, part in enumerate(ratio, start=1))

    def proved(labels: Labels) -> bool:
        squares = facing_squares(region, grid, used)
        shapes = proved_shapes(squares, labels)
        whole = shapes is not None and all(shape == squares.largest(shape) for shape in shapes)
        return whole and cells(labels) >= cells(start)

    def search() -> Labels:
        return polish(region, grid, ratio, start, orientations=used, moves=moves, enough=enough)[1]

    given = region, grid, ratio, start, used, moves, enough
    labels, kept = shipped().layout(origin_of("crooked borders", 1, *given), proved, search)
    assert labels is not None
    return cells(labels), labels, kept


@dataclass(frozen=True)
class LargestGap:
    """The widest gap between colours at which the required footprint is reached.

    Attributes:
        found_nm: widest at which a placement was found; None if it was not even at no gap.
        excluded_nm: narrowest at which it is proved impossible; None if it is not within the pixel.
    """

    found_nm: int | None
    excluded_nm: int | None
    footprint: Footprint | None


def largest_gap(
    opening: Opening, dot_nm: int, gutter_nm: int, orientations: Iterable[int], rules: EmitterRules
) -> LargestGap:
    """Widest gap between colours, by bisection: what fits at a gap fits at every narrower one."""
    used = tuple(orientations)
    step = math.gcd(dot_nm, gutter_nm, rules.gap_to_opening_nm, rules.min_width_nm)
    answers: dict[int, Footprint] = {}

    def answer(steps: int) -> Footprint:
        if steps not in answers:
            at = replace(rules, colour_gap_nm=steps * step)
            answers[steps] = footprint(opening, dot_nm, gutter_nm, used, at)
        return answers[steps]

    last = opening.dots * dot_nm // step
    fits = _last(last, lambda steps: answer(steps).verdict is Verdict.FITS)
    open_until = _last(last, lambda steps: answer(steps).verdict is not Verdict.DOES_NOT_FIT)
    return LargestGap(
        None if fits < 0 else fits * step,
        None if open_until == last else (open_until + 1) * step,
        None if fits < 0 else answer(fits),
    )


def three_squares(region: Mask, grid: EmitterGrid) -> Certificate | None:
    """A proof that no three emitters of any shape fit; None if three do. Exact.

    Each emitter holds a square of the least width, so three emitters fit exactly if three such squares do.
    """
    most, _ = three_rectangles(region, grid, (1.0, 1.0, 1.0))
    if most > 0:
        return None
    squares = Squares.of(region, grid.min_width, grid.colour_gap)
    placed = _two_squares(squares)
    w, gap, cell = (cells * grid.cell_nm / NM_PER_UM for cells in (grid.min_width, grid.colour_gap, 1))
    free = int(region.sum()) * cell**2
    count = placed.bit_count()
    most_fit = ("none fits", "one fits", "two fit")[count]
    return Certificate(
        Proof.NO_THREE_SQUARES,
        f"Every emitter holds a square of {w:g} um; of squares {gap:g} um apart in the {free:g} um^2 where emitters "
        f"may lie, {most_fit}, and three do not",
        {"squares": count, "width_um": w, "gap_um": gap, "free_um2": free},
        squares.picture(placed),
        grid.cell_nm,
    )


def _across_borders(
    region: Mask, grid: EmitterGrid, orientations: tuple[int, ...]
) -> tuple[Certificate | None, Labels]:
    """Three squares that keep the gap to all neighbours without a margin, or a proof that there are none."""
    squares = facing_squares(region, grid, orientations)
    placed = three_facing_squares(squares)
    labels = labelled(squares, placed or (0, 0, 0))
    if placed is None or any(placed):
        return None, labels
    w, gap = (cells * grid.cell_nm / NM_PER_UM for cells in (grid.min_width, grid.colour_gap))
    gutter = grid.gutter_nm / NM_PER_UM
    return (
        Certificate(
            Proof.BORDER_PAIR,
            f"Every emitter holds one of the {squares.free.bit_count()} squares of {w:g} um where emitters may lie; no "
            f"three of these are {gap:g} um apart both within the pixel and, across its gutter of {gutter:g} um, from "
            "the neighbours in every orientation",
            {"squares": squares.free.bit_count(), "width_um": w, "gap_um": gap, "gutter_um": gutter},
            squares.picture(squares.free),
            grid.cell_nm,
        ),
        labels,
    )


def _two_squares(squares: Squares) -> int:
    """As many squares as fit at the gap, up to two."""
    ys, xs = squares.places()
    for along in (ys, xs):
        if len(along) and np.ptp(along) >= squares.width + squares.gap:
            return sum(1 << int(ys[i]) * squares.stride + int(xs[i]) for i in (along.argmin(), along.argmax()))
    return squares.free & -squares.free


def _last(last: int, holds: Callable[[int], bool]) -> int:
    """The last of 0 to ``last`` for which it holds, if it holds up to there and not beyond; -1 if for none."""
    return bisect.bisect_left(range(last + 1), True, key=lambda steps: not holds(steps)) - 1


_PLACES = 12
"""Places of each cut that are looked at; more makes no centroid better by what can be seen."""
_TRIMMED = 3
"""Placements trimmed to each footprint: so many of the best as they are, and of those that trimming could make best."""
_REACHED = 0.7
"""Of the way that trimming could move the light if it all went one way, as much as it usually does."""
_ROUNDS = 4
"""In each, every colour loses half of what it has to lose, on the side to which the light then leans."""
_DIGITS = 3
"""Of a centroid in pixels; differences below make no grain that is seen, so that the larger area is chosen."""


def wander(emitters: Emitters, pitch_nm: int, elements: Iterable[int] = range(ORIENTATIONS)) -> float:
    """Root mean square distance of the centroid from its mean over equally likely orientations, in pixels."""
    places = np.array(
        [luminance_centroid(Emitters(orient(emitters.labels, k), emitters.cell_nm), pitch_nm) for k in elements]
    )
    return float(np.sqrt(((places - places.mean(axis=0)) ** 2).sum(axis=1).mean()))


def centred(
    largest: Emitters | None,
    opening: Opening,
    grid: EmitterGrid,
    orientations: Labels,
    rules: EmitterRules,
    *,
    keep: float,
) -> Emitters | None:
    """The placement, among those with enough area, with the luminance centroid nearest to the pixel's centre.

    Looked at are the one found and those that two straight cuts leave, in all colour orders that the ratio allows,
    trimmed to the ratio on the side to which the light leans. Centroids that differ by less than 0.001 pixel are equal;
    of these the larger placement is chosen.

    Args:
        keep: share of the footprint found that must be left, 0 to 1.
    """
    if largest is None:
        return None
    ratio = rules.ratio
    best = min(float((largest.labels == k + 1).sum()) / ratio[k] for k in range(3))
    if best <= 0:
        return largest
    required = rules.required * (grid.pitch_nm / grid.cell_nm) ** 2
    least = max(min(keep, 1.0) * best, min(best, required))
    used = tuple(int(k) for k in np.unique(orientations % ORIENTATIONS))
    region = free_region(opening.mask, grid, used, margin=border_margin(grid))
    light = _Light(Squares.of(region, grid.min_width, grid.colour_gap), grid, ratio)
    red, green, blue = (light.squares.largest(light.squares.among(largest.labels == k)) for k in (1, 2, 3))
    triples = [(red, green, blue), *cut_triples(light.squares, least * min(ratio), _PLACES)]
    levels = sorted({best, (best + least) / 2, least}, reverse=True)
    candidates = [light.trimmed(shapes, level) for level in levels for shapes in light.most_promising(triples, level)]
    clear = refined(opening.mask, grid.per_dot)
    offset = round(math.hypot(*luminance_centroid(largest, grid.pitch_nm)), _DIGITS)
    keyed = [(*light.key(shapes), shapes) for shapes in candidates if light.footprint(shapes) >= least - 1e-9]
    for distance, area, shapes in sorted(keyed, key=lambda candidate: candidate[:2]):
        if (distance, area) >= (offset, -best):
            break
        labels = labelled(light.squares, shapes)
        if borders(labels, clear, grid, orientations).legal:
            return Emitters(labels, grid.cell_nm)
    return largest


class _Light:
    """Where the light of three shapes, in the order red, green, blue, comes from; each shape measured once."""

    def __init__(self, squares: Squares, grid: EmitterGrid, ratio: Ratio) -> None:
        self.squares = squares
        self.grid = grid
        self.ratio = ratio
        self._measured: dict[int, tuple[int, float, float, float]] = {}

    def measured(self, shape: int) -> tuple[int, float, float, float]:
        """Cells, centroid (y, x) off the pixel's centre in pixels, and extent in pixels."""
        if shape not in self._measured:
            cells = self.squares.picture(shape)
            rows, columns = cells.sum(axis=1), cells.sum(axis=0)
            area = int(rows.sum())
            along = np.arange(self.grid.cells) + 0.5 - self.grid.cells / 2
            unit = self.grid.cell_nm / self.grid.pitch_nm
            y, x = (float(along @ line) / max(area, 1) * unit for line in (rows, columns))
            extent = max(np.count_nonzero(rows), np.count_nonzero(columns)) * unit
            self._measured[shape] = area, y, x, extent
        return self._measured[shape]

    def centroid(self, shapes: Shapes) -> tuple[float, float]:
        """(y, x) of the light off the pixel's centre, in pixels."""
        places = [self.measured(shape) for shape in shapes]
        y, x = (
            sum(share * place[axis] for share, place in zip(LUMINANCE.tolist(), places, strict=True)) for axis in (1, 2)
        )
        return y, x

    def footprint(self, shapes: Shapes) -> float:
        return min(self.measured(shape)[0] / part for shape, part in zip(shapes, self.ratio, strict=True))

    def key(self, shapes: Shapes) -> tuple[float, float]:
        """Lower is better."""
        return round(math.hypot(*self.centroid(shapes)), _DIGITS), -self.footprint(shapes)

    def most_promising(self, triples: list[Shapes], least: float) -> list[Shapes]:
        """The best few triples, in any colour order, by how near to the centre trimming could bring the light."""
        unique = list(dict.fromkeys(triples))
        measures = np.array([[self.measured(shape) for shape in shapes] for shapes in unique])
        shares, ratio = LUMINANCE, np.array(self.ratio)
        chosen: dict[Shapes, None] = {}
        for part in (0.0, _REACHED):
            keys: list[tuple[float, int, tuple[int, ...]]] = []
            for order in permutations(range(3)):
                area, y, x, extent = np.moveaxis(measures[:, order], -1, 0)
                # A fraction cut off one end moves the middle by half as much of the length.
                reach = (np.maximum(1 - least * ratio / area, 0) * extent / 2) @ shares
                left = np.hypot(y @ shares, x @ shares) - part * reach
                fits = np.flatnonzero((area >= least * ratio - 1e-9).all(axis=1))
                keys.extend((round(float(left[i]), 9), int(i), order) for i in fits)
            for _, i, order in heapq.nsmallest(_TRIMMED, keys):
                chosen[unique[i][order[0]], unique[i][order[1]], unique[i][order[2]]] = None
        return list(chosen)

    def trimmed(self, shapes: Shapes, level: float) -> Shapes:
        """The shapes without what they have beyond a footprint, so that the light comes to the centre."""
        placed = list(shapes)
        targets = [math.ceil(level * part - 1e-9) for part in self.ratio]
        for left in reversed(range(_ROUNDS)):
            # The colour with the most light first: what is left is for the finer steps of the others.
            for k in (1, 0, 2):
                spare = self.measured(placed[k])[0] - targets[k]
                count = spare if left == 0 else -(-spare // 2)
                y, x = self.centroid((placed[0], placed[1], placed[2]))
                for towards in ((y, x), self._other(y, x), (-y, -x), self._other(-y, -x)):
                    if count <= 0:
                        break
                    before = self.measured(placed[k])[0]
                    placed[k] = shaved(self.squares, placed[k], towards, count, targets[k])
                    count -= before - self.measured(placed[k])[0]
                    if left:
                        break
        return placed[0], placed[1], placed[2]

    @staticmethod
    def _other(y: float, x: float) -> tuple[float, float]:
        """The one of the sides across that the light leans to."""
        return math.copysign(abs(x), y), math.copysign(abs(y), x)
