"""The mean cell of a display in a microscope picture, and its opening with a bar on its edge.

Picture -> lattice -> periods laid over each other, without their dirt -> two levels -> outline at the middle of them

The edge of a blurred step lies at the middle of its levels, but a blurred corner or disc has shrunk there. What was
found is therefore blurred once more, by the blur that its own edges show, and as much as that moves it is given back.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from fractions import Fraction
from typing import Literal

import numpy as np

from maskfab.base.arrays import Floats, Mask
from maskfab.base.errors import OpeningError
from maskfab.display.lattice import Lattice, Periods, find_lattice, middle, refined, too_few

_SAMPLES = 720
"""Most samples along a cell; a picture that is finer is binned."""
_LEAST = 120
"""Fewest samples along a cell."""
_FINE = 500
"""Parts of a cell's side between which the outline is drawn, or a few more."""
_GREY, _GREY_SHARE = 0.2, 0.01
"""Of the contrast, by which a place may lie beside what two levels and their blur make of it; and of the cell."""
_DIFFER = 0.03
"""Contrast between neighbours, of clear against opaque, from which on they are no repetition of one period."""


@dataclass(frozen=True, eq=False)
class SeenCell:
    """The mean cell of a picture.

    Attributes:
        values: [samples, samples] 0 opaque to 1 clear, row 0 the lowest; beyond both where light is uneven.
        clear: [parts, parts] 0 to 1, the clear share of parts of the cell, whole parts to a sample.
        lattice: from cells to pixels of the picture, a cell from 0 to 1.
        pixels: pixels of the display along the cell's side.
        periods: periods of the picture that the square cell holds along each side.
        px_per_um: pixels of the picture in a micrometre, in the middle of it.
        px_per_um_bar: two sigma of it.
        turn_deg: turn of the display in the picture, anticlockwise, in the middle of it.
        skew_deg: angle of the cell's sides in the picture beyond 90 deg: of a tilt, or of pixels that are not square.
        open_ratio_bar: two sigma of the open ratio.
        blur_px: sigma of the blur of an edge, in pixels of the picture.
        edge_bar_px: two sigma of the place of an edge: noise, levels, blur and lattice.
        cells: periods that were averaged, counted by what is in view.
        differ: standard deviation of the open ratio over single periods; None where fewer than two are whole.
    """

    values: Floats
    clear: Floats
    lattice: Lattice
    pixels: int
    periods: tuple[int, int]
    px_per_um: float
    px_per_um_bar: float
    turn_deg: float
    skew_deg: float
    open_ratio_bar: float
    blur_px: float
    edge_bar_px: float
    cells: float
    differ: float | None

    @property
    def open_ratio(self) -> float:
        """Clear share of the cell."""
        return float(self.clear.mean())

    def dots(self, dots: int) -> Mask:
        """As many clear dots as the open ratio says, those first of which most is clear."""
        size = len(self.clear)
        places = np.linspace(0, size, dots + 1)
        share = self.clear
        for _ in range(2):
            summed = np.vstack([np.zeros(size if share.shape[1] == size else dots), share.cumsum(0)])
            whole = np.minimum(places.astype(int), size - 1)
            at = summed[whole] + (places - whole)[:, None] * share[whole]
            share = np.diff(at, axis=0).T
        count = round(self.open_ratio * dots**2)
        mask = np.zeros(dots**2, dtype=bool)
        mask[np.argsort(-np.round(share.ravel(), 6), kind="stable")[:count]] = True
        return mask.reshape(dots, dots)


