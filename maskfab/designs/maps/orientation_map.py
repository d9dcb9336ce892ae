"""Orientation maps: which way every cell of the panel is turned, chosen all at once by the adjoint field.

With p the pupil, g the slope of the loss by its autocorrelation and f its slope by the pupil
(:mod:`maskfab.designs.model.panel_error`), turning one cell, so that its dots change by δ, changes the loss by

    f·δ + sum over t of g(t) (δ ⋆ δ)(t)

up to the curvature of the loss by the autocorrelation: the part that is quadratic in δ is exact. One field thus prices
every orientation of every cell. A share of the best turns is made together and judged exactly; where the loss does not
fall they are undone and the share shrinks, else it grows. When no single turn helps any more, the map is done; then a
few cells are turned at random and the rest answers, and the best map is kept.

``equal_light`` keeps the clear dots inside the stop, which only cells that the stop cuts can change, within 0.1 % of
the random map that it starts from; turns are compared at the price of light at which its sum stays. ``edge_packing``
starts with the cut cells turned so that most of their opening is inside, and leaves the light free: more of it is
worth decibels that are no merit of the map.

With ``positions`` the map also moves its one opening inside the cells, to few of the places that it can have there,
because what a cell holds is one signed byte. Places that differ by an element of D4 are one: the map turns the cell
anyway. They are chosen by the field of the first map one after the other, each for what it adds when every cell takes
the best of those chosen.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from enum import StrEnum

import numpy as np
from numpy.typing import NDArray

from maskfab.base.arrays import Floats, Singles
from maskfab.base.errors import JobError
from maskfab.base.model import ORIENTATIONS, Scalar, frozen, orient, side_by_side, split_cells
from maskfab.base.work import NO_END, Clock, Progress, silent
from maskfab.camera.stop_cells import CellGrid
from maskfab.designs.model.panel_judgement import PanelError, Slope, parted
from maskfab.designs.rules.families import turned_key
from maskfab.mask.opening_masks import closed
from maskfab.mask.panels import Shift, shifted
from maskfab.optics.tiling import MOST_OPENINGS

LIGHT_TOLERANCE = 1e-3
"""Largest relative difference in clear dots that counts as equal light."""

_MOST_CANDIDATES = 48

_FIRST_SHARE, _LARGEST_SHARE = 0.1, 0.5

_GROWTH, _SHRINKAGE = 1.6, 0.3

_REFUSALS = 3

_MOST_DOTS = 85
"""Along a cell; all pairs of them take 1.5 GB."""

_MOST_CELLS = 1000
"""Along the panel, as of every map's file."""

_KICKED_SHARE = 0.04


# At first one turn is worth some 2e-3 dB.
FIRST_STEPS = 16
"""Fields of a descent that bring most of the gain."""

_ENOUGH_DB = 2e-5

_WORTH_ANOTHER_DB = 1e-3


class MapMode(StrEnum):
    """Freedom of the map besides the orientations: none, or the transmission."""

    EQUAL_LIGHT = "equal_light"
    EDGE_PACKING = "edge_packing"


@dataclass(frozen=True, eq=False)
class DesignedMap:
    """A map with what it was measured against.

    Attributes:
        orientations: int8 [cells, cells], 24 x 24 of 168 µm, 8 u + k for unit u under element k of D4, row 0 the
            lowest.
        psnr: expected restored PSNR in dB at each level.
        start_psnr: the same of the random map of the seed.
        clear_dots: inside the stop.
        start_clear_dots: the same of the random map.
        fields: adjoint fields that were computed.
        history: the loss after each, dB, lower is better.
        shifts: (right, up) in dots of every unit u, which is the one unit moved by that; empty without positions.
    """

    orientations: NDArray[np.int8]
    mode: MapMode
    psnr: tuple[float, ...]
    start_psnr: tuple[float, ...]
    clear_dots: int
    start_clear_dots: int
    fields: int
    history: tuple[float, ...]
    shifts: tuple[Shift, ...] = ()

    def __post_init__(self) -> None:
        object.__setattr__(self, "orientations", frozen(np.asarray(self.orientations, dtype=np.int8)))

    @property
    def gain_db(self) -> tuple[float, ...]:
        """Gain over the random map, at each level."""
        return tuple(a - b for a, b in zip(self.psnr, self.start_psnr, strict=True))


