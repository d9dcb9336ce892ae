"""Whether three emitters fit behind an opening: what was found, what is proved impossible, and what is not known."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from maskfab.display.emitters.across_borders import border_margin, facing_squares, three_facing_squares
from maskfab.display.emitters.bound import upper_bound
from maskfab.display.emitters.emitter_rules import EmitterGrid, EmitterRules, grid_of
from maskfab.display.emitters.free_area import free_region
from maskfab.display.emitters.freeform import guillotine, polish
from maskfab.display.emitters.placement import Certificate, Footprint, Proof, Verdict
from maskfab.display.emitters.rectangles import three_rectangles
from maskfab.display.emitters.squares import Squares
from maskfab.model import Emitters, Opening
from maskfab.units import NM_PER_UM

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
    seed: int = 0,
) -> Footprint:
    """The largest three emitters that were found behind an opening, and a bound that none exceeds.

    It fits if a placement of the required footprint was found. It does not fit only if there is a proof: no three
    squares of the least width, or a bound below what is required. Else the answer is unknown, between the two numbers.
    Where the gap between colours is wider than the gutter, rectangles and straight cuts keep half the difference free
    along each side, which makes every neighbour legal; crooked borders and proofs do without that margin. Both hold for
    panels in which any two of the orientations meet, and for shapes on the grid's cells.

    Args:
        opening: the pixel's opening.
        dot_nm, gutter_nm: as laid out.
        orientations: those in use.
        rules: the maker's; ``required`` decides the verdict.
        largest: work on the placement even if a smaller one answers the question.
        seed: of the search over crooked borders; the same seed gives the same placement.

    Raises:
        JobError: MF117 if a rule is wider than the pixel, MF118 if the grid is too fine.
    """
    grid = grid_of(opening, dot_nm, gutter_nm, rules)
    used = tuple(orientations)
    cell = (grid.cell_nm / grid.pitch_nm) ** 2
    needed = rules.required / cell
    margin = border_margin(grid)
    widest = free_region(opening.mask, grid, used)
    region = free_region(opening.mask, grid, used, margin=margin) if margin else widest
    rectangles, labels = three_rectangles(region, grid, rules.ratio, max_aspect=rules.max_aspect)
    method = "rectangles"
    found = rectangles
    if found == 0:
        none = three_squares(widest, grid)
        if none is None and margin:
            none, labels = _across_borders(widest, grid, used)
            found, method = min((labels == k + 1).sum() / rules.ratio[k] for k in range(3)), "three squares"
        if none is not None:
            return Footprint(Verdict.DOES_NOT_FIT, None, 0.0, 0.0, 0.0, none, "none")
    bound, certificate = upper_bound(widest, grid, rules.ratio, required=needed if needed > 0 else None)
    free, shapes = guillotine(region, grid, rules.ratio)
    if free > found:
        found, labels, method = free, shapes, "straight cuts"
    if 0 < found < bound and (largest or found < needed - _ROUNDING <= bound):
        enough = math.inf if largest else needed - _ROUNDING
        # With neighbours to look at, a move on a grid twice as fine takes four times as long.
        moves = round(_MOVES * min(1, (42 / grid.cells) ** 2)) if margin else _MOVES
        crooked, shapes = polish(
            widest, grid, rules.ratio, labels, orientations=used, moves=moves, seed=seed, enough=enough
        )
        if crooked > found:
            found, labels, method = crooked, shapes, "crooked borders"
    # A bound may be computed by floating point: what was found is never above it.
    bound = max(bound, found)
    if found > 0 and found >= needed - _ROUNDING:
        verdict = Verdict.FITS
    elif bound < needed - _ROUNDING:
        verdict = Verdict.DOES_NOT_FIT
    else:
        verdict = Verdict.UNKNOWN
    placed = Emitters(labels, grid.cell_nm) if found > 0 else None
    return Footprint(
        verdict, placed, found * cell, bound * cell, rectangles * cell, certificate, method if placed else "none"
    )


@dataclass(frozen=True)
class LargestGap:
    """The widest gap between colours at which the required footprint is reached.

    Attributes:
        found_nm: widest at which a placement was found; None if it was not even at no gap.
        excluded_nm: narrowest at which it is proved impossible; None if it is not within the pixel.
        footprint: at ``found_nm``.
    """

    found_nm: int | None
    excluded_nm: int | None
    footprint: Footprint | None


def largest_gap(
    opening: Opening,
    dot_nm: int,
    gutter_nm: int,
    orientations: Iterable[int],
    rules: EmitterRules,
    *,
    step_nm: int | None = None,
    seed: int = 0,
) -> LargestGap:
    """Widest gap between colours, by bisection: what fits at a gap fits at every narrower one.

    Args:
        opening, dot_nm, gutter_nm, orientations, rules: as for ``footprint``; the rules' colour gap is not used.
        step_nm: of the gaps tried; by default the largest on which the other rules are whole numbers.
        seed: as for ``footprint``.

    Raises:
        JobError: as ``footprint``.
    """
    used = tuple(orientations)
    step = step_nm or math.gcd(dot_nm, gutter_nm, rules.gap_to_opening_nm, rules.min_width_nm)
    answers: dict[int, Footprint] = {}

    def answer(steps: int) -> Footprint:
        if steps not in answers:
            at = replace(rules, colour_gap_nm=steps * step)
            answers[steps] = footprint(opening, dot_nm, gutter_nm, used, at, seed=seed)
        return answers[steps]

    last = opening.dots * dot_nm // step
    fits = _last(last, lambda steps: answer(steps).verdict is Verdict.FITS)
    open_until = _last(last, lambda steps: answer(steps).verdict is not Verdict.DOES_NOT_FIT)
    return LargestGap(
        None if fits < 0 else fits * step,
        None if open_until == last else (open_until + 1) * step,
        None if fits < 0 else answer(fits),
    )


def three_squares(region: NDArray[np.bool_], grid: EmitterGrid) -> Certificate | None:
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
    region: NDArray[np.bool_], grid: EmitterGrid, orientations: tuple[int, ...]
) -> tuple[Certificate | None, NDArray[np.int8]]:
    """Three squares that keep the gap to all neighbours without a margin, or a proof that there are none."""
    labels = np.zeros(region.shape, dtype=np.int8)
    squares = facing_squares(region, grid, orientations)
    placed = three_facing_squares(squares)
    if placed is None:
        return None, labels
    if any(placed):
        for k, square in enumerate(placed):
            labels[squares.picture(square)] = k + 1
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
    low, high = -1, last
    while low < high:
        middle = (low + high + 1) // 2
        if holds(middle):
            low = middle
        else:
            high = middle - 1
    return low
