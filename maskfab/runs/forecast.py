"""A run foreseen: its stages, what of them is kept, and the time and memory of the rest. Nothing is written."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any, cast

from maskfab.base.folders import check_target
from maskfab.base.model import Plate
from maskfab.base.processes import ArgumentsFactory, Found, SerialExecutor, Task
from maskfab.base.work import silent
from maskfab.display.feasibility import displays
from maskfab.mask.job import Job
from maskfab.report.documents.measured import measured_beside
from maskfab.report.pages.front import shown_count
from maskfab.report.rows.optics import layout_as_seen, plate_as_seen
from maskfab.report.rows.photographs import Conditions
from maskfab.runs import pipeline
from maskfab.runs.costs import (
    HELD,
    SCENES_S,
    STARTED_S,
    Amounts,
    Pace,
    draw_s,
    figures_s,
    layout_s,
    read_bytes,
    read_s,
    task_bytes,
    write_s,
)
from maskfab.runs.recall import kind_of, origin_of
from maskfab.runs.store import Finding, Store

_AFTER_DISPLAYS = "kept is known once the displays are"
_AFTER_OPTICS = "kept is known once the dies are measured"


@dataclass(frozen=True)
class Stage:
    """A stage of a run.

    Attributes:
        name: as progress tells it.
        tasks: it consists of.
        kept: of these, findings of earlier runs; None where that is not known before the run.
        seconds: of a processor that the rest takes.
        bytes: of memory, of the process that holds most, with all that it holds besides.
        note: why it is not known; empty otherwise.
    """

    name: str
    tasks: int
    kept: int | None
    seconds: float
    bytes: float
    note: str = ""


@dataclass(frozen=True, repr=False)
class Forecast:
    """A run foreseen.

    Attributes:
        stages: in their order; none for a run that is taken whole from the cache.
        processes: that share the work.
        source: of the numbers, in words.
        whole: whether the run is kept whole.
    """

    stages: tuple[Stage, ...]
    processes: int
    source: str
    whole: bool

    @property
    def seconds(self) -> float:
        """Of a processor, for all stages and for starting."""
        return STARTED_S * self.processes + sum(stage.seconds for stage in self.stages)

    @property
    def wall_s(self) -> float:
        """Until the run has ended, if its processors have nothing else to do."""
        shared = sum(stage.seconds for stage in self.stages)
        return STARTED_S + shared / self.processes

    @property
    def bytes(self) -> float:
        """Memory of the process that holds most."""
        return max((stage.bytes for stage in self.stages), default=HELD)

    def to_dict(self) -> dict[str, Any]:
        """Plain data; seconds are those of a processor, but for ``wall_s``."""
        total = {"seconds": self.seconds, "wall_s": self.wall_s, "bytes": self.bytes}
        return {
            "whole": self.whole, "processes": self.processes, "source": self.source,
            "stages": [asdict(stage) for stage in self.stages], "total": total,
        }  # fmt: skip

    def __str__(self) -> str:
        lines = [f"{'stage':12}  {'tasks':>5}  {'kept':>5}  {'seconds':>8}  {'MB':>6}"]
        for stage in self.stages:
            kept = "?" if stage.kept is None else str(stage.kept)
            row = f"{stage.name:12}  {stage.tasks:5}  {kept:>5}  {stage.seconds:8.2f}  {stage.bytes / 1e6:6.0f}"
            lines.append(f"{row}  {stage.note}".rstrip())
        lines.append(f"{'total':12}  {'':5}  {'':5}  {self.seconds:8.2f}  {self.bytes / 1e6:6.0f}")
        if self.whole:
            lines = ["The run is kept whole: its files are copied from the cache."]
        number = "one process" if self.processes == 1 else f"{self.processes} processes"
        lines.append(f"about {self.wall_s:.1f} s in {number}; seconds of a processor, {self.source}")
        return "\n".join(lines)

    def __repr__(self) -> str:
        return str(self)


def dry_run(job: Job, out: Path, *, force: bool = False, cache: Store | None = None) -> Forecast:
    """Tell what :func:`maskfab.runs.pipeline.run` would do; arguments as there.

    Raises:
        InputError: for what it would refuse before its work; a display that cannot be is found by the work itself.
    """
    job.check_window()
    check_target(out, force=force)
    pipeline.named_shop(job)
    if cache is not None and cache.has(pipeline.origin_of_run(job, measured_beside(job))):
        return Forecast((), 1, "for files of a usual size", True)
    plate = drawn = job.plate()
    pipeline.check_processes(job, plate)
    pipeline.check_pictures(job, plate)
    Conditions.of(job, "camera")
    pace = Pace.of(() if cache is None else cache.entries())
    executor = _ForecastExecutor(cache, pace)
    with suppress(_NotKeptError):
        plate = displays(job, plate, executor=executor).plate
    laid = executor.stage("displays")
    pipeline.begin_photographs(job, drawn, executor)
    photographs = executor.stage("photographs")
    processes = 1 if type(pipeline.executor_of(job)) is SerialExecutor else 2
    if photographs.kept != photographs.tasks:
        scenes_s = SCENES_S * pace.of_all * min(processes, photographs.tasks)
        photographs = replace(photographs, seconds=photographs.seconds + scenes_s)
    seen = plate_as_seen(job, plate)
    made = pipeline.draw_files(job, plate)
    pipeline.check_readers(made)
    # What is read back equals the design, or the run says that it does not.
    layout = layout_as_seen(job, made.design)
    with suppress(_NotKeptError):
        pipeline.measure_dies(seen, job.camera, layout, silent, None, job.blank, executor)
    optics = executor.stage("optics")
    plans = pipeline.plan_scenes(job, seen, silent)
    alone = [replace(seen, dies=(die,)) for die in seen.dies]
    for die in alone:
        with suppress(_NotKeptError):
            pipeline.measure_scenes(job, die, plans, layout, silent, None, executor)
    scenes = executor.stage("scene")
    for die in alone:
        with suppress(_NotKeptError):
            pipeline.measure_process(job, die, silent, None, executor)
    process = executor.stage("process")
    with suppress(_NotKeptError):
        pipeline.expand_photographs(job, seen, silent, None, executor)
    tolerance = executor.stage("tolerance")
    if laid.kept != laid.tasks:
        photographed = (optics, scenes, process, tolerance)
        optics, scenes, process, tolerance = (replace(each, kept=None, note=_AFTER_DISPLAYS) for each in photographed)
    amounts = Amounts.of(made)
    stages = (
        _own("layout", 1, layout_s(len(plate.dies)), pace),
        laid,
        photographs,
        _own("draw", 1, draw_s(amounts), pace),
        process,
        _own("write", len(made.products), write_s(made, amounts), pace),
        _own("read back", len(made.products), read_s(made, amounts), pace, read_bytes(made, amounts)),
        optics,
        scenes,
        tolerance,
        replace(
            _own("figures", _figures(job, plate), figures_s(_figures(job, plate)), pace), kept=None, note=_AFTER_OPTICS
        ),
    )
    return Forecast(tuple(stage for stage in stages if stage.tasks), processes, pace.source, False)


def _own(name: str, tasks: int, seconds: float, pace: Pace, held: float = 0.0) -> Stage:
    """A stage of the run itself, which keeps nothing of it."""
    return Stage(name, tasks, 0, seconds * pace.of_all, HELD + held)


def _figures(job: Job, plate: Plate) -> int:
    """Tasks of drawing: of the plate, the overview, and of each die that the page shows what it has."""
    dies, spec = shown_count(len(plate.dies)), job.spec
    own = 1 + (spec.emitters is not None) + (spec.scene is not None) + (spec.written is not None)
    return 2 + dies * own


class _NotKeptError(Exception):
    """A stage cannot be gone through, for not all that it needs is kept."""


class _ForecastExecutor(SerialExecutor):
    """An executor that does nothing: it tells what is kept of what it is asked for, and what the rest would take."""

    def __init__(self, cache: Store | None, pace: Pace) -> None:
        self._cache, self._pace = cache, pace
        self._seen: list[tuple[bool, float, float]] = []

    def run(self, function: Callable[..., Found], *given: Any) -> Found:
        """A kept finding.

        Raises:
            _NotKeptError: if it is not.
        """
        kept = self._look(function, given)
        if kept is None:
            raise _NotKeptError
        return cast(Found, kept[0])

    def submit(self, function: Callable[..., Found], given: ArgumentsFactory) -> Task[Found]:
        """A task that nobody may ask for its finding."""
        self._look(function, given())
        return Task(function, given, lambda _: False)

    def run_all(
        self,
        calls: Sequence[tuple[Callable[..., Found], ArgumentsFactory]],
        done: Callable[[int], None] = lambda _: None,
    ) -> list[Task[Found]]:
        """Tasks whose findings are all kept.

        Raises:
            _NotKeptError: if one is not.
        """
        found = [self._look(function, given()) for function, given in calls]
        if any(each is None for each in found):
            raise _NotKeptError
        return [_done(each[0]) for each in found if each is not None]

    def stage(self, name: str) -> Stage:
        """Everything that was asked since the last stage."""
        seen, self._seen = self._seen, []
        kept = sum(each for each, _, _ in seen)
        seconds = sum(took for each, took, _ in seen if not each)
        return Stage(name, len(seen), kept, seconds, max((held for _, _, held in seen), default=0.0) + HELD)

    def _look(self, function: Callable[..., Any], given: tuple[Any, ...]) -> Any:
        kept = None
        if self._cache is not None:
            with suppress(TypeError):
                entry = self._cache.get(origin_of(function, *given), kind_of(function))
                kept = (entry.value,) if isinstance(entry, Finding) else None
        held = task_bytes(function, given) if kept is None else 0.0
        self._seen.append((kept is not None, self._pace.seconds(function, given), held))
        return kept


def _done(found: Found) -> Task[Found]:
    """A task whose finding is known."""
    return Task(lambda: found, tuple, lambda task: not task.ended)
