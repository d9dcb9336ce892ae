"""The planner: the cheapest model of a scene that meets an accuracy, what it leaves out, and what it costs.

Every way to model the scene is a :class:`maskfab.optics.scene.plan.Choice`. Its error is the sum of the estimates
(:mod:`maskfab.optics.scene.omissions`) of all that it leaves out and of its own numerical error; its time is its
flops over a rate of matrix products. There are a few thousand choices, so all of them are priced and none is passed
over.

Notes:
    Rates are those of one thread, see ``RATES``. The planner's own pilot PSFs are not counted.
    No function takes a grey rim together with a phase or with diffraction over the gap, which see the rim through
    moments or samples of their own, so there is no such choice.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from math import log2
from types import MappingProxyType

import numpy as np

from maskfab.base.arrays import Floats
from maskfab.base.errors import JobError
from maskfab.base.model import Panel
from maskfab.base.quantities import columns
from maskfab.base.units import NM_PER_UM, UM_PER_NM
from maskfab.job.camera import Camera
from maskfab.job.values import MOST_FIELD_DEG
from maskfab.optics.field.methods import PATHS, STRUCTURE, FieldPath, FieldTask, Work
from maskfab.optics.field.waves import Precision
from maskfab.optics.gap import AXIS, MOST_GAP_SAMPLES, MOST_WAVES_PER_SAMPLE, gap_guard_um, moved_pupil, shift_um
from maskfab.optics.phase import defocus_waves, image_distance_um, nearest_object_um, phased_flops
from maskfab.optics.psf import odd_samples, pixel_margin, point_step_um
from maskfab.optics.pupil import Pupil, cut, panel_aperture
from maskfab.optics.scene.lens import RESAMPLED, SensorWindow
from maskfab.optics.scene.model_bar import ASSUMED_FILM_UM
from maskfab.optics.scene.omissions import GAP_SAFETY, Estimate, Estimates, estimate, grey, wavelength_range_nm
from maskfab.optics.scene.probe import phased_error, single_error
from maskfab.optics.scene.scene import Scene
from maskfab.optics.spectrum import BAND_SAFETY, band_lines
from maskfab.optics.stop import Waves, perimeter_um

RATES: Mapping[Precision, float] = MappingProxyType({"double": 43e9, "single": 92e9})
"""Flops a second of one thread's matrix products, measured on the machine of the reference numbers."""

PHASED = "phased"
SPECTRUM = "angular spectrum"

GAP_SAMPLES = (1, 2, 4, 8, 16, 32)
"""Numbers of samples per dot that a field over a gap may have."""

# Samples err where the stop cuts them, hence by its edge's share of the area, one sample wide, and by how openings
# crowd it; an even field has no such error, so by its unevenness. Edges that follow the dots meet theirs and err in
# step. The most seen was 1.4 and 4.3 times that, in stops of 0.16 to 1.5 mm, dots of 8 to 160 um, gaps of 0.05 to 1 mm,
# openings of 3 to 60 %, against samples of 1 um.
_GAP_EDGE_ROUND, _GAP_EDGE_STRAIGHT = 2.0, 6.0
_LEAST_UNEVENNESS = 0.05

# Samples must resolve the window's frequencies so many times over: at 1.1 the error was twice that at 2.3.
_GAP_RESOLVED = 2.0

# What a phase adds to it by waves per sample, measured on openings whose edges fall on the stop's rim, where it is
# largest; samples at the rim count with their share, and no more can err than they hold.
_GAP_RIM = 0.3

# Share of a dot that the film's walls may shade.
_MOST_WALLS = 0.1

DEPTHS = 2
"""Distances that stand for a range of depths: its ends."""

