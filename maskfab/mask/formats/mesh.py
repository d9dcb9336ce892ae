"""Triangle meshes of dies: GLB, 3MF and STL, byte-identical between runs, read back by trimesh.

All hold the film as :func:`maskfab.mask.formats.solid.film` makes it, one closed surface, and are plain enough to be
written here.
"""

from __future__ import annotations

import json
import struct
import zipfile
from collections.abc import Callable, Iterable, Iterator, Sequence
from itertools import chain
from pathlib import Path
from typing import Any, TypeAlias

import numpy as np
from numpy.typing import NDArray

from maskfab.base import __version__
from maskfab.base.arrays import Floats, Ints
from maskfab.base.errors import OutputError, SourceError
from maskfab.base.files import partial
from maskfab.base.model import Die, Quantity
from maskfab.base.units import MM_PER_NM, NM_PER_MM, UM_PER_NM
from maskfab.job.values import FileFormat
from maskfab.mask.formats.format import Drawn, Films, Format, Source, Stack
from maskfab.mask.formats.solid import Mesh, box_mesh, check_mesh_size, film, glass
from maskfab.mask.formats.solid_check import check_file, check_reach, damaged, mesh_rows
from maskfab.mask.formats.step_process import ReadShape, ReadSolid

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
_NM_PER_UNIT = {"meters": 1e9, "millimeters": 1e6, "micron": 1e3, "microns": 1e3}
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

_Scene: TypeAlias = tuple[list[tuple[Floats, Ints]], Ints, Floats, float]
"""Vertices and triangles of meshes, which mesh is placed, its matrices [n, 4, 4], and nanometres of its unit."""
_ROWS = 1 << 16
"""Of a table that are written together."""
_AT_ONCE = 1 << 24
"""Bytes of text whose numbers are read together."""


class _Run:
    """Elements of one kind in a 3MF, each on a line of its own."""

    def __init__(self, line: bytes, name: bytes, kind: type[np.generic], digits: bytes) -> None:
        self.line, self.kind, self.digits = line, kind, digits
        self.begins, self.ends = b"<%s>\n" % name, b"</%s>" % name
        self.spaced = bytes(byte if byte in digits else ord(" ") for byte in range(256))


_RUNS = (
    _Run(b'<vertex x="" y="" z=""/>\n', b"vertices", np.float64, b"0123456789.-"),
    _Run(b'<triangle va="" vb="" vc=""/>\n', b"triangles", np.int64, b"0123456789"),
)


def write_glb(
    die: Die, path: Path, comments: Sequence[str] = (), stack: Stack | None = None, films: Films = film
) -> None:
    """Write a die as binary glTF 2.0, in metres: a node of glass, and one of chrome.

    The film's vertices are whole nanometres under a node that scales them, so float32 holds them exactly in dies of up
    to 33.5 mm; beyond, they are rounded to 2 or 4 nm. The root node turns z up into glTF's y up. Comments and
    thicknesses stand in ``asset.extras``.

    Raises:
        OutputError: MF401 if the file cannot be written; MF436 as :func:`maskfab.mask.formats.solid.film`; MF410 or
            MF412 as :func:`maskfab.mask.formats.solid.check_mesh_size`; MF437 if rounding makes one of two vertices.
    """
    stack = stack or Stack()
    chrome, remarks = _film(die, "glb", stack, films)
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
    said = [*comments, *stack.remarks(), *remarks]
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


