"""``maskfab pareto``: designs for a display that none betters in photographs, emitters, wires and grain."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from maskfab.cli.common.options import Budget, JobFile, Json, Quiet
from maskfab.cli.common.printing import print_json
from maskfab.cli.common.watch import watched


def pareto(
    job: JobFile,
    out: Annotated[Path, typer.Option(help="Directory for the page, the designs with their jobs, and the figure.")],
    images: Annotated[
        Path | None, typer.Option(help="Folder of photographs to score with; default: synthetic scenes.")
    ] = None,
    budget: Budget = None,
    force: Annotated[bool, typer.Option("--force", help="Replace an earlier result.")] = False,
    as_json: Json = False,
    quiet: Quiet = False,
) -> None:
    """Find the designs for the job's display that none betters in restored PSNR, emitters, wires and grain."""
    from maskfab.api.verbs.sweeping import pareto as sweep
    from maskfab.base.folders import check_target

    command = f"maskfab pareto {job.as_posix()} --out {out.as_posix()}"
    command += "" if images is None else f" --images {images.as_posix()}"
    command += "" if budget is None else f" --budget '{budget}'"
    check_target(out, force=force)
    with watched(quiet) as progress:
        found = sweep(job, images=images, budget=budget, command=command, progress=progress)
        progress("files", 0, 1)
        paths = found.save(out, force=force)
        progress("files", 1, 1)
    if as_json:
        print_json({**found.to_dict(), "path": str(out)})
        return
    typer.echo(found)
    for path in paths:
        typer.echo(path)
