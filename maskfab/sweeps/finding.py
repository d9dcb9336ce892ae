"""One case, found: plain data, the same whoever finds it."""

from __future__ import annotations

import math
import time
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from maskfab.errors import InputError, JobError
from maskfab.job import resolve
from maskfab.jobfile import validate
from maskfab.model import Quantity
from maskfab.sweeps.case_files import Record, keep
from maskfab.sweeps.measures import measured
from maskfab.threads import one_thread


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
def find_by_one_thread(
    cases: Sequence[tuple[str, Mapping[str, Any]]], quantities: tuple[str, ...]
) -> tuple[list[Record], float]:
    """:func:`find` for some cases in a process that others have set up, which may use more threads; and its seconds."""
    start = time.perf_counter()
    records = [find(key, document, quantities) for key, document in cases]
    return records, time.perf_counter() - start


def find_and_keep(folder: Path, key: str, document: Mapping[str, Any], quantities: tuple[str, ...]) -> Record:
    """:func:`find`, and keep it as soon as it is found."""
    record = find(key, document, quantities)
    keep(folder, record)
    return record


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
