r"""A panel at some distance in front of the stop: light from the side meets other openings, and spreads on the way.

A plane wave towards the image point (x, y) has slopes (x, y) / f. Over a gap g it carries the shadow of the openings
sideways by g (x, y) / f, and diffraction multiplies the openings' spectrum at q by

    H(q) = exp(2πi g [w(q + q0) - w(q0) - q·∇w(q0)]),   w(q) = sqrt(1/λ² - q²),   q0 = (x, y) / (λ sqrt(f² + x² + y²)),

the angular spectrum's transfer (Goodman, Fourier Optics, 3.10) without the carrier and the shift, which are taken out
exactly. It is sampled without aliasing up to 1 / (λ sqrt(1 + (2g/L)²)) per axis on a period L (K. Matsushima,
T. Shimobaba, Opt. Express 17, 19662, 2009), and is zero beyond.

What the gap changes. A free wave's far field only changes in phase; the PSF changes because the stop cuts the wave
after the gap. By reciprocity the field at q is that of the openings under the stop moved by -λ g q, its edge blurred to
sqrt(λg). So the yardstick is λ g q / D and sqrt(λ g) / D, not the dot's Fresnel number a² / (λ g), which only tells
whether the shadow in the stop's plane still looks like the openings (above 1) or not (below).

Notes:
    Regimes: scalar light, thin opaque mask, openings wider than about a wavelength. The stop is not foreshortened and
    the lens obeys x = f tan θ, so angles up to about 20°, where cos θ is 0.94. Without H (`shifted_pupil` alone) the
    gap is geometrical optics, with the error of :func:`maskfab.optics.wavefront.gap_estimates.gap_error`.
    All functions but :func:`magnified` take the wave that meets the panel as plane: an object at infinity.
    A panel that ends inside the light that reaches the stop is taken as opaque beyond its edge.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np
import scipy
from numpy.typing import NDArray

from maskfab.base.arrays import Complexes, Floats
from maskfab.errors import JobError
from maskfab.model import Camera, Psf, Stop
from maskfab.optics.field.parity import direct_field
from maskfab.optics.image.psf import odd_samples, point_psf, point_step_um
from maskfab.optics.pupil.aperture import Aperture, Lattice
from maskfab.optics.pupil.pupil import Pupil, cut
from maskfab.optics.pupil.stop_shape import Waves
from maskfab.units import UM_PER_NM

Place = tuple[float, float]

AXIS: Place = (0.0, 0.0)
MOST_GAP_SAMPLES = 64_000_000
"""As many samples as a propagated field may have."""

MOST_WAVES_PER_SAMPLE = 0.125
"""Largest change of a phase between samples in the stop's plane."""

_SAMPLES_PER_DOT = 4


@dataclass(frozen=True, eq=False)
class StopField:
    """One line's amplitude behind the stop on a square of samples, the axis on the middle one.

    Attributes:
        sample_um: distance of samples.
        shadow: complex128 [n, n], n odd, without diffraction over the gap; samples at the rim have their share of it.
        amplitude: the same with diffraction.
        shadow_um2, energy_um2: integrals of the squared moduli.
    """

    sample_um: float
    shadow: Complexes
    amplitude: Complexes
    shadow_um2: float
    energy_um2: float


def shift_um(camera: Camera, gap_um: float, image_um: Place, distance_um: float | None = None) -> Place:
    """Displacement of the openings' shadow in the stop's plane for an image point, g (x, y) / d.

    Args:
        camera: lens.
        gap_um: from panel to stop.
        image_um: where the image of the source lies on the sensor.
        distance_um: d, from lens to sensor; the focal length if None.

    Raises:
        JobError: MF104 for a gap that is negative or not finite.
    """
    if not (math.isfinite(gap_um) and gap_um >= 0):
        raise JobError("MF104", f"a gap of {gap_um:g} um is not a distance", cure="Give 0 um or more")
    distance = camera.focal_um if distance_um is None else distance_um
    return gap_um * image_um[0] / distance, gap_um * image_um[1] / distance


def moved_pupil(openings: Aperture, stop: Stop, moved_um: Place) -> Pupil:
    """Openings moved by (x, y) and cut by the stop, which stays in the middle.

    Raises:
        JobError: MF114 if the moved openings no longer cover the stop.
    """
    check_cover(openings, stop, moved_um)
    return cut(moved_aperture(openings, moved_um, stop.diameter_um / 2), stop)


