"""Plates made and looked into: from a job of one's own, or an opening, to begin with."""

from __future__ import annotations

import html
import os
from collections.abc import Iterator, Mapping
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal, overload
from urllib.parse import quote

from maskfab.api.asked import AnyJob, AnyPanel, folder_of, job_of
from maskfab.api.camera import Camera
from maskfab.api.plate import Plate
from maskfab.api.results import Asked, InPython, Result, Told, answers, verdict_lines
from maskfab.base.checks import checked_arguments
from maskfab.base.errors import JobError, OutputError
from maskfab.base.folders import check_file, write_text
from maskfab.base.work import Progress, silent
from maskfab.base.workers import Workers
from maskfab.mask.job import Job, load_job
from maskfab.optics.metrics import fast_lens
from maskfab.runs import pipeline
from maskfab.runs.forecast import Forecast
from maskfab.runs.forecast import dry_run as forecast_run
from maskfab.runs.result import Result as Run
from maskfab.runs.store import Store, of_installation

if TYPE_CHECKING:
    from maskfab.api.asked import AnyPath  # at run time refused here, with the verb to call first


@overload
def run(
    job: Plate | AnyPanel | Mapping[str, AnyPanel] | list[AnyPanel], camera: Camera | None = None,
    out: str | Path = ..., *, force: bool = ..., pdf: bool = ..., live: str | Path | None = ...,
    progress: Progress = ..., cache: bool = ..., workers: int | None = ..., scheduler: str | None = ...
) -> Run: ...  # fmt: skip
@overload
def run(
    job: Job | str | Path,
    out: str | Path,
    /,
    *,
    force: bool = ...,
    live: str | Path | None = ...,
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
    live: str | Path | None = ...,
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
    live: Annotated[str | Path | None, "FILE.html"] = None,
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
        $ maskfab run layouts/upc12.toml --out build/upc12 --live build/live.html

    Args:
        job: job file (.toml); in Python also a plate, panels or a loaded job.
        camera: of a plate or of panels; by default the plate's, or that of protocol F1.
        out: output directory; it appears when everything in it is complete.
        cache: find everything anew, and keep nothing; see maskfab self cache. The files are the same either way.
        dry_run: tell stages, what of them is kept, time and memory; write nothing.
        force: replace an earlier result there.
        live: page that shows dies as soon as something of them is known, and renews itself, to stop a wrong job early.
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
    page = None if live is None else Path(live)
    return pipeline.run(made, out, force=force, progress=progress, cache=store, pdf=pdf, workers=crew, live=page)


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
    from maskfab.report.pages.viewer import shown_run, viewer_page  # slow to load

    shown = shown_run(folder, _address(folder, target))
    page = viewer_page(shown)
    write_text(target, page, replace=force)
    return View(target, shown["file"]["path"], shown["file"]["sha256"], len(page.encode()))
