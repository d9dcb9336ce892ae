from __future__ import annotations

import re
import sys
from dataclasses import replace

import numpy as np
import pytest
from sweeps import sweep

from maskfab.base.errors import OutputError, SourceError
from maskfab.base.model import Die, Opening, Panel, Tiling
from maskfab.base.processes import quiet
from maskfab.mask.formats import step as read_step_module
from maskfab.mask.formats.format import Stack
from maskfab.mask.formats.mesh import check_mesh, is_manifold, write_3mf, write_glb, write_stl
from maskfab.mask.formats.solid import box_mesh
from maskfab.mask.formats.step import check_plate_step, check_step, read_step, write_plate_step, write_step
from maskfab.mask.formats.table import format_of
from maskfab.mask.panels import hexagonal_sheet


def check_solid(die, path, stack=None):
    """The rows of a die's solid, by its suffix."""
    return (check_step if path.suffix == ".step" else check_mesh)(die, path, stack)


WRITERS = {"step": write_step, "glb": write_glb, "3mf": write_3mf, "stl": write_stl}
MAY_FOLLOW = {"solid_volume_error", "solid_pieces", "solid_vertex_error"}
"""What an opening closed by mistake may change besides dots, where it parted chrome or touched others."""
everywhere = pytest.mark.parametrize("format_", WRITERS)
but_step_when_quick = pytest.mark.parametrize("format_", sweep(reversed(WRITERS), 3))


def written(die, folder, format_, **options):
    path = folder / f"x.{format_}"
    WRITERS[format_](die, path, ["job 0123"], **options)
    return path


def values(quantities):
    return {quantity.name: quantity.value for quantity in quantities}


def failed(quantities):
    assert all(quantity.passed is not None for quantity in quantities)
    return {quantity.name for quantity in quantities if not quantity.passed}


@everywhere
@pytest.mark.parametrize("n", sweep([0, 1, 2], 1))
def test_a_written_die_comes_back_exactly(small_plate, tmp_path, format_, n):
    """Openings with holes and kissing corners; with a gutter and without; periodic and random."""
    die = small_plate.dies[n]
    rows = check_solid(die, written(die, tmp_path, format_))
    assert failed(rows) == set()
    found = values(rows)
    assert found["solid_instances"] == (20 if format_ == "step" else 1)
    assert found["solid_wrong_cells"] == found["solid_flaws"] == 0
    assert found["solid_position_error" if format_ == "step" else "solid_vertex_error"] < (
        0.1 if format_ == "stl" else 1e-3
    )
    assert {row.die for row in rows} == {die.name}


@but_step_when_quick
def test_several_openings_an_odd_pitch_and_other_thicknesses(tmp_path, format_):
    rng = np.random.default_rng(5)
    one, two = (Opening(name, rng.random((7, 7)) < 0.4, 4031) for name in ("one", "two"))
    turns = rng.integers(0, 16, (3, 4))
    die = Die("TWO", "", Panel(one, 4031, 2000, turns, Tiling.RANDOM, 1, others=(two,)), (7, 8), 400_000)
    stack = Stack(chrome_nm=80, glass_nm=1_000_000, exaggeration=20)
    rows = check_solid(die, written(die, tmp_path, format_, stack=stack), stack)
    assert failed(rows) == set()
    thin = failed(check_solid(die, tmp_path / f"x.{format_}"))
    assert {"solid_vertex_error", "solid_volume_error"} <= thin


@but_step_when_quick
def test_a_hexagonal_sheet_is_one_large_cell(tmp_path, format_):
    ring = np.zeros((7, 7), dtype=np.bool_)
    ring[2:5, 2:5] = True
    ring[3, 3] = False
    sheet = hexagonal_sheet(Opening("ring", ring, 8000), 20, seed=1)
    die = Die("HEX", "", Panel(sheet, 8000, 0, np.zeros((1, 1)), Tiling.HEXAGONAL, 1), (0, 0), 400_000)
    assert failed(check_solid(die, written(die, tmp_path, format_))) == set()


