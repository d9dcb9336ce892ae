"""Smooth phases on a pupil: its far field with one, the aberrations of a lens, and the defocus of near objects.

**The field.** The amplitude a(x, y) exp(2πi W(x, y)) is projected, dot by dot, on Legendre polynomials of total degree
below K, whose transforms are known exactly (see ``field``). K = 1 is a constant phase per dot, K = 2 adds the tilt, K =
3 the curvature. With m_qp the mean of a exp(2πiW) P_q P_p over a dot of area A, the part of the field that one pair of
orders makes is a kernel (2q+1)(2p+1) j_q j_p times a sum over dots that repeats with period 1/dot in frequency, so that
Parseval over one period bounds what dropping the pair costs below a highest frequency b:

    ‖F_qp‖ <= max_{|u|, |v| <= b} |j_q(πuw) j_p(πvh)| (2q+1)(2p+1) sqrt(Z A Σ_dots |m_qp|²),

Z the number of periods that the square |u|, |v| <= b touches. The error is the sum of these over the dropped pairs,
over the root of the whole energy. K is the smallest that meets the requested error; where the phase turns too fast for
the quadrature of m_qp, dots are halved and cut anew.

Notes:
    The quadrature of the moments is trusted while its highest order holds less than the requested error in energy,
    because a Gauss rule's own error is about the square of the last coefficient that it resolves.
    Dots that the stop cuts multiply their exact moments by the phase's own expansion (products of Legendre polynomials
    are linearised); degrees beyond the rim's 10 are lost, where both factors are already tiny.

**Aberrations.** A wavefront is Σ c_j Z_j in waves, Z_j the Zernike polynomials in Noll's order (R. J. Noll, J. Opt.
Soc. Am. 66, 207, 1976), orthonormal on the round stop: the mean of Z_j Z_k over it is 1 if j = k, else 0, so that the
rms of the wavefront is the root of the sum of squares of its coefficients (piston aside). The pupil is multiplied by
exp(+2πi W): a wavefront that rises towards +x moves the image towards +x.

Notes:
    On a square stop the polynomials belong to the circle inscribed in it: they go beyond 1 in the corners, where high
    degrees grow fast, and are no longer orthonormal.
    Noll's order counts cosine terms as even numbers and sine terms as odd ones, which is neither the OSA/ANSI nor the
    fringe order.

**Near objects** scale the PSF in focus, and put a parabola of phase on the pupil out of focus. A thin lens images an
object at distance z at z' = f z / (z - f). With the sensor at d, the image distance of whatever the camera is focused
on, the openings in the stop's plane are seen at frequencies u = x / (λ d), with the phase

    W(r) = ½ r² (1/d - 1/z') / λ     waves                                        (Goodman, Fourier Optics, 6.4.1)

which is r²/2λ times the difference of the object's and the focus' reciprocal distances. Within Fresnel's approximation
this is exact, and W = 0 in focus.

Notes:
    A PSF in focus at z is that at infinity stretched by d/f = 1 + f/(z - f). The change looks small, but it moves a
    speckle at radius r by r f/z, and speckle is λf/D wide: a point PSF of a wide stop is a different one long before
    its envelope is. Pixels wider than the speckle, and comparisons after stretching back, are far kinder.
    Fresnel's approximation drops D⁴/(64 λ d³)-sized phases of lens and path; they are the lens's to correct.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from functools import lru_cache
from types import MappingProxyType

import numpy as np
import scipy
from numpy.polynomial.legendre import legvander

from maskfab.base.arrays import Complexes, Floats, Indices
from maskfab.base.errors import JobError
from maskfab.base.model import Frozen, Psf
from maskfab.base.units import UM_PER_NM
from maskfab.job.camera import Camera, Stop
from maskfab.optics.polynomials import gauss_legendre, spherical_bessel, spherical_bessel_bounds
from maskfab.optics.psf import image_scale_um2, odd_samples, point_step_um, psf_norm_um6
from maskfab.optics.pupil import RIM_ORDERS, Aperture, Pupil, cut, finer_aperture
from maskfab.optics.stop import Waves, stop_strehl
from maskfab.optics.tiling_mean import MeanPsf, phase_error

_NODES = (3, 5, 8)
_CHUNK = 8192
_RIM_CHUNK = 128
_MOST_DOTS = 4_000_000
# Above it no rule of the above resolves a dot.
_MOST_WAVES_PER_DOT = 2.0
_RIM_TOLERANCE = 1e-8

# Work in flops of a product: of a phased pupil, of a moment of a dot, of all of a cut one, of a dot laid out in a
# matrix, of a kernel's value, and of the thin products of cut dots.
_PHASED, _MOMENT, _RIM_DOT, _SPREAD, _KERNEL, _THIN = 5e7, 3200.0, 4e5, 240.0, 65.0, 70.0


@dataclass(frozen=True, eq=False)
class PhasedPupil(Frozen):
    """A pupil times exp(2πi W), as Legendre moments of its dots.

    Attributes:
        pupil: the real pupil, its dots halved as often as the phase asked for.
        row, column: intp [k] the dots that transmit and that the stop leaves whole.
        moments: complex128 [k, degree, degree]; ``[i, q, p]`` is the mean over dot i of amplitude x exp(2πiW) x
            P_q(eta) x P_p(xi); those with q + p >= degree are not used.
        rim_moments: complex128 [r, RIM_ORDERS, RIM_ORDERS], the same for the pupil's cut dots, inside the stop.
        degree: K, one more than the highest total degree kept.
        highest: highest frequency along either axis for which the error holds, cycles per micrometre.
        error: bound on the L2 error of the field below it that the truncation causes, relative to all energy.
    """

    pupil: Pupil
    row: Indices
    column: Indices
    moments: Complexes
    rim_moments: Complexes
    degree: int
    highest: float
    error: float

    @property
    def field_integral_um2(self) -> complex:
        """Integral of the complex amplitude: the field on the axis."""
        widths, heights = np.diff(self.pupil.x.edges_um()), np.diff(self.pupil.y.edges_um())
        whole = self.moments[:, 0, 0] @ (heights[self.row] * widths[self.column])
        rim = self.rim_moments[:, 0, 0] @ (heights[self.pupil.rim_row] * widths[self.pupil.rim_column])
        return complex(whole + rim)

    def field(self, u: Floats, v: Floats) -> Complexes:
        """The field on the symmetric grid that u, v >= 0 span, complex128 [2 nv - 1, 2 nu - 1].

        Args:
            u, v: frequencies in cycles per micrometre, ascending, the first 0; [nu] and [nv].
        """
        pupil = self.pupil
        orders = max(self.degree, _rim_orders(pupil, u, v))
        along_x, along_y = (_kernels(axis.edges_um(), f, orders) for axis, f in ((pupil.x, u), (pupil.y, v)))
        stacked_y = np.concatenate(along_y)
        # Real and imaginary parts apart: the kernels are real.
        total = np.zeros((2, stacked_y.shape[1], along_x[0].shape[1]))
        for p in range(orders):
            columns = np.zeros((2, along_x[0].shape[0], stacked_y.shape[1]))
            dense = max(self.degree - p, 0)
            for q in range(dense):
                columns += self._matrix(q, p).transpose(0, 2, 1) @ along_y[q]
            if pupil.rim_row.size and dense < orders - p:
                columns += self._rim_columns(range(dense, orders - p), p, stacked_y)
            total += columns.transpose(0, 2, 1) @ along_x[p]
        even, odd = np.split(total[0] + 1j * total[1], 2)
        return _assembled(*np.split(even, 2, axis=1), *np.split(odd, 2, axis=1))

    def _matrix(self, q: int, p: int) -> Floats:
        """Moments of one order pair on the whole grid, weighted for synthesis, real and imaginary, [2, ny, nx]."""
        matrix = np.zeros((2, *self.pupil.whole.shape))
        weight = (2 * q + 1) * (2 * p + 1)
        for place, moments in (
            ((self.row, self.column), self.moments),
            ((self.pupil.rim_row, self.pupil.rim_column), self.rim_moments),
        ):
            matrix[0][place] = weight * moments[:, q, p].real
            matrix[1][place] = weight * moments[:, q, p].imag
        return matrix

    def _rim_columns(self, orders: range, p: int, stacked_y: Floats) -> Floats:
        """Contribution of the cut dots for one order in x and those in y above the degree, [2, nx, 2 nv]."""
        pupil = self.pupil
        rows, columns = pupil.whole.shape
        chosen = np.array(orders)
        weighted = (2 * chosen + 1) * (2 * p + 1) * self.rim_moments[:, chosen, p]
        place = (np.repeat(pupil.rim_column, chosen.size), (pupil.rim_row[:, None] + rows * chosen).ravel())
        shape = (columns, stacked_y.shape[0])
        parts = (weighted.real.ravel(), weighted.imag.ravel())
        return np.stack([scipy.sparse.coo_array((values, place), shape).tocsr() @ stacked_y for values in parts])


def phased(pupil: Pupil, waves: Waves, highest: float, tolerance: float = 1e-6) -> PhasedPupil:
    """A pupil times exp(2πi W).

    Args:
        waves: W, smooth on the scale of a dot.
        highest: highest frequency along either axis that will be asked for, cycles per micrometre.
        tolerance: largest L2 error of the field below it, relative to all energy; the PSF's is at most twice it in L1.

    Raises:
        JobError: MF104 if the phase is not finite, MF115 if it turns so fast that more than four million dots are
            needed.
    """
    span = _steepest(pupil, waves)
    if not pupil.whole.size * (span / _MOST_WAVES_PER_DOT) ** 2 <= _MOST_DOTS:
        what = (
            f"the phase turns by {span:.3g} waves over a dot of {pupil.x.dot_um:g} um, which would take more than "
            f"{_MOST_DOTS} dots"
        )
        raise JobError("MF115", what, cure="Ask for a weaker wavefront")
    # The dots that transmit and are whole.
    row, column = np.nonzero(pupil.whole)
    for nodes in _NODES:
        moments = pupil.whole[row, column][:, None, None] * _phase_moments(pupil, row, column, waves, nodes)
        if not _resolved(pupil, row, column, moments, tolerance):
            continue
        error = _truncation_errors(pupil, row, column, moments, highest)
        good = np.flatnonzero(error[1:] <= tolerance)
        if good.size:
            degree = int(good[0]) + 1
            rim = _rim_moments(pupil, waves, nodes + 3)
            whole = np.ascontiguousarray(moments[:, :degree, :degree])
            return PhasedPupil(pupil, row, column, whole, rim, degree, highest, float(error[degree]))
    if pupil.whole.size * 4 > _MOST_DOTS:
        what = f"the phase turns too fast: {pupil.whole.size} dots do not resolve it to the {tolerance:.1e} asked for"
        raise JobError("MF115", what, cure="Ask for a larger error or a weaker wavefront")
    return phased(halved(pupil), waves, highest, tolerance)


def phased_flops(pupil: Pupil, u: Floats, steepest: float, tolerance: float) -> float:
    """Work of a phased pupil and of its field, in flops of a matrix product, as for the paths to a field.

    A phase of s waves along a dot has orders sqrt(2k + 1) j_k(πs) of amplitude (DLMF 10.60.7): what :func:`phased`
    tries until it has enough follows from the steepest one.

    Args:
        u: float64 [n] frequencies from 0 along either axis, cycles per micrometre.
        steepest: most waves that the phase turns over a micrometre.
    """
    n, dot, moments = u.size, pupil.x.dot_um, 0
    (ny, nx), dots, rim = pupil.whole.shape, int(np.count_nonzero(pupil.whole)), pupil.rim_row.size
    weight = np.sqrt(2 * np.arange(_NODES[-1] + 1) + 1)
    while True:
        phase, seen = weight * spherical_bessel_bounds(np.pi * dot * np.array([steepest, u[-1]]), weight.size).T
        degree = int(np.flatnonzero(2 * phase * seen > tolerance)[-1]) + 1
        enough = [nodes for nodes in _NODES if nodes >= degree and 2 * phase[nodes - 1] ** 2 <= tolerance]
        moments += dots * sum(nodes**2 for nodes in _NODES if not enough or nodes <= enough[0])
        if enough or 4 * ny * nx > _MOST_DOTS:
            break
        dot, ny, nx, dots, rim = dot / 2, 2 * ny, 2 * nx, 4 * dots, 2 * rim
    orders, pairs = max(degree, _rim_orders(pupil, u, u)), degree * (degree + 1) // 2
    thin = orders * (orders + 1) // 2 - pairs
    return float(
        _PHASED
        + _MOMENT * moments
        + _RIM_DOT * rim
        + pairs * ny * nx * (8.0 * n + _SPREAD)
        + orders * nx * (16.0 * n**2 + _KERNEL * 4 * n)
        + _THIN * 4 * n * thin * rim
    )


def window_frequency(camera: Camera, wavelength_nm: float, distance_um: float | None = None) -> float:
    """Highest frequency along an axis that the camera's window shows, in cycles per micrometre."""
    distance = camera.focal_um if distance_um is None else distance_um
    return camera.window_um / 2 / (wavelength_nm * UM_PER_NM * distance)


