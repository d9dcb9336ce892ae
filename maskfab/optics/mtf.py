"""The MTF: presampled along cuts, rings and the worst direction, aliased by sampling, and as images of edges.

**Presampled** it is that of optics and sensor pixel, before any sampling can alias it.

**Aliased** it is that of a sampled picture, and changes with the sub-pixel phase. Samples h((n + φ) p) of a PSF with
transfer function O have the discrete transform

    A(ν; φ) = Σ_k O(ν + k/p) exp(2πi k·φ),                      (Poisson summation; Goodman, Fourier Optics, 2.4)

k running over all whole vectors. O ends at D / (λf), so the sum is finite and exact. The aliased MTF is
|A(ν; φ)| / |A(0; φ)|, what one computes from sampled values that were scaled to sum 1. It is no property of the optics
alone, as the presampled one is.

Notes:
    A(0; φ) is the sum of the samples and can be small or zero if a PSF without pixels is sampled too coarsely; a
    pixel's own sinc has its zeros at all k/p, so for pixel means the sum is 1 whatever the phase.

**Edges** between black and white take colour from three wavelengths. An edge along y is a step of the scene; its image
is the integral of the line spread function, the transform of the OTF along x (Goodman, Fourier Optics, 6.2). From lags
it is known without a window. From pixels in a window it is known within half of what falls outside, for a PSF that is
alike on opposite sides.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache
from itertools import product
from typing import Literal

import numpy as np

from maskfab.base.arrays import Floats, Indices, distinct
from maskfab.base.errors import InternalError, JobError
from maskfab.base.model import Frozen, Mtf, Psf, Quantity, RadialMean, frozen
from maskfab.base.units import UM_PER_MM
from maskfab.job.camera import Camera
from maskfab.optics.colour import delta_e_1976, lab_of_linear_srgb
from maskfab.optics.lags import AxisLags, LagTable
from maskfab.optics.polynomials import gauss_legendre
from maskfab.optics.psf import cutoff, image_scale_um2, odd_samples
from maskfab.optics.rim import apart
from maskfab.optics.spectrum import Spectrum, pixel_transfer, polychromatic_otf

RINGS = 147
"""Radii from 0 to half a cycle per pixel; as many as the published curves have at 470 nm."""

LEVELS = (50, 30, 10)
"""Modulations in per cent about whose first crossing the radial mean is told on exact radii."""

# A cut's sample whose error is larger is made exact.
_COARSE = 2e-3
# How many lags of a ring are made exact at first, and pairs of lags and cut dots after which no more are.
_FIRST_OF_RING, _MOST_PAIRS, _MOST_OF_OUTLINE = 1, 400_000, 3_000_000
# Boxes across the stop by which diagonals of an outline are known that has too many parts.
_BOXES_OF_DIAGONALS = 2000

# Rings to either side of a crossing, radii in each, and directions for each dot of a half circle of lags.
_RINGS_ABOUT, _RADII_PER_RING, _DIRECTIONS_PER_DOT = 2, 3, 2
_FEWEST_DIRECTIONS, _FEW_DIRECTIONS, _MOST_DIRECTIONS = 16, 64, 1024

# About a crossing a curve is looked at in so many errors of the place, and twice at so many radii at which it may have
# crossed, if it is not known to that; so many directions are exact there, and serve for radii by such a share of a dot.
_ASIDE, _HALVINGS, _MOST_DOUBTFUL, _KNOWN, _ALIKE = 1.5, 2, 6, 1e-3, 1 / 16
# Of an outline of many parts, fewer directions; near lags share their pairs.
_EXACT_DIRECTIONS, _FEW_EXACT, _NEAR_SHARE = 32, 8, 4
# A mean of so many samples errs by three of its standard deviations at most, in 997 of 1000 cases.
_SIGMAS = 3


def presampled_mtf(table: LagTable, camera: Camera, wavelength_nm: float, levels: Sequence[float] = LEVELS) -> Mtf:
    """MTF from 0 to half a cycle per pixel along four directions, and its radial mean, minimum and maximum.

    Radial statistics are taken over rings one sample wide of a square grid of frequencies, the corners left out. The
    pixel is a full square, so its transfer is sinc(ν_x p) sinc(ν_y p). About its first crossings of the ``levels``, in
    per cent, the radial mean is told on exact radii.

    Notes:
        Of every sample the error is known (see :mod:`maskfab.optics.shape_bounds`). What could be a ring's least value
        is made exact, and so is a cut's whose error exceeds 0.002; a ring's mean errs by the mean of its errors.
    """
    view = _View(table, camera, wavelength_nm)
    step = 0.5 / camera.pixel_um / (RINGS - 1)
    axis = step * np.arange(RINGS, dtype=np.float64)
    rings = _rings(view, step)
    cuts = {
        "horizontal": rings.horizontal,
        "vertical": rings.vertical,
        "diagonal": rings.diagonal,
        "antidiagonal": rings.antidiagonal,
        "radial_mean": rings.mean,
        "radial_min": rings.low,
        "radial_max": rings.high,
    }
    errors = (rings.cut_error, rings.mean_error, rings.low_error, rings.high_error)
    uncertainty = max(float(each.max()) for each in errors)
    least = float(rings.low_error.mean())
    return Mtf(axis * UM_PER_MM, cuts, wavelength_nm, uncertainty, least, _falls(view, rings, step, levels))


def longest_lag_um(camera: Camera) -> float:
    """The largest lag that :func:`presampled_mtf` asks for at any of the camera's wavelengths."""
    return max(image_scale_um2(camera, w) for w in camera.wavelengths_nm) * 0.5 / camera.pixel_um


