"""A panel at some distance in front of the stop: light from the side meets other openings, and spreads on the way.

A plane wave towards the image point (x, y) under f tan θ has slopes (x, y) / f. Over a gap g it carries the shadow of
the openings sideways by g (x, y) / f, and diffraction multiplies the openings' spectrum at q by

    H(q) = exp(2πi g [w(q + q0) - w(q0) - q·∇w(q0)]),   w(q) = sqrt(1/λ² - q²),   q0 = (x, y) / (λ sqrt(f² + x² + y²)),

the angular spectrum's transfer (Goodman, Fourier Optics, 3.10) without the carrier and the shift, which are taken out
exactly. Glass of index n has w(q) = sqrt(n²/λ² - q²) and its own factor. H is sampled without aliasing up to
1 / (λ sqrt(1 + (2g/L)²)) per axis on a period L (K. Matsushima, T. Shimobaba, Opt. Express 17, 19662, 2009); it is 0
beyond.

What the gap changes. A free wave's far field only changes in phase; the PSF changes because the stop cuts the wave
after the gap. By reciprocity the field at q is that of the openings under the stop moved by -λ g q, its edge blurred to
sqrt(λg). So the yardstick is λ g q / D and sqrt(λ g) / D, not the dot's Fresnel number a² / (λ g), which only tells
whether the shadow in the stop's plane still looks like the openings (above 1) or not (below).

Notes:
    Regimes: scalar light, thin opaque mask, openings wider than about a wavelength. PSFs are over even steps of sin θ,
    which :mod:`maskfab.optics.scene.lens` brings to places on the sensor. Without H (`shifted_pupil` alone) the gap is
    geometrical optics, with the error of :func:`maskfab.optics.gap.gap_error`.
    All functions but :func:`magnified` take the wave that meets the panel as plane: an object at infinity.
    A panel that ends inside the light that reaches the stop is taken as opaque beyond its edge.

The autocorrelation of the amplitude behind a stop takes a phase too:

    O(ν) = C(λdν) / C(0),    C(s) = ∫∫ a(r) a*(r + s) d²r                       (Goodman, Fourier Optics, 6.3)

is the transform of the point spread, exp(-2πi ν·x) its kernel. It is real only if the point spread is the same turned
by 180 degrees, as behind every mask that only dims.

Notes:
    Dots that the stop cuts enter with their mean amplitude, and lag 0 with all energy, as in
    :mod:`maskfab.optics.lags`, which knows their shapes too and no phase.

What a gap changes is also estimated, from the mean PSF over layouts.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import scipy
from numpy.typing import NDArray

from maskfab.base.arrays import Complexes, Floats, Mask, Singles, fast_length
from maskfab.base.errors import JobError
from maskfab.base.model import Psf, Scalar
from maskfab.base.units import UM_PER_NM
from maskfab.job.camera import Camera, Stop
from maskfab.job.process import Glass
from maskfab.optics.field.matrix import PreparedField, direct_field, fold, slim_term
from maskfab.optics.field.waves import point_sources
from maskfab.optics.lags import correlated, dot_blocks
from maskfab.optics.psf import image_scale_um2, odd_samples, point_step_um, psf_norm_um6
from maskfab.optics.pupil import Aperture, Lattice, Pupil, cut, share_inside
from maskfab.optics.stop import Waves, edge_points, perimeter_um, widest_um
from maskfab.optics.tiling_mean import MeanPsf, decorrelation_error

Place = tuple[float, float]

AXIS: Place = (0.0, 0.0)
MOST_GAP_SAMPLES = 64_000_000
"""As many samples as a propagated field may have."""

MOST_WAVES_PER_SAMPLE = 0.125
"""Largest change of a phase between samples in the stop's plane."""

_SAMPLES_PER_DOT = 4
# Of lengths at which complex transforms are fast.
_PRIMES = (2, 3, 5, 7, 11)


