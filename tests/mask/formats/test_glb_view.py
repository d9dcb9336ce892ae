"""What a viewer shows of a GLB: its triangles drawn here from the letter of the format, and held against the die."""

from __future__ import annotations

import json
import struct

import numpy as np
import pytest

from maskfab.mask.dots import die_edges_nm, die_raster
from maskfab.mask.formats.format import Stack
from maskfab.mask.formats.mesh import write_glb


def scene(path):
    """World coordinates in metres, float64 [n, 3, 3], and material, int64 [n], of every triangle of the scene."""
    data = path.read_bytes()
    length = struct.unpack_from("<I", data, 12)[0]
    document, binary = json.loads(data[20 : 20 + length]), data[28 + length :]

    def array(number, kind):
        accessor = document["accessors"][number]
        view = document["bufferViews"][accessor["bufferView"]]
        return np.frombuffer(binary[view["byteOffset"] :][: view["byteLength"]], kind)

    corners, materials = [], []

    def visit(number, above):
        node = document["nodes"][number]
        if "matrix" in node:
            local = np.reshape(node["matrix"], (4, 4)).T
        else:
            local = np.diag([*node.get("scale", (1, 1, 1)), 1.0])
            local[:3, 3] = node.get("translation", (0, 0, 0))
        world = above @ local
        for primitive in document["meshes"][node["mesh"]]["primitives"] if "mesh" in node else ():
            points = array(primitive["attributes"]["POSITION"], "<f4").reshape(-1, 3).astype(np.float64)
            placed = points @ world[:3, :3].T + world[:3, 3]
            corners.append(placed[array(primitive["indices"], "<u4").reshape(-1, 3)])
            materials.append(np.full(len(corners[-1]), primitive["material"]))
        for child in node.get("children", ()):
            visit(child, world)

    for root in document["scenes"][document["scene"]]["nodes"]:
        visit(root, np.eye(4))
    return np.concatenate(corners), np.concatenate(materials), [each["name"] for each in document["materials"]]


def seen_from_above(path, x_nm, y_nm):
    """Name of the material seen at each sample [y, x], as a camera does that looks down glTF's y, its x to the right.

    Triangles that run clockwise are culled, as the format asks for materials that are not double-sided.
    """
    corners, materials, names = scene(path)
    # Up is glTF's y; the picture's upper side is away from its z.
    right, up, height = 1e9 * corners[..., 0], -1e9 * corners[..., 2], 1e9 * corners[..., 1]
    turn = np.stack([right, up], axis=-1)
    one, other = turn[:, 1] - turn[:, 0], turn[:, 2] - turn[:, 0]
    front = one[:, 0] * other[:, 1] - one[:, 1] * other[:, 0] > 1.0
    nearest = np.full((len(y_nm), len(x_nm)), -np.inf)
    seen = np.full(nearest.shape, "nothing", dtype=object)
    for points, tops, material in zip(turn[front], height[front].max(axis=1), materials[front], strict=True):
        columns, rows = (
            slice(*np.searchsorted(line, (points[:, axis].min(), points[:, axis].max())))
            for axis, line in ((0, x_nm), (1, y_nm))
        )
        x, y = x_nm[columns], y_nm[rows, None]
        inside = np.ones((y.shape[0], x.shape[0]), dtype=np.bool_)
        for start, end in zip(points, np.roll(points, -1, axis=0), strict=True):
            (x0, y0), (x1, y1) = start, end
            inside &= (x1 - x0) * (y - y0) - (y1 - y0) * (x - x0) >= 0
        inside &= tops > nearest[rows, columns]
        nearest[rows, columns][inside] = tops
        seen[rows, columns][inside] = names[material]
    return seen


@pytest.mark.parametrize("n", [0, 1, 2])
def test_a_viewer_sees_glass_through_the_openings_and_chrome_round_them(small_plate, tmp_path, n):
    """Every dot and gutter of a die, holes, kissing corners and mirrored cells among them; beyond it, nothing."""
    die, path = small_plate.dies[n], tmp_path / "x.glb"
    write_glb(die, path, stack=Stack(exaggeration=20))
    edges = die_edges_nm(die)
    x, y = ((line[1:] + line[:-1]) / 2 - centre for line, centre in zip(edges, die.centre_nm, strict=True))
    seen = seen_from_above(path, x, y)
    assert np.array_equal(seen, np.where(die_raster(die), "glass", "chrome"))
    far = die.slot_nm
    assert (seen_from_above(path, np.array([-far, far]), np.array([-far, far])) == "nothing").all()


def test_one_turned_cell_is_seen(small_plate, tmp_path):
    """The picture tells dies apart: that of another is not this one's."""
    die, other, path = small_plate.dies[2], small_plate.dies[0], tmp_path / "x.glb"
    write_glb(other, path)
    x, y = ((line[1:] + line[:-1]) / 2 - c for line, c in zip(die_edges_nm(die), die.centre_nm, strict=True))
    assert not np.array_equal(seen_from_above(path, x, y), np.where(die_raster(die), "glass", "chrome"))
