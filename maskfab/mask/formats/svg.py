"""SVG: a picture of a die or a plate that is exact, with one symbol for each unit cell.

One unit is one millimetre and six decimals are nanometres. y points up inside one group that is mirrored, so that
coordinates are those of the plate (W3C, SVG 1.1, chapters 5 and 7). Only pictures of
ours are read back, by the XML that they are made of: symbols become cells, their uses references.
"""

from __future__ import annotations

import os
import re
from collections.abc import Iterator, Sequence
from decimal import Decimal, InvalidOperation
from itertools import chain
from pathlib import Path
from xml.etree import ElementTree

from klayout import db

from maskfab.base.errors import SourceError
from maskfab.base.files import partial
from maskfab.base.model import CHROME, LAYERS, Box, Layer, Plate, Polygon
from maskfab.base.units import NM_PER_MM
from maskfab.mask.figures import CUT, DieFigures, Figures, as_figures
from maskfab.mask.formats.format import Format
from maskfab.mask.layout import DBU_UM, CellArray, check_file_size, layer_info
from maskfab.mask.outlines import hull_points
from maskfab.mask.sandbox import missing

_SVG = "{http://www.w3.org/2000/svg}"
_LINK = "{http://www.w3.org/1999/xlink}href"
_FARTHEST_NM = 2**31 - 1
_FLIPPED = [Decimal(value) for value in (1, 0, 0, -1)]


def read_svg(path: Path) -> db.Layout:
    """The polygons of a plate's SVG in plate coordinates, a group of the picture on the layer of its name.

    Raises:
        SourceError: MF301 missing, MF303 not an SVG of this kind, or off the grid of 1 nm.
    """
    if not os.path.isfile(path):
        raise missing(path)
    try:
        return _layout(ElementTree.parse(path).getroot(), path)
    except (ElementTree.ParseError, InvalidOperation, AttributeError, LookupError, ValueError, TypeError) as error:
        what = f"{path.name} is not an SVG of a plate: {error!r}"
        raise SourceError("MF303", what, where=str(path), cure="Run the job again to rewrite it") from error


def _layout(root: ElementTree.Element, path: Path) -> db.Layout:
    layout = db.Layout()
    layout.dbu = DBU_UM
    top = layout.create_cell("PICTURE")
    outer = root.find(f"{_SVG}g")
    if outer is None:
        raise ValueError("no group")
    _check_frame(root, outer)
    symbols = {str(symbol.get("id")): symbol for symbol in root.iter(f"{_SVG}symbol")}
    layers = {layer.name: layer for layer in (*LAYERS, CHROME)}
    cells: dict[tuple[str, str], int] = {}
    for group in outer.findall(f"{_SVG}g"):
        name = str(group.get("id"))
        if name not in layers:
            raise ValueError(f"a group {name!r}")
        layer = layout.layer(layer_info(layers[name]))
        for element in group:
            if element.tag != f"{_SVG}use":
                _draw(element, top.shapes(layer), path)
                continue
            key = name, str(element.get(_LINK))[1:]
            if key not in cells:
                cell = layout.create_cell(f"{name}_{len(cells)}")
                for shape in symbols[key[1]]:
                    _draw(shape, cell.shapes(layer), path)
                cells[key] = cell.cell_index()
            place = db.Trans(_nm(element.get("x"), path), _nm(element.get("y"), path))
            top.insert(db.CellInstArray(cells[key], place))
    return layout


def _check_frame(root: ElementTree.Element, outer: ElementTree.Element) -> None:
    """Only what is drawn in millimetres from the middle of the picture, y upwards, is where its numbers say."""
    turn = [Decimal(value) for value in re.findall(r"[-\d.]+", str(outer.get("transform")))]
    if turn[:4] != _FLIPPED:
        raise ValueError("its y axis is not turned upwards")
    left, top, width, height = (Decimal(value) for value in str(root.get("viewBox")).split())
    if left or top or turn[4:] != [width / 2, height / 2]:
        raise ValueError("its origin is not in the middle of the picture")
    if (root.get("width"), root.get("height")) != (f"{width}mm", f"{height}mm"):
        raise ValueError("its unit is not 1 mm")
    if any(part.get("transform") is not None for part in root.iter() if part is not outer):
        raise ValueError("a part of it is transformed")


