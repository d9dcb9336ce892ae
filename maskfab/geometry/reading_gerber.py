"""Gerber X2 as a layout, read by gerbonara.

gerbonara reads what boards are made of and passes over what it does not know, step-and-repeat and block apertures
among it. So every command is looked at first, and only those are let through whose effect is certain: regions, flashes
and strokes of circles, rectangles, obrounds and regular polygons. Circles become polygons no further than 1 nm from
them, and are counted; arcs drawn by G02 and G03 are refused.
"""

from __future__ import annotations

import math
import re
import warnings
from collections.abc import Iterator
from itertools import chain, groupby, islice
from pathlib import Path
from typing import Any

import numpy as np
from klayout import db
from numpy.typing import NDArray

from maskfab.errors import SourceError
from maskfab.geometry.reading_limits import ROUNDING_KEY, LeftOut, is_empty, note_left_out
from maskfab.geometry.region import DBU_UM, layer_info
from maskfab.model import CLEAR

_LARGEST_NM = 2**31 - 1
_ON_GRID_NM = 1e-5
_FROM_CIRCLE_NM = 1.0
_CLOSED = 1e-9
_AT_A_TIME = 128
_NM_PER_UNIT = {"mm": 1e6, "in": 25.4e6}
_NUMBER = r"\d+(?:\.\d*)?|\.\d+"
_PLAIN = re.compile(
    r"(?:G04.*|G01|G75|G36|G37|M02|(?:G54)?D[1-9]\d+|(?:G01)?(?:X[+-]?\d+)?(?:Y[+-]?\d+)?D0?[123])", re.DOTALL
)
_EXTENDED = re.compile(
    rf"(?:FSLAX[1-6][3-7]Y[1-6][3-7]|MO(?:MM|IN)|LP[DC]|IPPOS|T[FAOD][^%*]*|"
    rf"ADD[1-9]\d+(?:C,(?:{_NUMBER})|[RO],(?:{_NUMBER})X(?:{_NUMBER})|P,(?:{_NUMBER})X\d+(?:X-?(?:{_NUMBER}))?))"
)
_ARCS = re.compile(r"G0?[23](?!\d)|G74")
_COMMAND = re.compile(r"%(?P<extended>[^%]*)%|(?P<plain>[^*%]*)\*")
_START = re.compile(rb"(?:\xef\xbb\xbf)?\s*(?:%|G0?[0-9])")


def read_gerber(path: Path) -> db.Layout:
    """A Gerber file as one cell on the layer CLEAR; dark is clear in the chrome, as the writer's data are.

    Raises:
        SourceError: MF303 damaged, MF304 no Gerber, MF308 without gerbonara, MF311 arcs, MF315 a command whose effect
            is not certain.
    """
    data = path.read_bytes()
    if not _START.match(data):
        raise SourceError("MF304", f"{path.name} is no Gerber file", where=str(path), cure="Give it its true suffix")
    try:
        text = data.decode("utf-8")
    except UnicodeDecodeError as error:
        raise _damaged(path, "it is no text") from error
    _check_commands(path, text)
    return _Drawing(path).layout(_objects(path, text))


def _damaged(path: Path, what: str) -> SourceError:
    return SourceError("MF303", f"{path.name}: {what}", where=str(path), cure="Write or copy it again")


def _check_commands(path: Path, text: str) -> None:
    end = 0
    ended = region = False
    for match in _COMMAND.finditer(text):
        between = text[end : match.start()]
        end = match.end()
        if between.strip():
            raise _damaged(path, f"{between.strip()[:40]!r} is no command")
        plain = match["plain"]
        commands = [plain] if plain is not None else match["extended"].strip().split("*")
        if plain is None and commands.pop().strip():
            raise _damaged(path, f"{match[0][:40]!r} has no end")
        for command in commands:
            _check_command(path, command.strip(), _PLAIN if plain is not None else _EXTENDED, ended)
            ended = ended or command.strip() == "M02"
            if command.strip() in {"G36", "G37"}:
                if region == (command.strip() == "G36"):
                    raise _damaged(path, f"{command.strip()} stands where no region can {'begin' if region else 'end'}")
                region = not region
    if region:
        raise _damaged(path, "a region has no end")
    if text[end:].strip() or not ended:
        raise _damaged(path, "it ends without M02")


