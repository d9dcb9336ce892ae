"""One file for each case of a sweep, under the hash of what it was found from."""

from __future__ import annotations

import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any, TypeAlias

from maskfab.files.atomic import not_writable, partial

Record: TypeAlias = Mapping[str, Any]
"""Of a case: its key, rows of numbers, and why it failed, or None."""


def make_folder(folder: Path) -> None:
    """Make the folder of the cases, before the first is looked for.

    Raises:
        OutputError: MF401 if it cannot be made.
    """
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise not_writable(folder, error) from error


def keep(folder: Path, record: Record) -> None:
    """Write a case under its key; nobody sees half a file.

    Raises:
        OutputError: MF401 if it cannot be written.
    """
    path = _path(folder, record["key"])
    path.parent.mkdir(parents=True, exist_ok=True)
    with partial(path) as aside:
        aside.write_text(json.dumps(record, ensure_ascii=False, allow_nan=False) + "\n", encoding="utf-8")


def kept(folder: Path, key: str) -> Record | None:
    """A case that was found before; None if there is none, or its file is damaged."""
    try:
        record: Any = json.loads(_path(folder, key).read_text(encoding="utf-8"))
        sound = record["key"] == key and (record["failed"] is not None or record["rows"])
    except (OSError, ValueError, KeyError, TypeError):
        return None
    return record if sound else None


def _path(folder: Path, key: str) -> Path:
    # A folder of a hundred thousand files is slow to list, and it is listed for every file that is written.
    return folder / key[:2] / f"{key}.json"
