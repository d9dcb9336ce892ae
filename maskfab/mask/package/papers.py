"""Papers of a package, made from its job and profile: the order sheet, which fills in the house's form as far as the
design determines it, a drawing with dimensions, marks and a die map without dates, and the certificate; and whether a
package holds just those."""

from __future__ import annotations

import csv
import hashlib
import io
import json
import math
import pathlib
import re
import textwrap
from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass
from html import escape
from typing import Any, Literal, get_args

import matplotlib as mpl
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import PathPatch, Rectangle
from matplotlib.path import Path

from maskfab.base import __version__, resources
from maskfab.base.folders import JOB_COPY, RESULT_MARK
from maskfab.base.model import Gauge, Plate, Polygon, Quantity, WrittenFile
from maskfab.base.quantities import columns
from maskfab.base.units import NM_PER_MM, NM_PER_UM, UM_PER_INCH
from maskfab.job.shop import OrderField, Shop, dump_shop
from maskfab.job.values import PLATE_BITMAPS, ShopFormat
from maskfab.mask.figures import CUT, Figures
from maskfab.mask.formats.table import readers_of
from maskfab.mask.houses.adaptation import kept_grid_nm
from maskfab.mask.houses.files import DotEdges
from maskfab.mask.houses.findings import Finding
from maskfab.mask.houses.order import Order, order_of
from maskfab.mask.houses.profiles import load_shop, shop_names, shop_of
from maskfab.mask.job import Job
from maskfab.mask.outlines import text_polygons
from maskfab.mask.plate_rules import Smallest, smallest_of_plate


def printable(text: str) -> str:
    """The text with a space for every control character: no font has them, XML forbids them, PDFs fail over them."""
    return "".join(letter if letter.isprintable() else " " for letter in text)


_INK, _QUIET, _CHROME, _CLEAR = "#1f2328", "#7a828c", "#d9dde2", "#ffffff"
_MOST_ROWS = 36
_LINE = 84
_WIDTH_IN, _HEIGHT_IN = 16.5, 11.7  # A3, landscape

_styled = mpl.rc_context(
    {
        "font.family": ["DejaVu Sans"],
        "font.size": 8.0,
        "text.color": _INK,
        "text.parse_math": False,  # a dollar sign in somebody's title is a dollar sign
        "svg.fonttype": "none",
        "svg.hashsalt": "maskfab",
        "pdf.fonttype": 42,
        "pdf.compression": 0,  # not every zlib packs alike, and a package is packed anyway
    }
)


@_styled
def drawing_sheet(plate: Plate, kind: Literal["svg", "pdf"], notes: Sequence[str], reads_up: bool = True) -> bytes:
    """The plate on a sheet of A3, equal plates in equal bytes; ``reads_up`` if right with the chrome up."""
    figure = Figure(figsize=(_WIDTH_IN, _HEIGHT_IN))
    _draw_plate(figure.add_axes((0.02, 0.03, 0.64, 0.94)), plate)
    _write(figure.add_axes((0.68, 0.14, 0.31, 0.83)), plate, notes)
    _sketch(figure.add_axes((0.68, 0.03, 0.31, 0.1)), reads_up)
    buffer = io.BytesIO()
    undated = {"CreationDate": None, "Creator": None, "Producer": None} if kind == "pdf" else {"Date": None}
    figure.savefig(buffer, format=kind, metadata=undated)
    return buffer.getvalue()


