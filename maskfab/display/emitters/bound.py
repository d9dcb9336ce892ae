"""Upper bound of the footprint of three emitters of any shape.

An emitter is a union of w x w squares joined by unit shifts, so it lies in one *piece*: the cells of squares that reach
one another by such shifts. Say that emitters A, B, C share a piece of V cells, at a gap g.

1. The cells at distance 1, 2, ... from A are *layers*. Layers of A up to h cells away and those of B and C are all
   different cells as long as 2h <= g.
2. Each layer of A holds a closed walk of cells with A and the layers before it on one side and B, or B and C, on the
   other, so it has at least as many cells of the piece as the shortest walk that parts the piece so: at least w
   (w lanes lead from a square of A to one of B), and exactly as :func:`maskfab.display.emitters.min_cut.shortest_cuts`
   says. If no one walk has both B and C on its other side (one lies within a hole or a bay of A), there is one for
   each, and these two share one cell at most, in the mouth of the bay.
3. If g is odd, one layer is left in the middle; it is shared. A cell next to all three of A, B, C (with their layers)
   exists at most twice, for three such cells would draw K(3,3) in the plane. So this layer has at least half of what
   its three walks have together less two.
4. Areas and layers together are at most V.

Areas are then raised until no way to share out the emitters over the pieces keeps 4.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import combinations

import numpy as np
from numpy.typing import NDArray

from maskfab.display.emitters.emitter_rules import EmitterGrid
from maskfab.display.emitters.min_cut import shortest_cuts
from maskfab.display.emitters.placement import Certificate, Proof
from maskfab.display.emitters.squares import Squares
from maskfab.units import NM_PER_UM

_SUBSETS = tuple(subset for size in (1, 2, 3) for subset in combinations(range(3), size))


def upper_bound(
    region: NDArray[np.bool_],
    grid: EmitterGrid,
    ratio: tuple[float, float, float],
    *,
    required: float | None = None,
    tight: bool = True,
) -> tuple[float, Certificate]:
    """No three emitters that keep the rules have all areas above ``a * ratio_k``.

    Args:
        region: bool [n, n] cells in which an emitter may lie.
        grid: the gap between colours and the least width, in cells.
        ratio: relative areas of red, green and blue.
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
    """Cells that one emitter could cover, and how long a line must be that parts them.

    Attributes:
        cells: bool [n, n].
        total: how many.
        lanes: what every such line has at least.
        cuts: int64 [total + 1] the shortest line by the cells on one side of it, once measured.
    """

    cells: NDArray[np.bool_]
    total: int
    lanes: int
    cuts: NDArray[np.int64] | None = None

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


def _pieces(region: NDArray[np.bool_], grid: EmitterGrid) -> list[_Piece]:
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
        known: dict[tuple[int, ...], bool] = {}
        more = set(placed)
        for subset in _SUBSETS:
            areas = tuple(sorted(needs[k] for k in subset))
            if areas not in known:
                known[areas] = sum(areas) <= piece.total and piece.taken(areas, gap) <= piece.total
            if known[areas]:
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
    low, high = 0, len(candidates)
    while low < high:
        middle = (low + high) // 2
        if _shared_out(pieces, _needs(float(candidates[middle]), grid, ratio), grid.colour_gap):
            low = middle + 1
        else:
            high = middle
    return float(candidates[low - 1]) if low else 0.0


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
