"""Upper bound of the footprint of three emitters of any shape, by the shortest lines that part a piece of the pixel.

An emitter is a union of w x w squares joined by unit shifts, so it lies in one *piece*: the cells of squares that reach
one another by such shifts. Say that emitters A, B, C share a piece of V cells, at a gap g.

1. The cells at distance 1, 2, ... from A are *layers*. Layers of A up to h cells away and those of B and C are all
   different cells as long as 2h <= g.
2. Each layer of A holds a closed walk of cells with A and the layers before it on one side and B, or B and C, on the
   other, so it has at least as many cells of the piece as the shortest walk that parts the piece so: at least w
   (w lanes lead from a square of A to one of B), and exactly as :func:`shortest_cuts` says. If no one walk has both B
   and C on its other side (one lies within a hole or a bay of A), there is one for each, and these two share one cell
   at most, in the mouth of the bay.
3. If g is odd, one layer is left in the middle; it is shared. A cell next to all three of A, B, C (with their layers)
   exists at most twice, for three such cells would draw K(3,3) in the plane. So this layer has at least half of what
   its three walks have together less two.
4. Areas and layers together are at most V.

Areas are then raised until no way to share out the emitters over the pieces keeps 4.

A closed walk over cells, one side step at a time, has a piece's cells on its left, on its right, and below itself. Only
those below itself count towards its length: it runs free of charge through holes and round the outside. The cells on
the left follow from the walk alone (Green's theorem: a step along x sweeps the piece's cells on one side of it in that
column), so walks can be grown one counted cell at a time while only the set of possible sizes of the left side is kept
per cell. That is the minimum-quotient cut of Park and Phillips (STOC 1993) with cells for edges. Walks that cross
themselves are among those looked at, which can only make the answer smaller.
"""

from __future__ import annotations

import bisect
import math
from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import combinations

import numpy as np
import scipy

from maskfab.base.arrays import Ints, Mask
from maskfab.base.units import NM_PER_UM
from maskfab.display.emitter_rules import Certificate, EmitterGrid, Proof
from maskfab.display.free_area import Squares

_WORK = 2**31
"""Bits moved before the search stops; what it has not reached by then is longer than what it has."""

_SUBSETS = tuple(subset for size in (1, 2, 3) for subset in combinations(range(3), size))


