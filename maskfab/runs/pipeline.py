"""The chain, on one page: job -> plate -> files -> files read back -> optics -> report."""

from __future__ import annotations

import json
import os
import shutil
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import AbstractContextManager, contextmanager, nullcontext
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeVar

from klayout import db

from maskfab.base import __version__, provenance, resources
from maskfab.base.errors import InternalError, SourceError, UnknownNameError
from maskfab.base.folders import JOB_COPY, PAGE, REPORT, RESULT_MARK, TIMES, Account, check_target, staged, times_text
from maskfab.base.model import UNSTATED, Camera, Die, DieOptics, MaskBlank, Plate, Quantity, Report, WrittenFile
from maskfab.base.processes import ArgumentsFactory, ProcessExecutor, SerialExecutor, Task, release_memory
from maskfab.base.work import Progress, one_thread, silent
from maskfab.display.feasibility import PlateWithDisplays, display_rules, displays
from maskfab.job.reference import USES, unused
from maskfab.job.sections import ExportSection
from maskfab.job.shop import Shop
from maskfab.job.values import PICTURES, PLATE_BITMAPS, FileFormat
from maskfab.mask.comparison.files import ReadBack, read_back
from maskfab.mask.formats.exr import PsfFile, check_psf_file, psf_files
from maskfab.mask.formats.gerber import require_gerbonara
from maskfab.mask.formats.picture import check_pixels
from maskfab.mask.formats.plate_bitmap import check_dots, check_plate_bitmap
from maskfab.mask.formats.table import FORMATS
from maskfab.mask.houses.adaptation import ordered_blank, written_formats
from maskfab.mask.houses.files import PlateFiles, check_plotter, check_polygons, files_of_job, plotted_dpi
from maskfab.mask.houses.findings import check_written
from maskfab.mask.houses.order import check_ordered
from maskfab.mask.houses.profiles import shop_of
from maskfab.mask.job import Job, load_job
from maskfab.mask.judge.verdict import asked
from maskfab.mask.layout import clear_shapes, plate_names
from maskfab.mask.plate_rules import check_plate, judged, limits_as_rules, smallest_features, write_markers
from maskfab.mask.raster import light_box
from maskfab.mask.rule import RuleResult
from maskfab.mask.writer import check_bias, check_process
from maskfab.optics.mtf import area_under_radial_min, worst_directions
from maskfab.optics.scene.plan import Plan
from maskfab.report.documents import die as die_data
from maskfab.report.documents import report as report_data
from maskfab.report.documents.measured import DOCUMENT as MEASURED
from maskfab.report.documents.measured import Beside, measured_beside
from maskfab.report.documents.shape import Document
from maskfab.report.figures import die as die_figures
from maskfab.report.figures import die as written_figures
from maskfab.report.figures import display
from maskfab.report.figures import scene as design_figures
from maskfab.report.figures import scene as scene_figures
from maskfab.report.pages import front, page
from maskfab.report.rows.as_written import Written, measure_written
from maskfab.report.rows.bands import (
    Expansion,
    ProcessSpread,
    band_quantities,
    check_spread,
    restored_bands,
    restored_expansion,
)
from maskfab.report.rows.display import display_quantities, footprint_band
from maskfab.report.rows.optics import (
    layout_as_seen,
    measure_with_bar,
    plate_as_seen,
    reach_box,
    read_openings,
    view_rows,
)
from maskfab.report.rows.photographs import Conditions, Photographs, Restored, Surroundings, photograph_die
from maskfab.report.rows.scene import SceneOptics, measure_scene, peak_bytes, scene_plan, scene_reach_um
from maskfab.report.rows.text import Quantities
from maskfab.report.rows.verdicts import Verdicts
from maskfab.runs.findings import expected
from maskfab.runs.recall import CachingExecutor
from maskfab.runs.store import Origin, Store, fingerprint, give_result, keep_result, of_installation

if TYPE_CHECKING:
    from pandas import DataFrame


MANIFEST_VERSION = 1
UNUSED = "unused_keys"
_NOTES = (UNUSED, "display_seed")
OVERVIEW = "overview.png"
TAKEN = "taken from the cache"
"""Stage of a run that an earlier one had made."""

Found = TypeVar("Found")

_MOST_PLACED = 1000
"""Violations of a rule on a die that the markers place; all are counted."""

_SCENE_BYTES = 6e9
"""As much memory as the scenes of dies that are measured at once may take."""


_FEWEST_SHARED = 4
"""Dies that take longer than starting a process that shares them."""


