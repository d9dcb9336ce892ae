"""Values of [pareto]: numbers of clear dots, listed or as a range."""

from __future__ import annotations

from itertools import islice
from typing import Annotated

from pydantic import BeforeValidator, Field

from maskfab.errors import JobError
from maskfab.jobfile.problems import refusing

_MOST = 64


def _listed(value: object) -> object:
    """A table of ``from``, ``to`` and ``step`` as the list that it stands for; anything else as it is."""
    if not isinstance(value, dict):
        return value
    asked = {"step": 1, **value}
    if (
        asked.keys() != {"from", "to", "step"}
        or not all(type(each) is int for each in asked.values())
        or not 1 <= asked["from"] <= asked["to"]
        or asked["step"] < 1
    ):
        raise JobError(
            "MF105",
            f"{value!r} is not a range of whole numbers from 1 upwards",
            cure="Write { from = 60, to = 110, step = 10 }, or a list",
        )
    # One more than may be is enough to be refused.
    return list(islice(range(asked["from"], asked["to"] + 1, asked["step"]), _MOST + 1))


Counts = Annotated[
    tuple[Annotated[int, Field(ge=1)], ...],
    Field(min_length=1, max_length=_MOST, strict=False),
    BeforeValidator(lambda v: refusing(_listed, v)),
]
