"""Places of violations as :func:`maskfab.export.markers.write_markers` has written them, for a page."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
from klayout import rdb

from maskfab.errors import OutputError
from maskfab.geometry.plate_layout import DBU_UM
from maskfab.report.viewer.varints import packed


def rule_places(path: Path) -> list[dict[str, Any]]:
    """Rules that were broken: ``name``, ``description``, ``told`` in words, and packed ``places``.

    Places are x0, y0, x1, y1 in nm, each less the one before.

    Raises:
        OutputError: MF407 if it is no marker file.
    """
    database = rdb.ReportDatabase("places")
    try:
        database.load(str(path))
    except RuntimeError as error:
        raise OutputError(
            "MF407", f"{path} cannot be read: {error}", cure="Run its job again with this version"
        ) from error
    return [_category(database, each) for each in database.each_category()]


def _category(database: rdb.ReportDatabase, category: rdb.RdbCategory) -> dict[str, Any]:
    told, boxes = [], []
    for item in database.each_item_per_category(category.rdb_id()):
        for value in item.each_value():
            if value.is_box():
                box = value.box()
                boxes.append([round(each / DBU_UM) for each in (box.left, box.bottom, box.right, box.top)])
            elif value.is_string():
                told.append(str(value.string()))
    places = np.array(boxes, dtype=np.int64).reshape(-1, 4)
    return {
        "name": str(category.name()),
        "description": str(category.description),
        "told": told,
        "places": packed(np.diff(places, axis=0, prepend=np.zeros((1, 4), dtype=np.int64))),
    }
