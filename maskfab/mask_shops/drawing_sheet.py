"""A drawing of the plate for the mask shop: dimensions, marks and a die map, as SVG and as PDF, without dates."""

from __future__ import annotations

import io
import re
import textwrap
from collections.abc import Sequence
from typing import Literal

import matplotlib as mpl
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import PathPatch, Rectangle
from matplotlib.path import Path

from maskfab.geometry.lettering import text_polygons
from maskfab.mask_shops.printable import printable
from maskfab.model import Plate, Polygon
from maskfab.units import NM_PER_MM

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
    """The plate on a sheet of A3, equal plates in equal bytes.

    Args:
        plate: what is drawn; panels as boxes, marks as they are.
        kind: of file.
        notes: lines of the title block.
        reads_up: whether the design reads right with the chrome up, and not through the glass.
    """
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
    marks = [polygon for mark in plate.furniture if mark.layer.written for polygon in mark.polygons]
    if marks:
        # Limits are stated below; to find them of letters takes longer than to draw those.
        axes.add_artist(PathPatch(_path_mm(marks), facecolor=_CLEAR, edgecolor=_INK, linewidth=0.15))
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
    for left, told, right in (
        (0.05, "seen on the chrome side", reads_up),
        (0.55, "seen through the glass", not reads_up),
    ):
        axes.add_patch(Rectangle((left, 0.04), 0.4, 0.17, facecolor=_CHROME, edgecolor=_INK, linewidth=0.8))
        scale = 1.2e-4 if right else -1.2e-4
        points = np.array([(left + 0.2 + (x - middle) * scale, 0.065 + y * 1.2e-4) for x, y in letter])
        axes.fill(points[:, 0], points[:, 1], facecolor=_CLEAR, edgecolor=_INK, linewidth=0.5)
        axes.text(left + 0.2, 0.015, told, ha="center", va="center", fontsize=7.5)


def _path_mm(polygons: Sequence[Polygon]) -> Path:
    """All polygons as one path: an element for each would make the drawing ten times as large."""
    vertices = [point for polygon in polygons for point in (*polygon, polygon[0])]
    codes = [
        code for polygon in polygons for code in (Path.MOVETO, *[Path.LINETO] * (len(polygon) - 1), Path.CLOSEPOLY)
    ]
    return Path(np.array(vertices, dtype=np.float64).reshape(-1, 2) / NM_PER_MM, codes)
