"""Triangle meshes of dies: GLB, 3MF and STL, byte-identical between runs.

GLB and 3MF hold one mesh for each orientation in use and place it once for each cell, so that they grow by some tens of
bytes a cell; they are plain enough to be written here, and are read back by a library that did not write them. STL
knows no instances and repeats every triangle of every cell.
"""

from __future__ import annotations

import json
import struct
import zipfile
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any
from xml.sax.saxutils import escape, quoteattr

import numpy as np
from numpy.typing import NDArray

from maskfab import __version__
from maskfab.errors import OutputError
from maskfab.export.solid.tiles import (
    MOST_MESH_CELLS,
    MOST_MESH_VERTICES,
    Mesh,
    Stack,
    box_mesh,
    cells,
    check_solid_size,
    films,
    glass,
    unit_names,
)
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
    """Write a die as binary glTF 2.0, in metres: glass and chrome, one node for each cell.

    Vertices are float32 within a cell, right to 0.004 nm for one of 168 µm; places are decimals. The root
    node turns z up into glTF's y up. Comments and thicknesses stand in ``asset.extras``.

    Raises:
        OutputError: MF401 if the file cannot be written; MF410 or MF412 as
            :func:`maskfab.export.solid.tiles.check_solid_size`.
    """
    stack = stack or Stack()
    check_solid_size(die, "glb", MOST_MESH_VERTICES, MOST_MESH_CELLS)
    names, chrome = unit_names(die.panel), films(die.panel, stack)
    low, high = glass(die, stack)
    # A unit box and a scale are exact where corners in float32 metres would not be.
    substrate = (f"{die.name}_GLASS", box_mesh(np.zeros(3), np.full(3, 1e9)))
    solids = [substrate, *((f"{die.name}_{names[cell]}", mesh) for cell, mesh in chrome.items())]
    blocks: list[bytes] = []
    views: list[dict[str, Any]] = []
    accessors: list[dict[str, Any]] = []
    meshes: list[dict[str, Any]] = []
    for n, (name, mesh) in enumerate(solids):
        points = (mesh.vertices_nm * 1e-9).astype("<f4")
        for block, target in ((points, _VERTICES), (mesh.triangles.astype("<u4"), _INDICES)):
            start = sum(view["byteLength"] for view in views)
            views.append({"buffer": 0, "byteOffset": start, "byteLength": block.nbytes, "target": target})
            blocks.append(block.tobytes())
        bounds = {"min": points.min(axis=0).tolist(), "max": points.max(axis=0).tolist()}
        accessors.append({"bufferView": 2 * n, "componentType": _FLOAT, "count": len(points), "type": "VEC3", **bounds})
        indices = {"bufferView": 2 * n + 1, "componentType": _UNSIGNED, "type": "SCALAR"}
        accessors.append({**indices, "count": mesh.triangles.size})
        primitive = {"attributes": {"POSITION": 2 * n}, "indices": 2 * n + 1, "material": min(n, 1)}
        meshes.append({"name": name, "primitives": [primitive]})
    index = {cell: n for n, cell in enumerate(chrome, 1)}
    nodes: list[dict[str, Any]] = [
        {"name": die.name, "matrix": _Y_UP, "children": list(range(1, die.panel.orientations.size + 2))},
        {"name": "GLASS", "mesh": 0, "translation": _metres(low), "scale": _metres(high - low)},
        *({"name": name, "mesh": index[cell], "translation": _metres(centre)} for name, cell, centre in cells(die)),
    ]
    document = {
        "asset": {
            "version": "2.0",
            "generator": f"maskfab {__version__}",
            "extras": {"comments": [*comments, *stack.remarks()], "exaggeration": stack.exaggeration},
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
    with partial(path) as place, place.open("wb") as file:
        file.write(struct.pack("<4sII", b"glTF", 2, 12 + 8 + len(text) + 8 + len(data)))
        file.write(struct.pack("<I4s", len(text), b"JSON") + text)
        file.write(struct.pack("<I4s", len(data), b"BIN\0") + data)


def write_3mf(die: Die, path: Path, comments: Sequence[str] = (), stack: Stack | None = None) -> None:
    """Write a die as 3MF, in micrometres: glass and chrome, one build item for each cell.

    Coordinates are decimals, exact to 1e-4 nm. Comments and thicknesses stand in the metadata ``Description``.

    Raises:
        OutputError: MF401 if the file cannot be written; MF410 or MF412 as
            :func:`maskfab.export.solid.tiles.check_solid_size`.
    """
    stack = stack or Stack()
    check_solid_size(die, "3mf", MOST_MESH_VERTICES, MOST_MESH_CELLS)
    names, chrome = unit_names(die.panel), films(die.panel, stack)
    low, high = glass(die, stack)
    objects = [(f"{die.name}_GLASS", box_mesh(np.zeros(3), high - low))]
    objects += [(f"{die.name}_{names[cell]}", mesh) for cell, mesh in chrome.items()]
    index = {cell: n for n, cell in enumerate(chrome, 2)}
    with partial(path) as place, zipfile.ZipFile(place, "w", zipfile.ZIP_DEFLATED) as package:
        _store(package, "[Content_Types].xml", _CONTENT_TYPES)
        _store(package, "_rels/.rels", _RELATIONS)
        parts = [
            '<?xml version="1.0" encoding="UTF-8"?>\n<model unit="micron" xml:lang="en-US" '
            'xmlns="http://schemas.microsoft.com/3dmanufacturing/core/2015/02">\n',
            f'<metadata name="Title">{escape(die.name)}</metadata>\n',
            f'<metadata name="Application">maskfab {__version__}</metadata>\n',
            f'<metadata name="Description">{escape("; ".join((*comments, *stack.remarks())))}</metadata>\n',
            "<resources>\n",
        ]
        for n, (name, mesh) in enumerate(objects, 1):
            parts += _mesh_xml(n, name, mesh)
        parts.append("</resources>\n<build>\n")
        parts.append(_item(1, *low, name="GLASS"))
        parts += (_item(index[cell], *centre.tolist(), name=name) for name, cell, centre in cells(die))
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

    Every cell is a closed surface of its own. Corners are float32 millimetres from the middle of the die, so they are
    rounded to 0.5 nm at 8 to 16 mm from it, to 1 nm at 16 to 32 mm. The head of 80 bytes holds the unit and as much of
    the first comment as fits.

    Args:
        die: what to write.
        path: the file.
        comments: lines about it.
        stack: thicknesses; those of the glass do not matter.
        limit_bytes: the largest file that is written.
        force: write it nonetheless.

    Raises:
        OutputError: MF401 if the file cannot be written; MF411 if it would be larger than ``limit_bytes``; MF410 or
            MF412 as :func:`maskfab.export.solid.tiles.check_solid_size`.
    """
    stack = stack or Stack()
    check_solid_size(die, "stl", MOST_MESH_VERTICES, MOST_MESH_CELLS)
    chrome = films(die.panel, stack)
    triangles = _triangles(die, chrome)
    size = _STL_HEAD + _STL_TRIANGLE.itemsize * triangles
    if size > limit_bytes and not force:
        raise OutputError(
            "MF411",
            f"an STL of {die.panel.orientations.size} cells would take {size / 1e6:.1f} MB, "
            f"more than {limit_bytes / 1e6:g} MB",
            where=f"die {die.name}",
            cure="Use glb or 3mf, which repeat no triangle, or raise export.stl_limit_mb",
        )
    records = {cell: _stl_records(mesh) for cell, mesh in chrome.items()}
    said = "; ".join(("unit mm", *stack.remarks()[1:], *comments))
    head = said.encode("ascii", "replace")[:80].ljust(80)
    with partial(path) as place, place.open("wb") as file:
        file.write(head + struct.pack("<I", triangles))
        for _, cell, centre in cells(die):
            table, corners = records[cell]
            table["corners"] = (corners + centre) * MM_PER_NM
            file.write(table.tobytes())


def _triangles(die: Die, chrome: Mapping[int, Mesh]) -> int:
    return sum(len(chrome[cell].triangles) for cell in die.panel.orientations.ravel().tolist())


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


def _stl_records(mesh: Mesh) -> tuple[NDArray[Any], NDArray[np.float64]]:
    """Records with normals but without places, and the corners in nanometres, float64 [n, 3, 3]."""
    corners = mesh.vertices_nm[mesh.triangles]
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    table = np.zeros(len(corners), dtype=_STL_TRIANGLE)
    table["normal"] = normals / np.linalg.norm(normals, axis=1, keepdims=True)
    return table, corners
