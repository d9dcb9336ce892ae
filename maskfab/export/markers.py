"""Violations of design rules as a marker file (.lyrdb) that KLayout shows on top of the plate."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path

from klayout import db, rdb

from maskfab.drc.results import RuleResult
from maskfab.geometry.plate_layout import DBU_UM

_DESCRIPTIONS = {
    "width": "clear polygons narrower than {limit} {unit}",
    "space": "clear edges closer than {limit} {unit}",
    "notch": "edges of one clear polygon closer than {limit} {unit}",
    "area": "clear polygons of less than {limit} {unit}",
    "chrome_area": "islands of chrome of less than {limit} {unit}",
    "corner_touch": "corners that kiss",
    "grid": "vertices off the grid of {limit} {unit}",
    "manhattan": "edges that run along neither axis",
    "acute_angle": "corners sharper than {limit} {unit}",
    "overlap": "areas drawn more than once",
    "vertices": "polygons of more than {limit} vertices",
    "references": "more than {limit} references",
    "name_pattern": "cell names that do not match {limit}",
    "forbidden_name": "cell names that contain {limit}",
    "name_length": "cell names of more than {limit} characters",
    "extent": "shapes outside {limit} {unit} about the origin",
}


def write_markers(results: Iterable[RuleResult], top_cell: str, path: Path) -> None:
    """Write what rules found as a report database; equal results give equal bytes.

    Every rule that was broken is a category, described with its limit; rules on several limits of one name are told
    apart by a number. Each placed violation is a box on the top cell in micrometres, each name a text. The first item
    of every owner carries the number of violations and the worst value, for only the first are placed.

    Args:
        results: what :func:`maskfab.drc.plate_rules.check_plate` or ``check_layout`` returned.
        top_cell: name of the layout's top cell, in whose coordinates the places are.
        path: the file to write.
    """
    database = rdb.ReportDatabase("design rules")
    database.description = f"Design rules of {top_cell}"
    database.generator = "maskfab"
    database.top_cell_name = top_cell
    cell = database.create_cell(top_cell)
    categories: dict[tuple[str, int | str], rdb.RdbCategory] = {}
    for result in results:
        if result.passed:
            continue
        key = result.rule, result.limit
        if key not in categories:
            alike = sum(rule == result.rule for rule, _ in categories)
            categories[key] = database.create_category(f"{result.rule}_{alike + 1}" if alike else result.rule)
            text = _DESCRIPTIONS[result.rule]
            categories[key].description = text.format(limit=result.limit, unit=result.unit)
        # An item with neither place nor name still says that the rule is broken.
        markers: list[db.DBox | str] = [db.DBox(*(value * DBU_UM for value in box)) for box in result.places]
        for n, marker in enumerate([*markers, *result.names] or [result.rule]):
            item = database.create_item(cell.rdb_id(), categories[key].rdb_id())
            item.add_value(marker)
            if n == 0:
                item.add_value(_summary(result))
    database.save(str(path))


def _summary(result: RuleResult) -> str:
    owner = f"die {result.die}" if result.die is not None else "plate"
    return f"{owner}: {result.count} in all, worst {result.value} {result.unit}".rstrip()
