"""A plan carried out: point PSFs of a scene by the path, the precision and the ingredients of the planner's choice.

All of them lie on the samples that the plan states, whatever the wavelength, so that they can be summed and compared.

Over the field there are PSFs behind a gap as shifts, tangential and sagittal cuts, and deblurring. The optics' transfer
is the transform of the point PSF (Goodman, Fourier Optics, 6.3),

    O(ν) = s² Σ_n I(x_n) exp(-2πi ν·x_n),

whose samples, s apart, are finer than its bandwidth asks for; times the pixel's own it is the presampled MTF. I holds
all light over all space, so |O| is exact but for the light outside the window.

Notes:
    What lies outside the window can add to |O| or take from it no more than its energy.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import replace

import numpy as np
import scipy

from maskfab.base.arrays import Floats
from maskfab.base.errors import InternalError, JobError
from maskfab.base.model import Psf
from maskfab.base.units import UM_PER_NM
from maskfab.job.camera import Camera
from maskfab.optics.field.methods import PATHS, FieldPath, FieldTask, Prepared, admissible
from maskfab.optics.gap import AXIS, Place, gap_psf, magnified, moved_pupil, shifted_pupil
from maskfab.optics.phase import image_distance_um, phased, phased_psf, window_frequency
from maskfab.optics.psf import image_scale_um2, odd_samples, point_step_um, psf_norm_um6
from maskfab.optics.pupil import Aperture
from maskfab.optics.scene.lens import Lens, SensorWindow
from maskfab.optics.scene.omissions import PLACES, grey
from maskfab.optics.scene.plan import (
    DEPTHS,
    PHASED,
    SPECTRUM,
    Choice,
    Plan,
    SceneCost,
    full_tolerance,
    phase_waves,
    sampling_camera,
)
from maskfab.optics.scene.scene import Scene
from maskfab.optics.spectrum import Band, band_lines
from maskfab.optics.stop import Waves

_FULL_LINES = 32


def scene_psf(
    openings: Aperture,
    camera: Camera,
    scene: Scene,
    plan: Plan,
    wavelength_nm: float,
    *,
    image_um: Place = AXIS,
    object_um: float | None = None,
    margin: int = 0,
) -> Psf:
    """Point PSF of a scene as its plan models it.

    Args:
        openings: everything clear in front of the stop: a panel's aperture, or what was read back.
        wavelength_nm: the line, not shorter than the plan's shortest, whose samples it shares.
        image_um: where the image lies on the sensor; it borrows the PSF of the nearest of the plan's places.
        object_um: distance of the object, within the scene's depth; in focus if None.
        margin: points beyond the window.

    Raises:
        JobError: MF104 for an image point outside the field, an object outside the depth or a line shorter than the
            plan's; MF114 if the openings do not cover the stop from there; MF115 if the choice takes more than one job
            may, which a plan rules out for the panel that it was made for.
    """
    seen = _psfs(openings, camera, scene, plan, [wavelength_nm], image_um=image_um, object_um=object_um, margin=margin)
    return next(seen)


def spectrum_psf(
    openings: Aperture,
    camera: Camera,
    scene: Scene,
    plan: Plan,
    light: Band | float,
    *,
    image_um: Place = AXIS,
    object_um: float | None = None,
    margin: int = 0,
) -> Psf:
    """Point PSF of a band: that of the plan's lines, each with its share of the detected energy.

    Args:
        light: one of the scene's bands, or a single line's wavelength in nanometres.

    Returns:
        The PSF; its ``wavelength_nm`` is the band's mean by energy.

    Raises:
        JobError: as for :func:`scene_psf`; MF104 for a band where the plan is one of lines.
    """
    if not isinstance(light, Band):
        return scene_psf(
            openings, camera, scene, plan, light, image_um=image_um, object_um=object_um, margin=margin
        )  # fmt: skip
    if not plan.choice.lines:
        what = f"the plan has no lines for the band {light.name}"
        raise JobError("MF104", what, cure="Give the scene the bands before planning")
    spectrum = band_lines(light, plan.choice.lines)
    wavelengths = [float(line) for line in spectrum.wavelengths_nm]
    seen = _psfs(openings, camera, scene, plan, wavelengths, image_um=image_um, object_um=object_um, margin=margin)
    first = next(seen)
    total = spectrum.weights[0] * first.values
    for weight, psf in zip(spectrum.weights[1:], seen, strict=True):
        total += weight * psf.values
    return Psf(total, first.step_um, float(band_lines(light, 1).wavelengths_nm[0]), first.kind)


def full_plan(plan: Plan) -> Plan:
    """The plan with the fullest choice that can be computed, to measure what the cheapest leaves out.

    It is not priced: flops, seconds, bytes and error are NaN, and it has no ingredients.
    """
    choice = plan.fullest
    if choice.lines:
        # The most that were priced were held against twice as many.
        choice = replace(choice, lines=max(2 * choice.lines, _FULL_LINES))
    return replace(
        plan,
        choice=choice,
        price=SceneCost(math.nan, math.nan, math.nan, math.nan),
        ingredients=(),
        wavelengths=plan.wavelengths // max(plan.choice.lines, 1) * max(choice.lines, 1),
        depths=DEPTHS if choice.defocus else 1,
        phase_tolerance=full_tolerance(plan.accuracy) if choice.path == PHASED else 0.0,
    )


def nearest_place(choice: Choice, scene: Scene, image_um: Place) -> Place:
    """The image point whose PSF a choice computes for another: the nearest node of its grid over the field.

    The grid has ``places`` nodes along each axis, from minus to plus the largest image height, under f tan θ where the
    choice tells that from the lens's own; one is the axis, and the most that are priced stand for every point itself.
    """
    if choice.places == PLACES[-1] or scene.tilt_rad:
        return image_um
    if choice.places == PLACES[0] or not scene.widest_um:
        return AXIS
    spacing = 2 * scene.widest_um / (choice.places - 1)
    x, y = (spacing * math.floor(abs(at) / spacing + 0.5) * math.copysign(1, at) for at in image_um)
    return x, y


def _psfs(
    openings: Aperture, camera: Camera, scene: Scene, plan: Plan, wavelengths_nm: Sequence[float], *,
    image_um: Place, object_um: float | None, margin: int,
) -> Iterator[Psf]:  # fmt: skip
    """PSFs at lines on the plan's samples, where their light lands if that is modelled."""
    sampled = sampling_camera(camera, scene)
    _check(sampled, scene, plan, min(wavelengths_nm), image_um, object_um)
    step, choice = point_step_um(sampled), plan.choice
    half = odd_samples(camera.window_um, step) // 2 + margin
    distance = image_distance_um(camera.focal_um, scene.focus_um if choice.scale else math.inf)
    lens = scene.lens(camera, distance) if choice.oblique else Lens(camera.focal_um, distance)
    sx, sy = lens.slopes_at(image_um)
    place = nearest_place(choice, scene, (distance * sx, distance * sy))
    slopes = place[0] / distance, place[1] / distance
    openings, gap_um = magnified(openings, scene.gap_um, modelled_distance_um(choice, scene, object_um))
    gap_um, glass = scene.seen(math.hypot(*slopes), gap_um)
    seen = lens.footprint(camera.stop, slopes, gap_um)

    def waves(line: float) -> Waves | None:
        stated = phase_waves(choice, camera, scene, line, object_um)
        return stated and seen.waves(stated)

    def even(sampled: Camera) -> Iterator[Psf]:
        """Over even samples of direction cosines about the place's, the pupil made ready once."""
        if choice.path == SPECTRUM:
            for line in wavelengths_nm:
                yield gap_psf(
                    openings, sampled, line, gap_um, place, choice.samples_per_dot,
                    waves=waves(line), distance_um=distance, glass=glass,
                )  # fmt: skip
            return
        fine = point_step_um(sampled)
        reach = fine * np.arange(odd_samples(sampled.window_um, fine) // 2 + 1, dtype=np.float64)
        if choice.path == PHASED:
            pupil = moved_pupil(openings, seen.stop, seen.moved_um)
            for line in wavelengths_nm:
                highest = float(reach[-1]) / (line * UM_PER_NM * distance)
                highest = max(highest, window_frequency(sampled, line, distance))
                source = phased(pupil, waves(line) or _flat, highest, plan.phase_tolerance)
                yield phased_psf(source, sampled, line, distance_um=distance)
            return
        exact = shifted_pupil(openings, seen.stop, seen.moved_um)
        pupil = grey(exact) if choice.grey_rim else exact
        widest = float(reach[-1]) / (min(wavelengths_nm) * UM_PER_NM * distance)
        ready: dict[str, Prepared] = {}
        for line in wavelengths_nm:
            scale = image_scale_um2(camera, line, distance)
            frequency = reach / scale
            path = _path(choice, FieldTask.of(pupil, frequency, frequency))
            if path.name not in ready:
                ready[path.name] = path.prepare(pupil, widest, widest, choice.precision)
            intensity = np.asarray(ready[path.name].field(frequency, frequency).intensity(), dtype=np.float64)
            yield Psf(intensity / psf_norm_um6(scale, pupil.energy_um2), fine, line, "point")

    if not choice.oblique:
        yield from even(replace(sampled, window_um=(2 * half + 1) * step))
        return
    window = SensorWindow.about(lens, image_um, step, half)
    for psf in even(window.camera(sampled, seen.stop)):
        yield window.of(psf, step)


def _path(choice: Choice, task: FieldTask) -> FieldPath:
    """The choice's path; if it refuses what was read back, the cheapest of its precision for the same field."""
    (chosen,) = (path for path in PATHS if path.name == choice.path)
    if chosen.refusal(task) is None:
        return chosen
    return next(path for path in admissible(task) if choice.precision in path.precisions)


def modelled_distance_um(choice: Choice, scene: Scene, object_um: float | None) -> float:
    """Distance of the object for a choice: its own if defocus is modelled, else the focus distance if that is."""
    if choice.defocus and object_um is not None:
        return object_um
    return scene.focus_um if choice.scale else math.inf


def _flat(x_um: Floats, y_um: Floats) -> Floats:
    return np.zeros(np.broadcast(x_um, y_um).shape)


def _check(
    sampled: Camera, scene: Scene, plan: Plan, shortest_nm: float, image_um: Place, object_um: float | None
) -> None:
    if not math.isclose(point_step_um(sampled), plan.step_um, rel_tol=1e-9):
        what = f"a plan with samples of {plan.step_um:g} um, this camera's are {point_step_um(sampled):g} um"
        raise InternalError("MF901", what)
    if shortest_nm < min(sampled.wavelengths_nm) * (1 - 1e-9):
        what = f"{shortest_nm:g} nm is shorter than the {min(sampled.wavelengths_nm):g} nm that set the plan's samples"
        raise JobError("MF104", what, cure="Plan for a camera or bands that reach it")
    height = math.hypot(*image_um)
    if not height <= scene.field_um * (1 + 1e-9):
        what = f"an image height of {height:g} um is outside the scene's field of {scene.field_um:g} um"
        raise JobError("MF104", what, where="scene.field", cure="Make the field larger, or ask for a place within")
    if object_um not in (None, scene.focus_um) and not scene.nearest_um <= object_um <= scene.farthest_um:
        what = (
            f"an object at {object_um:g} um is outside the scene's depth, {scene.nearest_um:g} to "
            f"{scene.farthest_um:g} um"
        )
        raise JobError("MF104", what, where="scene.depth", cure="Make the depth larger, or ask for a distance within")


def field_places(reach_um: float, points: int = 5) -> tuple[tuple[Place, ...], ...]:
    """Image points on a square grid from -reach to reach, [y][x]; odd ``points`` have one on the axis."""
    across = np.linspace(-reach_um, reach_um, points)
    return tuple(tuple((float(x), float(y)) for x in across) for y in across)


def residual_blur(psf: Psf, centre: Psf, noise_to_signal: float) -> Floats:
    """Residue of a PSF after Wiener deblurring with another: its samples' share of the energy, float64 [n, n].

    Both are normalised to sum 1, as a camera's own calibration would have it.
    """
    sizes = [scipy.fft.next_fast_len(2 * n, real=True) for n in psf.values.shape]
    seen, assumed = (scipy.fft.rfft2(image.values / image.values.sum(), sizes) for image in (psf, centre))
    restored = scipy.fft.irfft2(seen * assumed.conj() / (abs(assumed) ** 2 + noise_to_signal), sizes)
    half = [n // 2 for n in psf.values.shape]
    rolled: Floats = np.roll(restored, half, axis=(0, 1))[: psf.values.shape[0], : psf.values.shape[1]]
    return rolled


def deblurring_residual(psf: Psf, centre: Psf, noise_to_signal: float) -> float:
    """Relative L2 distance of a residual blur from the one that the centre PSF itself would have left."""
    own = residual_blur(centre, centre, noise_to_signal)
    return float(np.linalg.norm(residual_blur(psf, centre, noise_to_signal) - own) / np.linalg.norm(own))


def restored_error(psf: Psf, known: Psf, noise_to_signal: float, light: float = 1.0) -> float:
    """Mean squared error of pictures that one PSF blurs and the Wiener filter for another restores, over their power.

    With H the transfer of either, K of the known one, pictures of the power S = (0.1 / f)², f in cycles per pixel, and
    noise of ε at all f, the filter G = K* S / (|K|² S + ε) leaves S |1 - G H|² + ε |G|² / light.

    Args:
        psf, known: on pixels, of one shape; both are normalised to sum 1.
        noise_to_signal: ε, of power at 0.1 cycles per pixel.
        light: at the place by that on the axis; a picture that is made even again has so much more noise of photons.
    """
    count = psf.values.shape[0]
    square = np.hypot(scipy.fft.fftfreq(count)[:, None], scipy.fft.fftfreq(count)) ** 2
    power = np.divide(0.01, square, out=np.zeros_like(square), where=square > 0)
    seen, assumed = (scipy.fft.fft2(image.values / image.values.sum(), workers=1) for image in (psf, known))
    restored = assumed.conj() * power / (abs(assumed) ** 2 * power + noise_to_signal)
    error = power * abs(1 - restored * seen) ** 2 + noise_to_signal / light * abs(restored) ** 2
    return float(error.sum() / power.sum())


def tangential_cut(frequency: Floats, azimuth_rad: float) -> tuple[Floats, Floats]:
    """ν_x and ν_y of the tangential MTF of an image point at an azimuth (from the x axis, counter-clockwise).

    Its lines are tangents to circles about the optical axis, so its frequencies run along the radius (ISO 9334).
    """
    return frequency * math.cos(azimuth_rad), frequency * math.sin(azimuth_rad)


def sagittal_cut(frequency: Floats, azimuth_rad: float) -> tuple[Floats, Floats]:
    """ν_x and ν_y of the sagittal MTF: its lines run along the radius, its frequencies across it (ISO 9334)."""
    return -frequency * math.sin(azimuth_rad), frequency * math.cos(azimuth_rad)


def window_modulation(psf: Psf, nu_x: Floats, nu_y: Floats) -> tuple[Floats, float]:
    """|O| of a point PSF about the middle of its window, and the bound on its absolute error by the light outside.

    Args:
        psf: at points; that on pixels is sampled too coarsely.
        nu_x, nu_y: float64 [n], cycles per micrometre.

    Returns:
        Values, float64 [n], and the share of the energy outside the window.
    """
    count = psf.values.shape[0]
    place = psf.step_um * (np.arange(count, dtype=np.float64) - count // 2)
    along_x, along_y = (np.exp(-2j * np.pi * np.outer(nu, place)) for nu in (nu_x, nu_y))
    transform = np.einsum("nj,ji,ni->n", along_y, psf.values, along_x, optimize=True)
    return psf.step_um**2 * abs(transform), max(0.0, 1 - psf.energy_in_window)
