"""CIF 2.0, the Caltech Intermediate Form: symbols of polygons, and calls that place them; written by klayout.

C. Mead, L. Conway: Introduction to VLSI Systems (1980), section 4.5.

Written: the unit of 10 nm is scaled by 1/10 in every symbol, so that coordinates are whole nanometres. A layer's name
has at most four letters and digits: L and its number. Symbols have names by the user extension 9, which every reader of
today knows. The format has no arrays.

Read: twice, by the grammar here and by klayout, which must agree. Besides the grammar are read the user extension 9,
names of layers longer than four letters, and a file that calls nothing outside of its symbols, as klayout and others
write them; labels (94) draw nothing. What readers draw differently is refused: wires, round flashes, turns by other
than quarters, deleted definitions, further user extensions.
"""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from klayout import db

from maskfab.base.errors import SourceError
from maskfab.base.model import LAYERS, Plate
from maskfab.mask.figures import Figures, as_figures
from maskfab.mask.formats.content import Conversion, number_layers, read_with_klayout, rounding_nm
from maskfab.mask.formats.format import Format
from maskfab.mask.formats.gdsii import layout_bytes, write_pieces
from maskfab.mask.layout import (
    DBU_UM,
    MOST_CELLS,
    MOST_LAYERS,
    check_file_size,
    check_limits,
    layer_info,
    left_out,
    refuse_long,
    too_many_cells,
    too_many_layers,
)
from maskfab.mask.sandbox import damaged, wrong_kind

TOP = "CIF_TOP"
"""Cell of what stands outside of symbols, where that is more than the call of one of them."""

_NM_PER_UNIT = 10.0
_BLANK, _SEPARATOR = r"[^0-9A-Z();-]", r"[^0-9();-]"
_INTEGER = r"-?\d{1,10}"
_START = re.compile(rf"{_BLANK}*(?:[(;PBWRLC]|9\s|D{_BLANK}*S)")
_COMMAND = re.compile(rf"{_BLANK}*(?:(\()|([0-9][^;]*|[A-DF-Z][^;()]*)?;)")
_PARENTHESIS = re.compile(r"[()]")
_END_OF_COMMENT = re.compile(rf"{_BLANK}*;")
_END = re.compile(rf"{_BLANK}*E({_BLANK}*)")
_PATH = re.compile(rf"{_SEPARATOR}*{_INTEGER}(?:{_SEPARATOR}+{_INTEGER})*{_BLANK}*")
_NUMBERS = re.compile(_INTEGER)
_STEP = re.compile(
    rf"{_BLANK}*(?:T{_SEPARATOR}*({_INTEGER}){_SEPARATOR}+({_INTEGER})|M{_BLANK}*([XY])|"
    rf"R{_SEPARATOR}*({_INTEGER}){_SEPARATOR}+({_INTEGER}))"
)
_SYMBOL = re.compile(rf"D{_BLANK}*([SFD])(.*)", re.DOTALL)
_CALLED = re.compile(rf"C{_SEPARATOR}*(\d{{1,10}})")
_LAYER = re.compile(r"L\s*([A-Za-z0-9_.$]{1,64})\s*")
_NUMBERED = re.compile(r"L?0*(\d{1,5})(?:D0*(\d{1,5})(?:_.*)?)?")
_NAME = re.compile(r"9\s+(\S+)\s*")
LABEL = re.compile(rf"94\s+(?:'[^;]*'|\S+)\s+{_INTEGER}[\s,]+{_INTEGER}(?:\s[^;]*)?")
"""The command of a label: its text, place, and whatever else."""
_CIF_LABEL = re.compile(rf";\s*{LABEL.pattern};".encode())
_LARGEST_NUMBER = 65_535
_SHAPES_ALONE = db.LayoutDiff.BoxesAsPolygons | db.LayoutDiff.NoLayerNames | db.LayoutDiff.NoProperties

_Quarter = tuple[int, int, int, int, int, int]
"""A transformation x' = a x + b y + e, y' = c x + d y + f as a, b, c, d, e, f, in units of its symbol."""


class LayerKey(NamedTuple):
    """Numbers of a layer that its name says, -1 where it does not; the rest of the name."""

    number: int
    datatype: int
    name: str


@dataclass(frozen=True)
class CifContent:
    """Content of a CIF file.

    Attributes:
        cells: as of :mod:`maskfab.mask.formats.gdstk_process`; datatypes are 0, numbers of layers places in ``layers``.
    """

    cells: list[dict[str, Any]]
    layers: tuple[LayerKey, ...]


