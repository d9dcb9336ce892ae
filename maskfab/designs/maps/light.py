"""Light shared unevenly at the light of a uniform panel, and what the display pays: a denser unit beside a sparser one.

Graded: cells round the axis hold a denser unit, those beyond it a sparser one, so that the whole panel passes what the
uniform one does; the cells that the stop cuts are turned to make up what whole dots leave over. A stop that is clearer
in its middle passes more at the frequencies that pictures live from. Where the share of the middle is not stated, it is
sought: numbers of dots from the most that emitters leave downwards, then ever closer round the best, each with its best
shapes that the display fits on any map and whose light keeps the eye's rules.

All cells have one plan of emitters, which keeps clear of both units: they are as large as the denser cell lets them be,
and no colour, luminance or life differs from cell to cell. The sparser unit is turned so that it lies behind the denser
one as far as it can, where it takes no room of its own.

Notes:
    It is no merit of the mask: emitters are smaller than those of the uniform panel, in every cell, run at a higher
    current density for the same luminance, and age faster. That is stated; quote it beside the gain.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import islice

import numpy as np
from numpy.typing import NDArray

from maskfab.base.arrays import Mask
from maskfab.base.errors import InputError, JobError
from maskfab.base.model import ORIENTATIONS, frozen, orient
from maskfab.base.work import Progress, silent
from maskfab.designs.maps.orientation_map import FIRST_STEPS, DesignedMap, MapMode, design_map
from maskfab.designs.maps.shares import SPARSEST, Denser, Shares, beside, covered, require_outer, stated
from maskfab.designs.model.panel_judgement import PanelError
from maskfab.designs.rules.constraints import Constraints
from maskfab.designs.rules.display_fit import DieFit, Display, fitting_die
from maskfab.display.drive import LightDemand, relative_life
from maskfab.display.placement import footprint
from maskfab.mask.panels import CellMap

_TRIED = 12
"""Pairs of units for which a map is designed before a display is said not to hold them."""

_SPARSER = 3
"""Sparser units that are tried beside each denser one."""

_COARSE, _BELOW, _ABOVE = 8, 2, 10
"""Numbers of dots that a search first looks at, and those below and above its best that it looks at last: more dots
are worth more, and shapes whose light is centred are few."""

_LOOKED, _SPARSEST, _QUICK = 20, 24, 3
"""Openings that the display fits, of one number of dots, whose light is judged; sparser ones, of which the one that
lies behind a denser one is taken; middles that are given a quick map."""


@dataclass(frozen=True, eq=False)
class Graded:
    """A panel with two units, and what they cost the display, whose emitters are alike in all cells.

    Attributes:
        units: bool [2, dots, dots], the denser one first.
        designed: the map, 8 u + k for unit u; its gains are over the same cells turned at random.
        uniform_psnr: expected restored PSNR of the uniform unit's random map, dB by level.
        uniform_clear_dots: inside the stop, of the same.
        uniform_share: of a cell that each colour's emitter covers on the uniform panel, 0 to 1.
        share: the same of the panel of two units.
        life_ratio: life of the emitters over that of the uniform panel's, 0 where nothing fits.
        fit: of the display on a die; None where none must be held.
        lines: that are drawn for every pixel each way on that die; None where no wires are asked for.
        denser_cells: that hold the denser unit behind the stop.
        grain: slow grain of an even field of pixels turned at random; None where no display must be held.
    """

    units: Mask
    designed: DesignedMap
    uniform_psnr: tuple[float, ...]
    uniform_clear_dots: int
    uniform_share: float
    share: float
    life_ratio: float
    fit: DieFit | None = None
    lines: int | None = None
    denser_cells: int = 0
    grain: float | None = None

    def __post_init__(self) -> None:
        object.__setattr__(self, "units", frozen(np.asarray(self.units, dtype=np.bool_)))

    @property
    def gain_db(self) -> tuple[float, ...]:
        """Gain over the uniform unit's random map of equal light, at each level."""
        return tuple(a - b for a, b in zip(self.designed.psnr, self.uniform_psnr, strict=True))


