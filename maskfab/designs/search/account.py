"""Clocks of the stages of a design within its budget: each leaves those after it their time.

What a stage takes is told in judgements of one opening, whose time is measured here and now: a slow machine, or one
that others work on, is slow in all of them alike.

Account of a design: what was tried, in what order it got better, and what ended it.

Prices of rules: how much better an opening may be that need not keep them.

Openings that a search judged within a tenth of a decibel of its best, and what each is better at.

Shapes of one family and size that lie at different places of the cell restore nearly alike. So openings are told apart
by family, size and the closed rim that they leave, whatever way they are turned; of each such kind the best that keeps
the rules stands for all. Judged are openings turned at random, or all alike where the panel is periodic: a designed map
may set them in another order.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, field, replace
from types import MappingProxyType

import numpy as np

from maskfab.base.arrays import Mask
from maskfab.base.errors import JobError
from maskfab.base.model import Tiling
from maskfab.base.units import NM_PER_UM
from maskfab.base.work import Clock
from maskfab.designs.rules.constraints import Constraints
from maskfab.designs.rules.display_fit import Display, footprints_of
from maskfab.designs.rules.families import Candidate, kind, turned_key
from maskfab.designs.search.annealing import Bettered, Ranked

NO_BOUNDS = "The budget leaves no time to prove bounds: no headroom is told."

_PROBES = 3
# Measured at 21 and 88 dots, and half as much again.
_BATCH, _FIRST_MAP, _MAP, _PRICES, _FIT, _BOUNDS = 64, 400, 4500, 400, 1800, 4500
# Shares of the time left that a map, and bounds with what is like them, take at most.
_MOST_MAP, _MOST_BOUNDS = 0.25, 0.4


@dataclass(frozen=True)
class Stages:
    """Clocks of stages.

    Attributes:
        search: of scan, annealing, shortlist or descent.
        map: of the map.
        bounded: whether there is time for bounds, appraisals and alternatives.
        bounds_s: seconds that they take.
    """

    search: Clock
    map: Clock
    bounded: bool = True
    bounds_s: float = 0.0

    @classmethod
    def of(
        cls, judge: Callable[[Mask], object], unit: Mask, clock: Clock, *, mapped: bool = False, fitted: bool = False
    ) -> Stages:
        """By the time that judging one opening takes.

        Args:
            judge: of openings.
            unit: one of them, bool [dots, dots].
            clock: of the whole budget.
            mapped: whether a map is designed.
            fitted: whether a display must fit.

        Raises:
            JobError: MF150 for a clock that refuses what it cannot keep.
        """
        if clock.budget_s is None:
            return cls(clock, clock)
        judge(unit)
        begun = clock.spent
        for _ in range(_PROBES):
            judge(unit)
        each = (clock.spent - begun) / _PROBES
        needed = each * (_PRICES + _FIRST_MAP * mapped + _FIT * fitted)
        clock.require(needed + _BATCH * each, "the first openings", "budget")
        left = clock.left() or 0.0
        bounds = each * _BOUNDS
        bounded = bounds <= _MOST_BOUNDS * left
        after = needed + bounds * bounded
        design = min(_MOST_MAP * left, each * _MAP) * mapped
        return cls(clock.before(after + design), clock.before(after), bounded, bounds)


ANNEALING = "steps of annealing"
"""The stage that changes openings dot by dot."""


@dataclass(frozen=True)
class Without:
    """Searches once more without each rule.

    Attributes:
        gain_db: over the best that was found, by the rule that was left out; 0 or more.
        processor_s: seconds that they took.
    """

    gain_db: Mapping[str, float]
    processor_s: float


@dataclass(frozen=True)
class Account:
    """The way to a design.

    Attributes:
        method: by which it was searched, in words.
        seed: of its random numbers.
        stages: what was tried, and how often, in the order in which it was.
        value: what the values of ``bettered`` are, with their unit; empty where there are none.
        bettered: evaluations made when the best value was bettered, and that value.
        stopped: what ended it.
        tiling, tiling_seed: of the panel; with a map, of the cells that it does not design.
        asked: the rules that were asked for, with what each asks.
        budget_s: seconds; None without a budget.
        scenes: photographs that it was judged by, in words.
        priced_among: openings among which the rules are priced.
        without: searches once more without each rule; None where these were not asked for, or are not made.
    """

    method: str
    seed: int
    stages: tuple[tuple[str, int], ...]
    value: str
    bettered: Bettered
    stopped: str
    tiling: Tiling
    tiling_seed: int
    asked: Mapping[str, str] = field(default_factory=lambda: MappingProxyType({}))
    budget_s: float | None = None
    scenes: str = ""
    priced_among: int = 0
    without: Without | None = None


def asked_of(rules: Constraints) -> dict[str, str]:
    """Rules that ask for something, with what each asks in words; empty words where its value is a picture."""
    told = {}
    for rule in rules.rules:
        value = rules[rule.name]
        plain = isinstance(value, str | int | float) and not isinstance(value, bool)
        unit = rule.unit.removesuffix("s") if plain and value == 1 else rule.unit
        told[rule.name] = f"{value} {unit}".strip() if plain else ""
        if isinstance(value, Display):
            told[rule.name] = value.asks(rule.name)
    return told


def stopped(cut: bool) -> str:
    """The end of a search, that a budget ``cut`` short or did not."""
    return "the budget" if cut else "everything that was asked for was tried"


@dataclass(frozen=True)
class Price:
    """Cost of one constraint, in the objective's unit.

    Attributes:
        rule: its name.
        alone: the best of all, less the best that keeps this rule; inf if none does.
        last: the best that keeps all others, less the best that keeps all; inf if none keeps all.
    """

    rule: str
    alone: float
    last: float


@dataclass(frozen=True)
class Prices:
    """Prices of all constraints together (inf if no candidate keeps them) and of each."""

    together: float
    each: tuple[Price, ...]


def prices(candidates: Iterable[Candidate], objective: Callable[[Mask], float], constraints: Constraints) -> Prices:
    """Costs of the constraints among these candidates, all of the asked count; others are left out.

    Prices are differences between the best of the candidates, so give those that searches with and without each rule
    found.

    Raises:
        JobError: MF105 without any candidate of the count.
    """
    counted = (c.unit for c in candidates if int(c.unit.sum()) == constraints.clear_dots)
    known = sorted(((objective(unit), unit) for unit in counted), key=lambda each: -each[0])
    if not known:
        raise JobError(
            "MF105",
            "no candidate has the asked count",
            where="design",
            cure="Add candidates with that number of clear dots",
        )

    # Best first, so that rules that take long are asked of few.
    broken_by: list[frozenset[str]] = []

    def best(allowed: Callable[[frozenset[str]], bool]) -> float:
        for place, (value, unit) in enumerate(known):
            if place == len(broken_by):
                broken_by.append(constraints.broken(unit))
            if allowed(broken_by[place]):
                return value
        return -math.inf

    top, all_kept = known[0][0], best(lambda broken: not broken)
    found = []
    for rule in constraints.active:
        others = best(lambda broken, rule=rule: broken <= {rule})  # type: ignore[misc]
        alone = best(lambda broken, rule=rule: rule not in broken)  # type: ignore[misc]
        found.append(Price(rule, top - alone, math.inf if all_kept == -math.inf else others - all_kept))
    return Prices(top - all_kept, tuple(found))


WITHIN_DB = 0.1
"""Decibels below the best down to which an opening is an alternative: less than one scene differs from another."""
_MOST = 8
_TRIED = 48
"""Openings whose rules are judged at most: a display's take 0.2 s each where all are kept."""
_MORE_DB, _MORE_SHARE, _LESS_MOVED = 0.001, 0.001, 0.98
"""From so many decibels, and so much of the pixel, on an opening counts as better; as steadier below this share of what
bias moves."""

