"""Photographs through a die, restored, beside the truth: in a report, and one sheet that compares dies."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from matplotlib.figure import Figure
from numpy.typing import NDArray

from maskfab.base.arrays import Singles
from maskfab.camera.shots import Shot
from maskfab.measurement.restored import Restored
from maskfab.report.plots import png
from maskfab.report.plots.sheet import INK, QUIET, bitmap, img, place, styled

_WIDTH, _GAP, _CAPTION, _LEFT, _TOP, _FOOT = 3.2, 0.12, 0.5, 0.5, 0.5, 0.62
_DPI = 125
_LARGE, _SMALL = 20, 12.5  # points; on a telephone the sheet is a quarter as wide


def pictures(restored: Restored) -> dict[str, str]:
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
        scene: its name.
        taken: by die, the same part of its restored photographs; every die at the same levels.
        how: they were taken, in a few words.
    """
    levels = [shot.score.level_db for shot in next(iter(taken.values()))]
    columns, high = 1 + len(taken), _WIDTH * truth.shape[1] / truth.shape[2]
    width = _LEFT + columns * (_WIDTH + _GAP)
    height = _TOP + len(levels) * (high + _CAPTION) + _FOOT
    figure = Figure(figsize=(width, height), dpi=_DPI)
    figure.set_facecolor("white")
    for row, level in enumerate(levels):
        bottom = height - _TOP - (row + 1) * high - row * _CAPTION
        cells = [("truth", truth, ""), *((name, *_captioned(each[row])) for name, each in taken.items())]
        for column, (title, picture, caption) in enumerate(cells):
            axes = place(figure, (_LEFT + column * (_WIDTH + _GAP), bottom, _WIDTH, high))
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
