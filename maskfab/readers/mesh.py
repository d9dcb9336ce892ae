"""Meshes read back by trimesh, which did not write them: the shapes of a file and where they are placed."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from maskfab.errors import SourceError
from maskfab.model import Die

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]

_FLAT_NM = 5.0
"""Triangles of less height are lines whose points float32 has moved."""

_FARTHEST_NM = 1e10
_STL_HEAD, _STL_TRIANGLE = 84, 50
"""Bytes."""

_AT_ONCE = 100_000
"""Triangles of an STL looked at together."""

_NM_PER_UNIT = {"meters": 1e9, "millimeters": 1e6, "micron": 1e3, "microns": 1e3}


@dataclass(frozen=True, eq=False)
class ReadShape:
    """A shape that a file places.

    Attributes:
        vertices_nm: float64 [n, 3].
        triangles: int64 [m, 3], counter-clockwise seen from outside.
        volume_nm3: as the reading library computes it.
        sound: whether that library calls it closed and consistent, or valid.
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
        snapped_nm: how far vertices were moved onto the lines of the design to tell the cells of a flat file apart.
        total_nm3: volume before they were moved; None where none was.
    """

    shapes: tuple[ReadShape, ...]
    index: Ints
    turns: Floats
    places_nm: Floats
    snapped_nm: float = 0.0
    total_nm3: float | None = None


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


def read_stl(path: Path, die: Die) -> ReadSolid:
    """A flat STL file in millimetres, split into the cells of a die; cells that are alike become one shape.

    Raises:
        SourceError: MF303 if it is not as long as its triangles, or trimesh cannot read it.
    """
    _check_stl_size(path)
    # The whole library keeps ten times the file in memory: its parser alone is asked.
    from trimesh.exchange.stl import load_stl

    try:
        with path.open("rb") as file:
            found = load_stl(file)
        corners = np.asarray(found["vertices"], dtype=np.float32)[found["faces"]]
        del found
    except Exception as error:
        raise damaged(path, error) from error
    if not len(corners):
        raise damaged(path, "it has no triangles")
    check_reach(path, np.array([corners.min(), corners.max()], dtype=np.float64) * 1e6)
    sound = _all_closed(corners)
    pitch, columns = die.panel.pitch_nm, die.panel.orientations.shape[1]
    low = np.array(die.origin_nm) - np.array(die.centre_nm)
    split = [_split(chunk, die) for chunk in np.array_split(corners, -(-len(corners) // _AT_ONCE))]
    del corners
    total, moved = sum(each.volume_nm3 for each in split), max(each.moved_nm for each in split)
    cell, snapped = (
        np.concatenate(parts) for parts in zip(*((each.cell, each.snapped_nm) for each in split), strict=True)
    )
    del split
    if not len(cell):
        raise damaged(path, "no triangle has an area")
    key = cell[:, 1] * (columns + 2) + cell[:, 0]
    order = np.argsort(key, kind="stable")
    starts = np.flatnonzero(np.diff(key[order], prepend=key[order[0]] - 1))
    shapes: dict[bytes, int] = {}
    parts: list[ReadShape] = []
    index, places = [], []
    for members in np.split(order, starts[1:]):
        triangles = snapped[members]
        canonical = triangles.reshape(-1, 9)
        content = canonical[np.lexsort(canonical.T)].tobytes()
        if content not in shapes:
            shapes[content] = len(parts)
            volume = float(np.einsum("ni,ni->", triangles[:, 0], np.cross(triangles[:, 1], triangles[:, 2])) / 6)
            parts.append(ReadShape(triangles.reshape(-1, 3), np.arange(3 * len(members)).reshape(-1, 3), volume, sound))
        index.append(shapes[content])
        places.append([*(low + (cell[members[0]] + 0.5) * pitch), 0.0])
    turns = np.broadcast_to(np.eye(3), (len(index), 3, 3))
    return ReadSolid(tuple(parts), np.array(index, dtype=np.int64), turns, np.array(places), moved, total)


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


@dataclass(frozen=True, eq=False)
class _Split:
    """Triangles of a flat file, told apart by cells.

    Attributes:
        cell: int64 [m, 2], column and row of those that have an area.
        snapped_nm: float64 [m, 3, 3], their corners from the cell's centre, moved onto the lines of the design.
        moved_nm: how far at most.
        volume_nm3: of all, before they were moved.
    """

    cell: Ints
    snapped_nm: Floats
    moved_nm: float
    volume_nm3: float


def _split(corners_mm: NDArray[np.float32], die: Die) -> _Split:
    corners = corners_mm.astype(np.float64) * 1e6
    volume = float(np.einsum("ni,ni->", corners[:, 0], np.cross(corners[:, 1], corners[:, 2])) / 6)
    panel = die.panel
    pitch, (rows, columns) = panel.pitch_nm, panel.orientations.shape
    low = np.array(die.origin_nm) - np.array(die.centre_nm)
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    size = np.linalg.norm(normals, axis=1)
    # A triangle without height holds no volume, and nothing tells on which side of a border it belongs.
    longest = np.linalg.norm(corners - np.roll(corners, 1, axis=1), axis=2).max(axis=1)
    solid = size > _FLAT_NM * longest
    corners, inward = corners[solid], -normals[solid] / size[solid, None]
    # Walls on a border belong to the chrome behind them; a gutter may be the narrowest chrome there is.
    narrowest = min(panel.dot_nm, panel.gutter_nm // 2 or panel.dot_nm)
    inside = corners.mean(axis=1) + inward * (narrowest / 4)
    cell = np.clip(np.floor((inside[:, :2] - low) / pitch).astype(np.int64), -1, [columns, rows])
    local = corners.copy()
    local[..., :2] -= (low + (cell + 0.5) * pitch)[:, None]
    lines = unit_lines_nm(die) - pitch / 2
    snapped = np.concatenate([lines[nearest_line(lines, local[..., :2])], np.round(local[..., 2:], 2)], axis=2)
    return _Split(cell, snapped, float(np.abs(snapped - local).max(initial=0.0)), volume)


def unit_lines_nm(die: Die) -> Floats:
    """Borders of the dots and gutters of one cell along x or y, from its lower left corner."""
    return die.panel.cell_size.edges_nm.astype(np.float64)


def nearest_line(lines: Floats, values: Floats) -> Ints:
    """Index of the line nearest to each value."""
    return np.searchsorted((lines[1:] + lines[:-1]) / 2, values).astype(np.int64)


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
    check_reach(path, np.asarray(mesh.vertices, dtype=np.float64) * scale)
    # trimesh counts the faces of every edge by index, so corners that kiss count as the two edges that they are.
    sound = bool(mesh.is_watertight and mesh.is_winding_consistent)
    vertices = np.asarray(mesh.vertices, dtype=np.float64) * scale
    triangles = np.asarray(mesh.faces, dtype=np.int64)
    return ReadShape(vertices, triangles, float(mesh.volume) * scale**3, sound)


def _all_closed(triangles: NDArray[np.float32]) -> bool:
    """Whether every directed edge has as many partners that run the other way: no surface has a rim.

    Vertices are one where their float32 are; edges that several surfaces share are allowed.
    """
    # -0 and 0 are one number of two patterns.
    points = (triangles.reshape(-1, 3) + np.float32(0)).view(np.uint32)
    _, flat = np.unique(points[:, 0].astype(np.uint64) << np.uint64(32) | points[:, 1], return_inverse=True)
    heights, height = np.unique(points[:, 2], return_inverse=True)
    number = flat * len(heights) + height
    corner = np.unique(number, return_inverse=True)[1].reshape(-1, 3)
    start, end = corner.ravel(), np.roll(corner, -1, axis=1).ravel()
    count = int(corner.max()) + 1
    return bool(np.array_equal(np.sort(start * count + end), np.sort(end * count + start)))
