r"""Light of many wavelengths: lines, bands, and the transfer function that they share.

A mask that only dims treats every wavelength alike but for scale, so the transfer function of a spectrum is

    OTF(ν) = Σ_k w_k C(λ_k f ν) / C(0),    Σ_k w_k = 1                      (Goodman, Fourier Optics, 6.3, by line)

with w_k the share of the detected energy at λ_k: one lag table serves all of them. A band is turned into lines by
Gauss quadrature with the band's own energy as its weight, in equal panels of what is lit, doubled until the transfer
function stands still: however narrow a line of the light, the weight has it exactly, and only C(λfν) is sampled.

Notes:
    C is piecewise bilinear, so along λ it has a kink wherever a lag λfν crosses a dot's edge: about one per
    dot / (f ν) of wavelength. High order buys nothing there; the error falls as the square of the number of lines.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import scipy
from numpy.polynomial.legendre import leggauss

from maskfab.base.arrays import Floats
from maskfab.errors import JobError
from maskfab.model import Camera, frozen
from maskfab.optics.functions.gauss import gauss_rules
from maskfab.optics.image.lag_table import LagTable, neighbours
from maskfab.optics.pupil.aperture import Lattice
from maskfab.units import UM_PER_NM

SHORTEST_NM, LONGEST_NM = 200.0, 2000.0

_NODES_PER_PANEL = 4
_MOST_PANELS = 1024


@dataclass(frozen=True, eq=False)
class Spectrum:
    """Lines, each with its share of the detected energy.

    Attributes:
        wavelengths_nm: float64 [k], 200 to 2000 nm.
        weights: float64 [k], not negative, summing to 1.
        name: identifier for reports.

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
            raise JobError(
                "MF104",
                f"{self.name} has {weights.size} weights for {wavelengths.size} wavelengths",
                cure="Give one weight for each wavelength",
            )
        check_weights(weights, self.name)
        if abs(weights.sum() - 1) > 1e-9:
            raise JobError(
                "MF104",
                f"the weights of {self.name} sum to {weights.sum():g}, not 1",
                cure="Divide the weights by their sum",
            )
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
        name: identifier for reports.

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
            raise JobError(
                "MF104",
                f"the wavelengths of {self.name} are not an ascending list of two or more",
                cure="Sort them and leave each once",
            )
        if values.shape != wavelengths.shape:
            raise JobError(
                "MF104",
                f"{self.name} has {values.size} values for {wavelengths.size} wavelengths",
                cure="Give one value for each wavelength",
            )
        check_weights(values, self.name)
        object.__setattr__(self, "wavelengths_nm", frozen(wavelengths))
        object.__setattr__(self, "values", frozen(values))

    def at(self, wavelengths_nm: Floats) -> Floats:
        """Value at any wavelengths."""
        return np.interp(wavelengths_nm, self.wavelengths_nm, self.values, left=0.0, right=0.0)


