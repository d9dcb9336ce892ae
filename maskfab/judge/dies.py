"""Dies that a job asks for, dot by dot: where each lies, and what each of its cells shows.

Rows count from below and columns from the left, from 0. The rules are those of ``docs/layout.md``.
"""

from __future__ import annotations

import math
import tomllib
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from maskfab.base.arrays import Ints, Mask
from maskfab.jobfile import DieSection, JobSpec
from maskfab.judge.boundary import Boundary
from maskfab.units import NM_PER_UM

_TURNS = {
    "random": (0, 1, 2, 3, 4, 5, 6, 7),
    "map": (0, 1, 2, 3, 4, 5, 6, 7),
    "paper4": (0, 5, 4, 3),
    "flips": (0, 2, 4, 6),
    "periodic": (0,),
    "rot90": ((0, 1), (3, 2)),
    "rot90flip": ((0, 5), (7, 2)),
}
"""Turns that cells draw from or, for the last two, blocks of 2 x 2 cells from the lower row upwards."""
_REACH = 6


@dataclass(frozen=True, eq=False)
class AskedDie:
    """A die as the job asks for it.

    Attributes:
        name: of the die.
        label: text under it.
        centre: of its slot, nanometres.
        slot: side of it.
        dot: side of a dot.
        pitch: of its cells.
        x: lines along which dots and gutters end, int64 [nx + 1].
        y: int64 [ny + 1].
        clear: bool [ny, nx], between lines.
        narrowest: shortest clear run of its openings, or a dot where no run ends, nanometres.
    """

    name: str
    label: str
    centre: tuple[int, int]
    slot: int
    dot: int
    pitch: int
    x: Ints
    y: Ints
    clear: Mask
    narrowest: int

    @property
    def box(self) -> tuple[int, int, int, int]:
        return int(self.x[0]), int(self.y[0]), int(self.x[-1]), int(self.y[-1])


