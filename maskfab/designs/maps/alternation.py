r"""Unit and orientation map in turns: the best unit for this map, then the best map for that unit.

With f the slope of the loss by the pupil, opening one dot of the unit in every cell at once changes the loss by

    D = sum over cells of f at that cell's image of the dot, inside the stop,

to first order, and swapping the open dot b for the closed dot a adds within the cells, with g the slope by the
autocorrelation and N the cells, 2 N (g(0) - g(a - b)): that turns away swaps that leave a rough rim. The swaps that
promise most are judged exactly, alone and several together, and the best that helps and keeps the constraints is made.
Then the map goes on from where it was. No step makes the loss larger, so no round does.

Notes:
    What the unit gains is gained for this panel: its cells turned at random it may be worse than the one it came from.
    The light stays that of the first unit's random map, within the tolerance of the maps.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from maskfab.base.arrays import Floats, Mask
from maskfab.base.errors import JobError
from maskfab.base.model import ORIENTATIONS, frozen, orient, split_cells
from maskfab.base.work import NO_END, Clock, Progress, silent
from maskfab.designs.maps.orientation_map import LIGHT_TOLERANCE, DesignedMap, MapMode, design_map
from maskfab.designs.model.panel_judgement import PanelError, Slope
from maskfab.designs.rules.constraints import Constraints
from maskfab.mask.panels import Shift, shifted

_TRIED = 12
"""Swaps that are judged exactly before a unit is said to be done."""
_TOGETHER = (6, 3, 1)
_MOST_SWAPS = 40
_ENOUGH_DB = 2e-5


@dataclass(frozen=True, eq=False)
class Joint:
    """A unit with the map that was designed together with it.

    Attributes:
        unit: bool [dots, dots].
        designed: its map; what it gains is told against the random map of the first unit.
        alone: the first unit's map, before any round.
        losses: -dB, weighted mean over the levels: of ``alone``, then after every round; never rising.
        swaps: dots of the unit that were moved, all rounds together.
    """

    unit: Mask
    designed: DesignedMap
    alone: DesignedMap
    losses: tuple[float, ...]
    swaps: int

    def __post_init__(self) -> None:
        object.__setattr__(self, "unit", frozen(np.asarray(self.unit, dtype=np.bool_)))


def joint(
    unit: Mask,
    error: PanelError,
    constraints: Constraints,
    *,
    rounds: int = 2,
    seed: int = 0,
    mode: MapMode = MapMode.EQUAL_LIGHT,
    kicks: int = 0,
    positions: int = 1,
    start: NDArray[np.int8] | None = None,
    shifts: tuple[Shift, ...] = (),
    holds: Callable[[NDArray[np.int8]], bool] = lambda _: True,
    steps: int | None = None,
    clock: Clock = NO_END,
    progress: Progress = silent,
) -> Joint:
    """Design a unit and its map in turns.

    Args:
        unit: bool [dots, dots] to start from; it keeps the constraints.
        constraints: that every unit keeps, at every place that ``positions`` move it to.
        rounds: of unit and map; fewer are made where one brings nothing. 0 designs the map alone.
        positions: the same; the places stay those of the first map.
        start, shifts, holds, steps: the same, of the first map; where ``holds`` depends on the unit, make no rounds.
        clock: the same; no round is begun when its time is over.

    Raises:
        JobError: MF104 for fewer rounds than 0; MF123 for a unit that breaks the constraints, and for ``positions``
            together with a rule that is about cells of one place; and as ``design_map``.
        OpeningError: as ``design_map``.
    """
    if rounds < 0:
        raise JobError("MF104", f"{rounds} rounds are less than 0", where="joint", cure="Use 0 or more")
    mask = np.asarray(unit, dtype=np.bool_)
    if (broken := constraints.first_broken(mask)) is not None:
        what = f"the start breaks {broken}"
        raise JobError("MF123", what, where="joint", cure="Start from an opening that keeps the rules")
    if positions > 1:
        require_places(constraints)
    alone = design_map(
        mask,
        error,
        mode=mode,
        seed=seed,
        kicks=kicks,
        positions=positions,
        allows=constraints.allows,
        start=start,
        shifts=shifts,
        holds=holds,
        steps=steps,
        clock=clock,
        progress=progress,
    )
    best = alone
    losses = [_loss(error, alone.psnr)]
    swaps = 0
    for done in range(rounds):
        if clock.over:
            break
        changed, count = _refitted(mask, replace(best, start_clear_dots=alone.start_clear_dots), error, constraints)
        if not count:
            break
        again = design_map(
            changed,
            error,
            mode=mode,
            seed=seed,
            kicks=0,
            shifts=best.shifts,
            start=best.orientations,
            light=alone.start_clear_dots,
            clock=clock,
        )
        loss = _loss(error, again.psnr)
        if loss >= losses[-1]:
            break
        mask, best, swaps = changed, again, swaps + count
        losses.append(loss)
        progress("unit and map", done + 1, rounds)
    gained = replace(best, start_psnr=alone.start_psnr, start_clear_dots=alone.start_clear_dots)
    return Joint(mask, gained, alone, tuple(losses), swaps)


def dot_slopes(slope: Slope, orientations: NDArray[np.int8], shifts: tuple[Shift, ...], inside: Mask) -> Floats:
    """Change by opening each dot of the unit in every cell, to first order, dB; [dots, dots].

    Args:
        orientations: integers [cells, cells], :attr:`maskfab.designs.maps.orientation_map.DesignedMap.orientations`.
        shifts: of the map; empty without positions.
        inside: the stop, bool [cells dots, cells dots].
    """
    dots = len(inside) // len(orientations)
    cells = split_cells(slope.field * inside, dots, dots).reshape(-1, dots, dots)
    held = orientations.ravel()
    total = np.zeros((dots, dots))
    for kind in np.unique(held):
        # A pattern goes to cell[orient(index)], so a slope comes back by the same numbering read the other way.
        number = orient(np.arange(dots * dots).reshape(dots, dots), int(kind) % ORIENTATIONS).ravel()
        back = np.zeros(dots * dots)
        back[number] = cells[held == kind].sum(axis=0, dtype=np.float64).ravel()
        placed = back.reshape(dots, dots)
        if shifts:
            right, up = shifts[int(kind) // ORIENTATIONS]
            placed = shifted(placed, (-right, -up))
        total += placed
    return total


def require_places(constraints: Constraints) -> None:
    """Refuse rules whose proof takes neighbours, or what lies behind cells, to be those of one place (MF123)."""
    if asked := constraints.one_place:
        what = f"an opening at several places in its cell cannot be shown to keep {' and '.join(sorted(asked))}"
        raise JobError("MF123", what, where="positions", cure="Use positions = 1, or relax that rule")


def _refitted(mask: Mask, designed: DesignedMap, error: PanelError, constraints: Constraints) -> tuple[Mask, int]:
    """The unit after all swaps that help under this map, and how many were made."""
    free = constraints.free.copy()
    for shift in designed.shifts:
        # A dot may be clear only where every place of the unit keeps it in the cell.
        free &= shifted(shifted(np.ones_like(free), shift), (-shift[0], -shift[1]))
    pupil = laid(mask, designed, error)
    epsilons = error.epsilons(pupil)
    judged = error.judge(pupil, epsilons)
    loss, made = judged.loss, 0
    off = max(LIGHT_TOLERANCE * designed.start_clear_dots, abs(float(pupil.sum()) - designed.start_clear_dots))
    while made < _MOST_SWAPS:
        pairs = _ranked(mask, judged.slope(), designed, error, free)
        best = None
        for trial, count in _trials(mask, pairs):
            if not all(constraints.allows(shifted(trial, shift)) for shift in designed.shifts or ((0, 0),)):
                continue
            pupil = laid(trial, designed, error)
            equal = abs(float(pupil.sum()) - designed.start_clear_dots) <= off
            if not equal and designed.mode is MapMode.EQUAL_LIGHT:
                continue
            after = error.judge(pupil, epsilons)
            if after.loss < (loss if best is None else best[1].loss) - _ENOUGH_DB:
                best = trial, after, count
                if count > 1:
                    break
        if best is None:
            break
        mask, judged, count = best
        loss, made = judged.loss, made + count
    return mask, made


def _ranked(mask: Mask, slope: Slope, designed: DesignedMap, error: PanelError, free: Mask) -> NDArray[np.intp]:
    """Swaps (closed dot to open, open dot to close) as flat indices [m, 2], the most promising first."""
    dots = len(mask)
    gains = dot_slopes(slope, designed.orientations, designed.shifts, error.inside).ravel()
    opened, closed = np.flatnonzero(free & ~mask), np.flatnonzero(mask)
    (ay, ax), (by, bx) = np.divmod(opened, dots), np.divmod(closed, dots)
    middle = dots - 1
    # Turned cells see the lag turned; g is even and nearly round, so the mean over D4 stands for all of them.
    near = np.mean([orient(slope.near, k) for k in range(ORIENTATIONS)], axis=0)
    apart = near[ay[:, None] - by + middle, ax[:, None] - bx + middle]
    cells = error.inside.sum() / dots**2
    promise = gains[opened][:, None] - gains[closed] + 2 * cells * (near[middle, middle] - apart)
    order = np.argsort(promise, axis=None, kind="stable")[: 40 * _TRIED]
    rows, columns = np.divmod(order, len(closed))
    return np.stack([opened[rows], closed[columns]], axis=1)


def _trials(mask: Mask, pairs: NDArray[np.intp]) -> list[tuple[Mask, int]]:
    """Units to judge: several of the best swaps of different dots together, then the best by themselves."""
    apart: list[tuple[int, int]] = []
    used: set[int] = set()
    for opened, closed in pairs.tolist():
        if opened not in used and closed not in used:
            used |= {opened, closed}
            apart.append((opened, closed))
    sets = [apart[:count] for count in _TOGETHER[:-1] if len(apart) >= count]
    sets += [[pair] for pair in pairs[:_TRIED].tolist()]
    trials = []
    for chosen in sets:
        trial = mask.ravel().copy()
        for opened, closed in chosen:
            trial[opened], trial[closed] = True, False
        trials.append((trial.reshape(mask.shape), len(chosen)))
    return trials


def laid(mask: Mask, designed: DesignedMap, error: PanelError) -> Floats:
    """The pupil of a unit, bool [dots, dots], under its map."""
    units = np.stack([shifted(mask, shift) for shift in designed.shifts]) if designed.shifts else mask
    return error.laid(units, designed.orientations)


def _loss(error: PanelError, psnr: tuple[float, ...]) -> float:
    return -sum(weight * value for weight, value in zip(error.weights, psnr, strict=True))
