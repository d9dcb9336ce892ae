"""The judge on trial: known faults planted in copies of a file that it has passed, each of which it must name.

A judge that has gone blind passes everything, and its word is then worth nothing. Faults are drawn into the layout as
it was read, reduced to its smallest die and all marks so that they cost little, and judged as any file is. A row of the
judgement that is missing is a fault like any other: the last one planted drops a row and asks :func:`missing` for it.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterable, Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np
from klayout import db

from maskfab.base.model import Quantity
from maskfab.mask.judge.displays import LAYERS as OF_DISPLAY
from maskfab.mask.judge.marks import Code
from maskfab.mask.judge.verdict import LAYERS, Asked, judged, line_box

_CLEAR, _CUT, _CHROME = LAYERS
_OF_PLATE = ("judged_marks", "judged_text")
PLANTED = "judged_planted"
"""The row on how the judge stood its trial."""


def missing(
    rows: Iterable[Quantity], files: Iterable[str], dies: Sequence[str], shown: Collection[str] = ()
) -> tuple[str, ...]:
    """Rows that the judge owes for layout files and does not give: of every die, of marks, and of text.

    Args:
        rows: that it gives.
        shown: those of the files that show displays, for which it owes a row on that of every die.
    """
    given = {(row.method.partition(":")[0], row.name, row.die) for row in rows}
    owed = [("judged_die", die) for die in dies] + [(name, None) for name in _OF_PLATE]
    further = [("judged_display", die) for die in dies]
    return tuple(
        f"{file}: {name}{'' if die is None else f' of {die}'}"
        for file in files
        for name, die in (*owed, *(further if file in shown else ()))
        if (file, name, die) not in given
    )


@dataclass(frozen=True, eq=False)
class _Fault:
    """A change of drawn shapes, the row that has to fail, and a word that this has to say."""

    name: str
    change: Callable[[db.Layout], None]
    row: str
    said: str = ""


def planted(read: db.Layout, name: str, plate: Asked) -> Quantity:
    """The number of planted faults that the judge has caught.

    Args:
        read: a layout file, as :func:`maskfab.mask.judge.verdict.judged` takes it.
    """
    shown = [number for number, display in enumerate(plate.displays) if display.shown]
    least = min(shown or range(len(plate.dies)), key=lambda number: plate.dies[number].clear.size)
    displays = tuple(display.wires_or_emitters for display in plate.displays[least : least + 1])
    small = replace(plate, dies=(plate.dies[least],), displays=displays)
    drawn = _reduced(read, plate, least, [layer for display in displays for layer in display.shown])
    names, missed = [], []
    # Faults that different words tell of share a copy.
    waiting = list(_faults(small))
    while waiting:
        copy = list({(fault.row, fault.said): fault for fault in reversed(waiting)}.values())
        waiting = [fault for fault in waiting if fault not in copy]
        changed = drawn.dup()
        for fault in copy:
            fault.change(changed)
        # Displays cost most, and what is done to openings says nothing of them.
        looked = any(fault.row == "judged_display" for fault in copy)
        rows = judged(changed, name, small if looked else replace(small, displays=()))
        names += [fault.name for fault in copy]
        missed += [
            fault.name
            for fault in copy
            if not any(row.name == fault.row and not row.passed and fault.said in row.method for row in rows)
        ]
    names.append("a row of the judgement dropped")
    if missing(rows[:-1], [name], [small.dies[0].name]) != (f"{name}: {rows[-1].name}",):
        missed.append(names[-1])
    said = f"; not caught: {', '.join(missed)}" if missed else ""
    method = f"planted in copies of {name} in memory: {', '.join(names)}{said}"
    return Quantity(PLANTED, len(names) - len(missed), method, limit=len(names), passed=not missed)


def _reduced(read: db.Layout, plate: Asked, least: int, shown: Iterable[str]) -> db.Layout:
    """The plate without its other dies, in one cell, and of the display some layers."""
    others = db.Region([db.Box(*die.box) for number, die in enumerate(plate.dies) if number != least])
    places = db.Region(read.top_cell().bbox()) - others
    reduced = db.Layout()
    reduced.dbu = read.dbu
    top = reduced.create_cell("TOP")
    for layer in (*LAYERS, *(OF_DISPLAY[name] for name in shown)):
        index = read.find_layer(layer)
        if index is None:
            continue
        if layer not in LAYERS:
            own = db.Box(*plate.dies[least].box)
            top.shapes(reduced.layer(layer)).insert(db.RecursiveShapeIterator(read, read.top_cell(), index, own, True))
            continue
        found = db.Region(db.RecursiveShapeIterator(read, read.top_cell(), index, places, True))
        found.merged_semantics = False
        # Of chrome nothing may lack where the other dies were: the reduced plate has no openings there.
        shapes = found - others + others if layer == _CHROME else found.outside(others)
        if not shapes.is_empty():
            top.shapes(reduced.layer(layer)).insert(shapes)
    return reduced


def _faults(plate: Asked) -> Iterator[_Fault]:
    """Faults that a plate of one die has room for."""
    die, half = plate.dies[0], plate.bias // 2
    if (place := _turning(plate)) is not None:
        yield _Fault("a cell turned", _turned(db.Box(*place), db.Trans.R90), "judged_die")
    ends = np.argwhere(die.clear[:, :-1] & ~die.clear[:, 1:])
    if len(ends):
        row, column = ends[len(ends) // 2]
        x, low, high = int(die.x[column + 1]) - half, int(die.y[row]) + abs(half), int(die.y[row + 1]) - abs(half)
        if low < high:
            yield _Fault("an edge moved by 1 nm", _toggled(db.Box(x, low, x + 1, high)), "judged_die")
    for layer in [layer for display in plate.displays for layer in display.shown][:1]:
        what = "a wire" if layer not in ("RED", "GREEN", "BLUE") else "an emitter"
        yield _Fault(f"{what} moved by 1 nm", _display_moved(layer), "judged_display", layer)
    for mark in [mark for mark in plate.marks if mark.name == "PARITY"][:1]:
        box = db.Box(*(int(side) for side in mark.box)).enlarged(abs(half) + 1, abs(half) + 1)
        yield _Fault(f"{mark.name} mirrored", _turned(box, db.Trans.M90), "judged_marks", mark.name)
    for code in plate.codes:
        yield _Fault("a module of the code flipped", _toggled(_module(code, plate)), "judged_text", code.name)
    for line in plate.lines[:1]:
        box = db.Box(*line_box(replace(line, text=line.text[:1]), plate))
        yield _Fault(f"a letter of {line.name} blotted", _blotted(box, dark=plate.dark), "judged_text", line.name)


def _display_moved(layer: str) -> Callable[[db.Layout], None]:
    """The first shape on a layer of the display, moved to the right by a nanometre."""

    def changed(layout: db.Layout) -> None:
        shapes = layout.top_cell().shapes(layout.layer(OF_DISPLAY[layer]))
        shape = next(shapes.each())
        moved = shape.polygon.moved(1, 0)
        shapes.erase(shape)
        shapes.insert(moved)

    return changed


def _turning(plate: Asked) -> tuple[int, int, int, int] | None:
    """A square of a die that holds another picture when it is turned by 90 degrees; None if there is none."""
    die = plate.dies[0]
    x0, y0, x1, y1 = die.box
    for row in range((y1 - y0) // die.pitch):
        for column in range((x1 - x0) // die.pitch):
            left, low = x0 + column * die.pitch, y0 + row * die.pitch
            i, j = (np.searchsorted(lines, start) for lines, start in ((die.x, left), (die.y, low)))
            k, m = (np.searchsorted(lines, end) for lines, end in ((die.x, left + die.pitch), (die.y, low + die.pitch)))
            clear = die.clear[j:m, i:k]
            if clear.shape[0] == clear.shape[1] and not np.array_equal(clear, np.rot90(clear)):
                return left, low, left + die.pitch, low + die.pitch
    return None


def _module(code: Code, plate: Asked) -> db.Box:
    """The middle half of the module right above the code's middle, which no bar and no bias reaches."""
    (x, y), side = code.centre, code.module
    ends = plate.on_plate(np.array([x + side // 4, x + side - side // 4]), across=True)
    return db.Box(int(ends.min()), y + side // 4, int(ends.max()), y + side - side // 4)


def _toggled(box: db.Box) -> Callable[[db.Layout], None]:
    return _changed(box, lambda inside: inside ^ db.Region(box))


def _blotted(box: db.Box, *, dark: bool) -> Callable[[db.Layout], None]:
    return _changed(box, lambda inside: db.Region(box) if dark else db.Region())


def _turned(box: db.Box, how: int) -> Callable[[db.Layout], None]:
    """Shapes of a box turned or mirrored, and put back into it."""
    turn = db.Trans(how, 0, 0)
    ends = db.Region(box).transformed(turn).bbox()
    return _changed(box, lambda inside: inside.transformed(turn).moved(box.left - ends.left, box.bottom - ends.bottom))


def _changed(box: db.Box, change: Callable[[db.Region], db.Region]) -> Callable[[db.Layout], None]:
    """A change of what counts in a box: what is drawn there, less what a layer of holes takes out of it."""
    place = db.Region(box)

    def changed(layout: db.Layout) -> None:
        net = db.Region()
        for layer in (_CLEAR, _CHROME, _CUT):
            index = layout.find_layer(layer)
            if index is None:
                continue
            drawn = layout.top_cell().shapes(index)
            touching = list(drawn.each_touching(box))
            near = db.Region([shape.polygon for shape in touching])
            for shape in touching:
                drawn.erase(shape)
            drawn.insert(near - place)
            net = net - near if layer == _CUT else net + (near & place)
        main = layout.find_layer(_CHROME)
        layout.top_cell().shapes(layout.layer(_CLEAR) if main is None else main).insert(change(net.merged()))

    return changed
