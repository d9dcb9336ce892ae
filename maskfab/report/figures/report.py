"""Every figure of a report, by die.

PSFs and MTFs of many dies differ in pictures and curves alone: their frame, which is the SVG of the figure itself as it
is drawn of stand-ins, is made once a process, and filled.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import lru_cache
from itertools import chain
from typing import Any

import matplotlib as mpl
import numpy as np
from matplotlib.path import Path

from maskfab.base.model import DieOptics, Mtf, Plate, Psf, RadialMean
from maskfab.base.processes import Call, SerialExecutor
from maskfab.report.figures.die import (
    PLATE,
    curves,
    failed_dies,
    finest,
    middle,
    mtf,
    mtf_comparison,
    mtf_places,
    mtf_title,
    opening,
    panel_close_up,
    panel_thumbnail,
    plate_drawing,
    plate_places,
    psf,
    psf_thumbnail,
    seen_psfs,
)
from maskfab.report.figures.sheet import CURVE, DECADES, PICTURE, POINTS, image_of, log_intensity, picture, short_path


def pictures(
    plate: Plate,
    dies: Sequence[DieOptics],
    document: Mapping[str, Any],
    more: Sequence[Figures] = (),
    executor: SerialExecutor | None = None,
    stressed: Sequence[str] = (),
) -> dict[str, dict[str, str]]:
    """Every figure of a report: by die name, then by figure name; the whole plate's under :data:`PLATE`.

    Args:
        stressed: dies that the comparison of all shows before the others.
    """
    field_nm = 3 * max((item.die.panel.pitch_nm for item in dies), default=1)
    peak = max((float(middle(finest(item.psfs)).values.max()) for item in dies), default=1.0)
    drawn = [Figures(PLATE, of_plate, (plate, failed_dies(document), dies, tuple(stressed)))]
    drawn += [Figures(item.die.name, of_die, (item, field_nm, peak)) for item in dies]
    drawn += more
    images: dict[str, dict[str, str]] = {drawing.die: {} for drawing in drawn}
    tasks = (executor or SerialExecutor()).run_all([Call(drawing.function, drawing.arguments) for drawing in drawn])
    for drawing, task in zip(drawn, tasks, strict=True):
        images[drawing.die] |= task.result()
    return images


@dataclass(frozen=True, eq=False)
class Figures:
    """Figures of one die, or :data:`PLATE`, still to be drawn by a module's function, as ``<img>`` by name."""

    die: str
    function: Callable[..., dict[str, str]]
    given: tuple[Any, ...]

    def arguments(self) -> tuple[Any, ...]:
        """Arguments of the function, for a task."""
        return self.given


def of_plate(
    plate: Plate, failed: frozenset[str], dies: Sequence[DieOptics], stressed: Sequence[str]
) -> dict[str, str]:
    """The figures of a whole plate, dies that ``failed`` a check marked, those ``stressed`` drawn thick."""
    whole = {"drawing": plate_drawing(plate, failed).img(), "places": plate_places(plate)}
    if dies:
        whole["mtf"] = mtf_comparison(dies, stressed).img()
    return whole


def of_die(item: DieOptics, field_nm: int, peak: float) -> dict[str, str]:
    """The figures of one die; ``field_nm`` is its thumbnail's side, ``peak`` the brightest PSF's, of all dies."""
    return {
        "opening": opening(item.die.panel.opening, item.die.panel.dot_nm).img(),
        "panel": panel_close_up(item.die.panel).img(),
        "psf": psf_image(item.psfs),
        "mtf": mtf_image(item.mtfs),
        "mtf_small": mtf_image((middle(item.mtfs),)),
        "panel_small": panel_thumbnail(item.die.panel, field_nm),
        "psf_small": psf_thumbnail(middle(finest(item.psfs)), peak),
        "psf_own_peak": psf_thumbnail(middle(finest(item.psfs))),
    }


_SLOT = re.compile(rf'<g id="{CURVE}"> <path d="[^"]*"')


def mtf_image(mtfs: Sequence[Mtf]) -> str:
    """:func:`maskfab.report.figures.die.mtf` as an ``<img>`` element."""
    words, frame, titles = _mtf_frame(
        tuple((item.wavelength_nm, item.frequency_cy_per_mm[-1], *item.cuts) for item in mtfs)
    )
    (_, high), places = mtf_places(len(mtfs))
    drawn = chain.from_iterable(_drawn(item, high, place) for item, place in zip(mtfs, places, strict=True))
    svg = _SLOT.sub(lambda _: f'<g> <path d="{next(drawn)}"', frame)
    for title, item in zip(titles, mtfs, strict=True):
        svg = svg.replace(f">{title}<", f">{mtf_title(item)}<", 1)
    return image_of(svg, words)


@lru_cache(maxsize=8)
def _mtf_frame(shown: tuple[tuple[Any, ...], ...]) -> tuple[str, str, tuple[str, ...]]:
    """Words, SVG and titles of a figure of MTFs of some wavelengths, last frequencies and cuts."""
    ends, flat = np.arange(2.0), np.zeros(2)
    nowhere = RadialMean(flat, flat, flat)
    stands = [Mtf(last * ends, dict.fromkeys(cuts, flat), line, 0.0, 0.0, nowhere) for line, last, *cuts in shown]
    figure = mtf(stands)
    return figure.words, figure.svg(), tuple(map(mtf_title, stands))


def _drawn(item: Mtf, high: float, inches: tuple[float, float, float, float]) -> Iterator[str]:
    """Paths of the curves of a plot, points from the upper left corner of a figure so many inches high."""
    left, low, wide, tall = inches
    for _, x, y in curves(item):
        across = POINTS * (left + wide * x / item.frequency_cy_per_mm[-1])
        line = Path(np.column_stack([across, POINTS * (high - low - tall * y)])).cleaned(simplify=True)
        yield short_path("M" + "L".join(f"{a:.6f} {b:.6f}" for a, b in np.asarray(line.vertices)[:-1]))


def psf_image(psfs: Sequence[Psf]) -> str:
    """:func:`maskfab.report.figures.die.psf` as an ``<img>`` element."""
    seen = seen_psfs(psfs)
    words, first, *parts = _psf_frame(tuple((item.wavelength_nm, item.step_um, len(item.values)) for item in psfs))
    colours = mpl.colormaps["magma"]
    pictures = (
        picture(colours((log_intensity(item, pixels) + DECADES) / DECADES, bytes=True)) for item, pixels in seen
    )
    return image_of(first + "".join(chain.from_iterable(zip(pictures, parts, strict=True))), words)


@lru_cache(maxsize=8)
def _psf_frame(sampled: tuple[tuple[float, float, int], ...]) -> tuple[str, ...]:
    """Words of a figure of PSFs of some wavelengths, steps and samples, and its SVG in parts between their pictures."""
    stands = [Psf(np.zeros((count, count)), step, line, "point") for line, step, count in sampled]
    figure = psf(stands)
    return figure.words, *PICTURE.split(figure.svg(), maxsplit=len(seen_psfs(stands)))
