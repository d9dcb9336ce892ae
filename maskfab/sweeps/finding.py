"""One case, found: plain data, the same whoever finds it."""

from __future__ import annotations

import json
import math
from collections.abc import Mapping
from pathlib import Path
from typing import Any, TypeAlias

from maskfab.errors import InputError, JobError
from maskfab.files.atomic import partial
from maskfab.job import resolve
from maskfab.jobfile import validate
from maskfab.model import Quantity
from maskfab.sweeps.measures import measured
from maskfab.sweeps.plan import Case
from maskfab.threads import one_thread

Record: TypeAlias = Mapping[str, Any]
"""Of a case: its key, rows of numbers, and why it failed, or None."""


def find(key: str, document: Mapping[str, Any], quantities: tuple[str, ...]) -> Record:
    """The numbers of a case, or why it has none.

    Args:
        key: of the case.
        document: of its job, self-contained.
        quantities: names of those that are wanted.
    """
    try:
        job = resolve(validate(document, where="case"), Path("case.toml"))
        rows = [_row(quantity) for quantity in measured(job, quantities)]
    except InputError as refusal:
        return {"key": key, "failed": f"{refusal.code} {refusal.what}", "rows": []}
    return {"key": key, "failed": None, "rows": rows}


@one_thread
def find_by_one_thread(key: str, document: Mapping[str, Any], quantities: tuple[str, ...]) -> Record:
    """:func:`find` in a process that others have set up, which may use more threads."""
    return find(key, document, quantities)


def find_and_keep(folder: Path, key: str, document: Mapping[str, Any], quantities: tuple[str, ...]) -> Record:
    """:func:`find`, and keep it as soon as it is found."""
    record = find(key, document, quantities)
    keep(folder, record)
    return record


def keep(folder: Path, record: Record) -> None:
    """Write a case under its key; nobody sees half a file.

    Raises:
        OutputError: MF401 if it cannot be written.
    """
    path = _path(folder, record["key"])
    path.parent.mkdir(parents=True, exist_ok=True)
    with partial(path) as aside:
        aside.write_text(json.dumps(record, ensure_ascii=False, allow_nan=False) + "\n", encoding="utf-8")


def kept(folder: Path, case: Case) -> Record | None:
    """A case that was found before; None if there is none, or its file is damaged."""
    try:
        record: Any = json.loads(_path(folder, case.key).read_text(encoding="utf-8"))
        sound = record["key"] == case.key and (record["failed"] is not None or record["rows"])
    except (OSError, ValueError, KeyError, TypeError):
        return None
    return record if sound else None


def _path(folder: Path, key: str) -> Path:
    # A folder of a hundred thousand files is slow to list, and it is listed for every file that is written.
    return folder / key[:2] / f"{key}.json"


def _row(quantity: Quantity) -> dict[str, Any]:
    """A number as data.

    Raises:
        JobError: MF163 for one that is not finite.
    """
    value = quantity.value
    if isinstance(value, float) and not math.isfinite(value):
        raise JobError("MF163", f"{quantity.name} is not finite", cure="Leave these values out")
    return {
        "name": quantity.name,
        "die": quantity.die,
        "wavelength_nm": quantity.wavelength_nm,
        "level_db": quantity.level_db,
        "value": value,
        "uncertainty": quantity.uncertainty,
        "unit": quantity.unit,
        "limit": quantity.limit,
        "passed": quantity.passed,
    }
