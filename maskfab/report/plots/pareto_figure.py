"""Restored photographs against emitters: a curve for each open ratio, and given openings beside them.

A curve is drawn as what it says: an opening serves for its own footprint and every smaller one, so it is a stair that
comes from the left. The colours are those of cividis, whose lightness rises alike for colour-blind readers; every curve
also has a mark of its own.
"""

from __future__ import annotations

import io

import matplotlib as mpl
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from maskfab.optimiser.pareto import JudgedOpening, Pareto
from maskfab.report.plots.sheet import INK, QUIET, Drawing, bitmap, place, styled

_MARKS = "osD^vphX"
_WIDTH, _HEIGHT = 7.2, 4.2
_LEFT, _FOOT, _WIDE, _HIGH = 0.6, 0.5, 4.7, 3.4
_LIGHTEST = 0.85
_MOST_IN_LEGEND = 22


@styled
def pareto_png(found: Pareto) -> bytes:
    """The figure as a PNG file."""
    return bitmap(_drawn(found))


@styled
def pareto_drawing(found: Pareto) -> Drawing:
    """The figure, to be looked at or saved."""
    return Drawing(_drawn(found), f"Restored PSNR against footprint of emitters, {len(found.curves)} curves")


@styled
def svg(found: Pareto) -> str:
    """The figure as an SVG file; equal sweeps give equal text."""
    buffer = io.StringIO()
    _drawn(found).savefig(buffer, format="svg", metadata={"Date": None, "Creator": None, "Format": None, "Type": None})
    return buffer.getvalue()


def _drawn(found: Pareto) -> Figure:
    figure = Figure(figsize=(_WIDTH, _HEIGHT), dpi=160)
    figure.set_facecolor("white")
    axes = place(figure, (_LEFT, _FOOT, _WIDE, _HIGH))
    curves = [curve for curve in found.curves if curve.front]
    shades = mpl.colormaps["cividis"](np.linspace(0, _LIGHTEST, len(curves)))
    across = [100 * each.footprint for curve in curves for each in curve.front]
    across += [100 * each.footprint for each in found.compared]
    room = 0.06 * (max(across) - min(across)) + 0.3
    left = max(0.0, min(across) - room)
    # The most open stands highest in the figure, so it is the first in the legend.
    for k, curve in reversed(list(enumerate(curves))):
        ratio = curve.front[0].open_ratio
        label = f"{ratio:.1%} open, {curve.clear_dots} dots"
        _curve(axes, curve.front, left, shades[k], _MARKS[k % len(_MARKS)], label)
    best = [100 * each.footprint for each in found.best], [each.value for each in found.best]
    axes.plot(*best, color=INK, linewidth=0.8, linestyle=(0, (1, 2)), zorder=2, label="bettered by none")
    for number, each in enumerate(found.compared, start=1):
        x, y = 100 * each.footprint, each.value
        axes.plot(x, y, "*", color=INK, markersize=9, zorder=4, label=f"{number}  {each.shape}, {each.open_ratio:.1%}")
        axes.annotate(f"{number}", (x, y), (5, 4), textcoords="offset points", fontsize=7.5)
    axes.set(xlabel="area of each colour's emitter (% of the pixel)", ylabel="expected restored PSNR (dB)")
    axes.set_title("Restored photographs against room for emitters", loc="left")
    axes.grid(color=QUIET, alpha=0.25, linewidth=0.5)
    axes.set_axisbelow(True)
    axes.set_xlim(left, max(across) + room)
    axes.margins(y=0.08)
    for side in ("top", "right"):
        axes.spines[side].set_visible(False)
    handles, labels = axes.get_legend_handles_labels()
    figure.legend(
        handles[:_MOST_IN_LEGEND],
        labels[:_MOST_IN_LEGEND],
        loc="upper left",
        bbox_to_anchor=((_LEFT + _WIDE + 0.02) / _WIDTH, (_FOOT + _HIGH + 0.06) / _HEIGHT),
        fontsize=6.5,
        handlelength=1.6,
        borderaxespad=0,
    )
    return figure


def _curve(axes: Axes, front: tuple[JudgedOpening, ...], left: float, colour: object, mark: str, label: str) -> None:
    across = [100 * each.footprint for each in front]
    up = [each.value for each in front]
    axes.step([left, *across], [up[0], *up], where="pre", color=colour, linewidth=1.1, zorder=2)
    axes.plot(
        across, up, mark, color=colour, markersize=4.5, markeredgecolor=INK, markeredgewidth=0.4, zorder=3, label=label
    )
