"""The chain, on one page: job -> plate -> files -> files read back -> optics -> report."""

from __future__ import annotations

import time
from collections.abc import Iterator
from contextlib import AbstractContextManager, contextmanager, nullcontext
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path

from maskfab.base.effort import Costs
from maskfab.base.folders import OVERVIEW, TIMES, Account, check_target, staged, times_text
from maskfab.base.model import Plate, Quantity, Report
from maskfab.base.processes import SerialExecutor
from maskfab.base.work import Progress, one_thread, silent
from maskfab.base.workers import EVERY_CORE, Workers
from maskfab.display.feasibility import displays, plate_of
from maskfab.findings.optics import layout_as_seen, plate_as_seen
from maskfab.findings.photographs import Conditions
from maskfab.job.faults import JobFaults
from maskfab.mask.formats.exr import check_psf_file
from maskfab.mask.job import Job, load_job
from maskfab.report.documents.die import Beside, measured_beside
from maskfab.report.verdicts import Verdicts
from maskfab.runs.agreement import check_agreement
from maskfab.runs.live import Live
from maskfab.runs.paper import browser, print_report
from maskfab.runs.plate_files import (
    check_packages,
    check_pictures,
    check_processes,
    draw_files,
    job_text,
    psfs_as_files,
    read_own,
    shop_quantities,
    write_files,
    write_manifest,
    write_psfs,
)
from maskfab.runs.recall import CachingExecutor
from maskfab.runs.result import TAKEN, PlateFindings, Result
from maskfab.runs.stages import (
    begin_photographs,
    executor_of,
    expand_photographs,
    measure_dies,
    measure_process,
    measure_scenes,
    plan_scenes,
    report_cache_hits,
)
from maskfab.runs.store import Origin, Store, fingerprint, give_result, keep_result, of_installation


@one_thread
def run(
    job: Job | str | Path,
    out: str | Path,
    *,
    force: bool = False,
    progress: Progress = silent,
    cache: Store | None = None,
    pdf: bool = False,
    workers: Workers = EVERY_CORE,
    live: Path | None = None,
) -> Result:
    """Make a plate: lay the job out, write its mask files, read them back, measure them, and report.

    job: a loaded job, or the path of a job file.
    out: output directory; it appears when everything in it is complete.
    cache: what earlier runs have found, and where this one keeps what it finds; None for a run that finds
        everything itself. The files are the same to the last bit.
    pdf: print the report, too.
    workers: who shares the work; the files do not show it.
    live: a page that shows dies as soon as something of them is known.
    """
    job = job if isinstance(job, Job) else load_job(job, plate_to_make)
    place = check_target(Path(out), force=force)
    measured = measured_beside(job)
    with Live(progress, place.path, live, force=force) as told:
        aside = staged(place)
        if pdf:
            aside = _then_print(aside, browser(), told)
        if cache is None or not cache.has(origin_of_run(job, measured)):
            made = _make(job, aside, told, cache, measured, workers)
        else:
            with aside as folder:
                taken = _taken(job, folder, cache, measured, told, workers)
                made = taken or _make(job, nullcontext(folder), told, cache, measured, workers)
        told.ended(place.asked)
    return Result(place.asked, made.report, made.verdicts, None if cache is None else made.taken, made.accounts)


def plate_to_make(job: Job, faults: JobFaults) -> Plate | None:
    """The plate of a job and all that a run refuses of it before any die is worked on; None if it can't be laid out."""
    for check in (job.check_window, partial(check_packages, job), partial(Conditions.of, job, "camera")):
        with faults:
            check()
    plate = plate_of(job, faults)
    if plate is not None:
        with faults:
            check_processes(job, plate)
        with faults:
            check_pictures(job, plate)
    return plate


@contextmanager
def _then_print(aside: AbstractContextManager[Path], program: str, progress: Progress) -> Iterator[Path]:
    """The directory, whose report is printed once all else in it is complete."""
    with aside as folder:
        yield folder
        progress("print", 0, 1)
        print_report(folder, program)
        progress("print", 1, 1)


