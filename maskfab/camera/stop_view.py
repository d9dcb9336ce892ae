r"""Light that reaches a camera's pixels through its stop, from one place in the scene.

With a the amplitude behind the stop and C its autocorrelation over C(0), a line's transfer from scene to pixels is

    H(ν) = sum over k of C(λd (ν + k) / pixel) sinc(ν_x + k_x) sinc(ν_y + k_y),    k as far as the stop passes,

ν in cycles per pixel, d from lens to sensor (Goodman, Introduction to Fourier Optics, 6.3): optics times pixel, and
what sampling folds back. Every factor is separable but C, so H is two sparse products. A band is a sum over lines. A
gap, defocus and aberrations turn a's phase, and H is complex.

Notes:
    A lens turns the image over and a picture is shown upright: its right and its bottom are the sensor's +x and +y,
    which are the panel's as its viewer sees it. So rows and columns of a picture are those of the panel's arrays.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from functools import cached_property, lru_cache

import numpy as np
from scipy import sparse

from maskfab.base.arrays import Floats
from maskfab.camera.restorers.restorer import Transfer
from maskfab.model import Camera
from maskfab.optics.image.spectrum import Spectrum, interpolation
from maskfab.optics.pupil.aperture import Aperture, Lattice, finer_aperture
from maskfab.optics.pupil.stop_shape import Waves, inside
from maskfab.optics.scene.cost import Choice
from maskfab.optics.scene.scene import Scene
from maskfab.optics.scene.scene_psf import phase_waves
from maskfab.optics.wavefront.amplitude_lags import AmplitudeLags, StopAmplitude
from maskfab.optics.wavefront.depth import image_distance_um
from maskfab.optics.wavefront.panel_gap import (
    AXIS,
    Place,
    StopField,
    check_cover,
    moved_aperture,
    shift_um,
    stop_field,
)
from maskfab.units import UM_PER_NM

_PLACES = 257
_MOST_KEPT = 512


@dataclass(frozen=True)
class Samples:
    """Divisions of a dot's side, each where there is a phase: of the openings' shadow, and of what a gap changes."""

    shadow: int = 1
    gap: int = 1


@dataclass(frozen=True, eq=False)
class Lines:
    """Lines that stand for light: for the openings' shadow, and, fewer, for what a gap changes."""

    shadow: Spectrum
    gap: Spectrum


@dataclass(frozen=True, eq=False)
class StopView:
    """A camera's stop, and all that the light of one place goes through on its way to it.

    Attributes:
        openings: everything clear in front of the stop, as an object at infinity would show it.
        camera: of the job.
        scene: what is looked at.
        choice: what of it is modelled.
        gap_um: from openings to stop, as an object at infinity would show it.
        object_um: distance of what is photographed.
        image_um: place on the sensor, from the axis.

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
        return self._shadow(None, 1).energy_um2

    def transfer(self, lines: Lines, samples: Samples, y: Floats, x: Floats) -> Transfer:
        """H of some lines at the frequencies where rows y cross columns x, cycles per pixel, [y, x].

        Raises:
            JobError: MF104 for a phase that is not finite; MF115 where it turns by more than an eighth of a wave from
                one sample to the next, or as :func:`maskfab.optics.wavefront.panel_gap.stop_field`.
        """
        shadow = self.shadow(lines.shadow, samples.shadow, y, x)
        if not self.choice.diffraction:
            return shadow
        change, share = self.gap_change(lines.gap, samples.gap, y, x)
        return np.asarray(np.float32(share) * shadow + change)

    def shadow(self, lines: Spectrum, times: int, y: Floats, x: Floats) -> Transfer:
        """H without diffraction over the gap; arguments and errors as for :meth:`transfer`."""
        total: Transfer = np.zeros((y.size, x.size), dtype=np.float32)
        for line, weight in zip(lines.wavelengths_nm, lines.weights, strict=True):
            waves = self._waves(float(line))
            lags = self._plain if waves is None and times == 1 else AmplitudeLags.of(self._shadow(waves, times))
            total = total + line_transfer(lags, self._cycle_um(float(line)), y, x, float(weight))
        return total

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

    def _shadow(self, waves: Waves | None, times: int) -> StopAmplitude:
        """The amplitude behind the stop without diffraction over the gap."""
        stop = self.camera.stop
        near = moved_aperture(self.openings, self._moved_um, stop.diameter_um / 2)
        return StopAmplitude.of(finer_aperture(near, times) if times > 1 else near, stop, waves)

    def _field(self, line_nm: float, times: int) -> StopField:
        return stop_field(
            self.openings, self.camera, line_nm, self.gap_um, self.image_um, times,
            waves=self._waves(line_nm), distance_um=self._distance_um,
        )  # fmt: skip

    @cached_property
    def _plain(self) -> AmplitudeLags:
        """Of every line without a phase."""
        return AmplitudeLags.of(self._shadow(None, 1))

    @property
    def _distance_um(self) -> float:
        return image_distance_um(self.camera.focal_um, self.scene.focus_um if self.choice.scale else math.inf)

    @property
    def _moved_um(self) -> Place:
        return shift_um(self.camera, self.gap_um, self.image_um, self._distance_um)

    def _waves(self, line_nm: float) -> Waves | None:
        return phase_waves(self.choice, self.camera, self.scene, line_nm, self.object_um)


def line_transfer(lags: AmplitudeLags, cycle_um: float, y: Floats, x: Floats, weight: float = 1.0) -> Transfer:
    """H of one line where rows y cross columns x, times its weight, [y, x].

    Args:
        lags: of the amplitude behind the stop.
        cycle_um: the lag of one cycle per pixel, λd / pixel.
        y, x: frequencies in cycles per pixel.
        weight: of the line.
    """
    up, across = (
        (_folded if frequency.size <= _MOST_KEPT else _folded.__wrapped__)(
            replace(axis, start_um=0.0), sizes, cycle_um, frequency.tobytes()
        )
        for axis, sizes, frequency in zip((lags.y, lags.x), lags.sizes, (y, x), strict=True)
    )
    found: Transfer = (np.float32(weight) * across @ np.ascontiguousarray((up @ lags.table).T)).T
    return found


@lru_cache(maxsize=128)
def _folded(lattice: Lattice, sizes: tuple[int, int], cycle_um: float, frequencies: bytes) -> sparse.csr_array:
    """[frequencies, lags]: interpolation of the lags times the pixel's sinc, summed over what sampling folds back.

    Kept where they are few, as every place of an image takes the same ones.
    """
    frequency = np.frombuffer(frequencies, dtype=np.float64)
    edges = lattice.edges_um()
    most = max(0, math.ceil((edges[-1] - edges[0]) / cycle_um + 0.5) - 1)
    nu = frequency[:, None] + np.arange(-most, most + 1)
    places = np.repeat(np.arange(frequency.size), nu.shape[1]), np.arange(nu.size)
    sums = sparse.csr_array((np.sinc(nu).ravel(), places), shape=(frequency.size, nu.size))
    return (sums @ interpolation(lattice, nu.ravel() * cycle_um, sizes)).astype(np.float32)
