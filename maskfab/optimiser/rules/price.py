"""Prices of rules: how much better an opening may be that need not keep them."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable
from dataclasses import dataclass

from maskfab.base.arrays import Mask
from maskfab.errors import JobError
from maskfab.optimiser.rules.constraints import Constraints
from maskfab.optimiser.rules.families import Candidate


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
