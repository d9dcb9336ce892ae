"""Emitters in several pieces, laid round an opening so that a pixel looks alike however it is turned.

A pixel's colours lie beside one another, so that red sits here in one orientation and there in the next. Where pixels
are turned at random that is seen: as grain, where the luminance of all colours has its centroid off the centre, and as
spots of colour, where it has not and each colour has. A colour in several pieces can have its own centroid in the
centre, and be as wide as it is high; then little is left that turning changes.

The search is an annealing over squares of the least width, as in :class:`maskfab.display.free_area.Squares`: one more
square takes away those of other colours that it comes too near to, or a square is taken away. It minimises the rms ΔE
of :func:`maskfab.display.evenness.sight`, slow grain, which counts by the limits of both, and what each colour lacks of
the area asked for, which at its end no colour may. The same seed gives the same placement. ΔE alone would leave three
times the grain, for beside spots of colour S-CIELAB makes little of luminance.
"""

from __future__ import annotations

import math
import random
from collections.abc import Iterable
from dataclasses import dataclass, replace

import numpy as np

from maskfab.base.arrays import Floats, Indices, Labels, Mask
from maskfab.base.model import Emitters, Opening, orient
from maskfab.base.units import NM_PER_UM
from maskfab.display.emitted_light import Viewing
from maskfab.display.emitter_rules import Certificate, EmitterGrid, EmitterRules, Footprint, Proof, Verdict
from maskfab.display.emitter_shapes import Ratio, labelled
from maskfab.display.evenness import Evenness, evenness_of, sight
from maskfab.display.eye import DEFAULT_GRAIN
from maskfab.display.free_area import Squares, border_margin, free_region
from maskfab.optics.colour import JUST_NOTICEABLE

_MOVES = 80_000
"""Some three seconds for 42 x 42 cells; five times as many make ΔE a fifth smaller."""
_HOT, _COLD = 0.2, 0.01
"""Temperatures, in ΔE."""
_LACK = 100.0
"""ΔE that the whole area of a colour is worth; a hundredth of it is worth a hundredth of one."""
_NOTHING = 10.0
_EDGE = 0.002
"""ΔE that a cell's side along a border of a colour is worth, so that pieces are few and their borders smooth."""
_TRIES = 3
"""Larger areas that are tried for limits that are asked for: an eighth of what is between is left."""
_AIM = 1.01
"""Times the area asked for, so that a colour that is short of its aim by a few cells has enough."""
USUAL = Evenness(JUST_NOTICEABLE, DEFAULT_GRAIN)
"""Most that an even field may show where nothing is asked."""
_ROUNDING = 1e-9
_DIGITS = 9


def in_pieces(
    opening: Opening,
    grid: EmitterGrid,
    orientations: Iterable[int],
    ratio: Ratio,
    least: float,
    viewing: Viewing,
    *,
    limits: Evenness = USUAL,
    seed: int = 0,
    moves: int = _MOVES,
) -> Emitters | None:
    """Emitters of at least ``least`` cells for each colour, times its ratio, that look most alike in all orientations.

    Args:
        opening: the pixel's.
        grid: its cells and rules; where the gap between colours is wider than the gutter, half of the difference stays
            free along each side.
        orientations: those in use.
        ratio: of the colours.
        least: cells.
        viewing: where the eye is.
        limits: of which neither is worth more than the other.
        seed: of the search.
        moves: of it.

    Returns:
        A placement that keeps all rules; None if none so large was found.
    """
    region = free_region(opening.mask, grid, orientations, margin=border_margin(grid))
    squares = Squares.of(region, grid.min_width, grid.colour_gap)
    targets = tuple(math.ceil(least * part - _ROUNDING) for part in ratio)
    if not squares.free or sum(targets) > squares.area(squares.free):
        return None
    seen = sight(grid, viewing, limits.delta_e / limits.grain)
    found = _Annealing(squares, seen, (targets[0], targets[1], targets[2]), seed).run(moves)
    return None if found is None else Emitters(labelled(squares, found), grid.cell_nm)


