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
    gap is geometrical optics, with the error of :func:`gap_error`.
    A panel that ends inside the light that reaches the stop is taken as opaque beyond its edge.
"""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray
from scipy import fft
from scipy.special import jv

from maskfab.errors import JobError
from maskfab.model import Camera, Panel, Psf, Stop
from maskfab.optics.aperture import Aperture, Lattice, panel_aperture
from maskfab.optics.ensemble import MeanPsf, decorrelation_error
from maskfab.optics.field import direct_field
from maskfab.optics.psf import image_scale_um2, odd_samples, point_psf, point_step_um
from maskfab.optics.pupil import Pupil, cut

Floats = NDArray[np.float64]
Complexes = NDArray[np.complex128]
Place = tuple[float, float]

AXIS: Place = (0.0, 0.0)
_SAMPLES_PER_DOT = 4


def shift_um(camera: Camera, gap_um: float, image_um: Place) -> Place:
    """How far the openings' shadow moves in the stop's plane for an image point, g (x, y) / f.

    Raises:
        JobError: MF104 for a gap that is negative or not finite.
    """
    if not (math.isfinite(gap_um) and gap_um >= 0):
        raise JobError("MF104", f"a gap of {gap_um:g} um is no distance", cure="Give 0 um or more")
    return gap_um * image_um[0] / camera.focal_um, gap_um * image_um[1] / camera.focal_um


def shifted_pupil(panel: Panel, stop: Stop, moved_um: Place) -> Pupil:
    """Openings moved by (x, y) and cut by the stop.

    The lattices that come back are centred: shifting a pupil as a whole only turns the field's phase, and the parity
    split wants symmetry. ``stop`` is therefore off centre in them; intensities are right, phases lack that factor.

    Raises:
        JobError: MF114 if the moved panel no longer covers the stop.
    """
    aperture = moved_aperture(panel, moved_um, stop.diameter_um / 2)
    _check_cover(panel, stop, moved_um)
    pupil = cut(aperture, stop)
    return replace(pupil, x=_centred(pupil.x), y=_centred(pupil.y))


def moved_aperture(panel: Panel, moved_um: Place, half_width_um: float) -> Aperture:
    """The cells of a panel moved by (x, y) that meet a square of that half width."""
    whole = panel_aperture(panel)
    x, y = (
        replace(lattice, start_um=lattice.start_um + moved)
        for lattice, moved in ((whole.x, moved_um[0]), (whole.y, moved_um[1]))
    )
    near_x, near_y = x.trimmed(half_width_um), y.trimmed(half_width_um)
    columns, rows = (_intervals(a, b) for a, b in ((x, near_x), (y, near_y)))
    return Aperture(near_x, near_y, whole.transmission[rows, columns], whole.variance[rows, columns])


def shifted_psf(panel: Panel, camera: Camera, wavelength_nm: float, gap_um: float, image_um: Place = AXIS) -> Psf:
    """Point PSF about an image point, the gap as a shift of the openings only.

    Raises:
        JobError: MF104 for a gap that is no distance, MF114 if the panel does not cover the stop from there.
    """
    return point_psf(shifted_pupil(panel, camera.stop, shift_um(camera, gap_um, image_um)), camera, wavelength_nm)


def gap_psf(
    panel: Panel,
    camera: Camera,
    wavelength_nm: float,
    gap_um: float,
    image_um: Place = AXIS,
    samples_per_dot: int = _SAMPLES_PER_DOT,
) -> Psf:
    """Point PSF about an image point, the gap as shift and diffraction.

    The openings' exact spectrum up to half a cycle per sample is propagated, transformed to the stop's plane, cut by
    the stop (samples at its rim weighted with their share inside), and transformed to the sensor.

    Args:
        panel: what stands in front of the stop.
        camera: lens, stop and window.
        wavelength_nm: the line.
        gap_um: from panel to stop.
        image_um: where the image of the source lies on the sensor.
        samples_per_dot: how finely the stop's plane is sampled; twice as many cut the error by about three.

    Raises:
        JobError: MF104 for a gap that is no distance, MF114 if the panel does not cover the stop from there, MF115 if
            the samples are so fine that waves are evanescent, or more than 64 million.
    """
    moved = shift_um(camera, gap_um, image_um)
    _check_cover(panel, camera.stop, moved)
    wavelength = wavelength_nm * 1e-3
    sample = panel.dot_nm / 1e3 / samples_per_dot
    top = 0.5 / sample
    if wavelength * (top + _carrier(camera, wavelength, image_um)[2]) >= 1:
        raise JobError("MF115", f"samples of {sample:g} um resolve evanescent waves", cure="Ask for fewer per dot")
    radius = camera.stop.diameter_um / 2
    guard = gap_um * wavelength * top / math.sqrt(1 - (wavelength * top) ** 2)
    aperture = moved_aperture(panel, moved, radius + guard)
    extent = max(abs(edges).max() for edges in (aperture.x.edges_um(), aperture.y.edges_um()))
    count = fft.next_fast_len(math.ceil((radius + extent + guard) / sample) + 4)
    if count**2 > 64_000_000:
        raise JobError("MF115", f"the gap needs {count} x {count} samples", cure="Ask for fewer per dot")
    stop = _sampled_stop(camera.stop, sample)
    spectrum, transfer = (
        _spectrum(aperture, sample, count),
        _transfer(camera, wavelength, gap_um, image_um, sample, count),
    )
    middle = stop.shape[0]
    before, after = (_in_stop_plane(part, sample, middle) * stop for part in (spectrum, spectrum * transfer))
    step, scale = point_step_um(camera), image_scale_um2(camera, wavelength_nm)
    reach = odd_samples(camera.window_um, step) // 2
    u = step * np.arange(-reach, reach + 1, dtype=np.float64) / scale
    place = sample * (np.arange(middle, dtype=np.float64) - middle // 2)
    kernel = sample * np.exp(-2j * np.pi * u[:, None] * place)
    field = kernel @ after @ kernel.T
    energy = cut(aperture, camera.stop).energy_um2 + sample**2 * (_power(after, stop) - _power(before, stop))
    return Psf(abs(field) ** 2 / (scale**2 * energy), step, wavelength_nm, "point")


def field_places(reach_um: float, points: int = 5) -> tuple[tuple[Place, ...], ...]:
    """Image points on a square grid from -reach to reach, [y][x]; odd ``points`` have one on the axis."""
    across = np.linspace(-reach_um, reach_um, points)
    return tuple(tuple((float(x), float(y)) for x in across) for y in across)


def psf_over_field(
    panel: Panel, camera: Camera, wavelength_nm: float, gap_um: float, places: tuple[tuple[Place, ...], ...]
) -> tuple[tuple[Psf, ...], ...]:
    """Point PSFs at image points, the gap as a shift; in the order of ``places``.

    Raises:
        JobError: MF104 for a gap that is no distance, MF114 if the panel does not cover the stop from every point.
    """
    return tuple(tuple(shifted_psf(panel, camera, wavelength_nm, gap_um, place) for place in row) for row in places)


def residual_blur(psf: Psf, centre: Psf, noise_to_signal: float) -> Floats:
    """What is left of a PSF after Wiener deblurring with another: its samples' share of the energy, float64 [n, n].

    Both are normalised to sum 1, as a camera's own calibration would have it.
    """
    sizes = [fft.next_fast_len(2 * n, real=True) for n in psf.values.shape]
    seen, assumed = (fft.rfft2(each.values / each.values.sum(), sizes) for each in (psf, centre))
    restored = fft.irfft2(seen * assumed.conj() / (abs(assumed) ** 2 + noise_to_signal), sizes)
    half = [n // 2 for n in psf.values.shape]
    rolled: Floats = np.roll(restored, half, axis=(0, 1))[: psf.values.shape[0], : psf.values.shape[1]]
    return rolled


def deblurring_residual(psf: Psf, centre: Psf, noise_to_signal: float) -> float:
    """Relative L2 distance of a residual blur from the one that the centre PSF itself would have left."""
    own = residual_blur(centre, centre, noise_to_signal)
    return float(np.linalg.norm(residual_blur(psf, centre, noise_to_signal) - own) / np.linalg.norm(own))


def fresnel_number(width_um: float, gap_um: float, wavelength_nm: float) -> float:
    """(width/2)² / (λ g); far above 1 such an opening casts a sharp shadow over the gap, far below 1 a spread one."""
    return math.inf if gap_um == 0 else (width_um / 2) ** 2 / (wavelength_nm * 1e-3 * gap_um)


def common_share(stop: Stop, distance_um: Floats | float, gap_um: float = 0.0, wavelength_nm: float = 0.0) -> Floats:
    r"""Correlation of the clear stop with itself, moved by a distance and seen across a gap.

    For short distances a round stop of diameter D has 1 - 4 s / (πD) in common with itself. Across a gap s is averaged
    with Fresnel's kernel, a Gaussian of complex width σ² = iλg/2π, which gives the mean of Rice's distribution,

        ⟨s⟩ = sqrt(λg)/2 e^{iπ/4} e^{iη} [(1 - 2iη) J0(η) - 2η J1(η)],   η = π s² / (2λg).

    A square stop, whose overlap is direction-dependent, is treated as the round one of the same perimeter-to-area
    ratio, which is the one of the same D.
    """
    moved = np.asarray(distance_um, dtype=np.float64)
    span = wavelength_nm * 1e-3 * gap_um
    if span > 0:
        eta = np.pi * moved**2 / (2 * span)
        rice = np.exp(1j * eta) * ((1 - 2j * eta) * jv(0, eta) - 2 * eta * jv(1, eta))
        mean: NDArray[np.complex128] = np.sqrt(span) / 2 * np.exp(0.25j * np.pi) * rice
    else:
        mean = moved.astype(np.complex128)
    return np.asarray(np.clip(abs(1 - 4 * mean / (np.pi * stop.diameter_um)), 0, 1))


def shift_error(mean: MeanPsf, camera: Camera, gap_um: float, image_um: Place) -> float:
    """Estimated relative L2 error of the PSF if the openings' shift is left out, over the mean's window.

    For random tilings: the cells that the stop no longer shares are new. It saturates where no cell is shared. For an
    opening that looks alike in all orientations the variance, hence this, is 0.

    Notes:
        Measured at stops of 300 to 600 um, gaps up to 1 mm: the truth is 0.15 to 2.2 times the estimate. It is less
        where the shift is much shorter than the pitch, because the strip that is new is then not independent of the
        cell it belongs to; it is more for dense openings, because the repeating part changes too. Where a factor of
        three decides, compute :func:`shifted_psf`: it costs one PSF.
    """
    moved = math.hypot(*shift_um(camera, gap_um, image_um))
    if camera.stop.shape == "circle":
        s = min(moved / camera.stop.diameter_um, 1.0)
        share = 2 / math.pi * (math.acos(s) - s * math.sqrt(1 - s**2))
    else:
        across, up = shift_um(camera, gap_um, image_um)
        side = camera.stop.diameter_um
        share = max(0.0, 1 - abs(across) / side) * max(0.0, 1 - abs(up) / side)
    return decorrelation_error(mean.variance, mean.psf.values, share)


def gap_error(mean: MeanPsf, camera: Camera, gap_um: float) -> float:
    """Estimated relative L2 error of the PSF if diffraction over the gap is left out, over the mean's window.

    Light of spatial frequency q crosses the gap at the slope λq and so meets a stop that is moved by λ g q, blurred by
    sqrt(λg); the share of openings that enter or leave is new speckle. The notes of
    :func:`shift_error` hold here too, and the truth may be down to 0.05 of the estimate for openings that are large
    against sqrt(λg): a bound to rule the gap out with, not a measure of it.
    """
    count = mean.psf.values.shape[0]
    offset = mean.psf.step_um * (np.arange(count, dtype=np.float64) - count // 2)
    moved = gap_um / camera.focal_um * np.hypot(offset[:, None], offset)
    share = common_share(camera.stop, moved, gap_um, mean.psf.wavelength_nm)
    return decorrelation_error(mean.variance, mean.psf.values, share)


def _check_cover(panel: Panel, stop: Stop, moved_um: Place) -> None:
    width, height = (side / 1e3 for side in panel.size_nm)
    missing = max(
        stop.diameter_um / 2 + abs(moved_um[0]) - width / 2, stop.diameter_um / 2 + abs(moved_um[1]) - height / 2
    )
    if missing > 1e-6:
        raise JobError(
            "MF114",
            f"moved by {math.hypot(*moved_um):.1f} um, a panel of {width:g} um x {height:g} um leaves {missing:.1f} um "
            f"of the stop of {stop.diameter_um:g} um uncovered",
            cure="Make the panel larger, the gap shorter, or the field angle smaller",
        )


def _centred(lattice: Lattice) -> Lattice:
    length = (lattice.cells - 1) * lattice.pitch_um + lattice.dots * lattice.dot_um
    return replace(lattice, start_um=-length / 2)


def _intervals(whole: Lattice, part: Lattice) -> slice:
    """Where the intervals of some of a lattice's cells stand among all of them."""
    first = round((part.start_um - whole.start_um) / whole.pitch_um) * whole.period
    return slice(first, first + part.edges_um().size - 1)


