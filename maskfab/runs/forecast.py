"""A run foreseen: its stages, what of them is kept, and the time and memory of the rest. Nothing is written."""

from __future__ import annotations

import time
from collections import defaultdict
from collections.abc import Callable, Iterable, Mapping, Sequence
from contextlib import suppress
from dataclasses import asdict, dataclass, replace
from functools import partial
from pathlib import Path
from types import MappingProxyType
from typing import Any, cast

import numpy as np
from klayout import db

from maskfab.base.findings import expected, task_bytes, words
from maskfab.base.folders import check_target
from maskfab.base.model import Plate
from maskfab.base.processes import Call, Found, SerialExecutor, Task
from maskfab.base.work import silent
from maskfab.base.workers import EVERY_CORE, Workers
from maskfab.camera.die_transfer import MOST_ACROSS, too_fine
from maskfab.display.feasibility import displays
from maskfab.findings.optics import layout_as_seen, plate_as_seen
from maskfab.job.faults import JobFaults
from maskfab.mask.formats.solid import mesh_vertices
from maskfab.mask.houses.files import PlateFiles
from maskfab.mask.job import Job
from maskfab.report.documents.die import measured_beside
from maskfab.report.pages.front import shown_count
from maskfab.runs import pipeline
from maskfab.runs.plate_files import draw_files
from maskfab.runs.recall import kind_of, origin_of
from maskfab.runs.stages import (
    begin_photographs,
    expand_photographs,
    measure_dies,
    measure_process,
    measure_scenes,
    plan_scenes,
    tasks_at_once,
)
from maskfab.runs.store import Entry, KeptFinding, Store

PROBE_S = 0.1
"""Seconds that :func:`probe` takes on the machine of the reference numbers."""
STARTED_S = 2.0
"""Seconds of a process, for its imports."""
HELD = 400e6
"""Bytes of a process that has imported what it needs."""
SCENES_S = 2.0
"""Seconds of each process that takes photographs, for drawing their scenes."""
_CORES = (4, 16, 64)
"""Numbers of cores that a forecast is told for."""
_AFTER_PHOTOGRAPHS = ("tolerance", "figures")
"""Stages that wait for photographs, which are taken beside all others."""
_PROBED = 512
_TIMES = 3

_AFTER_DISPLAYS = "kept is known once the displays are"
_AFTER_OPTICS = "kept is known once the dies are measured"


@dataclass(frozen=True)
class Stage:
    """A stage of a run.

    Attributes:
        kept: of these, findings of earlier runs; None where that is not known before the run.
        seconds: of a processor that the rest takes.
        bytes: of memory, of the process that holds most, with all that it holds besides.
        longest_s: seconds of its longest task, before which the next stage cannot begin.
        each_s: seconds that each process that takes part spends besides its tasks, counted in the others.
        note: why it is not known; empty otherwise.
    """

    name: str
    tasks: int
    kept: int | None
    seconds: float
    bytes: float
    longest_s: float
    each_s: float = 0.0
    note: str = ""


