"""Result of a design, whichever method found it: the opening, the way to it, what its rules cost, and its rivals.

Prices of rules are how much better an opening may be that need not keep them.

Alternatives are openings that a search judged within a tenth of a decibel of its best. Shapes of one family and size
that lie at different places of the cell restore nearly alike. So openings are told apart by family, size and the closed
rim that they leave, whatever way they are turned; of each such kind the best that keeps the rules stands for all.
Judged are openings turned at random, or all alike where the panel is periodic: a designed map may set them in another
order.

Clocks of stages leave those after them their time. What a stage takes is told in judgements of one opening, whose time
is measured here and now: a slow machine, or one that others work on, is slow in all of them alike.
"""

from __future__ import annotations

import hashlib
import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from types import MappingProxyType
from typing import TYPE_CHECKING

import numpy as np

from maskfab.base import __version__
from maskfab.base.arrays import Mask
from maskfab.base.errors import JobError
from maskfab.base.model import ORIENTATIONS, Opening, Tiling
from maskfab.base.units import NM_PER_UM
from maskfab.base.work import Clock
from maskfab.camera.scenes import Bundled, Photograph
from maskfab.camera.sensor import LEVELS
from maskfab.camera.stop_cells import F1, PhotoCamera, camera_line
from maskfab.designs.model.appraisal import Robustness, SceneAppraisal, SceneConditions
from maskfab.designs.model.expected_psnr import Surrogate
from maskfab.designs.model.limits import Gap, bounds, optimality_gap
from maskfab.designs.model.statistics import F1_SETTINGS, CaptureSettings
from maskfab.designs.rules import constraints
from maskfab.designs.rules.constraints import Constraints
from maskfab.designs.rules.display_fit import OF_THE_EYE, DieFit, Display, footprints_of, of_display
from maskfab.designs.rules.families import Candidate, kind, turned_key
from maskfab.designs.rules.rule import price_key
from maskfab.designs.search.annealing import Bettered, Ranked
from maskfab.designs.search.held import Shortfall
from maskfab.job.camera import Camera
from maskfab.job.sections import DesignSection, RulesSection
from maskfab.mask.opening_file import dot_of_pitch
from maskfab.mask.panels import CellMap

if TYPE_CHECKING:
    from maskfab.designs.maps.orientation_map import DesignedMap


Facts = dict[str, str | int | float]

LEVELS_OF_F1 = "another camera at the levels of F1"
"""In the place of a protocol's name."""

NO_BOUNDS = "The budget leaves no time to prove bounds: no headroom is told."

ANNEALING = "steps of annealing"
"""The stage that changes openings dot by dot."""

WITHIN_DB = 0.1
"""Decibels below the best down to which an opening is an alternative: less than one scene differs from another."""

_PROBES = 3


# Measured at 21 and 88 dots, and half as much again.
_BATCH, _FIRST_MAP, _MAP, _PRICES, _FIT, _BOUNDS = 64, 400, 4500, 400, 1800, 4500


# Shares of the time left that a map, and bounds with what is like them, take at most.
_MOST_MAP, _MOST_BOUNDS, _MOST_DIE = 0.25, 0.4, 0.4
_MOST = 8

_TRIED = 48
"""Openings whose rules are judged at most: a display's take 0.2 s each where all are kept."""

_MORE_DB, _MORE_SHARE, _LESS_MOVED = 0.001, 0.001, 0.98
"""From so many decibels, and so much of the pixel, on an opening counts as better; as steadier below this share of what
bias moves."""


