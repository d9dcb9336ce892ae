"""Light of many wavelengths: lines, bands, and the transfer function that they share.

A mask that only dims treats every wavelength alike but for scale, so the transfer function of a spectrum is

    OTF(ν) = Σ_k w_k C(λ_k f ν) / C(0),    Σ_k w_k = 1                      (Goodman, Fourier Optics, 6.3, by line)

with w_k the share of the detected energy at λ_k: one lag table serves all of them. A band is turned into lines by
Gauss quadrature with the band's own energy as its weight, in equal panels of what is lit, doubled until the transfer
function stands still: however narrow a line of the light, the weight has it exactly, and only C(λfν) is sampled.

Notes:
    C is piecewise bilinear, so along λ it has a kink wherever a lag λfν crosses a dot's edge: about one per
    dot / (f ν) of wavelength. High order buys nothing there; the error falls as the square of the number of lines.

**Rays** from the axis are where all wavelengths are one function. A mask that only dims has at the place p of the
sensor the intensity I(p / (λf)) / (λf)² for every wavelength, I the squared modulus of one field (Goodman, Fourier
Optics, 4.4.2 and 6.3). On the ray t -> (t, st) it is one even function of t, whose Fourier integral ends at the longest
lag of the pupil along the ray. So samples of I on rays, taken once, give any sum over wavelengths by one product: its
matrix interpolates I to all the p / (λf) and adds them up.

Both interpolations are polynomials through the nearest samples of an even grid. Their errors fall as the power of the
number of samples that a wave's phase from one to the next is of π.

Such rays say how many lines stand for a band in a point PSF, by the error of each number.

Notes:
    The PSF in a window is smooth in the wavelength, so the error of Gauss nodes falls fast once the speckle at the
    window's edge moves by less than its size from one line to the next; before, lines buy little.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from maskfab.base.arrays import Floats, Indices
from maskfab.base.errors import InternalError, JobError
from maskfab.base.model import frozen
from maskfab.base.units import UM_PER_NM
from maskfab.job.camera import Camera
from maskfab.optics.field.matrix import SampledField
from maskfab.optics.field.methods import FieldTask, admissible
from maskfab.optics.lags import LagTable
from maskfab.optics.polynomials import gauss_legendre, gauss_rules
from maskfab.optics.psf import cutoff, image_scale_um2
from maskfab.optics.pupil import Pupil

SHORTEST_NM, LONGEST_NM = 200.0, 2000.0

_NODES_PER_PANEL = 4
_MOST_PANELS = 1024


@dataclass(frozen=True, eq=False)
class Spectrum:
    """Lines, each with its share of the detected energy.

    Attributes:
        wavelengths_nm: float64 [k], 200 to 2000 nm.
        weights: float64 [k], not negative, summing to 1.

    Raises:
        JobError: MF112 for a wavelength out of range; MF104 if there is no line, if the arrays differ in length, or if
            weights are negative, not finite or do not sum to 1.
    """

    wavelengths_nm: Floats
    weights: Floats
    name: str

    def __post_init__(self) -> None:
        wavelengths = np.atleast_1d(np.asarray(self.wavelengths_nm, dtype=np.float64))
        weights = np.atleast_1d(np.asarray(self.weights, dtype=np.float64))
        check_wavelengths(wavelengths, self.name)
        if weights.shape != wavelengths.shape or weights.ndim != 1:
            what = f"{self.name} has {weights.size} weights for {wavelengths.size} wavelengths"
            raise JobError("MF104", what, cure="Give one weight for each wavelength")
        check_weights(weights, self.name)
        if abs(weights.sum() - 1) > 1e-9:
            what = f"the weights of {self.name} sum to {weights.sum():g}, not 1"
            raise JobError("MF104", what, cure="Divide the weights by their sum")
        object.__setattr__(self, "wavelengths_nm", frozen(wavelengths))
        object.__setattr__(self, "weights", frozen(weights))

    @property
    def centroid_nm(self) -> float:
        """Mean wavelength, each line weighted by its energy."""
        return float(self.weights @ self.wavelengths_nm)


@dataclass(frozen=True, eq=False)
class Curve:
    """A quantity over wavelength, linear between samples and zero outside them: a response, a filter, an illuminant.

    Attributes:
        wavelengths_nm: float64 [n >= 2], ascending, 200 to 2000 nm.
        values: float64 [n], not negative and not all zero.

    Raises:
        JobError: MF112 for a wavelength out of range, MF104 for anything else in that list.
    """

    wavelengths_nm: Floats
    values: Floats
    name: str

    def __post_init__(self) -> None:
        wavelengths = np.asarray(self.wavelengths_nm, dtype=np.float64)
        values = np.asarray(self.values, dtype=np.float64)
        check_wavelengths(wavelengths, self.name)
        if wavelengths.ndim != 1 or wavelengths.size < 2 or (np.diff(wavelengths) <= 0).any():
            what = f"the wavelengths of {self.name} are not an ascending list of two or more"
            raise JobError("MF104", what, cure="Sort them and leave each once")
        if values.shape != wavelengths.shape:
            what = f"{self.name} has {values.size} values for {wavelengths.size} wavelengths"
            raise JobError("MF104", what, cure="Give one value for each wavelength")
        check_weights(values, self.name)
        object.__setattr__(self, "wavelengths_nm", frozen(wavelengths))
        object.__setattr__(self, "values", frozen(values))

    def at(self, wavelengths_nm: Floats) -> Floats:
        """Value at any wavelengths."""
        return np.interp(wavelengths_nm, self.wavelengths_nm, self.values, left=0.0, right=0.0)


@dataclass(frozen=True, eq=False)
class Band:
    """A continuous spectrum: the product of curves where all of them are defined; MF104 if that is nowhere."""

    curves: tuple[Curve, ...]
    name: str

    def __post_init__(self) -> None:
        if not self._lit()[0].size:
            what = f"the band {self.name} holds no light: {' x '.join(c.name for c in self.curves)} do not overlap"
            raise JobError("MF104", what, cure="Combine curves that share wavelengths")

    @property
    def range_nm(self) -> tuple[float, float]:
        """The wavelengths that every curve covers."""
        low = max(float(c.wavelengths_nm[0]) for c in self.curves)
        return low, min(float(c.wavelengths_nm[-1]) for c in self.curves)

    def density(self, wavelengths_nm: Floats) -> Floats:
        """Detected energy per nanometre on a free scale."""
        product = np.ones_like(wavelengths_nm)
        for curve in self.curves:
            product = product * curve.at(wavelengths_nm)
        return product

    @property
    def centroid_nm(self) -> float:
        """Mean wavelength, weighted by energy."""
        return self.quadrature(1).centroid_nm

    def quadrature(self, panels: int) -> Spectrum:
        """Lines at the nodes of Gauss quadrature for the band's density, four in each of equal panels of what is lit.

        With one panel, every polynomial of degree 7 in the wavelength has the band's own mean over the lines.
        """
        low, high = self._lit()
        # Lit wavelengths end to end, so that a panel of light never is one of darkness.
        ends = np.cumsum(high - low)
        edges = np.unique(np.concatenate([[0.0], ends, ends[-1] * np.arange(1, panels) / panels]))
        middles = (edges[1:] + edges[:-1]) / 2
        skipped = (high - ends)[np.minimum(np.searchsorted(ends, middles), ends.size - 1)]
        # Exact for the density, of one degree for each curve, times the polynomials of the rules.
        nodes, weights = gauss_legendre(_NODES_PER_PANEL + (len(self.curves) + 1) // 2)
        half = np.diff(edges)[:, None] / 2
        places = (skipped + middles)[:, None] + half * nodes
        energies = half * weights * self.density(places)
        panel = np.minimum((middles * (panels / ends[-1])).astype(np.intp), panels - 1)
        starts = np.flatnonzero(np.diff(panel, prepend=-1)) * nodes.size
        lines, shares = gauss_rules(places.ravel(), energies.ravel(), starts, _NODES_PER_PANEL)
        return line_spectrum(lines.ravel(), shares.ravel(), self.name)

    def _lit(self) -> tuple[Floats, Floats]:
        """Ends of the intervals between the curves' samples on which there is light, [k] each."""
        low, high = self.range_nm
        knots = np.unique(np.concatenate([[low, high], *(curve.wavelengths_nm for curve in self.curves)]))
        knots = knots[(knots >= low) & (knots <= high)]
        # Straight and not negative, a curve that is dark amid an interval is dark all over it.
        lit = self.density((knots[1:] + knots[:-1]) / 2) > 0
        return knots[:-1][lit], knots[1:][lit]


