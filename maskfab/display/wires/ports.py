"""Fixed ports at which lines meet those of any neighbour, however both pixels are turned."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from maskfab.display.wires.flow import DIRECTIONS, Direction, Net

_MOST_TRIED = 400


@dataclass(frozen=True)
class Ports:
    """Ports at which the lines of any two pixels of a panel meet.

    Attributes:
        places: dots along a side, ascending.
        exact: whether no larger set exists; otherwise the count is a lower bound.
    """

    places: tuple[int, ...]
    exact: bool

    @property
    def count(self) -> int:
        return len(self.places)


def ports(
    closed: NDArray[np.bool_],
    directions: Sequence[Direction] = DIRECTIONS,
    *,
    symmetric: bool = True,
    enough: int | None = None,
    most_tried: int = _MOST_TRIED,
) -> Ports:
    """The most ports, the same at both ends, through which lines run in every given direction.

    With both directions and symmetric places, i together with n - 1 - i, they serve all eight orientations beside any
    neighbour; without quarter turns each direction may have its own, and without turns they need not be symmetric.

    A set that can be wired stays so without some of its lines, so a set that fails rules out all that hold it.

    Args:
        closed: bool [n, n], True where a line may run; one line per dot and layer.
        directions: which of them share the ports.
        symmetric: whether the places must be mirror images of each other.
        enough: stop at so many; one more may come out where places are symmetric.
        most_tried: sets to try before the best so far is returned as a lower bound.
    """
    n = closed.shape[0]
    nets = [Net(closed, direction) for direction in directions]
    sides = np.ones(n, dtype=np.bool_)
    for direction in directions:
        upright = closed if direction == "vertical" else closed.T
        sides &= upright[0] & upright[-1]
    if symmetric:
        free = np.flatnonzero(sides & sides[::-1])
        orbits = [tuple(sorted({int(i), n - 1 - int(i)})) for i in free if 2 * i <= n - 1]
    else:
        free = np.flatnonzero(sides)
        orbits = [(int(i),) for i in free]
    # Pairs first: each adds two ports, the middle dot only one.
    orbits.sort(key=len, reverse=True)
    ceiling = min(net.count(free) for net in nets) if free.size else 0
    if enough is not None:
        ceiling = min(ceiling, enough + symmetric)
    best: tuple[int, ...] = ()
    tried = 0
    waiting: list[tuple[tuple[int, ...], int]] = [((), 0)]
    wanted = ceiling if enough is None else min(ceiling, enough)
    while waiting and len(best) < wanted:
        chosen, following = waiting.pop()
        if len(chosen) + sum(len(orbit) for orbit in orbits[following:]) <= len(best) or following == len(orbits):
            continue
        if tried >= most_tried:
            return Ports(best, False)
        waiting.append((chosen, following + 1))
        larger = tuple(sorted(chosen + orbits[following]))
        if len(larger) > ceiling:
            continue
        tried += 1
        if all(net.count(np.array(larger)) == len(larger) for net in nets):
            best = max(best, larger, key=len)
            waiting.append((larger, following + 1))
    return Ports(best, True)
