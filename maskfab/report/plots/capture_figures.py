"""Figures of a measured die: what was captured beside what is expected, on one scale; and their MTF."""

from __future__ import annotations

from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from maskfab.base.arrays import Floats
from maskfab.capture.frames import PIXELS_OF
from maskfab.capture.measured import Measured
from maskfab.capture.mtf_band import MtfBand
from maskfab.report.plots.number_text import short
from maskfab.report.plots.sheet import INK, QUIET, Drawing, place, styled

_SIDE, _LEFT, _TOP, _GAP, _FOOT, _BAR = 2.35, 0.7, 0.3, 0.25, 0.45, 0.7
_DECADES = 5
_MOST_SIGMA = 4.0
_COLOURS = {"R": "#D55E00", "G": "#009E73", "B": "#0072B2", "-": INK}


@styled
def captured_drawing(found: Measured) -> Drawing:
    """Captured, expected, and their difference in standard deviations, a row for each colour."""
    chosen = _first_of_each(found)
    width = _LEFT + 3 * (_SIDE + _GAP) + _BAR
    height = _TOP + len(chosen) * (_SIDE + _GAP) + _FOOT
    figure = Figure(figsize=(width, height), dpi=120)
    for row, k in enumerate(chosen):
        taken, expected = found.taken[k], found.fit.predicted[k]
        beneath = found.fit.beneath[taken.pixels.colour]
        peak = float((expected - beneath).max())
        bottom = height - _TOP - (row + 1) * _SIDE - row * _GAP
        shown = (
            _logarithm(np.where(taken.valid, taken.light, np.nan) - beneath, peak),
            _logarithm(expected - beneath, peak),
        )
        ends = _ends(taken.pixels.x_um, taken.pixels.y_um)
        for column, values in enumerate(shown):
            axes = _axes(figure, column, bottom)
            axes.imshow(values, cmap="magma", vmin=-_DECADES, vmax=0, extent=ends, interpolation="none")
            _named(
                axes, ("captured", "expected of the fitted die")[column] if row == 0 else "", column, row, len(chosen)
            )
            if column == 0:
                axes.set_ylabel(f"{PIXELS_OF[taken.pixels.colour]}, y (µm)")
        axes = _axes(figure, 2, bottom)
        residual = np.where(taken.valid, found.fit.residuals[k], np.nan)
        drawn = axes.imshow(
            residual, cmap="PuOr", vmin=-_MOST_SIGMA, vmax=_MOST_SIGMA, extent=ends, interpolation="none"
        )
        _named(axes, "difference, in standard deviations" if row == 0 else "", 2, row, len(chosen))
        bar = place(figure, (_LEFT + 3 * (_SIDE + _GAP) - _GAP + 0.08, bottom, 0.1, _SIDE))
        figure.colorbar(drawn, cax=bar)
    words = f"captured, expected and their difference, {len(chosen)} colours"
    return Drawing(figure, words)


@styled
def capture_mtf_drawing(found: Measured) -> Drawing:
    """MTF of what was captured over the band that noise allows the fitted die, for each grid of pixels."""
    figure = Figure(figsize=(9.0, 3.6), dpi=120)
    axes = place(figure, (0.75, 0.5, 5.6, 2.9))
    seen: set[str] = set()
    for band in found.bands:
        if band.colour in seen:
            continue
        seen.add(band.colour)
        _curves(axes, band)
    axes.set_xlabel("frequency on the sensor (cycles per mm)")
    axes.set_ylabel("modulation, window and noise included")
    axes.set_yscale("log")
    # Powers in the formulas' notation would show as their source, for no text is a formula here.
    axes.yaxis.set_major_formatter(lambda value, _: short(value))
    axes.grid(color=QUIET, alpha=0.25, linewidth=0.5)
    axes.legend(loc="upper left", bbox_to_anchor=(1.02, 1.0), fontsize=7)
    for side in ("top", "right"):
        axes.spines[side].set_visible(False)
    return Drawing(figure, "MTF of the captured picture and of the fitted die")


def _curves(axes: Axes, band: MtfBand) -> None:
    colour, name = _COLOURS[band.colour], PIXELS_OF[band.colour]
    for row, (style, kind) in enumerate((("-", "mean"), (":", "minimum"))):
        axes.fill_between(band.frequencies, band.low[row], band.high[row], color=colour, alpha=0.22, linewidth=0)
        label = f"{name}, {kind} over directions"
        axes.plot(band.frequencies, band.measured[row], style, color=colour, linewidth=1.2, label=label)
    if band.parted_per_mm is not None:
        axes.axvline(band.parted_per_mm, color=colour, linewidth=0.8, dashes=(2, 2))


def _first_of_each(found: Measured) -> list[int]:
    colours = [each.pixels.colour for each in found.taken]
    return [colours.index(colour) for colour in dict.fromkeys(colours)]


def _logarithm(values: Floats, peak: float) -> Floats:
    return np.asarray(np.log10(np.clip(values / peak, 10.0**-_DECADES, 1.0)))


def _ends(x_um: Floats, y_um: Floats) -> tuple[float, float, float, float]:
    half = abs(x_um[1] - x_um[0]) / 2
    return float(x_um[0] - half), float(x_um[-1] + half), float(y_um[-1] - half), float(y_um[0] + half)


def _axes(figure: Figure, column: int, bottom: float) -> Axes:
    return place(figure, (_LEFT + column * (_SIDE + _GAP), bottom, _SIDE, _SIDE))


def _named(axes: Any, title: str, column: int, row: int, rows: int) -> None:
    axes.set_title(title, loc="left")
    if column:
        axes.tick_params(labelleft=False)
    if row == rows - 1:
        axes.set_xlabel("x (µm)")
    else:
        axes.tick_params(labelbottom=False)
