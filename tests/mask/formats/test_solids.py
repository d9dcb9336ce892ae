from __future__ import annotations

import json
import re
import struct
import time
import zipfile
from dataclasses import replace
from xml.etree import ElementTree

import numpy as np
import pytest
import trimesh
from hypothesis import assume, example, given
from hypothesis import strategies as st
from scipy import ndimage
from sweeps import examples

from maskfab.base.errors import OutputError
from maskfab.base.model import Die, Opening, Panel, Tiling, orient
from maskfab.mask.dots import die_edges_nm, die_raster
from maskfab.mask.formats.format import Stack
from maskfab.mask.formats.mesh import is_manifold, write_3mf, write_glb, write_stl
from maskfab.mask.formats.solid import centres_nm, film, rotation
from maskfab.mask.formats.step import write_plate_step, write_step

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


def heights_nm(corners):
    """Heights of triangles [n, 3, 3] over their longest sides."""
    sides = corners - np.roll(corners, 1, axis=1)
    return np.linalg.norm(np.cross(sides[:, 0], sides[:, 1]), axis=1) / np.linalg.norm(sides, axis=2).max(axis=1)


def volume_nm3(corners):
    return float(np.einsum("ni,ni->", corners[:, 0], np.cross(corners[:, 1], corners[:, 2])) / 6)


def chrome_nm2(die, corners="gap"):
    """Area of a die's chrome, bridged as film() bridges it, from its raster alone; and how many corners touch."""
    clear = die_raster(die)
    x, y = (np.diff(line) for line in die_edges_nm(die))
    low, left, right, high = clear[:-1, :-1], clear[1:, :-1], clear[:-1, 1:], clear[1:, 1:]
    touches = int(((low == high) & (left == right) & (low != left)).sum())
    leg = Stack(corners=corners).corner_leg_nm(die) if touches else 0
    return float((~clear * np.outer(y, x)).sum()) + (1 if corners == "gap" else -1) * touches * leg**2, touches


def merged(path):
    """The film of a file, as trimesh reads it with all vertices of one place merged."""
    scene = trimesh.load_scene(path)
    names = [name for name in scene.geometry if "GLASS" not in name]
    (node,) = (each for each in scene.graph.nodes_geometry if scene.graph[each][1] in names)
    mesh = scene.geometry[names[0]].copy()
    mesh.merge_vertices()
    mesh.apply_transform(scene.graph[node][0])
    scale = {"meters": 1e9, "millimeters": 1e6, "micron": 1e3, "microns": 1e3, None: 1e6}[scene.units]
    return mesh.apply_scale(scale)


NOISE = np.random.default_rng(11).random((9, 9)) < 0.4
PLAIN = np.zeros((9, 9), dtype=np.bool_)
PLAIN[3:6, 2:8] = True
BORDERS = np.zeros((9, 9), dtype=np.bool_)
BORDERS[4, :] = BORDERS[:, 4] = True
CORNERS = np.zeros((9, 9), dtype=np.bool_)
CORNERS[0, 0] = CORNERS[4, 4] = CORNERS[8, 8] = True


@pytest.mark.parametrize(
    ("mask", "gutter_nm", "touching"),
    [(PLAIN, 8000, False), (NOISE, 8000, True), (NOISE, 0, True), (BORDERS, 0, False), (CORNERS, 0, True)],
    ids=["plain", "touching", "touching across cells", "joined across cells", "touching across cells only"],
)
@pytest.mark.parametrize("corners", ["gap", "neck"])
@pytest.mark.parametrize("format_", ["stl", "glb", "3mf"])
def test_the_film_of_a_die_is_one_closed_two_manifold(tmp_path, format_, corners, mask, gutter_nm, touching):
    """By trimesh, vertices of one place merged: two faces a side, wound alike, one fan a vertex, and the volume."""
    turns = np.random.default_rng(3).integers(0, 8, (4, 5))
    die, path = die_of(Opening("x", mask, 8000), turns, gutter_nm), tmp_path / f"x.{format_}"
    WRITERS[format_](die, path, stack=Stack(corners=corners))
    mesh = merged(path)
    assert mesh.is_watertight
    assert mesh.is_winding_consistent
    counts = np.unique(mesh.edges_sorted, axis=0, return_counts=True)[1]
    assert set(counts.tolist()) == {2}
    assert is_manifold(np.asarray(mesh.faces))
    area, touches = chrome_nm2(die, corners)
    assert (touches > 0) is touching
    assert mesh.volume == pytest.approx(100 * area, rel=1e-6 if format_ == "stl" else 1e-12)
    pieces = ndimage.label(~die_raster(die), np.ones((3, 3)) if corners == "gap" else None)[1]
    assert mesh.body_count == pieces
    assert heights_nm(np.asarray(mesh.triangles)).min() > 1