@dataclass(frozen=True, repr=False)
class Result:
    """Where a finished run is, and what came of it.

    ``result["DIE"]`` are the numbers of a die, ``result["DIE"]["mtf50", 530]`` one of them.

    Attributes:
        directory: of its files.
        report: all that was found out.
        verdicts: whether the plate can be ordered, its optics are proved, and displays fit.
        taken: how many findings earlier runs had kept, and how many there are; None for a run without a cache.
        accounts: where every finding comes from; none for a run without a cache.
    """

    directory: Path
    report: Report
    verdicts: Verdicts
    taken: tuple[int, int] | None = None
    accounts: tuple[Account, ...] = ()

    @property
    def passed(self) -> bool:
        """Whether no check failed."""
        return self.report.passed

    @property
    def origin(self) -> str:
        """Which of its numbers were found in this run, and which earlier ones had kept, in words."""
        since = min((each.since for each in self.accounts if each.kept), default="")
        refused = sum(each.refused is not None for each in self.accounts)
        whole = TAKEN in self.report.seconds
        told = "the whole run" if whole else "{} of {} findings".format(*self.taken or (0, 0))
        more = f", found since {since}" if since else ""
        more += ", its files read back in this run" if whole else ""
        more += f"; {refused} kept findings refused, and found again" if refused else ""
        return f"{told} taken from the cache{more}: see {TIMES}"

    @property
    def checks(self) -> Quantities:
        """Every number that was judged, of dies and plate."""
        return Quantities(self.report.checks)

    @property
    def plate(self) -> Quantities:
        """Numbers of the whole plate."""
        return Quantities(self.report.plate)

    @property
    def notes(self) -> tuple[Quantity, ...]:
        """Notes that a user must see beside the checks: keys of the job that were not used, dies of another seed."""
        every = (*self.report.plate, *(each for die in self.report.dies.values() for each in die))
        return tuple(each for each in every if each.name in _NOTES)

    def __getitem__(self, die: str) -> Quantities:
        if die not in self.report.dies:
            cure = f"Use one of {', '.join(self.report.dies)}"
            raise UnknownNameError("MF432", f"there is no die {die!r}", cure=cure)
        return Quantities(self.report.dies[die])

    def __iter__(self) -> Iterator[str]:
        return iter(self.report.dies)

    def to_dict(self) -> dict[str, Any]:
        """The content of report.json."""
        document: dict[str, Any] = json.loads((self.directory / REPORT).read_text(encoding="utf-8"))
        return document

    def to_dataframe(self) -> DataFrame:
        """One row for each number of each die and of the plate.

        Raises:
            OutputError: MF431 without pandas.
        """
        return self._every.to_dataframe()

    @property
    def _every(self) -> Quantities:
        return Quantities((*(each for die in self.report.dies.values() for each in die), *self.report.plate))

    def __str__(self) -> str:
        return f"{self.directory}\n{self._every}"

    def __repr__(self) -> str:
        return f"<Result in {self.directory}: {', '.join(self.report.dies)}; {'; '.join(self.verdicts.lines)}>"

    def _repr_html_(self) -> str:
        return self._every._repr_html_()


@one_thread
def run(
    job: Job | str | Path,
    out: str | Path,
    *,
    force: bool = False,
    progress: Progress = silent,
    cache: Store | None = None,
) -> Result:
    """Make a plate: lay the job out, write its mask files, read them back, measure them, and report.

    Args:
        job: a loaded job, or the path of a job file.
        out: output directory; it appears when everything in it is complete.
        force: replace an earlier result in ``out``.
        progress: told where the work stands.
        cache: what earlier runs have found, and where this one keeps what it finds; None for a run that finds
            everything itself. The files are the same to the last bit.

    Raises:
        InputError: for bad input, before anything is written.
    """
    job = job if isinstance(job, Job) else load_job(job)
    job.check_window()
    place = check_target(Path(out), force=force)
    named_shop(job)
    measured = measured_beside(job)
    if cache is None or not cache.has(origin_of_run(job, measured)):
        made = _make(job, staged(place), progress, cache, measured)
    else:
        with staged(place) as folder:
            taken = _taken(job, folder, cache, measured, progress)
            made = taken or _make(job, nullcontext(folder), progress, cache, measured)
    return Result(place.asked, made.report, made.verdicts, None if cache is None else made.taken, made.accounts)


def origin_of_run(job: Job, measured: Beside | None) -> Origin:
    """Everything that the files of a run depend on.

    Args:
        job: that asks for it.
        measured: beside it, see :func:`measured_beside`.
    """
    given = run, _job_text(job), *(() if measured is None else (measured.content,))
    return Origin("run", (of_installation(), *map(fingerprint, given)))


@dataclass(frozen=True)
class _Made:
    """A report, verdicts, how many findings of how many were kept, where they come from, and rows of the files as they
    were read back."""

    report: Report
    verdicts: Verdicts
    taken: tuple[int, int]
    accounts: tuple[Account, ...]
    read: tuple[Quantity, ...]


