"""Plates made, looked into and verified: from a job of one's own, or an opening, to begin with."""

from __future__ import annotations

import html
import os
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal, overload
from urllib.parse import quote

from maskfab.api.asked import AnyJob, AnyPanel, folder_of, job_of
from maskfab.api.camera import Camera
from maskfab.api.lengths import Length, drawing_unit_um, length_text
from maskfab.api.plate import Plate
from maskfab.api.results import Asked, InPython, Result, Told, answers, verdict_lines
from maskfab.base.checks import checked_arguments
from maskfab.base.errors import JobError, OutputError
from maskfab.base.files import suffix_of
from maskfab.base.folders import check_file, write_text
from maskfab.base.model import Quantity
from maskfab.base.units import NM_PER_UM, parse_length_um
from maskfab.base.work import Progress, silent
from maskfab.base.workers import Workers
from maskfab.findings.foreign import How
from maskfab.job.reference import USES, in_words, unused
from maskfab.mask.formats.picture import IMAGE_SUFFIXES
from maskfab.mask.formats.table import LAYOUT_SUFFIXES
from maskfab.mask.houses.profiles import load_shop
from maskfab.mask.job import Job, load_job
from maskfab.mask.package.archive import is_package
from maskfab.mask.package.pack import verify_package
from maskfab.optics.metrics import fast_lens
from maskfab.report.pages.viewer import shown_run, viewer_page
from maskfab.report.text import Quantities, table_lines
from maskfab.report.verdicts import Verdicts
from maskfab.runs import pipeline, verification
from maskfab.runs.forecast import Forecast
from maskfab.runs.forecast import dry_run as forecast_run
from maskfab.runs.result import Result as Run
from maskfab.runs.store import Store, of_installation
from maskfab.runs.verification import Reproduction, reproduce

if TYPE_CHECKING:
    from maskfab.api.asked import AnyPath  # at run time refused here, with the verb to call first


@overload
def run(
    job: Plate | AnyPanel | Mapping[str, AnyPanel] | list[AnyPanel], camera: Camera | None = None,
    out: str | Path = ..., *, force: bool = ..., pdf: bool = ...,
    progress: Progress = ..., cache: bool = ..., workers: int | None = ..., scheduler: str | None = ...
) -> Run: ...  # fmt: skip
@overload
def run(
    job: Job | str | Path,
    out: str | Path,
    /,
    *,
    force: bool = ...,
    pdf: bool = ...,
    progress: Progress = ...,
    cache: bool = ...,
    workers: int | None = ...,
    scheduler: str | None = ...,
) -> Run: ...
@overload
def run(
    job: Job | str | Path,
    *,
    out: str | Path,
    force: bool = ...,
    pdf: bool = ...,
    progress: Progress = ...,
    cache: bool = ...,
    workers: int | None = ...,
    scheduler: str | None = ...,
) -> Run: ...
@overload
def run(
    job: AnyJob, camera: Camera | str | Path | None = ..., out: str | Path | None = ..., *, dry_run: Literal[True],
    force: bool = ..., progress: Progress = ..., cache: bool = ..., workers: int | None = ...
) -> Forecast: ...  # fmt: skip
@checked_arguments
def run(
    job: AnyJob,
    camera: InPython[Camera | str | Path | None] = None,
    out: Annotated[str | Path | None, "FOLDER!"] = None,
    *,
    cache: bool = True,
    dry_run: bool = False,
    force: bool = False,
    pdf: bool = False,
    scheduler: Annotated[str | None, "ADDRESS"] = None,
    workers: Annotated[int | None, "1..1024"] = None,
    progress: Progress = silent,
) -> Run | Forecast:
    """Make a plate: write the mask files, read them back, measure them, check them against [export] shop, report.

    Examples:
        $ maskfab run layouts/upc12.toml --out build/upc12
        $ maskfab run layouts/upc12.toml --out build/upc12 --dry-run
        $ maskfab run layouts/upc12.toml --out build/upc12 --pdf

    Args:
        job: job file (.toml); in Python also a plate, panels or a loaded job.
        camera: of a plate or of panels; by default the plate's, or that of protocol F1.
        out: output directory; it appears when everything in it is complete.
        cache: find everything anew, and keep nothing; see maskfab self cache. The files are the same either way.
        dry_run: tell stages, what of them is kept, time and memory; write nothing.
        force: replace an earlier result there.
        pdf: print the report, too: report.pdf, by Chromium, Chrome or Edge.
        scheduler: address of a Dask scheduler whose workers share the work, such as tcp://127.0.0.1:8786.
        workers: processes; by default as many as processors and memory bear. The files are the same.
        progress: told where the work stands.

    Returns:
        What came of it: ``result["DIE"]["mtf50", 530]`` is a number, ``print(result)`` a table.

    Raises:
        InputError: for bad input, before anything is written.
    """
    if isinstance(camera, str | Path) and out is None:
        camera, out = None, camera
    if out is None:
        raise JobError("MF105", "there is no output directory", where="run: out", cure='Add out="build/demo"')
    if isinstance(camera, str | Path):
        raise JobError("MF105", f"{camera!r} is not a camera", where="run: camera", cure="Make one: Camera(...)")
    store, crew = Store.of_user() if cache else None, Workers(workers, scheduler, of_installation)
    made = job_of(job, camera, further=pipeline.plate_to_make)
    if dry_run:
        return forecast_run(made, Path(out), force=force, cache=store, workers=crew)
    return pipeline.run(made, out, force=force, progress=progress, cache=store, pdf=pdf, workers=crew)


