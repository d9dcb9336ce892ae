"""``maskfab plan``: what a scene needs modelled."""

from __future__ import annotations

from typing import Annotated

import typer

from maskfab.cli.common.options import JobFile, Json
from maskfab.cli.common.printing import print_json


def plan(
    job: JobFile,
    die: Annotated[str | None, typer.Option(help="Die of the job; default: all.")] = None,
    as_json: Json = False,
) -> None:
    """Plan the model of the job's [scene]: effects to include, error of those omitted, time and memory."""
    from maskfab.api.verbs.planning import plan as plan_job

    found = plan_job(job, die=die)
    if as_json:
        print_json(found.to_dict())
    else:
        typer.echo(found)