def write_3mf(
    die: Die, path: Path, comments: Sequence[str] = (), stack: Stack | None = None, films: Films = film
) -> None:
    """Write a die as 3MF, in micrometres: an object of glass, and one of chrome.

    Coordinates are decimals, exact to 1e-4 nm. Comments and thicknesses stand in the metadata ``Description``. Raises
    as :func:`write_glb`.
    """
    from xml.sax.saxutils import escape  # loads all of urllib

    stack = stack or Stack()
    chrome, remarks = _film(die, "3mf", stack, films)
    low, high = glass(die, stack)
    said = (*comments, *stack.remarks(), *remarks)
    with partial(path) as place, zipfile.ZipFile(place, "w", zipfile.ZIP_DEFLATED) as package:
        _store(package, "[Content_Types].xml", [_CONTENT_TYPES])
        _store(package, "_rels/.rels", [_RELATIONS])
        head = [
            '<?xml version="1.0" encoding="UTF-8"?>\n<model unit="micron" xml:lang="en-US" '
            'xmlns="http://schemas.microsoft.com/3dmanufacturing/core/2015/02">\n',
            f'<metadata name="Title">{escape(die.name)}</metadata>\n',
            f'<metadata name="Application">maskfab {__version__}</metadata>\n',
            f'<metadata name="Description">{escape("; ".join(said))}</metadata>\n',
            "<resources>\n",
        ]
        meshes = (
            _mesh_xml(1, f"{die.name}_GLASS", box_mesh(np.zeros(3), high - low)),
            _mesh_xml(2, f"{die.name}_FILM", chrome),
        )
        items = _item(1, *low, name="GLASS"), _item(2, 0.0, 0.0, 0.0, name="FILM")
        end = ["</resources>\n<build>\n", *items, "</build>\n</model>\n"]
        _store(package, _MODEL, chain(head, *meshes, end))


def write_stl(
    die: Die,
    path: Path,
    comments: Sequence[str] = (),
    stack: Stack | None = None,
    films: Films = film,
    *,
    limit_bytes: int = _STL_LIMIT,
    force: bool = False,
) -> None:
    """Write the chrome of a die as binary STL, in millimetres; without the glass, which would touch it everywhere.

    Vertices are float32 millimetres from the middle of the die, so they are rounded to 0.5 nm at 8 to 16 mm from it, to
    1 nm at 16 to 32 mm; those of one place are rounded alike. The head of 80 bytes holds the unit and as much of the
    remarks and of the first comment as fits.

    Raises:
        OutputError: MF411 if it would be larger than ``limit_bytes``, else as :func:`write_glb`.
    """
    stack = stack or Stack()
    chrome, remarks = _film(die, "stl", stack, films)
    count = len(chrome.triangles)
    size = _STL_HEAD + _STL_TRIANGLE.itemsize * count
    if size > limit_bytes and not force:
        what = (
            f"an STL of {die.panel.orientations.size} cells would take {size / 1e6:.1f} MB, "
            f"more than {limit_bytes / 1e6:g} MB"
        )
        cure = "Use glb, which takes half of it, or raise export.stl_limit_mb"
        raise OutputError("MF411", what, where=f"die {die.name}", cure=cure)
    rounded = _float32(die, "stl", chrome.vertices_nm * MM_PER_NM)
    said = "; ".join(("unit mm", *stack.remarks()[1:], *remarks, *comments))
    head = said.encode("ascii", "replace")[:80].ljust(80)
    with partial(path) as place, place.open("wb") as file:
        file.write(head + struct.pack("<I", count))
        for start in range(0, count, _ROWS):
            triangles = chrome.triangles[start : start + _ROWS]
            table = np.zeros(len(triangles), dtype=_STL_TRIANGLE)
            table["corners"] = rounded[triangles]
            # Of what is exact: a wall is no higher than the rounding of a die's coordinates leaves it.
            corners = chrome.vertices_nm[triangles]
            normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
            table["normal"] = normals / np.linalg.norm(normals, axis=1, keepdims=True)
            file.write(table.tobytes())


def _film(die: Die, kind: str, stack: Stack, films: Films) -> tuple[Mesh, tuple[str, ...]]:
    """The film of a die that is not too large, and a remark on corners that touched."""
    check_mesh_size(die, kind)
    chrome, touches = films(die, stack)
    return chrome, stack.touching_remark(die, touches)


def _float32(die: Die, kind: str, vertices: Floats) -> NDArray[np.float32]:
    """Vertices as a format rounds them, [n, 3]. Raises OutputError MF437 if two become one."""
    rounded = vertices.astype("<f4")
    # Two numbers as one of twice the length, none of them -0.
    flat, heights = np.ascontiguousarray(rounded[:, :2] + np.float32(0)).view("<u8").ravel(), rounded[:, 2]
    levels = (np.sort(flat[heights == height]) for height in np.unique(heights))
    if any((level[1:] == level[:-1]).any() for level in levels):
        what = f"corners of die {die.name} lie so near to one another that float32 makes one of two in a {kind}"
        cure = f"Use 3mf, whose decimals are exact, and leave {kind} out of export.formats"
        raise OutputError("MF437", what, where=f"die {die.name}", cure=cure)
    return rounded