@dataclass(frozen=True, repr=False)
class Forecast:
    """A run foreseen.

    Attributes:
        stages: in their order; none for a run that is taken whole from the cache.
        source: of the numbers, in words.
        whole: whether the run is kept whole.
        tasks: at a time at most, beyond which no further core would have anything to do.
        helper_bytes: of memory, of processes that read files beside the others.
    """

    stages: tuple[Stage, ...]
    processes: int
    source: str
    whole: bool
    tasks: int = 1
    helper_bytes: float = 0.0

    @property
    def seconds(self) -> float:
        """Seconds of a processor, for all stages and for starting."""
        return STARTED_S * self.processes + sum(stage.seconds for stage in self.stages)

    @property
    def wall_s(self) -> float:
        """Until the run has ended, if its processors have nothing else to do."""
        return self.on(self.processes)

    @property
    def chain_s(self) -> float:
        """Seconds of the longest chain of tasks that wait for one another: what no number of processors shortens."""
        longest = {stage.name: stage.longest_s for stage in self.stages}
        before, aside = longest.pop("layout", 0.0), longest.pop("photographs", 0.0)
        after = sum(longest.pop(name, 0.0) for name in _AFTER_PHOTOGRAPHS)
        return before + max(aside, sum(longest.values())) + after

    def on(self, cores: int) -> float:
        """Seconds until the run has ended on so many cores.

        No core is idle while a task waits, so that the chain is worked on wherever not all cores are busy: Graham's
        bound (SIAM J. Appl. Math. 17, 416, 1969, equation 1).
        """
        shared = min(cores, self.tasks)
        more = sum(
            stage.each_s * (min(shared, stage.tasks) - min(self.processes, stage.tasks)) for stage in self.stages
        )
        work_s = sum(stage.seconds for stage in self.stages) + more
        chain_s = min(self.chain_s, work_s)
        return STARTED_S + chain_s + (work_s - chain_s) / shared

    @property
    def bytes(self) -> float:
        """Memory of the process that holds most."""
        return max((stage.bytes for stage in self.stages), default=HELD)

    @property
    def all_bytes(self) -> float:
        """Memory of all processes together; others than the largest hold what they import, and a task."""
        return self.bytes + HELD * (self.processes - 1) + self.helper_bytes

    def to_dict(self) -> dict[str, Any]:
        """Plain data; seconds are those of a processor, but for ``wall_s``."""
        total = {
            "seconds": self.seconds,
            "wall_s": self.wall_s,
            "bytes": self.bytes,
            "all_bytes": self.all_bytes,
            "chain_s": self.chain_s,
        }
        return {
            "whole": self.whole, "processes": self.processes, "source": self.source,
            "stages": [asdict(stage) for stage in self.stages], "total": total,
            "on_cores": {str(cores): self.on(cores) for cores in _CORES},
        }  # fmt: skip

    def __str__(self) -> str:
        lines = [f"{'stage':12}  {'tasks':>5}  {'kept':>5}  {'seconds':>8}  {'MB':>6}"]
        for stage in self.stages:
            ready = "?" if stage.kept is None else str(stage.kept)
            row = f"{stage.name:12}  {stage.tasks:5}  {ready:>5}  {stage.seconds:8.2f}  {stage.bytes / 1e6:6.0f}"
            lines.append(f"{row}  {stage.note}".rstrip())
        lines.append(f"{'total':12}  {'':5}  {'':5}  {self.seconds:8.2f}  {self.bytes / 1e6:6.0f}")
        lines.append(f"about {self.all_bytes / 1e6:.0f} MB in all processes together")
        if self.whole:
            lines = ["The run is kept whole: its files are copied from the cache."]
        number = "one process" if self.processes == 1 else f"{self.processes} processes"
        lines.append(f"about {self.wall_s:.1f} s in {number}; seconds of a processor, {self.source}")
        if not self.whole:
            more = ", ".join(f"on {cores} cores {self.on(cores):.1f} s" for cores in _CORES)
            lines.append(f"about {more}; the longest chain of tasks takes {self.chain_s:.1f} s")
        return "\n".join(lines)

    def __repr__(self) -> str:
        return str(self)


