"""The corners of a lens stop of straight sides."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Annotated

from pydantic import BeforeValidator, PlainSerializer

from maskfab.errors import JobError
from maskfab.jobfile.problems import refusing
from maskfab.jobfile.values import length_um, um_text

_MOST_CORNERS = 256
_CURE = 'Write pairs of x and y: [["1 mm", "0 mm"], ["0 mm", "1 mm"], ["-1 mm", "-1 mm"]]'

Corner = tuple[float, float]


def _coordinate(value: object) -> float:
    """Micrometres of a length that may be negative or zero."""
    text = value.strip() if isinstance(value, str) else value
    if isinstance(text, str) and text.startswith("-"):
        return -length_um(text[1:], zero_allowed=True)
    return length_um(text, zero_allowed=True)


def _corners(value: object) -> tuple[Corner, ...]:
    """Corners of a polygon whose sides meet only where one follows the other.

    Raises:
        JobError: MF105 for what is no list of pairs, MF103 and MF104 for their lengths; MF132 for sides that cross or
            touch, corners that coincide, or fewer than three; MF115 for more than 256.
    """
    if not isinstance(value, list | tuple) or not all(isinstance(p, list | tuple) and len(p) == 2 for p in value):
        raise JobError("MF105", f"{value!r} is not a list of pairs", cure=_CURE)
    if len(value) < 3:
        raise JobError("MF132", f"{len(value)} corners hold no area; 3 are needed", cure=_CURE)
    if len(value) > _MOST_CORNERS:
        raise JobError(
            "MF115", f"{len(value)} corners are more than {_MOST_CORNERS}", cure="Draw the stop with fewer corners"
        )
    found = tuple((_coordinate(x), _coordinate(y)) for x, y in value)
    _refuse_crossing(found)
    return found


def _refuse_crossing(corners: Sequence[Corner]) -> None:
    sides = list(zip(corners, (*corners[1:], *corners[:1]), strict=True))
    for k, first in enumerate(sides):
        if first[0] == first[1]:
            raise JobError("MF132", f"corner {k + 1} and the next coincide", cure="Remove one of the two corners")
        for j in range(k + 1, len(sides)):
            second = sides[j]
            if j == k + 1 or (k == 0 and j == len(sides) - 1):
                shared, before, after = (
                    (first[1], first[0], second[1]) if j == k + 1 else (first[0], first[1], second[0])
                )
                meet = _turn(before, shared, after) == 0 and _ahead(before, shared, after)
            else:
                meet = _cross(*first, *second)
            if meet:
                raise JobError(
                    "MF132",
                    f"sides {k + 1} and {j + 1} cross or touch",
                    cure="Give the corners in order round the stop",
                )


def _turn(p: Corner, q: Corner, r: Corner) -> float:
    """Positive if p, q, r turn left; 0 on a line, up to rounding."""
    turn = (q[0] - p[0]) * (r[1] - p[1]) - (q[1] - p[1]) * (r[0] - p[0])
    return 0.0 if abs(turn) <= 1e-12 * math.dist(p, q) * math.dist(p, r) else turn


def _ahead(p: Corner, q: Corner, r: Corner) -> bool:
    """Whether the way from q to r leads back along that from p to q."""
    return (q[0] - p[0]) * (r[0] - q[0]) + (q[1] - p[1]) * (r[1] - q[1]) < 0


def _cross(p: Corner, q: Corner, r: Corner, s: Corner) -> bool:
    """Whether two sides have a place in common."""
    turns = _turn(p, q, r), _turn(p, q, s), _turn(r, s, p), _turn(r, s, q)
    if all(turns):
        return (turns[0] > 0) != (turns[1] > 0) and (turns[2] > 0) != (turns[3] > 0)
    ends = (p, q, r), (p, q, s), (r, s, p), (r, s, q)
    return any(turn == 0 and _between(*end) for turn, end in zip(turns, ends, strict=True))


def _between(p: Corner, q: Corner, r: Corner) -> bool:
    """Whether r, which is in line with p and q, lies between them."""
    return all(min(a, b) <= c <= max(a, b) for a, b, c in zip(p, q, r, strict=True))


Corners = Annotated[
    tuple[Corner, ...],
    BeforeValidator(lambda v: refusing(_corners, v)),
    PlainSerializer(lambda v: [[um_text(x), um_text(y)] for x, y in v]),
]
