"""The report that a person signs: what to build, the evidence for it, and one page a die.

One HTML file, rendered from report.json and its pictures, that needs nothing else and prints on A4 as it is: page 1 is
the decision, page 2 what it rests on, and then comes a page for each die. All other rows, figures and methods stand in
the appendix beside it, :mod:`maskfab.report.pages.appendix`.
"""

from __future__ import annotations

import hashlib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cache

from jinja2 import Template
from markupsafe import Markup

from maskfab.base.provenance import environments, versions
from maskfab.base.resources import template
from maskfab.base.units import UM_PER_MM
from maskfab.findings.photographs import middle_level
from maskfab.job.camera import median_nm
from maskfab.report.documents.numbers import methods
from maskfab.report.documents.report import report_text
from maskfab.report.documents.shape import WORST, Record
from maskfab.report.figures import die as die_figures
from maskfab.report.figures.display import seen_pixels
from maskfab.report.pages.appendix import by_name
from maskfab.report.pages.breaches import LimitLine, broken, judged_verdicts, limit_lines
from maskfab.report.pages.front import Best, assumptions, best, crops, decision, shown_dies, stamps
from maskfab.report.pages.tables import DieLine, die_table
from maskfab.report.pages.template import ROW_FILTERS, linked_places, page_environment, references, style
from maskfab.report.verdicts import FITS, LIVES, LOOKS

_KEY = (
    "restored_psnr", "restored_gain", "stop_open_ratio", WORST, "mtf50", "auc_radial_min", "halo_energy",
    "peak_to_side_lobe", "edge_colour_difference", "model_bar", "min_feature", "min_space", "readback_xor_area",
    "readback_psf_difference",
)  # fmt: skip
"""Numbers that a die's page has, in this order; others only where they fail."""
_MAIN = ("restored_psnr", "restored_gain", "readback_psf_difference", "flat_delta_e_mean", "model_bar")
"""Numbers whose methods page 2 tells in full."""
_COLUMNS = ("delta_e", "grain", "emitters", "life")
"""Numbers of displays that the table of dies has, by the names of :mod:`maskfab.report.pages.breaches`."""
_MOST_FAILED = 6
"""Kinds of failed checks that page 2 tells with their cures."""
SHORT_HASH = 16
"""Digits of a hash that tell two files apart by eye; the appendix has all."""


@dataclass(frozen=True)
class JudgedDie:
    """One line of the table of dies.

    Attributes:
        verdicts: FITS, LOOKS and LIVES, kept or not; None where it was not judged.
        cells: of :data:`_COLUMNS`; None where there is no such number.
        role: "best" or "reference", else empty.
    """

    line: DieLine
    verdicts: tuple[bool | None, ...]
    cells: tuple[LimitLine | None, ...]
    role: str
    failed: bool


@cache
def _page() -> Template:
    """The template of the page, compiled once for all reports of a process."""
    return page_environment(**ROW_FILTERS).from_string(template("report.html.j2"))


