"""Run as a process of its own: reads STEP with OCP and writes what it holds to stdout.

The library's own translation into shapes takes 17 s for 10 000 places, most of it to build the assembly. Here it parses
the file, its parts are translated and mended once each, as its reader would, and the places are taken from the
file's own transformations. For small files the tests compare that with the library's assembly.

    python -P step_process.py FILE

A damaged file can make the library search without end, or take all memory: both are limited here.
"""

from __future__ import annotations

import sys
from collections.abc import Iterator
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import Any, TypeAlias

import numpy as np

from maskfab.base.arrays import Floats, Ints
from maskfab.base.processes import quiet
from maskfab.mask.process_limits import limit_share
from maskfab.mask.sandbox import answer_message

_DEFLECTION_MM = 1e-3
_PRECISION_MM = 1e-7
_MOST_DEPTH = 16
_SECONDS = 8
_BYTES_PER_SECOND = 300_000
_LARGEST_MEMORY = 4 << 30
_MEMORY_PER_BYTE = 1024


@dataclass(frozen=True, eq=False)
class ReadShape:
    """A shape that a file places.

    Attributes:
        vertices_nm: float64 [n, 3].
        triangles: int64 [m, 3], counter-clockwise seen from outside.
        sound: whether it is closed: as :func:`maskfab.mask.formats.mesh.is_manifold` asks of a mesh, as the reading
            library asks of a solid.
    """

    vertices_nm: Floats
    triangles: Ints
    volume_nm3: float
    sound: bool


@dataclass(frozen=True, eq=False)
class ReadSolid:
    """Content of a solid file, z away from the glass, the middle of the die's slot the origin.

    Attributes:
        index: int64 [n], which shape each placement has.
        turns: float64 [n, 3, 3]; they may scale, too.
        places_nm: float64 [n, 3].
    """

    shapes: tuple[ReadShape, ...]
    index: Ints
    turns: Floats
    places_nm: Floats


@dataclass(frozen=True, eq=False)
class Placed:
    """A part in its place: its number in the file's order, float64 [4, 4] to the root in nanometres."""

    name: str
    part: int
    matrix: Floats


Parts: TypeAlias = tuple[ReadSolid, tuple[Placed, ...]]


def content(path: Path) -> Parts:
    """The parts of a file, and where each is placed; any exception if it cannot be read."""
    from OCP.IFSelect import IFSelect_ReturnStatus
    from OCP.StepBasic import StepBasic_SiPrefix, StepBasic_SiUnitAndLengthUnit
    from OCP.STEPControl import STEPControl_Reader
    from OCP.StepShape import (
        StepShape_ContextDependentShapeRepresentation,
        StepShape_ManifoldSolidBrep,
        StepShape_ShapeDefinitionRepresentation,
    )

    reader = STEPControl_Reader()
    if reader.ReadFile(str(path)) != IFSelect_ReturnStatus.IFSelect_RetDone:
        raise ValueError("it is no complete STEP file")
    model = reader.StepModel()
    # As long as an entity's Python object lives, it is the only one, so that identity serves as key.
    entities = [model.Value(n) for n in range(1, model.NbEntities() + 1)]
    units = [each for each in entities if isinstance(each, StepBasic_SiUnitAndLengthUnit)]
    if not units or any(not u.HasPrefix() or u.Prefix() != StepBasic_SiPrefix.StepBasic_spMilli for u in units):
        raise ValueError("its lengths are not in millimetres")
    solids: dict[int, list[Any]] = {}
    children: dict[int, list[tuple[str, int, Floats]]] = {}
    used: set[int] = set()
    for entity in entities:
        if isinstance(entity, StepShape_ShapeDefinitionRepresentation):
            shape = entity.UsedRepresentation()
            items = [shape.ItemsValue(n) for n in range(1, shape.NbItems() + 1)]
            breps = [item for item in items if isinstance(item, StepShape_ManifoldSolidBrep)]
            if breps:
                solids[id(entity.Definition().PropertyDefinition().Definition().ProductDefinition())] = breps
        elif isinstance(entity, StepShape_ContextDependentShapeRepresentation):
            use = entity.RepresentedProductRelation().Definition().ProductDefinitionRelationship()
            parent, child = id(use.RelatingProductDefinition()), id(use.RelatedProductDefinition())
            place = entity.RepresentationRelation().TransformationOperator().ItemDefinedTransformation()
            matrix = _frame(place.TransformItem2()) @ np.linalg.inv(_frame(place.TransformItem1()))
            children.setdefault(parent, []).append((use.Name().ToCString(), child, matrix))
            used.add(child)
    roots = (set(children) | set(solids)) - used
    if len(roots) != 1 or not solids:
        raise ValueError(f"it has {len(roots)} roots and {len(solids)} parts")
    numbers = {part: n for n, part in enumerate(solids)}
    placed = tuple(
        Placed(name, numbers[part], matrix) for name, part, matrix in _leaves(roots.pop(), children, numbers, {}, 0)
    )
    shapes = tuple(_shape(breps, model) for breps in solids.values())
    matrices = np.array([solid.matrix for solid in placed]).reshape(-1, 4, 4)
    index = np.array([solid.part for solid in placed], dtype=np.int64)
    return ReadSolid(shapes, index, matrices[:, :3, :3], matrices[:, :3, 3]), placed


