"""Figures of a die and its plate: pure functions from the vocabulary to ``<img>`` elements that need nothing else, and
links to lay over one of them.

Line drawings are SVG; pictures are palette PNGs inside it. Equal input gives equal bytes: no dates, no random ids.
An SVG inside ``<img>`` cannot run scripts, cannot load anything, and its ids cannot clash with those of the page.
Colours are those of Okabe and Ito, which colour-blind readers tell apart; line styles tell the curves apart in grey.
A die as it is written has its corners, in both readings of the writer, beside those drawn.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from types import MappingProxyType
from typing import Any, TypeVar

import matplotlib as mpl
import numpy as np
from klayout import db
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import PathPatch, Rectangle
from matplotlib.path import Path
from matplotlib.ticker import NullFormatter
from numpy.typing import NDArray

from maskfab.base.arrays import Floats
from maskfab.base.cell_size import CellSize
from maskfab.base.model import Die, DieOptics, Mtf, Opening, Panel, Plate, Psf, Tiling
from maskfab.base.units import NM_PER_MM, NM_PER_UM
from maskfab.findings.as_written import Written
from maskfab.mask.package.papers import path_mm
from maskfab.mask.writer import Reading, written_region
from maskfab.report.figures import sheet
from maskfab.report.figures.sheet import INK, QUIET, Drawing, bitmap, draw_psf, image, img, place, scale, styled
from maskfab.report.text import rounded

Item = TypeVar("Item", Psf, Mtf)

PLATE = "<plate>"
"""Key of the whole plate's figures; no die can have this name."""

_CHROME, _CLEAR = "#2f343c", "#ffffff"
_GREYS = np.linspace((0x2F, 0x34, 0x3C), (255, 255, 255), 64).round().astype(np.uint8)
# Okabe and Ito's set, told apart by all common kinds of colour vision; line styles tell the curves apart in grey.
OKABE_ITO = ("#0072B2", "#D55E00", "#009E73", "#CC79A7", "#E69F00", "#56B4E9", "#000000")
"""Colours of curves."""
# Tol's muted set has three more that differ from these.
_OF_OPENINGS = (*OKABE_ITO, "#882255", "#999933", "#332288")
_CUTS: Mapping[str, tuple[str, str, Any, float]] = MappingProxyType(
    {
        "horizontal": ("horizontal", "#0072B2", "-", 1.1),
        "vertical": ("vertical", "#D55E00", (0, (5, 1.5)), 1.1),
        "diagonal": ("diagonal +45°", "#009E73", (0, (3, 1, 1, 1)), 0.9),
        "antidiagonal": ("diagonal −45°", "#CC79A7", (0, (1, 1)), 0.9),
        "radial_mean": ("radial mean", "#000000", "-", 1.7),
        "radial_min": ("radial minimum", "#000000", (0, (4, 2)), 1.1),
    }
)
_BAND = "band"
MARKS = ("o", "s", "^", "D", "v", "P", "X", "<", ">", "p", "h", "*")
"""Marks of curves, which tell them apart in grey."""
_LOWEST = 5e-3
"""MTF at the lower edge of the comparison of dies; what is lower is drawn there."""
_PLATE_SEEN = (-1.02, 1.17), (-1.2, 1.17)
"""Extent of a drawing of the plate along x and y, in halves of the blank."""
_NAMED = 100
"""Dies whose names and labels a drawing of the plate can show."""
_NAME = 0.045
"""From one name beside it to the next, of its height."""
_POWERS = ("1", "10⁻¹", "10⁻²", "10⁻³", "10⁻⁴", "10⁻⁵", "10⁻⁶")


@styled
def opening(opening: Opening, dot_nm: int | None = None) -> Drawing:
    """The unit cell: clear is white, chrome dark; ``dot_nm`` if it is laid out at another size than its nominal one."""
    figure, axes = _sheet(2.6, 2.75)
    _draw_opening(axes, opening, dot_nm or opening.dot_nm)
    return Drawing(figure, f"Opening {opening.name}: {opening.dots} x {opening.dots} dots")


@styled
def panel_close_up(panel: Panel, cells: int = 6) -> Drawing:
    """Some cells in the middle of the panel, each in its own orientation, with the gutters between them."""
    figure, axes = _sheet(2.6, 2.75)
    _draw_panel(axes, panel, cells)
    return Drawing(figure, f"{cells} x {cells} cells of the panel, tiling {panel.tiling.value}")


