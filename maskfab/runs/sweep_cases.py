"""The cases of a sweep, found: each number that is wanted, by the least work that gives it.

A case is plain data, the same whoever finds it: this process, several, or a Dask cluster.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property, lru_cache, partial
from pathlib import Path
from typing import Any, Literal, TypeAlias, get_args

from maskfab.base.errors import InputError, JobError, OutputError
from maskfab.base.findings import STAGE_OF_QUANTITY, function_of
from maskfab.base.model import ORIENTATIONS, Die, Opening, Panel, Quantity, Tiling
from maskfab.base.processes import Call
from maskfab.base.work import Progress, one_thread
from maskfab.base.workers import Workers
from maskfab.camera import scenes as scene_sets
from maskfab.camera.stop_cells import PhotoCamera, lattice
from maskfab.designs.model.expected_psnr import Surrogate, surrogate_of
from maskfab.designs.model.statistics import CaptureSettings, scene_statistics
from maskfab.designs.rules.display_fit import Footprints
from maskfab.display.emitter_rules import Verdict
from maskfab.display.eye_and_life import judgement
from maskfab.display.feasibility import display_rules, feasibility, map_sizes
from maskfab.findings.as_written import measure_written, written_psf_quantities
from maskfab.findings.display import display_quantities
from maskfab.findings.photographs import Conditions, Photographs, Surroundings, photograph_die
from maskfab.findings.scene import measure_scene, scene_plan, scene_reach_um
from maskfab.job.camera import Camera
from maskfab.job.process import Process
from maskfab.job.read import validate
from maskfab.mask.job import Job, resolve
from maskfab.mask.plate_rules import judged, smallest_features, written_features
from maskfab.optics import metrics
from maskfab.optics.lags import LagTable, lag_table
from maskfab.optics.mtf import longest_lag_um, presampled_mtf
from maskfab.optics.pupil import cut, panel_aperture
from maskfab.runs.store import Record, keep, make_folder, of_installation
from maskfab.runs.sweep_plan import Case, by_psf

_SURROGATES = 8


@dataclass(frozen=True, eq=False)
class SweptDie:
    """One die of one case, and all that is wanted of it; one may find what another is about on its way."""

    job: Job
    name: str
    panel: Panel
    works: frozenset[str]

    @cached_property
    def alone(self) -> Die:
        """The die by itself."""
        return Die(self.name, self.name, self.panel, (0, 0), max(self.panel.size_nm))

    @property
    def camera(self) -> Camera:
        return self.job.camera

    @property
    def process(self) -> Process:
        """Process of the writer; one that changes nothing where the job states none."""
        return self.job.spec.written or Process(0.0, 0.0)

    @cached_property
    def as_written(self) -> tuple[Quantity, ...]:
        """Numbers of the die as the process makes it."""
        given = self.alone, self.camera, self.process, f"{self.job.where}: process"
        return measure_written(*given).quantities if "mtf as written" in self.works else written_psf_quantities(*given)

    def written_rows(self, work: str) -> list[Quantity]:
        """Numbers as written that one work finds."""
        return [row for row in self.as_written if STAGE_OF_QUANTITY[row.name].name == work]

    @cached_property
    def table(self) -> LagTable:
        """Lags of the panel as designed."""
        stop = self.camera.stop
        return lag_table(cut(panel_aperture(self.panel, stop.diameter_um / 2), stop), longest_lag_um(self.camera))


def measured(job: Job, wanted: Sequence[str]) -> list[Quantity]:
    """The quantities wanted of every die of a job, judged by its [limits]."""
    if by_psf(wanted):
        job.check_window()
    stages = [STAGE_OF_QUANTITY[name] for name in wanted]
    works = frozenset(stage.name for stage in stages)
    functions = [function_of(name) for name in dict.fromkeys(stage.sweep for stage in stages) if name is not None]
    return [
        judged(quantity, job.spec.limits)
        for name, panel in job.panels().items()
        for die in (SweptDie(job, name, panel, works),)
        for function in functions
        for quantity in function(die)
        if quantity.name in wanted
    ]


def open_ratio(die: SweptDie) -> Iterable[Quantity]:
    """Clear share of the die."""
    how = "clear share of one cell of the design, exact"
    return [Quantity("open_ratio", die.panel.open_ratio, how, die=die.name)]


def mtfs(die: SweptDie) -> Iterable[Quantity]:
    """MTF of the panel as designed, at every wavelength."""
    for line in die.camera.wavelengths_nm:
        mtf = presampled_mtf(die.table, die.camera, line)
        yield from metrics.mtf_quantities(mtf, die.camera.pixel_um, die.name)


def restoration(die: SweptDie) -> Iterable[Quantity]:
    """Contrast that a restored photograph keeps, at every wavelength."""
    for line in die.camera.wavelengths_nm:
        yield from metrics.restoration_quantities(die.table, die.camera, line, die.name)


def features(die: SweptDie) -> Iterable[Quantity]:
    """Smallest features of the die, as designed and as the process makes them."""
    return written_features(smallest_features(die.alone), die.process)


def written_psf(die: SweptDie) -> Iterable[Quantity]:
    """PSF of the die as the process makes it."""
    return die.written_rows("psf as written")


def written_mtf(die: SweptDie) -> Iterable[Quantity]:
    """MTF of the die as the process makes it."""
    return die.written_rows("mtf as written")


def scatter(die: SweptDie) -> Iterable[Quantity]:
    """Light that rough edges scatter. Raises JobError MF105 without roughness."""
    if die.process.roughness is None:
        where, cure = die.job.where, "Add it, or vary process.roughness.sigma and process.roughness.correlation"
        raise JobError("MF105", "rough edges scatter, and the job has no [process.roughness]", where=where, cure=cure)
    return die.written_rows("scatter")


def photographs(die: SweptDie) -> Iterable[Quantity]:
    """Scores of restored photographs through the die."""
    conditions, around = Conditions.of(die.job, "camera"), Surroundings.of(die.job)
    photograph = photograph_die(conditions, around, die.name, die.panel, False)
    if photograph.refused is not None:
        code, _, what = photograph.refused.partition(" ")
        raise JobError(code, what, where=f"die {die.name}", cure="See maskfab explain")
    return Photographs(conditions, {die.name: photograph}).quantities(die.name)


def expected(die: SweptDie) -> Iterable[Quantity]:
    """Score that the surrogate expects, by level of light. Raises JobError MF161 for cells of several openings."""
    from maskfab.designs.design import capture_settings

    opening = _only_opening(die)
    settings = capture_settings(die.job.spec)
    estimate = _surrogate(die.camera, opening.dots, die.panel.dot_nm, settings)
    scores = estimate(opening.mask, periodic=die.panel.tiling is Tiling.PERIODIC, levels=settings.levels)
    how = "surrogate: photographs of the bundled scenes through any random tiling of the opening, no gutters"
    for level, psnr in zip(settings.levels, scores, strict=True):
        yield Quantity("expected_psnr", psnr, how, die=die.name, level_db=level)


def footprint(die: SweptDie) -> Iterable[Quantity]:
    """Largest footprint of an emitter, and its bound. Raises JobError MF105 without emitters; MF161 for cells of
    several openings."""
    rules, opening = display_rules(die.job), _only_opening(die)
    if rules is None:
        where = die.job.where
        raise JobError("MF105", "a footprint is of emitters, and the job has no [emitters]", where=where, cure="Add it")
    turned = (0,) if die.panel.tiling is Tiling.PERIODIC else tuple(range(ORIENTATIONS))
    places = Footprints(rules.emitters, opening.dots, die.panel.dot_nm, turned)
    largest, bound = places(opening.mask), float(places.bounds(opening.mask[None])[0])
    name = die.name
    yield Quantity(
        "led_footprint_largest", largest, "of rectangles and straight cuts; crooked emitters may exceed it", die=name
    )
    how = "free squares of the least width, swept by the gap; the gap across borders is free in it"
    yield Quantity("led_footprint_bound", max(bound, largest), how, die=name, at_most=True)


def display(die: SweptDie) -> Iterable[Quantity]:
    """Whether emitters, circuits and wires fit, and how the display looks and lives. Raises JobError MF105 without
    emitters; MF161 for a sheet without pixels; MF117 for a reference display that is asked for and cannot be."""
    job, name = die.job, die.name
    rules = display_rules(job)
    if rules is None:
        cure = "Add it"
        raise JobError("MF105", "a display has emitters, and the job has no [emitters]", where=job.where, cure=cure)
    answer = feasibility(die.panel, rules)
    if answer is None:
        cure = "Leave the die out of sweep.dies"
        raise JobError("MF161", f"die {name} is a sheet without pixels", where=job.where, cure=cure)
    if answer.even is not None:
        lit, of_map = replace(die.panel, emitters=answer.emitters), map_sizes(job).get(name)
        answer = replace(answer, judged=judgement(lit, rules.eye, rules.emitters, rules.light, of_map))
    how = "emitters, circuits and wires by the job's rules: 1 they were placed, 0 a proof that they do not fit"
    value = {Verdict.FITS: 1, Verdict.DOES_NOT_FIT: 0, Verdict.UNKNOWN: None}[answer.verdict]
    yield Quantity("display_fits", value, how, passed=answer.passed, die=name)
    rows = display_quantities(die.alone, answer)
    yield from (row for row in rows if STAGE_OF_QUANTITY.get(row.name) is STAGE_OF_QUANTITY["display_fits"])


def scene(die: SweptDie) -> Iterable[Quantity]:
    """Numbers of the job's scene through the die. Raises JobError MF105 without a scene; MF114 or MF115 for one that
    cannot be modelled."""
    job, section, scene = die.job, die.job.spec.scene, die.job.scene
    if section is None or scene is None:
        raise JobError("MF105", "the job has no [scene]", where=job.where, cure="Add one, or vary a key of it")
    plan = scene_plan(die.alone, job.camera, scene, section.accuracy, job.where)
    openings = panel_aperture(die.panel, scene_reach_um(job.camera, scene))
    return measure_scene(die.alone, job.camera, scene, openings, plan, job.blank).quantities


def _only_opening(die: SweptDie) -> Opening:
    """The opening of all cells. Raises JobError MF161 for cells of several."""
    if die.panel.others:
        what = f"die {die.name} has several openings, of which no surrogate knows"
        raise JobError("MF161", what, where=die.job.where, cure="Ask for restored_psnr instead of expected_psnr")
    return die.panel.opening


@lru_cache(maxsize=_SURROGATES)
def _surrogate(camera: Camera, dots: int, dot_nm: int, settings: CaptureSettings) -> Surrogate:
    room = lattice(dots, dot_nm, camera=PhotoCamera.of(camera), where="die.dot")
    return surrogate_of(scene_statistics(scene_sets.bundled(), settings=settings), room)


def find(key: str, document: Mapping[str, Any], quantities: tuple[str, ...]) -> Record:
    """The numbers of a case, or why it has none."""
    try:
        job = resolve(validate(document, where="case"), Path("case.toml"))
        rows = [_row(quantity) for quantity in measured(job, quantities)]
    except InputError as refusal:
        return {"key": key, "failed": f"{refusal.code} {refusal.what}", "rows": []}
    return {"key": key, "failed": None, "rows": rows}


def _row(quantity: Quantity) -> dict[str, Any]:
    """A number as data. Raises JobError MF163 for one that is not finite."""
    value = quantity.value
    if isinstance(value, float) and not math.isfinite(value):
        raise JobError("MF163", f"{quantity.name} is not finite", cure="Leave these values out")
    return {
        "name": quantity.name,
        "die": quantity.die,
        "wavelength_nm": quantity.wavelength_nm,
        "level_db": quantity.level_db,
        "value": value,
        "uncertainty": quantity.uncertainty,
        "unit": quantity.unit,
        "limit": quantity.limit,
        "passed": quantity.passed,
    }


Engine: TypeAlias = Literal["processes", "serial", "dask"]
ENGINES: tuple[str, ...] = get_args(Engine)
_TOLD = 200
"""Times at most that progress is told: it counts all cases."""


def workers_of(engine: Engine, scheduler: str | None, workers: int | None) -> Workers:
    """Who finds cases, as a sweep's caller states it."""
    if (engine == "dask") != (scheduler is not None) or engine not in ENGINES:
        cure = "Use --engine serial or processes, or --engine dask with --scheduler tcp://HOST:8786"
        raise JobError("MF105", f"the engine {engine!r} with the scheduler {scheduler!r}", where="--engine", cure=cure)
    return Workers(1 if engine == "serial" else None if scheduler else workers, scheduler, of_installation)