def shifted_pupil(openings: Aperture, stop: Stop, moved_um: Place) -> Pupil:
    """The shifted pupil with its lattices centred, for paths that want symmetry.

    Shifting a pupil as a whole only turns the field's phase: ``stop`` is off centre in the lattices that come back, so
    intensities are right, and what tells places in the stop is not: take :func:`moved_pupil` for a phase.

    Raises:
        JobError: MF114 if the moved openings no longer cover the stop.
    """
    pupil = moved_pupil(openings, stop, moved_um)
    x, y = _centred(pupil.x), _centred(pupil.y)
    return replace(pupil, x=x, y=y, stop_um=(x.start_um - pupil.x.start_um, y.start_um - pupil.y.start_um))


def moved_aperture(openings: Aperture, moved_um: Place, half_width_um: float) -> Aperture:
    """The cells of openings moved by (x, y) that meet a square of that half width."""
    x, y = (
        replace(lattice, start_um=lattice.start_um + moved)
        for lattice, moved in ((openings.x, moved_um[0]), (openings.y, moved_um[1]))
    )
    near_x, near_y = x.trimmed(half_width_um), y.trimmed(half_width_um)
    columns, rows = (_intervals(a, b) for a, b in ((x, near_x), (y, near_y)))
    return Aperture(near_x, near_y, openings.transmission[rows, columns], openings.variance[rows, columns])


def magnified(openings: Aperture, gap_um: float, object_um: float) -> tuple[Aperture, float]:
    """Openings and gap that show an object at infinity what these show one at a finite distance.

    A spherical wave behind openings is a plane one behind openings m times as large, m times as far away, with the
    sphere's curvature left to the lens; m = z / (z - g), z from the object to the stop (Goodman, Fourier Optics, 4.2).
    Small as g/z is, it moves the speckle of a PSF by g/f as much as the change of focus does.

    Raises:
        JobError: MF104 for an object that is not in front of the openings.
    """
    if not object_um > gap_um:
        raise JobError(
            "MF104",
            f"an object {object_um:g} um from the stop is not in front of a panel {gap_um:g} um from it",
            cure="Move it beyond the panel",
        )
    factor = 1 / (1 - gap_um / object_um)
    x, y = (
        replace(axis, start_um=factor * axis.start_um, dot_um=factor * axis.dot_um, pitch_um=factor * axis.pitch_um)
        for axis in (openings.x, openings.y)
    )
    return replace(openings, x=x, y=y), factor * gap_um


def shifted_psf(openings: Aperture, camera: Camera, wavelength_nm: float, gap_um: float, image_um: Place = AXIS) -> Psf:
    """Point PSF about an image point, the gap as a shift of the openings only.

    Raises:
        JobError: MF104 for a gap that is no distance, MF114 if the openings do not cover the stop from there.
    """
    return point_psf(shifted_pupil(openings, camera.stop, shift_um(camera, gap_um, image_um)), camera, wavelength_nm)


