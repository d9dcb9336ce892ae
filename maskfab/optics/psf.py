"""Point spread functions on the sensor, of film that leaks light and of rough edges too.

**The PSF** is the field's intensity, at points or averaged over pixels. The intensity at sensor position x is |F(x /
(λf))|² / ((λf)² E), with E the transmitted energy, so that it integrates to 1 over the whole sensor plane (Parseval):
what lies outside the window is missing from the window's sum, not hidden.

It holds no frequency above B = D / (λf), so samples closer than 1 / (2B) say all about it, averages over pixels
included: a short symmetric filter w with Σ w_n cos(2πν n h) = sinc(νp) for all |ν| <= B turns samples at distance h
into means over pixels of side p, exactly but for the residual of that equation.

**A leak** is an amplitude τ = 10^(-OD / 2) exp(2πi φ) of the chrome where the openings have 1.

With o the openings and s the clear stop, the amplitude is a = o + τ (s - o), and so is its field: that of s is known in
closed form, so a leak costs one PSF nothing but a sum. Of a binary mask of open ratio η the mean amplitude is
η + τ (1 - η) and the mean intensity η + |τ|² (1 - η); they fix peak Strehl and volume under the MTF as η alone does
without a leak. Its lags are in :mod:`maskfab.optics.film_lags`.

**Rough edges** leave less of the orders and feed a halo. An edge is displaced along its normal by ξ(s), normally
distributed with the root mean square σ and the correlation ρ(s) = exp(-(s / l)²). The mean field is that of the smooth
openings times exp(-(2π f σ)² / 2), the Debye-Waller factor, and the light that the orders lose is spread about them: an
edge of length L adds

    L ∫ ds exp(-2πi f_t s) (exp(-a (1 - ρ)) - exp(-a)) / (2π f_n)²,    a = (2π f_n σ)²,

to the squared field at the frequency f = (f_n, f_t) across and along it (P. Beckmann, A. Spizzichino, The Scattering of
Electromagnetic Waves from Rough Surfaces, 1963, ch. 5, of one dimension less). Over all frequencies it holds L σ / √π,
and the mean field so much less: light is conserved, and the open ratio is that of the smooth openings in the mean.

Notes:
    The factor is exact for shapes of right angles whose edges are independent of each other, where it is one factor
    across and one up; of arcs it is as far as σ is small beside their radius. Near the ends of edges of length L the
    halo is wrong by about l / (√π L) of itself.
"""

from __future__ import annotations

import cmath
import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import lru_cache
from typing import TYPE_CHECKING

import numpy as np

from maskfab.base.arrays import Complexes, Floats
from maskfab.base.model import Psf, frozen
from maskfab.base.units import UM_PER_NM
from maskfab.job.camera import Camera, Stop
from maskfab.optics.field.matrix import ParityField, SampledField
from maskfab.optics.field.methods import FieldTask, Prepared, admissible, field
from maskfab.optics.field.waves import frequency_nodes
from maskfab.optics.pupil import Pupil
from maskfab.optics.stop import clear_field

if TYPE_CHECKING:
    from maskfab.job.process import MaskBlank, Roughness


@dataclass(frozen=True)
class Leak:
    """The film's amplitude behind a stop.

    Attributes:
        amplitude: τ.
    """

    amplitude: complex
    stop: Stop

    @classmethod
    def of(cls, blank: MaskBlank, stop: Stop) -> Leak | None:
        """The leak that a job states; None unless it states both density and phase."""
        if blank.optical_density is None or blank.film_phase_waves is None:
            return None
        return cls(10 ** (-blank.optical_density / 2) * cmath.exp(2j * cmath.pi * blank.film_phase_waves), stop)

    def field(self, openings: Complexes, u: Floats, v: Floats) -> Complexes:
        """The field of openings and film from that of the openings alone, at frequencies [nu] and [nv], [nv, nu]."""
        clear = clear_field(self.stop, u, v[:, None])
        return np.asarray((1 - self.amplitude) * openings + self.amplitude * clear)

    def energy_um2(self, clear_um2: float) -> float:
        """Integral of the intensity behind a mask that is clear over that area."""
        return clear_um2 + abs(self.amplitude) ** 2 * (self.stop.area_um2 - clear_um2)

    def field_integral_um2(self, clear_um2: float) -> complex:
        """Integral of the amplitude: the field on the axis."""
        return clear_um2 + self.amplitude * (self.stop.area_um2 - clear_um2)

    def volume_um2(self, clear_um2: float) -> float:
        """Volume under the MTF of a mask with that clear area."""
        return abs(self.field_integral_um2(clear_um2)) ** 2 / self.energy_um2(clear_um2)


