from __future__ import annotations

import json
import struct
import zipfile
from dataclasses import replace
from xml.etree import ElementTree

import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st
from sweeps import examples

from maskfab.errors import OutputError
from maskfab.export.solid.mesh import write_3mf, write_glb, write_stl
from maskfab.export.solid.step import write_plate_step, write_step
from maskfab.export.solid.tiles import Stack, centres_nm, film, rotation
from maskfab.model import Die, Opening, Panel, Tiling, orient
from maskfab.readers.mesh import read_scene

WRITERS = {"step": write_step, "glb": write_glb, "3mf": write_3mf, "stl": write_stl}


def die_of(opening, turns, gutter_nm=0, others=(), centre_nm=(3_000_001, -5)):
    turns = np.asarray(turns)
    panel = Panel(opening, opening.dot_nm, gutter_nm, turns, Tiling.RANDOM, 1, others=others)
    return Die("D1", "a die", panel, centre_nm, max(400_000, *panel.size_nm))


def random_opening(dots=9, seed=1, name="noise"):
    return Opening(name, np.random.default_rng(seed).random((dots, dots)) < 0.4, 8000)


@pytest.mark.parametrize("orientation", range(8))
def test_a_rotation_moves_dots_as_the_model_does(orientation):
    """Every orientation is a rigid placement: the mirrors too are turns, of determinant 1."""
    turn = rotation(orientation)
    assert np.linalg.det(turn) == 1
    mask = random_opening().mask
    middle = np.arange(9) - 4
    expected = orient(mask, orientation)
    for y, x in np.argwhere(mask):
        u, v, _ = turn @ [middle[x], middle[y], 0]
        assert expected[int(v) + 4, int(u) + 4]


@pytest.mark.parametrize("gutter_nm", [0, 8000, 8002])
def test_a_film_is_the_cell_less_its_openings(gutter_nm):
    panel = die_of(random_opening(), [[0]], gutter_nm).panel
    mesh = film(panel, 0, Stack(chrome_nm=80))
    a, b, c = (mesh.vertices_nm[mesh.triangles[:, n]] for n in range(3))
    volume = np.einsum("ni,ni->", a, np.cross(b, c)) / 6
    clear = panel.opening.clear_dots * panel.dot_nm**2
    assert volume == pytest.approx(80 * (panel.pitch_nm**2 - clear), rel=1e-12)
    assert (mesh.vertices_nm.min(axis=0) == [-panel.pitch_nm / 2, -panel.pitch_nm / 2, -40]).all()
    edges = np.concatenate([mesh.triangles[:, [n, (n + 1) % 3]] for n in range(3)])
    _, faces = np.unique(np.sort(edges, axis=1), axis=0, return_counts=True)
    assert set(faces) == {2}


def heights_nm(corners):
    """Heights of triangles [n, 3, 3] over their longest sides."""
    sides = corners - np.roll(corners, 1, axis=1)
    return np.linalg.norm(np.cross(sides[:, 0], sides[:, 1]), axis=1) / np.linalg.norm(sides, axis=2).max(axis=1)


def volume_nm3(corners):
    return float(np.einsum("ni,ni->", corners[:, 0], np.cross(corners[:, 1], corners[:, 2])) / 6)


@examples(60)
@given(
    dots=st.integers(1, 12),
    clear=st.floats(0, 1),
    seed=st.integers(0, 2**32 - 1),
    gutter_nm=st.sampled_from([0, 400, 8000, 8002, 12_346]),
    dot_nm=st.sampled_from([1000, 4031, 8000]),
)
def test_every_triangle_of_a_film_has_an_area_and_its_sides_are_shared_by_two(dots, clear, seed, gutter_nm, dot_nm):
    """Corners on one line, holes, kissing corners and parted chrome; 5 nm is what float32 millimetres resolve."""
    opening = Opening("noise", np.random.default_rng(seed).random((dots, dots)) < clear, dot_nm)
    assume(gutter_nm or not opening.mask.all())
    panel = Panel(opening, dot_nm, gutter_nm, np.zeros((1, 1), dtype=int), Tiling.RANDOM, 1)
    mesh = film(panel, 0, Stack())
    corners = mesh.vertices_nm[mesh.triangles]
    assert heights_nm(corners).min() >= 5
    there = np.concatenate([mesh.triangles[:, [n, (n + 1) % 3]] for n in range(3)]).tolist()
    assert len({(a, b) for a, b in there}) == len(there)
    assert {(a, b) for a, b in there} == {(b, a) for a, b in there}
    chrome_nm2 = panel.pitch_nm**2 - opening.clear_dots * dot_nm**2
    assert volume_nm3(corners) == pytest.approx(100 * chrome_nm2, rel=1e-12)
    # None overlaps another: the upper face is as large as all its triangles, and none is turned over.
    upper = corners[(corners[..., 2] == 50).all(axis=1)]
    doubled = np.cross(upper[:, 1] - upper[:, 0], upper[:, 2] - upper[:, 0])[:, 2]
    assert doubled.min() > 0
    assert doubled.sum() / 2 == chrome_nm2


