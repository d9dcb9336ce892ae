"""The figures of a display: emitters behind an opening, wires between pixels, and what stands in the way of either.

Also the shares of its pixel that were looked at: gains of photographs, and what the display pays.

Colours are those of Okabe and Ito, which colour-blind readers tell apart; every emitter also bears its letter.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from itertools import groupby
from typing import TYPE_CHECKING

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import PathPatch
from matplotlib.path import Path
from numpy.typing import NDArray

from maskfab.base.model import (
    BLACK,
    CIRCUIT,
    CLEAR,
    COLOURS,
    EMITTERS,
    GUTTER,
    VEIL,
    WIRES,
    Layer,
    Panel,
    Point,
    Polygon,
    orient,
)
from maskfab.base.units import UM_PER_NM
from maskfab.display.emitted_light import Tiled, show
from maskfab.display.emitter_rules import Certificate
from maskfab.display.eye import FLAT, TEXT
from maskfab.display.eye_and_life import Judgement
from maskfab.display.feasibility import Feasibility
from maskfab.display.looks import seen
from maskfab.display.pictures import text
from maskfab.display.polygon_check import Violation
from maskfab.display.wiring import Reach, Wiring
from maskfab.mask.outlines import outline, unit_shapes
from maskfab.optics.colour import code_of_light
from maskfab.report.figures import sheet
from maskfab.report.figures.sheet import INK, QUIET, image, img, open_field, place, styled

if TYPE_CHECKING:
    from maskfab.designs.search.share import ShareCurve, SharePoint

_FILL: dict[Layer, str] = {
    BLACK: "#2f343c",
    GUTTER: "#555c66",
    CLEAR: "#ffffff",
    EMITTERS[0]: "#d55e00",
    EMITTERS[1]: "#009e73",
    EMITTERS[2]: "#0072b2",
    WIRES[0]: "#ffc857",  # paler than the upper metal, which grey shows
    WIRES[1]: "#cc79a7",
    VEIL: "#f0e442",
    CIRCUIT: "#ffd58a",
}
_WITNESS = "#f0e442"
_EDGE = "#000000"
"""Of a dashed line, without which it is lost where it crosses what is clear."""
_SIDE = 2.7
_MOST_SHOWN = 8
"""Pixels along a side round a chain."""
_LIT_PIXELS, _LIT_SAMPLES = 24, 21
_SEEN_PIXELS = 48
"""As many as hold three lines of text, and fit beside each other on paper at their true size."""


def pictures(panel: Panel, feasibility: Feasibility) -> dict[str, str]:
    """The figures of one die's display as ``<img>`` elements.

    ``display_placement`` is always there; ``display_wires`` where there are wires, or a proof that there are none;
    ``display_lit`` where there are emitters.
    """
    circuits = feasibility.circuits
    proof = None if circuits is None else circuits.certificate
    if feasibility.emitters is None:
        proof = feasibility.footprint.certificate
    broken = feasibility.broken + (() if circuits is None else circuits.broken)
    drawn = {"display_placement": placement(panel, proof, broken)}
    wires = feasibility.wiring
    if wires is not None and (wires.tracks or wires.laid or wires.failed is not None):
        drawn["display_wires"] = wiring_picture(panel, wires, feasibility.stranded, feasibility.reaches)
    if panel.emitters is not None:
        drawn["display_lit"] = lit(panel)
    return drawn


def eye(panel: Panel, judged: Judgement) -> dict[str, str]:
    """Even light and text as the eye sees them: ``seen_white`` and ``seen_text`` on a die, ``maker_white`` and
    ``maker_text`` on its reference display, where there is one.

    Every picture has :func:`seen_pixels` of the die along a side, so that its true size is known.
    """
    count = seen_pixels(panel.orientations.shape)
    shown = {"seen": Tiled.of(panel, count, count)}
    if judged.reference is not None:
        shown["maker"] = judged.reference.tiled(count, count)
    drawn = {}
    for who, field in shown.items():
        whose = f"opening {panel.opening.name}" if who == "seen" else f"the regular {judged.layout} display"
        for name, picture in (("white", FLAT), ("text", TEXT)):
            light = np.clip(seen(field, judged.viewing, picture), 0, 1)
            levels, palette = sheet.few_colours(np.rint(code_of_light(light) * 255).astype(np.uint8))
            words = f"{'even light' if picture is FLAT else 'text'} on {whose} as the eye sees it"
            drawn[f"{who}_{name}"] = img(sheet.data_uri(sheet.png(levels, palette)), words, "lit")
    return drawn


def seen_pixels(cells: Sequence[int]) -> int:
    """Pixels along a side of the pictures of what the eye sees, of a die with so many rows and columns."""
    return min(_SEEN_PIXELS, *cells)


def lit(panel: Panel) -> str:
    """Some pixels in the middle of the panel that show letters, each sample the light of its own area.

    The letters, the pixels and the samples are the same for every panel, so that these compare; light that only a
    hundredth of the lit samples exceeds is white.
    """
    count = min(_LIT_PIXELS, *panel.orientations.shape)
    light = show(panel, text(_LIT_PIXELS)[:count, :count], _LIT_SAMPLES).rgb
    white = float(np.quantile(light[light > 0], 0.99))
    levels = np.rint(code_of_light(np.clip(np.moveaxis(light, 0, -1) / white, 0, 1)) * 255).astype(np.uint8)
    words = f"{count} x {count} pixels of opening {panel.opening.name} that show black letters on white"
    return img(sheet.data_uri(sheet.png_of_colours(levels)), words, "lit")


@styled
def placement(panel: Panel, certificate: Certificate | None = None, broken: Iterable[Violation] = ()) -> str:
    """One pixel with its emitters, and beside it a few pixels as they meet, as an ``<img>``.

    Circuits are outlined, so that the emitters above them are seen. Where a certificate has a witness, its cells are
    outlined, and so is what breaks a rule.
    """
    figure, (single, several) = _two()
    shown = (BLACK, GUTTER, CLEAR, *EMITTERS, CIRCUIT)
    _draw(single, panel, np.zeros((1, 1), dtype=np.int8), shown)
    _letters(single, panel)
    if certificate is not None and certificate.witness is not None:
        _outline(single, panel, certificate.witness, certificate.cell_nm)
    for rule in broken:
        _dash(single, _path(rule.outlines))
    single.set_title("one pixel")
    _draw(several, panel, panel.orientations[_middle(panel, 4)], shown)
    several.set_title("pixels as they meet")
    words = "placement of the red, green and blue emitters around the opening"
    return image(figure, f"Opening {panel.opening.name}: {words if panel.emitters else 'no emitters fit'}")


@styled
def wiring_picture(
    panel: Panel, wires: Wiring, certificates: Iterable[Certificate] = (), reaches: Iterable[Reach] = ()
) -> str:
    """The wires of one pixel and of a few, and the cuts that bound how many there can be, as an ``<img>``.

    A thin white line is an emitter's way to the pixel's side; a dashed one across pixels is what too few lines pass.
    """
    figure, (single, several) = _two()
    shown = (BLACK, GUTTER, *EMITTERS, CLEAR, VEIL, *WIRES)
    _draw(single, panel, np.zeros((1, 1), dtype=np.int8), shown, faint=frozenset(EMITTERS))
    for certificate in certificates:
        if certificate.witness is not None:
            _outline(single, panel, certificate.witness, certificate.cell_nm)
    for reach in reaches:
        if reach.path is not None:
            y, x = (
                (along + 0.5) * panel.dot_nm * UM_PER_NM + panel.gutter_nm / 2 * UM_PER_NM for along in reach.path.T
            )
            single.plot(x, y, color="white", linewidth=0.8, marker=".", markersize=3, markevery=[0])
    single.set_title("one pixel")
    chain = () if wires.failed is None else wires.failed.chain_nm
    rows, columns = _round(panel, chain) if chain else _middle(panel, 3 if wires.laid is None else 4)
    _draw(several, panel, panel.orientations[rows, columns], shown, faint=frozenset(EMITTERS))
    x0, y0 = columns.start * panel.pitch_nm, rows.start * panel.pitch_nm
    for layer, laid in zip(WIRES, wires.laid or (), strict=False):
        several.plot(*_trail(laid.paths, x0, y0), color=_FILL[layer], linewidth=0.8)
    trail = _trail((chain,), x0, y0)
    several.plot(*trail, color=_EDGE, linewidth=2.2)
    several.plot(*trail, color=_WITNESS, linewidth=1.1, linestyle=(0, (2, 1)))
    several.set_title("where too few lines pass" if chain else "pixels as they meet")
    return image(figure, f"Wires of opening {panel.opening.name}: orange lower metal, purple upper, yellow transparent")


def _two() -> tuple[Figure, tuple[Axes, Axes]]:
    figure = Figure(figsize=(2 * _SIDE + 0.75, _SIDE + 0.5))
    return figure, (place(figure, (0.1, 0.2, _SIDE, _SIDE)), place(figure, (_SIDE + 0.55, 0.2, _SIDE, _SIDE)))


def _middle(panel: Panel, cells: int) -> tuple[slice, slice]:
    rows, columns = panel.orientations.shape
    high, wide = min(rows, cells), min(columns, cells)
    bottom, left = (rows - high) // 2, (columns - wide) // 2
    return slice(bottom, bottom + high), slice(left, left + wide)


def _round(panel: Panel, chain: Sequence[Point]) -> tuple[slice, slice]:
    """Rows and columns of the pixels through which a chain goes, as many of each; those in the middle of a long one."""
    spans = [sorted((min(along), max(along))) for along in zip(*chain, strict=True)]
    (left, right), (bottom, top) = ([end // panel.pitch_nm for end in span] for span in spans)
    count = min(_MOST_SHOWN, max(right - left, top - bottom) + 1)

    def span(low: int, high: int, side: int) -> slice:
        first = min(max(0, (low + high + 1 - count) // 2), max(0, side - count))
        return slice(first, min(side, first + count))

    rows, columns = panel.orientations.shape
    return span(bottom, top, rows), span(left, right, columns)


def _trail(paths: Iterable[Sequence[Point]], x0: int, y0: int) -> tuple[list[float], list[float]]:
    """Paths as one line that breaks between them, micrometres from a place."""
    broken = (math.nan, math.nan)
    points = [point for path in paths for point in (*((x - x0, y - y0) for x, y in path), broken)]
    return [x * UM_PER_NM for x, _ in points], [y * UM_PER_NM for _, y in points]


def _draw(
    axes: Axes, panel: Panel, cells: NDArray[np.int8], layers: tuple[Layer, ...], faint: frozenset[Layer] = frozenset()
) -> None:
    pitch = panel.pitch_nm
    rows, columns = cells.shape
    axes.set_facecolor(_FILL[BLACK])
    shapes = {cell: unit_shapes(panel, cell) for cell in np.unique(cells).tolist()}
    for layer in layers:
        outlines = {cell: _outlines(unit.get(layer, ())) for cell, unit in shapes.items()}
        places = [(np.array(place[::-1]) * pitch * UM_PER_NM, int(cell)) for place, cell in np.ndenumerate(cells)]
        points = np.concatenate([outlines[cell][0] + place for place, cell in places])
        drawn = Path(points, np.concatenate([outlines[cell][1] for _, cell in places]))
        alpha = 0.35 if layer in faint else 0.6 if layer is VEIL else 1.0
        inside, width = ("none", 0.7) if layer is CIRCUIT else (_FILL[layer], 0.1)
        # A hair of edge closes the seams that drawing programs leave between neighbours. Adding it as a patch would
        # measure it first, point by point, and the frame is set anyway.
        axes.add_artist(PathPatch(drawn, facecolor=inside, edgecolor=_FILL[layer], linewidth=width, alpha=alpha))
    _frame(axes, pitch * columns * UM_PER_NM, pitch * rows * UM_PER_NM)


def _frame(axes: Axes, wide_um: float, high_um: float) -> None:
    axes.set(xlim=(0, wide_um), ylim=(0, high_um), aspect="equal", xticks=[], yticks=[])
    for spine in axes.spines.values():
        spine.set_color(QUIET)
    bar = 10 ** np.floor(np.log10(wide_um / 3))
    bar *= max(step for step in (1, 2, 5) if step * bar <= wide_um / 3)
    axes.plot([0, bar], [-0.03 * high_um] * 2, color=INK, linewidth=1.5, clip_on=False, solid_capstyle="butt")
    axes.text(bar * 1.08, -0.03 * high_um, f"{bar:g} µm", va="center", fontsize=7)


def _letters(axes: Axes, panel: Panel) -> None:
    """R, G and B on a cell of each emitter's largest width, for readers who do not see the colours."""
    if panel.emitters is None:
        return
    labels = orient(panel.emitters.labels, 0)
    half = panel.gutter_nm / 2
    for number, colour in enumerate(COLOURS, 1):
        place_of = np.argwhere(labels == number)
        if place_of.size:
            middle = place_of.mean(axis=0)
            row, column = place_of[abs(place_of - middle).max(axis=1).argmin()]
            x, y = ((index + 0.5) * panel.emitters.cell_nm + half for index in (column, row))
            axes.text(
                x * UM_PER_NM,
                y * UM_PER_NM,
                colour[0].upper(),
                color="white",
                ha="center",
                va="center",
                fontsize=9,
                weight="bold",
            )