def area_under_radial_min(mtf: Mtf) -> float:
    """Mean of the radial minimum over its samples from 0 to half a cycle per pixel (the AUC of the literature)."""
    return float(mtf.cuts["radial_min"].mean())


def frequency_at(mtf: Mtf, level: float) -> tuple[float, float] | None:
    """The first frequency, in cy/mm, at which the radial mean falls below a level, and its error.

    The error reaches to the first frequencies at which the mean could fall below the level, and at which it must: it is
    large where the curve is flat, or nearly falls before.

    Returns:
        None if it stays above to the end.
    """
    mean = mtf.falls
    frequency = first_below(mean.frequency_cy_per_mm, mean.modulation, level)
    if frequency is None:
        return None
    least, most = (
        first_below(mean.frequency_cy_per_mm, mean.modulation + sign * mean.error, level) for sign in (-1, 1)
    )
    last = float(mtf.frequency_cy_per_mm[-1])
    return frequency, max(
        frequency - (frequency if least is None else least), (last if most is None else most) - frequency
    )


def first_below(frequency: Floats, values: Floats, level: float) -> float | None:
    """Where samples joined by straight lines first fall below a level."""
    below = np.flatnonzero(values < level)
    if not below.size:
        return None
    k = int(below[0])
    if k == 0:
        return float(frequency[0])
    share = (values[k - 1] - level) / (values[k - 1] - values[k])
    return float(frequency[k - 1] + share * (frequency[k] - frequency[k - 1]))


@dataclass(frozen=True, eq=False)
class _View:
    """The presampled MTF at any frequency, in cycles per micrometre of sensor."""

    table: LagTable
    camera: Camera
    wavelength_nm: float

    @property
    def scale_um2(self) -> float:
        return image_scale_um2(self.camera, self.wavelength_nm)

    def pixel(self, nu_x: Floats, nu_y: Floats) -> Floats:
        return np.asarray(np.sinc(nu_x * self.camera.pixel_um) * np.sinc(nu_y * self.camera.pixel_um))

    def exact(self, nu_x: Floats, nu_y: Floats) -> tuple[Floats, Floats]:
        lag_x, lag_y = self.scale_um2 * nu_x, self.scale_um2 * nu_y
        pixel = self.pixel(nu_x, nu_y)
        return abs(self.table.otf(lag_x, lag_y)) * pixel, self.table.error_at(lag_x, lag_y) * pixel

    def coarse(self, nu_x: Floats, nu_y: Floats) -> tuple[Floats, Floats]:
        lag_x, lag_y = self.scale_um2 * nu_x, self.scale_um2 * nu_y
        pixel = self.pixel(nu_x, nu_y) * ~apart(self.camera.stop, lag_x, lag_y)
        return abs(self.table.coarse_otf(lag_x, lag_y)) * pixel, self.table.error_at(lag_x, lag_y, coarse=True) * pixel

    def diagonals(self, slant: Floats) -> tuple[Floats, Floats]:
        """The coarse MTF along both diagonals, one after the other, at even steps [n] of either frequency from 0."""
        across, up = np.concatenate([slant, -slant]), np.concatenate([slant, slant])
        if self.table.outline is None or (self.table.rims and self.table.affords(4 * RINGS)):
            return self.coarse(across, up)
        tables = self.table.outline.on_lattice(self.scale_um2 * float(slant[1]), slant.size, _BOXES_OF_DIAGONALS)
        along, step = self.pixel(across, up) / self.table.energy_um2, np.arange(slant.size)
        column = slant.size - 1 + np.concatenate([step, -step])
        means, bounds = (table[np.tile(step, 2), column] * along for table in tables)
        return abs(means), bounds

    def bounded_on_grid(self, step: float, steps_x: Indices, steps_y: Indices) -> tuple[Floats, Floats]:
        """The bounded MTF at so many steps of frequency, fewer than RINGS of them, and not downwards."""
        axis = step * np.arange(1 - RINGS, RINGS, dtype=np.float64)
        column, row = steps_x + RINGS - 1, steps_y + RINGS - 1
        if self.table.outline is not None:
            means, bounds = self.table.outline.on_lattice(self.scale_um2 * step, RINGS)
            along = self.pixel(axis[column], axis[row]) / self.table.energy_um2
            return abs(means[steps_y, column]) * along, bounds[steps_y, column] * along
        lag, pixel = self.scale_um2 * axis, np.sinc(axis * self.camera.pixel_um)
        upper = lag[RINGS - 1 :]
        optics = self.table.coarse_grid(lag, upper)[steps_y, column]
        error = self.table.coarse_error_on_grid(lag, upper)[steps_y, column]
        along = pixel[column] * pixel[row]
        stop = self.camera.stop
        if lag[-1] >= min(stop.sides_um):
            along *= ~apart(stop, lag[column], lag[row])
        return abs(optics) * along, error * along