def design_map(
    units: NDArray[np.bool_],
    error: PanelError,
    *,
    mode: MapMode = MapMode.EQUAL_LIGHT,
    seed: int = 0,
    kicks: int = 3,
    positions: int = 1,
    shifts: Sequence[Shift] = (),
    allows: Callable[[NDArray[np.bool_]], bool] = lambda _: True,
    start: NDArray[np.int8] | None = None,
    light: int | None = None,
    keep_units: bool = False,
    holds: Callable[[NDArray[np.int8]], bool] = lambda _: True,
    steps: int | None = None,
    clock: Clock | None = None,
    progress: Progress = silent,
) -> DesignedMap:
    """Design the orientation map of the cells that cover the stop.

    Args:
        units: bool [dots, dots], or [units, dots, dots] among which every cell chooses as well.
        mode: whether the light stays.
        seed: of the random map it starts from, drawn as protocol F1 draws it, and of the kicks.
        kicks: how often cells are turned at random after the first descent; 0 for none.
        positions: how many places inside the cell the map may move the unit to, at most; 1 for none but its own.
        shifts: these places themselves, (right, up) in dots, in place of a choice; the first is (0, 0).
        allows: whether the unit, bool [dots, dots], may stand where it was moved to, asked for every other place.
        start: integers [cells, cells] to go on from, as :attr:`DesignedMap.orientations`; None starts at the random
            map. Light and gains are still those of the random map.
        light: clear dots inside the stop that equal light is; None takes those of the random map.
        keep_units: cells keep the unit that ``start`` gives them and turn only; the random map is then ``start``.
        holds: whether a map is allowed, integers [cells, cells] as ``start``, which must be; turns that are not are
            refused.
        steps: after so many fields the map is taken as it is; None for as many as help.
        clock: when its time is over, the map is taken as it is after :data:`FIRST_STEPS` fields; None for no end.

    Raises:
        OpeningError: MF201 to MF203 as :func:`maskfab.camera.stop_cells.lay`.
        JobError: MF122 for units of other dots than the error's, or more than 15 of them; for several units together
            with positions; for shifts that move clear dots out of the cell. MF104 for fewer positions than 1. MF115
            for more than 85 dots along a cell, or 1000 cells along the panel.
    """
    stack = np.asarray(units)
    stack = stack[None] if stack.ndim == 2 else stack
    _check(stack, error, positions, shifts)
    size = error.cells, error.cells
    random = np.random.default_rng(seed).integers(ORIENTATIONS * len(stack), size=size).astype(np.int8)
    drawn = random if start is None else np.asarray(start, dtype=np.int8)
    first = error.laid(stack, drawn if keep_units else random)
    target = float(first.sum()) if light is None else float(light)
    if shifts or positions > 1:
        places_used = tuple(shifts) or _placed(stack[0], error, mode, random, positions, allows)
        stack = np.stack([shifted(stack[0], shift) for shift in places_used])
    else:
        places_used = ()
    search = _Search(stack, error.of_steps, mode, target, math.inf if steps is None else steps, clock or NO_END, holds)
    draw = np.random.default_rng([seed, 1])
    if keep_units:
        search.bar(drawn)
    best = search.descend(search.packed(drawn) if mode is MapMode.EDGE_PACKING else drawn)
    progress("map", 1, kicks + 1)
    for kick in range(kicks):
        if search.over:
            break
        kicked = search.kicked(best.chosen, draw)
        if not search.held(kicked):
            continue
        state = search.descend(kicked)
        best = min(best, state, key=lambda state: state.loss)
        progress("map", kick + 2, kicks + 1)
    chosen = best.chosen.reshape(size).astype(np.int8)
    return DesignedMap(
        chosen,
        mode,
        error.psnr(search.pupil(best.chosen)),
        error.psnr(first),
        round(float(search.pupil(best.chosen).sum())),
        round(target),
        len(search.history),
        tuple(search.history),
        places_used,
    )


