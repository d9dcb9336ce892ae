"""Optics by brute force, for tests: of boxes in a stop by exact intervals, nothing of it shared with the package.

The stop is cut into slices across x between all places where an edge of a box, or a crossing of a box's edge with the
stop's, lies. In a slice everything is smooth in x, so Gauss nodes in the cosine of an angle, which take the vertical
tangents of a round stop too, integrate it to rounding; across y every interval has its exact length or transform.

A PSF over a window is a band-limited function, and its Legendre series there, from Gauss nodes, converges to rounding:
any sample, any integral and any maximum of it follows from the series.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.polynomial.legendre import leggauss, legvander

_NODES = 16
_ELEMENTS = 4_000_000


@dataclass(frozen=True, eq=False)
class Outline:
    """A stop about the origin: ellipses of half axes, of which the second is dark, or corners of a convex polygon."""

    half_x_um: float
    half_y_um: float
    rings: tuple[float, ...] = (1.0,)
    corners_um: tuple[tuple[float, float], ...] = ()

    @classmethod
    def of(
        cls, shape: str, width: float, height: float, inner: float, corners: Sequence[tuple[float, float]]
    ) -> Outline:
        """Of a shape's name and sizes."""
        if shape in ("circle", "ellipse", "annulus"):
            return cls(width / 2, height / 2, (1.0, inner) if inner else (1.0,))
        x, y = width / 2, height / 2
        return cls(x, y, (), tuple(corners) or ((-x, -y), (x, -y), (x, y), (-x, y)))

    @property
    def straight(self) -> bool:
        """Whether its sides lie along the axes, so that slices are constant."""
        return bool(self.corners_um) and all(p[0] == q[0] or p[1] == q[1] for p, q in self._sides())

    def _sides(self) -> list[tuple[tuple[float, float], tuple[float, float]]]:
        return list(zip(self.corners_um, (*self.corners_um[1:], self.corners_um[0]), strict=True))

    def chords(self, x: np.ndarray) -> list[tuple[np.ndarray, np.ndarray]]:
        """Intervals along y at x, empty ones of no length."""
        if self.rings:
            ends = [
                self.half_y_um * np.sqrt(np.clip(ring**2 - (x / self.half_x_um) ** 2, 0, None)) for ring in self.rings
            ]
            if len(ends) == 1:
                return [(-ends[0], ends[0])]
            return [(-ends[0], -ends[1]), (ends[1], ends[0])]
        low, high = np.full(x.shape, np.inf), np.full(x.shape, -np.inf)
        for (px, py), (qx, qy) in self._sides():
            if px == qx:
                continue
            there = (x >= min(px, qx)) & (x <= max(px, qx))
            y = py + (x - px) * ((qy - py) / (qx - px))
            low, high = np.where(there, np.minimum(low, y), low), np.where(there, np.maximum(high, y), high)
        empty = low > high
        return [(np.where(empty, 0.0, low), np.where(empty, 0.0, high))]

    def ends(self) -> np.ndarray:
        """Places along x where chords begin, end or have a kink."""
        if self.rings:
            return np.array([s * ring * self.half_x_um for ring in self.rings for s in (-1, 1)])
        return np.array([x for x, _ in self.corners_um])

    def meets(self, y: np.ndarray) -> np.ndarray:
        """Places along x where its edge is at heights y [..., k]; [..., m]. NaN where it is not."""
        found = []
        if self.rings:
            for ring in self.rings:
                with np.errstate(invalid="ignore"):
                    x = self.half_x_um * np.sqrt(ring**2 - (y / self.half_y_um) ** 2)
                found += [-x, x]
            return np.concatenate(found, axis=-1)
        for (px, py), (qx, qy) in self._sides():
            if py == qy or px == qx:
                continue
            x = px + (y - py) * ((qx - px) / (qy - py))
            found.append(np.where((y >= min(py, qy)) & (y <= max(py, qy)), x, np.nan))
        return np.concatenate(found, axis=-1) if found else np.zeros((*y.shape[:-1], 0))

    def meets_moved(self, sx: np.ndarray, sy: np.ndarray) -> np.ndarray:
        """Places along x where its edge meets that of itself moved by lags [n]; [n, m]. NaN where they do not."""
        found = []
        with np.errstate(invalid="ignore", divide="ignore"):
            if self.rings:
                a, b = sx / self.half_x_um, sy / self.half_y_um
                apart = np.hypot(a, b)
                for r in self.rings:
                    for s in self.rings:
                        along = (apart**2 + r**2 - s**2) / (2 * apart)
                        aside = np.sqrt(r**2 - along**2)
                        for sign in (-1, 1):
                            found.append(self.half_x_um * (along * a - sign * aside * b) / apart)
            else:
                for (px, py), (qx, qy) in self._sides():
                    for (rx, ry), (tx, ty) in self._sides():
                        dx, dy, ex, ey = qx - px, qy - py, tx - rx, ty - ry
                        cross = dx * ey - dy * ex
                        if cross == 0:
                            continue
                        t = ((rx + sx - px) * ey - (ry + sy - py) * ex) / cross
                        found.append(px + t * dx)
        return np.stack(found, axis=-1)


