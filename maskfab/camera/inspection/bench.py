"""The bench on which a die is captured: all that a job states of stop, light and lens and that may be otherwise.

Every value is one number with a name, 0 where the bench is as stated. A die off the axis meets another part of the
openings: its picture changes by what the stop's edge takes in and leaves out, while phases that go with its place show
in no intensity. So does a stop of another size. A barrel that vignettes is a second circle, which cuts the first to a
depth; it is bent as the stop is, or less. A light that is no point, and a line that is a band, smooth the picture by
their variance, along all directions alike or outwards; a disc and a bell, or a flat band and a bell, of equal variance
do so alike while they are small. Glass bends colours otherwise: focus and place change with the wavelength.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace

import numpy as np

from maskfab.base.arrays import Floats, Mask
from maskfab.base.model import Panel, orient
from maskfab.job.camera import Stop
from maskfab.optics.polynomials import bessel_1, gauss_legendre
from maskfab.optics.pupil import Aperture, Pupil, cut, panel_aperture
from maskfab.optics.spectrum import Spectrum

DIE_X, DIE_Y = "die_x_um", "die_y_um"
STOP = "stop_um"
CUT_X, CUT_Y, CUT_BEND = "cut_x_um", "cut_y_um", "cut_bend"
LIGHT_DISC, LIGHT_BELL = "light_disc_um2", "light_bell_um2"
BAND_FLAT, BAND_BELL = "band_flat_nm2", "band_bell_nm2"
AXIAL, AXIAL_BEND = "axial_waves", "axial_bend_waves"
LATERAL_X, LATERAL_Y = "lateral_x_um", "lateral_y_um"

PLACE, CUT, LATERAL = (DIE_X, DIE_Y), (CUT_X, CUT_Y, CUT_BEND), (LATERAL_X, LATERAL_Y)
LIGHTS, BANDS = (LIGHT_DISC, LIGHT_BELL), (BAND_FLAT, BAND_BELL)
OF_PUPIL = (*PLACE, STOP, *CUT)
FULL = {
    LIGHT_DISC: 4.0,
    LIGHT_BELL: math.sqrt(8 * math.log(2)),
    BAND_FLAT: math.sqrt(12.0),
    BAND_BELL: math.sqrt(8 * math.log(2)),
}
"""Full widths, of a bell at half its height, in standard deviations; values of these names are variances."""
STEPS = {
    **dict.fromkeys((*PLACE, STOP, *CUT[:2]), 0.1),
    CUT_BEND: 0.01,
    **dict.fromkeys(LIGHTS, 0.05),
    **dict.fromkeys(BANDS, 1.0),
    **dict.fromkeys((AXIAL, AXIAL_BEND), 0.001),
    **dict.fromkeys(LATERAL, 0.02),
}
"""By which each is moved for its slope; the stop's edge by far less than a dot."""
_STRAIGHT, _BENT = 0.05, 1.0
_LEAST_SHARE = 0.5
"""Of the stated stop, below which none is looked for."""
_MOST = 900.0
"""Largest variance of either kind: lights wider than the speckles' reach tell nothing, nor do bands of 100 nm."""
PER_NM = 0.01
"""Axial and lateral colour are told for each 100 nm from the camera's first line."""


@dataclass(frozen=True, eq=False)
class Opened:
    """A die behind its stop, and which of its dots are clear where the stop does not hide them, [ny, nx]."""

    pupil: Pupil
    clear: Mask


def within(name: str, value: float) -> float:
    """The nearest value that there can be."""
    if name == CUT_BEND:
        return min(_BENT, max(_STRAIGHT, value))
    return min(_MOST, max(0.0, value)) if name in FULL else value


