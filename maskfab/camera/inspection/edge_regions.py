"""Straight edges of a picture between two even fields: where they are, how far each may be looked at, and its line.

A chart's slanted square has four, each the neighbour of two others. Behind a display an edge is a stair, for every
diffraction order shows it again: steps of one sign belong to one edge, and another edge begins where the sign turns.

The place of an edge on every line across it, and the polynomial that they lie on, are steps 3 and 4 of the slanted-edge
method of ISO 12233: the centroid of each line's derivative, and a polynomial through them, here of first to third order
and robust. The centroids only begin it: the shift that best maps a line onto the common edge spread has less noise, as
it weighs the derivative's tails by what they say.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass
from itertools import groupby
from typing import Literal

import numpy as np
import scipy.ndimage
from numpy.polynomial import Polynomial
from numpy.polynomial.polynomial import polyder, polyval

from maskfab.base.arrays import Floats, Indices, Mask
from maskfab.base.errors import SourceError
from maskfab.camera.frames.stack import SIGMA_OF_MAD

Direction = Literal["horizontal", "vertical"]

STEEPEST_DEG = 40.0
"""Edges that lean more off both axes have too few places between pixels, or none."""

FEWEST_LINES, NARROWEST_PX = 20, 6.0
"""Lines across an edge, and reach to either side of it, below which a region is too small."""

_WIDEST_PX = 128

_BLUR_PX = 2.0
_STRONG, _OTHER = 0.3, 0.12
"""Shares of the steepest gradient that make an edge, and that end its surroundings."""

# The gradient that noise of 1 has, in one standard deviation, after the median and the blur; and how many make an edge.
_NOISE_GRADIENT, _SURE = 0.065, 10.0
_STRAIGHT_PX = 1.5
_FEWEST_SEEN = 6


@dataclass(frozen=True)
class Region:
    """A box of pixels, row 0 the top: rows from ``top`` to ``bottom`` - 1, columns from ``left`` to ``right`` - 1."""

    top: int
    bottom: int
    left: int
    right: int

    @property
    def corner(self) -> tuple[int, int]:
        """Row and column of the uppermost left pixel."""
        return self.top, self.left

    def __str__(self) -> str:
        return f"rows {self.top} to {self.bottom - 1}, columns {self.left} to {self.right - 1}"


@dataclass(frozen=True)
class FoundEdge:
    """One edge, of lines that cross it: rows for one that is near upright, columns for one that is near level.

    Attributes:
        offset, slope: place along line k in samples, offset + slope k.
    """

    direction: Direction
    lines: tuple[int, int]
    offset: float
    slope: float
    reach: float

    @property
    def region(self) -> Region:
        """The box that holds what is looked at."""
        first, last = self.lines
        ends = [self.offset + self.slope * line for line in (first, last - 1)]
        low, high = math.ceil(min(ends) - self.reach), math.floor(max(ends) + self.reach) + 1
        return Region(first, last, low, high) if self.direction == "horizontal" else Region(low, high, first, last)


def found_edges(values: Floats, valid: Mask) -> tuple[list[FoundEdge], list[SourceError]]:
    """Edges from the top left on, and why others that look like edges cannot be measured.

    Args:
        values: linear light, float64 [rows, columns], row 0 the top.
    """
    if min(values.shape) < 2 * NARROWEST_PX or not valid.any():
        return [], []
    even = scipy.ndimage.median_filter(filled(values, valid), 3)
    down, across = (scipy.ndimage.gaussian_filter(even, _BLUR_PX, order=order) for order in ((1, 0), (0, 1)))
    steepness = np.hypot(across, down)
    steepest = float(steepness.max())
    if steepest <= _SURE * _NOISE_GRADIENT * noise_of(values, valid) or not steepest > 1e-12 * abs(even).max():
        return [], []
    edges: list[FoundEdge] = []
    small: list[FoundEdge] = []
    refused: list[SourceError] = []
    leaning = math.tan(math.radians(STEEPEST_DEG))
    strong = steepness > _STRONG * steepest
    frames: tuple[tuple[Direction, Floats, Floats], ...] = (
        ("horizontal", down, across),
        ("vertical", across.T, down.T),
    )
    for direction, along, over in frames:
        chosen = (strong if direction == "horizontal" else strong.T) & (abs(along) <= leaning * abs(over))
        for sign in (1, -1):
            scale = sign / steepest
            seen = _of_sign(direction, chosen & (scale * over > 0), scale * over, scale * along)
            candidates = list(seen)
            edges += _strongest(candidates)
            small += [edge for _, edge in candidates]
    diagonal = strong & (abs(down) > leaning * abs(across)) & (abs(across) > leaning * abs(down))
    labels, _ = scipy.ndimage.label(diagonal, np.ones((3, 3)))
    for box in scipy.ndimage.find_objects(labels):
        if min(side.stop - side.start for side in box) >= FEWEST_LINES:
            refused.append(
                SourceError(
                    "MF341",
                    f"an edge in rows {box[0].start} to {box[0].stop - 1}, columns {box[1].start} to "
                    f"{box[1].stop - 1} leans more than {STEEPEST_DEG:g} deg off both axes",
                    cure="Turn the chart: 5 deg off an axis is best, 2 to 20 deg do",
                )
            )
    if small and not edges and not refused:
        largest = max(small, key=lambda edge: edge.lines[1] - edge.lines[0])
        refused.append(
            SourceError(
                "MF342",
                f"the edge at {largest.region} has {largest.lines[1] - largest.lines[0]} lines across it with "
                f"{largest.reach:g} px free to either side; {FEWEST_LINES} lines and {NARROWEST_PX:g} px are needed",
                cure="Frame more of the edge, with nothing else beside it",
            )
        )
    return sorted(edges, key=lambda edge: (edge.region.top, edge.region.left)), refused


def filled(values: Floats, valid: Mask) -> Floats:
    """The values, those that do not count replaced by a mean of the ones about them."""
    if valid.all():
        return values
    share = scipy.ndimage.gaussian_filter(valid.astype(np.float64), _BLUR_PX)
    mean = scipy.ndimage.gaussian_filter(np.where(valid, values, 0.0), _BLUR_PX) / np.maximum(share, 1e-6)
    return np.where(valid, values, mean)


def noise_of(values: Floats, valid: Mask) -> float:
    """One standard deviation of independent noise, from differences that even light and slopes do not have."""
    for step in (1, 2):  # of the green pixels of a mosaic no four are neighbours
        ends = slice(None, -step), slice(step, None)
        corners = [(rows, columns) for rows in ends for columns in ends]
        counts = np.logical_and.reduce([valid[corner] for corner in corners])
        first, second, third, fourth = (values[corner] for corner in corners)
        twist = (first - second - third + fourth)[counts]
        if twist.size:
            return float(SIGMA_OF_MAD * np.median(abs(twist)) / 2)
    return 0.0


def _of_sign(direction: Direction, chosen: Mask, over: Floats, along: Floats) -> Iterator[tuple[float, FoundEdge]]:
    labels, _ = scipy.ndimage.label(chosen, np.ones((3, 3)))
    for number, box in enumerate(scipy.ndimage.find_objects(labels), 1):
        weight = np.where(labels[box] == number, over[box], 0.0)
        sums = weight.sum(axis=1)
        if np.count_nonzero(sums) < _FEWEST_SEEN:
            continue
        row = np.flatnonzero(sums)
        place = (weight[row] @ np.arange(weight.shape[1])) / sums[row]
        bent = np.polynomial.Polynomial.fit(row, place, 3)
        if np.sqrt(np.mean((bent(row) - place) ** 2)) > _STRAIGHT_PX:
            continue
        line = np.polynomial.polynomial.polyfit(row, place, 1)
        slope = float(line[1])
        offset = float(line[0]) + box[1].start - slope * box[0].start
        lines = np.arange(box[0].start, box[0].stop)
        # The edge's own gradient has no part along it.
        other = (over < -_OTHER) | (abs(along + slope * over) > 2 * _OTHER)
        free = _free(other, lines, offset + slope * lines)
        first, last, reach = _widest(free)
        yield float(sums.sum()), FoundEdge(direction, (box[0].start + first, box[0].start + last), offset, slope, reach)


def _free(other: Mask, lines: Indices, place: Floats) -> Floats:
    """Samples to either side of an edge, on every line, that are free of other edges and of the picture's border."""
    width = other.shape[1]
    free = np.asarray(np.minimum(place, width - 1 - place))
    for k, (line, at) in enumerate(zip(lines, place, strict=True)):
        there = np.flatnonzero(other[line])
        if there.size:
            # The other edge's own blur stays outside.
            free[k] = min(free[k], float(abs(there - at).min()) - 3 * _BLUR_PX)
    return free


