"""The plate of a finished run as one page to look into: its document, and the program that draws it, in one file.

The layout is told with every cell once, placed by references, nothing flattened. Whole numbers are text: zigzag, then
seven bits a byte, lowest first, then base64. Places of violations are those of
:func:`maskfab.mask.plate_rules.write_markers`, and pictures of PSFs are taken from the page of the report.
"""

from __future__ import annotations

import base64
import json
from collections.abc import Iterable, Iterator, Mapping, Sequence
from html.parser import HTMLParser
from pathlib import Path
from types import MappingProxyType
from typing import Any

import numpy as np
from klayout import db, rdb
from markupsafe import Markup
from numpy.typing import ArrayLike

from maskfab.base.errors import OutputError
from maskfab.base.folders import PAGE, read_manifest
from maskfab.base.model import CHROME, LAYERS
from maskfab.base.provenance import sha256_of_file
from maskfab.base.resources import template
from maskfab.base.units import UM_PER_NM
from maskfab.mask.formats.content import layer_label
from maskfab.mask.formats.table import LAYOUT_SUFFIXES, read_layout, readers_of
from maskfab.mask.layout import DBU_UM, CellNames
from maskfab.report.documents.report import read_reports
from maskfab.report.documents.shape import Document, Record
from maskfab.report.pages.front import shown_dies
from maskfab.report.pages.tables import die_table
from maskfab.report.pages.template import page_template

_MOST_BYTES = 10


def packed(values: ArrayLike) -> str:
    """Text of int64 numbers of either sign; small ones take little.

    Zigzag puts signs into the lowest bit: 0, -1, 1, -2 become 0, 1, 2, 3. The highest bit of a byte says that the
    number goes on. As Protocol Buffers' ``sint64``.
    """
    signed = np.asarray(values, dtype=np.int64).reshape(-1)
    rest = ((signed << 1) ^ (signed >> 63)).view(np.uint64)
    columns = np.zeros((signed.size, _MOST_BYTES), dtype=np.uint8)
    used = np.zeros((signed.size, _MOST_BYTES), dtype=bool)
    goes_on = np.ones(signed.size, dtype=bool)
    for place in range(_MOST_BYTES):
        used[:, place] = goes_on
        columns[:, place] = (rest & np.uint64(127)).astype(np.uint8)
        rest = rest >> np.uint64(7)
        goes_on = goes_on & (rest > 0)
        columns[:, place] |= goes_on.astype(np.uint8) << 7
    return base64.b64encode(columns[used].tobytes()).decode("ascii")


_PURPOSES = {(layer.number, layer.datatype): layer for layer in (*LAYERS, CHROME)}


