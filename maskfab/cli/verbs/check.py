"""``maskfab check``: feasibility of the displays of a job, or the verdict of a mask shop."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Annotated

import typer

from maskfab.cli.common.options import JobFile, Json, Quiet
from maskfab.cli.common.printing import leave, print_json
from maskfab.cli.common.watch import watched


def check(
    job: JobFile,
    die: Annotated[list[str] | None, typer.Option(help="Die of the job (repeatable); default: all.")] = None,
    largest: Annotated[
        bool, typer.Option("--largest", help="Search for the largest emitters, even if smaller ones suffice.")
    ] = False,
    shop: Annotated[str | None, typer.Option(help="Check against this mask shop's rules instead.")] = None,
    format_: Annotated[
        list[str] | None,
        typer.Option("--format", help="With --shop: output format (repeatable); default: the shop's first."),
    ] = None,
    widest: Annotated[
        bool, typer.Option("--largest-gap", help="Also find the widest possible gap between colours.")
    ] = False,
    as_json: Json = False,
    quiet: Quiet = False,
) -> None:
    """Check whether emitters, circuits and wires fit in the opaque area around the openings; prove it where not."""
    from maskfab.api.displays import check as check_job

    if shop is not None:
        _check_shop(job, shop, format_ or (), as_json=as_json, quiet=quiet)
        return
    with watched(quiet) as progress:
        found = check_job(job, die=die, largest=largest, largest_gap=widest, progress=progress)
    if as_json:
        print_json(found.to_dict())
    else:
        typer.echo(found)
    leave(found.passed)


def _check_shop(job: Path, shop: str, formats: Sequence[str], *, as_json: bool, quiet: bool) -> None:
    """Check the plate against the rules of a mask shop, with a cure for each violation; writes nothing."""
    from maskfab.api.displays import check as check_job
    from maskfab.cli.common.shop_verdict import print_findings

    with watched(quiet) as progress:
        found = check_job(job, shop=shop, formats=formats, progress=progress)
    if as_json:
        print_json(found.to_dict())
    else:
        print_findings(found.findings, found.shop.name, passed=found.passed)
    leave(found.passed)