@pytest.mark.parametrize("gutter_nm", [0, 8002])
@pytest.mark.parametrize("format_", ["glb", "3mf", "stl"])
def test_no_triangle_in_a_file_is_without_area(tmp_path, format_, gutter_nm):
    """As read back, rounded as the format rounds: files of 11 mm, where float32 millimetres are 0.5 nm apart."""
    turns = np.random.default_rng(3).integers(0, 8, (1, 60))
    die, path = die_of(random_opening(dots=21), turns, gutter_nm), tmp_path / f"x.{format_}"
    WRITERS[format_](die, path)
    if format_ == "stl":
        record = np.dtype([("normal", "<f4", 3), ("corners", "<f4", (3, 3)), ("attribute", "<u2")])
        table = np.frombuffer(path.read_bytes(), record, offset=84)
        solids = [table["corners"].astype(np.float64) * 1e6]
        assert np.linalg.norm(table["normal"], axis=1) == pytest.approx(1, abs=1e-6)
    else:
        shapes = read_scene(path).shapes
        assert all(shape.sound for shape in shapes)
        solids = [shape.vertices_nm[shape.triangles] for shape in shapes]
    assert min(heights_nm(corners).min() for corners in solids) > 1
    chrome_nm2 = die.panel.pitch_nm**2 - die.panel.opening.clear_dots * 8000**2
    for corners in solids if format_ == "stl" else solids[1:]:
        assert volume_nm3(corners) == pytest.approx(100 * chrome_nm2 * (60 if format_ == "stl" else 1), rel=1e-4)


def test_centres_are_measured_from_the_slots_middle():
    die = die_of(random_opening(), np.zeros((2, 3)), gutter_nm=2)
    centres = centres_nm(die)
    assert centres.shape == (2, 3, 2)
    corner = centres[0, 0] + die.centre_nm - die.panel.pitch_nm / 2
    assert tuple(corner) == die.origin_nm
    assert (centres[1, 2] - centres[0, 0] == [2 * die.panel.pitch_nm, die.panel.pitch_nm]).all()


@pytest.mark.parametrize("format_", WRITERS)
def test_two_writes_are_byte_identical_and_quiet(small_plate, tmp_path, capfd, format_):
    one, other = tmp_path / f"one.{format_}", tmp_path / f"other.{format_}"
    for path in (one, other):
        WRITERS[format_](small_plate.dies[2], path, ["job 0123"])
    assert one.read_bytes() == other.read_bytes()
    assert capfd.readouterr().out == ""
    assert sorted(path.name for path in tmp_path.iterdir()) == [one.name, other.name]


@pytest.mark.parametrize("format_", WRITERS)
def test_a_cell_without_chrome_is_refused(tmp_path, format_):
    die = die_of(Opening("bare", np.ones((3, 3), dtype=np.bool_), 8000), [[0, 1]])
    with pytest.raises(OutputError, match=r"MF410.*bare.*export\.formats"):
        WRITERS[format_](die, tmp_path / "x", [])
    framed = die_of(die.panel.opening, [[0, 1]], gutter_nm=8000)
    WRITERS[format_](framed, tmp_path / f"x.{format_}", [])


@pytest.mark.parametrize("format_", WRITERS)
def test_a_place_that_cannot_be_written_is_an_error(small_plate, tmp_path, format_):
    with pytest.raises(OutputError, match="MF401"):
        WRITERS[format_](small_plate.dies[0], tmp_path / "none" / f"x.{format_}")


def test_an_stl_is_refused_by_its_exact_size_before_it_is_written(small_plate, tmp_path):
    die, path = small_plate.dies[1], tmp_path / "x.stl"
    write_stl(die, tmp_path / "known.stl")
    size = (tmp_path / "known.stl").stat().st_size
    with pytest.raises(OutputError, match=r"MF411.*20 cells.*MB.*stl_limit"):
        write_stl(die, path, limit_bytes=size - 1)
    assert not path.exists()
    write_stl(die, path, limit_bytes=size)
    assert path.stat().st_size == size
    write_stl(die, path, ["x" * 100], limit_bytes=0, force=True)
    assert path.read_bytes().startswith(b"unit mm; xxx")
    assert path.stat().st_size == size


def test_step_refuses_outlines_and_panels_beyond_its_limits(small_plate, tmp_path):
    die, path = small_plate.dies[1], tmp_path / "x.step"
    with pytest.raises(OutputError, match=r"MF412.*vertices"):
        write_step(die, path, most_vertices=10)
    with pytest.raises(OutputError, match=r"MF412.*20 cells"):
        write_step(die, path, most_cells=19)
    assert not path.exists()


