"""Openings that a display fits before their map is known: the best one, or the largest where too many dots are asked.

Kinds of panels are tried, and the first that has an opening is taken. Openings round which lines run alike in every
pixel suit any map, so that this is designed freely. Where the families of the job have none, all families are looked
at; where these have none, openings that suit cells laid alike, whose map is looked at while it is designed. Last,
emitters may be crooked, which takes longer to ask.

Fewer dots are easier, so the largest number for which an opening is found is bisected. None being found is no proof
that there is none: the rules' own proofs come first.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from itertools import islice

import numpy as np

from maskfab.base.arrays import Floats, Ints, Mask
from maskfab.base.errors import JobError, OpeningError
from maskfab.base.work import Clock, Progress, silent
from maskfab.designs.rules.constraints import Constraints
from maskfab.designs.rules.display_fit import Display, Wired, footprints_of, of_display
from maskfab.designs.rules.families import FAMILIES, Candidate, kind, turned_key
from maskfab.designs.rules.rule import Conflict
from maskfab.designs.search.annealing import Ranked
from maskfab.designs.search.guard import Guard
from maskfab.display.pixel_lines import WireRules

_TRIED = 240
"""Openings whose rules are judged, of those of one kind of panel, before it is said to have none."""

_TRIED_OF_FEWER = 24
"""Openings whose rules are judged for every number of dots of a bisection, the roomiest first."""

MOST_JUDGED = 3000
"""Shapes of one count above which places in the cell are thinned."""

_JUDGED_OF_FEWER = 600
"""Of every number of dots of a bisection."""

_KINDS, _NEAR = 8, 3
"""Kinds of shapes that are judged at every place so near to the best one that was judged."""

_TRIED_CROOKED = 24
"""The most where crooked emitters are looked for, which takes some tenths of a second."""

ALL_FAMILIES: tuple[str, ...] = tuple(FAMILIES)


@dataclass(frozen=True)
class Shortfall:
    """A display that was found to hold fewer clear dots than were asked for.

    Attributes:
        asked: clear dots.
        held: the most for which an opening was found.
        proof: why no opening holds as many as asked; None where none was found and none is proved impossible.
    """

    asked: int
    held: int
    proof: str | None

    @property
    def told(self) -> str:
        """The sentence on it."""
        why = "none was found, which is no proof" if self.proof is None else self.proof
        return f"{self.asked} clear dots do not fit ({why}); the most that were found to fit are {self.held}"


def roomiest(shapes: Sequence[Candidate], rules: Constraints) -> list[Candidate]:
    """Shapes beside which a display may fit, those with most room for straight lines and emitters first.

    Left out are shapes whose lines or emitters a bound excludes. Room is the least, over lines and emitters, of what
    there is over what is asked; it only orders.

    Args:
        shapes: of one count of clear dots.
        rules: with a display that is wired before any map, or laid alike.
    """
    display: Display = rules["emitters"]
    if not shapes:
        return []
    units, dot_nm = np.stack([shape.unit for shape in shapes]), rules.dot_nm
    passing = display.lines_beside(units, dot_nm)
    if passing is not None:
        able = np.flatnonzero(passing >= display.opaque_lines).tolist()
        shapes, units = [shapes[k] for k in able], units[able]
        if not shapes:
            return []
    asked = display.rules.emitters
    share = footprints_of(rules, asked).bounds(units)
    room: Floats = share / asked.required if asked.required > 0 else np.ones(len(units))
    wires = display.rules.wires
    if wires is not None and display.opaque_lines:
        lines = straight_lines(units, dot_nm, wires.rules, turned=display.wired is not Wired.REGULAR)
        room = np.minimum(room, (lines + 0.5) / display.opaque_lines)
    order = np.argsort(-room, kind="stable").tolist()
    return [shapes[k] for k in order if share[k] >= asked.required]


def straight_lines(units: Mask, dot_nm: int, rules: WireRules, *, turned: bool) -> Ints:
    """Straight lines that pass beside openings along x and along y, the fewer of both; int64 [units].

    Args:
        units: bool [units, dots, dots], some of each clear.
        turned: whether they must pass in all eight orientations.
    """
    lane, dots = rules.line_nm + rules.space_nm, units.shape[1]
    seen = [np.asarray(units.any(axis=axis)) for axis in (1, 2)]
    if turned:
        one = seen[0] | seen[1] | seen[0][:, ::-1] | seen[1][:, ::-1]
        seen = [one]
    fewest = np.full(len(units), np.iinfo(np.int64).max)
    for clear in seen:
        # Many shapes cast one shadow.
        shadows, which = np.unique(clear, axis=0, return_inverse=True)
        passing = np.zeros(len(shadows), dtype=np.int64)
        for k, row in enumerate(shadows):
            places = np.flatnonzero(row)
            inner = np.diff(places, prepend=-1, append=dots) - 1
            spare = np.full(len(inner), rules.space_nm - 2 * rules.clearance_nm)
            # Half a space is kept from the pixel's border in place of the clearance.
            spare[[0, -1]] = rules.space_nm - rules.clearance_nm - -(-rules.space_nm // 2)
            passing[k] = np.maximum((inner * dot_nm + spare) // lane, 0).sum()
        fewest = np.minimum(fewest, passing[which])
    return fewest


def kinds_of_panel(rules: Constraints, *, crooked: bool = True) -> Iterator[Constraints]:
    """Rules of displays that suit any map; of cells laid alike; then, if time allows, any map and crooked emitters."""
    display: Display = rules["emitters"]
    any_map, regular = (display.wired_as(wired) for wired in (Wired.ANY_MAP, Wired.REGULAR))
    yield rules.asking(**of_display(any_map))
    yield rules.asking(**of_display(regular))
    if crooked:
        # What is known of its lines is known here.
        yield rules.asking(**of_display(replace(any_map, crooked=True)))


EASE = "Ask for fewer lines, or smaller emitters"


def shapes_of(families: Iterable[str], dots: int, clear_dots: int, most: int | None = MOST_JUDGED) -> list[Candidate]:
    """Shapes of some families, thinned where they are more than ``most``, if that is a number."""
    shapes: list[Candidate] = []
    for name in families:
        # A family that cannot have the count has no shapes.
        with suppress(OpeningError, JobError):
            shapes += FAMILIES[name](dots, clear_dots)
    return shapes if most is None else thinned(shapes, most)


def thinned(shapes: Sequence[Candidate], most: int = MOST_JUDGED) -> list[Candidate]:
    """Shapes at evenly fewer places in their cell, so that no more are left; those at its borders stay.

    What an opening is worth changes little from place to place, so that :func:`finer` finds what lies between.
    """
    if len(shapes) <= most:
        return list(shapes)
    places = _places(np.stack([shape.unit for shape in shapes]))
    step = 1
    chosen = np.ones(len(shapes), dtype=np.bool_)
    while chosen.sum() > most and step < len(shapes[0].unit):
        step += 1
        low, high = places[:, :2], places[:, 2:]
        chosen = np.asarray(((low % step == 0) | (high == 0)).all(axis=1))
    return [shape for shape, kept in zip(shapes, chosen, strict=True) if kept]


def finer(shapes: Sequence[Candidate], judged: Sequence[Ranked], kinds: int = _KINDS) -> list[Candidate]:
    """Shapes left out, near the best place of each of the best kinds of those ``judged``, which are the best first."""
    best: dict[str, tuple[int, int]] = {}
    for one in judged:
        name = one.name.partition(" at ")[0]
        if len(best) < kinds or name in best:
            best.setdefault(name, tuple(_places(one.unit[None])[0, :2].tolist()))
    seen = {one.name for one in judged}
    near = []
    for shape in shapes:
        middle = best.get(shape.name.partition(" at ")[0])
        if middle is not None and shape.name not in seen:
            row, column = _places(shape.unit[None])[0, :2]
            if max(abs(row - middle[0]), abs(column - middle[1])) <= _NEAR:
                near.append(shape)
    return near


def _places(units: Mask) -> Ints:
    """Closed rows below, columns left of what is clear, rows above and columns right of it; int64 [units, 4]."""
    rows, columns = (np.asarray(units.any(axis=axis)) for axis in (2, 1))
    return np.stack([part.argmax(axis=1) for part in (rows, columns, rows[:, ::-1], columns[:, ::-1])], axis=1)


def held_of(varied: Iterable[Candidate], rules: Constraints, clock: Clock) -> Candidate | None:
    """The first shape that keeps all rules, of those that are tried; None if none was found."""
    display: Display = rules["emitters"]
    for shape in varied:
        # Lines take a hundredth of the time of crooked emitters, so they are asked first.
        wired = not display.crooked or display.unwired(shape.unit, rules.dot_nm) is None
        if wired and rules.allows(shape.unit):
            return shape
        if clock.over:
            break
    return None


def _varied(shapes: Iterable[Candidate]) -> Iterator[Candidate]:
    """The first of every kind, then the second of each, and so on."""
    by_kind: dict[tuple[str, int, int], list[Candidate]] = {}
    for shape in shapes:
        by_kind.setdefault(kind(shape.name, shape.unit), []).append(shape)
    for round_ in range(max(map(len, by_kind.values()), default=0)):
        yield from (own[round_] for own in by_kind.values() if len(own) > round_)


@dataclass(frozen=True, eq=False)
class Start:
    """Where the search for a display begins, and for which kind of panel; ``shortfall`` if of fewer dots than asked."""

    rules: Constraints
    families: tuple[str, ...]
    first: Candidate
    shortfall: Shortfall | None = None

    @property
    def any_map(self) -> bool:
        """Whether no map breaks the display."""
        display: Display = self.rules["emitters"]
        return display.wired is Wired.ANY_MAP

    @property
    def laid_alike(self) -> Start:
        """The start in panels whose cells are laid alike."""
        display: Display = self.rules["emitters"]
        return replace(self, rules=self.rules.asking(**of_display(display.wired_as(Wired.REGULAR))))

    def guard(self, unit: Mask) -> Guard | None:
        """Guard of the map of an opening; None where no map breaks the display."""
        display: Display = self.rules["emitters"]
        return None if self.any_map or display.rules.wires is None else Guard(display, unit, self.rules.dot_nm)


def start_of(
    rules: Constraints,
    families: tuple[str, ...],
    clock: Clock,
    progress: Progress = silent,
    *,
    more_than: int = 0,
    crooked: bool = True,
) -> Start | None:
    """The first opening that a display fits, of as many dots as are asked for, or of as many as can be.

    Args:
        clock: the best so far is taken when it is over.
        progress: told when an opening is found, and by every step of the bisection.
        more_than: clear dots that are known to fit; only more are looked for.
        crooked: look for crooked emitters too, which takes most of the time where a display is nearly full.

    Returns:
        None where no opening of more dots than that was found to hold the display.
    """
    asked = rules.clear_dots
    conflict = _conflict(rules)
    if conflict is None and (found := _start(rules, families, _TRIED, clock, crooked)) is not None:
        progress(f"fits: {found.first.name}", 1, 1)
        return found
    best: Start | None = None
    low, high = more_than, asked
    steps = int(np.ceil(np.log2(max(asked, 2))))
    for step in range(steps + 1):
        if high - low <= 1 or (clock.over and best is not None):
            break
        count = (low + high) // 2
        fewer = replace(rules, clear_dots=count)
        found = None if _conflict(fewer) is not None else _start(fewer, families, _TRIED_OF_FEWER, clock, crooked)
        progress(f"{asked} dots do not fit; tried {count}", step + 1, steps + 1)
        if found is None:
            high = count
        else:
            low, best = count, found
    if best is None:
        return None
    return replace(best, shortfall=Shortfall(asked, low, None if conflict is None else conflict.statement))


def _conflict(rules: Constraints) -> Conflict | None:
    """A proof that no opening of the count suits even cells that are laid alike."""
    display: Display = rules["emitters"]
    return rules.asking(**of_display(display.wired_as(Wired.REGULAR))).conflict()


def _start(rules: Constraints, families: tuple[str, ...], tried: int, clock: Clock, crooked: bool) -> Start | None:
    others = tuple(name for name in ALL_FAMILIES if name not in families)
    made: dict[tuple[str, ...], list[Candidate]] = {}
    # What bounds leave is the same for crooked emitters.
    varied: dict[tuple[Wired, tuple[str, ...]], list[Candidate]] = {}
    for held in kinds_of_panel(rules, crooked=crooked):
        display: Display = held["emitters"]
        for names in (families, others):
            if names not in made:
                most = MOST_JUDGED if tried == _TRIED else _JUDGED_OF_FEWER
                made[names] = shapes_of(names, rules.dots, rules.clear_dots, most)
            if (display.wired, names) not in varied:
                varied[display.wired, names] = list(_varied(roomiest(made[names], held)))
            most = min(tried, _TRIED_CROOKED) if display.crooked else tried
            first = held_of(varied[display.wired, names][:most], held, clock)
            if first is not None:
                return Start(held, families if names == families else (*families, *others), first)
    return None


def require_held(rules: Constraints, families: tuple[str, ...], clock: Clock, progress: Progress = silent) -> None:
    """Refuse a display beside which no shape of the families keeps the rules on the job's tiling, before any is judged.

    Every shape is asked that bounds leave, the roomiest first, so that one that fits is soon found.

    Args:
        clock: a look that it ends refuses nothing.
        progress: told by every step of the bisection for the most dots that do fit.

    Raises:
        JobError: MF123, with the largest number of dots for which an opening was found.
    """
    asked = rules.clear_dots

    def first_of(count: int, tried: int | None) -> tuple[Candidate | None, int]:
        shapes = shapes_of(families, rules.dots, count, _JUDGED_OF_FEWER if tried else None)
        shapes = shapes if tried else _apart(shapes, rules.orientations)
        held = replace(rules, clear_dots=count)
        return held_of(islice(_varied(roomiest(shapes, held)), tried), held, clock), len(shapes)

    found, many = first_of(asked, None)
    if found is not None or clock.over:
        return
    low, high, best = 0, asked, None
    while high - low > 1 and not clock.over:
        count = (low + high) // 2
        progress(f"{asked} dots do not fit; tried {count}", 0, 1)
        found, _ = first_of(count, _TRIED_OF_FEWER)
        low, high, best = (low, count, best) if found is None else (count, high, found)
    what = (
        f"{asked} dots do not fit: none of the {many} shapes of {', '.join(families)} keeps {', '.join(rules.active)}"
    )
    if best is None:
        raise JobError("MF123", f"{what}; nor was one of fewer dots found", where="design.fit", cure=EASE)
    what += f"; {low} do, as {best.name}"
    raise JobError("MF123", what, where="design.clear_dots", cure=f"Set clear_dots = {low}, or {EASE.lower()}")


def _apart(shapes: Iterable[Candidate], orientations: Iterable[int]) -> list[Candidate]:
    turns = tuple(orientations)
    return list({turned_key(shape.unit, turns): shape for shape in reversed(list(shapes))}.values())[::-1]


_WALKED = 400
"""Judged openings whose rules are asked at most."""


def best_held(ranked: Sequence[Ranked], start: Start, value: float, most: int, clock: Clock) -> list[Ranked]:
    """The best judged openings that a display fits, one of every kind, PSNR falling.

    Those are asked first beside which straight lines pass, then any that are better than all that were found.

    Args:
        ranked: judged openings, the best first.
        start: of the search; its first opening is one of them.
    """
    first = Ranked(start.first.name, start.first.unit, value)
    found = {kind(first.name, first.unit): first}
    kept = {shape.name for shape in roomiest([Candidate(one.name, one.unit) for one in ranked], start.rules)}
    display: Display = start.rules["emitters"]
    wires = display.rules.wires
    able = [one for one in ranked if one.name in kept]
    if wires is None or not able:
        likely = [True] * len(able)
    else:
        units = np.stack([one.unit for one in able])
        passing = straight_lines(units, start.rules.dot_nm, wires.rules, turned=start.any_map)
        likely = (passing >= display.opaque_lines).tolist()
    asked, least = 0, _WALKED // 16
    for wanted in (True, False):
        for one, is_likely in zip(able, likely, strict=True):
            if asked >= _WALKED or (asked >= least and clock.over):
                break
            size = kind(one.name, one.unit)
            better = sum(other.value >= one.value for other in found.values()) < most
            if is_likely is not wanted or not better or (size in found and found[size].value >= one.value):
                continue
            asked += 1
            if start.rules.allows(one.unit):
                found[size] = one
    return sorted(found.values(), key=lambda one: -one.value)[:most]