# Besides the field paths' own work, in flops of a product: of a pupil, itself, a dot, one more for grey ones, and a cut
# dot; of a PSF, itself, a sample, and one that is brought to where its light lands; over a gap, a flop of a Fourier
# transform, which moves more data than a product's, a sample, and one's phase.
_CUT, _DOT, _GREY_DOT, _RIM_DOT = 3.2e7, 120.0, 300.0, 6.5e4
_PSF, _PSF_SAMPLE, _LANDED = 1e7, 120.0, 4e4
_TRANSFORM_FLOP, _GAP_SAMPLE, _TURN = 9.0, 1300.0, 1300.0
# Waves that leave at more than 64 degrees are beyond the model; with the carrier, near to evanescent.
_MOST_SLOPE = 0.9

PHASE_SHARE = 0.01
"""Tolerance of a phased field, as a share of the accuracy."""

_FULL_TOLERANCE = 1e-6
# Defocus down to so many halves of a range's ends, for degrees that no end takes.
_HALVINGS = 7

_PATHS: Mapping[str, FieldPath] = MappingProxyType({path.name: path for path in PATHS})


@dataclass(frozen=True)
class Choice:
    """One way to model a scene.

    Attributes:
        path: a field path's name, ``phased`` or ``angular spectrum``.
        grey_rim: whether cut dots are taken as whole ones of their mean transmission.
        places: along each axis of the field; 1 takes the axis's PSF everywhere.
        lines: for each band; 0 for the camera's own lines.
        samples_per_dot: in the stop's plane, where diffraction is modelled; else 0.
        oblique: whether light lands where the lens images its direction, seen from the panel's own plane: the field's
            angle, projection, distortion and tilt. Else the window is samples of sin θ about its middle.
    """

    path: str
    precision: Precision
    grey_rim: bool
    scale: bool
    defocus: bool
    aberrations: bool
    diffraction: bool
    places: int
    lines: int
    samples_per_dot: int
    oblique: bool = False


@dataclass(frozen=True)
class SceneCost:
    """Cost of a choice: flops of matrix products, seconds at ``RATES``, bytes beyond the pupil's own, and its relative
    L2 error, that of what it leaves out included."""

    flops: float
    seconds: float
    memory: float
    error: float


@dataclass(frozen=True)
class Ingredient:
    """A row of the plan.

    Attributes:
        error: estimated relative L2 error of the PSF without it; of what is left of it in ``remaining`` if modelled.
        remaining: what counts towards the plan's error: ``error`` if left out, else what modelling leaves.
    """

    name: str
    modelled: bool
    error: float
    method: str
    safety: float
    remaining: float