@answers(run)
def _run(asked: Asked) -> Told:
    """Files on stdout; times, checks that fail and verdicts on stderr."""
    if asked.stated.get("dry_run"):
        return Told.of(asked.found())
    loaded = load_job(asked.stated["job"], pipeline.plate_to_make)
    result = asked.found(job=loaded)
    asides = [] if asked.quiet else [*_times(result.report.seconds)]
    checks = [*fast_lens(loaded.camera), *result.notes, *result.report.checks]
    document = result.to_dict() | {"findings": [asdict(account) for account in result.accounts]}
    remarks = verdict_lines(checks, result.verdicts)
    if result.taken is not None and not asked.quiet:
        (asides if asked.as_json else remarks).append(result.origin)
    return Told(document, map(str, sorted(result.directory.iterdir())), result.passed, asides, remarks)


def _times(seconds: Mapping[str, float]) -> Iterator[str]:
    for stage, took in seconds.items():
        kind, _, die = stage.partition(" ")
        if kind == "optics" and die:
            scene = seconds.get(f"scene {die}")
            yield f"{die}: optics {took:.2f} s" + ("" if scene is None else f", scene {scene:.2f} s")


@checked_arguments
def forecast(
    job: AnyJob, camera: Camera | None = None, *, out: str | Path, force: bool = False, cache: bool = True
) -> Forecast:
    """Tell what :func:`maskfab.run` would do, as it does with ``dry_run``: stages, what of them is kept, time, memory.

    Raises:
        InputError: for bad input that the run would refuse before its work.
    """
    return run(job, camera, out, dry_run=True, force=force, cache=cache)


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


