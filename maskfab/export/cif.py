"""CIF 2.0, the Caltech Intermediate Form: symbols of polygons, and calls that place them.

C. Mead, L. Conway: Introduction to VLSI Systems (1980), section 4.5. Its unit of 10 nm is scaled by 1/10 in every
symbol, so that coordinates are whole nanometres. A layer's name has at most four letters and digits: L and its number.
Symbols have names by the user extension 9, which every reader of today knows. The format has no arrays.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import chain, count
from pathlib import Path

from maskfab.export.cell_polygons import Figures, Shapes, as_figures
from maskfab.export.polygon_text import Placeholder, filled, polygon_lines
from maskfab.export.size import check_file_size
from maskfab.files.atomic import partial
from maskfab.geometry.cell_grid import CellArray
from maskfab.model import Layer, Plate, Point, Polygon

LARGEST_BYTES = 1_000_000_000

_SCALE = "1 10"
_HEAD_BYTES = 2_000
_OUTLINE_BYTES = 3
_VERTEX_BYTES = 22
_CALL_BYTES = 34


def write_cif(
    source: Plate | Figures, path: Path, comments: Sequence[str] = (), *, limit_bytes: int = LARGEST_BYTES
) -> None:
    """Write a plate with all its layers as CIF, byte-identical between runs; notes that are text are left out.

    Args:
        source: what to draw, or how it was drawn.
        path: the file to write.
        comments: lines before what the figures' account has to say.
        limit_bytes: size beyond which nothing is written.

    Raises:
        OutputError: MF401 if the file cannot be written, MF415 if it would be too large.
    """
    figures = as_figures(source)
    check_file_size(cif_bytes(figures), limit_bytes, path, 'Choose hierarchy = "cells", or GDSII or OASIS')
    with partial(path) as aside, aside.open("w", encoding="ascii", newline="\n") as file:
        file.writelines(chain(_head(figures, comments), _symbols(figures)))


def cif_bytes(figures: Figures) -> int:
    """About how large the file becomes, from above."""
    account = figures.account
    calls = sum(grid.index.size for die in figures.dies for grid in die.grids)
    drawn = _OUTLINE_BYTES * account.polygons + _VERTEX_BYTES * account.vertices
    if figures.options.hierarchy == "cells":
        once = [polygon for shapes in figures.cells.values() for each in shapes.values() for polygon in each]
        marks = [polygon for mark in figures.marks for each in mark.shapes.values() for polygon in each]
        drawn = sum(_OUTLINE_BYTES + _VERTEX_BYTES * len(polygon) for polygon in (*once, *marks)) + _CALL_BYTES * calls
    return _HEAD_BYTES + drawn


def layer_name(layer: Layer) -> str:
    """The layer's name in CIF."""
    return f"L{layer.number}"


def _head(figures: Figures, comments: Sequence[str]) -> Iterator[str]:
    layers = ", ".join(f"{layer_name(layer)} is {layer.name}" for layer in figures.layers)
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


def _symbols(figures: Figures) -> Iterator[str]:
    numbers, pen = count(1), _Pen()
    top: list[str] = []
    if figures.options.hierarchy == "cells":
        placed: dict[str, int] = {}
        for name, shapes in figures.cells.items():
            placed[name] = next(numbers)
            yield from _symbol(placed[name], name, _drawn(shapes, pen))
        for die in figures.dies:
            number = next(numbers)
            yield from _symbol(number, die.name, chain.from_iterable(_calls(grid, placed) for grid in die.grids))
            top.append(_call(number, die.origin_nm))
        for mark in figures.marks:
            number = next(numbers)
            yield from _symbol(number, mark.name, _drawn(mark.shapes, pen))
            top.append(_call(number, (0, 0)))
    number = next(numbers)
    yield from _symbol(number, figures.top, chain(top, _flat(figures, pen)))
    # What no command outside of symbols calls is defined, and not drawn.
    yield f"C {number};\nE\n"


def _symbol(number: int, name: str, content: Iterator[str]) -> Iterator[str]:
    yield f"DS {number} {_SCALE};\n9 {name};\n"
    yield from content
    yield "DF;\n"


def _drawn(shapes: Shapes, pen: _Pen) -> Iterator[str]:
    for layer, polygons in shapes.items():
        yield f"L {layer_name(layer)};\n"
        yield from (filled(pen, polygon) for polygon in polygons)


def _flat(figures: Figures, pen: _Pen) -> Iterator[str]:
    """Polygons of the top symbol itself: none where there are others."""
    if figures.options.hierarchy == "cells":
        return
    for layer in figures.layers:
        yield f"L {layer_name(layer)};\n"
        yield from polygon_lines(figures, layer, pen)


def _calls(grid: CellArray, placed: dict[str, int]) -> Iterator[str]:
    (x0, y0), (dx, dy) = grid.origin_nm, grid.step_nm
    calls = [f"C {placed[name]} T " for name in grid.cells]
    columns = [f"{x0 + column * dx} " for column in range(grid.index.shape[1])]
    for row, kinds in enumerate(grid.index.tolist()):
        end = f"{y0 + row * dy};\n"
        yield "".join(calls[kind] + x + end for kind, x in zip(kinds, columns, strict=True))


def _call(number: int, origin_nm: Point) -> str:
    x, y = origin_nm
    return f"C {number} T {x} {y};\n" if x or y else f"C {number};\n"


@dataclass(frozen=True)
class _Pen:
    """Writes polygons, which close themselves."""

    def outline(self, polygon: Polygon) -> tuple[str, list[Placeholder]]:
        gaps = [gap for x, y in polygon for gap in (Placeholder("x", x), Placeholder("y", y))]
        return f"P{' %s' * len(gaps)};\n", gaps

    def number(self, nm: int) -> str:
        return str(nm)

    def serial(self) -> str:
        raise NotImplementedError("polygons have no numbers")
