from __future__ import annotations

from dataclasses import replace

import pytest
from klayout import rdb

from maskfab.mask.design_rules import DesignRules
from maskfab.mask.layout import plate_names
from maskfab.mask.plate_rules import check_plate, write_markers

RULES = DesignRules(min_width_nm=5000, no_corner_touch=True, forbidden_names=("ring", "cd"), max_references=3)


def test_markers_open_on_the_plate(small_plate, tmp_path):
    top, path = plate_names(small_plate).top, tmp_path / "plate.lyrdb"
    results = check_plate(small_plate, RULES)
    write_markers(results, top, path)
    database = rdb.ReportDatabase("read")
    database.load(str(path))
    assert database.top_cell_name == top
    assert [cell.name() for cell in database.each_cell()] == [top]
    names = [category.name() for category in database.each_category()]
    assert names == ["width", "corner_touch", "forbidden_name", "forbidden_name_2", "references"]
    placed = sum(max(1, len(result.places) + len(result.names)) for result in results if not result.passed)
    assert database.num_items() == placed
    width = database.category_by_path("width")
    broken = [result for result in results if result.rule == "width" and not result.passed]
    assert broken[-1].die is None
    last = list(database.each_item_per_category(width.rdb_id()))[-1]
    expected = broken[-1]
    box, text = last.each_value()
    corners = box.box()
    assert len(expected.places) == 1
    sides = [corners.left, corners.bottom, corners.right, corners.top]
    assert sides == pytest.approx([value / 1000 for value in expected.places[0]])
    assert text.string() == f"plate: {expected.count} in all, worst 2000 nm"


def test_equal_results_give_equal_bytes(small_plate, tmp_path):
    results = check_plate(small_plate, RULES)
    for name in ("a", "b"):
        write_markers(results, "TOP", tmp_path / name)
    assert (tmp_path / "a").read_bytes() == (tmp_path / "b").read_bytes()
    write_markers([replace(result, count=0) for result in results], "TOP", tmp_path / "c")
    database = rdb.ReportDatabase("read")
    database.load(str(tmp_path / "c"))
    assert database.num_items() == 0