@dataclass(frozen=True, eq=False)
class Boxes:
    """What is clear between lines along x and y: bool [rows, columns], and its amplitude where dark."""

    x_um: np.ndarray
    y_um: np.ndarray
    clear: np.ndarray

    def column(self, x: np.ndarray) -> np.ndarray:
        """Columns of places; one more than there are for what is outside."""
        index = np.searchsorted(self.x_um, x) - 1
        return np.where((index < 0) | (index >= len(self.x_um) - 1), len(self.x_um) - 1, index)

    @cached_property
    def padded(self) -> np.ndarray:
        """Clear or not, 0 or 1, with a dark row and column behind the last."""
        return np.pad(self.clear.astype(np.float64), ((0, 1), (0, 1)))


def boxes_of(cells: np.ndarray, pattern: Callable[[int], np.ndarray], dot_um: float, gutter_um: float) -> Boxes:
    """A panel about the axis: cells int [rows, columns], the pattern of each entry, bool [dots, dots]."""
    rows, columns = cells.shape
    dots = pattern(int(cells[0, 0])).shape[0]
    pitch = dots * dot_um + gutter_um

    def lines(count: int) -> np.ndarray:
        starts = pitch * (np.arange(count) - count / 2) + gutter_um / 2
        return (starts[:, None] + dot_um * np.arange(dots + 1)).ravel()

    clear = np.zeros((rows, dots + 1, columns, dots + 1), dtype=bool)
    for j in range(rows):
        for i in range(columns):
            clear[j, :dots, i, :dots] = pattern(int(cells[j, i]))
    whole = clear.reshape(rows * (dots + 1), columns * (dots + 1))[:-1, :-1]
    return Boxes(lines(columns), lines(rows), whole)


