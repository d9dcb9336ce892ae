"""Transfer of one die: its own layout before the job's own camera, in the light of the job's scene.

With a the amplitude behind the stop and C its autocorrelation over C(0), a line's transfer from scene to pixels is

    H(ν) = sum over k of C(λd (ν + k) / pixel) sinc(ν_x + k_x) sinc(ν_y + k_y),    k as far as the stop passes,

ν in cycles per pixel, d from lens to sensor (Goodman, Introduction to Fourier Optics, 6.3): optics times pixel, and
what sampling folds back. Every factor is separable but C, so H is two sparse products. A band is a sum over lines. A
gap, defocus and aberrations turn a's phase, and H is complex.

Notes:
    A lens turns the image over and a picture is shown upright: its right and its bottom are the sensor's +x and +y,
    which are the panel's as its viewer sees it. So rows and columns of a picture are those of the panel's arrays.
    A phase is taken as constant over a dot, and a dot that the stop cuts as its mean. With a phase, dots are divided
    until H stands still. The change by the last division is told as the error: the next ones change half as much each.
    Lines of a band are doubled likewise, and err by twice the change at most; a phase allows 16, whatever they err.
    Wires of a display that a die stands for are not on the mask. What else a transfer leaves out of what the job
    states, :func:`left_out` tells.
"""

from __future__ import annotations

import math
import operator
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property, lru_cache, reduce
from typing import Generic, TypeVar

import numpy as np
import scipy

from maskfab.base.arrays import Floats
from maskfab.base.errors import JobError
from maskfab.base.model import Panel
from maskfab.base.units import NM_PER_UM, UM_PER_MM, UM_PER_NM
from maskfab.camera.imaging import Isoplanatic, Transfer, upright
from maskfab.camera.stop_cells import COLOURS
from maskfab.job.camera import Camera, Stop
from maskfab.job.process import Glass, MaskBlank
from maskfab.optics.gap import (
    AXIS,
    AmplitudeLags,
    Place,
    StopField,
    check_cover,
    magnified,
    moved_aperture,
    shift_um,
    stop_amplitude,
    stop_field,
)
from maskfab.optics.lags import neighbours
from maskfab.optics.phase import image_distance_um
from maskfab.optics.pupil import Aperture, Lattice, finer_aperture, panel_aperture
from maskfab.optics.scene.plan import PHASED, SPECTRUM, Choice, Plan, phase_waves
from maskfab.optics.scene.point_images import modelled_distance_um
from maskfab.optics.scene.scene import Scene
from maskfab.optics.spectrum import BAND_SAFETY, Band, Spectrum, band_lines, line_spectrum
from maskfab.optics.stop import Waves, inside

_PLACES = 257
_MOST_KEPT = 512

T = TypeVar("T")


@dataclass(frozen=True)
class ShadowAndGap(Generic[T]):
    """A value for the openings' shadow, and one for what diffraction over the gap changes of it."""

    shadow: T
    gap: T


Samples = ShadowAndGap[int]
"""Divisions of a dot's side, each where there is a phase."""
Lines = ShadowAndGap[Spectrum]
"""Lines that stand for light; of a gap there are fewer."""


