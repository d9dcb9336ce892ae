"""Plates made, and files verified."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterable, Mapping, Sequence
from pathlib import Path
from typing import overload

from maskfab.api.camera import Camera
from maskfab.api.jobs import AnyJob, job_of
from maskfab.api.lengths import Length, length_text
from maskfab.api.plate import Plate
from maskfab.base.checks import checked_arguments
from maskfab.base.errors import JobError
from maskfab.base.model import Quantity
from maskfab.base.units import NM_PER_UM, parse_length_um
from maskfab.base.work import Progress, silent
from maskfab.job.reference import USES, unused
from maskfab.mask.formats.picture import IMAGE_SUFFIXES
from maskfab.mask.formats.table import LAYOUT_SUFFIXES
from maskfab.mask.houses.profiles import load_shop
from maskfab.mask.job import Job
from maskfab.mask.package.archive import is_package
from maskfab.mask.package.pack import verify_package
from maskfab.report.rows.foreign import How
from maskfab.report.rows.text import Quantities
from maskfab.report.rows.verdicts import Verdicts
from maskfab.runs import pipeline, verification
from maskfab.runs.pipeline import Result
from maskfab.runs.store import Store


@overload
def run(
    job: Plate,
    camera: Camera | None = None,
    out: str | Path = ...,
    *,
    force: bool = ...,
    progress: Progress = ...,
    cache: bool = ...,
) -> Result: ...
@overload
def run(
    job: Job | str | Path, out: str | Path, /, *, force: bool = ..., progress: Progress = ..., cache: bool = ...
) -> Result: ...
@overload
def run(
    job: Job | str | Path, *, out: str | Path, force: bool = ..., progress: Progress = ..., cache: bool = ...
) -> Result: ...
@checked_arguments
def run(
    job: AnyJob,
    camera: Camera | str | Path | None = None,
    out: str | Path | None = None,
    *,
    force: bool = False,
    progress: Progress = silent,
    cache: bool = True,
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
        cache: take what earlier runs have found, and keep what this one finds; the files are the same either way.

    Raises:
        InputError: for bad input, before anything is written.
    """
    if isinstance(camera, str | Path) and out is None:
        camera, out = None, camera
    if out is None:
        raise JobError("MF105", "there is no output directory", where="run: out", cure='Add out="build/demo"')
    if isinstance(camera, str | Path):
        raise JobError("MF105", f"{camera!r} is not a camera", where="run: camera", cure="Make one: Camera(...)")
    store = Store.of_user() if cache else None
    return pipeline.run(job_of(job, camera), out, force=force, progress=progress, cache=store)


class Verification(Quantities):
    """Checks of a run, a package or a mask file; of a file also how it was read.

    Attributes:
        verdicts: what the checks come to; displays are judged of a run alone.
        layer: of a layout, what was compared; None for a picture, a run or a package.
        tone: "clear" or "dark", what the file draws; None for a run or a package.
        other_layers: with shapes, which were not compared.
        unused: keys and tables of the job on which nothing of the comparison depends.
    """

    def __init__(
        self,
        checks: Iterable[Quantity],
        verdicts: Verdicts | None = None,
        *,
        layer: str | None = None,
        tone: str | None = None,
        other_layers: Sequence[str] = (),
        unused: Sequence[str] = (),
    ) -> None:
        super().__init__(checks)
        self.verdicts = verdicts or Verdicts.of(self, {}, 0)
        self.layer, self.tone, self.other_layers = layer, tone, tuple(other_layers)
        self.unused = tuple(unused)


