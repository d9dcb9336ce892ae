"""``maskfab schema``: JSON Schemas, from which editors complete a job."""

from __future__ import annotations

from typing import Annotated, Any, cast

import typer

from maskfab.cli.common.options import Json
from maskfab.cli.common.printing import print_json


def schema(
    of: Annotated[str, typer.Argument(metavar="[job|report|check]", help="Document that is described.")] = "job",
    as_json: Json = False,
) -> None:
    """Print the JSON Schema of a job file, of report.json or of maskfab check --json, with or without --json."""
    from maskfab.api.verbs.beginning import schema as described

    print_json(described(cast(Any, of)))
