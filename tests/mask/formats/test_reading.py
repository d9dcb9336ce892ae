from __future__ import annotations

import random
import re

import ezdxf
import gdstk
import numpy as np
import pytest
from klayout import db
from sweeps import sweep

from maskfab.base.errors import SourceError
from maskfab.base.model import CLEAR
from maskfab.mask.formats.cif import write_cif
from maskfab.mask.formats.content import find_cell, find_layer, rounding_nm
from maskfab.mask.formats.dxf_writer import write_dxf
from maskfab.mask.formats.gdsii import write_gdsii, write_oasis
from maskfab.mask.formats.table import read_layout
from maskfab.mask.layout import plate_layout, region

SUFFIXES = ("gds", "oas", "dxf", "cif")


@pytest.fixture(scope="session")
def written(small_plate, tmp_path_factory):
    """A good file of each kind, as bytes by suffix."""
    folder = tmp_path_factory.mktemp("written")
    layout = plate_layout(small_plate)
    write_gdsii(layout, folder / "plate.gds")
    write_oasis(layout, folder / "plate.oas")
    write_dxf(small_plate, folder / "plate.dxf", "R2010")
    write_cif(small_plate, folder / "plate.cif")
    return {suffix: (folder / f"plate.{suffix}").read_bytes() for suffix in SUFFIXES}


def refusal(path):
    with pytest.raises(SourceError) as caught:
        read_layout(path)
    assert path.name in str(caught.value)
    return caught.value.code


@pytest.mark.parametrize("suffix", SUFFIXES)
def test_good_files_are_read_in_nanometres(small_plate, written, tmp_path, suffix):
    path = tmp_path / f"x.{suffix.upper()}"
    path.write_bytes(written[suffix])
    layout = read_layout(path)
    assert layout.dbu == 0.001
    assert rounding_nm(layout) == 0
    assert (region(layout, CLEAR) ^ region(plate_layout(small_plate), CLEAR)).is_empty()


@pytest.mark.parametrize("suffix", SUFFIXES)
def test_missing_empty_and_wrong_files_are_refused(written, tmp_path, suffix):
    path = tmp_path / f"x.{suffix}"
    assert refusal(path) == "MF301"
    path.write_bytes(b"")
    assert refusal(path) == "MF302"
    for other in SUFFIXES:
        if other != suffix:
            path.write_bytes(written[other])
            assert refusal(path) == "MF304"
    for wrong in (b"\x00", b"hello", b"\x89PNG\r\n\x1a\n" + bytes(100), bytes(1000)):
        path.write_bytes(wrong)
        assert refusal(path) == "MF304"


def test_a_directory_is_no_file(tmp_path):
    path = tmp_path / "x.gds"
    path.mkdir()
    assert refusal(path) == "MF301"


@pytest.mark.parametrize("name", ["x.png", "x", "x.gz", "x.png.gz", "x.dwg"])
def test_other_suffixes_are_refused(tmp_path, name):
    path = tmp_path / name
    path.write_bytes(b"1234")
    assert refusal(path) == "MF308"


@pytest.mark.parametrize("suffix", SUFFIXES)
@pytest.mark.parametrize("share", [0.1, 0.5, 0.9, 0.999])
def test_truncated_files_are_refused(written, tmp_path, suffix, share):
    path = tmp_path / f"x.{suffix}"
    path.write_bytes(written[suffix][: int(len(written[suffix]) * share)])
    assert refusal(path) == "MF303"


def test_a_gdsii_file_without_its_last_record_is_refused(written, tmp_path):
    path = tmp_path / "x.gds"
    path.write_bytes(written["gds"].rstrip(b"\x00")[:-3])
    assert refusal(path) == "MF303"


@pytest.mark.parametrize("suffix", sweep(sorted(SUFFIXES, key=lambda each: each != "dxf"), 1))
def test_mutated_files_are_read_or_refused(written, tmp_path, suffix):
    """Whatever bytes change: an answer or a SourceError, never another exception, never a crash.

    What is damaged in other ways is for the fuzzer, of which every test run does a slice; DXF is text that is looked
    through here.
    """
    chance = random.Random(11)
    path = tmp_path / f"x.{suffix}"
    refusals = []
    count = 10 if suffix == "oas" else 100  # a process of its own for each
    for _ in range(count):
        data = bytearray(written[suffix])
        for _ in range(chance.choice([1, 2, 8])):
            place = chance.randrange(len(data))
            action = chance.randrange(3)
            if action == 0:
                data[place] = chance.randrange(256)
            elif action == 1:
                del data[place : place + chance.randrange(1, 9)]
            else:
                data[place:place] = chance.randbytes(chance.randrange(1, 9))
        path.write_bytes(data)
        try:
            read_layout(path).top_cells()
        except SourceError as error:
            refusals.append(error.code)
    assert len(refusals) > count // 10
    assert set(refusals) <= {"MF303", "MF304", "MF308", "MF310", "MF311", "MF312", "MF313", "MF315", "MF316"}


