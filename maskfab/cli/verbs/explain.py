"""``maskfab explain``: the meaning of an error code or of a job's key, and the list of codes."""

from __future__ import annotations

import re
import textwrap
from dataclasses import asdict
from typing import Annotated

import typer

from maskfab.cli.common.options import Json
from maskfab.cli.common.printing import print_json
from maskfab.errors import CATALOGUE

_WIDTH = 100
_CODE = re.compile(r"(?i)\s*(mf.?\d|\d)")
_INDENT = " " * len("Usual cause: ")


def explain(
    code: Annotated[
        str | None,
        typer.Argument(
            metavar="CODE|KEY",
            help="A code such as MF106, a key or a table of a job such as camera.stop; left out, all codes are listed.",
        ),
    ] = None,
    as_json: Json = False,
) -> None:
    """Explain an error code (meaning, example, usual cause, cure) or a key of a job (form, default, meaning)."""
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
    if not _CODE.match(code):
        _explain_keys(code, as_json)
        return
    found = error_codes.explained(code)
    if as_json:
        print_json(asdict(found))
        return
    typer.echo(f"{found.code}  {found.meaning}\n")
    _parts(("Example", found.example), ("Usual cause", found.cause), ("Cure", found.cure))


def _explain_keys(path: str, as_json: bool) -> None:
    from maskfab.jobfile.reference import described

    keys = described(path)
    if as_json:
        print_json({"keys": [asdict(key) for key in keys]})
        return
    for number, key in enumerate(keys):
        typer.echo("\n" * (number > 0) + key.path + key.section.partition(" ")[1] + key.section.partition(" ")[2])
        default = "required" if key.default is None else key.default or "none"
        _parts(("Meaning", key.meaning), ("Form", key.form), ("Default", default))


def _parts(*parts: tuple[str, str]) -> None:
    for title, text in parts:
        lines = (line for each in text.splitlines() for line in textwrap.wrap(each, _WIDTH - len(_INDENT)))
        typer.echo(f"{title + ':':<{len(_INDENT)}}" + f"\n{_INDENT}".join(lines))
