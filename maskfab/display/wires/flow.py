"""The most opaque lines that cross a pixel through closed dots, and the lines.

A dot carries one line; lines step between dots that share a side, since corners do not conduct. The count is a maximum
flow with capacities on the dots, and by Menger's theorem the fewest dots that cut one side off from the other.
"""

from __future__ import annotations

from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray
from scipy import sparse
from scipy.sparse import csgraph

from maskfab.base.arrays import Indices, Mask
from maskfab.errors import JobError

Direction = Literal["vertical", "horizontal"]

DIRECTIONS: tuple[Direction, Direction] = ("vertical", "horizontal")


class Net:
    """The flow network of a pixel in one direction, made once and asked for many sets of ports.

    Args:
        closed: bool [n, n], y up, True where a line may run.
        direction: vertical lines run from the lowest row to the highest, horizontal ones from the left to the right.

    Raises:
        JobError: MF120 if the dots are not a square.
    """

    def __init__(self, closed: Mask, direction: Direction) -> None:
        if closed.ndim != 2 or closed.shape[0] != closed.shape[1]:
            raise JobError(
                "MF120",
                f"lines through dots {closed.shape} cannot be counted",
                where="wiring",
                cure="Give a square of dots",
            )
        self.direction = direction
        self._upright = np.ascontiguousarray(closed if direction == "vertical" else closed.T)
        self._ids = np.flatnonzero(self._upright)
        self._number = np.full(self._upright.shape, -1, dtype=np.int32)
        self._number.flat[self._ids] = np.arange(self._ids.size, dtype=np.int32)
        self._tail, self._head = _neighbours(self._number)

    def count(self, ports: Indices | None = None) -> int:
        """Most lines that start at the dots ``ports`` of the first side and end at the same ones of the last."""
        return int(self._solve(ports).flow_value)

    def paths(self, ports: Indices | None = None) -> tuple[Indices, ...]:
        """The lines themselves, first side to last, ordered along the first side; intp [k, 2] row and column.

        A dot carries one line, so that lines cannot cross, so those through ports come out at the port they went in by
        when all ports are used.
        """
        flow = self._solve(ports).flow.tocoo()
        kept = flow.data > 0
        onward: dict[int, list[int]] = {}
        source = 2 * self._ids.size
        starts: list[int] = []
        for tail, head, units in zip(
            flow.row[kept].tolist(), flow.col[kept].tolist(), flow.data[kept].tolist(), strict=True
        ):
            if tail == source:
                starts += [head // 2] * units
            elif tail % 2:  # from the way out of a dot to the way into the next, or to the sink
                onward.setdefault(tail // 2, []).extend([head // 2] * units)
        found = [self._walk(start, onward) for start in sorted(starts)]
        return tuple(self._places(walk) for walk in found)

    def _solve(self, ports: Indices | None) -> Any:
        size = self._ids.size
        dots = np.arange(size, dtype=np.int32)
        source, sink = 2 * size, 2 * size + 1
        ends = []
        for row in (0, -1):
            side = self._number[row] if ports is None else self._number[row, ports]
            ends.append(side[side >= 0])
        starts, stops = ends
        tails = (2 * dots, 2 * self._tail + 1, np.full(starts.size, source), 2 * stops + 1)
        heads = (2 * dots + 1, 2 * self._head, 2 * starts, np.full(stops.size, sink))
        tail, head = np.concatenate(tails), np.concatenate(heads)
        data = np.ones(tail.size, dtype=np.int32)
        graph = sparse.csr_matrix((data, (tail, head)), shape=(2 * size + 2, 2 * size + 2))
        return csgraph.maximum_flow(graph, source, sink)

    def _walk(self, start: int, onward: dict[int, list[int]]) -> list[int]:
        """One unit of flow from a dot to the sink, loops left out."""
        sink = self._ids.size  # half the sink's number, rounded down
        walk, place = [start], {start: 0}
        while (following := onward[walk[-1]].pop()) != sink:
            if following in place:
                for dot in walk[place[following] + 1 :]:
                    del place[dot]
                del walk[place[following] + 1 :]
            else:
                place[following] = len(walk)
                walk.append(following)
        return walk

    def _places(self, walk: list[int]) -> Indices:
        rows, columns = np.unravel_index(self._ids[walk], self._upright.shape)
        pair = (rows, columns) if self.direction == "vertical" else (columns, rows)
        return np.stack(pair, axis=1).astype(np.intp)


def _neighbours(number: NDArray[np.int32]) -> tuple[NDArray[np.int32], NDArray[np.int32]]:
    """Both ends of every step between closed dots that share a side."""
    tails, heads = [], []
    for here, there in ((number[:, :-1], number[:, 1:]), (number[:-1], number[1:])):
        both = (here >= 0) & (there >= 0)
        tails += [here[both], there[both]]
        heads += [there[both], here[both]]
    return np.concatenate(tails), np.concatenate(heads)
