r"""Bands of a die's numbers over the displays that are made, from a few full cases.

A number f of the written die is expanded about the process stated, in standard deviations x of the bias and y of the
corner radius,

    f = f0 + a x + c x² + b y + d y²,

from full cases at two deviations either way, where the edges of a band are; where a radius cannot be less by two, from
rounder ones by one and by two. Its band lies between the quantiles of 2.5 and 97.5 % of the expansion over two
independent normal distributions, a radius below zero counting as zero. The PSF is expanded in the same way, point by
point, and the change of its shape is the distance that the expansion goes; its band is the quantile of 95 %.

A full case wider and rounder, as far from the process stated as the edges are, tells the error: what the expansion
misses of it are products of x and y and higher powers.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import partial

import numpy as np
from numpy.typing import NDArray
from scipy.special import ndtri

from maskfab.geometry.writer_model import Reading, check_process
from maskfab.measurement.as_written import Written, WrittenOptics, fused_optics
from maskfab.model import Camera, Panel, Process, Quantity
from maskfab.optics.image.mtf import area_under_radial_min, frequency_at

Floats = NDArray[np.float64]

SHARE = 0.95
"""Of the displays, within a band."""
_STEPS = 201
_CASES = 5
_SIDES = (-2.0, 2.0)
_CORNER = (math.sqrt(2), math.sqrt(2))
"""Deviations of bias and radius, together as far off as an edge."""


@dataclass(frozen=True)
class ProcessSpread:
    """Standard deviations over the displays that are made.

    Attributes:
        bias_um: of the width of clear features.
        radius_um: of the corner radius.
    """

    bias_um: float = 0.0
    radius_um: float = 0.0


@dataclass(frozen=True)
class Band:
    """The band of one number.

    Attributes:
        name: of the band.
        wavelength_nm: that it holds for; None for all.
        nominal: number of the process as stated; 0 for a change.
        low, high: edges.
        error: of either edge.
        by_bias, by_radius: change of the number by one standard deviation of each, to first order.
    """

    name: str
    wavelength_nm: float | None
    nominal: float
    low: float
    high: float
    error: float
    by_bias: float
    by_radius: float


@dataclass(frozen=True, eq=False)
class _Cases:
    """Full cases about the nominal one.

    Attributes:
        nominal: as stated.
        bias: narrower and wider, by :data:`_SIDES`; the nominal one twice without a spread.
        radius: sharper and rounder likewise, or rounder twice.
        sides: their deviations.
        corner: wider and rounder.
        least_radius: deviations from the nominal radius to zero, negative.
    """

    nominal: WrittenOptics
    bias: tuple[WrittenOptics, WrittenOptics]
    radius: tuple[WrittenOptics, WrittenOptics]
    sides: tuple[float, float]
    corner: WrittenOptics
    least_radius: float

    def terms(self, number: Callable[[WrittenOptics], Floats]) -> tuple[Floats, Floats, Floats, Floats]:
        """a, c, b and d of a number, or of an array of them."""
        f0 = number(self.nominal)
        bias = _parabola(_SIDES, *(number(each) - f0 for each in self.bias))
        return (*bias, *_parabola(self.sides, *(number(each) - f0 for each in self.radius)))


def _parabola(places: tuple[float, float], near: Floats, far: Floats) -> tuple[Floats, Floats]:
    """Linear and square term of the parabola through 0 at 0 and through two values at two places."""
    p, q = places
    square = (near / p - far / q) / (p - q)
    return near / p - square * p, square


def band_quantities(written: Written, camera: Camera, spread: ProcessSpread, where: str = "") -> tuple[Quantity, ...]:
    """The bands of a written die's numbers, as rows of a report; none without a spread.

    Args:
        written: the die as the process makes it.
        camera: what looks through it.
        spread: of the process.
        where: the job's key, for errors.

    Raises:
        JobError: MF104, MF127 for a spread that dots or gutters do not bear.
    """
    return tuple(_row(band, written, spread) for band in bands(written, camera, spread, where))


def bands(written: Written, camera: Camera, spread: ProcessSpread, where: str = "") -> tuple[Band, ...]:
    """The bands of a written die's numbers, for kissing corners fused; arguments and errors as above."""
    if not (spread.bias_um or spread.radius_um):
        return ()
    cases = _cases(written, camera, spread, where)
    x, y = _deviations(spread, cases.least_radius)
    found = [_band("band_open_ratio", None, cases, _open_ratio, x, y)]
    for i, line in enumerate(camera.wavelengths_nm):
        found.append(_band("band_auc_radial_min", line, cases, partial(_auc, i), x, y))
        if all(frequency_at(each.mtfs[i], 0.5) for each in (cases.nominal, *cases.bias, *cases.radius, cases.corner)):
            found.append(_band("band_mtf50", line, cases, partial(_mtf50, i), x, y))
    return (*found, _shape_band(cases, x, y))


def check_spread(process: Process, spread: ProcessSpread, panel: Panel, where: str = "") -> None:
    """Refuse a spread of which some case cannot be written on a panel's dots.

    Raises:
        JobError: MF104, MF127.
    """
    for x, y in ((-2, 0), (2, 0), (0, 2), _CORNER):
        check_process(_moved(process, spread, x, y), panel, f"{where}, with process.spread")


