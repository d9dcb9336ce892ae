"""``maskfab explain``: what an error code means, and the list of codes."""

from __future__ import annotations

import textwrap
from dataclasses import asdict
from typing import Annotated

import typer

from maskfab.cli.common.options import Json
from maskfab.cli.common.printing import print_json
from maskfab.errors import CATALOGUE

_WIDTH = 100
_INDENT = " " * len("Usual cause: ")


def explain(
    code: Annotated[
        str | None, typer.Argument(metavar="CODE", help="A code such as MF106; without one, all codes are listed.")
    ] = None,
    as_json: Json = False,
) -> None:
    """Explain an error code: its meaning, an example, the usual cause and the cure."""
    from maskfab import error_codes

    if code is None:
        groups = error_codes.grouped()
        if as_json:
            print_json({heading: {each: CATALOGUE[each] for each in codes} for heading, codes in groups.items()})
        else:
            typer.echo(
                "\n\n".join(
                    "\n".join([heading, *(f"  {each}  {CATALOGUE[each]}" for each in codes)])
                    for heading, codes in groups.items()
                )
            )
        return
    found = error_codes.explained(code)
    if as_json:
        print_json(asdict(found))
        return
    typer.echo(f"{found.code}  {found.meaning}\n")
    for title, text in (("Example", found.example), ("Usual cause", found.cause), ("Cure", found.cure)):
        lines = (line for each in text.splitlines() for line in textwrap.wrap(each, _WIDTH - len(_INDENT)))
        typer.echo(f"{title + ':':<{len(_INDENT)}}" + f"\n{_INDENT}".join(lines))
