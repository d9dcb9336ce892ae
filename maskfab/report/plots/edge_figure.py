"""MTFs measured across edges, with their bands, beside what was designed: one field for each edge."""

from __future__ import annotations

from collections.abc import Sequence

from matplotlib.axes import Axes
from matplotlib.figure import Figure

from maskfab.capture.measured_edges import MeasuredEdge, MeasuredEdges
from maskfab.capture.mtf_file import MtfCurve
from maskfab.report.plots.die_figures import OKABE_ITO
from maskfab.report.plots.sheet import INK, Drawing, place, styled

_LEFT, _FOOT, _WIDE, _HIGH, _ACROSS, _UP, _LEGEND = 0.55, 0.85, 3.2, 2.4, 0.35, 0.35, 0.35
_MOST_ACROSS = 3
_MOST_IN_LEGEND = 5
_STYLES = ((0, (5, 1.5)), (0, (1, 1)), (0, (3, 1, 1, 1)), (0, (6, 1, 1, 1, 1, 1)))
_LIMIT_CY_PER_PX = 0.5


@styled
def edges_drawing(found: MeasuredEdges, title: str = "") -> Drawing:
    """Every edge's MTF with its band, and the designed ones through the same window, up to one cycle per pixel."""
    columns = min(len(found.edges), _MOST_ACROSS)
    rows = -(-len(found.edges) // columns)
    width = _LEFT + columns * (_WIDE + _ACROSS)
    height = _LEGEND + rows * (_FOOT + _HIGH) + _UP
    figure = Figure(figsize=(width, height), dpi=160)
    figure.set_facecolor("white")
    lights = list(dict.fromkeys(designed.light for each in found.edges for designed in each.designed))
    for k, each in enumerate(found.edges):
        left = _LEFT + (k % columns) * (_WIDE + _ACROSS)
        bottom = _LEGEND + (rows - 1 - k // columns) * (_FOOT + _HIGH) + _FOOT - 0.3
        axes = place(figure, (left, bottom, _WIDE, _HIGH))
        _draw(axes, each, lights)
        if k % columns == 0:
            axes.set_ylabel("MTF")
    named = {}
    for axes in figure.axes:
        named.update({label: handle for handle, label in zip(*axes.get_legend_handles_labels(), strict=True)})
    across = min(len(named), _MOST_IN_LEGEND if columns > 1 else 2)
    figure.legend(named.values(), named, loc="lower center", ncols=across, fontsize=7.5)
    if title:
        figure.text(_LEFT / width, 1 - 0.08 / height, title, va="top", fontsize=10)
    return Drawing(figure, _words(found.edges, found.die))


def _draw(axes: Axes, measured: MeasuredEdge, lights: Sequence[str]) -> None:
    edge = measured.edge
    frequency = edge.frequency_cy_per_px
    if edge.low is not None and edge.high is not None:
        axes.fill_between(frequency, edge.low, edge.high, color="#bcc3cb", linewidth=0, label="95 % band")
    for designed in measured.designed:
        k = lights.index(designed.light)
        axes.plot(
            frequency,
            designed.seen,
            color=OKABE_ITO[k % (len(OKABE_ITO) - 1)],
            linestyle=_STYLES[k % len(_STYLES)],
            linewidth=1.2,
            label=f"designed, {designed.light}",
        )
    axes.plot(frequency, edge.mtf, color=INK, linewidth=1.1, label="measured")
    axes.axvline(_LIMIT_CY_PER_PX, color="#9aa3ad", linewidth=0.6)
    axes.set(xlim=(0, float(frequency[-1])), ylim=(0, max(1.05, float(edge.mtf.max()))))
    axes.set(xlabel="frequency (cycles/pixel)")
    axes.grid(color="#e3e6ea", linewidth=0.5)
    axes.set_axisbelow(True)
    title, per_mm = measured.title, edge.frequency_cy_per_mm
    if per_mm is not None:
        title += " (top: cy/mm)"
        _label_top(axes, float(frequency[-1]), float(per_mm[-1]))
    axes.set_title(title, loc="left", pad=14, fontsize=7.5)


def _label_top(axes: Axes, most_per_px: float, most_per_mm: float) -> None:
    top = axes.get_xaxis_transform()
    for share in (0.0, 0.25, 0.5, 0.75, 1.0):
        place, text = (share * most_per_px, 1), f"{share * most_per_mm:.4g}"
        axes.annotate(text, place, (0, 3), xycoords=top, textcoords="offset points", ha="center", va="bottom")


def _words(edges: Sequence[MeasuredEdge], die: str | None) -> str:
    beside = f" beside the design of {die}" if die else ""
    if isinstance(edges[0].edge, MtfCurve):
        return f"MTF of {edges[0].edge.name}{beside}"
    return f"MTF across {len(edges)} slanted edge{'s' if len(edges) > 1 else ''} with 95 % bands{beside}"