def _draw_plate(axes: Axes, plate: Plate) -> None:
    half, room = plate.blank_nm / 2 / NM_PER_MM, plate.writable_nm / 2 / NM_PER_MM
    axes.add_patch(Rectangle((-half, -half), 2 * half, 2 * half, facecolor=_CHROME, edgecolor=_INK, linewidth=1))
    axes.add_patch(
        Rectangle((-room, -room), 2 * room, 2 * room, facecolor="none", edgecolor=_QUIET, linestyle=(0, (6, 4)))
    )
    for number, die in enumerate(plate.dies, 1):
        x0, y0, x1, y1 = (edge / NM_PER_MM for edge in die.box_nm)
        axes.add_patch(Rectangle((x0, y0), x1 - x0, y1 - y0, facecolor=_CLEAR, edgecolor=_INK, linewidth=0.5))
        axes.text((x0 + x1) / 2, (y0 + y1) / 2, str(number), ha="center", va="center", fontsize=11)
    marks = [polygon for mark in plate.marks if mark.layer.written for polygon in mark.polygons]
    if marks:
        # Limits are stated below; to find them of letters takes longer than to draw those.
        axes.add_artist(PathPatch(path_mm(marks), facecolor=_CLEAR, edgecolor=_INK, linewidth=0.15))
    axes.plot([-0.03 * half, 0.03 * half], [0, 0], [0, 0], [-0.03 * half, 0.03 * half], color=_INK, linewidth=0.5)
    _dimension(axes, -half, half, -1.06 * half, f"blank {2 * half:.6g} mm", upright=False)
    _dimension(axes, -room, room, -1.13 * half, f"writable {2 * room:.6g} mm", upright=False)
    xs = sorted({die.centre_nm[0] / NM_PER_MM for die in plate.dies})
    ys = sorted({die.centre_nm[1] / NM_PER_MM for die in plate.dies})
    if len(xs) > 1:
        _dimension(axes, xs[0], xs[1], 1.06 * half, f"step {xs[1] - xs[0]:.6g} mm", upright=False)
    if len(ys) > 1:
        _dimension(axes, ys[0], ys[1], 1.06 * half, f"step {ys[1] - ys[0]:.6g} mm", upright=True)
    axes.set(xlim=(-1.04 * half, 1.12 * half), ylim=(-1.18 * half, 1.12 * half), aspect="equal")
    axes.set_axis_off()


def _dimension(axes: Axes, start: float, end: float, at: float, text: str, *, upright: bool) -> None:
    one, other = ((at, start), (at, end)) if upright else ((start, at), (end, at))
    axes.annotate("", one, other, arrowprops={"arrowstyle": "<->", "linewidth": 0.6, "shrinkA": 0, "shrinkB": 0})
    middle = (start + end) / 2
    x, y = (at, middle) if upright else (middle, at)
    box = {"facecolor": "white", "edgecolor": "none", "pad": 1.5}
    axes.text(x, y, text, ha="center", va="center", rotation=90 if upright else 0, fontsize=7.5, bbox=box)


def _write(axes: Axes, plate: Plate, notes: Sequence[str]) -> None:
    """The title block and the die map."""
    axes.set(xlim=(0, 1), ylim=(0, 1))
    axes.set_axis_off()
    y, step = 0.985, 0.0185
    axes.text(0, y, printable(plate.title), fontsize=11, va="top", weight="bold")
    y -= 1.6 * step
    for note in (f"plate {plate.name}; lengths in mm, origin at the plate's centre, y up", *notes):
        # Seeds of many dies are one word, with commas in it.
        for line in textwrap.wrap(re.sub(r",(?=\S)", ", ", printable(note)), _LINE):
            axes.text(0, y, line, va="top", fontsize=7.5)
            y -= step
    y -= step
    columns = (("no.", 0.0), ("die", 0.06), ("centre x, y", 0.38), ("size", 0.62), ("pitch um", 0.85))
    for heading, x in columns:
        axes.text(x, y, heading, va="top", fontsize=7.5, weight="bold")
    for number, die in enumerate(plate.dies[:_MOST_ROWS], 1):
        y -= step
        (cx, cy), (width, height) = (tuple(v / NM_PER_MM for v in pair) for pair in (die.centre_nm, die.panel.size_nm))
        cells = (
            str(number),
            die.name,
            f"{cx:.6g}, {cy:.6g}",
            f"{width:.6g} x {height:.6g}",
            f"{die.panel.cell_size.pitch_um:g}",
        )
        for cell, (_, x) in zip(cells, columns, strict=True):
            axes.text(x, y, cell, va="top", fontsize=7)
    if len(plate.dies) > _MOST_ROWS:
        axes.text(0, y - step, f"and {len(plate.dies) - _MOST_ROWS} more", va="top", fontsize=7)


