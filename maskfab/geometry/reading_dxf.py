"""What a text DXF draws that is no closed polygon, found before a reader makes something of it.

Readers of DXF turn arcs into chords, leave splines out, and take open lines for paths without width, each without a
word. A mask has polygons only, so such drawings are refused and named.
"""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Iterator
from pathlib import Path

from maskfab.errors import SourceError
from maskfab.model import CLEAR

_LINES = {"POLYLINE", "LWPOLYLINE"}
_HARMLESS = {
    "INSERT", "SOLID", "TEXT", "MTEXT", "ATTRIB", "ATTDEF", "POINT", "VERTEX", "SEQEND", "BLOCK", "ENDBLK",
    "SECTION", "ENDSEC", "VIEWPORT",
}  # fmt: skip
_OPEN = {"LINE", "3DFACE", "TRACE", "LEADER", "MLINE", "RAY", "XLINE", "HATCH", "REGION", "3DSOLID", "MESH"}
_ENTITY = re.compile(rb"(?:^|\n)[ \t]*0[ \t]*\r?\n[ \t]*((?:3D)?[A-Za-z][^\r\n]*?)[ \t]*\r?(?=\n)")
_SECTION = re.compile(rb"\s*2[ \t]*\r?\n[ \t]*(\w+)")
_TAG = re.compile(rb"\n[ \t]*(\d{1,4})[ \t]*\r?\n[ \t]*([^\r\n]*)")
_CLOSED = 1
_CURVE_FITTED = 2 | 4


def refuse_undrawable(path: Path, data: bytes) -> None:
    """Refuse a drawing with lines that are open, curves, or fills; on other layers if nothing lies on CLEAR.

    Args:
        path: the file, for errors.
        data: its content, a text DXF.

    Raises:
        SourceError: MF310 open lines or fills, MF311 arcs, splines and bulges.
    """
    found: Counter[tuple[str, str, str]] = Counter()
    clear_drawn = False
    for kind, body in _entities(data):
        tags = [(int(code), value.decode("latin-1").strip()) for code, value in _TAG.findall(body)]
        layer = next((value for code, value in tags if code == 8), "0")
        clear_drawn = clear_drawn or layer == CLEAR.name
        fault = _fault(kind, tags)
        if fault:
            found[(*fault, layer)] += 1
    faults = {
        (code, what, layer): count
        for (code, what, layer), count in found.items()
        if not clear_drawn or layer in {CLEAR.name, "0"}
    }
    if faults:
        told = [f"{count} x {what} on layer {layer!r}" for (_, what, layer), count in sorted(faults.items())]
        raise SourceError(
            max(code for code, _, _ in faults),
            f"{path.name} draws {', '.join(told[:6])}; a mask has closed polygons only",
            where=str(path),
            cure="Close its lines, and turn curves into polygons in the program that drew them",
        )


def _entities(data: bytes) -> Iterator[tuple[str, bytes]]:
    """Every entity of the sections BLOCKS and ENTITIES with its tags; a vertex belongs to its polyline."""
    drawn = False
    previous: tuple[str, int] | None = None
    for match in _ENTITY.finditer(data):
        kind = match[1].decode("latin-1").upper()
        if kind == "VERTEX":
            continue
        if previous is not None:
            yield previous[0], data[previous[1] : match.start()]
        previous = None
        if kind == "SECTION":
            said = _SECTION.match(data, match.end())
            drawn = said is not None and said[1].upper() in {b"BLOCKS", b"ENTITIES"}
        elif drawn:
            previous = kind, match.end()


def _fault(kind: str, tags: list[tuple[int, str]]) -> tuple[str, str] | None:
    if kind in _HARMLESS:
        return None
    if kind in _OPEN:
        return "MF310", kind
    if kind not in _LINES:
        return "MF311", kind
    if any(code == 42 and _number(value) != 0 for code, value in tags):
        return "MF311", f"{kind} with bulges"
    flags = int(next((_number(value) for code, value in tags if code == 70), 0.0))
    if flags & _CURVE_FITTED:
        return "MF311", f"{kind} fitted by curves"
    width = next((_number(value) for code, value in tags if code in {43, 40}), 0.0)
    if not flags & _CLOSED and width == 0 and not _returns(kind, tags):
        return "MF310", f"open {kind}"
    return None


def _returns(kind: str, tags: list[tuple[int, str]]) -> bool:
    """Whether a line ends where it began, which closes it as well as its flag does."""
    xs, ys = ([value for code, value in tags if code == axis] for axis in (10, 20))
    if kind == "POLYLINE":  # its own 10 and 20 are dummies
        xs, ys = xs[1:], ys[1:]
    return (
        len(xs) > 3
        and len(ys) == len(xs)
        and (_number(xs[0]), _number(ys[0]))
        == (
            _number(xs[-1]),
            _number(ys[-1]),
        )
    )


def _number(text: str) -> float:
    try:
        return float(text)
    except ValueError:
        return 0.0
