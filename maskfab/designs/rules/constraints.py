"""Constraints of an opening, whatever is optimised: its count of clear dots, its rules, and whether they agree.

Rules are judged in order of cost, a microsecond first, the display last, so that a search refuses most of what it tries
before anything is computed. A set of rules that no opening keeps is told with a proof where one is found: that of a
rule, or a look at every opening of the count where they are few.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import islice
from types import MappingProxyType
from typing import Any

import numpy as np
from numpy.typing import NDArray

from maskfab.base.arrays import Mask
from maskfab.base.errors import JobError, OpeningError
from maskfab.base.model import ORIENTATIONS, Opening, frozen, orient
from maskfab.designs.rules.display_fit import DISPLAY_RULES, Wired, of_display
from maskfab.designs.rules.eye import EYE_RULES
from maskfab.designs.rules.families import orbits, sums
from maskfab.designs.rules.rule import DOT_RULES, Conflict, Rule, out_of_range
from maskfab.display.emitter_rules import EmitterRules
from maskfab.mask.opening_masks import closed

RULES: tuple[Rule, ...] = (*DOT_RULES, *DISPLAY_RULES, *EYE_RULES)
"""Every rule but the count, in the order in which they are judged: cheap ones first, the display last."""

_FEW, _FEW_IF_SLOW = 1000, 20
_COUNT = "clear_dots"
_EMITTERS = EmitterRules(0, 8000, 16000)


@dataclass(frozen=True, eq=False, init=False)
class Constraints:
    """Constraints that every opening of a design must meet.

    The value of a rule is ``constraints[name]``, for every name in :data:`maskfab.designs.rules.constraints.RULES`.

    Attributes:
        clear_dots: exact number of clear dots in a cell.
        gutter_nm: opaque space between cells, outside the dots.
        orientations: elements of D4 in use; any two may be neighbours.
        asked: values of the rules that ask for something.
    """

    clear_dots: int
    dots: int
    gutter_nm: int
    orientations: tuple[int, ...]
    dot_nm: int
    asked: Mapping[str, Any]

    def __init__(
        self,
        clear_dots: int,
        *,
        dots: int = 21,
        gutter_nm: int = 0,
        orientations: tuple[int, ...] = tuple(range(ORIENTATIONS)),
        dot_nm: int = 8000,
        asked: Mapping[str, Any] = MappingProxyType({}),
        **rules: Any,
    ) -> None:
        """The attributes; values of rules by their names, those of ``asked`` where they are not given.

        Raises:
            JobError: MF104 for a number out of range; MF105 for a rule that there is not, or a value that it cannot
                have; MF117 or MF118 where the rules of a display do not suit the pixel.
        """
        for name, number, low, high in (
            ("dots", dots, 1, 512),
            (_COUNT, clear_dots, 0, math.inf),
            ("gutter_nm", gutter_nm, 0, math.inf),
            ("dot_nm", dot_nm, 1, math.inf),
        ):
            if not low <= number <= high:
                raise out_of_range(name, number, low, high, where=f"design.{name}")
        used = tuple(sorted(set(orientations)))
        if not used or not set(used) <= set(range(ORIENTATIONS)):
            what = f"the orientations {orientations} are not elements 0 to 7"
            cure = "List the orientations in use, such as (0, 1, 2, 3)"
            raise JobError("MF104", what, where="design.orientations", cure=cure)
        given = {name: value for name, value in {**asked, **rules}.items() if value is not None}
        if unknown := given.keys() - {rule.name for rule in RULES}:
            what = f"there is no rule {' or '.join(sorted(unknown))}"
            raise JobError("MF105", what, where="design.rules", cure=f"Use {', '.join(rule.name for rule in RULES)}")
        plain = {"clear_dots": clear_dots, "dots": dots, "gutter_nm": gutter_nm, "orientations": used, "dot_nm": dot_nm}
        for name, value in plain.items():
            object.__setattr__(self, name, value)
        values = {rule: rule.value(self, given[rule.name]) for rule in RULES if rule.name in given}
        held = {rule.name: value for rule, value in values.items() if rule.asks(value)}
        object.__setattr__(self, "asked", MappingProxyType(held))

    def __getitem__(self, rule: str) -> Any:
        """The value of a rule; its default where it asks for nothing."""
        if rule in self.asked:
            return self.asked[rule]
        return next(stated for stated in RULES if stated.name == rule).default

    @cached_property
    def rules(self) -> tuple[Rule, ...]:
        """The rules that ask for something, in the order in which they are judged."""
        return tuple(rule for rule in RULES if rule.name in self.asked)

    @property
    def active(self) -> tuple[str, ...]:
        """Names of the rules, beside the count, that ask for something."""
        return tuple(rule.name for rule in self.rules)

    @cached_property
    def free(self) -> Mask:
        """Where dots may be clear, bool [dots, dots]."""
        areas = [rule.free(self) for rule in self.rules if rule.free is not None]
        return frozen(np.logical_and.reduce([~self.nothing, *areas]))

    @property
    def closing(self) -> tuple[str, ...]:
        """Names of the rules that close dots."""
        return tuple(rule.name for rule in self.rules if rule.free is not None)

    @cached_property
    def orbits(self) -> tuple[NDArray[np.intp], ...]:
        """Sets of dots that are clear or closed together, as flat indices, in order of their first."""
        linked = next((rule.linked for rule in self.rules if rule.linked is not None), None)
        return orbits(self.dots, None) if linked is None else tuple(linked(self))

    @property
    def members(self) -> list[NDArray[np.intp]]:
        """Orbits that may be clear."""
        free = self.free.ravel()
        return [orbit for orbit in self.orbits if free[orbit].all()]

    @property
    def emitters(self) -> EmitterRules:
        """Rules of the emitters of the display that the opening must hold, or of plain ones where it must hold none."""
        display = self["emitters"]
        return display.rules.emitters if display else _EMITTERS

    @property
    def nothing(self) -> Mask:
        """No clear dots, bool [dots, dots]."""
        return np.zeros((self.dots, self.dots), dtype=np.bool_)

    def opening(self, unit: Mask) -> Opening:
        """A mask as the opening that a display is asked about."""
        return Opening("unit", unit, self.dot_nm)

    def turned(self, units: Mask) -> Mask:
        """Openings [units, dots, dots] in all orientations in use."""
        return np.stack([orient(unit, k) for unit in units for k in self.orientations])

    def asking(self, **rules: Any) -> Constraints:
        """These constraints with other values of some rules."""
        return replace(self, asked={**self.asked, **rules})

    def only(self, *names: str) -> Constraints:
        """The count and just these rules."""
        return replace(self, asked={name: value for name, value in self.asked.items() if name in names})

    def without(self, *names: str) -> Constraints:
        """These constraints but for some rules."""
        return self.only(*(self.asked.keys() - set(names)))

    @property
    def on_any_map(self) -> Constraints:
        """These constraints, whose display must fit however cells of the orientations in use are laid."""
        display = self["emitters"]
        return self.asking(**of_display(display.wired_as(Wired.ANY_MAP))) if display else self

    def violations(self, unit: Mask) -> tuple[str, ...]:
        """Rules that the opening breaks, each as ``rule: what and how much``; cheap rules first, empty if it meets all.

        An emitter's placement is searched for as long as the layout does; where none was found and none is proved
        impossible, that too is a violation, and says so.

        Args:
            unit: bool [dots, dots].

        Raises:
            JobError: MF105 for another shape.
        """
        return tuple(f"{rule}: {what}" for rule, what in self._broken(unit, quick=False))

    def allows(self, unit: Mask) -> bool:
        """Whether the opening keeps everything; stops at the first rule that is broken.

        Quicker than :meth:`violations`, and no laxer: emitters are rectangles or straight cuts, so that an opening is
        refused round which only crooked emitters fit.
        """
        return self.first_broken(unit) is None

    def first_broken(self, unit: Mask) -> str | None:
        """Name of the first rule that the opening breaks, judged as :meth:`allows` does; None if it keeps all."""
        return next((rule for rule, _ in self._broken(unit, quick=True)), None)

    def broken(self, unit: Mask) -> frozenset[str]:
        """Names of the rules that the opening breaks, judged as :meth:`allows` does; ``clear_dots`` is one."""
        return frozenset(rule for rule, _ in self._broken(unit, quick=True))

    def broken_beside(self, units: Mask) -> str | None:
        """Name of the first rule that openings which keep it among themselves break beside one another; None if none.

        Args:
            units: bool [units, dots, dots], any of which may be the neighbour of any, in the orientations used.
        """
        judged = np.asarray(units, dtype=np.bool_)
        return next((r.name for r in self.rules if r.beside is not None and r.beside(self, judged)), None)

    @property
    def one_place(self) -> tuple[str, ...]:
        """Names of the rules that are proved for cells that all hold the opening at the same place only."""
        return tuple(rule.name for rule in self.rules if rule.one_place(self))

    def conflict(self) -> Conflict | None:
        """Rules that contradict each other, with the proof; None where no proof was found, so that a search may go."""
        offered = int(self.free.sum())
        if self.clear_dots > offered:
            return Conflict(
                (_COUNT, *self.closing),
                f"{offered} of {self.dots} x {self.dots} dots may be clear, {self.clear_dots} must be",
            )
        for rule in self.rules:
            if rule.proof is not None and (conflict := rule.proof(self)) is not None:
                return conflict
        return self._by_looking()

    def require_possible(self) -> None:
        """Refuse rules that contradict each other.

        Raises:
            OpeningError: MF203 for no clear dots, MF204 where the count cannot be reached.
            JobError: MF123 for other contradictions.
        """
        if self.clear_dots == 0:
            raise closed(0, self.dots**2)
        conflict = self.conflict()
        if conflict is None:
            return
        blamed = {rule.name: rule for rule in self.rules if rule.name in conflict.rules}
        askers = [(blamed[name].asker if name in blamed else "") or name for name in conflict.rules]
        together = " together" if len(askers) > 1 else ""
        what = f"no opening keeps {' and '.join(askers)}{together}: {conflict.statement}"
        first = conflict.rules[0]
        where = blamed[first].where if first in blamed else f"design.{first}"
        cure = f"Relax {' or '.join(askers)}"
        if all(rule.counted for rule in blamed.values()):
            raise OpeningError("MF204", what, where=where, cure=cure)
        raise JobError("MF123", what, where=where, cure=cure)

    def _broken(self, unit: Mask, *, quick: bool) -> Iterator[tuple[str, str]]:
        unit = np.asarray(unit, dtype=np.bool_)
        if unit.shape != (self.dots, self.dots):
            raise JobError(
                "MF105",
                f"the opening is {unit.shape}, the cell {self.dots} x {self.dots} dots",
                where="design",
                cure="Give one value per dot",
            )
        if (count := int(unit.sum())) != self.clear_dots:
            yield _COUNT, f"{count} are clear, {self.clear_dots} asked"
        for rule in self.rules:
            check = rule.quick if quick and rule.quick is not None else rule.check
            if (what := check(self, unit)) is not None:
                yield rule.name, what

    def _by_looking(self) -> Conflict | None:
        few = _FEW_IF_SLOW if any(rule.slow for rule in self.rules) else _FEW
        members = self.members
        if all(len(orbit) == 1 for orbit in members) and math.comb(len(members), self.clear_dots) > few:
            return None
        units = list(islice(_every(members, self.clear_dots, self.dots), few + 1))
        if len(units) > few or any(self.allows(unit) for unit in units):
            return None
        broken = [{rule for rule, _ in self._broken(unit, quick=False)} for unit in units]
        if not all(broken):
            return None
        needed = [name for name in self.active if any(name in names for names in broken)]
        for name in list(needed):
            rest = set(needed) - {name}
            if all(names & rest for names in broken):
                needed.remove(name)
        how = "the only opening" if len(units) == 1 else f"every one of the {len(units)} openings"
        linking = (rule.name for rule in self.rules if rule.linked is not None)
        blamed = dict.fromkeys((*self.closing, *linking, *needed))
        return Conflict((_COUNT, *blamed), f"{how} of {self.clear_dots} clear dots breaks one of them")


def _every(members: list[NDArray[np.intp]], total: int, dots: int) -> Iterator[Mask]:
    rest = sums([len(orbit) for orbit in members])
    unit = np.zeros(dots * dots, dtype=np.bool_)
    waiting: list[tuple[int, int, tuple[int, ...]]] = [(0, total, ())]
    while waiting:
        k, left, chosen = waiting.pop()
        if left < 0 or not rest[len(members) - k] >> left & 1:
            continue
        if left == 0:
            unit[:] = False
            for j in chosen:
                unit[members[j]] = True
            yield unit.reshape(dots, dots).copy()
            continue
        waiting.append((k + 1, left, chosen))
        waiting.append((k + 1, left - len(members[k]), (*chosen, k)))
