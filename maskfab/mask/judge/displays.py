"""Layers of the display held against what was found for one pixel of each die, and against the job's own rules.

The finding is laid over the cells that the job asks for, each in its turn: emitters, circuits and some wires turn with
their cell, others lie alike in all cells or across the whole die. Nothing of the plate that was composed from it is
used. Rules of the job that need no finding are measured on polygons of the file, in the middle of each die.
"""

from __future__ import annotations

from collections import Counter, defaultdict
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import combinations
from typing import Literal

import numpy as np
from klayout import db

from maskfab.base.arrays import Ints
from maskfab.base.model import CircuitBox, Emitters, Point, Quantity, Track
from maskfab.base.units import NM_PER_UM
from maskfab.job.sections import JobSpec
from maskfab.mask.judge.dies import (
    AskedDie,
    Boundary,
    Figures,
    groups,
    nearest_die,
    packed,
    to_nm,
    total,
    turned,
    unpacked,
)

LAYERS = {
    "RED": db.LayerInfo(20, 0),
    "GREEN": db.LayerInfo(21, 0),
    "BLUE": db.LayerInfo(22, 0),
    "WIRE1": db.LayerInfo(30, 0),
    "WIRE2": db.LayerInfo(31, 0),
    "VEIL": db.LayerInfo(32, 0),
    "CIRCUIT": db.LayerInfo(33, 0),
}
_COLOURS = ("RED", "GREEN", "BLUE")
_METALS = {"x": "WIRE1", "y": "WIRE2"}
_WINDOW = 4
"""Cells along each side of the middle of a die in which rules are measured."""
_SQUARE = 2
"""KLayout's mode of sizing that keeps square corners, so that distances are the larger of those along x and y."""
_MOST_NAMED = 4
_LOOKED_AT = 30
"""Cells that are searched for one that can be told in words."""

_Placed = list[tuple[Boundary, Ints]]
"""Shapes, and the places at which they lie."""


@dataclass(frozen=True, eq=False)
class Answer:
    """Display of a die as it was found for one pixel of turn 0, whose lower left corner, gutter included, is at 0, 0.

    Attributes:
        emitters: labels 1 to 3 on square cells; None where none were found.
        laid: wires across the die by the axis that they run along: middles from the die's lower left corner.
        found: which of emitters, circuits and wires were found as the job asks for them.
    """

    emitters: Emitters | None = None
    circuits: tuple[CircuitBox, ...] = ()
    tracks: tuple[Track, ...] = ()
    laid: tuple[tuple[Literal["x", "y"], tuple[tuple[Point, ...], ...]], ...] = ()
    found: frozenset[str] = frozenset()