def _check_command(path: Path, command: str, known: re.Pattern[str], ended: bool) -> None:
    if ended:
        raise _damaged(path, f"{command[:40]!r} stands behind M02")
    if known.fullmatch(command):
        return
    shown = repr(command[:40])
    if known is _PLAIN and _ARCS.match(command):
        raise SourceError(
            "MF311", f"{path.name} draws arcs ({shown})", where=str(path), cure="Draw them as regions of straight lines"
        )
    raise SourceError(
        "MF315",
        f"{path.name} has the command {shown}, which is not read",
        where=str(path),
        cure="Write plain regions, flashes and strokes, without macros, blocks or repeats",
    )


class _Packed(list[Any]):
    """Takes objects of gerbonara as they are read: a pair of Python's numbers is ten times as large as one of numpy's.

    A region is complete when it is appended, and has no arcs, for files with arcs are refused before.
    """

    def append(self, each: Any) -> None:
        if hasattr(each, "outline"):
            each.outline = np.array(each.outline, dtype=np.float64)
            each.arc_centers = None
        super().append(each)


def _objects(path: Path, text: str) -> list[Any]:
    try:
        from gerbonara.rs274x import GerberFile, GerberParser
    except ImportError as error:
        raise SourceError(
            "MF308", f"{path.name} needs gerbonara", where=str(path), cure="pip install maskfab[gerber]"
        ) from error
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
        raise _damaged(path, said[0][:200] if said else type(error).__name__) from error