def halved(pupil: Pupil) -> Pupil:
    """The pupil on dots of half the side, those at the stop's rim cut anew."""
    transmission = np.array(pupil.whole)
    transmission[pupil.rim_row, pupil.rim_column] = pupil.rim_transmission
    return cut(finer_aperture(Aperture(pupil.x, pupil.y, transmission, pupil.whole_variance), 2), pupil.stop)


def phased_psf(
    source: PhasedPupil, camera: Camera, wavelength_nm: float, *, distance_um: float | None = None, margin: int = 0
) -> Psf:
    """Point intensity of a pupil with a phase, sampled as :func:`maskfab.optics.psf.point_psf` samples it.

    Args:
        distance_um: from lens to sensor; the focal length if None.
        margin: points beyond the window.
    """
    step = point_step_um(camera)
    scale = image_scale_um2(camera, wavelength_nm, distance_um)
    reach = odd_samples(camera.window_um, step) // 2 + margin
    frequency = step * np.arange(reach + 1, dtype=np.float64) / scale
    field = source.field(frequency, frequency)
    intensity = field.real**2 + field.imag**2
    return Psf(intensity / psf_norm_um6(scale, source.pupil.energy_um2), step, wavelength_nm, "point")


def _steepest(pupil: Pupil, waves: Waves) -> float:
    """The most waves that the phase turns along a side of any open dot."""
    rows, columns = np.nonzero(pupil.whole)
    row, column = np.append(rows, pupil.rim_row), np.append(columns, pupil.rim_column)
    if not row.size:
        return 0.0
    x, y = pupil.x.edges_um(), pupil.y.edges_um()
    corner, beside, above = (waves(x[column + i], y[row + j]) for i, j in ((0, 0), (1, 0), (0, 1)))
    if not all(np.isfinite(values).all() for values in (corner, beside, above)):
        raise JobError("MF104", "the wavefront is not finite inside the stop", cure="Give finite coefficients")
    return float(max(abs(beside - corner).max(), abs(above - corner).max()))