@dataclass(frozen=True, eq=False)
class CostModel:
    """The price of any choice for one panel, camera and scene.

    Attributes:
        tasks: by (grey rim, scale modelled, oblique).
        steepest: most waves that defocus and aberrations turn over a micrometre of the stop, at any line.
    """

    pupil: Pupil
    camera: Camera
    scene: Scene
    accuracy: float
    estimates: Estimates
    tasks: Mapping[tuple[bool, bool, bool], FieldTask]
    lines: int
    steepest: float

    def choices(self) -> Iterator[Choice]:
        """Every choice that can be computed, whatever its error."""
        estimates = self.estimates
        gap = _options(estimates.diffraction)
        options = itertools.product(
            (*(path.name for path in PATHS), PHASED, SPECTRUM),
            RATES,
            (False, True),
            _options(estimates.scale),
            _options(estimates.defocus),
            _options(estimates.aberrations),
            gap,
            (0, *GAP_SAMPLES) if any(gap) else (0,),
            # No other function knows of a tilt.
            (True,) if self.scene.tilt_rad else _options(estimates.oblique),
            estimates.places,
        )
        for path, precision, greyed, scale, defocus, aberrations, diffraction, samples, oblique, places in options:
            # Whether there is a function for it does not depend on how many lines it is called for.
            lines = min(estimates.bands)
            choice = Choice(
                path, precision, greyed, scale, defocus, aberrations, diffraction, places, lines, samples, oblique
            )
            if self.possible(choice):
                yield from (replace(choice, lines=lines) for lines in estimates.bands)

    def priced(self) -> Iterator[tuple[Choice, SceneCost]]:
        """Every choice that can be computed, with its price."""
        for _, alike in itertools.groupby(self.choices(), lambda one: replace(one, places=min(one.places, 2), lines=0)):
            first, *others = alike
            one = self._one(first)
            yield from ((choice, self._of_all(choice, *one)) for choice in (first, *others))

    def possible(self, choice: Choice) -> bool:
        """Whether there is a function for a choice, and it takes the pupil."""
        phase = choice.defocus or choice.aberrations
        if choice.diffraction != (choice.samples_per_dot > 0) or (choice.diffraction and self.scene.tilt_rad):
            return False
        if phase or choice.diffraction:
            wanted = SPECTRUM if choice.diffraction else PHASED
            fits = not choice.diffraction or self._gap_fits(choice)
            return choice.path == wanted and choice.precision == "double" and not choice.grey_rim and fits
        if choice.grey_rim and not self.pupil.rim_row.size:
            return False
        path, task = _PATHS.get(choice.path), self._task(choice)
        return path is not None and choice.precision in path.precisions and path.refusal(task) is None

    def price(self, choice: Choice) -> SceneCost:
        """Flops, time, memory and error of a possible choice."""
        return self._of_all(choice, *self._one(choice))

    def _of_all(self, choice: Choice, work: Work, memory: float) -> SceneCost:
        """The price of a choice of which a pupil and one PSF take so much; lines of a band share their pupil."""
        depths = DEPTHS if choice.defocus else 1
        psfs = self.wavelengths(choice) * depths * choice.places**2
        once, each = work.once * psfs / max(choice.lines, 1), work.each * psfs
        error = self.own_error(choice) + math.fsum(row.remaining for row in self.ingredients(choice))
        return SceneCost(once + each, once / RATES["double"] + each / RATES[choice.precision], memory, error)

    def wavelengths(self, choice: Choice) -> int:
        """Number of lines that a choice computes."""
        return choice.lines * self.estimates.in_bands if self.estimates.in_bands else self.lines

    def own_error(self, choice: Choice) -> float:
        """Numerical error of the field path, at most, whatever the pupil; a plan states what a probe finds."""
        if choice.path == PHASED:
            # The field's tolerance is a share of the accuracy; the intensity errs by at most twice as much, the
            # crossing of window and tail by as much again.
            return 4 * PHASE_SHARE * self.accuracy
        if choice.path == SPECTRUM:
            phase = choice.defocus or choice.aberrations
            return self._gap_edge(choice) + (self._gap_rim(choice) if phase else 0.0)
        return _PATHS[choice.path].error[choice.precision]

    def ingredients(self, choice: Choice) -> tuple[Ingredient, ...]:
        """The rows of a choice."""
        estimates = self.estimates
        spread = Estimate(
            estimates.bands[min(estimates.bands)], "PSF in the window against that of many lines", BAND_SAFETY
        )
        between = Estimate(
            estimates.places[choice.places], "the shift half a diagonal from the nearest place", GAP_SAFETY
        )
        rows = [
            _row("scale of a near focus", choice.scale, estimates.scale),
            _row("defocus over the depth", choice.defocus, estimates.defocus),
            _row("lens aberrations", choice.aberrations, estimates.aberrations),
            _row("oblique light", choice.oblique, estimates.oblique, RESAMPLED),
            _row("shift through the gap", choice.places > 1, estimates.shift),
            _row("diffraction over the gap", choice.diffraction, estimates.diffraction),
            _row("field between places", False, between),
            _row("width of the bands", choice.lines > 1, spread, estimates.bands[choice.lines]),
            _row("curve of the rim", not choice.grey_rim, estimates.rim),
        ]
        if estimates.layout:
            # The mean over layouts takes more than one layout's PSF, so it is never the cheaper one.
            rows.append(_row("the layout itself", True, estimates.layout))
        if self.scene.saturation:
            rows.append(_row("saturation", True, Estimate(0.0, "clipped by the capture; the PSF stays as it is")))
        return tuple(rows)

    def _task(self, choice: Choice) -> FieldTask:
        task = self.tasks[choice.grey_rim, choice.scale, choice.oblique]
        if choice.places == 1:
            return task
        # Openings that move are not alike along x and y, and a stop whose edge follows the dots cuts them.
        x = replace(task.x, start_um=task.x.start_um - task.x.pitch_um / 2, cells=task.x.cells + 1)
        return replace(task, x=x, rim=task.rim if choice.grey_rim else max(task.rim, 1))

    def _one(self, choice: Choice) -> tuple[Work, float]:
        task = self._task(choice)
        # The dots that the stop cuts mirror each other on the axis alone.
        dots, rim = self.pupil.whole.size, self.pupil.rim_row.size * (1 if choice.places == 1 else 2)
        once, each = _pupil_flops(dots, rim, choice.grey_rim), _PSF + _PSF_SAMPLE * 4 * task.u.size**2
        if choice.oblique:
            each += _LANDED * odd_samples(self.camera.window_um, point_step_um(self.camera)) ** 2
        # A PSF is of double precision, whatever the waves that made it.
        each *= RATES[choice.precision] / RATES["double"]
        if choice.path == SPECTRUM:
            flops, memory = self._gap_cost(choice, task)
            return Work(once, each + flops), memory
        if choice.path == PHASED:
            flops = phased_flops(self.pupil, task.u, self.steepest, PHASE_SHARE * self.accuracy)
            return Work(once, each + flops), 8.0 * (36 * dots + 16 * task.u.size**2)
        path = _PATHS[choice.path]
        work = path.work(task)
        memory = path.memory(task) / (2 if choice.precision == "single" else 1)
        return Work(once + work.once, each + work.each), memory

    def _sample_um(self, choice: Choice) -> float:
        return self.pupil.x.dot_um / choice.samples_per_dot

    def _gap_edge(self, choice: Choice) -> float:
        stop = self.camera.stop
        edge = perimeter_um(stop) / (4 * stop.area_um2) * self._sample_um(choice)
        uneven = max((1 - self.pupil.field_integral_um2 / stop.area_um2) ** 2, _LEAST_UNEVENNESS)
        return (_GAP_EDGE_ROUND if stop.round else _GAP_EDGE_STRAIGHT) * edge * self.estimates.crowding * uneven

    def _gap_rim(self, choice: Choice) -> float:
        sample = self._sample_um(choice)
        return min(_GAP_RIM * self.steepest * sample, 4 * sample / self.camera.stop.diameter_um)

    def _gap_fits(self, choice: Choice) -> bool:
        """Whether the samples are fine enough for the phase, coarse enough for waves that travel, and not too many."""
        sample, most = self._sample_um(choice), self.estimates.range_nm[1] * UM_PER_NM
        phase = choice.defocus or choice.aberrations
        # The corner of the grid of places is the farthest off the axis.
        corner = math.sqrt(2) * self.scene.widest_um
        highest = float(self._task(choice).u[-1])
        return (
            most / (2 * sample) < min(_MOST_SLOPE, 1 - corner / math.hypot(corner, self.camera.focal_um))
            and _GAP_RESOLVED * highest <= 0.5 / sample
            and not (phase and self.steepest * sample > MOST_WAVES_PER_SAMPLE)
            and self._gap_samples(choice) ** 2 <= MOST_GAP_SAMPLES
        )

    def _gap_samples(self, choice: Choice) -> int:
        """Samples along a side of the propagated field, as :func:`maskfab.optics.gap.gap_psf` takes them."""
        sample = self._sample_um(choice)
        guard = gap_guard_um(self.scene.gap_um, self.estimates.range_nm[1], sample)
        width = self.camera.stop.diameter_um + 2 * guard + self.pupil.x.pitch_um
        return math.ceil(width / sample) + 4

    def _gap_cost(self, choice: Choice, task: FieldTask) -> tuple[float, float]:
        count, sides = self._gap_samples(choice), 2 * task.u.size - 1
        across = count / choice.samples_per_dot
        middle = self.camera.stop.diameter_um / self.pupil.x.dot_um * choice.samples_per_dot
        # Dots without gutters between them have their spectrum from one small transform.
        axis = self.pupil.x
        even = math.isclose(axis.pitch_um, axis.dots * axis.dot_um)
        spectrum = 0.0 if even else 8 * count * across * (across + count)
        flops = (
            spectrum
            + (_TRANSFORM_FLOP * 2 * 5 * 2 * log2(count) + _GAP_SAMPLE) * count**2
            + 8 * sides * middle * (middle + sides)
            + _pupil_flops(middle**2, 4 * middle * self.camera.stop.round, grey=True)
            + (_TURN * middle**2 if choice.defocus or choice.aberrations else 0.0)
        )
        return flops, 16.0 * 4 * count**2


