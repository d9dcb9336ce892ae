"""An SVG of ours as a layout, by the XML it is made of: symbols become cells, their uses references."""

from __future__ import annotations

import os
import re
from collections.abc import Iterator
from decimal import Decimal, InvalidOperation
from pathlib import Path
from xml.etree import ElementTree

from klayout import db

from maskfab.errors import SourceError
from maskfab.geometry.plate_layout import DBU_UM, layer_info
from maskfab.model import CHROME, LAYERS
from maskfab.units import NM_PER_MM

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
        raise SourceError(
            "MF301", f"there is no file {path.name}", where=str(path), cure="Give the path of an existing file"
        )
    try:
        return _layout(ElementTree.parse(path).getroot(), path)
    except (ElementTree.ParseError, InvalidOperation, AttributeError, LookupError, ValueError, TypeError) as error:
        raise SourceError(
            "MF303",
            f"{path.name} is not an SVG of a plate: {error!r}",
            where=str(path),
            cure="Run the job again to rewrite it",
        ) from error


def _layout(root: ElementTree.Element, path: Path) -> db.Layout:
    layout = db.Layout()
    layout.dbu = DBU_UM
    top = layout.create_cell("PICTURE")
    outer = root.find(f"{_SVG}g")
    if outer is None:
        raise ValueError("no group")
    _check_frame(root, outer)
    symbols = {str(each.get("id")): each for each in root.iter(f"{_SVG}symbol")}
    known = {layer.name: layer for layer in (*LAYERS, CHROME)}
    cells: dict[tuple[str, str], int] = {}
    for group in outer.findall(f"{_SVG}g"):
        name = str(group.get("id"))
        if name not in known:
            raise ValueError(f"a group {name!r}")
        layer = layout.layer(layer_info(known[name]))
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
    if any(each.get("transform") is not None for each in root.iter() if each is not outer):
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
        raise SourceError(
            "MF303",
            f"{path.name} has {value} mm, off the grid of 1 nm",
            where=str(path),
            cure="Run the job again to rewrite it",
        )
    if abs(exact) > _FARTHEST_NM:
        raise ValueError(f"a coordinate of {value} mm")
    return int(exact)