def _phase_moments(pupil: Pupil, row: Indices, column: Indices, waves: Waves, nodes: int) -> Complexes:
    """Means over dots of exp(2πiW) P_q P_p by Gauss-Legendre quadrature, complex128 [k, nodes, nodes]."""
    place, weights = gauss_legendre(nodes)
    analysis = legvander(place, nodes - 1) * weights[:, None] / 2  # node, order
    x, y = pupil.x.edges_um(), pupil.y.edges_um()
    moments = np.empty((row.size, nodes, nodes), dtype=np.complex128)
    for start in range(0, row.size, _CHUNK):
        part = slice(start, start + _CHUNK)
        i, j = column[part], row[part]
        across = (x[i] + x[i + 1])[:, None] / 2 + (x[i + 1] - x[i])[:, None] / 2 * place
        up = (y[j] + y[j + 1])[:, None] / 2 + (y[j + 1] - y[j])[:, None] / 2 * place
        turn = 2 * np.pi * waves(across[:, None, :], up[:, :, None])
        # Two real products where a complex one would first turn the real analysis matrix complex.
        for trigonometric, target in ((np.cos, moments.real), (np.sin, moments.imag)):
            values = np.broadcast_to(trigonometric(turn), (i.size, nodes, nodes))
            target[part] = analysis.T @ values @ analysis
    return moments


