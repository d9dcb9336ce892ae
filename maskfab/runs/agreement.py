"""Page, table and report.json of a finished folder held against one another, as a reader meets them: by text alone.

A number that one of them tells otherwise is found before the folder has its name, with nothing of what wrote them.
"""

from __future__ import annotations

import csv
import hashlib
import json
import math
import re
from collections import Counter
from collections.abc import Iterable, Iterator, Mapping
from html import unescape
from pathlib import Path
from typing import Any

from maskfab.base.errors import InternalError
from maskfab.base.folders import APPENDIX, JOB_COPY, NUMBERS, PAGE, REPORT, RESULT_MARK
from maskfab.base.model import Quantity
from maskfab.mask.formats.table import LAYOUT_SUFFIXES
from maskfab.mask.judge.awake import missing
from maskfab.mask.judge.sources import digest

_ROW = re.compile(r'<tr>\s*<td title="(?P<name>[^"]+)">.*?</tr>', re.DOTALL)
_CELL = re.compile(r'<td class="n" title="(?P<exact>[^"]*)">(?P<shown>[^<]*)')
_EXACT = re.compile(r"(?P<number>-?\d+(\.\d+)?(e[-+]?\d+)?)( ± (?P<error>\S+))?( [^\d\s]\S*)?")
_NUMBER = re.compile(r"(?P<digits>[-−]?\d+(?:\s\d{3})*(?:\.\d+)?)(?:\s×\s10(?P<power>[⁻⁰¹²³⁴⁵⁶⁷⁸⁹]+))?")
_POWERS = str.maketrans("⁻⁰¹²³⁴⁵⁶⁷⁸⁹", "-0123456789")
_COLUMNS = ("die", "name", "value", "error", "unit", "limit", "passed", "wavelength_nm", "level_db")


def check_agreement(folder: Path) -> int:
    """Hold what a folder's texts say against one another; returns how many numbers were compared."""
    report = json.loads((folder / REPORT).read_text("utf-8"))
    _check_provenance(folder, report)
    rows = [_told(die["name"], row) for die in report["dies"] for row in (*die["quantities"], *_of_scene(die))]
    rows += [_told("", row) for row in report["plate"]]
    with (folder / NUMBERS).open(encoding="utf-8", newline="") as stream:
        table = [tuple(line[column] for column in _COLUMNS) for line in csv.DictReader(stream)]
    for place in (Counter(table) - Counter(rows), Counter(rows) - Counter(table)):
        for row in place:
            _refuse(NUMBERS, f"{row[1]} of {row[0] or 'the plate'}", f"has {row[2]} {row[4]} in one of the two")
    values: dict[str, set[str]] = {}
    for row in (*rows, *(_told("", check) for check in report["checks"])):
        values.setdefault(row[1], set()).update((row[2], row[5]))
    told: set[str] = set()
    compared = len(table)
    for page in (PAGE, APPENDIX):
        for name, exact, error, shown in _cells((folder / page).read_text("utf-8")):
            if name not in values:
                continue
            told.add(name)
            compared += 1
            if exact not in values[name] and float(exact) not in {
                float(own) for own in values[name] if _is_number(own)
            }:
                _refuse(page, name, f"is {exact} there, and nowhere in {REPORT}")
            if not _rounds_to(exact, shown, error):
                _refuse(page, name, f"of {exact} is shown as {shown}")
    owed = {row[1] for row in rows if row[0] and row[7] and _is_number(row[2])}
    if lost := sorted(owed - told):
        _refuse(APPENDIX, lost[0], "is not there")
    return compared


def _check_provenance(folder: Path, report: Mapping[str, Any]) -> None:
    """Hold hashes against bytes and the job's copy, and the verdict against checks, none of which may lack."""
    manifest = json.loads((folder / RESULT_MARK).read_text("utf-8"))
    for file in manifest["files"]:
        if hashlib.sha256((folder / file["path"]).read_bytes()).hexdigest() != file["sha256"]:
            _refuse(RESULT_MARK, file["path"], "has another SHA-256")
    of_copy = digest(json.loads((folder / JOB_COPY).read_text("utf-8")))
    for name, said in ((REPORT, report["job_hash"]), (RESULT_MARK, manifest["job_hash"])):
        if said != of_copy:
            _refuse(name, "the job's hash", f"is {said[:16]}..., and that of {JOB_COPY} {of_copy[:16]}...")
    failed = [row["name"] for row in report["checks"] if row["passed"] is False]
    if failed and report["verdict"] == "pass":
        _refuse(REPORT, failed[0], "has failed, and the verdict is pass")
    checks = [Quantity(row["name"], 0, row["method"], die=row.get("die")) for row in report["checks"] if _judged(row)]
    drawn = [file["path"] for file in report["files"] if Path(file["path"]).suffix.lower() in LAYOUT_SUFFIXES]
    if lost_rows := missing(checks, drawn, [die["name"] for die in report["dies"]]):
        _refuse(REPORT, lost_rows[0], "is not among the checks")
    own = Counter(row["name"] for row in report["checks"])
    every = (row for rows in (report["plate"], *(die["quantities"] for die in report["dies"])) for row in rows)
    if lost := Counter(row["name"] for row in every if row["passed"] is not None) - own:
        _refuse(REPORT, next(iter(lost)), "is judged, and not among the checks")


def _judged(row: Mapping[str, Any]) -> bool:
    return bool(row["name"].startswith("judged_") and row["passed"] is not None)


def _refuse(file: str, name: str, what: str) -> None:
    cure = "Please report this with the job file; nothing was written"
    raise InternalError(
        "MF329", f"what a run has written does not agree, in {file}: {name} {what}", where=file, cure=cure
    )


def _of_scene(die: Mapping[str, Any]) -> Iterable[Mapping[str, Any]]:
    rows: Iterable[Mapping[str, Any]] = (die.get("scene") or {}).get("quantities", ())
    return rows


def _told(die: str, row: Mapping[str, Any]) -> tuple[str, ...]:
    """A row of report.json as the table has it."""
    own = {**row, "die": die, "error": row.get("uncertainty")}
    return tuple(_text(own.get(column)) for column in _COLUMNS)


def _text(value: object) -> str:
    if value is None:
        return ""
    return value if isinstance(value, str) else json.dumps(value)


def _cells(page: str) -> Iterator[tuple[str, str, float, str]]:
    """Name, exact value, its error and shown value of every number in the tables of a page."""
    for row in _ROW.finditer(page):
        for cell in _CELL.finditer(row[0]):
            exact = _EXACT.fullmatch(unescape(cell["exact"]))
            if exact is not None:
                yield row["name"], exact["number"], float(exact["error"] or 0), unescape(cell["shown"]).strip()


def _is_number(text: str) -> bool:
    return re.fullmatch(r"-?\d+(\.\d+)?(e[-+]?\d+)?", text) is not None


def _rounds_to(exact: str, shown: str, error: float) -> bool:
    """Whether a number is shown to half a unit of its last digit, tens if unknown to units; words are not judged."""
    found = _NUMBER.match(shown)
    if found is None:
        return True
    digits = re.sub(r"\s", "", found["digits"]).replace("−", "-")
    power = 10.0 ** int((found["power"] or "⁰").translate(_POWERS))
    unit = power * 10.0 ** -len(digits.partition(".")[2])
    if error >= 10:
        unit = max(unit, 10.0 ** math.floor(math.log10(error)))
    return abs(float(digits) * power - float(exact)) <= 0.5001 * unit + 1e-12 * abs(float(exact))
