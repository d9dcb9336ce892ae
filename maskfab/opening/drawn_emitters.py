"""Emitters that come with an opening, drawn in letters, and what is wrong with a drawing."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np

from maskfab.base.arrays import Labels, Mask
from maskfab.errors import JobError
from maskfab.model import COLOURS, refined
from maskfab.opening.decode import CLOSED, Rows

LETTERS = CLOSED + "".join(colour[0].upper() for colour in COLOURS)


def labels_of_lines(lines: Rows, where: str) -> Labels:
    """Labels of a drawing in '.', R, G and B, the top line first; int8 [n, n], row 0 lowest.

    Raises:
        JobError: MF119 not square, or another character.
    """
    rows = [(number, line.strip()) for number, line in lines if line.strip()]
    for number, row in rows:
        wrong = next((character for character in row if character not in LETTERS), None)
        if wrong is not None:
            raise _refused(f"line {number}: {wrong!r} is none of {LETTERS}", where)
        if len(row) != len(rows):
            raise _refused(f"line {number} has {len(row)} cells, and there are {len(rows)} lines", where)
    if not rows:
        raise _refused("the drawing has 0 lines", where)
    return np.array([[LETTERS.index(character) for character in row] for _, row in reversed(rows)], dtype=np.int8)


def emitter_lines(labels: Labels) -> Iterable[str]:
    """The lines of a drawing, the top line first."""
    return ("".join(LETTERS[label] for label in row) for row in labels[::-1])


def check_emitters(labels: Labels, mask: Mask, where: str) -> None:
    """Refuse emitters that are not on the dots, lie on an opening, or lack a colour.

    Raises:
        JobError: MF119.
    """
    times, rest = divmod(labels.shape[0], mask.shape[0])
    if rest or not times:
        raise _refused(
            f"{labels.shape[0]} cells a side are no whole number of times the {mask.shape[0]} dots of the grid", where
        )
    clear = refined(mask, times)
    for label, colour in enumerate(COLOURS, 1):
        emitter = labels == label
        if not emitter.any():
            raise _refused(f"there is no {colour} emitter", where)
        both = np.argwhere(emitter & clear)
        if both.size:
            row, column = both[0]
            drawn = "".join(
                "!" if both_here else LETTERS[cell]
                for both_here, cell in zip((emitter & clear)[row], labels[row], strict=True)
            )
            raise _refused(
                f"the {colour} emitter lies on the opening in {len(both)} cells, first in line "
                f"{labels.shape[0] - row}, column {column + 1}, at the ! of {drawn}",
                where,
            )


def _refused(what: str, where: str) -> JobError:
    return JobError("MF119", what, where=where, cure=f"Draw {LETTERS} on closed dots only, every line of one length")
