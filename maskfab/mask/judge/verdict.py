"""Files of a plate held against what its job asks for: dies dot by dot, marks corner by corner, and text as it reads.

From the job come the corners of everything clear; from the file, through whatever library has read it, those of
everything that it draws. Both are whole numbers, and what is left where they do not cancel is named.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import product
from pathlib import Path

import numpy as np
import scipy
from klayout import db

from maskfab.base import __version__
from maskfab.base.arrays import Ints, Mask
from maskfab.base.model import Quantity
from maskfab.base.units import NM_PER_UM
from maskfab.job.sections import JobSpec
from maskfab.job.shop import Shop
from maskfab.mask.judge import dies as of_dies
from maskfab.mask.judge import marks as of_marks
from maskfab.mask.judge.dies import AskedDie, Boundary, Figures, asked_dies, by_die, figures, packed, total
from maskfab.mask.judge.displays import LAYERS as OF_DISPLAY
from maskfab.mask.judge.displays import Answer, Display, display_rows
from maskfab.mask.judge.headers import Stated
from maskfab.mask.judge.marks import (
    ADVANCE,
    HEIGHT,
    WIDTH,
    Code,
    Line,
    Mark,
    area_steps2,
    asked_marks,
    corner_squares,
    drawing,
    mirrored,
    nearest,
    on_grid,
    points,
    read,
    read_symbol,
    symbol,
)
from maskfab.mask.judge.sources import sources

_CLEAR, _CUT, _CHROME = LAYERS = db.LayerInfo(1, 0), db.LayerInfo(2, 0), db.LayerInfo(3, 0)
_MOST_NAMED = 5
_LONGEST = 200
"""Letters of a line that nobody asked for."""
_BARRED, _BARRED_LETTER, _MOST_OFF = 1 / 8, 1 / 3, 1 / 2
"""Shares of a line of text and of a letter that bars of chrome may take at most, and of corners that may be theirs."""


@dataclass(frozen=True, eq=False)
class Asked:
    """A plate as its job asks for it, in the coordinates of its files.

    Attributes:
        dies: with their lines as they lie on the plate.
        lines: of text, before the plate is mirrored.
        writable: side of the writable area, nanometres.
        grids: to which marks have been moved, in that order, nanometres.
        dark: whether the data are the chrome of the writable area.
        bias: by which clear widths of the data are narrower, nanometres.
        bar: width of bars of chrome that may cross marks, so that none has a hole or touches itself, nanometres; 0 for
            none.
        header: what files have to say beside their polygons.
        displays: of every die; none where a file shows no display.
    """

    dies: tuple[AskedDie, ...]
    marks: tuple[Mark, ...]
    lines: tuple[Line, ...]
    codes: tuple[Code, ...]
    writable: int
    mirror: bool
    grids: tuple[int, ...]
    dark: bool
    bias: int
    bar: int
    header: Stated
    displays: tuple[Display, ...] = ()

    @cached_property
    def boundaries(self) -> tuple[Boundary, ...]:
        """Clear parts of every die."""
        return tuple(of_dies.boundary(die, self.bias) for die in self.dies)

    @cached_property
    def clear_marks(self) -> tuple[Boundary, ...]:
        """Clear parts of every mark."""
        return tuple(of_marks.boundary(mark, self.bias) for mark in self.marks)

    def on_plate(self, x: Ints, *, across: bool) -> Ints:
        """Coordinates of marks as they lie on the plate; ``across`` for those along x."""
        if across and self.mirror:
            x = -x
        for grid in self.grids:
            x = nearest(x, grid)
        return x


def asked(
    spec: JobSpec,
    shop: Shop | None = None,
    *,
    file: Path | None = None,
    sent: bool = False,
    version: str = __version__,
    answers: Mapping[str, Answer] | None = None,
) -> Asked:
    """A plate from its job alone.

    Args:
        spec: a job that has been laid out, with its openings and maps as text.
        file: the job was read from; it and the openings and maps that it names are read once more.
        sent: whether it goes to the shop, which may ask for squares in the corners of a drawing.
        answers: what was found of the display of each die that has pixels; None where none is drawn.
    """
    held = sources(spec, file)
    dies = asked_dies(spec, held)
    grids = _grids(spec, dies, shop)
    marks, lines, codes, writable, blank = asked_marks(spec, dies, held, version)
    if held.mirror:
        dies = tuple(of_dies.mirrored(die) for die in dies)
        marks = tuple(map(mirrored, marks))
    if sent and shop is not None and shop.plate.extent_mm is not None and shop.plate.corner_square_um is not None:
        marks += tuple(corner_squares(shop.plate.extent_mm, shop.plate.corner_square_um))
    for grid in grids:
        marks = tuple(on_grid(mark, grid) for mark in marks)
    displays: tuple[Display, ...] = ()
    if answers is not None and spec.emitters is not None:
        of_wires = _house_grid(grids, spec, shop)
        given = zip(dies, held.labels, strict=True)
        displays = tuple(Display.of(answers.get(die.name), die, stated, spec, of_wires) for die, stated in given)
    # Bars open holes for a house where no two figures may share an edge.
    barred = shop is not None and shop.polygons.shared_boundaries is False
    least = 0 if shop is None else shop.limits.min_space_um or shop.limits.min_feature_um or 0
    return Asked(
        dies,
        marks,
        lines,
        codes,
        writable,
        held.mirror,
        grids,
        held.dark,
        held.bias,
        max(4_000, 2 * round(least * NM_PER_UM)) if barred else 0,
        Stated(held.dark, held.digest, tuple(_extents(blank, shop)), _drawing_unit(shop)),
        displays,
    )


def _extents(blank: int, shop: Shop | None) -> Iterator[tuple[int, int]]:
    """Widths and heights that a drawing's header may state: of the blank, or of what a house has it span."""
    yield blank, blank
    for sides in () if shop is None else (shop.plate.extent_mm, shop.plate.plot_area_mm):
        if sides is not None:
            yield min(round(sides[0] * 1e6), blank), min(round(sides[1] * 1e6), blank)
            yield round(sides[0] * 1e6), round(sides[1] * 1e6)


