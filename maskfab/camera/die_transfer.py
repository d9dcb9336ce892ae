"""Transfer of one die: its own layout before the job's own camera, in the light of the job's scene.

Notes:
    A phase is taken as constant over a dot, and a dot that the stop cuts as its mean. With a phase, dots are divided
    until H stands still. The change by the last division is told as the error: the next ones change half as much each.
    Lines of a band are doubled likewise, and err by twice the change at most; a phase allows 16, whatever they err.
    Wires of a display that a die stands for are not on the mask.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cached_property
from typing import cast

import numpy as np
import scipy.fft

from maskfab.base.arrays import Floats
from maskfab.camera.design import Isoplanatic
from maskfab.camera.photo_camera import COLOURS
from maskfab.camera.restorers.restorer import Transfer
from maskfab.camera.stop_view import Lines, Samples, StopView
from maskfab.errors import JobError
from maskfab.model import Camera, Panel
from maskfab.optics.image.spectrum import Band, Spectrum, line_spectrum
from maskfab.optics.light.band_lines import BAND_SAFETY, band_lines
from maskfab.optics.pupil.aperture import Aperture, panel_aperture
from maskfab.optics.scene.cost import PHASED, SPECTRUM, Choice
from maskfab.optics.scene.plan import Plan
from maskfab.optics.scene.scene import Scene
from maskfab.optics.scene.scene_psf import modelled_distance_um
from maskfab.optics.wavefront.panel_gap import Place, magnified

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


@dataclass(frozen=True)
class Resolution:
    """Samples and lines by which the transfer of a die is computed.

    Attributes:
        samples: of a phase.
        lines: that stand for red, green and blue light.
        by_samples, by_lines: error of H by either, measured at some frequencies; ``by_samples`` is None where there is
            no phase, until somebody asks.
    """

    samples: Samples
    lines: tuple[Lines, ...]
    by_samples: float | None
    by_lines: float


@dataclass(frozen=True, eq=False)
class DieTransfer(Isoplanatic):
    """Transfer of one die before one camera, for the light of one place in the scene: a design to be photographed.

    Attributes:
        view: what the light goes through.
        resolution: of what it is on the axis.
    """

    view: StopView
    resolution: Resolution

    def _transfer(self, shape: tuple[int, int]) -> Transfer:
        y, x = np.asarray(scipy.fft.fftfreq(shape[0])), np.asarray(scipy.fft.rfftfreq(shape[1]))
        return self._at(self.resolution.samples, y, x)

    def at(self, image_um: Place) -> DieTransfer:
        """The transfer at another place of the image, from the axis in micrometres to the right and down the picture.

        Raises:
            JobError: MF114 if the die does not cover the stop from there.
        """
        return replace(self, view=self.view.at(image_um))

    def through(self, openings: Aperture, finer: int) -> DieTransfer:
        """The transfer of other openings, by the same lines, and samples as fine: for dies that differ a little.

        Args:
            openings: as :func:`maskfab.optics.pupil.aperture.panel_aperture` lays them out, on parts of dots.
            finer: parts along a dot.
        """
        view, known = self.view, self.resolution
        distance = modelled_distance_um(view.choice, view.scene, view.object_um)
        shown, _ = magnified(openings, view.scene.gap_um, distance)
        samples = Samples(*(max(1, times // finer) for times in (known.samples.shadow, known.samples.gap)))
        return replace(self, view=replace(view, openings=shown), resolution=replace(known, samples=samples))

    @cached_property
    def probe(self) -> Transfer:
        """H at some frequencies, dense where it falls steeply, [3, n, m]: where errors are measured."""
        return self._at(self.resolution.samples, *_PROBED)

    @cached_property
    def error(self) -> float:
        """Largest error of H at the frequencies of ``probe``, by samples and lines together."""
        known, by_samples = self.resolution, self.resolution.by_samples
        if by_samples is None:
            middle = line_spectrum([known.lines[-1].shadow.centroid_nm])
            coarse, fine = (self.view.shadow(middle, times, *_PROBED) for times in (1, 2))
            by_samples = float(abs(fine - coarse).max())
        return by_samples + known.by_lines

    @cached_property
    def transmission(self) -> float:
        """Share of the light that falls on the stop that the die lets through, the mean of the colours."""
        samples, lines = self.resolution.samples, self.resolution.lines
        passed = [self.view.passed_um2(each.gap.centroid_nm, samples) for each in lines]
        return min(1.0, sum(passed) / COLOURS / self.view.camera.stop.area_um2)

    def _at(self, samples: Samples, y: Floats, x: Floats) -> Transfer:
        return cast(Transfer, np.stack([self.view.transfer(lines, samples, y, x) for lines in self.resolution.lines]))


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
        name: of the die, for errors.
        panel: of the die.
        camera: of the job.
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
        spectra = [_lines(view, coarse, each) for each in light]
    except JobError as refusal:
        raise JobError(refusal.code, refusal.what, where=name, cure=refusal.cure) from None
    lines = tuple(each for each, _ in spectra)
    return DieTransfer(name, view, Resolution(samples, lines, by_samples, max(error for _, error in spectra)))


def _bands(camera: Camera, scene: Scene, name: str) -> list[Band | float]:
    """Red, green and blue light: the scene's bands, or the camera's lines, the longest first."""
    if scene.bands:
        found: list[Band | float] = [*sorted(scene.bands, key=lambda band: -band.centroid_nm)]
    else:
        found = [*sorted(camera.wavelengths_nm, reverse=True)]
    if len(found) != COLOURS:
        what, key = ("bands", "scene.spectrum") if scene.bands else ("wavelengths", "camera.wavelengths")
        raise JobError(
            "MF134",
            f"photographs have red, green and blue, and {name} is seen in {len(found)} {what}",
            where=key,
            cure="Give three",
        )
    return found


def _everything(scene: Scene) -> Choice:
    """All of a scene that a transfer can hold."""
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
        raise JobError(
            "MF104",
            f"an object at {object_um:g} um is outside the scene's depth, {scene.nearest_um:g} to "
            f"{scene.farthest_um:g} um",
            where=name,
            cure="Make scene.depth larger, or photograph something within",
        )
    return object_um


def _samples(view: StopView, light: list[Band | float]) -> tuple[Samples, Samples, float | None]:
    """The samples that the phase of the shortest line takes, the fewest that it bears, and the error of H by them."""
    shortest = min(each.range_nm[0] if isinstance(each, Band) else each for each in light)
    if not view.has_phase(shortest):
        return Samples(), Samples(), None
    line, steep = line_spectrum([shortest]), view.steepest(shortest) * view.openings.x.dot_um
    # The phase from one sample to the next must be told by exp(2πi W) alone.
    coarsest = 2 ** max(0, math.ceil(math.log2(steep / _MOST_TURN))) if steep > 0 else 1

    def still(seen: Callable[[int], Transfer]) -> tuple[int, float]:
        known: Transfer | None = None
        times, error = coarsest, math.inf
        while True:
            try:
                _require_room(view.openings, view.camera, times, error)
                finer = seen(times)
            except JobError as refusal:
                if refusal.code == "MF115" and error <= _BEARABLE:
                    return times // 2, error
                raise
            if known is not None:
                error = float(abs(finer - known).max())
            if error <= MOST_CHANGE:
                return times, error
            known, times = finer, 2 * times

    shadow, by_shadow = still(lambda times: view.shadow(line, times, *_PROBED)) if steep else (1, 0.0)
    gapped = view.choice.diffraction
    gap, by_gap = still(lambda times: view.gap_change(line, times, *_PROBED)[0]) if gapped else (1, 0.0)
    return Samples(shadow, gap), Samples(coarsest, coarsest), by_shadow + by_gap


def _require_room(openings: Aperture, camera: Camera, times: int, error: float = math.inf) -> None:
    across = max(camera.stop.sides_um) / min(openings.x.dot_um, openings.y.dot_um) * times
    if across <= MOST_ACROSS:
        return
    told = "" if times == 1 else f" divided by {times / 2:g}, too coarse for the phase of the scene's light"
    told += f", whose transfer still changes by {error:.1g}" if math.isfinite(error) else ""
    raise JobError(
        "MF115",
        f"the stop of {camera.stop.diameter_um:g} um is {across / times:.0f} dots of {openings.x.dot_um:g} um{told}; "
        f"photographs take {MOST_ACROSS} along a side at most",
        cure="Use larger dots or a smaller stop" if times == 1 else "Ask for less defocus, aberration or gap",
    )


def _lines(view: StopView, samples: Samples, light: Band | float) -> tuple[Lines, float]:
    """The fewest lines that stand for light, on so many samples, and the error of H by them."""
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
    known = seen(fewer)
    while count < most:
        more = band_lines(band, max(4, 2 * count))
        finer = seen(more)
        error = float(abs(finer - known).max())
        if error <= MOST_CHANGE:
            break
        count, fewer, known = more.wavelengths_nm.size, more, finer
    return fewer, BAND_SAFETY * error
