"""``maskfab render``: pictures on the panels, as the eye sees them."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from maskfab.cli.common.options import JobFile, Json, Quiet
from maskfab.cli.common.printing import print_json
from maskfab.cli.common.watch import watched


def render(
    job: JobFile,
    image: Annotated[Path | None, typer.Argument(metavar="[IMAGE]", help="A photograph to show as well.")] = None,
    die: Annotated[
        list[str] | None, typer.Option(help="Die of the job (repeatable); default: all with emitters.")
    ] = None,
    dpi: Annotated[float | None, typer.Option(help="Scale the panels to this DPI; default: their own.")] = None,
    distance: Annotated[str, typer.Option(help="Viewing distance.")] = "300 mm",
    pixels: Annotated[
        int | None, typer.Option(help="Display pixels along a side; default: 100, or as many as the panel has.")
    ] = None,
    samples: Annotated[int, typer.Option(help="Samples along the side of a display pixel.")] = 21,
    with_jod: Annotated[bool, typer.Option("--jod", help="Also score with ColorVideoVDP; needs maskfab[eye].")] = False,
    out: Annotated[Path | None, typer.Option(help="Directory for the pictures and the results.")] = None,
    as_json: Json = False,
    quiet: Quiet = False,
) -> None:
    """Render pictures on the panels as the eye sees them, with S-CIELAB difference, grain and colour fringes."""
    from maskfab.api.verbs.displays import render as render_job

    if out is not None:
        from maskfab.base.folders import check_target

        check_target(out, force=False)
    with watched(quiet) as progress:
        found = render_job(
            job,
            image,
            die=die,
            dpi=dpi,
            distance=distance,
            pixels=pixels,
            samples=samples,
            with_jod=with_jod,
            progress=progress,
        )
        paths = [] if out is None else found.save(out, progress)
    if as_json:
        print_json(found.to_dict())
        return
    typer.echo(found)
    for path in paths:
        typer.echo(path)