@checked_arguments
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
) -> Verification:
    """Repeat every check of a finished run or package, or compare a mask file from any source with a plate.

    Args:
        subject: the directory of a run, a package (.zip), or a mask file (.gds .oas .dxf .gbr .cif .png .tif).
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
    check_applies(
        {
            "against": against, "shop": shop, "die": die, "layer": layer, "cell": cell, "dots_per_um": dots_per_um,
            "unit_um": unit_um, "tone": tone, "ignore": tuple(ignore) or None, "tolerance": tolerance,
        },
        path,
    )  # fmt: skip
    if is_package(path):
        profile, job = None if shop is None else load_shop(shop), None if against is None else job_of(against)
        progress("package", 0, 1)
        checks = verify_package(path, job, profile)
        progress("package", 1, 1)
        return Verification(checks)
    if against is None:
        verified = verification.verify(path, progress)
        return Verification(verified.checks, verified.verdicts)
    slivers = 0.0 if tolerance is None else parse_length_um(length_text(tolerance), where="tolerance")
    how = How(layer, cell, dots_per_um, unit_um, tuple(ignore), _is_dark(tone), slivers * NM_PER_UM)
    job = job_of(against)
    found = verification.verify_file(path, job, die, how, progress)
    return Verification(
        found.quantities,
        layer=found.layers.clear or None,
        tone="dark" if found.dark else "clear",
        other_layers=found.layers.others,
        unused=unused(job.spec, *USES["verify --against"]),
    )


def _is_dark(tone: str | None) -> bool:
    """Whether polygons are said to draw the chrome; they draw what is clear unless stated (MF105 for another tone)."""
    if tone not in {None, "clear", "dark"}:
        raise JobError("MF105", f"there is no tone {tone!r}", where="tone", cure="Use clear or dark")
    return tone == "dark"


def check_applies(stated: Mapping[str, object], subject: Path, spelt: Callable[[str], str] = str) -> None:
    """Refuse what cannot be said of the folder, package or file that is verified.

    Args:
        stated: arguments of :func:`verify` by name, None where left out.
        subject: what is verified.
        spelt: how the caller's user writes an argument.

    Raises:
        JobError: MF105 for all that do not apply, at the first; for what is missing.
    """
    said = [name for name, value in stated.items() if value is not None]
    if is_package(subject):
        _refuse_strangers([name for name in said if name not in {"against", "shop"}], "a package", spelt)
        if "shop" in said and "against" not in said:
            against, shop = spelt("against"), spelt("shop")
            raise JobError(
                "MF105",
                f"{against} is missing: with {shop} the package is rebuilt from its job",
                where=against,
                cure=f"Add {against} with the job, or leave {shop} out: the package holds its job and its shop",
            )
    elif "shop" in said:
        raise JobError(
            "MF105",
            f"{spelt('shop')} {stated['shop']} applies to packages only, and {subject.name} is not one",
            where=spelt("shop"),
            cure=f"Name a .zip that maskfab package wrote, or leave {spelt('shop')} out",
        )
    elif os.path.isdir(subject):
        _refuse_strangers(said, f"{subject.name}, which is a directory", spelt)
    elif "against" in said:
        meant = {"against", *_meant(subject)}
        _refuse_strangers([name for name in said if name not in meant], subject.name, spelt)
    elif os.path.isfile(subject):
        raise JobError(
            "MF105",
            f"no job is given to compare {subject.name} with",
            where=spelt("against"),
            cure=f"Add {spelt('against')} with a job, or name the directory of a finished run",
        )


def _refuse_strangers(strangers: Sequence[str], subject: str, spelt: Callable[[str], str]) -> None:
    told = " ".join(map(spelt, strangers))
    cure = f"Leave {told} out"
    if "against" in strangers:
        cure += ": a finished directory is held against the job in it. Or name one of its mask files"
    if strangers:
        raise JobError("MF105", f"{told} does not apply to {subject}", where=spelt(strangers[0]), cure=cure)


def _meant(file: Path) -> tuple[str, ...]:
    """Arguments with a meaning for a file of its kind; all of them where no such kind is read, which is told elsewhere.

    Only the unit of a DXF can be stated, which the reader of the others says.
    """
    kind, every = file.suffix.lower(), ("die", "unit_um", "tone", "tolerance")
    if kind in IMAGE_SUFFIXES:
        return (*every, "dots_per_um")
    return (*every, "layer", "cell", "ignore", *(() if kind in LAYOUT_SUFFIXES else ("dots_per_um",)))
