"""Run as a process of its own: reads GDSII or OASIS with gdstk and pickles its content, in nanometres, to stdout.

gdstk trusts its input: a damaged file can end the process that reads it, and may do so only later, when the name of a
cell is asked for. A few bytes of OASIS can make klayout repeat a shape until memory is full. So both read here first,
within limits, and :mod:`maskfab.geometry.reading` takes what came out whole. Imports little of maskfab, to start
fast.

    python -P -W error gdstk_process.py read_gds|read_oas FILE

A cell is {"name", "polygons": [(points, layer, datatype, repetition)], "labels": [(text, origin, layer, texttype,
repetition)], "references": [(cell name, origin, radians, magnification, mirrored, repetition)]}; a repetition is None,
(columns, rows, 2 x 2 step vectors) or an array of offsets.
"""

from __future__ import annotations

import pickle
import sys
from pathlib import Path
from typing import Any

import gdstk
import numpy as np

from maskfab.geometry.apart import limit_share

_METRES_PER_NM = 1e-9
_LARGEST_REPETITION = 10_000_000
_LARGEST_MEMORY = 3 << 30
_MEMORY_PER_BYTE = 256


def content(function: str, path: str) -> list[dict[str, Any]]:
    """All cells of a file as plain data."""
    if function == "read_oas":
        _try_klayout(path)
    library = getattr(gdstk, function)(path, unit=_METRES_PER_NM)
    return [_plain(cell) for cell in library.cells]


def _try_klayout(path: str) -> None:
    """Read the file with klayout where that may take all the memory that is allowed, and end in an exception."""
    from klayout import db

    options = db.LoadLayoutOptions()
    options.warn_level = 0
    try:
        db.Layout().read(path, options)
    except RuntimeError as error:
        if "topological_sort" not in str(error):
            raise  # cells that contain themselves are named by whoever sees the content


def _plain(cell: Any) -> dict[str, Any]:
    polygons = [*cell.polygons, *(polygon for path in cell.paths for polygon in path.to_polygons())]
    return {
        "name": cell.name,
        "polygons": [(each.points, each.layer, each.datatype, _repetition(each)) for each in polygons],
        "labels": [(each.text, each.origin, each.layer, each.texttype, _repetition(each)) for each in cell.labels],
        "references": [
            (each.cell_name, each.origin, each.rotation, each.magnification, each.x_reflection, _repetition(each))
            for each in cell.references
        ],
    }


def _repetition(each: Any) -> Any:
    repetition = each.repetition
    if not repetition.size:
        return None
    if repetition.columns and repetition.rows:
        if repetition.spacing is not None:
            return repetition.columns, repetition.rows, np.diag(repetition.spacing)
        return repetition.columns, repetition.rows, np.array([repetition.v1, repetition.v2])
    if repetition.size > _LARGEST_REPETITION:
        raise ValueError(f"it repeats one shape {repetition.size} times")
    return repetition.get_offsets()


if __name__ == "__main__":
    limit_share(Path(sys.argv[2]), _LARGEST_MEMORY, _MEMORY_PER_BYTE)
    pickle.dump(content(*sys.argv[1:]), sys.stdout.buffer, protocol=pickle.HIGHEST_PROTOCOL)