OVERSAMPLING = 1.15
"""Samples of a PSF, at least, by those that its highest frequency asks for."""
FILTER_TOLERANCE = 1e-10
"""Largest error of the pixel filter's transfer function, which is sinc(νp)."""
# Frequencies to a node that make it worth to keep the field at nodes, of one line.
_NODES_KEPT = 1.5


def image_scale_um2(camera: Camera, wavelength_nm: float, distance_um: float | None = None) -> float:
    """λz in square micrometres: sensor position divided by it is spatial frequency in cycles per micrometre.

    Args:
        distance_um: z, from lens to sensor; the focal length if None.
    """
    return wavelength_nm * UM_PER_NM * (camera.focal_um if distance_um is None else distance_um)


def psf_norm_um6(scale_um2: float, energy_um2: float) -> float:
    """(λz)² E, by which a field's intensity is divided to be a PSF: its integral over the sensor is 1 by Parseval.

    Args:
        scale_um2: λz, of :func:`image_scale_um2`.
        energy_um2: E, of the pupil: the integral of its squared transmission.
    """
    return scale_um2**2 * energy_um2


def cutoff(camera: Camera, wavelength_nm: float) -> float:
    """Highest frequency of the intensity along an axis, in cycles per micrometre of sensor: D / (λf)."""
    return camera.stop.diameter_um / image_scale_um2(camera, wavelength_nm)


def point_step_um(camera: Camera) -> float:
    """The largest whole fraction of a pixel that samples the PSF at every wavelength, with 15 % to spare."""
    highest = max(cutoff(camera, wavelength) for wavelength in camera.wavelengths_nm)
    return camera.pixel_um / math.ceil(camera.pixel_um * 2 * highest * OVERSAMPLING)


def odd_samples(width_um: float, step_um: float) -> int:
    """Number of samples, odd with one on the axis, that fit a window of that width."""
    return 2 * int((width_um / step_um - 1) / 2 + 1e-9) + 1


def point_psf(pupil: Pupil, camera: Camera, wavelength_nm: float, margin: int = 0) -> Psf:
    """Intensity at points ``point_step_um`` apart over the camera's window, and ``margin`` points beyond it."""
    frequency = _frequencies(camera, wavelength_nm, margin)
    return _psf(field(pupil, frequency, frequency), pupil, camera, wavelength_nm, frequency, None)


@dataclass(frozen=True, eq=False)
class ReadyPupil:
    """A pupil made ready for some lines of a camera, by the cheapest path that takes them all.

    Attributes:
        pupil: with a leak that of the openings of a binary mask, to which the film's light is added.
        frequencies: of every line, from the axis to the window's edge and the margin beyond it.
    """

    pupil: Pupil
    camera: Camera
    lines: Sequence[float]
    frequencies: Sequence[Floats]
    prepared: Prepared

    @classmethod
    def of(cls, pupil: Pupil, camera: Camera, margin: int = 0, lines: Sequence[float] | None = None) -> ReadyPupil:
        """Make a pupil ready for ``margin`` points beyond the camera's window, and for all its lines if None."""
        lines = camera.wavelengths_nm if lines is None else lines
        frequencies = [_frequencies(camera, wavelength, margin) for wavelength in lines]
        widest = max(frequencies, key=lambda frequency: float(frequency[-1]))
        path = admissible(FieldTask.of(pupil, widest, widest))[0]
        end = float(widest[-1]), float(widest[-1])
        prepared: Prepared = path.prepare(pupil, *end, "double")
        nodes = max(frequency_nodes(reach, end[0], "double").count for reach in pupil.reach_um)
        if len(lines) > 1 or _NODES_KEPT * nodes <= widest.size:
            # Openings are looked at once; all lines, and all further calls, are taken from there.
            prepared = SampledField.of(prepared.field, pupil.reach_um, end)
        return cls(pupil, camera, lines, frequencies, prepared)

    def psfs(self, leak: Leak | None = None) -> list[Psf]:
        """PSFs at every line."""
        return [
            _psf(self.prepared.field(frequency, frequency), self.pupil, self.camera, wavelength, frequency, leak)
            for frequency, wavelength in zip(self.frequencies, self.lines, strict=True)
        ]