def graded(
    uniform: Mask,
    error: PanelError,
    asked: Denser,
    find: Callable[[int], Iterable[Mask]],
    *,
    constraints: Constraints,
    seed: int = 0,
    kicks: int = 0,
    progress: Progress = silent,
) -> Graded:
    """Design a panel whose middle is denser, at equal light; where a display must fit, one that it fits.

    Args:
        uniform: bool [dots, dots], the unit of the panel that is compared with.
        asked: share of the denser unit's dots that are clear, above the uniform unit's, or a search for it.
        find: gives units of so many clear dots that keep the constraints, bool [dots, dots], the best first; for a
            search those of the eye need not be kept.
        constraints: that each unit keeps for its own count of clear dots, and both beside one another.

    Raises:
        JobError: MF104 for a share that is not between the uniform unit's and 1, or leaves nothing clear outside;
            MF117, MF118 where the emitters' rules do not suit the pixel; MF123 for units that break the constraints,
            or a display that fits no pair of them on its map.
    """
    mask = np.asarray(uniform, dtype=np.bool_)
    if asked.sought:
        looked = middles(mask, error, asked, find, constraints=constraints, seed=seed, progress=progress)
        return laid(
            mask, error, _by_quick_maps(looked, mask, error, seed, progress), constraints, seed, kicks, progress
        )
    shares = stated(mask, error, asked)
    pairs = ((units, shares) for units in _pairs(find, shares, constraints))
    return laid(mask, error, pairs, constraints, seed, kicks, progress)


def laid(
    uniform: Mask,
    error: PanelError,
    pairs: Iterable[tuple[Mask, Shares]],
    constraints: Constraints,
    seed: int,
    kicks: int,
    progress: Progress = silent,
) -> Graded:
    """The first of pairs of units that the display fits on their own map.

    Args:
        uniform, error, constraints, seed, kicks, progress: as for :func:`graded`.
        pairs: bool [2, dots, dots] and where each lies.

    Raises:
        JobError: MF123 where it fits none of the first.
    """
    first = error.laid(uniform, seed=seed)
    clear = round(float(first.sum()))
    why = ""
    for units, shares in islice(pairs, _TRIED):
        designed = _mapped(units, shares, error, clear, seed, kicks=kicks, progress=progress)
        fit, lines = shown(units, designed.orientations, constraints)
        if fit is not None and fit.why is not None:
            why = fit.why
            continue
        price = display_price(uniform, units, constraints)
        display: Display | None = constraints["emitters"] or None
        grain = None if display is None else display.grain(units[0], constraints.dot_nm)
        cells = int((shares.denser & (covered(error) > 0)).sum())
        return Graded(units, designed, error.psnr(first), clear, *price, fit, lines, cells, grain)
    what = f"the display fits none of the {_TRIED} best pairs of openings on their own maps: {why}"
    cure = "Ask for fewer lines, smaller emitters, a smaller density or another tiling_seed"
    raise JobError("MF123", what, where="design.fit", cure=cure)


def _mapped(
    units: Mask,
    shares: Shares,
    error: PanelError,
    light: int,
    seed: int,
    *,
    kicks: int = 0,
    steps: int | None = None,
    progress: Progress = silent,
) -> DesignedMap:
    return design_map(
        units,
        error,
        mode=MapMode.EQUAL_LIGHT,
        seed=seed,
        kicks=kicks,
        start=_drawn_cells(shares, error, seed),
        light=light,
        keep_units=True,
        steps=steps,
        progress=progress,
    )


def _drawn_cells(shares: Shares, error: PanelError, seed: int) -> NDArray[np.int8]:
    drawn = np.random.default_rng(seed).integers(ORIENTATIONS, size=(error.cells, error.cells)).astype(np.int8)
    return np.asarray(drawn + ORIENTATIONS * ~shares.denser, dtype=np.int8)


@dataclass(frozen=True, eq=False)
class Middle:
    """A denser middle that was looked at.

    Attributes:
        units: bool [2, dots, dots], the denser one first.
        value: expected restored PSNR in dB on the random map, weighted mean over the levels.
        grain: slow grain of an even field of pixels turned at random; 0 where no display must be held.
        centroid_px: distance of the light's centroid from the pixel's middle; 0 likewise.
    """

    units: Mask
    shares: Shares
    value: float
    grain: float
    centroid_px: float


