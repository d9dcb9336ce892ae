from __future__ import annotations

import re
from dataclasses import replace

import numpy as np
import pytest
from klayout import db

from maskfab.base.model import CLEAR, NOTE, OUTLINE, Opening, orient
from maskfab.mask.layout import CellNames, plate_layout, plate_names, region
from maskfab.mask.raster import coverage


def test_one_top_cell_and_names_fit_for_every_format(small_plate):
    layout = plate_layout(small_plate)
    assert [cell.name for cell in layout.top_cells()] == ["SMALL_PLATE"]
    names = [cell.name for cell in layout.each_cell()]
    assert names == sorted(names)
    assert len(set(names)) == len(names)
    for name in names:
        assert re.fullmatch(r"[A-Z0-9_]{1,32}", name)
        assert "MAIN" not in name


def test_only_orientations_in_use_are_drawn_and_dies_share_them(small_plate):
    units = plate_names(small_plate).units
    for die in small_plate.dies:
        used = {key.orientation for key in units if key.opening == die.panel.opening.name}
        assert set(np.unique(die.panel.orientations)) <= used
    ring = [key for key in units if key[0] == "ring"]
    assert len(ring) == len(np.union1d(small_plate.dies[0].panel.orientations, small_plate.dies[2].panel.orientations))


def test_a_periodic_die_is_one_array(small_plate):
    layout = plate_layout(small_plate)
    (array,) = layout.cell("PERIODIC").each_inst()
    assert (array.na, array.nb) == (5, 4)
    assert layout.cell("RANDOM").child_instances() == 20
    assert all(not inst.trans.is_mirror() and inst.trans.angle == 0 for inst in layout.cell("RANDOM").each_inst())


def test_every_cell_of_a_panel_stands_where_the_model_says(small_plate):
    layout = plate_layout(small_plate)
    for die in small_plate.dies:
        panel, (x0, y0) = die.panel, die.origin_nm
        for (row, column), orientation in np.ndenumerate(panel.orientations):
            x, y = x0 + column * panel.pitch_nm, y0 + row * panel.pitch_nm
            dots = panel.gutter_nm // 2 + panel.dot_nm * np.arange(panel.opening.dots + 1.0)
            share = coverage(region(layout, CLEAR, (x, y, x + panel.pitch_nm, y + panel.pitch_nm)), x + dots, y + dots)
            assert np.array_equal(share, orient(panel.opening.mask, int(orientation)))


def test_gutters_stay_opaque(small_plate):
    layout, die = plate_layout(small_plate), small_plate.dies[0]
    clear_um2 = region(layout, CLEAR, die.box_nm).area()
    cells = die.panel.orientations.size
    assert clear_um2 == cells * die.panel.opening.clear_dots * die.panel.dot_nm**2


def test_marks_and_notes_keep_to_their_layers(small_plate):
    layout = plate_layout(small_plate)
    assert region(layout, OUTLINE).bbox() == db.Box(-5_000_000, -5_000_000, 5_000_000, 5_000_000)
    assert region(layout, NOTE).is_empty()
    (note,) = layout.top_cell().shapes(layout.layer(11, 0)).each()
    assert (note.text_string, note.text_pos.y) == ("job 0123abcd", -4_000_000)


def test_region_of_one_cell_is_in_its_own_coordinates(small_plate):
    layout = plate_layout(small_plate)
    die = small_plate.dies[0]
    own = region(layout, CLEAR, cell="PERIODIC")
    assert (own.moved(*die.origin_nm) ^ region(layout, CLEAR, die.box_nm)).is_empty()


def test_region_of_a_layer_that_is_not_there_is_empty(small_plate):
    assert region(plate_layout(small_plate), db.LayerInfo(77, 7)).is_empty()


def test_openings_that_share_a_name_but_not_a_shape_get_two_cells(small_plate):
    die = small_plate.dies[0]
    twin = Opening(die.panel.opening.name, ~die.panel.opening.mask, die.panel.dot_nm)
    other = replace(die, name="TWIN", centre_nm=(0, 2_000_000), panel=replace(die.panel, opening=twin))
    plate = replace(small_plate, dies=(die, other))
    layout = plate_layout(plate)
    assert len(plate_names(plate).units) == 2
    first, second = (region(layout, CLEAR, each.box_nm).area() for each in plate.dies)
    assert first != second


@pytest.mark.parametrize(
    ("wishes", "given"),
    [
        (["die 1", "die-1", "DIE_1"], ["DIE_1", "DIE_1_2", "DIE_1_3"]),
        (["domain"], ["DOMA_IN"]),
        (["µ", ""], ["_", "CELL"]),
        (["x" * 40, "x" * 40], ["X" * 32, "X" * 30 + "_2"]),
    ],
)
def test_cell_names(wishes, given):
    names = CellNames()
    assert [names.unique(wish) for wish in wishes] == given


def test_a_suffix_survives_a_long_name():
    name = CellNames().unique("y" * 60, "_D8000_G0_R3")
    assert len(name) == 32
    assert name.endswith("_D8000_G0_R3")
