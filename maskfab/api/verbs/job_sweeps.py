"""Sweeps: the same job with other values of some keys."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from maskfab.base.checks import checked_arguments
from maskfab.base.work import Progress, silent
from maskfab.job.reference import in_words
from maskfab.runs import sweep as sweeping
from maskfab.runs.sweep import rows_of, sweep_document, write_sweep
from maskfab.runs.sweep_numbers import Sensitivity, Swept, Yield
from maskfab.runs.sweep_plan import planned

if TYPE_CHECKING:
    from pandas import DataFrame

    from maskfab.runs.sweep_cases import Engine


_MOST_LINES = 12


@dataclass(frozen=True, eq=False, repr=False)
class Sweep:
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
        """Of every number to every field, of each number the strongest first."""
        return self.found.sensitivities

    @property
    def yields(self) -> tuple[Yield, ...]:
        """Cases that keep every limit."""
        return self.found.yields

    def to_dict(self) -> dict[str, Any]:
        """Everything that was found."""
        return sweep_document(self.found)

    def to_dataframe(self) -> DataFrame:
        """One row for each number of each case.

        Raises:
            OutputError: MF431 without pandas.
        """
        from maskfab.report.rows.text import dataframe

        return dataframe(list(rows_of(self.found)))

    def __str__(self) -> str:
        found = self.found
        lines = [f"{len(found.records)} cases, {found.remade} found now, {len(found.failed)} failed"]
        for each in found.sensitivities[:_MOST_LINES]:
            told = ", ".join(str(part) for part in each.of if part is not None)
            lines.append(f"  {told}: {each.range:.4g} over {each.field}, {each.share:.0%} of all")
        lines += [
            f"{each.die or 'all dies'}: {each.kept} of {each.cases} keep every limit, {each.low:.1%} to {each.high:.1%}"
            for each in found.yields
        ]
        lines += [f"case {number} failed: {why}" for number, why in found.failed[:_MOST_LINES]]
        lines += in_words(found.plan.unused)
        return "\n".join(lines)


@checked_arguments
def sweep(
    study: str | Path,
    out: str | Path,
    *,
    engine: Engine = "processes",
    scheduler: str | None = None,
    workers: int | None = None,
    progress: Progress = silent,
) -> Sweep:
    """Find numbers of a job for many values of its keys, and what they depend on.

    Every case is kept in ``out`` as soon as it is found, and not found again: a sweep that was killed goes on where it
    was.

    Args:
        study: a study file: the job, its fields with their values, the quantities wanted.
        out: directory of the cases, the table and the page.
        engine: ``"serial"``, ``"processes"``, or ``"dask"``; the table is the same.
        scheduler: address of a Dask scheduler.
        workers: processes; by default as many as there are processors.
        progress: told where the work stands.

    Raises:
        JobError: MF160 to MF162 for a study that cannot be; MF105 for keys, MF103 for units; MF164 for a scheduler.
        OutputError: MF401, MF402 for a directory that cannot be used; MF431 without dask.
    """
    directory = Path(out)
    sweeping.check_folder(directory)
    plan = planned(Path(study))
    found = sweeping.made(plan, directory, progress, engine=engine, scheduler=scheduler, workers=workers)
    write_sweep(directory, found)
    return Sweep(found, directory)