def line_spectrum(
    wavelengths_nm: Floats | list[float], weights: Floats | list[float] | None = None, name: str = ""
) -> Spectrum:
    """A spectrum of lines, weights in any scale; equal energies if there are none."""
    places = np.atleast_1d(np.asarray(wavelengths_nm, dtype=np.float64))
    energies = np.ones_like(places) if weights is None else np.atleast_1d(np.asarray(weights, dtype=np.float64))
    label = name or " + ".join(f"{place:g} nm" for place in places[:4]) + (" ..." if places.size > 4 else "")
    check_weights(energies, label)
    return Spectrum(places, energies / energies.sum(), label)


def quadrature(
    band: Band, table: LagTable, camera: Camera, tolerance: float, nu_x: Floats, nu_y: Floats
) -> tuple[Spectrum, float]:
    """The fewest lines, in powers of two, whose transfer function is within a tolerance of the band's.

    Args:
        table: lags as far as :func:`reach_um` asks at the longest wavelength.
        tolerance: largest absolute change of the OTF that counts as none.
        nu_x, nu_y: frequencies of equal shape at which the OTF is watched, cycles per micrometre of sensor.

    Returns:
        The lines, and the largest change of the transfer function in the last doubling; an estimate that has been on
        the safe side by the factor 2 to 4 by which a doubling lowers it.

    Raises:
        JobError: MF104 for a tolerance that is not positive, MF115 if 4096 lines do not reach it.
    """
    if not tolerance > 0:
        raise JobError("MF104", f"the tolerance {tolerance:g} is not positive", cure="Give one such as 1e-4")
    panels = 1
    rule = band.quadrature(panels)
    before = polychromatic_otf(table, camera, rule, nu_x, nu_y)
    error = np.inf
    while panels < _MOST_PANELS:
        panels *= 2
        rule = band.quadrature(panels)
        after = polychromatic_otf(table, camera, rule, nu_x, nu_y)
        error = float(abs(after - before).max(initial=0.0))
        if error < tolerance:
            return rule, error
        before = after
    what = f"{_NODES_PER_PANEL * _MOST_PANELS} lines leave the band {band.name} {error:.1e} off, over {tolerance:.1e}"
    raise JobError("MF115", what, cure=f"Ask for a tolerance of {2 * error:.1e} or more")