def _sketch(axes: Axes, reads_up: bool) -> None:
    """The letter F as the plate shows it from its two sides."""
    axes.set(xlim=(0, 1), ylim=(0, 0.22), aspect="equal")
    axes.set_axis_off()
    (letter,) = text_polygons("F", 1000, (0, 0))
    middle = max(x for x, _ in letter) / 2
    for left, side, right in ((0.05, _SIDES[0], reads_up), (0.55, _SIDES[1], not reads_up)):
        axes.add_patch(Rectangle((left, 0.04), 0.4, 0.17, facecolor=_CHROME, edgecolor=_INK, linewidth=0.8))
        scale = 1.2e-4 if right else -1.2e-4
        points = np.array([(left + 0.2 + (x - middle) * scale, 0.065 + y * 1.2e-4) for x, y in letter])
        axes.fill(points[:, 0], points[:, 1], facecolor=_CLEAR, edgecolor=_INK, linewidth=0.5)
        axes.text(left + 0.2, 0.015, side, ha="center", va="center", fontsize=7.5)


def path_mm(polygons: Sequence[Polygon]) -> Path:
    """Polygons as one path: an element for each would make the drawing ten times as large."""
    vertices = [point for polygon in polygons for point in (*polygon, polygon[0])]
    codes = [
        code for polygon in polygons for code in (Path.MOVETO, *[Path.LINETO] * (len(polygon) - 1), Path.CLOSEPOLY)
    ]
    return Path(np.array(vertices, dtype=np.float64).reshape(-1, 2) / NM_PER_MM, codes)


_REFEREE = (
    "check of the GDSII",
    "python3 referee.py in this folder says that it is the plate of job.json (exit code 0), what is not (1), "
    "or that it cannot tell (2)",
)
_FORMULA = ("=", "+", "-", "@", "\t", "\r")
_NUMBER = re.compile(r"-?[0-9]+(\.[0-9]+)?")
_DATA, _MADE, _BUSINESS, _BUYER, _ASKED = "Data", "Plate", "Order", "Ordered by", "Please answer before you start"
_HEADING_F, _SIDES = "The letter F on the plate", ("seen on the chrome side", "seen through the glass")
_F = ("#####", "#    ", "###  ", "#    ", "#    ")
_LABELS: Mapping[OrderField, str] = {
    "min_cd_and_location": "smallest feature, and CD measured",
    "centred": "position",
}
"""Fields whose labels are not their names."""
_ALWAYS: tuple[OrderField, ...] = get_args(OrderField)
"""Fields that every writer must know, whether its form asks for them or not."""


