"""``maskfab design``: an opening by gradient descent."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from maskfab.cli.options import JobFile, Json, Quiet
from maskfab.cli.printing import tell_opening
from maskfab.cli.watch import watched
from maskfab.errors import JobError


def design(
    job: JobFile,
    out: Annotated[Path | None, typer.Option(help="Where the opening goes; default: design.output of the job.")] = None,
    force: Annotated[bool, typer.Option("--force", help="Replace an existing opening.")] = False,
    as_json: Json = False,
    quiet: Quiet = False,
) -> None:
    """Find an opening whose blur can be undone, by gradient descent."""
    from maskfab.design.job import find, settings
    from maskfab.export.staging import check_file, write_text
    from maskfab.layout.openings import dumps
    from maskfab.spec import read

    spec = read(job)
    wanted = settings(spec, where=str(job), command=f"maskfab design {job.as_posix()}")
    target = out or (job.parent / spec.design.output if spec.design and spec.design.output else None)
    if target is None:
        raise JobError("MF105", "the design has no output file", where=f"{job}: design.output", cure="Add it, or --out")
    check_file(target, force=force)
    with watched(quiet) as progress:
        opening = find(wanted, progress)
    write_text(target, dumps(opening))
    tell_opening(opening, target, as_json)