def _resolved(pupil: Pupil, row: Indices, column: Indices, moments: Complexes, tolerance: float) -> bool:
    """Whether the highest orders that the quadrature has hold a small enough share of the energy."""
    power = _order_power(pupil, row, column, moments)
    last = power[-1].sum() + power[:, -1].sum()
    return bool(last <= tolerance * power.sum())


def _order_power(pupil: Pupil, row: Indices, column: Indices, moments: Complexes) -> Floats:
    """Energy in each pair of orders, [nodes, nodes], in square micrometres."""
    area = np.diff(pupil.y.edges_um())[row] * np.diff(pupil.x.edges_um())[column]
    weight = 2 * np.arange(moments.shape[1], dtype=np.float64) + 1
    power: Floats = np.einsum("kqp,k->qp", moments.real**2 + moments.imag**2, area) * weight[:, None] * weight
    return power


def _truncation_errors(pupil: Pupil, row: Indices, column: Indices, moments: Complexes, highest: float) -> Floats:
    """The module's error bound for every K, float64 [nodes + 1]."""
    nodes = moments.shape[1]
    energy = pupil.energy_um2
    if energy == 0:
        return np.zeros(nodes + 1)
    orders = np.arange(nodes)
    sizes, periods = [], []
    for dot in (pupil.y.dot_um, pupil.x.dot_um):
        phase = np.linspace(0.0, np.pi * highest * dot, 65)
        sizes.append(abs(spherical_bessel(phase, nodes)).max(axis=1) * np.sqrt(2 * orders + 1))
        periods.append(np.ceil(2 * highest * dot))
    bound = np.sqrt(np.prod(periods) * _order_power(pupil, row, column, moments) / energy) * np.outer(*sizes)
    total = np.add.outer(orders, orders)
    return np.array([bound[total >= k].sum() for k in range(nodes + 1)], dtype=np.float64)