def _widest(free: Floats) -> tuple[int, int, float]:
    """Neighbouring lines, first and one after the last, and the reach that all of them have, of the largest area."""
    best = (0.0, 0, 0, 0.0)
    for reach in range(int(NARROWEST_PX), min(_WIDEST_PX, int(max(free.max(), NARROWEST_PX))) + 1):
        for wide, group in groupby(range(free.size), key=lambda k: bool(free[k] >= reach)):
            run = list(group)
            if wide and len(run) * reach > best[0]:
                best = (len(run) * reach, run[0], run[-1] + 1, float(reach))
    return best[1:]


def _strongest(seen: list[tuple[float, FoundEdge]]) -> list[FoundEdge]:
    """Edges that are large enough, without steps beside a stronger step of the same stair."""
    strongest: list[FoundEdge] = []
    for _, edge in sorted(seen, key=lambda weighed: -weighed[0]):
        if edge.lines[1] - edge.lines[0] < FEWEST_LINES or edge.reach < NARROWEST_PX:
            continue
        middle = sum(edge.lines) / 2
        place = edge.offset + edge.slope * middle
        if not any(
            each.lines[0] <= middle < each.lines[1] and abs(each.offset + each.slope * middle - place) <= each.reach
            for each in strongest
        ):
            strongest.append(edge)
    return strongest


