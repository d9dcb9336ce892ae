"""GDSII and OASIS files, byte-identical between runs."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from klayout import db

from maskfab.errors import OutputError
from maskfab.export.cell_polygons import MAX_VERTICES
from maskfab.files.atomic import partial

_BEGIN, _END, _END_OF_STREAM = b"\x00\x1c\x05\x02", b"\x00\x04\x07\x00", b"\x00\x04\x04\x00"
"""Records of GDSII: length, kind, type of its data. A structure begins with its times and its name."""
_NAME, _NAME_AT = b"\x06\x06", 28


def write_gdsii(layout: db.Layout, path: Path, max_vertices: int = MAX_VERTICES) -> None:
    """Write a layout as GDSII, without time stamps, its cells in the order of their names.

    Args:
        layout: from :func:`maskfab.geometry.plate_layout.plate_layout` or
            :meth:`maskfab.export.cell_polygons.Figures.layout`.
        path: the file to write.
        max_vertices: longer polygons, which only a layout from elsewhere has, are split by klayout.

    Raises:
        OutputError: MF401 if the file cannot be written; nothing is left under its name.
    """
    options = db.SaveLayoutOptions()
    options.format = "GDS2"
    options.gds2_write_timestamps = False
    options.gds2_max_vertex_count = max_vertices
    options.gds2_multi_xy_records = False
    _write(_by_name(_content(layout, path, options), layout.cells()), path)


def write_oasis(layout: db.Layout, path: Path) -> None:
    """Write a layout as OASIS, with compressed blocks and the tightest repetitions; raises as :func:`write_gdsii`."""
    options = db.SaveLayoutOptions()
    options.format = "OASIS"
    options.oasis_compression_level = 10
    options.oasis_write_cblocks = True
    _write([_content(layout, path, options)], path)


def _content(layout: db.Layout, path: Path, options: db.SaveLayoutOptions) -> bytes:
    try:
        return bytes(layout.write_bytes(options))
    except RuntimeError as error:
        raise OutputError(
            "MF401", f"{path} cannot be written: {error}", cure="Give --out a writable folder with room to spare"
        ) from error


def _by_name(stream: bytes, cells: int) -> Sequence[bytes | memoryview]:
    """The pieces of a GDSII stream with its structures in the order of their names.

    klayout writes what is placed before what places it; the format asks for no order. A stream that does not fall into
    as many structures as there are cells, for its coordinates happen to look like a border, is left as it is.
    """
    whole, starts = memoryview(stream), [stream.index(_BEGIN)]
    while (border := stream.find(_END + _BEGIN, starts[-1])) >= 0:
        starts.append(border + len(_END))
    names = [_NAME_AT + start for start in starts]
    if len(starts) != cells or not all(stream.startswith(_NAME, at + 2) for at in names):
        return [stream]
    ends = [*starts[1:], len(stream) - len(_END_OF_STREAM)]
    named = sorted(
        (stream[at + 4 : at + int.from_bytes(stream[at : at + 2])], start, end)
        for at, start, end in zip(names, starts, ends, strict=True)
    )
    return [whole[: starts[0]], *(whole[start:end] for _, start, end in named), whole[ends[-1] :]]


def _write(content: Sequence[bytes | memoryview], path: Path) -> None:
    with partial(path) as aside, aside.open("wb") as file:
        file.writelines(content)  # klayout itself would not say that a disk is full