@one_thread
def map_cases(
    cases: Sequence[Case], quantities: tuple[str, ...], folder: Path, progress: Progress, workers: Workers
) -> list[Record]:
    """Find cases, each kept in its file as soon as it is found.

    Returns:
        Records in the order of the cases; one whose worker failed says so and has no file, so that it is tried again.

    Raises:
        JobError: MF164 for a scheduler that does not answer, or workers that run another version.
        OutputError: MF401 where files cannot be written.
    """
    records: list[Record] = []
    every = max(1, len(cases) // _TOLD)
    told = -1

    def tell(ended: int) -> None:
        nonlocal told
        if ended // every > told // every or ended == len(cases):
            told = ended
            progress("cases", ended, len(cases))

    with workers.executor(len(cases)) as executor:
        make_folder(folder)
        tell(0)
        given = [(case.key, case.document, quantities) for case in cases]
        tasks = [executor.submit(Call(find, partial(tuple, own), then=partial(keep, folder))) for own in given]
        executor.finish(tasks, tell)
        for case, task in zip(cases, tasks, strict=True):
            try:
                records.append(task.result())
            except (JobError, OutputError):
                raise
            except Exception as error:
                records.append(_failed(case, error))
    return records


def _failed(case: Case, error: Exception) -> Record:
    lines = str(error).strip().splitlines() or [""]
    return {"key": case.key, "failed": f"{type(error).__name__}: {lines[0]}", "rows": []}
