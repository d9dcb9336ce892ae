"""``maskfab restore``: photographs taken behind a die, restored."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from maskfab.camera.restorers import FILES
from maskfab.cli.common.options import Json, Quiet, named_as_options
from maskfab.cli.common.printing import one_line, print_json
from maskfab.cli.common.watch import watched


def restore(
    context: typer.Context,
    photos: Annotated[
        list[Path],
        typer.Argument(
            metavar="PHOTO...", help="RAW, linear TIFF or PNG of 16 bits, EXR; other pictures are taken for sRGB."
        ),
    ],
    out: Annotated[Path, typer.Option("--out", "-o", help="Directory for the restored pictures.")],
    job: Annotated[Path | None, typer.Option(help="Job file whose camera took them.")] = None,
    die: Annotated[
        list[str] | None, typer.Option(help="Die of the job that they were taken through; or one for each photograph.")
    ] = None,
    stands: Annotated[
        str | None,
        typer.Option(
            help="How the dies stood: drawn, turned (90 degrees), mirrored, mirrored-turned; default: the job's."
        ),
    ] = None,
    psf: Annotated[
        list[Path] | None,
        typer.Option(
            help="EXR of the PSF in place of a job: a capture of a point light (or one for each photograph), or 1 or 3 "
            "of maskfab run."
        ),
    ] = None,
    restore: Annotated[
        list[str] | None,
        typer.Option(help=f"{', '.join(FILES)} (repeatable: the best of them); default: auto, all."),
    ] = None,
    epsilon: Annotated[
        float | None, typer.Option(help="Strength of the restorer's prior; default: what each record speaks for.")
    ] = None,
    bin: Annotated[bool, typer.Option("--bin", help="Restore means over 2 x 2 pixels.")] = False,
    pixel: Annotated[
        str | None, typer.Option(help="Side of their pixels, held against the PSF's or the job's.")
    ] = None,
    black: Annotated[float | None, typer.Option(help="Counts of no light; default: the file's.")] = None,
    white: Annotated[float | None, typer.Option(help="Counts of a full pixel; default: the file's.")] = None,
    mosaic: Annotated[str | None, typer.Option(help="rggb, bggr, grbg, gbrg: mosaic of a picture in grey.")] = None,
    gain: Annotated[float | None, typer.Option(help="Electrons per count; default: noise by the photograph.")] = None,
    read_noise: Annotated[float | None, typer.Option(help="In electrons, with --gain.")] = None,
    stops: Annotated[float, typer.Option(help="Brighten the pictures by so many stops.")] = 0.0,
    chart: Annotated[
        Path | None,
        typer.Option(metavar="PATCHES.csv", help="Patches of a colour chart in the first photograph, for its colours."),
    ] = None,
    register: Annotated[
        bool, typer.Option("--register", help="Bring the further photographs of a scene onto the first.")
    ] = False,
    force: Annotated[bool, typer.Option("--force", help="Replace an earlier result.")] = False,
    as_json: Json = False,
    quiet: Quiet = False,
) -> None:
    """Restore photographs taken behind a die, by its PSF as designed or as measured: PNG and linear EXR of each."""
    from maskfab.api.verbs.restoring import restore as restore_photos
    from maskfab.base.folders import check_target

    check_target(out, force=force)
    with named_as_options(context), watched(quiet) as progress:
        found = restore_photos(
            photos,
            job=job,
            die=die or None,
            stands=stands,
            psf=psf or None,
            restore=restore or "auto",
            epsilon=epsilon,
            bin=bin,
            pixel=pixel,
            black=black,
            white=white,
            mosaic=mosaic,
            gain=gain,
            read_noise=read_noise,
            stops=stops,
            chart=chart,
            register=register,
            progress=progress,
        )
    paths = found.save(out, force=force)
    if as_json:
        print_json({**found.to_dict(), "files": [str(path) for path in paths]})
        return
    typer.echo("\n".join(map(one_line, str(found).split("\n"))))
    for path in paths:
        typer.echo(path)
