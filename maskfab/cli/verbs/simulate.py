"""``maskfab simulate``: quality of restored photographs behind the dies of a job."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from maskfab.camera.restorers import FILES
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
    white: Annotated[float | None, typer.Option(help="Light that is white in EXR and HDR photographs.")] = None,
    whole: Annotated[bool, typer.Option("--whole", help="Photograph whole pictures, not their middle.")] = False,
    protocol: Annotated[
        str, typer.Option(help="camera: the job's camera, sensor, exposure and light; f1, paper: those protocols' own.")
    ] = "camera",
    light: Annotated[
        str | None, typer.Option(help="linear light, or code values taken for light; default: the protocol's own.")
    ] = None,
    level: Annotated[
        list[float] | None,
        typer.Option(help="Signal-to-noise ratio of white in dB (repeatable); default: the job's, or 24, 32 and 40."),
    ] = None,
    bracket: Annotated[
        list[float] | None,
        typer.Option(
            help="Times less light of an exposure (repeatable: 1, 4, 16), merged for highlights of EXR and HDR."
        ),
    ] = None,
    restore: Annotated[
        list[str] | None,
        typer.Option(help=f"{', '.join(FILES)} (repeatable); auto: the one each record speaks for."),
    ] = None,
    checkpoint: Annotated[
        list[Path] | None,
        typer.Option(help="File of maskfab learn, one for each die (repeatable): one more restorer, learned."),
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
    from maskfab.base.folders import check_file, write_bytes

    if picture is not None:
        check_file(picture, force=force)
    with watched(quiet) as progress:
        found = simulate_job(
            job,
            die=die,
            reference=reference,
            images=images,
            white=white,
            whole=whole,
            protocol=protocol,  # type: ignore[arg-type]
            light=light,  # type: ignore[arg-type]
            levels=level,
            brackets=bracket,
            restore=restore,
            checkpoints=checkpoint or (),
            pictures=picture is not None,
            progress=progress,
        )
    if picture is not None:
        write_bytes(picture, found.picture(), replace=force)
    if as_json:
        print_json(found.to_dict())
    else:
        typer.echo(found)
