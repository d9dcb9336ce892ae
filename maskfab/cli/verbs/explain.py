"""``maskfab explain``: the meaning of an error code or of a job's key, and the list of codes."""

from __future__ import annotations

from typing import Annotated

import typer

from maskfab.cli.common.options import Json
from maskfab.cli.common.printing import print_json


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
    from maskfab.api.verbs.explaining import explain as explained

    found = explained(code)
    if as_json:
        print_json(found.to_dict())
    else:
        typer.echo(found)