def _rim_moments(pupil: Pupil, waves: Waves, nodes: int) -> Complexes:
    """Moments of amplitude x exp(2πiW) over the cut dots, inside the stop, complex128 [r, RIM_ORDERS, RIM_ORDERS]."""
    weight = 2 * np.arange(nodes) + 1
    phase = _phase_moments(pupil, pupil.rim_row, pupil.rim_column, waves, nodes) * weight[:, None] * weight
    product = _linearisation(nodes).reshape(nodes * RIM_ORDERS, RIM_ORDERS)
    moments = np.empty((pupil.rim_row.size, RIM_ORDERS, RIM_ORDERS), dtype=np.complex128)
    for start in range(0, pupil.rim_row.size, _RIM_CHUNK):
        part = slice(start, start + _RIM_CHUNK)
        # dot, phase's order and result's order in y, the same two in x
        joint = (product @ pupil.rim_moments[part] @ product.T).reshape(-1, nodes, RIM_ORDERS, nodes, RIM_ORDERS)
        joint = joint.transpose(0, 1, 3, 2, 4).reshape(-1, nodes * nodes, RIM_ORDERS * RIM_ORDERS)
        turn = phase[part].reshape(-1, 1, nodes * nodes)
        result = np.concatenate([turn.real, turn.imag], axis=1) @ joint
        moments[part] = (result[:, 0] + 1j * result[:, 1]).reshape(-1, RIM_ORDERS, RIM_ORDERS)
    return moments


@lru_cache(maxsize=8)
def _linearisation(nodes: int) -> Floats:
    """P_a P_q = Σ_s L[a, q, s] P_s for a < nodes and q, s < RIM_ORDERS, float64 [nodes, RIM_ORDERS, RIM_ORDERS]."""
    place, weights = gauss_legendre(2 * RIM_ORDERS + nodes)
    values = legvander(place, max(RIM_ORDERS, nodes) - 1)
    table: Floats = np.einsum(
        "n,na,nq,ns->aqs", weights, values[:, :nodes], values[:, :RIM_ORDERS], values[:, :RIM_ORDERS], optimize=True
    ) * (np.arange(RIM_ORDERS) + 0.5)
    table.flags.writeable = False
    return table


def _rim_orders(pupil: Pupil, u: Floats, v: Floats) -> int:
    """Number of Legendre orders that the cut dots need at the highest frequency; none without cut dots."""
    if not pupil.rim_row.size:
        return 0
    phase = np.pi * np.maximum(u[-1] * pupil.x.dot_um, v[-1] * pupil.y.dot_um)
    size = (2 * np.arange(RIM_ORDERS) + 1) * spherical_bessel_bounds(phase, RIM_ORDERS)
    needed = np.flatnonzero(size >= _RIM_TOLERANCE)
    return int(needed[-1]) + 1


