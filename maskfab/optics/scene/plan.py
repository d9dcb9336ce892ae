"""The planner: the cheapest model of a scene that meets an accuracy, what it leaves out, and what it costs.

Every way to model the scene is a :class:`maskfab.optics.scene.cost.Choice`. Its error is the sum of the estimates
(:mod:`maskfab.optics.scene.omission_error`) of all that it leaves out and of its own numerical error; its time is its
flops over a rate of matrix products, and an overhead for each PSF. There are a few thousand choices, so all of them are
priced and none is passed over.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from maskfab.errors import JobError
from maskfab.model import Camera, Panel
from maskfab.optics.field.methods import FieldTask
from maskfab.optics.image.psf import odd_samples, pixel_margin, point_step_um
from maskfab.optics.pupil.aperture import panel_aperture
from maskfab.optics.pupil.pupil import cut
from maskfab.optics.scene.cost import (
    DEPTHS,
    FINEST,
    GAP_SAMPLES,
    PHASE_SHARE,
    PHASED,
    RESAMPLED,
    Choice,
    CostModel,
    Ingredient,
    SceneCost,
    resamplings,
)
from maskfab.optics.scene.distortion import DistortedWindow
from maskfab.optics.scene.omission_error import check_accuracy, estimate, wavelength_range_nm
from maskfab.optics.scene.scene import Scene
from maskfab.optics.wavefront.depth import defocus_waves, image_distance_um, nearest_object_um
from maskfab.optics.wavefront.panel_gap import moved_pupil, shift_um
from maskfab.units import UM_PER_NM

AT_MOST = "at most"
"""Qualifier of a plan's errors in its document: with their safety they may be far above the truth, and not below it."""


@dataclass(frozen=True)
class Plan:
    """The cheapest choice that meets the accuracy.

    Attributes:
        accuracy: admissible relative L2 error of the PSF.
        choice: what to do.
        price: what that takes.
        ingredients: what is modelled and what is left out, and how large that is.
        step_um, samples: of the point PSF, along each axis of the window.
        pixel_margin: samples beyond the window that the pixel filter gathers.
        wavelengths: how many are computed.
        depths: distances at which the PSF is computed.
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
    check_accuracy(accuracy)
    _check_field(panel, camera, scene)
    sampled = sampling_camera(camera, scene)
    pupil = cut(panel_aperture(panel, camera.stop.diameter_um / 2), camera.stop)
    estimates = estimate(panel, pupil, camera, scene)
    tasks = {}
    reaches = {finer: _reach_um(sampled, scene, finer) for finer in resamplings(estimates.distortion.error, accuracy)}
    for scale, (finer, reach) in itertools.product((False, True), reaches.items()):
        distance = image_distance_um(camera.focal_um, scene.focus_um if scale else math.inf)
        frequency = reach / (estimates.range_nm[0] * UM_PER_NM * distance)
        exact = FieldTask.of(pupil, frequency, frequency)
        tasks[False, scale, finer], tasks[True, scale, finer] = exact, replace(exact, rim=0)
    lines, steepest = len(camera.wavelengths_nm), _steepest(camera, scene, estimates.range_nm[0])
    return CostModel(pupil, sampled, scene, accuracy, estimates, tasks, lines, steepest)


def _reach_um(sampled: Camera, scene: Scene, finer: int) -> NDArray[np.float64]:
    """Places along half a side of a PSF that is computed for the window, or for what a distorting lens shows there."""
    step = point_step_um(sampled)
    half = odd_samples(sampled.window_um, step) // 2 + pixel_margin(sampled)
    if finer and scene.distortion is not None:
        window = DistortedWindow.about(scene.distortion, (scene.field_um, 0.0), step, half)
        step = point_step_um(finer_camera(sampled, finer))
        half = window.half(step)
    return step * np.arange(half + 1, dtype=np.float64)


def finer_camera(camera: Camera, times: int) -> Camera:
    """The camera with lines that ask for so many times finer samples."""
    return replace(camera, wavelengths_nm=tuple(line / times for line in camera.wavelengths_nm))


def plan(panel: Panel, camera: Camera, scene: Scene, accuracy: float) -> Plan:
    """The cheapest model of a scene whose error, that of what it leaves out included, is within the accuracy.

    Of equally cheap ones the one that errs least.

    Args:
        panel: openings, tiling and extent.
        camera: lens, stop, window and lines.
        scene: what is looked at.
        accuracy: admissible relative L2 error of the point PSF over the window, in (0, 1).

    Raises:
        JobError: MF104 for an accuracy, a distance or an aberration out of range; MF114 if the panel does not cover the
            stop from the edge of the field; MF115 if nothing that maskfab can compute meets the accuracy.
    """
    known = cost_model(panel, camera, scene, accuracy)
    priced = list(known.priced())
    fitting = [each for each in priced if each[1].error <= accuracy]
    if not fitting:
        least = min((price.error for _, price in priced), default=math.inf)
        raise JobError(
            "MF115",
            f"no model of this scene meets an accuracy of {accuracy:g}; the best errs by {least:.2g}",
            where="scene.accuracy",
            cure=f"Ask for {1.1 * least:.2g} or more, or for less of the scene",
        )
    choice, price = min(fitting, key=lambda each: (each[1].seconds, each[1].error))
    step = point_step_um(known.camera)
    fullest = _fullest(known, priced, choice)
    return Plan(
        accuracy,
        choice,
        price,
        known.ingredients(choice),
        step,
        odd_samples(camera.window_um, step),
        pixel_margin(known.camera),
        known.wavelengths(choice),
        DEPTHS if choice.defocus else 1,
        PHASE_SHARE * accuracy if choice.path == PHASED else 0.0,
        nearest_object_um(known.estimates.pilot, camera, accuracy),
        fullest,
        known.own_error(fullest) + (RESAMPLED[FINEST] if fullest.distortion else 0.0),
    )


def _check_field(panel: Panel, camera: Camera, scene: Scene) -> None:
    farthest = max(scene.field_um, scene.steepest_um)
    moved = shift_um(camera, scene.gap_um, (farthest, farthest))
    if moved[0]:
        moved_pupil(panel_aperture(panel), camera.stop, moved)


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


def _fullest(known: CostModel, priced: Sequence[tuple[Choice, SceneCost]], choice: Choice) -> Choice:
    """The fullest choice; of its samples over a gap no more than tell the error of the plan's own choice."""
    bands = known.estimates.bands
    lines = next((count for count, error in bands.items() if error <= known.accuracy / 4), max(bands))
    best = max((each for each in priced if each[0].lines == lines), key=_fullness)[0]
    alike = (replace(best, samples_per_dot=count) for count in GAP_SAMPLES if count <= best.samples_per_dot)
    for each in alike:
        enough = each.samples_per_dot >= 2 * choice.samples_per_dot and known.own_error(each) <= known.accuracy / 2
        if enough and known.possible(each):
            return each
    return best


