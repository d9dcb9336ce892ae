"""Letters of a plate read back as text, by a table of what each looks like."""

from __future__ import annotations

from collections.abc import Iterable
from functools import lru_cache
from itertools import product
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

Mask: TypeAlias = NDArray[np.bool_]

# A letter is 28 steps high and 20 wide, in a cell of 24; squares of 4 steps make its picture.
_HEIGHT, _WIDTH, _ADVANCE, _SQUARE = 28, 20, 24, 4
_ROWS, _COLUMNS = _HEIGHT // _SQUARE, _WIDTH // _SQUARE
# A square of one step is covered, blank, or parted by a diagonal: a point in each of its four quarters tells which.
# They are four of nine points on a lattice of thirds.
_THIRDS = 3
_QUARTERS = ((1, 0), (0, 1), (2, 1), (1, 2))

# Small letters are drawn as capitals.
_PICTURES = r"""
!      "      #      $      %      &      '      (
..#..  .#.#.  .#.#.  ..#..  ##..#  .##..  ..#..  ...#.
..#..  .#.#.  .#.#.  .####  ##..#  #..#.  ..#..  ..#..
..#..  .....  #####  #.#..  ...#.  #.#..  .....  .#...
..#..  .....  .#.#.  .###.  ..#..  .#...  .....  .#...
..#..  .....  #####  ..#.#  .#...  #.#.#  .....  .#...
.....  .....  .#.#.  ####.  #..##  #..#.  .....  ..#..
..#..  .....  .#.#.  ..#..  #..##  .##.#  .....  ...#.

)      *      +      ,      -      .      /      0
.#...  .....  .....  .....  .....  .....  ....#  .###.
..#..  ..#..  ..#..  .....  .....  .....  ....#  #...#
...#.  #.#.#  ..#..  .....  .....  .....  ...#.  #..##
...#.  .###.  #####  .....  .###.  .....  ..#..  #.#.#
...#.  #.#.#  ..#..  .....  .....  .....  .#...  ##..#
..#..  ..#..  ..#..  ..#..  .....  .....  #....  #...#
.#...  .....  .....  .#...  .....  ..#..  #....  .###.

1      2      3      4      5      6      7      8
..#..  .###.  .###.  ...#.  #####  ..##.  #####  .###.
.##..  #...#  #...#  ..##.  #....  .#...  ....#  #...#
#.#..  ....#  ....#  .#.#.  ####.  #....  ...#.  #...#
..#..  ...#.  ..##.  #..#.  ....#  ####.  ..#..  .###.
..#..  ..#..  ....#  #####  ....#  #...#  ..#..  #...#
..#..  .#...  #...#  ...#.  #...#  #...#  ..#..  #...#
#####  #####  .###.  ...#.  .###.  .###.  ..#..  .###.

9      :      ;      <      =      >      ?      @
.###.  .....  .....  ...#.  .....  .#...  .###.  .###.
#...#  .....  .....  ..#..  .....  ..#..  #...#  #...#
#...#  ..#..  ..#..  .#...  #####  ...#.  ....#  #.###
.####  .....  .....  #....  .....  ....#  ..##.  #.#.#
....#  ..#..  ..#..  .#...  #####  ...#.  ..#..  #.###
...#.  .....  .#...  ..#..  .....  ..#..  .....  #....
.##..  .....  .....  ...#.  .....  .#...  ..#..  .####

A      B      C      D      E      F      G      H
..#..  ####.  .###.  ####.  #####  #####  .###.  #...#
.#.#.  #...#  #...#  #...#  #....  #....  #...#  #...#
#...#  #...#  #....  #...#  #....  #....  #....  #...#
#...#  ####.  #....  #...#  ####.  ####.  #.###  #####
#####  #...#  #....  #...#  #....  #....  #...#  #...#
#...#  #...#  #...#  #...#  #....  #....  #...#  #...#
#...#  ####.  .###.  ####.  #####  #....  .####  #...#

I      J      K      L      M      N      O      P
.###.  ....#  #...#  #....  #...#  #...#  .###.  ####.
..#..  ....#  #...#  #....  ##.##  #...#  #...#  #...#
..#..  ....#  #..#.  #....  #.#.#  ##..#  #...#  #...#
..#..  ....#  ###..  #....  #...#  #.#.#  #...#  ####.
..#..  #...#  #..#.  #....  #...#  #..##  #...#  #....
..#..  #...#  #...#  #....  #...#  #...#  #...#  #....
.###.  .###.  #...#  #####  #...#  #...#  .###.  #....

Q      R      S      T      U      V      W      X
.###.  ####.  .###.  #####  #...#  #...#  #...#  #...#
#...#  #...#  #...#  ..#..  #...#  #...#  #...#  #...#
#...#  #...#  #....  ..#..  #...#  #...#  #...#  .#.#.
#...#  ####.  .###.  ..#..  #...#  #...#  #...#  ..#..
#.#.#  #..#.  ....#  ..#..  #...#  #...#  #.#.#  .#.#.
#..#.  #...#  #...#  ..#..  #...#  .#.#.  ##.##  #...#
.##.#  #...#  .###.  ..#..  .###.  ..#..  #...#  #...#

Y      Z      [      \      ]      ^      _      `
#...#  #####  .###.  #....  .###.  ..#..  .....  .#...
#...#  ....#  .#...  #....  ...#.  .#.#.  .....  ..#..
.#.#.  ...#.  .#...  .#...  ...#.  #...#  .....  .....
..#..  ..#..  .#...  ..#..  ...#.  .....  .....  .....
..#..  .#...  .#...  ...#.  ...#.  .....  .....  .....
..#..  #....  .#...  ....#  ...#.  .....  .....  .....
..#..  #####  .###.  ....#  .###.  .....  #####  .....

{      |      }      ~
..##.  ..#..  .##..  .....
..#..  ..#..  ..#..  .....
..#..  ..#..  ..#..  .#...
.#...  ..#..  ...#.  #.#.#
..#..  ..#..  ..#..  ...#.
..#..  ..#..  ..#..  .....
..##.  ..#..  .##..  .....
"""


