"""The option --budget: time that a user gives, such as "60 s"."""

from __future__ import annotations

import math
import re
from typing import Annotated

import typer

from maskfab.errors import JobError

Budget = Annotated[
    str | None, typer.Option("--budget", help="Time budget of the search, such as '60 s'; default: unlimited.")
]

_SECONDS = {"s": 1.0, "min": 60.0, "h": 3600.0}
_TIME = re.compile(r"\s*([-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?|nan|inf)\s*([a-z]*)\s*", re.IGNORECASE)


def seconds(text: str | None, *, where: str = "--budget") -> float | None:
    """Seconds of a time written with its unit, s, min or h; None for None.

    Raises:
        JobError: MF103 if there is no unit or it is no unit of time; MF104 if the time is not finite and positive.
    """
    if text is None:
        return None
    match = _TIME.fullmatch(text)
    if match is None or match[2] not in _SECONDS:
        raise JobError(
            "MF103", f"{text!r} is not a time with a unit", where=where, cure='Write it as "60 s", "5 min" or "1 h"'
        )
    value = float(match[1]) * _SECONDS[match[2]]
    if not (math.isfinite(value) and value > 0):
        raise JobError(
            "MF104", f"{text!r} must be a finite time above 0", where=where, cure='Give a positive time, such as "60 s"'
        )
    return value
