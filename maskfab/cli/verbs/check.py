"""``maskfab check``: feasibility of the displays of a job, or the verdict of a mask shop."""

from __future__ import annotations

from typing import Annotated

import typer

from maskfab.cli.common.options import JobFile, Json, Quiet, named_as_options
from maskfab.cli.common.printing import leave, print_json
from maskfab.cli.common.watch import watched


def check(
    context: typer.Context,
    job: JobFile,
    die: Annotated[list[str] | None, typer.Option(help="Die of the job (repeatable); default: all.")] = None,
    shop: Annotated[str | None, typer.Option(help="Check against this mask shop's rules instead.")] = None,
    formats: Annotated[
        list[str] | None,
        typer.Option("--format", help="With --shop: output format (repeatable); default: the shop's first."),
    ] = None,
    largest_gap: Annotated[
        bool, typer.Option("--largest-gap", help="Also find the widest possible gap between colours.")
    ] = False,
    as_json: Json = False,
    quiet: Quiet = False,
) -> None:
    """Check whether emitters, circuits and wires fit in the opaque area around the openings; prove it where not."""
    from maskfab.api.verbs.displays import check as check_job
    from maskfab.cli.common.shop_verdict import print_findings
    from maskfab.job.reference import in_words

    with named_as_options(context), watched(quiet) as progress:
        found = check_job(  # type: ignore[call-overload]
            job, die=die, largest_gap=largest_gap, shop=shop, formats=formats or (), progress=progress
        )
    if as_json:
        print_json(found.to_dict())
    elif shop is not None:
        print_findings(found.findings, found.shop.name, found.mail)
        for line in in_words(found.unused):
            typer.echo(line)
    else:
        typer.echo(found)
    leave(found.passed)
