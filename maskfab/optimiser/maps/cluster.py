"""Light shared unevenly within groups of 2 x 2 pixels, each of which passes what four equal pixels do.

Two pixels of every group hold a denser unit, two a sparser one: larger openings scatter less light. A group is laid and
turned as one. The map chooses among several arrangements of a group, which differ in what each of its pixels holds and
in how that is turned within the group, so that groups do not repeat on a lattice, whose orders would be seen.

All pixels have one plan of emitters, as in :mod:`maskfab.optimiser.maps.density`: no colour, luminance or life differs
from pixel to pixel.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass, replace
from itertools import islice

import numpy as np
from numpy.typing import NDArray

from maskfab.base.arrays import Mask
from maskfab.errors import JobError
from maskfab.jobfile import SearchSection
from maskfab.model import ORIENTATIONS, orient, side_by_side
from maskfab.optimiser.maps.density import Graded, behind, display_price, shown
from maskfab.optimiser.maps.orientation_map import DesignedMap, MapMode, design_map
from maskfab.optimiser.model.layout_error import PanelError
from maskfab.optimiser.rules.constraints import Constraints
from maskfab.plate.tiling import MOST_OPENINGS
from maskfab.progress import Progress, silent

SIDE = 2
"""Pixels along a group."""

_UNITS = 24
"""Denser and sparser units, each, of which pairs are drawn."""
_PAIRS, _ARRANGED = 400, 600
"""Arrangements drawn of all pairs, and of the pair that is taken."""
_BEST = 150
"""Of the latter, the best, among which the map's are spread: more alike ones would leave it less to choose from."""
_TRIED = 12
"""Pairs that are tried before a display is said not to hold them."""
_MARKS = np.arange(9).reshape(3, 3)


@dataclass(frozen=True, eq=False)
class Groups:
    """Groups of pixels as the search judges them.

    Attributes:
        value: of a group, bool [2 dots, 2 dots], the groups turned at random; higher is better.
        error: of panels of groups.
    """

    value: Callable[[Mask], float]
    error: PanelError


@dataclass(frozen=True)
class Arrangement:
    """Contents of a group's pixels.

    Attributes:
        held: the unit of each, 0 the denser one, row by row from the lower left.
        turned: the element of D4 under which it lies there.
    """

    held: tuple[int, ...]
    turned: tuple[int, ...]

    def group(self, units: Mask) -> Mask:
        """The group of these units, bool [2, dots, dots], as bool [2 dots, 2 dots]."""
        cells = np.stack([orient(units[u], k) for u, k in zip(self.held, self.turned, strict=True)])
        return side_by_side(cells.reshape(SIDE, SIDE, *cells.shape[1:]))

    def cells(self, element: int) -> NDArray[np.int8]:
        """Contents of the pixels of a turned group, int8 [2, 2]: 8 u + k for unit u under element k."""
        here = np.array(self.held).reshape(SIDE, SIDE)
        turned = np.array([_in_turn(k, element) for k in self.turned]).reshape(SIDE, SIDE)
        return orient(ORIENTATIONS * here + turned, element).astype(np.int8)


def clustered(
    uniform: Mask,
    error: PanelError,
    most_dots: int,
    find: Callable[[int], Iterable[Mask]],
    groups: Groups,
    *,
    constraints: Constraints,
    seed: int = 0,
    kicks: int = 0,
    progress: Progress = silent,
) -> Graded:
    """Design a panel of groups whose pixels share their light unevenly, at equal light.

    Args:
        uniform: bool [dots, dots], the unit of the panel that is compared with.
        error: of panels of such units.
        most_dots: clear dots of the denser unit; the sparser one has as many fewer.
        find: gives units of so many clear dots that keep the constraints, bool [dots, dots], the best first.
        groups: how they are judged.
        constraints: that each unit keeps for its own count of clear dots, and both beside one another.
        seed: of the random map, and of the arrangements.
        kicks: as of :func:`maskfab.optimiser.maps.orientation_map.design_map`.
        progress: as ``design_map`` tells.

    Raises:
        JobError: MF104 for dots that are not more than the uniform unit's and less than twice as many; MF123 for units
            that break the constraints, or a display that fits no pair of them on its map.
    """
    mask = np.asarray(uniform, dtype=np.bool_)
    first = error.laid(mask, seed=seed)
    clear = round(float(first.sum()))
    why = "none was found"
    for units in islice(_pairs(find, shares(int(mask.sum()), most_dots), groups, seed), _TRIED):
        if broken := constraints.broken_beside(units):
            why = f"they break {broken} where they meet"
            continue
        arranged = _spread(units, groups, seed)
        designed = design_map(
            np.stack([each.group(units) for each in arranged]),
            groups.error,
            mode=MapMode.EQUAL_LIGHT,
            seed=seed,
            kicks=kicks,
            light=clear,
            progress=progress,
        )
        pixels = _cut(pixel_map(designed, arranged), error.cells)
        fit, lines = shown(units, pixels.orientations, constraints)
        if fit is not None and fit.why is not None:
            why = fit.why
            continue
        price = display_price(mask, units, constraints, lines)
        return Graded(units, pixels, error.psnr(first), clear, price, fit)
    raise JobError(
        "MF123",
        f"no pair of openings of {' and '.join(map(str, shares(int(mask.sum()), most_dots)))} clear dots keeps the "
        f"rules in groups: {why}",
        where="most_dots",
        cure="Choose fewer most_dots, or relax that rule",
    )


