"""The figures of a study: scores along its axis, and the optics and restored photographs of every die."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from itertools import product

import matplotlib as mpl
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from numpy.typing import NDArray

from maskfab.base.arrays import Floats
from maskfab.measurement.claims import Take
from maskfab.measurement.study import Study
from maskfab.model import Die, DieOptics, Panel, Psf
from maskfab.report.plots import png
from maskfab.report.plots.design_figures import tile
from maskfab.report.plots.die_figures import OKABE_ITO, mtf_comparison, panel_thumbnail
from maskfab.report.plots.sheet import QUIET, Drawing, img, place, styled
from maskfab.units import dpi

_MARKS = "osD^vPX"
_LINES = ("-", (0, (5, 1.5)), (0, (3, 1, 1, 1)), (0, (1, 1)))
_WIDE, _HIGH, _LEFT, _FOOT, _TOP, _GAP, _LEGEND = 3.0, 2.1, 0.55, 0.62, 0.3, 0.62, 2.0
_ROWS = (("psnr", "PSNR (dB)"), ("ssim", "SSIM"))
_MODULATION_DECADES = 3


@styled
def scores_figure(study: Study) -> Drawing:
    """Mean scores along the study's axis: a column for each protocol, PSNR over SSIM, a curve for each die."""
    axis = study.plan.study.axis
    curves = _curves(study)
    columns = list(dict.fromkeys(key[0] for key in curves))
    labels = list(dict.fromkeys(key[1] for key in curves))
    ticks = list(dict.fromkeys(x for points in curves.values() for x, _ in points))
    words = all(isinstance(tick, str) for tick in ticks)
    # One protocol has its scores side by side, several have them one above the other.
    across, rows = (2, 1) if len(columns) == 1 else (len(columns), 2)
    figure = Figure(
        figsize=(_LEFT + across * (_WIDE + _GAP) + _LEGEND, _TOP + rows * _HIGH + (rows - 1) * _GAP / 2 + _FOOT)
    )
    for (column, protocol), (row, (measure, title)) in product(enumerate(columns), enumerate(_ROWS)):
        right, down = (row, 0) if rows == 1 else (column, row)
        bottom = _FOOT + (rows - 1 - down) * (_HIGH + _GAP / 2)
        axes = place(figure, (_LEFT + right * (_WIDE + _GAP), bottom, _WIDE, _HIGH))
        for number, label in enumerate(labels):
            points = curves.get((protocol, label))
            if points:
                at = [float(ticks.index(x) if words else x) for x, _ in points]
                _curve(axes, at, [_mean(study, of, measure) for _, of in points], number, label, joined=not words)
        lowest = down == rows - 1
        _dress(axes, ticks if words else None, lowest=lowest, title=title if right == row * (rows == 1) else "")
        if down == 0:
            axes.set_title(f"protocol {protocol}", loc="left")
        if lowest:
            axes.set_xlabel(_AXES[axis])
    handles, told = figure.axes[0].get_legend_handles_labels()
    beside = (1 - _LEGEND / figure.get_size_inches()[0], 0.5)
    figure.legend(handles, told, loc="center left", bbox_to_anchor=beside, borderaxespad=0, fontsize=7.5)
    return Drawing(figure, f"{study.plan.study.figure}: mean PSNR and SSIM of {len(study.scenes)} scenes, by {axis}")


_AXES: Mapping[str, str] = {
    "level": "signal-to-noise ratio of white (dB)",
    "dpi": "pixels per inch of the display (DPI)",
    "restorer": "",
    "case": "",
}


def _curves(study: Study) -> dict[tuple[str, str], list[tuple[float | str, Take]]]:
    """Points of every curve, by protocol and label; several restorers, levels or cases off the axis part curves."""
    axis, panels = study.plan.study.axis, study.plan.panels
    kinds: dict[tuple[str, str], bool] = {
        (protocol, key): len({getattr(take, key) for take in study.scores if take.protocol == protocol}) > 1
        for protocol in study.plan.study.protocols
        for key in ("case", "level_db", "restorer")
    }
    found: dict[tuple[str, str], list[tuple[float | str, Take]]] = {}
    for take in study.scores:
        along: Mapping[str, float | str] = {
            "level": take.level_db,
            "dpi": round(dpi(panels[take.die].cell_size.pitch_um), 1),
            "restorer": take.restorer,
            "case": take.case,
        }
        panel = panels[take.die]
        label = f"{panel.opening.name}, {panel.tiling.value}" if axis == "dpi" else take.die
        more = [take.case] if kinds[take.protocol, "case"] and axis != "case" else []
        more += [f"{take.level_db:g} dB"] if kinds[take.protocol, "level_db"] and axis != "level" else []
        more += [take.restorer] if kinds[take.protocol, "restorer"] and axis != "restorer" else []
        found.setdefault((take.protocol, ", ".join([label, *more])), []).append((along[axis], take))
    return {
        key: points if any(isinstance(x, str) for x, _ in points) else sorted(points, key=lambda point: point[0])
        for key, points in found.items()
    }