def reach_um(camera: Camera, wavelengths_nm: Floats, highest: float) -> float:
    """The largest lag that a transfer function up to a frequency, in cycles per micrometre of sensor, asks for."""
    return float(np.max(wavelengths_nm)) * UM_PER_NM * camera.focal_um * highest


def polychromatic_otf(table: LagTable, camera: Camera, spectrum: Spectrum, nu_x: Floats, nu_y: Floats) -> Floats:
    """Transfer function of the optics at frequencies of equal shape, cycles per micrometre of sensor; no pixel.

    Its error is that of the table, ``table.coarse_uncertainty``, and no more: the lines are summed as they are.
    """
    nu_x, nu_y = np.asarray(nu_x, dtype=np.float64), np.asarray(nu_y, dtype=np.float64)
    total = np.zeros(np.broadcast(nu_x, nu_y).shape)
    for wavelength, weight in zip(spectrum.wavelengths_nm, spectrum.weights, strict=True):
        scale = wavelength * UM_PER_NM * camera.focal_um
        total += weight * table.coarse_otf(scale * nu_x, scale * nu_y)
    return total


def polychromatic_otf_grid(table: LagTable, camera: Camera, spectrum: Spectrum, nu_x: Floats, nu_y: Floats) -> Floats:
    """The polychromatic OTF on a rectilinear grid, [ny, nx] from [nx] and [ny], along one axis after the other."""
    total = np.zeros((nu_y.size, nu_x.size))
    for wavelength, weight in zip(spectrum.wavelengths_nm, spectrum.weights, strict=True):
        scale = wavelength * UM_PER_NM * camera.focal_um
        total += weight * table.coarse_grid(scale * nu_x, scale * nu_y)
    return total


def pixel_transfer(camera: Camera, nu_x: Floats, nu_y: Floats) -> Floats:
    """Transfer function of a full square pixel, sinc(ν_x p) sinc(ν_y p); signed beyond one cycle per pixel."""
    return np.asarray(np.sinc(nu_x * camera.pixel_um) * np.sinc(nu_y * camera.pixel_um))


def check_wavelengths(wavelengths_nm: Floats, where: str) -> None:
    """Refuse wavelengths outside 200 to 2000 nm (MF112), or none at all (MF104)."""
    if not wavelengths_nm.size:
        raise JobError("MF104", "the spectrum has no wavelength", where=where, cure="Give at least one wavelength")
    outside = ~((wavelengths_nm >= SHORTEST_NM) & (wavelengths_nm <= LONGEST_NM))
    if outside.any():
        what = f"wavelength {wavelengths_nm[outside][0]:g} nm is outside {SHORTEST_NM:g} nm to {LONGEST_NM:g} nm"
        raise JobError("MF112", what, where=where, cure="Give wavelengths in nanometres, such as 530")