def _taken(job: Job, folder: Path, cache: Store, measured: Beside | None, progress: Progress) -> _Made | None:
    """The result of an earlier run, whose files are now in the folder and were read back from there; None if they are
    lost, damaged, or not what they were."""
    clock, origin = _Clock(), origin_of_run(job, measured)
    with clock.stage(TAKEN):
        kept = give_result(cache, origin, folder, _Made)
    if kept is None:
        return None
    with clock.stage("read back"), executor_of(job, cache) as executor:
        # What is handed out is judged as it lies there, whoever wrote it.
        plate = displays(job, executor=executor).plate
        back = _read_own(draw_files(job, plate), folder, progress)
    made: _Made = kept.value
    if back.quantities != made.read:
        for path in folder.iterdir():
            path.unlink()
        return None
    accounts = tuple(replace(each, kept=True, refused=None) for each in made.accounts)
    (folder / TIMES).write_text(times_text(job.digest, clock.seconds, accounts), encoding="utf-8")
    progress("run taken from the cache", 1, 1)
    return replace(made, report=replace(made.report, seconds=clock.seconds), taken=(1, 1), accounts=accounts)


def _make(
    job: Job,
    aside: AbstractContextManager[Path],
    progress: Progress,
    cache: Store | None,
    measured: Beside | None,
) -> _Made:
    """Every stage, in order; the directory is entered when all is known that could be refused."""
    clock = _Clock()
    with executor_of(job, cache) as executor:
        with clock.stage("layout"), _told("displays", executor, progress):
            plate = job.plate()
            check_processes(job, plate)
            check_pictures(job, plate)
            Conditions.of(job, "camera")  # light that cannot be is refused before dies are worked on
            built = displays(job, plate, progress, executor=executor)
            photographs = begin_photographs(job, plate, executor)
            plate = built.plate
            seen = plate_as_seen(job, plate)
        with clock.stage("draw"):
            made = draw_files(job, plate)
            check_readers(made)
        with clock.stage("plan"):
            plans = plan_scenes(job, seen, progress)
        # Before anything is written, for it takes the most memory, and libraries of solids and what is read back stay.
        with clock.stage("process"), _told("process", executor, progress):
            written = measure_process(job, seen, progress, clock.seconds, executor)
        with aside as folder:
            with clock.stage("write"):
                files = write_files(job, made, folder, progress, measured)
            with clock.stage("read back"):
                back = _read_own(made, folder, progress)
            layout = layout_as_seen(job, back.trips[0].layout)
            with clock.stage("optics"), _told("optics", executor, progress):
                optics = measure_dies(seen, job.camera, layout, progress, clock.seconds, job.blank, executor)
                psfs = psfs_as_files(job, made, optics)
                files += write_psfs(psfs, folder)
            with clock.stage("scene"), _told("scene", executor, progress):
                scenes = measure_scenes(job, seen, plans, layout, progress, clock.seconds, executor)
            read_psfs = [quantity for psf in psfs for quantity in check_psf_file(psf, folder)]
            read = (*back.quantities, *read_psfs, *made.account(), *shop_quantities(job, made))
            restored, changes = (
                photographs.result(progress, clock.seconds),
                _changes(job, seen, progress, clock, executor),
            )
            found = Findings(job, built, read, optics, scenes, restored, written, changes, measured)
            report = found.report(files, clock.seconds)
            with clock.stage("figures"), _told("figures", executor, progress):
                progress("figures", 0, 1)
                document = found.document(report)
                overview, pictures = draw_pictures(found, document, executor)
                progress("figures", 1, 1)
            document = found.document(report)
            (folder / OVERVIEW).write_bytes(overview)
            (folder / REPORT).write_text(report_data.report_text(document), encoding="utf-8")
            (folder / PAGE).write_text(page.html_page(document, pictures), encoding="utf-8")
            _write_manifest(job, files, folder)
            result = _Made(report, found.verdicts(report), executor.tally, _accounts(executor), back.quantities)
            (folder / TIMES).write_text(times_text(job.digest, clock.seconds, result.accounts), encoding="utf-8")
            if cache is not None:
                keep_result(cache, origin_of_run(job, measured), folder, result, _Made)
    return result


def _accounts(executor: SerialExecutor) -> tuple[Account, ...]:
    return executor.accounts if isinstance(executor, CachingExecutor) else ()


def _changes(
    job: Job, plate: Plate, progress: Progress, clock: _Clock, executor: SerialExecutor
) -> dict[str, Expansion | str]:
    with clock.stage("tolerance"), _told("tolerance", executor, progress):
        return expand_photographs(job, plate, progress, clock.seconds, executor)


