"""Our errors on their way through pydantic, and pydantic's own as errors of ours that name the key."""

from __future__ import annotations

from typing import Any

from pydantic import ValidationError
from pydantic_core import PydanticCustomError

from maskfab.errors import JobError

_PART = "\x1f"  # parts what from cure on the way through pydantic
_OUT_OF_RANGE = frozenset({"greater_than", "greater_than_equal", "less_than", "less_than_equal", "finite_number"})


def refusing(parse: Any, value: object, **options: object) -> Any:
    """Run one of our parsers inside pydantic, which then adds the place of the value."""
    try:
        return parse(value, **options)
    except JobError as error:
        # Without a context pydantic takes the text as it is, braces included.
        raise PydanticCustomError(error.code, error.what + _PART + error.cure) from error


def _written(loc: tuple[int | str, ...]) -> tuple[int | str, ...]:
    """A place without the name of the method that [design] was read as, which pydantic puts into it."""
    return loc[:1] + loc[2:] if loc[:1] == ("design",) and loc[1:2] in {("search",), ("relax",)} else loc


def first_problem(error: ValidationError, where: str) -> JobError:
    """The first problem pydantic found, as an error of ours that names the key; the number of others is told.

    An unknown key comes first of all: a misspelt one is also missing under its true name.
    """
    problems = sorted(error.errors(include_url=False), key=lambda p: p["type"] != "extra_forbidden")
    for each in problems:
        each["loc"] = _written(each["loc"])
    problem = problems[0]
    # A list of which one item is wrong may also count as too short; that is no problem of its own.
    more = sum(p["loc"] != problem["loc"][: len(p["loc"])] for p in problems)
    key = "".join(f"[{p}]" if isinstance(p, int) else f".{p}" for p in problem["loc"]).lstrip(".") or "the file"
    place = f"{where}: {key}"
    others = f"; {more} more problem{'s follow' if more > 1 else ' follows'}" if more else ""
    kind = problem["type"]
    if kind.startswith("MF"):
        what, _, cure = problem["msg"].partition(_PART)
        return JobError(kind, f"{key} = {what}{others}" if kind != "MF110" else what + others, where=place, cure=cure)
    if kind == "extra_forbidden":
        return JobError("MF102", f"unknown key {key!r}{others}", where=place, cure="Remove it, or mend its spelling")
    if kind == "missing":
        return JobError("MF105", f"the key {key!r} is missing{others}", where=place, cure=f"Add {key}")
    code = "MF104" if kind in _OUT_OF_RANGE else "MF105"
    what = f"{key} = {problem['input']!r}: {problem['msg'][0].lower()}{problem['msg'][1:]}{others}"
    return JobError(code, what, where=place, cure=f"Change {key}")
