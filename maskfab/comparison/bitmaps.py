"""A written picture of a die against the die: every pixel read back, held against the exact share of it that is clear.

A pixel of a TIFF is right if it is white exactly where half of it or more is clear; one of a PNG if its level is that
share to the nearest of 256. One wrong pixel fails, however coarse the picture.
"""

from __future__ import annotations

from collections.abc import Sequence
from math import gcd
from pathlib import Path

import numpy as np
from klayout import db

from maskfab.base.arrays import Floats
from maskfab.drc.raster_rules import smallest_runs
from maskfab.errors import JobError, SourceError
from maskfab.geometry.die_grid import die_edges_nm, die_raster
from maskfab.geometry.plate_layout import clear_shapes, coverage
from maskfab.jobfile import MOST_DOTS_PER_UM
from maskfab.model import Die, Quantity
from maskfab.readers.image_mask import read_levels
from maskfab.units import NM_PER_UM

_EDGE = 1e-9
"""A pixel covered to this much less or more than wholly is whole, and one covered by half to this is at a half."""

_WHITE = 255
_LEVEL = 1e-6
_BAND_PIXELS = 4_000_000
_MOST_SHIFT = 0.1
"""Part of a pixel by which the resolution that a file states, which is rounded, may displace its last one."""


def check_pixels(dies: Sequence[Die], dots_per_um: float, where: str) -> None:
    """Refuse pixels that are larger than the smallest feature of a die: no picture of them carries the design.

    Args:
        dies: what is to be pictured.
        dots_per_um: pixels per micrometre.
        where: the job file, for the error.

    Raises:
        JobError: MF104.
    """
    if not dies:
        return
    pixel = NM_PER_UM / dots_per_um
    smallest, die = min(((smallest_nm(die, pixel), die) for die in dies), key=lambda pair: pair[0])
    if pixel <= smallest * (1 + _EDGE):
        return
    coarsest, even = NM_PER_UM / smallest, NM_PER_UM / gcd(*(length for die in dies for length in _lengths_nm(die)))
    cure = f"Set it to at least {_rounded_up(coarsest)}"
    if coarsest > MOST_DOTS_PER_UM:
        cure = (
            f"Leave png and tiff out of export.formats: it would take {_rounded_up(coarsest)}, more than any may have"
        )
    elif coarsest * (1 + _EDGE) < even <= MOST_DOTS_PER_UM:
        cure += f"; from {_rounded_up(even)} on pixels can follow every dot"
    raise JobError(
        "MF104",
        f"{dots_per_um:g} dots per um are pixels of {pixel / NM_PER_UM:g} um, larger than the smallest feature of the "
        f"die {die.name}, {smallest / NM_PER_UM:g} um: such a picture cannot carry the design",
        where=f"{where}: export.dots_per_um",
        cure=cure,
    )


def check_bitmap(die: Die, design: db.Layout, path: Path, dots_per_um: float) -> tuple[Quantity, ...]:
    """Read a die's PNG or TIFF back and compare it with the plate.

    Args:
        die: what the picture shows.
        design: the plate, as :func:`maskfab.geometry.plate_layout.plate_layout`.
        path: the picture.
        dots_per_um: pixels per micrometre that it should have; its own resolution tags are what it is read by.

    Returns:
        ``bitmap_wrong_pixels``, whose limit is 0: pixels that are not what the exact share of them that is clear makes
        them, all of them if size or resolution are others; and ``bitmap_xor_area`` in um²: what only one of picture and
        die covers, each pixel clear or not. Its limit is 0 where pixels follow the dots; elsewhere it is not judged,
        for it tells what pixels so large cannot show.

    Raises:
        SourceError: as of :func:`maskfab.readers.image_mask.read_levels`; MF314 if it has no resolution.
    """
    x0, y0, x1, y1 = die.box_nm
    pixel = NM_PER_UM / dots_per_um
    width, height = (int(np.ceil(round(side / pixel, 6))) for side in (x1 - x0, y1 - y0))
    x, y = (start + pixel * np.arange(count + 1, dtype=np.float64) for start, count in ((x0, width), (y0, height)))
    clear = coverage(clear_shapes(design, die.box_nm), x, y)
    partly = int(np.count_nonzero((clear > _EDGE) & (clear < 1 - _EDGE)))
    wrong, differing, why = _compared(path, clear, dots_per_um)
    found = differing / dots_per_um**2
    return (
        Quantity("bitmap_wrong_pixels", wrong, why, limit=0, passed=wrong == 0, die=die.name),
        Quantity(
            "bitmap_xor_area",
            found,
            f"{path.name}, each pixel clear or not, against the exact share of it that is clear; "
            + (f"{partly} pixels are partly clear" if partly else "its pixels follow the dots"),
            limit=None if partly else 0.0,
            passed=None if partly else found == 0,
            die=die.name,
        ),
    )


def _compared(path: Path, clear: Floats, dots_per_um: float) -> tuple[int, float, str]:
    """Pixels of a file that are wrong; what only it or the design makes clear, in pixels; and how that was told."""
    levels, stated = read_levels(path)
    rows, columns = clear.shape
    if stated is None:
        raise SourceError(
            "MF314",
            f"{path.name} does not state the size of its pixels",
            where=str(path),
            cure="Run the job again to rewrite it",
        )
    if levels.shape != clear.shape or abs(stated / dots_per_um - 1) * max(rows, columns) > _MOST_SHIFT:
        high, wide = levels.shape
        every = max(levels.size, clear.size)
        return (
            every,
            every,
            (
                f"{path.name} is {wide} x {high} pixels, {stated:g} to the um; the design has {columns} x {rows}, "
                f"{dots_per_um:g} to the um"
            ),
        )
    grey, wrong, differing = path.suffix == ".png", 0, 0.0
    band = max(1, _BAND_PIXELS // columns)
    for low in range(0, rows, band):
        read, share = levels[::-1][low : low + band].astype(np.float64), clear[low : low + band]
        off = abs(read - _WHITE * share) > 0.5 + _LEVEL if grey else read != _WHITE * (share >= 0.5 - _EDGE)
        wrong += int(np.count_nonzero(off))
        apart = np.where(read >= _WHITE / 2, 1 - share, share)
        differing += float(apart[apart > _EDGE].sum())
    rule = (
        "level against the exact share of each pixel that is clear, to the nearest of 256"
        if grey
        else "white against the exact share of each pixel that is clear: half of it or more"
    )
    return wrong, differing, f"{path.name}, {rule}"


def smallest_nm(die: Die, enough_nm: float) -> float:
    """Shortest clear or opaque run of a die along x or y; lengths of which dots and gutters are at least are enough."""
    least = min(length for length in (die.panel.dot_nm, die.panel.gutter_nm) if length)
    if least >= enough_nm:
        return float(least)
    runs = smallest_runs(die_raster(die), *die_edges_nm(die))
    return min(runs.clear, runs.opaque)


def _lengths_nm(die: Die) -> tuple[int, int]:
    """Lengths that pixels have to divide to follow every dot: a dot, and the distance from the panel's border to the
    first."""
    return die.panel.dot_nm, die.panel.gutter_nm // 2


def _rounded_up(value: float) -> str:
    """The number to six digits, never less than it is."""
    text = f"{value:.6g}"
    digits = 5 - int(np.floor(np.log10(value)))
    return text if float(text) >= value else f"{np.ceil(value * 10.0**digits) / 10.0**digits:.6g}"