def _fullness(priced: tuple[Choice, SceneCost]) -> tuple[float, ...]:
    choice, price = priced
    asked = (choice.diffraction, choice.defocus, choice.aberrations, choice.scale, not choice.grey_rim)
    # Less of an error of its own: more samples, double precision; among equals, less time.
    return sum(asked) + (choice.distortion > 0), choice.places, -price.error, -price.seconds


def plan_document(die: str, found: Plan) -> dict[str, object]:
    """A die's plan as plain data for JSON: lengths in micrometres, times in seconds; null for an infinite distance."""
    choice, price = found.choice, found.price
    near = found.nearest_object_um
    return {
        "die": die,
        "path": choice.path,
        "precision": choice.precision,
        "grey_rim": choice.grey_rim,
        "step_um": found.step_um,
        "samples": found.samples,
        "pixel_margin": found.pixel_margin,
        "wavelengths": found.wavelengths,
        "depths": found.depths,
        "places": choice.places**2,
        "phase_tolerance": found.phase_tolerance,
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
            for row in found.ingredients
        ],
    }


def plan_table(die: str, found: Plan) -> list[str]:
    """A die's plan as lines of text."""
    choice, price = found.choice, found.price
    rows = [("ingredient", "", "error without", "counted", "method")]
    for row in found.ingredients:
        state = "modelled" if row.modelled else "left out"
        safety = f" (x {row.safety:g})" if row.safety != 1 and row.error else ""
        rows.append((row.name, state, _at_most(row.error), _at_most(row.remaining), row.method + safety))
    widths = [max(len(row[k]) for row in rows) for k in range(len(rows[0]))]
    lines = [f"{die}: accuracy {found.accuracy:g}, estimated error {_at_most(price.error)}"]
    lines += ["  ".join(cell.ljust(width) for cell, width in zip(row, widths, strict=True)).rstrip() for row in rows]
    rim = "grey" if choice.grey_rim else "exact"
    lines += [
        f"path         {choice.path}, {choice.precision} precision, {rim} rim",
        f"samples      {found.samples} x {found.samples}, {found.step_um:g} um apart, "
        f"{found.pixel_margin} more for the pixel filter",
        f"wavelengths  {found.wavelengths}, depths {found.depths}, places {choice.places**2}",
        f"predicted    {price.seconds:.2g} s, {price.memory / 1e6:.3g} MB",
    ]
    return lines


def _at_most(error: float) -> str:
    return f"≤ {error:.1e}" if error else "0"
