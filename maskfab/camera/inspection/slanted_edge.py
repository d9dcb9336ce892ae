"""The presampled MTF of a camera from one slanted edge, step by step after ISO 12233.

Each line's centroid and a polynomial through them are :mod:`maskfab.camera.inspection.edge_regions`. Distances are
measured along the edge's normal, so frequencies are those of a wave across the edge.

Step 5, the edge spread on a grid finer than the pixels, from all lines across an edge at once, with one change. There
every sample falls into the bin of a quarter of a pixel that holds its distance from the edge, and bins are means. Here
the edge spread is the piecewise linear function, with knots a quarter of a pixel apart, that is nearest to the samples:
where they lie unevenly within a bin, its mean is off, a line's slope is not. Least squares add up line by line, so a
resample of lines is a sum with other weights. Projected onto such functions, a wave of ν cycles per knot is passed by
sinc²(ν) / ((2 + cos 2πν) / 3); differences of neighbouring knots in place of the derivative pass sinc(ν) of it. The
window about an edge is as wide as the edge spread changes, and no wider, for beyond it there is only noise.

Light that is not quite even across an edge is told apart from light that the optics spreads, and taken out. Light that
grows by a share g per pixel tilts either field in proportion to its own level. Light that an optic spreads falls alike
on both sides of an edge, for its point spread is alike on opposite sides, and tilts both fields equally. Of the slopes
s of the two fields

    g = (s_bright - s_dark) / (e_bright - e_dark)

is therefore the light's alone. Here e is the slope of x times the edge spread, by which growing light changes it: the
field's level and, where the field itself is tilted, its slope times its distance.

Steps 6 to 9, differences, window, transform, and correction for the differences:

    MTF(ν) = |F(ν)| / F(0),    F(ν) = Σ_k w(x_k) (e_{k+1} - e_k) exp(-2πi ν x_k) / passed(ν)

Noise adds its own power to |F|²; the variance over resampled lines (Efron's bootstrap of pairs) is subtracted. That
variance along the phase of F also gives the band: the moduli under which the observed one is neither among the
smallest nor the largest 2.5 %, which is Rice's law, and holds where the MTF is as small as the noise, too.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np
import scipy
from scipy import special

from maskfab.base.arrays import Complexes, Floats, Indices, Mask
from maskfab.base.errors import SourceError
from maskfab.base.model import Frozen
from maskfab.base.units import UM_PER_MM
from maskfab.camera.frames.stack import SIGMA_OF_MAD
from maskfab.camera.inspection.edge_health import Excess, above_one, asymmetry, overshoot, uneven_light
from maskfab.camera.inspection.edge_regions import (
    FEWEST_LINES,
    NARROWEST_PX,
    STEEPEST_DEG,
    Direction,
    EdgeLine,
    FoundEdge,
    Order,
    Region,
    centroid_line,
    filled,
    fitted_line,
)

# What holds knots together that a resample leaves without samples, as a share of the mean weight of a knot.
_TIE = 1e-6


@dataclass(frozen=True, eq=False)
class NormalSums:
    """Normal equations of the edge spread, line by line: tridiagonal, one row of them for each line.

    Attributes:
        knots_px: float64 [k], distance from the edge along its normal, a step apart about 0.
        diagonal: float64 [lines, k].
        beside: float64 [lines, k - 1].
        right: float64 [lines, k].
    """

    knots_px: Floats
    diagonal: Floats
    beside: Floats
    right: Floats

    @property
    def step_px(self) -> float:
        return float(self.knots_px[1] - self.knots_px[0])

    def spreads(self, weights: Floats) -> Floats:
        """Edge spreads at the knots, [n, k], for weights of the lines, [n, lines]."""
        diagonal, beside, right = weights @ self.diagonal, weights @ self.beside, weights @ self.right
        tie = _TIE * float(diagonal.mean())
        diagonal[:, :-1] += tie
        diagonal[:, 1:] += tie
        beside -= tie
        spreads = np.empty_like(right)
        for k, band in enumerate(zip(diagonal, beside, right, strict=True)):
            packed = np.stack([np.concatenate([[0.0], band[1]]), band[0]])
            spreads[k] = scipy.linalg.solveh_banded(packed, band[2], check_finite=False)
        return spreads


def normal_sums(distance_px: Floats, values: Floats, counts: Mask, half_px: float, step_px: float) -> NormalSums:
    """Sums for samples of lines at distances from the edge, [lines, samples] each.

    Args:
        counts: which of them are used; those farther than ``half_px`` are not.
    """
    side = round(half_px / step_px)
    size = 2 * side + 1
    place = distance_px / step_px + side
    below = np.floor(place)
    used = counts & (below >= 0) & (below < size - 1)
    line = np.nonzero(used)[0]
    share = (place - below)[used]
    flat = line * size + below[used].astype(np.intp)
    lines = len(values)

    def summed(at: Indices, weight: Floats) -> Floats:
        return np.asarray(np.bincount(at, weight, lines * size), np.float64).reshape(lines, size)

    diagonal = summed(flat, (1 - share) ** 2) + summed(flat + 1, share**2)
    beside = summed(flat, share * (1 - share))[:, :-1]
    right = summed(flat, (1 - share) * values[used]) + summed(flat + 1, share * values[used])
    return NormalSums(step_px * (np.arange(size, dtype=np.float64) - side), diagonal, beside, right)


def passed(cycles_per_px: Floats, step_px: float) -> Floats:
    """Share of a wave that projection and differences leave: to be divided by."""
    cycles = cycles_per_px * step_px
    return np.asarray(np.sinc(cycles) ** 3 * 3 / (2 + np.cos(2 * np.pi * cycles)))


FLAT = 0.6
"""Share of the window that is 1; cosines fall to 0 on either side of it."""

# The edge spread has settled where means over so many pixels differ from its ends by less than so much of the step.
_SETTLED, _BLOCK_PX, _SIGMAS, _ENDS = 0.002, 2.0, 4.0, 0.15
_LEAST_HALF_PX, _MARGIN = 6.0, 1.6


def window(distance_px: Floats, half_px: float) -> Floats:
    """Tukey's window: 1 in the middle, cosines to 0 at ``half_px`` on either side."""
    beyond = (abs(distance_px) / half_px - FLAT) / (1 - FLAT)
    return np.asarray(np.cos(np.pi / 2 * np.clip(beyond, 0, 1)) ** 2)


