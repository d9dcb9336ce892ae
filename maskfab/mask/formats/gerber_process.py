"""Run as a process of its own: reads Gerber X2 with gerbonara and writes its outlines, in nanometres, to stdout.

gerbonara reads what boards are made of and passes over what it does not know, step-and-repeat and block apertures
among it. So every command is looked at first, and only those are let through whose effect is certain: regions, flashes
and strokes of circles, rectangles, obrounds and regular polygons. What draws nothing is left out of the text that
gerbonara gets: comments, names, and commands of earlier editions that state what holds anyhow. Circles become polygons
no further than 1 nm from them, their corners then go to the nanometre grid, and they are counted; arcs drawn by G02 and
G03 are refused. It parses a megabyte in a second, beside whatever else is done, and gives back what it took of memory.

    python -P -W error gerber_process.py FILE
"""

from __future__ import annotations

import math
import re
import sys
import warnings
from collections.abc import Iterator
from functools import lru_cache
from itertools import chain, groupby, islice
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from maskfab.base.errors import SourceError
from maskfab.mask.process_limits import limit_share
from maskfab.mask.sandbox import answer_message, damaged, error_message

Run = tuple[bool, NDArray[np.float64], NDArray[np.int64]]
"""Outlines of one polarity, dark or not: their corners [n, 2] in nanometres, and how many each has."""

Outlines = tuple[tuple[Run, ...], int]
"""Runs in their order, and the number of circles that became polygons."""

_LARGEST_NM = 2**31 - 1
_FROM_CIRCLE_NM = 1.0
_CLOSED = 1e-9
_AT_A_TIME = 128
_LARGEST_MEMORY = 3 << 29
_MEMORY_PER_BYTE = 256
_SECONDS = 4
_FARTHEST_NM = 1_000_000_000
"""As for every layout, see :mod:`maskfab.mask.layout`, which takes too long to import here."""

MOST_CURVES = 200_000
"""Flashes and strokes, which are of one kind in a mask file: a region says the same in less time and memory."""

MOST_CORNERS = 20_000_000
_NM_PER_UNIT = {"mm": 1e6, "in": 25.4e6}
_NUMBER = r"\d+(?:\.\d*)?|\.\d+"
_STROKE = r"(?:G01)?(?:X[+-]?\d+)?(?:Y[+-]?\d+)?D0?[123]"
_STROKES = re.compile(rf"(?:\s*+{_STROKE}\*)++")
_FLASHES = re.compile(r"D0?3\*")
_PLAIN = re.compile(rf"(?:G01|G75|G36|G37|M02|(?:G54)?D[1-9]\d+|{_STROKE})", re.DOTALL)
_ZERO, _ONE = r"[+-]?0*\.?0*", r"\+?0*1(?:\.0*)?"
_SILENT = re.compile(r"G0?4.*|G90", re.DOTALL)
"""Comments, and absolute coordinates, which the format statement has said."""

_SILENT_EXTENDED = re.compile(
    rf"AM.*|LN.*|IN.*|LMN|LR{_ZERO}|LS{_ONE}|IPPOS|IR{_ZERO}|MI(?:A0)?(?:B0)?|AS(?:AX)?(?:BY)?|OF(?:A{_ZERO})?(?:B{_ZERO})?|"
    rf"SF(?:A{_ONE})?(?:B{_ONE})?|SR(?:X0*1)?(?:Y0*1)?(?:I{_ZERO})?(?:J{_ZERO})?",
    re.DOTALL,
)
"""Macros and names, and images that are neither turned, mirrored, exchanged, shifted, scaled nor repeated."""

