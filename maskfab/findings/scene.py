"""A scene as its plan models it: PSFs over field, depth and colours, and how far they and the plan are from the truth.

Everything is computed from the polygons that were read back. Changes and errors are relative L2 of point PSFs over the
camera's window at the shortest wavelength, where they are largest. What is left after deblurring is told of the PSF on
pixels at the camera's middle line, or amid its middle band, for that is what a camera's own calibration sees.
"""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass, replace

import numpy as np

from maskfab.base.arrays import Floats
from maskfab.base.errors import JobError
from maskfab.base.model import Die, Psf, Quantity, frozen
from maskfab.base.units import NM_PER_UM, UM_PER_MM
from maskfab.job.camera import Camera
from maskfab.job.process import UNSTATED, MaskBlank
from maskfab.optics import metrics
from maskfab.optics.gap import AXIS, Place, gap_guard_um, moved_aperture
from maskfab.optics.metrics import NOISE_TO_SIGNAL, relative_difference
from maskfab.optics.phase import image_distance_um
from maskfab.optics.psf import pixel_psf, point_psf, within
from maskfab.optics.pupil import Aperture, cut
from maskfab.optics.scene.model_bar import rows_of, scene_bar
from maskfab.optics.scene.omissions import PLACES
from maskfab.optics.scene.plan import PHASED, SPECTRUM, Plan, sampling_camera
from maskfab.optics.scene.plan import plan as plan_scene
from maskfab.optics.scene.point_images import (
    deblurring_residual,
    field_places,
    full_plan,
    residual_blur,
    restored_error,
    sagittal_cut,
    scene_psf,
    spectrum_psf,
    tangential_cut,
    window_modulation,
)
from maskfab.optics.scene.scene import Scene
from maskfab.optics.spectrum import band_lines, pixel_transfer


@dataclass(frozen=True, eq=False)
class PointView:
    """The picture of one point of the scene.

    Attributes:
        object_um: how far the object is from the lens; may be infinite.
        psf: on pixels.
        change: relative L2 distance of ``psf`` from that of the axis in focus.
        left: float64 [n, n], the PSF after Wiener deblurring with that of the axis in focus, on pixels.
        residual: relative L2 distance of ``left`` from what deblurring leaves of the axis in focus itself.
        angle_deg: of its light off the axis.
        illumination: light there of an even scene, by that on the axis, through the stop alone.
        mtf_tangential, mtf_sagittal: presampled, at a quarter of a cycle per pixel.
        restored_loss_db: decibels by which pictures are restored less well than on the axis, by that one's blur, see
            :func:`maskfab.optics.scene.point_images.restored_error`.
        mtf_error: bound of the error of both, the energy outside the window.
    """

    image_um: Place
    object_um: float
    psf: Psf
    change: float
    left: Floats
    residual: float
    angle_deg: float
    illumination: float
    mtf_tangential: float
    mtf_sagittal: float
    restored_loss_db: float
    mtf_error: float

    def __post_init__(self) -> None:
        object.__setattr__(self, "left", frozen(self.left))


@dataclass(frozen=True, eq=False)
class SceneOptics:
    """Optics of a scene behind one die.

    Attributes:
        field: views of objects in focus, [y][x] over the field; none where the plan gives every place one PSF.
        depth: views on the axis, nearest first; none where the plan gives every distance one PSF.
        colours: PSF on pixels of each band, on the axis in focus; none for lines.
    """

    die: Die
    scene: Scene
    plan: Plan
    field: tuple[tuple[PointView, ...], ...]
    depth: tuple[PointView, ...]
    colours: tuple[Psf, ...]
    quantities: tuple[Quantity, ...]


def distance(length_um: float) -> str:
    """A distance in the unit that a reader would choose."""
    if math.isinf(length_um):
        return "infinity"
    return f"{length_um / 1e6:.4g} m" if length_um >= 1e5 else f"{length_um / UM_PER_MM:.4g} mm"


_PLACES = 5
# Seven complex fields of double precision: measured, in stops of 2 and 4 mm, with four and eight samples for each dot.
_BYTES_PER_SAMPLE = 112.0
# Slopes up to 0.9 are as far as diffraction over a gap is computed; sideways that is so many gaps.
_LARGEST_SLOPE = 0.9 / math.sqrt(1 - 0.9**2)