class _Drawing:
    """Objects of gerbonara as polygons, in the order in which dark and clear cover each other."""

    def __init__(self, path: Path) -> None:
        self._path = path
        self._rounding = 0.0
        self._curves = 0
        self._empty = 0
        self._repeated = 0

    def layout(self, objects: list[Any]) -> db.Layout:
        layout = db.Layout()
        layout.dbu = DBU_UM
        shapes = layout.create_cell("GERBER").shapes(layout.layer(layer_info(CLEAR)))
        try:
            runs = list(self._runs(objects))
        except (TypeError, ValueError, OverflowError, ZeroDivisionError, AttributeError, KeyError) as error:
            raise _damaged(self._path, f"it holds values that cannot be used ({error})") from error
        if all(dark for dark, _ in runs):
            for _, polygons in runs:
                for polygon in polygons:
                    shapes.insert(polygon)
        else:
            drawn = db.Region()
            for dark, polygons in runs:
                drawn = drawn + db.Region(polygons) if dark else drawn - db.Region(polygons)
            shapes.insert(drawn.merged(True, 1))
        told = "largest rounding to the nanometre grid"
        layout.add_meta_info(db.LayoutMetaInfo(ROUNDING_KEY, self._rounding, told))
        note_left_out(layout, LeftOut(self._repeated, self._empty, self._curves))
        return layout

    def _runs(self, objects: list[Any]) -> Iterator[tuple[bool, list[db.Polygon]]]:
        """Polygons of one polarity after the other."""
        for dark, run in groupby(objects, key=lambda each: bool(each.polarity_dark)):
            polygons = list[db.Polygon]()
            for filled, alike in groupby(run, key=lambda each: hasattr(each, "outline")):
                while part := list(islice(alike, _AT_A_TIME)):
                    polygons += self._regions(part) if filled else chain.from_iterable(map(self._stroked, part))
            yield dark, polygons

    def _regions(self, regions: list[Any]) -> Iterator[db.Polygon]:
        points = np.concatenate([each.outline for each in regions])
        sizes = np.array([len(each.outline) for each in regions])
        last = np.cumsum(sizes) - 1
        first = last - sizes + 1
        with np.errstate(over="ignore", invalid="ignore"):  # numbers too large even for floats are refused below
            open_ones = np.flatnonzero(np.hypot(*(points[first] - points[last]).T) > _CLOSED)
            scales = np.array([_NM_PER_UNIT[str(each.unit)] for each in regions])
            corners = np.delete(points * np.repeat(scales, sizes)[:, None], last, axis=0)
        if open_ones.size:
            ends = [tuple(points[at[open_ones[0]]].tolist()) for at in (first, last)]
            raise SourceError(
                "MF310",
                f"{self._path.name} has a region that is not closed, from {ends[0]} to {ends[1]}",
                where=str(self._path),
                cure="Close it",
            )
        yield from self._outlines(corners, sizes - 1)

    def _stroked(self, each: Any) -> Iterator[db.Polygon]:
        """A flash or a stroke."""
        aperture = getattr(each, "aperture", None)
        if hasattr(each, "x1") and type(aperture).__name__ != "CircleAperture":
            raise SourceError(
                "MF315",
                f"{self._path.name} draws a line with an aperture that is no circle",
                where=str(self._path),
                cure="Draw it as a region",
            )
        for part in each.to_primitives("mm"):
            yield from self._primitive(part)

    def _primitive(self, part: Any) -> Iterator[db.Polygon]:
        kind = type(part).__name__
        if kind == "Circle":
            yield from self._polygon(self._round(part.x * 1e6, part.y * 1e6, part.r * 1e6, 0.0, 2 * math.pi))
        elif kind == "Line":
            x1, y1, x2, y2 = (1e6 * value for value in (part.x1, part.y1, part.x2, part.y2))
            heading, radius = math.atan2(y2 - y1, x2 - x1), 5e5 * part.width
            far = self._round(x2, y2, radius, heading - math.pi / 2, heading + math.pi / 2)
            near = self._round(x1, y1, radius, heading + math.pi / 2, heading + 1.5 * math.pi)
            yield from self._polygon(np.concatenate([far, near]))
        else:
            yield from self._polygon(np.array(part.to_arc_poly().outline, dtype=np.float64) * 1e6)

    def _round(self, x: float, y: float, radius: float, start: float, stop: float) -> NDArray[np.float64]:
        """Points of an arc whose chords stay within a nanometre of it."""
        self._curves += 1
        step = 2 * math.acos(max(0.0, 1 - _FROM_CIRCLE_NM / max(radius, 1.0)))
        angles = np.linspace(start, stop, max(8, math.ceil((stop - start) / step)) + 1)
        return np.stack([x + radius * np.cos(angles), y + radius * np.sin(angles)], axis=1)

    def _polygon(self, points: NDArray[np.float64]) -> Iterator[db.Polygon]:
        return self._outlines(points, np.array([len(points)]))

    def _outlines(self, points: NDArray[np.float64], sizes: NDArray[np.int64]) -> Iterator[db.Polygon]:
        """Polygons of so many points each, in nanometres."""
        if not (np.abs(points) <= _LARGEST_NM).all():  # NaN included
            raise _damaged(self._path, "a coordinate lies beyond 2.1 m")
        nearest = np.rint(points)
        rounding = float(np.abs(points - nearest).max(initial=0.0))
        if rounding > _ON_GRID_NM:
            self._rounding = max(self._rounding, rounding)
        corners, ends = nearest.astype(np.int64), np.cumsum(sizes)
        for size, end in zip(sizes.tolist(), ends.tolist(), strict=True):
            outline = corners[end - size : end].tolist()
            polygon = db.Polygon([db.Point(x, y) for x, y in outline])
            if polygon.num_points() < size:
                self._repeated += sum(
                    one == other for one, other in zip(outline, [outline[-1], *outline], strict=False)
                )
            if is_empty(polygon):
                self._empty += 1
            else:
                yield polygon
