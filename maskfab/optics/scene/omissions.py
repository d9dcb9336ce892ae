r"""Effects that a scene could ask of the optics, with the error of omitting each.

Every estimate is the relative L2 error of the point PSF over the camera's window, at the worst of the camera's
shortest and longest lines, times a safety factor by which the truth was seen to exceed the plain estimate. They are
made from PSFs at infinity and mean PSFs (:mod:`maskfab.optics.tiling_mean`), not from the models that
they judge. Short moves of the openings are tried: a PSF at infinity behind moved ones is cheap.

Notes:
    Shifts and diffraction change the repeating part of a PSF too, which the ensemble's variance does not hold. A share
    1 - ρ of the stop's openings is new, more where they crowd its rim, so orders change by twice that share of their
    amplitude at most.
    Only cells drawn one by one have a closed mean. Of other layouts all that does not repeat from cell to cell is taken
    for random, which is too much where it repeats on larger cells, and never too little.
    The residues of cut dots add up in phase near the axis, where light is: taken as random they come out up to six
    times too small. So the grey rim is tried, which costs one cheap PSF; its safety is for the lines between.
    An even phase changes the orders of an even pupil to second order only. A periodic panel is not even where the stop
    cuts its cells, a share pitch / D of it, and that share changes to first order. Nor is a pupil that carries another
    even phase: leaving one of two out is of first order in the product of both.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cache

import numpy as np

from maskfab.base.arrays import Floats
from maskfab.base.model import ORIENTATIONS, Panel, Psf, Tiling
from maskfab.base.units import UM_PER_NM
from maskfab.job.camera import Camera, Stop
from maskfab.optics.field.methods import PATHS, field
from maskfab.optics.gap import (
    AXIS,
    Place,
    gap_error,
    rim_crowding,
    share_across_gap,
    shift_error,
    shift_um,
    shifted_pupil,
)
from maskfab.optics.metrics import relative_difference
from maskfab.optics.phase import (
    Wavefront,
    aberration_error,
    clear_stop_strehl,
    defocus_error,
    edge_defocus_waves,
    marechal_strehl,
    noll_degrees,
    scale_error,
)
from maskfab.optics.psf import ReadyPupil, image_scale_um2, odd_samples, point_step_um
from maskfab.optics.pupil import Aperture, Pupil, cut, panel_aperture
from maskfab.optics.scene.lens import SensorWindow
from maskfab.optics.scene.scene import Scene
from maskfab.optics.spectrum import band_errors
from maskfab.optics.stop import stop_strehl, widest_um
from maskfab.optics.tiling_mean import MeanPsf, layout_psf, mean_psf

# How much lower than the truth the plain estimates were seen to come out, and more: 2.2 for shifts and gaps; for phases
# 1.6 on the layouts of their own notes, 2.2 over eighty others of a few dozen cells, where one layout is not the mean.
GAP_SAFETY = 2.2
PHASE_SAFETY = 3.0
SCALE_SAFETY = 1.25
RIM_SAFETY = 1.2
OBLIQUE_SAFETY = 1.5
ORDER_SAFETY = 2.0

# Of moves that were tried at the edge of the field, and from places of a grid to what borrows their PSFs: directions
# and places between those tried were seen to change up to 1.14 and 1.52 times as much.
MOVED_SAFETY = 1.5
BETWEEN_SAFETY = 2.0
# Moves beyond that share of a pitch may change less than shorter ones, and of a PSF one sample of so many is tried.
_TRIED_PITCHES, _TRIED_EVERY = 0.25, 2
# Numbers of places along an axis that are tried; of half the move, twice as many leave its root, or less.
_TRIED_PLACES = (3, 9)

PLACES = (1, 3, 5, 9, 17, 33)
"""Places along each axis of the field; with the most of them, a PSF is computed where it is asked for."""


@dataclass(frozen=True)
class Estimate:
    """The error of leaving one thing out.

    Attributes:
        error: relative L2 of the PSF, safety included.
        safety: factor in ``error``; 1 where the estimate is exact.
    """

    error: float
    method: str
    safety: float = 1.0


NOTHING = Estimate(0.0, "the scene has none")


@dataclass(frozen=True)
class Estimates:
    """The errors of all omissions.

    Attributes:
        scale, defocus, aberrations, oblique, shift, diffraction, rim, layout: see :func:`estimate`; the layout's is
            None where nothing else asks for the mean over layouts.
        pilot: the PSF at infinity at the shortest wavelength.
        places: what is left when every image point borrows the PSF of the nearest of n x n places, by n.
        bands: the error of replacing each band by so many lines, by their number; 1 line first.
        in_bands: how many bands there are; 0 for the camera's lines.
        crowding: of openings at the stop's rim (:func:`maskfab.optics.gap.rim_crowding`), as far as
            diffraction over the gap blurs it; 1 without a gap.
    """

    scale: Estimate
    defocus: Estimate
    aberrations: Estimate
    oblique: Estimate
    shift: Estimate
    diffraction: Estimate
    rim: Estimate
    layout: Estimate | None
    pilot: Psf
    places: Mapping[int, float]
    bands: Mapping[int, float]
    in_bands: int
    crowding: float
    range_nm: tuple[float, float]


def wavelength_range_nm(camera: Camera, scene: Scene) -> tuple[float, float]:
    """Shortest and longest wavelength: of the camera's lines, or of the bands."""
    ranges = [band.range_nm for band in scene.bands]
    if not ranges:
        return min(camera.wavelengths_nm), max(camera.wavelengths_nm)
    return min(low for low, _ in ranges), max(high for _, high in ranges)