def require_size(room: CellGrid) -> None:
    """Refuse a map of more than 85 dots along a cell, or 1000 cells along the panel (MF115)."""
    for have, most, what in (
        (room.dots, _MOST_DOTS, "dots along a cell"),
        (room.cells, _MOST_CELLS, "cells along the panel"),
    ):
        if have > most:
            raise JobError(
                "MF115",
                f"{have} {what} are too many for a map; the limit is {most}",
                where="design.map",
                cure="Use a coarser opening, or no map",
            )


def _check(stack: NDArray[np.bool_], error: PanelError, positions: int, shifts: Sequence[Shift]) -> None:
    require_size(error.lattice)
    if not 0 < len(stack) <= MOST_OPENINGS or stack.shape[-1] != error.dots:
        what = (
            f"{len(stack)} openings of {stack.shape[-1]} dots a side for a panel of 1 to {MOST_OPENINGS} openings of "
            f"{error.dots}"
        )
        raise JobError("MF122", what, where="orientation map", cure="Give openings of the panel's dots")
    if not 1 <= positions <= MOST_OPENINGS or len(shifts) > MOST_OPENINGS:
        what = f"{max(positions, len(shifts)) if positions > 0 else positions} positions are not 1 to {MOST_OPENINGS}"
        raise JobError("MF104", what, where="positions", cure="Use a number in that range")
    if (positions > 1 or shifts) and len(stack) > 1:
        what = f"{len(stack)} openings cannot be moved as well"
        raise JobError("MF122", what, where="positions", cure="Give a single opening, or positions = 1")
    if shifts and shifts[0] != (0, 0):
        cure = "Give (0, 0) as the first shift: the opening in its own place"
        raise JobError("MF122", f"the first shift is {shifts[0]}", where="positions", cure=cure)
    for shift in shifts:
        lost = int(stack[0].sum()) - int(shifted(stack[0], shift).sum())
        if lost:
            what = f"the shift {shift} moves {lost} clear dots out of the cell"
            cure = "Use a shift that keeps every clear dot inside the cell"
            raise JobError("MF122", what, where="positions", cure=cure)


def _placed(
    unit: NDArray[np.bool_],
    error: PanelError,
    mode: MapMode,
    drawn: NDArray[np.int8],
    count: int,
    allows: Callable[[NDArray[np.bool_]], bool],
) -> tuple[Shift, ...]:
    """The places that promise most together, by the field of the random map."""
    first, *rest = places(unit)
    candidates = (first, *(shift for shift in rest if allows(shifted(unit, shift))))
    stack = np.stack([shifted(unit, shift) for shift in candidates])
    search = _Search(stack, error.of_steps, mode, float(error.laid(unit, drawn).sum()))
    state = search.fresh(drawn.ravel().astype(np.int64))
    worth = state.turns + search.price(state) * search.change(state.chosen)
    best = worth.reshape(len(worth), len(candidates), ORIENTATIONS).min(axis=2)
    return tuple(candidates[k] for k in best_places(best, count))


def places(unit: NDArray[np.bool_], most: int = _MOST_CANDIDATES) -> tuple[Shift, ...]:
    """Shifts (right, up) in dots that keep all clear dots in the cell and are not alike under D4; (0, 0) is the first.

    Args:
        unit: bool [dots, dots].
        most: at least 1; where there are more places, they are thinned evenly, in steps along both axes.

    Raises:
        OpeningError: MF203 for a unit without clear dots.
    """
    mask = np.asarray(unit, dtype=np.bool_)
    if not mask.any():
        raise closed(0, mask.size, where="positions", cure="Give an opening with at least 1 clear dot")
    rows, columns = np.flatnonzero(mask.any(axis=1)), np.flatnonzero(mask.any(axis=0))
    step = 1
    while True:
        ups = _steps(-int(rows[0]), len(mask) - 1 - int(rows[-1]), step)
        rights = _steps(-int(columns[0]), len(mask) - 1 - int(columns[-1]), step)
        distinct: dict[bytes, Shift] = {turned_key(mask): (0, 0)}
        for up in ups:
            for right in rights:
                distinct.setdefault(turned_key(shifted(mask, (right, up))), (right, up))
        # With the widest step the corners are left, which may be too many still.
        if len(distinct) <= most or step >= len(mask):
            return tuple(distinct.values())[:most]
        step += 1