def chunks(path):
    """The JSON document and the binary chunk of a GLB, by the letter of its specification."""
    data = path.read_bytes()
    magic, version, length = struct.unpack_from("<4sII", data)
    assert (magic, version, length) == (b"glTF", 2, len(data))
    found, at = [], 12
    while at < len(data):
        size, kind = struct.unpack_from("<I4s", data, at)
        assert size % 4 == 0
        found.append((kind, data[at + 8 : at + 8 + size]))
        at += 8 + size
    (first, text), (second, binary) = found
    assert (first, second) == (b"JSON", b"BIN\0")
    return json.loads(text), binary


def test_a_glb_obeys_its_specification(small_plate, tmp_path):
    die, path = small_plate.dies[2], tmp_path / "x.glb"
    write_glb(die, path, ["job 0123"], Stack(exaggeration=50))
    document, binary = chunks(path)
    assert document["asset"]["version"] == "2.0"
    assert document["asset"]["extras"]["comments"][0] == "job 0123"
    assert document["asset"]["extras"]["exaggeration"] == 50
    assert "50 times too thick" in document["asset"]["extras"]["comments"][-1]
    assert document["buffers"] == [{"byteLength": len(binary)}]
    used = set(die.panel.orientations.ravel().tolist())
    assert len(document["meshes"]) == 1 + len(used)
    for mesh in document["meshes"]:
        (primitive,) = mesh["primitives"]
        points, indices = (
            document["accessors"][n] for n in (primitive["attributes"]["POSITION"], primitive["indices"])
        )
        blocks = []
        for accessor, size in ((points, 12), (indices, 4)):
            view = document["bufferViews"][accessor["bufferView"]]
            assert view["byteOffset"] % 4 == 0
            assert view["byteLength"] == accessor["count"] * size
            blocks.append(binary[view["byteOffset"] : view["byteOffset"] + view["byteLength"]])
        positions = np.frombuffer(blocks[0], "<f4").reshape(-1, 3)
        assert np.frombuffer(blocks[1], "<u4").max() == points["count"] - 1
        assert positions.min(axis=0).tolist() == points["min"]
        assert positions.max(axis=0).tolist() == points["max"]
    root, glass, *cells = document["nodes"]
    assert root["children"] == list(range(1, len(document["nodes"])))
    assert glass["mesh"] == 0
    assert len(cells) == die.panel.orientations.size
    for node, centre, cell in zip(cells, centres_nm(die).reshape(-1, 2), die.panel.orientations.ravel(), strict=True):
        assert np.abs(np.array(node["translation"]) * 1e9 - [*centre, 0]).max() < 1e-3
        assert document["meshes"][node["mesh"]]["name"].endswith(f"_R{cell}")


def test_a_3mf_holds_every_mesh_once_in_micrometres(small_plate, tmp_path):
    die, path = replace(small_plate.dies[2], name="RANDOM"), tmp_path / "x.3mf"
    write_3mf(die, path, ["a < b & c"])
    with zipfile.ZipFile(path) as package:
        assert package.testzip() is None
        assert {info.date_time[0] for info in package.infolist()} == {1980}
        model = ElementTree.fromstring(package.read("3D/3dmodel.model"))
    space = {"m": "http://schemas.microsoft.com/3dmanufacturing/core/2015/02"}
    assert model.get("unit") == "micron"
    said = {each.get("name"): each.text for each in model.findall("m:metadata", space)}
    assert said["Description"].startswith("a < b & c; chrome 100 nm")
    objects = model.findall("m:resources/m:object", space)
    assert len(objects) == 1 + len(np.unique(die.panel.orientations))
    assert len(model.findall("m:build/m:item", space)) == 1 + die.panel.orientations.size


def test_ninety_thousand_cells_of_glb_take_some_tens_of_bytes_each(tmp_path):
    turns = np.random.default_rng(2).integers(0, 8, (300, 300))
    path = tmp_path / "x.glb"
    write_glb(die_of(random_opening(), turns), path)
    assert path.stat().st_size < 100 * turns.size


def test_a_step_header_tells_its_makers_but_not_the_time(small_plate, tmp_path):
    path = tmp_path / "x.step"
    write_step(small_plate.dies[0], path, ["maskfab 0 | job 0123 | seeds A=1", "two\nlines µ"])
    head = path.read_text(encoding="ascii").split("ENDSEC;")[0]
    assert "job 0123 | seeds A=1" in head
    assert "two lines ?" in head
    assert "FILE_NAME('PERIODIC',''" in head
    assert "AUTOMOTIVE_DESIGN" in head


def test_a_plate_in_step_is_light(small_plate, tmp_path):
    path = tmp_path / "x.step"
    write_plate_step(small_plate, path, ["job 0123"])
    assert path.stat().st_size < 60_000