@dataclass(frozen=True, eq=False)
class StopView:
    """A camera's stop, and all that the light of one place goes through on its way to it.

    Attributes:
        openings: everything clear in front of the stop, as an object at infinity would show it.
        gap_um: from openings to stop, as an object at infinity would show it.

    Raises:
        JobError: MF114 if the openings do not cover the stop from there.
    """

    openings: Aperture
    camera: Camera
    scene: Scene
    choice: Choice
    gap_um: float
    object_um: float
    image_um: Place = AXIS

    def __post_init__(self) -> None:
        check_cover(self.openings, self.camera.stop, self._moved_um)

    def at(self, image_um: Place) -> StopView:
        """The view of another place of the image; errors as for the type."""
        return replace(self, image_um=image_um)

    def has_phase(self, line_nm: float) -> bool:
        """Whether the amplitude behind the stop is complex."""
        return self.choice.diffraction or self._waves(line_nm) is not None

    def steepest(self, line_nm: float) -> float:
        """Most waves per micrometre along an axis by which a phase turns over the stop; 0 without one."""
        waves, stop = self._waves(line_nm), self.camera.stop
        if waves is None:
            return 0.0
        place = np.linspace(-stop.diameter_um / 2, stop.diameter_um / 2, _PLACES)
        phase = np.where(inside(stop, place, place[:, None]), waves(place, place[:, None]), np.nan)
        steps = [abs(np.diff(phase, axis=axis)) for axis in (0, 1)]
        return max(float(np.nanmax(step, initial=0.0)) for step in steps) / float(place[1] - place[0])

    def without_gap(self) -> StopView:
        """The view without diffraction over the gap, which still moves the openings' shadow."""
        return replace(self, choice=replace(self.choice, diffraction=False))

    def passed_um2(self, line_nm: float, samples: Samples) -> float:
        """Light behind the stop by that in front of it: an area. Errors as for :meth:`transfer`."""
        if self.choice.diffraction:
            return self._field(line_nm, samples.gap).energy_um2
        return stop_amplitude(self._near(1), self.camera.stop)[1]

    def transfer(self, lines: Lines, samples: Samples, y: Floats, x: Floats) -> Transfer:
        """H of some lines at the frequencies where rows y cross columns x, cycles per pixel, [y, x]."""
        shadow = self.shadow(lines.shadow, samples.shadow, y, x)
        if not self.choice.diffraction:
            return shadow
        change, share = self.gap_change(lines.gap, samples.gap, y, x)
        return np.asarray(np.float32(share) * shadow + change)

    def shadow(self, lines: Spectrum, times: int, y: Floats, x: Floats) -> Transfer:
        """H without diffraction over the gap; arguments and errors as for :meth:`transfer`."""
        transfers = []
        for line, weight in zip(lines.wavelengths_nm, lines.weights, strict=True):
            waves = self._waves(float(line))
            lags = self._plain if waves is None and times == 1 else self._shadow(waves, times)
            transfers.append(line_transfer(lags, self._cycle_um(float(line)), y, x, float(weight)))
        return reduce(operator.add, transfers)

    def gap_change(self, lines: Spectrum, times: int, y: Floats, x: Floats) -> tuple[Transfer, float]:
        """Change of H by diffraction over the gap, and the factor of H without it; otherwise as :meth:`shadow`."""
        total: Transfer = np.zeros((y.size, x.size), dtype=np.complex64)
        share = 0.0
        for line, weight in zip(lines.wavelengths_nm, lines.weights, strict=True):
            field = self._field(float(line), times)
            lags = AmplitudeLags.across_gap(field)
            total = total + line_transfer(lags, self._cycle_um(float(line)), y, x, float(weight))
            share += float(weight) * field.shadow_um2 / field.energy_um2
        return total, share

    def _cycle_um(self, line_nm: float) -> float:
        return line_nm * UM_PER_NM * self._distance_um / self.camera.pixel_um

    def _near(self, times: int) -> Aperture:
        """The openings whose shadow the stop sees, so many times finer."""
        near = moved_aperture(self.openings, self._moved_um, self.camera.stop.diameter_um / 2)
        return finer_aperture(near, times) if times > 1 else near

    def _shadow(self, waves: Waves | None, times: int) -> AmplitudeLags:
        """Lags of the amplitude behind the stop without diffraction over the gap."""
        near = self._near(times)
        return AmplitudeLags.of(near.x, near.y, *stop_amplitude(near, self.camera.stop, waves))

    def _field(self, line_nm: float, times: int) -> StopField:
        return stop_field(
            self.openings, self.camera, line_nm, self._seen[0], self.image_um, times,
            waves=self._waves(line_nm), distance_um=self._distance_um, glass=self._seen[1],
        )  # fmt: skip

    @cached_property
    def _plain(self) -> AmplitudeLags:
        return self._shadow(None, 1)

    @property
    def _distance_um(self) -> float:
        return image_distance_um(self.camera.focal_um, self.scene.focus_um if self.choice.scale else math.inf)

    @property
    def _moved_um(self) -> Place:
        return shift_um(self.camera, self._seen[0], self.image_um, self._distance_um)

    @property
    def _seen(self) -> tuple[float, Glass | None]:
        return self.scene.seen(math.hypot(*self.image_um) / self._distance_um, self.gap_um)

    def _waves(self, line_nm: float) -> Waves | None:
        return phase_waves(self.choice, self.camera, self.scene, line_nm, self.object_um)


