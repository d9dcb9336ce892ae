"""Run as a process of its own: reads GDSII or OASIS with gdstk and writes its content, in nanometres, to stdout.

gdstk trusts its input: a damaged file can end the process that reads it, and may do so only later, when the name of a
cell is asked for. A few bytes of OASIS can make klayout repeat a shape until memory is full. So both read here first,
within limits, and :mod:`maskfab.mask.formats.gdsii` takes what came out whole. Imports little, to start fast.

Records of GDSII that draw nothing, of which gdstk warns, are left out of a copy; so is the cell in which klayout keeps
settings. Round ends and circles become polygons no further than 1 nm from them. A path all of whose points are one
draws what its ends are: gdstk would leave it out.

    python -P -W error gdstk_process.py read_gds|read_oas FILE

A cell is {"name", "polygons": {"corners", "sizes", "layers", "repetitions"}, "labels": [(text, origin, layer,
texttype, repetition)], "references": [(cell name, origin, radians, magnification, mirrored, repetition)]}; a repetition
is None, (columns, rows, 2 x 2 step vectors) or an array of offsets. Polygons come as arrays, for there may be millions:
the corners of all of them one after the other, how many corners each has, its layer and datatype, and the repetitions
by the numbers of those that have one. From process to process a cell passes as arrays altogether.
"""

from __future__ import annotations

import struct
import sys
import warnings
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any, TypeAlias

import gdstk
import numpy as np
from numpy.typing import NDArray

from maskfab.base.errors import SourceError
from maskfab.mask.process_limits import limit_share
from maskfab.mask.sandbox import answer_message, damaged, error_message

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
            {number: _plain(item) for number, item in polygons["repetitions"].items()},
        ),
        tuple((text, (float(x), float(y)), layer, kind, _plain(r)) for text, (x, y), layer, kind, r in cell["labels"]),
        (
            names,
            np.array([place[item[0]] for item in references], dtype=np.int64),
            np.array([(*item[1], *item[2:4]) for item in references], dtype=np.float64).reshape(-1, 4),
            np.array([bool(item[4]) for item in references], dtype=np.bool_),
            {number: _plain(item[5]) for number, item in enumerate(references) if item[5] is not None},
        ),
    )


def cell_content(arrays: CellArrays) -> dict[str, Any]:
    """A cell that was handed over."""
    name, (corners, sizes, layers, repetitions), labels, (names, which, placed, mirrored, repeated) = arrays
    alike = corners.shape == (sizes.sum(), 2) and layers.shape == (len(sizes), 2) and (sizes >= 0).all()
    placed_alike = placed.shape == (len(which), 4) and mirrored.shape == which.shape
    if not (sizes.ndim == which.ndim == 1 and alike and placed_alike and ((which >= 0) & (which < len(names))).all()):
        raise ValueError("arrays of a cell that do not belong together")
    for repetition in (*repetitions.values(), *repeated.values(), *(label[4] for label in labels)):
        _check(repetition)
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


_METRES_PER_NM = 1e-9
_LARGEST_REPETITION = 10_000_000
_LARGEST_MEMORY = 3 << 29
_MEMORY_PER_BYTE = 256
_AT_ONCE = 10_000
_ENDLIB = 4
_ENDLIB_RECORD = bytes([0, 4, _ENDLIB, 0])
_SHORTEST_RECORD = 4

_CONTEXT = "$$$CONTEXT_INFO$$$"
_FROM_CIRCLE_NM = 1.0
_NODE, _ENDEL, _STRANS, _ABSOLUTE = 0x15, 0x11, 0x1A, 6
_SILENT = {
    0x1F, 0x20, 0x22, 0x23, 0x26, 0x2F, 0x32, 0x33, 0x34, 0x36, 0x37, 0x38, 0x39, 0x3A, 0x3B,
}  # fmt: skip
"""REFLIBS, FONTS, GENERATIONS, ATTRTABLE, ELFLAGS, PLEX, TAPENUM, TAPECODE, STRCLASS, FORMAT, MASK, ENDMASKS,
LIBDIRSIZE, SRFNAME and LIBSECUR."""


def content(function: str, path: str) -> list[dict[str, Any]]:
    """All cells of a file as plain data.

    Raises:
        SourceError: MF303 something stands behind the end of a GDSII file, or an OASIS file is not what its own
            checksum was made of; MF316 absolute widths, sizes or angles in cells that are placed otherwise.
    """
    if function == "read_oas":
        if gdstk.oas_validate(path)[0] is False:
            raise damaged(Path(path), "its own checksum says that it was changed since it was written")
        _try_klayout(path)
    else:
        _refuse_rest(path)
    cells = [cell for cell in _library(function, path).cells if cell.name != _CONTEXT]
    _refuse_absolute_widths(path, cells)
    return [_plain_repetition(cell) for cell in cells]


def _library(function: str, path: str) -> Any:
    warnings.filterwarnings("ignore", "Missing reference")  # whose names whoever sees the content tells
    read = getattr(gdstk, function)
    try:
        return read(path, unit=_METRES_PER_NM, tolerance=_FROM_CIRCLE_NM)
    except RuntimeWarning as warning:
        if function == "read_oas" or "Unsupported" not in str(warning):
            raise
    import tempfile  # slow to load, and of GDSII alone

    with tempfile.TemporaryDirectory(prefix="maskfab-") as aside:
        drawing = Path(aside) / "drawing.gds"
        drawing.write_bytes(b"".join(_drawing_records(Path(path))))
        return read(drawing, unit=_METRES_PER_NM, tolerance=_FROM_CIRCLE_NM)