def _kernels(edges: Floats, frequency: Floats, orders: int) -> list[Floats]:
    """Real transforms of P_0, P_1, ... on every interval, [n, 2 m] each: columns even in frequency, then odd ones."""
    width, centre = np.diff(edges), (edges[1:] + edges[:-1]) / 2
    different, which = np.unique(np.round(width, 11), return_inverse=True)
    phase = 2 * np.pi * centre[:, None] * frequency
    cosine, sine = np.cos(phase), np.sin(phase)
    sizes = different[:, None] * spherical_bessel(np.pi * different[:, None] * frequency, orders)
    kernels = []
    for p in range(orders):
        size = sizes[p][which]
        # (-i)^p exp(-i phase) = cos(phase + pπ/2) - i sin(phase + pπ/2)
        even, odd = ((cosine, sine), (-sine, cosine), (-cosine, -sine), (sine, -cosine))[p % 4]
        kernels.append(np.concatenate([size * even, size * odd], axis=1))
    return kernels


def _assembled(even_even: Complexes, even_odd: Complexes, odd_even: Complexes, odd_odd: Complexes) -> Complexes:
    """The field in all four quadrants from its parts even and odd in v (first word) and in u (second)."""
    same, opposite = even_even - odd_odd, even_even + odd_odd
    plus, minus = 1j * (odd_even + even_odd), 1j * (odd_even - even_odd)
    upper = np.concatenate([(opposite - minus)[:, :0:-1], same - plus], axis=1)
    lower = np.concatenate([(same + plus)[:0:-1, :0:-1], (opposite + minus)[:0:-1]], axis=1)
    return np.concatenate([lower, upper], axis=0)


HIGHEST_TERM = 66
"""Noll's number of the last term of radial degree 10."""

NOLL: Mapping[str, int] = MappingProxyType(
    {
        "tilt_x": 2,
        "tilt_y": 3,
        "defocus": 4,
        "astigmatism_oblique": 5,
        "astigmatism": 6,
        "coma_y": 7,
        "coma_x": 8,
        "trefoil_y": 9,
        "trefoil_x": 10,
        "spherical": 11,
    }
)
"""Noll's numbers of the terms that have names."""


@dataclass(frozen=True)
class Wavefront:
    """A lens's wavefront error.

    Attributes:
        terms: pairs of Noll's number and its coefficient in waves.
        reference_nm: the wavelength whose waves these are; at others the same path counts in proportion.

    Raises:
        JobError: MF104 for a term outside 1 to 66, or a coefficient that is not finite.
    """

    terms: tuple[tuple[int, float], ...]
    reference_nm: float

    def __post_init__(self) -> None:
        for term, coefficient in self.terms:
            if not 1 <= term <= HIGHEST_TERM:
                what = f"Zernike term {term} is outside 1 to {HIGHEST_TERM}"
                raise JobError("MF104", what, cure="Give Noll's numbers; defocus is 4, spherical aberration 11")
            if not math.isfinite(coefficient):
                what = f"the coefficient of Zernike term {term} is {coefficient}"
                raise JobError("MF104", what, cure="Give a finite number of waves, such as 0.05")
        if not (math.isfinite(self.reference_nm) and self.reference_nm > 0):
            what = f"the wavefront's reference wavelength is {self.reference_nm:g} nm"
            raise JobError("MF104", what, cure="Give the wavelength at which it was measured, such as 633 nm")

    def rms_waves(self, wavelength_nm: float) -> float:
        """Root mean square over the clear round stop, piston left out, in waves at that wavelength."""
        squares: dict[int, float] = {}
        for term, coefficient in self.terms:
            squares[term] = squares.get(term, 0.0) + coefficient
        total = sum(value**2 for term, value in squares.items() if term > 1)
        return math.sqrt(total) * self.reference_nm / wavelength_nm

    def waves(self, stop: Stop, wavelength_nm: float) -> Waves:
        """The wavefront as a function of x and y in micrometres."""
        radius, scale = stop.diameter_um / 2, self.reference_nm / wavelength_nm

        def path(x_um: Floats, y_um: Floats) -> Floats:
            total = np.zeros(np.broadcast(x_um, y_um).shape)
            for term, coefficient in self.terms:
                total += coefficient * scale * zernike(term, x_um / radius, y_um / radius)
            return total

        return path