def _leaves(
    node: int,
    children: dict[int, list[tuple[str, int, Floats]]],
    parts: dict[int, int],
    leaves: dict[int, list[tuple[str, int, Floats]]],
    depth: int,
) -> list[tuple[str, int, Floats]]:
    """Every part below an assembly: the name of the occurrence in the assembly, the part, and its matrix."""
    if depth > _MOST_DEPTH:
        raise RuntimeError("its assemblies are nested too deeply, or hold themselves")
    if node not in leaves:
        own = [("", node, np.eye(4))] if node in parts else []
        leaves[node] = own + [
            (name, part, matrix @ inner)
            for name, child, matrix in children.get(node, ())
            for _, part, inner in _leaves(child, children, parts, leaves, depth + 1)
        ]
    return leaves[node]


def _frame(placement: Any) -> Floats:
    """float64 [4, 4] of an axis placement, in nanometres."""
    point = placement.Location()
    z = _ratios(placement.Axis()) if placement.HasAxis() else (0.0, 0.0, 1.0)
    x = _ratios(placement.RefDirection()) if placement.HasRefDirection() else (1.0, 0.0, 0.0)
    frame = np.eye(4)
    frame[:3, :3] = _axes(z, x)
    frame[:3, 3] = [point.CoordinatesValue(n) * 1e6 for n in (1, 2, 3)]
    return frame


def _ratios(direction: Any) -> tuple[float, ...]:
    return tuple(direction.DirectionRatiosValue(n) for n in (1, 2, 3))


@lru_cache(maxsize=64)
def _axes(along_z: tuple[float, ...], near_x: tuple[float, ...]) -> Floats:
    """Axes as columns; cells share the few that a film is turned to."""
    z, x = (np.array(ratios) / np.linalg.norm(ratios) for ratios in (along_z, near_x))
    x = x - (x @ z) * z
    x /= np.linalg.norm(x)
    axes: Floats = np.column_stack([x, np.cross(z, x), z])
    return axes


