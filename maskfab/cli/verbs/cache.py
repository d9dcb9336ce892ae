"""``maskfab cache``: what earlier runs have found, and room for more."""

from __future__ import annotations

from typing import Annotated

import typer

from maskfab.cli.common.options import Json, named_as_options
from maskfab.cli.common.printing import print_found


def cache(
    context: typer.Context,
    limit: Annotated[
        str | None,
        typer.Option(metavar="SIZE", help="Remove what was used longest ago until the rest takes no more: '1 GB', 0."),
    ] = None,
    as_json: Json = False,
) -> None:
    """Tell what earlier runs have found, which later ones take from there, and remove what was used longest ago."""
    from maskfab.api.verbs.keeping import cache as kept

    with named_as_options(context):
        found = kept(limit)
    print_found(found, as_json)