def middles(
    uniform: Mask,
    error: PanelError,
    asked: Denser,
    find: Callable[[int], Iterable[Mask]],
    *,
    constraints: Constraints,
    counts: Sequence[int] | None = None,
    seed: int = 0,
    progress: Progress = silent,
) -> list[Middle]:
    """Middles that keep the constraints, the best first.

    Args:
        uniform, error, asked, find, constraints, seed, progress: as for :func:`graded`.
        counts: clear dots of the denser unit to look at; by default those round the best.

    Raises:
        JobError: MF104 for outer dots that are not fewer than the uniform unit's; MF123 where none keep the
            constraints.
    """
    uniform_count = int(uniform.sum())
    outer = tuple(k for k in SPARSEST if k < uniform_count) if asked.outer is None else (asked.outer,)
    for count in outer or (1,):
        require_outer(count, uniform_count)
    sparser: dict[int, list[Mask]] = {}
    found: dict[int, list[Middle]] = {}

    def look(count: int) -> float:
        """Value of the best middle of so many dots, -inf where there is none."""
        if count not in found:
            progress("denser middles", len(found), len(found) + 1)
            found[count] = list(_of_count(uniform_count, count, outer, error, find, sparser, constraints, seed))
        return max((one.value for one in found[count]), default=-math.inf)

    for count in counts or ():
        look(count)
    if counts is None:
        display: Display | None = constraints["emitters"] or None
        kept = 0.0 if display is None else 3 * display.rules.emitters.required
        _climb(look, uniform_count + 1, math.floor(constraints.dots**2 * (1 - kept)))
    every = sorted((one for some in found.values() for one in some), key=lambda one: -one.value)
    if not every:
        what = f"no denser opening than {uniform_count} dots keeps the rules, with {outer[0]} dots beyond the middle"
        cure = "Relax slow_grain or centroid_px, ask for fewer lines or smaller emitters, or state a density"
        raise JobError("MF123", what, where="design.density", cure=cure)
    return every


