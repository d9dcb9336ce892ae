"""From an opening that breaks the rules to the nearest one found that keeps them."""

from __future__ import annotations

from collections.abc import Iterator
from itertools import chain

import numpy as np

from maskfab.base.arrays import Mask
from maskfab.errors import JobError, OpeningError
from maskfab.optimiser.rules.constraints import Constraints
from maskfab.optimiser.rules.discrete import anneal
from maskfab.optimiser.rules.families import FAMILIES, Candidate

_EVALUATIONS = 400
_TRIED = 200


def nearest(unit: Mask, constraints: Constraints, *, seed: int = 0) -> Mask:
    """An opening that keeps the constraints and has as many dots as possible in common with this one.

    The compact shape that shares most dots with it and keeps the rules is changed dot by dot towards it, rules kept at
    every step. Not proven to be the nearest.

    Args:
        unit: bool [dots, dots].
        constraints: to be kept; their count is the unit's.
        seed: of the changes.

    Raises:
        OpeningError, JobError: MF203, MF204, MF123 if no opening keeps them, or no shape at hand does.
    """
    if constraints.allows(unit):
        return unit
    constraints.require_possible()

    def shared(other: Mask) -> float:
        return float(np.count_nonzero(unit & other))

    shapes = sorted(_shapes(constraints), key=lambda each: -shared(each.unit))
    start = next((each.unit for each in _few_first(shapes) if constraints.allows(each.unit)), None)
    if start is None:
        raise JobError(
            "MF123",
            f"none of {len(shapes)} compact shapes keeps all rules: {', '.join(constraints.active)}",
            where="design.rules",
            cure="Relax one of these rules, or change clear_dots",
        )
    return anneal(start, shared, constraints, evaluations=_EVALUATIONS, seed=seed).unit


def _shapes(constraints: Constraints) -> Iterator[Candidate]:
    families = ("bars", "discs", "l_shapes", "crosses")
    return chain.from_iterable(_of_family(name, constraints) for name in families)


def _of_family(name: str, constraints: Constraints) -> Iterator[Candidate]:
    try:
        yield from FAMILIES[name](constraints.dots, constraints.clear_dots)
    except OpeningError:
        return


def _few_first(shapes: list[Candidate]) -> Iterator[Candidate]:
    """The closest ones, then a few of all the others: rules on emitters take their time."""
    yield from shapes[:_TRIED]
    yield from shapes[_TRIED :: max(1, len(shapes) // _TRIED)]
