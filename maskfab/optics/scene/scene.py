"""The scene of a camera: distances, field, lens, gap, aberrations and the bands of light, as [scene] states them."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace
from types import MappingProxyType

import numpy as np

from maskfab.base.errors import JobError, SourceError
from maskfab.job.camera import Camera
from maskfab.job.process import Glass, MaskBlank
from maskfab.job.sections import SceneSection
from maskfab.job.values import angle_deg
from maskfab.optics.gap import glass_as_air_um
from maskfab.optics.phase import Wavefront, image_distance_um
from maskfab.optics.response import black_body, camera_bands, generic_rgb, numeric_table, parse_curves
from maskfab.optics.scene.lens import Distortion, Lens, Projection
from maskfab.optics.spectrum import Band, Curve

_NONE: Mapping[str, str] = MappingProxyType({})


@dataclass(frozen=True)
class Scene:
    """Scene of a camera; the defaults ask for nothing.

    Attributes:
        nearest_um, farthest_um: distances of objects from the lens.
        field_um: largest image height.
        gap_um: from the panel to the stop, in air that spreads light as much.
        aberrations: pairs of Noll's number and waves at the camera's first line.
        distortion: of a lens with image heights f tan θ; None for none.
        saturation: whether highlights clip, which is left to the capture and adds nothing to the PSF.
        bands: one for each colour, response times illuminant; empty for the camera's own lines.
        projection: of the lens; None for image heights f tan θ.
        tilt_rad: of the panel about y, its +x side away from the lens.
        glass: part of ``gap_um`` that is none of air; None for none.
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
    projection: Projection | None = None
    tilt_rad: float = 0.0
    glass: Glass | None = None

    @classmethod
    def of(
        cls,
        section: SceneSection | None,
        curves: Mapping[str, str] = _NONE,
        *,
        camera: Camera | None = None,
        where: str = "",
    ) -> Scene:
        """The scene of a job; the one that asks for nothing if the job has none.

        Args:
            curves: text of the tables that it names, by name, as ``JobSpec.curves`` holds them.
            camera: for a field that is an angle, or a projection other than f tan θ; else it may be None.

        Raises:
            SourceError: MF302 or MF303 for an empty or damaged table.
            JobError: MF105 for a table that ``curves`` lacks, or an illuminant of several curves; MF112 for a
                wavelength outside 200 to 2000 nm; MF104 for a curve that is negative, not finite or all zero, or a
                response that the illuminant does not overlap.
        """
        if section is None:
            return cls()
        near, far = section.depth
        focal_um = math.nan if camera is None else camera.focal_um
        if camera is None and (section.projection != "f tan" or isinstance(section.field, str)):
            what = "a field angle or a projection of a lens of which nothing is known"
            raise JobError("MF105", what, where=where, cure="Give the camera too, or an image height")
        projection = _projection(section.projection, curves, focal_um, where)
        scene = cls(
            near, far, section.focus, 0.0, section.gap, section.aberrations, section.saturation,
            _bands(section, curves, where), section.distortion and Distortion(*section.distortion),
            projection, math.radians(section.tilt),
        )  # fmt: skip
        return replace(scene, field_um=_height_um(section.field, scene, focal_um))

    def through(self, blank: MaskBlank) -> Scene:
        """The scene behind the plate's glass: with the chrome away from the lens, its t/n adds to the gap."""
        glass = blank.glass
        if glass is None or not glass.gap_um:
            return self
        return replace(self, gap_um=self.gap_um + glass.gap_um, glass=glass)

    def lens(self, camera: Camera, distance_um: float | None = None) -> Lens:
        """The way from the panel to the sensor of a camera, its sensor that far from the lens; at f if None."""
        away = camera.focal_um if distance_um is None else distance_um
        return Lens(camera.focal_um, away, self.projection or self.distortion, self.tilt_rad)

    def seen(self, slope: float, gap_um: float) -> tuple[float, Glass | None]:
        """The air over which light of that tan θ walks as far sideways as over the gap, and what of that is glass.

        Args:
            gap_um: of the scene, or as :func:`maskfab.optics.gap.magnified` has it; its glass is stretched alike.
        """
        if self.glass is None:
            return gap_um, None
        glass = replace(self.glass, thickness_um=self.glass.thickness_um * gap_um / self.gap_um)
        return gap_um - glass.gap_um + glass_as_air_um(glass, slope), glass

    def slope(self, camera: Camera) -> float:
        """tan θ of the light from the edge of the field, in focus."""
        return self.lens(camera, image_distance_um(camera.focal_um, self.focus_um)).slopes_at((self.field_um, 0.0))[0]

    @property
    def steepest_um(self) -> float:
        """The image height under f tan θ of the largest field: its object's slope times the focal length."""
        mapping = self.projection or self.distortion
        return self.field_um if mapping is None else float(mapping.objects(np.array(self.field_um), np.zeros(()))[0])

    @property
    def widest_um(self) -> float:
        """The larger of the largest image height and of that under f tan θ: how far places of its grid reach."""
        return max(self.field_um, self.steepest_um)

    def wavefront(self, camera: Camera) -> Wavefront:
        """The aberrations; their waves are of the camera's first line."""
        return Wavefront(self.aberrations, camera.wavelengths_nm[0])


def _height_um(field: float | str, scene: Scene, focal_um: float) -> float:
    """Largest image height of a field that a job states as such, or as an angle."""
    if not isinstance(field, str):
        return field
    angle, distance = math.radians(angle_deg(field)), image_distance_um(focal_um, scene.focus_um)
    if scene.projection is not None:
        return scene.projection.height_at(angle) * distance / focal_um
    height = np.array(distance * math.tan(angle))
    return float(height if scene.distortion is None else scene.distortion.displaced(height, np.zeros(()))[0])


def _projection(stated: str, curves: Mapping[str, str], focal_um: float, where: str) -> Projection | None:
    if stated in ("f tan", "f theta"):
        return Projection.even(focal_um) if stated == "f theta" else None
    place = f"{where}: scene.projection".removeprefix(": ")
    header, rows = numeric_table(_text(stated, curves, place), f"{place}: {stated}", ("angle_deg",))
    if header != ["angle_deg", "height_um"]:
        what = f"the table's columns are {', '.join(header)}"
        raise SourceError("MF303", what, where=f"{place}: {stated}", cure="Name them angle_deg,height_um")
    angles, heights = rows[rows.any(axis=1)].T
    return Projection(focal_um, tuple(np.radians(angles).tolist()), tuple(heights.tolist()))


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
        low = min(float(curve.wavelengths_nm[0]) for curve in response.values())
        return black_body(stated, low, max(float(curve.wavelengths_nm[-1]) for curve in response.values()))
    table = _curves(stated, curves, where)
    if len(table) != 1:
        what = f"the illuminant {stated!r} has {len(table)} curves ({', '.join(table)}) where one is needed"
        cure = "Give a table of two columns: wavelength_nm and the light's energy"
        raise JobError("MF105", what, where=where, cure=cure)
    return next(iter(table.values()))


def _curves(name: str, curves: Mapping[str, str], where: str) -> Mapping[str, Curve]:
    return parse_curves(_text(name, curves, where), f"{where}: {name}")


def _text(name: str, curves: Mapping[str, str], where: str) -> str:
    if name not in curves:
        cure = "Load the job from its file, or give the table's text by that name"
        raise JobError("MF105", f"the curves {name!r} are not part of the job", where=where, cure=cure)
    return curves[name]