def settled_px(sums: NormalSums, spread: Floats, noise: float, samples: int) -> float:
    """Reach of a window beyond which the edge spread no longer changes, with a margin; all that there is if it does."""
    half, step = float(sums.knots_px[-1]), sums.step_px
    block = round(_BLOCK_PX / step)
    mean = np.convolve(spread, np.full(block, 1 / block), "same")
    ends = max(block, round(_ENDS * spread.size))
    low, high = float(np.mean(spread[:ends])), float(np.mean(spread[-ends:]))
    of_block = noise / math.sqrt(max(samples / (2 * half) * _BLOCK_PX, 1.0))
    off = abs(mean - np.where(sums.knots_px < 0, low, high)) > _SETTLED * abs(high - low) + _SIGMAS * of_block
    # A mean over a block that reaches beyond the ends is none.
    off[:block] = off[-block:] = False
    farthest = float(abs(sums.knots_px[off]).max(initial=0.0))
    wanted = max(_LEAST_HALF_PX, _MARGIN * farthest + _BLOCK_PX)
    return min(half, step * math.ceil(wanted / step))


CONFIDENCE = 0.95
RESAMPLES = 400

# Moduli from so many standard deviations on are as good as normal.
_NORMAL = 8.0


def mtf_with_band(
    sums: NormalSums, spread: Floats, frequency_cy_per_px: Floats, half_px: float, seed: int
) -> tuple[Floats, Floats, Floats, Excess]:
    """MTF, and the ends of its pointwise band, [n] each; and the part of it that has another phase."""
    between = sums.knots_px[:-1] + sums.step_px / 2
    waves = np.exp(-2j * np.pi * frequency_cy_per_px[:, None] * between) * window(between, half_px)
    waves /= passed(frequency_cy_per_px, sums.step_px)[:, None]

    def transfer(spreads: Floats) -> Complexes:
        transforms = np.diff(spreads) @ waves.T
        return np.asarray(transforms / transforms[:, :1].real)

    lines = len(sums.diagonal)
    drawn = np.random.default_rng(seed).multinomial(lines, np.full(lines, 1 / lines), RESAMPLES)
    (own,) = transfer(spread[None])
    size = abs(own)
    turned = transfer(sums.spreads(drawn.astype(np.float64))) * np.exp(-1j * np.angle(own))
    # A knot seen by n samples has a mean whose variance a resample of them tells by (n - 1) / n.
    seen = max(2.0, float(np.median(sums.diagonal.sum(axis=0) * 1.5)))
    along, across = (part.var(axis=0, ddof=1) * seen / (seen - 1) for part in (turned.real, turned.imag))
    mtf = np.sqrt(np.maximum(size**2 - along - across, 0))
    mtf[0] = 1.0
    low, high = rice_interval(size, np.sqrt(along))
    return mtf, low, high, asymmetry(frequency_cy_per_px, own, np.sqrt(across))