def line_transfer(lags: AmplitudeLags, cycle_um: float, y: Floats, x: Floats, weight: float = 1.0) -> Transfer:
    """H of one line where rows y cross columns x, times its weight, [y, x].

    Args:
        cycle_um: the lag of one cycle per pixel, λd / pixel.
        y, x: frequencies in cycles per pixel.
    """
    up, across = (
        (_folded if frequency.size <= _MOST_KEPT else _folded.__wrapped__)(
            replace(axis, start_um=0.0), sizes, cycle_um, frequency.tobytes()
        )
        for axis, sizes, frequency in zip((lags.y, lags.x), lags.sizes, (y, x), strict=True)
    )
    transfer: Transfer = (np.float32(weight) * across @ np.ascontiguousarray((up @ lags.table).T)).T
    return transfer


@lru_cache(maxsize=128)
def _folded(lattice: Lattice, sizes: tuple[int, int], cycle_um: float, frequencies: bytes) -> scipy.sparse.csr_array:
    """[frequencies, lags]: interpolation times the pixel's sinc, summed over what folds back; the few ones are kept."""
    frequency = np.frombuffer(frequencies, dtype=np.float64)
    edges = lattice.edges_um()
    most = max(0, math.ceil((edges[-1] - edges[0]) / cycle_um + 0.5) - 1)
    nu = frequency[:, None] + np.arange(-most, most + 1)
    places = np.repeat(np.arange(frequency.size), nu.shape[1]), np.arange(nu.size)
    sums = scipy.sparse.csr_array((np.sinc(nu).ravel(), places), shape=(frequency.size, nu.size))
    return (sums @ _interpolation(lattice, nu.ravel() * cycle_um, sizes)).astype(np.float32)


def _interpolation(lattice: Lattice, lag_um: Floats, sizes: tuple[int, int]) -> scipy.sparse.csr_array:
    """Matrix [lags, cells x dots] that interpolates a lag table along one axis."""
    rows, columns, weights = [], [], []
    for place, weight in neighbours(lattice, lag_um, sizes):
        rows.append(np.arange(lag_um.size))
        columns.append(place)
        weights.append(weight)
    places = (np.concatenate(rows), np.concatenate(columns))
    matrix = scipy.sparse.coo_array((np.concatenate(weights), places), (lag_um.size, sizes[0] * sizes[1])).tocsr()
    matrix.eliminate_zeros()
    return matrix


MOST_CHANGE = 2e-3
"""Of H by twice the samples of a phase, or twice the lines of a band."""
MOST_ACROSS = 4096
"""Dots, or samples of a phase, along a side of the stop: their autocorrelation takes a gigabyte."""

# A phase takes transforms of its own for every line.
_MOST_LINES, _MOST_PHASED = 512, 16
_MOST_TURN = 0.1
# Where no finer samples can be had, so much may still change.
_BEARABLE = 5 * MOST_CHANGE
_HALF = (0.0, 0.004, 0.012, 0.03, 0.07, 0.15, 0.27, 0.41)
_PROBED = np.array([*(-each for each in _HALF[:0:-1]), *_HALF, 0.5]), np.array([*_HALF, 0.5])
"""Frequencies along y and x, cycles per pixel, at which errors are measured: dense where H falls steeply."""