@pytest.mark.parametrize("format_", ["gds", "oas"])
def test_turned_mirrored_and_repeated_references_agree_with_klayout(tmp_path, format_):
    layout = db.Layout()
    layer = layout.layer(1, 0)
    letter, top = layout.create_cell("F"), layout.create_cell("TOP")
    for box in (db.Box(0, 0, 2, 10), db.Box(2, 8, 7, 10), db.Box(2, 4, 5, 6)):
        letter.shapes(layer).insert(box)
    letter.shapes(layer).insert(db.Path([db.Point(20, 0), db.Point(20, 30), db.Point(40, 30)], 4))
    for code in range(8):
        turn = db.Trans(code % 4, code >= 4, 500 * code, 7)
        top.insert(db.CellInstArray(letter.cell_index(), turn, db.Vector(0, 90), db.Vector(120, 0), 3, 2))
        top.insert(db.CellInstArray(letter.cell_index(), turn * db.Trans(700, 1100)))
    top.insert(db.CellInstArray(letter.cell_index(), db.ICplxTrans(2.0, 90.0, True, -900, -900)))
    path = tmp_path / f"x.{format_}"
    layout.write(str(path))
    assert (region(read_layout(path), CLEAR) ^ region(layout, CLEAR)).is_empty()


@pytest.mark.parametrize("format_", ["gds", "oas"])
def test_coordinates_off_the_grid_are_rounded_and_told(tmp_path, format_):
    library = gdstk.Library(unit=1e-6, precision=1e-10)
    library.new_cell("TOP").add(gdstk.rectangle((0, 0), (1.0003, 2), layer=1))
    path = tmp_path / f"x.{format_}"
    (library.write_gds if format_ == "gds" else library.write_oas)(path)
    layout = read_layout(path)
    assert rounding_nm(layout) == pytest.approx(0.3, abs=1e-6)
    assert region(layout, CLEAR).bbox() == db.Box(0, 0, 1000, 2000)


@pytest.mark.parametrize("precision", [1e-9, 5e-9, 1e-8])
def test_coarser_database_units_are_honoured(tmp_path, precision):
    library = gdstk.Library(unit=1e-6, precision=precision)
    library.new_cell("TOP").add(gdstk.rectangle((-60_000, -60_000), (60_000, 59_999.99), layer=1))
    path = tmp_path / "x.gds"
    library.write_gds(path)
    layout = read_layout(path)
    assert rounding_nm(layout) == 0
    assert region(layout, CLEAR).bbox() == db.Box(-60_000_000, -60_000_000, 60_000_000, 59_999_990)


def test_a_reference_to_a_cell_that_is_lacking_is_refused(tmp_path):
    library = gdstk.Library()
    library.new_cell("TOP").add(gdstk.Reference("GHOST"))
    path = tmp_path / "x.gds"
    library.write_gds(path)
    assert refusal(path) == "MF303"


@pytest.mark.parametrize(
    ("units", "side_nm"), [(13, 1500), (4, 1_500_000), (1, 38_100_000), (5, 15_000_000), (0, 1500), (12, 2)]
)
def test_dxf_units_are_honoured(tmp_path, units, side_nm):
    drawing = ezdxf.new("R2010", units=units)
    drawing.modelspace().add_lwpolyline([(0, 0), (1.5, 0), (1.5, 1.5), (0, 1.5)], close=True)
    path = tmp_path / "x.dxf"
    drawing.saveas(path)
    layout = read_layout(path)
    assert region(layout, find_layer(layout)).bbox().width() == side_nm


def test_dxf_units_that_no_mask_has_are_refused(tmp_path):
    drawing = ezdxf.new("R2010", units=7)
    path = tmp_path / "x.dxf"
    drawing.saveas(path)
    assert refusal(path) == "MF308"


def test_binary_dxf_is_refused(tmp_path):
    path = tmp_path / "x.dxf"
    ezdxf.new("R2010", units=4).saveas(path, fmt="bin")
    assert refusal(path) == "MF308"


def test_dxf_may_begin_with_comments(written, tmp_path):
    path = tmp_path / "x.dxf"
    path.write_bytes(b"999\r\nhello\r\n  999\n0\n" + written["dxf"].replace(b"\n", b"\r\n"))
    assert find_layer(read_layout(path)).layer == 1


