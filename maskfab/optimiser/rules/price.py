"""Prices of rules: how much better an opening may be that need not keep them."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable
from dataclasses import dataclass

from maskfab.errors import JobError
from maskfab.optimiser.rules.constraints import Constraints
from maskfab.optimiser.rules.families import Candidate
from maskfab.optimiser.rules.rule import Mask


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
    judged = [(objective(c.unit), constraints.broken(c.unit)) for c in candidates]
    known = [(value, broken) for value, broken in judged if "clear_dots" not in broken]
    if not known:
        raise JobError(
            "MF105",
            "no candidate has the asked count",
            where="design",
            cure="Add candidates with that number of clear dots",
        )

    def best(allowed: Callable[[frozenset[str]], bool]) -> float:
        return max((value for value, broken in known if allowed(broken)), default=-math.inf)

    top, all_kept = best(lambda _: True), best(lambda broken: not broken)
    found = []
    for rule in constraints.active:
        others = best(lambda broken, rule=rule: broken <= {rule})  # type: ignore[misc]
        alone = best(lambda broken, rule=rule: rule not in broken)  # type: ignore[misc]
        found.append(Price(rule, top - alone, math.inf if all_kept == -math.inf else others - all_kept))
    return Prices(top - all_kept, tuple(found))