def _drawing_records(path: Path) -> Iterator[bytes]:
    """The records of a GDSII file without those that draw nothing."""
    data, start, kind, within_node = path.read_bytes(), 0, -1, False
    while kind != _ENDLIB:
        length, kind = struct.unpack_from(">HB", data, start)
        record = data[start : start + max(length, _SHORTEST_RECORD)]
        start += len(record)
        if kind == _STRANS and record[-1] & _ABSOLUTE:
            what = f"{path.name} places a cell with an absolute magnification or angle, which few programs know"
            raise SourceError("MF316", what, where=str(path), cure="Place it with both relative to the cell around it")
        within_node = within_node or kind == _NODE
        if not within_node and kind not in _SILENT:
            yield record
        within_node = within_node and kind != _ENDEL


def _refuse_absolute_widths(path: str, cells: Sequence[Any]) -> None:
    """Refuse paths whose width is not to grow with the cell that they lie in, where that is placed magnified."""
    within = {cell.name for cell in cells if any(not own.scale_width and own.widths().any() for own in cell.paths)}
    known = 0
    while len(within) > known:
        known = len(within)
        for cell, placed in ((one, item) for one in cells for item in one.references if item.cell_name in within):
            if placed.magnification != 1:
                what = (
                    f"{Path(path).name} draws a path of an absolute width below cell {placed.cell_name!r}, which cell "
                    f"{cell.name!r} places {placed.magnification:g} times as large: some readers widen it"
                )
                cure = "Draw it as a boundary, or with a width that is not negative"
                raise SourceError("MF316", what, where=path, cure=cure)
            within.add(cell.name)


def _refuse_rest(path: str) -> None:
    """Readers of GDSII stop at its end, and say nothing of a second library behind it; tapes are filled up with zeros.

    A record is its length in two bytes, its type in one, that of its data in another, and its data.
    """
    data = Path(path).read_bytes()
    if data.find(_ENDLIB_RECORD) == len(data.rstrip(b"\0")) - len(_ENDLIB_RECORD.rstrip(b"\0")):
        return  # nothing before looks like an end, and to go through a million records takes long
    start, kind = 0, -1
    while kind != _ENDLIB:
        length, kind = data[start] << 8 | data[start + 1], data[start + 2]
        if length < _SHORTEST_RECORD:
            raise damaged(Path(path), f"it has a record of {length} bytes")
        start += length
    if rest := data[start:].strip(b"\0"):
        raise damaged(Path(path), f"{len(rest)} bytes stand behind its end")


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


def _plain_repetition(cell: Any) -> dict[str, Any]:
    polygons = [*cell.polygons, *(polygon for path in cell.paths for polygon in _outlined(path))]
    return {
        "name": cell.name,
        "polygons": _outlines(polygons),
        "labels": [(item.text, item.origin, item.layer, item.texttype, _repetition(item)) for item in cell.labels],
        "references": [
            (item.cell_name, item.origin, item.rotation, item.magnification, item.x_reflection, _repetition(item))
            for item in cell.references
        ],
    }


def _outlined(path: Any) -> list[Any]:
    """A path as polygons."""
    spine = path.spine()
    if (spine != spine[0]).any():
        return list(path.to_polygons())
    (x, y), half, (ends,) = spine[0], path.widths()[0, 0] / 2, path.ends
    if ends == "flush" or not half:
        return []
    on: dict[str, Any] = {"layer": path.layers[0], "datatype": path.datatypes[0]}
    if ends == "round":
        drawn = gdstk.ellipse((x, y), half, tolerance=_FROM_CIRCLE_NM, **on)
    else:
        before, after = (half, half) if isinstance(ends, str) else ends
        drawn = gdstk.rectangle((x - before, y - half), (x + after, y + half), **on)
    drawn.repetition = path.repetition
    return [drawn]


def _outlines(polygons: list[Any]) -> dict[str, Any]:
    corners = [np.empty((0, 2))]
    for start in range(0, len(polygons), _AT_ONCE):
        corners.append(np.concatenate([polygon.points for polygon in polygons[start : start + _AT_ONCE]]))
    repeated = ((number, _repetition(polygon)) for number, polygon in enumerate(polygons))
    return {
        "corners": np.concatenate(corners),
        "sizes": np.array([polygon.size for polygon in polygons], dtype=np.int64),
        "layers": np.array([(polygon.layer, polygon.datatype) for polygon in polygons], dtype=np.int64).reshape(-1, 2),
        "repetitions": {number: repetition for number, repetition in repeated if repetition is not None},
    }


def _repetition(element: Any) -> Any:
    repetition = element.repetition
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
    try:
        message = answer_message(tuple(map(cell_arrays, content(*sys.argv[1:]))), tuple[CellArrays, ...])
    except SourceError as error:
        message = error_message(error)
    sys.stdout.buffer.write(message)
