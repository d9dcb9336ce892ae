"""Layouts of displays drawn by rule: an opening and the emitters round it, in one square cell.

Lengths are whole dots. What a pixel alone cannot hold in a square is drawn as the smallest square of whole pixels: two
by two for a diamond lattice, whose pixels share red and blue, and for a delta, whose rows are shifted by half a pixel
of sub-pixels. Functions are pure and return the mask, bool [dots, dots], and the labels, int8 [n, n], n a multiple of
dots, both with row 0 lowest and as in :class:`~maskfab.base.model.Opening`.
"""

from __future__ import annotations

import json
import math
import re
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path
from types import MappingProxyType

import numpy as np

from maskfab.base.arrays import Floats, Labels, Mask
from maskfab.base.errors import JobError
from maskfab.base.model import refined
from maskfab.mask.opening_masks import MAX_DOTS, away, check_range

RED, GREEN, BLUE = 1, 2, 3
_FINER = 2  # emitter cells along a dot of the round layout


def band(
    dots: int,
    *,
    clear_width: int,
    clear_height: int,
    emitter_width: int,
    emitter_height: int,
    colour_gap: int,
    to_opening: int,
) -> tuple[Mask, Labels]:
    """A rectangular opening, and above it red, green and blue rectangles side by side.

    Both are centred from left to right; where parities differ, half a dot left of the centre.

    Args:
        to_opening: between the emitters and the openings below and above them.

    Raises:
        JobError: MF104 for a length below 1, MF117 if they do not fit the cell.
    """
    _check(dots, **{k: v for k, v in locals().items() if k != "dots"})
    row = 3 * emitter_width + 2 * colour_gap
    _check_room("the opening's width", clear_width, dots)
    _check_room("three emitters and the gaps right of them", row + colour_gap, dots)
    _check_room("opening, emitters and two gaps to the opening", clear_height + emitter_height + 2 * to_opening, dots)
    mask, labels = _empty(dots)
    left = (dots - clear_width) // 2
    mask[to_opening : to_opening + clear_height, left : left + clear_width] = True
    foot = clear_height + 2 * to_opening
    for index, label in enumerate((RED, GREEN, BLUE)):
        left = (dots - row) // 2 + index * (emitter_width + colour_gap)
        labels[foot : foot + emitter_height, left : left + emitter_width] = label
    return mask, labels


def diamond(
    dots: int, *, clear_reach: int, red_reach: int, green_reach: int, blue_reach: int, to_opening: int
) -> tuple[Mask, Labels]:
    """Two by two pixels of a diamond lattice: two red and two blue rhombi, four green discs, eight openings.

    Red lies at the corner and in the middle, blue at the middle of the sides, green between; openings lie between two
    rhombi and two discs. The cell has all symmetries of a square, so every tiling of it is the same lattice.

    Args:
        dots: along the cell's side, even.
        clear_reach: from the middle of an opening, a square, to its sides; what is too near to an emitter stays closed.
        red_reach, blue_reach: from the middle of a rhombus to its tips.
        green_reach: radius of a disc, half a dot less, for a disc of whole dots has tips of one dot.
        to_opening: between an emitter and an opening.

    Raises:
        JobError: MF104 for a length below 1 or odd dots, MF117 if emitters or openings meet.
    """
    _check(dots, **{k: v for k, v in locals().items() if k != "dots"})
    _check_multiple(dots, 2)
    _check_room("twice the opening's reach, and a dot", 4 * clear_reach + 2, dots)
    labels = _diamond_emitters(dots, red_reach, green_reach, blue_reach)
    quarters, halves = (
        np.minimum(away(dots, one), away(dots, other)) < clear_reach for one, other in ((0.25, 0.75), (0, 0.5))
    )
    mask = (quarters[None, :] & halves[:, None]) | (halves[None, :] & quarters[:, None])
    near = _spread(labels, to_opening, "wrap")
    mask &= near == 0
    if not mask.any():
        raise _narrow("nothing is left of the openings", "clear_reach")
    return mask, labels


