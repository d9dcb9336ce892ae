"""``maskfab bench``: ways to a PSF side by side."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from maskfab.cli.common.options import Json, Quiet
from maskfab.cli.common.printing import leave, print_json
from maskfab.cli.common.watch import watched


def bench(
    job: Annotated[
        Path | None, typer.Argument(metavar="[JOB]", help="A job file (.toml); default: a standard panel.")
    ] = None,
    die: Annotated[str | None, typer.Option(help="Die of the job; default: the first.")] = None,
    hard: Annotated[bool, typer.Option("--hard", help="Run the hard cases instead.")] = False,
    rounds: Annotated[int, typer.Option(min=2, max=1000, help="Number of timed rounds.")] = 9,
    out: Annotated[Path | None, typer.Option(help="Directory for the figure and the results.")] = None,
    as_json: Json = False,
    quiet: Quiet = False,
) -> None:
    """Time every PSF method and compare each with the exact one, or run the hard cases."""
    from maskfab.api.verbs.benchmarking import bench as race
    from maskfab.optics import benchmark as accuracy_page
    from maskfab.optics.hard_cases import CASES, run_cases

    if hard:
        outcomes = []
        for line in accuracy_page.case_table(outcomes.append(o) or o for o in run_cases(CASES)):  # type: ignore[func-returns-value]
            if not as_json:
                typer.echo(line)
        if as_json:
            print_json(accuracy_page.case_document(outcomes))
        leave(all(outcome.passed for outcome in outcomes))
        return
    if out is not None:
        from maskfab.base.folders import check_target

        check_target(out, force=False)
    with watched(quiet) as progress:
        found = race(job, die=die, rounds=rounds, progress=progress)
    if as_json:
        print_json(found.to_dict())
    else:
        typer.echo(found)
    for path in [] if out is None else found.save(out):
        typer.echo(path, err=as_json)