@dataclass(frozen=True)
class OrderSheet:
    """An order as rows of text.

    Attributes:
        groups: headings, each with rows of label and answer; first that for which the house's form asks, in its order.
        cds: name, axis, x and y in millimetres, drawn width in micrometres of every gauge.
        files: mask files that go with it, with their SHA-256.
        sources: pages on which the house's rules were read.
        rules_heading: above them, with the day if it is known.
        mirrored: whether the letter F on the plate is mirrored on the chrome side.
    """

    title: str
    groups: tuple[tuple[str, tuple[tuple[str, str], ...]], ...]
    cds: tuple[tuple[str, str, str, str, str], ...]
    files: tuple[tuple[str, str], ...]
    sources: tuple[str, ...]
    rules_heading: str
    mirrored: bool

    def text(self) -> str:
        """The sheet as plain text with a line for each row."""
        wide = max((len(label) for _, rows in self.groups for label, _ in rows), default=0)
        lines = [self.title, "=" * len(self.title)]
        for heading, rows in self.groups:
            lines += ["", heading, *(f"  {label.ljust(wide)}  {answer}" for label, answer in rows)]
        lines += ["", _HEADING_F, f"  {_SIDES[0]:30}{_SIDES[1]}"]
        lines += [f"  {left:30}{right}".rstrip() for left, right in zip(*_letters(self.mirrored), strict=True)]
        lines += ["", "CDs (clear width along the axis; plate centre = origin, x to the right, y up, chrome side)"]
        lines += [f"  {line}" for line in columns([("name", "axis", "x mm", "y mm", "width um"), *self.cds])]
        lines += ["", "Files", *(f"  {name}  sha256 {digest}" for name, digest in self.files)]
        if self.sources:
            lines += ["", self.rules_heading, *(f"  {source}" for source in self.sources)]
        return "\n".join(map(printable, lines)) + "\n"

    def csv(self) -> str:
        """The sheet's rows, CDs and files as a table for spreadsheets, which take nothing in it for a formula."""

        def inert(cell: str) -> str:
            """The cell as text, also where it begins as a formula does; numbers stay numbers."""
            return f"'{cell}" if cell.startswith(_FORMULA) and not _NUMBER.fullmatch(cell) else cell

        buffer = io.StringIO()
        writer = csv.writer(buffer, lineterminator="\n")
        rows = [row for heading, group in self.groups for row in ((heading,), *group)]
        table = [(self.title,), *rows, ("name", "axis", "x mm", "y mm", "width um"), *self.cds,
                 ("file", "SHA-256"), *self.files]  # fmt: skip
        writer.writerows([inert(printable(cell)) for cell in row] for row in table)
        return buffer.getvalue()

    def html(self) -> str:
        """The order sheet as an HTML page; names are escaped."""
        parts = [
            f"<h1>{escape(self.title)}</h1>",
            *(f"<h2>{escape(heading)}</h2>" + _table((), rows) for heading, rows in self.groups),
            f"<h2>{_HEADING_F}</h2>{_pictures(self.mirrored)}",
            "<h2>CDs</h2><p>Clear width along the axis; the plate's centre is the origin, x to the right, y up, seen "
            "on the chrome side.</p>",
            _table(("name", "axis", "x mm", "y mm", "width µm"), self.cds),
            "<h2>Files</h2>",
            _table(("file", "SHA-256"), self.files),
        ]
        if self.sources:
            listed = "".join(f"<li>{escape(source)}</li>" for source in self.sources)
            parts.append(f"<h2>{escape(self.rules_heading)}</h2><ul>{listed}</ul>")
        style = (
            "body{font:14px system-ui,sans-serif;margin:2em auto;max-width:60em;padding:0 1em;color-scheme:light;"
            "color:#000;background:#fff}"
            "table{border-collapse:collapse;width:100%}td:first-child{width:12em}"
            "td,th{border:1px solid #bbb;padding:.3em .7em;text-align:left;vertical-align:top;overflow-wrap:anywhere}"
            "h1{font-size:1.5em}h2{font-size:1.1em;margin:1.2em 0 .4em;break-after:avoid}tr,li{break-inside:avoid}"
            "figure{display:inline-block;margin:0 3em 0 0;text-align:center}svg{background:#d9dde2;border:1px solid}"
            "li{overflow-wrap:anywhere}@page{size:A4;margin:15mm}@media print{body{font-size:9pt;margin:0;padding:0}}"
        )
        return (
            f'<!DOCTYPE html>\n<html lang="en"><head><meta charset="utf-8">'
            f'<meta name="viewport" content="width=device-width, initial-scale=1"><title>{escape(self.title)}</title>'
            f"<style>{style}</style></head>\n<body>\n" + "\n".join(parts) + "\n</body></html>\n"
        )