def elements(panel: Panel) -> tuple[int, ...]:
    """Entries of ``Panel.orientations`` among which the cells of a panel are drawn."""
    if panel.tiling is Tiling.RANDOM:
        return tuple(range(ORIENTATIONS * len(panel.openings)))
    return tuple(int(k) for k in np.unique(panel.orientations))


def _mean(panel: Panel, camera: Camera, pilot: Psf) -> MeanPsf:
    """The mean PSF of the layouts that could have been drawn, as far as one layout's own PSF tells it where cells are
    not drawn one by one; a panel of which nothing is drawn is its own mean."""
    if panel.tiling.independent:
        return mean_psf(panel, camera, pilot.wavelength_nm, elements(panel))
    if panel.tiling.seeded or panel.others:
        return layout_psf(panel, pilot, camera)
    nothing = np.zeros_like(pilot.values)
    return MeanPsf(pilot, nothing, nothing)


def estimate(panel: Panel, pupil: Pupil, camera: Camera, scene: Scene) -> Estimates:
    """The errors of leaving out everything that a scene could ask for.

    They do not depend on the accuracy that is asked for, so that a plan never costs more where it may err more.

    Args:
        pupil: its openings inside the stop, the rim exact.

    Raises:
        JobError: MF104 for a distance within the focal length, a gap that is no distance or a wrong aberration.
    """
    ends = wavelength_range_nm(camera, scene)
    sampled = replace(camera, wavelengths_nm=tuple(dict.fromkeys(ends)))
    pilots = ReadyPupil.of(pupil, sampled).psfs()
    # Only what is weighed against speckle needs the mean over layouts, which costs several PSFs.
    phase = scene.aberrations or not scene.nearest_um == scene.farthest_um == scene.focus_um
    # A tilted panel lies in front of the stop and behind it: its rim, where that tells, by 2/π of the most in the mean.
    gap_um = scene.gap_um + abs(math.sin(scene.tilt_rad)) * camera.stop.diameter_um / math.pi
    asks = gap_um or phase
    means = [_mean(panel, sampled, pilot) for pilot in pilots] if asks else []
    moved = math.hypot(*shift_um(camera, scene.gap_um, (scene.widest_um, 0.0)))

    @cache
    def openings() -> Aperture:
        return panel_aperture(panel, camera.stop.diameter_um / 2 + moved + panel.cell_size.pitch_um)

    lens_moves = abs(scene.steepest_um - scene.field_um)
    turned = _shift(means, openings(), pupil, sampled, scene, lens_moves).error if moved and lens_moves else 0.0
    blur = math.sqrt(UM_PER_NM * max(ends) * gap_um)
    shift = NOTHING
    places: Mapping[int, float] = {PLACES[0]: 0.0}
    if moved:
        shift = _shift(means, openings(), pupil, sampled, scene, scene.widest_um)
        places = {n: _between(means, openings(), pupil, sampled, scene, n) for n in PLACES}
        if not phase and blur <= pupil.x.dot_um:
            shift, places = _tried(openings(), sampled, scene, panel.cell_size.pitch_um, shift, places)
    crowding = rim_crowding(openings(), pupil, blur) if blur else 1.0
    uneven = panel.cell_size.pitch_um / camera.stop.diameter_um if not panel.tiling.independent else 0.0
    return Estimates(
        scale=_scale(pilots, sampled, scene),
        defocus=_defocus(means, sampled, scene, min(1.0, uneven + _lens_share(sampled, scene.wavefront(camera)))),
        aberrations=_aberrations(
            means, sampled, scene.wavefront(camera), min(1.0, uneven + _defocus_share(sampled, scene))
        ),
        oblique=_oblique(panel, pupil, pilots, sampled, scene, turned),
        shift=shift,
        diffraction=_diffraction(means, crowding, sampled, gap_um) if gap_um else NOTHING,
        rim=_rim(pupil, pilots, sampled),
        layout=_layout(means) if means else None,
        pilot=pilots[0],
        places=places,
        bands=band_errors(pupil, camera, scene.bands) or {0: 0.0},
        in_bands=len(scene.bands),
        crowding=crowding,
        range_nm=ends,
    )