@dataclass(frozen=True, eq=False)
class Display:
    """Display of a die as it is asked for.

    Attributes:
        answer: what was found for it; emitters that its opening states are those of the opening's own text.
        grid: to which wires across the die have been moved, nanometres.
    """

    answer: Answer
    spec: JobSpec
    grid: int

    @classmethod
    def of(cls, answer: Answer | None, die: AskedDie, stated: Ints | None, spec: JobSpec, grid: int) -> Display:
        """Display of a die.

        Args:
            answer: None for a die without pixels.
            stated: labels in the text of the die's opening, if there are any.
            grid: of marks, nanometres.
        """
        own = answer or Answer()
        if stated is not None and answer is not None:
            side = (die.pitch - die.gutter) // len(stated)
            own = replace(own, emitters=Emitters(stated.astype(np.int8), side))
        return cls(own, spec, grid)

    @property
    def shown(self) -> tuple[str, ...]:
        """Layers that show something of it, wires first."""
        wires = {"VEIL" if track.transmission else _METALS[track.axis] for track in self.answer.tracks}
        wires |= {_METALS[axis] for axis, paths in self.answer.laid if paths}
        return (*sorted(wires, reverse=True), *(_COLOURS if self.answer.emitters is not None else ()))

    @property
    def wires_or_emitters(self) -> Display:
        """Its wires alone, which are soon judged, or its emitters where it has none."""
        answer = replace(self.answer, circuits=(), found=self.answer.found - {"circuits", "emitters"})
        alone = replace(self, answer=replace(answer, emitters=None))
        return alone if alone.shown else replace(self, answer=answer)

    def unit(self, die: AskedDie, turn: int) -> dict[str, Boundary]:
        """Shapes of a cell by layer, its lower left corner the origin."""
        drawn: dict[str, list[Ints]] = defaultdict(list)
        drawn["CIRCUIT"] = [_turned(_corners(box), turn, die.pitch) for box in self.answer.circuits]
        for track in self.answer.tracks:
            # A quarter turn lays a wire along the other axis, which is another metal's.
            across = track.turns and turn % 2 == 1
            layer = "VEIL" if track.transmission else _METALS["yx"[track.axis == "y"] if across else track.axis]
            drawn[layer] += [_turned(np.array(ring), turn * track.turns, die.pitch) for ring in track.polygons]
        shapes = {layer: Boundary.of_polygons(map(_pairs, rings)) for layer, rings in drawn.items() if rings}
        if (emitters := self.answer.emitters) is not None:
            labels = turned(emitters.labels, turn)
            lines = die.gutter // 2 + emitters.cell_nm * np.arange(len(labels) + 1)
            shapes |= {
                layer: Boundary.of_raster(lines, lines, labels == colour) for colour, layer in enumerate(_COLOURS, 1)
            }
        return {layer: shape for layer, shape in shapes.items() if not shape.empty}

    def shapes(self, die: AskedDie) -> dict[str, _Placed]:
        """Everything that the die has to show, by layer."""
        asked: dict[str, _Placed] = defaultdict(list)
        corner = np.array(die.box[:2])
        for turn in np.unique(die.turns):
            row, column = np.nonzero(die.turns == turn)
            places = corner + die.pitch * np.column_stack([column, row])
            for layer, shape in self.unit(die, int(turn)).items():
                asked[layer].append((shape, places))
        width = 0 if self.spec.wires is None else to_nm(self.spec.wires.line)
        for axis, paths in self.answer.laid:
            outlines = (db.Path([db.Point(*point) for point in path], width).polygon() for path in paths)
            rings = (np.array([(point.x, point.y) for point in ring.each_point_hull()]) + corner for ring in outlines)
            moved = [(2 * ring + self.grid) // (2 * self.grid) * self.grid for ring in rings]
            if moved:
                asked[_METALS[axis]].append((Boundary.of_polygons(map(_pairs, moved)), np.zeros((1, 2), np.int64)))
        return asked


def _pairs(ring: Ints) -> list[tuple[int, int]]:
    return [(x, y) for x, y in ring.tolist()]


def _corners(box: CircuitBox) -> Ints:
    x0, y0, x1, y1 = box.box_nm
    return np.array([(x0, y0), (x1, y0), (x1, y1), (x0, y1)])


def _turned(points: Ints, turn: int, pitch: int) -> Ints:
    """Points of a cell under a turn, as :func:`maskfab.mask.judge.dies.turned` turns its opening."""
    x, y = points.T
    x = pitch - x if turn >= 4 else x
    for _ in range(turn % 4):
        x, y = pitch - y, x
    return np.column_stack([x, y])


def display_rows(
    read: db.Layout,
    name: str,
    dies: Sequence[AskedDie],
    displays: Sequence[Display],
    shown: Iterable[tuple[db.LayerInfo, Figures]],
) -> Iterator[Quantity]:
    """A row on the display of every die; what a file draws belongs to the die that it is nearest to."""
    drawn: list[dict[str, _Placed]] = [defaultdict(list) for _ in dies]
    names = {(layer.layer, layer.datatype): called for called, layer in LAYERS.items()}
    for layer, figure in shown:
        for number, shape, places in _by_die(figure, dies):
            drawn[number][names[layer.layer, layer.datatype]].append((shape, places))
    for die, display, own in zip(dies, displays, drawn, strict=True):
        wrong = [*_misplaced(die, display, own), *_broken(read, die, display)]
        more = f"; and {len(wrong) - _MOST_NAMED} more" if len(wrong) > _MOST_NAMED else ""
        said = "".join(f"; {sentence}" for sentence in wrong[:_MOST_NAMED]) + more
        what = "emitters, circuits and wires as they were found for a pixel, in every cell, and as the job's rules say"
        yield Quantity("judged_display", len(wrong), f"{name}: {what}{said}", limit=0, passed=not wrong, die=die.name)


def _by_die(figure: Figures, dies: Sequence[AskedDie]) -> Iterator[tuple[int, Boundary, Ints]]:
    if len(figure.places) > 1:
        whole = Boundary.of_edges(figure.edges)
        for number, placed in groups(nearest_die(figure.box + np.tile(figure.places, 2), dies)):
            yield min(number, len(dies) - 1), whole, figure.places[placed]
        return
    owner = nearest_die(figure.boxes + np.tile(figure.places, 2), dies)[figure.owner]
    for number, edges in groups(owner):
        yield min(number, len(dies) - 1), Boundary.of_edges(figure.edges[edges]), figure.places


def _left_over(drawn: _Placed, asked: _Placed) -> Boundary:
    """Difference of what is drawn and what is asked for; equal shapes at equal places are never spread out."""
    alike: dict[tuple[bytes, ...], tuple[Boundary, list[Ints]]] = {}
    for factor, placed in ((1, drawn), (-1, asked)):
        for shape, places in placed:
            key = shape.level.tobytes(), shape.change.tobytes(), shape.slanted.tobytes()
            where = np.column_stack([packed(*places.T), np.full(len(places), factor)])
            alike.setdefault(key, (shape, []))[1].append(where)
    parts = []
    for shape, found in alike.values():
        where, factors = np.concatenate(found).T
        places, index = np.unique(where, return_inverse=True)
        counts = np.bincount(index, weights=factors).astype(np.int64)
        for count in np.unique(counts[counts != 0]):
            parts.append(shape.at(unpacked(places[counts == count])).times(int(count)))
    return total(parts)


def _spread(placed: _Placed) -> Boundary:
    return total(shape.at(places) for shape, places in placed)


def _misplaced(die: AskedDie, display: Display, drawn: Mapping[str, _Placed]) -> Iterator[str]:
    """A sentence on every layer that is not as it was found."""
    asked = display.shapes(die)
    left = {layer: _left_over(drawn.get(layer, []), asked.get(layer, [])) for layer in LAYERS}
    wrong = [layer for layer in LAYERS if not left[layer].empty]
    there = {layer: _spread(drawn.get(layer, [])) for layer in wrong}
    wanted = {layer: _spread(asked.get(layer, [])) for layer in wrong}
    for layer in wrong:
        twin = next((each for each in wrong if each != layer and _equal(there[layer], wanted[each])), None)
        if there[layer].empty:
            yield f"{layer} is missing"
        elif wanted[layer].empty:
            yield f"{layer} is drawn where nothing is asked for"
        elif twin is not None:
            yield f"{layer} is what should be {twin}"
        elif (shift := _shift(there[layer], wanted[layer])) is not None:
            yield f"{layer} {shift}"
        else:
            yield _in_a_cell(layer, die, display, left[layer], drawn[layer], there[layer])


def _equal(one: Boundary, other: Boundary) -> bool:
    return total([one, other.times(-1)]).empty


def _shift(there: Boundary, wanted: Boundary) -> str | None:
    """Words on where shapes lie that are only moved; None if they are otherwise wrong."""
    if there.empty or wanted.empty:
        return None
    shift = there.corners.min(axis=0) - wanted.corners.min(axis=0)
    if shift.any() and _equal(there, wanted.at(shift[None, :])):
        return f"lies {shift[0]:+d} nm along x and {shift[1]:+d} nm along y from its place"
    return None


def _in_a_cell(layer: str, die: AskedDie, display: Display, left: Boundary, drawn: _Placed, there: Boundary) -> str:
    """A sentence on the lowest cell, and of those the leftmost, that shows something else than it should."""
    rows, columns = die.turns.shape
    corners, origin = left.corners, np.array(die.box[:2])
    cells = np.clip((corners - origin) // die.pitch, 0, (columns - 1, rows - 1))
    touched = unpacked(np.unique(packed(*cells.T)))
    alone = [display.unit(die, turn).get(layer, Boundary.none()) for turn in range(8)]
    many = f", and {len(touched) - 1} more" if len(touched) > 1 else ""
    for column, row in touched[:_LOOKED_AT].tolist():
        low = origin + die.pitch * np.array([column, row])
        own, turn = _of_cell(drawn, there, low, die.pitch), int(die.turns[row, column])
        units = [unit.at(low[None, :]) for unit in alone]
        place = f"cell {column}, {row} from the lower left{many}"
        if _equal(own, units[turn]):
            continue
        if (shift := _shift(own, units[turn])) is not None:
            return f"{layer} {shift} in {place}"
        if any(_equal(own, unit) for unit in units):
            return f"{layer} is not turned with {place}"
        if layer == "CIRCUIT":
            boxes = [packed(*(low + _turned(_corners(box), turn, die.pitch)).T) for box in display.answer.circuits]
            kept = sum(not np.isin(box, packed(*corners.T)).any() for box in boxes)
            return f"{layer}: {kept} of {len(boxes)} boxes at their places in {place}"
        return f"{layer} has another shape in {place}"
    x, y = corners[np.lexsort(corners.T)[0]] / NM_PER_UM
    return f"{layer} has another shape, the first at ({x:.3f}, {y:.3f}) um"


def _of_cell(drawn: _Placed, there: Boundary, low: Ints, pitch: int) -> Boundary:
    """Shapes drawn of a cell: those placed at its corner, or in a file without cells those within it."""
    placed = [shape for shape, places in drawn if (places == low).all(axis=1).any()]
    if placed:
        return total(shape.at(low[None, :]) for shape in placed)
    x, y = (there.corners - low).T
    return there.kept((x >= 0) & (y >= 0) & (x <= pitch) & (y <= pitch))


def _broken(read: db.Layout, die: AskedDie, display: Display) -> Iterator[str]:
    """A sentence on every rule of the job that shapes in the middle of a die break."""
    rows, columns = die.turns.shape
    first = [max(0, (count - _WINDOW) // 2) for count in (columns, rows)]
    last = [min(count, start + _WINDOW) for count, start in zip((columns, rows), first, strict=True)]
    (x0, y0), (x1, y1) = ((np.array(die.box[:2]) + die.pitch * np.array(ends)).tolist() for ends in (first, last))
    window = db.Box(x0, y0, x1, y1)
    raw = {layer: _within(read, layer, window) for layer in LAYERS}
    drawn = {layer: (region & db.Region(window)).merged() for layer, region in raw.items()}
    clear, spec, found = _clear(die, window), display.spec, display.answer.found
    cells = [(column, row) for row in range(first[1], last[1]) for column in range(first[0], last[0])]
    emitters, circuits, wires = spec.emitters, spec.circuits, spec.wires
    to_clear = dict.fromkeys(_COLOURS, emitters.gap_to_opening if emitters and "emitters" in found else 0)
    to_clear |= {"CIRCUIT": circuits.gap_to_opening if circuits and "circuits" in found else 0}
    to_clear |= dict.fromkeys(_METALS.values(), wires.clearance if wires and "wires" in found else 0)
    for layer, gap in to_clear.items():
        if not (drawn[layer].sized(to_nm(gap), _SQUARE) & clear).is_empty():
            yield f"{layer} is over what is clear, or less than {gap:g} um from it"
    if emitters is not None and "emitters" in found:
        for one, other in combinations(_COLOURS, 2):
            if not (drawn[one].sized(to_nm(emitters.colour_gap), _SQUARE) & drawn[other]).is_empty():
                yield f"{one} and {other} are less than {emitters.colour_gap:g} um apart"
        for layer, ratio in zip(_COLOURS, emitters.ratio, strict=True):
            asked = emitters.required * 3 * ratio / sum(emitters.ratio)
            least = min((drawn[layer] & db.Region(_cell(die, cell))).area() for cell in cells) / die.pitch**2
            if least < asked - 1e-9:
                yield f"{layer} covers {least:.4g} of a pixel, and {asked:.4g} are asked for"
    if circuits is not None:
        yield from _wrong_boxes(raw["CIRCUIT"], die, display, cells)
        gap = to_nm(circuits.gap)
        if gap and "circuits" in found and not drawn["CIRCUIT"].space_check(gap, False, db.Region.Square).is_empty():
            yield f"boxes of CIRCUIT are less than {circuits.gap:g} um apart"
    if wires is not None and "wires" in found:
        yield from _wrong_wires(read, die, display, drawn, window)


def _cell(die: AskedDie, cell: tuple[int, int]) -> db.Box:
    x, y = (corner + die.pitch * number for corner, number in zip(die.box[:2], cell, strict=True))
    return db.Box(x, y, x + die.pitch, y + die.pitch)


def _within(read: db.Layout, layer: str, box: db.Box) -> db.Region:
    index = read.find_layer(LAYERS[layer])
    if index is None:
        return db.Region()
    found = db.Region(db.RecursiveShapeIterator(read, read.top_cell(), index, box, False))
    found.merged_semantics = False
    return found


def _clear(die: AskedDie, box: db.Box) -> db.Region:
    """Clear parts of a die in a box, by the job."""
    left, right = np.searchsorted(die.x, (box.left, box.right))
    low, high = np.searchsorted(die.y, (box.bottom, box.top))
    row, column = np.nonzero(die.clear[low:high, left:right])
    x, y = die.x[left : right + 1], die.y[low : high + 1]
    sides = np.column_stack([x[column], y[row], x[column + 1], y[row + 1]]).tolist()
    return db.Region([db.Box(*side) for side in sides]).merged()


def _wrong_boxes(drawn: db.Region, die: AskedDie, display: Display, cells: Iterable[tuple[int, int]]) -> Iterator[str]:
    """Cells of which the boxes are not those that [circuits] lists; of a display that does not fit, some may lack."""
    circuits = display.spec.circuits
    assert circuits is not None
    wanted: Counter[tuple[int, ...]] = Counter()
    for box in circuits.boxes:
        sides = to_nm(box.width), to_nm(box.height)
        many = -(-circuits.per_pixel // display.spec.sharing) * box.count
        wanted[tuple(sorted(sides)) if circuits.turnable else sides] += many
    held: dict[tuple[int, int], Counter[tuple[int, ...]]] = {cell: Counter() for cell in cells}
    for polygon in drawn.each():
        box, centre = polygon.bbox(), polygon.bbox().center()
        cell = (centre.x - die.box[0]) // die.pitch, (centre.y - die.box[1]) // die.pitch
        if cell in held:
            upright = circuits.turnable or die.turns[cell[1], cell[0]] % 2 == 0
            sides = (box.width(), box.height()) if upright else (box.height(), box.width())
            held[cell][tuple(sorted(sides)) if circuits.turnable else sides] += polygon.is_box() or 1 << 20
    for (column, row), there in held.items():
        if there - wanted or (wanted - there and "circuits" in display.answer.found):
            yield (
                f"CIRCUIT: {(there & wanted).total()} of {wanted.total()} boxes of their sizes in cell {column}, {row}"
            )
            return


def _wrong_wires(
    read: db.Layout, die: AskedDie, display: Display, drawn: Mapping[str, db.Region], window: db.Box
) -> Iterator[str]:
    """Width and space of wires in a window, and their number across the die at three places."""
    wires = display.spec.wires
    assert wires is not None
    line, space = to_nm(wires.line), to_nm(wires.space)
    # At the window's rim lines are cut; where turned pixels meet, the middle of a line may be one nanometre off.
    inner = db.Region(window.enlarged(-(line + space)))
    opaque, (x0, y0, x1, y1) = wires.lines - (wires.transparent is not None), die.box
    for axis, layer in _METALS.items():
        if not (drawn[layer].width_check(line - 1).polygons() & inner).is_empty():
            yield f"{layer} is narrower than {wires.line:g} um"
        narrow = drawn[layer].edges().space_check(space, False, db.Region.Square)
        if not (narrow.polygons() & inner).is_empty():
            yield f"wires of {layer} are less than {wires.space:g} um apart"
        pixels, others = die.turns.shape if axis == "x" else die.turns.shape[::-1]
        for cell in sorted({0, others // 2, others - 1}):
            at = cell * die.pitch + die.pitch // 4
            strip = db.Box(x0 + at, y0, x0 + at + 2, y1) if axis == "x" else db.Box(x0, y0 + at, x1, y0 + at + 2)
            # Lines across the die may pass beside it, where nothing is clear.
            strip = strip.enlarged(*((0, die.pitch) if axis == "x" else (die.pitch, 0)))
            count = (_within(read, layer, strip) & db.Region(strip)).merged().count()
            if count < opaque * pixels:
                yield f"{layer} has {count} wires beside each other, not {opaque} for each of {pixels} pixels"
                break
    if wires.transparent is not None:
        width = to_nm(wires.transparent)
        covered = 1 - (1 - width / die.pitch) ** 2
        share = drawn["VEIL"].area() / window.area()
        if abs(share - covered) > 1e-9:
            yield f"VEIL covers {share:.4g} of pixels, and wires of {wires.transparent:g} um cover {covered:.4g}"