def dry_run(
    job: Job, out: Path, *, force: bool = False, cache: Store | None = None, workers: Workers = EVERY_CORE
) -> Forecast:
    """Tell what :func:`maskfab.runs.pipeline.run` would do; arguments as there. Raises InputError for what it would
    refuse before its work; a display that cannot be is found by the work itself."""
    check_target(out, force=force)
    if cache is not None and cache.has(pipeline.origin_of_run(job, measured_beside(job))):
        return Forecast((), 1, "for files of a usual size", True)
    faults = JobFaults.of_spec(job.spec)
    plate = drawn = pipeline.plate_to_make(job, faults)
    faults.refuse()
    assert plate is not None
    assert drawn is not None
    pace = Pace.of(() if cache is None else cache.entries())
    executor = _ForecastExecutor(cache, pace)
    with suppress(_NotKeptError):
        plate = displays(job, plate, executor=executor).plate
    laid = executor.stage("displays")
    processes = workers.at_once(tasks_at_once(job))
    photographs = _photographs(job, drawn, executor, pace, processes)
    seen = plate_as_seen(job, plate)
    made = draw_files(job, plate)
    # What is read back equals the design, or the run says that it does not.
    layout = layout_as_seen(job, made.design)
    rest = silent, None, executor
    optics = executor.stage(
        "optics", partial(measure_dies, seen, job.camera, layout, silent, None, job.blank, executor)
    )
    plans = plan_scenes(job, seen, silent)
    alone = [replace(seen, dies=(die,)) for die in seen.dies]
    scenes = executor.stage("scene", *(partial(measure_scenes, job, die, plans, layout, *rest) for die in alone))
    process = executor.stage("process", *(partial(measure_process, job, die, *rest) for die in alone))
    tolerance = executor.stage("tolerance", partial(expand_photographs, job, seen, *rest))
    if laid.kept != laid.tasks:
        photographed = (optics, scenes, process, tolerance)
        optics, scenes, process, tolerance = (replace(part, kept=None, note=_AFTER_DISPLAYS) for part in photographed)
    amounts, drawings = Amounts.of(made), _figures(job, plate)
    stages = (
        _own("layout", 1, 0.1 + 0.01 * len(plate.dies), pace),
        laid,
        photographs,
        _own("draw", 1, 0.05 + 1.5e-6 * amounts.vertices + 3e-6 * amounts.references, pace),
        process,
        _own("write", len(made.products), _files_s(made, amounts, 0), pace, _solid_bytes(made)),
        _own(
            "read back",
            len(made.products),
            _files_s(made, amounts, 1) + _DOTS_S * amounts.dies,
            pace,
            max(read_bytes(made, amounts), _solid_bytes(made)),
        ),
        optics,
        scenes,
        tolerance,
        replace(
            _own("figures", drawings, 0.25 + 0.3 * drawings, pace),
            kept=None,
            longest_s=0.55 * pace.of_all,
            note=_AFTER_OPTICS,
        ),
    )
    helpers = _HELPER_BYTES * any(product.form.reading == "thread" for product in made.products)
    return Forecast(
        tuple(stage for stage in stages if stage.tasks), processes, pace.source, False, tasks_at_once(job), helpers
    )


def _photographs(job: Job, plate: Plate, executor: _ForecastExecutor, pace: Pace, processes: int) -> Stage:
    """The stage of photographs: each process that takes some draws the scenes first."""
    begin_photographs(job, plate, executor)
    stage = executor.stage("photographs")
    if stage.kept != stage.tasks:
        each_s = SCENES_S * pace.of_all
        seconds, longest_s = stage.seconds + each_s * min(processes, stage.tasks), stage.longest_s
        stage = replace(stage, seconds=seconds, longest_s=longest_s + each_s, each_s=each_s)
    refused = [die.name for die in plate.dies if too_fine(die.panel, job.camera.stop)]
    if refused:
        seconds = stage.seconds * (1 - len(refused) / len(plate.dies))
        note = f"none of {', '.join(refused)}: more than {MOST_ACROSS} dots across the stop"
        stage = replace(stage, seconds=seconds, note=note)
    return stage


def _own(name: str, tasks: int, seconds: float, pace: Pace, held: float = 0.0) -> Stage:
    """A stage of the run itself, which keeps nothing of it."""
    return Stage(name, tasks, 0, seconds * pace.of_all, HELD + held, seconds * pace.of_all)


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
        """A kept finding."""
        entry = self._look(function, given)
        if entry is None:
            raise _NotKeptError
        return cast(Found, entry[0])

    def submit(self, call: Call[Found]) -> Task[Found]:
        """A task that nobody may ask for its finding."""
        self._look(call.function, call.given())
        return Task(call, self)

    def run_all(self, calls: Sequence[Call[Found]], done: Callable[[int], None] = lambda _: None) -> list[Task[Found]]:
        """Tasks whose findings are all kept."""
        entries = [self._look(call.function, call.given()) for call in calls]
        if any(entry is None for entry in entries):
            raise _NotKeptError
        return [_done(entry[0]) for entry in entries if entry is not None]

    def stage(self, name: str, *works: Callable[[], object]) -> Stage:
        """Everything that was asked since the last stage, by works that go on as far as what they need is kept."""
        for work in works:
            with suppress(_NotKeptError):
                work()
        seen, self._seen = self._seen, []
        count = sum(is_kept for is_kept, _, _ in seen)
        took = [took for is_kept, took, _ in seen if not is_kept]
        held = max((held for _, _, held in seen), default=0.0) + HELD
        return Stage(name, len(seen), count, sum(took), held, max(took, default=0.0))

    def _look(self, function: Callable[..., Any], given: tuple[Any, ...]) -> Any:
        value = None
        if self._cache is not None:
            with suppress(TypeError):
                entry = self._cache.get(origin_of(function, *given), kind_of(function))
                value = (entry.value,) if isinstance(entry, KeptFinding) else None
        held = task_bytes(function, given) if value is None else 0.0
        self._seen.append((value is not None, self._pace.seconds(function, given), held))
        return value