def look(emitters: Emitters, pitch_nm: int, orientations: Iterable[int], viewing: Viewing) -> Evenness:
    """Evenness of a field of pixels that are turned at random among some orientations."""
    pixels = [Emitters(orient(emitters.labels, k), emitters.cell_nm) for k in orientations]
    return evenness_of(pixels, np.full(len(pixels), 1 / len(pixels)), pitch_nm, viewing)


def pieces_bound(widest: Mask, grid: EmitterGrid, ratio: Ratio) -> tuple[float, Certificate]:
    """Footprint, in cells, that no emitters in however many pieces exceed, and why.

    Together they cover no more than the cells in which squares of the least width fit.
    """
    squares = Squares.of(widest, grid.min_width, grid.colour_gap)
    held = squares.area(squares.free)
    bound = min(math.floor(held * part / 3) / part for part in ratio)
    unit, share = (grid.cell_nm / NM_PER_UM) ** 2, (grid.cell_nm / grid.pitch_nm) ** 2
    text = (
        f"squares of {grid.min_width * grid.cell_nm / NM_PER_UM:g} um fit in {held * unit:.0f} um^2 of the area where "
        f"emitters may lie, so that three colours, in however many pieces, have at most {bound * share:.2%} of the "
        "pixel each"
    )
    numbers = {"free_um2": held * unit, "bound_share": bound * share}
    witness = squares.picture(squares.free)
    return bound, Certificate(Proof.COMPONENT_PACKING, text, numbers, witness, grid.cell_nm)


def placed_in_pieces(
    whole: Footprint,
    drawn: Emitters | None,
    opening: Opening,
    grid: EmitterGrid,
    orientations: Iterable[int],
    rules: EmitterRules,
    *,
    keep: float,
    viewing: Viewing,
    limits: Evenness = USUAL,
    larger: bool = False,
) -> tuple[Footprint, Emitters | None]:
    """The answer about emitters that may lie in pieces, from that about emitters each of which is one area.

    Args:
        whole: of emitters that are one area each.
        drawn: what would be drawn of these.
        opening, grid, orientations, rules: the pixel's.
        keep: share of the largest footprint that must be left.
        viewing: where the eye is.
        limits: most that an even field may show.
        larger: whether pieces are to have the largest area found that keeps these.

    Returns:
        The footprint, whose bound is that of pieces, and the emitters to draw: of those in pieces and the whole ones
        those that are farther below the limits.
    """

    def excess(placed: Emitters) -> float:
        """Share of the limit that is nearer, 1 at it."""
        seen = look(placed, grid.pitch_nm, used, viewing)
        return max(seen.delta_e / limits.delta_e, seen.grain / limits.grain)

    def searched(cells: float) -> Emitters | None:
        return in_pieces(opening, grid, used, rules.ratio, cells, viewing, limits=limits)

    used = tuple(sorted(set(orientations)))
    cell = (grid.cell_nm / grid.pitch_nm) ** 2
    widest = free_region(opening.mask, grid, used)
    bound, certificate = pieces_bound(widest, grid, rules.ratio)
    largest = whole.found_share / cell
    bound = max(bound, largest)
    least = max(min(keep, 1.0) * largest, rules.required / cell)
    parts = searched(least) if 0 < least <= bound + _ROUNDING else None
    if parts is not None and larger:
        low, high = least, max(least, largest)
        for _ in range(_TRIES if excess(parts) <= 1 else 0):
            middle = (low + high) / 2
            tried = searched(middle)
            if tried is not None and excess(tried) <= 1:
                low, parts = middle, tried
            else:
                high = middle
    chosen = drawn
    if parts is not None and (drawn is None or whole.verdict is not Verdict.FITS or excess(parts) < excess(drawn)):
        chosen = parts
    share = 0.0 if parts is None else _footprint(parts.labels, rules.ratio) * cell
    found = max(whole.found_share, share)
    if found > 0 and found >= rules.required - _ROUNDING:
        verdict = Verdict.FITS
    elif bound * cell < rules.required - _ROUNDING:
        verdict = Verdict.DOES_NOT_FIT
    else:
        verdict = Verdict.UNKNOWN
    answer = replace(
        whole,
        verdict=verdict,
        best=chosen if share > whole.found_share else whole.best,
        found_share=found,
        bound_share=bound * cell,
        certificate=certificate,
        method="several pieces" if share > whole.found_share else whole.method,
    )
    return answer, chosen


