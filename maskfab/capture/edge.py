"""The presampled MTF of a camera from one slanted edge.

The slanted-edge method of ISO 12233, step by step: each line's centroid and a polynomial through them
(:mod:`.edge_line`), the oversampled edge spread (:mod:`.oversampled`), a window (:mod:`.edge_window`), its differences'
transform and a band (:mod:`.edge_band`). Distances are measured along the edge's normal, so frequencies are those of a
wave across the edge.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np

from maskfab.base.arrays import Floats, Mask
from maskfab.capture.edge_band import CONFIDENCE, RESAMPLES, mtf_with_band
from maskfab.capture.edge_line import EdgeLine, Order, centroid_line, fitted_line
from maskfab.capture.edge_regions import (
    FEWEST_LINES,
    NARROWEST_PX,
    STEEPEST_DEG,
    Direction,
    FoundEdge,
    Region,
    filled,
)
from maskfab.capture.edge_window import settled_px
from maskfab.capture.even_light import light_slope, noise_about
from maskfab.capture.oversampled import NormalSums, normal_sums
from maskfab.errors import SourceError
from maskfab.model import frozen
from maskfab.units import UM_PER_MM

FREQUENCIES = np.arange(129) / 128
"""Cycles per pixel at which an MTF is told: up to twice the limit of the sensor's sampling."""
FREQUENCIES.flags.writeable = False

STEP_PX = 0.25
"""Distance between knots of the edge spread; fourfold oversampling, as the standard has it."""

_MATCHED_PX = 8.0
_CLIPPED_SHARE = 1e-3
_FEWEST_VALID = 0.2
"""Share of pixels about the edge that must count; of the rare colours of a mosaic there are a quarter."""


@dataclass(frozen=True, eq=False)
class EdgeMtf:
    """The presampled MTF across one edge: optics and pixel, before any sampling can alias it.

    Attributes:
        direction: ``horizontal`` across an edge that is near upright, ``vertical`` across one that is near level.
        angle_deg: of the edge from the nearer axis, positive if it leans to the right, or falls to the right.
        normal_deg: direction of the waves, from the picture's x axis (right) towards its y axis (up).
        region: what was looked at, in pixels of the sensor.
        lines: number of lines across the edge.
        order: of the polynomial that the edge follows.
        half_px: reach of the window to either side of the edge.
        pixel_um: side of a sensor pixel; None where it is not known.
        frequency_cy_per_px: float64 [n], 0 first.
        mtf: float64 [n], noise's share subtracted.
        low, high: float64 [n], ends of the pointwise 95 % band.
        method: in words.
    """

    direction: Direction
    angle_deg: float
    normal_deg: float
    region: Region
    lines: int
    order: int
    half_px: float
    pixel_um: float | None
    frequency_cy_per_px: Floats
    mtf: Floats
    low: Floats
    high: Floats
    method: str

    def __post_init__(self) -> None:
        for name in ("frequency_cy_per_px", "mtf", "low", "high"):
            object.__setattr__(self, name, frozen(getattr(self, name)))

    @property
    def frequency_cy_per_mm(self) -> Floats | None:
        """Float64 [n], of a pixel whose side is known."""
        return None if self.pixel_um is None else np.asarray(self.frequency_cy_per_px * (UM_PER_MM / self.pixel_um))

    @property
    def title(self) -> str:
        """Which edge it is, in words."""
        return f"{self.direction}, edge {self.angle_deg:+.2f}°, {self.lines} lines".replace("-", "−")


