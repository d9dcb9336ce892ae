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
import operator
import random
from collections.abc import Iterable, Iterator
from dataclasses import replace
from functools import lru_cache

import numpy as np

from maskfab.base.arrays import Floats, Labels, Mask
from maskfab.base.model import Emitters, Opening, frozen, orient
from maskfab.base.units import NM_PER_UM
from maskfab.display.emitted_light import Viewing
from maskfab.display.emitter_rules import Certificate, EmitterGrid, EmitterRules, Footprint, Proof, Verdict
from maskfab.display.emitter_shapes import Ratio, labelled, proved_shapes
from maskfab.display.evenness import Evenness, evenness_of, sight
from maskfab.display.eye import DEFAULT_GRAIN
from maskfab.display.free_area import Squares, border_margin, both_ways, free_region
from maskfab.display.kept_layouts import origin_of, shipped
from maskfab.optics.colour import JUST_NOTICEABLE

_MOVES = 80_000
"""Half a second for 42 x 42 cells; five times as many make ΔE a fifth smaller."""
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
        grid: its cells and rules; where the gap between colours is wider than the gutter, half of the difference stays
            free along each side.
        limits: of which neither is worth more than the other.
    """
    region = free_region(opening.mask, grid, orientations, margin=border_margin(grid))
    red, green, blue = (math.ceil(least * part - _ROUNDING) for part in ratio)
    worth = limits.delta_e / limits.grain
    labels, kept = _placed(region.tobytes(), grid, (red, green, blue), viewing, worth, seed, moves)
    return None if labels is None else Emitters(labels, grid.cell_nm, kept)


@lru_cache(maxsize=16)
def _placed(
    region: bytes,
    grid: EmitterGrid,
    targets: tuple[int, int, int],
    viewing: Viewing,
    worth: float,
    seed: int,
    moves: int,
) -> tuple[Labels | None, bool]:
    """Colours of the cells of a region, and whether they came with the program; dies of one opening ask alike."""
    free = np.frombuffer(region, np.bool_).reshape(grid.cells, grid.cells)
    squares = Squares.of(free, grid.min_width, grid.colour_gap)
    if not squares.free or sum(targets) > squares.area(squares.free):
        return None, False

    def proved(labels: Labels) -> bool:
        shapes = proved_shapes(squares, labels)
        return shapes is not None and all(map(operator.ge, map(squares.area, shapes), targets))

    def search() -> Labels | None:
        found = _Annealing(squares, sight(grid, viewing, worth), targets, seed).run(moves)
        return None if found is None else labelled(squares, found)

    origin = origin_of("pieces", 1, free, grid, targets, viewing, worth, seed, moves)
    labels, kept = shipped().layout(origin, proved, search)
    return None if labels is None else frozen(labels), kept


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


_OTHERS = ((1, 2), (0, 2), (0, 1))
_Change = tuple[int, int, int, int, int]
"""A colour, its squares and the cells that they cover then, the cells that come or go, how many: below 0 if they go."""


class _Annealing:
    """Squares of three colours. Most moves are refused, for no more than has to be known of them."""

    def __init__(self, squares: Squares, seen: Floats, targets: tuple[int, int, int], seed: int) -> None:
        """No square of any colour yet; ``seen`` is [3, n, n, terms] as of :func:`maskfab.display.evenness.sight`."""
        n, stride, terms = squares.cells, squares.stride, seen.shape[-1]
        self.squares, self.targets, self.seed = squares, targets, seed
        ys, xs = squares.places()
        self.bits = [1 << int(number) for number in ys * stride + xs]
        self.near = [squares.near(bit) for bit in self.bits]
        self.whole = [squares.cover(bit) for bit in self.bits]
        rows = np.zeros((3, n, stride, terms))
        rows[:, :, :n] = seen
        # Lights by the number of a cell's bit, and of whole squares by their place.
        self.rows = list(rows.reshape(3, n * stride, terms))
        square = [y * stride + x for y in range(squares.width) for x in range(squares.width)]
        self.lit = [list(sum(own[ys * stride + xs + cell] for cell in square)) for own in self.rows]
        self.prices = [[_lack(area, target) for area in range(n * n + 1)] for target in targets]
        self.inverse = [1 / max(1, area) for area in range(n * n + 1)]
        self.held, self.covers, self.areas, self.edges = [0, 0, 0], [0, 0, 0], [0, 0, 0], [0, 0, 0]
        # Light of each colour, and after it what a move changes, in the order of its changes.
        self.parts, self.shares, self.sum = np.zeros((6, terms)), np.zeros(6), np.empty(terms)
        self.lights, self.shared = list(self.parts), self.shares.data.cast("B").cast("d")
        self.shifts = both_ways(squares.stride, squares.width - 1)
        widest = 3 * squares.width + 2 * squares.gap
        self.raw = bytearray((widest * stride + 7) // 8)
        self.bytes = np.frombuffer(self.raw, np.uint8)
        taken, ones = np.empty((widest**2, terms)), np.ones(widest**2)
        self.taken = [(taken[:count], ones[:count]) for count in range(widest**2 + 1)]

    def run(self, moves: int) -> tuple[int, int, int] | None:
        """The best placement with enough of every colour; None if there was none."""
        held, (red, green, blue) = self.held, self.prices
        value, best, least, border = red[0] + green[0] + blue[0], None, math.inf, 0
        for place, colour, spare in _draws(self.seed, len(self.bits), moves):
            changes = self._changes(place, colour)
            areas, flips = self.areas.copy(), 0
            for k, _, _, _, more in changes:
                areas[k] += more
                flips += abs(more)
            if not flips:
                for k, squares, *_ in changes:
                    held[k] = squares
                continue
            most = value + spare
            lack = red[areas[0]] + green[areas[1]] + blue[areas[2]]
            # A cell has four sides: what is too dear without them needs no count of borders, or none of light either.
            bound = lack + _EDGE * (border - 4 * flips) - _ROUNDING
            if bound > most:
                continue
            length = self._length(place, changes, areas)
            if bound + length > most:
                continue
            edges = self._edges(changes)
            # Rounded, so that what is equal by symmetry is equal.
            tried = round(length + (lack + _EDGE * sum(edges)), _DIGITS)
            if tried > most:
                continue
            self._take(changes)
            self.areas, self.edges, value, border = areas, edges, tried, sum(edges)
            if value < least and all(area >= target for area, target in zip(areas, self.targets, strict=True)):
                best, least = (held[0], held[1], held[2]), value
        return best

    def _changes(self, place: int, colour: int) -> list[_Change]:
        """Changes by one more square of a colour, or one less where it has that square; those of the colour first."""
        held, covers, shifts = self.held, self.covers, self.shifts
        own, old, bit = held[colour], covers[colour], self.bits[place]
        if own & bit:
            new = self.squares.cover(own ^ bit)
            return [(colour, own ^ bit, new, old ^ new, -(old ^ new).bit_count())]
        come = self.whole[place] & ~old
        changes = [(colour, own | bit, old | come, come, come.bit_count())]
        near = self.near[place]
        for k in _OTHERS[colour]:
            # As :meth:`maskfab.display.free_area.Squares.cover` does; most of a search's time is spent here and in
            # :meth:`_length`.
            if taken := held[k] & near:
                new = left = held[k] ^ taken
                for shift in shifts:
                    new |= new << shift
                gone = covers[k] ^ new
                changes.append((k, left, new, gone, -gone.bit_count()))
        return changes

    def _length(self, place: int, changes: list[_Change], areas: list[int]) -> float:
        """Length of the sum of the colours' lights over their areas, after a move."""
        shares, inverse, part = self.shared, self.inverse, 3
        shares[0], shares[1], shares[2] = inverse[areas[0]], inverse[areas[1]], inverse[areas[2]]
        shares[3] = shares[4] = shares[5] = 0.0
        for k, _, _, cells, more in changes:
            if not more:
                continue
            if cells == self.whole[place]:
                self.parts[part] = self.lit[k][place]
            elif -3 < more < 3:
                self.parts[part] = self.rows[k][cells.bit_length() - 1]
                if more not in (1, -1):
                    self.parts[part] += self.rows[k][(cells & -cells).bit_length() - 1]
            else:
                first = (cells & -cells).bit_length() - 1
                self.raw[:] = (cells >> first).to_bytes(len(self.raw), "little")
                numbers = np.unpackbits(self.bytes, 0, None, "little").view(np.bool_).nonzero()[0]
                taken, ones = self.taken[abs(more)]
                self.rows[k][first:].take(numbers, 0, taken, "clip")
                ones.dot(taken, self.lights[part])
            shares[part] = inverse[areas[k]] if more > 0 else -inverse[areas[k]]
            part += 1
        self.shares.dot(self.parts, self.sum)
        return math.sqrt(self.sum.dot(self.sum))

    def _edges(self, changes: list[_Change]) -> list[int]:
        """Sides of cells along the borders of each colour, after a move."""
        edges, stride = self.edges.copy(), self.squares.stride
        for k, _, cover, _, _ in changes:
            edges[k] = (cover ^ cover << 1).bit_count() + (cover ^ cover << stride).bit_count()
        return edges

    def _take(self, changes: list[_Change]) -> None:
        lights, part = self.lights, 3
        for k, self.held[k], self.covers[k], _, more in changes:
            if more > 0:
                lights[k] += lights[part]
            elif more:
                lights[k] -= lights[part]
            part += bool(more)


def _draws(seed: int, places: int, moves: int) -> Iterator[tuple[int, int, float]]:
    """Place, colour, and what a move may cost, as ``randrange`` and ``random`` draw them; these take twice as long."""
    draw = random.Random(seed)
    bits, number, cooling = places.bit_length(), draw.getrandbits, math.log(_COLD / _HOT) / moves
    for move in range(moves):
        place = number(bits)
        while place >= places:
            place = number(bits)
        colour = number(2)
        while colour == 3:
            colour = number(2)
        yield place, colour, -_HOT * math.exp(cooling * move) * math.log(1 - draw.random())


def _lack(area: int, target: int) -> float:
    """Price of the area that a colour lacks."""
    aim = _AIM * target
    return _LACK * (1 - area / aim) ** 2 + (0.0 if area else _NOTHING) if area < aim else 0.0