def seen_cell(
    picture: Floats, pitch_um: float, clear: Literal["dark", "bright"], pixels: int | None, where: str
) -> SeenCell:
    """The mean cell of a picture in linear light [rows, columns], row 0 on top.

    Args:
        pitch_um: side of a pixel of the display.
        clear: which is clear.
        pixels: pixels along the side of the square cell; None for as many as its likeness tells.

    Raises:
        OpeningError: MF207 no lattice, MF208 too few periods in view, MF209 out of focus or too coarse, MF210 clipped,
            MF211 no square cell, or one of an unknown number of pixels.
    """
    _check_clipped(picture, where)
    lattice = find_lattice(picture)
    sides = np.hypot(*lattice.middle_px(picture.shape))
    step = max(1, int(sides.max() // _SAMPLES))
    rows, columns = (length // step * step for length in picture.shape)
    binned = picture[:rows, :columns].reshape(rows // step, step, columns // step, step).mean((1, 3))
    shift = (1 - step) / (2 * step)
    scaled = np.array([[1 / step, 0, shift], [0, 1 / step, shift], [0, 0, 1]])
    lattice = Lattice(scaled @ lattice.matrix, lattice.shift_px / step, lattice.matched)
    even = binned / _evened(binned, lattice)
    if clear == "dark":
        even = -even
    lattice = _between_openings(even, lattice)
    groups = _groups(even, lattice, pixels is None, where)
    lattice = lattice.of_groups(*groups)
    if max(groups) > 1:  # the mean of unlike periods had pulled it
        lattice = refined(even, lattice)
    if np.ptp(lattice.across(binned.shape), axis=1).min() < 1.98:
        raise too_few(binned, lattice)
    vectors = lattice.middle_px(binned.shape)
    sides = np.hypot(*vectors)
    periods, across = _square(sides, groups, pixels, where)
    side = float((sides * periods).mean())
    least = 6 * max(periods)
    samples = int(np.clip(math.ceil(side / least) * least, math.ceil(_LEAST / least) * least, None))
    laid = Periods.of(even, lattice, (samples // periods[1], samples // periods[0]), 3)
    mean, error = _mean(laid, where)
    seen = float(laid.seen.sum())
    mean, error = np.tile(mean, periods[::-1]), np.tile(error, periods[::-1])
    low, high, spread, sigma = _levels(mean, where)
    values = (mean - low) / (high - low)
    roll = [_begin(values.mean(axis)) for axis in (1, 0)]
    values, error = np.roll(values, (-roll[0], -roll[1]), (0, 1)), np.roll(error, (-roll[0], -roll[1]), (0, 1))
    cell = lattice.of_groups(*periods).moved(roll[1] / samples, roll[0] / samples)
    outline, edges, blurred = _outline(values, sigma)
    _check_two_levels(values - blurred, where)
    slope = 1 / (math.sqrt(2 * math.pi) * sigma)  # of a blurred edge, at its middle
    noise = float(np.median(error[_border(values > 0.5)])) / (high - low) / slope
    level, blur = spread / (high - low) / 2 / slope, edges / 2
    shift_px = lattice.shift_px / math.sqrt(max(1.0, seen))
    common = math.hypot(level, blur, 0.03)
    edge = 2 * math.hypot(noise, common, shift_px)
    length = _border_length(outline > 0.5) * samples / len(outline)
    px_um, per_px = step * side / (pitch_um * across), step * side / samples
    lever = float(np.ptp(lattice.across(binned.shape), axis=1).mean() / math.sqrt(12))
    scale = max(lattice.shift_px, 0.02) / (math.sqrt(max(1.0, seen)) * lever * float(sides.mean()))
    whole = (laid.values[laid.seen > 0.999] > (low + high) / 2).mean(axis=(1, 2))
    back, turns = np.linalg.inv(scaled), np.degrees(np.arctan2(-vectors[1], vectors[0]))
    return SeenCell(
        values, outline, Lattice(back @ cell.matrix), across, periods, px_um, 2 * scale * px_um, float(turns[0]),
        float(turns[1] - turns[0] - 90),
        2 * length * common / samples**2, sigma * per_px, edge * per_px, seen,
        float(whole.std(ddof=1)) if len(whole) > 1 else None,
    )  # fmt: skip


def _check_clipped(picture: Floats, where: str) -> None:
    """MF210 where half of the bright, or of the dark, is at the end of the scale."""
    middle = (np.percentile(picture, 2) + np.percentile(picture, 98)) / 2
    bright = picture >= middle
    for part, end, word in ((bright, 1.0, "full"), (~bright, 0.0, "black")):
        share = float(np.mean(np.abs(picture[part] - end) < 1e-6)) if part.any() else 1.0
        if share > 0.5:
            what = (
                f"{share:.0%} of the {'bright' if end else 'dark'} places are {word}: their level is not in the picture"
            )
            cure = "Halve the exposure" if end else "Expose longer, or raise the black level"
            raise OpeningError("MF210", what, where=where, cure=cure)


def _evened(picture: Floats, lattice: Lattice) -> Floats:
    """The smooth light over a picture: its quotient by the mean period, as a polynomial of the third degree."""
    even = np.full(picture.shape, picture.mean())
    rows, columns = picture.shape
    step = max(1, max(rows, columns) // 300)
    y, x = np.meshgrid(np.arange(0.0, rows, step), np.arange(0.0, columns, step), indexing="ij")
    u, v = lattice.periods(x, y)
    samples = 48
    at = tuple((part % 1 * samples).astype(int) for part in (v, u))
    powers = [(i, j) for i in range(4) for j in range(4 - i)]
    high, wide = (np.linspace(-1, 1, length) for length in (rows, columns))
    for _ in range(4):
        laid = Periods.of(picture / even, lattice, (samples, samples), 1)
        mean = middle(laid.values.reshape(-1, samples, samples))
        part, weight = np.nan_to_num(mean, nan=float(np.nanmedian(mean)))[at], np.ones(at[0].shape)
        near = [(2 * y / (rows - 1) - 1), (2 * x / (columns - 1) - 1)]
        terms = np.stack([part * near[0] ** i * near[1] ** j for i, j in powers], -1).reshape(part.size, -1)
        goal, found = picture[::step, ::step].ravel(), np.zeros(len(powers))
        for _ in range(3):
            weighted = terms * weight.reshape(-1, 1)
            found = np.linalg.solve(weighted.T @ terms, weighted.T @ goal)
            off = np.abs(goal - terms @ found)
            weight = 1 / (1 + (off / (4 * np.median(off) + 1e-12)) ** 2)
        table = np.zeros((4, 4))
        table[tuple(np.transpose(powers))] = found
        even = np.vander(high, 4, increasing=True) @ table @ np.vander(wide, 4, increasing=True).T
        even = np.maximum(even, 0.1 * even.mean())
    return even


def _groups(even: Floats, lattice: Lattice, asking: bool, where: str) -> tuple[int, int]:
    """Periods along u and along v after which a picture repeats truly: 2 where neighbours are mirrored or turned.

    Raises:
        OpeningError: MF211, if asking, for two that are no mirror images.
    """
    samples = 48
    laid = Periods.of(even, lattice, (samples, samples), 1)
    v, u = np.nonzero(laid.seen > 0.3)
    values = laid.values[v, u]
    inside = np.isfinite(values)
    mean = middle(values)
    apart = np.where(inside, values - mean, 0)
    contrast = float(np.nanpercentile(mean, 97) - np.nanpercentile(mean, 3))
    found = [1, 1]
    for number, steps in ((2, (1, 0)), (2, (0, 1)), (2, (1, 1)), (3, (1, 0)), (3, (0, 1))):
        if any(have > 1 and along for have, along in zip(found, steps, strict=True)):
            continue  # in few periods one rhythm is mixed up with another
        of_group = ((u * steps[0] + v * steps[1]) % number == np.arange(number)[:, None]).astype(float)
        count = np.tensordot(of_group, inside, 1)
        means = np.tensordot(of_group, apart, 1) / np.maximum(count, 1)
        squares = np.tensordot(of_group, apart**2, 1) - count * means**2
        known = (count > 1).all(0)  # places that were seen twice in every group
        if known.mean() < 0.3:
            continue
        within = float((squares / np.maximum(count * (count - 1), 1)).mean(0)[known].mean())
        between = float(means.var(axis=0, ddof=1)[known].mean())
        if between > max(4 * within, (_DIFFER * contrast) ** 2):
            found = [math.lcm(have, number if along else 1) for have, along in zip(found, steps, strict=True)]
            if asking and number == 2 and _unlike(mean + means[0], mean + means[1]) > 1.2 * between:
                rms = math.sqrt(2 * between) / contrast
                what = f"every second period differs by {rms:.1%} rms of the contrast, and is no mirror image"
                cure = "Say how many pixels of this pitch are along the cell, such as --set pixels=1 or --set pixels=2"
                raise OpeningError("MF211", what, where=where, cure=cure)
    return found[0], found[1]


def _unlike(one: Floats, other: Floats) -> float:
    """Mean square by which one period differs from the other, mirrored or turned and moved so that it is most alike."""
    power = np.fft.fft2(one)
    turned = [each for part in (other, other.T) for each in (part, part[::-1], part[:, ::-1], part[::-1, ::-1])]
    likeness = max(float(np.fft.ifft2(power * np.conj(np.fft.fft2(each))).real.max()) for each in turned[1:])
    return float((one**2).mean() + (other**2).mean()) - 2 * likeness / one.size


def _square(sides: Floats, groups: tuple[int, int], pixels: int | None, where: str) -> tuple[tuple[int, int], int]:
    """Periods along each side of the smallest square cell, and the pixels of the display along it."""
    ratio = float(sides[0] / sides[1])
    near = min(
        (Fraction(a, b) for a in range(1, 5) for b in range(1, 5)), key=lambda f: abs(math.log(ratio / float(f)))
    )
    if abs(ratio / float(near) - 1) > 0.04:
        what = f"a period is {ratio:.3f} times as wide as high, which makes no square cell"
        raise OpeningError("MF211", what, where=where, cure="Photograph it straight from above, with square pixels")
    periods = near.denominator, near.numerator
    if pixels is not None:
        return periods, pixels
    units = tuple(groups[axis] * periods[axis] for axis in (0, 1))
    if 2 in units and units[0] == units[1]:
        return periods, 2  # neighbours that are mirrored or turned
    if max(periods) in (1, 3) and min(periods) == 1:
        return periods, 1  # or one of three columns, one for each colour
    what = f"the square cell holds {periods[0]} x {periods[1]} periods; they may be pixels, or parts of one"
    cure = f"Say how many pixels of this pitch are along the cell: --set pixels=1, or --set pixels={max(periods)}"
    raise OpeningError("MF211", what, where=where, cure=cure)


def _mean(laid: Periods, where: str) -> tuple[Floats, Floats]:
    """Mean [rows, columns] of periods without what lies far from their median, and its standard error.

    Raises:
        OpeningError: MF207 where so many periods lie far from it at one place that it is no dirt.
    """
    v, u = np.nonzero(laid.seen > 0.02)
    values = laid.values[v, u]
    most = middle(values)
    off = np.abs(values - most)
    far = off > 0.3 * (np.percentile(most, 97) - np.percentile(most, 3))
    unlike = float(((far.sum(0) > 1) & (far.sum(0) > 0.12 * np.isfinite(values).sum(0))).mean())
    if unlike > _GREY_SHARE / 2:
        what = f"single periods differ in {unlike:.1%} of their area"
        cure = "Photograph where pixels are alike; those that are turned at random have no mean"
        raise OpeningError("MF207", what, where=where, cure=cure)
    spread = 1.48 * middle(off)
    kept = off <= 3 * np.maximum(spread, np.median(spread))
    count = np.maximum(kept.sum(0), 1)
    mean = np.where(kept, values, 0).sum(0) / count
    rms = np.sqrt(np.where(kept, (values - mean) ** 2, 0).sum(0) / np.maximum(count - 1, 1))
    return mean, np.maximum(rms, np.median(rms)) / np.sqrt(count)


def _levels(mean: Floats, where: str) -> tuple[float, float, float, float]:
    """Lower and upper level of a mean cell, how far they are uncertain, and sigma of the blur between, in samples."""
    from scipy import ndimage

    low, high = (float(value) for value in np.percentile(mean, [2, 98]))
    for _ in range(30):  # two means
        split = (low + high) / 2
        low, high = float(mean[mean <= split].mean()), float(mean[mean > split].mean())
    spread, sigma = 0.0, 1.0
    for _ in range(4):
        bright = mean > (low + high) / 2
        slopes = np.hypot(*(np.roll(mean, -1, axis) - np.roll(mean, 1, axis) for axis in (0, 1))) / 2
        edge = _border(bright)
        sigma = (high - low) / (math.sqrt(2 * math.pi) * float(np.median(slopes[edge])) + 1e-12)
        wide = int(min(len(mean) // 2, 6 * sigma + 8))
        padded = np.pad(bright, wide, mode="wrap")
        inside = slice(wide, -wide or None), slice(wide, -wide or None)
        parts = []
        for kind in (False, True):
            deep = ndimage.distance_transform_edt(padded == kind)[inside]
            place = (bright == kind) & (deep > 2 * sigma)
            if not place.any():
                narrow = 2 * float(deep[bright == kind].max())
                kinds = "clear" if kind else "opaque"
                what = f"the widest {kinds} place is {narrow:.1f} samples, its edges {2.4 * sigma:.1f}"
                cure = "Focus on the wires, or take an objective of a larger aperture"
                raise OpeningError("MF209", f"{what} wide: none of it shows its level", where=where, cure=cure)
            parts.append(mean[place])
        low, high = (float(np.median(part)) for part in parts)
        spread = math.hypot(*(1.48 * float(np.median(np.abs(part - np.median(part)))) for part in parts)) / 2
    return low, high, spread, sigma


def _between_openings(even: Floats, lattice: Lattice) -> Lattice:
    """The lattice, its periods beginning where least is clear: mirrors stand between openings."""
    mean = middle(Periods.of(even, lattice, (48, 48), 1).values.reshape(-1, 48, 48))
    mean = (mean - mean.min()) / np.ptp(mean)
    return lattice.moved(*(_begin(mean.mean(axis)) / 48 for axis in (0, 1)))


def _begin(share: Floats) -> int:
    """Where a cell begins along one side: in the middle of the longest stretch of which least is clear."""
    low = share <= share.min() + 0.02
    if low.all():
        return 0
    turned = np.roll(low, -int(np.argmin(low)))  # begins outside of a stretch
    edges = np.flatnonzero(np.diff(np.concatenate([[0], turned.astype(int), [0]])))
    starts, stops = edges[::2], edges[1::2]
    longest = int(np.argmax(stops - starts))
    return (int(np.argmin(low)) + int(starts[longest] + stops[longest]) // 2) % len(share)


def _outline(values: Floats, sigma: float) -> tuple[Floats, float, Floats]:
    """Clear share of parts, blur given back; the mean move of an edge by that, in samples; and it blurred once more."""
    from scipy import ndimage

    size, finer = len(values), -(-_FINE // len(values))
    at = (np.arange(size * finer) + 0.5) / finer - 0.5
    fine = ndimage.map_coordinates(values, np.meshgrid(at, at, indexing="ij"), order=3, mode="grid-wrap")
    first = _share(fine)
    again = ndimage.gaussian_filter(first, sigma * finer, mode="wrap")
    clear = _share(2 * fine - again)
    moved = float(np.abs(clear - first).sum()) / max(1.0, _border_length(clear > 0.5)) / finer
    return clear, moved, again.reshape(size, finer, size, finer).mean((1, 3))


def _share(values: Floats) -> Floats:
    """Share of every part beyond one half, by its slope: edges along the grid would else jump by whole parts."""
    slopes = (np.roll(values, -1, axis) - np.roll(values, 1, axis) for axis in (0, 1))
    share: Floats = np.clip(0.5 + (values - 0.5) / np.maximum(np.hypot(*slopes) / 2, 1e-9), 0, 1)
    return share


def _check_two_levels(apart: Floats, where: str) -> None:
    """MF209 for a mean cell that is no blurred picture of two levels, by what parts it from that."""
    wrong = float((np.abs(apart) > _GREY).mean())
    if wrong > _GREY_SHARE:
        what = f"{wrong:.1%} of the mean cell are neither clear nor opaque, nor a blurred edge: gaps, or a third level"
        cure = "Focus on the wires, take more magnification, or light that shows two levels of brightness"
        raise OpeningError("MF209", what, where=where, cure=cure)


def _border(clear: Mask) -> Mask:
    """Places whose neighbour to the right or above is of the other kind."""
    border: Mask = (clear != np.roll(clear, -1, 0)) | (clear != np.roll(clear, -1, 1))
    return border


def _border_length(clear: Mask) -> float:
    """Length of the border between clear and opaque, in samples (Cauchy and Crofton, by four directions)."""
    straight = sum(float((clear != np.roll(clear, -1, axis)).sum()) for axis in (0, 1))
    oblique = sum(float((clear != np.roll(clear, move, (0, 1))).sum()) for move in ((-1, -1), (-1, 1)))
    return math.pi / 8 * (straight + oblique / math.sqrt(2))
