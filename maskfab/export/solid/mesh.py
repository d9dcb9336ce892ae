"""Triangle meshes of dies: GLB, 3MF and STL, byte-identical between runs.

All hold the film as :func:`maskfab.export.solid.film.film` makes it, one closed surface. They are plain enough to be
written here, and are read back by a library that did not write them.
"""

from __future__ import annotations

import json
import struct
import zipfile
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any
from xml.sax.saxutils import escape, quoteattr

import numpy as np
from numpy.typing import NDArray

from maskfab.base import __version__
from maskfab.base.arrays import Floats
from maskfab.errors import OutputError
from maskfab.export.solid.film import Mesh, box_mesh, film
from maskfab.export.solid.tiles import Stack, check_mesh_size, glass
from maskfab.files.atomic import partial
from maskfab.model import Die
from maskfab.units import MM_PER_NM, UM_PER_NM

_STL_LIMIT = 100_000_000
_STL_HEAD = 84
_STL_TRIANGLE = np.dtype([("normal", "<f4", 3), ("corners", "<f4", (3, 3)), ("attribute", "<u2")])

_FLOAT, _UNSIGNED = 5126, 5125
_VERTICES, _INDICES = 34962, 34963
_Y_UP = (1, 0, 0, 0, 0, 0, -1, 0, 0, 1, 0, 0, 0, 0, 0, 1)
"""glTF's y points up, a die's z; columns of the matrix."""
_DARK = (0.09, 0.1, 0.11)
_GLASS_ALPHA = 0.2

_MODEL = "3D/3dmodel.model"
_CONTENT_TYPES = (
    '<?xml version="1.0" encoding="UTF-8"?>\n'
    '<Types xmlns="http://schemas.openxmlformats.org/package/2006/content-types">'
    '<Default Extension="rels" ContentType="application/vnd.openxmlformats-package.relationships+xml"/>'
    '<Default Extension="model" ContentType="application/vnd.ms-package.3dmanufacturing-3dmodel+xml"/></Types>\n'
)
_RELATIONS = (
    '<?xml version="1.0" encoding="UTF-8"?>\n'
    '<Relationships xmlns="http://schemas.openxmlformats.org/package/2006/relationships">'
    f'<Relationship Target="/{_MODEL}" Id="rel0" Type="http://schemas.microsoft.com/3dmanufacturing/2013/01/3dmodel"/>'
    "</Relationships>\n"
)


def write_glb(die: Die, path: Path, comments: Sequence[str] = (), stack: Stack | None = None) -> None:
    """Write a die as binary glTF 2.0, in metres: a node of glass, and one of chrome.

    The film's vertices are whole nanometres under a node that scales them, so float32 holds them exactly in dies of up
    to 33.5 mm; beyond, they are rounded to 2 or 4 nm. The root node turns z up into glTF's y up. Comments and
    thicknesses stand in ``asset.extras``.

    Raises:
        OutputError: MF401 if the file cannot be written; MF436 as :func:`maskfab.export.solid.film.film`; MF410 or
            MF412 as :func:`maskfab.export.solid.tiles.check_mesh_size`; MF437 if rounding makes one of two vertices.
    """
    stack = stack or Stack()
    check_mesh_size(die, "glb")
    chrome, touches = film(die, stack)
    low, high = glass(die, stack)
    nodes: list[dict[str, Any]] = [{"name": die.name, "matrix": _Y_UP, "children": [1, 2]}]
    blocks: list[bytes] = []
    views: list[dict[str, Any]] = []
    accessors: list[dict[str, Any]] = []
    meshes: list[dict[str, Any]] = []
    # A unit cube of glass and a film one unit thick: in both, scales are exact where corners in metres would not be.
    flat = np.array([1.0, 1.0, stack.film_nm])
    parts = (
        ("GLASS", box_mesh(np.zeros(3), np.ones(3)), {"translation": _metres(low), "scale": _metres(high - low)}),
        ("FILM", Mesh(chrome.vertices_nm / flat, chrome.triangles), {"scale": _metres(flat)}),
    )
    for n, (name, mesh, place) in enumerate(parts):
        points = _float32(die, "glb", mesh.vertices_nm)
        for block, target in ((points, _VERTICES), (mesh.triangles.astype("<u4"), _INDICES)):
            start = sum(view["byteLength"] for view in views)
            views.append({"buffer": 0, "byteOffset": start, "byteLength": block.nbytes, "target": target})
            blocks.append(block.tobytes())
        bounds = {"min": points.min(axis=0).tolist(), "max": points.max(axis=0).tolist()}
        accessors.append({"bufferView": 2 * n, "componentType": _FLOAT, "count": len(points), "type": "VEC3", **bounds})
        indices = {"bufferView": 2 * n + 1, "componentType": _UNSIGNED, "type": "SCALAR"}
        accessors.append({**indices, "count": mesh.triangles.size})
        primitive = {"attributes": {"POSITION": 2 * n}, "indices": 2 * n + 1, "material": n}
        meshes.append({"name": f"{die.name}_{name}", "primitives": [primitive]})
        nodes.append({"name": name, "mesh": n, **place})
    said = [*comments, *stack.remarks(), *stack.touching_remark(die, touches)]
    document = {
        "asset": {
            "version": "2.0",
            "generator": f"maskfab {__version__}",
            "extras": {"comments": said, "exaggeration": stack.exaggeration},
        },
        "scene": 0,
        "scenes": [{"nodes": [0]}],
        "nodes": nodes,
        "meshes": meshes,
        "materials": [
            {"name": "glass", "alphaMode": "BLEND", "pbrMetallicRoughness": _surface(_GLASS_ALPHA)},
            {"name": "chrome", "pbrMetallicRoughness": _surface(1)},
        ],
        "accessors": accessors,
        "bufferViews": views,
        "buffers": [{"byteLength": sum(map(len, blocks))}],
    }
    text = json.dumps(document, separators=(",", ":")).encode()
    text += b" " * (-len(text) % 4)
    data = b"".join(blocks)
    with partial(path) as place_aside, place_aside.open("wb") as file:
        file.write(struct.pack("<4sII", b"glTF", 2, 12 + 8 + len(text) + 8 + len(data)))
        file.write(struct.pack("<I4s", len(text), b"JSON") + text)
        file.write(struct.pack("<I4s", len(data), b"BIN\0") + data)


