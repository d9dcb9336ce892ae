"""Designs for a display: restored photographs against emitters, one field for each number of lines.

A curve is drawn as what it says: a design serves for its own footprint and every smaller one, and for its own lines and
fewer, so it is a stair that comes from the left and stands in every field that it serves. A given opening is a star,
hollow where fewer lines pass it than the field asks for. The colours are those of
cividis, whose lightness rises alike for colour-blind readers; every curve also has a mark of its own.
"""

from __future__ import annotations

import io

import matplotlib as mpl
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from maskfab.optimiser.pareto.front import FrontPoint, Pareto
from maskfab.report.plots.sheet import INK, QUIET, Drawing, bitmap, place, styled

_MARKS = "osD^vphX"
_LEFT, _FOOT, _WIDE, _HIGH, _GAP, _LEGEND = 0.6, 0.5, 3.4, 3.4, 0.2, 2.0
_MOST_FIELDS = 4
_LIGHTEST = 0.85
_MOST_IN_LEGEND = 22


@styled
def pareto_png(found: Pareto) -> bytes:
    """The figure as a PNG file."""
    return bitmap(_drawn(found))


@styled
def pareto_drawing(found: Pareto) -> Drawing:
    """The figure, to be looked at or saved."""
    said = f"Restored PSNR against footprint of emitters, {len(found.curves)} open ratios"
    return Drawing(_drawn(found), f"{said}, {' and '.join(map(str, _fields(found)))} lines")


@styled
def svg(found: Pareto) -> str:
    """The figure as an SVG file; equal sweeps give equal text."""
    buffer = io.StringIO()
    _drawn(found).savefig(buffer, format="svg", metadata={"Date": None, "Creator": None, "Format": None, "Type": None})
    return buffer.getvalue()


def _fields(found: Pareto) -> tuple[int, ...]:
    """Numbers of lines that some design serves, at most so many."""
    most = max(each.lines for each in found.points)
    served = [lines for lines in found.lines if lines <= most]
    return tuple(served[-_MOST_FIELDS:])


def _drawn(found: Pareto) -> Figure:
    fields = _fields(found)
    width = _LEFT + len(fields) * (_WIDE + _GAP) + _LEGEND
    height = _FOOT + _HIGH + 0.4
    figure = Figure(figsize=(width, height), dpi=160)
    figure.set_facecolor("white")
    first: Axes | None = None
    for k, lines in enumerate(fields):
        axes = place(figure, (_LEFT + k * (_WIDE + _GAP), _FOOT, _WIDE, _HIGH))
        if first is not None:
            axes.sharex(first)
            axes.sharey(first)
            axes.tick_params(labelleft=False)
        first = first or axes
        _field(axes, found, lines)
        axes.set_title(f"{lines} lines each way" if lines else "not wired", loc="left")
    assert first is not None
    first.set_ylabel("expected restored PSNR (dB)")
    handles, labels = first.get_legend_handles_labels()
    figure.legend(
        handles[:_MOST_IN_LEGEND],
        labels[:_MOST_IN_LEGEND],
        loc="upper left",
        bbox_to_anchor=((width - _LEGEND) / width, (_FOOT + _HIGH + 0.06) / height),
        fontsize=6.5,
        handlelength=1.6,
        borderaxespad=0,
    )
    return figure


def _field(axes: Axes, found: Pareto, lines: int) -> None:
    curves = [curve for curve in found.curves if curve.front]
    shades = mpl.colormaps["cividis"](np.linspace(0, _LIGHTEST, len(curves)))
    across = [100 * each.footprint for each in found.points]
    across += [100 * each.footprint for each in found.compared]
    room = 0.06 * (max(across) - min(across)) + 0.3
    left = max(0.0, min(across) - room)
    # The most open stands highest in the figure, so it is the first in the legend.
    for k, curve in reversed(list(enumerate(curves))):
        ratio = curve.front[0].judged.open_ratio
        label = f"{ratio:.1%} open, {curve.clear_dots} dots"
        serving = [each for each in curve.front if each.lines >= lines]
        mark = _MARKS[k % len(_MARKS)]
        _curve(axes, serving, left, shades[k], mark, label)
        _denser(axes, [each for each in curve.denser if each.lines >= lines], shades[k], mark)
    for number, each in enumerate(found.compared, start=1):
        label = f"{number}  {each.shape}, {each.open_ratio:.1%}, {each.lines} lines"
        x, y = 100 * each.footprint, each.value
        filled = INK if each.lines >= lines else "white"
        axes.plot(x, y, "*", color=INK, markerfacecolor=filled, markersize=9, zorder=4, label=label)
        axes.annotate(f"{number}", (x, y), (5, 4), textcoords="offset points", fontsize=7.5)
    axes.set_xlabel("area of each colour's emitter (% of the pixel)")
    axes.grid(color=QUIET, alpha=0.25, linewidth=0.5)
    axes.set_axisbelow(True)
    axes.set_xlim(left, max(across) + room)
    axes.margins(y=0.08)
    for side in ("top", "right"):
        axes.spines[side].set_visible(False)


def _denser(axes: Axes, serving: list[FrontPoint], colour: object, mark: str) -> None:
    """Hollow marks with the clear share of the middle beside them."""
    for each in serving:
        x, y = 100 * each.footprint, each.value
        axes.plot(
            x, y, mark, markerfacecolor="white", markeredgecolor=colour, markeredgewidth=1.4, markersize=7, zorder=3
        )
        axes.annotate(f"{each.densest:.0%}", (x, y), (6, -3), textcoords="offset points", fontsize=6.5, color=INK)


def _curve(axes: Axes, serving: list[FrontPoint], left: float, colour: object, mark: str, label: str) -> None:
    """The stair of those that none betters in this field, and marks for all that serve."""
    across = [100 * each.footprint for each in serving]
    up = [each.value for each in serving]
    widest, stair_x, stair_y = left, [left], []
    for x, y in sorted(zip(across, up, strict=True), key=lambda pair: (-pair[1], -pair[0])):
        if x > widest:
            stair_x.append(x)
            stair_y.append(y)
            widest = x
    if stair_y:
        axes.step(stair_x, [stair_y[0], *stair_y], where="pre", color=colour, linewidth=1.1, zorder=2)
    axes.plot(
        across, up, mark, color=colour, markersize=4.5, markeredgecolor=INK, markeredgewidth=0.4, zorder=3, label=label
    )
