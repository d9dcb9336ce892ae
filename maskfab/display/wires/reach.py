"""Path of each emitter to a gutter through closed dots, or the reason why there is none."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import scipy
from numpy.typing import NDArray

from maskfab.display.emitters.placement import Certificate, Proof
from maskfab.model import COLOURS, Emitters


@dataclass(frozen=True, eq=False)
class Reach:
    """The way from one connected emitter to a gutter.

    Attributes:
        colour: 1 to 3 for red, green and blue.
        path: intp [k, 2] row and column of the dots from the emitter to the pixel's side; None if there is no way.
        certificate: the island that the emitter lies on, if there is no way.
    """

    colour: int
    path: NDArray[np.intp] | None
    certificate: Certificate | None


def reaches(closed: NDArray[np.bool_], emitters: Emitters) -> tuple[Reach, ...]:
    """The shortest way of every connected emitter, by colour, through closed dots that share sides.

    Args:
        closed: bool [n, n], True where a line may run.
        emitters: on cells that divide the dots.
    """
    per_dot = emitters.labels.shape[0] // closed.shape[0]
    found = []
    for colour in range(1, len(COLOURS) + 1):
        pieces, count = scipy.ndimage.label(emitters.labels == colour)
        for piece in range(1, count + 1):
            start = np.zeros(closed.shape, dtype=np.bool_)
            rows, columns = np.nonzero(pieces == piece)
            start[rows // per_dot, columns // per_dot] = True
            found.append(_reach(closed, start & closed, colour, emitters.cell_nm * per_dot))
    return tuple(found)


def _reach(closed: NDArray[np.bool_], start: NDArray[np.bool_], colour: int, dot_nm: int) -> Reach:
    n = closed.shape[0]
    before: dict[tuple[int, int], tuple[int, int] | None] = {(int(y), int(x)): None for y, x in np.argwhere(start)}
    queue = list(before)
    for y, x in queue:
        if y in (0, n - 1) or x in (0, n - 1):
            path = [(y, x)]
            while (last := before[path[-1]]) is not None:
                path.append(last)
            return Reach(colour, np.array(path[::-1], dtype=np.intp), None)
        for step in ((y + 1, x), (y - 1, x), (y, x + 1), (y, x - 1)):
            if closed[step] and step not in before:
                before[step] = (y, x)
                queue.append(step)
    island = np.zeros(closed.shape, dtype=np.bool_)
    for place in before:
        island[place] = True
    statement = (
        f"the {COLOURS[colour - 1]} emitter lies on an island of {len(before)} closed dots with openings all round"
    )
    return Reach(colour, None, Certificate(Proof.FLOW, statement, {"dots": float(len(before))}, island, dot_nm))