_UNITS = {"G70": "MOIN", "G71": "MOMM"}
_CURES = {
    "IP": "Draw it in positive polarity (%IPPOS*%), clear areas as regions of %LPC*%",
    "OF": "Add the offset to the coordinates, and leave it out",
    "SF": "Multiply the coordinates by the factor, and leave it out",
    "SR": "Write every copy by itself, without step and repeat",
    "G91": "Write absolute coordinates (%FSLA, and no G91)",
    "G70": "State one unit, by %MOIN*% or %MOMM*%",
    "G71": "State one unit, by %MOIN*% or %MOMM*%",
}
_EXTENDED = re.compile(
    rf"(?:FSLAX[1-6][3-7]Y[1-6][3-7]|MO(?:MM|IN)|LP[DC]|T[FAOD][^%*]*|"
    rf"ADD[1-9]\d+(?:C,(?:{_NUMBER})|[RO],(?:{_NUMBER})X(?:{_NUMBER})|P,(?:{_NUMBER})X\d+(?:X-?(?:{_NUMBER}))?))"
)
# In a comment, too, for readers that know no attributes.
_NOT_POSITIVE = re.compile(r"(?:G04\s*#@!\s*)?TF\s*\.FilePolarity\b(?!\s*,\s*Positive\s*$).*", re.DOTALL)
_LENGTHS = re.compile(rf"ADD.*|{_STROKE}", re.DOTALL)
_STATEMENTS = {"FS": "format statement (%FS)", "MO": "unit statement (%MO)"}
_ARCS = re.compile(r"G0?[23](?!\d)|G74")
_COMMAND = re.compile(r"%(?P<extended>[^%]*)%|(?P<plain>G0?4[^*]*|[^*%]*)\*")


def content(path: Path) -> tuple[list[Run], int]:
    """The outlines of a file in the order in which dark and clear cover each other, and how many of them are curves.

    Raises:
        SourceError: MF303 damaged, MF310 open regions, MF311 arcs, MF315 a command whose
            effect is not certain, MF313 too many flashes, strokes or corners, or beyond a metre.
    """
    try:
        text = path.read_bytes().decode("utf-8")
    except UnicodeDecodeError as error:
        raise damaged(path, "it is no text") from error
    text = _drawing_commands(path, text)
    if len(flashes := _FLASHES.findall(text)) > MOST_CURVES:
        raise _too_many(path, f"{len(flashes)} flashes", f"{MOST_CURVES}")
    outlines = _Outlines(path)
    try:
        return list(outlines.runs(_objects(path, text))), outlines.curves
    except (TypeError, ValueError, OverflowError, ZeroDivisionError, AttributeError, KeyError) as error:
        raise damaged(path, f"it holds values that cannot be used ({error})") from error


def _too_many(path: Path, what: str, most: str) -> SourceError:
    cure = "Draw them as regions, or one die at a time"
    return SourceError("MF313", f"{path.name} has {what}; the limit is {most}", where=str(path), cure=cure)


def _drawing_commands(path: Path, text: str) -> str:
    """The text without what draws nothing. Raises SourceError MF303, MF311, MF315."""
    end = start = 0
    kept, unit = list[str](), ""
    ended = region = False
    lacking = dict(_STATEMENTS)
    while match := _COMMAND.search(text, end):
        between = text[end : match.start()]
        end = match.end()
        if between.strip():
            raise damaged(path, f"{between.strip()[:40]!r} is no command")
        plain = match["plain"]
        commands = [plain] if plain is not None else _extended(path, match["extended"].strip())
        drawing = list[str]()
        for command in map(str.strip, commands):
            silent = (_SILENT if plain is not None else _SILENT_EXTENDED).fullmatch(command) is not None
            _check_command(path, command, _PLAIN if plain is not None else _EXTENDED, ended, silent=silent)
            if (meant := _UNITS.get(command, command)).startswith("MO"):
                if unit not in ("", meant):
                    raise _unread(path, command)
                silent, unit = silent or unit == meant, meant
            drawing += [] if silent else [meant]
            lacking.pop(meant[:2], None)
            if lacking and _LENGTHS.fullmatch(command):
                raise _without(path, lacking)
            ended = ended or command == "M02"
            region = _within_region(path, command, region)
        if [command.strip() for command in commands] != drawing:
            kept.append(text[start : match.start()])
            start = end
            if drawing:
                kept.append(f"%{'*'.join(drawing)}*%")
        # Nearly all of a file: such commands need no further look, unless they stand behind its end.
        if not ended and not lacking and (strokes := _STROKES.match(text, end)):
            end = strokes.end()
    if region or text[end:].strip() or not ended:
        raise damaged(path, "a region has no end" if region else "it ends without M02")
    return "".join([*kept, text[start:]])


def _extended(path: Path, text: str) -> list[str]:
    """The commands of a block between percent signs; a macro is one, and draws nothing unless an aperture uses it."""
    *commands, rest = text.split("*")
    if rest.strip():
        raise damaged(path, f"{f'%{text}%'[:40]!r} has no end")
    return ["*".join(commands)] if text.startswith("AM") else commands


