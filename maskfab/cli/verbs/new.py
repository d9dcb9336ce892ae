"""``maskfab new``: a job of one's own to begin with."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from maskfab.cli.common.options import Json, named_as_options
from maskfab.cli.common.printing import print_found


def new(
    context: typer.Context,
    folder: Annotated[Path, typer.Argument(metavar="FOLDER", help="Folder to make; it must be new or empty.")],
    source: Annotated[
        str, typer.Option("--from", metavar="NAME", help="A shipped job, such as upc12 or display_that_fits.")
    ] = "first_plate",
    as_json: Json = False,
) -> None:
    """Begin a job of your own: a folder with a commented job, and the openings and maps that it names."""
    from maskfab.api.verbs.beginning import new as begin

    with named_as_options(context):
        found = begin(folder, source)
    print_found(found, as_json)