def _steps(low: int, high: int, step: int) -> list[int]:
    """From low to high, both ends and 0 included, about ``step`` apart."""
    if step == 1:
        return list(range(low, high + 1))
    spread = np.linspace(low, high, 1 + -(-(high - low) // step))
    return sorted({0, *(round(float(value)) for value in spread)})


def best_places(worth: Floats, count: int) -> tuple[int, ...]:
    """Which of the places to keep, the first always.

    Args:
        worth: [cells, places], what the best turn of a cell at a place changes, dB; less is better.

    Raises:
        JobError: MF104 for a count below 1.
    """
    if count < 1:
        raise JobError("MF104", f"{count} positions are less than 1", where="positions", cure="Use 1 or more")
    chosen = [0]
    held = np.minimum(worth[:, 0], 0)
    while len(chosen) < min(count, worth.shape[1]):
        total = np.minimum(worth, held[:, None]).sum(axis=0)
        total[chosen] = np.inf
        best = int(total.argmin())
        chosen.append(best)
        held = np.minimum(held, worth[:, best])
    return tuple(chosen)


@dataclass(frozen=True, eq=False)
class _State:
    """A map between two descents: what every cell holds, int64 [cells], and its turns."""

    chosen: NDArray[np.int64]
    epsilons: tuple[float, ...]
    loss: float
    turns: Floats


class _Search:
    """The constants of one search: what every cell can hold, what the stop leaves of it."""

    def __init__(
        self,
        units: NDArray[np.bool_],
        error: PanelError,
        mode: MapMode,
        target: float,
        steps: float = math.inf,
        clock: Clock = NO_END,
        holds: Callable[[NDArray[np.int8]], bool] = lambda _: True,
    ) -> None:
        dots = error.dots
        self.error, self.mode = error, mode
        self.patterns = np.stack([orient(unit, k) for unit in units for k in range(ORIENTATIONS)]).astype(np.float64)
        self.flat = self.patterns.reshape(len(self.patterns), dots * dots)
        self.inside = _by_cell(error.inside.astype(np.float64), dots)
        self.light = self.inside @ self.flat.T
        self.live = np.flatnonzero(self.inside.any(axis=1))
        self.cut = np.flatnonzero(self.inside.any(axis=1) & ~self.inside.all(axis=1))
        # Dots of a cell that no lag in question parts from one another lie together.
        self.parted = _parted(self.flat, dots, error.stride)
        self.rim = _parted(self.flat * self.inside[self.cut, None], dots, error.stride)
        self.target, self.steps, self.clock, self.holds = target, steps, clock, holds
        self.history: list[float] = []
        self.barred = np.zeros(self.light.shape, dtype=np.bool_)
        across = -(-dots // error.stride)
        y, x = error.stride * np.stack(np.divmod(np.arange(across * across), across))
        self.apart = (y[:, None] - y + dots - 1, x[:, None] - x + dots - 1)

    @property
    def over(self) -> bool:
        fields = len(self.history)
        return fields >= self.steps or ((fields >= FIRST_STEPS or self.clock.halt.is_set()) and self.clock.over)

    def bar(self, drawn: NDArray[np.int8]) -> None:
        """Keep every cell's unit."""
        units = np.arange(len(self.flat)) // ORIENTATIONS
        self.barred = units != drawn.ravel()[:, None] // ORIENTATIONS

    def held(self, chosen: NDArray[np.int64]) -> bool:
        return self.holds(chosen.reshape(self.error.cells, self.error.cells).astype(np.int8))

    def pupil(self, chosen: NDArray[np.int64]) -> Floats:
        cells = self.patterns[chosen.reshape(self.error.cells, self.error.cells)]
        return np.asarray(side_by_side(cells) * self.error.inside)

    def packed(self, drawn: NDArray[np.int8]) -> NDArray[np.int8]:
        """The map with every cut cell turned so that the most light is inside; of equals, the drawn one first."""
        chosen = drawn.ravel().copy()
        own = np.take_along_axis(self.light, chosen[:, None].astype(np.int64), axis=1)[:, 0]
        light = np.where(self.barred, -1, self.light)
        better = light.max(axis=1) > own
        chosen[better] = light.argmax(axis=1)[better]
        return chosen

    def kicked(self, chosen: NDArray[np.int64], draw: np.random.Generator) -> NDArray[np.int64]:
        whole = np.setdiff1d(self.live, self.cut)
        turned = chosen.copy()
        if len(whole):
            cells = draw.choice(whole, size=max(1, round(_KICKED_SHARE * len(whole))), replace=False)
            turned[cells] += draw.integers(ORIENTATIONS, size=len(cells)) - turned[cells] % ORIENTATIONS
        return turned

    def descend(self, start: NDArray[np.integer]) -> _State:
        """Turn cells until no turn helps; the ε and the price of light are those of the start, then of the end."""
        state = self.fresh(start.ravel().astype(np.int64))
        while True:
            price = self.price(state)
            after = self.fresh(self._descended(state, price))
            # Where light has a price, the way may end above its beginning by what the band of light is worth.
            if after.loss > state.loss - _WORTH_ANOTHER_DB or self.over:
                return min(state, after, key=lambda end: end.loss)
            state = after

    def fresh(self, chosen: NDArray[np.int64]) -> _State:
        pupil = self.pupil(chosen)
        epsilons = self.error.epsilons(pupil)
        judged = self.error.judge(pupil, epsilons)
        return _State(chosen, epsilons, judged.loss, self._turns(chosen, judged.slope()))

    def _descended(self, state: _State, price: float) -> NDArray[np.int64]:
        """Contents of the cells at the end of the descent, when no turn improves them as predicted."""
        chosen, loss, turns, share, refused = state.chosen, state.loss, state.turns, _FIRST_SHARE, 0
        while True:
            self.history.append(loss)
            worth = self._worth(turns, chosen, price)
            helpful = max(1, int((worth.min(axis=1) < -_ENOUGH_DB).sum()))
            most = max(1, round(share * helpful))
            while True:
                cells, kinds = self._selected(chosen, worth, most)
                if not len(cells):
                    return chosen
                tried = chosen.copy()
                tried[cells] = kinds
                after = self.error.judge(self.pupil(tried), state.epsilons)
                paid = price * float((self._light_of(tried) - self._light_of(chosen)).sum())
                if after.loss + paid < loss - _ENOUGH_DB and self.held(tried):
                    break
                if len(cells) == 1:
                    worth[cells, kinds], refused = 0, refused + 1
                    if refused > _REFUSALS:
                        return chosen
                most = max(1, round(len(cells) * _SHRINKAGE))
            if self.over:
                return tried
            chosen, loss, turns, refused = tried, after.loss, self._turns(tried, after.slope()), 0
            share = min(_LARGEST_SHARE, _GROWTH * len(cells) / helpful)

    def change(self, chosen: NDArray[np.int64]) -> Floats:
        """Clear dots inside the stop that turning every cell to every kind adds, [cells, kinds]."""
        return self.light - self._light_of(chosen)[:, None]

    def _worth(self, turns: Floats, chosen: NDArray[np.int64], price: float) -> Floats:
        """The turns with their light paid, 0 for those that are barred."""
        return np.where(self.barred, 0.0, turns + price * self.change(chosen))

    def _light_of(self, chosen: NDArray[np.int64]) -> Floats:
        return np.take_along_axis(self.light, chosen[:, None], axis=1)[:, 0]

    def _turns(self, chosen: NDArray[np.int64], slope: Slope) -> Floats:
        """Change by turning every cell to every kind, [cells, kinds], dB; 0 for its present one."""
        linear = (_by_cell(slope.field, self.error.dots) * self.inside) @ self.flat.T
        pairs = slope.near.astype(np.float32)[self.apart]
        kinds = len(self.flat)
        whole = (self.parted.reshape(-1, len(pairs)) @ pairs).reshape(kinds, -1) @ self.parted.reshape(kinds, -1).T
        turns = linear - np.take_along_axis(linear, chosen[:, None], axis=1)
        alone = np.diag(whole)
        turns += alone + alone[chosen, None] - 2 * whole[chosen]
        held = chosen[self.cut]
        # All in one product: as many small ones take twice the time.
        seen = (self.rim.reshape(-1, len(pairs)) @ pairs).reshape(self.rim.shape)
        alone = np.einsum("ckd,ckd->ck", seen, self.rim)
        mine = self.rim[np.arange(len(held)), held]
        quadratic = alone + np.take_along_axis(alone, held[:, None], axis=1)
        quadratic -= 2 * (seen @ mine[:, :, None])[:, :, 0]
        turns[self.cut] = linear[self.cut] - linear[self.cut, held][:, None] + quadratic
        turns[np.setdiff1d(np.arange(len(turns)), self.live)] = 0
        # What a cell holds costs nothing, whatever the rounding.
        turns[np.arange(len(turns)), chosen] = 0
        return np.asarray(turns)

    def price(self, state: _State) -> float:
        """dB per dot at which all turns that help together bring the light to its target; 0 where light is free."""
        if self.mode is MapMode.EDGE_PACKING:
            return 0.0
        held = self._light_of(state.chosen)
        change = self.change(state.chosen)
        spare = self.target - held.sum()
        low, high = 0.0, 4 * float(abs(state.turns).max() / max(1.0, abs(change).max()))
        for _ in range(20):
            price = (low + high) / 2
            cells, kinds = _best(self._worth(state.turns, state.chosen, price))
            low, high = (price, high) if change[cells, kinds].sum() > spare else (low, price)
        return high

    def _selected(
        self, chosen: NDArray[np.int64], worth: Floats, most: int
    ) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
        """Cells to turn and what to, the best of those that help; the light kept where the mode asks for it."""
        cells, kinds = _best(worth)
        if self.mode is MapMode.EDGE_PACKING:
            return cells[:most], kinds[:most]
        held = self._light_of(chosen)
        steps = self.light[cells, kinds] - held[cells]
        light, room = held.sum() - self.target, LIGHT_TOLERANCE * self.target
        chosen_places: list[int] = []
        waiting = list(range(len(cells)))
        # What broke the band at first may fit it once others have moved the light the other way.
        for _ in range(2):
            left = []
            for place in waiting:
                if len(chosen_places) < most and abs(light + steps[place]) <= max(room, abs(light)):
                    light += steps[place]
                    chosen_places.append(place)
                else:
                    left.append(place)
            waiting = left
        return cells[chosen_places], kinds[chosen_places]


def _best(worth: Floats) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """The best turn of every cell that some turn helps, best first."""
    kinds, least = worth.argmin(axis=1), worth.min(axis=1)
    helpful = np.flatnonzero(least < -_ENOUGH_DB)
    cells = helpful[np.argsort(least[helpful], kind="stable")]
    return cells, kinds[cells]


def _by_cell(values: NDArray[Scalar], dots: int) -> NDArray[Scalar]:
    """[side, side] as [cells, dots²]."""
    return split_cells(values, dots, dots).reshape(-1, dots * dots)


def _parted(flat: Floats, dots: int, stride: int) -> Singles:
    """Patterns [.., dots²] by the parts of :func:`maskfab.designs.model.panel_judgement.parted`, one after another."""
    parts = parted(flat.astype(np.float32).reshape(*flat.shape[:-1], dots, dots), stride)
    return parts.reshape(*flat.shape[:-1], -1)