@dataclass(frozen=True, eq=False)
class StopField:
    """One line's amplitude behind the stop on a square of samples, the axis on the middle one.

    Attributes:
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
        distance_um: d, from lens to sensor; the focal length if None.

    Raises:
        JobError: MF104 for a gap that is negative or not finite.
    """
    if not (math.isfinite(gap_um) and gap_um >= 0):
        raise JobError("MF104", f"a gap of {gap_um:g} um is not a distance", cure="Give 0 um or more")
    distance = camera.focal_um if distance_um is None else distance_um
    return gap_um * image_um[0] / distance, gap_um * image_um[1] / distance


def moved_pupil(openings: Aperture, stop: Stop, moved_um: Place) -> Pupil:
    """Openings moved by (x, y) and cut by the stop, which stays in the middle; MF114 if they do not cover it."""
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
        what = f"an object {object_um:g} um from the stop is not in front of a panel {gap_um:g} um from it"
        raise JobError("MF104", what, cure="Move it beyond the panel")
    factor = 1 / (1 - gap_um / object_um)
    x, y = (
        replace(axis, start_um=factor * axis.start_um, dot_um=factor * axis.dot_um, pitch_um=factor * axis.pitch_um)
        for axis in (openings.x, openings.y)
    )
    return replace(openings, x=x, y=y), factor * gap_um


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
    glass: Glass | None = None,
) -> Psf:
    """Point PSF about an image point, the gap as shift and diffraction.

    The openings' exact spectrum up to half a cycle per sample is propagated, transformed to the stop's plane, cut by
    the stop (samples at its rim weighted with their share inside), and transformed to the sensor.

    Args:
        samples_per_dot: how finely the stop's plane is sampled; twice as many cut the error by about three.
        waves: phase in the stop's plane, the axis at its origin; none if None.
        distance_um: from lens to sensor; the focal length if None.
        glass: part of the gap; light on its way to the image walks as far over it as over ``gap_um`` of air in all.

    Raises:
        JobError: MF104 for a gap that is no distance, or a phase that is not finite; MF114 if the openings do not cover
            the stop from there; MF115 if the samples are so fine that waves are evanescent, or more than 64 million, or
            so coarse that the phase turns by more than an eighth of a wave from one to the next.
    """
    distance = camera.focal_um if distance_um is None else distance_um
    behind = stop_field(
        openings, camera, wavelength_nm, gap_um, image_um, samples_per_dot,
        waves=waves, distance_um=distance, glass=glass,
    )  # fmt: skip
    middle = behind.amplitude.shape[0]
    place = behind.sample_um * (np.arange(middle, dtype=np.float64) - middle // 2)
    step, scale = point_step_um(camera), image_scale_um2(camera, wavelength_nm, distance)
    reach = odd_samples(camera.window_um, step) // 2
    u = step * np.arange(-reach, reach + 1, dtype=np.float64) / scale
    kernel = behind.sample_um * np.exp(-2j * np.pi * u[:, None] * place)
    field = kernel @ behind.amplitude @ kernel.T
    return Psf(abs(field) ** 2 / psf_norm_um6(scale, behind.energy_um2), step, wavelength_nm, "point")


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
    glass: Glass | None = None,
) -> StopField:
    """The amplitude behind the stop of light on its way to an image point; arguments and errors as for
    :func:`gap_psf`.
    """
    distance = camera.focal_um if distance_um is None else distance_um
    moved = shift_um(camera, gap_um, image_um, distance)
    check_cover(openings, camera.stop, moved)
    sample, stop, spectrum, transfer = _spectra(
        openings, camera, wavelength_nm, gap_um, image_um, samples_per_dot, moved, distance, glass
    )
    before, after = (
        _middle(np.fft.ifft2(part), len(stop)) * (stop / sample**2) for part in (spectrum, spectrum * transfer)
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
        u: float64 [n] frequencies from 0 on along either axis at which the two are compared, cycles per micrometre;
            opposite ones count as well.

    Raises:
        JobError: MF115 as for :func:`gap_psf`.
    """
    # Openings are real, and on the axis opposite directions are alike: real transforms of half of them tell all.
    sample, stop, spectrum, transfer = _spectra(
        openings, camera, wavelength_nm, gap_um, AXIS, 1, AXIS, camera.focal_um, half=True
    )
    sources = point_sources(sample * np.arange(stop.shape[0] // 2 + 1, dtype=np.float64))

    def far(part: Complexes) -> tuple[Complexes, float]:
        """The field of light in the stop's plane, and its power; both on a scale of their own."""
        passing = _middle(np.fft.irfft2(part, (len(part), len(part))), len(stop))
        values = passing * stop
        term = slim_term(sources, sources, fold(values), "double")
        seen = PreparedField((term,), float(u[-1]), float(u[-1]), "double").field(u, u).amplitude()
        return seen, float(np.vdot(values, passing))

    (still, power), (real, of_real), (imaginary, of_imaginary) = map(
        far, (spectrum, spectrum * transfer.real, spectrum * transfer.imag)
    )
    plain = abs(still) ** 2 / power
    spread = abs(real + 1j * imaginary) ** 2 / (of_real + of_imaginary)
    return float(np.linalg.norm(spread - plain) / np.linalg.norm(plain))


def _spectra(
    openings: Aperture,
    camera: Camera,
    wavelength_nm: float,
    gap_um: float,
    image_um: Place,
    samples_per_dot: int,
    moved: Place,
    distance: float,
    glass: Glass | None = None,
    *,
    half: bool = False,
) -> tuple[float, Floats, Complexes, Complexes]:
    """Distance of samples, the stop on them, the openings' spectrum, and by what diffraction over the gap multiplies.

    Of both only the columns up to half a cycle per sample if ``half``.
    """
    wavelength, radius = wavelength_nm * UM_PER_NM, camera.stop.diameter_um / 2
    sample = openings.x.dot_um / samples_per_dot
    top = 0.5 / sample
    x, y = image_um
    length = wavelength * math.sqrt(distance**2 + x**2 + y**2)
    # Spatial frequency of the incoming wave in x and y, and its size.
    carrier = x / length, y / length, math.hypot(x, y) / length
    if wavelength * (top + carrier[2]) >= 1:
        raise JobError("MF115", f"samples of {sample:g} um resolve evanescent waves", cure="Ask for fewer per dot")
    guard = gap_guard_um(gap_um, wavelength_nm, sample)
    aperture = moved_aperture(openings, moved, radius + guard)
    extent = max(abs(edges).max() for edges in (aperture.x.edges_um(), aperture.y.edges_um()))
    dots = math.ceil((math.ceil((radius + extent + guard) / sample) + 4) / samples_per_dot)
    count = samples_per_dot * fast_length(dots, _PRIMES)
    if count**2 > MOST_GAP_SAMPLES:
        raise JobError("MF115", f"the gap needs {count} x {count} samples", cure="Ask for fewer per dot")
    stop = _sampled_stop(camera.stop, sample)
    columns = count // 2 + 1 if half else count
    spectrum = _spectrum(aperture, samples_per_dot, count, columns)
    return sample, stop, spectrum, _transfer(wavelength, carrier, gap_um, sample, count, glass, columns)


def gap_guard_um(gap_um: float, wavelength_nm: float, sample_um: float) -> float:
    """Sideways reach over a gap of the finest waves that samples hold; infinite if evanescent."""
    slope = wavelength_nm * UM_PER_NM / (2 * sample_um)
    return gap_um * slope / math.sqrt(1 - slope**2) if slope < 1 else math.inf


def check_cover(openings: Aperture, stop: Stop, moved_um: Place) -> None:
    """Refuse openings that, moved by (x, y), no longer cover the stop. Raises JobError MF114."""
    radius = stop.diameter_um / 2
    ends = [_ends_um(lattice) for lattice in (openings.x, openings.y)]
    missing = max(
        max(low + moved + radius, radius - high - moved) for (low, high), moved in zip(ends, moved_um, strict=True)
    )
    if missing > 1e-6:
        width, height = (high - low for low, high in ends)
        what = (
            f"moved by {math.hypot(*moved_um):.1f} um, openings of {width:g} um x {height:g} um leave {missing:.1f} um "
            f"of the stop of {stop.diameter_um:g} um uncovered"
        )
        raise JobError("MF114", what, cure="Make the panel larger, the gap shorter, or the field angle smaller")


def _ends_um(lattice: Lattice) -> Place:
    """Where the cells of a lattice begin and end, half a gutter beyond their dots."""
    edges, strip = lattice.edges_um(), (lattice.pitch_um - lattice.dots * lattice.dot_um) / 2
    return float(edges[0]) - strip, float(edges[-1]) + strip


def _centred(lattice: Lattice) -> Lattice:
    return replace(lattice, start_um=-lattice.length_um / 2)


def _intervals(whole: Lattice, part: Lattice) -> slice:
    """Where the intervals of some of a lattice's cells stand among all of them."""
    first = round((part.start_um - whole.start_um) / whole.pitch_um) * whole.period
    return slice(first, first + part.edges_um().size - 1)


def _spectrum(aperture: Aperture, samples_per_dot: int, count: int, columns: int) -> Complexes:
    """Exact Fourier coefficients of the openings on a period of whole dots and so many samples, FFT order, [v, u], the
    first columns of them."""
    x, y = aperture.x, aperture.y
    frequency = np.asarray(np.fft.fftfreq(count, x.dot_um / samples_per_dot), dtype=np.float64)
    if not (x.has_gutter or y.has_gutter) and x.dot_um == y.dot_um:
        size = count // samples_per_dot
        repeated: Complexes = np.fft.rfft2(_folded(aperture.transmission, size))
        if columns > repeated.shape[1]:
            # Of real openings opposite frequencies are conjugate.
            mirrored = repeated[-np.arange(size) % size, (size - 1) // 2 : 0 : -1]
            whole = np.concatenate([repeated, mirrored.conj()], axis=1)
            repeated = np.tile(whole, (samples_per_dot, samples_per_dot))[:, :columns]
        across, up = (
            axis.dot_um
            * np.sinc(axis.dot_um * frequency)
            * np.exp(-2j * np.pi * (axis.start_um + axis.dot_um / 2) * frequency)
            for axis in (x, y)
        )
        if columns < count and count % 2 == 0:
            up[count // 2] = up[count // 2].real  # half a cycle per sample is its own opposite
        repeated *= up[:, None]
        repeated *= across[:columns]
        return repeated
    everywhere = Stop("square", math.inf)
    openings = Pupil.of_whole_dots(aperture.x, aperture.y, aperture.transmission, everywhere)
    return direct_field(openings, frequency[:columns], frequency)


def _folded(values: Floats, size: int) -> Floats:
    """Sums over a period of so many rows and columns; openings may be wider than it by cells that do not matter."""
    rows, columns = (-(-n // size) for n in values.shape)
    padded = np.zeros((rows * size, columns * size))
    padded[: values.shape[0], : values.shape[1]] = values
    return np.asarray(padded.reshape(rows, size, columns, size).sum(axis=(0, 2)))


def _transfer(
    wavelength: float,
    carrier: tuple[float, float, float],
    gap_um: float,
    sample: float,
    count: int,
    glass: Glass | None,
    columns: int | None = None,
) -> Complexes:
    """H at the frequencies of :func:`_spectrum`, in all columns if None."""
    across, up, size = carrier
    q = np.asarray(np.fft.fftfreq(count, sample), dtype=np.float64)
    place = np.arange(count)
    if size == 0:
        # On the axis opposite frequencies are alike.
        q, place = q[: count // 2 + 1], np.minimum(place, count - place)
    limit = 1 / (wavelength * math.sqrt(1 + (2 * gap_um / (sample * count)) ** 2))
    u, v = q[None, :], q[:, None]
    layers = [(gap_um, 1.0)]
    if glass is not None:
        slope = wavelength * size / math.sqrt(1 - (wavelength * size) ** 2)
        layers = [(gap_um - glass_as_air_um(glass, slope), 1.0), (glass.thickness_um, glass.index)]
    path = np.zeros((q.size, q.size))
    for thickness, index in layers:
        straight = math.sqrt((index / wavelength) ** 2 - size**2)
        along = np.sqrt(np.clip((index / wavelength) ** 2 - (u + across) ** 2 - (v + up) ** 2, 0, None))
        path += thickness * (along - straight + (u * across + v * up) / straight)
    found = np.where((abs(u) <= limit) & (abs(v) <= limit), np.exp(2j * np.pi * path), 0.0)
    return found[np.ix_(place, place[:columns])] if size == 0 else found[:, :columns]


def glass_as_air_um(glass: Glass, slope: float) -> float:
    """The air over which light of that tan θ walks as far sideways as through glass, by Snell's law.

    Glass of index n and thickness b counts as b / sqrt(n² + (n² - 1) tan² θ): b / n on the axis.
    """
    return glass.thickness_um / math.sqrt(glass.index**2 + (glass.index**2 - 1) * slope**2)


def _sampled_stop(stop: Stop, sample: float) -> Floats:
    """Share of every sample's square that lies inside the stop, [n, n], n odd, the axis on the middle sample."""
    count = 2 * math.ceil(stop.diameter_um / 2 / sample) + 1
    lattice = Lattice(-count * sample / 2, count, 1, sample, sample)
    ones = np.ones((count, count))
    return cut(Aperture(lattice, lattice, ones, np.zeros_like(ones)), stop).mean_transmission


def _middle(field: NDArray[Scalar], count: int) -> NDArray[Scalar]:
    """So many samples about the axis, which is on the first one."""
    sides = slice(-(count // 2), None), slice(count - count // 2)
    return np.block([[field[rows, columns] for columns in sides] for rows in sides])


def turned(waves: Waves, x_um: Floats, y_um: Floats, inside: Mask) -> Complexes:
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
        what = f"the phase turns by {steepest:.2g} waves from one sample to the next"
        raise JobError("MF115", what, cure="Ask for more samples per dot or a weaker wavefront")
    return np.where(inside, np.exp(2j * np.pi * phase), 0.0)


def _power(cut_field: Complexes, stop: Floats) -> float:
    """Sum of |amplitude|² over samples, those at the rim counted with their share."""
    share = np.where(stop > 0, stop, 1.0)
    return float(((cut_field.real**2 + cut_field.imag**2) / share).sum())


Table = Singles | NDArray[np.complex64]
Amplitudes = Floats | NDArray[np.complex64]


def stop_amplitude(openings: Aperture, stop: Stop, waves: Waves | None = None) -> tuple[Amplitudes, float]:
    """Openings cut by a centred stop, with a phase that is constant over each dot, as in its middle.

    Returns:
        The amplitude, float64, or complex64 with a phase, [cells y, dots y, cells x, dots x], the mean over each dot;
        and the integral of its squared modulus, in square micrometres.

    Raises:
        JobError: MF104 for a phase that is not finite; MF115 where it turns by more than an eighth of a wave from one
            dot to the next.
    """
    x, y = openings.x, openings.y
    share = share_inside(x, y, stop)
    energy = np.diff(y.edges_um()) @ ((openings.transmission**2 + openings.variance) * share)
    dots: Amplitudes = dot_blocks(x, y, openings.transmission * share)
    if waves is not None:
        inside = dot_blocks(x, y, share) > 0
        flat = inside.reshape(inside.shape[0] * inside.shape[1], -1)
        turn = turned(waves, _middles(x), _middles(y), flat)
        dots = (dots * turn.reshape(dots.shape)).astype(np.complex64)
    return dots, float(energy @ np.diff(x.edges_um()))


@dataclass(frozen=True, eq=False)
class AmplitudeLags:
    """C(s) / C(0) at every cell lag and dot lag.

    Attributes:
        sizes: lags of cells and dots, along y and along x.
        table: float32, or complex64 with a phase, [lags y, lags x], negative ones wrapped round; lag 0 first.
    """

    x: Lattice
    y: Lattice
    sizes: tuple[tuple[int, int], tuple[int, int]]
    table: Table

    @classmethod
    def of(cls, x: Lattice, y: Lattice, dots: Amplitudes, energy_um2: float) -> AmplitudeLags:
        """Lags by FFT over cells and dots at once, of what :func:`stop_amplitude` gives on those lattices."""
        sizes = [fast_length(2 * n - 1, _PRIMES) if n > 1 else 1 for n in dots.shape]
        scale = x.dot_um * y.dot_um / energy_um2
        if dots.dtype == np.complex64:
            table: Table = _from_power(_amplitude_power(dots, sizes))
            table *= np.float32(scale)
        else:
            rows = np.asarray(dots, dtype=np.float64).reshape(-1, *dots.shape[2:])
            table = (scale * correlated(rows.__getitem__, dots.shape[:2], sizes, sizes)[0]).astype(np.float32)
        table = table.reshape(sizes[0] * sizes[1], sizes[2] * sizes[3])
        table[0, 0] = 1
        return cls(x, y, ((sizes[0], sizes[1]), (sizes[2], sizes[3])), table)

    @classmethod
    def across_gap(cls, field: StopField) -> AmplitudeLags:
        """The change by diffraction over a gap: C with it less C without, over C(0) with it.

        A free wave keeps its autocorrelation, so the change is small and smooth where both parts are neither: samples
        tell it far better than either.
        """
        count, sample = field.amplitude.shape[0], field.sample_um
        size = fast_length(2 * count - 1, _PRIMES)
        lattice = Lattice(-count * sample / 2, count, 1, sample, sample)
        power = _amplitude_power(field.amplitude, [size, size])
        power -= _amplitude_power(field.shadow, [size, size])
        table = _from_power(power)
        table *= np.float32(sample**2 / field.energy_um2)
        table[0, 0] = 1 - field.shadow_um2 / field.energy_um2
        return cls(lattice, lattice, ((size, 1), (size, 1)), table)


def _amplitude_power(amplitude: NDArray[Any], sizes: list[int]) -> Singles:
    spectrum = scipy.fft.fftn(amplitude.astype(np.complex64, copy=False), sizes, workers=1)
    power = spectrum.real**2
    power += spectrum.imag**2
    return np.asarray(power)


def _from_power(power: Singles) -> NDArray[np.complex64]:
    """The inverse transform of |A|² is the sum of a*(r) a(r + s); the forward one is that of the opposite lag."""
    return np.asarray(scipy.fft.fftn(power, norm="forward", workers=1))


def _middles(lattice: Lattice) -> Floats:
    edges, index = lattice.edges_um(), lattice.dot_index().ravel()
    return np.asarray((edges[index] + edges[index + 1]) / 2)


_RIM_POINTS = 2048
_STRIP_LAYERS = 8
_DIRECTIONS = 24


def common_share(stop: Stop, distance_um: Floats | float, gap_um: float = 0.0, wavelength_nm: float = 0.0) -> Floats:
    r"""Correlation of the clear stop with itself, moved by a distance and seen across a gap.

    For short distances a round stop of diameter D has 1 - 4 s / (πD) in common with itself. Across a gap s is averaged
    with Fresnel's kernel, a Gaussian of complex width σ² = iλg/2π, which gives the mean of Rice's distribution,

        ⟨s⟩ = sqrt(λg)/2 e^{iπ/4} e^{iη} [(1 - 2iη) J0(η) - 2η J1(η)],   η = π s² / (2λg).

    Other stops, whose overlap is direction-dependent, are treated as the round one of the same perimeter-to-area ratio;
    for a square that is the one of the same D.
    """
    moved = np.asarray(distance_um, dtype=np.float64)
    span = wavelength_nm * UM_PER_NM * gap_um
    if span > 0:
        eta = np.pi * moved**2 / (2 * span)
        rice = np.exp(1j * eta) * ((1 - 2j * eta) * scipy.special.j0(eta) - 2 * eta * scipy.special.j1(eta))
        mean: Complexes = np.sqrt(span) / 2 * np.exp(0.25j * np.pi) * rice
    else:
        mean = moved.astype(np.complex128)
    return np.asarray(np.clip(abs(1 - mean * (perimeter_um(stop) / (np.pi * stop.area_um2))), 0, 1))


def rim_crowding(openings: Aperture, inside: Pupil, distance_um: float) -> float:
    """Ratio of the clear area that a stop trades when it moves by a distance to that of even openings, at least 1.

    The clear area of the strips along the rim that the stop loses on one side and gains on the other, over their whole
    area times the open share of the stop; the worst of many directions. Cells that are few or sparse stand on the rim
    as it happens: a strip then holds several times its share of the light, or none.

    Args:
        openings: as far as the stop reaches, and that distance beyond.
    """
    stop, clear_um2 = inside.stop, inside.field_integral_um2
    if not clear_um2:
        return 1.0
    place, outward, length = edge_points(stop, _RIM_POINTS)
    angle = 2 * np.pi * np.arange(_DIRECTIONS) / _DIRECTIONS
    across = outward @ np.stack([np.cos(angle), np.sin(angle)])
    layer = distance_um / _STRIP_LAYERS
    traded = np.zeros(_DIRECTIONS)
    for k in range(_STRIP_LAYERS):
        # The strip is as deep as the move along the rim's normal: of its last layer it holds a part.
        held = layer * np.clip(_STRIP_LAYERS * abs(across) - k, 0, 1)
        for side in (1, -1):
            clear = _seen(openings, place + side * (k + 0.5) * layer * outward)
            traded += (clear * length) @ (held * (side * across > 0))
    even = clear_um2 / stop.area_um2 * distance_um * (length @ abs(across))
    return max(1.0, float((traded / even).max()))


def _seen(openings: Aperture, place: Floats) -> Floats:
    """Transmission at points [..., 2]; 0 beyond the openings."""
    index = []
    inside = np.ones(place.shape[:-1], dtype=np.bool_)
    for axis, lattice in enumerate((openings.x, openings.y)):
        edges = lattice.edges_um()
        interval = np.searchsorted(edges, place[..., axis], side="right") - 1
        inside &= (interval >= 0) & (interval < edges.size - 1)
        index.append(np.clip(interval, 0, edges.size - 2))
    return np.where(inside, openings.transmission[index[1], index[0]], 0.0)


def shift_error(mean: MeanPsf, camera: Camera, gap_um: float, image_um: Place) -> float:
    """Estimated relative L2 error of the PSF if the openings' shift is left out, over the mean's window.

    For random tilings: the cells that the stop no longer shares are new. It saturates where no cell is shared. For an
    opening that looks alike in all orientations the variance, hence this, is 0.

    Notes:
        Measured at stops of 300 to 600 um, gaps up to 1 mm: the truth is 0.15 to 2.2 times the estimate. It is less
        where the shift is much shorter than the pitch, because the strip that is new is then not independent of the
        cell it belongs to; it is more for dense openings, because the repeating part changes too. Where a factor of
        three decides, compute the PSF of :func:`maskfab.optics.gap.shifted_pupil`.
    """
    moved = math.hypot(*shift_um(camera, gap_um, image_um))
    if camera.stop.shape == "circle":
        s = min(moved / camera.stop.diameter_um, 1.0)
        share = 2 / math.pi * (math.acos(s) - s * math.sqrt(1 - s**2))
    elif camera.stop.shape in ("square", "rectangle"):
        width, height = camera.stop.sides_um
        across, up = shift_um(camera, gap_um, image_um)
        share = max(0.0, 1 - abs(across) / width) * max(0.0, 1 - abs(up) / height)
    else:
        share = max(0.0, 1 - moved * widest_um(camera.stop) / camera.stop.area_um2)
    return decorrelation_error(mean.variance, mean.psf.values, share)


def share_across_gap(psf: Psf, camera: Camera, gap_um: float) -> Floats:
    """:func:`common_share` of the stop with where the light of each of a PSF's samples leaves the openings, [n, n]."""
    count = psf.values.shape[0]
    across = gap_um / camera.focal_um * psf.step_um * np.arange(count // 2 + 1, dtype=np.float64)
    quadrant = common_share(camera.stop, np.hypot(across[:, None], across), gap_um, psf.wavelength_nm)
    place = abs(np.arange(count) - count // 2)
    return quadrant[np.ix_(place, place)]


def gap_error(mean: MeanPsf, share: Floats) -> float:
    """Estimated relative L2 error of the PSF if diffraction over the gap is left out, over the mean's window.

    Light of spatial frequency q crosses the gap at the slope λq and so meets a stop that is moved by λ g q, blurred by
    sqrt(λg); the share of openings that enter or leave is new speckle. The notes of
    :func:`shift_error` hold here too, and the truth may be down to 0.05 of the estimate for openings that are large
    against sqrt(λg): a bound to rule the gap out with, not a measure of it.
    """
    return decorrelation_error(mean.variance, mean.psf.values, share)