def drawn_cells(layout: db.Layout) -> Document:
    """Layers that hold something and the cells that the top cell reaches, children before parents.

    * ``layers``: ``name``, ``numbers``, ``purpose`` and, of layers of ours, whether the mask writer exposes them; how
      many ``drawn`` shapes every reference followed, and the ``box`` about them in nm.
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
    layers = [
        index
        for index in layout.layer_indexes()
        if not top.bbox(index).empty() or any(not cell.shapes(index).is_empty() for cell in layout.each_cell())
    ]
    infos = {index: layout.get_info(index) for index in layers}
    layers.sort(key=lambda index: (infos[index].layer, infos[index].datatype, str(infos[index].name)))
    return {
        "layers": [_layer(infos[index]) | _extent(top, index) for index in layers],
        "cells": [_cell(layout.cell(index), layers, places) for index in order],
        "top": places[top.cell_index()],
    }


def _extent(top: db.Cell, layer: int) -> Document:
    box, shapes = top.bbox(layer), db.Region(top.begin_shapes_rec(layer))
    shapes.merged_semantics = False
    return {"drawn": shapes.count(), "box": [box.left, box.bottom, box.right, box.top]}


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
    """Matrix of a reference: mirrored at the x axis, then turned and scaled."""
    sine, cosine = (scale * function(np.deg2rad(degrees)) for function in (np.sin, np.cos))
    up = -1.0 if mirrored else 1.0
    return [round(float(entry), 15) + 0.0 for entry in (cosine, sine, -sine * up, cosine * up)]


def rule_places(path: Path) -> list[Document]:
    """Rules that were broken: ``name``, ``description``, ``told`` in words, and packed ``places``.

    Places are x0, y0, x1, y1 in nm, each less the one before.

    Raises:
        OutputError: MF407 if it is no marker file.
    """
    database = rdb.ReportDatabase("places")
    try:
        database.load(str(path))
    except RuntimeError as error:
        what = f"{path} cannot be read: {error}"
        raise OutputError("MF407", what, cure="Run its job again with this version") from error
    return [_category(database, category) for category in database.each_category()]


def _category(database: rdb.ReportDatabase, category: rdb.RdbCategory) -> Document:
    sentences, boxes = [], []
    for item in database.each_item_per_category(category.rdb_id()):
        for value in item.each_value():
            if value.is_box():
                box = value.box()
                boxes.append([round(edge / DBU_UM) for edge in (box.left, box.bottom, box.right, box.top)])
            elif value.is_string():
                sentences.append(str(value.string()))
    places = np.array(boxes, dtype=np.int64).reshape(-1, 4)
    return {
        "name": str(category.name()),
        "description": str(category.description),
        "told": sentences,
        "places": packed(np.diff(places, axis=0, prepend=np.zeros((1, 4), dtype=np.int64))),
    }


_SECTION = "die-"
_WORDS = "PSF at "
_INERT = ("data:image/svg+xml,", "data:image/png;base64,", "data:image/webp;base64,")


def psf_pictures(page: str) -> dict[str, tuple[str, str]]:
    """Address and words of the first PSF of every die's section, by the die's name, if it lies in the page itself."""
    reader = _Reader()
    reader.feed(page)
    return reader.found


class _Reader(HTMLParser):
    def __init__(self) -> None:
        super().__init__()
        self.found: dict[str, tuple[str, str]] = {}
        self._die: str | None = None

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        attributes = dict(attrs)
        if tag == "section":
            name = attributes.get("id") or ""
            self._die = name.removeprefix(_SECTION) if name.startswith(_SECTION) else None
        elif tag == "img" and self._die is not None and self._die not in self.found:
            words, address = attributes.get("alt") or "", attributes.get("src") or ""
            if words.startswith(_WORDS) and address.startswith(_INERT):
                self.found[self._die] = address, words


_MARKERS = ".lyrdb"
_CELLS_FIRST = (".gds", ".oas")
"""Files in which cells are placed by references, whatever the job; others may be flat."""

MOST_BYTES = 50_000_000
"""Of a mask file of which a run writes a page by itself; asked for, one is made of any."""


def shown_run(folder: Path, beside: str | None = "", report: Record | None = None) -> Document:
    """A finished directory, its mask file read back: all that the page draws and tells.

    Args:
        beside: address of the directory from where the page will lie, "" or ending in a slash; None without links.
        report: content of report.json, if it is not that of the directory.

    Raises:
        OutputError: MF403 if it is no finished run, MF407 if a file that would be shown was changed since, MF409 if
            none of its files has polygons.
        SourceError: as :func:`maskfab.mask.formats.table.read_layout` raises it.
    """
    files = {str(row["path"]): {"format": "", **row} for row in read_manifest(folder)["files"]}
    if report is None:
        report = read_reports([folder])[0].document
    mask = mask_file(files.values())
    if mask is None:
        formats = ", ".join(dict.fromkeys(str(row["format"]) for row in files.values() if row["format"]))
        what = f"{folder} holds no mask file with polygons, only {formats or 'other files'}"
        cure = 'Add "gdsii" or "oasis" to [export] formats, and run the job again'
        raise OutputError("MF409", what, where=str(folder), cure=cure)
    page = _unchanged(folder, files[PAGE]).read_text(encoding="utf-8") if PAGE in files else ""
    for row in (mask, *(row for name, row in files.items() if name.endswith(_MARKERS))):
        _unchanged(folder, row)
    return shown_plate(folder, list(files.values()), report, page, beside)


def shown_plate(
    folder: Path,
    files: Sequence[Record],
    report: Record,
    page: str,
    beside: str | None = "",
    read: Mapping[str, db.Layout] = MappingProxyType({}),
) -> Document:
    """As :func:`shown_run`, of a directory that is still being made.

    Args:
        files: their rows, of which one is a mask file with polygons.
        beside: as of :func:`shown_run`.
        read: layouts of files that are read already, by their names.
    """
    mask = mask_file(files)
    assert mask is not None
    name = str(mask["path"])
    layout = read.get(name) or read_layout(folder / name)
    markers = [folder / str(row["path"]) for row in files if str(row["path"]).endswith(_MARKERS)]
    box = layout.top_cell().bbox()
    return {
        "title": report["title"],
        "beside": beside,
        "file": {key: mask[key] for key in ("path", "format", "bytes", "sha256")},
        "readers": readers_of(Path(name), versions=True),
        "job_hash": report["job_hash"],
        "maskfab_version": report["maskfab_version"],
        "box": [box.left, box.bottom, box.right, box.top],
        **drawn_cells(layout),
        "dies": _dies(report, layout, psf_pictures(page)),
        "rules": [rule for path in markers for rule in rule_places(path)],
        "markers": [path.name for path in markers],
    }


def mask_file(files: Iterable[Record]) -> Record | None:
    """The row of the first file with cells, else of the first with polygons; None where there is neither."""
    rows = list(files)
    of_kinds = (
        row for kinds in (_CELLS_FIRST, LAYOUT_SUFFIXES) for row in rows if Path(str(row["path"])).suffix in kinds
    )
    return next(of_kinds, None)


def _unchanged(folder: Path, row: Record) -> Path:
    """Path of a file that the manifest knows as it is."""
    path, cure = folder / str(row["path"]), "Run its job again, or put the file back as the run wrote it"
    try:
        same = sha256_of_file(path) == row["sha256"]
    except OSError as error:
        raise OutputError("MF407", f"{path} cannot be read: {error.strerror or error}", cure=cure) from error
    if not same:
        raise OutputError("MF407", f"{path} was changed since its run finished", where=str(path), cure=cure)
    return path


def _dies(report: Record, layout: db.Layout, pictures: Mapping[str, tuple[str, str]]) -> list[Document]:
    table = die_table(report)
    lines, in_report = {line.name: line for line in table.lines}, shown_dies(report)
    documents = []
    for die, box in zip(report["dies"], _boxes(report, layout), strict=True):
        line = lines[die["name"]]
        ratio = next((row["value"] for row in die["quantities"] if row["name"] == "open_ratio"), None)
        address, words = pictures.get(die["name"], (None, None))
        rows = [
            [
                "Restored PSNR" if table.level_db is None else f"PSNR, {table.level_db:g} dB of light",
                _decibels(line.psnr.text),
            ],
            ["Gain" if table.reference is None else f"Gain over {table.reference}", _decibels(line.gain.text)],
            ["Open ratio", "–" if ratio is None else f"{ratio:.4f}"],
            ["Display", line.display or "–"],
            ["Opening", die["opening"]],
            ["Tiling", die["tiling"] if die["seed"] is None else f"{die['tiling']}, seed {die['seed']}"],
            ["Pitch, µm", f"{die['pitch_um']:g}"],
            ["Cells", " × ".join(str(cell) for cell in die["cells"])],
        ]
        documents.append(
            {
                "name": die["name"],
                "label": die["label"],
                "best": line.psnr.best,
                "in_report": die["name"] in in_report,
                "box": box,
                "rows": rows,
                "psf": address,
                "psf_words": words,
            }
        )
    return documents


def _decibels(number: str) -> str:
    """A number with its unit; words as they are."""
    return f"{number} dB" if any(letter.isdigit() for letter in number) else number


def _boxes(report: Record, layout: db.Layout) -> list[list[int]]:
    """Where panels are in the file: by the reference to the die's cell, else, in a flat file, by the report."""
    names = CellNames()
    top = layout.top_cell()
    names.unique(top.name)
    corners = {reference.cell.name: (reference.trans.disp.x, reference.trans.disp.y) for reference in top.each_inst()}
    boxes = []
    for die in report["dies"]:
        size = [round(count * die["pitch_um"] / UM_PER_NM) for count in die["cells"]]
        stated = [round(middle / UM_PER_NM - length / 2) for middle, length in zip(die["centre_um"], size, strict=True)]
        x, y = corners.get(names.unique(die["name"]), stated)
        boxes.append([x, y, x + size[0], y + size[1]])
    return boxes


SCRIPTS = ("geometry.js", "paint.js", "tiles.js", "measure.js", "panel.js", "view.js")
"""The program in the order in which its parts need each other."""
_INERT_TEXT = {ord("<"): "\\u003c", ord(">"): "\\u003e", ord("&"): "\\u0026"}


def viewer_page(document: Record) -> str:
    """The page of a run, with nothing from outside it; equal documents give equal pages."""
    return page_template("view/view.html.j2").render(
        title=document["title"],
        style=Markup(template("view/view.css")),
        program=Markup("\n".join(template(f"view/{name}") for name in SCRIPTS)),
        document=Markup(inert_json(document)),
    )


def inert_json(document: object) -> str:
    """JSON that ends no element of a page, whatever names it holds."""
    return json.dumps(document, allow_nan=False, separators=(",", ":")).translate(_INERT_TEXT)