@dataclass(frozen=True, eq=False)
class Designed:
    """Result of a design.

    Attributes:
        shape: how it was found: the family, size and place it came from, or the objectives that were descended.
        psnr: expected restored PSNR in dB, by level, cells turned at random (or not at all, if periodic); of a scene's
            depth the mean over its distances.
        head_room: by level, dB that no other opening of as many dots can gain over it in the picture's interior, in
            focus; None for a panel of two openings, and where the budget is shorter than bounds take.
        evaluated: openings that were judged.
        prices: what the rules cost among them, in dB of the weighted mean; None where they were judged otherwise, and
            of rules of the eye where there is a budget.
        cells: the designed map; None if none was asked for.
        map_head_room: by level, dB that no layout of as much light in every cell can gain over the map, far from the
            picture's edge; None without a map, for one of groups, of several distances or of many dots, and as above.
        gap: the opening beside all its bounds; None for a panel of two, where there is no other opening, and as above.
        outer: the opening of the outer half of the stop; None unless the density was asked to differ.
        robust: the panel beside those that are made instead of it; None where the budget is shorter than bounds take,
            and for a descent.
        fit: of the display on a die; None where none must be held.
        scene: the panel in the conditions that it is designed for; None where nothing of a scene must be modelled, and
            where the budget is shorter than bounds take.
        cut: a budget cut the search short, so that it depends on the clock.
        alternatives: openings of nearly its PSNR; None for a panel of two openings, for a descent, where openings were
            not judged in dB, and where the budget is shorter than bounds take.
        shortfall: where the display was found to hold fewer clear dots than were asked for.
        rivals: the best openings of other families or sizes that a display was found to fit in the scan, two at most.
    """

    opening: Opening
    shape: str
    psnr: tuple[float, ...]
    head_room: tuple[float, ...] | None
    evaluated: int
    prices: Prices | None = None
    cells: CellMap | None = None
    designed: DesignedMap | None = None
    map_head_room: tuple[float, ...] | None = None
    gap: Gap | None = None
    outer: Opening | None = None
    notes: tuple[str, ...] = ()
    cut: bool = False
    camera: str = ""
    levels: tuple[float, ...] = LEVELS
    robust: Robustness | None = None
    fit: DieFit | None = None
    scene: SceneDesign | None = None
    account: Account | None = None
    alternatives: Alternatives | None = None
    shortfall: Shortfall | None = None
    rivals: tuple[Ranked, ...] = ()


@dataclass(frozen=True, eq=False)
class SceneDesign:
    """A design in its scene's conditions; ``random``: its cells turned at random, None without a map of one opening."""

    seen: SceneConditions
    panel: SceneAppraisal
    random: SceneAppraisal | None


@dataclass(frozen=True)
class Account:
    """The way to a design.

    Attributes:
        stages: what was tried, and how often, in the order in which it was.
        value: what the values of ``bettered`` are, with their unit; empty where there are none.
        bettered: evaluations made when the best value was bettered, and that value.
        tiling, tiling_seed: of the panel; with a map, of the cells that it does not design.
        priced_among: openings among which the rules are priced.
        without: gain in dB of searches once more without each rule over the best found, by the rule left out, 0 or
            more, and the seconds of processor that they took; None where these were not asked for, or are not made.
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
    without: tuple[Mapping[str, float], float] | None = None


@dataclass(frozen=True)
class Price:
    """Cost of one constraint, in the objective's unit.

    Attributes:
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