def _pupil_flops(dots: float, rim: float, grey: bool) -> float:
    return _CUT + (_DOT + grey * _GREY_DOT) * dots + _RIM_DOT * rim


def _options(estimate: Estimate) -> tuple[bool, ...]:
    return (False, True) if estimate.error else (False,)


def _row(name: str, modelled: bool, estimate: Estimate, remaining: float = 0.0) -> Ingredient:
    return Ingredient(
        name, modelled, estimate.error, estimate.method, estimate.safety, remaining if modelled else estimate.error
    )


AT_MOST = "at most"
"""Qualifier of a plan's errors in its document: with their safety they may be far above the truth, and not below it."""


@dataclass(frozen=True)
class Plan:
    """The cheapest choice that meets the accuracy.

    Attributes:
        accuracy: admissible relative L2 error of the PSF.
        ingredients: what is modelled and what is left out, and how large that is.
        step_um, samples: of the point PSF, along each axis of the window.
        pixel_margin: samples beyond the window that the pixel filter gathers.
        phase_tolerance: to hand to a phased PSF; 0 where there is none.
        nearest_object_um: focused nearer than this, the change of scale alone exceeds the accuracy.
        fullest: all of the scene that can be computed, to hold the choice against: the rim exact, every image point its
            own PSF, lines that err by a quarter of the accuracy at most or as many as were priced; samples over a gap
            twice as fine as the choice's and good for half of the accuracy, or as fine as can be.
        fullest_error: the numerical error of that, beside which a measured difference means nothing.
    """

    accuracy: float
    choice: Choice
    price: SceneCost
    ingredients: tuple[Ingredient, ...]
    step_um: float
    samples: int
    pixel_margin: int
    wavelengths: int
    depths: int
    phase_tolerance: float
    nearest_object_um: float
    fullest: Choice
    fullest_error: float