def grey(pupil: Pupil) -> Pupil:
    """The pupil with cut dots replaced by whole ones of their mean transmission; its energy is kept."""
    plain = Pupil.of_whole_dots(pupil.x, pupil.y, pupil.mean_transmission, pupil.stop)
    return replace(plain, whole_variance=pupil.variance)


def _scale(pilots: list[Psf], camera: Camera, scene: Scene) -> Estimate:
    if math.isinf(scene.focus_um):
        return Estimate(0.0, "in focus at infinity")
    worst = max(scale_error(pilot, camera, scene.focus_um) for pilot in pilots)
    return Estimate(SCALE_SAFETY * worst, "stretch sensitivity of the PSF at infinity", SCALE_SAFETY)


def _defocus(means: list[MeanPsf], camera: Camera, scene: Scene, uneven: float) -> Estimate:
    if scene.nearest_um == scene.farthest_um == scene.focus_um:
        return NOTHING
    worst = max(
        math.hypot(
            defocus_error(camera, mean.psf.wavelength_nm, distance, scene.focus_um, mean),
            uneven * defocus_error(camera, mean.psf.wavelength_nm, distance, scene.focus_um),
        )
        for mean in means
        for distance in (scene.nearest_um, scene.farthest_um)
    )
    method = "Strehl ratio of the defocus on the mean PSF, worse end of the depth range"
    return Estimate(PHASE_SAFETY * worst, method, PHASE_SAFETY)


def _lens_share(camera: Camera, wavefront: Wavefront) -> float:
    """The share of a clear pupil that even aberrations turn out of phase, sqrt(1 - Strehl), at the worst line."""
    even = replace(wavefront, terms=tuple(term for term in wavefront.terms if noll_degrees(term[0])[0] % 2 == 0))
    strehls = [
        marechal_strehl(even.rms_waves(line)) if camera.stop.shape == "circle" else _strehl(even, camera.stop, line)
        for line in camera.wavelengths_nm
    ]
    return math.sqrt(1 - min(strehls))


def _defocus_share(camera: Camera, scene: Scene) -> float:
    """The share that defocus turns out of phase, at the worse end of the depth range."""
    edges = [
        edge_defocus_waves(camera, line, distance, scene.focus_um)
        for line in camera.wavelengths_nm
        for distance in (scene.nearest_um, scene.farthest_um)
    ]
    return math.sqrt(1 - min(clear_stop_strehl(edge) for edge in edges))


