"""Dies side by side: of finished runs, and panels as designed, which are photographed for it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from os import PathLike
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

from maskfab.api.asked import AnyPanel, AnyReport, job_of, panels_of
from maskfab.api.results import Asked, InPython, Result, Told, answers
from maskfab.base.checks import checked_arguments
from maskfab.base.errors import JobError, UnknownNameError
from maskfab.base.folders import check_target, staged, write_mark
from maskfab.base.work import Progress, silent

if TYPE_CHECKING:
    from pandas import DataFrame

    from maskfab.api.camera import Camera
    from maskfab.base.model import DieOptics
    from maskfab.mask.job import Job
    from maskfab.report.documents.report import FinishedReport
    from maskfab.report.figures.sheet import Drawing
    from maskfab.report.pages.compared import Compared
    from maskfab.report.text import Quantities
    from maskfab.runs.as_designed import AsDesigned

PAGE = "compare.html"
_CONDITIONS = ("sensor", "exposure", "scene", "curves")
"""Sections of a job, beside its camera, that photographs are taken under."""


@dataclass(frozen=True, repr=False)
class Comparison(Result):
    """Dies of finished reports, or panels as designed, side by side.

    compared: everything that was found.
    optics: of dies that come from panels, their MTF and numbers, by the names that they are compared under.
    """

    compared: Compared
    optics: Mapping[str, DieOptics] = field(default_factory=dict)
    notes: tuple[str, ...] = ()

    def __getitem__(self, die: str) -> Quantities:
        from maskfab.report.text import Quantities

        if die not in self.optics:
            cure = f"Use one of {', '.join(self.optics)}" if self.optics else "Ask the run: run[die]"
            raise UnknownNameError("MF432", f"no panel {die!r} was compared", cure=cure)
        return Quantities(self.optics[die].quantities)

    def to_dict(self) -> dict[str, Any]:
        """Rankings, numbers, what cannot be compared, where the jobs differ, and what was assumed."""
        return {**self.compared.to_dict(), **({"notes": list(self.notes)} if self.notes else {})}

    def rows(self) -> list[dict[str, Any]]:
        """Rows: one for each number of each die."""
        dies = self.compared.document["dies"]
        return [{"die": die["name"], **row} for die in dies for row in die["quantities"]]

    def plot(self) -> Drawing | None:
        """The MTF in the worst direction where all dies come from panels; else light against photographs, of all."""
        shown = [self.optics[name] for name in self._names if name in self.optics]
        if len(shown) == len(self._names):
            from maskfab.report.figures.die import mtf_comparison

            return mtf_comparison(shown)
        from maskfab.report.pages.compared import trade

        return None if self.compared.table.level_db is None else trade(self.compared.document)

    @property
    def _names(self) -> list[str]:
        return [die["name"] for die in self.compared.document["dies"]]

    def table(self) -> DataFrame:
        """The table that is shown, a row for each die, the best first; :meth:`to_dataframe` has every number.

        Gains are means in dB, beside half their interval; numbers that a die has not are missing values.
        """
        from maskfab.report.pages.compared import compare_records
        from maskfab.report.text import dataframe

        table = dataframe(compare_records(self.compared))
        return table.set_index("die")

    def save(self, out: Annotated[str | Path, "FOLDER"]) -> Path:
        """Write the page into a folder that appears whole, and return its path.

        Args:
            out: new folder for a page with the figure.
        """
        from maskfab.report.pages.compared import compare_page

        place = check_target(Path(out), force=False)
        with staged(place) as made:
            (made / PAGE).write_text(compare_page(self.compared), encoding="utf-8")
            write_mark(made, None)
        return Path(out) / PAGE

    def __str__(self) -> str:
        from maskfab.report.pages.compared import compare_text

        return "\n".join([*compare_text(self.compared), *self.notes])

    def _repr_html_(self) -> str:
        from maskfab.report.pages.compared import compare_html

        return f"{self._shown()}{compare_html(self.compared, self.notes)}"


@checked_arguments
def compare(
    *reports: Annotated[AnyReport | Sequence[AnyReport] | Mapping[str, AnyPanel], "REPORT..."],
    camera: Camera | None = None,
    dies: Annotated[Sequence[str], "[RUN:]DIE"] = (),
    reference: str | None = None,
    progress: InPython[Progress] = silent,
) -> Comparison:
    """Put the dies of finished runs side by side: paired differences over the same photographs, numbers, jobs.

    Who is best and how sure, what cannot be compared, and how the jobs differ. In Python also panels and openings as
    designed, of which no file is written: they are photographed now, beside a run under the run's own conditions.

    Examples:
        $ maskfab compare build/upc12
        $ maskfab compare build/upc12 build/mine --reference upc12:TOLED_P150 --out build/side_by_side
        >>> import maskfab as mf
        >>> bar = mf.Opening.bar(dots=21, size=(15, 7), pitch="168 um")
        >>> print(mf.compare([bar, mf.Panel.tile(bar, "random", seed=1, size="4.4 mm")]))  # doctest: +SKIP

    Args:
        reports: finished runs, or report.json files; of one, its dies are compared. In Python also results of
            :func:`maskfab.run`, panels, openings, plates and loaded jobs, one by one, in a list, or panels by name.
        camera: of panels and plates; by default that of the first run or job beside them, the plate's, or that of
            protocol F1.
        dies: die to compare, of several reports ``RUN:DIE``; by default all.
        reference: die that gains are over; by default that of the first report.
        progress: told where the work stands.

    Raises:
        JobError: MF105 for a die that is not there, for nothing to compare, and for what is no report; MF114 for a
            panel that does not cover the stop; else as :func:`maskfab.simulate`.
        OutputError: MF403 for a place without a report; MF407 for one that was edited, is damaged, or of another
            version.
    """
    every = [source for given in reports for source in (given if isinstance(given, list | tuple) else [given])]
    if not every:
        cure = "Give directories of finished runs, or two panels"
        raise JobError("MF105", "there is no report to compare", where="compare: reports", cure=cure)
    from maskfab.report.documents.report import named_apart, read_reports
    from maskfab.report.pages.compared import compare_reports

    read = read_reports([Path(source) for source in every if isinstance(source, str | PathLike)])
    jobs = _jobs([source for source in every if not isinstance(source, str | PathLike)], camera, read)
    if camera is not None and not jobs:
        what = "finished runs have cameras of their own"
        raise JobError("MF105", what, where="camera", cure="Leave camera out: it goes with panels")
    made = _as_designed(jobs, progress)
    reported = named_apart([*read, *(one.report for one in made)])
    optics = {
        item.die.name if len(reported) == 1 else f"{report.name}:{item.die.name}": item
        for report, one in zip(reported[len(read) :], made, strict=True)
        for item in one.optics
    }
    compared = compare_reports(reported, dies, reference)
    named = {die["name"].rpartition(":")[2] for die in compared.document["dies"]}
    return Comparison(compared, optics, tuple(note for _, job in jobs for note in job.assumptions(named)))


def _jobs(sources: Sequence[Any], camera: Camera | None, beside: Sequence[FinishedReport]) -> list[tuple[str, Job]]:
    """Jobs of what is no finished report, and their names: plates and jobs by themselves, all panels together."""
    from maskfab.api.plate import Plate
    from maskfab.mask.job import Job

    jobs, named, listed = list[tuple[str, Job]](), dict[str, Any](), list[Any]()
    for source in sources:
        if isinstance(source, Job):
            jobs.append((Path(source.where).stem, source))
        elif isinstance(source, Plate):
            jobs.append((source.heading.name, job_of(source, camera)))
        elif isinstance(source, Mapping):
            named |= source
        else:
            listed.append(source)
    if named or listed:
        taken = [*(report.job for report in beside), *(job.spec.dump() for _, job in jobs)]
        lens, sections = _taken_as(next((job for job in taken if job is not None), None), camera)
        panels = {**(panels_of(listed, lens) if listed else {}), **named}
        jobs.append(("panels", job_of(panels, lens, sections)))
    return jobs


def _as_designed(jobs: Sequence[tuple[str, Job]], progress: Progress) -> list[AsDesigned]:
    if not jobs:
        return []
    from maskfab.runs.as_designed import as_designed

    return [as_designed(job, name, progress) for name, job in jobs]


@answers(compare)
def _compare(asked: Asked) -> Told:
    if asked.out is not None:
        check_target(asked.out, force=False)
    stated = dict(asked.stated)
    comparison = compare(*stated.pop("reports"), **stated)
    paths = [] if asked.out is None else [str(comparison.save(asked.out))]
    if asked.as_json:
        return Told(comparison.to_dict(), (), asides=paths)
    return Told(comparison.to_dict(), [*str(comparison).split("\n"), *paths])


def _taken_as(job: Mapping[str, Any] | None, camera: Camera | None) -> tuple[Camera | None, dict[str, Any]]:
    """Camera and sections by which panels are photographed as the dies of a job were."""
    if job is None:
        return camera, {}
    from maskfab.api.camera import Camera
    from maskfab.job.camera import Camera as Lens
    from maskfab.job.faults import parse_section

    theirs = Camera.of_section(parse_section(Lens, job["camera"], where="camera of the run"))
    return camera or theirs, {key: job[key] for key in _CONDITIONS if key in job}
