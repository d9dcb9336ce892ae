"""Statements of callers, as the chain takes them: jobs and their dies, folders of photographs, stands.

One way in for all verbs: a job file, a loaded job, a plate, or what Python makes, which becomes the job of a plate.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterable, Iterator, Mapping, Sequence
from dataclasses import replace
from os import PathLike
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeAlias, TypeVar

import numpy as np
from numpy.typing import NDArray

from maskfab.base.errors import JobError
from maskfab.base.model import Opening
from maskfab.base.units import NM_PER_UM
from maskfab.job.faults import JobFaults
from maskfab.job.read import read
from maskfab.job.sections import AssumedPlate
from maskfab.mask.job import Further, Job, load_job

if TYPE_CHECKING:
    from maskfab.api.camera import Camera, HasPanel
    from maskfab.api.panel import Panel
    from maskfab.api.plate import Plate
    from maskfab.camera.frames.frame import Source
    from maskfab.camera.scenes import Folder
    from maskfab.job.sections import JobSpec


AnyPanel: TypeAlias = "Panel | Opening | HasPanel"
"""A panel; or an opening, which is laid out periodically over the camera's stop; or a design with its map."""
AnyJob: TypeAlias = "Plate | AnyPanel | Mapping[str, AnyPanel] | Sequence[AnyPanel] | Job | str | Path"
"""A plate of Python; a panel, or several by name or in a list; a loaded job, or the path of a job file."""
AnyPath: TypeAlias = str | PathLike[str]
"""A path, or a result that is one: a finished run is that of its directory."""
AnyReport: TypeAlias = "AnyPath | Plate | Job | AnyPanel"
"""A finished run, or what can be measured and photographed as designed."""
DesignJob: TypeAlias = "Job | str | Path"
"""A job with [design]: loaded, or the path of its file."""
AnyPhoto: TypeAlias = str | PathLike[str] | NDArray[Any]
"""The path of a picture, or linear light in memory: [rows, columns] or [rows, columns, 3], row 0 the top."""
_Laid = TypeVar("_Laid")
_TAKEN = "a Plate, a Panel, a list or a mapping of panels, a loaded job, or the path of a job file"


def job_of(
    job: AnyJob,
    camera: Camera | None = None,
    sections: Mapping[str, object] | None = None,
    further: Further | None = None,
) -> Job:
    """The validated job of whatever states one.

    Args:
        job: a file, a loaded job, a plate, or panels, which become a plate of dies of these names; those of a list are
            named after their openings, or P1, P2 and so on where two have one name.
        camera: that looks through plate or panels; by default the plate's, or that of protocol F1.
        further: what a verb refuses, told with the faults of a file; see :func:`maskfab.mask.job.load_job`.

    Raises:
        JobError: MF105 for a second camera beside that of a job, and for what states none; else as for the job.
    """
    if isinstance(job, Job | str | Path):
        for name, given in {"camera": camera, "sections": sections}.items():
            if given is not None:
                what = f"the job has {'a camera' if name == 'camera' else 'sections'} of its own"
                raise JobError("MF105", what, where=name, cure=f"Give no {name}, or change what the job states")
        return job if isinstance(job, Job) else load_job(job, further)
    # Plates bring along all that lays out and draws.
    from maskfab.api.plate import Plate

    if isinstance(job, Plate):
        return job.with_sections(sections or {}).job(camera)
    by_die, alone = _panels(job, camera)
    made = Plate.of(by_die, camera=camera, sections=sections).job()
    assert made.spec.plate is not None
    assumed = AssumedPlate(**vars(made.spec.plate))
    return replace(made, spec=made.spec.model_copy(update={"plate": assumed}), laid_out=alone)


def refuse_stated(stated: Mapping[str, object], made: str, asked: str) -> None:
    """Refuse whatever is stated and has no meaning for what is made, which a key asks for. Raises JobError MF105."""
    for key, value in stated.items():
        if value is not None:
            raise JobError("MF105", f"{key} does not apply to {made}", where=key, cure=f"Leave {key} out, or {asked}")


def laid_out(
    job: AnyJob, lay: Callable[[Job], _Laid], *checks: Callable[[Job], object], camera: Camera | None = None
) -> tuple[Job, _Laid]:
    """The validated job of whatever states one, and its plate or panels, refused with all that checks refuse, at once.

    Args:
        lay: lays the job out.

    Raises:
        JobError, OpeningError, SourceError, OutputError: for all that is wrong, at once.
    """
    made: list[_Laid] = []

    def further(loaded: Job, faults: JobFaults) -> None:
        for check in checks:
            with faults:
                check(loaded)
        with faults:
            made.append(lay(loaded))

    loaded = job_of(job, camera, further=further)
    faults = JobFaults.of_spec(loaded.spec)
    further(loaded, faults)
    faults.refuse()
    return loaded, made[-1]


def spec_of(job: DesignJob, verb: str, check: Callable[[JobSpec], None] | None = None) -> tuple[JobSpec, Path]:
    """The spec of a job that says what is designed, and the path that its files are relative to. Raises JobError MF105
    for an opening or a panel, which are designed already; else as for a job file."""
    if isinstance(job, Job):
        return job.spec, Path(job.where)
    if isinstance(job, str | Path):
        return read(Path(job), check), Path(job)
    what = f"{verb} finds an opening, and {type(job).__name__} does not say for what"
    cure = "Give a job with [design], or begin a design at an opening: design(start=opening, camera=camera)"
    raise JobError("MF105", what, where=f"{verb}: job", cure=cure)