def _done(finding: Found) -> Task[Found]:
    """A task whose finding is known."""
    return Task(Call(lambda: finding, tuple), SerialExecutor())


# What this machine takes for it.


@dataclass(frozen=True)
class Pace:
    """Time that this machine takes over that of the machine of the reference numbers.

    Attributes:
        of_all: tasks without one of their own.
        of_kind: tasks, by the name of their function.
        source: of the numbers, in words.
    """

    of_all: float
    of_kind: Mapping[str, float]
    source: str

    @classmethod
    def of(cls, entries: Iterable[Entry]) -> Pace:
        """Pace by what earlier tasks took; by a probe where there are none."""
        took: dict[str, list[tuple[float, float]]] = defaultdict(list)
        for entry in entries:
            if entry.seconds is not None and entry.expected_s:
                took[entry.what].append((entry.seconds, entry.expected_s))
        if not took:
            return cls(probe() / PROBE_S, {}, "by constants, and a probe of this machine")
        number = sum(map(len, took.values()))
        of_kind = {what: _ratio(pairs) for what, pairs in took.items()}
        every = [pair for pairs in took.values() for pair in pairs]
        return cls(_ratio(every), of_kind, f"by {number} earlier tasks on this machine")

    def seconds(self, function: Callable[..., Any], given: tuple[Any, ...]) -> float:
        """Seconds that a task is expected to take here."""
        own = expected(function, given)
        return 0.0 if own is None else own * self.of_kind.get(words(function), self.of_all)


@dataclass(frozen=True)
class _FileCost:
    """Seconds that a kind of file takes, written and read back: for each vertex that stands in a cell, for each
    reference, for each vertex with all references followed, for each file, and of one die besides: for each vertex in
    all its cells and for each cell."""

    vertex: tuple[float, float] = (0.0, 0.0)
    reference: tuple[float, float] = (0.0, 0.0)
    drawn: tuple[float, float] = (0.0, 0.0)
    file: tuple[float, float] = (0.03, 0.05)
    of_die: tuple[float, float] = (0.0, 0.0)
    cell: tuple[float, float] = (0.0, 0.0)


_FILES: Mapping[str, _FileCost] = MappingProxyType(
    {
        ".gds": _FileCost((0.6e-6, 1e-6), (1.4e-6, 25e-6)),
        ".oas": _FileCost((1e-6, 1e-6), (1.6e-6, 32e-6)),
        "_R12.dxf": _FileCost((1.9e-6, 4.8e-6), (5.8e-6, 38e-6)),
        "_R2010.dxf": _FileCost((1e-6, 2.8e-6), (4.5e-6, 35e-6)),
        ".gbr": _FileCost(drawn=(0.46e-6, 11e-6)),
        ".cif": _FileCost((1e-6, 2e-6), (1e-6, 26e-6)),
        ".svg": _FileCost(reference=(0.6e-6, 17e-6)),
        ".step": _FileCost(file=(0.4, 1.3), cell=(0.7e-3, 0.25e-3)),
        ".glb": _FileCost(file=(0.1, 0.2), of_die=(20e-6, 8e-6)),
        ".3mf": _FileCost(file=(0.1, 0.1), of_die=(14e-6, 12e-6)),
        ".stl": _FileCost(file=(0.03, 0.1), of_die=(1.8e-6, 11e-6)),
    }
)
"""Costs by how a file's name ends."""
_OTHER = _FileCost(file=(0.3, 0.8))
"""Pictures of a die."""
_SOLIDS = (".step", ".glb", ".3mf", ".stl")
_SOLID_BYTES, _MESH_BYTES = 250e6, 1500.0
"""Bytes that the library of solids keeps, and of each vertex in all cells of the die that has most of them."""
_HELPER_BYTES = 300e6
"""Of a process that reads a file beside others."""
_DOTS_S = 0.08
"""Seconds of comparing a die dot by dot."""
_VERTEX_BYTES = 900.0
_DRAWN_BYTES = 150.0
_DOT_BYTES = 19.0
"""Bytes of a dot, as it was read and as it was designed, in the die that has most of them."""
_BOX_BYTES = 22.0
"""Bytes of a vertex among the boxes that the die's dots are found from."""