def sampling_camera(camera: Camera, scene: Scene) -> Camera:
    """The camera at the ends of the scene's spectrum, whose samples all of its PSFs share."""
    return replace(camera, wavelengths_nm=tuple(dict.fromkeys(wavelength_range_nm(camera, scene))))


def cost_model(panel: Panel, camera: Camera, scene: Scene, accuracy: float) -> CostModel:
    """Everything that pricing needs; arguments and errors as for :func:`plan`."""
    if not 0 < accuracy < 1:
        raise JobError("MF104", f"an accuracy of {accuracy:g} is outside 0 to 1", cure="Give a ratio: 1e-3 for 0.1 %")
    _refuse_steep(camera, scene, panel.dot_nm / NM_PER_UM)
    # The openings must cover the stop from the corner of the field too.
    farthest = scene.widest_um
    moved = shift_um(camera, scene.seen(farthest / camera.focal_um, scene.gap_um)[0], (farthest, farthest))
    if moved[0]:
        moved_pupil(panel_aperture(panel), camera.stop, moved)
    sampled = sampling_camera(camera, scene)
    pupil = cut(panel_aperture(panel, camera.stop.diameter_um / 2), camera.stop)
    estimates = estimate(panel, pupil, camera, scene)
    tasks = {}
    reaches = {oblique: _reach_um(sampled, scene, oblique) for oblique in (False, True)}
    for scale, (oblique, reach) in itertools.product((False, True), reaches.items()):
        distance = image_distance_um(camera.focal_um, scene.focus_um if scale else math.inf)
        frequency = reach / (estimates.range_nm[0] * UM_PER_NM * distance)
        exact = FieldTask.of(pupil, frequency, frequency)
        tasks[False, scale, oblique], tasks[True, scale, oblique] = exact, replace(exact, rim=0)
    lines, steepest = len(camera.wavelengths_nm), _steepest(camera, scene, estimates.range_nm[0])
    return CostModel(pupil, sampled, scene, accuracy, estimates, tasks, lines, steepest)


