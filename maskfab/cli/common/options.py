"""Arguments and options that several verbs take."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Annotated

import typer

from maskfab.base.errors import JobError, MaskfabError
from maskfab.base.units import UM_PER_UNIT

_DRAWING_UNITS = ("nm", "um", "mm", "mil", "in")

JobFile = Annotated[Path, typer.Argument(metavar="JOB", help="A job file (.toml).")]
Json = Annotated[bool, typer.Option("--json", help="Print a single JSON document on stdout.")]
Unit = Annotated[
    str | None, typer.Option(metavar="nm|um|mm|mil|in", help="Drawing unit of a DXF; overrides the one in the file.")
]
Budget = Annotated[
    str | None, typer.Option("--budget", help="Time budget of the search, such as '60 s'; default: unlimited.")
]
Quiet = Annotated[bool, typer.Option("--quiet", help="Show no progress on stderr.")]


def unit_um(unit: str | None) -> float | None:
    """Micrometres of a stated :data:`Unit`.

    Raises:
        JobError: MF105 if it is none of them.
    """
    if unit is not None and unit not in _DRAWING_UNITS:
        known = ", ".join(_DRAWING_UNITS)
        raise JobError("MF105", f"there is no unit {unit!r}", where="--unit", cure=f"Use one of {known}")
    return None if unit is None else UM_PER_UNIT[unit]


@contextmanager
def named_as_options(context: typer.Context) -> Iterator[None]:
    """Errors that name an argument of a function name the option that states it instead."""
    try:
        yield
    except MaskfabError as error:
        stated = context.command.params
        options = {each.name: each.opts[0] for each in stated if each.param_type_name == "option"}
        function, _, argument = error.where.rpartition(": ")
        if argument not in options or not (function.isidentifier() or not function):
            raise
        raise type(error)(error.code, error.what, where=options[argument], cure=error.cure) from error
