"""Figures of a scene: PSFs over field, depth and colours with what deblurring leaves, and photographs beside the truth.

PSFs have the colours and the six decades of the other figures; what deblurring leaves has colours of its own.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import matplotlib as mpl
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from numpy.typing import NDArray

from maskfab.base.arrays import Floats, Singles
from maskfab.base.model import Psf
from maskfab.base.units import UM_PER_MM
from maskfab.camera.scores import Shot
from maskfab.findings.photographs import Restored
from maskfab.findings.scene import PointView, SceneOptics, distance
from maskfab.report.figures import sheet as png
from maskfab.report.figures.sheet import INK, QUIET, bitmap, image, img, place, styled
from maskfab.report.text import rounded

_FIELD_PIXELS, _STRIP_PIXELS = 61, 101
_LEFT_DECADES = 3
# Shares of a tile: room beside it, and room below for its number.
_GAP, _STRIP = 0.04, 0.17
# With 200 colours and white a picture still fits a palette of one byte.
_COLOURS = 200


@dataclass(frozen=True, eq=False)
class _Tiles:
    """Pictures in rows and columns, row 0 the lowest, log10 [n, n] from -decades to 0, and numbers under them."""

    levels: Sequence[Sequence[Floats]]
    numbers: Sequence[Sequence[str]]
    columns: Sequence[str]
    rows: Sequence[str]
    width_um: float
    colours: str
    decades: int
    title: str


def pictures(scene: SceneOptics) -> dict[str, str]:
    """The figures of one die's scene as ``<img>`` elements: ``scene_field``, ``scene_depth``, ``scene_colours``."""
    return {name: _page(figure, words) for name, (figure, words) in _figures(scene).items()}


def bitmaps(scene: SceneOptics) -> dict[str, bytes]:
    """The figures of a scene as PNG files."""
    return {name: _file(figure) for name, (figure, _) in _figures(scene).items()}


@styled
def _page(figure: Figure, words: str) -> str:
    return image(figure, words)


@styled
def _file(figure: Figure) -> bytes:
    figure.set_dpi(120)
    return bitmap(figure)


