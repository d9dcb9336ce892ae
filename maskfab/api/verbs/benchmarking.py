"""Every way to a PSF, timed and compared with an exact one."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from maskfab.api.jobs import AnyJob, dies_of, job_of
from maskfab.base.checks import checked_arguments
from maskfab.base.folders import check_target
from maskfab.base.work import Progress, silent
from maskfab.job.reference import USES, in_words, unused
from maskfab.optics import benchmark
from maskfab.optics.benchmark import Timing


@dataclass(frozen=True, eq=False, repr=False)
class Benchmark:
    """Time and error of every method.

    Attributes:
        timings: by contestant.
        bound_ms: processor time of the matrix products alone, by precision.
        absent: libraries that are not installed, and why.
        unused: keys and tables that the job states and the race does not depend on.
    """

    timings: Sequence[Timing]
    bound_ms: Mapping[str, float]
    absent: Mapping[str, str]
    unused: tuple[str, ...] = ()

    def to_dict(self) -> dict[str, Any]:
        """Everything that was measured."""
        return {
            **benchmark.race_document(self.timings, self.bound_ms, self.absent),
            "unused": list(self.unused),
        }

    def picture(self) -> bytes:
        """A PNG of error against time."""
        return benchmark.race_figure(self.timings)

    def save(self, out: str | Path) -> list[Path]:
        """Write figure and results into a new directory.

        Raises:
            OutputError: MF401 or MF402 for a place that cannot be written.
        """
        check_target(Path(out), force=False)
        return benchmark.write_accuracy(Path(out), self.to_dict(), self.picture())

    def __str__(self) -> str:
        return "\n".join([*benchmark.race_table(self.timings, self.bound_ms, self.absent), *in_words(self.unused)])

    def _repr_png_(self) -> bytes:
        return self.picture()


@checked_arguments
def bench(
    job: AnyJob | None = None, *, die: str | None = None, rounds: int = 9, progress: Progress = silent
) -> Benchmark:
    """Time every PSF method and compare each with the exact one.

    Args:
        job: a plate, a loaded job, or the path of a job file; a standard panel if None.
        die: of the job; by default the first.
        rounds: how often each is timed.
        progress: told where the work stands.

    Raises:
        JobError: MF105 for a die that the job does not have.
    """
    left: tuple[str, ...] = ()
    if job is None:
        workload = benchmark.standard_workload()
    else:
        loaded = job_of(job)
        loaded.check_window()
        left = unused(loaded.spec, *USES["bench"])
        panels = {each.name: each.panel for each in loaded.plate().dies}
        workload = benchmark.workload_of(panels[dies_of(die, panels)[0]], loaded.camera)
    timings = benchmark.race(workload, rounds, progress)
    return Benchmark(timings, benchmark.gemm_bound_ms(workload), benchmark.absent(), left)