def write_3mf(die: Die, path: Path, comments: Sequence[str] = (), stack: Stack | None = None) -> None:
    """Write a die as 3MF, in micrometres: an object of glass, and one of chrome.

    Coordinates are decimals, exact to 1e-4 nm. Comments and thicknesses stand in the metadata ``Description``.

    Raises:
        OutputError: MF401 if the file cannot be written; MF436 as :func:`maskfab.export.solid.film.film`; MF410 or
            MF412 as :func:`maskfab.export.solid.tiles.check_mesh_size`.
    """
    stack = stack or Stack()
    check_mesh_size(die, "3mf")
    chrome, touches = film(die, stack)
    low, high = glass(die, stack)
    said = (*comments, *stack.remarks(), *stack.touching_remark(die, touches))
    with partial(path) as place, zipfile.ZipFile(place, "w", zipfile.ZIP_DEFLATED) as package:
        _store(package, "[Content_Types].xml", _CONTENT_TYPES)
        _store(package, "_rels/.rels", _RELATIONS)
        parts = [
            '<?xml version="1.0" encoding="UTF-8"?>\n<model unit="micron" xml:lang="en-US" '
            'xmlns="http://schemas.microsoft.com/3dmanufacturing/core/2015/02">\n',
            f'<metadata name="Title">{escape(die.name)}</metadata>\n',
            f'<metadata name="Application">maskfab {__version__}</metadata>\n',
            f'<metadata name="Description">{escape("; ".join(said))}</metadata>\n',
            "<resources>\n",
        ]
        parts += _mesh_xml(1, f"{die.name}_GLASS", box_mesh(np.zeros(3), high - low))
        parts += _mesh_xml(2, f"{die.name}_FILM", chrome)
        parts += ["</resources>\n<build>\n", _item(1, *low, name="GLASS"), _item(2, 0.0, 0.0, 0.0, name="FILM")]
        parts.append("</build>\n</model>\n")
        _store(package, _MODEL, "".join(parts))


