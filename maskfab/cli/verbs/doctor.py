"""``maskfab doctor``: the installation examined."""

from __future__ import annotations

import typer

from maskfab.cli.common.options import Json, Quiet
from maskfab.cli.common.printing import leave, one_line, print_json
from maskfab.cli.common.watch import watched


def doctor(as_json: Json = False, quiet: Quiet = False) -> None:
    """Examine this installation: versions, threads, memory, optional parts, and a self-test that takes seconds."""
    from maskfab.api.verbs.examining import doctor as examine

    with watched(quiet) as progress:
        found = examine(progress=progress)
    if as_json:
        print_json(found.to_dict())
    else:
        for line in str(found).split("\n"):
            typer.echo(one_line(line))
    leave(found.passed)