def test_dxf_layers_of_the_plate_get_their_numbers(written, tmp_path):
    path = tmp_path / "x.dxf"
    path.write_bytes(written["dxf"])
    layout = read_layout(path)
    for name in ("CLEAR", "1/0", "1", None):
        info = find_layer(layout, name)
        assert (info.layer, info.datatype, info.name) == (1, 0, "CLEAR")


def two_tops():
    layout = db.Layout()
    for name in ("ONE", "TWO"):
        layout.create_cell(name)
    return layout


def test_the_only_top_cell_needs_no_name(small_plate):
    layout = plate_layout(small_plate)  # a cell does not keep its layout
    assert find_cell(layout).name == "SMALL_PLATE"


def test_two_top_cells_need_a_name():
    with pytest.raises(SourceError, match=r"MF305 .*ONE, TWO"):
        find_cell(two_tops())
    layout = two_tops()
    assert find_cell(layout, "TWO").name == "TWO"


def test_a_cell_that_is_not_there_is_refused_with_those_that_are():
    with pytest.raises(SourceError, match=r"MF307 .*'THREE'.*ONE, TWO"):
        find_cell(two_tops(), "THREE")


def layered(*layers):
    layout = db.Layout()
    top = layout.create_cell("TOP")
    for info in layers:
        top.shapes(layout.layer(info)).insert(db.Box(0, 0, 1, 1))
    return layout


def test_the_clear_layer_or_the_only_layer_needs_no_name():
    assert find_layer(layered(db.LayerInfo(5, 2))).layer == 5
    assert find_layer(layered(db.LayerInfo(5, 2), db.LayerInfo(1, 0))).layer == 1
    assert find_layer(layered(db.LayerInfo("CHROME"))).name == "CHROME"


def test_layers_go_by_number_and_name():
    layout = layered(db.LayerInfo(5, 2), db.LayerInfo(7, 0), db.LayerInfo("CHROME"))
    assert find_layer(layout, "5/2").layer == 5
    assert find_layer(layout, "7").layer == 7
    assert find_layer(layout, "7/0").layer == 7
    assert find_layer(layout, "CHROME").name == "CHROME"


@pytest.mark.parametrize("wish", ["1/0", "5", "5/0", "chrome", None])
def test_a_layer_that_is_not_there_is_refused_with_those_that_are(wish):
    layout = layered(db.LayerInfo(5, 2), db.LayerInfo("CHROME"))
    with pytest.raises(SourceError, match=re.escape("layers: 5/2, CHROME")) as caught:
        find_layer(layout, wish)
    assert caught.value.code == "MF306"


def test_rounding_ignores_the_noise_of_floats(tmp_path):
    library = gdstk.Library(unit=1e-6, precision=1e-9)
    rng = np.random.default_rng(0)
    cell = library.new_cell("TOP")
    for x, y in rng.integers(-60_000_000, 60_000_000, (500, 2)) / 1000:
        cell.add(gdstk.rectangle((x, y), (x + 0.001, y + 4.03), layer=1))
    path = tmp_path / "x.gds"
    library.write_gds(path)
    assert rounding_nm(read_layout(path)) == 0


@pytest.mark.parametrize("start", range(4))
@pytest.mark.parametrize("backwards", [False, True])
def test_boxes_and_what_only_resembles_them_cover_what_they_draw(tmp_path, start, backwards):
    """Boxes are taken whole, from whichever corner they begin; kites, bow ties and folded lines are not boxes."""
    outlines = [
        [(0, 0), (50, 0), (50, 70), (0, 70)],
        [(100, 0), (150, 0), (160, 70), (110, 70)],
        [(200, 0), (230, 10), (260, 0), (230, 90)],
        [(300, 0), (350, 0), (350, 70), (350, 30)],
        [(400, 0), (450, 0), (450, 70), (420, 70)],
    ]
    turned = [outline[start:] + outline[:start] for outline in outlines]
    polygons = [gdstk.Polygon(outline[::-1] if backwards else outline) for outline in turned]
    library = gdstk.Library(unit=1e-9, precision=1e-9)
    library.new_cell("TOP").add(*(gdstk.Polygon(each.points, layer=1) for each in polygons))
    library.write_gds(tmp_path / "x.gds")
    expected = db.Region([db.Polygon([db.Point(x, y) for x, y in outline]) for outline in outlines])
    read = read_layout(tmp_path / "x.gds")
    assert (region(read, CLEAR) ^ expected.merged()).is_empty()
    assert sum(shape.is_box() for shape in read.top_cell().shapes(read.find_layer(1, 0)).each()) == 1