@dataclass(frozen=True, eq=False)
class Slices:
    """Boxes in a stop.

    Attributes:
        leak: amplitude of what is dark within the stop.
    """

    boxes: Boxes
    outline: Outline
    leak: complex = 0.0
    nodes: int = 24

    @cached_property
    def _pieces(self) -> tuple[np.ndarray, np.ndarray]:
        x = np.concatenate([self.boxes.x_um, self.outline.ends(), self.outline.meets(self.boxes.y_um)])
        reach = abs(self.outline.ends()).max()
        x = np.unique(np.clip(x[~np.isnan(x)], -reach, reach))
        return x[:-1], x[1:]

    def area_um2(self) -> float:
        """Clear area within the stop."""
        return float(self.field(np.zeros(1), np.zeros(1), openings_only=True)[0, 0].real)

    def energy_um2(self) -> float:
        """Integral of the intensity behind it."""
        clear = self.area_um2()
        whole = Slices(Boxes(self._frame, self._frame, np.ones((1, 1), dtype=bool)), self.outline).area_um2()
        return clear + abs(self.leak) ** 2 * (whole - clear)

    @cached_property
    def _frame(self) -> np.ndarray:
        reach = 1.01 * max(self.outline.half_x_um, self.outline.half_y_um)
        return np.array([-reach, reach])

    def field(
        self,
        u: np.ndarray,
        v: np.ndarray,
        waves: Callable[[np.ndarray, np.ndarray], np.ndarray] | None = None,
        *,
        openings_only: bool = False,
    ) -> np.ndarray:
        """∫∫ a exp(2πi W) exp(-2πi (ux + vy)) over the stop, complex [v, u]."""
        total = self._field(u, v, waves)
        if self.leak == 0 or openings_only:
            return total
        bare = Slices(Boxes(self._frame, self._frame, np.ones((1, 1), dtype=bool)), self.outline, nodes=160)
        return (1 - self.leak) * total + self.leak * bare._field(u, v, waves)

    def _field(self, u: np.ndarray, v: np.ndarray, waves: Callable[..., np.ndarray] | None) -> np.ndarray:
        left, right = self._pieces
        middle = (left + right) / 2
        column = self.boxes.column(middle)
        x, weight = _cosine_nodes(left, right, self.nodes)
        lines, count = self.boxes.y_um, len(self.boxes.y_um) - 1
        rows = self.boxes.padded[:, column].T  # piece, row
        total = np.zeros((len(v), len(u)), dtype=complex)
        across = np.exp(-2j * np.pi * u[:, None] * x.ravel()) * weight.ravel()
        fills = np.zeros((len(left), count))
        parts = []
        for (low, high), (lows, highs) in zip(self.outline.chords(middle), self.outline.chords(x), strict=True):
            first = np.searchsorted(lines, low, side="right") - 1
            last = np.searchsorted(lines, high, side="right") - 1
            index = np.arange(count)
            fills += (index > first[:, None]) & (index < last[:, None]) & (high > low)[:, None]
            same = first == last
            for row, bottom, top, there in (
                (first, lows, np.where(same[:, None], highs, lines[np.clip(first + 1, 0, count)][:, None]), True),
                (last, lines[np.clip(last, 0, count)][:, None] + 0 * highs, highs, ~same),
            ):
                inside = (row >= 0) & (row < count) & (high > low) & there
                lit = np.flatnonzero(inside & (rows[np.arange(len(row)), np.clip(row, 0, count)] > 0))
                parts.append((lit, bottom[lit], top[lit]))
        fills *= rows[:, :count]
        if waves is None:
            kernel = _interval(lines[:-1], lines[1:], v)  # row, v
            whole = fills @ kernel  # piece, v
            per_piece = across.reshape(len(u), *x.shape).sum(axis=2)
            total += (per_piece @ whole).T
            for lit, bottom, top in parts:
                if lit.size:
                    partial = _interval(bottom.ravel(), top.ravel(), v)
                    total += (across.reshape(len(u), *x.shape)[:, lit].reshape(len(u), -1) @ partial).T
            return total
        nodes, weights = leggauss(5)
        y = ((lines[:-1] + lines[1:])[:, None] + np.diff(lines)[:, None] * nodes) / 2
        wy = np.diff(lines)[:, None] * weights / 2
        lit_rows = np.repeat(fills, x.shape[1], axis=0)  # node, row
        spread = (np.repeat(lit_rows, 5, axis=1) * wy.ravel()) * np.exp(
            2j * np.pi * waves(x.reshape(-1, 1), y.reshape(1, -1))
        )
        total += (across @ (spread @ np.exp(-2j * np.pi * y.reshape(-1, 1) * v))).T
        for lit, bottom, top in parts:
            if lit.size:
                places = (bottom + top)[..., None] / 2 + (top - bottom)[..., None] / 2 * nodes
                turned = (top - bottom)[..., None] / 2 * weights * np.exp(2j * np.pi * waves(x[lit][..., None], places))
                sums = np.einsum("pnk,pnkv->pnv", turned, np.exp(-2j * np.pi * places[..., None] * v))
                total += (across.reshape(len(u), *x.shape)[:, lit].reshape(len(u), -1) @ sums.reshape(-1, len(v))).T
        return total

    def overlaps(self, sx: np.ndarray, sy: np.ndarray) -> np.ndarray:
        """Area that the clear part shares with itself moved by lags [n]; the leak aside."""
        sx, sy = np.broadcast_arrays(np.asarray(sx, dtype=float), np.asarray(sy, dtype=float))
        sizes = (2 * len(self.boxes.x_um) + (4 if not self.outline.straight else 0) * 2 * len(self.boxes.y_um)) * (
            2 * len(self.boxes.y_um)
        )
        at_once = max(1, _ELEMENTS // sizes)
        parts = [self._overlaps(sx[k : k + at_once], sy[k : k + at_once]) for k in range(0, len(sx), at_once)]
        return np.concatenate(parts)

    def _overlaps(self, sx: np.ndarray, sy: np.ndarray) -> np.ndarray:
        boxes, outline, n = self.boxes, self.outline, len(sx)
        lines = np.sort(np.concatenate([np.tile(boxes.y_um, (n, 1)), boxes.y_um + sy[:, None]], axis=1), axis=1)
        reach = outline.half_x_um
        low, high = np.maximum(-reach, -reach + sx), np.minimum(reach, reach + sx)
        x = [
            np.tile(boxes.x_um, (n, 1)), boxes.x_um + sx[:, None],
            np.tile(outline.ends(), (n, 1)), outline.ends() + sx[:, None],
        ]  # fmt: skip
        if not outline.straight:
            x += [outline.meets(lines), outline.meets(lines - sy[:, None]) + sx[:, None], outline.meets_moved(sx, sy)]
        cuts = np.concatenate(x, axis=1)
        cuts = np.where(np.isnan(cuts), low[:, None], cuts)
        cuts = np.sort(np.clip(cuts, low[:, None], np.maximum(low, high)[:, None]), axis=1)
        left, right = cuts[:, :-1], cuts[:, 1:]
        # Most cuts are doubled or clipped: pieces of no width are left out.
        keep = right - left > 1e-12 * reach
        lag, _ = np.nonzero(keep)
        left, right = left[keep], right[keep]
        middle = (left + right) / 2
        at = (lines[:, :-1] + lines[:, 1:]) / 2
        own, moved = _row(boxes.y_um, at), _row(boxes.y_um, at - sy[:, None])
        i, j = boxes.column(middle), boxes.column(middle - sx[lag])
        product = boxes.padded[own[lag], i[:, None]] * boxes.padded[moved[lag], j[:, None]]
        heights = np.cumsum(np.pad(product * np.diff(lines, axis=1)[lag], ((0, 0), (1, 0))), axis=1)
        nodes, weight = _cosine_nodes(left, right, 1 if outline.straight else _NODES)
        if outline.straight:
            weight = (right - left)[:, None]
        total = np.zeros(left.shape)
        for a, b in outline.chords(nodes):
            for c, d in outline.chords(nodes - sx[lag][:, None]):
                bottom, top = np.maximum(a, c + sy[lag][:, None]), np.minimum(b, d + sy[lag][:, None])
                top = np.maximum(bottom, top)
                total += (weight * (_cumulative(lines, heights, product, lag, top)
                                    - _cumulative(lines, heights, product, lag, bottom))).sum(axis=1)  # fmt: skip
        return np.bincount(lag, total, minlength=n)


def _row(lines: np.ndarray, y: np.ndarray) -> np.ndarray:
    index = np.searchsorted(lines, y) - 1
    return np.where((index < 0) | (index >= len(lines) - 1), len(lines) - 1, index)


def _cumulative(
    lines: np.ndarray, heights: np.ndarray, product: np.ndarray, lag: np.ndarray, y: np.ndarray
) -> np.ndarray:
    """∫ of a piecewise constant up to y [pieces, nodes]; lines of every lag, [lags, k]."""
    span = lines[-1].max() - lines.min() + 1e6
    shift = span * np.arange(len(lines))[:, None]
    flat = (lines + shift).ravel()
    clipped = np.clip(y, lines[lag, 0][:, None], lines[lag, -1][:, None])
    index = np.searchsorted(flat, clipped + shift[lag], side="right") - 1 - lag[:, None] * lines.shape[1]
    index = np.clip(index, 0, lines.shape[1] - 2)
    piece = np.arange(len(lag))[:, None]
    return np.asarray(heights[piece, index] + product[piece, index] * (clipped - lines[lag[:, None], index]))


def _cosine_nodes(left: np.ndarray, right: np.ndarray, count: int) -> tuple[np.ndarray, np.ndarray]:
    """Gauss nodes of the angle whose cosine is the place in an interval, [n, count], and weights."""
    nodes, weights = leggauss(count)
    angle = np.pi / 2 * (1 + nodes)
    half = (right - left)[:, None] / 2
    return left[:, None] + half * (1 - np.cos(angle)), half * np.sin(angle) * weights * np.pi / 2


def _interval(low: np.ndarray, high: np.ndarray, v: np.ndarray) -> np.ndarray:
    """∫ exp(-2πivy) dy from low to high, [n, v]."""
    length, twice = (high - low)[:, None], (high + low)[:, None]
    return np.asarray(length * np.sinc(length * v) * np.exp(-1j * np.pi * v * twice))


@dataclass(frozen=True, eq=False)
class Picture:
    """A PSF over a square window as its Legendre series, [y, x]."""

    half_um: float
    series: np.ndarray

    @classmethod
    def nodes(cls, half_um: float, highest: float) -> tuple[np.ndarray, np.ndarray]:
        """Places and weights along an axis for intensities of no frequency above ``highest``."""
        return leggauss(math.ceil(2 * np.pi * half_um * highest * 1.2) + 32)

    @classmethod
    def of(cls, half_um: float, values: np.ndarray) -> Picture:
        """From values at the nodes."""
        places, weights = leggauss(len(values))
        basis = legvander(places, len(values) - 1) * weights[:, None] * (np.arange(len(values)) + 0.5)
        return cls(half_um, basis.T @ values @ basis)

    @property
    def error(self) -> float:
        """The last coefficients over the largest: how far the series has not converged."""
        last = max(abs(self.series[-4:]).max(), abs(self.series[:, -4:]).max())
        return float(last / abs(self.series).max())

    def on_grid(self, x: np.ndarray, y: np.ndarray) -> np.ndarray:
        """Values [y, x]."""
        degree = len(self.series) - 1
        return np.asarray(legvander(y / self.half_um, degree) @ self.series @ legvander(x / self.half_um, degree).T)

    def at(self, x: np.ndarray, y: np.ndarray) -> np.ndarray:
        """Values at places, any one shape."""
        degree = len(self.series) - 1
        along = legvander(y / self.half_um, degree) @ self.series
        return np.asarray((along * legvander(x / self.half_um, degree)).sum(axis=-1))

    def in_square(self, side_um: float) -> float:
        """Integral over a square about the middle."""
        places, weights = leggauss(len(self.series))
        axis = side_um / 2 * places
        return float(weights @ self.on_grid(axis, axis) @ weights) * side_um**2 / 4

    def in_circle(self, radius_um: float) -> float:
        """Integral over a disc about the middle."""
        count = len(self.series) + 16
        radii, weights = leggauss(count)
        radii, weights = radius_um / 2 * (1 + radii), weights * radius_um / 2
        angle = 2 * np.pi * np.arange(2 * count) / (2 * count)
        values = self.at(np.outer(radii, np.cos(angle)), np.outer(radii, np.sin(angle)))
        return float(weights * radii @ values.mean(axis=1)) * 2 * np.pi

    def pixel_means(self, pixel_um: float, reach: int) -> np.ndarray:
        """Means over pixels, one in the middle and so many on either side."""
        nodes, weights = leggauss(12)
        places = (pixel_um * (np.arange(-reach, reach + 1)[:, None] + nodes / 2)).ravel()
        values = self.on_grid(places, places).reshape(2 * reach + 1, 12, 2 * reach + 1, 12)
        return np.einsum("jqip,q,p->ji", values, weights / 2, weights / 2)

    def lobes(self, reach_um: float, step_um: float, faintest: float = 1e-12) -> np.ndarray:
        """Local maxima apart from the middle one, within a square: x, y and height, [k, 3], from samples so close."""
        count = math.floor(reach_um / step_um)
        axis = step_um * np.arange(-count, count + 1)
        values = self.on_grid(axis, axis)
        inner = values[1:-1, 1:-1]
        highest = np.full(inner.shape, True)
        for j in (-1, 0, 1):
            for i in (-1, 0, 1):
                if i or j:
                    highest &= inner > values[1 + j : len(values) - 1 + j, 1 + i : len(values) - 1 + i]
        row, column = np.nonzero(highest & (inner > faintest * values.max()))
        x, y = axis[column + 1], axis[row + 1]
        away = np.hypot(x, y) > 1.5 * step_um
        return np.stack([x[away], y[away], inner[row[away], column[away]]], axis=-1)

    def climbed(self, x: float, y: float, step_um: float) -> tuple[float, float, float]:
        """The maximum near a place."""
        offsets, longest = np.linspace(-1, 1, 9), step_um
        for _ in range(400):
            values = self.on_grid(x + step_um * offsets, y + step_um * offsets)
            j, i = np.unravel_index(np.argmax(values), values.shape)
            x, y = x + step_um * offsets[i], y + step_um * offsets[j]
            # Along a ring the way is long, and steps grow again.
            step_um = step_um / 3 if 0 < i < 8 and 0 < j < 8 else min(1.5 * step_um, longest)
            if step_um < 1e-6:
                break
        return float(x), float(y), float(values.max())