def folder_of(given: AnyPath, verb: str, where: str) -> Path:
    """The path that a caller names, or that a result is. Raises JobError MF105 for what is none: a plate, say, of which
    nothing was written yet."""
    if isinstance(given, str | PathLike):
        return Path(given)
    what = f"{verb} looks into files, and {type(given).__name__} is no path and no finished run"
    cure = 'Make it first: report = run(plate, camera, out="build/demo")'
    raise JobError("MF105", what, where=f"{verb}: {where}", cure=cure)


def panels_of(stated: object, camera: Camera | None = None) -> dict[str, Panel]:
    """Panels by the names of their dies, of one or several, as :func:`job_of` takes them. Raises JobError MF105 for
    what is no panel, and for none."""
    return _panels(stated, camera)[0]


def _panels(stated: object, camera: Camera | None) -> tuple[dict[str, Panel], frozenset[str]]:
    """Panels by the names of their dies, and the names of those that were openings alone."""
    from maskfab.api.plate import named as by_name

    if isinstance(stated, Mapping):
        every = {name: _panel(held, camera, f"job[{name!r}]") for name, held in stated.items()}
        named, given = every, list(stated.values())
    elif isinstance(stated, Sequence) and not isinstance(stated, str | bytes):
        named = by_name([_panel(held, camera, f"job[{number}]") for number, held in enumerate(stated)])
        given = list(stated)
    else:
        named, given = by_name(_panel(stated, camera, "job")), [stated]
    if not named:
        raise JobError("MF105", "there is no panel", where="job", cure=f"Give {_TAKEN}")
    alone = frozenset(name for name, held in zip(named, given, strict=True) if isinstance(held, Opening))
    return dict(_apart(named.items())), alone


def _panel(stated: object, camera: Camera | None, where: str) -> Panel:
    """A panel as it is, of a result its own, of an opening cells that turn no way over the camera's stop."""
    from maskfab.api.camera import protocol_f1
    from maskfab.api.panel import Panel
    from maskfab.mask.panels import lacks_pitch, laid_over

    if isinstance(stated, Opening):
        side_nm = min(laid_over(stated, (camera or protocol_f1()).model.stop).size_nm)
        return Panel.tile(stated, size=f"{side_nm / NM_PER_UM:.15g} um")
    if isinstance(stated, np.ndarray):
        raise lacks_pitch(stated, where)
    panel = stated if isinstance(stated, Panel) else getattr(stated, "panel", None)
    if not isinstance(panel, Panel):
        raise JobError("MF105", f"{type(stated).__name__} states no job", where=where, cure=f"Give {_TAKEN}")
    return panel


def _apart(named: Iterable[tuple[str, Panel]]) -> Iterator[tuple[str, Panel]]:
    """Panels in which no two openings that differ have one name, as those of arrays do: the later gets its die's."""
    from maskfab.mask.opening_file import opening_text

    texts: dict[str, str] = {}
    for die, panel in named:
        names = {}
        for number, opening in enumerate(panel.held):
            text = opening_text(replace(opening, name=""))
            if texts.setdefault(opening.name, text) != text:
                names[opening.name] = die if len(panel.held) == 1 else f"{die}_{number + 1}"
                texts[names[opening.name]] = text
        yield die, panel.renamed(names) if names else panel


def sources(given: AnyPhoto | Sequence[AnyPhoto], name: str) -> list[Source]:
    """Pictures of a caller: paths, and arrays as frames, which are called after their argument and their number.

    Raises:
        JobError: MF105 for what is neither.
        SourceError: as :func:`maskfab.camera.frames.frame.frame_of_array`.
    """
    # Frames bring along what reads them.
    from maskfab.camera.frames.frame import frame_of_array

    alone = isinstance(given, str | PathLike | np.ndarray) or not isinstance(given, Sequence)
    every: Sequence[object] = [given] if alone else given  # type: ignore[assignment]
    made: list[Source] = []
    for number, one in enumerate(every, 1):
        if isinstance(one, str | PathLike):
            made.append(Path(one))
        elif isinstance(one, np.ndarray):
            made.append(frame_of_array(one, name if alone else f"{name}_{number}"))
        else:
            cure = "Give paths of files, or arrays of linear light, [rows, columns, 3]"
            raise JobError("MF105", f"{type(one).__name__} is no picture", where=name, cure=cure)
    return made


def dies_of(asked: str | Sequence[str] | None, names: Collection[str]) -> tuple[str, ...]:
    """The dies that are asked for, each once; all if none is. Raises JobError MF105 for the first that the job does not
    have."""
    wanted = (asked,) if isinstance(asked, str) else tuple(asked or names)
    for name in wanted:
        if name not in names:
            listed = ", ".join(names)
            raise JobError("MF105", f"the job has no die {name!r}", where="die", cure=f"Use one of {listed}")
    return tuple(dict.fromkeys(wanted))


def given_folder(images: str | Path | None, white: float | None, *, whole: bool = False) -> Folder | None:
    """The photographs of a folder; None where none is named, and scenes are drawn.

    Args:
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
    from maskfab.findings.optics import sees_mirrored

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
