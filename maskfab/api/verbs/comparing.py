"""Finished reports side by side."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from maskfab.files.finished import write_mark
from maskfab.files.staging import check_target, staged
from maskfab.report.side_by_side.compared import Compared, compare_reports
from maskfab.report.side_by_side.finished_report import read_reports
from maskfab.report.side_by_side.page import compare_page, compare_text

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


def compare(*reports: str | Path, dies: Sequence[str] = (), reference: str | None = None) -> Comparison:
    """Put the dies of finished runs side by side: paired differences over the same photographs, numbers, jobs.

    Args:
        reports: directories of finished runs, or report.json files; of one, its dies are compared.
        dies: only these, by ``DIE`` or, of several reports, ``REPORT:DIE``.
        reference: die that gains are over; by default that of the first report.

    Raises:
        JobError: MF105 for a die that is not there, or for nothing to compare.
        OutputError: MF403 for a place without a report; MF407 for one that was edited, is damaged, or of another
            version.
    """
    read = read_reports([Path(each) for each in reports])
    return Comparison(compare_reports(read, dies, reference))