def rice_interval(size: Floats, deviation: Floats) -> tuple[Floats, Floats]:
    """Moduli of a complex number under which an observed modulus is not unlikely, by Rice's law.

    Args:
        deviation: of the noise of the real part, [n]; 0 where there is none.

    Returns:
        Ends of the :data:`CONFIDENCE` interval; both are 0 where noise alone is seldom so small.
    """
    tail = (1 - CONFIDENCE) / 2
    sigmas = size / np.where(deviation > 0, deviation, np.nan)
    few = np.where(sigmas < _NORMAL, sigmas, np.nan)
    far = sigmas - 0.5 / sigmas
    ends = []
    for share, sign in ((1 - tail, -1.0), (tail, 1.0)):
        # The noncentral chi-square at which the observed square is that quantile; none if 0 already has less.
        beside = few**2
        possible = special.chdtr(2.0, beside) > share
        near = np.sqrt(special.chndtrinc(np.where(possible, beside, np.nan), 2.0, share))
        near = np.where(possible, near, 0.0)
        end = np.where(sigmas < _NORMAL, near, far + sign * special.ndtri(1 - tail)) * deviation
        ends.append(np.where(deviation > 0, end, size))
    return ends[0], ends[1]


# Fields are what lies beyond this share of the reach; slopes below so many standard errors are none.
_FIELD, _SURE = 0.5, 4.0


def noise_about(sums: NormalSums, spread: Floats, distance_px: Floats, values: Floats, used: Mask) -> float:
    """One robust standard deviation of samples about the edge spread."""
    rest = values[used] - np.interp(distance_px[used], sums.knots_px, spread)
    return SIGMA_OF_MAD * float(np.median(abs(rest)))