@styled
def _figures(scene: SceneOptics) -> dict[str, tuple[Figure, str]]:
    figures: dict[str, tuple[Figure, str]] = {}
    if scene.field:
        line = scene.field[0][0].psf.wavelength_nm
        words = f"PSF over the field at {line:g} nm, and what deblurring with the PSF of the centre leaves of each"
        field = scene.field
        columns = [f"{view.image_um[0] / UM_PER_MM:.3g}" for view in field[0]]
        rows = [f"{row[0].image_um[1] / UM_PER_MM:.3g}" for row in field]
        centre = field[len(field) // 2][len(field) // 2]
        both = _pair(field, centre, columns, rows, _FIELD_PIXELS, "the PSF of the centre")
        figures["scene_field"] = _side_by_side(both, (0.75, 5.95), 4.2, "place on the sensor, x (mm)", "y (mm)"), words
    if scene.depth:
        line = scene.depth[0].psf.wavelength_nm
        words = f"PSF over the depth at {line:g} nm, and what deblurring with the PSF in focus leaves of each"
        depth = scene.depth
        columns = [distance(view.object_um) for view in depth]
        centre = next(view for view in depth if view.residual == 0)
        both = _pair([depth], centre, columns, [""], _STRIP_PIXELS, "the PSF in focus")
        wide = min(4.5, 1.9 * len(depth))
        figures["scene_depth"] = _side_by_side(both, (0.3, 5.6), wide, "distance of the object"), words
    if scene.colours:
        names = ", ".join(band.name for band in scene.scene.bands)
        named = zip(scene.scene.bands, scene.colours, strict=True)
        tiles = _Tiles(
            [[_log(psf, _STRIP_PIXELS) for psf in scene.colours]],
            [],
            [f"{band.name}, mean {psf.wavelength_nm:.0f} nm" for band, psf in named],
            [""],
            _span(scene.colours[0], _STRIP_PIXELS),
            "magma",
            png.DECADES,
            "intensity / peak",
        )
        figure = _side_by_side((tiles,), (0.3,), min(1.9 * len(scene.colours), 9.0), "")
        figures["scene_colours"] = figure, f"PSF of the bands {names}, logarithmic"
    return figures


def _side_by_side(
    blocks: Sequence[_Tiles], lefts: Sequence[float], wide: float, along: str, upwards: str = ""
) -> Figure:
    """Blocks of equal shape in one row, each so many inches wide, with a bar of its colours and a scale."""
    high = wide * _height(blocks[0]) / _width(blocks[0])
    foot = 0.72 if along else 0.5
    figure = Figure(figsize=(lefts[-1] + wide + 0.65, foot + high + 0.3))
    for left, tiles in zip(lefts, blocks, strict=True):
        axes = place(figure, (left, foot, wide, high))
        _draw(axes, tiles)
        axes.set_xlabel(along)
        _scale(axes, tiles.width_um, (0.12 - foot) / high)
        _bar(figure, (left + wide + 0.08, foot, 0.1, high), tiles)
    figure.axes[0].set_ylabel(upwards, labelpad=1)
    return figure


def _pair(
    views: Sequence[Sequence[PointView]],
    centre: PointView,
    columns: Sequence[str],
    rows: Sequence[str],
    pixels: int,
    stated: str,
) -> tuple[_Tiles, _Tiles]:
    """PSFs with their change, and what is left of them with its residual."""
    line = centre.psf.wavelength_nm
    width = _span(centre.psf, pixels)
    peak = float(abs(centre.left).max())
    return (
        _Tiles(
            [[_log(view.psf, pixels) for view in row] for row in views],
            [[_told(view.change, view is centre) for view in row] for row in views],
            columns,
            rows,
            width,
            "magma",
            png.DECADES,
            f"PSF at {line:g} nm, intensity / peak; below: change",
        ),
        _Tiles(
            [
                [np.log10(np.clip(abs(_middle(view.left, pixels)) / peak, 10.0**-_LEFT_DECADES, 1.0)) for view in row]
                for row in views
            ],
            [[_told(view.residual, view is centre) for view in row] for row in views],
            columns,
            rows,
            width,
            "cividis",
            _LEFT_DECADES,
            f"deblurred with {stated}, |value| / peak; below: residual",
        ),
    )


def _told(value: float, centre: bool) -> str:
    return "0" if centre else rounded(value, 2)


def _log(psf: Psf, pixels: int) -> Floats:
    return png.log_intensity(Psf(_middle(psf.values, pixels), psf.step_um, psf.wavelength_nm, psf.kind), pixels)


def _middle(values: Floats, pixels: int) -> Floats:
    reach = min(pixels, values.shape[0]) // 2
    middle = values.shape[0] // 2
    return values[middle - reach : middle + reach + 1, middle - reach : middle + reach + 1]


def _span(psf: Psf, pixels: int) -> float:
    return psf.step_um * min(pixels, len(psf.values))


def _width(tiles: _Tiles) -> float:
    return len(tiles.levels[0]) * (1 + _GAP) - _GAP


def _height(tiles: _Tiles) -> float:
    return float(len(tiles.levels) * (1 + (_STRIP if tiles.numbers else _GAP)))


def _draw(axes: Axes, tiles: _Tiles) -> None:
    """Pictures as one bitmap; lengths on the axes are those of a picture."""
    side = tiles.levels[0][0].shape[0]
    gap, strip = round(_GAP * side), round((_STRIP if tiles.numbers else _GAP) * side)
    rows, columns = len(tiles.levels), len(tiles.levels[0])
    sheet = np.full((rows * (side + strip), columns * (side + gap) - gap), np.nan)
    for j, row in enumerate(tiles.levels):
        for i, level in enumerate(row):
            bottom, left = j * (side + strip) + strip, i * (side + gap)
            sheet[bottom : bottom + side, left : left + side] = level
            if tiles.numbers:
                middle, below = (left + side / 2) / side, (bottom - 0.45 * strip) / side
                axes.text(middle, below, tiles.numbers[j][i], ha="center", va="center", fontsize=7.0)
    colours = mpl.colormaps[tiles.colours].resampled(_COLOURS).with_extremes(bad="white")
    extent = (0.0, sheet.shape[1] / side, 0.0, sheet.shape[0] / side)
    axes.imshow(
        np.ma.masked_invalid(sheet), origin="lower", interpolation="none", cmap=colours, vmin=-tiles.decades, vmax=0.0,
        extent=extent,
    )  # fmt: skip
    axes.set_title(tiles.title, loc="left", pad=5)
    axes.set(
        xticks=[(i * (side + gap) + side / 2) / side for i in range(columns)],
        yticks=[(j * (side + strip) + strip + side / 2) / side for j in range(rows)],
    )
    axes.set_xticklabels([label.replace("-", "−") for label in tiles.columns])
    axes.set_yticklabels([label.replace("-", "−") for label in tiles.rows])
    axes.tick_params(length=0, pad=3)
    axes.spines[:].set_visible(False)


def _scale(axes: Axes, width_um: float, y: float) -> None:
    """A bar of a round length below the last picture, at a height that is a share of the axes'."""
    decade = 10.0 ** np.floor(np.log10(width_um / 2))
    bar = decade * max(step for step in (1, 2, 5) if step * decade <= width_um / 2)
    right = axes.get_xlim()[1]
    start = right - bar / width_um
    foot = axes.get_xaxis_transform()
    axes.plot(
        [start, right], [y, y], color=INK, linewidth=2, solid_capstyle="butt", clip_on=False, transform=foot
    )  # fmt: skip
    axes.text(start - 0.06, y, f"{bar:g} µm", ha="right", va="center", transform=foot)


def _bar(figure: Figure, inches: tuple[float, float, float, float], tiles: _Tiles) -> None:
    axes = place(figure, inches)
    ramp = np.linspace(-tiles.decades, 0, _COLOURS)[:, None]
    axes.imshow(
        ramp, origin="lower", cmap=mpl.colormaps[tiles.colours].resampled(_COLOURS), interpolation="none",
        aspect="auto", extent=(0, 1, -tiles.decades, 0),
    )  # fmt: skip
    axes.set(xticks=[], yticks=range(0, -tiles.decades - 1, -1))
    axes.set_yticklabels(["1", "10⁻¹", "10⁻²", "10⁻³", "10⁻⁴", "10⁻⁵", "10⁻⁶"][: tiles.decades + 1])
    axes.yaxis.tick_right()


_WIDTH, _PHOTO_GAP, _CAPTION, _LEFT, _TOP, _FOOT = 3.2, 0.12, 0.5, 0.5, 0.5, 0.62
_DPI = 125
_LARGE, _SMALL = 20, 12.5  # points; on a telephone the sheet is a quarter as wide


def photograph_pictures(restored: Restored) -> dict[str, str]:
    """``<img>`` elements of what was photographed, in least light and in most: ``design_24`` and so on.

    Nothing if no photograph was taken. A pixel of the picture is a pixel of the sensor.
    """
    levels = [shot.score.level_db for shot in restored.shots]
    return {
        f"design_{level:g}": _restored(shot)
        for shot, level in zip(restored.shots, levels, strict=True)
        if level in (min(levels), max(levels))
    }


def truth(restored: Restored) -> dict[str, str]:
    """``front_truth``: what was photographed, as it is."""
    if restored.truth is None:
        return {}
    return {"front_truth": tile(restored.truth, f"part of the scene {restored.scene} as it is")}


def front(restored: Restored, level_db: float) -> dict[str, str]:
    """``front``: the photograph at one level of light, restored."""
    return {"front": _restored(next(shot for shot in restored.shots if shot.score.level_db == level_db))}


def _restored(shot: Shot) -> str:
    score = shot.score
    words = f"the same through {score.design} at {score.level_db:g} dB, restored, {score.psnr:.2f} dB"
    levels, palette = png.few_colours(_levels(shot.picture)[::-1])
    return img(png.data_uri(png.png(levels, palette)), words, "photograph")


@styled
def sheet(truth: Singles, scene: str, taken: Mapping[str, Sequence[Shot]], how: str) -> bytes:
    """One PNG: a row for each level of light, a column for the truth and for each die, PSNRs under the pictures.

    Args:
        truth: part of the scene, float32 [3, rows, columns] within 0 to 1, row 0 on top.
        taken: by die, the same part of its restored photographs; every die at the same levels.
    """
    levels = [shot.score.level_db for shot in next(iter(taken.values()))]
    columns, high = 1 + len(taken), _WIDTH * truth.shape[1] / truth.shape[2]
    width = _LEFT + columns * (_WIDTH + _PHOTO_GAP)
    height = _TOP + len(levels) * (high + _CAPTION) + _FOOT
    figure = Figure(figsize=(width, height), dpi=_DPI)
    figure.set_facecolor("white")
    for row, level in enumerate(levels):
        bottom = height - _TOP - (row + 1) * high - row * _CAPTION
        cells = [("truth", truth, ""), *((name, *_captioned(pictures[row])) for name, pictures in taken.items())]
        for column, (title, picture, caption) in enumerate(cells):
            axes = place(figure, (_LEFT + column * (_WIDTH + _PHOTO_GAP), bottom, _WIDTH, high))
            axes.imshow(_levels(picture), interpolation="none")
            axes.set(xticks=[], yticks=[])
            for spine in axes.spines.values():
                spine.set(edgecolor=QUIET, linewidth=0.5)
            if row == 0:
                axes.set_title(title, fontsize=_LARGE, pad=6, weight="bold")
            if column == 0:
                axes.text(
                    -0.06,
                    0.5,
                    f"{level:.4g} dB",
                    transform=axes.transAxes,
                    rotation=90,
                    fontsize=_LARGE,
                    ha="center",
                    va="center",
                )
            axes.text(0.5, -0.04, caption, transform=axes.transAxes, ha="center", va="top", color=INK, fontsize=_LARGE)
    said = (
        f"Middle of the scene {scene}, photographed by {how}, and restored.\n"
        "PSNR of the whole frame, in brackets without 64 pixels at its edges."
    )
    figure.text(_LEFT / width, 0.08 / height, said, color=QUIET, fontsize=_SMALL, va="bottom")
    return bitmap(figure)


def _captioned(shot: Shot) -> tuple[Singles, str]:
    chosen = f", {shot.score.chosen}" if shot.score.chosen else ""
    return shot.picture, f"{shot.score.psnr:.1f} dB ({shot.score.psnr_inner:.1f}){chosen}"


def tile(picture: Singles, words: str) -> str:
    """An ``<img>`` of a picture, float32 [3, rows, columns] of code values, row 0 on top."""
    return img(png.data_uri(png.png_of_colours(_levels(picture)[::-1])), words, "photograph")


def _levels(picture: Singles) -> NDArray[np.uint8]:
    """[rows, columns, 3] codes; scenes are code values already."""
    return np.rint(np.clip(picture, 0, 1).transpose(1, 2, 0) * 255).astype(np.uint8)