def order_sheet(
    order: Order,
    figures: Figures,
    shop: Shop,
    formats: Sequence[ShopFormat],
    files: Sequence[tuple[str, str]],
    remarks: Sequence[str] = (),
    edges: DotEdges | None = None,
    questions: Sequence[str] = (),
) -> OrderSheet:
    """The order sheet of a fitted plate.

    Args:
        shop: whose form is answered; what it does not ask for but every writer must know is added at its end.
        files: their names and SHA-256.
        questions: to the house, which its pages leave open.
    """
    answers = _answers(order, figures, shop, formats, remarks)
    if edges is not None and not set(formats) - set(PLATE_BITMAPS):
        answers["units"] = f"1 dot = {UM_PER_INCH / edges.dpi:g} um"
    fields = dict.fromkeys((*(field for field in shop.order.fields if field != "comments"), *_ALWAYS))
    groups: dict[str, list[tuple[str, str]]] = {heading: [] for heading in (_DATA, _MADE, _BUSINESS, _BUYER)}
    smallest = smallest_of_plate(figures.plate)
    answers["min_cd_and_location"] = _smallest(figures.plate, smallest)
    groups[_DATA] = [(_LABELS.get(field, field.replace("_", " ")), answers[field]) for field in fields]
    groups[_DATA] += [(f"smallest, {kind.of}", str(kind)) for kind in smallest]
    if edges is not None:
        dots = f"{edges.dpi} dpi; 1 (white) is digitized data, as seen on the chrome side"
        groups[_DATA] += [("plotter's dots", dots), ("edges of the bitmap", edges.said())]
    for answer in order.answers:
        groups[_heading(answer.key)].append((answer.label, answer.text))
    groups[_MADE] += _promised(shop)
    if questions:
        groups[_ASKED] = [(str(number), question) for number, question in enumerate(questions, 1)]
    if "gdsii" in formats:
        groups[_DATA].append(_REFEREE)
    read = [f"{name}, {how}" for name, _ in files if (how := readers_of(pathlib.Path(name)))]
    groups[_DATA] += [("read back", "; ".join(read))] if read else []
    plate = figures.plate
    return OrderSheet(
        f"Photomask order: {plate.name}, {shop.title}",
        tuple((heading, tuple(rows)) for heading, rows in groups.items()),
        tuple(_cd(gauge) for gauge in plate.gauges),
        tuple(files),
        shop.sources,
        _rules_heading(shop, order),
        order.mirrored,
    )


def _heading(key: str) -> str:
    """Group of a line of the order."""
    if key.startswith("contact."):
        return _BUYER
    return _BUSINESS if key in {"revision", "date", "purchase_number", "quantity", "delivery"} else _MADE


def _rules_heading(shop: Shop, order: Order) -> str:
    read = "Rules of the house" + ("" if shop.read_on is None else f", read on {shop.read_on}")
    if order.day is None or not shop.outdated(order.day):
        return read
    return f"Ask whether they still hold, for they were read more than two years before this order. {read}"


def _answers(
    order: Order, figures: Figures, shop: Shop, formats: Sequence[ShopFormat], remarks: Sequence[str]
) -> dict[OrderField, str]:
    plate, account = figures.plate, figures.account
    cut, names = CUT in figures.layers, shop.layer_names
    drawn_on = figures.options.layer
    written = names[drawn_on.name]
    layers = f"{written} minus {names[CUT.name]}" if cut else written
    numbers = f"{drawn_on.number}/{drawn_on.datatype}" + (f", {CUT.number}/{CUT.datatype}" if cut else "")
    drawn = any(form.startswith("dxf") for form in formats)
    unit, grid = shop.accepts.drawing_unit or "um", kept_grid_nm(plate, shop)
    return {
        "mask_name": f"{plate.name} ({plate.title}), layer {written}",
        "tone": order.tone,
        "parity": order.parity,
        "min_cd_and_location": "",
        "grid": f"{grid} nm; every vertex lies on it",
        "blank": f"{plate.blank_nm / NM_PER_UM / UM_PER_INCH:g} in ({plate.blank_nm / 1e6:g} mm) square",
        "centred": "centred: the data's origin (0, 0) is the plate's centre",
        "units": f"1 drawing unit = 1 {unit}" if drawn else "database unit 1 nm, user unit 1 um",
        "design_layers": f"{layers} (GDSII {numbers})",
        "display_work": "yes: openings of a display, periodic or nearly so; banding and stitching show",
        "comments": " ".join((*remarks, *(f"{line[0].upper()}{line[1:]}." for line in account.lines()))),
    }


def _smallest(plate: Plate, smallest: Sequence[Smallest]) -> str:
    """The narrowest that has to be held, which is not what is measured: CD structures are as wide as dots."""
    held = [kind for kind in smallest if not kind.fine]
    least = min((kind.least_um for kind in held), default=math.inf)
    narrowest = f"{least:.6g} um, clear or chrome" if math.isfinite(least) else "nothing narrow"
    gauge = min(plate.gauges, key=lambda each: each.target_nm, default=None)
    if gauge is None:
        return f"{narrowest}; no CD structure on this plate"
    _, axis, x, y, width = _cd(gauge)
    return f"{narrowest}; smallest CD structure {width} um along {axis} at ({x}, {y}) mm; all CDs below"