def scene_plan(die: Die, camera: Camera, scene: Scene, accuracy: float, where: str) -> Plan:
    """The plan of a die; its errors name the die."""
    try:
        return plan_scene(die.panel, camera, scene, accuracy)
    except JobError as error:
        place = f"{where}: die {die.name}" + (f", {error.where}" if error.where else ", scene")
        raise JobError(error.code, error.what, where=place, cure=error.cure) from error


def peak_bytes(die: Die, camera: Camera, scene: Scene, plan: Plan) -> float:
    """Memory that :func:`measure_scene` takes at its most: the plan's own, or that of the fullest choice's gap."""
    full = plan.fullest
    if not full.diffraction:
        return plan.price.memory
    sample = die.panel.dot_nm / NM_PER_UM / full.samples_per_dot
    guard = gap_guard_um(scene.gap_um, max(sampling_camera(camera, scene).wavelengths_nm), sample)
    return float(_BYTES_PER_SAMPLE * ((camera.stop.diameter_um + 2 * guard) / sample) ** 2)


def scene_reach_um(camera: Camera, scene: Scene) -> float:
    """Half the side of the square of openings that light on its way to the stop can meet."""
    moved = scene.gap_um * scene.widest_um / camera.focal_um
    return camera.stop.diameter_um / 2 + moved + _LARGEST_SLOPE * scene.gap_um


def measure_scene(
    die: Die, camera: Camera, scene: Scene, openings: Aperture, plan: Plan, blank: MaskBlank = UNSTATED
) -> SceneOptics:
    """Views over the field, the depth and the colours of a scene, and their numbers.

    Args:
        openings: as read back, as far as :func:`scene_reach_um`.
        blank: what the plate is made of; of it a scene holds the glass alone.
    """
    shown = _Shown(die, camera, scene, openings, plan)
    field, depth, colours = shown.over_field(), shown.over_depth(), shown.of_bands()
    near = plan.nearest_object_um
    nearest = Quantity(
        "nearest_object",
        near / 1e6 if math.isfinite(near) else None,
        f"distance at which the PSF of an object in focus has changed by the accuracy of {plan.accuracy:g} by its "
        "scale alone, from the stretch sensitivity of the PSF at infinity",
        die=die.name,
    )
    quantities = [*shown.errors(), *shown.of_field(field), *shown.of_depth(depth), nearest]
    if colours:
        quantities += metrics.colour_quantities(colours, die.name)
    pupil = cut(moved_aperture(openings, AXIS, camera.stop.diameter_um / 2), camera.stop)
    quantities += rows_of(scene_bar(pupil, camera, scene.slope(camera), blank), die.name)
    return SceneOptics(die, scene, plan, field, depth, colours, tuple(quantities))