def read_line(
    polygons: Iterable[NDArray[np.int64]],
    left_nm: int,
    base_nm: int,
    height_nm: int,
    *,
    letters: int,
    mirrored: bool = False,
) -> str:
    """Text that polygons show where a line of text should stand.

    Judged by the middles of the 35 squares of each letter: text that is dropped, mirrored, exchanged or off by more
    than half a square reads otherwise. What is off by less is told by :func:`difference_steps2`.

    Args:
        polygons: int [vertex, (x, y)] in nanometres, of what is clear in and around the line, whole or in pieces, in
            any order and sense; a hole is reached by a cut.
        left_nm: x where the first letter's cell begins.
        base_nm: y of the base line.
        height_nm: height of the letters as ordered; they are drawn in whole steps of about a 28th of it.
        letters: how many to read, spaces included.
        mirrored: read from the plate's other side, where the line runs to the left from ``left_nm``.

    Returns:
        Capitals, digits and signs, a space where nothing is clear, and ``?`` for what is no letter at all; a question
        mark reads so too, and :func:`difference_steps2` tells them apart.
    """
    columns, rows = (
        np.arange(count, dtype=np.float64) * _SQUARE + _SQUARE / 2 for count in (letters * _ADVANCE // _SQUARE, _ROWS)
    )
    seen = _clear(polygons, columns, rows, _frame(left_nm, base_nm, height_nm, mirrored))[::-1]
    cells = (seen[:, start : start + _COLUMNS] for start in range(0, len(columns), _ADVANCE // _SQUARE))
    meanings = {picture.tobytes(): letter for letter, picture in _pictures().items()}
    return "".join(meanings.get(cell.tobytes(), "?") for cell in cells)


def difference_steps2(
    polygons: Iterable[NDArray[np.int64]],
    text: str,
    left_nm: int,
    base_nm: int,
    height_nm: int,
    *,
    mirrored: bool = False,
) -> float:
    """Area in steps squared that is clear and should not be, or should be and is not, in the box of a line of text.

    Asked of four points in every step squared, so that a letter moved by a third of a step is told. Arguments as of
    :func:`read_line`. What lies outside of the line's box is not looked at; :func:`ink_steps2` says how much all should
    be.

    Raises:
        KeyError: for a character that is no letter of the plate's.
    """
    length = max(0, len(text) * _ADVANCE - (_ADVANCE - _WIDTH))
    columns, rows = _points(length), _points(_HEIGHT)
    seen = _clear(polygons, columns, rows, _frame(left_nm, base_nm, height_nm, mirrored))
    blank = np.zeros((len(rows), 0), dtype=np.bool_)
    ordered = np.concatenate([blank, *map(_figure, text.upper())], axis=1)[:, : len(columns)]
    return _area_steps2(seen ^ ordered)


def ink_steps2(text: str) -> float:
    """Clear area of a line of text in steps squared, exactly.

    Raises:
        KeyError: for a character that is no letter of the plate's.
    """
    return sum(_area_steps2(_figure(letter)) for letter in text.upper())


def width_nm(letters: int, height_nm: int) -> int:
    """Width of a line of so many letters, from the first cell to the last: a centred line begins half of it, rounded
    down, left of its middle, and spaces at its end do not count."""
    return max(0, letters * _ADVANCE - (_ADVANCE - _WIDTH)) * _step_nm(height_nm)


def _step_nm(height_nm: int) -> int:
    return max(1, round(height_nm / _HEIGHT))


def _frame(left_nm: int, base_nm: int, height_nm: int, mirrored: bool) -> tuple[int, int, int, int]:
    """Where a line starts, x and y, and its steps along x and y, in nanometres."""
    step = _step_nm(height_nm)
    return left_nm, base_nm, -step if mirrored else step, step


def _points(steps: int) -> NDArray[np.float64]:
    """Middles of the thirds of so many steps, in steps."""
    return (np.arange(_THIRDS * steps) + 1 / 2) / _THIRDS


def _area_steps2(mask: Mask) -> float:
    """Area of which a mask on a lattice of thirds shows a quarter of a step squared at each point."""
    return float(sum(mask[v::_THIRDS, u::_THIRDS].sum() for u, v in _QUARTERS)) / len(_QUARTERS)


def _clear(
    polygons: Iterable[NDArray[np.int64]],
    columns: NDArray[np.float64],
    rows: NDArray[np.float64],
    frame: tuple[int, int, int, int],
) -> Mask:
    """Whether points lie in any of the polygons: whether these wind around them.

    Args:
        polygons: in nanometres.
        columns: x of the points in steps from the line's start, rising.
        rows: y of the points likewise.
        frame: of :func:`_frame`.

    Returns:
        bool [row, column].
    """
    windings = np.zeros((len(rows), len(columns) + 1), dtype=np.int64)
    polygons = list(polygons)
    if not polygons:
        return windings[:, :-1] > 0
    counts = np.array([len(polygon) for polygon in polygons])
    after, starts = np.arange(counts.sum()) + 1, np.cumsum(counts) - counts
    after[starts + counts - 1] = starts
    ends = (np.concatenate(polygons) - frame[:2]) / frame[2:]
    (x, y), (x_next, y_next) = ends.T, ends[after].T
    sense = np.repeat(np.sign(np.add.reduceat(x * y_next - x_next * y, starts)), counts)
    # An edge meets the rows from its lower end up to its upper one, which belongs to the next edge. Counted from its
    # lower end in either sense, so that it meets them in one place for the two polygons that it parts.
    falls = y > y_next
    x_low, x_high = np.where(falls, (x_next, x), (x, x_next))
    y_low, y_high = np.where(falls, (y_next, y), (y, y_next))
    first = np.searchsorted(rows, y_low)
    spans = np.searchsorted(rows, y_high) - first
    edge = np.repeat(np.arange(len(ends)), spans)
    row = np.arange(len(edge)) + np.repeat(first + spans - np.cumsum(spans), spans)
    met = x_low[edge] + (rows[row] - y_low[edge]) * ((x_high - x_low)[edge] / (y_high - y_low)[edge])
    turns = np.where(falls, sense, -sense)[edge].astype(np.int64)
    np.add.at(windings, (row, np.searchsorted(columns, met)), turns)
    return np.asarray(np.cumsum(windings, axis=1)[:, :-1] > 0)


@lru_cache(1)
def _pictures() -> dict[str, Mask]:
    """Letters as bool [7, 5], the top row first."""
    pictures = {" ": np.zeros((_ROWS, _COLUMNS), dtype=np.bool_)}
    for band in _PICTURES.strip("\n").split("\n\n"):
        names, *rows = (line.split() for line in band.splitlines())
        for place, name in enumerate(names):
            pictures[name] = np.array([[square == "#" for square in row[place]] for row in rows])
    return pictures


@lru_cache(128)
def _figure(letter: str) -> Mask:
    """Whether the points of a lattice of thirds in a letter's cell are clear, bool [84, 72], the lowest row first.

    Strokes run from middle to middle of squares that share a side, and of squares that share a corner where both
    squares beside that corner are blank. They are 4 steps wide, at 45 degrees 3 sqrt(2). A slanting stroke that meets
    none ends at a right angle, half a sqrt(2) beyond the middle; where it meets others is an octagon, and elsewhere the
    square.
    """
    picture = np.pad(_pictures()[letter][::-1], 1)
    figure = np.zeros((_THIRDS * _HEIGHT, _THIRDS * _ADVANCE), dtype=np.bool_)
    x, y = _points(_ADVANCE)[None, :], _points(_HEIGHT)[:, None]
    for row, column in np.argwhere(picture):
        u, v = x - (column - 1 / 2) * _SQUARE, y - (row - 1 / 2) * _SQUARE
        strokes = {True: 0, False: 0}
        for right, up in product((-1, 0, 1), repeat=2):
            slanting = bool(right and up)
            beside = slanting and (picture[row, column + right] or picture[row + up, column])
            if (right or up) and picture[row + up, column + right] and not beside:
                strokes[slanting] += 1
                low, high, near = (-1, 9, 3) if slanting else (0, 4, 2)
                along, across = right * u + up * v, np.abs(up * u - right * v)
                figure |= (low <= along) & (along <= high) & (across <= near)
        pen = (np.abs(u) <= 2) & (np.abs(v) <= 2)
        if strokes[True]:
            pen &= (np.abs(u + v) <= 3) & (np.abs(u - v) <= 3)
        if strokes[True] != 1 or strokes[False]:
            figure |= pen
    return figure