Moved = Callable[[Mask], float]
"""Decibels, mean over the levels, by which a bias moves an opening's expected PSNR."""


@dataclass(frozen=True, eq=False)
class Alternative:
    """An opening beside others of nearly its PSNR.

    Attributes:
        name: the family, size and place it came from.
        unit: bool [dots, dots].
        value: expected restored PSNR, dB, weighted mean over the levels, cells turned at random or all alike.
        emitters: largest footprint, share of the pixel that each colour covers; None where no emitters suit the pixel.
        rim_um: closed border that the opening leaves all round its cell.
        moved_db: by how much a bias moves the PSNR; None where it was not judged.
        alike: openings of its kind among those within reach, this one included.
    """

    name: str
    unit: Mask
    value: float
    emitters: float | None
    rim_um: float
    moved_db: float | None = None
    alike: int = 1

    @property
    def open_ratio(self) -> float:
        return float(self.unit.mean())

    def better_at(self, other: Alternative) -> tuple[str, ...]:
        """All that it has more of than another: ``psnr``, ``emitters``, ``rim``, ``bias``."""
        better = {
            "psnr": self.value > other.value + _MORE_DB,
            "emitters": None not in (self.emitters, other.emitters)
            and (self.emitters or 0.0) > (other.emitters or 0.0) + _MORE_SHARE,
            "rim": self.rim_um > other.rim_um,
            "bias": None not in (self.moved_db, other.moved_db)
            and (self.moved_db or 0.0) < _LESS_MOVED * (other.moved_db or 0.0),
        }
        return tuple(name for name, holds in better.items() if holds)


