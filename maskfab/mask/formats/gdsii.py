"""GDSII and OASIS: written by klayout, read by gdstk, each block of GDSII in the order of its name.

gdstk reads in a process of its own (:mod:`maskfab.mask.formats.gdstk_process`), for damaged files can end it. Layers
and structures of a GDSII file are counted before, by the patterns that records begin with: klayout reads 60 000 layers
in 40 s. What draws its records in another order is not counted, and is read within the limits of
:mod:`maskfab.mask.sandbox`.
"""

from __future__ import annotations

import re
import zlib
from collections.abc import Collection, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from klayout import db
from numpy.typing import NDArray

from maskfab.base.errors import OutputError, SourceError
from maskfab.base.files import partial
from maskfab.mask.figures import MAX_VERTICES
from maskfab.mask.formats.agreement import count_curves, refuse_unlike
from maskfab.mask.formats.content import Conversion, read_with_klayout
from maskfab.mask.formats.format import Format, Source
from maskfab.mask.formats.gdstk_process import CellArrays, cell_content
from maskfab.mask.layout import (
    MOST_CELLS,
    MOST_LAYERS,
    check_limits,
    check_size,
    left_out,
    note_left_out,
    too_many_cells,
    too_many_layers,
)
from maskfab.mask.sandbox import PATIENCE_S, damaged, read_apart, unusable, wrong_kind

_BEGIN, _END, _END_OF_STREAM = b"\x00\x1c\x05\x02", b"\x00\x04\x07\x00", b"\x00\x04\x04\x00"
"""Records of GDSII: length, kind, type of its data. A structure begins with its times and its name."""
_NAME, _NAME_AT = b"\x06\x06", 28

_GDSII_MAGIC = b"\x00\x06\x00\x02"
_OASIS_MAGIC = b"%SEMI-OASIS\r\n"
_UNSIGNED = b"\x80\x80\x80\x80\0\0"
_BYTES_PER_SECOND = 3e4
_CYCLE = "topological_sort"

# LAYER, and the DATATYPE, TEXTTYPE or BOXTYPE that has to follow it, by their bytes; -1 where their numbers stand.
_LAYER = [0, 6, 0x0D, 2, -1, -1, 0, 6, -1, 2, -1, -1]
_NUMBERS = [4, 5, 10, 11]
_KIND, _KINDS = 8, [0x0E, 0x16, 0x2E]
# BGNSTR with its two times, and the STRNAME that has to follow it.
_STRUCTURE = re.compile(rb"\x00\x1c\x05\x02.{24}[\x00-\x7f].\x06\x06", re.DOTALL)


def write_gdsii(layout: db.Layout, path: Path, max_vertices: int = MAX_VERTICES) -> None:
    """Write GDSII without time stamps, cells in the order of names; klayout splits polygons over ``max_vertices``."""
    options = db.SaveLayoutOptions()
    options.format = "GDS2"
    options.gds2_write_timestamps = False
    options.gds2_max_vertex_count = max_vertices
    options.gds2_multi_xy_records = False
    write_pieces(_by_name(layout_bytes(layout, path, options), layout.cells()), path)


def write_oasis(layout: db.Layout, path: Path) -> None:
    """Write a layout as OASIS, with compressed blocks and the tightest repetitions; raises as :func:`write_gdsii`."""
    options = db.SaveLayoutOptions()
    options.format = "OASIS"
    options.oasis_compression_level = 10
    options.oasis_write_cblocks = True
    write_pieces([_signed(layout_bytes(layout, path, options))], path)


def _signed(stream: bytes) -> bytes:
    """A stream of OASIS with the CRC-32 of all its bytes, which klayout does not write: scheme 1 of its END (SEMI P39).

    END takes 256 bytes, filled up by zeros of the length of an empty text, of which the CRC takes the place of four.
    """
    if not stream.endswith(_UNSIGNED):
        return stream
    whole = stream[: -len(_UNSIGNED)] + b"\0\1"
    return whole + zlib.crc32(whole).to_bytes(4, "little")


def layout_bytes(layout: db.Layout, path: Path, options: db.SaveLayoutOptions) -> bytes:
    """A file as klayout writes it. Raises OutputError MF401."""
    try:
        return bytes(layout.write_bytes(options))
    except RuntimeError as error:
        what = f"{path} cannot be written: {error}"
        raise OutputError("MF401", what, cure="Give --out a writable folder with room to spare") from error


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


def write_pieces(content: Sequence[bytes | memoryview], path: Path) -> None:
    """Write them as one file, which appears once it is whole."""
    with partial(path) as aside, aside.open("wb") as file:
        file.writelines(content)  # klayout itself would not say that a disk is full


def read_gdsii(path: Path) -> db.Layout:
    """A GDSII file as a layout; raises as :func:`maskfab.mask.formats.table.read_layout`."""
    _look_at_gdsii(path)
    klayout = None
    try:
        klayout = by_klayout(path)
    except SourceError as error:
        if _CYCLE not in error.what:
            raise
    return _agreed(path, *_by_gdstk(path, "read_gds"), klayout)


def read_oasis(path: Path) -> db.Layout:
    """An OASIS file as a layout; raises as :func:`maskfab.mask.formats.table.read_layout`."""
    return _agreed(path, *_oasis_by_gdstk(path))