def _sides(process: Process, spread: ProcessSpread) -> tuple[float, float]:
    """Deviations of the radius in full cases: to either side, or rounder alone where it cannot be less by as much."""
    return (1.0, 2.0) if process.corner_radius_um < 2 * spread.radius_um else _SIDES


def _moved(process: Process, spread: ProcessSpread, x: float, y: float) -> Process:
    """The process so many deviations of bias and radius off."""
    return replace(
        process,
        corner_radius_um=process.corner_radius_um + y * spread.radius_um,
        cd_bias_um=process.cd_bias_um + x * spread.bias_um,
    )


def _open_ratio(optics: WrittenOptics) -> Floats:
    return np.array(optics.open_ratio)


def _auc(line: int, optics: WrittenOptics) -> Floats:
    return np.array(area_under_radial_min(optics.mtfs[line]))


def _mtf50(line: int, optics: WrittenOptics) -> Floats:
    found = frequency_at(optics.mtfs[line], 0.5)
    assert found is not None
    return np.array(found[0])


def _cases(written: Written, camera: Camera, spread: ProcessSpread, where: str) -> _Cases:
    nominal, process = written.readings[Reading.FUSED], written.process

    def at(x: float, y: float) -> WrittenOptics:
        moved = _moved(process, spread, x, y)
        if moved == process:
            return nominal
        return fused_optics(written.die, camera, moved, nominal.psf, f"{where}: process.spread")

    sides = _sides(process, spread)
    least = -process.corner_radius_um / spread.radius_um if spread.radius_um else 0.0
    near, far = (at(0, side) for side in sides)
    narrow, wide = (at(side, 0) for side in _SIDES)
    return _Cases(nominal, (narrow, wide), (near, far), sides, at(*_CORNER), least)


def _deviations(spread: ProcessSpread, least_radius: float) -> tuple[Floats, Floats]:
    """Equally likely deviations of bias and radius, [n, n] of all pairs."""
    steps = ndtri((np.arange(_STEPS) + 0.5) / _STEPS)
    none = np.zeros(1)
    x = steps if spread.bias_um else none
    y = np.maximum(steps, least_radius) if spread.radius_um else none
    across, down = np.meshgrid(x, y)
    return across, down


def _edges(values: Floats) -> tuple[float, float]:
    low, high = np.quantile(values, [(1 - SHARE) / 2, (1 + SHARE) / 2])
    return float(low), float(high)


def _band(
    name: str, line: float | None, cases: _Cases, number: Callable[[WrittenOptics], Floats], x: Floats, y: Floats
) -> Band:
    a, c, b, d = (float(term) for term in cases.terms(number))
    f0 = float(number(cases.nominal))
    low, high = _edges(f0 + a * x + c * x**2 + b * y + d * y**2)
    across, down = _CORNER
    missed = abs(float(number(cases.corner)) - (f0 + a * across + c * across**2 + b * down + d * down**2))
    return Band(name, line, f0, low, high, missed, a, b)


def _shape_band(cases: _Cases, x: Floats, y: Floats) -> Band:
    """The change of the PSF's shape: distances from lengths and angles of the expansion's four terms."""

    def to_peak(optics: WrittenOptics) -> Floats:
        return np.asarray(optics.psf.values / optics.psf.values.max())

    f0 = to_peak(cases.nominal)
    terms = cases.terms(to_peak)
    angles = np.array([[float(np.vdot(one, other)) for other in terms] for one in terms])
    size = float(np.linalg.norm(f0))
    share = np.stack([x, x**2, y, y**2]).reshape(4, -1)
    squares = np.einsum("ik,ij,jk->k", share, angles, share)
    high = float(np.quantile(np.sqrt(np.maximum(squares, 0)), SHARE)) / size
    across, down = _CORNER
    told = sum(term * by for term, by in zip(terms, (across, across**2, down, down**2), strict=True))
    missed = float(np.linalg.norm(to_peak(cases.corner) - f0 - told)) / size
    first = [math.sqrt(max(0.0, angles[k, k])) / size for k in (0, 2)]
    return Band("band_psf_shape", cases.nominal.psf.wavelength_nm, 0.0, 0.0, high, missed, *first)


def _row(band: Band, written: Written, spread: ProcessSpread) -> Quantity:
    said = ", ".join(
        f"{change:+.2g} by {deviation:g} um of {what}"
        for change, deviation, what in (
            (band.by_bias, spread.bias_um, "bias"),
            (band.by_radius, spread.radius_um, "corner radius"),
        )
        if deviation
    )
    between = f"from {band.low:.4g} to {band.high:.4g}" if band.name != "band_psf_shape" else f"up to {band.high:.2g}"
    return Quantity(
        band.name,
        band.high if band.name == "band_psf_shape" else (band.high - band.low) / 2,
        f"{SHARE:.0%} of displays lie {between}: expansion to second order from {_CASES} full cases about the process "
        f"stated, {said}; error: what it misses of a case wider and rounder",
        uncertainty=band.error,
        die=written.die.name,
        wavelength_nm=band.wavelength_nm,
    )