def noll_degrees(term: int) -> tuple[int, int]:
    """Radial degree n and azimuthal frequency m of a term; m > 0 for a cosine, m < 0 for a sine."""
    n = 0
    while (n + 1) * (n + 2) // 2 < term:
        n += 1
    place = term - n * (n + 1) // 2
    m = 2 * (place // 2) if n % 2 == 0 else 2 * ((place - 1) // 2) + 1
    return n, m if term % 2 == 0 else -m


def zernike(term: int, x: Floats, y: Floats) -> Floats:
    """Zernike polynomial of Noll's number ``term`` at x, y in units of the stop's radius; any shapes that broadcast.

    The radial polynomial (Born and Wolf, 9.2.1) without its factor ρ^|m|, which goes to the angle's cosine or sine, is
    a polynomial in ρ²; together they are a polynomial in x and y, with no angle undefined at the middle.
    """
    n, signed = noll_degrees(term)
    m = abs(signed)
    squared = x**2 + y**2
    radial = np.zeros_like(squared)
    for k in range((n - m) // 2 + 1):
        factor = math.factorial(n - k) // (
            math.factorial(k) * math.factorial((n + m) // 2 - k) * math.factorial((n - m) // 2 - k)
        )
        radial += (-1) ** k * factor * squared ** ((n - m) // 2 - k)
    if m == 0:
        return np.asarray(math.sqrt(n + 1) * radial)
    power = (x + 1j * y) ** m
    return np.asarray(math.sqrt(2 * (n + 1)) * radial * (power.real if signed > 0 else power.imag))


def marechal_strehl(rms_waves: float) -> float:
    """exp(-(2πσ)²), the Strehl ratio of a weak wavefront of any shape (V. N. Mahajan, J. Opt. Soc. Am. 73, 860, 1983).

    Notes:
        Good to 1e-3 for the usual shapes at σ = 1/14 wave; at σ = 0.2 it is a guess.
    """
    return math.exp(-((2 * math.pi * rms_waves) ** 2))


def aberration_error(wavefront: Wavefront, wavelength_nm: float, mean: MeanPsf | None = None) -> float:
    """Estimated relative L2 error of the PSF if the wavefront is left out (:func:`ensemble.phase_error`).

    Args:
        wavefront: weak, up to about a tenth of a wave rms.
        mean: of the tiling; without it the answer is the most that any tiling shows.
    """
    parts = [
        marechal_strehl(Wavefront(chosen, wavefront.reference_nm).rms_waves(wavelength_nm))
        for chosen in (
            tuple(term for term in wavefront.terms if noll_degrees(term[0])[0] % 2 == parity) for parity in (0, 1)
        )
    ]
    return phase_error(mean, parts[0], parts[1])


def image_distance_um(focal_um: float, object_um: float) -> float:
    """Distance behind a thin lens at which an object in front of it is imaged: f z / (z - f); f for one at infinity.

    Raises:
        JobError: MF104 for an object that is not beyond the focal length, and so has no real image.
    """
    if math.isinf(object_um) and object_um > 0:
        return focal_um
    if not object_um > focal_um:
        what = f"an object {object_um:g} um from a lens of focal length {focal_um:g} um has no real image"
        raise JobError("MF104", what, cure="Move it beyond the focal length")
    return focal_um * object_um / (object_um - focal_um)


def defocus_waves(camera: Camera, wavelength_nm: float, object_um: float, focus_um: float) -> Waves:
    """Phase (x, y in um) of an object while the camera is focused elsewhere; MF104 within the focal length."""
    curvature = 1 / image_distance_um(camera.focal_um, focus_um) - 1 / image_distance_um(camera.focal_um, object_um)
    factor = curvature / (2 * wavelength_nm * UM_PER_NM)

    def path(x_um: Floats, y_um: Floats) -> Floats:
        return np.asarray(factor * (x_um**2 + y_um**2))

    return path


def edge_defocus_waves(camera: Camera, wavelength_nm: float, object_um: float, focus_um: float) -> float:
    """The phase at the rim of a round stop (the middle of a square one's sides) in waves; negative beyond the focus."""
    radius = np.array(camera.stop.diameter_um / 2)
    return float(defocus_waves(camera, wavelength_nm, object_um, focus_um)(radius, np.zeros(())))


def clear_stop_strehl(waves_at_rim: float) -> float:
    """Strehl ratio of a clear round stop defocused by that many waves at its rim: sinc²(W) (Born and Wolf, 8.8.2)."""
    return float(np.sinc(waves_at_rim) ** 2)


def defocus_error(
    camera: Camera, wavelength_nm: float, object_um: float, focus_um: float = math.inf, mean: MeanPsf | None = None
) -> float:
    """Estimated relative L2 error of the PSF if the defocus is left out (:func:`ensemble.phase_error`).

    Args:
        object_um, focus_um: distances of the object and of what is in focus.
        mean: of the tiling; without it the answer is the most that any tiling shows, and needs no PSF.

    Raises:
        JobError: MF104 for a distance within the focal length.
    """
    edge = edge_defocus_waves(camera, wavelength_nm, object_um, focus_um)
    if camera.stop.shape == "circle":
        return phase_error(mean, clear_stop_strehl(edge))
    blur = defocus_waves(camera, wavelength_nm, object_um, focus_um)
    return phase_error(mean, stop_strehl(camera.stop, blur, 32 + 4 * math.ceil(abs(edge))))


def stretch_sensitivity(psf: Psf) -> float:
    """Relative L2 change of a PSF per relative stretch, ‖2 I + x·∇I‖ / ‖I‖ over its window.

    The derivative of I(x / m) / m² by m at m = 1. Gradients are spectral, which band-limited samples allow: with n
    samples h apart, n odd, the weight of the k-th beside is (-1)^k π / (nh sin(πk/n)) (L. N. Trefethen, Spectral
    Methods in MATLAB, 2000, chapter 3).

    Notes:
        The window's edges wrap round in the spectral gradient; it matters only if the PSF is not small there.
    """
    count = psf.values.shape[0]
    offset = psf.step_um * (np.arange(count, dtype=np.float64) - count // 2)
    beside = np.arange(1, count)
    weight = np.zeros(count)
    weight[1:] = np.where(beside % 2, -np.pi, np.pi) / (count * psf.step_um * np.sin(np.pi * beside / count))
    place = np.arange(count)
    slope = weight[place[:, None] - place]
    change = 2 * psf.values + (psf.values @ slope.T) * offset + offset[:, None] * (slope @ psf.values)
    return float(np.linalg.norm(change) / np.linalg.norm(psf.values))


def scale_error(psf: Psf, camera: Camera, object_um: float) -> float:
    """Estimated relative L2 error of the PSF, over its window, if an object in focus is taken to be at infinity.

    Proportional to the stretch δ = f / (z - f) at first, levelling at sqrt(2), where nothing is alike any more:
    sqrt(2 (1 - exp(-(κδ)² / 2))) with κ from :func:`stretch_sensitivity`. One PSF, at infinity, serves every distance.

    Args:
        psf: at infinity, sampled at points; of one averaged over pixels too wide for its speckle the gradients alias,
            and the answer comes out up to twice too high.

    Raises:
        JobError: MF104 for an object within the focal length.
    """
    stretch = image_distance_um(camera.focal_um, object_um) / camera.focal_um - 1
    return math.sqrt(-2 * math.expm1(-((stretch_sensitivity(psf) * stretch) ** 2) / 2))


def nearest_object_um(psf: Psf, camera: Camera, error: float) -> float:
    """The shortest distance at which :func:`scale_error` stays below ``error``: nearer, depth matters.

    Args:
        psf: at infinity.
        error: relative L2, in (0, 1).

    Raises:
        JobError: MF104 for an error outside that range.
    """
    if not 0 < error < 1:
        raise JobError("MF104", f"an error of {error:g} is outside 0 to 1", cure="Give a ratio: 0.05 for 5 %")
    stretch = math.sqrt(-2 * math.log1p(-(error**2) / 2)) / stretch_sensitivity(psf)
    return camera.focal_um * (1 + 1 / stretch)
