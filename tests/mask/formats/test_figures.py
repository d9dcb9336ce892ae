from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from klayout import db
from trips import roundtrip

from maskfab.base.errors import OutputError
from maskfab.base.model import CLEAR, NOTE, OUTLINE, Die, Mark, Note, Opening, Panel, Plate, Tiling
from maskfab.mask.figures import CUT, PolygonOptions, draw
from maskfab.mask.formats.dxf_writer import write_dxf
from maskfab.mask.formats.format import DrawingStyle
from maskfab.mask.formats.gdsii import write_gdsii, write_oasis
from maskfab.mask.formats.table import read_layout
from maskfab.mask.layout import plate_layout, region

pytestmark = pytest.mark.usefixtures("read_here")

EVERY = [
    PolygonOptions(hierarchy=hierarchy, holes=holes, corners=corners, max_vertices=most)
    for hierarchy, holes, corners, most in [
        ("cells", "bisect", "joined", 4094),
        ("cells", "keyhole", "apart", 4094),
        ("cells", "trapezoids", "apart", 4094),
        ("cells", "layer", "apart", 4094),
        ("cells", "layer", "joined", 12),
        ("cells", "bisect", "apart", 6),
        ("flat", "bisect", "apart", 4094),
        ("flat", "keyhole", "joined", 30),
        ("merged", "bisect", "apart", 4094),
        ("merged", "keyhole", "joined", 200),
        ("merged", "layer", "apart", 4094),
    ]
]
every_option = pytest.mark.parametrize("options", EVERY, ids=str)


def exposed(layout):
    return region(layout, CLEAR) - region(layout, CUT)


def drawn(layout):
    """Every polygon on written layers, all references followed."""
    for layer in (CLEAR, CUT):
        index = layout.find_layer(layer.number, layer.datatype)
        if index is not None:
            places = layout.top_cell().begin_shapes_rec(index)
            while not places.at_end():
                yield places.shape().polygon
                places.next()


@every_option
def test_what_is_exposed_is_the_design(small_plate, tmp_path, options):
    figures = draw(small_plate, options)
    path = tmp_path / "x.gds"
    write_gdsii(figures.layout(), path, options.max_vertices)
    read = read_layout(path)
    assert (exposed(read) ^ region(plate_layout(small_plate), CLEAR)).is_empty()
    assert (region(read, OUTLINE) ^ region(plate_layout(small_plate), OUTLINE)).is_empty()
    assert len(read.top_cells()) == 1


@every_option
def test_the_account_is_what_the_layout_holds(small_plate, options):
    figures = draw(small_plate, options)
    polygons = list(drawn(figures.layout()))
    assert figures.account.polygons == len(polygons)
    assert figures.account.vertices == sum(polygon.num_points() for polygon in polygons)
    assert max(polygon.num_points() for polygon in polygons) <= options.max_vertices
    assert not any(polygon.holes() for polygon in polygons)
    assert figures.account.holed > 0
    assert any("hole" in line for line in figures.account.lines())


@pytest.mark.parametrize("options", EVERY[4::6], ids=str)
@pytest.mark.parametrize(("write", "name"), [(write_gdsii, "x.gds"), (write_oasis, "x.oas")])
def test_two_writes_are_byte_identical(small_plate, tmp_path, options, write, name):
    write(draw(small_plate, options).layout(), tmp_path / name)
    write(draw(small_plate, options).layout(), tmp_path / f"again_{name}")
    assert (tmp_path / name).read_bytes() == (tmp_path / f"again_{name}").read_bytes()


@pytest.mark.parametrize(("write", "name"), [(write_gdsii, "x.gds"), (write_oasis, "x.oas")])
def test_by_default_it_is_the_layout_of_the_plate(small_plate, tmp_path, write, name):
    write(draw(small_plate).layout(), tmp_path / name)
    write(plate_layout(small_plate), tmp_path / f"again_{name}")
    assert (tmp_path / name).read_bytes() == (tmp_path / f"again_{name}").read_bytes()


@every_option
def test_reading_back_takes_the_second_layer_off(small_plate, tmp_path, options):
    figures = draw(small_plate, options)
    path = tmp_path / "x.gds"
    write_gdsii(figures.layout(), path)
    trip = roundtrip(small_plate, plate_layout(small_plate), path, drawn_polygons=figures.account.polygons)
    assert all(quantity.passed is not False for quantity in trip.quantities())
    assert all(check.wrong_dots == 0 for check in trip.dies)


def test_a_missing_second_layer_is_found(small_plate, tmp_path):
    layout = draw(small_plate, PolygonOptions(holes="layer")).layout()
    layout.clear_layer(layout.find_layer(CUT.number, CUT.datatype))
    write_gdsii(layout, tmp_path / "x.gds")
    trip = roundtrip(small_plate, plate_layout(small_plate), tmp_path / "x.gds")
    assert trip.xor_area_um2 > 0


