"""The rise of a search: its best value against what was judged."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise

from matplotlib.figure import Figure

from maskfab.report.plots.sheet import INK, QUIET, Drawing, place, styled

_WIDE, _HIGH, _LEFT, _FOOT, _TOP = 5.6, 1.9, 0.75, 0.5, 0.15


@styled
def search_drawing(bettered: Sequence[Sequence[float]], last: int, value: str, judged: str) -> Drawing | None:
    """A stair of the best values for each stage that began anew; None where the best was bettered less than twice.

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
    runs = stages(bettered)
    ends = [*(run[0][0] for run in runs[1:]), last]
    for run, end in zip(runs, ends, strict=True):
        numbers, values = zip(*run, strict=True)
        axes.step([*numbers, max(end, numbers[-1])], [*values, values[-1]], where="post", color=INK, linewidth=1.1)
        axes.plot(numbers, values, "o", color=INK, markersize=3)
    axes.set_xlabel(judged)
    axes.set_ylabel(value.split(", ", maxsplit=1)[0] + (" (dB)" if ", dB" in value else ""))
    axes.grid(color=QUIET, alpha=0.25, linewidth=0.5)
    axes.set_axisbelow(True)
    for side in ("top", "right"):
        axes.spines[side].set_visible(False)
    numbers, values = zip(*bettered, strict=True)
    return Drawing(figure, f"{value}: {values[0]:.4g} at {numbers[0]}, {values[-1]:.4g} from {numbers[-1]} on")


def stages(bettered: Sequence[Sequence[float]]) -> list[list[Sequence[float]]]:
    """Parts in which the values go one way, that of the first two: an annealing under rules may begin below a scan."""
    upwards = bettered[1][1] > bettered[0][1]
    found = [[bettered[0]]]
    for before, each in pairwise(bettered):
        if (each[1] > before[1]) is upwards:
            found[-1].append(each)
        else:
            found.append([each])
    return found
