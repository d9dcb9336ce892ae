"""A plate as the lens sees it: its chrome side, or, through the glass, the mirror image of that."""

from __future__ import annotations

from collections.abc import Iterator

from klayout import db

from maskfab.job import Job
from maskfab.model import Plate, Quantity
from maskfab.plate.mirrored import mirrored


def through_glass(job: Job) -> bool:
    """Whether the plate stands with its chrome away from the lens."""
    return job.blank.glass is not None and job.blank.glass.chrome == "away"


def sees_mirrored(job: Job) -> bool:
    """Whether the lens sees the design as in a mirror: a plate that was ordered for the other side."""
    return through_glass(job) != job.spec.mirrored


def plate_as_seen(job: Job, plate: Plate) -> Plate:
    """A plate as its files draw it, seen from the lens."""
    return mirrored(plate) if through_glass(job) else plate


def layout_as_seen(job: Job, layout: db.Layout) -> db.Layout:
    """A file of the plate that was read, seen from the lens."""
    if not through_glass(job):
        return layout
    seen = layout.dup()
    seen.transform(db.Trans.M90)
    return seen


def view_rows(job: Job) -> Iterator[Quantity]:
    """From where the optics are seen, of a job that says anything of it."""
    if job.blank.glass is None and not job.spec.mirrored:
        return
    side = "through the glass" if through_glass(job) else "the chrome side"
    reads = "mirrored" if sees_mirrored(job) else "as drawn"
    method = "PSFs and photographs are of the plate as the lens sees it, by plate.glass.chrome and [order]"
    if job.blank.glass is None:
        method += "; assumed, for the job states no glass: the chrome is towards the lens"
    yield Quantity("lens_view", f"{side}; the design reads {reads}", method)