def _within_region(path: Path, command: str, region: bool) -> bool:
    if command not in ("G36", "G37"):
        return region
    if region == (command == "G36"):
        raise damaged(path, f"{command} stands where no region can {'begin' if region else 'end'}")
    return not region


def _without(path: Path, lacking: dict[str, str]) -> SourceError:
    what = f"{path.name}: missing before its first length or coordinate is its {' and its '.join(lacking.values())}"
    cure = "Write it with %FSLAX46Y46*% and %MOMM*%, or whatever its numbers mean"
    return SourceError("MF303", what, where=str(path), cure=cure)


def _check_command(path: Path, command: str, grammar: re.Pattern[str], ended: bool, *, silent: bool) -> None:
    if ended:
        raise damaged(path, f"{command[:40]!r} stands behind M02")
    if _NOT_POSITIVE.match(command):
        what = f"{path.name} says that its polarity is not positive ({command[:60]!r})"
        cure = "Draw clear areas as dark objects, and state Positive or no polarity"
        raise SourceError("MF315", what, where=str(path), cure=cure)
    if silent or grammar.fullmatch(command) or (grammar is _PLAIN and command in _UNITS):
        return
    if grammar is _PLAIN and _ARCS.match(command):
        what = f"{path.name} draws arcs ({command[:40]!r})"
        raise SourceError("MF311", what, where=str(path), cure="Draw them as regions of straight lines")
    raise _unread(path, command)


def _unread(path: Path, command: str) -> SourceError:
    usual = "Write plain regions, flashes and strokes, without macros, blocks or repeats"
    cure = next((told for start, told in _CURES.items() if command.startswith(start)), usual)
    what = f"{path.name} has the command {command[:40]!r}, which is not read"
    return SourceError("MF315", what, where=str(path), cure=cure)


class _Packed(list[Any]):
    """Takes objects of gerbonara as they are read: a pair of Python's numbers is ten times as large as one of numpy's.

    A region is complete when it is appended, and has no arcs, for files with arcs are refused before.
    """

    def append(self, item: Any) -> None:
        if hasattr(item, "outline"):
            item.outline = np.array(item.outline, dtype=np.float64)
            item.arc_centers = None
        super().append(item)


def _objects(path: Path, text: str) -> list[Any]:
    from gerbonara.rs274x import GerberFile, GerberParser

    try:
        with warnings.catch_warnings():
            # What gerbonara warns of it has guessed.
            warnings.simplefilter("error")
            warnings.simplefilter("ignore", DeprecationWarning)
            file, objects = GerberFile(), _Packed()
            file.objects = objects
            GerberParser(file).parse(text)
            return objects
    except Exception as error:  # a parser of its own, with exceptions of every kind
        said = str(error).splitlines()
        raise damaged(path, said[0][:200] if said else type(error).__name__) from error


