"""Finished reports as they are read back to be compared."""

from __future__ import annotations

import json
import os
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from maskfab import provenance
from maskfab.errors import JobError, OutputError
from maskfab.files.finished import JOB_COPY, REPORT, read_manifest
from maskfab.report.documents.report_data import SCHEMA_VERSION
from maskfab.report.side_by_side.told_report import check_told

_MOST_BYTES = 200_000_000
_AGAIN = "Name the --out of a finished maskfab run, or its report.json; of another version, run its job again"


@dataclass(frozen=True)
class FinishedReport:
    """One report.

    Attributes:
        name: told of it: of its folder.
        document: of report.json.
        job: the resolved job beside it; None for a report that stands alone.
        proved: whether the manifest beside it says that nobody changed it since.
    """

    name: str
    document: Mapping[str, Any]
    job: Mapping[str, Any] | None
    proved: bool


def read_reports(paths: list[Path]) -> tuple[FinishedReport, ...]:
    """Reports by their folders, or by their own paths; of equal names, each with a number.

    Raises:
        OutputError: MF403 for a place without a report, MF407 for one that was edited, is damaged, or of another
            version.
        JobError: MF105 for a report that is named twice, or is equal to another in all that it says.
    """
    found = [_read(path) for path in paths]
    for number, each in enumerate(found):
        earlier = next((n for n, other in enumerate(found[:number]) if other.document == each.document), None)
        if earlier is not None:
            raise JobError(
                "MF105",
                f"report {number + 1}, {each.name}, is the same as report {earlier + 1}, {found[earlier].name}",
                where="REPORT",
                cure="Name each report once; two dies of one report are compared by naming it alone",
            )
    names = [each.name for each in found]
    return tuple(
        FinishedReport(
            name if names.count(name) == 1 else f"{name}#{names[:number].count(name) + 1}",
            each.document,
            each.job,
            each.proved,
        )
        for number, (name, each) in enumerate(zip(names, found, strict=True))
    )


def _read(path: Path) -> FinishedReport:
    file = path / REPORT if os.path.isdir(path) else path
    try:
        if file.stat().st_size > _MOST_BYTES:
            raise OutputError("MF407", f"{file} is longer than {_MOST_BYTES / 1e6:g} MB", cure=_AGAIN)
        document = json.loads(file.read_bytes())
    except OSError as error:
        raise OutputError("MF403", f"{file} cannot be read: {error.strerror or error}", cure=_AGAIN) from error
    except (ValueError, RecursionError) as error:
        raise OutputError("MF407", f"{file} is truncated or damaged: {error}", cure=_AGAIN) from error
    version = document.get("schema_version") if isinstance(document, dict) else None
    if version != SCHEMA_VERSION:
        what = f"{file} is of schema {version!r}; this version compares {SCHEMA_VERSION}"
        raise OutputError("MF407", what, cure=_AGAIN)
    proved = _proved(file)
    try:
        check_told(document)
    except ValueError as error:
        raise OutputError("MF407", f"{file} is no report that can be compared: {error}", cure=_AGAIN) from error
    return FinishedReport(_printable(file.resolve().parent.name), document, _job(file) if proved else None, proved)


def _printable(name: str) -> str:
    """A folder's name without what moves a terminal's cursor, or no text can hold."""
    return "".join(letter if letter.isprintable() else "\N{REPLACEMENT CHARACTER}" for letter in name)


def _proved(file: Path) -> bool:
    """Whether the manifest beside a report knows its hash; False without a manifest.

    Raises:
        OutputError: MF407 if it knows another.
    """
    try:
        rows = read_manifest(file.parent)["files"]
    except OutputError:
        return False
    known = next((row["sha256"] for row in rows if row["path"] == file.name), None)
    if known != provenance.sha256_of_file(file):
        raise OutputError("MF407", f"{file} was changed since its run finished", cure=_AGAIN)
    return True


def _job(file: Path) -> Mapping[str, Any] | None:
    try:
        job = json.loads((file.parent / JOB_COPY).read_bytes())
    except (OSError, ValueError, RecursionError):
        return None
    return job if isinstance(job, dict) else None
