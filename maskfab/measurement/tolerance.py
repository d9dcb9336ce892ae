"""Bands of a die's numbers over the displays that are made, from a few full cases.

A band lies between the quantiles of 2.5 and 97.5 % of the number's expansion over two independent normal
distributions, see :mod:`maskfab.measurement.process_spread`. The PSF is expanded in the same way, point by point, and
the change of its shape is the distance that the expansion goes; its band is the quantile of 95 %.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import partial

import numpy as np

from maskfab.base.arrays import Floats
from maskfab.geometry.writer_model import Reading
from maskfab.measurement.as_written import Written, WrittenOptics, fused_optics
from maskfab.measurement.process_spread import FULL_CASES, SHARE, Cases, Expansion, ProcessSpread, at_corner
from maskfab.model import Camera, Process, Quantity
from maskfab.optics.image.mtf import area_under_radial_min, frequency_at
from maskfab.optics.image.psf import pixel_margin, pixel_psf, point_step_um
from maskfab.optics.numbers import metrics
from maskfab.optics.numbers.worst_direction import worst_directions

BIAS_UM = 0.1
"""Of the bias, by which dies are ranked."""
_ROUNDING = 1e-12
HOW = (
    f"expansion to second order from {FULL_CASES} full cases about the process stated, kissing corners fused; error: "
    "what it misses of a case wider and rounder"
)


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

    @classmethod
    def of(cls, name: str, line: float | None, found: Expansion, process: Process, spread: ProcessSpread) -> Band:
        """Of a number that was expanded about a process."""
        low, high = found.edges(spread.deviations(process))
        return cls(name, line, found.nominal, low, high, found.error, found.terms[0], found.terms[2])

    def row(self, die: str, spread: ProcessSpread, how: str = HOW, level_db: float | None = None) -> Quantity:
        """As a row of a report; of a change the band begins at 0, and its value is the upper edge."""
        change = self.low == self.nominal == 0
        said = ", ".join(
            f"{each:+.2g} by {deviation:g} um of {what}"
            for each, deviation, what in (
                (self.by_bias, spread.bias_um, "bias"),
                (self.by_radius, spread.radius_um, "corner radius"),
            )
            if deviation
        )
        between = f"up to {self.high:.2g}" if change else f"from {self.low:.5g} to {self.high:.5g}"
        return Quantity(
            self.name,
            self.high if change else (self.high - self.low) / 2,
            f"{SHARE:.0%} of displays lie {between}, {said}: {how}",
            uncertainty=self.error,
            die=die,
            wavelength_nm=self.wavelength_nm,
            level_db=level_db,
            between=(self.low, self.high),
        )


def sensitivity(name: str, band: Band, die: str, spread: ProcessSpread, level_db: float | None = None) -> Quantity:
    """The change of a band's number by a tenth of a micrometre of bias, as a row of a report."""
    return Quantity(
        name,
        band.by_bias * BIAS_UM / spread.bias_um,
        f"first order in the bias, from full cases two deviations of {spread.bias_um:g} um narrower and wider",
        uncertainty=band.error * BIAS_UM / spread.bias_um,
        die=die,
        wavelength_nm=band.wavelength_nm,
        level_db=level_db,
    )


def band_quantities(
    written: Written, camera: Camera, spread: ProcessSpread, frequencies: Sequence[float] = (), where: str = ""
) -> tuple[Quantity, ...]:
    """The bands of a written die's numbers and the sensitivity of its PSF, as rows of a report; none without a spread.

    Args:
        written: the die as the process makes it.
        camera: what looks through it.
        spread: of the process.
        frequencies: at which the MTF in its worst direction is told, cycles per millimetre of sensor.
        where: the job's key, for errors.

    Raises:
        JobError: MF104, MF127 for a spread that dots or gutters do not bear.
    """
    name, found = written.die.name, bands(written, camera, spread, frequencies, where)
    rows = [band.row(name, spread) for band in found]
    if found and spread.bias_um:
        rows.append(sensitivity("sensitivity_psf_shape", found[-1], name, spread))
    return tuple(rows)