def read_cif(path: Path) -> db.Layout:
    """A CIF file as a layout; raises as :func:`maskfab.mask.formats.table.read_layout`."""
    # klayout passes over what it does not know, over calls of symbols that are not there and over the place of a call
    # that stands alone; and it ends the process where symbols contain themselves. So the grammar comes first.
    content = cif_content(path)
    conversion = Conversion(path, [_cif_layer(key) for key in content.layers])
    by_grammar = conversion.layout(content.cells)
    options = db.LoadLayoutOptions()
    options.cif_dbu = DBU_UM
    by_klayout = read_with_klayout(path, options, re.sub(_CIF_LABEL, b";", path.read_bytes()))
    number_layers(by_klayout)
    for info in by_grammar.layer_infos():
        by_klayout.layer(info)
    # Off the grid each rounds in a way of its own, and klayout keeps polygons without area.
    exact = not rounding_nm(by_grammar) and not left_out(by_grammar).empty_polygons
    if exact and not db.LayoutDiff().compare(by_grammar, by_klayout, _SHAPES_ALONE):
        what = f"{path.name} shows other polygons to klayout than its grammar says"
        cure = "Write it with plain polygons, and call one symbol outside of all others, unmoved"
        raise SourceError("MF316", what, where=str(path), cure=cure)
    check_limits(by_grammar, path)
    return by_grammar


def _cif_layer(key: LayerKey) -> db.LayerInfo:
    ours = (
        candidate
        for candidate in LAYERS
        if key.name == candidate.name or (key.number, key.datatype) == (candidate.number, candidate.datatype)
    )
    layer = next(ours, None)
    if layer is not None:
        return layer_info(layer)
    return db.LayerInfo(key.name) if key.name else db.LayerInfo(key.number, key.datatype)


def cif_content(path: Path) -> CifContent:
    """All symbols of a file; one more for what stands outside of them.

    Raises:
        SourceError: MF303 truncated or damaged, MF304 no CIF, MF311 round flashes, MF313 too many symbols or layers,
            MF315 a command whose effect is not certain.
    """
    text = path.read_bytes().decode("latin-1")
    if "\0" in text or not _START.match(text):
        raise wrong_kind(path, "CIF")
    return _Reading(path, text).content()


@dataclass
class _Symbol:
    """Content of a symbol while it is read, in its own units."""

    scale: float
    name: str
    layer: int | None = None
    corners: list[float] = field(default_factory=list)
    sizes: list[int] = field(default_factory=list)
    layers: list[int] = field(default_factory=list)
    calls: list[tuple[int, _Quarter]] = field(default_factory=list)

    def content(self, names: Mapping[int, str]) -> dict[str, Any]:
        corners = np.array(self.corners, dtype=np.float64).reshape(-1, 2) * self.scale
        return {
            "name": self.name,
            "polygons": {
                "corners": corners,
                "sizes": np.array(self.sizes, dtype=np.int64),
                "layers": np.array([(layer, 0) for layer in self.layers], dtype=np.int64).reshape(-1, 2),
                "repetitions": {},
            },
            "labels": [],
            "references": [
                (
                    names.get(number, f"C{number}"),
                    (e * self.scale, f * self.scale),
                    math.atan2(c, a),
                    1.0,
                    a * d - b * c < 0,
                    None,
                )
                for number, (a, b, c, d, e, f) in self.calls
            ],
        }