@dataclass(frozen=True)
class Grid:
    """Samples' places on the sensor, as those of one colour of a mosaic lie.

    Attributes:
        first: row and column of the uppermost left one, in pixels.
        step: pixels from one to the next, along rows and columns.
    """

    first: tuple[int, int] = (0, 0)
    step: int = 1

    def on_sensor(self, region: Region) -> Region:
        """A box of samples as one of pixels."""
        top, left = self.first
        rows = (top + self.step * row for row in (region.top, region.bottom))
        return Region(*rows, *(left + self.step * column for column in (region.left, region.right)))

    def of_samples(self, region: Region) -> Region:
        """The samples within a box of pixels."""
        top, left = self.first
        rows = (-((top - row) // self.step) for row in (region.top, region.bottom))
        columns = (-((left - column) // self.step) for column in (region.left, region.right))
        return Region(*(max(0, k) for k in (*rows, *columns)))

    def part(self, samples: Region) -> Grid:
        """The grid of the samples in a box of them."""
        return Grid(self.on_sensor(samples).corner, self.step)


WHOLE = Grid()
"""Every pixel is a sample."""


def edge_mtf(
    values: Floats,
    valid: Mask,
    found: FoundEdge,
    pixel_um: float | None,
    *,
    grid: Grid = WHOLE,
    order: Order | None = None,
    clipped_at: float = math.inf,
    seed: int = 0,
) -> EdgeMtf:
    """The MTF across one edge of a picture.

    Args:
        values: linear light, float64 [rows, columns], row 0 the top, of any unit; black is 0.
        valid: which of them count.
        found: the edge, as :func:`maskfab.capture.edge_regions.found_edges` has it.
        pixel_um: side of a sensor pixel, or None.
        grid: where the samples lie on the sensor.
        order: of the polynomial that the edge follows; None lets the centroids decide.
        clipped_at: values from it on are clipped.
        seed: of the resamples.

    Raises:
        SourceError: MF341 for an angle at which the lines meet the edge in too few places between pixels, MF342 for too
            few lines or samples that count, MF343 for clipped values.
    """
    where = str(grid.on_sensor(found.region))
    if found.direction == "vertical":
        values, valid = values.T, valid.T
    part = slice(*found.lines)
    seen = _Lines(np.arange(*found.lines, dtype=np.float64), values[part], valid[part], grid.step)
    places = found.offset + found.slope * seen.numbers
    within = abs(seen.samples - places[:, None]) <= found.reach
    _refuse_clipped(seen.values[within & seen.valid], clipped_at, where)
    _refuse_few(within, seen.valid, where)

    line = centroid_line(filled(seen.values, seen.valid), seen.numbers, places, order)
    # A whole number of knots, all of which every line reaches.
    reach = found.reach - float(abs(line.places(seen.numbers) - places).max())
    half = STEP_PX * math.floor(grid.step * reach * math.cos(math.atan(abs(found.slope))) / STEP_PX)
    if half < NARROWEST_PX / 2:
        raise _too_small(f"{half:g} px to either side of the edge are in every line", f"{NARROWEST_PX / 2:g} px", where)
    line = fitted_line(seen.numbers, seen.matched(line, half), order)
    distance = seen.distance_px(line)
    used = seen.valid & (abs(distance) < half)
    _refuse_gaps(distance[used], line, seen.numbers, where)
    sums, spread = seen.spread(distance, half)
    uneven = light_slope(sums, spread, distance, seen.values, used)
    if uneven:
        seen = replace(seen, values=seen.values / (1 + uneven * np.clip(distance, -half, half)))
        sums, spread = seen.spread(distance, half)
    noise = noise_about(sums, spread, distance, seen.values, used)
    half = settled_px(sums, spread, noise, int(np.count_nonzero(used)))
    mtf, low, high = mtf_with_band(sums, spread, FREQUENCIES, half, seed)
    slope = float(np.mean(line.slopes(seen.numbers)))
    angle = math.degrees(math.atan(slope))
    return EdgeMtf(
        found.direction,
        # Line numbers grow downwards, so that an edge whose place grows leans to the left, or falls to the right.
        -angle if found.direction == "horizontal" else angle,
        angle if found.direction == "horizontal" else 90 - angle,
        grid.on_sensor(found.region),
        seen.numbers.size,
        line.order,
        half,
        pixel_um,
        FREQUENCIES,
        mtf,
        low,
        high,
        f"slanted edge after ISO 12233, {1 / STEP_PX:g}-fold oversampling, {seen.numbers.size} lines, window of "
        f"{2 * half:g} px, noise power subtracted, {CONFIDENCE:.0%} band by {RESAMPLES} resamples of lines",
    )


@dataclass(frozen=True, eq=False)
class _Lines:
    """Lines across an edge: their numbers [n], values and which of them count [n, samples], pixels between samples."""

    numbers: Floats
    values: Floats
    valid: Mask
    step: int

    @property
    def samples(self) -> Floats:
        return np.arange(self.values.shape[1], dtype=np.float64)

    def distance_px(self, line: EdgeLine) -> Floats:
        """Pixels from the edge along its normal, [n, samples]."""
        upright = np.cos(np.arctan(line.slopes(self.numbers)))[:, None]
        return np.asarray(self.step * (self.samples - line.places(self.numbers)[:, None]) * upright)

    def spread(self, distance_px: Floats, half_px: float) -> tuple[NormalSums, Floats]:
        """Sums of the lines, and the edge spread that all of them share."""
        sums = normal_sums(distance_px, self.values, self.valid, half_px, STEP_PX)
        return sums, sums.spreads(np.ones((1, self.numbers.size)))[0]

    def matched(self, line: EdgeLine, half_px: float) -> Floats:
        """The places at which lines fit the common edge spread best: one step of Gauss and Newton."""
        distance = self.distance_px(line)
        sums, spread = self.spread(distance, half_px)
        used = self.valid & (abs(distance) < min(_MATCHED_PX, half_px))
        slope = np.interp(distance, sums.knots_px[:-1] + STEP_PX / 2, np.diff(spread) / STEP_PX) * used
        rest = (self.values - np.interp(distance, sums.knots_px, spread)) * used
        weight = (slope**2).sum(axis=1)
        shift = -(slope * rest).sum(axis=1) / np.where(weight > 0, weight, np.nan)
        upright = np.cos(np.arctan(line.slopes(self.numbers)))
        return np.asarray(line.places(self.numbers) + shift / (self.step * upright))


def _refuse_clipped(seen: Floats, clipped_at: float, where: str) -> None:
    share = float(np.mean(seen >= clipped_at)) if seen.size else 0.0
    if share > _CLIPPED_SHARE:
        raise SourceError(
            "MF343",
            f"{share:.2%} of the pixels about the edge are clipped at {clipped_at:g}; {_CLIPPED_SHARE:.1%} may be",
            where=where,
            cure="Expose for less: the bright side belongs below 80 % of white",
        )


def _refuse_few(within: Mask, valid: Mask, where: str) -> None:
    share = float(valid[within].mean()) if within.any() else 0.0
    whole = int((within & valid).any(axis=1).sum())
    if whole < FEWEST_LINES or share < _FEWEST_VALID:
        told = f"{whole} lines cross the edge and {share:.0%} of their pixels count"
        raise _too_small(told, f"{FEWEST_LINES} lines and {_FEWEST_VALID:.0%}", where)


def _too_small(told: str, needed: str, where: str) -> SourceError:
    return SourceError("MF342", f"{told}; {needed} are needed", where=where, cure="Frame more of the edge")


def _refuse_gaps(distance: Floats, line: EdgeLine, numbers: Floats, where: str) -> None:
    """Refuse an angle at which whole knots are skipped: near an axis, 45 deg, and other ratios of small numbers."""
    angle = abs(math.degrees(math.atan(float(np.mean(line.slopes(numbers))))))
    ordered = np.sort(distance)
    gap = float(np.diff(ordered).max()) if ordered.size > 1 else math.inf
    if gap > STEP_PX or angle > STEEPEST_DEG:
        raise SourceError(
            "MF341",
            f"at {angle:.3g} deg off the axis {numbers.size} lines meet the edge at places {min(gap, 1.0):.2f} px "
            f"apart; {STEP_PX:g} px is the most",
            where=where,
            cure="Turn the chart: 5 deg off an axis is best, 2 to 20 deg do",
        )
