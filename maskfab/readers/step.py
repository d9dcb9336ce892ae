"""STEP files read back by OCP, in a process of its own: their parts, and where each is placed.

A STEP file whose references were damaged can end the process that reads it, and what OCP took of memory it keeps.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TypeAlias

from maskfab.base.arrays import Floats
from maskfab.readers.mesh import ReadSolid, check_reach
from maskfab.readers.sandbox.child_process import PATIENCE_S, read_apart

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
