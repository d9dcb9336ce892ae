"""The directory of something measured: its page, its numbers and a manifest, whole or not at all."""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

from maskfab.files.finished import write_mark
from maskfab.files.staging import Place, staged

SCHEMA_VERSION = 1
DOCUMENT, PAGE = "measure.json", "measure.html"


def write_measured(
    place: Place, document: Mapping[str, Any], page: str, more: Callable[[Path], None] | None = None
) -> list[Path]:
    """Write everything into a directory that appears whole, and return the paths.

    Args:
        place: where.
        document: what measure.json says; its ``job_hash`` is None without a job.
        page: HTML.
        more: writes other files into the folder that it is given.

    Raises:
        OutputError: MF401 or MF404 as :func:`maskfab.files.staging.staged`.
    """
    with staged(place) as folder:
        (folder / PAGE).write_text(page, encoding="utf-8")
        (folder / DOCUMENT).write_text(_json(document), encoding="utf-8")
        if more is not None:
            more(folder)
        write_mark(folder, document["job_hash"])
    return sorted(place.asked.iterdir())


def _json(told: Mapping[str, Any]) -> str:
    return json.dumps(told, indent=1, ensure_ascii=False, allow_nan=False) + "\n"
