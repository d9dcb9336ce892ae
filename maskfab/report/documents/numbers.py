"""numbers.csv, and the list of methods: every number of report.json in one table, each way of finding one told once.

EMVA 1288 demands that every quantity which a report shows also stands in a file under a fixed name, with symbol, value
and unit; this is that file. Methods are long sentences, and dozens of numbers share one: rows refer to it.
"""

from __future__ import annotations

import csv
import io
import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from maskfab.report.documents.shape import Record

COLUMNS = (
    "die", "name", "symbol", "value", "unit", "error", "limit", "passed", "at_most", "wavelength_nm", "level_db",
    "method", "remark",
)  # fmt: skip
"""Of the table. A row without a die is of the plate; ``method`` is a key of the list of :func:`methods`."""


def rows_of(document: Record) -> Iterator[tuple[str, Record]]:
    """Every number with the name of its die, "" for the plate's, in the order of report.json."""
    for die in document["dies"]:
        for row in (*die["quantities"], *die.get("scene", {}).get("quantities", ())):
            yield die["name"], row
    for row in document["plate"]:
        yield "", row


@dataclass(frozen=True)
class Methods:
    """Ways in which numbers were found.

    Attributes:
        keys: by which rows refer to them, by their sentence: M1, M2 and so on, by first use.
        parts: sentence and remark of a row, by its name and its method as report.json has it.
    """

    keys: Mapping[str, str]
    parts: Mapping[tuple[str, str], tuple[str, str]]

    def of(self, row: Record) -> tuple[str, str]:
        """Key of a row's method, and what is said of this row alone; both empty for a row without a method."""
        sentence, remark = self.parts.get((row["name"], row["method"]), ("", ""))
        return self.keys.get(sentence, ""), remark


def methods(document: Record) -> Methods:
    """The list of methods: of sentences on one quantity that begin alike, the clauses that all have are the method, and
    the others a remark on their row."""
    rows = [(row["name"], row["method"]) for _, row in rows_of(document)]
    rows += [(row["name"], row["method"]) for row in document["checks"]]
    for die in document["dies"]:
        plan = die.get("scene", {}).get("plan", {})
        rows += [(row["name"], row["method"]) for row in plan.get("ingredients", ())]
    alike: dict[tuple[str, str], list[tuple[str, ...]]] = {}
    for name, sentence in dict.fromkeys(row for row in rows if row[1]):
        clauses = tuple(_CLAUSE.split(sentence))
        alike.setdefault((name, clauses[0]), []).append(clauses)
    shared = {place: _common(own) for place, own in alike.items()}
    parts = {}
    for name, sentence in rows:
        clauses = tuple(_CLAUSE.split(sentence))
        count = shared.get((name, clauses[0]), 0)
        parts[name, sentence] = " ".join(clauses[:count]).rstrip(";:"), " ".join(clauses[count:])
    used = dict.fromkeys(method for method, _ in parts.values() if method)
    return Methods({method: f"M{number}" for number, method in enumerate(used, start=1)}, parts)


_CLAUSE = re.compile(r"(?<=[;:]) ")


def _common(sentences: Sequence[tuple[str, ...]]) -> int:
    return next(
        (count for count, clauses in enumerate(zip(*sentences, strict=False)) if len(set(clauses)) > 1),
        min(map(len, sentences)),
    )


def numbers_text(document: Record) -> str:
    """The table as CSV (RFC 4180, lines end with a line feed), a line for each row of :func:`rows_of`.

    Numbers have every digit that report.json has; what is null there is empty. Equal documents give equal texts.
    """
    listed = methods(document)
    buffer = io.StringIO()
    table = csv.writer(buffer, lineterminator="\n")
    table.writerow(COLUMNS)
    for die, row in rows_of(document):
        method, remark = listed.of(row)
        own = {**row, "die": die, "error": row["uncertainty"], "method": method, "remark": remark}
        table.writerow([_cell(own.get(column)) for column in COLUMNS])
    return buffer.getvalue()


def _cell(value: Any) -> str:
    """A value as the table has it: true and false as JSON spells them."""
    if value is None:
        return ""
    if isinstance(value, bool):
        return "true" if value else "false"
    return value if isinstance(value, str) else repr(value)