def _refuse_steep(camera: Camera, scene: Scene, dot_um: float) -> None:
    """Refuse a field beyond 75 degrees, or where the film's walls shade more than a tenth of a dot: JobError MF104."""
    slope = scene.slope(camera)
    degrees, shade, most = math.degrees(math.atan(slope)), ASSUMED_FILM_UM * slope, _MOST_WALLS * dot_um
    limit = min(MOST_FIELD_DEG, math.degrees(math.atan(most / ASSUMED_FILM_UM)))
    if degrees > limit * (1 + 1e-9):
        what = f"a field of {degrees:.4g} degrees is beyond {limit:.3g}, where the optics are proved"
        if shade > most:
            what += (
                f": walls of a film of {ASSUMED_FILM_UM:g} um shade {shade:.3g} um of a dot there, of {most:g} at most"
            )
        cure = f'Ask for a field of at most "{limit:.3g} deg"'
        raise JobError("MF104", what, where="scene.field", cure=cure)


def _reach_um(sampled: Camera, scene: Scene, oblique: bool) -> Floats:
    """Places along half a side of a PSF for the window, or for what lands there, where that is most."""
    step = point_step_um(sampled)
    half = odd_samples(sampled.window_um, step) // 2 + pixel_margin(sampled)
    if oblique:
        lens, ends = scene.lens(sampled), (AXIS, (scene.field_um, 0.0), (-scene.field_um, 0.0))
        half = max(SensorWindow.about(lens, place, step, half).half(step) for place in ends)
    return step * np.arange(half + 1, dtype=np.float64)


def plan(panel: Panel, camera: Camera, scene: Scene, accuracy: float) -> Plan:
    """The cheapest model of a scene whose error, that of what it leaves out included, is within the accuracy.

    Of equally cheap ones the one that errs least.

    Args:
        accuracy: admissible relative L2 error of the point PSF over the window, in (0, 1).

    Raises:
        JobError: MF104 for an accuracy, a distance or an aberration out of range; MF114 if the panel does not cover the
            stop from the edge of the field; MF115 if nothing that maskfab can compute meets the accuracy.
    """
    model = cost_model(panel, camera, scene, accuracy)
    priced = list(model.priced())
    fitting = [candidate for candidate in priced if candidate[1].error <= accuracy]
    if not fitting:
        least = min((price.error for _, price in priced), default=math.inf)
        what = f"no model of this scene meets an accuracy of {accuracy:g}; the best errs by {least:.2g}"
        cure = f"Ask for {1.1 * least:.2g} or more, or for less of the scene"
        raise JobError("MF115", what, where="scene.accuracy", cure=cure)
    choice, price = min(fitting, key=lambda candidate: (candidate[1].seconds, candidate[1].error))
    step = point_step_um(model.camera)
    fullest, tolerance = _fullest(model, priced, choice), PHASE_SHARE * accuracy
    ingredients = model.ingredients(choice)
    error = _own_error(model, camera, choice, tolerance) + math.fsum(row.remaining for row in ingredients)
    return Plan(
        accuracy,
        choice,
        replace(price, error=error),
        ingredients,
        step,
        odd_samples(camera.window_um, step),
        pixel_margin(model.camera),
        model.wavelengths(choice),
        DEPTHS if choice.defocus else 1,
        tolerance if choice.path == PHASED else 0.0,
        nearest_object_um(model.estimates.pilot, camera, accuracy),
        fullest,
        _own_error(model, camera, fullest, full_tolerance(accuracy))
        + (RESAMPLED if fullest.oblique else 0.0)
        + min((error for count, error in model.estimates.bands.items() if count <= fullest.lines), default=0.0),
    )