def lined_diamond(
    dots: int,
    *,
    red_reach: int,
    green_reach: int,
    blue_reach: int,
    to_opening: int,
    line_width: int,
    first_data: int,
    second_data: int,
    power: int,
    scan: int,
    emission: int,
) -> tuple[Mask, Labels]:
    """Two by two pixels of a diamond lattice as :func:`diamond`, clear wherever no emitter and no line is.

    Three lines go up through every pixel, two across it, all opaque. The cell begins where a pixel's first data line
    crosses its scan line, so no emitter lies where a turned cell has one, and tilings differ.

    Args:
        dots: along the cell's side, even.
        red_reach, green_reach, blue_reach, to_opening: as of :func:`diamond`.
        first_data, second_data, power: left side of the lines that go up, from the middle of a rhombus.
        scan, emission: lower side of those that go across.

    Raises:
        JobError: MF104 for a length below 1 or odd dots, MF117 if emitters or lines meet, or nothing is clear.
    """
    _check(dots, **{k: v for k, v in locals().items() if k != "dots"})
    _check_multiple(dots, 2)
    labels = _diamond_emitters(dots, red_reach, green_reach, blue_reach)
    mask = _spread(labels, to_opening, "wrap") == 0
    pixel = dots // 2
    for starts, across in (((first_data, second_data, power), False), ((scan, emission), True)):
        places = np.sort(np.array(starts) % pixel)
        nearest = int(np.diff(places, append=places[0] + pixel).min())
        _check_room("a line and a dot beside it, between two lines", line_width + 1, nearest)
        lines = (np.array(starts)[:, None] + np.arange(line_width)).ravel() % pixel
        (mask if across else mask.T)[np.r_[lines, lines + pixel]] = False
    if not mask.any():
        raise _narrow("nothing is left between the lines", "line_width")
    return np.roll(mask, (-scan, -first_data), (0, 1)), np.roll(labels, (-scan, -first_data), (0, 1))


def _diamond_emitters(dots: int, red_reach: int, green_reach: int, blue_reach: int) -> Labels:
    """Labels of rhombi and discs, of which none may touch another."""
    _check_room("the reaches of red and blue, and a dot", 2 * (red_reach + blue_reach) + 2, dots)
    # Along the diagonal, a disc reaches sqrt(2) times its radius towards a rhombus.
    towards = math.ceil((green_reach + 0.5) * math.sqrt(2))
    _check_room("the reaches of blue and green, and a dot", 2 * (max(red_reach, blue_reach) + towards) + 2, dots)
    _check_room("twice a disc and a dot", 4 * green_reach + 2, dots)
    _, labels = _empty(dots)
    for label, reach, starts in ((RED, red_reach, (0, 0.5)), (BLUE, blue_reach, (0.5, 0))):
        for start in starts:
            other = start if label == RED else 0.5 - start
            labels[away(dots, start)[None, :] + away(dots, other)[:, None] <= reach] = label
    for x in (0.25, 0.75):
        for y in (0.25, 0.75):
            labels[away(dots, x)[None, :] ** 2 + away(dots, y)[:, None] ** 2 < (green_reach + 0.5) ** 2] = GREEN
    return labels


def delta(
    dots: int, *, clear_width: int, clear_height: int, emitter_width: int, emitter_height: int
) -> tuple[Mask, Labels]:
    """Two by two pixels of a delta: rows of red, green and blue, every other one shifted by one and a half of them.

    A pixel is three neighbouring sub-pixels in two rows. With sub-pixels 2/3 of a pixel apart and rows 1/2 of one,
    pixels are square, the pattern repeats every two pixels along and one pixel up, and two by two of them are a square
    cell of four rows of three. An opening lies between every two sub-pixels of a row. A half turn maps the openings on
    themselves.

    Args:
        dots: along the cell's side, a multiple of 12.

    Raises:
        JobError: MF104 for a length below 1 or other dots, MF117 if an emitter and an opening meet.
    """
    _check(dots, **{k: v for k, v in locals().items() if k != "dots"})
    _check_multiple(dots, 12)
    across, rise = dots // 3, dots // 4
    _check_room("an emitter's and an opening's width", emitter_width + clear_width, across)
    _check_room("an emitter's width and one dot", 2 * (emitter_width + 1), across)
    _check_room("the larger height and one dot", max(emitter_height, clear_height) + 1, rise)
    mask, labels = _empty(dots)
    for row in range(4):
        for index, label in enumerate((RED, GREEN, BLUE)):
            # A quarter of a sub-pixel's room from the side, no emitter of either kind of row is cut by it.
            twice = across // 2 + 2 * index * across + 3 * across * (row % 2)
            for drawn, value, middle, width, height in (
                (labels, label, twice, emitter_width, emitter_height),
                (mask, True, twice + across, clear_width, clear_height),
            ):
                left, foot = (middle - width) // 2 % dots, row * rise + (rise - height) // 2
                drawn[foot : foot + height, np.arange(left, left + width) % dots] = value
    return mask, labels