class _Reading:
    """Goes through the commands of a text."""

    def __init__(self, path: Path, text: str) -> None:
        self._path, self._text = path, text
        self._symbols: dict[int, _Symbol] = {}
        self._layers: dict[str, int] = {}
        self._top = _Symbol(_NM_PER_UNIT, TOP)
        self._now = self._top
        self._place = 0
        self._commands: dict[str, Callable[[str], None]] = {
            "P": self._polygon,
            "B": self._box,
            "L": self._layer,
            "C": self._call,
            "D": self._definition,
            "R": self._round,
            "W": self._wire,
        }

    def content(self) -> CifContent:
        for command in self._each_command():
            act = self._commands.get(command[0])
            if act is not None:
                act(command)
            elif command[0].isdigit():
                self._extension(command)
            else:
                raise self._damaged(f"{command[:40]!r} is no command")
        top, names = self._top, {number: symbol.name for number, symbol in self._symbols.items()}
        still = (1, 0, 0, 1, 0, 0)
        alone = not top.sizes and (not top.calls or [call[1] for call in top.calls] == [still])
        if alone and top.calls and top.calls[0][0] not in names:
            raise self._damaged(f"it calls the symbol {top.calls[0][0]}, which it lacks")
        symbols = [*self._symbols.values(), *(() if alone else (top,))]
        layers = tuple(map(_layer_key, self._layers))
        return CifContent([symbol.content(names) for symbol in symbols], layers)

    def _each_command(self) -> Iterator[str]:
        """Commands in their order, comments and empty ones left out, up to the end of the file."""
        text = self._text
        while True:
            match = _COMMAND.match(text, self._place)
            if match is None:
                break
            if match[1]:
                self._skip_comment(match.end())
                continue
            if match[2]:
                self._place = match.start(2)
                yield match[2]
            self._place = match.end()
        end = _END.match(text, self._place)
        if end is None:
            rest = text[self._place : self._place + 40].strip()
            raise self._damaged(f"{rest!r} is no command" if rest else "it ends without E")
        if end.end() != len(text):
            raise self._damaged(f"{text[end.end() : end.end() + 40]!r} stands behind its end")
        if self._now is not self._top:
            raise self._damaged(f"the definition of {self._now.name} has no end")

    def _skip_comment(self, place: int) -> None:
        depth = 1
        while depth:
            match = _PARENTHESIS.search(self._text, place)
            if match is None:
                raise self._damaged("a comment has no end")
            depth += 1 if match[0] == "(" else -1
            place = match.end()
        end = _END_OF_COMMENT.match(self._text, place)
        if end is None:
            raise self._damaged("a comment stands within a command")
        self._place = end.end()

    def _integers(self, text: str, counts: tuple[int, ...] = ()) -> list[int]:
        """The numbers of a command behind its letter; as many as one of ``counts``, or any."""
        if _PATH.fullmatch(text):
            numbers = list(map(int, _NUMBERS.findall(text)))
            if not counts or len(numbers) in counts:
                return numbers
        raise self._damaged(f"{text[:40]!r} are not the numbers of its command")

    def _on_layer(self) -> int:
        if self._now.layer is None:
            raise self._damaged("it draws before it has named a layer")
        return self._now.layer

    def _polygon(self, command: str) -> None:
        numbers = self._integers(command[1:])
        if len(numbers) % 2:
            raise self._damaged(f"the polygon {command[:40]!r} has half a corner")
        self._draw(numbers)

    def _draw(self, corners: list[int] | list[float]) -> None:
        refuse_long(len(corners) // 2, self._path)
        self._now.layers.append(self._on_layer())
        self._now.corners += corners
        self._now.sizes.append(len(corners) // 2)

    def _box(self, command: str) -> None:
        length, width, x, y, *along = self._integers(command[1:], (4, 6))
        lies = not along or self._direction(along[0], along[1])[0]
        if length <= 0 or width <= 0:
            raise self._damaged(f"the box {command[:40]!r} has no area")
        dx, dy = (length / 2, width / 2) if lies else (width / 2, length / 2)
        self._draw([x - dx, y - dy, x + dx, y - dy, x + dx, y + dy, x - dx, y + dy])

    def _direction(self, x: int, y: int) -> tuple[int, int]:
        if not x and not y:
            raise self._damaged("a direction has no length")
        if x and y:
            raise self._uncertain(f"turns by a direction of ({x}, {y})", "Turn by quarters only")
        return (x > 0) - (x < 0), (y > 0) - (y < 0)

    def _layer(self, command: str) -> None:
        match = _LAYER.fullmatch(command)
        if match is None:
            raise self._damaged(f"{command[:40]!r} names no layer")
        self._now.layer = self._layers.setdefault(match[1], len(self._layers))
        if len(self._layers) > MOST_LAYERS:
            raise too_many_layers(self._path)

    def _call(self, command: str) -> None:
        match = _CALLED.match(command)
        if match is None:
            raise self._damaged(f"{command[:40]!r} calls no symbol")
        place, turn = match.end(), (1, 0, 0, 1, 0, 0)
        while step := _STEP.match(command, place):
            turn = self._turned(turn, step)
            place = step.end()
        if command[place:].strip():
            raise self._damaged(f"{command[:40]!r} is no call")
        self._now.calls.append((int(match[1]), turn))

    def _turned(self, turn: _Quarter, step: re.Match[str]) -> _Quarter:
        a, b, c, d, e, f = turn
        if step[1]:
            return a, b, c, d, e + int(step[1]), f + int(step[2])
        if step[3] == "X":
            return -a, -b, c, d, -e, f
        if step[3] == "Y":
            return a, b, -c, -d, e, -f
        x, y = self._direction(int(step[4]), int(step[5]))
        return x * a - y * c, x * b - y * d, y * a + x * c, y * b + x * d, x * e - y * f, y * e + x * f

    def _definition(self, command: str) -> None:
        match = _SYMBOL.fullmatch(command)
        if match is None:
            raise self._damaged(f"{command[:40]!r} is no command")
        kind, rest = match[1], match[2]
        if kind == "D":
            raise self._uncertain("deletes definitions (DD)", "Give every symbol a number of its own")
        if (kind == "S") != (self._now is self._top):
            raise self._damaged("a definition stands within another, or ends where none began")
        if kind == "F":
            if rest.strip():
                raise self._damaged(f"{command[:40]!r} is no command")
            self._now = self._top
            return
        number, *scale = self._integers(rest, (1, 3))
        above, below = scale or (1, 1)
        if number < 0 or above <= 0 or below <= 0:
            raise self._damaged(f"the symbol {number} has a scale of {above}/{below}")
        if number in self._symbols:
            raise self._damaged(f"it defines the symbol {number} twice")
        if len(self._symbols) == MOST_CELLS:
            raise too_many_cells(self._path)
        self._now = self._symbols[number] = _Symbol(_NM_PER_UNIT * above / below, f"C{number}")

    def _round(self, command: str) -> None:
        what = f"{self._path.name} draws round flashes ({command[:40]!r})"
        raise SourceError("MF311", what, where=str(self._path), cure="Draw them as polygons")

    def _wire(self, command: str) -> None:
        raise self._uncertain(f"draws wires ({command[:40]!r})", "Draw them as polygons: readers end wires differently")

    def _extension(self, command: str) -> None:
        if name := _NAME.fullmatch(command):
            if self._now is self._top:
                raise self._damaged(f"{command[:40]!r} names no symbol")
            self._now.name = name[1]
        elif not LABEL.fullmatch(command):
            raise self._uncertain(f"has the user extension {command[:40]!r}", "Leave it out")

    def _damaged(self, what: str) -> SourceError:
        line = self._text.count("\n", 0, self._place) + 1
        return damaged(self._path, f"line {line}: {what}")

    def _uncertain(self, what: str, cure: str) -> SourceError:
        line = self._text.count("\n", 0, self._place) + 1
        return SourceError("MF315", f"{self._path.name} {what} in line {line}", where=str(self._path), cure=cure)


def _layer_key(name: str) -> LayerKey:
    match = _NUMBERED.fullmatch(name)
    if match is None or max(int(match[1]), int(match[2] or 0)) > _LARGEST_NUMBER:
        return LayerKey(-1, -1, name)
    return LayerKey(int(match[1]), int(match[2] or 0), "")


LARGEST_BYTES = 1_000_000_000


def write_cif(
    source: Plate | Figures, path: Path, comments: Sequence[str] = (), *, limit_bytes: int = LARGEST_BYTES
) -> None:
    """Write a plate with all its layers as CIF, byte-identical between runs; notes that are text are left out.

    Raises:
        OutputError: MF401 if the file cannot be written, MF415 if it would be too large.
    """
    figures = as_figures(source)
    # klayout draws a box of odd width 1 nm too wide; a layout of figures has none, only polygons.
    layout = replace(figures, notes=()).layout()
    for layer in figures.layers:
        layout.set_info(layout.layer(layer_info(layer)), db.LayerInfo(f"L{layer.number}"))
    options = db.SaveLayoutOptions()
    options.format = "CIF"
    options.cif_blank_separator = True
    options.cif_dummy_calls = True  # what no command outside of symbols calls is defined, and not drawn
    _, _, content = layout_bytes(layout, path, options).partition(b";\n")  # the first line says when it was written
    head = "".join(_head(figures, comments)).encode("ascii")
    check_file_size(len(head) + len(content), limit_bytes, path, 'Choose hierarchy = "cells", or GDSII or OASIS')
    write_pieces([head, content], path)


def _head(figures: Figures, comments: Sequence[str]) -> Iterator[str]:
    layers = ", ".join(f"L{layer.number} is {layer.name}" for layer in figures.layers)
    lines = (
        *comments,
        *figures.account.lines(),
        f"Layers: {layers}",
        "Coordinates of every symbol are nanometres; origin is the centre of the blank",
    )
    yield from (f"({_comment(line)});\n" for line in lines)


def _comment(line: str) -> str:
    """The line as comments take it: ASCII, and nothing that ends a command or opens a comment within."""
    plain = re.sub(r"[^ -~]", "_", " ".join(line.split()))
    return plain.translate(str.maketrans("();", "[],"))


FORMATS = (
    Format(
        "cif",
        "CIF",
        ".cif",
        write_plate=lambda of, to: write_cif(of.figures, to, of.comments),
        read=read_cif,
        suffixes=(".cif",),
    ),
)
