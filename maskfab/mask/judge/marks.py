"""Marks that a job asks for: outlines of figures, and lines of text, which are read back by a table of letters.

Rooms, sizes and rules are those of the plate's template (``export_templates/plates``) and of
``docs/reference/layout.md``.
"""

from __future__ import annotations

import math
import tomllib
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import lru_cache
from itertools import product
from pathlib import Path
from typing import Any, TypeAlias, TypeVar

import numpy as np
from numpy.typing import NDArray

from maskfab.base import resources
from maskfab.base.arrays import Ints, Mask
from maskfab.base.units import NM_PER_UM, parse_length_um
from maskfab.job.sections import JobSpec
from maskfab.mask.judge.dies import AskedDie, Boundary, narrowed, total
from maskfab.mask.judge.sources import Sources

HEIGHT, WIDTH, ADVANCE = 28, 20, 24
"""Sides of a letter, and from letter to letter, in steps."""

# Squares of 4 steps make the picture of a letter.
_SQUARE = 4
_ROWS, _COLUMNS = HEIGHT // _SQUARE, WIDTH // _SQUARE
# A square of one step is covered, blank, or parted by a diagonal: a point in each of its four quarters tells which.
# They are four of nine points on a lattice of thirds.
_THIRDS = 3
_QUARTERS = ((1, 0), (0, 1), (2, 1), (1, 2))


def points(steps: int) -> NDArray[np.float64]:
    """Where to look along so many steps, in steps: a lattice of thirds."""
    return (np.arange(_THIRDS * steps) + 1 / 2) / _THIRDS


