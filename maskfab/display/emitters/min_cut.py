"""The shortest line of cells that parts a piece of the plane in two, for every size that the two parts can have.

A closed walk over cells, one side step at a time, has a piece's cells on its left, on its right, and below itself. Only
those below itself count towards its length: it runs free of charge through holes and round the outside. The cells on
the left follow from the walk alone (Green's theorem: a step along x sweeps the piece's cells on one side of it in that
column), so walks can be grown one counted cell at a time while only the set of possible sizes of the left side is kept
per cell. That is the minimum-quotient cut of Park and Phillips (STOC 1993) with cells for edges. Walks that cross
themselves are among those looked at, which can only make the answer smaller.
"""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass

import numpy as np
import scipy
from numpy.typing import NDArray

_WORK = 2**31
"""Bits moved before the search stops; what it has not reached by then is longer than what it has."""


def shortest_cuts(piece: NDArray[np.bool_], longest: int) -> NDArray[np.int64]:
    """The least number of the piece's cells on a closed walk with ``s`` of its cells on the left, for every ``s``.

    Cells below the walk may be counted on either side, so a walk with at least ``p`` cells strictly on one side and at
    least ``q`` strictly on the other is no shorter than the least of entries ``p`` to ``V - q``.

    Args:
        piece: bool [rows, columns], not empty, connected through cell sides.
        longest: longest walk looked for.

    Returns:
        int64 [V + 1] with ``V`` the piece's cells. Never above the truth; what exceeds ``longest`` (or the work limit)
        stands as one more than the longest walk that was looked for.
    """
    total = int(piece.sum())
    walk = _Walks(piece)
    # A line along the rows, or one with a single step from a row to the next, leaves any number of cells on one side.
    longest = min(longest, 1 + int(min(piece.sum(0).max(), piece.sum(1).max())))
    shortest = np.full(total + 1, longest + 1, np.int64)
    inner = np.arange(total + 1)
    # A walk that touches no hole and not the outside rings its inside, which then fits in its bounding box.
    smaller = np.minimum(inner, total - inner)
    ring = 2 * np.ceil(2 * np.sqrt(smaller) - 1e-9).astype(np.int64) + 4
    shortest = np.minimum(shortest, ring)
    work = _WORK
    for start in range(1, walk.faces + 1):
        longest = min(longest, int(shortest[1:-1].max(initial=0)))
        found = walk.sizes(start, longest, work if start == walk.faces else work // 2)
        work -= found.work
        reached = np.full(total + 1, found.length + 1 if found.stopped else longest + 1, np.int64)
        for length in range(found.length, -1, -1):
            reached[_members(found.at[length], total)] = length
        shortest = np.minimum(shortest, reached)
    shortest[[0, total]] = 0
    return np.minimum(shortest, shortest[::-1])


def _members(bits: int, total: int) -> NDArray[np.bool_]:
    raw = np.frombuffer(bits.to_bytes(total // 8 + 1, "little"), np.uint8)
    return np.unpackbits(raw, bitorder="little", count=total + 1).astype(bool)


@dataclass
class _Found:
    """Sizes that closed walks from one face enclose on their left.

    Attributes:
        at: by length, the sizes as bits.
        stopped: for want of work, so that longer walks were not looked at.
        work: bits moved.
    """

    at: list[int]
    stopped: bool = False
    work: int = 0

    @property
    def length(self) -> int:
        return len(self.at) - 1


class _Walks:
    """The piece's cells, and its holes and the outside (faces) as one place each.

    Within a face all ways are free and sweep the same number of cells (modulo the whole piece), hence one place.
    """

    def __init__(self, piece: NDArray[np.bool_]) -> None:
        padded = np.pad(piece, 1)
        self.total = total = int(piece.sum())
        width = padded.shape[1]
        below = np.cumsum(padded, axis=0).ravel().tolist()
        faces, self.faces = scipy.ndimage.label(~padded)
        flat = padded.ravel().tolist()
        face = faces.ravel().tolist()
        size = len(flat)

        def steps(at: int) -> list[tuple[int, int]]:
            column = at % width
            found = []
            if column + 1 < width:
                found.append((at + 1, below[at + 1] % total))
            if column:
                found.append((at - 1, -below[at] % total))
            if at + width < size:
                found.append((at + width, 0))
            if at >= width:
                found.append((at - width, 0))
            return found

        swept: dict[int, int] = {}
        seen_faces: set[int] = set()
        for root in range(size):
            if flat[root] or face[root] in seen_faces:
                continue
            seen_faces.add(face[root])
            swept[root] = 0
            queue = deque([root])
            while queue:
                at = queue.popleft()
                for to, area in steps(at):
                    if not flat[to] and to not in swept:
                        swept[to] = (swept[at] + area) % total
                        queue.append(to)
        number = {at: index for index, at in enumerate(at for at in range(size) if flat[at])}
        self.to_cells: list[list[tuple[int, int]]] = []
        self.to_faces: list[list[tuple[int, int]]] = []
        self.from_face: list[set[tuple[int, int]]] = [set() for _ in range(self.faces + 1)]
        for at, index in number.items():
            cells, outside = [], set()
            for to, area in steps(at):
                if flat[to]:
                    cells.append((number[to], area))
                else:
                    # Counted from the face's root: the way back from `to` to the root sweeps the opposite.
                    there = (area - swept[to]) % total
                    outside.add((face[to], there))
                    self.from_face[face[to]].add((index, -there % total))
            self.to_cells.append(cells)
            self.to_faces.append(sorted(outside))

    def away(self, start: int, longest: int) -> list[int]:
        """The piece's cells on the shortest way from face ``start`` to each cell, itself included."""
        away = [longest + 1] * len(self.to_cells)
        passed = {start}
        edge = [at for at, _ in self.from_face[start]]
        length = 0
        while edge:
            length += 1
            onward: set[int] = set()
            for at in edge:
                if away[at] <= length:
                    continue
                away[at] = length
                onward.update(to for to, _ in self.to_cells[at])
                for face, _ in self.to_faces[at]:
                    if face > start and face not in passed:
                        passed.add(face)
                        onward.update(to for to, _ in self.from_face[face])
            edge = [at for at in onward if away[at] > length]
            if length >= longest:
                break
        return away

    def sizes(self, start: int, longest: int, work: int) -> _Found:
        """Walks from face ``start`` back to it that touch no face of a lower number: those were looked at before."""
        total, mask = self.total, (1 << self.total) - 1
        seen = [0] * len(self.to_cells)
        seen_face = [0] * (self.faces + 1)
        away = self.away(start, longest)
        fresh: dict[int, int] = {}
        fresh_face = {start: 1}
        seen_face[start] = 1
        result = _Found([1])
        wanted = mask & ~1
        while result.length < longest and (fresh or fresh_face) and wanted:
            result.work += (4 * len(fresh) + 4) * total
            if result.work > work:
                result.stopped = True
                break
            grown: dict[int, int] = {}
            for places, ways in ((fresh, self.to_cells), (fresh_face, self.from_face)):
                for at, bits in places.items():
                    for to, area in ways[at]:
                        moved = bits if not area else ((bits << area) | (bits >> (total - area))) & mask
                        grown[to] = grown.get(to, 0) | moved
            fresh = {}
            fresh_face = {}
            for at, bits in grown.items():
                # The way back is as long as the way there; both count the cell itself.
                new = bits & ~seen[at] if result.length + away[at] <= longest else 0
                if new:
                    fresh[at] = new
                    seen[at] |= new
                    for to, area in self.to_faces[at]:
                        if to >= start:
                            fresh_face[to] = fresh_face.get(to, 0) | ((new << area) | (new >> (total - area))) & mask
            for to in list(fresh_face):
                new = fresh_face[to] & ~seen_face[to]
                seen_face[to] |= new
                fresh_face[to] = new
                if not new:
                    del fresh_face[to]
            result.at.append(fresh_face.get(start, 0))
            wanted &= ~fresh_face.get(start, 0)
        return result