def _draw(element: ElementTree.Element, shapes: db.Shapes, path: Path) -> None:
    for points in _outlines(str(element.get("d"))):
        shapes.insert(db.SimplePolygon([db.Point(_nm(x, path), _nm(y, path)) for x, y in points], True))


def _outlines(data: str) -> Iterator[list[tuple[Decimal, Decimal]]]:
    """Closed outlines of a path's data, in millimetres."""
    x = y = Decimal(0)
    *closed, rest = data.split("Z")
    if rest.strip():
        raise ValueError("an open outline")
    for outline in closed:
        points = []
        for letter, numbers in re.findall(r"([A-Za-z])([^A-Za-z]*)", outline):
            values = [Decimal(number) for number in numbers.split()]
            if letter == "H":
                (x,) = values
            elif letter == "V":
                (y,) = values
            elif letter in "ML":
                x, y = values
            else:
                raise ValueError(f"a command {letter!r}")
            points.append((x, y))
        yield points


def _nm(value: Decimal | str | None, path: Path) -> int:
    exact = Decimal(value if value is not None else 0) * NM_PER_MM
    if exact % 1:
        what = f"{path.name} has {value} mm, off the grid of 1 nm"
        raise SourceError("MF303", what, where=str(path), cure="Run the job again to rewrite it")
    if abs(exact) > _FARTHEST_NM:
        raise ValueError(f"a coordinate of {value} mm")
    return int(exact)


LARGEST_BYTES = 500_000_000

_HEAD_BYTES = 4_000
_USE_BYTES = 80
_VERTEX_BYTES = 14
_CLEAR, _CHROME = "#ffffff", "#303030"


def write_svg(
    source: Plate | Figures,
    path: Path,
    comments: Sequence[str] = (),
    *,
    die: str | None = None,
    limit_bytes: int = LARGEST_BYTES,
) -> None:
    """Write a plate, or one of its dies alone, as SVG in its true size; byte-identical between runs.

    Chrome is dark, what is exposed is white, holes that have a layer of their own are dark again on top of it. Merged
    figures are joined across pixels and belong to no die.

    Raises:
        OutputError: MF401 if the file cannot be written, MF415 if it would be too large.
    """
    figures = as_figures(source)
    chosen = None if die is None else _die(figures, die)
    check_file_size(svg_bytes(figures, die), limit_bytes, path, 'Choose hierarchy = "cells", or GDSII or OASIS')
    with partial(path) as aside, aside.open("w", encoding="utf-8", newline="\n") as file:
        file.writelines(_document(figures, chosen, comments))


def svg_bytes(figures: Figures, die: str | None = None) -> int:
    """About how large the file becomes."""
    dies = figures.dies if die is None else (_die(figures, die),)
    uses = sum(grid.index.size for item in dies for grid in item.grids)
    drawn = sum(len(polygon) for shapes in figures.cells.values() for item in shapes.values() for polygon in item)
    merged = figures.account.vertices if figures.merged else 0
    return _HEAD_BYTES + uses * _USE_BYTES + (drawn + merged) * _VERTEX_BYTES


def _die(figures: Figures, name: str) -> DieFigures:
    names = [die.name for die in figures.plate.dies]
    if name not in names:
        raise KeyError(f"no die {name!r} on the plate {figures.plate.name!r}")
    return figures.dies[names.index(name)]


def _document(figures: Figures, die: DieFigures | None, comments: Sequence[str]) -> Iterator[str]:
    plate = figures.plate
    half = plate.blank_nm // 2
    box = die.box_nm if die else (-half, -half, half, half)
    width, height = box[2] - box[0], box[3] - box[1]
    said = [*comments, *figures.account.lines(), "1 unit = 1 mm; white is clear in the chrome"]
    title = f"{plate.title}: {die.name}" if die else plate.title
    yield '<?xml version="1.0" encoding="UTF-8"?>\n'
    yield (
        '<svg xmlns="http://www.w3.org/2000/svg" xmlns:xlink="http://www.w3.org/1999/xlink" version="1.1" '
        f'width="{_mm(width)}mm" height="{_mm(height)}mm" viewBox="0 0 {_mm(width)} {_mm(height)}">\n'
    )
    yield f"<title>{_safe(title)}</title>\n<desc>{_safe(chr(10).join(said))}</desc>\n"
    written, dark = figures.options.layer, figures.options.tone == "dark"
    colours = {written: _CHROME, CUT: _CLEAR} if dark else {written: _CLEAR, CUT: _CHROME}
    layers = [layer for layer in (written, CUT) if layer in figures.layers]
    dies = (die,) if die else figures.dies
    used = dict.fromkeys(name for item in dies for grid in item.grids for name in grid.cells)
    yield "<defs>\n"
    for layer in layers:
        for name in used:
            polygons = figures.cells[name].get(layer, ())
            if polygons:
                path = "".join(map(_path, polygons))
                yield f'<symbol id={_id(name, layer)} overflow="visible"><path d="{path}"/></symbol>\n'
    yield "</defs>\n"
    yield f'<rect width="{_mm(width)}" height="{_mm(height)}" fill="{_CLEAR if dark else _CHROME}"/>\n'
    yield f'<g transform="matrix(1 0 0 -1 {_mm(-box[0])} {_mm(box[3])})">\n'
    for layer in layers:
        yield f'<g id="{layer.name}" fill="{colours[layer]}">\n'
        for item in dies:
            for grid in item.grids:
                yield from _uses(figures, layer, item, grid)
        yield from _loose(figures, layer, box if die else None)
        yield "</g>\n"
    yield "</g>\n</svg>\n"