def check_weights(weights: Floats, where: str) -> None:
    """Refuse weights that are negative, not finite, or all zero. Raises JobError MF104."""
    wrong = ~(np.isfinite(weights) & (weights >= 0))
    if wrong.any():
        what = f"weight {weights[wrong][0]:g} is not a finite number of at least 0"
        cure = "Light and response are never negative; remove the offset that made them so"
        raise JobError("MF104", what, where=where, cure=cure)
    if not weights.any():
        raise JobError("MF104", "all weights are zero", where=where, cure="Give at least one positive weight")


_TAPS = 14
# Samples for each that the longest lag needs at least.
_OVERSAMPLING = 5.0

RAYS_ERROR = 4e-8
"""Relative error of the wave of the longest lag, twice Π|x - k| (π/n)^14 / 14! halfway between samples; of all others
far less. Rounding comes on top."""

_BLOCK = 256
_PLACES = 16


@dataclass(frozen=True, eq=False)
class Rays:
    """|F|² on rays (t, st) and (st, t), 0 < s < 1, and on their mirror images, which with t < 0 make the whole plane.

    Attributes:
        step: between samples t = 0, step, ..., in cycles per micrometre.
        values: [t, rays].
    """

    step: float
    values: Floats

    @classmethod
    def of(cls, field: SampledField, reach_um: float, highest: float, slopes: Floats) -> Rays:
        """Sample a field along rays.

        Args:
            field: known as far as :func:`beyond` says along both axes.
            reach_um: most of x + sy, of its light and for any of the slopes.
            highest: t that will be asked for, cycles per micrometre.
            slopes: s of the rays.
        """
        step, count = _grid(reach_um, highest)
        t = step * np.arange(count + _TAPS, dtype=np.float64)
        values = np.empty((count, slopes.size, 4))
        for start in range(0, count, _BLOCK):
            block = t[start : min(start + _BLOCK, count)]
            # Beyond the diagonal no ray needs the field, but for the neighbours of those close to it.
            inner = t[: start + block.size + _TAPS]
            along_x, along_y = (field.field(*axes).quadrants() for axes in ((block, inner), (inner, block)))
            tall = [quadrant.T for quadrant in along_x]
            # The four that share their neighbours side by side in memory.
            sides = [_mirrored(*pair) for pair in (tall, tall[::-1], along_y, along_y[::-1])]
            quartets = np.stack(sides, axis=-1).reshape(-1, 4)
            first, weights = _neighbours(np.arange(start, start + block.size)[:, None] * slopes)
            first += _TAPS + (inner.size + _TAPS) * np.arange(block.size)[:, None]
            near = weights[..., None]
            rows = values[start : start + block.size]
            np.multiply(near[0], quartets[first], out=rows)
            for k in range(1, _TAPS):
                rows += near[k] * quartets[first + k]
        return cls(step, values.reshape(count, -1))

    def combined(self, places: Floats, scales: Floats, weights: Floats) -> Floats:
        """Σ_k w_k |F(p / c_k)|² at places p along all rays, [p, rays].

        Args:
            places: p > 0, float64 [p], ascending.
            scales, weights: c_k and w_k, float64 [k].
        """
        count = self.values.shape[0]
        total = np.empty((places.size, self.values.shape[1]))
        for start in range(0, places.size, _PLACES):
            some = places[start : start + _PLACES]
            first, near = _neighbours(some[:, None] / scales / self.step)
            near *= weights
            index = abs(first + np.arange(_TAPS)[:, None, None])
            used = slice(int(index.min()), int(index.max()) + 1)
            index += count * np.arange(some.size)[:, None]
            matrix = np.bincount(index.ravel(), near.ravel(), count * some.size).reshape(-1, count)[:, used]
            np.matmul(matrix, self.values[used], out=total[start : start + some.size])
        return total


def beyond(reach_um: float, highest: float) -> float:
    """The highest frequency at which rays look at a field; arguments as for :meth:`Rays.of`."""
    step, count = _grid(reach_um, highest)
    return step * (count + _TAPS - 1)


def _grid(reach_um: float, highest: float) -> tuple[float, int]:
    step = 1 / (4 * _OVERSAMPLING * reach_um)
    return step, math.ceil(highest / step) + _TAPS


