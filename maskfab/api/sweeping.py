"""Sweeps: the same job with other values of some keys."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from contextlib import nullcontext
from dataclasses import dataclass
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import TYPE_CHECKING, Annotated, Any, overload

import numpy as np

from maskfab.api.asked import AnyJob, job_of, require_form
from maskfab.api.lengths import length_text, wavelength_text
from maskfab.api.results import Asked, InPython, Result, Told, answers
from maskfab.base.checks import checked_arguments
from maskfab.base.errors import JobError
from maskfab.base.work import Progress, silent
from maskfab.job.faults import parse_section
from maskfab.job.reference import in_words
from maskfab.job.sections import JobSpec
from maskfab.job.sweep_file import SweepSpec, read_value
from maskfab.job.values import length_keys, sections_of
from maskfab.mask.job import Job
from maskfab.runs import sweep as sweeping
from maskfab.runs.sweep import rows_of, sweep_document, write_sweep
from maskfab.runs.sweep_numbers import Sensitivity, Swept, Yield
from maskfab.runs.sweep_plan import Plan, faults_of_plate, planned, planned_of, require_quantities

if TYPE_CHECKING:
    from maskfab.api.camera import Camera
    from maskfab.report.figures.sheet import Drawing
    from maskfab.runs.sweep_cases import Engine


USUAL_QUANTITIES = ("open_ratio", "auc_radial_min", "mtf50")
"""Quantities that a sweep finds unless others are named: those that take no photographs."""
_FEW = 50
_MOST_LINES = 12


@dataclass(frozen=True, eq=False, repr=False)
class Sweep(Result):
    """A sweep that was made.

    Attributes:
        found: every case.
        directory: of its files; None for one that was asked for none.
    """

    found: Swept
    directory: Path | None

    @property
    def passed(self) -> bool:
        """Whether no case failed."""
        return not self.found.failed

    @property
    def sensitivities(self) -> tuple[Sensitivity, ...]:
        """Sensitivities of every number to every field, of each number the strongest first."""
        return self.found.sensitivities

    @property
    def yields(self) -> tuple[Yield, ...]:
        """Cases that keep every limit."""
        return self.found.yields

    def to_dict(self) -> dict[str, Any]:
        """Everything that was found."""
        return sweep_document(self.found)

    def rows(self) -> Iterable[Mapping[str, Any]]:
        """Rows: one for each number of each case."""
        return rows_of(self.found)

    def plot(self) -> Drawing | None:
        """The first quantity against every field; None where there is nothing to draw."""
        from maskfab.runs.sweep_page import quantity_figure

        return quantity_figure(self.found, self.found.plan.quantities[0])

    def __str__(self) -> str:
        swept = self.found
        lines = [f"{len(swept.records)} cases, {swept.remade} found now, {len(swept.failed)} failed"]
        for effect in swept.sensitivities[:_MOST_LINES]:
            name = ", ".join(str(part) for part in effect.of if part is not None)
            lines.append(f"  {name}: {effect.range:.4g} over {effect.field}, {effect.share:.0%} of all")
        lines += [
            f"{part.die or 'all dies'}: {part.kept} of {part.cases} keep every limit, {part.low:.1%} to {part.high:.1%}"
            for part in swept.yields
        ]
        lines += [f"case {number} failed: {why}" for number, why in swept.failed[:_MOST_LINES]]
        lines += in_words(swept.plan.unused)
        return "\n".join(lines)


@overload
def sweep(
    study: str | Path, out: str | Path, /, *, engine: Engine = ..., scheduler: str | None = ...,
    workers: int | None = ..., progress: Progress = ...
) -> Sweep: ...  # fmt: skip
@overload
def sweep(
    study: AnyJob, camera: Camera | None = ..., out: str | Path | None = ..., *,
    over: Mapping[str, Any] | None = ..., quantities: Sequence[str] = ..., dies: Sequence[str] | None = ...,
    cases: int | None = ..., seed: int = ..., engine: Engine = ..., scheduler: str | None = ...,
    workers: int | None = ..., progress: Progress = ...
) -> Sweep: ...  # fmt: skip
@checked_arguments
def sweep(
    study: AnyJob,
    camera: InPython[Camera | str | Path | None] = None,
    out: Annotated[str | Path | None, "FOLDER!"] = None,
    *,
    over: InPython[Mapping[str, Any] | None] = None,
    quantities: InPython[Sequence[str]] = USUAL_QUANTITIES,
    dies: InPython[Sequence[str] | None] = None,
    cases: InPython[int | None] = None,
    seed: InPython[int] = 0,
    engine: Annotated[Engine, "processes|serial|dask"] = "processes",
    scheduler: Annotated[str | None, "ADDRESS"] = None,
    workers: Annotated[int | None, "1..1024"] = None,
    progress: Progress = silent,
) -> Sweep:
    """Find numbers of a job for many values of its keys: curves, sensitivities, yield, and a table of all cases.

    Every case is kept as soon as it is found, and not found again: a sweep that was killed goes on where it was.

    Examples:
        $ maskfab sweep layouts/sweeps/bias.toml -o build/bias
        $ maskfab sweep layouts/sweeps/shapes.toml -o build/shapes --engine dask --scheduler tcp://127.0.0.1:8786
        >>> import maskfab as mf
        >>> bar = mf.Opening.bar(dots=7, size=(5, 3), pitch="56 um")
        >>> camera = mf.Camera("5 mm", stop="400 um", pixel="2 um", wavelengths="530 nm", window="64 um")
        >>> swept = mf.sweep(bar, camera, over={"camera.focal": ["5 mm", "6 mm"]}, engine="serial")
        >>> [round(row["value"], 2) for row in swept.rows() if row["name"] == "mtf50"]
        [4.56, 3.8]

    Args:
        study: study file (.toml): the job, its fields with their values, the quantities wanted. In Python also a job,
            plate or panels, with over.
        camera: of a plate or of panels; by default the plate's, or that of protocol F1.
        out: directory of the cases, the table and the page; cases in it are not found again. In Python it may be left
            out with over: nothing is written then.
        over: keys of the job and the values of each, as ``{"camera.pixel": ["1 um", "2 um"], "die.gutter": [0, 8]}``,
            every value with every other; ``die.KEY`` is of every die. In place of a list a field as in a study file,
            such as ``{"from": "1 um", "to": "3 um", "count": 5}`` or, with cases, ``{"uniform": ["1 um", "3 um"]}``.
            Of a key that holds a list, such as ``camera.wavelengths``, values are lists or single items. Numbers, also
            of arrays, are micrometres, of wavelengths nanometres. Curves of one panel over the wavelength take one
            call, ``camera.mtf(panel, array)``.
        quantities: wanted, with over, as report.json names them.
        dies: that are looked at, with over; by default all.
        cases: number of draws, with over, where a field is drawn.
        seed: of the draws.
        engine: who finds the cases; the table is the same.
        scheduler: address of a Dask scheduler, such as tcp://127.0.0.1:8786.
        workers: processes; by default as many as processors and memory bear.
        progress: told where the work stands.

    Raises:
        JobError: MF160 to MF162 for a study that cannot be; MF105 for keys, and for an object without over; MF103 for
            units; MF152 for a cluster without dask; MF164 for a scheduler.
        OutputError: MF401, MF402 for a directory that cannot be used.
    """
    if isinstance(camera, str | Path):
        if out is not None:
            raise JobError("MF105", f"{camera!r} is not a camera", where="sweep: camera", cure="Make one: Camera(...)")
        camera, out = None, camera
    if over is None:
        if not isinstance(study, str | Path):
            what = f"{type(study).__name__} does not state which of its keys vary"
            raise JobError("MF105", what, where="over", cure='Add over={"camera.pixel": ["1 um", "2 um"]}')
        require_form("over", {"dies": dies, "cases": cases, "camera": camera, "seed": seed or None}, of=False)
        if out is None:
            raise JobError("MF105", "there is no output directory", where="sweep: out", cure='Add out="build/sweep"')
    if out is not None:
        sweeping.check_folder(Path(out))
    if over is None:
        plan = planned(Path(str(study)))
    else:
        plan = _planned(job_of(study, camera, further=faults_of_plate), over, tuple(quantities), dies, cases, seed)
        if engine == "processes" and len(plan.cases) < _FEW and set(quantities) <= set(USUAL_QUANTITIES):
            engine = "serial"  # found in less time than processes take to start
    with nullcontext(out) if out is not None else TemporaryDirectory(prefix="maskfab-") as folder:
        swept = sweeping.made(plan, Path(folder), progress, engine=engine, scheduler=scheduler, workers=workers)
        if out is None:
            return Sweep(swept, None)
        write_sweep(Path(out), swept)
    return Sweep(swept, Path(out))


def _planned(
    job: Job, over: Mapping[str, Any], quantities: tuple[str, ...], dies: Sequence[str] | None, cases: int | None,
    seed: int,
) -> Plan:  # fmt: skip
    where = "sweep: over"
    if not over:
        raise JobError("MF105", "no key varies", where=where, cure='Write over={"camera.pixel": ["1 um", "2 um"]}')
    section = {
        "title": "Sweep", "job": job.where, "quantities": list(quantities), "cases": cases, "seed": seed,
        "dies": None if dies is None else list(dies),
    }  # fmt: skip
    fields = [_field(key, values) for key, values in over.items()]
    spec = parse_section(SweepSpec, {"sweep": section, "field": fields}, where=where)
    require_quantities(spec, where)
    return planned_of(spec, job, Path(job.where), where)


def _field(key: str, values: object) -> dict[str, object]:
    """A field as a study file has it; numbers of a key that is a length are micrometres."""
    table, *inner = key.split(".")
    path = f"die.*.{inner[0]}" if table == "die" and len(inner) == 1 else key
    where = f"sweep: over[{key!r}]"
    section = next(iter(sections_of(JobSpec.model_fields[table])), None) if table in JobSpec.model_fields else None
    is_length = section is not None and bool(inner) and inner[-1] in length_keys(section)
    of_light = inner[-1:] == ["wavelengths"]

    def stated(value: Any) -> Any:
        """One value, or a list of them, as a job file has it."""
        if isinstance(value, np.ndarray | np.generic):
            value = value.tolist()
        if isinstance(value, list | tuple):
            return [stated(item) for item in value]
        return wavelength_text(value, where) if of_light else length_text(value) if is_length else value

    if isinstance(values, Mapping):
        ends = ("from", "to", "uniform")
        return {"key": path, **{name: stated(value) if name in ends else value for name, value in values.items()}}
    listed = stated(values)
    if listed == []:
        raise JobError("MF105", "no value is stated", where=where, cure='Write {"camera.pixel": ["1 um", "2 um"]}')
    return {
        "key": path,
        "values": [read_value(one, where) for one in (listed if isinstance(listed, list) else [listed])],
    }


@answers(sweep)
def _sweep(asked: Asked) -> Told:
    swept: Sweep = asked.found()
    assert swept.directory is not None
    return Told.of(swept, [swept.directory / "sweep.html"], path=str(swept.directory))