def _letters(mirrored: bool) -> tuple[tuple[str, ...], tuple[str, ...]]:
    """The letter F in rows of signs, as it is seen on the chrome side and through the glass."""
    right, wrong = _F, tuple(row[::-1] for row in _F)
    return (wrong, right) if mirrored else (right, wrong)


def _pictures(mirrored: bool) -> str:
    """Both views of the letter F as small drawings."""
    figures = []
    for rows, side in zip(_letters(mirrored), _SIDES, strict=True):
        dots = "".join(
            f'<rect x="{x + 2}" y="{y + 1}" width="1" height="1"/>'
            for y, row in enumerate(rows)
            for x, sign in enumerate(row)
            if sign != " "
        )
        drawn = f'<svg width="90" height="70" viewBox="0 0 9 7" fill="#fff" shape-rendering="crispEdges">{dots}</svg>'
        figures.append(f"<figure>{drawn}<figcaption>{side}</figcaption></figure>")
    return "".join(figures)


def _cd(gauge: Gauge) -> tuple[str, str, str, str, str]:
    x, y = (f"{value / 1e6:.6f}" for value in gauge.centre_nm)
    return gauge.name, gauge.axis, x, y, f"{gauge.target_nm / NM_PER_UM:g}"


def _promised(shop: Shop) -> list[tuple[str, str]]:
    """Tolerances that the house guarantees, for the order to refer to."""
    tolerance, plate = shop.tolerance, shop.plate
    widths = (
        (f"widths up to {most:g} um" if math.isfinite(most) else "any width beyond", deviation)
        for most, deviation in tolerance.cd_um
    )
    facts = (
        ("CD tolerance", "; ".join(f"{width}: +-{deviation:g} um" for width, deviation in widths)),
        ("tolerance, short distances", tolerance.short_um and f"+-{tolerance.short_um:g} um"),
        ("tolerance, long distances", tolerance.long_um and f"+-{tolerance.long_um:g} um"),
        ("chrome thickness", plate.chrome_nm and "{:g} to {:g} nm".format(*plate.chrome_nm)),
        ("glass thickness", plate.glass_mm and "{:g} to {:g} mm".format(*plate.glass_mm)),
    )
    return [(f"published {fact}", text) for fact, text in facts if text]


def _table(head: Sequence[str], rows: Sequence[Sequence[str]]) -> str:
    top = "<tr>" + "".join(f"<th>{escape(cell)}</th>" for cell in head) + "</tr>" if head else ""
    body = "".join("<tr>" + "".join(f"<td>{escape(cell)}</td>" for cell in row) + "</tr>" for row in rows)
    return f"<table>{top}{body}</table>"


PROFILE = "shop.toml"
"""Name in a package of the profile of its house."""
CERTIFICATE = "certificate.json"
"""Name in a package of the rules it was checked against, and of the result of reading its files back."""
REFEREE = "referee.py"
"""Name in a package of a judge of its GDSII that needs Python alone."""
_VERSION = 2
_SOURCES = (JOB_COPY, PROFILE)
_DRAWINGS = ("plate.svg", "plate.pdf")
_LASTING = ("plate", "shop", "job_hash", "revision", "tone", "parity")
"""Entries of a manifest that do not depend on the version that wrote it."""
_WRITERS = ("maskfab_version", "matplotlib_version")


@dataclass(frozen=True)
class MaskOrder:
    """The order that the papers of a package describe.

    Attributes:
        signature: of the job, by the version that drew the plate.
        checks: what reading the masks back has shown.
        sent: formats of the mask files, in the order in which they were asked for.
        masks: the mask files, in that order.
        edges: what a plotter's dots make of edges; None where no file is of dots.
    """

    job: Job
    shop: Shop
    figures: Figures
    signature: str
    findings: tuple[Finding, ...]
    checks: tuple[Quantity, ...]
    sent: tuple[ShopFormat, ...]
    masks: tuple[WrittenFile, ...]
    edges: DotEdges | None = None

    @property
    def order(self) -> Order:
        """The order to the house."""
        touches = (finding.value for finding in self.findings if finding.rule == "corner_touches")
        return order_of(self.job.spec, self.figures.plate, self.shop, int(next(touches, 0)))


