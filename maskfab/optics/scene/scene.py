"""The scene of a camera: distances, field, gap, aberrations and the bands of light, as stated in [scene]."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace
from types import MappingProxyType

import numpy as np

from maskfab.errors import JobError
from maskfab.jobfile import SceneSection
from maskfab.model import Camera, MaskBlank
from maskfab.optics.image.spectrum import Band, Curve
from maskfab.optics.light.response import black_body, camera_bands, generic_rgb, parse_curves
from maskfab.optics.scene.distortion import Distortion
from maskfab.optics.wavefront.aberration import Wavefront

_NONE: Mapping[str, str] = MappingProxyType({})


@dataclass(frozen=True)
class Scene:
    """Scene of a camera; the defaults ask for nothing.

    Attributes:
        nearest_um, farthest_um: distances of objects from the lens.
        focus_um: distance of what is in focus.
        field_um: largest image height.
        gap_um: from the panel to the stop, in air that spreads light as much.
        aberrations: pairs of Noll's number and waves at the camera's first line.
        distortion: of the lens; None for an image height of f tan θ.
        saturation: whether highlights clip, which is left to the capture and adds nothing to the PSF.
        bands: one for each colour, response times illuminant; empty for the camera's own lines.
    """

    nearest_um: float = math.inf
    farthest_um: float = math.inf
    focus_um: float = math.inf
    field_um: float = 0.0
    gap_um: float = 0.0
    aberrations: tuple[tuple[int, float], ...] = ()
    saturation: bool = False
    bands: tuple[Band, ...] = ()
    distortion: Distortion | None = None

    @classmethod
    def of(cls, section: SceneSection | None, curves: Mapping[str, str] = _NONE, *, where: str = "") -> Scene:
        """The scene of a job; the one that asks for nothing if the job has none.

        Args:
            section: a job's [scene].
            curves: text of the tables that it names, by name, as ``JobSpec.curves`` holds them.
            where: the job file, for errors.

        Raises:
            SourceError: MF302 or MF303 for an empty or damaged table.
            JobError: MF105 for a table that ``curves`` lacks, or an illuminant of several curves; MF112 for a
                wavelength outside 200 to 2000 nm; MF104 for a curve that is negative, not finite or all zero, or a
                response that the illuminant does not overlap.
        """
        if section is None:
            return cls()
        near, far = section.depth
        return cls(
            near, far, section.focus, section.field, section.gap, section.aberrations, section.saturation,
            _bands(section, curves, where), section.distortion and Distortion(*section.distortion),
        )  # fmt: skip

    def through(self, blank: MaskBlank) -> Scene:
        """The scene behind the plate's glass: with the chrome away from the lens, its t/n adds to the gap."""
        glass = blank.glass
        return self if glass is None or not glass.gap_um else replace(self, gap_um=self.gap_um + glass.gap_um)

    @property
    def differs_off_axis(self) -> bool:
        """Whether image points off the axis have another PSF."""
        return bool(self.field_um and (self.gap_um or (self.distortion is not None and self.distortion.ratio)))

    @property
    def steepest_um(self) -> float:
        """The image height, without distortion, of the largest field: its object's angle times the focal length."""
        if self.distortion is None:
            return self.field_um
        return float(self.distortion.undistorted(np.array(self.field_um), np.zeros(()))[0])

    def wavefront(self, camera: Camera) -> Wavefront:
        """The aberrations; their waves are of the camera's first line."""
        return Wavefront(self.aberrations, camera.wavelengths_nm[0])


def _bands(section: SceneSection, curves: Mapping[str, str], where: str) -> tuple[Band, ...]:
    if section.spectrum == "lines":
        return ()
    place = f"{where}: scene.spectrum".removeprefix(": ")
    response = generic_rgb() if section.spectrum == "rgb" else _curves(section.spectrum, curves, place)
    place = f"{where}: scene.illuminant".removeprefix(": ")
    return tuple(camera_bands(response, _illuminant(section.illuminant, response, curves, place), place).values())


def _illuminant(
    stated: str | float, response: Mapping[str, Curve], curves: Mapping[str, str], where: str
) -> Curve | None:
    """Illuminant of the scene; None for equal energy at all wavelengths."""
    if stated == "equal":
        return None
    if isinstance(stated, float):
        # Over all that the camera sees: a curve is zero where it ends, a black body is not.
        low = min(float(each.wavelengths_nm[0]) for each in response.values())
        return black_body(stated, low, max(float(each.wavelengths_nm[-1]) for each in response.values()))
    found = _curves(stated, curves, where)
    if len(found) != 1:
        raise JobError(
            "MF105",
            f"the illuminant {stated!r} has {len(found)} curves ({', '.join(found)}) where one is needed",
            where=where,
            cure="Give a table of two columns: wavelength_nm and the light's energy",
        )
    return next(iter(found.values()))


def _curves(name: str, curves: Mapping[str, str], where: str) -> Mapping[str, Curve]:
    if name not in curves:
        raise JobError(
            "MF105",
            f"the curves {name!r} are not part of the job",
            where=where,
            cure="Load the job from its file, or give the table's text by that name",
        )
    return parse_curves(curves[name], f"{where}: {name}")
