"""The nearest lengths of a display that lie on one grid: its pitch, its dots, and the rules of its emitters.

Emitters are placed on square cells, at most 128 along a pixel, of which dots, gutter and rules are whole numbers. Where
those that are stated share no such cells, all are moved at once: the pitch to the nearest, least lengths upwards, so
that what keeps the moved rules keeps the stated ones.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass

from maskfab.base.cell_size import MOST_CELLS, CellSize
from maskfab.base.errors import JobError
from maskfab.base.units import NM_PER_UM, UM_PER_NM
from maskfab.job.camera import Camera

FEWEST_DOTS, _USUAL_DOTS, _MOST_DOTS = 16, 22, 64
"""Along a pixel: fewer draw no shape that restores well, more cost time; shipped displays have 21."""
_FEWEST_ACROSS, _FEWEST_LAGS = 64, 32
"""Dots across the stop, and dots of lag to one cycle per pixel, that photographs are judged through."""
_STEP_NM, _DOT_STEP_NM = 50, 10
"""Cells are whole steps, unless the lengths share another grid: plotters' address grids divide them. Dots whose number
is given move by smaller ones."""
_MOST_PITCH_MOVE, _MOST_RAISE = 0.01, 0.1
_FINER, _NEAR_PITCH = 1.25, 0.02
"""Times as many dots from which on a grid is told as a finer one, and the most that the pitch would move to it."""


@dataclass(frozen=True)
class Grid:
    """Lengths that are whole numbers of cells, in the order in which they were given."""

    dots: int
    cell_nm: int
    pitch_nm: int
    gutter_nm: int
    rules_nm: tuple[int, ...]

    @property
    def dot_nm(self) -> int:
        """Side of a dot."""
        return (self.pitch_nm - self.gutter_nm) // self.dots


def widest_dot_nm(camera: Camera, lines_nm: Sequence[float]) -> float:
    """The widest dots that photographs of a camera can be judged through."""
    lag_um = min(lines_nm) * UM_PER_NM * camera.focal_um / camera.pixel_um
    return min(camera.stop.diameter_um / _FEWEST_ACROSS, lag_um / _FEWEST_LAGS) * NM_PER_UM


def nearest_grid(
    pitch_nm: int, rules_nm: Sequence[int], *, dots: int | None = None, gutter_nm: int = 0, widest_nm: float = math.inf
) -> Grid | None:
    """The best grid of at most 128 cells along a pixel; None where dots cannot be so fine.

    Lengths that share a grid stay as they are. Otherwise the pitch moves by at most 1 %, and a rule grows by at most a
    tenth or a hundredth of the pitch, where that can be. Of the grids that do so the best has the least sum of: cells
    over 128, for time; |ln(dots / 22)|, for finer dots help a display to fit and coarser ones are fast; and fifty times
    the share of the pitch by which all lengths move together, so that 1 % weighs half as much as the finest grid
    against a pixel of no cells.

    Args:
        dots: along the pixel, if they are given; 16 to 64 are looked at otherwise.
        gutter_nm: as stated; it grows as a rule does.
    """
    asked = Grid(dots or 0, 0, pitch_nm, gutter_nm, tuple(rules_nm))
    nearest = min(_grids(asked, widest_nm), key=lambda grid: _cost(grid, asked), default=None)
    if nearest is None or dots is not None:
        return nearest
    # Lengths that have moved may share a better grid yet, which they would be given if they were stated.
    again = Grid(0, 0, nearest.pitch_nm, nearest.gutter_nm, nearest.rules_nm)
    return min(_grids(again, widest_nm), key=lambda grid: _cost(grid, again))


def finer_grid(pitch_nm: int, rules_nm: Sequence[int], found: Grid, *, widest_nm: float = math.inf) -> Grid | None:
    """Of grids with a quarter more dots than was found at least, which lengths that are near are given when they are
    asked for instead, the best of those that move the fewest lengths; None where there is none. Arguments as of
    :func:`nearest_grid`."""
    asked, least = Grid(0, 0, pitch_nm, 0, tuple(rules_nm)), _FINER * found.dots

    def order(grid: Grid) -> tuple[int, float]:
        return sum(by > 0 for by in _moved(grid, asked)), _cost(grid, asked)[2]

    near = [grid for grid in _grids(asked, widest_nm) if grid.dots >= least and not _far(grid, asked, _NEAR_PITCH)]
    given = (nearest_grid(grid.pitch_nm, grid.rules_nm, widest_nm=widest_nm) for grid in sorted(near, key=order))
    return next((grid for grid in given if grid in near), None)


def _grids(asked: Grid, widest_nm: float) -> Iterator[Grid]:
    finest = math.ceil(asked.pitch_nm / (MOST_CELLS + 0.5))
    shared = math.gcd(asked.pitch_nm, asked.gutter_nm, *asked.rules_nm)
    if asked.dots:
        yield from _of_dots(asked) if asked.rules_nm else [_without_rules(asked)]
        return
    steps = range(-(-finest // _STEP_NM) * _STEP_NM, asked.pitch_nm // FEWEST_DOTS + _STEP_NM, _STEP_NM)
    for cell in sorted({*steps, *(shared // n for n in range(1, shared // finest + 1) if shared % n == 0)}):
        gutter = -(-asked.gutter_nm // cell)
        cells = round(asked.pitch_nm / cell)
        for dots in range(FEWEST_DOTS, min(_MOST_DOTS, cells) + 1):
            if cells <= MOST_CELLS and (cells - gutter) % dots == 0 and (cells - gutter) * cell <= dots * widest_nm:
                yield _on(cell, asked, dots, cells * cell)


def _of_dots(asked: Grid) -> Iterator[Grid]:
    side = (asked.pitch_nm - asked.gutter_nm) / asked.dots
    near = range(math.floor(side * 0.95 / _DOT_STEP_NM), math.ceil(side * 1.05 / _DOT_STEP_NM) + 1)
    for dot in sorted({max(1, round(side)), *(step * _DOT_STEP_NM for step in near if step > 0)}):
        for parts in range(1, max(1, MOST_CELLS // asked.dots) + 1):
            if dot % parts == 0:
                cell = dot // parts
                gutter = -(-asked.gutter_nm // cell) * cell
                if gutter % 2 == 0:
                    yield _on(cell, asked, asked.dots, asked.dots * dot + gutter)


def _without_rules(asked: Grid) -> Grid:
    dot = max(1, round((asked.pitch_nm - asked.gutter_nm) / asked.dots))
    return Grid(asked.dots, dot, asked.dots * dot + asked.gutter_nm, asked.gutter_nm, ())


def _on(cell: int, asked: Grid, dots: int, pitch_nm: int) -> Grid:
    gutter, *rules = (-(-length // cell) * cell for length in (asked.gutter_nm, *asked.rules_nm))
    return Grid(dots, cell, pitch_nm, gutter, tuple(rules))


def _moved(grid: Grid, asked: Grid) -> list[int]:
    """By how much the pitch moves, and then every least length."""
    more = zip((grid.gutter_nm, *grid.rules_nm), (asked.gutter_nm, *asked.rules_nm), strict=True)
    return [abs(grid.pitch_nm - asked.pitch_nm), *(got - was for got, was in more)]


def _far(grid: Grid, asked: Grid, most_move: float = _MOST_PITCH_MOVE) -> bool:
    by, *more = _moved(grid, asked)
    most = (max(_MOST_RAISE * was, asked.pitch_nm / 100) for was in (asked.gutter_nm, *asked.rules_nm))
    return by > most_move * asked.pitch_nm or any(one > limit for one, limit in zip(more, most, strict=True))


def _cost(grid: Grid, asked: Grid) -> tuple[bool, bool, float]:
    by = sum(_moved(grid, asked))
    size = grid.pitch_nm / grid.cell_nm / MOST_CELLS + abs(math.log(grid.dots / _USUAL_DOTS))
    return by > 0, _far(grid, asked), size + 50 * by / asked.pitch_nm


def check_grid(
    pitch_um: float,
    dots: int,
    dot_nm: int | None,
    gutter_nm: int,
    rules_um: Mapping[str, float],
    *,
    key: str,
    dots_given: bool,
    widest_nm: float = math.inf,
    also: Sequence[str] = (),
    where: str,
) -> None:
    """Refuse lengths of a pixel and its emitters that share no grid of at most 128 cells, all of them at once.

    Args:
        dot_nm: side of a dot, if it is stated.
        rules_um: gaps and widths of emitters by their keys; none without emitters.
        dots_given: whether the dots are those of a file, which no other number can take the place of.
        also: other places that state the same pitch.

    Raises:
        JobError: MF106 for a pitch that is not its dots and gutter, MF107 if no dots of whole nanometres are; MF118 for
            rules and dots of too fine a grid; all with lengths that work together.
    """
    pitch_nm, rules_nm = pitch_um * NM_PER_UM, [round(rule * NM_PER_UM) for rule in rules_um.values()]
    made = CellSize(dots, dot_nm or round((pitch_nm - gutter_nm) / dots), gutter_nm)
    meets = made.has_pitch(pitch_um)
    cell = math.gcd(made.dot_nm, gutter_nm, *rules_nm)
    # A rule wider than the pixel is refused as such where emitters are placed; no grid would mend it.
    if meets and (_shares(made, rules_nm) or max(rules_nm) > made.dots_nm):
        return
    side, apart = made.dots_nm / NM_PER_UM, abs((pitch_nm - gutter_nm) / dots % 1 - 0.5) < 0.5 - 1e-6
    code, place = ("MF118", "emitters") if meets else ("MF107" if apart else "MF106", f"{key}.pitch")
    what = (
        f"dots of {made.dot_nm / NM_PER_UM:g} um and the rules of [emitters] are whole numbers only on a grid of "
        f"{cell / NM_PER_UM:g} um, {made.dots_nm // cell} cells on {side:g} um; the limit is {MOST_CELLS}"
        if meets
        else f"{dots} dots x {made.dot_nm / NM_PER_UM:g} um + gutter {gutter_nm / NM_PER_UM:g} um = "
        f"{made.pitch_um:.10g} um, but pitch says {pitch_um:.10g} um"
        + (", which no dots of whole nanometres make" if apart else "")
    )
    near = [nearest_grid(round(pitch_nm), rules_nm, dots=dots, gutter_nm=gutter_nm)]
    near += (
        []
        if meets or not _shares(made, rules_nm)
        else [Grid(dots, made.dot_nm, made.pitch_nm, gutter_nm, (*rules_nm,))]
    )
    near += [] if dots_given else [nearest_grid(round(pitch_nm), rules_nm, gutter_nm=gutter_nm, widest_nm=widest_nm)]
    lines = dict.fromkeys(_lines(found, rules_um, key, gutter_nm) for found in near if found is not None)
    cure = f"These work together: {', or '.join(lines)}" if lines else "Use other dots: none near these share a grid"
    cure += f"; the same pitch stands in {' and '.join(also)}" if also else ""
    raise JobError(code, what, where=f"{where}{place}", cure=cure)


def _shares(made: CellSize, rules_nm: Sequence[int]) -> bool:
    """Whether dots, gutter and rules are whole numbers of few enough cells; a pixel without rules needs none."""
    cell = math.gcd(made.dot_nm, made.gutter_nm, *rules_nm)
    return not rules_nm or made.dots_nm // cell <= MOST_CELLS


def _lines(found: Grid, rules_um: Mapping[str, float], key: str, gutter_nm: int) -> str:
    def um(length_nm: int) -> str:
        return f'"{length_nm / NM_PER_UM:.10g} um"'

    own = [f"pitch = {um(found.pitch_nm)}"]
    own += [f"dots = {found.dots}"] if key == "design" else [f"dot = {um(found.dot_nm)}"]
    own += [f"gutter = {um(found.gutter_nm)}"] if gutter_nm else []
    lines = [f"{'[design]' if key == 'design' else f'[[die]] of {found.dots} dots'} {', '.join(own)}"]
    if rules_um:
        rules = (f"{name} = {um(rule)}" for name, rule in zip(rules_um, found.rules_nm, strict=True))
        lines.append(f"[emitters] {', '.join(rules)}")
    return "; ".join(lines)