@dataclass(frozen=True, eq=False)
class _Rings:
    """Mean, least and greatest modulation of every ring, and cuts across them; bounds of the errors of each."""

    mean: Floats
    low: Floats
    high: Floats
    mean_error: Floats
    low_error: Floats
    high_error: Floats
    horizontal: Floats
    vertical: Floats
    diagonal: Floats
    antidiagonal: Floats
    cut_error: Floats


@cache
def _ring_grid() -> tuple[Indices, Indices, Indices]:
    """Steps across and up of the upper half of the square grid, ring by ring, and where each ring begins."""
    axis = np.arange(RINGS)
    across, up = np.meshgrid(np.concatenate([-axis[:0:-1], axis]), axis)
    ring = np.rint(np.hypot(across, up)).astype(np.intp)
    # Opposite frequencies are alike; of those on the horizontal axis one side counts.
    inside = (ring < RINGS) & ((up > 0) | (across >= 0))
    order = np.argsort(ring[inside], kind="stable")
    starts = np.searchsorted(ring[inside][order], axis)
    return frozen(across[inside][order]), frozen(up[inside][order]), frozen(starts)


def _rings(view: _View, step: float) -> _Rings:
    """Statistics over rings; what may be a ring's least value is found exactly."""
    steps_x, steps_y, starts = _ring_grid()
    nu_x, nu_y = step * steps_x.astype(np.float64), step * steps_y.astype(np.float64)
    count = np.diff(np.append(starts, nu_x.size))
    values, errors = view.bounded_on_grid(step, steps_x, steps_y)
    ring = np.repeat(np.arange(RINGS), count)
    slant = step / np.sqrt(2) * np.arange(RINGS, dtype=np.float64)
    slanted = np.concatenate([slant, -slant]), np.concatenate([slant, slant])
    of_slanted = view.diagonals(slant)
    nu_x, nu_y, values, errors = (
        np.concatenate(pair) for pair in zip((nu_x, nu_y, values, errors), (*slanted, *of_slanted), strict=True)
    )
    # What comes near to lag 0, the cuts, and the least of every ring in one go.
    chosen = np.ones(nu_x.size, dtype=np.bool_)
    chosen[: ring.size] = (steps_x == 0) | (steps_y == 0) | (ring * (step * view.scale_um2) < view.table.near_um)
    cut = chosen.copy()
    chosen &= errors > _COARSE
    chosen[_least(ring, values[: ring.size], _FIRST_OF_RING)] = True
    _make_exact(view, nu_x, nu_y, values, errors, np.flatnonzero(chosen))
    cut_errors, (diagonal, antidiagonal) = errors[cut], values[ring.size :].reshape(2, RINGS)
    nu_x, nu_y, values, errors = (each[: ring.size] for each in (nu_x, nu_y, values, errors))
    _refine_minima(view, nu_x, nu_y, values, errors, starts)
    # Where too many lags are alike some stay coarse, and any of them may be the least.
    low, below, above = (np.minimum.reduceat(values + sign * errors, starts) for sign in (0, -1, 1))
    high, most, least = (np.maximum.reduceat(values + sign * errors, starts) for sign in (0, 1, -1))
    return _Rings(
        np.add.reduceat(values, starts) / count,
        low,
        high,
        np.add.reduceat(errors, starts) / count,
        np.maximum(low - np.maximum(below, 0.0), above - low),
        np.maximum(most - high, high - least),
        values[steps_y == 0],
        values[steps_x == 0],
        diagonal,
        antidiagonal,
        cut_errors,
    )


def _make_exact(view: _View, nu_x: Floats, nu_y: Floats, values: Floats, errors: Floats, k: Indices) -> None:
    """Make the values of some frequencies exact, in place."""
    if view.table.rims and k.size and view.table.affords(k.size):
        values[k], errors[k] = view.exact(nu_x[k], nu_y[k])