@dataclass(frozen=True, eq=False)
class Alternative:
    """An opening beside others of nearly its PSNR.

    Attributes:
        name: the family, size and place it came from.
        unit: bool [dots, dots].
        value: expected restored PSNR, dB, weighted mean over the levels, cells turned at random or all alike.
        emitters: largest footprint, share of the pixel that each colour covers; None where no emitters suit the pixel.
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
        """Names of what it has more of than another: ``psnr``, ``emitters``, ``rim``, ``bias``."""
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


@dataclass(frozen=True)
class Stages:
    """Clocks of a design's stages in its budget; ``bounded`` if there is time for bounds, appraisals, alternatives."""

    search: Clock
    map: Clock
    bounded: bool = True
    bounds_s: float = 0.0

    @classmethod
    def of(
        cls,
        judge: Callable[[Mask], object],
        unit: Mask,
        clock: Clock,
        *,
        mapped: bool = False,
        fitted: bool = False,
        die_s: float = 0.0,
    ) -> Stages:
        """Clocks by the time that judging one opening takes.

        Args:
            unit: one of them, bool [dots, dots].
            die_s: seconds of the look at a die, as they were measured.

        Raises:
            JobError: MF150 for a clock that refuses what it cannot keep.
        """
        if clock.budget_s is None:
            return cls(clock, clock)
        judge(unit)
        begun = clock.spent
        for _ in range(_PROBES):
            judge(unit)
        judgement_s = (clock.spent - begun) / _PROBES
        needed_s = judgement_s * (_PRICES + _FIRST_MAP * mapped + _FIT * fitted)
        clock.require(needed_s + _BATCH * judgement_s, "the first openings", "budget")
        left = clock.left() or 0.0
        bounds_s = judgement_s * _BOUNDS
        bounded = bounds_s <= _MOST_BOUNDS * left
        # The look at the die goes by its pixels, however fast an opening is judged.
        beyond_s = max(0.0, die_s - judgement_s * _FIT * fitted)
        after_s = needed_s + min(beyond_s, _MOST_DIE * left) + bounds_s * bounded
        map_s = min(_MOST_MAP * left, judgement_s * _MAP) * mapped
        return cls(clock.before(after_s + map_s), clock.before(after_s), bounded, bounds_s)


def constraints_of(section: DesignSection, *, where: str = "design", display: Display | None = None) -> Constraints:
    """The section's rules.

    Raises:
        JobError: MF104, MF106 or MF107 for a pitch that is no whole number of dots on the grid, or rules out of range;
            MF105 for a centroid without a display; MF117 or MF118 where its rules do not suit the pixel.
    """
    asked = section.rules
    dot_nm = dot_of_pitch(section.pitch, section.dots, where=f"{where}.pitch")
    for key in OF_THE_EYE:
        if getattr(asked, key) is not None and display is None:
            what = "there are no emitters whose light could be judged"
            cure = f"Set fit = true, with [emitters] in the job, or remove {key}"
            raise JobError("MF105", what, where=f"{where}.rules.{key}", cure=cure)
    stated = {
        rule.name: rule.read(getattr(asked, rule.name), section, where)
        for rule in constraints.RULES
        if issubclass(rule.section, RulesSection)
    }
    return Constraints(
        section.clear_dots,
        dots=section.dots,
        dot_nm=dot_nm,
        orientations=(0,) if section.tiling is Tiling.PERIODIC else tuple(range(ORIENTATIONS)),
        asked=stated,
        **({} if display is None else of_display(display)),
    )


def appraised(
    estimate: Surrogate, mask: Mask, *, periodic: bool
) -> tuple[tuple[float, ...], Facts, tuple[float, ...], Gap | None]:
    """Expected restored PSNR of a unit by level, both as provenance, and what no other of as many dots can gain, in dB.

    That is of the picture's interior. Last all bounds, unless there is no other opening of as many dots.
    """
    # What is clear throughout is the only opening of its count.
    limit = None if mask.all() else bounds(estimate, int(mask.sum()), periodic=periodic)
    gap = None if limit is None else optimality_gap(estimate, mask, limit)
    psnr, room = estimate(mask, periodic=periodic), (0.0,) * len(estimate.levels) if gap is None else gap.head_room
    facts = by_level("expected_psnr", psnr, estimate.levels) | by_level("head_room", room, estimate.levels)
    return psnr, facts, room, gap


def origin(section: DesignSection, command: str, made_for: Facts) -> Facts:
    """Who made it, how it is made again, and for which camera."""
    made: Facts = {"author": "maskfab", "command": command, "version": __version__, "seed": section.seed}
    return made | made_for


def camera_facts(
    camera: Camera | PhotoCamera, settings: CaptureSettings = F1_SETTINGS, seen: SceneConditions | None = None
) -> Facts:
    """The camera that an opening was designed for, as provenance; nothing for protocol F1's: earlier bytes are kept."""
    line = camera_line(camera)
    scene: Facts = {} if seen is None else {"scene": seen.line}
    if not settings.is_f1:
        return {"camera": line, "protocol": settings.line, **scene}
    return scene if line == camera_line(F1) else {"camera": line, "protocol": LEVELS_OF_F1, **scene}