def test_a_second_layer_is_explained_in_the_file(small_plate):
    layout = draw(small_plate, PolygonOptions(holes="layer")).layout()
    notes = [shape.text_string for shape in layout.top_cell().shapes(layout.find_layer(NOTE.number, 0)).each()]
    assert "EXPOSED = CLEAR 1/0 MINUS CUT 2/0" in notes


@pytest.mark.parametrize("hierarchy", ["flat", "merged"])
def test_without_hierarchy_there_is_one_cell(small_plate, hierarchy):
    layout = draw(small_plate, PolygonOptions(hierarchy=hierarchy)).layout()
    assert [cell.name for cell in layout.each_cell()] == ["SMALL_PLATE"]


def test_merged_figures_share_no_side(small_plate):
    """Then there are as many as the union has parts."""
    uncut = PolygonOptions(hierarchy="merged", holes="keyhole", corners="joined")
    account = draw(small_plate, uncut).account
    union = region(plate_layout(small_plate), CLEAR).merged(False, 1)
    union.merged_semantics = False
    assert account.polygons == union.count()
    assert account.parted == account.split == 0
    assert account.polygons < draw(small_plate, replace(uncut, hierarchy="flat")).account.polygons


def big(rows, columns):
    mask = np.random.default_rng(1).random((5, 5)) < 0.4
    turns = np.random.default_rng(2).integers(0, 8, (rows, columns))
    panel = Panel(Opening("big", mask, 8000), 8000, 0, turns, Tiling.RANDOM, 1)
    die = Die("BIG", "big", panel, (0, 0), 10_000_000)
    return Plate("big plate", "Big", 127_000_000, 100_000_000, (die,), (), (), ())


@pytest.mark.parametrize("columns", [20, 21])
def test_cells_of_two_pixels(columns):
    plate = big(30, columns)
    figures = draw(plate, PolygonOptions(max_references=30 * columns - 1))
    assert figures.account.paired == ("BIG",)
    assert figures.account.references == 30 * (columns // 2 + columns % 2)
    assert figures.account.definitions <= 64 + 8
    assert (region(figures.layout(), CLEAR) ^ region(plate_layout(plate), CLEAR)).is_empty()


def test_a_hundred_by_a_hundred_takes_64_cells_and_5000_references():
    figures = draw(big(100, 100), PolygonOptions(max_references=8192))
    assert (figures.account.definitions, figures.account.references) == (64, 5000)


def test_more_references_than_pairs_can_save_are_refused():
    with pytest.raises(OutputError, match="MF416"):
        draw(big(30, 20), PolygonOptions(max_references=299))


def test_a_periodic_die_is_one_reference_and_never_paired(small_plate):
    plate = replace(small_plate, dies=small_plate.dies[:1])
    account = draw(plate, PolygonOptions(max_references=1)).account
    assert (account.references, account.paired) == (1, ())


def test_notes_as_polygons_or_not_at_all(small_plate):
    plate = replace(small_plate, notes=(Note("JOB 1 µm", (0, 0)),))
    for notes, empty in (("polygons", False), ("none", True)):
        layout = draw(plate, PolygonOptions(notes=notes)).layout()
        index = layout.find_layer(NOTE.number, NOTE.datatype)
        texts = db.Texts(layout.top_cell().begin_shapes_rec(index))
        assert texts.count() == 0
        assert region(layout, NOTE).is_empty() is empty


@pytest.mark.parametrize(
    "wrong",
    [
        {"hierarchy": "tree"},
        {"holes": "fill"},
        {"corners": "round"},
        {"notes": "loud"},
        {"max_vertices": 3},
        {"max_vertices": 5000},
        {"max_references": 0},
    ],
)
def test_options_that_there_are_not(wrong):
    with pytest.raises(OutputError, match="MF413"):
        PolygonOptions(**wrong)


def test_a_mark_that_cannot_be_cut_on_the_grid_is_refused(small_plate):
    odd = ((0, 0), (1, 7), (3, 8), (101, 6), (103, 3), (50, 1))
    plate = replace(small_plate, marks=(Mark("ODD", "fiducial", CLEAR, (odd,)),))
    with pytest.raises(OutputError, match="MF413"):
        draw(plate, PolygonOptions(max_vertices=4))


NAMES = {"CLEAR": "CHROME1", "CUT": "CHROME2"}


@pytest.mark.parametrize("version", ["R12", "R2010"])
@pytest.mark.parametrize("options", [PolygonOptions(), *EVERY[3:4], *EVERY[6:9]], ids=str)
def test_dxf_under_other_names(small_plate, tmp_path, version, options):
    path = tmp_path / "x.dxf"
    figures = draw(small_plate, options)
    write_dxf(figures, path, version, style=DrawingStyle(layer_names=NAMES))
    trip = roundtrip(
        small_plate, plate_layout(small_plate), path, drawn_polygons=figures.account.polygons, layer_names=NAMES
    )
    assert all(quantity.passed is not False for quantity in trip.quantities())
