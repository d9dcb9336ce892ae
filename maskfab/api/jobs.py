"""Jobs of whatever states one, and their dies."""

from __future__ import annotations

from collections.abc import Collection, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, TypeAlias

from maskfab.base.errors import JobError
from maskfab.mask.job import Job, load_job

if TYPE_CHECKING:
    from maskfab.api.camera import Camera
    from maskfab.api.panel import Panel
    from maskfab.api.plate import Plate


AnyJob: TypeAlias = "Plate | Panel | Job | str | Path"
"""A plate of Python, a panel that is alone on one, a loaded job, or the path of a job file."""


def job_of(job: AnyJob, camera: Camera | None = None) -> Job:
    """The validated job of whatever states one.

    Raises:
        JobError: MF105 for a second camera beside that of a job, and for what states none; else as for the job.
    """
    if not isinstance(job, Job | str | Path):
        # Plates bring along all that lays out and draws.
        from maskfab.api.panel import Panel
        from maskfab.api.plate import Plate

        plate = Plate.of(PANEL=job) if isinstance(job, Panel) else job
        if not isinstance(plate, Plate):
            cure = "Give a Plate, a Panel, or the path of a job file"
            raise JobError("MF105", f"a {type(job).__name__} states no job", where="job", cure=cure)
        return plate.job(camera)
    if camera is not None:
        raise JobError(
            "MF105",
            "the job has a camera of its own",
            where="camera",
            cure="Give no camera, or change the one in the job",
        )
    return job if isinstance(job, Job) else load_job(job)


def dies_of(asked: str | Sequence[str] | None, names: Collection[str]) -> tuple[str, ...]:
    """The dies that are asked for, each once; all if none is.

    Raises:
        JobError: MF105 for the first that the job does not have.
    """
    wanted = (asked,) if isinstance(asked, str) else tuple(asked or names)
    for name in wanted:
        if name not in names:
            listed = ", ".join(names)
            raise JobError("MF105", f"the job has no die {name!r}", where="die", cure=f"Use one of {listed}")
    return tuple(dict.fromkeys(wanted))