@dataclass(frozen=True, eq=False)
class DieTransfer(Isoplanatic):
    """Transfer of one die before one camera, for the light of one place in the scene: a design to be photographed.

    Attributes:
        by_samples, by_lines: error of H by either, measured at some frequencies; ``by_samples`` is None where there is
            no phase, until somebody asks.
    """

    view: StopView
    samples: Samples
    lines: tuple[Lines, ...]
    by_samples: float | None
    by_lines: float

    def _transfer(self, shape: tuple[int, int]) -> Transfer:
        y, x = np.asarray(scipy.fft.fftfreq(shape[0])), np.asarray(scipy.fft.rfftfreq(shape[1]))
        first = self.view.transfer(self.lines[0], self.samples, y, x)
        every = upright((COLOURS, *first.shape), first.dtype.type)
        # A large picture's are not held twice.
        for colour, lines in zip(every, self.lines, strict=True):
            colour[:] = first if lines is self.lines[0] else self.view.transfer(lines, self.samples, y, x)
        return every

    def at(self, image_um: Place) -> DieTransfer:
        """The transfer at another place of the image, micrometres from the axis to the right and down the picture."""
        return replace(self, view=self.view.at(image_um))

    def through(self, openings: Aperture, finer: int) -> DieTransfer:
        """The transfer of other openings, by the same lines, and samples as fine: for dies that differ a little.

        Args:
            openings: as :func:`maskfab.optics.pupil.panel_aperture` lays them out, on parts of dots.
        """
        view = self.view
        distance = modelled_distance_um(view.choice, view.scene, view.object_um)
        shown, _ = magnified(openings, view.scene.gap_um, distance)
        samples = Samples(*(max(1, times // finer) for times in (self.samples.shadow, self.samples.gap)))
        return replace(self, view=replace(view, openings=shown), samples=samples)

    @cached_property
    def error(self) -> float:
        """Largest error of H at frequencies where it falls steeply, by samples and lines together."""
        by_samples = self.by_samples
        if by_samples is None:
            middle = line_spectrum([self.lines[-1].shadow.centroid_nm])
            coarse, fine = (self.view.shadow(middle, times, *_PROBED) for times in (1, 2))
            by_samples = float(abs(fine - coarse).max())
        return by_samples + self.by_lines

    @cached_property
    def transmission(self) -> float:
        """Share of the light that falls on the stop that the die lets through, the mean of the colours."""
        # Without a gap every colour passes as much.
        colours = self.lines if self.view.choice.diffraction else self.lines[:1]
        passed = [self.view.passed_um2(lines.gap.centroid_nm, self.samples) for lines in colours]
        return min(1.0, sum(passed) / len(passed) / self.view.camera.stop.area_um2)


def die_transfer(
    name: str,
    panel: Panel,
    camera: Camera,
    scene: Scene | None = None,
    plan: Plan | None = None,
    *,
    object_um: float | None = None,
) -> DieTransfer:
    """Prepare the transfer of a die: its own cells, drawn by its own seed, the panel's middle on the axis.

    Args:
        scene: of the job, the plate's glass in its gap; None for one at infinity in the light of the camera's lines.
        plan: of that scene, panel and camera; what it leaves out is left out here. None models all of the scene.
        object_um: distance of what is photographed, all of it; None for the scene's distance nearest to focus.

    Raises:
        JobError: MF114 for a die that does not cover the stop; MF134 for other than three wavelengths, or bands; MF104
            for an object outside the scene's depth; MF115 for more than 4096 dots across the stop, or a phase or band
            that takes more samples than that, or more than 512 lines, for a change of H below 2e-3.
    """
    seen = Scene() if scene is None else scene
    light = _bands(camera, seen, name)
    choice = _everything(seen) if plan is None else plan.choice
    distance = _object_um(seen, object_um, name)
    openings = panel_aperture(replace(panel, tracks=()))
    shown, gap = magnified(openings, seen.gap_um, modelled_distance_um(choice, seen, distance))
    try:
        view = StopView(shown, camera, seen, choice, gap, distance)
        _require_room(shown, camera, 1)
        samples, coarse, by_samples = _samples(view, light)
        spectra = [_lines(view, coarse, colour) for colour in light]
    except JobError as refusal:
        raise JobError(refusal.code, refusal.what, where=name, cure=refusal.cure) from None
    lines = tuple(pair for pair, _ in spectra)
    return DieTransfer(name, view, samples, lines, by_samples, max(error for _, error in spectra))


def _bands(camera: Camera, scene: Scene, name: str) -> list[Band | float]:
    """Red, green and blue light: the scene's bands, or the camera's lines, the longest first."""
    light: list[Band | float]
    if scene.bands:
        light = [*sorted(scene.bands, key=lambda band: -band.centroid_nm)]
    else:
        light = [*sorted(camera.wavelengths_nm, reverse=True)]
    if len(light) != COLOURS:
        what, key = ("bands", "scene.spectrum") if scene.bands else ("wavelengths", "camera.wavelengths")
        raise JobError(
            "MF134",
            f"photographs have red, green and blue, and {name} is seen in {len(light)} {what}",
            where=key,
            cure="Give three",
        )
    return light


def _everything(scene: Scene) -> Choice:
    diffracts = scene.gap_um > 0
    return Choice(
        path=SPECTRUM if diffracts else PHASED,
        precision="double",
        grey_rim=False,
        scale=not math.isinf(scene.focus_um),
        defocus=True,
        aberrations=bool(scene.aberrations),
        diffraction=diffracts,
        places=1,
        lines=0,
        samples_per_dot=0,
    )


def _object_um(scene: Scene, object_um: float | None, name: str) -> float:
    if object_um is None:
        return min(max(scene.focus_um, scene.nearest_um), scene.farthest_um)
    if object_um != scene.focus_um and not scene.nearest_um <= object_um <= scene.farthest_um:
        what = (
            f"an object at {object_um:g} um is outside the scene's depth, {scene.nearest_um:g} to "
            f"{scene.farthest_um:g} um"
        )
        raise JobError("MF104", what, where=name, cure="Make scene.depth larger, or photograph something within")
    return object_um


def _samples(view: StopView, light: list[Band | float]) -> tuple[Samples, Samples, float | None]:
    """The samples that the phase of the shortest line takes, the fewest that it bears, and the error of H by them."""
    shortest = min(colour.range_nm[0] if isinstance(colour, Band) else colour for colour in light)
    if not view.has_phase(shortest):
        return Samples(1, 1), Samples(1, 1), None
    line, steep = line_spectrum([shortest]), view.steepest(shortest) * view.openings.x.dot_um
    # The phase from one sample to the next must be told by exp(2πi W) alone.
    coarsest = 2 ** max(0, math.ceil(math.log2(steep / _MOST_TURN))) if steep > 0 else 1

    def still(seen: Callable[[int], Transfer]) -> tuple[int, float]:
        coarser: Transfer | None = None
        times, error = coarsest, math.inf
        while True:
            try:
                _require_room(view.openings, view.camera, times, error)
                finer = seen(times)
            except JobError as refusal:
                if refusal.code == "MF115" and error <= _BEARABLE:
                    return times // 2, error
                raise
            if coarser is not None:
                error = float(abs(finer - coarser).max())
            if error <= MOST_CHANGE:
                return times, error
            coarser, times = finer, 2 * times

    shadow, by_shadow = still(lambda times: view.shadow(line, times, *_PROBED)) if steep else (1, 0.0)
    gapped = view.choice.diffraction
    gap, by_gap = still(lambda times: view.gap_change(line, times, *_PROBED)[0]) if gapped else (1, 0.0)
    return Samples(shadow, gap), Samples(coarsest, coarsest), by_shadow + by_gap


def too_fine(panel: Panel, stop: Stop) -> bool:
    """Whether a panel has more dots along the stop than photographs take, whatever the scene."""
    return max(stop.sides_um) * NM_PER_UM > MOST_ACROSS * panel.dot_nm


def _require_room(openings: Aperture, camera: Camera, times: int, error: float = math.inf) -> None:
    across = max(camera.stop.sides_um) / min(openings.x.dot_um, openings.y.dot_um) * times
    if across <= MOST_ACROSS:
        return
    divided = "" if times == 1 else f" divided by {times / 2:g}, too coarse for the phase of the scene's light"
    divided += f", whose transfer still changes by {error:.1g}" if math.isfinite(error) else ""
    what = (
        f"the stop of {camera.stop.diameter_um:g} um is {across / times:.0f} dots of {openings.x.dot_um:g} um{divided}"
        f"; photographs take {MOST_ACROSS} along a side at most"
    )
    dot_um = max(camera.stop.sides_um) / MOST_ACROSS
    stop_um = camera.stop.diameter_um * MOST_ACROSS / across
    sizes = (
        f"Use dots of {math.ceil(dot_um * NM_PER_UM) / NM_PER_UM:g} um or more, or a stop of at most {stop_um:.4g} um"
    )
    cure = sizes if times == 1 else "Ask for less defocus, aberration or gap"
    raise JobError("MF115", what, cure=cure)


def _lines(view: StopView, samples: Samples, light: Band | float) -> tuple[Lines, float]:
    if not isinstance(light, Band):
        line = line_spectrum([light])
        return Lines(line, line), 0.0
    phased = view.without_gap().has_phase(light.centroid_nm)
    most = _MOST_PHASED if phased else _MOST_LINES
    shadow, error = _fewest(light, most, lambda lines: view.shadow(lines, samples.shadow, *_PROBED))
    if not view.choice.diffraction:
        return Lines(shadow, shadow), error
    gap, more = _fewest(light, _MOST_PHASED, lambda lines: view.gap_change(lines, samples.gap, *_PROBED)[0])
    return Lines(shadow, gap), error + more


def _fewest(band: Band, most: int, seen: Callable[[Spectrum], Transfer]) -> tuple[Spectrum, float]:
    count, fewer, error = 1, band_lines(band, 1), math.inf
    coarser = seen(fewer)
    while count < most:
        more = band_lines(band, max(4, 2 * count))
        finer = seen(more)
        error = float(abs(finer - coarser).max())
        if error <= MOST_CHANGE:
            break
        count, fewer, coarser = more.wavelengths_nm.size, more, finer
    return fewer, BAND_SAFETY * error


_OWN_WORDS = ("curve of the rim", "field between places", "width of the bands")


def left_out(panel: Panel, scene: Scene, blank: MaskBlank, plan: Plan | None = None) -> tuple[str, ...]:
    """Sentences on what the photographs of a die leave out; none where they hold all that the job states."""
    return (*by_plan(scene, plan), *_by_lens(scene), *_by_plate(panel, scene, blank))


def by_sentence(left_out: Mapping[str, Sequence[str]]) -> list[str]:
    """Every sentence once, with the dies that it is about where these are not all."""
    dies: dict[str, list[str]] = {}
    for name, sentences in left_out.items():
        for sentence in sentences:
            dies.setdefault(sentence, []).append(name)
    every = len(left_out)
    return [f"{'' if len(names) == every else ', '.join(names) + ': '}{sentence}." for sentence, names in dies.items()]


def by_plan(scene: Scene, plan: Plan | None) -> list[str]:
    """Sentences on what a plan leaves out of a scene; without a plan, on the shift that is then left out."""
    if plan is None:
        shift = "the shift through the gap off the axis is left out: every place is seen as the axis is"
        return [shift] if scene.gap_um and scene.field_um else []
    # The transfer knows nothing of oblique light, whatever the plan does.
    out = (row for row in plan.ingredients if row.name == "oblique light" or not row.modelled)
    rows = [row for row in out if row.error and row.name not in _OWN_WORDS]
    return [
        f"{row.name} is left out: without it the PSF errs by {row.error:.2g} at most, and the accuracy asked for is "
        f"{plan.accuracy:g}"
        for row in rows
    ]


def _by_lens(scene: Scene) -> list[str]:
    sentences = []
    if scene.projection is not None:
        sentences.append(
            f"the projection, {scene.projection.name}, is left out: photographs are compared as if rectified to f tan θ"
        )
    if scene.tilt_rad:
        sentences.append("the panel's tilt is left out: it stands square to the axis in photographs")
    if scene.distortion is not None and scene.distortion.ratio:
        sentences.append(
            f"lens distortion of {scene.distortion.ratio:.2g} is left out: photographs are compared as if rectified, "
            "and their PSF is that of a lens without it"
        )
    if scene.nearest_um != scene.farthest_um:
        near, far = (
            "infinity" if math.isinf(length_um) else f"{length_um / UM_PER_MM:.4g} mm"
            for length_um in (scene.nearest_um, scene.farthest_um)
        )
        sentences.append(f"depth is left out: all of a photograph is at one distance between {near} and {far}")
    return sentences


def _by_plate(panel: Panel, scene: Scene, blank: MaskBlank) -> list[str]:
    sentences = []
    if blank.optical_density is not None:
        share = 10**-blank.optical_density
        sentences.append(
            f"light through the film is left out: it passes {share:.1g} of what falls on it, and is taken as opaque"
        )
    if blank.glass is not None:
        side = "its thickness counts as a gap" if blank.glass.gap_um else "behind it, it only dims"
        if blank.glass.gap_um and not scene.gap_um:
            side = "its thickness counts as a gap with a [scene] alone, and the job has none"
        sentences.append(f"reflections and absorption of the glass are left out: {side}")
    if panel.tracks:
        sentences.append("wires of the display are left out: the mask has none")
    return sentences