@overload
def verify(subject: AnyPath, *, again: Literal[True], progress: Progress = ...) -> Reproduction: ...
@overload
def verify(
    subject: AnyPath, *, against: AnyJob | None = ..., shop: str | None = ..., die: str | None = ...,
    layer: str | None = ..., cell: str | None = ..., dots_per_um: float | None = ..., unit_um: str | float | None = ...,
    tone: str | None = ..., ignore: Sequence[str] = ..., tolerance: Length | None = ..., progress: Progress = ...
) -> Verification: ...  # fmt: skip
@checked_arguments
def verify(
    subject: Annotated[AnyPath, "DIR|PACKAGE|FILE"],
    *,
    against: Annotated[AnyJob | None, "JOB"] = None,
    shop: str | None = None,
    die: str | None = None,
    layer: str | None = None,
    cell: str | None = None,
    dots_per_um: Annotated[float | None, "1e-6..1e6"] = None,
    unit_um: Annotated[str | float | None, "--unit nm|um|mm|mil|in"] = None,
    tone: Annotated[str | None, "clear|dark"] = None,
    ignore: Annotated[Sequence[str], "LAYER"] = (),
    tolerance: Length | None = None,
    again: bool = False,
    progress: Progress = silent,
) -> Verification | Reproduction:
    """Repeat every check on a finished run or package, or compare a mask file with a job.

    Examples:
        $ maskfab verify build/upc12
        $ maskfab verify build/upc12 --again
        $ maskfab verify from_elsewhere.gds --against layouts/upc12.toml --layer 1/0

    Args:
        subject: the --out of a finished run, a .zip that maskfab order pack wrote, or a mask file (.gds .oas .dxf .gbr
            .cif .png .tif) from any source. In Python also the result of :func:`maskfab.run`.
        against: job (.toml) to compare a mask file or package with; by default for a package the job in it. In Python
            also a plate, panels or a loaded job.
        shop: shop profile to re-check the package against; by default the one in the package.
        die: compare only this die of the job.
        layer: clear layer of the mask file, such as 1/0 or CLEAR.
        cell: cell of a mask file; by default its only top cell.
        dots_per_um: image pixels per micrometre; by default the resolution stored in the file.
        unit_um: drawing unit of a DXF, by its name or in micrometres; overrides the one in the file.
        tone: what the polygons draw; by default clear.
        ignore: layer with shapes that are not part of the mask.
        tolerance: ignore differences (slivers) up to this width, such as ``"1 nm"``.
        again: make the finished run once more from its own job: every byte the same, or which file, stage and version.
        progress: told where the work stands.

    Raises:
        OutputError: MF403 for a directory that is no result.
        SourceError: for a file that cannot be read.
        JobError: MF105 for a file without a job to compare it with, and for arguments that do not apply.
    """
    path = folder_of(subject, "verify", "subject")
    unit_um = drawing_unit_um(unit_um)
    stated = {
        "against": against, "shop": shop, "die": die, "layer": layer, "cell": cell, "dots_per_um": dots_per_um,
        "unit_um": unit_um, "tone": tone, "ignore": tuple(ignore) or None, "tolerance": tolerance,
    }  # fmt: skip
    if again:
        _refuse_strangers([name for name, value in stated.items() if value is not None], "a run made again", str)
        return reproduce(path, progress=progress)
    check_applies(stated, path)
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
    if tone not in {None, "clear", "dark"}:
        raise JobError("MF105", f"there is no tone {tone!r}", where="tone", cure="Use clear or dark")
    how = How(layer, cell, dots_per_um, unit_um, tuple(ignore), tone == "dark", slivers * NM_PER_UM)
    job = job_of(against)
    foreign = verification.verify_file(path, job, die, how, progress)
    return Verification(
        foreign.quantities,
        layer=foreign.layers.clear or None,
        tone="dark" if foreign.dark else "clear",
        other_layers=foreign.layers.others,
        unused=unused(job.spec, *USES["verify --against"]),
    )


@answers(verify)
def _verify(asked: Asked) -> Told:
    """A run and a package by their verdicts, a file also by how it was read."""
    path, stated = Path(asked.stated["subject"]), asked.stated
    if stated.get("again"):
        return Told.of(asked.found())
    options = {key: value for key, value in stated.items() if key not in ("subject", "progress")}
    check_applies(options, path, lambda name: "--unit" if name == "unit_um" else f"--{name.replace('_', '-')}")
    answer: Verification = asked.found()
    against, shop = (None if stated.get(key) is None else str(stated[key]) for key in ("against", "shop"))
    document: dict[str, Any] = {"verdict": "pass" if answer.passed else "fail", "verdicts": answer.verdicts.to_dict()}
    if answer.tone is None:
        more = {"package": str(path), "against": against, "shop": shop} if is_package(path) else {}
        document |= {**more, "checks": answer.to_dict()}
        return Told(document, (), answer.passed, remarks=verdict_lines(answer, answer.verdicts))
    document |= {
        "layer": answer.layer, "tone": answer.tone, "other_layers": list(answer.other_layers), "file": str(path),
        "against": against, "die": stated.get("die"), "quantities": answer.to_dict(), "unused": list(answer.unused),
    }  # fmt: skip
    of_layer = f" on layer {answer.layer}" if answer.layer else ""
    beside = f"; ignored layers with shapes: {', '.join(answer.other_layers)}" if answer.other_layers else ""
    read_as = f"{path.name}: polygons{of_layer} are {'opaque' if answer.tone == 'dark' else 'clear'}{beside}"
    lines = [read_as, *table_lines(answer, dies=True), *in_words(answer.unused)]
    judged = [quantity for quantity in answer if quantity.passed is not None]
    return Told(document, lines, answer.passed, remarks=verdict_lines(judged, answer.verdicts))


