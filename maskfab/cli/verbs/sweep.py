"""``maskfab sweep``: numbers of a job for many values of its keys."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from maskfab.cli.common.options import Json, Quiet
from maskfab.cli.common.printing import one_line, print_json
from maskfab.cli.common.watch import watched


def sweep(
    study: Annotated[Path, typer.Argument(metavar="STUDY", help="A study file (.toml): job, fields, quantities.")],
    out: Annotated[
        Path, typer.Option("--out", "-o", help="Directory of cases, table and page; cases in it are not found again.")
    ],
    engine: Annotated[
        str, typer.Option(metavar="processes|serial|dask", help="Who finds the cases; the table is the same.")
    ] = "processes",
    scheduler: Annotated[
        str | None, typer.Option(help="Address of a Dask scheduler, such as tcp://127.0.0.1:8786.")
    ] = None,
    workers: Annotated[
        int | None, typer.Option(min=1, max=1024, help="Processes; default: as many as there are processors.")
    ] = None,
    as_json: Json = False,
    quiet: Quiet = False,
) -> None:
    """Find numbers of a job for many values of its keys: curves, sensitivities, yield, and a table of all cases."""
    from maskfab.api.verbs.job_sweeps import sweep as make

    with watched(quiet) as progress:
        found = make(study, out, engine=engine, scheduler=scheduler, workers=workers, progress=progress)  # type: ignore[arg-type]
    if as_json:
        print_json({**found.to_dict(), "path": str(out)})
    else:
        for line in [*str(found).split("\n"), str(out / "sweep.html")]:
            typer.echo(one_line(line))
    if not found.passed:
        raise typer.Exit(1)