def _frequencies(camera: Camera, wavelength_nm: float, margin: int) -> Floats:
    step = point_step_um(camera)
    reach = odd_samples(camera.window_um, step) // 2 + margin
    return step * np.arange(reach + 1, dtype=np.float64) / image_scale_um2(camera, wavelength_nm)


def _psf(
    quadrant: ParityField, pupil: Pupil, camera: Camera, wavelength_nm: float, frequency: Floats, leak: Leak | None
) -> Psf:
    energy = pupil.energy_um2
    if leak is None:
        values = quadrant.intensity()
    else:
        axis, energy = np.concatenate([-frequency[:0:-1], frequency]), leak.energy_um2(energy)
        field = leak.field(quadrant.amplitude(), axis, axis)
        values = field.real**2 + field.imag**2
    values /= psf_norm_um6(image_scale_um2(camera, wavelength_nm), energy)
    values.flags.writeable = False
    return Psf(values, point_step_um(camera), wavelength_nm, "point")


def pixel_psf(points: Psf, camera: Camera) -> Psf:
    """Means over square pixels, one of them centred on the axis, over the camera's window.

    Args:
        points: sampled at ``point_step_um`` with a margin of at least :func:`pixel_margin`.
    """
    gather = pixel_means(camera, points.step_um, points.values.shape[0], points.wavelength_nm)
    return Psf(gather @ points.values @ gather.T, camera.pixel_um, points.wavelength_nm, "pixel")


def pixel_means(camera: Camera, step_um: float, samples: int, wavelength_nm: float) -> Floats:
    """Weights [pixels, samples] that take samples along an axis to means over the pixels of the window."""
    weights = _pixel_filter(camera.pixel_um, step_um, cutoff(camera, wavelength_nm))
    reach = weights.size // 2
    stride = round(camera.pixel_um / step_um)
    half = odd_samples(camera.window_um, camera.pixel_um) // 2
    centres = samples // 2 + stride * np.arange(-half, half + 1)
    gather = np.zeros((centres.size, samples))
    gather[np.arange(centres.size)[:, None], centres[:, None] + np.arange(-reach, reach + 1)] = weights
    return gather


def pixel_sum_error(pixels: Psf, highest: float) -> float:
    """Bound of what the pixel filter adds to an energy that pixel means are summed to.

    Along an axis a sum over n pixels weighs the filter's error at ν by p |sin(πnνp) / sin(πνp)|, whose integral over
    1/p is Lebesgue's constant, below 1.3 + 0.41 ln n, and a transfer function is nowhere above 1.

    Args:
        pixels: the means; their number along a side is taken for n.
        highest: the PSF's highest frequency along an axis, cycles per micrometre of sensor.
    """
    periods = math.ceil(2 * highest * pixels.step_um) + 1
    return 2 * FILTER_TOLERANCE * periods * (1.3 + 0.41 * math.log(pixels.values.shape[0]))