@dataclass(frozen=True, eq=False)
class _Shown:
    """Arguments of :func:`measure_scene`."""

    die: Die
    camera: Camera
    scene: Scene
    openings: Aperture
    plan: Plan

    @property
    def corner(self) -> Place:
        reach = self.scene.field_um / math.sqrt(2)
        return (reach, reach) if self.scene.field_um else AXIS

    @property
    def farthest_off(self) -> float | None:
        """The end of the depth range that is most out of focus; None if all of it is in focus."""
        sharp = _curvature(self.scene.focus_um)
        ends = (self.scene.nearest_um, self.scene.farthest_um)
        worst = max(ends, key=lambda end: abs(_curvature(end) - sharp))
        return None if worst == self.scene.focus_um else worst

    @property
    def middle_nm(self) -> float:
        """The camera's middle line, or the mean of the middle band, to a nanometre."""
        bands = self.scene.bands
        if not bands:
            return self.camera.middle_nm
        return float(round(band_lines(bands[len(bands) // 2], 1).wavelengths_nm[0]))

    def psf(
        self,
        wavelength_nm: float,
        image_um: Place = AXIS,
        object_um: float | None = None,
        *,
        plan: Plan | None = None,
        margin: int = 0,
    ) -> Psf:
        return scene_psf(
            self.openings,
            self.camera,
            self.scene,
            plan or self.plan,
            wavelength_nm,
            image_um=image_um,
            object_um=object_um,
            margin=margin,
        )

    def view(self, image_um: Place, object_um: float, centre: Psf | None) -> PointView:
        """A view, deblurred with the PSF of the axis in focus; that one's own if there is no ``centre`` yet."""
        away = None if object_um == self.scene.focus_um else object_um
        # Every place has its own PSF here, where the plan may let it borrow that of a neighbour.
        everywhere = replace(self.plan, choice=replace(self.plan.choice, places=PLACES[-1]))
        points = self.psf(self.middle_nm, image_um, away, plan=everywhere, margin=self.plan.pixel_margin)
        pixels = pixel_psf(points, self.camera)
        chosen = centre or pixels
        scale = self.scene.focus_um if self.plan.choice.scale else math.inf
        lens = self.scene.lens(self.camera, image_distance_um(self.camera.focal_um, scale))
        frequency, azimuth = np.array([0.25 / self.camera.pixel_um]), math.atan2(image_um[1], image_um[0])
        cuts = [chosen_cut(frequency, azimuth) for chosen_cut in (tangential_cut, sagittal_cut)]
        (along, outside), (across, _) = (window_modulation(within(points, self.camera), *nu) for nu in cuts)
        light, own = lens.illumination(image_um), restored_error(chosen, chosen, NOISE_TO_SIGNAL)
        return PointView(
            image_um,
            object_um,
            pixels,
            relative_difference(pixels, chosen),
            residual_blur(pixels, chosen, NOISE_TO_SIGNAL),
            deblurring_residual(pixels, chosen, NOISE_TO_SIGNAL) if centre else 0.0,
            math.degrees(math.atan(math.hypot(*lens.slopes_at(image_um)))),
            light,
            float((along * pixel_transfer(self.camera, *cuts[0]))[0]),
            float((across * pixel_transfer(self.camera, *cuts[1]))[0]),
            10 * math.log10(restored_error(pixels, chosen, NOISE_TO_SIGNAL, light) / own),
            outside,
        )

    def over_field(self) -> tuple[tuple[PointView, ...], ...]:
        if self.corner == AXIS or not (self.plan.choice.places > 1 or self.plan.choice.oblique):
            return ()
        focus = self.scene.focus_um
        centre = self.view(AXIS, focus, None)
        return tuple(
            tuple(centre if place == AXIS else self.view(place, focus, centre.psf) for place in row)
            for row in field_places(self.corner[0], _PLACES)
        )

    def over_depth(self) -> tuple[PointView, ...]:
        if self.farthest_off is None or not self.plan.choice.defocus:
            return ()
        scene = self.scene
        centre = self.view(AXIS, scene.focus_um, None)
        distances = sorted({scene.nearest_um, scene.focus_um, scene.farthest_um})
        return tuple(
            centre if object_um == scene.focus_um else self.view(AXIS, object_um, centre.psf) for object_um in distances
        )

    def of_bands(self) -> tuple[Psf, ...]:
        return tuple(
            pixel_psf(
                spectrum_psf(
                    self.openings, self.camera, self.scene, self.plan, band, margin=self.plan.pixel_margin
                ),
                self.camera,
            )
            for band in self.scene.bands
        )  # fmt: skip

    def errors(self) -> list[Quantity]:
        """Change of the PSF by the scene, estimated error of what the plan omits, and its measured error."""
        plan, accuracy, sampled = self.plan, self.plan.accuracy, sampling_camera(self.camera, self.scene)
        line = min(sampled.wavelengths_nm)
        here = self.psf(line, self.corner, self.farthest_off)
        true = self.psf(line, self.corner, self.farthest_off, plan=full_plan(plan))
        plain = point_psf(
            cut(moved_aperture(self.openings, AXIS, self.camera.stop.diameter_um / 2), self.camera.stop), sampled, line
        )
        lines, bands = relative_difference(here, true), self._bands_apart()
        # Where a band's own difference leaves out that of a line, both together are between their difference and sum.
        measured, doubt = max(lines, bands), min(lines, bands) if self._costly else 0.0
        place = self._place()
        samples = plan.fullest.samples_per_dot
        finer = f", with {samples} samples per dot in the stop's plane" if samples else ""
        return [
            Quantity(
                "scene_psf_change",
                relative_difference(here, plain),
                f"relative L2 between the PSF {place} and the one on the axis, at infinity, in focus, without a gap",
                die=self.die.name,
                wavelength_nm=line,
            ),
            Quantity(
                "plan_error",
                plan.price.error,
                "at most: sum of the estimated errors of all that the plan leaves out, and of its own arithmetic",
                limit=accuracy,
                passed=plan.price.error <= accuracy,
                die=self.die.name,
                at_most=True,
            ),
            Quantity(
                "plan_error_measured",
                measured,
                f"relative L2 between the plan's PSF and the one that leaves nothing out, {place}{finer}"
                + (", or of the band where it is larger" if self.scene.bands else ""),
                uncertainty=plan.fullest_error + doubt,
                limit=accuracy,
                passed=measured <= accuracy,
                die=self.die.name,
                wavelength_nm=line,
            ),
        ]

    @property
    def _costly(self) -> bool:
        """Whether one line of the fullest choice takes so long that a band's are told by more lines of the plan's."""
        return self.plan.fullest.path in (PHASED, SPECTRUM)

    def _bands_apart(self) -> float:
        """Relative L2 between the plan's PSF of a band and one of more lines that leaves nothing out, the largest."""
        full = full_plan(self.plan)
        if self._costly:
            full = replace(full, choice=replace(self.plan.choice, lines=full.choice.lines))
        object_um = self.farthest_off
        return max(
            (
                relative_difference(*(
                    spectrum_psf(
                        self.openings, self.camera, self.scene, plan, band, image_um=self.corner, object_um=object_um
                    )
                    for plan in (self.plan, full)
                ))
                for band in self.scene.bands
            ),
            default=0.0,
        )  # fmt: skip

    def of_field(self, field: tuple[tuple[PointView, ...], ...]) -> Iterable[Quantity]:
        """Residue in the worst corner of the field after deblurring with the centre's PSF."""
        if field:
            worst = max((field[y][x] for y in (0, -1) for x in (0, -1)), key=lambda view: view.residual)
            x, y = (1e-3 * coordinate for coordinate in worst.image_um)
            where = (
                f"at ({x:.3g}, {y:.3g}) mm on the sensor, the worst corner, {worst.angle_deg:.3g} degrees off the "
                f"axis, where an even scene is {worst.illumination:.3g} as bright"
            )
            yield self._left("field_residual", worst, f"{where},")
            yield Quantity(
                "field_restored_loss",
                worst.restored_loss_db,
                "dB of pictures of power (0.1 / f)², f in cycles per pixel, restored by the Wiener filter for the PSF "
                f"of the axis in focus (ε = {NOISE_TO_SIGNAL:g} at f = 0.1, more where there is less light), {where}, "
                "less than there",
                die=self.die.name,
                wavelength_nm=worst.psf.wavelength_nm,
            )
            yield from self._modulations(worst, where)

    def _modulations(self, view: PointView, where: str) -> Iterable[Quantity]:
        """The tangential and sagittal MTF off the axis, half-way to the highest frequency that pixels hold."""
        frequency = UM_PER_MM * 0.25 / self.camera.pixel_um
        for name, across in (("tangential", "along"), ("sagittal", "across")):
            yield Quantity(
                f"field_mtf_{name}",
                getattr(view, f"mtf_{name}"),
                f"presampled MTF at 0.25 cy/pixel ({frequency:g} cy/mm) {across} the radius, {where}; "
                "transform of the point PSF, its error no more than the energy outside the window",
                uncertainty=view.mtf_error,
                die=self.die.name,
                wavelength_nm=view.psf.wavelength_nm,
            )

    def of_depth(self, depth: tuple[PointView, ...]) -> Iterable[Quantity]:
        """Residue at the worse end of the depth range, and the difference of its PSF from the one in focus."""
        if not depth:
            return
        worst = max(depth, key=lambda view: view.residual)
        away = f"of an object at {distance(worst.object_um)}, the worse end of the depth,"
        yield self._left("depth_residual", worst, away)
        sharp = next(view for view in depth if view.object_um == self.scene.focus_um)
        yield Quantity(
            "depth_change",
            max(relative_difference(view.psf, sharp.psf) for view in depth),
            "relative L2 between the PSFs on pixels of an object at either end of the depth, whichever is more, and "
            f"of one in focus at {distance(self.scene.focus_um)}",
            die=self.die.name,
            wavelength_nm=sharp.psf.wavelength_nm,
        )

    def _left(self, name: str, view: PointView, where: str) -> Quantity:
        return Quantity(
            name,
            view.residual,
            f"relative L2 between what Wiener deblurring (ε = {NOISE_TO_SIGNAL:g}) with the PSF of the axis in focus "
            f"leaves of the PSF {where} and what it leaves of its own",
            die=self.die.name,
            wavelength_nm=view.psf.wavelength_nm,
        )

    def _place(self) -> str:
        x, y = self.corner
        where = f"at ({x / UM_PER_MM:.3g}, {y / UM_PER_MM:.3g}) mm on the sensor" if x else "on the axis"
        off = self.farthest_off
        return f"{where} of an object {'in focus' if off is None else f'at {distance(off)}'}"


def _curvature(object_um: float) -> float:
    return 0.0 if math.isinf(object_um) else 1 / object_um
