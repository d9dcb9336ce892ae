"""Dies of several reports: light against restored photographs, with the intervals of their differences."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from matplotlib.figure import Figure

from maskfab.measurement.restored import middle_level
from maskfab.report.page.photograph_table import difference, mean_psnr, scores
from maskfab.report.plots.die_figures import OKABE_ITO
from maskfab.report.plots.sheet import INK, QUIET, Drawing, place, styled

_MARKS = "osD^vphX"


@styled
def trade(document: Mapping[str, Any]) -> Drawing:
    """Open ratio against gain over the reference, one mark for each die; a die that none betters in both is filled."""
    taken = document["photographs"]
    level, reference = middle_level(taken["levels_db"]), taken["reference"]
    light = {
        die["name"]: 100 * row["value"]
        for die in document["dies"]
        for row in die["quantities"]
        if row["name"] == "open_ratio"
    }
    names = [name for name in scores(taken, level) if name in light]
    figure = Figure(figsize=(8.6, 4.2))
    axes = place(figure, (0.7, 0.5, 4.9, 3.4))
    base = mean_psnr(taken, level, reference)
    gains = {name: mean_psnr(taken, level, name) - base for name in names}
    for number, name in enumerate(names):
        bettered = any(
            light[other] >= light[name] and gains[other] >= gains[name] and other != name
            and (light[other], gains[other]) != (light[name], gains[name])
            for other in names
        )  # fmt: skip
        colour = OKABE_ITO[number % len(OKABE_ITO)]
        width = 0.0 if name == reference else difference(taken, level, name, reference).half_width
        axes.errorbar(
            light[name],
            gains[name],
            yerr=width if width > 0 else None,
            color=colour,
            marker=_MARKS[number % len(_MARKS)],
            markerfacecolor="white" if bettered else colour,
            markersize=6,
            capsize=2,
            linestyle="none",
            label=name,
        )
    axes.axhline(0, color=QUIET, linewidth=0.7)
    axes.set(xlabel="open ratio (%)", ylabel=f"gain over {reference} (dB)")
    axes.grid(visible=True, color=QUIET, alpha=0.25, linewidth=0.5)
    axes.tick_params(colors=INK)
    figure.legend(loc="upper left", bbox_to_anchor=(5.75 / 8.6, 3.95 / 4.2), fontsize=7)
    return Drawing(figure, f"Gain over {reference} at {level:g} dB of light against open ratio, {len(names)} dies")
