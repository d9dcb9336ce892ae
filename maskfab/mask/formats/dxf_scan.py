"""Entities of a DXF found in the bytes of its text, fast enough for any plate, and what of them is out of sight.

A plot shows paper space or the model but not both, and neither frozen layers nor what is invisible. Readers take all of
it for one drawing, and look at shapes that stand upright from the side.
"""

from __future__ import annotations

import math
import re
from array import array
from collections.abc import Iterator

# Most of a plate are vertices, which belong to their polyline. With one sign first, thrice as fast as with a choice.
_ENTITY = re.compile(rb"\n[ \t]*0[ \t]*\r?\n[ \t]*(?!(?i:vertex)[ \t]*\r?\n)((?:3D)?[A-Za-z][^\r\n]*)\r?(?=\n)")
_SECTION = re.compile(rb"\s*2[ \t]*\r?\n[ \t]*(\w+)")
_DRAWN = {b"BLOCKS", b"ENTITIES"}
_TAG = re.compile(rb"\n[ \t]*(\d{1,4})[ \t]*\r?\n[ \t]*([^\r\n]*)")
# Layer, block, x and y of a reference that says no more: a random die has thousands.
_PLAIN = re.compile(
    rb"(?:\n *(?:5|330|100)\r?\n[^\n]*)*\n *8\r?\n([^\r\n]*)\r?(?:\n *100\r?\n[^\n]*)*"
    rb"\n *2\r?\n([^\r\n]*)\r?\n *10\r?\n([^\r\n]*)\r?\n *20\r?\n([^\r\n]*)\r?(?:\n *30\r?\n[^\n]*)?"
)

_SHAPING = frozenset({b"40", b"41", b"42", b"43"})
"""Widths and bulges of a line and of its vertices."""


class Entity:
    """One thing that is drawn; a vertex belongs to its polyline.

    Args:
        kind: its name, such as ``LWPOLYLINE``.
        block: name of the block that it is drawn in; None in the drawing itself.

    Attributes:
        layer: its layer; ``0``, in a block that of the reference, if it does not say.
        copies: x and y of further references that differ from this one in nothing else.
    """

    __slots__ = ("_first", "_tags", "block", "copies", "kind", "layer")

    def __init__(self, kind: str, block: str | None, body: bytes) -> None:
        self.kind = kind
        self.block = block
        # Group codes and values stay bytes: a plate has millions of them, and few are looked at.
        self._tags: list[tuple[bytes, bytes]] = _TAG.findall(body)
        self._first = dict(reversed(self._tags))
        self.layer = self.text(8, "0")
        self.copies = array("d")

    def says(self, codes: frozenset[bytes]) -> bool:
        """Whether it has a value under any of these group codes: most have none that change how they are placed."""
        return not codes.isdisjoint(self._first)

    @property
    def plain_line(self) -> bool:
        """Whether a line has neither widths nor arcs."""
        if _SHAPING.isdisjoint(self._first):
            return True
        return not any(code in _SHAPING and number_of(value) != 0 for code, value in self._tags)

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
    data = b"\n" + data
    section = b""
    block: str | None = None
    previous: tuple[str, int] | None = None
    alike: dict[tuple[bytes, bytes], Entity] = {}
    for match in _ENTITY.finditer(data):
        kind = match[1].decode("latin-1").rstrip(" \t").upper()
        if (
            previous is not None
            and previous[0] == "INSERT"
            and (plain := _PLAIN.fullmatch(data, previous[1], match.start()))
        ):
            layer, name, x, y = plain.groups()
            if (layer, name) in alike:
                alike[layer, name].copies.extend((number_of(x), number_of(y)))
            else:
                alike[layer, name] = Entity("INSERT", block, data[previous[1] : match.start()])
        elif previous is not None:
            yield from alike.values()
            alike.clear()
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
    yield from alike.values()


IN_PAPER_SPACE = " in paper space"
_PAPER = ("*PAPER_SPACE", "$PAPER_SPACE")
_FROZEN = 1
_HIDING = frozenset({b"60", b"67", b"210", b"220", b"230"})
_IN_PLANE = 1e-9
"""Directions are written with so many digits that those along z are closer to it."""


def hiding(entry: Entity) -> str:
    """Words on a layer, by its entry in the table of layers, that no plot shows; empty for others."""
    if int(entry.number(70)) & _FROZEN:
        return "the frozen "
    return "the switched-off " if entry.number(62) < 0 else ""


def out_of_sight(entity: Entity) -> str:
    """Reason for which no plot shows an entity, in words; empty if one does."""
    if (entity.block or "").upper().startswith(_PAPER):
        return IN_PAPER_SPACE
    if not entity.says(_HIDING):
        return ""
    if entity.number(67) == 1:
        return IN_PAPER_SPACE
    if entity.number(60) == 1:
        return " made invisible"
    x, y, z = entity.number(210), entity.number(220), entity.number(230, 1.0)
    if not math.hypot(x, y) < _IN_PLANE * abs(z):
        return " out of the plane"
    return ""