def circular(dots: int, *, diameter: int, colour_gap: int, to_opening: int, border: int) -> tuple[Mask, Labels]:
    """A round opening in a ring of three emitters that are together as large as it: 1 to 1 within 1 %.

    The ring is cut at 30, 150 and 270 degrees, red is on top, green and blue follow counter-clockwise. It grows from
    its inner rim, by whole circles of cells, until the areas are nearest. Labels have two cells along a dot.

    Args:
        colour_gap: between colours, along x or y.
        to_opening: from the opening to the ring, along x or y.
        border: from the ring to the cell's sides.

    Raises:
        JobError: MF104 for a length below 1, MF117 if the ring is too narrow for as much area.
    """
    _check(dots, **{k: v for k, v in locals().items() if k != "dots"})
    mask = np.hypot(*_centred(dots)) < diameter / 2  # without the lone dots that a circle's tips may touch
    x, y = (place / _FINER for place in _centred(dots * _FINER))
    radius = np.hypot(x, y)
    clear = refined(mask, _FINER)
    near = _spread(clear, _FINER * to_opening, "constant")
    free = ~near & (radius <= dots / 2 - border)
    labels = np.zeros(radius.shape, dtype=np.int8)
    share = int(clear.sum()) / 3
    angle = np.degrees(np.arctan2(y, x))
    for label, middle in ((RED, 90.0), (GREEN, 210.0), (BLUE, 330.0)):
        sector = free & (np.abs((angle - middle + 180) % 360 - 180) < 60)
        for cut in np.radians((middle - 60, middle + 60)):
            # Chebyshev distance across a line is the Euclidean one over |cos| + |sin| of its normal; a cell's middle
            # is half a cell from its side.
            wide = (colour_gap + 1 / _FINER) * (abs(np.cos(cut)) + abs(np.sin(cut))) / 2
            sector &= np.abs(-x * np.sin(cut) + y * np.cos(cut)).round(9) >= wide.round(9)
        shells, cells = np.unique(radius[sector].round(9), return_counts=True)
        if cells.sum() < share:
            raise _narrow(
                f"a third of the ring has room for {cells.sum()} cells, and a third of the opening has {share:g}",
                "diameter",
            )
        outermost = shells[np.argmin(np.abs(np.cumsum(cells) - share))]
        labels[sector & (radius.round(9) <= outermost)] = label
    return np.asarray(mask), labels


Layout = Callable[..., tuple[Mask, Labels]]