def _mean(study: Study, of: Take, measure: str) -> float:
    return float(np.mean([getattr(score, measure) for score in study.scores[of]]))


def _curve(axes: Axes, x: Sequence[float], y: Sequence[float], number: int, label: str, *, joined: bool) -> None:
    axes.plot(
        x,
        y,
        color=OKABE_ITO[number % len(OKABE_ITO)],
        linestyle=_LINES[number // len(OKABE_ITO) % len(_LINES)] if joined else (0, (1, 3)),
        marker=_MARKS[number % len(_MARKS)],
        markersize=4.5,
        linewidth=1.2 if joined else 0.7,
        label=label,
    )


def _dress(axes: Axes, words: Sequence[object] | None, *, lowest: bool, title: str) -> None:
    axes.set_ylabel(title)
    axes.grid(color=QUIET, alpha=0.25, linewidth=0.5)
    axes.set_axisbelow(True)
    axes.margins(x=0.06, y=0.1)
    for side in ("top", "right"):
        axes.spines[side].set_visible(False)
    if words is not None:
        axes.set_xticks(range(len(words)), [str(each) for each in words], rotation=20, ha="right")
    axes.tick_params(labelbottom=lowest)


def optics_figure(study: Study) -> Drawing:
    """Radial-minimum MTF of every die at the longest wavelength."""
    dies = [
        DieOptics(_alone(name, study.plan.panels[name]), (each.psf,), each.mtfs[:1], ())
        for name, each in study.optics.items()
    ]
    return mtf_comparison(dies)


def _alone(name: str, panel: Panel) -> Die:
    return Die(name, name, panel, (0, 0), max(panel.size_nm))


def optics_tiles(study: Study) -> dict[str, dict[str, str]]:
    """``<img>`` elements of cells, PSF and autocorrelation, by die: cells on one scale, PSFs below their own peaks."""
    side = 3 * max(panel.pitch_nm for panel in study.plan.panels.values())
    return {
        name: {
            "cells": panel_thumbnail(study.plan.panels[name], side, 240, "photograph"),
            "psf": _psf_tile(each.psf),
            "autocorrelation": _modulation_tile(each.autocorrelation, name),
        }
        for name, each in study.optics.items()
    }


def _psf_tile(psf: Psf) -> str:
    levels = np.rint((png.log_intensity(psf, 161) / png.DECADES + 1) * 255).astype(np.uint8)
    return img(_coloured(levels, "magma"), f"PSF at {psf.wavelength_nm:g} nm", "photograph")


def _modulation_tile(modulation: Floats, name: str) -> str:
    decades = np.log10(np.clip(modulation, 10.0**-_MODULATION_DECADES, 1)) / _MODULATION_DECADES + 1
    levels = np.rint(decades * 255).astype(np.uint8)
    return img(_coloured(levels, "cividis"), f"autocorrelation behind {name}", "photograph")


def _coloured(levels: NDArray[np.uint8], colours: str) -> str:
    palette = (mpl.colormaps[colours](np.arange(256))[:, :3] * 255).round().astype(np.uint8)
    return png.data_uri(png.png(levels, palette))


def brightening(study: Study) -> float:
    """Factor of 1 or more on code values of photographs that are shown: with it a hundredth of the scene's is white."""
    if study.truth is None:
        return 1.0
    bright = float(np.quantile(study.truth, 0.99))
    return 1 / bright if 0 < bright < 1 else 1.0


def photograph_tiles(study: Study) -> list[tuple[Take | None, str]]:
    """Part of the first scene, and of what every die, case and restorer made of it under the first protocol, at the
    middle level; each as an ``<img>`` element, brightened by :func:`brightening`."""
    if study.truth is None:
        return []
    protocol = next(iter(study.shown)).protocol
    levels = sorted({take.level_db for take in study.shown if take.protocol == protocol})
    middle = levels[len(levels) // 2]
    factor = np.float32(brightening(study))
    scene = tile(factor * study.truth, f"part of the scene {study.scenes[0]}")
    found: list[tuple[Take | None, str]] = [(None, scene)]
    for take, picture in study.shown.items():
        if take.protocol == protocol and take.level_db == middle:
            words = f"the same through {take.die}, {take.case}, restored by {take.restorer}"
            found.append((take, tile(factor * picture, words)))
    return found
