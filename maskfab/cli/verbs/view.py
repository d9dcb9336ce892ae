"""``maskfab view``: the plate of a finished run, to look into."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from maskfab.cli.common.options import Json
from maskfab.cli.common.printing import one_line, print_json


def view(
    directory: Annotated[Path, typer.Argument(metavar="DIR", help="Finished run: the --out of maskfab run.")],
    out: Annotated[Path | None, typer.Option(help="The page.", show_default="DIR.html, beside the directory")] = None,
    force: Annotated[bool, typer.Option("--force", help="Replace an existing file.")] = False,
    as_json: Json = False,
) -> None:
    """Make one page that shows the plate: layers, dies and their numbers, places of rule violations, a ruler.

    It shows the polygons of the first mask file, read back, and needs neither a network nor a server.
    """
    from maskfab.api.verbs.viewing import view as made

    found = made(directory, out, force=force)
    if as_json:
        print_json(found.to_dict())
    else:
        typer.echo(one_line(str(found)))