@dataclass(frozen=True, eq=False)
class Band:
    """A continuous spectrum: the product of curves where all of them are defined.

    Attributes:
        curves: for instance a camera's response and an illuminant.
        name: identifier for reports.

    Raises:
        JobError: MF104 if no wavelength passes all of the curves.
    """

    curves: tuple[Curve, ...]
    name: str

    def __post_init__(self) -> None:
        if not self._lit()[0].size:
            raise JobError(
                "MF104",
                f"the band {self.name} holds no light: {' x '.join(c.name for c in self.curves)} do not overlap",
                cure="Combine curves that share wavelengths",
            )

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
        nodes, weights = leggauss(_NODES_PER_PANEL + (len(self.curves) + 1) // 2)
        half = np.diff(edges)[:, None] / 2
        places = (skipped + middles)[:, None] + half * nodes
        energies = half * weights * self.density(places)
        panel = np.minimum((middles * (panels / ends[-1])).astype(np.intp), panels - 1)
        starts = np.flatnonzero(np.diff(panel, prepend=-1)) * nodes.size
        found, shares = gauss_rules(places.ravel(), energies.ravel(), starts, _NODES_PER_PANEL)
        return line_spectrum(found.ravel(), shares.ravel(), self.name)

    def _lit(self) -> tuple[Floats, Floats]:
        """Ends of the intervals between the curves' samples on which there is light, [k] each."""
        low, high = self.range_nm
        knots = np.unique(np.concatenate([[low, high], *(curve.wavelengths_nm for curve in self.curves)]))
        knots = knots[(knots >= low) & (knots <= high)]
        # Straight and not negative, a curve that is dark amid an interval is dark all over it.
        lit = self.density((knots[1:] + knots[:-1]) / 2) > 0
        return knots[:-1][lit], knots[1:][lit]


@dataclass(frozen=True, eq=False)
class Quadrature:
    """A band as lines, and how far these are from the band.

    Attributes:
        spectrum: the lines.
        error: largest change of the transfer function in the last doubling; an estimate that has been on the safe
            side by the factor 2 to 4 by which a doubling lowers it.
    """

    spectrum: Spectrum
    error: float


def line_spectrum(
    wavelengths_nm: Floats | list[float], weights: Floats | list[float] | None = None, name: str = ""
) -> Spectrum:
    """A spectrum of lines, weights in any scale; equal energies if there are none.

    Raises:
        JobError: MF112 or MF104, see :class:`Spectrum`.
    """
    places = np.atleast_1d(np.asarray(wavelengths_nm, dtype=np.float64))
    energies = np.ones_like(places) if weights is None else np.atleast_1d(np.asarray(weights, dtype=np.float64))
    label = name or " + ".join(f"{place:g} nm" for place in places[:4]) + (" ..." if places.size > 4 else "")
    check_weights(energies, label)
    return Spectrum(places, energies / energies.sum(), label)


def quadrature(band: Band, table: LagTable, camera: Camera, tolerance: float, nu_x: Floats, nu_y: Floats) -> Quadrature:
    """The fewest lines, in powers of two, whose transfer function is within a tolerance of the band's.

    Args:
        band: what is to be replaced by lines.
        table: lags as far as :func:`reach_um` asks at the longest wavelength.
        camera: for its focal length.
        tolerance: largest absolute change of the OTF that counts as none.
        nu_x, nu_y: frequencies of equal shape at which the OTF is watched, cycles per micrometre of sensor.

    Raises:
        JobError: MF104 for a tolerance that is not positive, MF115 if 4096 lines do not reach it.
    """
    if not tolerance > 0:
        raise JobError("MF104", f"the tolerance {tolerance:g} is not positive", cure="Give one such as 1e-4")
    panels = 1
    found = band.quadrature(panels)
    before = polychromatic_otf(table, camera, found, nu_x, nu_y)
    error = np.inf
    while panels < _MOST_PANELS:
        panels *= 2
        found = band.quadrature(panels)
        after = polychromatic_otf(table, camera, found, nu_x, nu_y)
        error = float(abs(after - before).max(initial=0.0))
        if error < tolerance:
            return Quadrature(found, error)
        before = after
    raise JobError(
        "MF115",
        f"{_NODES_PER_PANEL * _MOST_PANELS} lines leave the band {band.name} {error:.1e} off, over {tolerance:.1e}",
        cure=f"Ask for a tolerance of {2 * error:.1e} or more",
    )


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
    """The polychromatic OTF on a rectilinear grid, [ny, nx] from [nx] and [ny], by one sparse product along each axis.

    Raises:
        InternalError: MF901 for a lag beyond the table's reach.
    """
    cells_y, dots_y, cells_x, dots_x = table.values.shape
    values = table.values.reshape(cells_y * dots_y, cells_x * dots_x)
    total = np.zeros((nu_y.size, nu_x.size))
    for wavelength, weight in zip(spectrum.wavelengths_nm, spectrum.weights, strict=True):
        scale = wavelength * UM_PER_NM * camera.focal_um
        # The table itself refuses lags that it does not hold.
        table.coarse_otf(scale * np.array([abs(nu_x).max()]), scale * np.array([abs(nu_y).max()]))
        along_x = interpolation(table.x, scale * nu_x, (cells_x, dots_x))
        along_y = interpolation(table.y, scale * nu_y, (cells_y, dots_y))
        total += (along_x @ (along_y @ values).T).T * (weight / table.energy_um2)
    return total


def pixel_transfer(camera: Camera, nu_x: Floats, nu_y: Floats) -> Floats:
    """Transfer function of a full square pixel, sinc(ν_x p) sinc(ν_y p); signed beyond one cycle per pixel."""
    return np.asarray(np.sinc(nu_x * camera.pixel_um) * np.sinc(nu_y * camera.pixel_um))


def check_wavelengths(wavelengths_nm: Floats, where: str) -> None:
    """Refuse wavelengths outside 200 to 2000 nm, or none at all.

    Raises:
        JobError: MF112, or MF104 for an empty list.
    """
    if not wavelengths_nm.size:
        raise JobError("MF104", "the spectrum has no wavelength", where=where, cure="Give at least one wavelength")
    outside = ~((wavelengths_nm >= SHORTEST_NM) & (wavelengths_nm <= LONGEST_NM))
    if outside.any():
        raise JobError(
            "MF112",
            f"wavelength {wavelengths_nm[outside][0]:g} nm is outside {SHORTEST_NM:g} nm to {LONGEST_NM:g} nm",
            where=where,
            cure="Give wavelengths in nanometres, such as 530",
        )


def check_weights(weights: Floats, where: str) -> None:
    """Refuse weights that are negative, not finite, or all zero.

    Raises:
        JobError: MF104.
    """
    wrong = ~(np.isfinite(weights) & (weights >= 0))
    if wrong.any():
        raise JobError(
            "MF104",
            f"weight {weights[wrong][0]:g} is not a finite number of at least 0",
            where=where,
            cure="Light and response are never negative; remove the offset that made them so",
        )
    if not weights.any():
        raise JobError("MF104", "all weights are zero", where=where, cure="Give at least one positive weight")


def interpolation(lattice: Lattice, lag_um: Floats, sizes: tuple[int, int]) -> scipy.sparse.csr_array:
    """Matrix [lags, cells x dots] that interpolates a lag table along one axis."""
    rows, columns, weights = [], [], []
    for place, weight in neighbours(lattice, lag_um, sizes):
        rows.append(np.arange(lag_um.size))
        columns.append(place)
        weights.append(weight)
    places = (np.concatenate(rows), np.concatenate(columns))
    matrix = scipy.sparse.coo_array((np.concatenate(weights), places), (lag_um.size, sizes[0] * sizes[1])).tocsr()
    matrix.eliminate_zeros()
    return matrix