@but_step_when_quick
def test_one_turned_cell_is_found(small_plate, tmp_path, format_):
    die = small_plate.dies[1]
    turns = die.panel.orientations.copy()
    turns[2, 3] = (turns[2, 3] + 1) % 8
    wrong = replace(die, panel=replace(die.panel, orientations=turns))
    rows = check_solid(die, written(wrong, tmp_path, format_))
    if format_ == "step":
        assert failed(rows) == {"solid_wrong_cells"}
        assert values(rows)["solid_wrong_cells"] == 1
        return
    # In one surface the corners at which it touches its neighbours are others, too.
    assert "solid_wrong_cells" in failed(rows)
    assert 1 <= values(rows)["solid_wrong_cells"] <= 9


@everywhere
def test_one_closed_dot_is_found(small_plate, tmp_path, format_):
    die = small_plate.dies[0]
    mask = die.panel.opening.mask.copy()
    mask[0, 0] = False
    wrong = replace(die, panel=replace(die.panel, opening=replace(die.panel.opening, mask=mask)))
    rows = check_solid(die, written(wrong, tmp_path, format_))
    assert {"solid_wrong_cells", "solid_volume_error"} <= failed(rows) <= {*MAY_FOLLOW, "solid_wrong_cells"}
    assert values(rows)["solid_wrong_cells"] == 20


@but_step_when_quick
def test_a_die_off_its_place_is_found(small_plate, tmp_path, format_):
    """A panel whose middle is 2 nm off: nothing but the places differ."""
    die = small_plate.dies[0]
    path = written(die, tmp_path, format_)
    x, y = die.centre_nm
    moved = _Shifted(die.name, die.label, die.panel, (x, y), die.slot_nm)
    assert failed(check_solid(moved, path)) & {"solid_vertex_error", "solid_position_error"}


class _Shifted(Die):
    @property
    def origin_nm(self):
        x, y = super().origin_nm
        return x + 2, y


@but_step_when_quick
def test_a_lost_row_is_found(small_plate, tmp_path, format_):
    die = small_plate.dies[1]
    fewer = replace(die, panel=replace(die.panel, orientations=die.panel.orientations[:3]))
    rows = check_solid(die, written(fewer, tmp_path, format_))
    assert {"solid_wrong_cells", "solid_volume_error"} <= failed(rows)
    assert values(rows)["solid_instances"] == (15 if format_ == "step" else 1)