def _drawing_unit(shop: Shop | None) -> str:
    return "um" if shop is None else shop.accepts.drawing_unit or "um"


def _grids(spec: JobSpec, dies: Sequence[AskedDie], shop: Shop | None) -> tuple[int, ...]:
    """Grids to which marks are moved: the job's, then the house's."""
    stated = None if spec.export is None or spec.export.grid is None else round(spec.export.grid * NM_PER_UM)
    own = () if stated is None or stated == 1 else (stated,)
    if shop is None:
        return own
    lines = [line for die in dies for line in (die.x, die.y)]
    grids = [grid for grid in shop.limits.grid_nm or () if not any(np.any(line % grid) for line in lines)]
    if stated in grids or 1 in grids or not grids:
        return own
    return (*own, max(grids))


def _house_grid(grids: Sequence[int], spec: JobSpec, shop: Shop | None) -> int:
    """Grid of wires across a die, which are laid after the job's own grid and before the house's."""
    own = None if spec.export is None or spec.export.grid is None else round(spec.export.grid * NM_PER_UM)
    if shop is None or not grids:
        return 1
    return grids[-1] if grids[-1] != own or own in (shop.limits.grid_nm or ()) else 1


def judged(read: db.Layout, name: str, plate: Asked) -> tuple[Quantity, ...]:
    """Rows of a report on one file: of every die, of its display if it is shown, of all marks, and of all text.

    Args:
        read: the file, read by a library that did not write it, layers under the plate's numbers; one top cell.
    """
    of_plate = (_CHROME if plate.dark else _CLEAR, _CUT)
    drawn = list(figures(read, *of_plate, *(OF_DISPLAY.values() if plate.displays else ())))
    left = _left_over([(layer, figure) for layer, figure in drawn if layer in of_plate], plate)
    owners = [die.box for die in plate.dies]
    of_lines = [line_box(line, plate) for line in plate.lines]
    of_codes = [_code_box(code, plate) for code in plate.codes]
    corners = left.corners
    taken = np.full(len(corners), -1)
    places = np.array([*owners, *of_lines, *of_codes], dtype=np.int64).reshape(-1, 4)
    # What lies in a line belongs to it, and only then to another that it lies near.
    near = [line_box(line, plate, near=True) for line in plate.lines]
    wider = np.array(near, dtype=np.int64).reshape(-1, 4)
    for number, (x0, y0, x1, y1) in (*enumerate(places), *enumerate(wider, len(owners))):
        inside = (corners[:, 0] >= x0) & (corners[:, 0] <= x1) & (corners[:, 1] >= y0) & (corners[:, 1] <= y1)
        taken[inside & (taken < 0)] = number
    parts = [left.kept(taken == number) for number in range(len(places))]
    rows = [_die_row(die, part, name) for die, part in zip(plate.dies, parts, strict=False)]
    texts = parts[len(owners) : len(owners) + len(of_lines)]
    wrong_text = [said for line, part in zip(plate.lines, texts, strict=True) if (said := _misread(line, part, plate))]
    codes = parts[len(owners) + len(of_lines) :]
    wrong_text += [
        said for code, part in zip(plate.codes, codes, strict=True) if (said := _miscoded(code, part, plate))
    ]
    wrong_marks = list(_wrong_marks(left.kept(taken < 0), plate))
    shown = [(layer, figure) for layer, figure in drawn if layer not in of_plate]
    marks_method = f"{len(plate.marks)} marks at the places and in the sense that job and template ask for"
    text_method = f"{len(plate.lines) + len(plate.codes)} lines and codes read back as text, each at its place"
    return (
        *rows,
        *(display_rows(read, name, plate.dies, plate.displays, shown) if plate.displays else ()),
        _plate_row("judged_marks", f"{name}: {marks_method}", wrong_marks),
        _plate_row("judged_text", f"{name}: {text_method}", wrong_text),
    )


