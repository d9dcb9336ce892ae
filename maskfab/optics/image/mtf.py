"""Cuts and radial statistics of the presampled MTF: optics x sensor pixel, before any sampling can alias it."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache

import numpy as np
from numpy.typing import NDArray

from maskfab.base.arrays import Floats, Indices
from maskfab.model import Camera, Mtf, RadialMean, frozen
from maskfab.optics.image.lag_table import LagTable
from maskfab.optics.image.psf import image_scale_um2
from maskfab.units import UM_PER_MM

RINGS = 147
"""Radii from 0 to half a cycle per pixel; as many as the published curves have at 470 nm."""

LEVELS = (50, 30, 10)
"""Modulations in per cent about whose first crossing the radial mean is told on exact radii."""

# How many lags of a ring are made exact at first, and pairs of lags and cut dots after which no more are.
_FIRST_OF_RING, _MOST_PAIRS = 1, 200_000

# Rings to either side of a crossing, radii in each, and directions for each dot of a half circle of lags.
_RINGS_ABOUT, _RADII_PER_RING, _DIRECTIONS_PER_DOT = 2, 3, 2
_FEWEST_DIRECTIONS, _FEW_DIRECTIONS, _MOST_DIRECTIONS = 16, 64, 1024


def presampled_mtf(table: LagTable, camera: Camera, wavelength_nm: float, levels: Sequence[float] = LEVELS) -> Mtf:
    """MTF from 0 to half a cycle per pixel along four directions, and its radial mean, minimum and maximum.

    Radial statistics are taken over rings one sample wide of a square grid of frequencies, the corners left out. The
    pixel is a full square, so its transfer is sinc(ν_x p) sinc(ν_y p). About its first crossings of the ``levels``, in
    per cent, the radial mean is told on exact radii.
    """
    view = _View(table, camera, wavelength_nm)
    step = 0.5 / camera.pixel_um / (RINGS - 1)
    axis = step * np.arange(RINGS, dtype=np.float64)
    rings = _rings(view, step)
    slant = axis / np.sqrt(2)
    slanted, slanted_errors = view.bounded(np.concatenate([slant, -slant]), np.concatenate([slant, slant]))
    diagonal, antidiagonal = slanted.reshape(2, RINGS)
    cuts = {
        "horizontal": rings.horizontal,
        "vertical": rings.vertical,
        "diagonal": diagonal,
        "antidiagonal": antidiagonal,
        "radial_mean": rings.mean,
        "radial_min": rings.low,
        "radial_max": rings.high,
    }
    uncertainty = max(float(slanted_errors.max()), float(rings.error.max()))
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
    found = first_below(mean.frequency_cy_per_mm, mean.modulation, level)
    if found is None:
        return None
    least, most = (
        first_below(mean.frequency_cy_per_mm, mean.modulation + sign * mean.error, level) for sign in (-1, 1)
    )
    last = float(mtf.frequency_cy_per_mm[-1])
    return found, max(found - (found if least is None else least), (last if most is None else most) - found)


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

    def exact(self, nu_x: Floats, nu_y: Floats) -> Floats:
        optics = abs(self.table.otf(self.scale_um2 * nu_x, self.scale_um2 * nu_y))
        return np.asarray(optics * self.pixel(nu_x, nu_y))

    def bounded(self, nu_x: Floats, nu_y: Floats) -> tuple[Floats, Floats]:
        """Modulation, and an error bar for each."""
        optics, error = self.table.bounded_otf(self.scale_um2 * nu_x, self.scale_um2 * nu_y)
        pixel = self.pixel(nu_x, nu_y)
        return abs(optics) * pixel, error * pixel

    def bounded_on_grid(self, step: float, steps_x: Indices, steps_y: Indices) -> tuple[Floats, Floats]:
        """The bounded MTF at so many steps of frequency, fewer than RINGS of them, and not downwards."""
        axis = step * np.arange(1 - RINGS, RINGS, dtype=np.float64)
        column, row = steps_x + RINGS - 1, steps_y + RINGS - 1
        lag, pixel = self.scale_um2 * axis, np.sinc(axis * self.camera.pixel_um)
        coarse = self.table.coarse_grid(lag, lag[RINGS - 1 :])[steps_y, column]
        optics, error = self.table.bounded_otf(lag[column], lag[row], coarse)
        along = pixel[column] * pixel[row]
        return abs(optics) * along, error * along


@dataclass(frozen=True, eq=False)
class _Rings:
    """Mean, least and greatest modulation of every ring; bounds of the errors of all, and of the least; along axes."""

    mean: Floats
    low: Floats
    high: Floats
    error: Floats
    low_error: Floats
    horizontal: Floats
    vertical: Floats


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
    sure, low = _refined_minima(view, nu_x, nu_y, values, errors, starts)
    # Where too many lags are alike some stay coarse, and one of them may be less.
    floor = np.minimum.reduceat(np.where(sure, np.inf, np.maximum(values - errors, 0)), starts)
    of_sure = np.maximum.reduceat(np.where(sure, errors, 0.0), starts)
    return _Rings(
        np.add.reduceat(values, starts) / count,
        low,
        np.maximum.reduceat(values, starts),
        np.maximum.reduceat(errors, starts),
        np.maximum(low - floor, of_sure),
        values[steps_y == 0],
        values[steps_x == 0],
    )


def _refined_minima(
    view: _View, nu_x: Floats, nu_y: Floats, values: Floats, errors: Floats, starts: Indices
) -> tuple[NDArray[np.bool_], Floats]:
    """Make exact, in place, what may be less than a ring's least exact value, some of every ring at a time.

    Returns:
        Which values are exact, and the least of them in every ring.
    """
    table = view.table
    ring = np.repeat(np.arange(RINGS), np.diff(np.append(starts, values.size)))
    sure = errors <= table.uncertainty
    low = np.minimum.reduceat(np.where(sure, values, np.inf), starts)
    spent, at_a_time = 0, _FIRST_OF_RING
    while table.rims and spent < _MOST_PAIRS:
        k = np.flatnonzero(~sure & (np.maximum(values - errors, 0.0) < low[ring] - table.uncertainty))
        k = k[_least(ring[k], values[k], at_a_time)]
        if not k.size:
            break
        values[k], errors[k], sure[k] = view.exact(nu_x[k], nu_y[k]), table.uncertainty, True
        low = np.minimum.reduceat(np.where(sure, values, np.inf), starts)
        spent, at_a_time = spent + k.size * table.cut_dots, 4 * at_a_time
    return sure, low


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
    found = []
    for level in levels:
        may, must = (np.flatnonzero(rings.mean + sign * rings.error < level / 100) for sign in (-1, 1))
        first = int(may[0]) if may.size else RINGS
        last = int(must[0]) if must.size else first
        about = np.zeros(RINGS, dtype=np.bool_)
        about[max(0, first - _RINGS_ABOUT) : last + _RINGS_ABOUT] = True
        # What is told for a higher level is told.
        rings_of_level = np.flatnonzero(about & ~chosen)
        chosen |= about
        if rings_of_level.size:
            found.append(_directional_mean(view, step, rings_of_level))
    if not found:
        found.append(_directional_mean(view, step, np.zeros(1, dtype=np.intp)))
    frequency, mean, error = np.concatenate(found, axis=1)
    return RadialMean(UM_PER_MM * frequency, mean, error)


def _directional_mean(view: _View, step: float, rings: Indices) -> Floats:
    """Radii from rings to the next ones, the mean over directions at each, and its error, [3, n]."""
    lag = view.scale_um2 * step * float(rings[-1] + 1)
    wanted = _DIRECTIONS_PER_DOT * math.pi * lag / view.table.x.dot_um
    count = 2 ** math.ceil(math.log2(min(max(wanted, _FEWEST_DIRECTIONS), _MOST_DIRECTIONS)))
    # The curve bends where lags are short, and there directions are few.
    parts = _RADII_PER_RING if count > _FEW_DIRECTIONS else 2 * _RADII_PER_RING
    places = (rings[:, None] + np.arange(parts) / parts).ravel()
    radii = step * places[places <= RINGS - 1]
    angle = np.pi * np.arange(count) / count
    values, errors = view.bounded(np.outer(radii, np.cos(angle)).ravel(), np.outer(radii, np.sin(angle)).ravel())
    values, errors = values.reshape(-1, count), errors.reshape(-1, count)
    # Every other direction errs by half of how far both halves are apart, and all of them by less.
    quadrature = abs(values[:, ::2].mean(axis=1) - values[:, 1::2].mean(axis=1)) / 2
    mean = values.mean(axis=1)
    # A straight line is off by no more than this where a curve is convex or has one kink.
    bend = abs(np.diff(mean, 2)) / 2
    bend = np.pad(bend, 1, mode="edge") if bend.size else np.zeros(mean.size)
    return np.stack([radii, mean, quadrature + errors.mean(axis=1) + bend])
