from __future__ import annotations

import ezdxf
import pytest

from maskfab.base.errors import OutputError
from maskfab.base.model import CLEAR, LAYERS, NOTE, OUTLINE
from maskfab.mask.figures import PolygonOptions, draw
from maskfab.mask.formats.dxf_writer import flat_bytes, write_dxf
from maskfab.mask.formats.format import DrawingStyle
from maskfab.mask.formats.table import read_layout
from maskfab.mask.layout import plate_layout, region

versions = pytest.mark.parametrize("version", ["R12", "R2010"])
without_blocks = pytest.mark.parametrize("hierarchy", ["flat", "merged"])


@versions
@without_blocks
def test_a_drawing_without_blocks(small_plate, tmp_path, version, hierarchy):
    path = tmp_path / "x.dxf"
    figures = draw(small_plate, PolygonOptions(hierarchy=hierarchy))
    write_dxf(figures, path, version, ["made by a test"])
    drawing = ezdxf.readfile(path)
    audit = drawing.audit()
    assert not audit.errors
    assert not audit.fixes
    assert not drawing.query("INSERT")
    assert all(block.name.startswith(("*", "$", "_")) for block in drawing.blocks)
    outlines = drawing.modelspace().query("POLYLINE LWPOLYLINE")
    assert len(outlines.query(f'*[layer=="{CLEAR.name}"]')) == figures.account.polygons
    assert all(outline.is_closed and not outline.has_width for outline in outlines)
    read = read_layout(path)
    for layer in (CLEAR, OUTLINE):
        assert (region(read, layer) ^ region(plate_layout(small_plate), layer)).is_empty()


@versions
@without_blocks
def test_a_file_is_no_larger_than_told(small_plate, tmp_path, version, hierarchy):
    figures = draw(small_plate, PolygonOptions(hierarchy=hierarchy))
    write_dxf(figures, tmp_path / "x.dxf", version)
    assert (tmp_path / "x.dxf").stat().st_size <= flat_bytes(figures, version) + 40_000


@versions
def test_what_is_too_large_is_refused_before_it_is_begun(small_plate, tmp_path, version):
    figures = draw(small_plate, PolygonOptions(hierarchy="flat"))
    with pytest.raises(OutputError, match="MF415"):
        write_dxf(figures, tmp_path / "x.dxf", version, limit_bytes=1000)
    assert not list(tmp_path.iterdir())


@versions
def test_what_was_changed_is_said_in_the_file(small_plate, tmp_path, version):
    figures = draw(small_plate, PolygonOptions(holes="trapezoids"))
    write_dxf(figures, tmp_path / "x.dxf", version)
    head = (tmp_path / "x.dxf").read_bytes().split(b"SECTION")[0].decode()
    assert all(line in head for line in figures.account.lines())


@versions
def test_only_named_layers_are_drawn_and_nothing_on_layer_0(small_plate, tmp_path, version):
    path = tmp_path / "x.dxf"
    write_dxf(small_plate, path, version, style=DrawingStyle(layer_names={"CLEAR": "MASK_1", "NOTE": "TEXT"}))
    drawing = ezdxf.readfile(path)
    used = {entity.dxf.layer for entity in drawing.entitydb.values() if entity.dxf.hasattr("layer")}
    drawn = {entity.dxf.layer for block in drawing.blocks for entity in block if block.name[0] not in "*$_"}
    drawn |= {entity.dxf.layer for entity in drawing.modelspace()}
    assert drawn == {"MASK_1", "TEXT"}
    assert not used & {layer.name for layer in LAYERS}
    assert not drawing.audit().errors


@pytest.mark.parametrize(
    "names",
    [
        {"CLEAR": "0"},
        {"CLEAR": "Defpoints"},
        {"CLEAR": "L" * 32},
        {"CLEAR": "A B"},
        {"CLEAR": "µ"},
        {"CLEAR": ""},
        {"CLEAR": "M%s"},
        {"CLEAR": "A", "NOTE": "a"},
        {"NOTE": "A"},
        {"CLEAR": "A", "METAL": "B"},
        {"CLEAR": "dense"},
    ],
)
def test_names_that_no_house_takes(small_plate, tmp_path, names):
    with pytest.raises(OutputError, match="MF414"):
        write_dxf(small_plate, tmp_path / "x.dxf", "R12", style=DrawingStyle(layer_names=names))
    assert not list(tmp_path.iterdir())


def test_the_note_layer_can_be_left_out(small_plate, tmp_path):
    write_dxf(small_plate, tmp_path / "x.dxf", "R12", style=DrawingStyle(layer_names={"CLEAR": CLEAR.name}))
    drawing = ezdxf.readfile(tmp_path / "x.dxf")
    assert not drawing.query("TEXT")
    assert NOTE.name not in drawing.layers
