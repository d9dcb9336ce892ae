"""Limits of what is read, by counts that follow from the drawing."""

from __future__ import annotations

import pytest
from hostile_files import arrayed
from klayout import db

from maskfab.base.errors import SourceError
from maskfab.mask import layout as shape_limits
from maskfab.mask.formats.table import read_layout
from maskfab.mask.layout import most_covered, weight

pytestmark = pytest.mark.usefixtures("read_here")


@pytest.mark.parametrize(("along", "refused"), [(10, False), (11, True)])
def test_what_covers_one_place_too_often_is_refused_with_how_often(tmp_path, along, refused):
    """Squares of 1000 nm at steps of 1 nm."""
    path = arrayed(tmp_path / "x.gds", db.Box(0, 0, 1000, 1000), 1, along)
    layout = db.Layout()
    layout.read(str(path))
    covered = along**2 * 1000**2 / (999 + along) ** 2
    assert most_covered(layout, layout.find_layer(1, 0)) == pytest.approx(covered, rel=1e-12)
    if not refused:
        read_layout(path)
        return
    with pytest.raises(SourceError, match=f"MF326 .*{covered:.3g} times over"):
        read_layout(path)


def test_a_place_is_covered_as_often_where_it_is_magnified(tmp_path):
    layout = db.Layout()
    layer, cell, top = layout.layer(1, 0), layout.create_cell("A"), layout.create_cell("TOP")
    cell.shapes(layer).insert(db.Box(0, 0, 100, 100))
    for _ in range(3):
        top.insert(db.CellInstArray(cell.cell_index(), db.ICplxTrans(2.5, 0, False, 0, 0)))
    assert most_covered(layout, layer) == pytest.approx(3)


def test_shapes_are_counted_by_their_vertices_until_there_are_too_many(tmp_path):
    layout = db.Layout()
    layer, top = layout.layer(1, 0), layout.create_cell("TOP")
    top.shapes(layer).insert(db.Box(0, 0, 100, 100))
    top.shapes(layer).insert(db.Polygon.ellipse(db.Box(0, 0, 1000, 1000), 64))
    assert weight(top.begin_shapes_rec(layer), 1000) == 1 + 16
    assert weight(top.begin_shapes_rec(layer), 1000, 5) == 1 + 5
    layout.read(str(arrayed(tmp_path / "x.gds", db.Box(0, 0, 10, 10), 20, 100, 3)))
    assert weight(layout.cell("C3").begin_shapes_rec(layout.layer(1, 0)), 100) == 101


@pytest.mark.parametrize("suffix", [".gds", ".oas", ".cif"])
def test_a_polygon_of_too_many_vertices_is_refused_before_it_is_drawn(tmp_path, monkeypatch, suffix):
    """Whether it crosses itself is not asked any more, which takes longest."""
    monkeypatch.setattr(shape_limits, "MOST_VERTICES", 60)
    monkeypatch.setattr(shape_limits, "_refuse_crossing", lambda *_: pytest.fail("it is looked through"))
    path = arrayed(tmp_path / f"x{suffix}", db.Polygon.ellipse(db.Box(0, 0, 1_000_000, 1_000_000), 64), 10**7, 1)
    with pytest.raises(SourceError, match=r"MF313 .*a polygon of 64 vertices; the limit is 60"):
        read_layout(path)