class _Outlines:
    """Objects of gerbonara as outlines."""

    def __init__(self, path: Path) -> None:
        self._path = path
        self.curves = 0
        self._corners = 0

    def runs(self, objects: list[Any]) -> Iterator[Run]:
        for dark, run in groupby(objects, key=lambda item: bool(item.polarity_dark)):
            parts = list[tuple[NDArray[np.float64], NDArray[np.int64]]]()
            for filled, alike in groupby(run, key=lambda item: hasattr(item, "outline")):
                while some := list(islice(alike, _AT_A_TIME)):
                    parts += [self._regions(some)] if filled else chain.from_iterable(map(self._stroked, some))
            corners, sizes = (np.concatenate(item) for item in zip(*parts, strict=True))
            if not (np.abs(corners) <= _LARGEST_NM).all():  # NaN included
                raise damaged(self._path, "a coordinate lies beyond 2.1 m")
            if not (np.abs(corners) <= _FARTHEST_NM).all():  # near two metres klayout's booleans overflow
                reach = np.abs(corners).max() / 1e9
                what = f"{self._path.name} reaches {reach:.3g} m from its origin; the limit is 1 m"
                cure = "Check the unit, and delete shapes far from the origin"
                raise SourceError("MF313", what, where=str(self._path), cure=cure)
            yield dark, corners, sizes

    def _regions(self, regions: list[Any]) -> tuple[NDArray[np.float64], NDArray[np.int64]]:
        points = np.concatenate([region.outline for region in regions])
        sizes = np.array([len(region.outline) for region in regions])
        last = np.cumsum(sizes) - 1
        first = last - sizes + 1
        with np.errstate(over="ignore", invalid="ignore"):  # numbers too large even for floats are refused below
            open_ones = np.flatnonzero(np.hypot(*(points[first] - points[last]).T) > _CLOSED)
            scales = np.array([_NM_PER_UNIT[str(region.unit)] for region in regions])
            corners = np.delete(points * np.repeat(scales, sizes)[:, None], last, axis=0)
        if open_ones.size:
            ends = [tuple(points[at[open_ones[0]]].tolist()) for at in (first, last)]
            what = f"{self._path.name} has a region that is not closed, from {ends[0]} to {ends[1]}"
            raise SourceError("MF310", what, where=str(self._path), cure="End the region at the point where it starts")
        return corners, sizes - 1

    def _stroked(self, item: Any) -> Iterator[tuple[NDArray[np.float64], NDArray[np.int64]]]:
        aperture = getattr(item, "aperture", None)
        if hasattr(item, "x1") and type(aperture).__name__ != "CircleAperture":
            what = f"{self._path.name} draws a line with an aperture that is not a circle"
            raise SourceError("MF315", what, where=str(self._path), cure="Draw it as a region")
        for part in item.to_primitives("mm"):
            outline = self._primitive(part)
            yield outline, np.array([len(outline)])

    def _primitive(self, part: Any) -> NDArray[np.float64]:
        kind = type(part).__name__
        if kind == "Circle":
            return _distinct(self._round(part.x * 1e6, part.y * 1e6, part.r * 1e6, 0.0, 2 * math.pi))
        if kind == "Line":
            x1, y1, x2, y2 = (1e6 * value for value in (part.x1, part.y1, part.x2, part.y2))
            heading, radius = math.atan2(y2 - y1, x2 - x1), 5e5 * part.width
            far = self._round(x2, y2, radius, heading - math.pi / 2, heading + math.pi / 2)
            near = self._round(x1, y1, radius, heading + math.pi / 2, heading + 1.5 * math.pi)
            return _distinct(np.concatenate([far, near]))
        outline: NDArray[np.float64] = np.array(part.to_arc_poly().outline, dtype=np.float64) * 1e6
        return outline

    def _round(self, x: float, y: float, radius: float, start: float, stop: float) -> NDArray[np.float64]:
        """Points of an arc whose chords stay within a nanometre of it."""
        if not radius <= _LARGEST_NM:
            raise damaged(self._path, "a circle is larger than 2.1 m")
        self.curves += 1
        if self.curves > 2 * MOST_CURVES:  # a stroke has two round ends
            raise _too_many(self._path, f"over {MOST_CURVES} strokes", f"{MOST_CURVES}")
        arc = _arc(radius, start, stop)
        self._corners += len(arc)
        if self._corners > MOST_CORNERS:
            raise _too_many(self._path, f"over {MOST_CORNERS:.0e} corners of circles", f"{MOST_CORNERS:.0e}")
        placed: NDArray[np.float64] = arc + np.array((x, y))
        return placed


@lru_cache(maxsize=64)
def _arc(radius: float, start: float, stop: float) -> NDArray[np.float64]:
    """[n, 2] about the origin; most circles of a file are alike."""
    step = 2 * math.acos(max(0.0, 1 - _FROM_CIRCLE_NM / max(radius, 1.0)))
    angles = np.linspace(start, stop, max(8, math.ceil((stop - start) / step)) + 1)
    return np.stack([radius * np.cos(angles), radius * np.sin(angles)], axis=1)


def _distinct(corners: NDArray[np.float64]) -> NDArray[np.float64]:
    """The corners of a curve on the nanometre grid, without those that repeat the one before: no file drew them."""
    nearest = np.rint(corners)
    moves = (nearest != np.roll(nearest, 1, axis=0)).any(axis=1)
    return nearest[moves] if moves.any() else nearest[:1]


if __name__ == "__main__":
    file = Path(sys.argv[1])
    limit_share(file, _LARGEST_MEMORY, _MEMORY_PER_BYTE, _SECONDS)
    try:
        runs, curves = content(file)
        message = answer_message((tuple(runs), curves), Outlines)
    except SourceError as error:
        message = error_message(error)
    sys.stdout.buffer.write(message)