def made_for_line(
    camera: Camera | PhotoCamera, settings: CaptureSettings = F1_SETTINGS, seen: SceneConditions | None = None
) -> str:
    """Lens, sensor, light and scene that numbers are expected for, in words."""
    return f"{camera_line(camera)}; {settings.line}{'' if seen is None else f'; scene: {seen.line}'}"


def by_level(name: str, values: Sequence[float], levels: Sequence[float]) -> Facts:
    """Decibels as provenance: ``name_24`` and so on, rounded to what they are worth."""
    # A rounded loss of nothing must not be written as -0.0.
    return {f"{name}_{level:g}": round(value, 3) + 0.0 for level, value in zip(levels, values, strict=True)}


def of_prices(paid: Prices) -> Facts:
    """Costs of the rules, as provenance."""
    facts: Facts = {"rules_cost_db": round(paid.together, 3) + 0.0}
    facts.update({price_key(price.rule): round(price.last, 3) + 0.0 for price in paid.each})
    return facts


def run_key(section: DesignSection, scenes: Sequence[Photograph], *more: object) -> str:
    """Key that tells the checkpoint of this run from every other."""
    digest = hashlib.sha256(f"{__version__} {np.__version__} {section!r} {more!r}".encode())
    if isinstance(scenes, Bundled):
        digest.update(f"{len(scenes)} bundled".encode())
        return digest.hexdigest()
    for scene in scenes:
        digest.update(f"{scene.name} {scene.number} {scene.values.shape}".encode())
        digest.update(np.ascontiguousarray(scene.values).tobytes())
    return digest.hexdigest()


def asked_of(rules: Constraints) -> dict[str, str]:
    """Rules that ask for something, with what each asks in words; empty words where its value is a picture."""
    demands = {}
    for rule in rules.rules:
        value = rules[rule.name]
        if isinstance(value, Display):
            demands[rule.name] = value.asks(rule.name)
            continue
        plain = isinstance(value, str | int | float) and not isinstance(value, bool)
        unit = rule.unit.removesuffix("s") if plain and value == 1 else rule.unit
        demands[rule.name] = f"{value} {unit}".strip() if plain else ""
    return demands


def stopped(cut: bool) -> str:
    """End of a search in words; ``cut`` where a budget ended it."""
    return "the budget" if cut else "everything that was asked for was tried"


def prices(candidates: Iterable[Candidate], objective: Callable[[Mask], float], constraints: Constraints) -> Prices:
    """Costs of the constraints among these candidates, all of the asked count; others are left out.

    Prices are differences between the best of the candidates, so give those that searches with and without each rule
    found.

    Raises:
        JobError: MF105 without any candidate of the count.
    """
    counted = (c.unit for c in candidates if int(c.unit.sum()) == constraints.clear_dots)
    judged = sorted(((objective(unit), unit) for unit in counted), key=lambda pair: -pair[0])
    if not judged:
        what = "no candidate has the asked count"
        raise JobError("MF105", what, where="design", cure="Add candidates with that number of clear dots")

    # Best first, so that rules that take long are asked of few.
    broken_by: list[frozenset[str]] = []

    def best(allowed: Callable[[frozenset[str]], bool]) -> float:
        for place, (value, unit) in enumerate(judged):
            if place == len(broken_by):
                broken_by.append(constraints.broken(unit))
            if allowed(broken_by[place]):
                return value
        return -math.inf

    top, all_kept = judged[0][0], best(lambda broken: not broken)
    by_rule = []
    for rule in constraints.active:
        others = best(lambda broken, rule=rule: broken <= {rule})  # type: ignore[misc]
        alone = best(lambda broken, rule=rule: rule not in broken)  # type: ignore[misc]
        by_rule.append(Price(rule, top - alone, math.inf if all_kept == -math.inf else others - all_kept))
    return Prices(top - all_kept, tuple(by_rule))


