"""``maskfab explain``: what an error code means."""

from __future__ import annotations

from typing import Annotated

import typer

from maskfab import errors
from maskfab.cli.options import Json
from maskfab.cli.printing import print_json
from maskfab.errors import JobError


def explain(
    code: Annotated[str, typer.Argument(metavar="CODE", help="A code such as MF106.")], as_json: Json = False
) -> None:
    """Say what an error code means."""
    known = errors.CATALOGUE.get(code.upper())
    if known is None:
        listed = ", ".join(errors.CATALOGUE)
        raise JobError("MF105", f"there is no code {code!r}", cure=f"The codes are {listed}")
    if as_json:
        print_json({"code": code.upper(), "meaning": known})
    else:
        typer.echo(f"{code.upper()} {known}")