@dataclass(frozen=True)
class Display:
    """A layout with the lengths of a display, and where they come from.

    Attributes:
        pitch: of the cell, as a user would write it.
        lengths: the layout's other arguments, in dots.
        source: who published figures.
        what: these figures.
        judgement: what nobody published.
        multiple: number that divides its dots.
        pixels_across: pixels of the display along the cell's side.
    """

    layout: Layout
    dots: int
    pitch: str
    lengths: Mapping[str, int]
    source: str
    what: str
    judgement: str
    multiple: int = 1
    pixels_across: int = 1

    def draw(self, dots: int | None = None, changed: Mapping[str, int] = MappingProxyType({})) -> tuple[Mask, Labels]:
        """The mask and the labels, with other dots or lengths where given; with other dots all lengths in proportion.

        Raises:
            JobError: MF102 for a length that the layout has not, and what the layout raises.
        """
        dots = self.dots if dots is None else dots
        share = dots / self.dots
        nearest = {name: max(1, round(length * share)) for name, length in self.lengths.items()}
        for name in changed:
            if name not in nearest:
                own = ", ".join(f"{key}={length}" for key, length in nearest.items())
                cure = f"It has, with {dots} dots along the cell, {own}"
                raise JobError("MF102", f"this display has no length {name!r}", where=name, cure=cure)
        try:
            return self.layout(dots, **{**nearest, **changed})
        except JobError as narrow:
            if narrow.code != "MF117" or dots == self.dots:
                raise
        # Rounded down, what has room among its own dots has it among others.
        least = {name: max(1, math.floor(length * share)) for name, length in self.lengths.items()}
        return self.layout(dots, **{**least, **changed})


_LAYOUTS: Mapping[str, Layout] = {made.__name__: made for made in (band, diamond, lined_diamond, delta, circular)}
_STATED = json.loads(Path(__file__).with_name("displays.json").read_text(encoding="utf-8"))
DISPLAYS: Mapping[str, Display] = MappingProxyType(
    {name: Display(**{**stated, "layout": _LAYOUTS[stated["layout"]]}) for name, stated in _STATED.items()}
)
"""The displays that come with the program, by the word that draws them."""


def read_lengths(pairs: Iterable[str]) -> dict[str, int]:
    """Lengths in dots by name, from pairs such as ``clear_width=38``.

    Raises:
        JobError: MF105 for a pair of another form, MF102 for a name given twice.
    """
    lengths: dict[str, int] = {}
    for pair in pairs:
        name, _, number = (part.strip() for part in pair.partition("="))
        if not (number.isascii() and number.isdigit()):
            whole = re.fullmatch(r"(\d{1,6})\.\d+", number)
            near = sorted({max(1, int(whole[1])), int(whole[1]) + 1}) if whole else [5]
            cure = f"Write {' or '.join(f'{name}={dots}' for dots in near)}: dots are whole"
            raise JobError("MF105", f"{pair!r} is not a length in dots", where=name, cure=cure)
        if name in lengths:
            raise JobError("MF102", f"{name} is given twice", where=name, cure="Give each length once")
        lengths[name] = int(number)
    return lengths


def source_facts(display: Display, *, changed: bool) -> dict[str, str]:
    """Where a display's lengths come from; nobody published those of a changed one."""
    if changed:
        return {"judgement": "lengths other than the display's own"}
    return {"source": display.source, "what": display.what, "judgement": display.judgement}


def _empty(dots: int) -> tuple[Mask, Labels]:
    return np.zeros((dots, dots), dtype=np.bool_), np.zeros((dots, dots), dtype=np.int8)


def _centred(cells: int) -> tuple[Floats, Floats]:
    middle = np.arange(cells) + 0.5 - cells / 2
    x, y = np.meshgrid(middle, middle)
    return x, y


def _check(dots: int, **lengths: int) -> None:
    for name, value in {"dots": dots, **lengths}.items():
        check_range(name, value, 1, MAX_DOTS)


def _check_multiple(dots: int, of: int) -> None:
    if dots % of:
        near = [str(whole) for whole in (dots - dots % of, dots - dots % of + of) if whole]
        what = f"dots = {dots} is not a multiple of {of}, as this display's must be"
        raise JobError("MF104", what, where="dots", cure=f"Use {' or '.join(near)} dots")


def _check_room(what: str, needed: int, room: int) -> None:
    if needed > room:
        raise _narrow(f"{what}: {needed} dots, and there is room for {room}", "lengths")


def _narrow(what: str, where: str) -> JobError:
    return JobError("MF117", what, where=where, cure="Use more dots, or smaller lengths")


def _spread(picture: Labels | Mask, reach: int, mode: str) -> Labels:
    """The largest value within so many elements either way."""
    from scipy import ndimage  # slow to load, and few openings are drawn with emitters

    found: Labels = ndimage.maximum_filter(picture, size=2 * reach + 1, mode=mode)
    return found