def alternatives(
    chosen: Ranked,
    visited: Iterable[Ranked],
    rules: Constraints,
    *,
    moved: Callable[[Mask], float] | None,
    bias_um: float,
) -> Alternatives:
    """Openings of other kinds than the chosen one, or of its kind with another rim, no more than 0.1 dB below it.

    Args:
        visited: openings that were judged by the same objective, whether or not they keep the rules.
        moved: decibels, mean over the levels, by which a bias moves an opening's PSNR; None where that is not judged.
    """
    seen = {turned_key(chosen.unit)}
    kinds: dict[tuple[object, ...], list[Ranked]] = {}
    for opening in sorted(visited, key=lambda opening: -opening.value):
        if opening.value < chosen.value - WITHIN_DB:
            break
        key = turned_key(opening.unit)
        if key not in seen:
            seen.add(key)
            kinds.setdefault((*kind(opening.name, opening.unit), rim_dots(opening.unit)), []).append(opening)
    same = kinds.pop((*kind(chosen.name, chosen.unit), rim_dots(chosen.unit)), [])
    best, untried = _keeping(kinds.values(), rules)
    judged = [_numbers(opening, rules, alike) for opening, alike in best]
    own = _numbers(chosen, rules, 1 + len(same))
    listed = _listed(judged, own)
    if moved is not None:
        own, *listed = (replace(rival, moved_db=moved(rival.unit)) for rival in (own, *listed))
    return Alternatives(
        own,
        tuple(listed),
        len(seen) - 1,
        len(kinds),
        len(judged) - len(listed),
        untried,
        bias_um,
        own_emitters="emitters" in rules.active,
    )


def rim_dots(unit: Mask) -> int:
    """Closed dots between what is clear, of which there is some, and the nearest side of the cell."""
    rows, columns = (np.flatnonzero(unit.any(axis=axis)) for axis in (1, 0))
    return int(min(rows[0], columns[0], len(unit) - 1 - rows[-1], len(unit) - 1 - columns[-1]))


def _keeping(kinds: Iterable[list[Ranked]], rules: Constraints) -> tuple[list[tuple[Ranked, int]], int]:
    """The best of each kind that keeps the rules, with how many there are of it; and kinds that were not judged."""
    best, tried, untried = [], 0, 0
    for members in kinds:
        if tried >= _TRIED:
            untried += 1
            continue
        for opening in members:
            tried += 1
            if rules.allows(opening.unit):
                best.append((opening, len(members)))
                break
            if tried >= _TRIED:
                untried += 1
                break
    return sorted(best, key=lambda pair: -pair[0].value), untried


def _numbers(opening: Ranked, rules: Constraints, alike: int) -> Alternative:
    try:
        room: float | None = footprints_of(rules, rules.emitters)(opening.unit)
    except JobError:
        # Plain rules of emitters, where the job has none, are whole numbers of not every dot.
        room = None
    rim_um = rim_dots(opening.unit) * rules.dot_nm / NM_PER_UM
    return Alternative(opening.name, opening.unit, opening.value, room, rim_um, alike=alike)


def _listed(judged: list[Alternative], chosen: Alternative) -> list[Alternative]:
    """At most eight, PSNR falling: those that no other has as much of everything as, then the best of the rest."""
    worth = {id(rival): (rival.value, rival.emitters or 0, rival.rim_um) for rival in (chosen, *judged)}

    def covered(rival: Alternative) -> bool:
        others = (numbers for key, numbers in worth.items() if key != id(rival))
        return any(all(a >= b for a, b in zip(numbers, worth[id(rival)], strict=True)) for numbers in others)

    first = [id(rival) for rival in judged if not covered(rival)][:_MOST]
    rest = [id(rival) for rival in judged if id(rival) not in first]
    listed = {*first, *rest[: _MOST - len(first)]}
    return [rival for rival in judged if id(rival) in listed]
