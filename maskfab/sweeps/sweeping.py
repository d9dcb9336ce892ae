"""A sweep, made: cases that were found before are taken as they are, the others found."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

from maskfab.errors import OutputError
from maskfab.files.atomic import not_writable
from maskfab.progress import Progress, silent
from maskfab.sweeps.case_files import Record, kept, make_folder
from maskfab.sweeps.numbers import Swept
from maskfab.sweeps.plan import Plan

if TYPE_CHECKING:
    from maskfab.sweeps.engines import Engine

CASES = "cases"
"""Folder of the cases, in the sweep's own."""


def check_folder(out: Path) -> None:
    """Refuse a folder that holds something else than a sweep.

    Raises:
        OutputError: MF401 for what is no folder, MF402 for a strange one.
    """
    try:
        if out.exists() and any(out.iterdir()) and not (out / CASES).is_dir():
            what = f"the directory {out} is not empty and holds no sweep"
            raise OutputError("MF402", what, cure="Give --out a new or empty folder, or that of this sweep")
    except OSError as error:
        raise not_writable(out, error) from error


def made(
    plan: Plan,
    out: Path,
    progress: Progress = silent,
    *,
    engine: Engine = "processes",
    scheduler: str | None = None,
    workers: int | None = None,
) -> Swept:
    """Make a sweep in a folder; what is in it of an earlier one, killed or finished, is not found again.

    Args:
        plan: that was checked.
        out: the folder.
        progress: told where the work stands.
        engine, scheduler, workers: as for :func:`maskfab.sweeps.engines.map_cases`.

    Raises:
        OutputError: MF401, MF402 for a folder that cannot be used; else as for the engine.
    """
    check_folder(out)
    folder = out / CASES
    records: dict[str, Record] = {}
    for case in plan.cases:
        if case.refused is not None:
            records[case.key] = {"key": case.key, "failed": case.refused, "rows": []}
        elif (found := kept(folder, case.key)) is not None:
            records[case.key] = found
    missing = list({case.key: case for case in plan.cases if case.key not in records}.values())
    if missing:
        from maskfab.sweeps.engines import map_cases  # which loads optics and photographs: a second, often

        found_now = map_cases(
            missing, plan.quantities, folder, progress, engine=engine, scheduler=scheduler, workers=workers
        )
        records |= {record["key"]: record for record in found_now}
    else:
        make_folder(folder)
    return Swept(plan, tuple(records[case.key] for case in plan.cases), len(missing))