def _footprint(labels: Labels, ratio: Ratio) -> float:
    return min(float((labels == colour).sum()) / part for colour, part in enumerate(ratio, start=1))


@dataclass
class _Annealing:
    """Squares of three colours.

    Attributes:
        squares: of the region.
        seen: [3, n, n, terms] as :func:`maskfab.display.evenness.sight` has it.
        targets: least cells of each colour.
        seed: of the moves.
    """

    squares: Squares
    seen: Floats
    targets: tuple[int, int, int]
    seed: int

    def run(self, moves: int) -> tuple[int, int, int] | None:
        """The best placement with enough of every colour; None if there was none."""
        squares, lights, draw = self.squares, self._rows(), random.Random(self.seed)
        ys, xs = squares.places()
        places = [1 << int(y) * squares.stride + int(x) for y, x in zip(ys, xs, strict=True)]
        near: list[int] = [0] * len(places)
        held, covers, areas, edges = [0, 0, 0], [0, 0, 0], [0, 0, 0], [0, 0, 0]
        light = np.zeros((3, self.seen.shape[-1]))
        lack = self._lack(areas)
        value, best, least = lack, None, math.inf
        cooling = math.log(_COLD / _HOT) / moves
        for move in range(moves):
            place, colour = draw.randrange(len(places)), draw.randrange(3)
            most = value - _HOT * math.exp(cooling * move) * math.log(1 - draw.random())
            bit = places[place]
            changed = {colour: held[colour] ^ bit}
            if not held[colour] & bit:
                taken = near[place] = near[place] or squares.near(bit)
                changed |= {k: held[k] & ~taken for k in range(3) if k != colour and held[k] & taken}
            tried_covers, tried_areas, tried_edges = covers.copy(), areas.copy(), edges.copy()
            for k, now in changed.items():
                cover = tried_covers[k] = squares.cover(now)
                tried_areas[k] = cover.bit_count()
                tried_edges[k] = (cover ^ cover << 1).bit_count() + (cover ^ cover << squares.stride).bit_count()
            lack = self._lack(tried_areas) + _EDGE * sum(tried_edges)
            # Most moves of a cold search are refused for the area alone, which costs a tenth of the rest.
            if lack > most:
                continue
            tried_light = light.copy()
            for k in changed:
                moved = tried_covers[k] ^ covers[k]
                if more := moved & tried_covers[k]:
                    tried_light[k] += np.add.reduce(lights[k].take(_bits(more), axis=0))
                if less := moved & covers[k]:
                    tried_light[k] -= np.add.reduce(lights[k].take(_bits(less), axis=0))
            seen = np.array([1 / max(1, area) for area in tried_areas]) @ tried_light
            # Rounded, so that what is equal by symmetry is equal.
            tried = round(math.sqrt(float(seen @ seen)) + lack, _DIGITS)
            if tried > most:
                continue
            for k, now in changed.items():
                held[k] = now
            covers, areas, edges, light, value = tried_covers, tried_areas, tried_edges, tried_light, tried
            if value < least and all(area >= target for area, target in zip(areas, self.targets, strict=True)):
                best, least = (held[0], held[1], held[2]), value
        return best

    def _rows(self) -> Floats:
        """[3, bits, terms]: lights by the number of a cell's bit."""
        n, stride = self.squares.cells, self.squares.stride
        rows = np.zeros((3, n, stride, self.seen.shape[-1]))
        rows[:, :, :n] = self.seen
        return rows.reshape(3, n * stride, -1)

    def _lack(self, areas: list[int]) -> float:
        """Price of the area that is not there."""
        lack = 0.0
        for area, target in zip(areas, self.targets, strict=True):
            if area < _AIM * target:
                lack += _LACK * (1 - area / (_AIM * target)) ** 2 + (0.0 if area else _NOTHING)
        return lack


def _bits(number: int) -> Indices:
    """Numbers of the bits that are set; a few."""
    found = []
    while number:
        lowest = number & -number
        found.append(lowest.bit_length() - 1)
        number ^= lowest
    return np.array(found, dtype=np.intp)