def _surface(alpha: float) -> dict[str, Any]:
    """Appearance of glass and chrome: the same, matt, as viewers cannot resolve the 100 nm by which one lies nearer."""
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
    from xml.sax.saxutils import quoteattr

    yield f'<object id="{number}" name={quoteattr(name)} type="model"><mesh><vertices>\n'
    for start in range(0, len(mesh.vertices_nm), _ROWS):
        block = mesh.vertices_nm[start : start + _ROWS]
        # Dots share their borders, so that few numbers are different.
        values, at = np.unique(block, return_inverse=True)
        texts = np.array([_um(value) for value in values.tolist()], dtype=np.object_)
        yield '<vertex x="%s" y="%s" z="%s"/>\n' * len(block) % tuple(texts[at.ravel()].tolist())
    yield "</vertices><triangles>\n"
    for start in range(0, len(mesh.triangles), _ROWS):
        corners = mesh.triangles[start : start + _ROWS]
        yield '<triangle v1="%d" v2="%d" v3="%d"/>\n' * len(corners) % tuple(corners.ravel().tolist())
    yield "</triangles></mesh></object>\n"


def _store(package: zipfile.ZipFile, name: str, texts: Iterable[str]) -> None:
    entry = zipfile.ZipInfo(name, (1980, 1, 1, 0, 0, 0))
    entry.compress_type = zipfile.ZIP_DEFLATED
    with package.open(entry, "w") as part:
        for text in texts:
            part.write(text.encode())


def read_scene(path: Path) -> ReadSolid:
    """A GLB or 3MF file. Raises SourceError MF303 if it cannot be read."""
    try:
        meshes, index, matrices, scale = (_plain_3mf(path) if path.suffix == ".3mf" else None) or _by_trimesh(path)
        check_reach(path, matrices[:, :3, 3] * scale)
        check_reach(path, matrices[:, :3, :3])
        shapes = []
        while meshes:
            vertices, triangles = meshes.pop(0)
            # As numbers: what they are in nanometres, a matrix may say.
            check_reach(path, vertices)
            shapes.append(_welded(vertices * scale, triangles))
        for number, matrix in zip(index, matrices, strict=True):
            check_reach(path, np.abs(shapes[number].vertices_nm).max(axis=0) @ np.abs(matrix[:3, :3]).T)
    except SourceError:
        raise
    except Exception as error:
        # A parser meets a damaged file with whatever exception it happens to run into.
        raise damaged(path, error) from error
    turns, places = matrices[:, :3, :3], matrices[:, :3, 3] * scale
    if path.suffix == ".glb":
        z_up = np.array([[1.0, 0.0, 0.0], [0.0, 0.0, -1.0], [0.0, 1.0, 0.0]])
        turns, places = z_up @ turns, places @ z_up.T
    return ReadSolid(tuple(shapes), index, turns, places)


def _by_trimesh(path: Path) -> _Scene:
    import trimesh

    scene = trimesh.load_scene(path, process=False)
    scale, names = _NM_PER_UNIT[scene.units], list(scene.geometry)
    nodes = [scene.graph.get(node) for node in scene.graph.nodes_geometry]
    meshes = [
        (np.asarray(mesh.vertices, dtype=np.float64), np.asarray(mesh.faces, dtype=np.int64))
        for mesh in map(scene.geometry.pop, names)
    ]
    index = np.array([names.index(name) for _, name in nodes], dtype=np.int64)
    matrices = np.array([matrix for matrix, _ in nodes]).reshape(-1, 4, 4)
    return meshes, index, matrices, scale


