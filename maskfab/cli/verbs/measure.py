"""``maskfab measure``: a die as a camera saw it, by a point light or across a slanted edge."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from maskfab.base.errors import JobError
from maskfab.cli.common.options import Json, Quiet, named_as_options
from maskfab.cli.common.printing import one_line, print_json
from maskfab.cli.common.watch import watched

if TYPE_CHECKING:
    from maskfab.api.verbs.measuring import Measurement
    from maskfab.api.verbs.measuring_edges import EdgeMeasurement


_LEVELS = ("black", "white", "mosaic")
_TAKES = {
    "FILE": (
        "captures",
        "job",
        "die",
        "times",
        "gain",
        "read_noise",
        "pair",
        "dark",
        "flat",
        "window",
        "line",
        *_LEVELS,
    ),
    "--edge": ("edge", "job", "die", "stands", "pixel", "region", "window", "line", *_LEVELS),
    "--mtf": ("mtf", "job", "die", "stands", "angle", "line"),
}
"""Parameters that each form of the command takes, beside those of every command that writes."""
_OUTPUT = ("out", "force", "as_json", "quiet")
_POINT_WINDOW = 150


def measure(
    context: typer.Context,
    captures: Annotated[
        list[Path] | None,
        typer.Argument(metavar="[FILE...]", help="Exposures of a point light: RAW, 16-bit TIFF or PNG, EXR."),
    ] = None,
    edge: Annotated[
        Path | None, typer.Option(metavar="FILE", help="Picture of slanted edges instead, of any of those kinds.")
    ] = None,
    mtf: Annotated[
        Path | None, typer.Option(metavar="CURVE.csv", help="MTF that was measured elsewhere instead.")
    ] = None,
    job: Annotated[Path | None, typer.Option(help="Job file (.toml) of the plate, with the camera.")] = None,
    die: Annotated[
        list[str] | None,
        typer.Option(help="Die that it may be (repeatable; default: all); of --edge and --mtf the one that it is."),
    ] = None,
    stands: Annotated[
        str | None,
        typer.Option(
            help="Of --edge and --mtf: how the die stood: drawn, turned (90 degrees), mirrored, mirrored-turned; "
            "default: the job's."
        ),
    ] = None,
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
    window: Annotated[
        int | None,
        typer.Option(
            help=f"Pixels along a side of what is looked at, {_POINT_WINDOW} by default; "
            "of --edge pixels across it, by default as far as its blur reaches."
        ),
    ] = None,
    line: Annotated[
        str | None, typer.Option(help="Wavelength of a light of one line, such as '530 nm'; default: the job's light.")
    ] = None,
    black: Annotated[float | None, typer.Option(help="Counts of no light; default: the files' own.")] = None,
    white: Annotated[float | None, typer.Option(help="Counts of a full pixel; default: the files' own.")] = None,
    mosaic: Annotated[
        str | None, typer.Option(help="Mosaic of grey pictures that hold one: rggb, bggr, grbg or gbrg.")
    ] = None,
    pixel: Annotated[
        str | None, typer.Option(help="Of --edge without --job: side of the sensor's pixel, such as '2 um'.")
    ] = None,
    region: Annotated[
        str | None,
        typer.Option(
            metavar="ROW,COLUMN,ROW,COLUMN",
            help="Of --edge: box of pixels to look in, its last row and column not in it.",
        ),
    ] = None,
    angle: Annotated[
        float, typer.Option(help="Of --mtf: direction of its waves in degrees, 0 horizontal, 90 vertical.")
    ] = 0.0,
    out: Annotated[
        Path | None, typer.Option("--out", "-o", help="Directory for page, numbers and a merged capture.")
    ] = None,
    force: Annotated[bool, typer.Option("--force", help="Replace an earlier result.")] = False,
    as_json: Json = False,
    quiet: Quiet = False,
) -> None:
    """Tell what a camera saw of a die, and whether that is what was designed.

    Exposures of a point light tell which die it shone through, which way round, and how wide it was written. A picture
    of slanted edges tells the MTF.
    """
    from maskfab.base.folders import check_target

    _refuse_unused(context)
    if out is not None:
        check_target(out, force=force)
    found: Measurement | EdgeMeasurement
    with named_as_options(context), watched(quiet) as progress:
        if edge is not None:
            from maskfab.api.verbs.measuring_edges import measure_edge

            found = measure_edge(
                edge,
                job,
                die=_only(die),
                stands=stands,
                pixel=pixel,
                region=region,
                window=window,
                line=line,
                black=black,
                white=white,
                mosaic=mosaic,
            )
        elif mtf is not None:
            from maskfab.api.verbs.measuring_edges import measure_mtf

            name = _only(die)
            if job is None or name is None:
                raise _missing("--die" if job is not None else "--job", "--mtf is held against the die of a job")
            found = measure_mtf(mtf, job, die=name, stands=stands, angle=angle, line=line)
        else:
            from maskfab.api.verbs.measuring import measure as measure_captures

            if not captures:
                raise _missing("FILE", "there is nothing to measure", "Give captures of a point light, --edge or --mtf")
            if job is None:
                raise _missing("--job", "nothing states the dies that these captures may show")
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
                window=_POINT_WINDOW if window is None else window,
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


def _refuse_unused(context: typer.Context) -> None:
    """Refuse two forms at once, and options that the form which was asked for has no use for.

    Raises:
        JobError: MF105.
    """
    stated = {each.name: each for each in context.command.params if _is_stated(context, each.name)}
    forms = [name for name, takes in _TAKES.items() if takes[0] in stated]
    if len(forms) > 1:
        raise JobError(
            "MF105",
            f"{' and '.join(forms)} do not go together",
            where=forms[-1],
            cure="Measure a point light, an edge and a curve each by a command of its own",
        )
    form = forms[0] if forms else "FILE"
    for name, option in stated.items():
        if name not in (*_TAKES[form], *_OUTPUT):
            others = ", ".join(each for each, takes in _TAKES.items() if name in takes)
            raise JobError(
                "MF105",
                f"{option.opts[0]} has no use beside {form}",
                where=option.opts[0],
                cure=f"Leave {option.opts[0]} out; it goes with {others}",
            )


def _is_stated(context: typer.Context, name: str | None) -> bool:
    source = None if name is None else context.get_parameter_source(name)
    return source is not None and source.name == "COMMANDLINE" and context.params.get(name or "") not in (None, [])


def _only(die: list[str] | None) -> str | None:
    if die is not None and len(die) > 1:
        raise JobError(
            "MF105",
            f"{len(die)} dies are given, and an MTF is held against one",
            where="--die",
            cure=f"Give one of them, such as --die {die[0]}",
        )
    return die[0] if die else None


def _missing(option: str, why: str, cure: str = "") -> JobError:
    return JobError("MF105", f"{option} is missing: {why}", where=option, cure=cure or f"Add {option}")
