"""``maskfab shops``: the mask shops with published rules."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from maskfab.cli.common.options import Json, Quiet
from maskfab.cli.common.printing import leave, one_line, print_found, print_json
from maskfab.cli.common.shop_verdict import tell_age
from maskfab.cli.common.watch import watched

if TYPE_CHECKING:
    from maskfab.job.shop import Shop


_SECTIONS = ("accepts", "limits", "plate", "names", "blocks", "text", "polygons", "tolerance", "offers", "order")


def shops(
    name: Annotated[
        str | None,
        typer.Argument(metavar="[NAME]", help="A shop, or the path of a profile (.toml); default: all shops."),
    ] = None,
    compare: Annotated[
        Path | None,
        typer.Option(metavar="JOB", help="Show which shops take the plate of this job, and why others do not."),
    ] = None,
    as_json: Json = False,
    quiet: Quiet = False,
) -> None:
    """List the mask shops with published rules, show the rules of one with their sources, or compare them on a job."""
    from maskfab.api.verbs.shops import shops as known

    if compare is not None:
        with watched(quiet) as progress:
            found = known(name, compare=compare, progress=progress)
        print_found(found, as_json)
        leave(found.passed)
        return
    if name is not None:
        shop = known(name)
        if as_json:
            print_json(_document(shop))
        else:
            _show(shop)
            tell_age(shop)
        return
    every = known()
    for shop in every if not as_json else ():
        tell_age(shop)
    if as_json:
        print_json({"shops": [_document(shop) for shop in every]})
        return
    rows = [("shop", "formats", "min feature", "house")]
    for shop in every:
        least = shop.limits.min_feature_um
        formats = "not published" if shop.accepts.formats is None else " ".join(shop.accepts.formats)
        rows.append((shop.name, formats, "-" if least is None else f"{least:g} um", shop.title))
    widths = [max(len(row[k]) for row in rows) for k in range(4)]
    for row in rows:
        typer.echo(one_line("  ".join(cell.ljust(width) for cell, width in zip(row, widths, strict=True)).rstrip()))


def _document(shop: Shop) -> dict[str, Any]:
    """Everything that a profile says; null is what its house does not publish."""
    document: dict[str, Any] = shop.model_dump(mode="json")
    # JSON has no infinity: a tolerance without an upper width holds for all others.
    document["tolerance"]["cd_um"] = [
        [None if width == float("inf") else width, deviation] for width, deviation in shop.tolerance.cd_um
    ]
    return document


def _show(shop: Shop) -> None:
    typer.echo(one_line(f"{shop.name}: {shop.title}"))
    said = shop.model_dump(mode="python", exclude_none=True)
    for section in _SECTIONS:
        for key, value in said[section].items():
            if value not in ((), {}):
                typer.echo(one_line(f"  {section}.{key} = {_told(value)}"))
    for source in shop.sources:
        typer.echo(one_line(f"  source {source}"))
    if shop.read_on is not None:
        typer.echo(f"  read on {shop.read_on}")
    for key in shop.third_party:
        typer.echo(one_line(f"  not from a page of the house: {key}"))


def _told(value: object) -> str:
    if isinstance(value, tuple):
        return ", ".join(_told(each) for each in value)
    if isinstance(value, dict):
        return ", ".join(f"{key}: {_told(each)}" for key, each in value.items())
    return (
        "yes" if value is True else "no" if value is False else f"{value:g}" if isinstance(value, float) else str(value)
    )