def _mirrored(same: Floats, opposite: Floats) -> Floats:
    """[t, taps + r] along a grid of r >= 0 and before it ``_TAPS`` samples of r < 0, which the other quadrant has."""
    return np.concatenate([opposite[:, _TAPS:0:-1], same], axis=1)


def _neighbours(place: Floats) -> tuple[Indices, Floats]:
    """The first of the nearest points of the grid of whole numbers, [...], and Lagrange's weights, [taps, ...]."""
    first = np.floor(place).astype(np.intp) - (_TAPS // 2 - 1)
    node = np.arange(_TAPS, dtype=np.float64)
    apart = (place - first) - node.reshape(-1, *(1 for _ in place.shape))
    # At a node the others' weights come out as nothing, and its own as one.
    apart[apart == 0] = np.finfo(np.float64).tiny
    scale = [(-1) ** (_TAPS - 1 - k) * math.factorial(k) * math.factorial(_TAPS - 1 - k) for k in range(_TAPS)]
    weights: Floats = apart.prod(axis=0) / apart / np.reshape(scale, (-1, *(1 for _ in place.shape)))
    return first, weights


BAND_SAFETY = 2.0
_MOST_LINES = 512
_LEAST_SAMPLES = 64


def band_lines(band: Band, count: int) -> Spectrum:
    """A band as so many lines: one at its mean wavelength, or four in each panel of :meth:`Band.quadrature`."""
    if count == 1:
        return line_spectrum([band.centroid_nm], name=band.name)
    return band.quadrature(count // 4)


def band_errors(pupil: Pupil, camera: Camera, bands: Sequence[Band]) -> dict[int, float]:
    """The error of replacing every band by 1, 4, 8, ... lines: relative L2 of the PSF in the window against the most
    tried, of the worst band; empty without bands.

    The PSF is looked at along rays to all sides of the window, as dense at its edge as places along a ray, three of
    which or more fall on the width of its sharpest orders; a place stands for its part of the window. Twice the lines
    are tried until doubling changes less than the rays' own error, or there are 512; the last has nothing to be
    compared with and is left out. A band that stood still earlier than others keeps its last error for more lines.
    """
    if not bands:
        return {}
    half, shortest_nm = camera.window_um / 2, min(band.range_nm[0] for band in bands)
    samples = max(_LEAST_SAMPLES, math.ceil(1.5 * half * cutoff(camera, shortest_nm)))
    slopes = (np.arange(samples, dtype=np.float64) + 0.5) / samples
    highest = half / image_scale_um2(camera, shortest_nm)
    sides = pupil.stop.sides_um
    farthest = max(sides) / math.sqrt(2) if pupil.stop.round else sum(sides) / 2
    path = admissible(FieldTask.of(pupil, highest * slopes, highest * slopes))[0]
    end = (beyond(farthest, highest),) * 2
    sampled = SampledField.of(path.prepare(pupil, *end, "double").field, pupil.reach_um, end)
    rays, own = Rays.of(sampled, farthest, highest, slopes), path.error["double"] + RAYS_ERROR
    # Evenly in the angle whose cosine it is, places see the peak on the axis, where even ones hardly do.
    count = math.ceil(np.pi / 2 * samples)
    angle = np.pi * (np.arange(count, dtype=np.float64) + 0.5) / count
    place = half * (1 - np.cos(angle)) / 2
    root = np.sqrt(place * np.sin(angle))[:, None]

    def seen(spectrum: Spectrum) -> Floats:
        """The PSF, weighted with the root of the area that a place stands for."""
        scales = np.array([image_scale_um2(camera, float(line)) for line in spectrum.wavelengths_nm])
        psf = rays.combined(place, scales, spectrum.weights / scales**2)
        psf *= root
        return psf

    errors = [_errors(band, seen, own) for band in bands]
    return {
        count: max(by_count.get(count, by_count[max(by_count)]) for by_count in errors)
        for count in max(errors, key=len)
    }


def _errors(band: Band, seen: Callable[[Spectrum], Floats], own: float) -> dict[int, float]:
    values: dict[int, Floats] = {}
    for count in (1, *(4 * 2**k for k in range(20))):
        values[count] = seen(band_lines(band, count))
        size = float(np.linalg.norm(values[count]))
        if count > 4 and (2 * count > _MOST_LINES or np.linalg.norm(values[count] - values[count // 2]) < own * size):
            errors = {n: float(np.linalg.norm(values[n] - values[count])) / size for n in values}
            return {n: BAND_SAFETY * (error + own) for n, error in errors.items() if n != count}
    raise InternalError("MF901", "a band was doubled without end")
