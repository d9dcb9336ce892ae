"""The content of cells as it passes from the process that reads a file, in arrays, for there may be millions.

Cells are those of :mod:`maskfab.readers.gdstk_process`.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, TypeAlias

import numpy as np
from numpy.typing import NDArray

Repetition: TypeAlias = tuple[int, int, NDArray[np.float64]] | NDArray[np.float64] | None
_Polygons: TypeAlias = tuple[NDArray[np.float64], NDArray[np.int64], NDArray[np.int64], Mapping[int, Repetition]]
_Label: TypeAlias = tuple[str, tuple[float, float], int, int, Repetition]
_References: TypeAlias = tuple[
    tuple[str, ...], NDArray[np.int64], NDArray[np.float64], NDArray[np.bool_], Mapping[int, Repetition]
]
"""Distinct names; which of them each has; x, y, radians and magnification [n, 4]; whether it is mirrored."""

CellArrays: TypeAlias = tuple[str, _Polygons, tuple[_Label, ...], _References]


def cell_arrays(cell: Mapping[str, Any]) -> CellArrays:
    """A cell, to be handed over."""
    polygons, references = cell["polygons"], cell["references"]
    names = tuple(dict.fromkeys(reference[0] for reference in references))
    place = {name: number for number, name in enumerate(names)}
    return (
        cell["name"],
        (
            polygons["corners"],
            polygons["sizes"],
            polygons["layers"],
            {number: _plain(each) for number, each in polygons["repetitions"].items()},
        ),
        tuple((text, (float(x), float(y)), layer, kind, _plain(r)) for text, (x, y), layer, kind, r in cell["labels"]),
        (
            names,
            np.array([place[each[0]] for each in references], dtype=np.int64),
            np.array([(*each[1], *each[2:4]) for each in references], dtype=np.float64).reshape(-1, 4),
            np.array([bool(each[4]) for each in references], dtype=np.bool_),
            {number: _plain(each[5]) for number, each in enumerate(references) if each[5] is not None},
        ),
    )


def cell_content(arrays: CellArrays) -> dict[str, Any]:
    """A cell that was handed over.

    Raises:
        ValueError: for arrays that do not belong together.
    """
    name, (corners, sizes, layers, repetitions), labels, (names, which, placed, mirrored, repeated) = arrays
    alike = corners.shape == (sizes.sum(), 2) and layers.shape == (len(sizes), 2) and (sizes >= 0).all()
    placed_alike = placed.shape == (len(which), 4) and mirrored.shape == which.shape
    if not (sizes.ndim == which.ndim == 1 and alike and placed_alike and ((which >= 0) & (which < len(names))).all()):
        raise ValueError("arrays of a cell that do not belong together")
    for each in (*repetitions.values(), *repeated.values(), *(label[4] for label in labels)):
        _check(each)
    return {
        "name": name,
        "polygons": {"corners": corners, "sizes": sizes, "layers": layers, "repetitions": dict(repetitions)},
        "labels": list(labels),
        "references": [
            (names[number], (x, y), radians, magnification, turned, repeated.get(k))
            for k, (number, (x, y, radians, magnification), turned) in enumerate(
                zip(which.tolist(), placed.tolist(), mirrored.tolist(), strict=True)
            )
        ],
    }


def _plain(repetition: Any) -> Repetition:
    if isinstance(repetition, tuple):
        columns, rows, vectors = repetition
        return int(columns), int(rows), np.asarray(vectors, dtype=np.float64)
    return None if repetition is None else np.asarray(repetition, dtype=np.float64)


def _check(repetition: Repetition) -> None:
    if isinstance(repetition, tuple):
        right = min(repetition[:2]) > 0 and repetition[2].shape == (2, 2)
    else:
        right = repetition is None or (repetition.ndim == 2 and repetition.shape[1] == 2)
    if not right:
        raise ValueError("a repetition that is none")
