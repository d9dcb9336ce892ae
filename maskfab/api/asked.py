"""Statements of callers, as the chain takes them: jobs and their dies, folders of photographs, stands."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, TypeAlias

from maskfab.base.errors import JobError
from maskfab.mask.job import Job, load_job

if TYPE_CHECKING:
    from maskfab.api.camera import Camera
    from maskfab.api.panel import Panel
    from maskfab.api.plate import Plate
    from maskfab.camera.scenes import Folder


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
        what = "the job has a camera of its own"
        raise JobError("MF105", what, where="camera", cure="Give no camera, or change the one in the job")
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


def given_folder(images: str | Path | None, white: float | None, *, whole: bool = False) -> Folder | None:
    """The photographs of a folder; None where none is named, and scenes are drawn.

    Args:
        images: the folder.
        white: light that is white in photographs that hold light, EXR and HDR; None where nobody states it.
        whole: take whole photographs rather than their middle.

    Raises:
        JobError: MF105 for a white that nothing is measured by, or whole photographs of none; as
            :func:`maskfab.camera.scenes.folder`.
        SourceError: MF301 without photographs in it.
    """
    if images is not None:
        # Photographs bring along what reads pictures.
        from maskfab.camera.scenes import folder

        return folder(Path(images), white, whole=whole)
    if white is not None:
        what = f"light of {white:g} is stated as white, and the drawn scenes have a white of their own"
        cure = "Add images, a folder of EXR or HDR photographs, or remove white"
        raise JobError("MF105", what, where="white", cure=cure)
    if whole:
        what = "whole photographs are asked for, and scenes are drawn"
        raise JobError("MF105", what, where="whole", cure="Add images, a folder of photographs, or remove whole")
    return None


def way_round(asked: str | None, job: Job) -> int:
    """The element of D4 that takes a die as drawn to how the picture shows it.

    Args:
        asked: one of :data:`maskfab.camera.blur.STANDS`; None for what the job says, mirrored if the plate's
            chrome is away from the lens.
        job: of the plate.

    Raises:
        JobError: MF105 for a name that none has.
    """
    from maskfab.camera.blur import STANDS, stand_named
    from maskfab.report.rows.optics import sees_mirrored

    if asked is None:
        return STANDS["mirrored" if sees_mirrored(job) else "drawn"]
    return stand_named(asked)


def require_form(form: str, stated: Mapping[str, object], *, of: bool) -> None:
    """Refuse what is stated of another form of a verb.

    Args:
        form: name of the argument that asks for the form.
        stated: arguments that go with it alone, each None or False where it is left out.
        of: whether the form is asked for.

    Raises:
        JobError: MF105 for the first.
    """
    for name, value in stated.items():
        if not of and value is not None and value is not False:
            raise JobError("MF105", f"{name} goes with {form}", where=name, cure=f"Add {form}, or leave {name} out")
