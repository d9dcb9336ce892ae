"""The figures of a written die: corners as drawn and in both readings of the writer, and their PSF and MTF.

Colours are those of Okabe and Ito, which colour-blind readers tell apart; line styles tell the curves apart in grey.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from klayout import db
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import PathPatch
from matplotlib.path import Path

from maskfab.geometry.writer_model import Reading, written_region
from maskfab.measurement.as_written import Written
from maskfab.model import Mtf
from maskfab.report.plots.die_figures import draw_decades
from maskfab.report.plots.sheet import INK, QUIET, bitmap, draw_psf, image, place, styled
from maskfab.units import NM_PER_UM

_CHROME, _CLEAR, _DRAWN = "#2f343c", "#ffffff", "#E69F00"
_STYLE: dict[Reading, tuple[str, Any]] = {Reading.FUSED: ("#0072B2", "-"), Reading.OPEN: ("#D55E00", (0, (5, 1.5)))}
_NAMES = {Reading.FUSED: "written, fused", Reading.OPEN: "written, open"}
_FIGURES = ("corner", "psf", "mtf")
_FINER = 16
_SIDE = 2.1
# Half the width of the picture, in corner radii: room for the arcs and what surrounds them.
_RADII = 3.5


def pictures(written: Written) -> dict[str, str]:
    """The figures of one written die as ``<img>`` elements: ``written_corner``, ``written_psf``, ``written_mtf``."""
    return {f"written_{which}": _page(written, which) for which in _FIGURES}


def bitmaps(written: Written) -> dict[str, bytes]:
    """The figures of the written mask as PNG files."""
    return {f"written_{which}": _file(written, which) for which in _FIGURES}


@styled
def _page(written: Written, which: str) -> str:
    return image(*_figure(written, which))


@styled
def _file(written: Written, which: str) -> bytes:
    figure, _ = _figure(written, which)
    figure.set_dpi(120)
    return bitmap(figure)


def _figure(written: Written, which: str) -> tuple[Figure, str]:
    return {"corner": _corner, "psf": _spread, "mtf": _transfer}[which](written)


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
        axes.set_facecolor(_CHROME)
        axes.add_artist(PathPatch(_path_um(region), facecolor=_CLEAR, edgecolor="none"))
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


def _shown(written: Written) -> tuple[Reading, ...]:
    """Both readings, or one where no corners kiss and they are alike."""
    return tuple(Reading) if written.kissing else (Reading.FUSED,)


def _label(who: str, cut: str) -> str:
    return f"{who}: {cut.replace('_', ' ').replace('min', 'minimum')}"
