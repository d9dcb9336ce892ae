"""Values of [emitters], [wires] and [light]: ratios of three colours, areas with their units."""

from __future__ import annotations

import math
import re
from typing import Annotated

from pydantic import BeforeValidator, PlainSerializer

from maskfab import units
from maskfab.errors import JobError
from maskfab.jobfile.problems import refusing

_AREA = re.compile(r"\s*(\S+?)\s*(nm|um|µm|mm)(?:\^2|2|²)\s*")


def _area(value: object) -> float:
    """Square micrometres of an area such as ``"1985 um^2"``."""
    match = _AREA.fullmatch(value) if isinstance(value, str) else None
    if match is None:
        raise JobError("MF103", f"{value!r} is not an area with its unit", cure='Write it as "1985 um^2"')
    # A number times a unit squared is a length in that unit, times the unit once more.
    once = units.parse_length_um(f"{match[1]} {match[2]}", zero_allowed=True)
    return float(f"{once * units.parse_length_um(f'1 {match[2]}'):.15g}")


def _area_text(value: float) -> str:
    return f"{value:.15g} um^2"


def _three(value: object) -> tuple[float, float, float]:
    """Three finite positive numbers, for red, green and blue."""
    parts = value if isinstance(value, list | tuple) else ()
    numbers = [part for part in parts if isinstance(part, int | float) and not isinstance(part, bool)]
    if len(parts) != 3 or len(numbers) != 3 or not all(math.isfinite(part) and part > 0 for part in numbers):
        raise JobError(
            "MF116", f"{value!r} is not three positive numbers", cure="Give red, green and blue, such as [1, 1, 2]"
        )
    red, green, blue = (float(part) for part in numbers)
    return red, green, blue


Area = Annotated[float, BeforeValidator(lambda v: refusing(_area, v)), PlainSerializer(_area_text)]
ThreeColours = Annotated[tuple[float, float, float], BeforeValidator(lambda v: refusing(_three, v))]