def _aberrations(means: list[MeanPsf], camera: Camera, wavefront: Wavefront, uneven: float) -> Estimate:
    if not any(wave for term, wave in wavefront.terms if term > 1):
        return NOTHING
    if camera.stop.shape != "circle":
        # The polynomials belong to a circle: Marechal does not see the corners of a square, where they grow.
        strehls = [_strehl(wavefront, camera.stop, mean.psf.wavelength_nm) for mean in means]
        worst = max(math.sqrt(1 - strehl) for strehl in strehls)
        return Estimate(PHASE_SAFETY * worst, f"Strehl ratio over the {camera.stop.shape}, any tiling", PHASE_SAFETY)
    worst = max(
        math.hypot(
            aberration_error(wavefront, mean.psf.wavelength_nm, mean),
            uneven * aberration_error(wavefront, mean.psf.wavelength_nm),
        )
        for mean in means
    )
    return Estimate(PHASE_SAFETY * worst, "Marechal's Strehl ratio on the mean PSF", PHASE_SAFETY)


def _oblique(panel: Panel, pupil: Pupil, pilots: list[Psf], camera: Camera, scene: Scene, turned: float) -> Estimate:
    """The PSF where its light lands; ``turned`` is the error of the light's other angle, which moves the openings."""
    reach, part = scene.field_um, scene.field_um / math.sqrt(2)
    if not reach and not scene.tilt_rad:
        return NOTHING
    lens, step = scene.lens(camera), point_step_um(camera)
    worst, half = 0.0, odd_samples(camera.window_um, step) // 2
    # A tilted panel's footprint is a stop of the same kind along x alone.
    for place in ((reach, 0.0), (-reach, 0.0), AXIS) if scene.tilt_rad else ((reach, 0.0), (part, part), AXIS):
        stop = lens.footprint(camera.stop, lens.slopes_at(place), 0.0).stop
        seen = cut(panel_aperture(panel, stop.diameter_um / 2), stop) if scene.tilt_rad else pupil
        window = SensorWindow.about(lens, place, step, half)
        landed = (window.of(psf, step) for psf in ReadyPupil.of(seen, window.camera(camera, stop)).psfs())
        worst = max(worst, *map(relative_difference, pilots, landed))
    method = "PSF at infinity as it lands at the largest image height"
    return Estimate(math.hypot(OBLIQUE_SAFETY * worst, turned), method, OBLIQUE_SAFETY)


def _strehl(wavefront: Wavefront, stop: Stop, wavelength_nm: float) -> float:
    return stop_strehl(stop, wavefront.waves(stop, wavelength_nm))


def _shift(
    means: list[MeanPsf], openings: Aperture, pupil: Pupil, camera: Camera, scene: Scene, image_um: float
) -> Estimate:
    """The openings' shadow moved as for an image point that far from the axis, in the worse of two directions."""
    diagonal = image_um / math.sqrt(2)
    stated = max(
        shift_error(mean, camera, scene.gap_um, place)
        for mean in means
        for place in ((image_um, 0.0), (diagonal, diagonal))
    )
    moved = shift_um(camera, scene.gap_um, (image_um, 0.0))[0]
    lost = min(1.0, rim_crowding(openings, pupil, moved) * moved * widest_um(camera.stop) / camera.stop.area_um2)
    ordered = max(_order_change(mean, np.asarray(lost)) for mean in means)
    method = "share of the stop's openings that are new, speckle and orders"
    return Estimate(math.hypot(GAP_SAFETY * stated, ordered), method, GAP_SAFETY)


