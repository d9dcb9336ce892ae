"""``maskfab verify``: a finished directory or a package read again, or any mask file held against a job."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from maskfab.cli.common.options import Json, Quiet, Unit, named_as_options, unit_um
from maskfab.cli.common.printing import leave, one_line, print_json, print_table, summarise
from maskfab.cli.common.watch import watched

if TYPE_CHECKING:
    from maskfab.api.verbs.plates import Verification


def verify(
    context: typer.Context,
    subject: Annotated[Path, typer.Argument(metavar="DIR|PACKAGE|FILE", help="The --out of a finished run, a .zip that "
                                            "maskfab package wrote, or a mask file (.gds .oas .dxf .gbr .cif .png "
                                            ".tif) from any source.")],
    against: Annotated[Path | None, typer.Option(metavar="JOB", help="Job (.toml) to compare a mask file or package "
                                                 "with; default for a package: the job in it.")] = None,
    shop: Annotated[str | None, typer.Option(help="Shop profile to re-check the package against; default: the one in "
                                             "the package.")] = None,
    die: Annotated[str | None, typer.Option(help="Compare only this die of the job.")] = None,
    layer: Annotated[str | None, typer.Option(help="Clear layer of the mask file, such as 1/0 or CLEAR.")] = None,
    cell: Annotated[str | None, typer.Option(help="Cell of a mask file; default: its only top cell.")] = None,
    dots_per_um: Annotated[float | None, typer.Option(min=1e-6, max=1e6, help="Image pixels per micrometre; default: "
                                                      "the resolution stored in the file.")] = None,
    unit: Unit = None,
    tone: Annotated[str | None, typer.Option(metavar="clear|dark", help="Tone: what the polygons draw; default: "
                                             "clear.")] = None,
    ignore: Annotated[list[str] | None, typer.Option(metavar="LAYER", help="Layer with shapes that are not part of the "
                                                     "mask (repeatable).")] = None,
    tolerance: Annotated[str | None, typer.Option(help="Ignore differences (slivers) up to this width, such as "
                                                  "'1 nm'.")] = None,
    as_json: Json = False,
    quiet: Quiet = False,
) -> None:  # fmt: skip
    """Repeat every check on a finished run or package, or compare a mask file with a job."""
    from maskfab.api.verbs import plates
    from maskfab.mask.package.archive import is_package

    stated = {
        "against": against, "shop": shop, "die": die, "layer": layer, "cell": cell, "dots_per_um": dots_per_um,
        "unit_um": unit_um(unit), "tone": tone, "ignore": ignore or None, "tolerance": tolerance,
    }  # fmt: skip
    plates.check_applies(stated, subject, _option)
    given: dict[str, Any] = {name: value for name, value in stated.items() if value is not None}
    with named_as_options(context), watched(quiet) as progress:
        found = plates.verify(subject, **given, progress=progress)
    if found.tone is not None:
        _tell_file(found, subject, against, die, as_json)
        return
    if as_json:
        names = {"package": subject, "against": against, "shop": shop} if is_package(subject) else {}
        said = {name: None if value is None else str(value) for name, value in names.items()}
        told = {"verdict": _verdict(found), "verdicts": found.verdicts.to_dict()}
        print_json({**told, **said, "checks": found.to_dict()})
    else:
        summarise(found, found.verdicts)
    leave(found.passed)


def _option(argument: str) -> str:
    """The option for an argument of the function."""
    return "--unit" if argument == "unit_um" else f"--{argument.replace('_', '-')}"


def _verdict(found: Verification) -> str:
    return "pass" if found.passed else "fail"


def _tell_file(found: Verification, path: Path, against: Path | None, die: str | None, as_json: bool) -> None:
    """Print what is known of a mask file, and leave by its verdict."""
    if as_json:
        print_json(
            {
                "verdict": _verdict(found),
                "verdicts": found.verdicts.to_dict(),
                "layer": found.layer,
                "tone": found.tone,
                "other_layers": list(found.other_layers),
                "file": str(path),
                "against": str(against),
                "die": die,
                "quantities": found.to_dict(),
                "unused": list(found.unused),
            }
        )
    else:
        from maskfab.job.reference import in_words

        typer.echo(one_line(_read_as(found, path)))
        print_table(found, dies=True)
        for line in in_words(found.unused):
            typer.echo(line)
        summarise([quantity for quantity in found if quantity.passed is not None], found.verdicts)
    leave(found.passed)


def _read_as(found: Verification, path: Path) -> str:
    """Layer and tone with which a file was read, in one line."""
    of_layer = f" on layer {found.layer}" if found.layer else ""
    beside = f"; ignored layers with shapes: {', '.join(found.other_layers)}" if found.other_layers else ""
    return f"{path.name}: polygons{of_layer} are {'opaque' if found.tone == 'dark' else 'clear'}{beside}"
