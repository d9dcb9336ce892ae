"""The stages of a run that find something about every die, each by an executor that may know it already."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from functools import partial
from typing import Any

from klayout import db

from maskfab.base.findings import expected, task_bytes
from maskfab.base.model import Die, DieOptics, Plate, Quantity
from maskfab.base.processes import ArgumentsFactory, Call, Found, SerialExecutor, Task
from maskfab.base.work import Progress
from maskfab.base.workers import EVERY_CORE, Workers
from maskfab.findings.as_written import Written, measure_written
from maskfab.findings.bands import Expansion, band_quantities, restored_expansion
from maskfab.findings.optics import measure_with_bar, plate_as_seen, reach_box, read_openings
from maskfab.findings.photographs import Conditions, Photographs, Restored, Surroundings, photograph_die
from maskfab.findings.scene import SceneOptics, measure_scene, scene_plan, scene_reach_um
from maskfab.job.camera import Camera
from maskfab.job.process import UNSTATED, MaskBlank
from maskfab.mask.job import Job
from maskfab.mask.layout import clear_shapes
from maskfab.mask.raster import light_box
from maskfab.optics.scene.plan import Plan
from maskfab.report.documents import die as die_data
from maskfab.runs.plate_files import process_spread
from maskfab.runs.recall import CachingExecutor
from maskfab.runs.store import Store

MIN_DIES_TO_FORK = 4
"""Dies that take longer than starting a process that shares them."""


def executor_of(job: Job, cache: Store | None = None, workers: Workers = EVERY_CORE) -> SerialExecutor:
    """Who makes a plate: this process alone where its dies are too few to be worth starting another."""
    executor = workers.executor(tasks_at_once(job))
    return executor if cache is None else CachingExecutor(executor, cache, expected)


def tasks_at_once(job: Job) -> int:
    """Tasks of a plate that are worth a process: a die is photographed while another one is measured."""
    dies = len(job.spec.die)
    return 1 if dies < MIN_DIES_TO_FORK else 2 * dies


@contextmanager
def report_cache_hits(stage: str, executor: SerialExecutor, progress: Progress) -> Iterator[None]:
    """Tell how much of a stage was kept, once it is done."""
    taken, asked = executor.tally
    yield
    now, of = executor.tally
    if now > taken:
        progress(f"{stage} taken from the cache", now - taken, of - asked)


def measure_dies(
    plate: Plate,
    camera: Camera,
    layout: db.Layout,
    progress: Progress,
    seconds: dict[str, float] | None = None,
    blank: MaskBlank = UNSTATED,
    executor: SerialExecutor | None = None,
    then: Callable[[DieOptics], None] | None = None,
) -> list[DieOptics]:
    """The optics of every die from a layout that was read back of a plate made of ``blank``, and what they leave out.

    Every sum is done in one order, by one thread, which makes equal runs equal to the last bit. The time of every die
    is added to ``seconds``; ``then`` is told of each as soon as it is known, by any thread.
    """

    def call(die: Die) -> Call[DieOptics]:
        known, box = (_mask(die), camera), light_box(die, camera.stop)
        call = _call(measure_with_bar, lambda: (*known, clear_shapes(layout, box), blank), known)
        return replace(call, then=then)

    optics = _by_tasks("optics", call, plate.dies, progress, seconds, executor)
    return [replace(item, die=_mask(die)) for die, item in zip(plate.dies, optics, strict=True)]


def expand_photographs(
    job: Job,
    plate: Plate,
    progress: Progress,
    seconds: dict[str, float] | None = None,
    executor: SerialExecutor | None = None,
) -> dict[str, Expansion | str]:
    """Changes of restored photographs over the spread of the job's [process], by die; none without a spread. Raises
    JobError MF140, MF141 for a sensor or a light that cannot be."""
    process, spread = job.spec.written, process_spread(job)
    if process is None or not spread:
        return {}
    conditions, around = Conditions.of(job, "camera"), Surroundings.of(job)

    def call(die: Die) -> Call[Expansion | str]:
        given = conditions, around, _mask(die), process, spread, job.where
        return _call(restored_expansion, lambda: given, given)

    changes = _by_tasks("tolerance", call, plate.dies, progress, seconds, executor)
    return {die.name: change for die, change in zip(plate.dies, changes, strict=True)}


def _call(function: Callable[..., Found], given: ArgumentsFactory, known: tuple[Any, ...]) -> Call[Found]:
    """A call whose time and memory follow from those of its arguments that are known before it begins."""
    return Call(function, given, expected(function, known), task_bytes(function, known))


def _by_tasks(
    stage: str,
    call: Callable[[Die], Call[Found]],
    dies: Sequence[Die],
    progress: Progress,
    seconds: dict[str, float] | None,
    executor: SerialExecutor | None,
) -> list[Found]:
    """Findings about every die, by whichever process, and the time that each took."""
    progress(stage, 0, len(dies))
    calls = [call(die) for die in dies]
    tasks = (executor or SerialExecutor()).run_all(calls, lambda done: progress(stage, done, len(dies)))
    if seconds is not None:
        for die, task in zip(dies, tasks, strict=True):
            key = f"{stage} {die.name}"
            seconds[key] = round(seconds.get(key, 0.0) + task.seconds, 3)
    return [task.result() for task in tasks]


@dataclass(frozen=True)
class PendingPhotographs:
    """Photographs being taken, tasks by die; the reference as the job names it."""

    conditions: Conditions
    tasks: Mapping[str, Task[Restored]]
    reference: str | None
    executor: SerialExecutor

    def result(self, progress: Progress, seconds: dict[str, float] | None = None) -> Photographs:
        """Every photograph; the time of every die is added to ``seconds``."""
        dies = {}
        with report_cache_hits("photographs", self.executor, progress):
            for done, (name, task) in enumerate(self.tasks.items()):
                progress("photographs", done, len(self.tasks))
                dies[name] = task.result()
                if seconds is not None:
                    seconds[f"photographs {name}"] = round(task.seconds, 3)
            progress("photographs", len(dies), len(dies))
        return Photographs(self.conditions, dies, self.reference)


def begin_photographs(
    job: Job, plate: Plate, executor: SerialExecutor, then: Callable[[str, Restored], None] = lambda *_: None
) -> PendingPhotographs:
    """Photographs through the dies of a plate, which need nothing of its files; ``then`` is told of each die's as soon
    as they are known, by any thread. Raises JobError MF140 or MF141 for a sensor or a light that cannot be."""
    conditions, around, shown = Conditions.of(job, "camera"), Surroundings.of(job), die_data.stated(job)

    def call(die: Die) -> Call[Restored]:
        given = conditions, around, die.name, die.panel, die.name in shown
        return replace(_call(photograph_die, lambda: given, given), then=partial(then, die.name))

    dies = plate_as_seen(job, plate).dies
    reference = None if job.spec.report is None else job.spec.report.reference
    return PendingPhotographs(conditions, {die.name: executor.submit(call(die)) for die in dies}, reference, executor)


def plan_scenes(job: Job, plate: Plate, progress: Progress) -> dict[str, Plan]:
    """Plans of the job's scene, by die; nothing for a job without one. Raises JobError MF114 or MF115 if the scene
    cannot be modelled for a die."""
    scene, section = job.scene, job.spec.scene
    if scene is None or section is None:
        return {}

    plans = {}
    for done, die in enumerate(plate.dies):
        progress("plan", done, len(plate.dies))
        plans[die.name] = scene_plan(_mask(die), job.camera, scene, section.accuracy, job.where)
    progress("plan", len(plans), len(plate.dies))
    return plans


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
    reach = scene_reach_um(camera, scene)

    def call(die: Die) -> Call[SceneOptics]:
        mask, plan = _mask(die), plans[die.name]

        def given() -> tuple[Any, ...]:
            openings = read_openings(mask, clear_shapes(layout, reach_box(die, reach)), reach)
            return mask, camera, scene, openings, plan, job.blank

        return _call(measure_scene, given, (mask, camera, scene, None, plan))

    return _by_tasks("scene", call, plate.dies, progress, seconds, executor)


def measure_process(
    job: Job,
    plate: Plate,
    progress: Progress,
    seconds: dict[str, float] | None = None,
    executor: SerialExecutor | None = None,
) -> dict[str, Written]:
    """Optics of every die as written, by the job's [process], with bands over its spread; nothing without a process."""
    process = job.spec.written
    if process is None:
        return {}
    spread, dies = process_spread(job), plate.dies

    def write(die: Die) -> Call[Written]:
        given = _mask(die), job.camera, process, job.where
        return _call(measure_written, lambda: given, given)

    written = dict(zip(dies, _by_tasks("process", write, dies, progress, seconds, executor), strict=True))

    def band(die: Die) -> Call[tuple[Quantity, ...]]:
        given = written[die], job.camera, spread, job.spec.frequencies_cy_per_mm, job.where
        return _call(band_quantities, lambda: given, given)

    bands = _by_tasks("process", band, dies, progress, seconds, executor)
    return {
        die.name: replace(written[die], quantities=(*written[die].quantities, *more))
        for die, more in zip(dies, bands, strict=True)
    }


def _mask(die: Die) -> Die:
    """The die as it is on the plate, whose chrome knows no wires."""
    return replace(die, panel=replace(die.panel, tracks=()))