@styled
def psf(psfs: Sequence[Psf]) -> Drawing:
    """log10 of the PSFs over six decades below each one's own peak: the middle wavelength large, its neighbours small.

    The colour scale is the same for every PSF of every die. Of two samplings of one wavelength the finer is shown.
    """
    shown = finest(psfs)
    (main, pixels), *others = seen_psfs(psfs)
    width = 6.2 if others else 4.5
    figure = Figure(figsize=(width, 3.8))
    _draw_psf(place(figure, (0.6, 0.5, 3.0, 3.0)), main, pixels)
    for row, (item, few) in enumerate(others):
        axes = place(figure, (3.85, 2.15 - 1.65 * row, 1.35, 1.35))
        axes.set_title(f"{item.wavelength_nm:g} nm")
        draw_psf(axes, item, few)
        axes.set(xticks=[], yticks=[])
    draw_decades(place(figure, (width - 0.8, 0.5, 0.12, 3.0)), "intensity / peak (log)")
    lines = ", ".join(f"{item.wavelength_nm:g} nm" for item in shown)
    return Drawing(figure, f"PSF at {lines}, logarithmic, six decades below the peak")


def seen_psfs(psfs: Sequence[Psf]) -> list[tuple[Psf, int]]:
    """PSFs that :func:`psf` shows, and how many pixels along a side: the middle wavelength, and its neighbours."""
    shown = finest(psfs)
    main = middle(shown)
    return [(main, 257), *((item, 129) for item in dict.fromkeys((shown[0], shown[-1])) if item is not main)]


def draw_decades(bar: Axes, words: str) -> None:
    """The colours of :func:`maskfab.report.figures.sheet.log_intensity` as a narrow upright bar."""
    ramp = np.linspace(-sheet.DECADES, 0, 256)[:, None]
    bar.imshow(
        ramp, origin="lower", cmap="magma", interpolation="none", aspect="auto", extent=(0, 1, -sheet.DECADES, 0)
    )
    bar.set_xticks([])
    scale(bar, "right", words, dict(zip(range(0, -sheet.DECADES - 1, -1), _POWERS, strict=True)))


@styled
def mtf(mtfs: Sequence[Mtf]) -> Drawing:
    """One plot for each wavelength: the band from radial minimum to maximum, radial mean, and the straight cuts."""
    size, places = mtf_places(len(mtfs))
    figure = Figure(figsize=size)
    for index, (item, inches) in enumerate(zip(mtfs, places, strict=True)):
        _draw_mtf(place(figure, inches), item, first=not index)
    handles, labels = figure.axes[0].get_legend_handles_labels()
    figure.legend(handles, labels, loc="lower center", ncols=3 if len(mtfs) < 3 else 7, fontsize=7.5)
    lines = ", ".join(f"{item.wavelength_nm:g} nm" for item in mtfs)
    return Drawing(figure, f"MTF at {lines}: radial mean, minimum and maximum, horizontal, vertical, diagonal cuts")


def mtf_places(count: int) -> tuple[tuple[float, float], list[tuple[float, float, float, float]]]:
    """Size of the figure of so many MTFs, and left, bottom, width and height of each plot, inches."""
    # The legend of few has three lines, and needs its width.
    width, low = max(3.4 * count, 5.2), 1.15 if count < 3 else 0.75
    step = width / count
    return (width + 0.6, low + 2.65), [(0.5 + step * index, low, step - 0.3, 2.05) for index in range(count)]