def _plain_3mf(path: Path) -> _Scene | None:
    """A 3MF of only plain elements, a line each, read without a tree of forty times the memory; else None."""
    from lxml import etree

    with zipfile.ZipFile(path) as package:
        (name,) = (name for name in package.namelist() if name.lower() == _MODEL.lower())
        text = package.read(name)
    rest, at = bytearray(), 0
    runs: list[NDArray[Any]] = []
    while (start := text.find(_RUNS[len(runs) % 2].begins, at)) >= 0:
        run = _RUNS[len(runs) % 2]
        start += len(run.begins)
        end = text.find(run.ends, start)
        numbers = _numbers(text, start, end, run)
        if numbers is None:
            return None
        runs.append(numbers)
        rest += text[at:start]
        at = end
    rest += text[at:]
    del text
    root = etree.fromstring(bytes(rest), etree.XMLParser(resolve_entities=False, no_network=True))
    objects = root.findall("{*}resources/{*}object")
    told = [f"{len(each.findall(f'{{*}}mesh/{{*}}{kind}'))}" for each in objects for kind in ("vertices", "triangles")]
    if told != ["1"] * len(runs) or root.find(".//{*}component") is not None or len(root.find(".//{*}vertices")):
        return None
    numbers_of = {each.get("id"): number for number, each in enumerate(objects)}
    items = root.findall("{*}build/{*}item")
    matrices = np.tile(np.eye(4), (len(items), 1, 1))
    for matrix, item in zip(matrices, items, strict=True):
        if (placed := item.get("transform")) is not None:
            matrix[:3] = np.array(placed.split(), dtype=np.float64).reshape(4, 3).T
    index = np.array([numbers_of[item.get("objectid")] for item in items], dtype=np.int64)
    meshes = list(zip(runs[::2], runs[1::2], strict=True))
    return meshes, index, matrices, _NM_PER_UNIT[root.get("unit", "millimeters")]


def _numbers(text: bytes, start: int, end: int, run: _Run) -> NDArray[Any] | None:
    """Three numbers of each element of a run, [n, 3]; None where it is not of plain elements alone."""
    parts = [np.empty(0, run.kind)]
    while start < end:
        stop = min(end, text.find(b"\n", min(start + _AT_ONCE, end - 1)) + 1)
        part = text[start:stop].replace(b"v1=", b"va=").replace(b"v2=", b"vb=").replace(b"v3=", b"vc=")
        count = part.count(b"\n")
        numbers = np.fromstring(part.translate(run.spaced), run.kind, sep=" ")
        if part.translate(None, run.digits) != run.line * count or len(numbers) != 3 * count:
            return None
        parts.append(numbers)
        start = stop
    return np.concatenate(parts).reshape(-1, 3) if end >= start else None


def read_stl(path: Path) -> ReadSolid:
    """A binary STL file in millimetres: one shape."""
    _check_stl_size(path)
    # The whole library keeps ten times the file in memory: its parser alone is asked.
    from trimesh.exchange.stl import load_stl

    try:
        with path.open("rb") as file:
            content = load_stl(file)
        vertices, faces = np.asarray(content["vertices"]), np.asarray(content["faces"], np.int64)
        del content
    except Exception as error:
        raise damaged(path, error) from error
    if not len(faces):
        raise damaged(path, "it has no triangles")
    if not np.isfinite(vertices).all():
        raise damaged(path, "a coordinate is no number")
    check_reach(path, np.abs(vertices).max(axis=0).astype(np.float64) * NM_PER_MM)
    # Every triangle has corners of its own: those of one place are one, as for whoever makes a solid of it.
    shape = _welded(vertices, faces, NM_PER_MM)
    return ReadSolid((shape,), np.zeros(1, dtype=np.int64), np.eye(3)[None], np.zeros((1, 3)))


def _check_stl_size(path: Path) -> None:
    """Refuse a file whose length is not that of its triangles: parsers take it for text then, and say so oddly."""
    try:
        size = path.stat().st_size
        with path.open("rb") as file:
            head = file.read(_STL_HEAD)
    except OSError as error:
        raise damaged(path, error) from error
    if len(head) < _STL_HEAD:
        raise damaged(path, f"it has {size} bytes; a binary STL has {_STL_HEAD} at least")
    triangles = int.from_bytes(head[-4:], "little")
    expected = _STL_HEAD + _STL_TRIANGLE.itemsize * triangles
    if size != expected:
        raise damaged(path, f"it has {size} bytes; the {triangles} triangles that it states take {expected}")