def gap_psf(
    openings: Aperture,
    camera: Camera,
    wavelength_nm: float,
    gap_um: float,
    image_um: Place = AXIS,
    samples_per_dot: int = _SAMPLES_PER_DOT,
    *,
    waves: Waves | None = None,
    distance_um: float | None = None,
    margin: int = 0,
) -> Psf:
    """Point PSF about an image point, the gap as shift and diffraction.

    The openings' exact spectrum up to half a cycle per sample is propagated, transformed to the stop's plane, cut by
    the stop (samples at its rim weighted with their share inside), and transformed to the sensor.

    Args:
        openings: everything clear in front of the stop.
        camera: lens, stop and window.
        wavelength_nm: the line.
        gap_um: from panel to stop.
        image_um: where the image of the source lies on the sensor.
        samples_per_dot: how finely the stop's plane is sampled; twice as many cut the error by about three.
        waves: phase in the stop's plane, the axis at its origin; none if None.
        distance_um: from lens to sensor; the focal length if None.
        margin: points beyond the window.

    Raises:
        JobError: MF104 for a gap that is no distance, or a phase that is not finite; MF114 if the openings do not cover
            the stop from there; MF115 if the samples are so fine that waves are evanescent, or more than 64 million, or
            so coarse that the phase turns by more than an eighth of a wave from one to the next.
    """
    distance = camera.focal_um if distance_um is None else distance_um
    found = stop_field(
        openings, camera, wavelength_nm, gap_um, image_um, samples_per_dot, waves=waves, distance_um=distance
    )  # fmt: skip
    middle = found.amplitude.shape[0]
    place = found.sample_um * (np.arange(middle, dtype=np.float64) - middle // 2)
    step, scale = point_step_um(camera), wavelength_nm * UM_PER_NM * distance
    reach = odd_samples(camera.window_um, step) // 2 + margin
    u = step * np.arange(-reach, reach + 1, dtype=np.float64) / scale
    kernel = found.sample_um * np.exp(-2j * np.pi * u[:, None] * place)
    field = kernel @ found.amplitude @ kernel.T
    return Psf(abs(field) ** 2 / (scale**2 * found.energy_um2), step, wavelength_nm, "point")


def stop_field(
    openings: Aperture,
    camera: Camera,
    wavelength_nm: float,
    gap_um: float,
    image_um: Place = AXIS,
    samples_per_dot: int = _SAMPLES_PER_DOT,
    *,
    waves: Waves | None = None,
    distance_um: float | None = None,
) -> StopField:
    """The amplitude behind the stop of light on its way to an image point; arguments and errors as for
    :func:`gap_psf`.
    """
    distance = camera.focal_um if distance_um is None else distance_um
    moved = shift_um(camera, gap_um, image_um, distance)
    check_cover(openings, camera.stop, moved)
    sample, stop, before, after = _cut_fields(
        openings, camera, wavelength_nm, gap_um, image_um, samples_per_dot, moved, distance
    )
    still = cut(moved_aperture(openings, moved, camera.stop.diameter_um / 2), camera.stop).energy_um2
    energy = still + sample**2 * (_power(after, stop) - _power(before, stop))
    if waves is not None:
        middle = stop.shape[0]
        place = sample * (np.arange(middle, dtype=np.float64) - middle // 2)
        turn = turned(waves, place, place, stop > 0)
        before *= turn
        after *= turn
    return StopField(sample, before, after, still, energy)


def gap_change(openings: Aperture, camera: Camera, wavelength_nm: float, gap_um: float, u: Floats) -> float:
    """Relative L2 change of the PSF on the axis by diffraction over a gap, as far as one sample for each dot tells it.

    Both PSFs are of the same samples, so that these add to neither; where the openings do not go on beyond the stop,
    what would come from there is missing.

    Args:
        openings: everything clear in front of the stop, and some of what lies beyond.
        camera: lens and stop.
        wavelength_nm: the line.
        gap_um: from panel to stop.
        u: float64 [n] frequencies along either axis at which the two are compared, cycles per micrometre.

    Raises:
        JobError: MF115 as for :func:`gap_psf`.
    """
    sample, stop, before, after = _cut_fields(openings, camera, wavelength_nm, gap_um, AXIS, 1, AXIS, camera.focal_um)
    place = sample * (np.arange(stop.shape[0], dtype=np.float64) - stop.shape[0] // 2)
    kernel = np.exp(-2j * np.pi * u[:, None] * place)
    plain, spread = (abs(kernel @ part @ kernel.T) ** 2 / _power(part, stop) for part in (before, after))
    return float(np.linalg.norm(spread - plain) / np.linalg.norm(plain))


def _cut_fields(
    openings: Aperture,
    camera: Camera,
    wavelength_nm: float,
    gap_um: float,
    image_um: Place,
    samples_per_dot: int,
    moved: Place,
    distance: float,
) -> tuple[float, Floats, Complexes, Complexes]:
    """Distance of samples, the stop on them, and the amplitude behind it without the gap's diffraction and with it."""
    wavelength, radius = wavelength_nm * UM_PER_NM, camera.stop.diameter_um / 2
    sample = openings.x.dot_um / samples_per_dot
    top = 0.5 / sample
    carrier = _carrier(wavelength, distance, image_um)
    if wavelength * (top + carrier[2]) >= 1:
        raise JobError("MF115", f"samples of {sample:g} um resolve evanescent waves", cure="Ask for fewer per dot")
    guard = gap_guard_um(gap_um, wavelength_nm, sample)
    aperture = moved_aperture(openings, moved, radius + guard)
    extent = max(abs(edges).max() for edges in (aperture.x.edges_um(), aperture.y.edges_um()))
    dots = math.ceil((math.ceil((radius + extent + guard) / sample) + 4) / samples_per_dot)
    count = samples_per_dot * scipy.fft.next_fast_len(dots)
    if count**2 > MOST_GAP_SAMPLES:
        raise JobError("MF115", f"the gap needs {count} x {count} samples", cure="Ask for fewer per dot")
    stop = _sampled_stop(camera.stop, sample)
    spectrum = _spectrum(aperture, samples_per_dot, count)
    transfer = _transfer(wavelength, carrier, gap_um, sample, count)
    middle = stop.shape[0]
    before, after = (_in_stop_plane(part, sample, middle) * stop for part in (spectrum, spectrum * transfer))
    return sample, stop, before, after


def gap_guard_um(gap_um: float, wavelength_nm: float, sample_um: float) -> float:
    """Sideways reach over a gap of the finest waves that samples hold; infinite if evanescent."""
    slope = wavelength_nm * UM_PER_NM / (2 * sample_um)
    return gap_um * slope / math.sqrt(1 - slope**2) if slope < 1 else math.inf


def check_cover(openings: Aperture, stop: Stop, moved_um: Place) -> None:
    """Refuse openings that, moved by (x, y), no longer cover the stop.

    Raises:
        JobError: MF114.
    """
    radius = stop.diameter_um / 2
    ends = [_ends_um(lattice) for lattice in (openings.x, openings.y)]
    missing = max(
        max(low + moved + radius, radius - high - moved) for (low, high), moved in zip(ends, moved_um, strict=True)
    )
    if missing > 1e-6:
        width, height = (high - low for low, high in ends)
        raise JobError(
            "MF114",
            f"moved by {math.hypot(*moved_um):.1f} um, openings of {width:g} um x {height:g} um leave {missing:.1f} um "
            f"of the stop of {stop.diameter_um:g} um uncovered",
            cure="Make the panel larger, the gap shorter, or the field angle smaller",
        )


def _ends_um(lattice: Lattice) -> Place:
    """Where the cells of a lattice begin and end, half a gutter beyond their dots."""
    edges, strip = lattice.edges_um(), (lattice.pitch_um - lattice.dots * lattice.dot_um) / 2
    return float(edges[0]) - strip, float(edges[-1]) + strip


def _centred(lattice: Lattice) -> Lattice:
    length = (lattice.cells - 1) * lattice.pitch_um + lattice.dots * lattice.dot_um
    return replace(lattice, start_um=-length / 2)


def _intervals(whole: Lattice, part: Lattice) -> slice:
    """Where the intervals of some of a lattice's cells stand among all of them."""
    first = round((part.start_um - whole.start_um) / whole.pitch_um) * whole.period
    return slice(first, first + part.edges_um().size - 1)


def _carrier(wavelength: float, distance: float, image_um: Place) -> tuple[float, float, float]:
    """Spatial frequency of the incoming wave in x and y, and its size, cycles per micrometre."""
    x, y = image_um
    length = wavelength * math.sqrt(distance**2 + x**2 + y**2)
    return x / length, y / length, math.hypot(x, y) / length


def _spectrum(aperture: Aperture, samples_per_dot: int, count: int) -> Complexes:
    """Exact Fourier coefficients of the openings on a period of count samples, in FFT order, [v, u].

    The period is a whole number of dots: where these are on one grid, the coefficients are those of points on it, which
    repeat for every sample per dot, times the dot's own and the phase of where the grid begins.
    """
    x, y = aperture.x, aperture.y
    frequency = np.asarray(scipy.fft.fftfreq(count, x.dot_um / samples_per_dot), dtype=np.float64)
    if not (x.has_gutter or y.has_gutter) and x.dot_um == y.dot_um:
        size = count // samples_per_dot
        points = scipy.fft.fft2(_folded(aperture.transmission, size))
        across, up = (
            axis.dot_um
            * np.sinc(axis.dot_um * frequency)
            * np.exp(-2j * np.pi * (axis.start_um + axis.dot_um / 2) * frequency)
            for axis in (x, y)
        )
        repeated: Complexes = np.tile(points, (samples_per_dot, samples_per_dot))
        repeated *= up[:, None]
        repeated *= across
        return repeated
    everywhere = Stop("square", math.inf)
    whole = Pupil.of_whole_dots(aperture.x, aperture.y, aperture.transmission, everywhere)
    return direct_field(whole, frequency, frequency)


def _folded(values: Floats, size: int) -> Floats:
    """Sums over a period of so many rows and columns; openings may be wider than it by cells that do not matter."""
    rows, columns = (-(-n // size) for n in values.shape)
    padded = np.zeros((rows * size, columns * size))
    padded[: values.shape[0], : values.shape[1]] = values
    return np.asarray(padded.reshape(rows, size, columns, size).sum(axis=(0, 2)))


def _transfer(
    wavelength: float, carrier: tuple[float, float, float], gap_um: float, sample: float, count: int
) -> Complexes:
    """H at the frequencies of :func:`_spectrum`."""
    across, up, size = carrier
    q = np.asarray(scipy.fft.fftfreq(count, sample), dtype=np.float64)
    limit = 1 / (wavelength * math.sqrt(1 + (2 * gap_um / (sample * count)) ** 2))
    u, v = q[None, :], q[:, None]
    straight = math.sqrt(1 / wavelength**2 - size**2)
    along = np.sqrt(np.clip(1 / wavelength**2 - (u + across) ** 2 - (v + up) ** 2, 0, None))
    path = along - straight + (u * across + v * up) / straight
    return np.where((abs(u) <= limit) & (abs(v) <= limit), np.exp(2j * np.pi * gap_um * path), 0.0)


def _sampled_stop(stop: Stop, sample: float) -> Floats:
    """Share of every sample's square that lies inside the stop, [n, n], n odd, the axis on the middle sample."""
    count = 2 * math.ceil(stop.diameter_um / 2 / sample) + 1
    lattice = Lattice(-count * sample / 2, count, 1, sample, sample)
    ones = np.ones((count, count))
    return cut(Aperture(lattice, lattice, ones, np.zeros_like(ones)), stop).mean_transmission


def _in_stop_plane(spectrum: Complexes, sample: float, middle: int) -> Complexes:
    """The amplitude at the middle samples of the stop's plane."""
    field: Complexes = np.roll(scipy.fft.ifft2(spectrum), (middle // 2, middle // 2), axis=(0, 1))[:middle, :middle]
    return field / sample**2


def turned(waves: Waves, x_um: Floats, y_um: Floats, inside: NDArray[np.bool_]) -> Complexes:
    """exp(2πi W) at the samples of the stop's plane that let light pass, 0 elsewhere.

    Args:
        waves: W.
        x_um, y_um: of the samples' columns and rows.
        inside: bool [rows, columns], where light passes.

    Raises:
        JobError: MF104 for a phase that is not finite; MF115 where it turns by more than an eighth of a wave from one
            sample to the next.
    """
    phase = np.where(inside, waves(x_um, y_um[:, None]), 0.0)
    if not np.isfinite(phase).all():
        raise JobError("MF104", "the wavefront is not finite inside the stop", cure="Give finite coefficients")
    across, up = (abs(np.diff(phase, axis=axis)) for axis in (1, 0))
    steepest = max(
        float(across[inside[:, 1:] & inside[:, :-1]].max(initial=0.0)),
        float(up[inside[1:] & inside[:-1]].max(initial=0.0)),
    )
    if steepest > MOST_WAVES_PER_SAMPLE:
        raise JobError(
            "MF115",
            f"the phase turns by {steepest:.2g} waves from one sample to the next",
            cure="Ask for more samples per dot or a weaker wavefront",
        )
    return np.where(inside, np.exp(2j * np.pi * phase), 0.0)


def _power(cut_field: Complexes, stop: Floats) -> float:
    """Sum of |amplitude|² over samples, those at the rim counted with their share."""
    share = np.where(stop > 0, stop, 1.0)
    return float(((cut_field.real**2 + cut_field.imag**2) / share).sum())
