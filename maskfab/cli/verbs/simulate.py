"""``maskfab simulate``: quality of restored photographs behind the dies of a job."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from maskfab.cli.common.options import JobFile, Json, Quiet
from maskfab.cli.common.printing import print_json
from maskfab.cli.common.watch import watched


def simulate(
    job: JobFile,
    die: Annotated[
        list[str] | None, typer.Option(help="Die of the job (repeatable); default: all that can be judged.")
    ] = None,
    reference: Annotated[str | None, typer.Option(help="Die to compare with; default: the first.")] = None,
    images: Annotated[Path | None, typer.Option(help="Folder of photographs; default: synthetic scenes.")] = None,
    protocol: Annotated[
        str | None, typer.Option(help="f1: use that protocol's camera; default: the job's. Light levels are F1's.")
    ] = None,
    picture: Annotated[
        Path | None, typer.Option(help="Write a PNG of the truth and each die, one row per light level.")
    ] = None,
    force: Annotated[bool, typer.Option("--force", help="Replace an existing picture.")] = False,
    as_json: Json = False,
    quiet: Quiet = False,
) -> None:
    """Simulate noisy photographs through each die, restore and score them: PSNR, SSIM, gain over a reference."""
    from maskfab.api.verbs.photographs import simulate as simulate_job
    from maskfab.files.staging import check_file, write_bytes

    if picture is not None:
        check_file(picture, force=force)
    with watched(quiet) as progress:
        found = simulate_job(
            job,
            die=die,
            reference=reference,
            images=images,
            protocol=protocol,  # type: ignore[arg-type]
            pictures=picture is not None,
            progress=progress,
        )
    if picture is not None:
        write_bytes(picture, found.picture(), replace=force)
    if as_json:
        print_json(found.to_dict())
    else:
        typer.echo(found)
