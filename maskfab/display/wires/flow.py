"""The most opaque lines that cross a pixel through closed dots, the lines, and the barrier that stops one more.

A dot carries so many lines per layer; lines step between dots that share a side, since corners do not conduct. The
count is a maximum flow with capacities on the dots. By planar duality it equals the cheapest barrier: a chain of dots
from one flank to the other, joined by sides or corners, that costs nothing at an opening and its capacity at a closed
dot. Every line crosses it, so it is a proof that a reader can check by counting.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray
from scipy import sparse
from scipy.sparse import csgraph

from maskfab.display.emitters.placement import Certificate, Proof
from maskfab.errors import JobError
from maskfab.model import frozen

Mask = NDArray[np.bool_]
Indices = NDArray[np.intp]
Direction = Literal["vertical", "horizontal"]

DIRECTIONS: tuple[Direction, Direction] = ("vertical", "horizontal")


@dataclass(frozen=True, eq=False)
class Lines:
    """The most lines of one layer through closed dots.

    Attributes:
        direction: vertical lines run from the lowest row to the highest, horizontal ones from the left to the right.
        paths: intp [k, 2] row and column of each dot of each line, in order; at most ``capacity`` through one dot.
        capacity: lines that a dot carries.
        certificate: the barrier, whose closed dots carry no more lines than there are.
    """

    direction: Direction
    paths: tuple[Indices, ...]
    capacity: int
    certificate: Certificate

    def __post_init__(self) -> None:
        object.__setattr__(self, "paths", tuple(frozen(path) for path in self.paths))

    @property
    def count(self) -> int:
        return len(self.paths)


class Net:
    """The flow network of a pixel in one direction, made once and asked for many sets of ports.

    Args:
        closed: bool [n, n], True where a line may run.
        direction: which way the lines go.
        capacity: lines that a dot carries.

    Raises:
        JobError: MF120 if the dots are not a square or the capacity is less than 1.
    """

    def __init__(self, closed: Mask, direction: Direction, capacity: int = 1) -> None:
        if closed.ndim != 2 or closed.shape[0] != closed.shape[1] or capacity < 1:
            raise JobError(
                "MF120",
                f"{capacity} lines per dot on dots {closed.shape} cannot be counted",
                where="wiring",
                cure="Give a square of dots that carry at least 1 line each",
            )
        self.direction = direction
        self._upright = np.ascontiguousarray(closed if direction == "vertical" else closed.T)
        self._capacity = capacity
        self._ids = np.flatnonzero(self._upright)
        self._number = np.full(self._upright.shape, -1, dtype=np.int32)
        self._number.flat[self._ids] = np.arange(self._ids.size, dtype=np.int32)
        self._tail, self._head = _neighbours(self._number)

    def count(self, ports: Indices | None = None) -> int:
        """Most lines that start at the dots ``ports`` of the first side and end at the same ones of the last."""
        return int(self._solve(ports).flow_value)

    def paths(self, ports: Indices | None = None) -> tuple[Indices, ...]:
        """The lines themselves, first side to last, ordered along the first side; intp [k, 2] row and column.

        Through dots of capacity 1 lines cannot cross, so those through ports come out at the port they went in by
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

    def barrier(self) -> tuple[Mask, int]:
        """The cheapest chain of dots, joined by sides or corners, between the flanks, and what its closed dots carry;
        among equals the shortest."""
        n = self._upright.shape[0]
        length = 1 / (2 * n * n)
        cost = np.where(self._upright, 1.0, 0.0) + length
        number = np.arange(n * n).reshape(n, n)
        tails, heads = [], []
        for dy, dx in ((0, 1), (1, 0), (1, 1), (1, -1)):
            here = number[: n - dy, max(0, -dx) : n - max(0, dx)].ravel()
            there = number[dy:, max(0, dx) : n + min(0, dx)].ravel()
            tails += [here, there]
            heads += [there, here]
        first, last = n * n, n * n + 1
        tails += [np.full(n, first), number[:, -1]]
        heads += [number[:, 0], np.full(n, last)]
        tail, head = np.concatenate(tails), np.concatenate(heads)
        weight = np.append(cost.ravel(), [length, length])[head]
        graph = sparse.csr_matrix((weight, (tail, head)), shape=(n * n + 2, n * n + 2))
        _, before = csgraph.dijkstra(graph, indices=first, return_predecessors=True)
        chain = np.zeros(n * n, dtype=np.bool_)
        at = int(before[last])
        while at != first:
            chain[at] = True
            at = int(before[at])
        upright = chain.reshape(n, n)
        carried = int((upright & self._upright).sum()) * self._capacity
        return (upright if self.direction == "vertical" else upright.T), carried

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
        data = np.full(tail.size, self._capacity, dtype=np.int32)
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


def line_flow(closed: Mask, direction: Direction, *, capacity: int = 1, dot_nm: int = 0) -> Lines:
    """The most lines between opposite sides of a pixel.

    Args:
        closed: bool [n, n], y up, True where a line may run.
        direction: vertical from bottom to top, horizontal from left to right.
        capacity: lines that a dot carries.
        dot_nm: side of a dot, for the certificate.

    Raises:
        JobError: MF120 if the dots are not a square or the capacity is less than 1.
    """
    net = Net(closed, direction, capacity)
    paths = net.paths()
    barrier, carried = net.barrier()
    shut = carried // capacity
    statement = (
        f"every {direction} line crosses a chain of {int(barrier.sum())} dots, {shut} of them closed, "
        f"which carry {carried} lines"
    )
    numbers = {"lines": float(len(paths)), "closed_dots": float(shut), "capacity": float(capacity)}
    return Lines(direction, paths, capacity, Certificate(Proof.FLOW, statement, numbers, barrier, dot_nm))


def _neighbours(number: NDArray[np.int32]) -> tuple[NDArray[np.int32], NDArray[np.int32]]:
    """Both ends of every step between closed dots that share a side."""
    tails, heads = [], []
    for here, there in ((number[:, :-1], number[:, 1:]), (number[:-1], number[1:])):
        both = (here >= 0) & (there >= 0)
        tails += [here[both], there[both]]
        heads += [there[both], here[both]]
    return np.concatenate(tails), np.concatenate(heads)