def test_a_file_says_what_became_of_corners_that_touch(tmp_path):
    die = die_of(Opening("x", CORNERS, 8000), np.zeros((4, 5), dtype=int))
    write_stl(die, tmp_path / "x.stl")
    assert (tmp_path / "x.stl").read_bytes().startswith(b"unit mm; 12 touching corners have a gap of 0.8 um")
    write_glb(die, tmp_path / "x.glb", stack=Stack(corners="neck", corner_nm=2000))
    said = chunks(tmp_path / "x.glb")[0]["asset"]["extras"]["comments"]
    assert said[-1] == "12 touching corners have a neck of 2 um"
    write_stl(die, tmp_path / "wide.stl", stack=Stack(corner_nm=5333.0))
    assert is_manifold(np.asarray(merged(tmp_path / "wide.stl").faces))


@pytest.mark.parametrize("corner_nm", [9.0, 5334.0])
@pytest.mark.parametrize("format_", ["stl", "glb", "3mf"])
def test_a_gap_that_cannot_be_is_refused_before_anything_is_written(tmp_path, format_, corner_nm):
    path = tmp_path / f"x.{format_}"
    die = die_of(Opening("x", CORNERS, 8000), np.zeros((2, 2), dtype=int))
    with pytest.raises(OutputError, match=r"MF436.*10 nm and 5333 nm.*D1.*export\.formats"):
        WRITERS[format_](die, path, stack=Stack(corner_nm=corner_nm))
    assert not path.exists()
    # Where nothing touches nobody asks.
    WRITERS[format_](die_of(Opening("x", PLAIN, 8000), [[0]]), path, stack=Stack(corner_nm=corner_nm))


def test_corners_that_float32_cannot_part_are_refused(tmp_path):
    """Dots of 1 nm at 20 mm from the middle, where float32 millimetres are 1.9 nm apart."""
    opening = Opening("x", np.array([[1, 0, 1], [0, 0, 0], [1, 0, 1]], dtype=np.bool_), 1)
    die = die_of(opening, np.zeros((1, 2), dtype=int), gutter_nm=40_000_000)
    with pytest.raises(OutputError, match=r"MF437.*3mf"):
        write_stl(die, tmp_path / "x.stl")
    assert not (tmp_path / "x.stl").exists()
    write_3mf(die, tmp_path / "x.3mf")


@examples(60)
@example(dots=11, clear=0.5, seed=0, gutter_nm=400, dot_nm=8000, corners="gap", band=4000)
@given(
    dots=st.integers(1, 12),
    clear=st.floats(0, 1),
    seed=st.integers(0, 2**32 - 1),
    gutter_nm=st.sampled_from([0, 400, 8000, 8002, 12_346]),
    dot_nm=st.sampled_from([1000, 4031, 8000]),
    corners=st.sampled_from(["gap", "neck"]),
    band=st.sampled_from([10, 4000]),
)
def test_every_triangle_of_a_film_has_an_area_and_every_side_two(dots, clear, seed, gutter_nm, dot_nm, corners, band):
    """Corners on one line, holes, touching corners, parted chrome, bands, strips between the frame and openings."""
    rng = np.random.default_rng(seed)
    opening = Opening("noise", rng.random((dots, dots)) < clear, dot_nm)
    assume(gutter_nm or not opening.mask.all())
    die = die_of(opening, rng.integers(0, 8, (2, 3)), gutter_nm)
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("maskfab.mask.formats.solid._BAND_CORNERS", band)
        mesh, touches = film(die, Stack(corners=corners))
    found = mesh.vertices_nm[mesh.triangles]
    assert heights_nm(found).min() >= 5
    assert len(np.unique(mesh.vertices_nm, axis=0)) == len(mesh.vertices_nm)
    assert is_manifold(mesh.triangles)
    area, expected = chrome_nm2(die, corners)
    assert touches == expected
    assert volume_nm3(found) == pytest.approx(100 * area, rel=1e-9)
    # None overlaps another: the upper face is as large as all its triangles, and none is turned over.
    upper = found[(found[..., 2] == 50).all(axis=1)]
    doubled = np.cross(upper[:, 1] - upper[:, 0], upper[:, 2] - upper[:, 0])[:, 2]
    assert doubled.min() > 0
    assert doubled.sum() / 2 == area