def _carrier(camera: Camera, wavelength: float, image_um: Place) -> tuple[float, float, float]:
    """Spatial frequency of the incoming wave in x and y, and its size, cycles per micrometre."""
    x, y = image_um
    length = wavelength * math.sqrt(camera.focal_um**2 + x**2 + y**2)
    return x / length, y / length, math.hypot(x, y) / length


def _spectrum(aperture: Aperture, sample: float, count: int) -> Complexes:
    """Exact Fourier coefficients of the openings on a period of count samples, in FFT order, [v, u]."""
    frequency = np.asarray(fft.fftfreq(count, sample), dtype=np.float64)
    everywhere = Stop("square", math.inf)
    whole = Pupil.of_whole_dots(aperture.x, aperture.y, aperture.transmission, everywhere)
    return direct_field(whole, frequency, frequency)


def _transfer(
    camera: Camera, wavelength: float, gap_um: float, image_um: Place, sample: float, count: int
) -> Complexes:
    """H at the frequencies of :func:`_spectrum`."""
    across, up, size = _carrier(camera, wavelength, image_um)
    q = np.asarray(fft.fftfreq(count, sample), dtype=np.float64)
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
    field: Complexes = np.roll(fft.ifft2(spectrum), (middle // 2, middle // 2), axis=(0, 1))[:middle, :middle]
    return field / sample**2


def _power(cut_field: Complexes, stop: Floats) -> float:
    """Sum of |amplitude|² over samples, those at the rim counted with their share."""
    share = np.where(stop > 0, stop, 1.0)
    return float(((cut_field.real**2 + cut_field.imag**2) / share).sum())