def upper_bound(
    region: Mask,
    grid: EmitterGrid,
    ratio: tuple[float, float, float],
    *,
    required: float | None = None,
    tight: bool = True,
) -> tuple[float, Certificate]:
    """No three emitters that keep the rules have all areas above ``a * ratio_k``.

    Args:
        required: an ``a`` in cells; the bound is only made tight if a quick one does not exclude it.
        tight: False stays with the quick bound (a gap g takes g * w cells): milliseconds.

    Returns:
        The bound ``a`` in cells (0 if three squares do not fit into the pieces), never below the optimum, and why.
    """
    pieces = _pieces(region, grid)
    bound = _largest(pieces, grid, ratio)
    proof = Proof.COMPONENT_PACKING
    if tight and grid.colour_gap > 0 and bound > 0 and (required is None or bound >= required):
        least = grid.min_width**2
        # A piece of one emitter at most has no line to be parted by.
        measured = [
            piece.measured(1 + piece.total // grid.colour_gap) if piece.total >= 2 * least else piece
            for piece in pieces
        ]
        tighter = _largest(measured, grid, ratio)
        if tighter < bound:
            pieces, bound, proof = measured, tighter, Proof.SEPARATION
    return bound, _certificate(pieces, grid, ratio, bound, proof)


@dataclass(frozen=True, eq=False)
class _Piece:
    """Cells that one emitter could cover, and how long a line must be that parts them."""

    cells: Mask
    total: int
    lanes: int
    cuts: Ints | None = None

    def measured(self, longest: int) -> _Piece:
        rows, columns = np.flatnonzero(self.cells.any(1)), np.flatnonzero(self.cells.any(0))
        box = self.cells[rows[0] : rows[-1] + 1, columns[0] : columns[-1] + 1]
        return _Piece(self.cells, self.total, self.lanes, shortest_cuts(box, longest))

    def cut(self, one: int, other: int) -> int:
        """Cells on any line with so many cells on its two sides; more than there are where that cannot be."""
        if one + other > self.total:
            return self.total + 1
        if self.cuts is None:
            return self.lanes
        return max(self.lanes, int(self.cuts[one : self.total - other + 1].min()))

    def taken(self, areas: Sequence[int], gap: int) -> int:
        """The least that emitters of these areas and the gaps between them take of the piece's cells."""
        grown = list(areas)
        if len(grown) == 1:
            return grown[0]
        if len(grown) == 2:
            for layer in range(gap):
                if sum(grown) <= self.total:
                    grown[layer % 2] += self.cut(*grown)
            return sum(grown)
        for _ in range(gap // 2):
            if sum(grown) <= self.total:
                grown = [area + layer for area, layer in zip(grown, self.layers(grown), strict=True)]
        taken = sum(grown)
        if gap % 2 and taken <= self.total:
            layers = self.layers(grown)
            taken += max(*layers, (sum(layers) - 1) // 2)
        return taken

    def layers(self, areas: Sequence[int]) -> list[int]:
        """The least cells of the next layer of each of three emitters, all of which have grown to these areas."""
        everything = sum(areas)
        alone = [self.cut(area, everything - area) for area in areas]
        return [min(alone[k], alone[k - 1] + alone[k - 2] - 1) for k in range(3)]


def _pieces(region: Mask, grid: EmitterGrid) -> list[_Piece]:
    squares = Squares.of(region, grid.min_width, grid.colour_gap)
    left, pieces = squares.free, []
    while left:
        part = squares.reach(left & -left, left)
        left ^= part
        pieces.append(_Piece(squares.picture(part), squares.area(part), grid.min_width))
    return sorted(pieces, key=lambda piece: -piece.total)


def _needs(a: float, grid: EmitterGrid, ratio: Sequence[float]) -> list[int]:
    return [max(grid.min_width**2, math.ceil(a * part - 1e-9)) for part in ratio]


def _shared_out(pieces: Sequence[_Piece], needs: Sequence[int], gap: int) -> bool:
    """Whether the emitters can be given to the pieces so that none is overfull."""
    placed = {0}
    for piece in pieces:
        if piece.total < min(needs):
            break
        held: dict[tuple[int, ...], bool] = {}
        more = set(placed)
        for subset in _SUBSETS:
            areas = tuple(sorted(needs[k] for k in subset))
            if areas not in held:
                held[areas] = sum(areas) <= piece.total and piece.taken(areas, gap) <= piece.total
            if held[areas]:
                bits = sum(1 << k for k in subset)
                more |= {have | bits for have in placed if not have & bits}
        if 7 in more:
            return True
        placed = more
    return False


def _largest(pieces: Sequence[_Piece], grid: EmitterGrid, ratio: Sequence[float]) -> float:
    """Largest a that passes; emitters have whole cells, so only a = cells / ratio_k can be one."""
    if not pieces or not _shared_out(pieces, _needs(0.0, grid, ratio), grid.colour_gap):
        return 0.0
    steps = np.arange(1, pieces[0].total + 1)
    candidates = np.unique(np.concatenate([steps / part for part in set(ratio)]))

    def too_large(area: float) -> bool:
        return not _shared_out(pieces, _needs(float(area), grid, ratio), grid.colour_gap)

    fits = bisect.bisect_left(candidates, True, key=too_large)
    return float(candidates[fits - 1]) if fits else 0.0


def _certificate(
    pieces: Sequence[_Piece], grid: EmitterGrid, ratio: Sequence[float], bound: float, proof: Proof
) -> Certificate:
    """The sentence is about areas of one cell more for the emitter that is largest relative to its ratio."""
    unit = (grid.cell_nm / NM_PER_UM) ** 2
    share = bound * grid.cell_nm**2 / grid.pitch_nm**2
    numbers = {"bound_cells": bound, "bound_share": share, "pieces": float(len(pieces))}
    if not pieces:
        text = f"nowhere in the region does a square of {grid.min_width * grid.cell_nm / NM_PER_UM:g} um fit"
        return Certificate(proof, text, numbers, np.zeros((grid.cells, grid.cells), np.bool_), grid.cell_nm)
    needs = _needs(bound + 1e-6, grid, ratio)
    piece = pieces[0]
    held = [
        subset
        for subset in _SUBSETS
        if sum(needs[k] for k in subset) <= piece.total
        and piece.taken([needs[k] for k in subset], grid.colour_gap) <= piece.total
    ]
    most = max((len(subset) for subset in held), default=0)
    tried = sorted(needs)[: most + 1]
    taken = piece.taken(tried, grid.colour_gap) if sum(tried) <= piece.total else sum(tried)
    cut = piece.cut(tried[0], sum(tried[1:])) if len(tried) > 1 and sum(tried) <= piece.total else 0
    numbers |= {
        "piece_cells": float(piece.total),
        "emitters_in_piece": float(most),
        "areas_cells": float(sum(tried)),
        "cut_cells": float(cut),
        "taken_cells": float(taken),
    }
    line = f"; every line of cells that parts it so has at least {cut} of them" if cut else ""
    others = "; the other pieces cannot hold the rest" if most and len(pieces) > 1 else ""
    text = (
        f"emitters above {bound:g} cells ({bound * unit:.0f} um^2, {share:.2%} of the pixel) times their ratio "
        f"do not fit: the largest piece of the region has {piece.total} cells{line}, so {len(tried)} of them with "
        f"gaps of {grid.colour_gap} cells would take {taken} or more{others}"
    )
    witness = np.logical_or.reduce([piece.cells for piece in pieces])
    return Certificate(proof, text, numbers, witness, grid.cell_nm)


def shortest_cuts(piece: Mask, longest: int) -> Ints:
    """The least number of the piece's cells on a closed walk with ``s`` of its cells on the left, for every ``s``.

    Cells below the walk may be counted on either side, so a walk with at least ``p`` cells strictly on one side and at
    least ``q`` strictly on the other is no shorter than the least of entries ``p`` to ``V - q``.

    Args:
        piece: bool [rows, columns], not empty, connected through cell sides.

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
        sizes, stopped, moved = walk.sizes(start, longest, work if start == walk.faces else work // 2)
        work -= moved
        reached = np.full(total + 1, len(sizes) if stopped else longest + 1, np.int64)
        for length in range(len(sizes) - 1, -1, -1):
            members = np.frombuffer(sizes[length].to_bytes(total // 8 + 1, "little"), np.uint8)
            reached[np.unpackbits(members, bitorder="little", count=total + 1).astype(bool)] = length
        shortest = np.minimum(shortest, reached)
    shortest[[0, total]] = 0
    return np.minimum(shortest, shortest[::-1])


class _Walks:
    """The piece's cells, and each hole and the outside as one place: within it all ways are free and sweep alike."""

    def __init__(self, piece: Mask) -> None:
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
            ways = []
            if column + 1 < width:
                ways.append((at + 1, below[at + 1] % total))
            if column:
                ways.append((at - 1, -below[at] % total))
            if at + width < size:
                ways.append((at + width, 0))
            if at >= width:
                ways.append((at - width, 0))
            return ways

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

    def sizes(self, start: int, longest: int, most: int) -> tuple[list[int], bool, int]:
        """Sizes that closed walks from face ``start`` enclose on their left, as bits, by the length of the walk.

        Walks touch no face of a lower number: those were looked at before. With them comes whether they stopped for
        want of work, ``most`` bits to be moved, so that longer ones were not looked at, and the bits moved.
        """
        total, mask = self.total, (1 << self.total) - 1
        seen = [0] * len(self.to_cells)
        seen_face = [0] * (self.faces + 1)
        away = self.away(start, longest)
        fresh: dict[int, int] = {}
        fresh_face = {start: 1}
        seen_face[start] = 1
        sizes, work = [1], 0
        wanted = mask & ~1
        while len(sizes) <= longest and (fresh or fresh_face) and wanted:
            work += (4 * len(fresh) + 4) * total
            if work > most:
                return sizes, True, work
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
                new = bits & ~seen[at] if len(sizes) - 1 + away[at] <= longest else 0
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
            sizes.append(fresh_face.get(start, 0))
            wanted &= ~fresh_face.get(start, 0)
        return sizes, False, work
