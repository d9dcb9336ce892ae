"""``maskfab run``: a plate from a job."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict
from pathlib import Path
from typing import Annotated

import typer

from maskfab.cli.common.options import JobFile, Json, Quiet
from maskfab.cli.common.printing import leave, print_json, summarise
from maskfab.cli.common.watch import watched


def run(
    job: JobFile,
    out: Annotated[Path, typer.Option(help="Output directory; written only once all files are complete.")],
    force: Annotated[bool, typer.Option("--force", help="Replace an earlier result in --out.")] = False,
    no_cache: Annotated[
        bool, typer.Option("--no-cache", help="Find everything anew, and keep nothing; see maskfab cache.")
    ] = False,
    dry_run: Annotated[
        bool, typer.Option("--dry-run", help="Tell stages, what of them is kept, time and memory; write nothing.")
    ] = False,
    as_json: Json = False,
    quiet: Quiet = False,
) -> None:
    """Make a plate: write the mask files, read them back, measure them, check them against [export] shop, report."""
    if dry_run:
        _foresee(job, out, force=force, cache=not no_cache, as_json=as_json)
        return
    from maskfab.mask.job import load_job
    from maskfab.optics.metrics import fast_lens
    from maskfab.runs.pipeline import run as run_job
    from maskfab.runs.store import Store

    with watched(quiet) as progress:
        loaded = load_job(job)
        result = run_job(loaded, out, force=force, progress=progress, cache=None if no_cache else Store.of_user())
    report = result.report
    if not quiet:
        _tell_times(report.seconds)
    if as_json:
        print_json(result.to_dict() | {"findings": [asdict(each) for each in result.accounts]})
    else:
        for path in sorted(result.directory.iterdir()):
            typer.echo(path)
        summarise([*fast_lens(loaded.camera), *result.notes, *report.checks], result.verdicts)
    if result.taken is not None and not quiet:
        typer.echo(result.origin, err=True)
    leave(report.passed)


def _foresee(job: Path, out: Path, *, force: bool, cache: bool, as_json: bool) -> None:
    from maskfab.api.verbs.forecasting import forecast

    found = forecast(job, out=out, force=force, cache=cache)
    if as_json:
        print_json(found.to_dict())
    else:
        typer.echo(found)


def _tell_times(seconds: Mapping[str, float]) -> None:
    """Print the time that the optics of every die took."""
    for stage, took in seconds.items():
        kind, _, die = stage.partition(" ")
        if kind == "optics" and die:
            scene = seconds.get(f"scene {die}")
            more = "" if scene is None else f", scene {scene:.2f} s"
            typer.echo(f"{die}: optics {took:.2f} s{more}", err=True)
