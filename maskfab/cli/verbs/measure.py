"""``maskfab measure``: which die a camera saw, how it stands, and how it was written."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from maskfab.cli.common.options import Json, Quiet, named_as_options
from maskfab.cli.common.printing import one_line, print_json
from maskfab.cli.common.watch import watched


def measure(
    context: typer.Context,
    captures: Annotated[
        list[Path], typer.Argument(metavar="FILE...", help="Exposures of a point light: RAW, 16-bit TIFF or PNG, EXR.")
    ],
    job: Annotated[Path, typer.Option(help="Job file (.toml) of the plate, with the camera.")],
    die: Annotated[list[str] | None, typer.Option(help="Die that it may be (repeatable); default: all.")] = None,
    times: Annotated[
        list[str] | None,
        typer.Option(help="Exposure, such as '4 ms' (repeatable, in the order of the files); default: the files' own."),
    ] = None,
    gain: Annotated[float | None, typer.Option(help="Electrons for each count; default: told from --pair.")] = None,
    read_noise: Annotated[float | None, typer.Option(help="Electrons; default: told from --pair.")] = None,
    pair: Annotated[
        list[Path] | None, typer.Option(help="Frame of two or more equal ones with light (repeatable), for the gain.")
    ] = None,
    dark: Annotated[list[Path] | None, typer.Option(help="Frame without light (repeatable).")] = None,
    flat: Annotated[list[Path] | None, typer.Option(help="Frame of even light (repeatable).")] = None,
    window: Annotated[int, typer.Option(help="Pixels along a side of what is looked at.")] = 150,
    line: Annotated[
        str | None, typer.Option(help="Wavelength of a light of one line, such as '530 nm'; default: the job's light.")
    ] = None,
    black: Annotated[float | None, typer.Option(help="Counts of no light; default: the files' own.")] = None,
    white: Annotated[float | None, typer.Option(help="Counts of a full pixel; default: the files' own.")] = None,
    mosaic: Annotated[
        str | None, typer.Option(help="Mosaic of grey pictures that hold one: rggb, bggr, grbg or gbrg.")
    ] = None,
    out: Annotated[
        Path | None, typer.Option("--out", "-o", help="Directory for page, numbers and the merged capture.")
    ] = None,
    force: Annotated[bool, typer.Option("--force", help="Replace an earlier result.")] = False,
    as_json: Json = False,
    quiet: Quiet = False,
) -> None:
    """Tell from exposures of a point light which die it shone through, which way round, and how wide it was written."""
    from maskfab.api.verbs.measuring import measure as measure_captures
    from maskfab.files.staging import check_target

    if out is not None:
        check_target(out, force=force)
    with named_as_options(context), watched(quiet) as progress:
        found = measure_captures(
            captures,
            job,
            die=die,
            times=times,
            gain=gain,
            read_noise=read_noise,
            pair=pair or (),
            dark=dark or (),
            flat=flat or (),
            window=window,
            line=line,
            black=black,
            white=white,
            mosaic=mosaic,
            progress=progress,
        )
    paths = [] if out is None else found.save(out, force=force)
    if as_json:
        print_json({**found.to_dict(), **({} if out is None else {"path": str(out)})})
        return
    for text in [*str(found).split("\n"), *map(str, paths)]:
        typer.echo(one_line(text))