def _plate_row(quantity: str, method: str, wrong: Sequence[str]) -> Quantity:
    more = f"; and {len(wrong) - _MOST_NAMED} more" if len(wrong) > _MOST_NAMED else ""
    method += "".join(f"; {sentence}" for sentence in wrong[:_MOST_NAMED]) + more
    return Quantity(quantity, len(wrong), method, limit=0, passed=not wrong)


def _left_over(made_clear: Iterable[tuple[db.LayerInfo, Figures]], plate: Asked) -> Boundary:
    """Difference of what the file makes clear and what the job asks for, its text apart."""
    drawn: list[list[Boundary]] = [[] for _ in range(len(plate.dies) + 1)]
    for layer, figure in made_clear:
        for number, part in by_die(figure, plate.dies):
            drawn[number].append(part.times(-1 if layer == _CUT else 1))
    *of_dies_drawn, rest = drawn
    if not plate.dark:
        marks = [*rest, *(mark.times(-1) for mark in plate.clear_marks)]
        pairs = zip(plate.boundaries, of_dies_drawn, strict=True)
        return total([*(total([*parts, clear.times(-1)]) for clear, parts in pairs), total(marks)])
    # Chrome is asked for where the writable area is neither die nor mark, and in dies where nothing is clear.
    squares = [_whole(die.x, die.y) for die in plate.dies]
    side = np.array([-(plate.writable // 2), plate.writable // 2])
    field = [*rest, _whole(side, side).times(-1), *squares, *plate.clear_marks]
    triples = zip(squares, plate.boundaries, of_dies_drawn, strict=True)
    of_chrome = (total([*parts, square.times(-1), clear]) for square, clear, parts in triples)
    return total([*of_chrome, total(field)]).times(-1)


def _whole(x: Ints, y: Ints) -> Boundary:
    """Everything between the first and the last of some lines."""
    return Boundary.of_raster(x[[0, -1]], y[[0, -1]], np.ones((1, 1), np.bool_))


def _die_row(die: AskedDie, left: Boundary, name: str) -> Quantity:
    corners = left.corners
    said = ""
    if len(corners):
        column, row = ((corners - die.box[:2]) // die.pitch)[np.lexsort(corners.T)[0]]
        said = f"; the first at {_first(corners)}, cell {column}, {row} from the lower left"
    return Quantity(
        "judged_die",
        len(corners),
        f"{name}: corners that place, tiling rule and opening of the job do not ask for, or that are missing{said}",
        limit=0,
        passed=not len(corners),
        die=die.name,
    )


def _first(corners: Ints) -> str:
    """The lowest place, and of those the leftmost."""
    x, y = corners[np.lexsort(corners.T)[0]] / NM_PER_UM
    return f"({x:.3f}, {y:.3f}) um"


def _wrong_marks(left: Boundary, plate: Asked) -> Iterator[str]:
    """A sentence on every mark at which something is left; each corner belongs to the mark that it lies nearest to."""
    corners = left.corners
    if not len(corners):
        return
    names = list(dict.fromkeys(line.name for line in plate.lines))
    hulls = [_hull([line for line in plate.lines if line.name == name], plate) for name in names]
    boxes = np.array([*(mark.box for mark in plate.marks), *hulls], dtype=np.int64).reshape(-1, 4)
    gap_x = np.maximum(0, np.maximum(boxes[:, 0] - corners[:, :1], corners[:, :1] - boxes[:, 2]))
    gap_y = np.maximum(0, np.maximum(boxes[:, 1] - corners[:, 1:], corners[:, 1:] - boxes[:, 3]))
    nearest_mark = np.argmin(np.hypot(gap_x, gap_y), axis=1)
    for number in np.unique(nearest_mark):
        mine = left.kept(nearest_mark == number)
        if number >= len(plate.marks):
            name = names[number - len(plate.marks)]
            told = _further_text(mine, plate)
            yield f"{name} has {told} beside its lines, first at {_first(mine.corners)}"
            continue
        mark = plate.marks[number]
        if plate.bar and _may_be_barred(plate.clear_marks[number]) and _only_bars(mine, plate):
            continue
        yield f"{mark.name}{_how(mark, mine, plate.clear_marks[number])}, first at {_first(mine.corners)}"


def _hull(lines: Sequence[Line], plate: Asked) -> tuple[int, int, int, int]:
    """Lines of one mark, and a line's height about them."""
    boxes = np.array([line_box(line, plate) for line in lines])
    reach = HEIGHT * min(line.step for line in lines)
    (x0, y0), (x1, y1) = boxes[:, :2].min(axis=0), boxes[:, 2:].max(axis=0)
    return int(x0), int(y0) - reach, int(x1), int(y1) + reach


def _further_text(drawn: Boundary, plate: Asked) -> str:
    """That which stands where nothing should, if letters can be read."""
    (x0, y0), (x1, y1) = drawn.corners.min(axis=0), drawn.corners.max(axis=0)
    step, rest = divmod(int(y1 - y0), HEIGHT)
    letters = math.ceil((x1 - x0) / max(step, 1) / ADVANCE)
    for shift in range(0, 0 if rest or not step or letters > _LONGEST else WIDTH, 4):
        x = x0 - shift * step + step * points(letters * ADVANCE)
        seen = drawn.seen(np.sort(x0 + x1 - x) if plate.mirror else x, y0 + step * points(HEIGHT)) != 0
        text = read(seen[:, ::-1] if plate.mirror else seen).strip()
        if text and "?" not in text:
            return f"the text {text!r}"
    return "something"


def _how(mark: Mark, left: Boundary, clear: Boundary) -> str:
    """In which way a mark is wrong, where that can be told."""
    boundary = total([left, clear])
    if boundary.empty:
        return " is missing"
    across = int(mark.box[0] + mark.box[2])
    x, y = boundary.corners[: len(boundary.level)].T
    if (
        not boundary.slanted.size
        and total([Boundary(packed(across - x, y), boundary.change, boundary.slanted), clear]).empty
    ):
        return " is mirrored"
    shift = boundary.corners.min(axis=0) - clear.corners.min(axis=0)
    if total([boundary, clear.at(shift[None, :]).times(-1)]).empty:
        return f" lies {shift[0]:+d} nm along x and {shift[1]:+d} nm along y from its place"
    return " has another shape"


def _may_be_barred(clear: Boundary) -> bool:
    """Whether a mark has a hole, or touches itself at a corner, so that bars have to open it."""
    seen = _parts(clear)[2] > 0
    holes = scipy.ndimage.label(np.pad(~seen, 1, constant_values=True))[1] > 1
    ones, others = seen[1:, 1:] & seen[:-1, :-1], seen[1:, :-1] & seen[:-1, 1:]
    touches = (ones & ~(seen[1:, :-1] | seen[:-1, 1:])) | (others & ~(seen[1:, 1:] | seen[:-1, :-1]))
    return bool(holes or touches.any())


def _only_bars(left: Boundary, plate: Asked) -> bool:
    """Whether nothing is clear that should not be, and what lacks is nowhere wider than a bar."""
    width, height, seen = _parts(left)
    if left.slanted.size or not np.isin(seen, (-1, 0)).all():
        return False
    lost = seen < 0
    across, up = _runs(lost, width), _runs(lost.T, height).T
    return bool((np.minimum(across, up)[lost] <= plate.bar).all())


def _parts(boundary: Boundary) -> tuple[Ints, Ints, Ints]:
    """Widths and heights of parts between all lines of a boundary without slants, and how often each is covered."""
    x, y = (np.unique(boundary.corners[:, k]) for k in (0, 1))
    seen = boundary.seen((x[1:] + x[:-1]) / 2, (y[1:] + y[:-1]) / 2).astype(np.int64)
    return np.diff(x), np.diff(y), seen


def _runs(lost: Mask, widths: Ints) -> Ints:
    """Length of the run along a row that each part belongs to, int64 [ny, nx]; of parts that are not lost, 0."""
    starts = lost & ~np.pad(lost, ((0, 0), (1, 0)))[:, :-1]
    number = np.cumsum(starts.ravel()).reshape(lost.shape) * lost
    lengths = np.bincount(number.ravel(), weights=(lost * widths).ravel()).astype(np.int64)
    return np.where(lost, lengths[number], 0)


def line_box(line: Line, plate: Asked, *, near: bool = False) -> tuple[int, int, int, int]:
    """Letters of a line of text; what is near is half a letter to either side, and a stroke above and below."""
    width = (len(line.text) * ADVANCE - (ADVANCE - WIDTH)) * line.step
    margin, stroke = (count * line.step * near for count in (ADVANCE // 2, HEIGHT // 7))
    x = plate.on_plate(np.array([line.left - margin, line.left + width + margin]), across=True)
    low, high = plate.on_plate(np.array([line.base - stroke, line.base + HEIGHT * line.step + stroke]), across=False)
    return int(x.min()), int(low), int(x.max()), int(high)


def _misread(line: Line, drawn: Boundary, plate: Asked) -> str:
    """The fault of a line of text; nothing if it reads as it should and lies where it should."""
    text = line.text.upper()
    if drawn.empty:
        return f"{line.name} {text!r} is missing"
    columns = plate.on_plate(line.left + line.step * np.arange(len(text) * ADVANCE + 1), across=True)
    rows = plate.on_plate(line.base + line.step * np.arange(HEIGHT + 1), across=False)
    x, y = (np.interp(points(len(edges) - 1), np.arange(len(edges)), edges) for edges in (columns, rows))
    seen = drawn.seen(np.sort(x), y) != 0
    seen = seen[:, ::-1] if plate.mirror else seen
    wanted, corners = drawing(text), drawn.corners
    off = ~(np.isin(corners[:, 0], columns) & np.isin(corners[:, 1], rows))
    extra, lacking = area_steps2(seen & ~wanted), area_steps2(wanted & ~seen)
    outside = (corners < (columns.min(), rows[0])).any(axis=1) | (corners > (columns.max(), rows[-1])).any(axis=1)
    # Bars leave most corners where they were.
    bars = plate.bar and lacking <= _BARRED * area_steps2(wanted) and off.mean() < _MOST_OFF and not outside.any()
    bars = bars and _most_lost(wanted, seen) <= _BARRED_LETTER
    if not extra and (bars or not (lacking or off.any())):
        return ""
    if (said := read(seen)) != text:
        return f"{line.name} reads {said!r}, not {text!r}"
    where = _first(corners[off] if off.any() else corners)
    return f"{line.name} {text!r} is not drawn as letters are, or not at its place, first at {where}"


def _most_lost(wanted: Mask, seen: Mask) -> float:
    """Largest share of a letter that should be clear and is not."""
    width = len(points(ADVANCE))
    letters = [slice(start, start + width) for start in range(0, wanted.shape[1], width)]
    areas = ((area_steps2(wanted[:, one] & ~seen[:, one]), area_steps2(wanted[:, one])) for one in letters)
    return max((lost / whole for lost, whole in areas if whole), default=0.0)


def _code_box(code: Code, plate: Asked) -> tuple[int, int, int, int]:
    reach = 40 * code.module
    x = plate.on_plate(np.array([code.centre[0] - reach, code.centre[0] + reach]), across=True)
    return int(x.min()), code.centre[1] - reach, int(x.max()), code.centre[1] + reach


def _miscoded(code: Code, drawn: Boundary, plate: Asked) -> str:
    """The fault of a data matrix, whose light modules are clear; nothing if every one is that of the code's text."""
    if drawn.empty:
        return f"{code.name} is missing"
    wanted = symbol(code.text)
    x, y = _lines_of(code, len(wanted), plate)
    light = wanted[:, ::-1] if plate.mirror else wanted
    boxes = [[x[i], y[j], x[i + 1], y[j + 1]] for j, i in zip(*np.nonzero(light), strict=True)]
    mark = Mark(code.name, np.array(boxes, dtype=np.int64).reshape(-1, 4))
    left = total([drawn, of_marks.boundary(mark, plate.bias).times(-1)])
    if left.empty or (plate.bar and _only_bars(left, plate)):
        return ""
    corners = drawn.corners
    count = max(1, round((int(corners[:, 0].max() - corners[:, 0].min()) + plate.bias) / code.module))
    x, y = _lines_of(code, count, plate)
    # At nine places of each module, of which a bar may take three.
    nine = (np.interp((np.arange(3 * count) + 0.5) / 3, np.arange(count + 1), edges) for edges in (x, y))
    seen = drawn.seen(*nine).reshape(count, 3, count, 3).sum(axis=(1, 3)) > 4
    seen = seen[:, ::-1] if plate.mirror else seen
    if np.array_equal(seen, wanted):
        return f"{code.name} has modules off their places"
    for mirrored_, turns in product((False, True), range(4)):
        if np.array_equal(np.rot90(seen[:, ::-1] if mirrored_ else seen, -turns), wanted):
            how = ("mirrored" * mirrored_, f"turned by {90 * turns} degrees" * (turns > 0))
            return f"{code.name} is {' and '.join(filter(None, how))}"
    text = read_symbol(seen)
    if text not in ("", code.text):
        return f"{code.name} reads {text!r}, not {code.text!r}"
    if seen.shape != wanted.shape:
        return f"{code.name} has {count} modules a side, not {len(wanted)}"
    row, column = np.argwhere(seen != wanted)[0]
    wrong = int(np.count_nonzero(seen != wanted))
    return (
        f"{code.name} has {wrong} wrong modules, the lowest in column {column} of row {row}, from 0 at the lower left"
    )


def _lines_of(code: Code, count: int, plate: Asked) -> tuple[Ints, Ints]:
    """Lines between so many modules a side, on the plate."""
    start = (code.centre[0] - count * code.module // 2, code.centre[1] - count * code.module // 2)
    x, y = (plate.on_plate(start[k] + code.module * np.arange(count + 1), across=k == 0) for k in (0, 1))
    return np.sort(x), y
