"""The files of a sweep: its page, and its table as JSON and as CSV."""

from __future__ import annotations

import csv
import io
import json
import math
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from maskfab.base import __version__
from maskfab.files.atomic import partial
from maskfab.sweeps.numbers import Swept

SCHEMA_VERSION = 1
DOCUMENT, TABLE, PAGE = "sweep.json", "sweep.csv", "sweep.html"
_COLUMNS = ("name", "die", "wavelength_nm", "level_db", "value", "uncertainty", "unit", "limit", "passed")


def sweep_document(found: Swept) -> dict[str, Any]:
    """Everything that was found; what sweep.json and ``--json`` say."""
    plan = found.plan
    return {
        "schema_version": SCHEMA_VERSION,
        "maskfab_version": __version__,
        "digest": plan.digest,
        "job_hash": plan.job.digest,
        "title": plan.spec.sweep.title,
        "fields": [{"key": field.name, "unit": field.unit, "drawn": field.drawn} for field in plan.fields],
        "yields": [vars(each) for each in found.yields],
        "sensitivities": [
            {**each.of._asdict(), **{k: _finite(v) for k, v in vars(each).items() if k != "of"}}
            for each in found.sensitivities
        ],
        "unused": list(plan.unused),
        "failed": [{"case": number, "why": why} for number, why in found.failed],
        "cases": [
            {"case": number, "values": list(case.stated), **record}
            for number, (case, record) in enumerate(zip(plan.cases, found.records, strict=True))
        ],
    }


def rows_of(found: Swept) -> Iterator[dict[str, Any]]:
    """One row for each number of each case, and one for a case that failed."""
    plan = found.plan
    names = [field.name for field in plan.fields]
    for number, (case, record) in enumerate(zip(plan.cases, found.records, strict=True)):
        head = {"case": number, **dict(zip(names, case.stated, strict=True))}
        for row in record["rows"] or [dict.fromkeys(_COLUMNS)]:
            yield {**head, **row, "failed": record["failed"]}


def write_sweep(out: Path, found: Swept) -> list[Path]:
    """Write page and tables into the sweep's folder, beside its cases; what is there and still true stays.

    Raises:
        OutputError: MF401 if they cannot be written.
    """
    paths = [out / PAGE, out / DOCUMENT, out / TABLE]
    document = json.dumps(sweep_document(found), indent=1, ensure_ascii=False, allow_nan=False) + "\n"
    unchanged = not found.remade and all(path.is_file() for path in paths)
    if unchanged and (out / DOCUMENT).read_text(encoding="utf-8") == document:
        return paths
    from maskfab.report.page.sweep_page import sweep_page

    # The document last: where it is up to date, the others are.
    for path, text in ((paths[0], sweep_page(found)), (paths[2], _csv(found)), (paths[1], document)):
        with partial(path) as aside:
            aside.write_text(text, encoding="utf-8", newline="")
    return paths


def _csv(found: Swept) -> str:
    rows = rows_of(found)
    text = io.StringIO()
    first = next(rows)
    table = csv.DictWriter(text, list(first), lineterminator="\n")
    table.writeheader()
    table.writerow(first)
    table.writerows(rows)
    return text.getvalue()


def _finite(value: Any) -> Any:
    """None for what is no number: JSON has none."""
    return None if isinstance(value, float) and not math.isfinite(value) else value
