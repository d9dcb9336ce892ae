"""numbers.csv, and the list of methods: every number of report.json in one table, each way of finding one told once.

EMVA 1288 demands that every quantity which a report shows also stands in a file under a fixed name, with symbol, value
and unit; this is that file. Methods are long sentences, and dozens of numbers share one: rows refer to it.
"""

from __future__ import annotations

import csv
import io
from collections.abc import Iterator
from typing import Any

from maskfab.report.documents.shape import Record

COLUMNS = (
    "die", "name", "symbol", "value", "unit", "error", "limit", "passed", "at_most", "wavelength_nm", "level_db",
    "method",
)  # fmt: skip
"""Of the table. A row without a die is of the plate; ``method`` is a key of :func:`methods`."""


def rows_of(document: Record) -> Iterator[tuple[str, Record]]:
    """Every number with the name of its die, "" for the plate's, in the order of report.json."""
    for die in document["dies"]:
        for row in (*die["quantities"], *die.get("scene", {}).get("quantities", ())):
            yield die["name"], row
    for row in document["plate"]:
        yield "", row


def methods(document: Record) -> dict[str, str]:
    """Ways in which numbers were found, each with the key by which rows refer to it: M1, M2 and so on, by first use."""
    sentences = [row["method"] for _, row in rows_of(document)]
    sentences += [row["method"] for row in document["checks"]]
    for die in document["dies"]:
        plan = die.get("scene", {}).get("plan", {})
        sentences += [row["method"] for row in plan.get("ingredients", ())]
    return {sentence: f"M{number}" for number, sentence in enumerate(dict.fromkeys(filter(None, sentences)), start=1)}


def numbers_text(document: Record) -> str:
    """The table as CSV (RFC 4180, lines end with a line feed), a line for each row of :func:`rows_of`.

    Numbers have every digit that report.json has; what is null there is empty. Equal documents give equal texts.
    """
    keys = methods(document)
    buffer = io.StringIO()
    table = csv.writer(buffer, lineterminator="\n")
    table.writerow(COLUMNS)
    for die, row in rows_of(document):
        own = {**row, "die": die, "error": row["uncertainty"], "method": keys.get(row["method"], "")}
        table.writerow([_cell(own.get(column)) for column in COLUMNS])
    return buffer.getvalue()


def _cell(value: Any) -> str:
    """A value as the table has it: true and false as JSON spells them."""
    if value is None:
        return ""
    if isinstance(value, bool):
        return "true" if value else "false"
    return value if isinstance(value, str) else repr(value)
