"""Openings that a search judged within a tenth of a decibel of its best, and what each is better at.

Shapes of one family and size that lie at different places of the cell restore nearly alike. So openings are told apart
by family, size and the closed rim that they leave, whatever way they are turned; of each such kind the best that keeps
the rules stands for all. Judged are openings turned at random, or all alike where the panel is periodic: a designed map
may set them in another order.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass, replace

import numpy as np

from maskfab.base.arrays import Mask
from maskfab.errors import JobError
from maskfab.optimiser.rules.constraints import Constraints
from maskfab.optimiser.rules.discrete import Ranked
from maskfab.optimiser.rules.families import kind
from maskfab.optimiser.rules.fit_rule import footprints_of
from maskfab.optimiser.rules.orbits import turned_key
from maskfab.units import NM_PER_UM

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
