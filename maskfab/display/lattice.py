"""Two vectors after which a picture repeats, and the projective map of its periods, to a fraction of a pixel.

The picture is laid over itself (Padfield's masked correlation, so that what leaves the view does not count); the
shortest shifts at which it is like itself span the lattice. Every period in view is then matched with their mean, and
one projective map is fitted to all of them: turn, tilt and scale of the panel before the camera.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from itertools import product

import numpy as np
from numpy.typing import NDArray

from maskfab.base.arrays import Floats
from maskfab.base.errors import OpeningError

_WORKED = 900
"""Pixels along the longer side of the picture that is laid over itself."""
_ALIKE = 0.6
"""Likeness that counts as a repetition, of the best one: neighbours that are mirrored are told apart afterwards."""
_RISE = 0.04
"""Least rise of likeness above the valley that parts a repetition from the place itself."""
_SAMPLES = 96
"""Most samples along a period while periods are matched."""
_MOST = 250_000
"""Samples that are matched at once."""
_CURE = "Photograph 3 x 3 pixels of the display or more, sharp and at an even height"


@dataclass(frozen=True, eq=False)
class Lattice:
    """Periods of a picture.

    Attributes:
        matrix: [3, 3] projective map from periods (u, v, 1) to pixels (column, row, 1); v runs upwards in the picture.
        shift_px: rms by which periods lie beside the map, in pixels.
        matched: number of periods that were matched.
    """

    matrix: Floats
    shift_px: float = 0.0
    matched: int = 0

    def pixels(self, u: Floats, v: Floats) -> tuple[Floats, Floats]:
        """Column and row of places in periods."""
        x, y, w = np.tensordot(self.matrix, np.stack([u, v, np.ones_like(u)]), 1)
        return x / w, y / w

    def periods(self, x: Floats, y: Floats) -> tuple[Floats, Floats]:
        """Place in periods of columns and rows."""
        return replace(self, matrix=np.linalg.inv(self.matrix).astype(float)).pixels(x, y)

    def middle_px(self, shape: tuple[int, ...]) -> Floats:
        """Columns are the two periods in the middle of a picture, [2, 2], in pixels (column, row)."""
        (u, *_), (v, *_) = self.periods(*np.array([[(shape[1] - 1) / 2], [(shape[0] - 1) / 2]]))
        x, y = self.pixels(np.array([u + 0.5, u - 0.5, u, u]), np.array([v, v, v + 0.5, v - 0.5]))
        return np.array([x[::2] - x[1::2], y[::2] - y[1::2]])

    def across(self, shape: tuple[int, ...]) -> Floats:
        """First and last period in view on the lines through the middle of a picture, along u and along v, [2, 2]."""
        high, wide = shape[0] - 1.0, shape[1] - 1.0
        u, v = self.periods(np.array([0, wide, wide / 2, wide / 2]), np.array([high / 2, high / 2, high, 0]))
        return np.array([u[:2], v[2:]])

    def of_groups(self, across: int, up: int) -> Lattice:
        """The lattice whose periods hold so many of these."""
        return replace(self, matrix=self.matrix @ np.diag([across, up, 1.0]))

    def moved(self, u: float, v: float) -> Lattice:
        """This lattice, its periods beginning elsewhere."""
        return replace(self, matrix=self.matrix @ np.array([[1.0, 0.0, u], [0.0, 1.0, v], [0.0, 0.0, 1.0]]))

    def view(self, shape: tuple[int, ...]) -> tuple[int, int, int, int]:
        """First and one past the last period along u, then along v, of a picture of so many rows and columns."""
        u, v = self.periods(*np.array([[0, shape[1] - 1, 0, shape[1] - 1], [0, 0, shape[0] - 1, shape[0] - 1.0]]))
        (low_u, low_v), (high_u, high_v) = np.floor([u.min(), v.min()]), np.ceil([u.max(), v.max()])
        return int(low_u), int(high_u), int(low_v), int(high_v)


@dataclass(frozen=True, eq=False)
class Periods:
    """Periods of a picture laid side by side: values [v, u, rows, columns], row 0 the lowest, NaN out of view.

    Attributes:
        first: period along u and v of the first.
    """

    values: Floats
    first: tuple[int, int]

    @classmethod
    def of(cls, picture: Floats, lattice: Lattice, samples: tuple[int, int], order: int) -> Periods:
        """Sampled at the middles of so many rows and columns a period, by splines of an order."""
        from scipy import ndimage

        u0, u1, v0, v1 = lattice.view(picture.shape)
        rows, columns = samples
        u, v = ((np.arange((b - a) * n) + 0.5) / n + a for a, b, n in ((u0, u1, columns), (v0, v1, rows)))
        flat = ndimage.spline_filter(picture, order) if order > 1 else picture
        values = np.empty((v.size, u.size))
        for top in range(0, v.size, rows):  # a row of periods at a time, for memory
            x, y = lattice.pixels(*np.broadcast_arrays(u[None, :], v[top : top + rows, None]))
            values[top : top + rows] = ndimage.map_coordinates(flat, [y, x], order=order, cval=np.nan, prefilter=False)
            seen = (x >= 0) & (y >= 0) & (x <= picture.shape[1] - 1) & (y <= picture.shape[0] - 1)
            values[top : top + rows][~seen] = np.nan
        return cls(values.reshape(v1 - v0, rows, u1 - u0, columns).swapaxes(1, 2), (u0, v0))

    @property
    def seen(self) -> Floats:
        """Share of every period that is in view."""
        share: Floats = np.isfinite(self.values).mean(axis=(2, 3))
        return share


def find_lattice(picture: Floats) -> Lattice:
    """Lattice of a picture [rows, columns] that stands as upright as it can, its periods within 45 deg of the sides.

    Raises:
        OpeningError: MF207 where it does not repeat along two directions, MF208 for less than two periods in view.
    """
    from scipy import ndimage

    step = max(1, -(-max(picture.shape) // _WORKED))
    rows, columns = (length // step * step for length in picture.shape)
    small = picture[:rows, :columns].reshape(rows // step, step, columns // step, step).mean((1, 3))
    smooth = ndimage.gaussian_filter(small, max(small.shape) / 3, mode="nearest")
    first, second = _upright(*_shortest(_likeness(small / np.maximum(smooth, 1e-3))))
    middle = np.array([(columns - 1) / 2, (rows - 1) / 2])
    start = Lattice(np.block([[np.stack([first, second], 1) * step, middle[:, None]], [np.zeros((1, 2)), np.eye(1)]]))
    return refined(picture, start)


def middle(values: Floats) -> Floats:
    """Median along the first axis of what is no NaN; NumPy's own takes long where the axis is short."""
    ordered, count = np.sort(values, axis=0), np.isfinite(values).sum(0, keepdims=True)
    low, high = (np.take_along_axis(ordered, np.maximum(count - part, 0) // 2, 0)[0] for part in (1, 0))
    median: Floats = np.where(count[0] % 2, low, (low + high) / 2)
    return median


def refined(picture: Floats, lattice: Lattice) -> Lattice:
    """A lattice fitted to all periods in view, from the middle outwards."""
    from scipy import ndimage

    sides = np.hypot(*lattice.middle_px(picture.shape))
    step = max(1, int(sides.max() // (2 * _SAMPLES)))
    small = ndimage.uniform_filter(picture, step) if step > 1 else picture
    far = float(np.abs(lattice.view(picture.shape)).max())
    reach, rounds = min(2.0, far), 0
    while True:
        most = np.sqrt(_MOST / (2 * reach) ** 2)
        columns, rows = (int(np.clip(round(side), 12, min(most, _SAMPLES))) for side in sides)
        periods = Periods.of(small, lattice, (rows, columns), 1)
        v, u = (np.arange(n) + a + 0.5 for n, a in zip(periods.seen.shape, periods.first[::-1], strict=True))
        within = (np.maximum(np.abs(u[None, :]), np.abs(v[:, None])) <= reach) & (periods.seen > 0.1)
        found = np.argwhere(within)
        if periods.seen[within].sum() < 3:
            raise too_few(picture, lattice)
        at = np.stack([u[found[:, 1]], v[found[:, 0]]], 1)
        lattice, moved, shift = _matched(lattice, periods.values[within], at, projective=reach >= far)
        if reach >= far:
            rounds += 1
            if moved * float(sides.max()) < 0.01 or rounds == 20:
                return replace(lattice, shift_px=shift * float(sides.max()), matched=len(found))
        reach = min(1.6 * reach, far)


def too_few(picture: Floats, lattice: Lattice) -> OpeningError:
    """MF208: less than two periods along a side are in view."""
    u, v = np.ptp(lattice.across(picture.shape), axis=1)
    return OpeningError("MF208", f"{u:.1f} x {v:.1f} periods are in view; their mean needs 2 x 2", cure=_CURE)


def _likeness(picture: Floats) -> Floats:
    """Correlation coefficient of a picture with itself at every shift, [2 rows - 1, 2 columns - 1], 0 in the middle.

    NaN where less than a fifth of it overlaps. Padfield, "Masked object registration in the Fourier domain", 2012.
    """
    from scipy import fft

    rows, columns = picture.shape
    size = [fft.next_fast_len(2 * length, real=True) for length in (rows, columns)]
    centred = picture - picture.mean()
    one, value, square = (fft.rfft2(part, size) for part in (np.ones_like(centred), centred, centred**2))

    def summed(a: NDArray[np.complex128], b: NDArray[np.complex128]) -> Floats:
        whole: Floats = np.roll(fft.irfft2(a.conj() * b, size), (rows - 1, columns - 1), (0, 1))
        return whole[: 2 * rows - 1, : 2 * columns - 1]

    count = np.maximum(summed(one, one), 1.0)
    here, there = summed(value, one) / count, summed(one, value) / count
    first, second = summed(square, one) / count - here**2, summed(one, square) / count - there**2
    with np.errstate(invalid="ignore", divide="ignore"):
        likeness = (summed(value, value) / count - here * there) / np.sqrt(first * second)
    return np.where(count > 0.2 * rows * columns, likeness, np.nan)


def _shortest(likeness: Floats) -> tuple[Floats, Floats]:
    """The two shortest shifts (x, y) at which a picture is like itself, refined by all that they span."""
    from scipy import ndimage

    middle = np.array(likeness.shape) // 2
    filled = np.nan_to_num(ndimage.gaussian_filter(np.nan_to_num(likeness, nan=-1.0), 1.0), nan=-1.0)
    tops = (filled == ndimage.maximum_filter(filled, 5)) & (filled > 0.1)
    places = np.argwhere(tops) - middle
    half = places[(places[:, 0] > 0) | ((places[:, 0] == 0) & (places[:, 1] > 0))]
    half = half[(np.abs(half) < middle - 2).all(1)]
    along = np.linspace(0, 1, 65)[:, None, None]
    paths = ndimage.map_coordinates(filled, np.moveaxis(middle + along * half, 2, 0), order=1)
    heights = filled[tuple((half + middle).T)]
    kept = heights - paths.min(0) > _RISE
    half, heights = half[kept], heights[kept]
    if len(half):
        good = heights > max(0.15, _ALIKE * heights.max())
        half, heights = half[good], heights[good]
        half = half[[_parted(filled, middle, half, heights, k) for k in range(len(half))]]
    half = half[np.argsort((half**2).sum(1))]
    if len(half):
        first = half[0]
        sine = np.abs(first[0] * half[:, 1] - first[1] * half[:, 0]) / np.hypot(*first) / np.hypot(*half.T)
        other = half[sine > 0.4]
        if len(other):
            basis = np.stack([first, other[0]], 1).astype(float)
            for near in (2.5, 4.5, 8.5):  # farther shifts are more exact once the nearer ones are
                counts = np.linalg.solve(basis, half.T)
                whole = np.rint(counts)
                used = (np.abs(counts - whole).max(0) < 0.2) & (np.abs(whole).max(0) < near) & whole.any(0)
                tops_at = np.array([_top(filled, middle + place) - middle for place in half[used]])
                basis = np.linalg.lstsq(whole[:, used].T, tops_at, rcond=None)[0].T
            return basis[::-1, 0], basis[::-1, 1]
    what = "the picture does not repeat along two directions" if len(half) else "the picture does not repeat"
    raise OpeningError("MF207", what, cure=_CURE)


def _parted(values: Floats, middle: NDArray[np.int_], places: NDArray[np.int_], heights: Floats, k: int) -> bool:
    """Whether a valley parts a top from every higher one: else it is a shoulder of it."""
    from scipy import ndimage

    higher = np.concatenate([places[heights > heights[k]], -places[heights > heights[k]]])
    paths = middle + places[k] + np.linspace(0, 1, 65)[:, None, None] * (higher - places[k])
    lowest = ndimage.map_coordinates(values, np.moveaxis(paths, 2, 0), order=1).min(0)
    return bool((heights[k] - lowest > _RISE / 2).all())


def _top(values: Floats, place: NDArray[np.int64]) -> Floats:
    """A maximum between samples, by the parabola through three of them along each side."""
    y, x = place
    below, above = (np.array([values[y + step, x], values[y, x + step]]) for step in (-1, 1))
    refined_place: Floats = place + (above - below) / (2 * np.maximum(2 * values[y, x] - above - below, 1e-12))
    return refined_place


def _upright(a: Floats, b: Floats) -> tuple[Floats, Floats]:
    """The smallest cell of a lattice with a right angle: its first side points to the right, its second upwards.

    One that stands within 20 deg of the picture's sides goes before any other, such as the diagonals of a square.
    """
    counts = [np.array(pair) for pair in product(range(-3, 4), repeat=2) if any(pair)]
    sides = [m * a + n * b for m, n in counts]
    found: list[tuple[bool, float, Floats, Floats]] = []
    for first in sides:
        for second in sides:
            area = first[1] * second[0] - first[0] * second[1]  # rows run downwards
            lengths = float(np.hypot(*first) * np.hypot(*second))
            turn = abs(np.arctan2(first[1], first[0]))
            if turn <= np.pi / 4 + 0.01 and area > lengths * np.cos(np.deg2rad(5)):
                found.append((turn > np.deg2rad(20), area, first, second))
    if not found:
        angle = np.rad2deg(np.arccos(abs(a @ b) / np.hypot(*a) / np.hypot(*b)))
        what = f"the directions of the lattice stand at {angle:.0f} deg, and no cell of it has a right angle"
        raise OpeningError("MF207", what, cure="Photograph a display of rows and columns, straight from above")
    _, _, first, second = min(found, key=lambda each: (each[0], round(each[1], 3)))
    return first, second


def _matched(lattice: Lattice, values: Floats, at: Floats, *, projective: bool) -> tuple[Lattice, float, float]:
    """A lattice moved so that periods [number, rows, columns] about ``at`` are most alike.

    Beside it the largest move, and the rms by which single periods lie beside it then, both in periods.

    Their mean is unknown too, and is projected out of residuals and derivatives at once (variable projection), else a
    mean that is smeared would hold every period where it lies. Light varies by a polynomial of the second degree.
    """
    _, rows, columns = values.shape
    seen = np.isfinite(values)
    filled = np.where(seen, values, 0.0)
    mean = filled.sum(0) / np.maximum(seen.sum(0), 1)
    near = float(np.abs(at).max())
    right, up = (
        (np.roll(mean, -1, axis) - np.roll(mean, 1, axis)) * near * length / 2
        for axis, length in ((1, columns), (0, rows))
    )
    u = (at[:, 0, None, None] + (np.arange(columns) + 0.5) / columns - 0.5) / near
    v = (at[:, 1, None, None] + (np.arange(rows)[:, None] + 0.5) / rows - 0.5) / near
    terms = [right * u, right * v, up * u, up * v, *(-mean * part for part in (u, v, u * u, u * v, v * v))]
    if projective:
        outwards = right * u + up * v
        terms += [-u * outwards, -v * outwards]
    whole = np.stack([np.broadcast_to(term, values.shape) for term in [*terms, -filled]], -1)
    weight, answer, left = seen.astype(float), np.zeros(len(terms)), filled
    for _ in range(3):  # dirt counts less each time
        total = np.maximum(weight.sum(0), 1e-9)[..., None]
        apart = whole - (weight[..., None] * whole).sum(0) / total
        rooted = (np.sqrt(weight)[..., None] * apart).reshape(-1, len(terms) + 1)
        product_ = rooted.T @ rooted
        answer = np.linalg.lstsq(product_[:-1, :-1], product_[:-1, -1], rcond=1e-10)[0]
        left = apart[..., -1] - apart[..., :-1] @ answer
        weight = seen / (1 + (left / (4 * np.median(np.abs(left[seen])) + 1e-12)) ** 2)
    slopes = np.stack([right, up], -1) / near
    normal = np.einsum("kyx,yxa,yxb->kab", weight, slopes, slopes)
    single = np.linalg.solve(normal + 1e-9 * np.eye(2), np.einsum("kyx,yxa->ka", weight * left, slopes)[..., None])
    shift = float(np.sqrt((single[seen.mean((1, 2)) > 0.5] ** 2).sum(1).mean())) if len(single) else 0.0
    change = np.eye(3)
    change[:2, :2] += answer[:4].reshape(2, 2)
    if projective:
        change[2, :2] = answer[9:11]
    largest = float(np.abs(change - np.eye(3)).max())
    change = np.eye(3) + (change - np.eye(3)) * min(1.0, 0.15 / max(largest, 1e-12))
    scaled = np.diag([near, near, 1.0]) @ change @ np.diag([1 / near, 1 / near, 1.0])
    return replace(lattice, matrix=lattice.matrix @ scaled), largest * near, shift
