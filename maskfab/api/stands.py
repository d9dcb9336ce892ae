"""Stand of a job's dies before the camera."""

from __future__ import annotations

from maskfab.camera.blur import STANDS, stand_named
from maskfab.mask.job import Job
from maskfab.report.rows.optics import sees_mirrored


def way_round(asked: str | None, job: Job) -> int:
    """The element of D4 that takes a die as drawn to how the picture shows it.

    Args:
        asked: one of :data:`maskfab.camera.blur.STANDS`; None for what the job says, mirrored if the plate's
            chrome is away from the lens.
        job: of the plate.

    Raises:
        JobError: MF105 for a name that none has.
    """
    if asked is None:
        return STANDS["mirrored" if sees_mirrored(job) else "drawn"]
    return stand_named(asked)