@dataclass(frozen=True)
class Amounts:
    """Size of the work of drawing, writing and reading the files of a plate.

    Attributes:
        vertices: that stand in cells of the design.
        references: of the design.
        drawn: vertices with all references followed.
        dots: of the die that has most, its gutters among them.
        share: of that die in the dots of all.
    """

    vertices: int
    references: int
    drawn: int
    dots: int
    share: float
    dies: int

    @classmethod
    def of(cls, made: PlateFiles) -> Amounts:
        """Amounts of the files that a plate becomes."""
        vertices = references = 0
        for cell in made.design.each_cell():
            references += cell.child_instances()
            for layer in made.design.layer_indexes():
                drawn = db.Region(cell.shapes(layer))
                drawn.merged_semantics = False
                vertices += drawn.edges().count()
        panels = [die.panel for die in made.plate.dies]
        dots = [panel.orientations.size * (len(panel.cell_size.edges_nm) - 1) ** 2 for panel in panels]
        most = max(dots, default=0)
        share = most / sum(dots) if most else 0.0
        return cls(vertices, references, made.figures.account.vertices, most, share, len(dots))


def read_bytes(made: PlateFiles, amounts: Amounts) -> float:
    """Bytes of memory, for the design, a file that is held against it, and the dots of one die."""
    flat = any(product.name.endswith(".gbr") for product in made.products)
    of_die = _DOT_BYTES * amounts.dots + _BOX_BYTES * amounts.share * amounts.drawn
    return _VERTEX_BYTES * amounts.vertices + max(of_die, _DRAWN_BYTES * amounts.drawn * flat)


def _files_s(made: PlateFiles, amounts: Amounts, way: int) -> float:
    counted = amounts.vertices, amounts.references, amounts.drawn
    total = 0.0
    for product in made.products:
        cost = next((cost for ending, cost in _FILES.items() if product.name.endswith(ending)), _OTHER)
        costs = (cost.vertex[way], cost.reference[way], cost.drawn[way])
        total += cost.file[way] + sum(one * amount for one, amount in zip(costs, counted, strict=True))
        if product.die is not None and product.name.endswith(_SOLIDS):
            panel = product.die.panel
            total += cost.of_die[way] * mesh_vertices(panel) + cost.cell[way] * panel.orientations.size
    return total


def _solid_bytes(made: PlateFiles) -> float:
    """Bytes that solids take besides, written or read back; 0 without them."""
    dies = [product for product in made.products if product.name.endswith(_SOLIDS[1:])]
    most = max((mesh_vertices(product.die.panel) for product in dies if product.die is not None), default=0)
    return _MESH_BYTES * most + _SOLID_BYTES * any(product.name.endswith(_SOLIDS) for product in made.products)


def _ratio(pairs: Iterable[tuple[float, float]]) -> float:
    measured = list(pairs)
    return sum(seconds for seconds, _ in measured) / sum(expected_s for _, expected_s in measured)


def probe() -> float:
    """Seconds of a processor for a fixed piece of work of the kind that tasks do, a quarter of a second at most."""
    values = np.random.default_rng(1).random((_PROBED, _PROBED))
    begun = time.thread_time()
    for _ in range(_TIMES):
        np.fft.ifft2(np.fft.fft2(values))
        values @ values
        sorted(values.ravel().tolist()[:20_000])
    return time.thread_time() - begun