def phase_waves(
    choice: Choice, camera: Camera, scene: Scene, wavelength_nm: float, object_um: float | None
) -> Waves | None:
    """The phase in the stop's plane that a choice models; None for none."""
    parts: list[Waves] = []
    if choice.defocus and object_um not in (None, scene.focus_um):
        parts.append(defocus_waves(camera, wavelength_nm, object_um, scene.focus_um))
    if choice.aberrations:
        parts.append(scene.wavefront(camera).waves(camera.stop, wavelength_nm))
    if not parts:
        return None

    def path(x_um: Floats, y_um: Floats) -> Floats:
        return np.asarray(sum(part(x_um, y_um) for part in parts))

    return path


def _steepest(camera: Camera, scene: Scene, wavelength_nm: float) -> float:
    """Most waves per micrometre along an axis, by differences over the stop."""
    radius = camera.stop.diameter_um / 2
    half_x, half_y = (side / 2 for side in camera.stop.sides_um)
    if camera.stop.round:
        angle = np.linspace(0, 2 * np.pi, 64, endpoint=False)
        rings = np.linspace(0, 1, 33)[:, None]
        x, y = half_x * rings * np.cos(angle), half_y * rings * np.sin(angle)
    else:
        x, y = np.meshgrid(*(np.linspace(-half, half, 65) for half in (half_x, half_y)))
    lens, h = scene.wavefront(camera).waves(camera.stop, wavelength_nm), 1e-3 * radius
    steepest = 0.0
    for distance in (scene.nearest_um, scene.farthest_um, scene.focus_um):
        blur = defocus_waves(camera, wavelength_nm, distance, scene.focus_um)
        for dx, dy in ((h, 0.0), (0.0, h)):
            beyond, before = (lens(x + k * dx, y + k * dy) + blur(x + k * dx, y + k * dy) for k in (1, -1))
            steepest = max(steepest, float(abs(beyond - before).max()) / (2 * h))
    return steepest


def full_tolerance(accuracy: float) -> float:
    """Tolerance of a phased field that others are held against."""
    return min(PHASE_SHARE * accuracy, _FULL_TOLERANCE)


def _nearer_focus(scene: Scene, object_um: float, share: float) -> float:
    """Distance of which the defocus is so large a share of an object's."""
    vergence = (1 - share) / scene.focus_um + share / object_um
    return 1 / vergence if vergence else math.inf


def _own_error(model: CostModel, camera: Camera, choice: Choice, tolerance: float) -> float:
    """Numerical error of a choice: by a probe where one is at hand, as :meth:`CostModel.own_error` bounds any pupil."""
    bound, scene = model.own_error(choice), model.scene
    bands = [band_lines(band, choice.lines).wavelengths_nm.tolist() for band in scene.bands]
    lines = sorted({line for band in bands or [camera.wavelengths_nm] for line in band})
    found: float | None = None
    if choice.path == PHASED:
        bound = min(bound, 4 * tolerance)
        distance = image_distance_um(camera.focal_um, scene.focus_um if choice.scale else math.inf)
        ranging = choice.defocus and scene.nearest_um != scene.farthest_um
        objects = {scene.nearest_um, scene.farthest_um, scene.focus_um} if choice.defocus else {scene.focus_um}
        seen = [(line, at) for line in lines for at in objects]
        if ranging:
            seen += [
                (lines[0], _nearer_focus(scene, end, 0.5**k))
                for end in objects - {scene.focus_um}
                for k in range(1, _HALVINGS)
            ]
        phases = [(line, waves) for line, at in seen if (waves := phase_waves(choice, camera, scene, line, at))]
        # Where the probe itself would take too many dots, what holds for any pupil stands.
        with suppress(JobError):
            found = phased_error(model.pupil, model.camera, phases, tolerance, distance, between=ranging)
    elif choice.path == STRUCTURE.name and choice.precision == "single":
        u = model.tasks[choice.grey_rim, choice.scale, choice.oblique].u
        pupil = grey(model.pupil) if choice.grey_rim else model.pupil
        found = single_error(pupil, STRUCTURE, float(u[-1]), u.size, lines)
    return bound if found is None else min(bound, found)