def _tried(
    openings: Aperture, camera: Camera, scene: Scene, pitch_um: float, shift: Estimate, places: Mapping[int, float]
) -> tuple[Estimate, Mapping[int, float]]:
    """Estimates of moves, less where PSFs that were moved tell less.

    A short move changes a PSF in proportion to it, one over many dots with its root. So at half of a move that was
    tried there is no more than the root of a half of its change. Openings that move against a phase change it more:
    what is tried holds without one, and where the gap blurs openings by less than a dot.
    """
    reach, moved = scene.widest_um, shift_um(camera, scene.gap_um, (scene.widest_um, 0.0))[0]

    @cache
    def seen(place: Place) -> tuple[Floats, ...]:
        pupil = shifted_pupil(openings, camera.stop, shift_um(camera, scene.gap_um, place))
        step = point_step_um(camera)
        across = step * np.arange(0, odd_samples(camera.window_um, step) // 2 + 1, _TRIED_EVERY, dtype=np.float64)
        lines = [across / image_scale_um2(camera, line) for line in camera.wavelengths_nm]
        return tuple(np.asarray(field(pupil, u, u).intensity() / pupil.energy_um2, dtype=np.float64) for u in lines)

    def change(at: Place, instead: Place) -> float:
        pairs = zip(seen(at), seen(instead), strict=True)
        return max(float(np.linalg.norm(borrowed - own) / np.linalg.norm(own)) for own, borrowed in pairs)

    part = reach / math.sqrt(2)
    edge = [(reach, 0.0), (part, part), (0.0, reach), (-part, part)]
    if moved <= _TRIED_PITCHES * pitch_um:
        whole = max(change((sign * x, sign * y), AXIS) for x, y in edge for sign in (1, -1))
        if MOVED_SAFETY * whole < shift.error:
            method = "PSF at infinity moved to the edge of the field, eight directions"
            shift = Estimate(MOVED_SAFETY * whole, method, MOVED_SAFETY)
    finer, between = {}, math.inf
    for count, error in places.items():
        between /= math.sqrt(2)
        if count in _TRIED_PLACES and math.sqrt(2) * moved / (count - 1) <= _TRIED_PITCHES * pitch_um:
            away = reach / (count - 1)
            steps = [(away, away), (away, -away)]
            nodes = itertools.product((AXIS, *edge[:3]), steps)
            between = max(change((node[0] - step[0], node[1] - step[1]), node) for node, step in nodes)
        finer[count] = min(error, BETWEEN_SAFETY * between)
    return shift, finer


def _diffraction(means: list[MeanPsf], crowding: float, camera: Camera, gap_um: float) -> Estimate:
    errors = []
    for mean in means:
        share = share_across_gap(mean.psf, camera, gap_um)
        lost = np.minimum(1.0, crowding * (1 - share))
        errors.append(math.hypot(GAP_SAFETY * gap_error(mean, share), _order_change(mean, lost)))
    method = "stop seen across the gap, moved by its diffraction angles and blurred by sqrt(λg)"
    return Estimate(max(errors), method, GAP_SAFETY)


def _order_change(mean: MeanPsf, lost: Floats) -> float:
    """Change of the repeating part where a share of the openings is new: twice that share of its intensity."""
    ordered = np.clip(mean.psf.values - mean.random_share, 0, None)
    return float(ORDER_SAFETY * np.linalg.norm(2 * lost * ordered) / np.linalg.norm(mean.psf.values))


def _between(
    means: list[MeanPsf], openings: Aperture, pupil: Pupil, camera: Camera, scene: Scene, places: int
) -> float:
    """Error half a diagonal away from the nearest of n x n places; the axis alone is the shift's own row."""
    if places in (PLACES[0], PLACES[-1]):
        return 0.0
    return _shift(means, openings, pupil, camera, scene, math.sqrt(2) * scene.widest_um / (places - 1)).error


def _layout(means: list[MeanPsf]) -> Estimate:
    scatter = max(mean.scatter for mean in means)
    return Estimate(GAP_SAFETY / 2 * scatter, "scatter of layouts about the ensemble's mean", GAP_SAFETY / 2)


def _rim(pupil: Pupil, pilots: list[Psf], camera: Camera) -> Estimate:
    if not pupil.rim_row.size:
        return Estimate(0.0, "the stop cuts no dot")
    plain = grey(pupil)
    own = max(path.error["double"] for path in PATHS)
    worst = max(map(relative_difference, ReadyPupil.of(plain, camera).psfs(), pilots)) + own
    return Estimate(RIM_SAFETY * worst, "grey rim's PSF against the exact one, at the ends of the spectrum", RIM_SAFETY)