def most_dots(section: SearchSection) -> int:
    """Clear dots of the denser pixels of a group."""
    return 3 * section.clear_dots // 2 if section.most_dots is None else section.most_dots


def shares(clear_dots: int, most_dots: int) -> tuple[int, int]:
    """Clear dots of the denser and the sparser unit for the light of a uniform panel.

    Raises:
        JobError: MF104 for dots that are not more than the uniform unit's and less than twice as many.
    """
    if not clear_dots < most_dots < 2 * clear_dots:
        raise JobError(
            "MF104",
            f"most_dots = {most_dots} is not above the {clear_dots} clear dots of a pixel and below twice as many",
            where="design.most_dots",
            cure=f"Choose {clear_dots + 1} to {2 * clear_dots - 1}" if clear_dots > 1 else "Ask for more clear_dots",
        )
    return most_dots, 2 * clear_dots - most_dots


def pixel_map(designed: DesignedMap, arranged: list[Arrangement]) -> DesignedMap:
    """The map of the pixels from that of their groups, [rows, columns] of 8 a + k for arrangement a under element k."""
    known = np.stack([each.cells(k) for each in arranged for k in range(ORIENTATIONS)])
    return replace(designed, orientations=side_by_side(known[designed.orientations]))


def _cut(pixels: DesignedMap, cells: int) -> DesignedMap:
    """The map without pixels beyond the cells that cover the stop; groups take up to one more on each side."""
    spare = (len(pixels.orientations) - cells) // 2
    return replace(pixels, orientations=pixels.orientations[spare : spare + cells, spare : spare + cells])


def _pairs(find: Callable[[int], Iterable[Mask]], counts: tuple[int, int], groups: Groups, seed: int) -> Iterator[Mask]:
    """Denser and sparser units, bool [2, dots, dots], in the order of the best arrangement that was drawn of them."""
    dense, sparse = (list(islice(find(count), _UNITS)) for count in counts)
    draw = np.random.default_rng([seed, 2])
    best: dict[tuple[int, int], float] = {}
    for _ in range(_PAIRS):
        pair = int(draw.integers(len(dense))), int(draw.integers(len(sparse)))
        units = np.stack([dense[pair[0]], behind(sparse[pair[1]], dense[pair[0]], range(ORIENTATIONS))])
        best[pair] = max(best.get(pair, -np.inf), groups.value(_drawn(draw).group(units)))
    for i, j in sorted(best, key=lambda pair: -best[pair]):
        yield np.stack([dense[i], behind(sparse[j], dense[i], range(ORIENTATIONS))])


def _spread(units: Mask, groups: Groups, seed: int) -> list[Arrangement]:
    """Arrangements for the map to choose from, spread over the best that were drawn."""
    draw = np.random.default_rng([seed, 3])
    drawn = list(dict.fromkeys(_drawn(draw) for _ in range(_ARRANGED)))
    drawn.sort(key=lambda each: -groups.value(each.group(units)))
    return drawn[:_BEST][:: _BEST // MOST_OPENINGS][:MOST_OPENINGS]


def _drawn(draw: np.random.Generator) -> Arrangement:
    held = draw.permutation(np.repeat([0, 1], SIDE**2 // 2))
    return Arrangement(tuple(held.tolist()), tuple(draw.integers(ORIENTATIONS, size=SIDE**2).tolist()))


def _in_turn(first: int, then: int) -> int:
    """The element of D4 that does both."""
    moved = orient(orient(_MARKS, first), then)
    return next(k for k in range(ORIENTATIONS) if np.array_equal(orient(_MARKS, k), moved))