def opened(panel: Panel, way_round: int, stop: Stop, bench: Mapping[str, float], orders: int) -> Opened:
    """The die as it lies before the stop, whose middle is the origin; cut dots with moments of so many orders."""
    right, up = bench.get(DIE_X, 0.0), bench.get(DIE_Y, 0.0)
    true = stop.scaled(*[max(_LEAST_SHARE, 1 + bench.get(STOP, 0.0) / stop.diameter_um)] * 2)
    openings = panel_aperture(panel, true.diameter_um / 2 + max(abs(right), abs(up)))
    x, y = (openings.x, openings.y) if way_round % 2 == 0 else (openings.y, openings.x)
    values, variance = (orient(each, way_round) for each in (openings.transmission, openings.variance))

    def moved(x_um: float, y_um: float) -> Aperture:
        there = replace(x, start_um=x.start_um + x_um), replace(y, start_um=y.start_um + y_um)
        return Aperture(*there, values, variance)

    pupil, depth = cut(moved(right, up), true, orders), math.hypot(bench.get(CUT_X, 0.0), bench.get(CUT_Y, 0.0))
    if depth:
        radius = true.diameter_um / 2
        wide = radius / bench.get(CUT_BEND, _BENT)
        off = (radius - depth - wide) / depth
        at_x, at_y = off * bench.get(CUT_X, 0.0), off * bench.get(CUT_Y, 0.0)
        pupil = _cut_again(pupil, cut(moved(right - at_x, up - at_y), Stop("circle", 2 * wide), orders))
    return Opened(pupil, np.asarray(values > 0))


def _cut_again(pupil: Pupil, other: Pupil) -> Pupil:
    """Dots as two stops leave them; those that both cut, a few, are dimmed by the other's share."""
    share = (other.whole > 0).astype(np.float64)
    share[other.rim_row, other.rim_column] = other.rim_moments[:, 0, 0] / other.rim_transmission
    fresh = pupil.whole[other.rim_row, other.rim_column] > 0
    row, column, transmission = (
        np.concatenate([own, more[fresh]])
        for own, more in (
            (pupil.rim_row, other.rim_row),
            (pupil.rim_column, other.rim_column),
            (pupil.rim_transmission, other.rim_transmission),
        )
    )
    own = pupil.rim_moments * share[pupil.rim_row, pupil.rim_column][:, None, None]
    moments = np.concatenate([own, other.rim_moments[fresh]])
    order = np.lexsort((column, row))
    whole = share == 1
    return replace(
        pupil,
        whole=np.where(whole, pupil.whole, 0.0),
        whole_variance=np.where(whole, pupil.whole_variance, 0.0),
        rim_row=row[order],
        rim_column=column[order],
        rim_moments=moments[order],
        rim_transmission=transmission[order],
    )


def edge_inside_um(panel: Panel, way_round: int, stop: Stop, bench: Mapping[str, float]) -> float:
    """Reach of the stop beyond the die's edge, as drawn; negative where it ends before."""
    openings = panel_aperture(panel)
    x, y = (openings.x, openings.y) if way_round % 2 == 0 else (openings.y, openings.x)
    radius = (stop.diameter_um + bench.get(STOP, 0.0)) / 2
    ends = [(axis.edges_um() + bench.get(name, 0.0))[[0, -1]] for axis, name in zip((x, y), PLACE, strict=True)]
    return max(radius + float(max(low, -high)) for low, high in ends)


def light_transfer(bench: Mapping[str, float]) -> Callable[[Floats], Floats] | None:
    """Share of a wave of so many cycles per micrometre of sensor that a light leaves; None of a point."""
    disc, bell = bench.get(LIGHT_DISC, 0.0), bench.get(LIGHT_BELL, 0.0)
    if disc:
        across = math.pi * FULL[LIGHT_DISC] * math.sqrt(disc)
        return lambda wave: np.where(wave > 0, 2 * bessel_1(across * wave) / np.maximum(across * wave, 1e-300), 1.0)
    return (lambda wave: np.asarray(np.exp(-2 * np.pi**2 * bell * wave**2))) if bell else None


def in_band(lines: Spectrum, bench: Mapping[str, float], most_apart_nm: float) -> Spectrum:
    """Lines of which each is a band, as lines that lie no farther apart than so in the mean."""
    name = next((each for each in BANDS if bench.get(each)), None)
    if name is None:
        return lines
    sigma = math.sqrt(bench[name])
    count = 2 + math.ceil(FULL[name] * sigma / most_apart_nm)
    if name == BAND_FLAT:
        nodes, weights = gauss_legendre(count)
        nodes = nodes * FULL[BAND_FLAT] / 2
    else:
        nodes, weights = np.polynomial.hermite_e.hermegauss(2 * count)
    every = lines.wavelengths_nm[:, None] + sigma * nodes
    shares = lines.weights[:, None] * weights / weights.sum()
    held = shares > 1e-6
    return Spectrum(every[held], shares[held] / shares[held].sum(), lines.name)