@contextmanager
def _told(stage: str, executor: SerialExecutor, progress: Progress) -> Iterator[None]:
    """Tell how much of a stage was kept, once it is done."""
    taken, asked = executor.tally
    yield
    now, of = executor.tally
    if now > taken:
        progress(f"{stage} taken from the cache", now - taken, of - asked)


def executor_of(job: Job, cache: Store | None = None) -> SerialExecutor:
    """Who makes a plate: two processes where there are two processors, and dies enough to be worth starting one.

    Args:
        job: asks for it.
        cache: what they need not find, and where they keep what they find.
    """
    shared = (os.cpu_count() or 1) > 1 and len(job.spec.die) >= _FEWEST_SHARED
    executor = ProcessExecutor() if shared else SerialExecutor()
    return executor if cache is None else CachingExecutor(executor, cache, expected)


@dataclass(frozen=True, eq=False)
class Findings:
    """All that was found out about a plate.

    Attributes:
        job: that asks for it.
        built: the plate, and its displays.
        read: rows of what reading files back has shown, and the shop's rules.
        optics: of every die.
        scenes: through every die; none for a job without a scene.
        restored: photographs through all dies.
        written: dies as their writer makes them, by name.
        changes: of restored photographs over the spread of the process, by die; none without a spread.
        measured: the measurement beside the job; None if there is none.
    """

    job: Job
    built: PlateWithDisplays
    read: Sequence[Quantity]
    optics: Sequence[DieOptics]
    scenes: Sequence[SceneOptics]
    restored: Photographs
    written: Mapping[str, Written]
    changes: Mapping[str, Expansion | str]
    measured: Beside | None = None

    @property
    def plate(self) -> Plate:
        """With its displays."""
        return self.built.plate

    def report(self, files: tuple[WrittenFile, ...], seconds: dict[str, float]) -> Report:
        """Everything gathered; every judged quantity is also a check."""
        job, built = self.job, self.built
        of_dies = {item.die.name: die_quantities(item, self.read, job) for item in self.optics}
        of_plate = tuple(quantity for quantity in self.read if quantity.die is None)
        for die in built.plate.dies:
            if die.name in built.displays and die.name in of_dies:
                of_dies[die.name] += display_quantities(die, built.displays[die.name], job.camera)
                of_dies[die.name] += self._of_footprint(die)
        for name in self.restored.dies:
            of_dies[name] += self.restored.quantities(name)
        for name, process in self.written.items():
            of_dies[name] += process.quantities
        if job.spec.written is not None:
            for name in self.changes:
                of_process = job.spec.written, process_spread(job)
                of_dies[name] += tuple(restored_bands(self.restored, name, self.changes, *of_process))
        for notes in (die_data.camera_notes(job), job.seed_notes):
            for name, note in notes.items():
                if name in of_dies:
                    of_dies[name] += (note,)
        of_plate += (*view_rows(job), *_unused_row(job))
        if self.measured is not None:
            of_plate += self.measured.note(job.digest)
        everything = [*of_plate]
        of_scenes = {scene.die.name: scene.quantities for scene in self.scenes}
        for name, quantities in of_dies.items():
            everything += [*quantities, *of_scenes.get(name, ())]
        checks = tuple(quantity for quantity in everything if quantity.passed is not None)
        return Report(built.plate.title, job.digest, job.seeds, of_dies, of_plate, checks, files, seconds)

    def _of_footprint(self, die: Die) -> tuple[Quantity, ...]:
        """The band of a die's emitters over the spread of the process."""
        rules, process = display_rules(self.job), self.job.spec.written
        if rules is None or process is None:
            return ()
        return footprint_band(die, self.built.displays[die.name], rules.emitters, process, process_spread(self.job))

    def verdicts(self, report: Report) -> Verdicts:
        """On the plate."""
        return Verdicts.of(report.checks, self.built.displays, len(self.plate.dies))

    def document(self, report: Report) -> Document:
        """The content of report.json."""
        designs = {
            name: die_data.stated_design(said, self.restored.conditions.levels, self.restored.dies.get(name))
            for name, said in die_data.stated(self.job).items()
        }
        photographs = die_data.photographs_document(self.restored)
        return report_data.to_document(
            report, self.plate, self.job.camera, self.scenes, self.built.displays, designs, photographs,
            self._of_dies(), self._expected_s(), process_spread(self.job), self.job.spec.written,
        )  # fmt: skip

    def _expected_s(self) -> dict[str, dict[str, float]]:
        """Seconds that the models of every die are expected to take, by constants: equal runs tell equal numbers."""
        around = Surroundings.of(self.job)
        known: dict[str, dict[str, float]] = {}
        for optics in self.optics:
            die = optics.die
            models = {
                "optics": expected(measure_with_bar, (die, self.job.camera)),
                "written": expected(measure_written, ()) if die.name in self.written else None,
                "photographs": expected(photograph_die, (self.restored.conditions, around)),
            }
            known[die.name] = {name: seconds for name, seconds in models.items() if seconds}
        return known

    def _of_dies(self) -> dict[str, Document]:
        """The measurement, by the die that it is of."""
        names = () if self.measured is None else [die.name for die in self.plate.dies]
        told = {name: self.measured.of_die(name, self.job.digest) for name in names if self.measured is not None}
        return {name: document for name, document in told.items() if document is not None}


