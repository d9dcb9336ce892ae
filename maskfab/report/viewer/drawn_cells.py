"""A layout as a document that a page can draw: every cell once, placed by references, nothing flattened."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any, TypeAlias

import numpy as np
from klayout import db

from maskfab.model import CHROME, LAYERS
from maskfab.readers.layout_file import layer_label
from maskfab.report.viewer.varints import packed

Document: TypeAlias = dict[str, Any]

_PURPOSES = {(each.number, each.datatype): each for each in (*LAYERS, CHROME)}


def drawn_cells(layout: db.Layout) -> Document:
    """Layers that hold something and the cells that the top cell reaches, children before parents.

    * ``layers``: ``name``, ``numbers``, ``purpose`` and, of layers of ours, whether the mask writer exposes them.
    * ``cells``: ``name``; ``shapes``, for each layer by its place in ``layers`` packed numbers: of every polygon how
      many contours it has, of every contour how many vertices, then their steps in nm, hull first; ``groups`` of
      references alike: place of the cell, ``turn`` (a, b, c, d: x' = a x + c y, y' = b x + d y), ``steps`` and
      ``counts`` of an array, and packed steps from origin to origin; ``texts``: layer, x, y, words.
    * ``top``: place of the top cell, the last.

    Args:
        layout: its database unit is 1 nm.
    """
    top = layout.top_cell()
    reached = {top.cell_index(), *top.called_cells()}
    order = [index for index in layout.each_cell_bottom_up() if index in reached]
    places = {index: place for place, index in enumerate(order)}
    layers = [index for index in layout.layer_indexes() if not top.bbox(index).empty() or _has_texts(layout, index)]
    layers.sort(key=lambda index: _sorted_by(layout.get_info(index)))
    return {
        "layers": [_layer(layout.get_info(index)) for index in layers],
        "cells": [_cell(layout.cell(index), layers, places) for index in order],
        "top": places[top.cell_index()],
    }


def _has_texts(layout: db.Layout, index: int) -> bool:
    return any(not cell.shapes(index).is_empty() for cell in layout.each_cell())


def _sorted_by(info: db.LayerInfo) -> tuple[int, int, str]:
    return info.layer, info.datatype, str(info.name)


def _layer(info: db.LayerInfo) -> Document:
    ours = _PURPOSES.get((info.layer, info.datatype))
    return {
        "name": ours.name if ours else str(info.name) or layer_label(info),
        "numbers": f"{info.layer}/{info.datatype}" if info.layer >= 0 else "",
        "purpose": ours.purpose if ours else "",
        "written": bool(ours and ours.written),
    }


def _cell(cell: db.Cell, layers: list[int], places: dict[int, int]) -> Document:
    shapes = {place: _contours(cell.shapes(index)) for place, index in enumerate(layers)}
    return {
        "name": str(cell.name),
        "shapes": [[place, packed(numbers)] for place, numbers in shapes.items() if numbers],
        "groups": list(_groups(cell, places)),
        "texts": [
            [place, text.text_trans.disp.x, text.text_trans.disp.y, str(text.text_string)]
            for place, index in enumerate(layers)
            for text in cell.shapes(index).each(db.Shapes.STexts)
        ],
    }


def _contours(shapes: db.Shapes) -> list[int]:
    numbers: list[int] = []
    x = y = 0
    for shape in shapes.each(db.Shapes.SPolygons | db.Shapes.SBoxes | db.Shapes.SPaths):
        polygon = shape.polygon
        numbers.append(polygon.holes() + 1)
        for contour in _each_contour(polygon):
            numbers.append(len(contour))
            for point in contour:
                numbers += (point.x - x, point.y - y)
                x, y = point.x, point.y
    return numbers


def _each_contour(polygon: db.Polygon) -> Iterator[list[db.Point]]:
    yield list(polygon.each_point_hull())
    for hole in range(polygon.holes()):
        yield list(polygon.each_point_hole(hole))


def _groups(cell: db.Cell, places: dict[int, int]) -> Iterator[Document]:
    """References of one cell, turned and repeated alike, in the order of the file."""
    groups: dict[tuple[Any, ...], list[tuple[int, int]]] = {}
    for reference in cell.each_inst():
        turned = reference.cplx_trans
        key = (
            places[reference.cell_index],
            (turned.angle, turned.is_mirror(), turned.mag),
            ((reference.a.x, reference.a.y), (reference.b.x, reference.b.y)),
            (max(reference.na, 1), max(reference.nb, 1)),
        )
        groups.setdefault(key, []).append((round(turned.disp.x), round(turned.disp.y)))
    for (place, turn, steps, counts), origins in groups.items():
        yield {
            "cell": place,
            "turn": _matrix(*turn),
            "steps": steps,
            "counts": counts,
            "at": packed(np.diff(np.array(origins, dtype=np.int64), axis=0, prepend=0)),
        }


def _matrix(degrees: float, mirrored: bool, scale: float) -> list[float]:
    """Of a reference: mirrored at the x axis, then turned and scaled."""
    sine, cosine = (scale * each(np.deg2rad(degrees)) for each in (np.sin, np.cos))
    up = -1.0 if mirrored else 1.0
    return [round(float(each), 15) + 0.0 for each in (cosine, sine, -sine * up, cosine * up)]