@but_step_when_quick
def test_files_that_are_missing_empty_or_cut_are_refused(small_plate, tmp_path, format_):
    die = small_plate.dies[0]
    with pytest.raises(SourceError, match="MF301"):
        check_solid(die, tmp_path / f"none.{format_}")
    empty = tmp_path / f"empty.{format_}"
    empty.touch()
    with pytest.raises(SourceError, match="MF302"):
        check_solid(die, empty)
    path = written(die, tmp_path, format_)
    path.write_bytes(path.read_bytes()[: path.stat().st_size // 2])
    with pytest.raises(SourceError, match="MF303"):
        check_solid(die, path)


def test_another_suffix_is_refused(tmp_path):
    path = tmp_path / "x.obj"
    path.write_text("o")
    with pytest.raises(OutputError, match="MF430"):
        format_of(path, die=True)


def edited(path, pattern, change):
    """The file with the first match of a pattern changed."""
    text, count = re.subn(pattern, change, path.read_text(encoding="ascii"), count=1)
    assert count == 1
    path.write_text(text, encoding="ascii")
    return path


@pytest.mark.slow
def test_damage_to_one_face_of_a_step_shows(small_plate, tmp_path):
    """A face taken out of the shell leaves a solid that is not closed."""
    path = written(small_plate.dies[0], tmp_path, "step")
    text = path.read_text(encoding="ascii")
    shell = re.findall(r"CLOSED_SHELL\('',\(([^)]*)\)", text)[-1]
    path.write_text(text.replace(shell, shell.split(",", 1)[1]), encoding="ascii")
    assert "solid_flaws" in failed(check_solid(small_plate.dies[0], path))


def test_a_step_in_other_units_is_refused(small_plate, tmp_path):
    path = edited(
        written(small_plate.dies[0], tmp_path, "step"), r"SI_UNIT\(\.MILLI\.,\.METRE\.\)", "SI_UNIT($,.METRE.)"
    )
    with pytest.raises(SourceError, match=r"MF303.*millimetres"):
        check_solid(small_plate.dies[0], path)


def test_a_hole_in_a_mesh_is_not_watertight(small_plate, tmp_path):
    die = small_plate.dies[0]
    path = written(die, tmp_path, "stl")
    data = path.read_bytes()
    # The last triangle is made to point at its own first corner.
    path.write_bytes(data[:-26] + data[-38:-26] + data[-14:])
    assert "solid_flaws" in failed(check_solid(die, path))


@pytest.mark.parametrize(
    ("moved", "sound"),
    [((5, 0, 0), True), ((2, 0, 0), False), ((2, 2, 0), False), ((2, 2, 1), False), ((0.0, 0.0, 3.0), True)],
    ids=["apart", "tiles", "an edge of four faces", "one vertex of two fans", "above"],
)
def test_only_closed_surfaces_of_two_faces_a_side_and_one_fan_a_vertex_are_manifold(moved, sound):
    """Two boxes: apart, abutting, sharing one edge, sharing one vertex."""
    mesh = box_mesh(np.zeros(3), np.array([2.0, 2.0, 1.0]))
    points = np.concatenate([mesh.vertices_nm, mesh.vertices_nm + moved])
    triangles = np.concatenate([mesh.triangles, mesh.triangles + len(mesh.vertices_nm)])
    _, number = np.unique(points, axis=0, return_inverse=True)
    welded = number.ravel()[triangles]
    assert is_manifold(welded) is sound
    assert not is_manifold(welded[1:])
    turned = welded.copy()
    turned[0] = turned[0, ::-1]
    assert not is_manifold(turned)


@pytest.mark.parametrize("change", [b"\0", b"solid", -1, -50, 83, 10])
def test_an_stl_of_another_length_is_refused_plainly(small_plate, tmp_path, change):
    die = small_plate.dies[0]
    path = written(die, tmp_path, "stl")
    data = path.read_bytes()
    path.write_bytes(data + change if isinstance(change, bytes) else data[:change])
    with pytest.raises(SourceError, match=r"MF303.* it has \d+ bytes; ") as caught:
        check_solid(die, path)
    assert f"it has {path.stat().st_size} bytes" in str(caught.value)
    if path.stat().st_size >= 84:
        assert f"{(len(data) - 84) // 50} triangles that it states take {len(data)}" in str(caught.value)


@pytest.mark.parametrize("value", [np.inf, np.nan, 1e30])
def test_a_corner_that_no_plate_has_is_refused(small_plate, tmp_path, value):
    die = small_plate.dies[0]
    path = written(die, tmp_path, "stl")
    data = path.read_bytes()
    # An STL's record ends in its last corner and two bytes.
    path.write_bytes(data[:-6] + np.float32(value).tobytes() + data[-2:])
    with pytest.raises(SourceError, match="MF303"):
        check_solid(die, path)


@pytest.mark.skipif(sys.platform == "win32", reason="signals of POSIX")
def test_a_step_file_that_ends_its_reader_is_refused(small_plate, tmp_path, monkeypatch):
    """What damaged references do to the library itself, which cannot be provoked alike in all of its versions."""
    path = written(small_plate.dies[0], tmp_path, "step")
    dying = tmp_path / "step_process.py"
    dying.write_text("import os, signal; os.kill(os.getpid(), signal.SIGSEGV)", encoding="utf-8")
    monkeypatch.setattr(read_step_module, "__file__", str(dying))
    with pytest.raises(SourceError, match="MF303"):
        check_solid(small_plate.dies[0], path)


@pytest.mark.parametrize("entity", sweep(["VERTEX_POINT", "ADVANCED_FACE", "MANIFOLD_SOLID_BREP"], 1))
def test_a_step_file_with_a_dangling_reference_is_refused(small_plate, tmp_path, entity):
    path = written(small_plate.dies[0], tmp_path, "step")
    path = edited(path, rf"({entity}\('[^']*',\(?)#\d+", r"\g<1>#999999")
    with pytest.raises(SourceError, match="MF303"):
        check_solid(small_plate.dies[0], path)


@pytest.mark.slow
def test_places_are_those_of_the_librarys_own_assembly(small_plate, tmp_path):
    """The quick reader against OCP's translation of the whole file, name by name."""
    from OCP.IFSelect import IFSelect_ReturnStatus
    from OCP.Quantity import Quantity_ColorRGBA
    from OCP.STEPCAFControl import STEPCAFControl_Reader
    from OCP.TCollection import TCollection_ExtendedString
    from OCP.TDataStd import TDataStd_Name
    from OCP.TDF import TDF_Label, TDF_LabelSequence
    from OCP.TDocStd import TDocStd_Document
    from OCP.XCAFDoc import XCAFDoc_ColorType, XCAFDoc_DocumentTool

    def name_of(label):
        attribute = TDataStd_Name()
        assert label.FindAttribute(TDataStd_Name.GetID_s(), attribute)
        return attribute.Get().ToExtString()

    die = small_plate.dies[1]
    path = written(die, tmp_path, "step")
    with quiet():
        document = TDocStd_Document(TCollection_ExtendedString("XmlXCAF"))
        reader = STEPCAFControl_Reader()
        reader.SetColorMode(True)
        assert reader.ReadFile(str(path)) == IFSelect_ReturnStatus.IFSelect_RetDone
        assert reader.Transfer(document)
    shapes = XCAFDoc_DocumentTool.ShapeTool_s(document.Main())
    colours = XCAFDoc_DocumentTool.ColorTool_s(document.Main())
    roots = TDF_LabelSequence()
    shapes.GetFreeShapes(roots)
    assert roots.Length() == 1
    assert name_of(roots.Value(1)) == die.name
    components = TDF_LabelSequence()
    shapes.GetComponents_s(roots.Value(1), components, False)
    theirs, units = {}, {}
    for label in components:
        unit = TDF_Label()
        shapes.GetReferredShape_s(label, unit)
        units[name_of(label)] = name_of(unit)
        to = shapes.GetLocation_s(label).Transformation()
        if name_of(unit) != f"{die.name}_GLASS":
            inner = TDF_LabelSequence()
            shapes.GetComponents_s(unit, inner, False)
            to = to.Multiplied(shapes.GetLocation_s(inner.Value(1)).Transformation())
        theirs[name_of(label)] = np.array([[to.Value(r, c) for c in range(1, 5)] for r in range(1, 4)])
    _, ours = read_step(path)
    assert (
        {each.name for each in ours} == theirs.keys() == {"GLASS", *(f"R{r}C{c}" for r in range(4) for c in range(5))}
    )
    for each in ours:
        matrix = each.matrix[:3].copy()
        matrix[:, 3] *= 1e-6
        assert np.abs(matrix - theirs[each.name]).max() < 1e-12
    for (row, column), cell in np.ndenumerate(die.panel.orientations):
        assert units[f"R{row}C{column}"].endswith(f"_R{cell}")
    every, shades = TDF_LabelSequence(), {}
    shapes.GetShapes(every)
    for label in every:
        shade = Quantity_ColorRGBA()
        if colours.GetColor(shapes.GetShape_s(label), XCAFDoc_ColorType.XCAFDoc_ColorSurf, shade):
            shades[name_of(label)] = shade.Alpha()
    assert shades[f"{die.name}_GLASS"] == pytest.approx(0.3)


@pytest.mark.slow
def test_a_plate_names_its_dies_and_puts_them_in_their_places(small_plate, tmp_path):
    path = tmp_path / "plate.step"
    write_plate_step(small_plate, path)
    rows = check_plate_step(small_plate, path)
    assert failed(rows) == set()
    assert values(rows)["solid_dies"] == 3
    first, *others = small_plate.dies
    moved = replace(first, centre_nm=(first.centre_nm[0] + 2, first.centre_nm[1]))
    assert failed(check_plate_step(replace(small_plate, dies=(moved, *others)), path)) == {"solid_position_error"}
    renamed = replace(first, name="OTHER")
    assert failed(check_plate_step(replace(small_plate, dies=(renamed, *others)), path)) == {
        "solid_dies",
        "solid_strangers",
    }