def read(seen: Mask) -> str:
    """Text of a line.

    Judged by the middles of the 35 squares of each letter: text that is dropped, mirrored, exchanged or off by more
    than half a square reads otherwise. What is off by less, the :func:`drawing` tells.

    Args:
        seen: whether the :func:`points` of whole letters are clear, bool [84, 72 letters], the lowest row first.

    Returns:
        Capitals, digits and signs, a space where nothing is clear, and ``?`` for what is no letter at all; a question
        mark reads so too.
    """
    # Beside the middle, where no edge can run.
    middles = seen[_THIRDS * _SQUARE // 2 :: _THIRDS * _SQUARE, _THIRDS * _SQUARE // 2 + 1 :: _THIRDS * _SQUARE][::-1]
    cells = (middles[:, start : start + _COLUMNS] for start in range(0, middles.shape[1], ADVANCE // _SQUARE))
    meanings = {picture.tobytes(): letter for letter, picture in _pictures().items()}
    return "".join(meanings.get(cell.tobytes(), "?") for cell in cells)


def drawing(text: str) -> Mask:
    """The :func:`points` of a line of text that should be clear; KeyError for a letter that the plate has not."""
    return np.concatenate([_figure(letter) for letter in text.upper()], axis=1)


def area_steps2(mask: Mask) -> float:
    """Area in steps squared, exactly where edges run along steps or their diagonals."""
    return float(sum(mask[v::_THIRDS, u::_THIRDS].sum() for u, v in _QUARTERS)) / len(_QUARTERS)


@lru_cache(1)
def _pictures() -> dict[str, Mask]:
    """Letters of letters.txt as bool [7, 5], the top row first; small ones are drawn as capitals."""
    pictures = {" ": np.zeros((_ROWS, _COLUMNS), dtype=np.bool_)}
    for band in Path(__file__).with_name("letters.txt").read_text("ascii").strip("\n").split("\n\n"):
        names, *rows = (line.split() for line in band.splitlines())
        for place, name in enumerate(names):
            pictures[name] = np.array([[square == "#" for square in row[place]] for row in rows])
    return pictures


@lru_cache(128)
def _figure(letter: str) -> Mask:
    """Whether the points of a lattice of thirds in a letter's cell are clear, bool [84, 72], the lowest row first.

    Strokes run from middle to middle of squares that share a side, and of squares that share a corner where both
    squares beside that corner are blank. They are 4 steps wide, at 45 degrees 3 sqrt(2). A slanting stroke that meets
    none ends at a right angle, half a sqrt(2) beyond the middle; where it meets others is an octagon, and elsewhere the
    square. A blank square beside a slanting stroke whose other two neighbours are not blank, nor the square between
    one of these and the stroke's end, is covered for one step along that end.
    """
    picture = np.pad(_pictures()[letter][::-1], 1)
    figure = np.zeros((_THIRDS * HEIGHT, _THIRDS * ADVANCE), dtype=np.bool_)
    x, y = points(ADVANCE)[None, :], points(HEIGHT)[:, None]
    for row, column in np.argwhere(picture):
        u, v = x - (column - 1 / 2) * _SQUARE, y - (row - 1 / 2) * _SQUARE
        strokes = {True: 0, False: 0}
        for right, up in product((-1, 0, 1), repeat=2):
            slanting = bool(right and up)
            beside = slanting and (picture[row, column + right] or picture[row + up, column])
            if (right or up) and picture[row + up, column + right] and not beside:
                strokes[slanting] += 1
                low, high, near = (-1, 9, 3) if slanting else (0, 4, 2)
                along, across = right * u + up * v, np.abs(up * u - right * v)
                figure |= (low <= along) & (along <= high) & (across <= near)
                # Towards this end: the square above or below it, then the one beside it.
                if slanting and picture[row + up, column - right] and picture[row, column - right]:
                    figure |= (np.abs(u) <= 2) & (np.abs(up * v - 5 / 2) <= 1 / 2)
                if slanting and picture[row - up, column + right] and picture[row - up, column]:
                    figure |= (np.abs(v) <= 2) & (np.abs(right * u - 5 / 2) <= 1 / 2)
        pen = (np.abs(u) <= 2) & (np.abs(v) <= 2)
        if strokes[True]:
            pen &= (np.abs(u + v) <= 3) & (np.abs(u - v) <= 3)
        if strokes[True] != 1 or strokes[False]:
            figure |= pen
    return figure


def symbol(text: str) -> Mask:
    """The smallest square data matrix of a text and its quiet zone, bool [n, n], True where light, lowest row first."""
    import zxingcpp

    drawn = zxingcpp.create_barcode(text, zxingcpp.BarcodeFormat.DataMatrix, force_square=True)
    return np.array(drawn.to_image(scale=1, add_quiet_zones=True))[::-1] > 127


def read_symbol(light: Mask) -> str:
    """Text of a data matrix as a camera reads it, which corrects errors; nothing if it cannot be read."""
    import zxingcpp

    # A few pixels a module and some room around it.
    picture = np.where(light[::-1], 255, 0).astype(np.uint8).repeat(8, axis=0).repeat(8, axis=1)
    found = zxingcpp.read_barcodes(np.pad(picture, 32, constant_values=255))
    return found[0].text if len(found) == 1 else ""


Place: TypeAlias = tuple[int, int]
Coordinate = TypeVar("Coordinate", int, Ints)

_LABEL = 420_000
_LABEL_GAP = 180_000
_CAPTION = 150_000
_BETWEEN = 300_000
_LARGEST_FEATURE = 50_000
_MAP_LETTERS = 60_000, 250_000


@dataclass(frozen=True, eq=False)
class Mark:
    """A figure of the plate.

    Attributes:
        name: as a cell of the file.
        boxes: int64 [n, 4] that cover it, which may overlap.
        polygons: further outlines, apart from each other and from the boxes.
        sized: whether a bias of the data moves its edges.
    """

    name: str
    boxes: Ints
    polygons: tuple[tuple[Place, ...], ...] = ()
    sized: bool = True

    @property
    def box(self) -> Ints:
        points = np.concatenate(
            [self.boxes.reshape(-1, 2), *(np.array(polygon).reshape(-1, 2) for polygon in self.polygons)]
        )
        return np.concatenate([points.min(axis=0), points.max(axis=0)])


@dataclass(frozen=True)
class Line:
    """A line of text.

    Attributes:
        name: of the mark that it belongs to.
        left: where the cell of the first letter begins, nanometres.
        base: on which letters stand.
        step: a 28th of their height.
    """

    name: str
    text: str
    left: int
    base: int
    step: int


@dataclass(frozen=True)
class Code:
    """A data matrix: its text, the middle of the symbol, and the side of a module."""

    name: str
    text: str
    centre: Place
    module: int


def asked_marks(
    spec: JobSpec, dies: Sequence[AskedDie], held: Sources, version: str
) -> tuple[tuple[Mark, ...], tuple[Line, ...], tuple[Code, ...], int, int]:
    """Figures, lines and codes of a job before the plate is mirrored; sides of writable area and blank, nanometres."""
    plate, heading = spec.plate, spec.job
    assert plate is not None
    assert heading is not None
    feature = min(_LARGEST_FEATURE, *(die.narrowest for die in dies))
    drawn: list[Mark | Line | Code] = []
    tone = "dark" if held.dark else "clear"
    maker = f"maskfab {version} | job {held.digest[:16]}" + (f" | serial {plate.serial}" if plate.serial else "")
    if plate.template is None:
        assert plate.writable is not None
        assert plate.blank is not None
        side, whole = (round(length * NM_PER_UM) for length in (plate.writable, plate.blank))
        drawn += _plain(side, feature, heading.title, f"{maker} | digitized data = {tone}")
    else:
        facts = tomllib.loads(resources.path(f"export_templates/plates/{plate.template}.toml").read_text("utf-8"))
        side, whole = _nm(facts["writable"]), _nm(facts["blank"])
        reading = f"digitized data = {tone} | right reading, chrome {'down' if held.mirror else 'up'}"
        blank = [_nm(facts[key]) / 1e6 for key in ("blank", "blank", "thickness")]
        size = "{:g} x {:g} x {:g} mm".format(*blank)
        titles, code = (heading.title, maker, f"{reading} | {size}"), f"maskfab:{version}:{held.digest}"
        across = whole, round(plate.die_pitch * NM_PER_UM)
        for mark in facts.get("mark", ()):
            drawn += _of_template(mark, feature, titles, code, dies, across)
    drawn += map(_label, dies)
    return (
        tuple(part for part in drawn if isinstance(part, Mark)),
        tuple(part for part in drawn if isinstance(part, Line) and part.text),
        tuple(part for part in drawn if isinstance(part, Code)),
        side,
        whole,
    )


def _plain(side: int, feature: int, title: str, line: str) -> Iterator[Mark | Line]:
    """The marks of a plate without a template."""
    corner = side // 2 - 2_000_000
    room = side - 8_000_000
    yield _centred("TITLE", title, (0, corner - 750_000), 1_500_000, room)
    yield _centred("TITLE", line, (0, corner - 750_000 - 840_000), 420_000, room)
    for name, x, y in (("SW", -1, -1), ("SE", 1, -1), ("NW", -1, 1), ("NE", 1, 1)):
        yield Mark(f"FIDUCIAL_{name}", _cross((x * corner, y * corner), 1_000_000, 50_000))
    yield _letter_f("PARITY", (4_000_000 - corner, -corner), 2_000_000)
    yield from _bars("CD", (0, -corner), feature, (1, 2, 5), 500_000)


def _of_template(
    mark: Mapping[str, Any],
    feature: int,
    titles: Sequence[str],
    code: str,
    dies: Sequence[AskedDie],
    across: tuple[int, int],
) -> Iterator[Mark | Line | Code]:
    """Parts of one [[mark]] of a template; ``across`` are blank and distance of dies."""
    name, (x, y) = mark["name"], map(_nm, mark["at"])
    width, height = map(_nm, mark["room"])
    high, room = y - height // 2 + height, width * 999 // 1000
    lengths = {key: _nm(mark[key]) for key in ("length", "line", "height", "small", "module") if key in mark}
    match mark["kind"]:
        case "fiducial":
            yield Mark(name, _cross((x, y), lengths["length"], lengths["line"]))
        case "alignment":
            yield Mark(name, _broad_cross((x, y), lengths["length"], lengths["line"]))
        case "parity":
            tall = lengths["height"]
            yield _letter_f(name, (x - tall * 3 // 5 // 2, y - tall // 2), tall)
        case "title":
            tall, small = lengths["height"], lengths["small"]
            yield _centred(name, titles[0], (x, high - tall), tall, room)
            for number, text in enumerate(titles[1:], 1):
                yield _centred(name, text, (x, high - tall - 2 * small * number), small, room)
        case "data_matrix":
            yield Code(name, code, (x, y), lengths["module"])
        case "die_map":
            yield from _map(name, (x, y), min(width, height), lengths["line"], dies, across)
        case kind:
            yield from _test_figures(kind, mark, (x, y), feature)
            size = f"{feature / NM_PER_UM:g} um"
            multiples = ", ".join(f"{multiple:g}" for multiple in mark.get("multiples", ()))
            text = f"{name}  {size} {'inside' if kind == 'siemens_star' else f'x {multiples}'}"
            yield _centred(f"{name}_TEXT", text, (x, y - height // 2), _CAPTION, room)


def _test_figures(kind: str, mark: Mapping[str, Any], centre: Place, feature: int) -> Iterator[Mark]:
    """Figures of multiples of the smallest feature, by which a writer's resolution is seen."""
    name, multiples = mark["name"], mark.get("multiples", ())
    match kind:
        case "cd_bars":
            yield from _bars(name, centre, feature, multiples, _nm(mark["length"]))
        case "line_space":
            yield from _gratings(name, centre, feature, multiples, mark.get("lines", 5), _nm(mark["length"]))
        case "siemens_star":
            yield _star(name, centre, feature, _nm(mark["radius"]), mark.get("spokes", 36))
        case "checkerboard":
            yield from _boards(name, centre, feature, multiples, mark.get("squares", 10))
        case "corners":
            yield from _corners(name, centre, feature, multiples)


def _nm(length: str) -> int:
    sign = -1 if length.startswith("-") else 1
    return sign * round(parse_length_um(length.removeprefix("-"), zero_allowed=True) * NM_PER_UM)


def _boxes(*boxes: tuple[int, int, int, int]) -> Ints:
    return np.array(boxes, dtype=np.int64).reshape(-1, 4)


def _round(centre: Place, width: int, height: int) -> tuple[int, int, int, int]:
    """A box round a place; of an odd side the longer part lies to the right, or above."""
    left, low = centre[0] - width // 2, centre[1] - height // 2
    return left, low, left + width, low + height


def _cross(centre: Place, length: int, line: int) -> Ints:
    long, thin = length // 2 * 2, line // 2 * 2
    return _boxes(_round(centre, long, thin), _round(centre, thin, long))


def _broad_cross(centre: Place, length: int, line: int) -> Ints:
    """A cross whose arms are three times as broad in their outer half."""
    x, y = centre
    tip, middle, thin = length // 2, length // 4, line // 2
    broad = 3 * thin
    ends = [
        (x + middle, y - broad, x + tip, y + broad),
        (x - tip, y - broad, x - middle, y + broad),
        (x - broad, y + middle, x + broad, y + tip),
        (x - broad, y - tip, x + broad, y - middle),
    ]
    return np.concatenate([_cross(centre, 2 * tip, 2 * thin), _boxes(*ends)])


def _letter_f(name: str, corner: Place, height: int) -> Mark:
    """The letter F, its strokes a fifth of its height broad: a stem, a long upper arm, and a shorter one below."""
    (x, y), unit = corner, height // 5
    arms = ((0, 0, 1, 5), (0, 4, 3, 5), (0, 2, 2, 3))
    return Mark(name, np.array([x, y, x, y]) + unit * _boxes(*arms))


def _bars(name: str, centre: Place, feature: int, multiples: Sequence[int], length: int) -> Iterator[Mark]:
    """A bar for each multiple whose width lies along x, and one whose width lies along y, two lengths apart."""
    for number, multiple in enumerate(multiples):
        middle = centre[0] + 2 * length * (2 * number + 1 - len(multiples))
        width = feature * multiple
        for axis, x, size in (("X", middle - length, (width, length)), ("Y", middle + length, (length, width))):
            yield Mark(f"{name}_{axis}_{_times(multiple)}", _boxes(_round((x, centre[1]), *size)))


def _row(
    name: str, centre: int, feature: int, multiples: Sequence[float], side: Callable[[int], int]
) -> Iterator[tuple[str, int, int]]:
    """Test figures from left to right: name, width and left end; ``side`` tells how broad one of a width is."""
    widths = [round(feature * multiple) for multiple in multiples]
    left = centre - (sum(map(side, widths)) + _BETWEEN * (len(widths) - 1)) // 2
    for multiple, width in zip(multiples, widths, strict=True):
        yield f"{name}_{_times(multiple)}", width, left
        left += side(width) + _BETWEEN


def _gratings(
    name: str, centre: Place, feature: int, multiples: Sequence[float], lines: int, length: int
) -> Iterator[Mark]:
    """Upright lines over lying ones for each multiple, from left to right, as wide as their spaces."""

    def side(width: int) -> int:
        return max((2 * lines - 1) * width, length)

    rise = (side(round(feature * max(multiples))) + _BETWEEN) // 2
    for (_, width, left), multiple in zip(_row(name, centre[0], feature, multiples, side), multiples, strict=True):
        x = left + side(width) // 2
        starts = [math.floor(-(2 * lines - 1) * width / 2) + 2 * number * width for number in range(lines)]
        low, high = -(side(width) // 2), side(width) - side(width) // 2
        upright = ((x + start, low, x + start + width, high) for start in starts)
        yield Mark(f"{name}_V_{_times(multiple)}", _boxes(*upright) + np.array([0, centre[1] + rise] * 2))
        lying = ((low, start, high, start + width) for start in starts)
        yield Mark(f"{name}_H_{_times(multiple)}", _boxes(*lying) + np.array([x, centre[1] - rise] * 2))


def _star(name: str, centre: Place, feature: int, radius: int, spokes: int) -> Mark:
    """Spokes as wide as the spaces between them, from where they are one feature wide; the first lies along x."""
    inner = feature / (2 * math.sin(math.pi / (2 * spokes)))
    polygons = []
    for number in range(spokes):
        low, high = (2 * math.pi / spokes * (number + side / 4) for side in (-1, 1))
        corners = ((inner, low), (radius, low), (radius, high), (inner, high))
        polygons.append(
            tuple(
                (centre[0] + round(round(r * math.cos(a), 6)), centre[1] + round(round(r * math.sin(a), 6)))
                for r, a in corners
            )
        )
    return Mark(name, _boxes(), tuple(polygons), sized=False)


def _boards(name: str, centre: Place, feature: int, multiples: Sequence[float], squares: int) -> Iterator[Mark]:
    """Boards of squares, of which the lower left one is clear and so is every other one."""
    clear = [(i, j) for j in range(squares) for i in range(squares) if (i + j) % 2 == 0]
    for board, side, left in _row(name, centre[0], feature, multiples, lambda side: squares * side):
        low = centre[1] - squares * side // 2
        boxes = ((left + i * side, low + j * side, left + i * side + side, low + j * side + side) for i, j in clear)
        yield Mark(board, _boxes(*boxes))


def _corners(name: str, centre: Place, feature: int, multiples: Sequence[float]) -> Iterator[Mark]:
    """Letters L on one base line, their arms six widths long."""
    low = centre[1] - 6 * round(feature * max(multiples)) // 2
    for letter, width, left in _row(name, centre[0], feature, multiples, lambda width: 6 * width):
        long = 6 * width
        yield Mark(letter, _boxes((left, low, left + long, low + width), (left, low, left + width, low + long)))


def _times(multiple: float) -> str:
    return f"{multiple:g}X".replace(".", "_")


def _label(die: AskedDie) -> Line:
    below = die.centre[1] - die.slot // 2 - _LABEL_GAP - _LABEL
    return _centred(f"LABEL_{die.name}", f"{die.name}  {die.label}", (die.centre[0], below), _LABEL, die.slot)


def _centred(name: str, text: str, foot: Place, height: int, room: int) -> Line:
    """Text centred over a place, smaller where it would be wider than its room."""
    step = max(1, round(height / HEIGHT))
    if _width(text) * step > room:
        step = max(1, round(height * room // (_width(text) * step) / HEIGHT))
    return Line(name, text.rstrip(), foot[0] - _width(text) * step // 2, foot[1], step)


def _width(text: str) -> int:
    """Steps from the first letter's cell to the end of the last letter."""
    return len(text.rstrip()) * ADVANCE - (ADVANCE - WIDTH)


def _map(
    name: str, centre: Place, side: int, line: int, dies: Sequence[AskedDie], across: tuple[int, int]
) -> Iterator[Mark | Line]:
    """Frames of the blank and of every slot, to scale, with names in or under the slots, whichever can be larger."""
    blank, pitch = across[0], across[1] * side // across[0]
    slot = dies[0].slot * side // blank
    offsets = [(die.centre[0] * side // blank, die.centre[1] * side // blank) for die in dies]
    places = [(centre[0] + x, centre[1] + y) for x, y in offsets]
    frames = [_frame(centre, side, line), *(_frame(place, slot, line) for place in places)]
    yield Mark(name, np.concatenate(frames), sized=False)
    inner = side // 2 - 2 * line
    wide = min(0.9 * pitch, *(2 * (inner - abs(x)) for x, _ in offsets))
    high = min(0.6 * (pitch - slot), *((inner + y - slot // 2) / 1.5 for _, y in offsets))
    for words in ([die.name for die in dies], [str(number + 1) for number in range(len(dies))]):
        widest = max(map(_width, words))

        def tallest(wide: float, high: float, widest: int = widest) -> int:
            return int(min(high, wide * HEIGHT / widest, _MAP_LETTERS[1]))

        inside, under = tallest(slot - 4 * line, slot - 4 * line), tallest(wide, high)
        height, drop = (inside, 0) if inside >= under else (under, slot // 2 + under)
        if height >= _MAP_LETTERS[0]:
            for word, (x, y) in zip(words, places, strict=True):
                yield _centred(name, word, (x, y - drop - height // 2), height, 2**40)
            return


def _frame(centre: Place, side: int, line: int) -> Ints:
    """Two brackets that leave two widths of their line open above and below; a square where that were no frame."""
    x0, y0, x1, y1 = _round(centre, side, side)
    if side < 8 * line:
        return _boxes((x0, y0, x1, y1))
    tip = centre[0] - line
    left = [(x0, y0, x0 + line, y1), (x0, y0, tip, y0 + line), (x0, y1 - line, tip, y1)]
    right = [(x0 + x1 - b, low, x0 + x1 - a, high) for a, low, b, high in left]
    return _boxes(*left, *right)


def corner_squares(extent_mm: tuple[float, float], side_um: float) -> Iterator[Mark]:
    """Squares in the corners of a drawing that must span an extent, as some houses ask."""
    (x, y), side = (round(side_mm * 1e6) // 2 for side_mm in extent_mm), round(side_um * NM_PER_UM)
    for name, left, low in (("SW", -x, -y), ("SE", x - side, -y), ("NW", -x, y - side), ("NE", x - side, y - side)):
        yield Mark(f"CORNER_{name}", _boxes((left, low, left + side, low + side)), sized=False)


def mirrored(mark: Mark) -> Mark:
    """The mark with left and right exchanged about the plate's middle."""
    boxes = mark.boxes * np.array([-1, 1, -1, 1])
    polygons = tuple(tuple((-x, y) for x, y in polygon) for polygon in mark.polygons)
    return replace(mark, boxes=boxes[:, [2, 1, 0, 3]], polygons=polygons)


def on_grid(mark: Mark, grid: int) -> Mark:
    """The mark with every corner on the nearest line of a grid, the upper of two that are equally near."""
    polygons = tuple(tuple((nearest(x, grid), nearest(y, grid)) for x, y in polygon) for polygon in mark.polygons)
    return replace(mark, boxes=nearest(mark.boxes, grid), polygons=polygons)


def nearest(value: Coordinate, grid: int) -> Coordinate:
    """The line of a grid that is nearest, the upper of two; of one coordinate or of many."""
    return (value + grid // 2) // grid * grid


def boundary(mark: Mark, bias: int) -> Boundary:
    """Clear parts of a mark in data of which edges have moved by half a bias."""
    x, y = (np.unique(mark.boxes[:, [k, k + 2]]) for k in (0, 1))
    clear = np.zeros((max(len(y) - 1, 0), max(len(x) - 1, 0)), dtype=np.bool_)
    for x0, y0, x1, y1 in mark.boxes:
        clear[np.searchsorted(y, y0) : np.searchsorted(y, y1), np.searchsorted(x, x0) : np.searchsorted(x, x1)] = True
    if bias and mark.sized and clear.size:
        x, y, clear = narrowed(x, y, clear, bias)
    boxes = Boundary.of_raster(x, y, clear) if clear.size else Boundary.none()
    return total([boxes, Boundary.of_polygons(mark.polygons)])
