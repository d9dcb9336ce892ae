"""Plates made, and files verified."""

from __future__ import annotations

import os
from collections.abc import Sequence
from pathlib import Path
from typing import overload

from maskfab import pipeline, verification
from maskfab.api.camera import Camera
from maskfab.api.jobs import AnyJob, job_of
from maskfab.api.lengths import Length, length_text
from maskfab.api.plate import Plate
from maskfab.errors import JobError
from maskfab.job import Job
from maskfab.package.archive import is_package
from maskfab.package.pack import verify_package
from maskfab.pipeline import Result
from maskfab.progress import Progress, silent
from maskfab.report.quantities import Quantities
from maskfab.shops.profiles import load_shop
from maskfab.units import NM_PER_UM, parse_length_um
from maskfab.verify.foreign.comparison import How


@overload
def run(
    job: Plate, camera: Camera | None = None, out: str | Path = ..., *, force: bool = ..., progress: Progress = ...
) -> Result: ...
@overload
def run(job: Job | str | Path, out: str | Path, /, *, force: bool = ..., progress: Progress = ...) -> Result: ...
@overload
def run(job: Job | str | Path, *, out: str | Path, force: bool = ..., progress: Progress = ...) -> Result: ...
def run(
    job: AnyJob,
    camera: Camera | str | Path | None = None,
    out: str | Path | None = None,
    *,
    force: bool = False,
    progress: Progress = silent,
) -> Result:
    """Make a plate: write its mask files, read them back, measure them, and report.

    ``run(plate, camera, out="build/demo")`` or ``run("job.toml", "build/demo")``. Of the result,
    ``result["DIE"]["mtf50", 530]`` is a number and ``print(result)`` a table.

    Args:
        job: a plate, a loaded job, or the path of a job file.
        camera: of a plate; by default its own.
        out: output directory; it appears when everything in it is complete.
        force: replace an earlier result there.
        progress: told where the work stands.

    Raises:
        InputError: for bad input, before anything is written.
    """
    if isinstance(camera, str | Path) and out is None:
        camera, out = None, camera
    if out is None:
        raise JobError("MF105", "there is no output directory", where="run: out", cure='Add out="build/demo"')
    if isinstance(camera, str | Path):
        raise JobError("MF105", f"{camera!r} is not a camera", where="run: camera", cure="Make one: Camera(...)")
    return pipeline.run(job_of(job, camera), out, force=force, progress=progress)


def verify(
    subject: str | Path,
    *,
    against: AnyJob | None = None,
    shop: str | None = None,
    die: str | None = None,
    layer: str | None = None,
    cell: str | None = None,
    dots_per_um: float | None = None,
    unit_um: float | None = None,
    tone: str | None = None,
    ignore: Sequence[str] = (),
    tolerance: Length | None = None,
    progress: Progress = silent,
) -> Quantities:
    """Repeat every check of a finished run or package, or compare a mask file from any source with a plate.

    Args:
        subject: the directory of a run, a package (.zip), or a mask file (.gds .oas .dxf .gbr .png .tif).
        against: plate or job that a mask file is compared with; a package has its own.
        shop: of a package, the shop whose rules it must keep; by default the one in it.
        die: compare only this die.
        layer, cell, dots_per_um, unit_um, tone, ignore: what a mask file does not state itself.
        tolerance: differences up to this width are none.
        progress: told where the work stands.

    Raises:
        OutputError: MF403 for a directory that is no result.
        SourceError: for a file that cannot be read.
        JobError: MF105 for a file without a job to compare it with, and for arguments that do not apply.
    """
    path = Path(subject)
    if is_package(path):
        job = None if against is None else job_of(against)
        return Quantities(verify_package(path, job, None if shop is None else load_shop(shop)))
    if against is None:
        if os.path.isfile(path):
            raise JobError(
                "MF105",
                f"no plate or job is given to compare {path.name} with",
                where="verify: against",
                cure="Add against=plate, or name the directory of a finished run",
            )
        return Quantities(verification.verify(path, progress))
    if tone not in (None, "clear", "dark"):
        raise JobError("MF105", f"there is no tone {tone!r}", where="verify: tone", cure="Use clear or dark")
    slivers = 0.0 if tolerance is None else parse_length_um(length_text(tolerance), where="verify: tolerance")
    how = How(layer, cell, dots_per_um, unit_um, tuple(ignore), tone == "dark", slivers * NM_PER_UM)
    return Quantities(verification.verify_file(path, job_of(against), die, how, progress).quantities)