def _make(
    job: Job,
    aside: AbstractContextManager[Path],
    progress: Live,
    cache: Store | None,
    measured: Beside | None,
    workers: Workers,
) -> _Made:
    """Every stage, in order; the directory is entered when all is known that could be refused."""
    from maskfab.runs.drawing import draw_pictures, report_texts  # slow to load, and kept runs draw nothing

    seconds: dict[str, float] = {}
    with executor_of(job, cache, workers) as executor:
        stage = partial(_stage, seconds=seconds, executor=executor, progress=progress)
        with stage("layout", of="displays"):
            faults = JobFaults.of_spec(job.spec)
            plate = plate_to_make(job, faults)
            faults.refuse()
            assert plate is not None
            progress.laid_out(plate.dies)
            photographs = begin_photographs(job, plate, executor, progress.photographed)
            built = displays(job, plate, progress, executor=executor)
            progress.placed(built.displays)
            seen = plate_as_seen(job, plate := built.plate)
        with stage("draw"):
            made = draw_files(job, plate, displays=built.displays)
        with stage("plan"):
            plans = plan_scenes(job, seen, progress)
        # Before anything is written, for it takes the most memory, and libraries of solids and what is read back stay.
        with stage("process"):
            written = measure_process(job, seen, progress, seconds, executor)
        with aside as folder:
            with stage("write"):
                files = write_files(job, made, folder, progress, measured, costs := Costs())
            with stage("read back"):
                back = read_own(made, folder, progress, costs)
            layout = layout_as_seen(job, back.trips[0].layout)
            with stage("optics"):
                optics = measure_dies(
                    seen, job.camera, layout, progress, seconds, job.blank, executor, progress.measured
                )
                files += write_psfs(psfs := psfs_as_files(job, made, optics), folder)
            with stage("scene"):
                scenes = measure_scenes(job, seen, plans, layout, progress, seconds, executor)
            restored = photographs.result(progress, seconds)
            with stage("tolerance"):
                changes = expand_photographs(job, seen, progress, seconds, executor)
            read = (
                *back.quantities,
                *(row for psf in psfs for row in check_psf_file(psf, folder)),
                *made.account(),
                *shop_quantities(job, made),
            )
            findings = PlateFindings(job, built, read, optics, scenes, restored, written, changes, measured)
            report = findings.report(files, seconds)
            with stage("figures"):
                overview, pictures = draw_pictures(findings, findings.document(report), executor, progress)
            document = findings.document(report)
            (folder / OVERVIEW).write_bytes(overview)
            for name, text in report_texts(document, pictures, folder, back.read).items():
                (folder / name).write_text(text, encoding="utf-8")
            write_manifest(job, files, folder)
            check_agreement(folder)
            kept = executor.accounts if isinstance(executor, CachingExecutor) else ()
            result = _Made(report, findings.verdicts(report), executor.tally, kept, back.quantities)
            (folder / TIMES).write_text(times_text(job.digest, seconds, result.accounts, costs.rows), encoding="utf-8")
            if cache is not None:
                keep_result(cache, origin_of_run(job, measured), folder, result, _Made)
    return result


@dataclass(frozen=True)
class _Made:
    """A report, verdicts, how many findings of how many were kept, where they come from, and rows of the files as they
    were read back."""

    report: Report
    verdicts: Verdicts
    taken: tuple[int, int]
    accounts: tuple[Account, ...]
    read: tuple[Quantity, ...]


def origin_of_run(job: Job, measured: Beside | None) -> Origin:
    """Everything that the files of a run depend on."""
    given = run, job_text(job), *(() if measured is None else (measured.content,))
    return Origin("run", (of_installation(), *map(fingerprint, given)))


def _taken(
    job: Job, folder: Path, cache: Store, measured: Beside | None, progress: Live, workers: Workers
) -> _Made | None:
    """The result of an earlier run, whose files are now in the folder and were read back from there; None if they are
    lost, damaged, or not what they were."""
    seconds: dict[str, float] = {}
    origin = origin_of_run(job, measured)
    with _timed(TAKEN, seconds):
        entry = give_result(cache, origin, folder, _Made)
    if entry is None:
        return None
    with _timed("read back", seconds), executor_of(job, cache, workers) as executor:
        # What is handed out is judged as it lies there, whoever wrote it.
        built = displays(job, executor=executor)
        progress.laid_out(built.plate.dies)
        progress.placed(built.displays)
        made = draw_files(job, built.plate, displays=built.displays)
        back = read_own(made, folder, progress, costs := Costs())
    kept: _Made = entry.value
    if back.quantities != kept.read:
        for path in folder.iterdir():
            path.unlink()
        return None
    accounts = tuple(replace(account, kept=True, refused=None) for account in kept.accounts)
    (folder / TIMES).write_text(times_text(job.digest, seconds, accounts, costs.rows), encoding="utf-8")
    progress("run taken from the cache", 1, 1)
    return replace(kept, report=replace(kept.report, seconds=seconds), taken=(1, 1), accounts=accounts)


@contextmanager
def _timed(stage: str, seconds: dict[str, float]) -> Iterator[None]:
    start = time.perf_counter()
    yield
    seconds[stage] = round(time.perf_counter() - start, 3)


@contextmanager
def _stage(
    name: str, *, seconds: dict[str, float], executor: SerialExecutor, progress: Progress, of: str = ""
) -> Iterator[None]:
    """One stage, whose time is added to ``seconds``; progress is told how many findings ``of`` what were kept."""
    with _timed(name, seconds), report_cache_hits(of or name, executor, progress):
        yield