def _look_at_gdsii(path: Path) -> None:
    if not _begins(path, _GDSII_MAGIC):
        raise wrong_kind(path, "GDSII")
    refuse_many_in_gdsii(path)


def by_klayout(path: Path) -> db.Layout:
    """A GDSII or OASIS file by klayout alone, in the file's own unit. Raises SourceError MF303, MF313."""
    options = db.LoadLayoutOptions()
    options.properties_enabled = False
    layout = read_with_klayout(path, options)
    check_size(layout, path)
    return layout


def _gdsii_by_gdstk(path: Path) -> db.Layout:
    _look_at_gdsii(path)
    by_klayout(path)
    return _by_gdstk(path, "read_gds")[0]


def _oasis_by_gdstk(path: Path) -> tuple[db.Layout, Collection[int]]:
    if not _begins(path, _OASIS_MAGIC):
        raise wrong_kind(path, "OASIS")
    return _by_gdstk(path, "read_oas")


def _by_gdstk(path: Path, function: str) -> tuple[db.Layout, Collection[int]]:
    # gdstk takes truncated files for whole ones and dies of some damaged ones. So klayout, which raises, looks first,
    # and gdstk reads in a process of its own, where a warning is a failure too: it means that something is left out.
    # A few bytes of OASIS can make klayout fill all memory with copies of one shape: there the process looks first.
    # Which cells contain themselves klayout does not say: there gdstk goes on, and they are found in its answer.
    conversion = Conversion(path)
    try:
        layout = conversion.layout(_read_cells(path, function, PATIENCE_S + path.stat().st_size / _BYTES_PER_SECOND))
    except (TypeError, ValueError, OverflowError, RuntimeError) as error:
        # Text that is none and numbers that fit no integer pass gdstk.
        raise damaged(path, f"it holds values that cannot be used ({error})") from error
    check_limits(layout, path)
    return layout, conversion.repeated


def _agreed(path: Path, gdstk: db.Layout, repeated: Collection[int], klayout: db.Layout | None = None) -> db.Layout:
    """The layout by gdstk, if klayout reads the same."""
    klayout = klayout or by_klayout(path)
    refuse_unlike(path, klayout, gdstk, repeated)
    note_left_out(gdstk, replace(left_out(gdstk), curves=count_curves(klayout)))
    return gdstk


def _begins(path: Path, magic: bytes) -> bool:
    with path.open("rb") as file:
        return file.read(len(magic)) == magic


def _read_cells(path: Path, function: str, seconds: float) -> list[dict[str, Any]]:
    script = Path(__file__).with_name("gdstk_process.py")
    cells = read_apart(path, script, function, kind=tuple[CellArrays, ...], seconds=seconds)
    try:
        return [cell_content(cell) for cell in cells]
    except ValueError as error:
        raise unusable(path, error) from error


def refuse_many_in_gdsii(path: Path) -> None:
    """Refuse a GDSII file of too many layers or structures. Raises SourceError MF313."""
    data = path.read_bytes()
    if _layers(np.frombuffer(data, dtype=np.uint8)) > MOST_LAYERS:
        raise too_many_layers(path)
    # Whether cells begin at more places than there may be cells.
    if any(count > MOST_CELLS for count, _ in enumerate(_STRUCTURE.finditer(data), 1)):
        raise too_many_cells(path)


def _layers(data: NDArray[np.uint8]) -> int:
    # The rarest byte first: of what is left to look at it leaves least.
    places = np.flatnonzero(data[2 : max(2, len(data) - len(_LAYER) + 3)] == _LAYER[2])
    for place, byte in enumerate(_LAYER):
        if byte >= 0:
            places = places[data[places + place] == byte]
    places = places[np.isin(data[places + _KIND], _KINDS)]
    pairs = data[places[:, None] + np.array(_NUMBERS)]
    return int(np.unique(np.ascontiguousarray(pairs).view(np.uint32)).size)


def _gdsii(of: Source, to: Path) -> None:
    write_gdsii(of.figures.layout(), to, of.figures.options.max_vertices)


def _oasis(of: Source, to: Path) -> None:
    """OASIS with the names of layers of the house's drawings; numbers stay."""
    layout, names = of.figures.layout(), of.settings.drawing.layer_names or {}
    for info in layout.layer_infos():
        if info.name in names:
            layout.set_info(layout.find_layer(info), db.LayerInfo(info.layer, info.datatype, names[info.name]))
    write_oasis(layout, to)


FORMATS = (
    Format(
        "gdsii",
        "GDSII",
        ".gds",
        write_plate=_gdsii,
        read=read_gdsii,
        readers=(("klayout", by_klayout), ("gdstk", _gdsii_by_gdstk)),
        agreed=True,
        suffixes=(".gds", ".gdsii", ".gds2"),
        notes=True,
    ),
    Format(
        "oasis",
        "OASIS",
        ".oas",
        write_plate=_oasis,
        read=read_oasis,
        readers=(("gdstk", lambda path: _oasis_by_gdstk(path)[0]), ("klayout", by_klayout)),
        agreed=True,
        suffixes=(".oas", ".oasis"),
        notes=True,
    ),
)