@pytest.mark.slow
def test_ten_thousand_cells_are_one_solid_within_twenty_seconds(tmp_path):
    turns = np.random.default_rng(4).integers(0, 8, (100, 100))
    die, path = die_of(Opening("x", PLAIN | CORNERS, 8000), turns), tmp_path / "x.stl"
    before = time.process_time()
    write_stl(die, path, limit_bytes=1_000_000_000)
    assert time.process_time() - before < 20
    mesh = merged(path)
    assert mesh.is_watertight
    assert is_manifold(np.asarray(mesh.faces))
    assert mesh.volume == pytest.approx(100 * chrome_nm2(die)[0], rel=1e-5)


def test_centres_are_measured_from_the_slots_middle():
    die = die_of(random_opening(), np.zeros((2, 3)), gutter_nm=2)
    centres = centres_nm(die)
    assert centres.shape == (2, 3, 2)
    corner = centres[0, 0] + die.centre_nm - die.panel.pitch_nm / 2
    assert tuple(corner) == die.origin_nm
    assert (centres[1, 2] - centres[0, 0] == [2 * die.panel.pitch_nm, die.panel.pitch_nm]).all()


@pytest.mark.parametrize("format_", WRITERS)
def test_a_cell_without_chrome_is_refused(tmp_path, format_):
    die = die_of(Opening("bare", np.ones((3, 3), dtype=np.bool_), 8000), [[0, 1]])
    with pytest.raises(OutputError, match=r"MF410.*bare.*export\.formats"):
        WRITERS[format_](die, tmp_path / "x", [])
    framed = die_of(die.panel.opening, [[0, 1]], gutter_nm=8000)
    WRITERS[format_](framed, tmp_path / f"x.{format_}", [])


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
    assert path.read_bytes().startswith(b"unit mm; 164 touching corners have a gap of 0.403 um; xxx")
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
    assert "50 times too thick" in document["asset"]["extras"]["comments"][-2]
    assert document["buffers"] == [{"byteLength": len(binary)}]
    assert [mesh["name"] for mesh in document["meshes"]] == ["RANDOM_GLASS", "RANDOM_FILM"]
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
    root, *parts = document["nodes"]
    assert root["children"] == [1, 2]
    assert [(part["name"], part["mesh"]) for part in parts] == [("GLASS", 0), ("FILM", 1)]


def test_a_3mf_holds_glass_and_film_in_micrometres(small_plate, tmp_path):
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
    assert [each.get("name") for each in objects] == ["RANDOM_GLASS", "RANDOM_FILM"]
    assert [each.get("partnumber") for each in model.findall("m:build/m:item", space)] == ["GLASS", "FILM"]


@pytest.mark.parametrize("format_", ["stl", "glb", "3mf"])
def test_outlines_of_more_cells_than_a_mesh_holds_are_refused(tmp_path, format_):
    die = die_of(Opening("x", NOISE, 8000), np.zeros((300, 300), dtype=int))
    with pytest.raises(OutputError, match=r"MF412.*vertices in all cells.*1500000"):
        WRITERS[format_](die, tmp_path / f"x.{format_}")


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
    placed = [replace(die, centre_nm=(die.centre_nm[0], 3000 * n - 7000)) for n, die in enumerate(small_plate.dies)]
    write_plate_step(replace(small_plate, dies=tuple(placed)), path, ["job 0123"])
    assert path.stat().st_size < 60_000
    points = re.findall(r"CARTESIAN_POINT\('',\(([^)]*)\)\)", path.read_text())
    there = {tuple(round(float(value) * 1e6) for value in point.split(",")) for point in points}
    assert there >= {((x0 + x1) // 2, (y0 + y1) // 2, 0) for x0, y0, x1, y1 in (die.box_nm for die in placed)}