def pixel_margin(camera: Camera) -> int:
    """Number of points beyond the window that the pixel filter needs at every wavelength."""
    step = point_step_um(camera)
    inside = odd_samples(camera.window_um, step) // 2
    pixels = round(camera.pixel_um / step) * (odd_samples(camera.window_um, camera.pixel_um) // 2)
    sizes = [_pixel_filter(camera.pixel_um, step, cutoff(camera, w)).size // 2 for w in camera.wavelengths_nm]
    return max(0, pixels + max(sizes) - inside)


def within(points: Psf, camera: Camera) -> Psf:
    """A PSF without its margin."""
    surplus = (points.values.shape[0] - odd_samples(camera.window_um, points.step_um)) // 2
    if surplus == 0:
        return points
    inner = points.values[surplus:-surplus, surplus:-surplus]
    return Psf(inner, points.step_um, points.wavelength_nm, points.kind)


@lru_cache(maxsize=64)
def _pixel_filter(pixel_um: float, step_um: float, highest: float) -> Floats:
    """Weights [2 n + 1] that average samples ``step_um`` apart over a pixel, for frequencies up to ``highest``.

    The plain mean plus least squares at the rim; taps grow until the error anywhere in the band is below the tolerance.
    """
    steps = round(pixel_um / step_um)
    beyond, error = 2, np.inf
    while error >= FILTER_TOLERANCE:
        last = steps // 2 + beyond
        band = np.linspace(0.0, highest, max(801, 8 * last))
        tap = np.arange(last + 1)
        weights = np.where(2 * tap < steps, 1.0, np.where(2 * tap == steps, 0.5, 0.0)) / steps
        basis = 2 * np.cos(2 * np.pi * band[:, None] * step_um * tap)
        basis[:, 0] = 1.0
        lacking = np.sinc(band * pixel_um) - basis @ weights
        rim = basis[:, max(0, last - 2 * beyond) :]
        # Beyond working precision more taps only grow; the pseudo-inverse keeps them small.
        solution = np.linalg.lstsq(rim, lacking, rcond=1e-13)[0]
        error = abs(rim @ solution - lacking).max()
        weights[-solution.size :] += solution
        beyond += 4
    both: Floats = np.concatenate([weights[:0:-1], weights])
    both.flags.writeable = False
    return both


_LEAST_TERM = 1e-12


@dataclass(frozen=True, eq=False)
class EdgeLengths:
    """Edges of clear shapes by their direction.

    Attributes:
        along: float64 [n, 2] unit vectors along the edges.
        length_um: float64 [n] of all edges of a direction together.
    """

    along: Floats
    length_um: Floats

    @classmethod
    def of(cls, edges_um: Floats, counts: Floats) -> EdgeLengths:
        """Lengths of edges x0, y0, x1, y1 [n, 4], each so many times; opposite directions are one."""
        vectors = edges_um[:, 2:] - edges_um[:, :2]
        lengths = np.hypot(*vectors.T)
        back = (vectors[:, 1] < 0) | ((vectors[:, 1] == 0) & (vectors[:, 0] < 0))
        units = np.where(back[:, None], -vectors, vectors) / lengths[:, None]
        along, index = np.unique(np.round(units, 9) + 0.0, axis=0, return_inverse=True)
        summed = np.zeros(len(along))
        np.add.at(summed, index.ravel(), lengths * counts)
        return cls(frozen(along), frozen(summed))

    @property
    def total_um(self) -> float:
        """Length of all edges."""
        return float(self.length_um.sum())


def scattered_um2(edges: EdgeLengths, roughness: Roughness) -> float:
    """Clear area whose light leaves the orders of smooth edges for the halo, wherever it goes."""
    return edges.total_um * roughness.sigma_um / float(np.sqrt(np.pi))


def halo_um3(across: Floats, along: Floats, roughness: Roughness) -> Floats:
    """Mean squared field that a micrometre of rough edge adds.

    Args:
        across, along: cycles per micrometre across the edge and along it.
    """
    a = (2 * np.pi * across * roughness.sigma_um) ** 2
    decay = (np.pi * along * roughness.correlation_um) ** 2
    halo = np.zeros(np.broadcast(a, decay).shape)
    power, k = np.exp(-a), 1
    while True:
        halo += power / np.sqrt(k) * np.exp(-decay / k)
        k += 1
        power = power * a / k
        if k > a.max(initial=0.0) and power.max(initial=0.0) < _LEAST_TERM:
            break
    scale = roughness.sigma_um**2 * roughness.correlation_um * np.sqrt(np.pi)
    return np.asarray(scale * halo)


def rough_psf(smooth: Psf, edges: EdgeLengths, area_um2: float, scale_um2: float, roughness: Roughness) -> Psf:
    """The PSF of openings with rough edges, in the mean over all displays.

    Args:
        smooth: that of smooth edges, at points.
        edges: all of them inside the stop, without the stop's own.
        area_um2: what is clear in the stop.
        scale_um2: wavelength times image distance: micrometres on the sensor for a cycle per micrometre.
    """
    half = smooth.values.shape[0] // 2
    f = smooth.step_um / scale_um2 * np.arange(-half, half + 1, dtype=np.float64)
    fx, fy = f[None, :], f[:, None]
    values = smooth.values * np.exp(-((2 * np.pi * roughness.sigma_um) ** 2) * (fx**2 + fy**2))
    for (tx, ty), length in zip(edges.along, edges.length_um, strict=True):
        halo = halo_um3(fx * ty - fy * tx, fx * tx + fy * ty, roughness)
        values = values + length / (scale_um2**2 * area_um2) * halo
    return replace(smooth, values=values)
