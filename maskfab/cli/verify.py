"""``maskfab verify``: a finished directory read again."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from maskfab.cli.options import Json, Quiet
from maskfab.cli.printing import leave, print_json, summarise
from maskfab.cli.watch import watched


def verify(
    directory: Annotated[Path, typer.Argument(metavar="DIR", help="The --out of a finished run.")],
    as_json: Json = False,
    quiet: Quiet = False,
) -> None:
    """Read a finished output directory again and repeat every check."""
    from maskfab.verification import verify as verify_directory

    with watched(quiet) as progress:
        checks = verify_directory(directory, progress)
    passed = all(check.passed for check in checks)
    if as_json:
        from maskfab.report.data import quantity_document

        print_json({"verdict": "pass" if passed else "fail", "checks": [quantity_document(q) for q in checks]})
    else:
        summarise(checks)
    leave(passed)