def _shape(breps: list[Any], model: Any) -> ReadShape:
    from OCP.BRepCheck import BRepCheck_Analyzer
    from OCP.BRepGProp import BRepGProp
    from OCP.BRepMesh import BRepMesh_IncrementalMesh
    from OCP.GProp import GProp_GProps

    points: list[Floats] = []
    triangles: list[Ints] = []
    volume, sound, count = 0.0, True, 0
    for brep in breps:
        solid = _translated(brep, model)
        # The analyser passes a shell that lacks a face.
        sound = sound and bool(BRepCheck_Analyzer(solid).IsValid() and _closed(solid))
        mass = GProp_GProps()
        BRepGProp.VolumeProperties_s(solid, mass)
        volume += mass.Mass() * 1e18
        BRepMesh_IncrementalMesh(solid, _DEFLECTION_MM)
        for own_points, own_triangles in _faces(solid):
            points.append(own_points * 1e6)
            triangles.append(own_triangles + count)
            count += len(own_points)
    return ReadShape(np.concatenate(points), np.concatenate(triangles), volume, sound)


def _translated(brep: Any, model: Any) -> Any:
    """One solid, mended with the reader's own defaults (a file without curves on surfaces needs them computed)."""
    from OCP.ShapeFix import ShapeFix_Shape
    from OCP.StepData import StepData_Factors
    from OCP.StepToTopoDS import StepToTopoDS_Builder
    from OCP.Transfer import Transfer_TransientProcess

    process = Transfer_TransientProcess()
    process.SetModel(model)
    factors = StepData_Factors()
    factors.InitializeFactors(1.0, 1.0, 1.0)
    builder = StepToTopoDS_Builder()
    builder.SetPrecision(_PRECISION_MM)
    builder.SetMaxTol(10 * _PRECISION_MM)
    builder.Init(brep, process, factors)
    if not builder.IsDone():
        raise RuntimeError("a solid cannot be translated")
    mend = ShapeFix_Shape(builder.Value())
    mend.SetPrecision(_PRECISION_MM)
    mend.Perform()
    return mend.Shape()


def _closed(solid: Any) -> bool:
    """Whether every shell has each of its edges as often forwards as backwards."""
    from OCP.BRep import BRep_Tool
    from OCP.TopAbs import TopAbs_ShapeEnum
    from OCP.TopExp import TopExp_Explorer

    explorer = TopExp_Explorer(solid, TopAbs_ShapeEnum.TopAbs_SHELL)
    while explorer.More():
        if not BRep_Tool.IsClosed_s(explorer.Current()):
            return False
        explorer.Next()
    return True


def _faces(solid: Any) -> Iterator[tuple[Floats, Ints]]:
    """Points (mm) and triangles of every face, turned outwards."""
    from OCP.BRep import BRep_Tool
    from OCP.TopAbs import TopAbs_Orientation, TopAbs_ShapeEnum
    from OCP.TopExp import TopExp_Explorer
    from OCP.TopLoc import TopLoc_Location
    from OCP.TopoDS import TopoDS

    explorer = TopExp_Explorer(solid, TopAbs_ShapeEnum.TopAbs_FACE)
    while explorer.More():
        face = TopoDS.Face_s(explorer.Current())
        mesh = BRep_Tool.Triangulation_s(face, TopLoc_Location())
        if mesh is None:
            raise RuntimeError("a face has no area")
        nodes = (mesh.Node(n) for n in range(1, mesh.NbNodes() + 1))
        triangles = np.array([mesh.Triangle(n).Get() for n in range(1, mesh.NbTriangles() + 1)], dtype=np.int64) - 1
        if face.Orientation() == TopAbs_Orientation.TopAbs_REVERSED:
            triangles = triangles[:, ::-1]
        yield np.array([(p.X(), p.Y(), p.Z()) for p in nodes]), triangles
        explorer.Next()


def limit(path: Path) -> None:
    """Let the system end this process for more than a whole file takes."""
    limit_share(path, _LARGEST_MEMORY, _MEMORY_PER_BYTE, _SECONDS, _BYTES_PER_SECOND)


if __name__ == "__main__":
    file = Path(sys.argv[1])
    limit(file)
    try:
        with quiet():
            found = content(file)
    except Exception as error:
        # The library's exceptions share no base but this, and a dangling reference ends in any of Python's.
        sys.exit(f"{str(error) or type(error).__name__}")
    sys.stdout.buffer.write(answer_message(found, Parts))