def _outline(axes: Axes, panel: Panel, witness: NDArray[np.bool_], cell_nm: int) -> None:
    half = panel.gutter_nm // 2
    _dash(axes, _path(outline(witness, cell_nm, (half, half))))


def _dash(axes: Axes, around: Path) -> None:
    axes.add_artist(PathPatch(around, facecolor="none", edgecolor=_EDGE, linewidth=2.2))
    axes.add_artist(PathPatch(around, facecolor="none", edgecolor=_WITNESS, linewidth=1.1, linestyle=(0, (2, 1))))


def _path(polygons: Iterable[Polygon]) -> Path:
    """Outlines as one path: as many paths take ten times as long to draw."""
    points, codes = _outlines(polygons)
    return Path(points, codes)


def _outlines(polygons: Iterable[Polygon]) -> tuple[NDArray[np.float64], NDArray[np.uint8]]:
    """Points in micrometres, float64 [n, 2], and what leads to each."""
    points: list[Point] = []
    codes: list[np.uint8] = []
    for polygon in polygons:
        points += [*polygon, polygon[0]]
        codes += [Path.MOVETO, *[Path.LINETO] * (len(polygon) - 1), Path.CLOSEPOLY]
    return np.array(points).reshape(-1, 2) * UM_PER_NM, np.array(codes, dtype=np.uint8)