@styled
def mtf_comparison(dies: Sequence[DieOptics], stressed: Sequence[str] = ()) -> Drawing:
    """Radial-minimum MTF of every die at its middle wavelength, each with its name at the end of its curve.

    Colour says the opening, dashes a tiling that turns it; marks and names tell the dies apart in grey, too.
    """
    figure = Figure(figsize=(10.8, 4.6))
    axes = place(figure, (0.7, 0.5, 8.2, 3.4))
    names = list(dict.fromkeys(item.die.panel.opening.name for item in dies))
    for number, item in enumerate(dies):
        panel, curve, thick = item.die.panel, middle(item.mtfs), item.die.name in stressed
        colour = _OF_OPENINGS[names.index(panel.opening.name) % len(_OF_OPENINGS)]
        every = max(len(curve.frequency_cy_per_mm) // 5, 1)
        axes.plot(
            curve.frequency_cy_per_mm,
            np.clip(curve.cuts["radial_min"], _LOWEST, 1.0),
            color=colour,
            linestyle="-" if panel.tiling is Tiling.PERIODIC else (0, (4, 1.5)),
            linewidth=2.4 if thick else 0.9,
            marker=MARKS[number % len(MARKS)],
            markevery=(every * (number + 1) // (len(dies) + 1), every),  # those of two dies do not meet
            markersize=6 if thick else 4.5,
            markerfacecolor=colour if thick else "white",
            zorder=3 if thick else 2,
            label=item.die.name,
        )
    # What restoration can bring back is decided near zero, which a linear axis hides.
    axes.set_yscale("log")
    axes.yaxis.set_minor_formatter(NullFormatter())
    axes.set(xlim=(0, dies[0].mtfs[0].frequency_cy_per_mm[-1]), ylim=(_LOWEST, 1))
    _name_ends(axes)
    _dress_mtf(axes, middle(dies[0].mtfs), "MTF (log)", {1: "1", 0.1: "0.1", 0.01: "0.01"})
    axes.set_title(f"{middle(dies[0].mtfs).wavelength_nm:g} nm, lowest over all directions", loc="left", pad=30)
    return Drawing(figure, f"Radial-minimum MTF of {len(dies)} dies")


def _name_ends(axes: Axes) -> None:
    """Names of the curves beside the right edge, at the heights where they end, or as near as they can be read."""
    curves = axes.get_lines()
    within = axes.transData + axes.transAxes.inverted()
    last = np.array([np.asarray(curve.get_xydata())[-1] for curve in curves])
    ends: list[float] = np.asarray(within.transform(last))[:, 1].tolist()
    order = np.argsort(ends, kind="stable")
    for index, height in zip(order, spread([ends[k] for k in order], _NAME, 0.0, 1.0), strict=True):
        curve = curves[index]
        shared: dict[str, Any] = {"transform": axes.transAxes, "color": curve.get_color(), "clip_on": False}
        axes.plot([1, 1.02, 1.03], [ends[index], height, height], linewidth=0.6, **shared)
        mark = {"marker": curve.get_marker(), "markerfacecolor": curve.get_markerfacecolor(), "markersize": 4.5}
        axes.plot([1.04], [height], **mark, **shared)
        weight = "bold" if curve.get_linewidth() > 2 else "normal"
        name = str(curve.get_label())
        axes.text(1.055, height, name, transform=axes.transAxes, va="center", fontsize=7.5, weight=weight)


def spread(wanted: Sequence[float], apart: float, low: float, high: float) -> list[float]:
    """Rising heights moved until they are ``apart``, between two bounds; below the lower one if there is no room."""
    chosen: list[float] = []
    for target in wanted:
        chosen.append(max(target, low, *(last + apart for last in chosen[-1:])))
    top = high
    for index in reversed(range(len(chosen))):
        chosen[index] = min(chosen[index], top)
        top = chosen[index] - apart
    return chosen


@styled
def plate_drawing(plate: Plate, failed: frozenset[str] = frozenset()) -> Drawing:
    """The plate in millimetres: blank, writable area, dies by name (marked if a check failed), marks as drawn."""
    figure, axes = _sheet(8.6, 8.6)
    _draw_plate(axes, plate, failed)
    return Drawing(figure, f"Drawing of plate {plate.name} with {len(plate.dies)} dies")


def plate_places(plate: Plate) -> str:
    """Links to lay over :func:`plate_drawing`: each die to its numbers, ``numbers-`` and its name, in percent."""
    (left, right), (low, high) = _PLATE_SEEN
    half_nm, side = plate.blank_nm / 2, high - low
    beside = (side - (right - left)) / 2  # the drawing is square, what it shows is not
    links = []
    for die in plate.dies:
        x0, y0, x1, y1 = (edge / half_nm for edge in die.box_nm)
        box = (x0 - left + beside, high - y1, x1 - x0, y1 - y0)
        style = "; ".join(
            f"{name}: {100 * length / side:.2f}%"
            for name, length in zip(("left", "top", "width", "height"), box, strict=True)
        )
        links.append(f'<a href="#numbers-{die.name}" style="{style}" title="{die.name}" aria-label="{die.name}"></a>')
    return "".join(links)


def panel_thumbnail(panel: Panel, side_nm: int, pixels: int = 108, kind: str = "small") -> str:
    """A small picture of a square of ``side_nm``; with one side for all dies their cells compare in size."""
    levels = np.rint(sheet.panel_coverage(panel, side_nm, pixels) * (len(_GREYS) - 1)).astype(np.uint8)
    return img(sheet.data_uri(sheet.png(levels, _GREYS)), f"Cells of opening {panel.opening.name}", kind)


def psf_thumbnail(psf: Psf, peak: float | None = None, pixels: int = 97) -> str:
    """A small picture of a PSF over the decades below ``peak``, its own if None."""
    levels = np.rint((sheet.log_intensity(psf, pixels, peak) / sheet.DECADES + 1) * 255).astype(np.uint8)
    magma = (mpl.colormaps["magma"](np.arange(256))[:, :3] * 255).round().astype(np.uint8)
    return img(sheet.data_uri(sheet.png(levels, magma)), f"PSF at {psf.wavelength_nm:g} nm", "small")


@styled
def overview(plate: Plate, document: Mapping[str, Any], optics: DieOptics) -> bytes:
    """One PNG for a whole run: the plate, and one die's opening, panel, PSF and MTF."""
    figure = Figure(figsize=(13.0, 6.9), dpi=120)
    whole = place(figure, (0.05, 0.2, 5.8, 6.4))
    _draw_plate(whole, plate, failed_dies(document))
    whole.set_title(plate.title)
    panel = optics.die.panel
    boxes = (6.4, 3.75, 2.75, 2.75), (9.85, 3.75, 2.75, 2.75), (6.3, 0.5, 2.75, 2.75), (9.75, 0.5, 3.15, 2.6)
    places = [place(figure, box) for box in boxes]
    _draw_opening(places[0], panel.opening, panel.dot_nm)
    _draw_panel(places[1], panel, 6)
    _draw_psf(places[2], middle(finest(optics.psfs)), 641)
    _draw_mtf(places[3], middle(optics.mtfs))
    places[0].set_title(f"opening {panel.opening.name}")
    places[1].set_title(f"die {optics.die.name}, 6 × 6 cells")
    places[2].set_title(f"PSF, {middle(finest(optics.psfs)).wavelength_nm:g} nm, six decades")
    places[3].legend(fontsize=6.5)
    return bitmap(figure)


@styled
def optics(psfs: Sequence[Psf], mtfs: Sequence[Mtf], name: str) -> bytes:
    """One PNG of what an opening or a mask does to a picture: a PSF over an MTF for each wavelength."""
    shown = finest(psfs)
    columns = max(len(shown), len(mtfs))
    figure = Figure(figsize=(3.6 * columns + 0.4, 7.2), dpi=120)
    for column, item in enumerate(shown):
        _draw_psf(place(figure, (3.6 * column + 0.7, 3.95, 2.7, 2.7)), item, 641)
    for column, curve in enumerate(mtfs):
        axes = place(figure, (3.6 * column + 0.7, 0.5, 3.0, 2.4))
        _draw_mtf(axes, curve)
        if not column:
            axes.legend(fontsize=6.5)
    figure.suptitle(f"{name}: PSF over six decades below its peak, and presampled MTF")
    return bitmap(figure)


def _draw_opening(axes: Axes, opening: Opening, dot_nm: int) -> None:
    _show_chrome(axes, opening.mask.astype(np.float64), CellSize(opening.dots, dot_nm).pitch_um)


def _draw_panel(axes: Axes, panel: Panel, cells: int) -> None:
    side_nm = min(cells, *panel.orientations.shape) * panel.pitch_nm
    _show_chrome(axes, sheet.panel_coverage(panel, side_nm, 360), side_nm / NM_PER_UM)


def _show_chrome(axes: Axes, clear: NDArray[np.float64], side_um: float) -> None:
    """A picture of clear shares with a scale bar of a round length under it."""
    grey = _GREYS[np.rint(clear * (len(_GREYS) - 1)).astype(np.intp)]
    axes.imshow(grey, origin="lower", interpolation="none", extent=(0, side_um, 0, side_um))
    decade = 10.0 ** np.floor(np.log10(side_um / 2))
    bar = decade * max(step for step in (1, 2, 5) if step * decade <= side_um / 2)
    axes.plot([0, bar], [-0.03 * side_um] * 2, color=INK, linewidth=2, solid_capstyle="butt", clip_on=False)
    axes.text(bar + 0.03 * side_um, -0.03 * side_um, f"{bar:g} µm", va="center")
    axes.add_patch(_outline((0, 0, side_um, side_um), QUIET, "-"))
    axes.set(xlim=(-0.01 * side_um, 1.01 * side_um), ylim=(-0.06 * side_um, 1.01 * side_um))
    axes.set_axis_off()


def _draw_psf(axes: Axes, psf: Psf, pixels: int) -> None:
    axes.set_title(f"{psf.wavelength_nm:g} nm")
    draw_psf(axes, psf, pixels)
    scale(axes, "bottom", "x (µm)")
    scale(axes, "left", "y (µm)")


def _draw_mtf(axes: Axes, mtf: Mtf, *, first: bool = True) -> None:
    """Curves over their axes; whose left one has numbers and words if it is the first of a row."""
    for name, x, y in curves(mtf):
        if name == _BAND:
            axes.fill(x, y, color="#d5dae0", linewidth=0, label="radial minimum to maximum", gid=sheet.CURVE)
        else:
            label, colour, style, width = _CUTS[name]
            shown: dict[str, Any] = {"color": colour, "linestyle": style, "linewidth": width, "label": label}
            axes.plot(x, y, gid=sheet.CURVE, **shown)
    axes.set_ylim(0, 1)
    _dress_mtf(axes, mtf, "MTF" if first else "", first=first)
    axes.set_title(mtf_title(mtf), pad=32)


def mtf_title(mtf: Mtf) -> str:
    """Wavelength and error bar of a plot."""
    return f"{mtf.wavelength_nm:g} nm (± {rounded(float(mtf.uncertainty), 2)})"


def curves(mtf: Mtf) -> Iterator[tuple[str, Floats, Floats]]:
    """Curves of a plot of an MTF, by name: frequencies and values of the band, a polygon, and of the cuts, lines."""
    frequency, low, high = mtf.frequency_cy_per_mm, mtf.cuts.get("radial_min"), mtf.cuts.get("radial_max")
    if low is not None and high is not None:
        # One sample for each point on paper is enough, extremes kept.
        starts = np.arange(0, len(frequency), -(-len(frequency) // 220))
        x = np.append(frequency[starts], frequency[-1])
        least = np.append(np.minimum.reduceat(low, starts), low[-1])
        most = np.append(np.maximum.reduceat(high, starts), high[-1])
        yield _BAND, np.append(x, x[::-1]), np.append(least, most[::-1])
    yield from ((name, frequency, mtf.cuts[name]) for name in _CUTS if name in mtf.cuts)


def _dress_mtf(
    axes: Axes, mtf: Mtf, words: str, named: Mapping[float, str] | None = None, *, first: bool = True
) -> None:
    nyquist = float(mtf.frequency_cy_per_mm[-1])
    axes.set_xlim(0, nyquist)
    scale(axes, "bottom", "frequency (cy/mm)", grid=True)
    scale(axes, "left", words, named, numbers=first, grid=True)
    scale(axes, "top", "cy/pixel", {nyquist * tenth / 5: f"{tenth / 10:g}" for tenth in range(6)})


def _draw_plate(axes: Axes, plate: Plate, failed: frozenset[str]) -> None:
    half, room = plate.blank_nm / 2 / NM_PER_MM, plate.writable_nm / 2 / NM_PER_MM
    axes.add_artist(Rectangle((-half, -half), 2 * half, 2 * half, facecolor=_CHROME, edgecolor=INK, linewidth=1))
    axes.add_artist(_outline((-room, -room, room, room), "#9aa3ad", (0, (6, 4))))
    for die in plate.dies:
        axes.add_artist(_outline(_slot_mm(die), "#6b737e", (0, (2, 2))))
        x0, y0, x1, y1 = (edge / NM_PER_MM for edge in die.box_nm)
        tone = 0.25 + 0.75 * die.panel.open_ratio  # a panel seen from afar is grey; lifted so that it shows on chrome
        grey = tuple(_GREYS[round(tone * (len(_GREYS) - 1))] / 255)
        axes.add_artist(Rectangle((x0, y0), x1 - x0, y1 - y0, facecolor=grey, linewidth=0))
        if die.name in failed or len(plate.dies) <= _NAMED:
            _write_name(axes, die, die.name in failed, 2 * half)
    labels = {f"LABEL_{die.name}" for die in plate.dies} if len(plate.dies) > _NAMED else frozenset()
    marks = [item for item in plate.marks if item.kind != "wires" and item.name not in labels]
    for written, edge in ((True, "none"), (False, "#6b737e")):
        polygons = [p for item in marks if item.layer.written is written for p in item.polygons]
        fill = _CLEAR if written else "none"
        axes.add_artist(PathPatch(path_mm(polygons), facecolor=fill, edgecolor=edge, linewidth=0.4))
    for item in plate.marks:
        if item.kind == "fiducial":
            pad = 0.04 * half
            corners = np.concatenate([np.array(polygon) for polygon in item.polygons]) / NM_PER_MM
            low, high = corners.min(axis=0), corners.max(axis=0)
            x, y = (low + high) / 2
            # Outwards of the mark: other marks stand beside it and further in.
            above = y >= 0
            height, align = (high[1] + pad, "bottom") if above else (low[1] - pad, "top")
            axes.text(x, height, f"({x:.5g}, {y:.5g})", color="#c9d1d9", fontsize=6.5, ha="center", va=align)
    _dimension(axes, (-half, -half), (half, -half), -0.055 * half, f"blank {2 * half:.6g} mm")
    _dimension(axes, (-room, -half), (room, -half), -0.135 * half, f"writable {2 * room:.6g} mm")
    _dimension_dies(axes, plate, half)
    axes.plot([-0.03 * half, 0.03 * half], [0, 0], [0, 0], [-0.03 * half, 0.03 * half], color=_CLEAR, linewidth=0.6)
    (left, right), (low, high) = _PLATE_SEEN
    axes.set(xlim=(left * half, right * half), ylim=(low * half, high * half), aspect="equal")
    axes.set_axis_off()


def _write_name(axes: Axes, die: Die, failed: bool, span: float) -> None:
    x, y = (coordinate / NM_PER_MM for coordinate in die.centre_nm)
    width_pt = die.panel.size_nm[0] / NM_PER_MM / span * 530
    size = min(9.0, 1.45 * width_pt / max(len(die.name), 4))
    box = {"facecolor": _CHROME, "edgecolor": "none", "boxstyle": "round,pad=0.25"}
    text = f"{die.name}\nFAIL" if failed else die.name
    axes.text(x, y, text, ha="center", va="center", color=_CLEAR, fontsize=size, bbox=box)


def _dimension_dies(axes: Axes, plate: Plate, half: float) -> None:
    """Slot and step of the dies, where the top row and the right-hand column show them."""
    top = max((die.centre_nm[1] for die in plate.dies), default=0)
    row = sorted((die for die in plate.dies if die.centre_nm[1] == top), key=lambda die: die.centre_nm[0])
    if not row:
        return
    x0, _, x1, y1 = _slot_mm(row[0])
    _dimension(axes, (x0, y1), (x1, y1), half - y1 + 0.05 * half, f"slot {x1 - x0:.5g} mm")
    if len(row) > 1:
        a, b = (die.centre_nm[0] / NM_PER_MM for die in row[:2])
        _dimension(axes, (a, y1), (b, y1), half - y1 + 0.125 * half, f"step {b - a:.5g} mm")
    last = row[-1].centre_nm[0]
    column = sorted((die.centre_nm[1] for die in plate.dies if die.centre_nm[0] == last), reverse=True)
    if len(column) > 1:
        a, b = (coordinate / NM_PER_MM for coordinate in column[:2])
        right = _slot_mm(row[-1])[2]
        _dimension(axes, (right, a), (right, b), half - right + 0.06 * half, f"step {a - b:.5g} mm")


def _dimension(axes: Axes, start: tuple[float, float], end: tuple[float, float], offset: float, text: str) -> None:
    """A dimension line between two points, moved outwards by ``offset`` across its direction."""
    upright = start[0] == end[0]
    dx, dy = (offset, 0.0) if upright else (0.0, offset)
    a, b = (start[0] + dx, start[1] + dy), (end[0] + dx, end[1] + dy)
    for point, tip in ((start, a), (end, b)):
        axes.plot([point[0], tip[0]], [point[1], tip[1]], color=QUIET, linewidth=0.4)
    axes.annotate("", a, b, arrowprops={"arrowstyle": "<->", "linewidth": 0.6, "shrinkA": 0, "shrinkB": 0})
    x, y = (a[0] + b[0]) / 2, (a[1] + b[1]) / 2
    box = {"facecolor": "white", "edgecolor": "none", "pad": 1.5}
    axes.text(x, y, text, ha="center", va="center", rotation=90 if upright else 0, fontsize=7.5, bbox=box)


def _slot_mm(die: Die) -> tuple[float, float, float, float]:
    x, y = (coordinate / NM_PER_MM for coordinate in die.centre_nm)
    reach = die.slot_nm / 2 / NM_PER_MM
    return x - reach, y - reach, x + reach, y + reach


def _outline(box: tuple[float, float, float, float], colour: str, style: Any) -> Rectangle:
    x0, y0, x1, y1 = box
    return Rectangle((x0, y0), x1 - x0, y1 - y0, facecolor="none", edgecolor=colour, linestyle=style, linewidth=0.6)


def failed_dies(document: Mapping[str, Any]) -> frozenset[str]:
    """Names of dies of a report that failed a check."""
    return frozenset(check["die"] for check in document["checks"] if not check["passed"] and "die" in check)


def finest(psfs: Sequence[Psf]) -> list[Psf]:
    """One PSF for each wavelength, in the given order: the one sampled at the closest points."""
    chosen: dict[float, Psf] = {}
    for item in psfs:
        if item.step_um < chosen.setdefault(item.wavelength_nm, item).step_um:
            chosen[item.wavelength_nm] = item
    return list(chosen.values())


def middle(items: Sequence[Item]) -> Item:
    """That of the median wavelength, whatever their order."""
    return sorted(items, key=lambda item: item.wavelength_nm)[len(items) // 2]


def _sheet(width: float, height: float) -> tuple[Figure, Axes]:
    figure = Figure(figsize=(width, height))
    return figure, figure.add_axes((0.0, 0.0, 1.0, 1.0))


_WRITTEN_CHROME, _WRITTEN_CLEAR, _DRAWN = "#2f343c", "#ffffff", "#E69F00"
_STYLE: dict[Reading, tuple[str, Any]] = {Reading.FUSED: ("#0072B2", "-"), Reading.OPEN: ("#D55E00", (0, (5, 1.5)))}
_NAMES = {Reading.FUSED: "written, fused", Reading.OPEN: "written, open"}
_FINER = 16
_SIDE = 2.1
# Half the width of the picture, in corner radii: room for the arcs and what surrounds them.
_RADII = 3.5


def written_pictures(written: Written) -> dict[str, str]:
    """The figures of one written die as ``<img>`` elements: ``written_corner``, ``written_psf``, ``written_mtf``."""
    return {f"written_{which}": _page(written, which) for which in _WRITTEN_FIGURES}


def bitmaps(written: Written) -> dict[str, bytes]:
    """The figures of the written mask as PNG files."""
    return {f"written_{which}": _file(written, which) for which in _WRITTEN_FIGURES}


@styled
def _page(written: Written, which: str) -> str:
    return image(*_WRITTEN_FIGURES[which](written))


@styled
def _file(written: Written, which: str) -> bytes:
    figure, _ = _WRITTEN_FIGURES[which](written)
    figure.set_dpi(120)
    return bitmap(figure)


def _corner(written: Written) -> tuple[Figure, str]:
    process = written.process
    kind = "a kissing corner" if written.kissing else "a corner"
    figure = Figure(figsize=(3 * _SIDE + 1.0, _SIDE + 0.75))
    drawn = db.Region()
    for box in (written.close_up_nm * _FINER).tolist():
        drawn.insert(db.Box(*box))
    shapes = {
        "drawn": drawn.merged(True, 1),
        **{_NAMES[reading]: written_region(drawn, process, reading, NM_PER_UM * _FINER) for reading in Reading},
    }
    reach = _reach_um(written)
    for index, (title, region) in enumerate(shapes.items()):
        axes = place(figure, (0.2 + index * (_SIDE + 0.3), 0.45, _SIDE, _SIDE))
        axes.set_facecolor(_WRITTEN_CHROME)
        axes.add_artist(PathPatch(_path_um(region), facecolor=_WRITTEN_CLEAR, edgecolor="none"))
        if index:
            outline = PathPatch(_path_um(shapes["drawn"]), facecolor="none", edgecolor=_DRAWN, linewidth=1.0)
            outline.set_linestyle((0, (4, 2)))
            axes.add_artist(outline)
        axes.set(xlim=(-reach, reach), ylim=(-reach, reach), aspect="equal", xticks=[], yticks=[], title=title)
        _scale_bar(axes, reach)
    rough = process.roughness
    mean = "" if rough is None else f", without the edges' roughness of {rough.sigma_um:g} µm"
    words = f"corner radius {process.corner_radius_um:g} µm, CD bias {process.cd_bias_um:g} µm{mean}; dashed: as drawn"
    figure.text(0.5, 0.03, words, ha="center", va="bottom", color=INK)
    return figure, f"{kind} of die {written.die.name}: as drawn, as written fused, as written open; {words}"


def _reach_um(written: Written) -> float:
    process, dot = written.process, written.die.panel.dot_nm / NM_PER_UM
    wanted = _RADII * (process.corner_radius_um + abs(process.cd_bias_um))
    return float(min(max(wanted, dot / 4), 1.25 * dot))


def _scale_bar(axes: Axes, reach: float) -> None:
    length = 10.0 ** np.floor(np.log10(reach))
    length *= max(m for m in (1, 2, 5) if m * length <= reach)
    left, low = -0.92 * reach, -1.08 * reach
    axes.plot([left, left + length], [low, low], color=INK, linewidth=2, clip_on=False, solid_capstyle="butt")
    axes.text(left + length + 0.05 * reach, low, f"{length:g} µm", va="center", fontsize=7.5)


def _path_um(region: db.Region) -> Path:
    vertices: list[tuple[float, float]] = []
    codes: list[np.uint8] = []
    for polygon in region.each():
        rings = [polygon.each_point_hull(), *(polygon.each_point_hole(k) for k in range(polygon.holes()))]
        for ring in rings:
            points = [(point.x / NM_PER_UM / _FINER, point.y / NM_PER_UM / _FINER) for point in ring]
            vertices += [*points, points[0]]
            codes += [Path.MOVETO, *[Path.LINETO] * (len(points) - 1), Path.CLOSEPOLY]
    return Path(np.array(vertices).reshape(-1, 2), codes)


def _spread(written: Written) -> tuple[Figure, str]:
    """The PSFs at the middle wavelength, all over the peak of the drawing's."""
    drawn = written.drawn_psf
    readings = _shown(written)
    names = [_NAMES[reading] if len(readings) > 1 else "written" for reading in readings]
    shown = dict(zip(["drawn", *names], [drawn, *(written.readings[r].psf for r in readings)], strict=True))
    peak = float(drawn.values.max())
    step, side = _SIDE + 0.2, _SIDE
    figure = Figure(figsize=(0.6 + len(shown) * step + 0.75, side + 0.9))
    for index, (title, psf) in enumerate(shown.items()):
        axes = place(figure, (0.6 + index * step, 0.5, side, side))
        draw_psf(axes, psf, 241, peak)
        axes.set(title=title, xlabel="x (µm)")
        if index:
            axes.tick_params(labelleft=False)
        else:
            axes.set_ylabel("y (µm)")
    draw_decades(place(figure, (0.6 + len(shown) * step, 0.5, 0.12, side)), "intensity / peak as drawn (log)")
    return figure, (
        f"PSF of die {written.die.name} at {drawn.wavelength_nm:g} nm: {', '.join(shown)}; logarithmic, "
        "six decades below the peak of the drawn one"
    )


def _transfer(written: Written) -> tuple[Figure, str]:
    middle = len(written.drawn) // 2
    drawn = written.drawn[middle]
    figure = Figure(figsize=(7.3, 3.25))
    curves = place(figure, (0.55, 0.9, 2.9, 2.0))
    change = place(figure, (4.2, 0.9, 2.9, 2.0))
    frequency = drawn.frequency_cy_per_mm
    for cut, width in (("radial_mean", 1.5), ("radial_min", 0.8)):
        curves.plot(frequency, drawn.cuts[cut], color=QUIET, linewidth=width + 1.5, label=_label("drawn", cut))
        for reading in _shown(written):
            colour, style = _STYLE[reading]
            mtf: Mtf = written.readings[reading].mtfs[middle]
            name = _label(_NAMES[reading], cut)
            curves.plot(frequency, mtf.cuts[cut], color=colour, linestyle=style, linewidth=width, label=name)
            change.plot(frequency, mtf.cuts[cut] - drawn.cuts[cut], color=colour, linestyle=style, linewidth=width)
    change.axhline(0, color=QUIET, linewidth=0.6)
    nyquist = float(frequency[-1])
    curves.set(xlim=(0, nyquist), ylim=(0, 1), xlabel="frequency (cy/mm)", title=f"MTF at {drawn.wavelength_nm:g} nm")
    error = max(written.readings[reading].radial_errors[middle] for reading in Reading)
    change.set(xlim=(0, nyquist), xlabel="frequency (cy/mm)", title=f"MTF written − drawn (± {error:.1g} at worst)")
    for axes in (curves, change):
        axes.grid(color="#e3e6ea", linewidth=0.5)
        axes.set_axisbelow(True)
    handles, labels = curves.get_legend_handles_labels()
    columns = len(labels) // 2
    # Legends fill column by column: a row for each cut.
    order = [row * columns + column for column in range(columns) for row in range(2)]
    named = [handles[k] for k in order], [labels[k] for k in order]
    figure.legend(*named, loc="lower center", ncols=columns, fontsize=7.0)
    return (
        figure,
        f"MTF of die {written.die.name} at {drawn.wavelength_nm:g} nm as drawn and as written, and the change",
    )


_WRITTEN_FIGURES = {"corner": _corner, "psf": _spread, "mtf": _transfer}


def _shown(written: Written) -> tuple[Reading, ...]:
    return tuple(Reading) if written.kissing else (Reading.FUSED,)


def _label(who: str, cut: str) -> str:
    return f"{who}: {cut.replace('_', ' ').replace('min', 'minimum')}"
