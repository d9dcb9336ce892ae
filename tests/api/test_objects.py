"""Panels and plates handed to other libraries hold the same clear area."""

from __future__ import annotations

import pytest
from klayout import db

import maskfab as mf


@pytest.fixture(scope="module")
def panel() -> mf.Panel:
    return mf.Panel.tile(mf.Opening.bar(dots=7, size=(5, 3), pitch="56 um"), size="112 um")


def test_chrome_and_clear_area_make_the_panel_in_every_library(panel: mf.Panel) -> None:
    film_mm = 0.02
    chrome_mm2 = panel.to_trimesh(chrome="20 um").volume / film_mm - 0.112**2 * 2.3 / film_mm
    clear_mm2 = panel.open_ratio * 0.112**2
    assert chrome_mm2 + clear_mm2 == pytest.approx(0.112**2, rel=1e-9)
    solids = [child.obj.val() for child in panel.to_cadquery(chrome="20 um").children if child.name != "GLASS"]
    assert sum(solid.Volume() for solid in solids) / film_mm == pytest.approx(chrome_mm2, rel=1e-9)
    plate = mf.Plate.of(
        P=panel,
        template="5in",
        camera=mf.Camera("5 mm", stop="100 um", pixel="2 um", wavelengths="530 nm", window="64 um"),
    )
    layout = plate.to_klayout()
    clear = db.Region(layout.top_cell().begin_shapes_rec(layout.layer(1, 0)))
    die = plate.layout().dies[0]
    x, y = die.centre_nm
    inside = clear & db.Region(db.Box(x - 56_000, y - 56_000, x + 56_000, y + 56_000))
    assert inside.area() * 1e-12 == pytest.approx(clear_mm2, rel=1e-12)


def test_a_thickness_needs_its_unit(panel: mf.Panel) -> None:
    with pytest.raises(mf.MaskfabError, match="MF103"):
        panel.to_trimesh(chrome="20")