def _welded(vertices: NDArray[np.floating[Any]], triangles: Ints, unit_nm: float = 1.0) -> ReadShape:
    """A shape whose vertices of one place are one."""
    key = np.zeros(len(vertices), dtype=np.int64)
    for axis in range(3):
        levels = np.sort(vertices[:, axis])
        levels = levels[np.append(True, levels[1:] != levels[:-1])]
        key *= len(levels)
        key += np.searchsorted(levels, vertices[:, axis])
    order = np.argsort(key)
    key = key[order]
    other, order = np.append(True, key[1:] != key[:-1]), order.astype(np.int32)
    del key
    welded = vertices[order[other]].astype(np.float64) * unit_nm
    number = np.empty(len(order), dtype=np.int32)
    number[order] = np.cumsum(other, dtype=np.int32) - 1
    del order, other, vertices
    faces = number[triangles].astype(np.int64)
    del number, triangles
    crossed = np.empty((len(faces), 3))
    for axis in range(3):
        (b, b_next), (c, c_next) = ([welded[faces[:, n], (axis + further) % 3] for further in (1, 2)] for n in (1, 2))
        crossed[:, axis] = b * c_next - b_next * c
    del b, b_next, c, c_next
    volume = float(np.einsum("ni,ni->", welded[faces[:, 0]], crossed) / 6)
    del crossed
    return ReadShape(welded, faces, volume, is_manifold(faces))


def is_manifold(triangles: Ints) -> bool:
    """Whether triangles are closed surfaces and nothing else.

    Every side runs once each way, so it has two faces, wound alike; the faces round every vertex are one fan; no corner
    comes twice in a triangle. That is what solid modellers ask of a mesh before they make a solid of it.
    """
    start, end, count = triangles.ravel(), triangles[:, [1, 2, 0]].ravel(), int(triangles.max()) + 1
    if (start == end).any():
        return False
    sides = start * count + end
    there = np.argsort(sides)
    sides = sides[there]
    if (sides[1:] == sides[:-1]).any():
        return False
    there = there.astype(np.int32)
    end *= count
    end += start
    back = np.argsort(end)
    if not np.array_equal(sides, end[back]):
        return False
    del end, sides
    back = back.astype(np.int32)
    # Where corner n starts a side, the neighbour across it ends that side: both corners are of one fan.
    following = np.empty_like(there)
    following[there] = back - back % 3 + (back + 1) % 3
    del there, back
    last = np.full(count, -1, dtype=np.int32)
    last[start] = np.arange(len(start), dtype=np.int32)
    first = last[last >= 0]
    at, seen = first, 0
    while len(at):
        at, seen = following[at], seen + len(at)  # type: ignore[assignment]
        at, first = at[at != first], first[at != first]
    return seen == len(start)


def check_mesh(die: Die, path: Path, stack: Stack | None = None) -> tuple[Quantity, ...]:
    """Read a die's GLB, 3MF or STL file back and compare it with the design, see :func:`mesh_rows`."""
    check_file(path)
    read = read_stl(path) if path.suffix == ".stl" else read_scene(path)
    return tuple(mesh_rows(die, path, stack or Stack(), read))


def _format(name: FileFormat, write: Callable[[Source, Die, Path], None]) -> Format:
    def compare(made: Drawn, die: Die, path: Path) -> tuple[Quantity, ...]:
        return check_mesh(die, path, made.settings.stack)

    return Format(name, name.upper(), f".{name}", write_die=write, compare_die=compare, extra="solid")


def _stl(of: Source, die: Die, to: Path) -> None:
    write_stl(die, to, of.comments, of.settings.stack, of.films, limit_bytes=of.settings.stl_limit_bytes)


FORMATS = (
    _format("glb", lambda of, die, to: write_glb(die, to, of.comments, of.settings.stack, of.films)),
    _format("3mf", lambda of, die, to: write_3mf(die, to, of.comments, of.settings.stack, of.films)),
    _format("stl", _stl),
)
