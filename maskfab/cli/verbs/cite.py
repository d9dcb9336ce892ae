"""``maskfab cite``: entries for a bibliography."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from maskfab.cli.common.options import Json
from maskfab.cli.common.printing import print_found


def cite(
    directory: Annotated[
        Path | None, typer.Argument(metavar="[DIR]", help="A finished run, whose version and job are cited.")
    ] = None,
    as_json: Json = False,
) -> None:
    """Print BibTeX entries of maskfab, and of the paper whose experiment it is for."""
    from maskfab.api.verbs.citing import cite as entries

    found = entries(directory)
    print_found(found, as_json)