def light_slope(sums: NormalSums, spread: Floats, distance_px: Floats, values: Floats, used: Mask) -> float:
    """Share by which the light grows per pixel along the edge's normal; 0 where noise explains it."""
    half = float(sums.knots_px[-1])
    noise = noise_about(sums, spread, distance_px, values, used)
    slopes, effects, variance = [], [], 0.0
    for side in (-1.0, 1.0):
        field = used & (side * distance_px > _FIELD * half)
        place, light = distance_px[field], values[field]
        about = place - place.mean()
        power = float(about @ about)
        slopes.append(float(about @ light) / power)
        effects.append(float(light.mean()) + slopes[-1] * float(place.mean()))
        variance += noise**2 / power
    tilt = slopes[1] - slopes[0]
    return tilt / (effects[1] - effects[0]) if abs(tilt) > _SURE * math.sqrt(variance) else 0.0


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
class EdgeMtf(Frozen):
    """The presampled MTF across one edge: optics and pixel, before any sampling can alias it.

    Attributes:
        direction: ``horizontal`` across an edge that is near upright, ``vertical`` across one that is near level.
        angle_deg: of the edge from the nearer axis, positive if it leans to the right, or falls to the right.
        normal_deg: direction of the waves, from the picture's x axis (right) towards its y axis (up).
        half_px: reach of the window to either side of the edge.
        frequency_cy_per_px: float64 [n], 0 first.
        mtf: float64 [n], noise's share subtracted.
        low, high: float64 [n], ends of the pointwise 95 % band.
        excesses: that only an edge which is no light's own has.
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
    excesses: tuple[Excess, ...] = ()

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
    edge: FoundEdge,
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

    Raises:
        SourceError: MF341 for an angle at which the lines meet the edge in too few places between pixels, MF342 for too
            few lines or samples that count, MF343 for clipped values.
    """
    where = str(grid.on_sensor(edge.region))
    if edge.direction == "vertical":
        values, valid = values.T, valid.T
    part = slice(*edge.lines)
    seen = _Lines(np.arange(*edge.lines, dtype=np.float64), values[part], valid[part], grid.step)
    places = edge.offset + edge.slope * seen.numbers
    within = abs(seen.samples - places[:, None]) <= edge.reach
    _refuse_clipped(seen.values[within & seen.valid], clipped_at, where)
    _refuse_few(within, seen.valid, where)

    line = centroid_line(filled(seen.values, seen.valid), seen.numbers, places, order)
    # A whole number of knots, all of which every line reaches.
    reach = edge.reach - float(abs(line.places(seen.numbers) - places).max())
    half = STEP_PX * math.floor(grid.step * reach * math.cos(math.atan(abs(edge.slope))) / STEP_PX)
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
    reach = half
    half = settled_px(sums, spread, noise, int(np.count_nonzero(used)))
    mtf, low, high, unlike = mtf_with_band(sums, spread, FREQUENCIES, half, seed)
    of_knot = noise / math.sqrt(max(1.0, float(np.median(sums.diagonal.sum(axis=0)) * 1.5)))
    bright = distance * np.sign(spread[-1] - spread[0]) > min(half, reach / 2)
    excesses = (
        overshoot(sums.knots_px, spread, of_knot),
        above_one(FREQUENCIES, mtf, low),
        unlike,
        uneven_light(seen.values, used & bright, 2 * uneven * reach),
    )
    slope = float(np.mean(line.slopes(seen.numbers)))
    angle = math.degrees(math.atan(slope))
    return EdgeMtf(
        edge.direction,
        # Line numbers grow downwards, so that an edge whose place grows leans to the left, or falls to the right.
        -angle if edge.direction == "horizontal" else angle,
        angle if edge.direction == "horizontal" else 90 - angle,
        grid.on_sensor(edge.region),
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
        excesses,
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
        what = f"{share:.2%} of the pixels about the edge are clipped at {clipped_at:g}; {_CLIPPED_SHARE:.1%} may be"
        cure = "Expose for less: the bright side belongs below 80 % of white"
        raise SourceError("MF343", what, where=where, cure=cure)


def _refuse_few(within: Mask, valid: Mask, where: str) -> None:
    share = float(valid[within].mean()) if within.any() else 0.0
    whole = int((within & valid).any(axis=1).sum())
    if whole < FEWEST_LINES or share < _FEWEST_VALID:
        seen = f"{whole} lines cross the edge and {share:.0%} of their pixels count"
        raise _too_small(seen, f"{FEWEST_LINES} lines and {_FEWEST_VALID:.0%}", where)


def _too_small(seen: str, needed: str, where: str) -> SourceError:
    return SourceError("MF342", f"{seen}; {needed} are needed", where=where, cure="Frame more of the edge")


def _refuse_gaps(distance: Floats, line: EdgeLine, numbers: Floats, where: str) -> None:
    """Refuse an angle at which whole knots are skipped: near an axis, 45 deg, and other ratios of small numbers."""
    angle = abs(math.degrees(math.atan(float(np.mean(line.slopes(numbers))))))
    ordered = np.sort(distance)
    gap = float(np.diff(ordered).max()) if ordered.size > 1 else math.inf
    if gap > STEP_PX or angle > STEEPEST_DEG:
        what = (
            f"at {angle:.3g} deg off the axis {numbers.size} lines meet the edge at places {min(gap, 1.0):.2f} px "
            f"apart; {STEP_PX:g} px is the most"
        )
        raise SourceError("MF341", what, where=where, cure="Turn the chart: 5 deg off an axis is best, 2 to 20 deg do")