def draw_files(job: Job, plate: Plate, version: str = __version__) -> PlateFiles:
    """The files that a job's plate becomes, and what they are held against; the optics come from the first.

    Args:
        job: a loaded job.
        plate: as :meth:`maskfab.mask.job.Job.plate` lays it out.
        version: of maskfab that signs it.
    """
    shop = named_shop(job)
    made = files_of_job(plate, job.spec, [job.signature, plate.title], shop)
    return replace(made, asked=asked(job.spec, shop, version=version))


def write_files(
    job: Job, made: PlateFiles, folder: Path, progress: Progress, measured: Beside | None = None
) -> tuple[WrittenFile, ...]:
    """Write the files of a plate, and those of :func:`aids`."""
    steps: dict[str, tuple[str, Callable[[Path], object]]] = {
        **{product.name: (product.form.title, product.write) for product in made.products},
        **aids(job, made.plate, measured),
    }
    for done, (name, (_, write)) in enumerate(steps.items()):
        progress("write files", done, len(steps))
        write(folder / name)
        release_memory()
    progress("write files", len(steps), len(steps))
    return tuple(provenance.file_record(folder, folder / name, kind) for name, (kind, _) in steps.items())


def _read_own(made: PlateFiles, folder: Path, progress: Progress) -> ReadBack:
    """The files of a folder read back, of a run that wrote them and of one that took them from the cache.

    Raises:
        InternalError: MF324 for a damaged one, which is no fault of the input.
    """
    try:
        return read_back(made, folder, progress)
    except SourceError as error:
        if error.code != "MF303":
            raise
        what = f"a mask file that was just written cannot be read back: {error.what}"
        raise InternalError("MF324", what, where=error.where, cure="Please report this with the job file") from error


def aids(job: Job, plate: Plate, measured: Beside | None = None) -> dict[str, tuple[str, Callable[[Path], object]]]:
    """Auxiliary files of a plate, title and writer: markers of its rules, KLayout's colours, the resolved job, and the
    measurement beside it, which is then beside the job that is kept."""
    more = {} if measured is None else {MEASURED: ("measurement", lambda path: path.write_bytes(measured.content))}
    return {
        **more,
        f"{plate.name}.lyrdb": (
            "KLayout markers",
            lambda path: write_markers(check_rules(job, plate), plate_names(plate).top, path),
        ),
        "layers.lyp": (
            "KLayout layer properties",
            lambda path: shutil.copyfile(resources.path("export_templates/layers.lyp"), path),
        ),
        JOB_COPY: (
            "resolved job",
            lambda path: path.write_text(_job_text(job), encoding="utf-8"),
        ),
    }


def _job_text(job: Job) -> str:
    return json.dumps(job.spec.dump(), indent=1) + "\n"


def psfs_as_files(
    job: Job, made: PlateFiles, optics: Sequence[DieOptics], version: str = __version__
) -> tuple[PsfFile, ...]:
    """The PSFs of the report as files, if the job asks for EXR: they need what is measured in the files before them."""
    if "exr" not in made.formats:
        return ()
    return psf_files(job, made.plate, optics, made.products[0].name, version)


def write_psfs(psfs: Sequence[PsfFile], folder: Path) -> tuple[WrittenFile, ...]:
    """Write PSFs beside the files that they were measured in."""
    for psf in psfs:
        psf.write(folder / psf.name)
    return tuple(provenance.file_record(folder, folder / psf.name, FORMATS["exr"].title) for psf in psfs)


def measure_dies(
    plate: Plate,
    camera: Camera,
    layout: db.Layout,
    progress: Progress,
    seconds: dict[str, float] | None = None,
    blank: MaskBlank = UNSTATED,
    executor: SerialExecutor | None = None,
) -> list[DieOptics]:
    """The optics of every die from a layout that was read back of a plate made of ``blank``, and what they leave out.

    Every sum is done in one order, by one thread, which makes equal runs equal to the last bit. The time of every die
    is added to ``seconds``.
    """
    masks = [_mask(die) for die in plate.dies]

    def given(die: Die) -> ArgumentsFactory:
        return lambda: (die, camera, clear_shapes(layout, light_box(die, camera.stop)), blank)

    progress("optics", 0, len(masks))
    calls = [(measure_with_bar, given(die)) for die in masks]
    tasks = (executor or SerialExecutor()).run_all(calls, lambda done: progress("optics", done, len(masks)))
    for die, task in zip(masks, tasks, strict=True):
        if seconds is not None:
            seconds[f"optics {die.name}"] = round(task.seconds, 3)
    return [replace(task.result(), die=die) for die, task in zip(masks, tasks, strict=True)]


