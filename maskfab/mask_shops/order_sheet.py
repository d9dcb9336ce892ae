"""The order sheet: the fields of the shop's form, filled in as far as the design determines them."""

from __future__ import annotations

import csv
import io
import math
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from html import escape

from maskfab.export.cell_polygons import CUT, Account, Figures
from maskfab.jobfile import PLATE_BITMAPS
from maskfab.jobfile.shop_profile import Format, OrderField, Shop
from maskfab.mask_shops.adapt import kept_grid_nm
from maskfab.mask_shops.dot_edges import DotEdges
from maskfab.mask_shops.order import Order
from maskfab.mask_shops.printable import printable
from maskfab.mask_shops.smallest import Smallest, smallest_features
from maskfab.model import Gauge, Plate
from maskfab.units import NM_PER_UM, UM_PER_INCH

_FORMULA = ("=", "+", "-", "@", "\t", "\r")
_NUMBER = re.compile(r"-?[0-9]+(\.[0-9]+)?")
_DATA, _MADE, _BUSINESS, _BUYER, _ASKED = "Data", "Plate", "Order", "Ordered by", "Please answer before you start"
_HEADING_F, _SIDES = "The letter F on the plate", ("seen on the chrome side", "seen through the glass")
_F = ("#####", "#    ", "###  ", "#    ", "#    ")
_LABELS: Mapping[OrderField, str] = {
    "mask_name": "mask name",
    "tone": "tone",
    "parity": "parity",
    "min_cd_and_location": "smallest feature, and CD measured",
    "grid": "grid",
    "blank": "blank",
    "centred": "position",
    "units": "units",
    "design_layers": "design layers",
    "display_work": "display work",
    "comments": "comments",
}
_ALWAYS: tuple[OrderField, ...] = (
    "mask_name", "tone", "parity", "min_cd_and_location", "grid", "blank", "centred", "units", "design_layers",
    "display_work", "comments",
)  # fmt: skip
"""Fields that every writer must know, whether its form asks for them or not."""


@dataclass(frozen=True)
class OrderSheet:
    """An order as rows of text.

    Attributes:
        title: what the sheet is for.
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
        table = [("name", "axis", "x mm", "y mm", "width um"), *self.cds]
        widths = [max(len(row[k]) for row in table) for k in range(5)]
        lines += [
            "  " + "  ".join(cell.ljust(width) for cell, width in zip(row, widths, strict=True)).rstrip()
            for row in table
        ]
        lines += ["", "Files", *(f"  {name}  sha256 {digest}" for name, digest in self.files)]
        if self.sources:
            lines += ["", self.rules_heading, *(f"  {source}" for source in self.sources)]
        return "\n".join(map(printable, lines)) + "\n"

    def csv(self) -> str:
        """The sheet's rows, CDs and files as a table for spreadsheets, which take nothing in it for a formula."""
        buffer = io.StringIO()
        writer = csv.writer(buffer, lineterminator="\n")
        rows = [row for heading, group in self.groups for row in ((heading,), *group)]
        table = [(self.title,), *rows, ("name", "axis", "x mm", "y mm", "width um"), *self.cds,
                 ("file", "SHA-256"), *self.files]  # fmt: skip
        writer.writerows([_inert(printable(cell)) for cell in row] for row in table)
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
            "body{font:14px system-ui,sans-serif;margin:2em auto;max-width:60em}"
            "table{border-collapse:collapse;width:100%}td:first-child{width:12em}"
            "td,th{border:1px solid #bbb;padding:.3em .7em;text-align:left;vertical-align:top;overflow-wrap:anywhere}"
            "h1{font-size:1.5em}h2{font-size:1.1em;margin:1.2em 0 .4em;break-after:avoid}tr,li{break-inside:avoid}"
            "figure{display:inline-block;margin:0 3em 0 0;text-align:center}svg{background:#d9dde2;border:1px solid}"
            "li{overflow-wrap:anywhere}@page{size:A4;margin:15mm}@media print{body{font-size:9pt;margin:0}}"
        )
        return (
            f'<!DOCTYPE html>\n<html lang="en"><head><meta charset="utf-8"><title>{escape(self.title)}</title>'
            f"<style>{style}</style></head>\n<body>\n" + "\n".join(parts) + "\n</body></html>\n"
        )


