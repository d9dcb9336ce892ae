"""Sweeps: the same job with other values of some keys."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

from maskfab.api.results import Asked, Result, Told, answers
from maskfab.base.checks import checked_arguments
from maskfab.base.work import Progress, silent
from maskfab.job.reference import in_words
from maskfab.runs import sweep as sweeping
from maskfab.runs.sweep import rows_of, sweep_document, write_sweep
from maskfab.runs.sweep_numbers import Sensitivity, Swept, Yield
from maskfab.runs.sweep_plan import planned

if TYPE_CHECKING:
    from maskfab.runs.sweep_cases import Engine


_MOST_LINES = 12


@dataclass(frozen=True, eq=False, repr=False)
class Sweep(Result):
    """A sweep that was made.

    Attributes:
        found: every case.
        directory: of its files.
    """

    found: Swept
    directory: Path

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


@checked_arguments
def sweep(
    study: str | Path,
    out: Annotated[str | Path, "FOLDER"],
    *,
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

    Args:
        study: study file (.toml): the job, its fields with their values, the quantities wanted.
        out: directory of the cases, the table and the page; cases in it are not found again.
        engine: who finds the cases; the table is the same.
        scheduler: address of a Dask scheduler, such as tcp://127.0.0.1:8786.
        workers: processes; by default as many as there are processors.
        progress: told where the work stands.

    Raises:
        JobError: MF160 to MF162 for a study that cannot be; MF105 for keys, MF103 for units; MF152 for a cluster
            without dask; MF164 for a scheduler.
        OutputError: MF401, MF402 for a directory that cannot be used.
    """
    directory = Path(out)
    sweeping.check_folder(directory)
    plan = planned(Path(study))
    swept = sweeping.made(plan, directory, progress, engine=engine, scheduler=scheduler, workers=workers)
    write_sweep(directory, swept)
    return Sweep(swept, directory)


@answers(sweep)
def _sweep(asked: Asked) -> Told:
    swept: Sweep = asked.found()
    return Told.of(swept, [swept.directory / "sweep.html"], path=str(swept.directory))