def plan_scenes(job: Job, plate: Plate, progress: Progress) -> dict[str, Plan]:
    """Plans of the job's scene, by die; nothing for a job without one.

    Raises:
        JobError: MF114 or MF115 if the scene cannot be modelled for a die.
    """
    scene, section = job.scene, job.spec.scene
    if scene is None or section is None:
        return {}

    def one(die: Die) -> Plan:
        return scene_plan(_mask(die), job.camera, scene, section.accuracy, job.where)

    plans = _each(plate.dies, one, "plan", progress, None, os.cpu_count() or 1)
    return {die.name: plan for die, plan in zip(plate.dies, plans, strict=True)}


def measure_scenes(
    job: Job,
    plate: Plate,
    plans: Mapping[str, Plan],
    layout: db.Layout,
    progress: Progress,
    seconds: dict[str, float] | None = None,
    executor: SerialExecutor | None = None,
) -> list[SceneOptics]:
    """The job's scene through every die, as :func:`measure_dies` does it; none for a job without a scene."""
    scene, camera = job.scene, job.camera
    if scene is None:
        return []
    reach, run = scene_reach_um(camera, scene), (executor or SerialExecutor()).run

    def one(die: Die) -> SceneOptics:
        shapes = clear_shapes(layout, reach_box(die, reach))
        mask = _mask(die)
        openings = read_openings(mask, shapes, reach)
        return run(measure_scene, mask, camera, scene, openings, plans[die.name], job.blank)

    peak = max((peak_bytes(die, camera, scene, plans[die.name]) for die in plate.dies), default=0.0)
    workers = int(min(os.cpu_count() or 1, max(1, _SCENE_BYTES // max(peak, 1.0))))
    return _each(plate.dies, one, "scene", progress, seconds, workers)


def check_rules(job: Job, plate: Plate) -> tuple[RuleResult, ...]:
    """Corners that only touch, and what is narrower than the job's limits, on the whole plate."""
    return check_plate(plate, limits_as_rules(job.spec.limits), most=_MOST_PLACED)


def named_shop(job: Job) -> Shop | None:
    """The mask house that the job names; None if it names none.

    Raises:
        OutputError: MF420 if there is no such house, MF421 if its profile is malformed.
    """
    return shop_of(job.spec, job.where)


def shop_quantities(job: Job, made: PlateFiles) -> tuple[Quantity, ...]:
    """The rules of the mask house that the job names, each a check of the files as drawn; none if it names none.

    Raises:
        OutputError: MF420 or MF421 as of :func:`named_shop`.
    """
    shop = named_shop(job)
    if shop is None:
        return ()
    found = check_written(made.figures, shop, made.formats, ordered_blank(job.spec))
    # What dots do to edges are rows of their own, with or without a house.
    plotter = check_plotter(made.plate, job.spec, shop, made.formats)
    dots = (each for each in plotter if each.rule != "edge_error")
    return tuple(
        each.quantity(shop.name) for each in check_ordered((*found, *dots), job.spec, made.plate, made.plate, shop)
    )


def check_processes(job: Job, plate: Plate) -> None:
    """Refuse a [process] that the dots of a die do not bear, or biased data of it, before anything is drawn.

    Raises:
        JobError: MF104 or MF127.
    """
    if job.spec.written is not None:
        for die in plate.dies:
            place = f"{job.where}: process, die {die.name}"
            check_process(job.spec.written, die.panel, place)
            check_spread(job.spec.written, process_spread(job), die.panel, place)
    if job.spec.data_bias_nm:
        check_bias(plate, job.spec.data_bias_nm, f"{job.where}: process.cd_bias")


def check_pictures(job: Job, plate: Plate, formats: Sequence[FileFormat] | None = None) -> None:
    """Refuse pixels and dots that are larger than the smallest feature of a die, dots of which there are too many, and
    either of biased data, before anything is drawn.

    Args:
        job: whose plate it is.
        plate: its dies.
        formats: to be written; by default those of the job.

    Raises:
        JobError: MF104, MF128.
        OutputError: MF415.
    """
    section, shop = job.spec.export or ExportSection(), named_shop(job)
    written = written_formats(section, shop) if formats is None else formats
    if not set(PICTURES).isdisjoint(written):
        check_pixels(plate.dies, section.dots_per_um, job.where)
    dpi = plotted_dpi(section, shop)
    check_polygons(job.spec, written, job.where)
    asked = [each for each in PLATE_BITMAPS if each in written]
    if dpi is not None and asked:
        check_dots(plate.dies, dpi, job.where)
        for each in asked:
            check_plate_bitmap(plate, each, dpi, plate.name + FORMATS[each].tail)


def check_readers(made: PlateFiles) -> None:
    """Refuse files that this installation could not read back, before any is written.

    Raises:
        SourceError: MF308.
    """
    if "gerber" in made.formats:
        require_gerbonara(made.plate.name)


def measure_process(
    job: Job,
    plate: Plate,
    progress: Progress,
    seconds: dict[str, float] | None = None,
    executor: SerialExecutor | None = None,
) -> dict[str, Written]:
    """Optics of every die as written, by the job's [process], with bands over its spread; nothing without a process.

    Raises:
        JobError: MF104, MF127 or MF115 for a process that does not go with a die.
    """
    process, run = job.spec.written, (executor or SerialExecutor()).run
    if process is None:
        return {}

    spread = process_spread(job)

    def one(die: Die) -> Written:
        written = run(measure_written, _mask(die), job.camera, process, job.where)
        bands = run(band_quantities, written, job.camera, spread, job.spec.frequencies_cy_per_mm, job.where)
        return replace(written, quantities=(*written.quantities, *bands))

    # One after another: a die takes up to a gigabyte.
    found = _each(plate.dies, one, "process", progress, seconds, 1)
    return {die.name: written for die, written in zip(plate.dies, found, strict=True)}


def expand_photographs(
    job: Job,
    plate: Plate,
    progress: Progress,
    seconds: dict[str, float] | None = None,
    executor: SerialExecutor | None = None,
) -> dict[str, Expansion | str]:
    """Changes of restored photographs over the spread of the job's [process], by die; none without a spread.

    Raises:
        JobError: MF140, MF141 for a sensor or a light that cannot be.
    """
    process, spread = job.spec.written, process_spread(job)
    if process is None or not spread:
        return {}
    conditions, around = Conditions.of(job, "camera"), Surroundings.of(job)

    def given(die: Die) -> ArgumentsFactory:
        return lambda: (conditions, around, _mask(die), process, spread, job.where)

    progress("tolerance", 0, len(plate.dies))
    calls = [(restored_expansion, given(die)) for die in plate.dies]
    tasks = (executor or SerialExecutor()).run_all(calls, lambda done: progress("tolerance", done, len(plate.dies)))
    if seconds is not None:
        for die, task in zip(plate.dies, tasks, strict=True):
            seconds[f"tolerance {die.name}"] = round(task.seconds, 3)
    return {die.name: task.result() for die, task in zip(plate.dies, tasks, strict=True)}


def process_spread(job: Job) -> ProcessSpread:
    """Standard deviations of the job's process over the displays that are made; zeros where it states none."""
    stated = None if job.spec.process is None else job.spec.process.spread
    return ProcessSpread() if stated is None else ProcessSpread(stated.bias or 0.0, stated.radius or 0.0)


@dataclass(frozen=True)
class Begun:
    """Photographs that are being taken.

    Attributes:
        conditions: of all.
        tasks: by die.
        reference: die that the job names as such.
        executor: takes them.
    """

    conditions: Conditions
    tasks: Mapping[str, Task[Restored]]
    reference: str | None
    executor: SerialExecutor

    def result(self, progress: Progress, seconds: dict[str, float] | None = None) -> Photographs:
        """All of them; the time of every die is added to ``seconds``."""
        dies = {}
        with _told("photographs", self.executor, progress):
            for done, (name, task) in enumerate(self.tasks.items()):
                progress("photographs", done, len(self.tasks))
                dies[name] = task.result()
                if seconds is not None:
                    seconds[f"photographs {name}"] = round(task.seconds, 3)
            progress("photographs", len(dies), len(dies))
        return Photographs(self.conditions, dies, self.reference)


def begin_photographs(job: Job, plate: Plate, executor: SerialExecutor) -> Begun:
    """Photographs through the dies of a plate, which need nothing of its files.

    Raises:
        JobError: MF140 or MF141 for a sensor or a light that cannot be.
    """
    conditions, around, shown = Conditions.of(job, "camera"), Surroundings.of(job), die_data.stated(job)

    def given(die: Die) -> ArgumentsFactory:
        return lambda: (conditions, around, die.name, die.panel, die.name in shown)

    dies = plate_as_seen(job, plate).dies
    reference = None if job.spec.report is None else job.spec.report.reference
    return Begun(
        conditions, {die.name: executor.submit(photograph_die, given(die)) for die in dies}, reference, executor
    )


def _unused_row(job: Job) -> Iterator[Quantity]:
    """Note on all that a job states and a run does not use; none where it uses everything."""
    names = unused(job.spec, *USES["run"], *(USES["run for a house"] if named_shop(job) is not None else ()))
    if names:
        yield Quantity(UNUSED, ", ".join(names), "of the job: no file and no number here depends on it")


def _mask(die: Die) -> Die:
    """The die as it is on the plate, whose chrome knows no wires."""
    return replace(die, panel=replace(die.panel, tracks=()))


def _each(
    dies: Sequence[Die],
    one: Callable[[Die], Found],
    stage: str,
    progress: Progress,
    seconds: dict[str, float] | None,
    workers: int,
) -> list[Found]:
    """A result for every die, some dies at once, and the time that each took."""
    progress(stage, 0, len(dies))
    results: list[Found] = []

    def timed(die: Die) -> Found:
        start = time.perf_counter()
        result = one(die)
        if seconds is not None:
            seconds[f"{stage} {die.name}"] = round(time.perf_counter() - start, 3)
        return result

    with ThreadPoolExecutor(workers) as pool:
        for result in pool.map(timed, dies):
            results.append(result)
            release_memory()
            progress(stage, len(results), len(dies))
    return results


def draw_pictures(
    found: Findings, document: Document, executor: SerialExecutor
) -> tuple[bytes, Mapping[str, Mapping[str, str]]]:
    """The picture of the whole plate, as PNG, and every figure of the report, by die and figure, of the dies that it
    shows."""
    Figures, built = die_figures.Figures, found.built
    designs, drawn = {die["name"]: die for die in document["dies"]}, frozenset(front.shown_dies(document))
    more = [
        Figures(scene.die.name, scene_figures.pictures, (scene,)) for scene in found.scenes if scene.die.name in drawn
    ]
    more += _front_figures(found.restored, document)
    for die in found.plate.dies:
        name = die.name
        if name not in drawn:
            continue
        if name in built.displays:
            more.append(Figures(name, display.pictures, (die.panel, built.displays[name])))
        if "design" in designs[name]:
            more.append(Figures(name, design_figures.photograph_pictures, (found.restored.dies[name],)))
        if name in found.written:
            more.append(Figures(name, written_figures.written_pictures, (found.written[name],)))
    shown, best = _most_invertible(found.optics), front.best(document)
    overview = executor.submit(die_figures.overview, lambda: (found.plate, document, shown))
    stressed = () if isinstance(best, str) else best.shown
    optics = [item for item in found.optics if item.die.name in drawn]
    pictures = die_figures.pictures(found.plate, optics, document, more, executor, stressed)
    return overview.result(), pictures


def _front_figures(restored: Photographs, document: Document) -> Iterator[die_figures.Figures]:
    """The truth, and what the reference and the best die make of it."""
    best = front.best(document)
    if isinstance(best, str):
        return
    yield die_figures.Figures(die_figures.PLATE, design_figures.truth, (restored.dies[best.name],))
    for name, _ in front.crops(document, best):
        yield die_figures.Figures(name, design_figures.front, (restored.dies[name], best.level_db))


def die_quantities(item: DieOptics, read: Sequence[Quantity], job: Job) -> tuple[Quantity, ...]:
    """All numbers of one die: optics, what reading back has shown, and features, judged by the job's own limits."""
    name = item.die.name
    shown = (quantity for quantity in read if quantity.die == name)
    frequencies = job.spec.frequencies_cy_per_mm
    worst = (each for mtf in item.mtfs for each in worst_directions(mtf, frequencies, name))
    every = (*item.quantities, *worst, *shown, *smallest_features(item.die))
    return tuple(judged(quantity, job.spec.limits) for quantity in every)


def _most_invertible(optics: Sequence[DieOptics]) -> DieOptics:
    """The die whose radial-minimum MTF is highest on average over the wavelengths."""
    return max(optics, key=lambda item: sum(area_under_radial_min(mtf) for mtf in item.mtfs))


def _write_manifest(job: Job, files: Sequence[WrittenFile], folder: Path) -> None:
    reports = [provenance.file_record(folder, folder / name, "report") for name in (REPORT, PAGE, OVERVIEW)]
    manifest = {
        "schema_version": MANIFEST_VERSION,
        "maskfab_version": __version__,
        "job_hash": job.digest,
        "seeds": job.seeds,
        "provenance": TIMES,
        "versions": provenance.versions(),
        "files": [vars(file) for file in (*files, *reports)],
    }
    (folder / RESULT_MARK).write_text(json.dumps(manifest, indent=1) + "\n", encoding="utf-8")


@dataclass
class _Clock:
    """Wall-clock time by stage."""

    seconds: dict[str, float] = field(default_factory=dict)

    @contextmanager
    def stage(self, name: str) -> Iterator[None]:
        start = time.perf_counter()
        yield
        self.seconds[name] = round(time.perf_counter() - start, 3)
