"""``maskfab learn``: a restorer trained on photographs through one die of a job."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from maskfab.cli.common.options import JobFile, Json, Quiet, named_as_options
from maskfab.cli.common.printing import print_json
from maskfab.cli.common.watch import watched


def learn(
    context: typer.Context,
    job: JobFile,
    out: Annotated[Path, typer.Option("--out", "-o", help="File of the checkpoint; goes on from it if it exists.")],
    die: Annotated[str | None, typer.Option(help="Die of the job; default: its only one.")] = None,
    images: Annotated[
        Path | None, typer.Option(help="Folder of photographs to learn from, besides drawn scenes.")
    ] = None,
    white: Annotated[float | None, typer.Option(help="Light that is white in EXR and HDR photographs.")] = None,
    level: Annotated[
        list[float] | None,
        typer.Option(help="Signal-to-noise ratio of white in dB (repeatable); default: the job's, or 24, 32 and 40."),
    ] = None,
    minutes: Annotated[float, typer.Option(help="Time to train, on all cores.")] = 15.0,
    seed: Annotated[int, typer.Option(help="Of weights, scenes and noise.")] = 0,
    device: Annotated[str, typer.Option(help="cpu, cuda, or auto: CUDA where there is any.")] = "auto",
    force: Annotated[bool, typer.Option("--force", help="Train anew, and replace an existing file.")] = False,
    as_json: Json = False,
    quiet: Quiet = False,
) -> None:
    """Train a network that restores photographs through one die; simulate --checkpoint uses it."""
    from maskfab.api.verbs.learning import learn as learn_job

    with named_as_options(context), watched(quiet) as progress:
        found = learn_job(
            job,
            out=out,
            die=die,
            images=images,
            white=white,
            levels=level,
            minutes=minutes,
            seed=seed,
            device=device,
            force=force,
            progress=progress,
        )
    if as_json:
        print_json(found.to_dict())
    else:
        typer.echo(found)
