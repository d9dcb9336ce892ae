"""Meshes read back by trimesh, which did not write them: the shapes of a file and where they are placed.

STEP files read back by OCP, in a process of its own: their parts, and where each is placed.

A STEP file whose references were damaged can end the process that reads it, and what OCP took of memory it keeps.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any, TypeAlias

import numpy as np
from scipy import sparse
from scipy.sparse import csgraph

from maskfab.base.arrays import Floats, Ints
from maskfab.base.errors import SourceError
from maskfab.mask.sandbox import PATIENCE_S, read_apart

_FARTHEST_NM = 1e10
_STL_HEAD, _STL_TRIANGLE = 84, 50
"""Bytes."""

_NM_PER_UNIT = {"meters": 1e9, "millimeters": 1e6, "micron": 1e3, "microns": 1e3}


@dataclass(frozen=True, eq=False)
class ReadShape:
    """A shape that a file places.

    Attributes:
        vertices_nm: float64 [n, 3].
        triangles: int64 [m, 3], counter-clockwise seen from outside.
        volume_nm3: within it.
        sound: whether it is closed, as :func:`is_manifold` asks of a mesh, or the reading library of a solid.
    """

    vertices_nm: Floats
    triangles: Ints
    volume_nm3: float
    sound: bool


@dataclass(frozen=True, eq=False)
class ReadSolid:
    """Content of a solid file, z away from the glass, the middle of the die's slot the origin.

    Attributes:
        shapes: everything that is placed.
        index: int64 [n], which shape each placement has.
        turns: float64 [n, 3, 3]; they may scale, too.
        places_nm: float64 [n, 3].
    """

    shapes: tuple[ReadShape, ...]
    index: Ints
    turns: Floats
    places_nm: Floats


def read_scene(path: Path) -> ReadSolid:
    """A GLB or 3MF file.

    Raises:
        SourceError: MF303 if trimesh cannot read it.
    """
    import trimesh

    try:
        scene = trimesh.load_scene(path, process=False)
        scale = _NM_PER_UNIT[scene.units]
        names = list(scene.geometry)
        shapes = tuple(_shape(scene.geometry[name], scale, path) for name in names)
        found = [scene.graph.get(node) for node in scene.graph.nodes_geometry]
        matrices = np.array([matrix for matrix, _ in found]).reshape(-1, 4, 4)
        index = np.array([names.index(name) for _, name in found], dtype=np.int64)
        check_reach(path, matrices[:, :3, 3] * scale)
        check_reach(path, matrices[:, :3, :3])
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
    return ReadSolid(shapes, index, turns, places)


def read_stl(path: Path) -> ReadSolid:
    """A binary STL file in millimetres: one shape.

    Raises:
        SourceError: MF303 if it is not as long as its triangles, or trimesh cannot read it.
    """
    _check_stl_size(path)
    # The whole library keeps ten times the file in memory: its parser alone is asked.
    from trimesh.exchange.stl import load_stl

    try:
        with path.open("rb") as file:
            found = load_stl(file)
        vertices, faces = np.asarray(found["vertices"], dtype=np.float64) * 1e6, np.asarray(found["faces"], np.int64)
        del found
    except Exception as error:
        raise damaged(path, error) from error
    if not len(faces):
        raise damaged(path, "it has no triangles")
    check_reach(path, vertices)
    # Every triangle has corners of its own: those of one place are one, as for whoever makes a solid of it.
    return ReadSolid((_welded(vertices, faces),), np.zeros(1, dtype=np.int64), np.eye(3)[None], np.zeros((1, 3)))


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
    expected = _STL_HEAD + _STL_TRIANGLE * triangles
    if size != expected:
        raise damaged(path, f"it has {size} bytes; the {triangles} triangles that it states take {expected}")


def damaged(path: Path, why: object) -> SourceError:
    """The error for a file that its reader refuses."""
    return SourceError(
        "MF303", f"{path.name} cannot be read: {why}", where=str(path), cure="Run the job again to rewrite it"
    )


def check_reach(path: Path, *lengths_nm: Floats) -> None:
    """Refuse coordinates that no plate has, which arithmetic on them could only turn into warnings.

    Raises:
        SourceError: MF303 for one that is not finite or farther than 10 m away.
    """
    for values in lengths_nm:
        farthest = float(np.abs(values).max(initial=0.0))
        if not farthest <= _FARTHEST_NM:
            raise damaged(path, f"it has a coordinate of {farthest / 1e6:g} mm; the limit is {_FARTHEST_NM / 1e6:g} mm")


def _shape(mesh: Any, scale: float, path: Path) -> ReadShape:
    vertices = np.asarray(mesh.vertices, dtype=np.float64)
    # As numbers: what they are in nanometres, a matrix may say.
    check_reach(path, vertices)
    return _welded(vertices * scale, np.asarray(mesh.faces, dtype=np.int64))


def _welded(vertices: Floats, triangles: Ints) -> ReadShape:
    """A shape whose vertices of one place are one."""
    levels, height = np.unique(vertices[:, 2], return_inverse=True)
    flat, place = np.unique(vertices[:, 0] + 1j * vertices[:, 1], return_inverse=True)
    key, number = np.unique(place * len(levels) + height, return_inverse=True)
    one = np.column_stack([flat.real, flat.imag])[key // len(levels)]
    welded, faces = np.column_stack([one, levels[key % len(levels)]]), number[triangles]
    a, b, c = (welded[faces[:, n]] for n in range(3))
    volume = float(np.einsum("ni,ni->", a, np.cross(b, c)) / 6)
    return ReadShape(welded, faces, volume, is_manifold(faces))


def is_manifold(triangles: Ints) -> bool:
    """Whether triangles are closed surfaces and nothing else.

    Every side runs once each way, so it has two faces, wound alike; the faces round every vertex are one fan; no corner
    comes twice in a triangle. That is what solid modellers ask of a mesh before they make a solid of it.
    """
    count = int(triangles.max()) + 1
    start, end = triangles.ravel(), np.roll(triangles, -1, axis=1).ravel()
    there, back = start * count + end, end * count + start
    order = np.argsort(there)
    ordered = there[order]
    if (start == end).any() or (ordered[1:] == ordered[:-1]).any():
        return False
    at = np.minimum(np.searchsorted(ordered, back), len(ordered) - 1)
    if not np.array_equal(ordered[at], back):
        return False
    # Where corner n starts a side, the neighbour across it ends that side: both corners are of one fan.
    across = order[at]
    following = across - across % 3 + (across + 1) % 3
    links = sparse.coo_array((np.ones(len(start), np.bool_), (np.arange(len(start)), following)), (len(start),) * 2)
    fans = csgraph.connected_components(links, directed=False, return_labels=False)
    return int(fans) == len(np.unique(start))


_BYTES_PER_SECOND = 1e5


@dataclass(frozen=True, eq=False)
class Placed:
    """A part in its place.

    Attributes:
        name: of the occurrence in the root.
        part: number of the part in the order of the file.
        matrix: float64 [4, 4], from the part to the root, in nanometres.
    """

    name: str
    part: int
    matrix: Floats


Parts: TypeAlias = tuple[ReadSolid, tuple[Placed, ...]]


def read_step(path: Path) -> Parts:
    """The parts of a file with one root, and where each is placed.

    Raises:
        SourceError: MF303 if the file cannot be read, has no solids or no root, or is not in millimetres; MF316 if it
            takes far longer than whole files do.
    """
    seconds = PATIENCE_S + path.stat().st_size / _BYTES_PER_SECOND
    read, placed = read_apart(path, Path(__file__).with_name("step_process.py"), kind=Parts, seconds=seconds)
    for shape in read.shapes:
        check_reach(path, shape.vertices_nm)
    check_reach(path, *(each.matrix for each in placed))
    return read, placed