@dataclass(frozen=True, eq=False)
class Alternatives:
    """The opening that was chosen, and those that were judged within reach of it.

    Attributes:
        chosen: with its own numbers.
        others: of different kinds, PSNR falling.
        within: openings within reach that were judged, of every kind, before rules were asked.
        kinds: of these.
        unlisted: kinds that keep the rules and are not among ``others``, for those have as much of everything or are
            enough.
        untried: kinds whose rules were not judged, for that takes long.
        bias_um: that ``moved_db`` is of.
        own_emitters: the emitters are those of the job's display.
    """

    chosen: Alternative
    others: tuple[Alternative, ...]
    within: int
    kinds: int
    unlisted: int
    untried: int
    bias_um: float
    own_emitters: bool


def alternatives(
    chosen: Ranked, visited: Iterable[Ranked], rules: Constraints, *, moved: Moved | None, bias_um: float
) -> Alternatives:
    """Openings of other kinds than the chosen one, or of its kind with another rim, no more than 0.1 dB below it.

    Args:
        chosen: with its value.
        visited: openings that were judged by the same objective, whether or not they keep the rules.
        rules: that an alternative keeps.
        moved: what a bias does to an opening; None where that is not judged.
        bias_um: of that.
    """
    mine = turned_key(chosen.unit)
    seen = {mine}
    kinds: dict[tuple[object, ...], list[Ranked]] = {}
    within = 0
    for each in sorted(visited, key=lambda each: -each.value):
        if each.value < chosen.value - WITHIN_DB:
            break
        key = turned_key(each.unit)
        if key not in seen:
            seen.add(key)
            within += 1
            kinds.setdefault((*kind(each.name, each.unit), rim_dots(each.unit)), []).append(each)
    same = kinds.pop((*kind(chosen.name, chosen.unit), rim_dots(chosen.unit)), [])
    kept, untried = _keeping(kinds.values(), rules)
    judged = [replace(_numbers(each, rules), alike=alike) for each, alike in kept]
    own = replace(_numbers(chosen, rules), alike=1 + len(same))
    listed = _listed(judged, own)
    if moved is not None:
        own, *listed = (replace(each, moved_db=moved(each.unit)) for each in (own, *listed))
    count = len(kinds)
    display = "emitters" in rules.active
    return Alternatives(
        own, tuple(listed), within, count, len(judged) - len(listed), untried, bias_um, own_emitters=display
    )


def rim_dots(unit: Mask) -> int:
    """Closed dots between what is clear, of which there is some, and the nearest side of the cell."""
    rows, columns = (np.flatnonzero(unit.any(axis=axis)) for axis in (1, 0))
    return int(min(rows[0], columns[0], len(unit) - 1 - rows[-1], len(unit) - 1 - columns[-1]))


def _keeping(kinds: Iterable[list[Ranked]], rules: Constraints) -> tuple[list[tuple[Ranked, int]], int]:
    """The best of each kind that keeps the rules, with how many there are of it; and kinds that were not judged."""
    kept, tried, untried = [], 0, 0
    for members in kinds:
        if tried >= _TRIED:
            untried += 1
            continue
        for each in members:
            tried += 1
            if rules.allows(each.unit):
                kept.append((each, len(members)))
                break
            if tried >= _TRIED:
                untried += 1
                break
    return sorted(kept, key=lambda each: -each[0].value), untried


def _numbers(each: Ranked, rules: Constraints) -> Alternative:
    try:
        room: float | None = footprints_of(rules, rules.emitters)(each.unit)
    except JobError:
        # Plain rules of emitters, where the job has none, are whole numbers of not every dot.
        room = None
    return Alternative(each.name, each.unit, each.value, room, rim_dots(each.unit) * rules.dot_nm / NM_PER_UM)


def _listed(judged: list[Alternative], chosen: Alternative) -> list[Alternative]:
    """At most eight, PSNR falling: those that no other has as much of everything as, then the best of the rest."""
    free = [each for each in judged if not any(_covers(other, each) for other in (chosen, *judged) if other != each)]
    first = {id(each) for each in free[:_MOST]}
    rest = [each for each in judged if id(each) not in first]
    chosen_few = first | {id(each) for each in rest[: _MOST - len(first)]}
    return [each for each in judged if id(each) in chosen_few]


def _covers(mine: Alternative, other: Alternative) -> bool:
    """Whether one has at least as much of all that is known of both."""
    return mine.value >= other.value and (mine.emitters or 0) >= (other.emitters or 0) and mine.rim_um >= other.rim_um