def order_sheet(
    order: Order,
    figures: Figures,
    shop: Shop,
    formats: Sequence[Format],
    files: Sequence[tuple[str, str]],
    remarks: Sequence[str] = (),
    edges: DotEdges | None = None,
    questions: Sequence[str] = (),
) -> OrderSheet:
    """The order sheet of a fitted plate.

    Args:
        order: what is asked for.
        figures: the plate as it is drawn for the shop.
        shop: whose form is answered; what it does not ask for but every writer must know is added at its end.
        formats: in which the plate is sent.
        files: their names and SHA-256.
        remarks: comments for the house, a sentence each.
        edges: of the bitmap that is sent, if any.
        questions: to the house, which its pages leave open.
    """
    answers = _answers(order, figures, shop, formats, remarks)
    if edges is not None and not set(formats) - set(PLATE_BITMAPS):
        answers["units"] = f"1 dot = {UM_PER_INCH / edges.dpi:g} um"
    fields = dict.fromkeys((*(each for each in shop.order.fields if each != "comments"), *_ALWAYS))
    groups: dict[str, list[tuple[str, str]]] = {heading: [] for heading in (_DATA, _MADE, _BUSINESS, _BUYER)}
    smallest = smallest_features(figures.plate)
    answers["min_cd_and_location"] = _smallest(figures.plate, smallest)
    groups[_DATA] = [(_LABELS[each], answers[each]) for each in fields]
    groups[_DATA] += [(f"smallest, {each.of}", str(each)) for each in smallest]
    if edges is not None:
        dots = f"{edges.dpi} dpi; 1 (white) is digitized data, as seen on the chrome side"
        groups[_DATA] += [("plotter's dots", dots), ("edges of the bitmap", edges.said())]
    for each in order.answers:
        groups[_heading(each.key)].append((each.label, each.text))
    groups[_MADE] += _promised(shop)
    if questions:
        groups[_ASKED] = [(str(number), each) for number, each in enumerate(questions, 1)]
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
    order: Order, figures: Figures, shop: Shop, formats: Sequence[Format], remarks: Sequence[str]
) -> dict[OrderField, str]:
    plate, account = figures.plate, figures.account
    cut, names = CUT in figures.layers, shop.layer_names
    drawn_on = figures.options.layer
    written = names[drawn_on.name]
    layers = f"{written} minus {names[CUT.name]}" if cut else written
    numbers = f"{drawn_on.number}/{drawn_on.datatype}" + (f", {CUT.number}/{CUT.datatype}" if cut else "")
    drawn = any(each.startswith("dxf") for each in formats)
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
        "comments": " ".join((*remarks, *_said(account))),
    }


def _said(account: Account) -> list[str]:
    return [f"{line[0].upper()}{line[1:]}." for line in account.lines()]


def _smallest(plate: Plate, smallest: Sequence[Smallest]) -> str:
    """The narrowest that has to be held, which is not what is measured: CD structures are as wide as dots."""
    held = [each for each in smallest if not each.fine]
    least = min((each.least_um for each in held), default=math.inf)
    told = f"{least:.6g} um, clear or chrome" if math.isfinite(least) else "nothing narrow"
    gauge = min(plate.gauges, key=lambda each: each.target_nm, default=None)
    if gauge is None:
        return f"{told}; no CD structure on this plate"
    _, axis, x, y, width = _cd(gauge)
    return f"{told}; smallest CD structure {width} um along {axis} at ({x}, {y}) mm; all CDs below"


def _letters(mirrored: bool) -> tuple[tuple[str, ...], tuple[str, ...]]:
    """The letter F in rows of signs, as it is seen on the chrome side and through the glass."""
    right, wrong = _F, tuple(row[::-1] for row in _F)
    return (wrong, right) if mirrored else (right, wrong)


def _pictures(mirrored: bool) -> str:
    """Both views of the letter F as small drawings."""
    told = []
    for rows, side in zip(_letters(mirrored), _SIDES, strict=True):
        dots = "".join(
            f'<rect x="{x + 2}" y="{y + 1}" width="1" height="1"/>'
            for y, row in enumerate(rows)
            for x, sign in enumerate(row)
            if sign != " "
        )
        drawn = f'<svg width="90" height="70" viewBox="0 0 9 7" fill="#fff" shape-rendering="crispEdges">{dots}</svg>'
        told.append(f"<figure>{drawn}<figcaption>{side}</figcaption></figure>")
    return "".join(told)


def _cd(gauge: Gauge) -> tuple[str, str, str, str, str]:
    x, y = (f"{value / 1e6:.6f}" for value in gauge.centre_nm)
    return gauge.name, gauge.axis, x, y, f"{gauge.target_nm / NM_PER_UM:g}"


def _promised(shop: Shop) -> list[tuple[str, str]]:
    """Tolerances that the shop guarantees, for the order to refer to."""
    told, tolerance, plate = [], shop.tolerance, shop.plate
    if tolerance.cd_um:
        steps = (f"{_widths(width)}: +-{deviation:g} um" for width, deviation in tolerance.cd_um)
        told.append(("published CD tolerance", "; ".join(steps)))
    if tolerance.short_um is not None:
        told.append(("published tolerance, short distances", f"+-{tolerance.short_um:g} um"))
    if tolerance.long_um is not None:
        told.append(("published tolerance, long distances", f"+-{tolerance.long_um:g} um"))
    if plate.chrome_nm is not None:
        told.append(("published chrome thickness", f"{plate.chrome_nm[0]:g} to {plate.chrome_nm[1]:g} nm"))
    if plate.glass_mm is not None:
        told.append(("published glass thickness", f"{plate.glass_mm[0]:g} to {plate.glass_mm[1]:g} mm"))
    return told


def _widths(most_um: float) -> str:
    return f"widths up to {most_um:g} um" if math.isfinite(most_um) else "any width beyond"


def _inert(cell: str) -> str:
    """The cell as text, also where it begins as a formula does; numbers stay numbers."""
    return f"'{cell}" if cell.startswith(_FORMULA) and not _NUMBER.fullmatch(cell) else cell


def _table(head: Sequence[str], rows: Sequence[Sequence[str]]) -> str:
    top = "<tr>" + "".join(f"<th>{escape(cell)}</th>" for cell in head) + "</tr>" if head else ""
    body = "".join("<tr>" + "".join(f"<td>{escape(cell)}</td>" for cell in row) + "</tr>" for row in rows)
    return f"<table>{top}{body}</table>"