def _refine_minima(view: _View, nu_x: Floats, nu_y: Floats, values: Floats, errors: Floats, starts: Indices) -> None:
    """Make exact, in place, what may be less than a ring's least exact value, some of every ring at a time."""
    table = view.table
    ring = np.repeat(np.arange(RINGS), np.diff(np.append(starts, values.size)))
    sure = errors <= table.uncertainty
    low = np.minimum.reduceat(np.where(sure, values, np.inf), starts)
    spent, at_a_time = 0, 4 * _FIRST_OF_RING
    most = _MOST_PAIRS if table.outline is None else _MOST_OF_OUTLINE
    while table.rims and spent < most:
        k = np.flatnonzero(~sure & (np.maximum(values - errors, 0.0) < low[ring] - table.uncertainty))
        k = k[_least(ring[k], values[k], at_a_time)]
        if table.outline is not None:
            k = k[: (most - spent) // table.cut_dots]
        if not k.size or not table.affords(k.size):
            break
        _make_exact(view, nu_x, nu_y, values, errors, k)
        sure[k] = True
        low = np.minimum.reduceat(np.where(sure, values, np.inf), starts)
        spent, at_a_time = spent + k.size * table.cut_dots, 4 * at_a_time


def _least(group: Indices, values: Floats, count: int) -> Indices:
    """Places of the least values of every group, so many of each at most; groups ascend."""
    if count == 1:
        starts = np.flatnonzero(np.diff(group, prepend=-1))
        least = np.minimum.reduceat(values, starts) if group.size else values
        places = np.flatnonzero(values == np.repeat(least, np.diff(starts, append=group.size)))
        return places[np.diff(group[places], prepend=-1) > 0]
    order = np.lexsort((values, group))
    return order[np.arange(order.size) - np.searchsorted(group, group) < count]


def _falls(view: _View, rings: _Rings, step: float, levels: Sequence[float]) -> RadialMean:
    """The mean over directions on exact radii, wherever it may first fall below one of the levels."""
    chosen = np.zeros(RINGS, dtype=np.bool_)
    means = []
    for level in levels:
        may, must = (np.flatnonzero(rings.mean + sign * rings.mean_error < level / 100) for sign in (-1, 1))
        first = int(may[0]) if may.size else RINGS
        last = int(must[0]) if must.size else first
        about = np.zeros(RINGS, dtype=np.bool_)
        about[max(0, first - _RINGS_ABOUT) : last + _RINGS_ABOUT] = True
        # What is told for a higher level is told.
        rings_of_level = np.flatnonzero(about & ~chosen)
        chosen |= about
        if rings_of_level.size:
            means.append(_directional_mean(view, step, rings_of_level))
    if not means:
        means.append(_directional_mean(view, step, np.zeros(1, dtype=np.intp)))
    told = np.concatenate(means, axis=1)
    radii, mean, error = _with_lines(_looked_at(told, [level / 100 for level in levels], step, view), step)
    return RadialMean(UM_PER_MM * radii, mean, error)


def _with_lines(told: Floats, step: float) -> Floats:
    """Radii, a curve and its error, that of straight lines between radii included, [3, 2 n - 1].

    A kink κ a share t on the way from one radius to the next, h farther, takes the curve off the line by κ h t (1 - t)
    at most, and that is below what rises evenly to κ h / 2 half way, and falls again.
    """
    radii, mean, error, kink = told
    width = np.diff(radii)
    # Between levels nothing is told, for there the rings tell that none is met.
    sag = np.where(width < 1.01 * step, kink[:-1] * width / 2, 0.0)
    places, values, errors = np.empty((3, 2 * radii.size - 1))
    places[::2], values[::2], errors[::2] = radii, mean, error
    places[1::2], values[1::2] = radii[:-1] + width / 2, (mean[:-1] + mean[1:]) / 2
    errors[1::2] = (error[:-1] + error[1:]) / 2 + sag
    return np.stack([places, values, errors])


def _directions(view: _View, lag_um: float) -> int:
    """Number of directions that tell the mean of a ring of lags."""
    wanted = _DIRECTIONS_PER_DOT * math.pi * lag_um / view.table.x.dot_um
    return 1 << math.ceil(math.log2(min(max(wanted, _FEWEST_DIRECTIONS), _MOST_DIRECTIONS)))


def _directional_mean(view: _View, step: float, rings: Indices) -> Floats:
    """Radii of rings and between, the mean over directions, its error, and the kink on the way to the next, [4, n]."""
    count = _directions(view, view.scale_um2 * step * float(rings[-1] + 1))
    # The curve bends where lags are short, and there directions are few.
    parts = _RADII_PER_RING if count > _FEW_DIRECTIONS else 2 * _RADII_PER_RING
    places = (rings[:, None] + np.arange(parts) / parts).ravel()
    radii = step * places[places <= RINGS - 1]
    angle = np.pi * np.arange(count) / count
    values, errors = view.coarse(np.outer(radii, np.cos(angle)), np.outer(radii, np.sin(angle)))
    # Every other direction errs by half of how far both halves are apart, and all of them by less.
    quadrature = abs(values[:, ::2].mean(axis=1) - values[:, 1::2].mean(axis=1)) / 2
    mean = values.mean(axis=1)
    # A kink between two radii bends the curve at both, in shares that add up to it.
    bend = np.zeros(mean.size + 1)
    bend[1 : mean.size - 1] = abs(np.diff(mean, 2)) / (radii[1] - radii[0])
    return np.stack([radii, mean, quadrature + errors.mean(axis=1), bend[:-1] + bend[1:]])


def _looked_at(told: Floats, levels: Sequence[float], step: float, view: _View) -> Floats:
    """A curve as of :func:`_directional_mean`, known closer where it falls below levels, and where it may before."""
    aside, closely = np.zeros(len(levels)), _Closely(view, [])
    # At the fall, then where that is by what was seen there, and on either side.
    for sides in ((0,), (-1, 0, 1)):
        falls = [_fall(told, level, step) for level in levels]
        met = [k for k, fall in enumerate(falls) if fall is not None]
        radii = np.array([falls[k] for k in met], dtype=np.float64)
        if not met:
            break
        places = np.clip((radii[:, None] + np.outer(aside[met], sides)).ravel(), told[0, 0], told[0, -1])
        seen = closely(places)
        off = seen[1] + abs(seen[0] - np.repeat(np.array(levels)[met], len(sides)))
        after = np.searchsorted(told[0], radii)
        slope = (told[1, after - 1] - told[1, after]) / (told[0, after] - told[0, after - 1])
        aside[met] = np.minimum(_ASIDE * off[:: len(sides)] / np.maximum(slope, 1e-12), step / 4)
        told = _merged(told, np.concatenate([places[None], seen]))
    # Radii between are halved where the curve may have crossed.
    for _ in range(_HALVINGS):
        lines = _with_lines(told, step)
        doubtful = distinct(
            np.concatenate([np.zeros(0, dtype=np.intp), *(_doubtful(lines, level) for level in levels)])
        )
        if not doubtful.size:
            break
        told = _merged(told, np.concatenate([lines[:1, doubtful], closely(lines[0, doubtful])]))
    return told


def _merged(told: Floats, looked: Floats) -> Floats:
    """A curve with radii known better, new ones among them, on whose way a kink may be that was on the way past."""
    place = np.searchsorted(told[0], looked[0], side="right")
    more = np.concatenate([looked, told[3:, np.maximum(place - 1, 0)]])
    # Of one radius what comes first counts.
    first = np.unique(np.append(looked[0], told[0]), return_index=True)[1]
    return np.concatenate([more, told], axis=1)[:, first]


def _fall(curve: Floats, level: float, step: float) -> float | None:
    """Where a curve first falls below a level; None if it does not, or between radii that are farther than a step."""
    radius = first_below(curve[0], curve[1], level)
    place = 0 if radius is None else int(np.searchsorted(curve[0], radius))
    return radius if place and curve[0, place] - curve[0, place - 1] < 1.01 * step else None


def _doubtful(told: Floats, level: float) -> Indices:
    """Radii at which means of dots alone leave open whether a curve has fallen, those next to its fall."""
    _, mean, error = told
    fallen = np.flatnonzero(mean + error < level)
    doubtful = np.flatnonzero((abs(mean - level) < error) & (error > _KNOWN))
    first = int(np.argmax(mean < level))
    doubtful = doubtful[doubtful < (fallen[0] if fallen.size else mean.size)]
    return np.asarray(doubtful[np.argsort(abs(doubtful - first), kind="stable")[:_MOST_DOUBTFUL]])


@dataclass(frozen=True, eq=False)
class _Closely:
    """The mean over four times as many directions; what means of dots lack is known in some of them.

    Attributes:
        lacking: radii that were looked at, what the mean lacks there, the error of that, and how much of it is new a
            dot farther, [4] each.
    """

    view: _View
    lacking: list[Floats]

    def __call__(self, radii: Floats) -> Floats:
        """The mean at radii [n], and its error, [2, n]."""
        view, table = self.view, self.view.table
        count = 4 * _directions(view, view.scale_um2 * float(radii.max()))
        angle = np.pi * np.arange(count) / count
        x, y = np.outer(radii, np.cos(angle)), np.outer(radii, np.sin(angle))
        values, errors = view.coarse(x, y)
        mean, half, quarter = (values[:, ::every].mean(axis=1) for every in (1, 2, 4))
        # Each of these errs by a quarter of the one before, or less; either difference may be small by chance.
        quadrature = np.maximum(abs(mean - half), abs(half - quarter) / 2)
        coarse = np.stack([mean, quadrature + errors.mean(axis=1)])
        if not table.rims:
            return coarse
        dot = table.x.dot_um / view.scale_um2
        most = _EXACT_DIRECTIONS if table.affords(_EXACT_DIRECTIONS * _EXACT_DIRECTIONS) else _FEW_EXACT
        seen = np.array([place[0] for place in self.lacking])
        far = abs(radii[:, None] - seen).min(axis=1, initial=np.inf) > _ALIKE * dot
        near = radii * view.scale_um2 < table.near_um
        # Near lag 0 cut dots meet themselves: exact lags are dear there, and alike.
        for new, directions in ((far & near, max(most // 2, _FEW_EXACT)), (far & ~near, most)):
            if new.any() and table.affords(directions * (len(self.lacking) + int(new.sum())) // _NEAR_SHARE):
                every = max(1, count // directions)
                self._look(radii[new], x[new, ::every], y[new, ::every], values[new, ::every])
        if not self.lacking:
            return coarse
        lacking = np.array(self.lacking).T
        aside = abs(radii[:, None] - lacking[0])
        nearest = aside.argmin(axis=1)
        _, change, error, new = lacking[:, nearest]
        known = np.stack([mean + change, quadrature + error + 2 * new * aside.min(axis=1) / dot])
        return np.where(known[1] < coarse[1], known, coarse)

    def _look(self, radii: Floats, x: Floats, y: Floats, values: Floats) -> None:
        exact, unknown = (each.reshape(x.shape) for each in self.view.exact(x.ravel(), y.ravel()))
        changes = exact - values
        deviation = np.sqrt(((changes - np.roll(changes, 1, axis=1)) ** 2).mean(axis=1) / 2 / x.shape[1])
        new = abs(changes.mean(axis=1)) + _SIGMAS * changes.std(axis=1) / math.sqrt(x.shape[1])
        error = _SIGMAS * deviation + unknown.mean(axis=1)
        self.lacking.extend(np.stack([radii, changes.mean(axis=1), error, new], axis=1))


def worst_directions(mtf: Mtf, frequencies_cy_per_mm: Sequence[float], die: str | None) -> list[Quantity]:
    """The radial minimum at each frequency.

    Args:
        frequencies_cy_per_mm: on the sensor, at most half a cycle per pixel.

    Notes:
        Between two rings the minimum is interpolated; it may lie anywhere between theirs, so that the error holds both.
    """
    rings, least = mtf.frequency_cy_per_mm, mtf.cuts["radial_min"]
    directions = []
    for frequency in frequencies_cy_per_mm:
        value = float(np.interp(frequency, rings, least))
        after = int(np.clip(np.searchsorted(rings, frequency), 1, rings.size - 1))
        near = least[after - 1 : after + 1] if frequency < rings[after] else least[after : after + 1]
        directions.append(
            Quantity(
                f"mtf_worst_{frequency:g}",
                value,
                f"radial minimum of the presampled MTF at {frequency:g} cy/mm, between rings interpolated",
                uncertainty=mtf.uncertainty + float(np.abs(near - value).max()),
                die=die,
                wavelength_nm=mtf.wavelength_nm,
            )
        )
    return directions


PHASES = 16
"""Sub-pixel phases along each axis; 0 and half a pixel, where symmetric PSFs have their extremes, are among them."""


@dataclass(frozen=True, eq=False)
class AliasedMtf(Frozen):
    """The MTF of a PSF sampled once per pixel; aliased, unlike :class:`maskfab.base.model.Mtf`.

    Attributes:
        frequency_cy_per_mm: float64 [2, n], x and y component.
        values: float64 [phases y, phases x, n].
        phases: float64 [phases], offset of the PSF from the pixels' grid, in pixels.
        sampled: ``point`` values, or ``pixel`` means over full square pixels.
        uncertainty: bound on the absolute error of any value.
    """

    frequency_cy_per_mm: Floats
    values: Floats
    phases: Floats
    sampled: Literal["point", "pixel"]
    uncertainty: float

    @property
    def lowest(self) -> Floats:
        """Smallest value over all phases, [n]."""
        return np.asarray(self.values.min(axis=(0, 1)))

    @property
    def highest(self) -> Floats:
        """Largest value over all phases, [n]."""
        return np.asarray(self.values.max(axis=(0, 1)))


def aliased_mtf(
    table: LagTable,
    camera: Camera,
    spectrum: Spectrum,
    nu_x: Floats,
    nu_y: Floats,
    *,
    sampled: Literal["point", "pixel"] = "pixel",
    phases: int = PHASES,
) -> AliasedMtf:
    """The aliased MTF at every sub-pixel phase.

    Args:
        table: lags up to the stop's diameter; one of shorter reach does not hold the aliases.
        nu_x, nu_y: float64 [n], cycles per micrometre of sensor.
        sampled: whether the PSF is sampled at points or averaged over pixels first.
        phases: how many along each axis.

    Raises:
        JobError: MF104 if there is no phase, or if the samples of some phase sum to nothing.
    """
    if phases < 1:
        raise JobError("MF104", f"{phases} sub-pixel phases are too few", cure="Give 1 phase or more")
    wanted_x, wanted_y = np.append(nu_x, 0.0), np.append(nu_y, 0.0)
    orders_x, orders_y = (_orders(camera, spectrum, nu) for nu in (wanted_x, wanted_y))
    alias_x = wanted_x + orders_x[:, None] / camera.pixel_um
    alias_y = wanted_y + orders_y[:, None] / camera.pixel_um
    nu_xy = np.broadcast_arrays(alias_x, alias_y[:, None, :])
    values = _transfer(table, camera, spectrum, nu_xy[0], nu_xy[1], sampled)
    phase = np.arange(phases, dtype=np.float64) / phases
    turn_x, turn_y = (np.exp(2j * np.pi * phase[:, None] * orders) for orders in (orders_x, orders_y))
    sums = abs(np.einsum("al,bk,lkn->abn", turn_y, turn_x, values, optimize=True))
    total = sums[..., -1:]
    aliases = orders_x.size * orders_y.size
    if total.min() <= aliases * max(table.coarse_uncertainty, 1e-12):
        what = f"samples {camera.pixel_um:g} um apart can sum to nothing, so their MTF has no scale"
        raise JobError("MF104", what, cure="Average over pixels, or sample finer")
    uncertainty = 2 * aliases * table.coarse_uncertainty / float(total.min())
    frequency = UM_PER_MM * np.stack([np.asarray(nu_x), np.asarray(nu_y)])
    return AliasedMtf(frequency, sums[..., :-1] / total, phase, sampled, uncertainty)


def phase_spread(aliased: AliasedMtf, presampled: Floats, die: str | None = None) -> Quantity:
    """Largest distance, over frequencies and phases, of the aliased MTF from the presampled one.

    Args:
        presampled: float64 [n], the MTF with the same pixel but before sampling, at the same frequencies.
    """
    distance = abs(aliased.values - presampled).max()
    return Quantity(
        "mtf_aliasing",
        float(distance),
        f"largest distance of the aliased MTF ({aliased.sampled} samples) from the presampled one over "
        f"{aliased.phases.size} x {aliased.phases.size} sub-pixel phases and the frequencies of the cut",
        uncertainty=aliased.uncertainty,
        die=die,
    )


def cy_per_pixel(frequency_cy_per_mm: Floats, pixel_um: float) -> Floats:
    """Cycles per pixel of a frequency on the sensor."""
    return np.asarray(frequency_cy_per_mm * pixel_um * 1e-3)


def _orders(camera: Camera, spectrum: Spectrum, nu: Floats) -> Floats:
    """Every k for which ν + k/p may lie below the cutoff."""
    highest = cutoff(camera, float(spectrum.wavelengths_nm.min()))
    last = math.ceil((highest + abs(nu).max()) * camera.pixel_um)
    return np.arange(-last, last + 1, dtype=np.float64)


def _transfer(
    table: LagTable, camera: Camera, spectrum: Spectrum, nu_x: Floats, nu_y: Floats, sampled: Literal["point", "pixel"]
) -> Floats:
    """Transfer function before sampling, zero beyond the cutoff along either axis."""
    highest = cutoff(camera, float(spectrum.wavelengths_nm.min()))
    within = (abs(nu_x) < highest) & (abs(nu_y) < highest)
    values = np.zeros(nu_x.shape)
    kept_x, kept_y = nu_x[within], nu_y[within]
    total = np.zeros(kept_x.shape)
    for wavelength, weight in zip(spectrum.wavelengths_nm, spectrum.weights, strict=True):
        highest = cutoff(camera, float(wavelength))
        seen = (abs(kept_x) < highest) & (abs(kept_y) < highest)
        line = Spectrum(np.array([wavelength]), np.ones(1), spectrum.name)
        total[seen] += weight * polychromatic_otf(table, camera, line, kept_x[seen], kept_y[seen])
    values[within] = total
    return values * pixel_transfer(camera, nu_x, nu_y) if sampled == "pixel" else values


_FEWEST_NODES = 5
_QUADRATURE_ERROR = 1e-8
EDGE_UM = 30.0
"""Fringes are looked for so far from an edge; farther off there is less light than lags are known to."""


@dataclass(frozen=True, eq=False)
class EdgeSpread(Frozen):
    """The image of a step from 0 to 1 along x, then along y, where pixels meet.

    Attributes:
        values: float64 [2, n], n even, the step between the middle two.
        error: float64 [n], bound of the error of each.
        outside: share of the light of which it is not known where it falls.
    """

    values: Floats
    error: Floats
    outside: float
    wavelength_nm: float


def edge_spread(lags: tuple[AxisLags, AxisLags], table: LagTable, camera: Camera, wavelength_nm: float) -> EdgeSpread:
    """The image of an edge in the camera's window, as far as ``EDGE_UM`` from it, from lags, whatever falls outside.

    Args:
        table: of the pupil of the lags; gives energy and error bound.

    Notes:
        An error of the OTF by ε(ν) moves the image at x by ∫ ε |sin 2πνx| / (πν) dν at most.
    """
    scale, half_pixel = image_scale_um2(camera, wavelength_nm), camera.pixel_um / 2
    pixels = odd_samples(min(camera.window_um, 2 * EDGE_UM), camera.pixel_um)
    highest = cutoff(camera, wavelength_nm)
    nodes, weights = gauss_legendre(_FEWEST_NODES + math.ceil(1.5 * np.pi * highest * half_pixel))
    # From the axis on, in steps of half a pixel: pixels meet at every other one.
    starts, within = half_pixel * np.arange(pixels, dtype=np.float64), half_pixel * (1 + nodes) / 2
    sides = []
    for axis in lags:
        line = axis.transform(starts / scale, within / scale) / (scale * table.energy_um2)
        sides.append(np.cumsum(line @ weights * (half_pixel / 2))[::2])
    meet = half_pixel + starts[::2]
    error = np.max([_edge_error(axis, table, scale, highest, meet) for axis in lags], axis=0) + _QUADRATURE_ERROR
    side = np.array(sides)
    return EdgeSpread(
        0.5 + np.concatenate([-side[..., ::-1], side], axis=-1),
        np.concatenate([error[..., ::-1], error], axis=-1),
        0.0,
        wavelength_nm,
    )


def _edge_error(axis: AxisLags, table: LagTable, scale_um2: float, highest: float, places_um: Floats) -> Floats:
    """Bound at places [n] of ∫ ε |sin 2πνx| / (πν) dν, ε constant from step to step of the lag.

    A sine is below its argument; and over a step 1/ν is below its first value, and the sine's integral is known.
    """
    ends = np.minimum(axis.step_um / scale_um2 * np.arange(axis.bounds.size + 1), highest)
    error = axis.error_at(scale_um2 * (ends[1:] + ends[:-1]) / 2, table)
    turn = 2 * np.pi * places_um[:, None] * ends
    waves = np.diff(2 * np.floor(turn / np.pi) + 1 - np.cos(turn % np.pi), axis=1)
    most = np.diff(turn, axis=1) / np.pi
    most[:, 1:] = np.minimum(most[:, 1:], waves[:, 1:] / turn[:, 1:-1] * 2 / (2 * np.pi))
    return np.asarray(most @ error)


def edge_in_window(pixels: Psf) -> EdgeSpread:
    """Edge spread from pixel means in a window; half of what lies outside is taken to fall on either side."""
    outside = max(0.0, 1 - pixels.energy_in_window)
    sides = []
    for along in (0, 1):
        share = np.cumsum(pixels.values.sum(axis=along)) * pixels.step_um**2
        sides.append(np.concatenate([[0.0], share]) + (1 - share[-1]) / 2)
    values = np.array(sides)
    return EdgeSpread(values, np.full(values.shape[1], outside / 2), outside, pixels.wavelength_nm)


def edge_colour_difference(red: EdgeSpread, green: EdgeSpread, blue: EdgeSpread, die: str | None = None) -> Quantity:
    """Largest ΔE (CIE 1976) along a black and white edge imaged in three colours, against the same edge in grey.

    The edge is imaged along x and along y, white being (1, 1, 1) in linear sRGB; the grey edge has the mean of the
    three as all its channels.
    """
    edges = (red, green, blue)
    if len({edge.values.shape for edge in edges}) > 1:
        raise InternalError("MF901", "edges on different grids were compared")
    channels = np.stack([edge.values for edge in edges], axis=-1)
    errors = np.stack([edge.error for edge in edges], axis=-1)
    largest = float(_colour(channels).max())
    # Each colour may be off either way at each place, and the largest difference lie elsewhere.
    moved = np.stack([_colour(channels + errors * signs) for signs in product((-1, 1), repeat=3)])
    least, most = float(moved.min(axis=0).max()), float(moved.max())
    outside = max(edge.outside for edge in edges)
    extent = (
        f"up to {outside:.2g} of a colour's light lies outside the window, and the error bar is what it could change"
        if outside
        else "from the lags, all light included"
    )
    return Quantity(
        "edge_colour_difference",
        largest,
        "largest CIE 1976 colour difference of a black and white edge, along x or y, in linear sRGB under D65, from "
        f"the same edge in grey; {extent}",
        uncertainty=max(most - largest, largest - least),
        die=die,
    )


def _colour(channels: Floats) -> Floats:
    grey = np.repeat(channels.mean(axis=-1, keepdims=True), 3, axis=-1)
    return delta_e_1976(lab_of_linear_srgb(channels), lab_of_linear_srgb(grey))
