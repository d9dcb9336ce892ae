"""The entities of a text DXF, found in its bytes: fast enough for any plate, and blind to what no reader draws."""

from __future__ import annotations

import math
import re
from collections.abc import Iterator

# Most of a plate are vertices, which belong to their polyline.
_ENTITY = re.compile(rb"(?:^|\n)[ \t]*0[ \t]*\r?\n[ \t]*(?!(?i:vertex)[ \t]*\r?\n)((?:3D)?[A-Za-z][^\r\n]*)\r?(?=\n)")
_SECTION = re.compile(rb"\s*2[ \t]*\r?\n[ \t]*(\w+)")
_DRAWN = {b"BLOCKS", b"ENTITIES"}
_TAG = re.compile(rb"\n[ \t]*(\d{1,4})[ \t]*\r?\n[ \t]*([^\r\n]*)")


class Entity:
    """One thing that is drawn; a vertex belongs to its polyline.

    Args:
        kind: its name, such as ``LWPOLYLINE``.
        block: name of the block that it is drawn in; None in the drawing itself.
        body: its bytes after its name.

    Attributes:
        layer: its layer; ``0``, in a block that of the reference, if it does not say.
    """

    __slots__ = ("_first", "_tags", "block", "kind", "layer")

    def __init__(self, kind: str, block: str | None, body: bytes) -> None:
        self.kind = kind
        self.block = block
        # Group codes and values stay bytes: a plate has millions of them, and few are looked at.
        self._tags: list[tuple[bytes, bytes]] = _TAG.findall(body)
        self._first = dict(reversed(self._tags))
        self.layer = self.text(8, "0")

    def says(self, codes: frozenset[bytes]) -> bool:
        """Whether it has a value under any of these group codes: most have none that change how they are placed."""
        return not codes.isdisjoint(self._first)

    @property
    def width(self) -> float:
        """Width of a line, its first where it has several."""
        if b"40" not in self._first and b"43" not in self._first:
            return 0.0
        return next(number_of(value) for code, value in self._tags if code in {b"43", b"40"})

    @property
    def bulges(self) -> bool:
        """Whether an edge of a line is an arc."""
        return b"42" in self._first and any(code == b"42" and number_of(value) != 0 for code, value in self._tags)

    def text(self, code: int, default: str = "") -> str:
        """The first value under a group code."""
        said = self._first.get(b"%d" % code)
        return default if said is None else said.decode("latin-1").strip()

    def number(self, code: int, default: float = 0.0) -> float:
        """The first value under a group code; 0 if it is no number."""
        said = self._first.get(b"%d" % code)
        return default if said is None else number_of(said)

    def points(self) -> tuple[list[float], list[float]]:
        """x and y of all vertices of a line, in units of the drawing."""
        tags = self._tags
        if self.kind == "POLYLINE":  # its own 10 and 20 are dummies
            tags = tags[next((place for place, tag in enumerate(tags) if tag[0] == b"0"), len(tags)) :]
        xs = [value for code, value in tags if code == b"10"]
        ys = [value for code, value in tags if code == b"20"]
        return _numbers(xs), _numbers(ys)


def codes(*numbers: int) -> frozenset[bytes]:
    """Group codes as :meth:`Entity.says` takes them."""
    return frozenset(b"%d" % each for each in numbers)


def number_of(text: bytes) -> float:
    """A value as a number; 0 if it is none, or has no end."""
    try:
        value = float(text)
    except ValueError:
        return 0.0
    return value if math.isfinite(value) else 0.0


def _numbers(texts: list[bytes]) -> list[float]:
    try:
        return list(map(float, texts))
    except ValueError:
        return [number_of(text) for text in texts]


def entities(data: bytes) -> Iterator[Entity]:
    """Every entity of the sections BLOCKS and ENTITIES, BLOCK and ENDBLK among them, and every LAYER of the tables."""
    section = b""
    block: str | None = None
    previous: tuple[str, int] | None = None
    for match in _ENTITY.finditer(data):
        kind = match[1].decode("latin-1").rstrip(" \t").upper()
        if previous is not None:
            entity = Entity(previous[0], block, data[previous[1] : match.start()])
            if entity.kind == "BLOCK":
                block = entity.block = entity.text(2)
            elif entity.kind == "ENDBLK":
                block = None
            yield entity
        previous = None
        if kind == "SECTION":
            said = _SECTION.match(data, match.end())
            section = b"" if said is None else said[1].upper()
            block = None
        elif section in _DRAWN or (section == b"TABLES" and kind == "LAYER"):
            previous = kind, match.end()
