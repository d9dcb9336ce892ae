from __future__ import annotations

import numpy as np
import pytest
from klayout import db

from maskfab.mask.layout import CellArray, placed

KINDS = np.random.default_rng(3).integers(0, 3, (4, 5))


def one_by_one(names, grids):
    """The layout that klayout's own references make."""
    layout = db.Layout()
    cells = {name: layout.create_cell(name) for name in names}
    for name, filled in grids.items():
        for grid in filled:
            for (row, column), kind in np.ndenumerate(grid.index):
                x, y = (o + s * n for o, s, n in zip(grid.origin_nm, grid.step_nm, (column, row), strict=True))
                cells[name].insert(db.CellInstArray(cells[grid.cells[kind]].cell_index(), db.Trans(int(x), int(y))))
    return layout


@pytest.mark.parametrize("first", ["A_MARK", "Z_MARK"])
def test_references_are_those_that_klayout_would_insert(first):
    units = ("B", "BCD", "LONG_NAME_OF_32_CHARACTERS_ABCDE")
    names = ["TOP", "B_DIE", "C_DIE", first, *units]
    grids = {
        "B_DIE": [
            CellArray(units, KINDS, (-2_000_000_000, 7), (1_000_001, 3)),
            CellArray(units[:2], KINDS % 2, (5, 5), (9, 9)),
        ],
        "C_DIE": [CellArray(units[1:2], np.zeros((3, 2), dtype=np.int64), (1, 2), (30, 40))],
    }
    layout = placed(names, grids)
    diff = db.LayoutDiff()
    assert diff.compare(layout, one_by_one(names, grids), db.LayoutDiff.FlattenArrayInsts)
    assert (layout.dbu, layout.cells()) == (0.001, len(names))
    leading = min(first, "TOP")
    assert [cell.name for cell in layout.each_cell()] == [leading, *(name for name in sorted(names) if name != leading)]
    assert list(layout.each_meta_info()) == []
    assert [each.size() for each in layout.cell("C_DIE").each_inst()] == [6]


def test_a_cell_of_grids_is_never_first():
    layout = placed(["A", "B", "C", "TOP"], {"A": [CellArray(("B", "C"), np.array([[0, 1]]), (0, 0), (1, 1))]})
    assert [cell.name for cell in layout.each_cell()] == ["TOP", "A", "B", "C"]
    assert sorted(cell.name for cell in layout.top_cells()) == ["A", "TOP"]