def _uses(figures: Figures, layer: Layer, die: DieFigures, grid: CellArray) -> Iterator[str]:
    (dx, dy), x0, y0 = grid.step_nm, die.origin_nm[0] + grid.origin_nm[0], die.origin_nm[1] + grid.origin_nm[1]
    # SVG 1.1 readers know the link under its older name only, and those of SVG 2 know both.
    heads = [
        f'<use xlink:href="#{_bare(name, layer)}"' if figures.cells[name].get(layer) else None for name in grid.cells
    ]
    columns = [_mm(x0 + column * dx) for column in range(grid.index.shape[1])]
    for row, kinds in enumerate(grid.index.tolist()):
        y = _mm(y0 + row * dy)
        texts = (f'{heads[kind]} x="{columns[column]}" y="{y}"/>\n' for column, kind in enumerate(kinds) if heads[kind])
        yield "".join(texts)


def _loose(figures: Figures, layer: Layer, box: Box | None) -> Iterator[str]:
    """Marks and what is joined across pixels, of a die only what lies in its box."""
    if box is None:
        for mark in figures.marks:
            polygons = mark.shapes.get(layer, ())
            if polygons:
                yield f'<path id={_id(mark.name, layer)} d="{"".join(map(_path, polygons))}"/>\n'
    if layer not in figures.merged:
        return
    outlines: Iterator[Polygon] = map(hull_points, figures.merged[layer].each())
    inside = outlines if box is None else (outline for outline in outlines if _within(outline, box))
    first = next(inside, None)
    if first is not None:
        yield '<path d="'
        yield from map(_path, chain((first,), inside))
        yield '"/>\n'


def _within(polygon: Polygon, box: Box) -> bool:
    return all(box[0] <= x <= box[2] and box[1] <= y <= box[3] for x, y in polygon)


def _path(polygon: Polygon) -> str:
    (x, y), texts = polygon[0], [f"M{_mm(polygon[0][0])} {_mm(polygon[0][1])}"]
    for next_x, next_y in polygon[1:]:
        if next_y == y:
            texts.append(f"H{_mm(next_x)}")
        elif next_x == x:
            texts.append(f"V{_mm(next_y)}")
        else:
            texts.append(f"L{_mm(next_x)} {_mm(next_y)}")
        x, y = next_x, next_y
    return "".join([*texts, "Z"])


def _mm(nm: int) -> str:
    whole, rest = divmod(abs(nm), NM_PER_MM)
    sign = "-" if nm < 0 else ""
    return f"{sign}{whole}.{rest:06d}".rstrip("0").rstrip(".")


def _bare(name: str, layer: Layer) -> str:
    return name if layer is not CUT else f"{name}.{layer.name}"


def _id(name: str, layer: Layer) -> str:
    from xml.sax.saxutils import quoteattr  # loads all of urllib

    return quoteattr(_bare(name, layer))


def _safe(text: str) -> str:
    """The text escaped, without the control characters that XML forbids."""
    from xml.sax.saxutils import escape

    return escape("".join(letter if letter.isprintable() or letter == "\n" else " " for letter in text))


FORMATS = (
    Format(
        "svg",
        "SVG",
        ".svg",
        write_plate=lambda of, to: write_svg(of.figures, to, of.comments),
        read=read_svg,
        layers="one",
    ),
)