def html_page(
    document: Record,
    pictures: Mapping[str, Mapping[str, str]],
    made_with: Mapping[str, str] | None = None,
    *,
    view: bool = False,
    text: str | None = None,
) -> str:
    """The report as one HTML page.

    Args:
        document: report.json, as :func:`maskfab.report.documents.report.to_document` makes it.
        pictures: ``<img>`` elements by die and figure, as :func:`maskfab.report.figures.report.pictures` makes them;
            a figure that is missing is left out.
        made_with: versions of the programs that made it; by default those that are installed.
        text: of report.json, where it is there already.

    Equal documents and pictures give equal pages.
    """
    drawn = {place: {name: Markup(image) for name, image in images.items()} for place, images in pictures.items()}
    checks: Sequence[Record] = document["checks"]
    failures = by_name(check for check in checks if not check["passed"])
    leader = best(document)
    listed = methods(document)
    lines_nm = document["camera"]["wavelengths_nm"]
    dies = {die["name"]: die for die in document["dies"]}
    return _page().render(
        style=style(),
        document=document,
        whole=drawn.get(die_figures.PLATE, {}),
        drawn=drawn,
        stamps=stamps(document),
        decision=decision(document, leader),
        best=leader,
        best_die=dies.get(leader.name) if isinstance(leader, Best) else None,
        crops=list(crops(document, leader)),
        assumptions=assumptions(document),
        failures=failures[:_MOST_FAILED],
        more_failures=len(failures[_MOST_FAILED:]),
        table=die_table(document),
        judged=judged_dies(document, leader),
        shown=(shown := shown_dies(document)),
        eye_mm=eye_mm,
        left=len(dies) - len(shown),
        limit_lines=limit_lines,
        verdicts=lambda die: {name: name not in broken(die) for name in judged_verdicts(die)},
        key_rows=lambda die: key_rows(die, median_nm(lines_nm), _level(document)),
        middle_nm=median_nm(lines_nm),
        main=_main(document),
        refs=references(listed, "appendix.html"),
        view=view,
        places=linked_places,
        report_hash=hashlib.sha256((text or report_text(document)).encode()).hexdigest(),
        versions=versions() if made_with is None else made_with,
        environments=environments(
            document["job_hash"], document["maskfab_version"], [file["sha256"] for file in document["files"]]
        ),
        digits=SHORT_HASH,
    )


def judged_dies(document: Record, leader: Best | str) -> tuple[JudgedDie, ...]:
    """The dies side by side: those that keep every limit first, each group with the best photographs first."""
    dies = {die["name"]: die for die in document["dies"]}
    failed = {check["die"] for check in document["checks"] if not check["passed"] and "die" in check}
    table = die_table(document)
    rows = []
    for line in table.lines:
        die = dies[line.name]
        missed, asked = broken(die), judged_verdicts(die)
        numbers = {number.name: number for number in limit_lines(die)}
        role = "reference" if line.name == table.reference else ""
        if isinstance(leader, Best) and line.name == leader.name and not leader.broken:
            role = "best" if not role else "best, reference"
        rows.append(
            JudgedDie(
                line,
                tuple(name not in missed if name in asked else None for name in (FITS, LOOKS, LIVES)),
                tuple(numbers.get(name) for name in _COLUMNS),
                role,
                line.name in failed,
            )
        )
    return tuple(sorted(rows, key=lambda row: False in row.verdicts))


def eye_mm(die: Record) -> float | None:
    """True side of the pictures of what the eye sees of a die, in mm; None where it was not looked at."""
    pitch_um = (die.get("display", {}).get("looks") or {}).get("pitch_um")
    return None if pitch_um is None else float(seen_pixels(die["cells"]) * pitch_um / UM_PER_MM)


def key_rows(die: Record, middle_nm: float, level_db: float | None) -> list[Record]:
    """Numbers of a die's page: deciding ones at the middle wavelength and the front's light, and all that failed."""

    def rank(row: Record) -> int:
        name = WORST if row["name"].startswith(WORST) else row["name"]
        return _KEY.index(name) if name in _KEY else len(_KEY)

    chosen = [
        row
        for row in die["quantities"]
        if row["passed"] is False
        or (
            rank(row) < len(_KEY)
            and row.get("wavelength_nm", middle_nm) == middle_nm
            and row.get("level_db", level_db) == level_db
        )
    ]
    # Of each file a die has such rows: the worst stands for all.
    worst: dict[tuple[object, ...], Record] = {}
    for row in chosen:
        place = row["name"], row.get("wavelength_nm"), row.get("level_db")
        worst[place] = max(worst.get(place, row), row, key=_badness)
    return sorted(worst.values(), key=rank)


def _badness(row: Record) -> tuple[bool, float]:
    value = row["value"]
    return row["passed"] is False, float(value) if isinstance(value, int | float) else 0.0


def _level(document: Record) -> float | None:
    taken = document.get("photographs")
    return None if taken is None else middle_level(taken["levels_db"])


def _main(document: Record) -> list[Record]:
    """A row for each main number that a die has, the last die's: of the first there is no gain."""
    rows = {row["name"]: row for die in document["dies"] for row in die["quantities"]}
    return [rows[name] for name in _MAIN if name in rows]