def _climb(value: Callable[[int], float], low: int, high: int) -> None:
    """Look at whole numbers from the highest downwards until the value falls, then ever closer round the best."""
    if low > high:
        return
    step = max(1, (high - low) // _COARSE)
    best, best_value, worse = high, -math.inf, 0
    for count in range(high, low - 1, -step):
        here = value(count)
        if here > best_value:
            best, best_value, worse = count, here, 0
        elif best_value > -math.inf:
            worse += 1
        if worse > 1:
            break
    while step > 1:
        step = (step + 1) // 2
        sides = [count for count in (best + step, best - step) if low <= count <= high]
        best = max((best, *sides), key=value)
    for count in range(max(low, best - _BELOW), min(high, best + _ABOVE) + 1):
        value(count)


def _of_count(
    uniform_count: int,
    count: int,
    outer: tuple[int, ...],
    error: PanelError,
    find: Callable[[int], Iterable[Mask]],
    sparser: dict[int, list[Mask]],
    constraints: Constraints,
    seed: int,
) -> Iterator[Middle]:
    rules, display = replace(constraints, clear_dots=count), constraints["emitters"] or None
    shares = beside(count, outer, uniform_count, error)
    if shares.sparse not in sparser:
        sparser[shares.sparse] = list(islice(_none_if_refused(find, shares.sparse), _SPARSEST))
    for dense in islice(_none_if_refused(find, count), _LOOKED):
        if rules.first_broken(dense) is not None or not sparser[shares.sparse]:
            continue
        turned = (behind(sparse, dense, rules.orientations) for sparse in sparser[shares.sparse])
        units = np.stack([dense, max(turned, key=lambda unit, dense=dense: int((unit & dense).sum()))])  # type: ignore[misc]
        if constraints.without("emitters", "wires").broken_beside(units) is not None or (units[1] & ~dense).any():
            continue
        value = float(np.dot(error.weights, error.psnr(error.laid(units, _drawn_cells(shares, error, seed)))))
        answer = None if display is None else display.lit(dense, rules.dot_nm)
        grain = None if display is None else display.grain(dense, rules.dot_nm)
        away = 0.0 if answer is None else math.hypot(*answer.centroid_px)
        yield Middle(units, shares, value, grain or 0.0, away)


def _none_if_refused(find: Callable[[int], Iterable[Mask]], count: int) -> Iterator[Mask]:
    try:
        yield from find(count)
    except InputError:
        return


def _by_quick_maps(
    looked: Sequence[Middle], uniform: Mask, error: PanelError, seed: int, progress: Progress
) -> Iterator[tuple[Mask, Shares]]:
    """The best few in the order of what a quick map makes of them, then the rest."""
    light = round(float(error.laid(uniform, seed=seed).sum()))
    few = looked[:_QUICK]
    values = []
    for done, one in enumerate(few):
        progress("quick maps", done, len(few))
        quick = _mapped(one.units, one.shares, error, light, seed, steps=FIRST_STEPS)
        values.append(float(np.dot(error.weights, quick.psnr)))
    ordered = [few[k] for k in sorted(range(len(few)), key=lambda k: -values[k])]
    yield from ((one.units, one.shares) for one in (*ordered, *looked[len(few) :]))


def shown(units: Mask, kinds: NDArray[np.int8], constraints: Constraints) -> tuple[DieFit | None, int | None]:
    """Whether the display that must be held fits two openings on their map, and the lines each way if it does.

    One die is tried: there are other pairs of openings. Both are None where no display must be held, the lines too
    where none with wires must.
    """
    display: Display | None = constraints["emitters"] or None
    if display is None:
        return None, None
    cells = CellMap("map", kinds, beyond=ORIENTATIONS)
    fit = fitting_die(display, units[0], constraints.dot_nm, cells, units[1], most=1)
    if fit.why is not None:
        return fit, None
    return fit, display.most_lines(display.die(units[0], constraints.dot_nm, cells, units[1]))


def _pairs(find: Callable[[int], Iterable[Mask]], wanted: Shares, constraints: Constraints) -> Iterator[Mask]:
    """Denser and sparser units beside one another, bool [2, dots, dots], the best first; MF123 where there are none."""
    dense_count, sparse_count = wanted.dense, wanted.sparse
    sparser: list[Mask] | None = None
    fitting, broken = False, None
    for dense in find(dense_count):
        _require(dense, dense_count, constraints, "denser")
        if sparser is None:
            sparser = list(islice(find(sparse_count), _SPARSER))
        for sparse in sparser:
            _require(sparse, sparse_count, constraints, "sparser")
            units = np.stack([dense, behind(sparse, dense, constraints.orientations)])
            broken = constraints.broken_beside(units)
            if broken is None:
                fitting = True
                yield units
    if not fitting:
        what = f"openings of {dense_count} and {sparse_count} clear dots break {broken} where they meet"
        cure = "Relax that rule, ask for rim_dots, or choose a smaller density"
        raise JobError("MF123", what, where="density", cure=cure)


def behind(sparse: Mask, dense: Mask, orientations: Sequence[int]) -> Mask:
    """The sparser unit in the orientation, of those in use, in which most of it lies where the denser one is clear."""
    return max((orient(sparse, k) for k in orientations), key=lambda turned: int((turned & dense).sum()))


def _require(unit: Mask, count: int, constraints: Constraints, which: str) -> None:
    if (broken := replace(constraints, clear_dots=count).first_broken(unit)) is not None:
        what = f"the {which} opening of {count} clear dots breaks {broken}"
        raise JobError("MF123", what, where="density", cure="Relax that rule, or choose another density")


def display_price(uniform: Mask, units: Mask, constraints: Constraints) -> tuple[float, float, float]:
    """Cost for the display, from the largest emitters found around one unit, and around both, in all orientations.

    Args:
        units: bool [2, dots, dots].
        constraints: whose rules of emitters hold, and whose display's light says how fast emitters age.

    Returns:
        ``uniform_share``, ``share`` and ``life_ratio`` of :class:`Graded`.

    Raises:
        JobError: MF117, MF118 as :func:`maskfab.display.placement.footprint`.
    """

    def largest(clear: Mask) -> float:
        opening, orientations = constraints.opening(clear), constraints.orientations
        return footprint(opening, constraints.dot_nm, 0, orientations, constraints.emitters, largest=True).found_share

    before, share = largest(uniform), largest(np.logical_or(*units))
    if not (before > 0 and share > 0):
        return before, share, 0.0
    display: Display | None = constraints["emitters"] or None
    light = LightDemand() if display is None else display.rules.light
    # At equal luminance the current density goes with one over the area.
    return before, share, relative_life(before / share, 1.0, light.ageing_exponent)
