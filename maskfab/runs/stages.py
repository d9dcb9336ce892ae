"""The stages of a run that find something about every die, each by an executor that may know it already.

Dies that are plain to hand over are found by all processes; those that need an open layout, by threads.
"""

from __future__ import annotations

import os
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from dataclasses import dataclass, replace
from functools import partial
from typing import Any

from klayout import db

from maskfab.base.findings import expected
from maskfab.base.model import Die, DieOptics, Plate
from maskfab.base.processes import ArgumentsFactory, Found, ProcessExecutor, SerialExecutor, Task, release_memory
from maskfab.base.work import Progress
from maskfab.job.camera import Camera
from maskfab.job.process import UNSTATED, MaskBlank
from maskfab.mask.job import Job
from maskfab.mask.layout import clear_shapes
from maskfab.mask.raster import light_box
from maskfab.optics.scene.plan import Plan
from maskfab.report.documents import die as die_data
from maskfab.report.rows.as_written import Written, measure_written
from maskfab.report.rows.bands import Expansion, band_quantities, restored_expansion
from maskfab.report.rows.optics import measure_with_bar, plate_as_seen, reach_box, read_openings
from maskfab.report.rows.photographs import Conditions, Photographs, Restored, Surroundings, photograph_die
from maskfab.report.rows.scene import SceneOptics, measure_scene, peak_bytes, scene_plan, scene_reach_um
from maskfab.runs.plate_files import process_spread
from maskfab.runs.recall import CachingExecutor
from maskfab.runs.store import Store

_SCENE_BYTES = 6e9
"""As much memory as the scenes of dies that are measured at once may take."""
MIN_DIES_TO_FORK = 4
"""Dies that take longer than starting a process that shares them."""


def executor_of(job: Job, cache: Store | None = None) -> SerialExecutor:
    """Who makes a plate: two processes where there are two processors, and dies enough to be worth starting one.

    Args:
        job: asks for it.
        cache: what they need not find, and where they keep what they find.
    """
    shared = (os.cpu_count() or 1) > 1 and len(job.spec.die) >= MIN_DIES_TO_FORK
    executor = ProcessExecutor() if shared else SerialExecutor()
    return executor if cache is None else CachingExecutor(executor, cache, expected)


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
) -> list[DieOptics]:
    """The optics of every die from a layout that was read back of a plate made of ``blank``, and what they leave out.

    Every sum is done in one order, by one thread, which makes equal runs equal to the last bit. The time of every die
    is added to ``seconds``.
    """

    def given(die: Die) -> tuple[Any, ...]:
        return _mask(die), camera, clear_shapes(layout, light_box(die, camera.stop)), blank

    optics = _by_tasks("optics", measure_with_bar, plate.dies, given, progress, seconds, executor)
    return [replace(item, die=_mask(die)) for die, item in zip(plate.dies, optics, strict=True)]


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

    def given(die: Die) -> tuple[Any, ...]:
        return conditions, around, _mask(die), process, spread, job.where

    changes = _by_tasks("tolerance", restored_expansion, plate.dies, given, progress, seconds, executor)
    return {die.name: change for die, change in zip(plate.dies, changes, strict=True)}


def _by_tasks(
    stage: str,
    function: Callable[..., Found],
    dies: Sequence[Die],
    given: Callable[[Die], tuple[Any, ...]],
    progress: Progress,
    seconds: dict[str, float] | None,
    executor: SerialExecutor | None,
) -> list[Found]:
    """Findings of a function about every die, by whichever process, and the time that each took."""
    progress(stage, 0, len(dies))
    calls = [(function, partial(given, die)) for die in dies]
    tasks = (executor or SerialExecutor()).run_all(calls, lambda done: progress(stage, done, len(dies)))
    if seconds is not None:
        seconds |= {f"{stage} {die.name}": round(task.seconds, 3) for die, task in zip(dies, tasks, strict=True)}
    return [task.result() for task in tasks]


@dataclass(frozen=True)
class PendingPhotographs:
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


def begin_photographs(job: Job, plate: Plate, executor: SerialExecutor) -> PendingPhotographs:
    """Photographs through the dies of a plate, which need nothing of its files.

    Raises:
        JobError: MF140 or MF141 for a sensor or a light that cannot be.
    """
    conditions, around, shown = Conditions.of(job, "camera"), Surroundings.of(job), die_data.stated(job)

    def given(die: Die) -> ArgumentsFactory:
        return lambda: (conditions, around, die.name, die.panel, die.name in shown)

    dies = plate_as_seen(job, plate).dies
    reference = None if job.spec.report is None else job.spec.report.reference
    return PendingPhotographs(
        conditions, {die.name: executor.submit(photograph_die, given(die)) for die in dies}, reference, executor
    )


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
    results = _each(plate.dies, one, "process", progress, seconds, 1)
    return {die.name: written for die, written in zip(plate.dies, results, strict=True)}


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