Order = Literal[1, 2, 3]

_CENTROID_PX = 8.0
_CENTROID_ROUNDS, _HUBER_ROUNDS = 4, 8
# Residuals beyond so many robust standard deviations count less; Huber's constant for 95 % efficiency.
_HUBER = 1.345
# By how much the information criterion must fall for one more order: strong evidence.
_LEAST_GAIN = 6.0


@dataclass(frozen=True)
class EdgeLine:
    """The edge's place along every line across it, in samples, as a polynomial of the line's number.

    Attributes:
        middle, half: which map the lines to -1 to 1.
    """

    coefficients: tuple[float, ...]
    middle: float
    half: float

    @property
    def order(self) -> int:
        return len(self.coefficients) - 1

    def places(self, lines: Floats) -> Floats:
        """Where it crosses them."""
        return np.asarray(polyval((lines - self.middle) / self.half, self.coefficients), np.float64)

    def slopes(self, lines: Floats) -> Floats:
        """Samples per line."""
        slopes = polyval((lines - self.middle) / self.half, polyder(self.coefficients))
        return np.asarray(slopes / self.half, np.float64)


def fitted_line(lines: Floats, places: Floats, order: Order | None = None) -> EdgeLine:
    """The polynomial through places on lines, [n] each, robust against a few that are far off (Huber's weights).

    Args:
        order: 1 to 3; None for the one with the least Bayesian information criterion.
    """
    placed = np.isfinite(places)
    lines, places = lines[placed], places[placed]
    middle, half = (float(lines[0] + lines[-1])) / 2, max(float(lines[-1] - lines[0]) / 2, 1.0)
    scaled = (lines - middle) / half
    best: tuple[float, Floats] | None = None
    for tried in (order,) if order else (1, 2, 3):
        coefficients, loss = _huber(scaled, places, tried)
        criterion = lines.size * np.log(max(loss, 1e-24)) + (tried + 1) * np.log(lines.size)
        if best is None or criterion < best[0] - _LEAST_GAIN:
            best = criterion, coefficients
    assert best is not None
    return EdgeLine(tuple(map(float, best[1])), middle, half)


def _huber(scaled: Floats, places: Floats, order: int) -> tuple[Floats, float]:
    """Coefficients, and the mean of Huber's loss."""
    weights = np.ones(places.size)
    spread = 0.0
    for _ in range(_HUBER_ROUNDS):
        fit = Polynomial.fit(scaled, places, order, domain=(-1, 1), window=(-1, 1), w=np.sqrt(weights))
        residual = abs(places - fit(scaled))
        spread = SIGMA_OF_MAD * float(np.median(residual))
        if spread <= 1e-9:
            break
        weights = np.minimum(1.0, _HUBER * spread / np.maximum(residual, 1e-300))
    limit = _HUBER * max(spread, 1e-9)
    residual = abs(places - fit(scaled))
    loss = np.where(residual <= limit, residual**2, 2 * limit * residual - limit**2)
    return np.asarray(fit.coef, np.float64), float(loss.mean())


def centroid_line(values: Floats, lines: Floats, first: Floats, order: Order | None) -> EdgeLine:
    """The line through the centroids of the lines' derivatives, each within a Hann window about the last estimate."""
    derivative = np.diff(values, axis=1)
    between = np.arange(derivative.shape[1]) + 0.5
    step = float(np.median(abs(derivative.sum(axis=1))))
    places = first
    for _ in range(_CENTROID_ROUNDS):
        off = between - places[:, None]
        seen = derivative * np.where(abs(off) < _CENTROID_PX, np.cos(np.pi / (2 * _CENTROID_PX) * off) ** 2, 0.0)
        total = seen.sum(axis=1)
        moved = (seen * off).sum(axis=1) / np.where(total, total, np.nan)
        # A line without a step of its own has no centroid.
        sure = (abs(total) > 0.1 * step) & (abs(moved) < _CENTROID_PX)
        line = fitted_line(lines, np.where(sure, places + moved, np.nan), order)
        places = line.places(lines)
    return line