def papers(ordered: MaskOrder) -> dict[str, bytes]:
    """Order sheet, drawing, the house's profile, the job and the certificate, by file name; equal for equal orders."""
    plate, shop = ordered.figures.plate, ordered.shop
    order = ordered.order
    # Corners that meet have a line of their own.
    asked = (finding for finding in ordered.findings if finding.rule != "corner_touches")
    remarks = [
        f"{question.rule}: {question.value} {question.unit} at {question.place}; please confirm."
        for question in asked
        if question.passed is None and question.place and not question.question and question.rule != "edge_error"
    ]
    files = [(mask.path, mask.sha256) for mask in ordered.masks]
    questions = [finding.question for finding in ordered.findings if finding.question]
    sheet = order_sheet(order, ordered.figures, shop, ordered.sent, files, remarks, ordered.edges, questions)
    revision = next(answer.text for answer in order.answers if answer.key == "revision")
    bias = [answer.text for answer in order.answers if answer.key == "bias" and ordered.job.spec.data_bias_nm]
    notes = (f"for {shop.title}", f"revision: {revision}", order.tone, order.parity, *bias, ordered.signature)
    reads_up = not ordered.job.spec.mirrored
    return {
        "order.txt": sheet.text().encode(),
        "order.html": sheet.html().encode(),
        "order.csv": sheet.csv().encode(),
        "plate.svg": drawing_sheet(plate, "svg", notes, reads_up),
        "plate.pdf": drawing_sheet(plate, "pdf", notes, reads_up),
        PROFILE: dump_shop(shop).encode(),
        JOB_COPY: (json.dumps(ordered.job.spec.dump(), indent=1) + "\n").encode(),
        CERTIFICATE: (json.dumps(_certificate(ordered), indent=1, ensure_ascii=False) + "\n").encode(),
        **_referee(ordered.job),
    }


def _referee(job: Job) -> dict[str, bytes]:
    """A judge of the plate that needs nothing but Python, and the plate's template, which it reads beside the job."""
    plate = job.spec.plate
    template = {} if plate is None or plate.template is None else {"template.toml": f"plates/{plate.template}.toml"}
    return {name: resources.template(each).encode() for name, each in {REFEREE: "referee.py", **template}.items()}


def package_facts(job: Job, shop: Shop, figures: Figures, order: Order) -> dict[str, Any]:
    """Facts of a package in its manifest, beside its files."""
    revision = None if job.spec.order is None else job.spec.order.revision
    return {
        "schema_version": _VERSION,
        "maskfab_version": __version__,
        "matplotlib_version": mpl.__version__,
        "plate": figures.plate.name,
        "shop": shop.name,
        "job_hash": job.digest,
        **({"revision": revision} if revision is not None else {}),
        "tone": order.tone,
        "parity": order.parity,
        "drawing": {key: value for key, value in vars(figures.options).items() if value is not None},
        "drawn": list(figures.account.lines()),
    }


def check_papers(
    ordered: MaskOrder, manifest: Mapping[str, Any], present: Collection[str], *, readable: bool
) -> Iterator[Quantity]:
    """Checks of a package's own statements, and of every paper in it, against what its job and profile make.

    Papers are compared by the hashes of the manifest, which are held against the files elsewhere. What another version
    of maskfab wrote otherwise is a note, and so are drawings by another matplotlib: their ``passed`` is None.

    Args:
        ordered: the package made again, its masks as the manifest lists them.
        present: names of the files that it holds.
        readable: whether all its masks could be read; without them nobody can say what the certificate should say.
    """
    ours, drawn_alike = manifest.get("maskfab_version") == __version__, True
    for key, own in (("maskfab_version", __version__), ("matplotlib_version", mpl.__version__)):
        said = manifest.get(key, own)
        if said != own:
            drawn_alike = False
            method = f"{key} of {RESULT_MARK}; this is {own}, and what it would write otherwise is not judged"
            yield Quantity(f"manifest_{key}", _text(said), method)
    yield from _facts_held(ordered, manifest, ours=ours)
    if not ordered.masks:
        return
    made = papers(ordered)
    digests = {name: hashlib.sha256(content).hexdigest() for name, content in made.items()}
    listed = {row["path"]: row for row in manifest["files"]}
    for name, digest in digests.items():
        if name in _SOURCES and name not in {*listed, *present}:
            # Whoever verifies it has named them; a house reads neither.
            yield Quantity("paper", "missing", f"it holds no {name}: without it nobody else can verify it")
        elif readable or name != CERTIFICATE:
            said = str(listed[name]["sha256"]) if name in listed else "missing"
            method = f"SHA-256 of {name} as its job and profile make it"
            yield _compared("paper", said, digest, method, judged=drawn_alike if name in _DRAWINGS else ours)
    files = [*ordered.masks, *(WrittenFile(name, "paper", len(made[name]), digests[name]) for name in made)]
    yield from _files_held({file.path: file for file in files}, listed, present, ours=ours)


