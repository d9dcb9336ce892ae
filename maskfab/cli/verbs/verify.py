"""``maskfab verify``: a finished directory or a package read again, or any mask file held against a job."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from maskfab.cli.common.options import Json, Quiet, Unit, unit_um
from maskfab.cli.common.printing import leave, one_line, print_json, print_table, summarise
from maskfab.cli.common.watch import watched

if TYPE_CHECKING:
    from maskfab.comparison.foreign.foreign_mask import Foreign, How
    from maskfab.model import Quantity


def verify(
    subject: Annotated[Path, typer.Argument(metavar="DIR|PACKAGE|FILE", help="The --out of a finished run, a .zip that "
                                            "maskfab package wrote, or a mask file (.gds .oas .dxf .gbr .png .tif) "
                                            "from any source.")],
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
    from maskfab.api.verbs.plates import check_applies, is_dark
    from maskfab.delivery.archive import is_package

    check_applies(
        {
            "against": against, "shop": shop, "die": die, "layer": layer, "cell": cell, "dots_per_um": dots_per_um,
            "unit_um": unit, "tone": tone, "ignore": ignore or None, "tolerance": tolerance,
        },
        subject,
        _option,
    )  # fmt: skip
    if is_package(subject):
        _package(subject, against, shop, as_json, quiet)
        return
    if against is not None:
        from maskfab.comparison.foreign.foreign_mask import How
        from maskfab.units import NM_PER_UM, parse_length_um

        wide = 0.0 if tolerance is None else NM_PER_UM * parse_length_um(tolerance, where="--tolerance")
        dark = is_dark(tone, "--tone")
        how = How(layer, cell, dots_per_um, unit_um(unit), tuple(ignore or ()), dark, wide)
        _foreign(subject, against, die, how, as_json, quiet)
        return
    from maskfab.verification import verify as verify_directory

    with watched(quiet) as progress:
        checks = verify_directory(subject, progress)
    _tell(checks, {}, as_json)


def _option(argument: str) -> str:
    """The option for an argument of the function."""
    return "--unit" if argument == "unit_um" else f"--{argument.replace('_', '-')}"


def _package(path: Path, against: Path | None, shop: str | None, as_json: bool, quiet: bool) -> None:
    from maskfab.delivery.pack import verify_package
    from maskfab.job import load
    from maskfab.mask_shops.profiles import load_shop

    profile, job = None if shop is None else load_shop(shop), None if against is None else load(against)
    with watched(quiet) as progress:
        progress("package", 0, 1)
        checks = verify_package(path, job, profile)
        progress("package", 1, 1)
    said = {"package": str(path), "against": None if against is None else str(against), "shop": shop}
    _tell(checks, said, as_json)


def _tell(checks: Sequence[Quantity], said: dict[str, Any], as_json: bool) -> None:
    """Print checks, and leave by their verdict."""
    passed = all(check.passed is not False for check in checks)
    if as_json:
        from maskfab.report.quantities import quantity_document

        rows = [quantity_document(quantity) for quantity in checks]
        print_json({"verdict": "pass" if passed else "fail", **said, "checks": rows})
    else:
        summarise(checks)
    leave(passed)


def _foreign(
    path: Path,
    against: Path,
    die: str | None,
    how: How,
    as_json: bool,
    quiet: bool,
) -> None:
    from maskfab.job import load
    from maskfab.verification import verify_file

    with watched(quiet) as progress:
        found = verify_file(path, load(against), die, how, progress)
    checks = [quantity for quantity in found.quantities if quantity.passed is not None]
    passed = all(check.passed for check in checks)
    if as_json:
        from maskfab.report.quantities import quantity_document

        print_json(
            {
                "verdict": "pass" if passed else "fail",
                "layer": found.layers.clear or None,
                "tone": "dark" if found.dark else "clear",
                "other_layers": list(found.layers.others),
                "file": str(path),
                "against": str(against),
                "die": die,
                "quantities": [quantity_document(quantity) for quantity in found.quantities],
            }
        )
    else:
        typer.echo(one_line(_read_as(found)))
        print_table(found.quantities, dies=True)
        summarise(checks)
    leave(passed)


def _read_as(found: Foreign) -> str:
    """Layer and tone with which a file was read, in one line."""
    layers = found.layers
    of_layer = f" on layer {layers.clear}" if layers.clear else ""
    beside = f"; ignored layers with shapes: {', '.join(layers.others)}" if layers.others else ""
    return f"{found.path.name}: polygons{of_layer} are {'opaque' if found.dark else 'clear'}{beside}"
