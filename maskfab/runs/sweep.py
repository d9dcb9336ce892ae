"""A sweep, made: cases that were found before are taken as they are, the others found; then its page and its tables."""

from __future__ import annotations

import csv
import io
import json
import math
from collections.abc import Iterator
from itertools import chain
from pathlib import Path
from typing import TYPE_CHECKING, Any

from maskfab.base import __version__
from maskfab.base.errors import OutputError
from maskfab.base.files import partial, writing
from maskfab.base.work import Progress, silent
from maskfab.runs.store import Record, kept, make_folder
from maskfab.runs.sweep_numbers import Swept
from maskfab.runs.sweep_plan import Plan

if TYPE_CHECKING:
    from maskfab.runs.sweep_cases import Engine


CASES = "cases"
"""Folder of the cases, in the sweep's own."""


def check_folder(out: Path) -> None:
    """Refuse a folder that holds something else than a sweep."""
    with writing(out):
        if out.exists() and any(out.iterdir()) and not (out / CASES).is_dir():
            what = f"the directory {out} is not empty and holds no sweep"
            raise OutputError("MF402", what, cure="Give --out a new or empty folder, or that of this sweep")


def made(
    plan: Plan,
    out: Path,
    progress: Progress = silent,
    *,
    engine: Engine = "processes",
    scheduler: str | None = None,
    workers: int | None = None,
) -> Swept:
    """Make a sweep in a folder; what is in it of an earlier one, killed or finished, is not found again."""
    check_folder(out)
    folder = out / CASES
    records: dict[str, Record] = {}
    for case in plan.cases:
        if case.refused is not None:
            records[case.key] = {"key": case.key, "failed": case.refused, "rows": []}
        elif (earlier := kept(folder, case.key)) is not None:
            records[case.key] = earlier
    missing = list({case.key: case for case in plan.cases if case.key not in records}.values())
    if missing:
        # It loads optics and photographs, which takes a second, often.
        from maskfab.runs.sweep_cases import map_cases, workers_of

        found_now = map_cases(missing, plan.quantities, folder, progress, workers_of(engine, scheduler, workers))
        records |= {record["key"]: record for record in found_now}
    else:
        make_folder(folder)
    return Swept(plan, tuple(records[case.key] for case in plan.cases), len(missing))


SCHEMA_VERSION = 1
DOCUMENT, TABLE, PAGE = "sweep.json", "sweep.csv", "sweep.html"
_COLUMNS = ("name", "die", "wavelength_nm", "level_db", "value", "uncertainty", "unit", "limit", "passed")


def sweep_document(swept: Swept) -> dict[str, Any]:
    """Everything that was found; what sweep.json and ``--json`` say."""
    plan = swept.plan
    return {
        "schema_version": SCHEMA_VERSION,
        "maskfab_version": __version__,
        "digest": plan.digest,
        "job_hash": plan.job.digest,
        "title": plan.spec.sweep.title,
        "fields": [{"key": field.name, "unit": field.unit, "drawn": field.drawn} for field in plan.fields],
        "yields": [vars(share) for share in swept.yields],
        "sensitivities": [
            {**effect.of._asdict(), **{k: _finite(v) for k, v in vars(effect).items() if k != "of"}}
            for effect in swept.sensitivities
        ],
        "unused": list(plan.unused),
        "failed": [{"case": number, "why": why} for number, why in swept.failed],
        "cases": [
            {"case": number, "values": list(case.stated), **record}
            for number, (case, record) in enumerate(zip(plan.cases, swept.records, strict=True))
        ],
    }


def rows_of(swept: Swept) -> Iterator[dict[str, Any]]:
    """One row for each number of each case, and one for a case that failed."""
    plan = swept.plan
    names = [field.name for field in plan.fields]
    for number, (case, record) in enumerate(zip(plan.cases, swept.records, strict=True)):
        head = {"case": number, **dict(zip(names, case.stated, strict=True))}
        for row in record["rows"] or [dict.fromkeys(_COLUMNS)]:
            yield {**head, **row, "failed": record["failed"]}


def write_sweep(out: Path, swept: Swept) -> list[Path]:
    """Write page and tables into the sweep's folder, beside its cases; what is there and still true stays."""
    paths = [out / PAGE, out / DOCUMENT, out / TABLE]
    document = json.dumps(sweep_document(swept), indent=1, ensure_ascii=False, allow_nan=False) + "\n"
    unchanged = not swept.remade and all(path.is_file() for path in paths)
    if unchanged and (out / DOCUMENT).read_text(encoding="utf-8") == document:
        return paths
    from maskfab.runs.sweep_page import sweep_page

    rows = rows_of(swept)
    first, csv_text = next(rows), io.StringIO()
    table = csv.DictWriter(csv_text, list(first), lineterminator="\n")
    table.writeheader()
    table.writerows(chain([first], rows))
    # The document last: where it is up to date, the others are.
    for path, text in ((paths[0], sweep_page(swept)), (paths[2], csv_text.getvalue()), (paths[1], document)):
        with partial(path) as aside:
            aside.write_text(text, encoding="utf-8", newline="")
    return paths


def _finite(value: Any) -> Any:
    """None for what is no number: JSON has none."""
    return None if isinstance(value, float) and not math.isfinite(value) else value