def _fullest(model: CostModel, priced: Sequence[tuple[Choice, SceneCost]], choice: Choice) -> Choice:
    """The fullest choice; of its samples over a gap no more than tell the error of the plan's own choice."""
    bands = model.estimates.bands
    lines = next((count for count, error in bands.items() if error <= model.accuracy / 4), max(bands))
    best = max((similar for similar in priced if similar[0].lines == lines), key=_fullness)[0]
    alike = (replace(best, samples_per_dot=count) for count in GAP_SAMPLES if count <= best.samples_per_dot)
    for similar in alike:
        enough = (
            similar.samples_per_dot >= 2 * choice.samples_per_dot and model.own_error(similar) <= model.accuracy / 2
        )
        if enough and model.possible(similar):
            return similar
    return best


def _fullness(priced: tuple[Choice, SceneCost]) -> tuple[float, ...]:
    choice, price = priced
    asked = (choice.diffraction, choice.defocus, choice.aberrations, choice.scale, not choice.grey_rim)
    # Less of an error of its own: more samples, double precision; among equals, less time.
    return sum(asked) + choice.oblique, choice.places, -price.error, -price.seconds


def plan_document(die: str, plan: Plan) -> dict[str, object]:
    """A die's plan as plain data for JSON: lengths in micrometres, times in seconds; null for an infinite distance."""
    choice, price = plan.choice, plan.price
    near = plan.nearest_object_um
    return {
        "die": die,
        "path": choice.path,
        "precision": choice.precision,
        "grey_rim": choice.grey_rim,
        "step_um": plan.step_um,
        "samples": plan.samples,
        "pixel_margin": plan.pixel_margin,
        "wavelengths": plan.wavelengths,
        "depths": plan.depths,
        "places": choice.places**2,
        "phase_tolerance": plan.phase_tolerance,
        "samples_per_dot": choice.samples_per_dot,
        "predicted_flops": price.flops,
        "predicted_seconds": price.seconds,
        "predicted_bytes": price.memory,
        "error": price.error,
        "errors": AT_MOST,
        "nearest_object_um": near if math.isfinite(near) else None,
        "ingredients": [
            {
                "name": row.name,
                "modelled": row.modelled,
                "error_if_left_out": row.error,
                "counted": row.remaining,
                "method": row.method,
                "safety": row.safety,
            }
            for row in plan.ingredients
        ],
    }


def plan_table(die: str, plan: Plan) -> list[str]:
    """A die's plan as lines of text."""
    choice, price = plan.choice, plan.price
    rows = [("ingredient", "", "error without", "counted", "method")]
    for row in plan.ingredients:
        state = "modelled" if row.modelled else "left out"
        safety = f" (x {row.safety:g})" if row.safety != 1 and row.error else ""
        rows.append((row.name, state, _at_most(row.error), _at_most(row.remaining), row.method + safety))
    lines = [f"{die}: accuracy {plan.accuracy:g}, estimated error {_at_most(price.error)}"]
    lines += columns(rows)
    rim = "grey" if choice.grey_rim else "exact"
    lines += [
        f"path         {choice.path}, {choice.precision} precision, {rim} rim",
        f"samples      {plan.samples} x {plan.samples}, {plan.step_um:g} um apart, "
        f"{plan.pixel_margin} more for the pixel filter",
        f"wavelengths  {plan.wavelengths}, depths {plan.depths}, places {choice.places**2}",
        f"predicted    {price.seconds:.2g} s, {price.memory / 1e6:.3g} MB",
    ]
    return lines


def _at_most(error: float) -> str:
    return f"≤ {error:.1e}" if error else "0"
