"""The rise of a search: its best value against what was judged."""

from __future__ import annotations

from collections.abc import Sequence

from matplotlib.figure import Figure

from maskfab.report.plots.sheet import INK, QUIET, Drawing, place, styled

_WIDE, _HIGH, _LEFT, _FOOT, _TOP = 5.6, 1.9, 0.75, 0.5, 0.15


@styled
def search_drawing(bettered: Sequence[Sequence[float]], last: int, value: str, judged: str) -> Drawing | None:
    """A stair of the best values; None where the best was bettered less than twice.

    Args:
        bettered: how many were judged when the best was bettered, and its value.
        last: how many were judged in all.
        value: what the values are, with their unit.
        judged: what is counted.
    """
    if len(bettered) < 2:
        return None
    figure = Figure(figsize=(_LEFT + _WIDE + 0.15, _TOP + _HIGH + _FOOT))
    figure.set_facecolor("white")
    axes = place(figure, (_LEFT, _FOOT, _WIDE, _HIGH))
    numbers, values = zip(*bettered, strict=True)
    axes.step([*numbers, max(last, numbers[-1])], [*values, values[-1]], where="post", color=INK, linewidth=1.1)
    axes.plot(numbers, values, "o", color=INK, markersize=3)
    axes.set_xlabel(judged)
    axes.set_ylabel(value.split(", ", maxsplit=1)[0] + (" (dB)" if ", dB" in value else ""))
    axes.grid(color=QUIET, alpha=0.25, linewidth=0.5)
    axes.set_axisbelow(True)
    for side in ("top", "right"):
        axes.spines[side].set_visible(False)
    return Drawing(figure, f"{value}: {values[0]:.4g} at {numbers[0]}, {values[-1]:.4g} from {numbers[-1]} on")
