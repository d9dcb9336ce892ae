"""The scene of a camera: distances, field, gap, aberrations, distortion and the bands of light, as [scene] states them.

Distortion is radial, pincushion or barrel, of the third order alone: r becomes r (1 + k (r / h)²) (Born and Wolf,
Principles of Optics, 5.3). Light that the openings diffract comes to the lens under another angle, so it lands where
the lens images an object under that angle.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace
from types import MappingProxyType

import numpy as np
import scipy

from maskfab.base.arrays import Floats
from maskfab.base.errors import JobError
from maskfab.base.model import Psf
from maskfab.job.camera import Camera
from maskfab.job.process import MaskBlank
from maskfab.job.sections import SceneSection
from maskfab.job.values import MOST_DISTORTION
from maskfab.optics.phase import Wavefront
from maskfab.optics.response import black_body, camera_bands, generic_rgb, parse_curves
from maskfab.optics.spectrum import Band, Curve

SPLINE_REACH = 8
"""Samples beyond the outermost point that the spline between samples needs: its poles decay by 0.43 a sample."""

# Newton's steps end when they no longer tell, a hundred roundings.
_STEPS, _STILL = 60, 2e-14


@dataclass(frozen=True)
class Distortion:
    """Radial distortion of the third order: an image height r becomes r (1 + k (r / h)²).

    Attributes:
        ratio: k, the relative displacement at ``height_um``; pincushion if positive, barrel if negative.
        height_um: h, an image height without distortion.

    Raises:
        JobError: MF104 if a value is not finite, the height not positive, or |k| above 0.3.
    """

    ratio: float
    height_um: float

    def __post_init__(self) -> None:
        if not abs(self.ratio) <= MOST_DISTORTION:
            what = f"distortion of {self.ratio:g} is beyond {MOST_DISTORTION:g}"
            raise JobError("MF104", what, cure="Give it as a ratio: 0.02 for 2 %, negative for a barrel")
        if not (math.isfinite(self.height_um) and self.height_um > 0):
            what = f"the height of the distortion is {self.height_um:g} um"
            raise JobError("MF104", what, cure="Give the image height at which it was measured")

    @property
    def farthest_um(self) -> float:
        """The largest image height with an object: where a barrel turns back; infinite for a pincushion."""
        return math.inf if self.ratio >= 0 else 2 / 3 * self.height_um / math.sqrt(-3 * self.ratio)

    def displaced(self, x_um: Floats, y_um: Floats) -> tuple[Floats, Floats]:
        """Where points of the undistorted picture land, in micrometres."""
        stretch = 1 + self.ratio * (x_um**2 + y_um**2) / self.height_um**2
        return x_um * stretch, y_um * stretch

    def undistorted(self, x_um: Floats, y_um: Floats) -> tuple[Floats, Floats]:
        """The points of the undistorted picture that land there: the inverse of :meth:`displaced`.

        Raises:
            JobError: MF104 beyond ``farthest_um``.
        """
        radius = np.hypot(x_um, y_um)
        if float(np.max(radius)) >= self.farthest_um:
            what = (
                f"an image height of {float(np.max(radius)):g} um is beyond {self.farthest_um:g} um, where a barrel of "
                f"{self.ratio:g} at {self.height_um:g} um folds the picture"
            )
            cure = "State less distortion, a smaller field or a smaller window"
            raise JobError("MF104", what, where="scene.distortion", cure=cure)
        # Newton's steps from within fall or rise to the root without a turn, as the cubic bends one way up to the fold.
        root = radius
        for _ in range(_STEPS):
            share = self.ratio * (root / self.height_um) ** 2
            change = (root * (1 + share) - radius) / (1 + 3 * share)
            root = root - change
            if float(np.max(abs(change))) <= _STILL * self.height_um:
                break
        inward = np.divide(root, radius, out=np.ones_like(root), where=radius > 0)
        return x_um * inward, y_um * inward

    def magnification(self, x_um: Floats, y_um: Floats) -> Floats:
        """Factor by which a small area about a point of the undistorted picture grows.

        Along the radius the scale is 1 + 3 k (r / h)², across it 1 + k (r / h)².
        """
        share = self.ratio * (x_um**2 + y_um**2) / self.height_um**2
        return (1 + share) * (1 + 3 * share)


@dataclass(frozen=True, eq=False)
class DistortedWindow:
    """A window on the sensor about an image point, as the undistorted picture has it.

    Attributes:
        middle_um: the image point without distortion.
        x_um, y_um: float64 [n, n], offsets from there of what the samples of the window show.
        magnification: float64 [n, n], of areas about them.
    """

    middle_um: tuple[float, float]
    x_um: Floats
    y_um: Floats
    magnification: Floats

    @classmethod
    def about(cls, lens: Distortion, image_um: tuple[float, float], step_um: float, half: int) -> DistortedWindow:
        """The window of 2 half + 1 samples along a side. Raises JobError MF104 where the lens folds the picture."""
        offset = step_um * np.arange(-half, half + 1, dtype=np.float64)
        x, y = lens.undistorted(*np.meshgrid(image_um[0] + offset, image_um[1] + offset))
        middle_x, middle_y = (float(at) for at in lens.undistorted(np.array(image_um[0]), np.array(image_um[1])))
        return cls((middle_x, middle_y), x - middle_x, y - middle_y, lens.magnification(x, y))

    def half(self, step_um: float) -> int:
        """Samples of that step on either side of the middle that the window takes of an undistorted PSF."""
        return math.ceil(max(float(abs(self.x_um).max()), float(abs(self.y_um).max())) / step_um) + SPLINE_REACH

    def of(self, psf: Psf, step_um: float, order: int = 5) -> Psf:
        """An undistorted PSF as the sensor gets it; what it does not hold is dark.

        The intensity at s is I(q(s)) over the magnification at q, so energy is kept. A spline of that order
        interpolates between samples; the cubic takes a third of the time.
        """
        middle = psf.values.shape[0] // 2
        places = [self.y_um / psf.step_um + middle, self.x_um / psf.step_um + middle]
        values = scipy.ndimage.map_coordinates(psf.values, places, order=order, mode="constant")
        return Psf(values / self.magnification, step_um, psf.wavelength_nm, psf.kind)


_NONE: Mapping[str, str] = MappingProxyType({})


@dataclass(frozen=True)
class Scene:
    """Scene of a camera; the defaults ask for nothing.

    Attributes:
        nearest_um, farthest_um: distances of objects from the lens.
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
        low = min(float(curve.wavelengths_nm[0]) for curve in response.values())
        return black_body(stated, low, max(float(curve.wavelengths_nm[-1]) for curve in response.values()))
    table = _curves(stated, curves, where)
    if len(table) != 1:
        what = f"the illuminant {stated!r} has {len(table)} curves ({', '.join(table)}) where one is needed"
        cure = "Give a table of two columns: wavelength_nm and the light's energy"
        raise JobError("MF105", what, where=where, cure=cure)
    return next(iter(table.values()))


def _curves(name: str, curves: Mapping[str, str], where: str) -> Mapping[str, Curve]:
    if name not in curves:
        cure = "Load the job from its file, or give the table's text by that name"
        raise JobError("MF105", f"the curves {name!r} are not part of the job", where=where, cure=cure)
    return parse_curves(curves[name], f"{where}: {name}")