def write_stl(
    die: Die,
    path: Path,
    comments: Sequence[str] = (),
    stack: Stack | None = None,
    *,
    limit_bytes: int = _STL_LIMIT,
    force: bool = False,
) -> None:
    """Write the chrome of a die as binary STL, in millimetres; without the glass, which would touch it everywhere.

    Vertices are float32 millimetres from the middle of the die, so they are rounded to 0.5 nm at 8 to 16 mm from it, to
    1 nm at 16 to 32 mm; those of one place are rounded alike. The head of 80 bytes holds the unit and as much of the
    remarks and of the first comment as fits.

    Args:
        die: what to write.
        path: the file.
        comments: lines about it.
        stack: thicknesses; those of the glass do not matter.
        limit_bytes: the largest file that is written.
        force: write it nonetheless.

    Raises:
        OutputError: MF401 if the file cannot be written; MF411 if it would be larger than ``limit_bytes``; MF436 as
            :func:`maskfab.export.solid.film.film`; MF410 or MF412 as
            :func:`maskfab.export.solid.tiles.check_mesh_size`; MF437 if rounding makes one of two vertices.
    """
    stack = stack or Stack()
    check_mesh_size(die, "stl")
    chrome, touches = film(die, stack)
    count = len(chrome.triangles)
    size = _STL_HEAD + _STL_TRIANGLE.itemsize * count
    if size > limit_bytes and not force:
        raise OutputError(
            "MF411",
            f"an STL of {die.panel.orientations.size} cells would take {size / 1e6:.1f} MB, "
            f"more than {limit_bytes / 1e6:g} MB",
            where=f"die {die.name}",
            cure="Use glb, which takes half of it, or raise export.stl_limit_mb",
        )
    table = np.zeros(count, dtype=_STL_TRIANGLE)
    table["corners"] = _float32(die, "stl", chrome.vertices_nm * MM_PER_NM)[chrome.triangles]
    # Of what is exact: a wall is no higher than the rounding of a die's coordinates leaves it.
    corners = chrome.vertices_nm[chrome.triangles]
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    table["normal"] = normals / np.linalg.norm(normals, axis=1, keepdims=True)
    said = "; ".join(("unit mm", *stack.remarks()[1:], *stack.touching_remark(die, touches), *comments))
    head = said.encode("ascii", "replace")[:80].ljust(80)
    with partial(path) as place, place.open("wb") as file:
        file.write(head + struct.pack("<I", count))
        file.write(table.tobytes())


def _float32(die: Die, kind: str, vertices: Floats) -> NDArray[np.float32]:
    """Vertices as a format rounds them, [n, 3].

    Raises:
        OutputError: MF437 if two become one.
    """
    rounded = vertices.astype("<f4")
    flat, heights = rounded[:, 0] + 1j * rounded[:, 1], rounded[:, 2]
    if sum(len(np.unique(flat[heights == each])) for each in np.unique(heights)) < len(vertices):
        raise OutputError(
            "MF437",
            f"corners of die {die.name} lie so near to one another that float32 makes one of two in a {kind}",
            where=f"die {die.name}",
            cure=f"Use 3mf, whose decimals are exact, and leave {kind} out of export.formats",
        )
    return rounded


def _surface(alpha: float) -> dict[str, Any]:
    """Appearance of glass and chrome: the same, so that it does not show which of the two a viewer takes to be nearer.

    They lie 100 nm apart, less than the depth buffer of most viewers resolves for a whole die, which mottles the chrome
    with any other colour of glass. Matt and without metal they stay dark where a light shines back at the camera.
    """
    return {"baseColorFactor": [*_DARK, alpha], "metallicFactor": 0, "roughnessFactor": 0.7}


def _metres(point_nm: Sequence[float] | NDArray[np.float64]) -> list[float]:
    # 13 decimals are 1e-4 nm; rounding takes away the noise of the product.
    return [round(float(value) * 1e-9, 13) for value in point_nm]


def _um(value_nm: float) -> str:
    """Micrometres to 1e-4 nm, without trailing zeros."""
    return f"{value_nm * UM_PER_NM:.7f}".rstrip("0").rstrip(".")


def _item(number: int, x: float, y: float, z: float, *, name: str) -> str:
    place = f"1 0 0 0 1 0 0 0 1 {_um(x)} {_um(y)} {_um(z)}"
    return f'<item objectid="{number}" transform="{place}" partnumber="{name}"/>\n'


def _mesh_xml(number: int, name: str, mesh: Mesh) -> Iterator[str]:
    yield f'<object id="{number}" name={quoteattr(name)} type="model"><mesh><vertices>\n'
    for x, y, z in mesh.vertices_nm.tolist():
        yield f'<vertex x="{_um(x)}" y="{_um(y)}" z="{_um(z)}"/>\n'
    yield "</vertices><triangles>\n"
    for a, b, c in mesh.triangles.tolist():
        yield f'<triangle v1="{a}" v2="{b}" v3="{c}"/>\n'
    yield "</triangles></mesh></object>\n"


def _store(package: zipfile.ZipFile, name: str, text: str) -> None:
    """Add a part without the time of day."""
    entry = zipfile.ZipInfo(name, (1980, 1, 1, 0, 0, 0))
    entry.compress_type = zipfile.ZIP_DEFLATED
    package.writestr(entry, text.encode())
