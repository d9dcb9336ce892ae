"""Pictures as files: a rendering of panels side by side as the eye sees them, and the PSFs of an analysis.

All panels of a rendering have one scale; the files hold emitted light, the image that the eye sees, a comparison of
them, and the results. An analysis is its PSFs as EXR, a picture, and the numbers.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from textwrap import wrap
from types import MappingProxyType
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from maskfab.base import __version__, provenance
from maskfab.base.arrays import Floats
from maskfab.base.folders import check_target, staged
from maskfab.base.units import UM_PER_MM, dpi
from maskfab.base.work import Progress, silent
from maskfab.display.emitted_light import ideal, show
from maskfab.display.eye import FLAT, PictureView, SeenPanel
from maskfab.display.pictures import flat
from maskfab.display.surround import BORDER
from maskfab.findings.analysis import Analysis
from maskfab.mask.formats.exr import Facts, psf_facts, write_exr, write_png, write_psf
from maskfab.optics.colour import code_of_light
from maskfab.report.documents.display import render_document
from maskfab.report.documents.shape import document_text
from maskfab.report.figures import die, scene
from maskfab.report.figures.sheet import INK, QUIET, bitmap, place, styled

_TITLES: Mapping[str, str] = MappingProxyType(
    {FLAT: "even grey, contrast × 10", BORDER: "even grey in the\nregular display, × 10"}
)
"""Pictures whose titles are not their names."""
_CELL, _GAP, _CAPTION, _LEFT, _TOP, _FOOT = 2.05, 0.14, 0.36, 0.5, 0.6, 0.42
_CLOSE_UP_PIXELS, _LEAST_PIXELS = 6, 1.5  # of the finest and of the coarsest panel
_CLOSE_UP_SAMPLES = 42
_EXPLAINED = (
    "ΔE: S-CIELAB difference from even pixels, mean (95th percentile); aligned: after the common shift of all pixels "
    "is removed. Fringe: largest difference in a*, b*. Grain: rms luminance contrast below 10 cycles per degree."
)
_LETTER, _LINE, _LETTERS = 0.055, 0.14, 112  # inches of a letter and a line of that text, and the longest line
_MIDDLE, _STRETCH = 0.5, 10.0


@styled
def comparison(panels: Sequence[SeenPanel]) -> bytes:
    """One PNG: a column for each panel, beside an ideal display, a row for each picture, its numbers under it.

    All pictures of a row have one scale in micrometres per inch. The first row is the light itself, close up; the
    others are what the eye takes in.
    """
    names = tuple(panels[0].views)
    columns, rows = 1 + len(panels), 1 + len(names)
    width = _LEFT + columns * (_CELL + _GAP)
    explained = wrap(_EXPLAINED, min(_LETTERS, int((width - _LEFT - _GAP) / _LETTER)))
    height = _TOP + rows * (_CELL + _CAPTION) + _FOOT + _LINE * (len(explained) - 2)
    figure = Figure(figsize=(width, height), dpi=130)
    figure.set_facecolor("white")
    windows = {
        name: max(
            max(panel.views[name].seen.shape[:2]) / panel.views[name].samples * panel.viewing.pitch_um
            for panel in panels
        )
        for name in names
    }
    pitches = [panel.viewing.pitch_um for panel in panels]
    close = max(_CLOSE_UP_PIXELS * min(pitches), _LEAST_PIXELS * max(pitches))

    def axes_at(row: int, column: int) -> Axes:
        left = _LEFT + column * (_CELL + _GAP)
        bottom = height - _TOP - (row + 1) * _CELL - row * _CAPTION
        return place(figure, (left, bottom, _CELL, _CELL))

    for column in range(columns):
        judged = panels[max(0, column - 1)]
        axes = axes_at(0, column)
        _close_up(axes, judged, close, perfect=column == 0)
        axes.set_title(_heading(judged, perfect=column == 0), fontsize=8.5, pad=6, linespacing=1.35)
        if column == 0:
            _scale_bar(axes, close)
            _label(axes, "light, close up")
        for row, name in enumerate(names, start=1):
            axes = axes_at(row, column)
            view, window = judged.views[name], windows[name]
            _seen(axes, judged, view, window, name, perfect=column == 0)
            if column == 0:
                _label(axes, _TITLES.get(name, name.replace("_", " ")))
                _scale_bar(axes, window)
            else:
                if name == FLAT:
                    said = f"ΔE {view.delta_e:.2f}, grain {100 * _value(judged, 'grain_slow'):.2f} %"
                elif name == BORDER:
                    inside, edge = (_value(judged, f"border_delta_e_{place}") for place in ("inside", "edge"))
                    said = f"ΔE inside {inside:.2f}, along the border {edge:.2f}"
                elif name == "edge":
                    said = f"ΔE {view.delta_e:.2f}, fringe Δab {view.fringe:.0f}"
                else:
                    said = f"ΔE {view.delta_e:.2f} ({view.delta_e_95:.1f}), aligned {view.delta_e_aligned:.2f}"
                said += "" if view.jod is None else f"\n{view.jod:.2f} JOD"
                axes.text(0.5, -0.025, said, transform=axes.transAxes, ha="center", va="top")
    told = "\n".join(explained)
    figure.text(_LEFT / width, 0.12 / height, told, color=QUIET, fontsize=7, va="bottom", linespacing=1.4)
    return bitmap(figure)


def _heading(judged: SeenPanel, *, perfect: bool) -> str:
    density, distance = dpi(judged.viewing.pitch_um), judged.viewing.distance_um / UM_PER_MM
    if perfect:
        return f"even pixels\n{density:.0f} DPI at {distance:.0f} mm"
    offset = _value(judged, "centroid_offset")
    return f"{judged.name}\n{density:.0f} DPI, centroid offset {offset:.3f} px"


def _value(judged: SeenPanel, name: str) -> float:
    value: Any = next(quantity.value for quantity in judged.quantities if quantity.name == name)
    return float(value)


def _close_up(axes: Axes, judged: SeenPanel, side_um: float, *, perfect: bool) -> None:
    """Emitters of the pixels in the middle, each colour as bright as the others at its own brightest."""
    pitch = judged.viewing.pitch_um
    count = min(int(np.ceil(side_um / pitch)), *judged.panel.orientations.shape)
    image = flat(count, 1.0)
    lit = ideal(image, _CLOSE_UP_SAMPLES, pitch) if perfect else show(judged.panel, image, _CLOSE_UP_SAMPLES)
    light = lit.rgb
    picture = np.moveaxis(light / light.max(axis=(1, 2), keepdims=True), 0, -1)
    _draw(axes, picture, count * pitch, side_um)


def _seen(axes: Axes, judged: SeenPanel, view: PictureView, side_um: float, name: str, *, perfect: bool) -> None:
    shown = view.reference if perfect else view.seen
    rgb = shown.astype(np.float64)
    if name in {FLAT, BORDER}:
        rgb = _MIDDLE + _STRETCH * (rgb - _MIDDLE)
    _draw(axes, rgb, shown.shape[1] / view.samples * judged.viewing.pitch_um, side_um)


def _draw(axes: Axes, rgb: Floats, own_um: float, side_um: float) -> None:
    """A picture of its own width in the middle of a window of ``side_um``."""
    height = own_um * rgb.shape[0] / rgb.shape[1]
    extent = (-own_um / 2, own_um / 2, -height / 2, height / 2)
    axes.imshow(code_of_light(rgb), origin="lower", interpolation="antialiased", extent=extent)
    half = side_um / 2
    axes.set(xlim=(-half, half), ylim=(-half, half), xticks=[], yticks=[])
    for spine in axes.spines.values():
        spine.set(edgecolor=QUIET, linewidth=0.5)


def _label(axes: Axes, words: str) -> None:
    axes.text(-0.07, 0.5, words, transform=axes.transAxes, rotation=90, ha="center", va="center", color=INK, fontsize=9)


def _scale_bar(axes: Axes, side_um: float) -> None:
    decade = 10.0 ** np.floor(np.log10(side_um / 3))
    length = decade * max(step for step in (1, 2, 5) if step * decade <= side_um / 3)
    words = f"{length / UM_PER_MM:g} mm" if length >= UM_PER_MM else f"{length:g} µm"
    y = -0.055
    share = length / side_um
    axes.plot(
        [0, share], [y, y], transform=axes.transAxes, color=INK, linewidth=1.6, solid_capstyle="butt", clip_on=False
    )
    axes.text(share + 0.03, y, words, transform=axes.transAxes, va="center", color=QUIET, fontsize=7.5)


DOCUMENT, FIGURE = "render.json", "render.png"


def write_rendering(
    target: Path,
    panels: Sequence[SeenPanel],
    samples: int,
    job_hash: str,
    progress: Progress = silent,
    unused: Sequence[str] = (),
) -> list[Path]:
    """Write everything into a new directory, and return the paths.

    For each die and picture: ``DIE_PICTURE.exr`` and ``.png`` are the emitted light, ``samples`` along a pixel (the PNG
    as bright as its brightest sample allows), ``DIE_PICTURE_seen.png`` what the eye takes in.
    """
    total = sum(len(panel.images) for panel in panels)
    with staged(check_target(target, force=False)) as folder:
        done = 0
        for die in panels:
            for title in die.images:
                progress("files", done, total)
                light = die.light(title, samples).rgb
                facts: dict[str, str | float] = {
                    "die": die.name,
                    "picture": title,
                    "pitch_um": die.viewing.pitch_um,
                    "dpi": dpi(die.viewing.pitch_um),
                    "distance_mm": die.viewing.distance_um / UM_PER_MM,
                    "samples_per_pixel": float(samples),
                    "job": job_hash,
                    "software": f"maskfab {__version__}",
                }
                stem = f"{die.name}_{title}"
                write_exr(light, folder / f"{stem}.exr", facts)
                write_png(light, folder / f"{stem}.png", white=max(float(light.max()), 1e-12))
                write_png(die.views[title].seen.astype(np.float64), folder / f"{stem}_seen.png")
                done += 1
        progress("files", total, total)
        (folder / FIGURE).write_bytes(comparison(panels))
        files = [
            {"path": path.name, "bytes": path.stat().st_size, "sha256": provenance.sha256_of_file(path)}
            for path in sorted(folder.iterdir())
        ]
        document = {**render_document(panels, samples, job_hash, unused), "files": files}
        (folder / DOCUMENT).write_text(document_text(document), encoding="utf-8")
    return sorted(target.iterdir())


def write_analysis(analysis: Analysis, target: Path, facts: Facts) -> list[Path]:
    """Write everything into a new directory, and return the paths; ``facts`` go into the headers of PSFs."""
    signature = f"maskfab {__version__} | {analysis.name}"
    with staged(check_target(target, force=False)) as folder:
        for psf in analysis.psfs:
            name = f"psf_{psf.kind}_{psf.wavelength_nm:.12g}nm.exr"
            write_psf(psf, folder / name, {**psf_facts(psf), **facts}, signature)
        pictures = {} if analysis.scene is None else scene.bitmaps(analysis.scene)
        for name, picture in pictures.items():
            (folder / f"{name}.png").write_bytes(picture)
        (folder / "optics.png").write_bytes(die.optics(analysis.psfs, analysis.mtfs, analysis.name))
    return sorted(target.iterdir())
