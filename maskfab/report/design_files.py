"""The files of a design: its page, its numbers, the opening and its map."""

from __future__ import annotations

import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from maskfab.files.finished import write_mark
from maskfab.files.staging import Place, staged
from maskfab.report.page.design_page import design_page

DOCUMENT, PAGE = "design.json", "design.html"


def write_design(place: Place, document: Mapping[str, Any], files: Mapping[str, str]) -> list[Path]:
    """Write everything into a directory that appears whole, and return the paths.

    Args:
        place: where.
        document: what design.json says.
        files: texts of the opening and its map, by their names.

    Raises:
        OutputError: MF401 or MF404 as :func:`maskfab.files.staging.staged`.
    """
    text = json.dumps(document, indent=1, ensure_ascii=False, allow_nan=False) + "\n"
    with staged(place) as folder:
        for name, content in {**files, DOCUMENT: text, PAGE: design_page(json.loads(text))}.items():
            (folder / name).write_text(content, encoding="utf-8")
        write_mark(folder, document["job_hash"])
    return sorted(place.asked.iterdir())