def _facts_held(ordered: MaskOrder, manifest: Mapping[str, Any], *, ours: bool) -> Iterator[Quantity]:
    wanted = package_facts(ordered.job, ordered.shop, ordered.figures, ordered.order)
    for key in dict.fromkeys((*wanted, *manifest)):
        if key not in (*_WRITERS, "files"):
            said, fact = (_text(facts[key]) if key in facts else "nothing" for facts in (manifest, wanted))
            method = f"{key} of {RESULT_MARK} against its job and profile"
            yield _compared(f"manifest_{key}", said, fact, method, judged=ours or key in _LASTING)


def check_profile(job: Job, shop: Shop, *, ours: bool) -> Iterator[Quantity]:
    """The profile that a package brings against what is known of that house here, or kept of it in the job.

    Of a house that is known from nowhere else, its hash in the certificate stands for it.

    Args:
        ours: whether this version wrote it; what another one knew of the house is a note.
    """
    profile = load_shop(shop.name) if shop.name in shop_names() else shop_of(job.spec, job.where)
    if profile is not None and profile.name == shop.name and profile != shop:
        method = f"{PROFILE} holds other rules than those known of {shop.name}"
        yield Quantity("profile", shop.name, method, limit="the known rules", passed=(None, False)[ours])


def _files_held(
    made: Mapping[str, WrittenFile], listed: Mapping[str, Mapping[str, Any]], present: Collection[str], *, ours: bool
) -> Iterator[Quantity]:
    """Files that no such package has, and those of which the manifest tells a wrong format or length."""
    for name, row in listed.items():
        if name not in present:
            continue
        if name not in made:
            yield _compared("files", name, "nothing", f"{name}: no package of this job holds it", judged=ours)
        elif row["sha256"] == made[name].sha256:
            said, fact = (f"{record.get('format')}, {record.get('bytes')} bytes" for record in (row, vars(made[name])))
            if said != fact:
                yield _compared("files", said, fact, f"what {RESULT_MARK} says of {name}", judged=True)


def _compared(name: str, said: str, made: str, method: str, *, judged: bool) -> Quantity:
    """One row; without a verdict where another version may rightly differ, and does."""
    same = said == made
    account = (
        method if same or judged else f"{method}; it differs, and another version wrote it, so that it is not judged"
    )
    return Quantity(name, said, account, limit=made, passed=same if same or judged else None)


def _text(said: object) -> str:
    return said if isinstance(said, str) else json.dumps(said, sort_keys=True)


def _certificate(ordered: MaskOrder) -> dict[str, Any]:
    return {
        "plate": ordered.figures.plate.name,
        "shop": ordered.shop.name,
        "sources": list(ordered.shop.sources),
        "job_hash": ordered.job.digest,
        "profile_sha256": hashlib.sha256(dump_shop(ordered.shop).encode()).hexdigest(),
        "verdict": "pass",
        "tone": ordered.order.tone,
        "parity": ordered.order.parity,
        "order": {answer.key: answer.text for answer in ordered.order.answers},
        "files": [vars(file) for file in ordered.masks],
        "rules": [
            {key: value for key, value in vars(finding).items() if key != "source"} for finding in ordered.findings
        ],
        "checks": [{key: value for key, value in vars(check).items() if value is not None} for check in ordered.checks],
    }
