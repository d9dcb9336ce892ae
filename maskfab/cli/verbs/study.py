"""``maskfab study``: figures of dies, and claims held against their numbers."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from maskfab.base.errors import JobError
from maskfab.cli.common.options import Json, Quiet
from maskfab.cli.common.printing import one_line, print_json
from maskfab.cli.common.watch import watched


def study(
    jobs: Annotated[list[Path], typer.Argument(metavar="JOB...", help="Job files (.toml) with [study].")],
    out: Annotated[
        Path,
        typer.Option("--out", "-o", help="Directory for page, numbers and figures; of several jobs, one in it each."),
    ],
    images: Annotated[Path | None, typer.Option(help="Folder of photographs, beside the study's drawn scenes.")] = None,
    white: Annotated[float | None, typer.Option(help="Light that is white in EXR and HDR photographs.")] = None,
    checkpoint: Annotated[
        list[Path] | None,
        typer.Option(help="File of maskfab learn, of a die (repeatable): one more restorer, learned."),
    ] = None,
    force: Annotated[bool, typer.Option("--force", help="Replace an earlier result.")] = False,
    as_json: Json = False,
    quiet: Quiet = False,
) -> None:
    """Make figures of a job's dies, with tables and intervals, and tell which claims agree with the numbers."""
    from maskfab.api.verbs.studying import Study, plan
    from maskfab.base.folders import check_target
    from maskfab.report.rows.study import made

    plans = {}
    for job in jobs:
        place = out / job.stem if len(jobs) > 1 else out
        if place in plans:
            problem = f"two of the jobs are called {job.stem}, and would be written to {place}"
            raise JobError("MF105", problem, where="JOB", cure="Make them one after the other, or rename one")
        plans[place] = plan(job, images=images, white=white, checkpoints=checkpoint or ())
        check_target(place, force=force)
    told = []
    for place, planned in plans.items():
        with watched(quiet) as progress:
            found = Study(made(planned, progress))
        paths = found.save(place, force=force)
        told.append({**found.to_dict(), "path": str(place)})
        if not as_json:
            for line in [*str(found).split("\n"), "", *map(str, paths)]:
                typer.echo(one_line(line))
    if as_json:
        print_json({"studies": told})
