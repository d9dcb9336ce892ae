"""Finished reports side by side."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from maskfab.base.checks import checked_arguments
from maskfab.base.errors import JobError
from maskfab.base.folders import check_target, staged, write_mark
from maskfab.report.pages.compared import Compared, compare_page, compare_reports, compare_text
from maskfab.report.pages.finished import read_reports

if TYPE_CHECKING:
    from maskfab.runs.pipeline import Result


PAGE = "compare.html"


@dataclass(frozen=True, repr=False)
class Comparison:
    """Dies of finished reports side by side.

    Attributes:
        compared: everything that was found.
    """

    compared: Compared

    def to_dict(self) -> dict[str, Any]:
        """Rankings, numbers, what cannot be compared, and where the jobs differ."""
        return self.compared.to_dict()

    def save(self, folder: str | Path) -> Path:
        """Write the page into a folder that appears whole, and return its path.

        Raises:
            OutputError: MF401 or MF402 if the folder cannot be written, or is not empty.
        """
        place = check_target(Path(folder), force=False)
        with staged(place) as made:
            (made / PAGE).write_text(compare_page(self.compared), encoding="utf-8")
            write_mark(made, None)
        return Path(folder) / PAGE

    def __str__(self) -> str:
        return "\n".join(compare_text(self.compared))

    def __repr__(self) -> str:
        return str(self)


@checked_arguments
def compare(
    *reports: str | Path | Result | Sequence[str | Path | Result],
    dies: Sequence[str] = (),
    reference: str | None = None,
) -> Comparison:
    """Put the dies of finished runs side by side: paired differences over the same photographs, numbers, jobs.

    Args:
        reports: directories of finished runs, report.json files, or results of :func:`maskfab.run`, one by one or in
            a list; of one, its dies are compared.
        dies: only these, by ``DIE`` or, of several reports, ``REPORT:DIE``.
        reference: die that gains are over; by default that of the first report.

    Raises:
        JobError: MF105 for a die that is not there, for nothing to compare, and for what is no report.
        OutputError: MF403 for a place without a report; MF407 for one that was edited, is damaged, or of another
            version.
    """
    every = [each for given in reports for each in (given if isinstance(given, list | tuple) else [given])]
    if not every:
        cure = "Give the directories of finished runs"
        raise JobError("MF105", "there is no report to compare", where="compare: reports", cure=cure)
    read = read_reports([_place(each) for each in every])
    return Comparison(compare_reports(read, dies, reference))


def _place(report: object) -> Path:
    if isinstance(report, str | Path):
        return Path(report)
    from maskfab.runs.pipeline import Result  # which brings along all that runs

    if not isinstance(report, Result):
        cure = "Give the directory of a finished run, or the result of run()"
        raise JobError("MF105", f"a {type(report).__name__} is no report", where="compare: reports", cure=cure)
    return report.directory