def bands(
    written: Written, camera: Camera, spread: ProcessSpread, frequencies: Sequence[float] = (), where: str = ""
) -> tuple[Band, ...]:
    """The bands of a written die's numbers, that of the PSF's shape last, for kissing corners fused; arguments and
    errors as above."""
    if not spread:
        return ()
    process, nominal = written.process, written.readings[Reading.FUSED]

    def made(moved: Process) -> WrittenOptics:
        return fused_optics(written.die, camera, moved, nominal.psf, f"{where}: process.spread")

    cases = Cases.about(process, spread, made, nominal)

    def band(name: str, line: float | None, number: Callable[[WrittenOptics], Floats]) -> Band:
        return Band.of(name, line, cases.expansion(number), process, spread)

    found = [band("band_stop_open_ratio", None, _open_ratio)]
    for i, line in enumerate(camera.wavelengths_nm):
        found.append(band("band_auc_radial_min", line, partial(_auc, i)))
        if all(frequency_at(each.mtfs[i], 0.5) for each in (nominal, *cases.bias, *cases.radius, cases.corner)):
            found.append(band("band_mtf50", line, partial(_mtf50, i)))
        found += [band(f"band_mtf_worst_{each:g}", line, partial(_worst, i, each)) for each in frequencies]
    pixels = _inner(camera)
    if pixels is not None:
        found.append(band("band_halo_energy", nominal.psf.wavelength_nm, partial(_halo, pixels)))
    return (*found, _shape_band(cases, spread.deviations(process)))


def _open_ratio(optics: WrittenOptics) -> Floats:
    return np.array(optics.open_ratio)


def _auc(line: int, optics: WrittenOptics) -> Floats:
    return np.array(area_under_radial_min(optics.mtfs[line]))


def _mtf50(line: int, optics: WrittenOptics) -> Floats:
    found = frequency_at(optics.mtfs[line], 0.5)
    assert found is not None
    return np.array(found[0])


def _worst(line: int, frequency: float, optics: WrittenOptics) -> Floats:
    (found,) = worst_directions(optics.mtfs[line], (frequency,), None)
    # Where a direction is lost altogether, what is left of it is rounding.
    return np.array(float(found) if float(found) > _ROUNDING else 0.0)


def _halo(camera: Camera, optics: WrittenOptics) -> Floats:
    return np.array(float(metrics.halo_of(pixel_psf(optics.psf, camera), camera, None)))


def _inner(camera: Camera) -> Camera | None:
    """The camera with a window smaller by the points that means over pixels need; None where it holds no halo."""
    window = camera.window_um - 2 * (pixel_margin(camera) * point_step_um(camera) + camera.pixel_um)
    return replace(camera, window_um=window) if metrics.holds_halo(window) else None


def _shape_band(cases: Cases[WrittenOptics], deviations: tuple[Floats, Floats]) -> Band:
    """The change of the PSF's shape: distances from lengths and angles of the expansion's four terms."""

    def to_peak(optics: WrittenOptics) -> Floats:
        return np.asarray(optics.psf.values / optics.psf.values.max())

    f0, (x, y) = to_peak(cases.nominal), deviations
    terms = cases.terms(to_peak)
    angles = np.array([[float(np.vdot(one, other)) for other in terms] for one in terms])
    size = float(np.linalg.norm(f0))
    share = np.stack([x, x**2, y, y**2]).reshape(4, -1)
    squares = np.einsum("ik,ij,jk->k", share, angles, share)
    high = float(np.quantile(np.sqrt(np.maximum(squares, 0)), SHARE)) / size
    missed = float(np.linalg.norm(to_peak(cases.corner) - f0 - at_corner(terms))) / size
    first = [math.sqrt(max(0.0, angles[k, k])) / size for k in (0, 2)]
    return Band("band_psf_shape", cases.nominal.psf.wavelength_nm, 0.0, 0.0, high, missed, *first)
