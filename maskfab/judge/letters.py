"""Letters of a plate read back as text, by a table of what each looks like."""

from __future__ import annotations

from functools import lru_cache
from itertools import product

import numpy as np
from numpy.typing import NDArray

from maskfab.base.arrays import Mask

HEIGHT, WIDTH, ADVANCE = 28, 20, 24
"""Of a letter, and from letter to letter, in steps."""

# Squares of 4 steps make the picture of a letter.
_SQUARE = 4
_ROWS, _COLUMNS = HEIGHT // _SQUARE, WIDTH // _SQUARE
# A square of one step is covered, blank, or parted by a diagonal: a point in each of its four quarters tells which.
# They are four of nine points on a lattice of thirds.
_THIRDS = 3
_QUARTERS = ((1, 0), (0, 1), (2, 1), (1, 2))

# Small letters are drawn as capitals.
_PICTURES = r"""
!      "      #      $      %      &      '      (
..#..  .#.#.  .#.#.  ..#..  ##..#  .##..  ..#..  ...#.
..#..  .#.#.  .#.#.  .####  ##..#  #..#.  ..#..  ..#..
..#..  .....  #####  #....  ...#.  #.#..  .....  .#...
..#..  .....  .#.#.  .###.  ..#..  .#...  .....  .#...
..#..  .....  #####  ....#  .#...  #.#.#  .....  .#...
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


def points(steps: int) -> NDArray[np.float64]:
    """Where to look along so many steps, in steps: a lattice of thirds."""
    return (np.arange(_THIRDS * steps) + 1 / 2) / _THIRDS


def read(seen: Mask) -> str:
    """Text of a line.

    Judged by the middles of the 35 squares of each letter: text that is dropped, mirrored, exchanged or off by more
    than half a square reads otherwise. What is off by less, the :func:`drawing` tells.

    Args:
        seen: whether the :func:`points` of whole letters are clear, bool [84, 72 letters], the lowest row first.

    Returns:
        Capitals, digits and signs, a space where nothing is clear, and ``?`` for what is no letter at all; a question
        mark reads so too.
    """
    # Beside the middle, where no edge can run.
    middles = seen[_THIRDS * _SQUARE // 2 :: _THIRDS * _SQUARE, _THIRDS * _SQUARE // 2 + 1 :: _THIRDS * _SQUARE][::-1]
    cells = (middles[:, start : start + _COLUMNS] for start in range(0, middles.shape[1], ADVANCE // _SQUARE))
    meanings = {picture.tobytes(): letter for letter, picture in _pictures().items()}
    return "".join(meanings.get(cell.tobytes(), "?") for cell in cells)


def drawing(text: str) -> Mask:
    """The :func:`points` of a line of text that should be clear.

    Raises:
        KeyError: for a character that is no letter of the plate's.
    """
    return np.concatenate([_figure(letter) for letter in text.upper()], axis=1)


def area_steps2(mask: Mask) -> float:
    """Area in steps squared, exactly where edges run along steps or their diagonals."""
    return float(sum(mask[v::_THIRDS, u::_THIRDS].sum() for u, v in _QUARTERS)) / len(_QUARTERS)


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
    square. A blank square beside a slanting stroke whose other two neighbours are not blank, nor the square between
    one of these and the stroke's end, is covered for one step along that end.
    """
    picture = np.pad(_pictures()[letter][::-1], 1)
    figure = np.zeros((_THIRDS * HEIGHT, _THIRDS * ADVANCE), dtype=np.bool_)
    x, y = points(ADVANCE)[None, :], points(HEIGHT)[:, None]
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
                # Towards this end: the square above or below it, then the one beside it.
                if slanting and picture[row + up, column - right] and picture[row, column - right]:
                    figure |= (np.abs(u) <= 2) & (np.abs(up * v - 5 / 2) <= 1 / 2)
                if slanting and picture[row - up, column + right] and picture[row - up, column]:
                    figure |= (np.abs(v) <= 2) & (np.abs(right * u - 5 / 2) <= 1 / 2)
        pen = (np.abs(u) <= 2) & (np.abs(v) <= 2)
        if strokes[True]:
            pen &= (np.abs(u + v) <= 3) & (np.abs(u - v) <= 3)
        if strokes[True] != 1 or strokes[False]:
            figure |= pen
    return figure