def asked_dies(spec: JobSpec) -> tuple[AskedDie, ...]:
    """Every die of a job, in its order, before the plate is mirrored."""
    section = spec.plate
    assert section is not None
    slot, pitch = _nm(section.die_size), _nm(section.die_pitch)
    columns = min(section.columns, len(spec.die))
    rows = math.ceil(len(spec.die) / columns)
    left, top = math.floor(-(columns - 1) * pitch / 2), math.floor((rows - 1) * pitch / 2)
    return tuple(
        _die(die, spec, (left + number % columns * pitch, top - number // columns * pitch), slot)
        for number, die in enumerate(spec.die)
    )


def _die(die: DieSection, spec: JobSpec, centre: tuple[int, int], slot: int) -> AskedDie:
    side, dot, gutter = slot if die.size is None else _nm(die.size), _nm(die.dot), _nm(die.gutter)
    shapes = [_drawing(spec.openings[name]) for name in (die.opening, *(die.others or ()))]
    dots = len(shapes[0])
    rows = columns = side // (dots * dot + gutter)
    if die.tiling == "hexagonal":
        shapes = [_hexagonal(shapes[0], side // dot, die.seed or 0)]
        dots, rows, columns = len(shapes[0]), 1, 1
        cells: NDArray[np.int64] = np.zeros((1, 1), np.int64)
    elif die.map is not None:
        given = tomllib.loads(spec.maps[die.map])
        turns = _digits(given["map"])
        held = _digits(given["openings"]) if "openings" in given else 0 * turns
        if given.get("shifts"):
            shapes = [_moved(shapes[0], right, up) for right, up in given["shifts"]]
        rows, columns = (room - (room - have) % 2 for room, have in zip((rows, columns), turns.shape, strict=True))
        cells = _tiled("map", rows, columns, die.seed, len(shapes))
        _put_in_the_middle(cells, 8 * held + turns)
    elif die.tiling == "blue_noise":
        cells = _blue_noise(8 * len(shapes), rows, columns, die.seed or 0)
    else:
        cells = _tiled(str(die.tiling), rows, columns, die.seed, len(shapes))
    pitch = dots * dot + gutter
    x, y = (_lines(count, dots, dot, gutter) for count in (columns, rows))
    clear, rim = np.zeros((len(y) - 1, len(x) - 1), dtype=np.bool_), 1 if gutter else 0
    every = np.stack([_turned(shape, turn) for shape in shapes for turn in range(8)])[cells]
    for row in range(dots):
        for column in range(dots):
            clear[row + rim :: dots + rim, column + rim :: dots + rim] = every[:, :, row, column]
    corner = centre[0] - columns * pitch // 2, centre[1] - rows * pitch // 2
    runs = [run for shape in shapes if (run := _shortest_run(shape))]
    narrowest = min(runs, default=1) * dot
    return AskedDie(die.name, die.label, centre, slot, dot, pitch, corner[0] + x, corner[1] + y, clear, narrowest)


def _nm(length_um: float) -> int:
    return round(length_um * NM_PER_UM)


def _drawing(text: str) -> Mask:
    """Dots of an opening, bool [dots, dots]; drawn with the top row first."""
    rows = [line.strip() for line in tomllib.loads(text)["grid"].splitlines() if line.strip()]
    return np.array([[dot == "#" for dot in row] for row in reversed(rows)])


def _digits(text: str) -> Ints:
    """Digits of a map, int64; drawn with the top row first."""
    rows = [line.strip() for line in text.splitlines() if line.strip()]
    return np.array([[int(digit, 16) for digit in row] for row in reversed(rows)], dtype=np.int64)


def _lines(cells: int, dots: int, dot: int, gutter: int) -> Ints:
    """Where dots and gutters of so many cells end: half a gutter, the dots, a gutter, the dots, and so on."""
    if not gutter:
        return np.arange(cells * dots + 1, dtype=np.int64) * dot
    widths = [gutter // 2, *([*[dot] * dots, gutter] * cells)[:-1], gutter // 2]
    return np.concatenate([[0], np.cumsum(widths)]).astype(np.int64)


def _turned(shape: Mask, turn: int) -> Mask:
    """An opening mirrored left to right for turns 4 to 7, then turned counter-clockwise by quarters, turn modulo 4."""
    if turn >= 4:
        shape = shape[:, ::-1]
    for _ in range(turn % 4):
        shape = shape[::-1].T  # what lies to the right goes up, and what lies above to the left
    return shape


def _moved(shape: Mask, right: int, up: int) -> Mask:
    """An opening moved by whole dots, none of which leaves the cell."""
    return np.roll(shape, (up, right), axis=(0, 1))


def _tiled(tiling: str, rows: int, columns: int, seed: int | None, openings: int) -> Ints:
    """Contents of each cell: 8 times the opening's number and the turn."""
    draw, turns = np.random.default_rng(seed), np.array(_TURNS[tiling])
    if turns.ndim == 2:
        cells = turns[np.arange(rows)[:, None] % 2, np.arange(columns) % 2]
    elif tiling == "periodic":
        cells = np.zeros((rows, columns), dtype=np.int64)
    else:
        cells = turns[draw.integers(len(turns), size=(rows, columns))]
    return cells + 8 * draw.integers(openings, size=(rows, columns)) if openings > 1 else cells


def _put_in_the_middle(cells: Ints, given: Ints) -> None:
    """Overwrite the middle of a panel by a map, or all of it by the map's middle."""
    room, have = np.array(cells.shape), np.array(given.shape)
    to, start, size = np.maximum(room - have, 0) // 2, np.maximum(have - room, 0) // 2, np.minimum(room, have)
    cells[to[0] : to[0] + size[0], to[1] : to[1] + size[1]] = given[
        start[0] : start[0] + size[0], start[1] : start[1] + size[1]
    ]


def _blue_noise(kinds: int, rows: int, columns: int, seed: int) -> Ints:
    """Equal cells kept apart by swaps; whole numbers alone decide, so that any machine comes to the same map."""
    draw = np.random.default_rng(seed)
    size = rows * columns
    cells = draw.permutation(np.arange(size) % kinds).reshape(rows, columns)
    repels = np.zeros((rows, columns), dtype=np.int64)
    for up in range(-_REACH, _REACH + 1):
        for right in range(-_REACH, _REACH + 1):
            repels[up % rows, right % columns] += round(2**20 * math.exp(-(up * up + right * right) / 4.5))
    up_to, right_to = np.nonzero(repels)
    # felt[k, cell]: how much all cells of kind k together repel one that stands there.
    felt = np.zeros((kinds, rows, columns), dtype=np.int64)
    for row in range(rows):
        for column in range(columns):
            np.add.at(
                felt[cells[row, column]], ((row + up_to) % rows, (column + right_to) % columns), repels[up_to, right_to]
            )
    for _ in range(6):
        swaps = 0
        for one in draw.permutation(size):
            here, mine = divmod(int(one), columns), int(cells.flat[one])
            others = draw.integers(size, size=24)
            there_up, there_right = np.divmod(others, columns)
            theirs = cells[there_up, there_right]
            between = repels[(there_up - here[0]) % rows, (there_right - here[1]) % columns]
            gain = felt[mine][here] - felt[theirs, here[0], here[1]]
            gain = gain + felt[theirs, there_up, there_right] - felt[mine, there_up, there_right]
            gain = np.where(theirs == mine, 0, gain + 2 * (between - repels[0, 0]))
            best = int(np.argmax(gain))
            if gain[best] > 0:
                there, its = (int(there_up[best]), int(there_right[best])), int(theirs[best])
                for place, comes, goes in ((here, its, mine), (there, mine, its)):
                    around = (place[0] + up_to) % rows, (place[1] + right_to) % columns
                    np.add.at(felt[comes], around, repels[up_to, right_to])
                    np.subtract.at(felt[goes], around, repels[up_to, right_to])
                cells[here], cells[there] = its, mine
                swaps += 1
        if not swaps:
            break
    return np.asarray(cells, dtype=np.int64)


def _hexagonal(shape: Mask, dots: int, seed: int) -> Mask:
    """A sheet of hexagonal cells, as wide from flat to flat as the opening, each turned by a multiple of 60 degrees."""
    width = len(shape)
    rise = width * math.sqrt(3) / 2
    rows, columns = math.ceil(dots / rise) + 3, math.ceil(dots / width) + 3
    turns = np.random.default_rng(seed).integers(6, size=(rows, columns))
    middle = np.arange(dots) + 0.5 - dots / 2
    y, x = np.meshgrid(middle, middle, indexing="ij")
    found = []
    for row in (np.floor(y / rise), np.floor(y / rise) + 1):
        column = np.rint((x - width / 2 * (row % 2)) / width)
        away_x, away_y = x - width / 2 * (row % 2) - column * width, y - row * rise
        turn = turns[(row.astype(int) + rows // 2) % rows, (column.astype(int) + columns // 2) % columns]
        found.append((away_x**2 + away_y**2, away_x, away_y, turn))
    upper = found[1][0] < found[0][0]
    right, up, turn = (np.where(upper, found[1][k], found[0][k]) for k in (1, 2, 3))
    angle = -np.pi / 3 * turn
    column = np.floor(right * np.cos(angle) - up * np.sin(angle) + width / 2).astype(int)
    row = np.floor(right * np.sin(angle) + up * np.cos(angle) + width / 2).astype(int)
    inside = (column >= 0) & (column < width) & (row >= 0) & (row < width)
    return np.asarray(inside & shape[np.clip(row, 0, width - 1), np.clip(column, 0, width - 1)])


def _shortest_run(shape: Mask) -> int:
    """Dots of the shortest clear run of an opening that repeats; 0 where none ends."""
    shortest = []
    for line in (*shape, *shape.T):
        if line.any() and not line.all():
            ends = np.flatnonzero(~np.roll(line, -int(np.argmin(line))))
            runs = np.diff(np.append(ends, len(line))) - 1
            shortest.append(int(runs[runs > 0].min()))
    return min(shortest, default=0)


def narrowed(x: Ints, y: Ints, clear: Mask, bias: int) -> tuple[Ints, Ints, Mask]:
    """Lines and what is clear between them when every edge has moved inwards by half a bias; outwards if negative.

    Every line becomes two, half the bias to either side. What lies between them is clear where the parts on both sides
    are, or with a negative bias where one is: along x, then along y.
    """
    for _ in range(2):
        padded = np.pad(clear, ((0, 0), (1, 1)))
        joined = padded[:, 1:] & padded[:, :-1] if bias > 0 else padded[:, 1:] | padded[:, :-1]
        parts = np.empty((clear.shape[0], 2 * clear.shape[1] + 1), dtype=np.bool_)
        parts[:, ::2], parts[:, 1::2] = joined, clear
        lines = np.sort(np.concatenate([x - abs(bias) // 2, x + abs(bias) // 2]))
        x, y, clear = y, lines, parts.T
    return x, y, clear


def boundary(die: AskedDie, bias: int) -> Boundary:
    """Clear parts of a die in data of which edges have moved by half a bias."""
    x, y, clear = die.x, die.y, die.clear
    if bias:
        # Without a dark rim, whose outer line could pass the edges of dots when both are moved.
        kept = slice(1, -1) if not (clear[[0, -1]].any() or clear[:, [0, -1]].any()) else slice(None)
        x, y, clear = narrowed(x[kept], y[kept], clear[kept, kept], bias)
    return Boundary.of_raster(x, y, clear)


def mirrored(die: AskedDie) -> AskedDie:
    """The die with left and right exchanged about the plate's middle."""
    return replace(die, centre=(-die.centre[0], die.centre[1]), x=-die.x[::-1], clear=die.clear[:, ::-1])
