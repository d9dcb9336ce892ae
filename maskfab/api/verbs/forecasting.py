"""Runs foreseen."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

from maskfab.api.jobs import AnyJob, job_of
from maskfab.base.checks import checked_arguments
from maskfab.runs import forecast as dry_run
from maskfab.runs.forecast import Forecast
from maskfab.runs.store import Store

if TYPE_CHECKING:
    from maskfab.api.camera import Camera


@checked_arguments
def forecast(
    job: AnyJob, camera: Camera | None = None, *, out: str | Path, force: bool = False, cache: bool = True
) -> Forecast:
    """Tell what :func:`maskfab.run` would do: stages, what of them is kept, time and memory. Nothing is written.

    Examples:
        >>> import maskfab as mf
        >>> print(mf.forecast("layouts/upc12.toml", out="build/upc12"))                # doctest: +SKIP

    Args:
        job: a plate, a loaded job, or the path of a job file.
        camera: of a plate; by default its own.
        out: output directory that the run would have.
        force: replace an earlier result there.
        cache: count what earlier runs have found as found.

    Raises:
        InputError: for bad input that the run would refuse before its work.
    """
    return dry_run.dry_run(job_of(job, camera), Path(out), force=force, cache=Store.of_user() if cache else None)