def check_applies(stated: Mapping[str, object], subject: Path, spelt: Callable[[str], str] = str) -> None:
    """Refuse what cannot be said of the folder, package or file that is verified.

    Args:
        spelt: how the caller's user writes an argument.

    Raises:
        JobError: MF105 for all that do not apply, at the first; for what is missing.
    """
    said = [name for name, value in stated.items() if value is not None]
    if is_package(subject):
        _refuse_strangers([name for name in said if name not in {"against", "shop"}], "a package", spelt)
        if "shop" in said and "against" not in said:
            against, shop = spelt("against"), spelt("shop")
            what = f"{against} is missing: with {shop} the package is rebuilt from its job"
            cure = f"Add {against} with the job, or leave {shop} out: the package holds its job and its shop"
            raise JobError("MF105", what, where=against, cure=cure)
    elif "shop" in said:
        what = f"{spelt('shop')} {stated['shop']} applies to packages only, and {subject.name} is not one"
        cure = f"Name a .zip that maskfab order pack wrote, or leave {spelt('shop')} out"
        raise JobError("MF105", what, where=spelt("shop"), cure=cure)
    elif os.path.isdir(subject):
        _refuse_strangers(said, f"{subject.name}, which is a directory", spelt)
    elif "against" in said:
        meant = {"against", *_meant(subject)}
        _refuse_strangers([name for name in said if name not in meant], subject.name, spelt)
    elif os.path.isfile(subject):
        cure = f"Add {spelt('against')} with a job, or name the directory of a finished run"
        raise JobError("MF105", f"no job is given to compare {subject.name} with", where=spelt("against"), cure=cure)


def _refuse_strangers(strangers: Sequence[str], subject: str, spelt: Callable[[str], str]) -> None:
    names = " ".join(map(spelt, strangers))
    cure = f"Leave {names} out"
    if "against" in strangers:
        cure += ": a finished directory is held against the job in it. Or name one of its mask files"
    if strangers:
        raise JobError("MF105", f"{names} does not apply to {subject}", where=spelt(strangers[0]), cure=cure)


def _meant(file: Path) -> tuple[str, ...]:
    """Arguments with a meaning for a file of its kind; all of them where no such kind is read, which is told elsewhere.

    Only the unit of a DXF can be stated, which the reader of the others says.
    """
    kind, every = suffix_of(file), ("die", "unit_um", "tone", "tolerance")
    if kind in IMAGE_SUFFIXES:
        return (*every, "dots_per_um")
    return (*every, "layer", "cell", "ignore", *(() if kind in LAYOUT_SUFFIXES else ("dots_per_um",)))


@dataclass(frozen=True, repr=False)
class View(Result):
    """A page that shows a plate."""

    path: Path
    mask_file: str
    sha256: str
    bytes: int

    def to_dict(self) -> dict[str, Any]:
        """Its attributes."""
        return {"page": str(self.path), "mask_file": self.mask_file, "sha256": self.sha256, "bytes": self.bytes}

    def _shown(self) -> str:
        return f'<a href="{html.escape(self.path.as_posix())}">{html.escape(self.path.name)}</a>'

    def __str__(self) -> str:
        return f"{self.path}: {self.mask_file}, SHA-256 {self.sha256}, in {self.bytes / 1e6:.1f} MB"


def _address(folder: Path, page: Path) -> str | None:
    """Of a folder from beside a page; None where there is no way, as from one drive of Windows to another."""
    try:
        way = os.path.relpath(folder, os.path.realpath(page.parent))
    except ValueError:
        return None
    return f"{quote(Path(way).as_posix())}/"


@checked_arguments
def view(directory: AnyPath, out: Annotated[str | Path | None, "PAGE.html"] = None, *, force: bool = False) -> View:
    """Make one page that shows the plate: layers, dies and their numbers, places of rule violations, a ruler.

    It shows the polygons of the first mask file, read back, and needs neither a network nor a server.

    Examples:
        $ maskfab view build/upc12
        $ maskfab view build/upc12 --out plate.html --force
        >>> import maskfab as mf
        >>> print(mf.view("build/upc12"))                                              # doctest: +SKIP

    Args:
        directory: finished run, the --out of maskfab run; nothing is written into it. In Python also the result of
            :func:`maskfab.run`.
        out: file of the page; by default DIR.html, beside the directory.
        force: replace an existing file.

    Raises:
        OutputError: MF401 or MF402 if the page cannot be written, MF403 for no finished run, MF407 for a file that was
            changed since, MF409 for a run without a mask file of polygons.
        SourceError: if the mask file cannot be read.
    """
    folder = Path(os.path.realpath(folder_of(directory, "view", "directory")))
    target = folder.with_name(f"{folder.name}.html") if out is None else Path(out)
    if folder in Path(os.path.realpath(target)).parents:
        what = f"{target} lies in the finished run, whose manifest does not know it"
        raise OutputError("MF401", what, where="--out", cure="Give --out a path beside the directory")
    check_file(target, force=force)
    shown = shown_run(folder, _address(folder, target))
    page = viewer_page(shown)
    write_text(target, page, replace=force)
    return View(target, shown["file"]["path"], shown["file"]["sha256"], len(page.encode()))
