"""``maskfab bench``: ways to a PSF side by side."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from maskfab.cli.common.dies import check_dies
from maskfab.cli.common.options import Json, Quiet
from maskfab.cli.common.printing import leave, print_json
from maskfab.cli.common.watch import watched

if TYPE_CHECKING:
    from maskfab.bench.accuracy import Workload


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
    from maskfab.bench import accuracy, accuracy_page
    from maskfab.bench.cases import CASES
    from maskfab.bench.cases import run as run_cases

    if hard:
        outcomes = []
        for line in accuracy_page.case_table(outcomes.append(o) or o for o in run_cases(CASES)):  # type: ignore[func-returns-value]
            if not as_json:
                typer.echo(line)
        if as_json:
            print_json(accuracy_page.case_document(outcomes))
        leave(all(outcome.passed for outcome in outcomes))
        return
    workload = accuracy.standard_workload() if job is None else _workload(job, die)
    if out is not None:
        from maskfab.files.staging import check_target

        check_target(out, force=False)
    with watched(quiet) as progress:
        timings = accuracy.race(workload, rounds, progress)
    bound, absent = accuracy.gemm_bound_ms(workload), accuracy.absent()
    document = accuracy_page.race_document(timings, bound, absent)
    if as_json:
        print_json(document)
    else:
        for line in accuracy_page.race_table(timings, bound, absent):
            typer.echo(line)
    if out is not None:
        for path in accuracy_page.write(out, document, accuracy_page.race_figure(timings)):
            typer.echo(path, err=as_json)


def _workload(path: Path, die: str | None) -> Workload:
    from maskfab.bench.accuracy import workload_of
    from maskfab.job import load

    job = load(path)
    panels = {each.name: each.panel for each in job.plate().dies}
    check_dies([] if die is None else [die], panels)
    return workload_of(panels[die or next(iter(panels))], job.camera)
