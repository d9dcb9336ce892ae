"""``maskfab reproduce``: a finished directory made once more."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from maskfab.cli.common.options import Json, Quiet
from maskfab.cli.common.printing import leave, print_found
from maskfab.cli.common.watch import watched


def reproduce(
    directory: Annotated[Path, typer.Argument(metavar="DIR", help="The --out of a finished maskfab run.")],
    as_json: Json = False,
    quiet: Quiet = False,
) -> None:
    """Make a finished directory once more from its own job: every byte the same, or which file, stage and version."""
    from maskfab.runs.verification import reproduce as remake

    with watched(quiet) as progress:
        found = remake(directory, progress=progress)
    print_found(found, as_json)
    leave(found.passed)