_SHARES_SIZE = (5.4, 3.6)
_LEVELS = (("#0072b2", "o"), ("#d55e00", "s"), ("#009e73", "D"), ("#cc79a7", "^"))
"""Colours and marks of levels, told apart by those who see fewer colours, too."""


@styled
def shares(found: ShareCurve) -> str:
    """Gain and life over the share of the pixel that is clear, as an ``<img>``; a ring is round the chosen point."""
    figure = Figure(figsize=_SHARES_SIZE)
    gains, lives = figure.subplots(2, 1, sharex=True, height_ratios=(3, 1.4))
    levels = groupby(found.fitting, key=lambda point: point.zone)
    for (words, own), (colour, mark) in zip(levels, _LEVELS, strict=False):
        points = list(own)
        for axes, value in ((gains, found.gain_db), (lives, _life_of)):
            at = [100 * point.share for point in points], [value(point) for point in points]
            axes.plot(*at, color=colour, lw=1.2, label=words)
            for point, x, y in zip(points, *at, strict=True):
                size = 3 if found.photographed and point.error_db is None else 6
                axes.plot(x, y, mark, ms=size, mec=colour, mfc=colour if point.holds else "none")
    if found.best is not None:
        for axes, height in ((gains, found.gain_db(found.best)), (lives, _life_of(found.best))):
            axes.plot(100 * found.best.share, height, "o", ms=13, mfc="none", mec=INK, mew=1.4)
    _named_axes(gains, "gain, dB")
    _named_axes(lives, "life")
    lives.set_xlabel("clear share of the pixel, %")
    gains.legend(loc="upper left", frameon=False, fontsize=8)
    figure.subplots_adjust(left=0.11, right=0.98, top=0.97, bottom=0.13, hspace=0.12)
    return image(figure, "gain of restored photographs and life of emitters over the clear share of the pixel")


def _named_axes(axes: Axes, name: str) -> None:
    open_field(axes)
    axes.set_ylabel(name)
    axes.margins(0.06, 0.14)


def _life_of(point: SharePoint) -> float:
    """Life over that of the display around; 0 where none is told."""
    return next((number.value for number in point.numbers if number.name == "life"), 0.0)
