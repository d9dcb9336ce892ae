r"""Where light lands on the sensor, and from where it comes: a lens's projection and distortion, and a tilted panel.

A plane wave of direction cosines (l₀, m₀, n₀), n₀ towards the sensor, meets a thin panel of transmission t in front of
the stop. In the panel's own plane it is a plane wave again, so what leaves towards (l, m) has the amplitude

    F((l' - l₀') / λ, (m' - m₀') / λ),    F the Fourier integral of t inside the stop's footprint on the panel,

primed cosines those along the panel's x and y (J. W. Goodman, Introduction to Fourier Optics, 3.10: the angular
spectrum, without a small angle). The lens images each direction to one place p on the sensor, so the point PSF is

    I(p) = |F|² / (λ² E) |∂(l', m') / ∂p|,    E = ∫ |t|² over the footprint,

whose integral is 1 up to waves that are evanescent. That holds, exactly, what small angles call foreshortening of
openings and stop, F at u cos θ for a direction and at u cos² θ for a place under f tan θ, and the tangent in place of
the sine over the window. An extended scene of even radiance lights the place p by

    f² |∂(l, m) / ∂p|  of what it lights the axis by:    cos⁴ θ under f tan θ, sin θ cos θ / θ under f θ.

* **Projection.** Image height r over the angle θ off the axis: d tan θ, d from lens to sensor, which a distortion of
  the third order may follow, r (1 + k (r / h)²) (Born and Wolf, Principles of Optics, 5.3); d θ; or d / f times a
  table's, of which θ(r) is the odd cubic spline. Light that the openings diffract comes to the lens under another angle
  and lands where the lens images an object under that angle.
* **Panel and stop.** The stop is the lens's entrance pupil: it stays where it is, as large, at all angles. A panel that
  is tilted by τ about y, its +x side away from the lens, and g in front of the stop is pierced at X, Y by the ray of
  slopes s = l₀ / n₀, t = m₀ / n₀ that meets the stop's plane at

      x = X (cos τ + s sin τ) + s g,    y = Y + t (g + X sin τ),

  and the footprint is the stop under the inverse of that. Over a gap light walks by g tan θ, and through glass of index
  n and thickness b by b tan θ' with sin θ' = sin θ / n (Snell).
* **Left out.** Polarisation, walls of thick films beyond what the model bar tells, vignetting by the lens's barrel,
  a pupil that wanders or swells with the angle, and Fresnel's losses in glass, which dim a place and shape nothing.

Notes:
    A PSF on even samples of direction cosines is brought to the places by its Fourier series, see
    :meth:`SensorWindow.of`: it has no frequency beyond the footprint's width, so nothing is lost.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from functools import cached_property, lru_cache

import numpy as np
import scipy

from maskfab.base.arrays import Floats, fast_length
from maskfab.base.errors import JobError
from maskfab.base.model import Psf
from maskfab.job.camera import Camera, Stop
from maskfab.job.values import MOST_DISTORTION
from maskfab.optics.psf import OVERSAMPLING, point_step_um
from maskfab.optics.stop import Waves

# Newton's steps end when they no longer tell, a hundred roundings.
_STEPS, _STILL = 60, 2e-14
# A lens's table may differ so much from the focal length near the axis; heights f θ end this near to a right angle.
_FOCAL_SLACK, _STEEPEST_RAD = 0.01, math.radians(89.0)
# Sides of a polygon in place of a round footprint that is sheared. Its ripple throws light far beyond any window.
_ROUND_SIDES = 1024


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
        """The points of the undistorted picture that land there (:meth:`displaced`); MF104 beyond ``farthest_um``."""
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

    def objects(self, x_um: Floats, y_um: Floats) -> tuple[Floats, Floats, Floats]:
        """:meth:`undistorted` of places on the sensor, and :meth:`magnification` there."""
        place = self.undistorted(x_um, y_um)
        return *place, self.magnification(*place)

    def magnification(self, x_um: Floats, y_um: Floats) -> Floats:
        """Factor by which a small area about a point of the undistorted picture grows.

        Along the radius the scale is 1 + 3 k (r / h)², across it 1 + k (r / h)².
        """
        share = self.ratio * (x_um**2 + y_um**2) / self.height_um**2
        return (1 + share) * (1 + 3 * share)


@dataclass(frozen=True)
class Projection:
    """A projection other than f tan θ, as rows of image height over the angle off the axis.

    Attributes:
        angles_rad, heights_um: of the rows, ascending, above 0; θ(r) is the odd cubic spline through them.
        name: "f theta", or "a table".

    Raises:
        JobError: MF104 for rows that do not rise, a spline that turns back between them, or one of another focal length
            near the axis by more than 1 %.
    """

    focal_um: float
    angles_rad: tuple[float, ...]
    heights_um: tuple[float, ...]
    name: str = "a table"

    def __post_init__(self) -> None:
        rises = all(np.diff(ends, prepend=0.0).min() > 0 for ends in (self.angles_rad, self.heights_um))
        problem = "" if rises else "does not rise from row to row"
        if rises:
            slope = self._curve.derivative()
            turns = [x for x in slope.derivative().roots(extrapolate=False) if math.isfinite(x)]
            if float(slope([*slope.x, *turns]).min()) <= 0:
                problem = "turns back between its rows"
            elif abs(float(slope(0.0)) * self.focal_um - 1) > _FOCAL_SLACK:
                problem = f"is of a focal length of {1 / slope(0.0):.5g} um on the axis, not {self.focal_um:g} um"
        if problem:
            cure = "Give rows of angle and height of this lens, both rising from above 0 to the edge of the field"
            raise JobError("MF104", f"the projection {problem}", where="scene.projection", cure=cure)

    @classmethod
    def even(cls, focal_um: float) -> Projection:
        """Heights f θ."""
        angles = tuple(float(share * _STEEPEST_RAD) for share in (0.25, 0.5, 0.75, 1.0))
        return cls(focal_um, angles, tuple(focal_um * angle for angle in angles), "f theta")

    @cached_property
    def _curve(self) -> scipy.interpolate.CubicSpline:
        rows = [np.array(ends) for ends in (self.heights_um, self.angles_rad)]
        return scipy.interpolate.CubicSpline(*(np.concatenate([-ends[::-1], [0.0], ends]) for ends in rows))

    def height_at(self, angle_rad: float) -> float:
        """Image height of an angle, in micrometres. Raises JobError MF104 beyond the last row."""
        found = self._curve.solve(min(angle_rad, self.angles_rad[-1]), extrapolate=False)
        if angle_rad > self.angles_rad[-1]:
            self._refuse(f"{math.degrees(angle_rad):g}", f"{math.degrees(self.angles_rad[-1]):g} degrees")
        return float(max(found))

    def objects(self, x_um: Floats, y_um: Floats) -> tuple[Floats, Floats, Floats]:
        """Where a lens of that focal length would image under f tan θ what lands there, and how much smaller an area.

        Raises:
            JobError: MF104 beyond the last row.
        """
        radius = np.hypot(x_um, y_um)
        if float(np.max(radius)) > self.heights_um[-1]:
            self._refuse(f"{float(np.max(radius)):g}", f"{self.heights_um[-1]:g} um")
        slope, tangent = self._curve(radius, 1), np.tan(self._curve(radius))
        outward = self.focal_um * np.where(radius > 0, tangent / np.where(radius > 0, radius, 1.0), slope)
        return x_um * outward, y_um * outward, 1 / (outward * self.focal_um * (1 + tangent**2) * slope)

    def _refuse(self, what: str, limit: str) -> None:
        cure = "Give the projection's table more rows, or ask for a smaller field or window"
        raise JobError("MF104", f"{what} is beyond the projection's {limit}", where="scene.projection", cure=cure)


@dataclass(frozen=True)
class Lens:
    """The way from the panel's own plane to the sensor.

    Attributes:
        focal_um, distance_um: f, and d from lens to sensor.
        mapping: what stands between a picture under f tan θ and the sensor; None for nothing.
        tilt_rad: τ, of the panel about y, its +x side away from the lens.
    """

    focal_um: float
    distance_um: float
    mapping: Distortion | Projection | None = None
    tilt_rad: float = 0.0

    def slopes(self, x_um: Floats, y_um: Floats) -> tuple[Floats, Floats, Floats]:
        """tan θ along x and y of the light that lands at places, and |∂(slopes) / ∂p| per square micrometre."""
        if self.mapping is None:
            area: Floats = np.full(np.broadcast(x_um, y_um).shape, 1 / self.distance_um**2)
            return x_um / self.distance_um, y_um / self.distance_um, area
        # A table is of a lens in focus at infinity; a distortion is as measured on the sensor.
        scale = self.distance_um / self.focal_um if isinstance(self.mapping, Projection) else 1.0
        tx, ty, magnification = self.mapping.objects(x_um / scale, y_um / scale)
        unit = scale / self.distance_um
        return tx * unit, ty * unit, 1 / (magnification * self.distance_um**2)

    def directions(self, x_um: Floats, y_um: Floats) -> tuple[Floats, Floats, Floats]:
        """l' and m' of the light that lands at places, and |∂(l', m') / ∂p| per square micrometre."""
        sx, sy, area = self.slopes(x_um, y_um)
        ahead = 1 / np.sqrt(1 + sx**2 + sy**2)
        cosine, sine = math.cos(self.tilt_rad), math.sin(self.tilt_rad)
        return ahead * (sx * cosine - sine), ahead * sy, area * ahead**4 * (cosine + sx * sine)

    def illumination(self, image_um: tuple[float, float]) -> float:
        """Light at a place of the sensor by that on the axis, of an even scene through the stop alone."""
        (sx, _), (sy, _), (area, on_axis) = self.slopes(*(np.array([at, 0.0]) for at in image_um))
        return float(area / on_axis / (1 + sx**2 + sy**2) ** 2)

    def slopes_at(self, image_um: tuple[float, float]) -> tuple[float, float]:
        """tan θ along x and y of the light that lands at a place."""
        sx, sy, _ = self.slopes(*(np.array(at) for at in image_um))
        return float(sx), float(sy)

    def footprint(self, stop: Stop, slopes: tuple[float, float], gap_um: float) -> Footprint:
        """The part of the panel that light of slopes towards the sensor meets inside the stop.

        Raises:
            JobError: MF104 for an annulus that is sheared, which a tilt does off the x axis.
        """
        (sx, sy), cosine, sine = slopes, math.cos(self.tilt_rad), math.sin(self.tilt_rad)
        narrow, shear = cosine + sx * sine, sy * sine
        moved = gap_um * sx / narrow, gap_um * sy * cosine / narrow
        if not sine:
            return Footprint(stop, moved)
        if not shear:
            return Footprint(stop.scaled(1 / narrow, 1.0), moved, narrow)
        if stop.inner_share:
            what = "an annular stop behind a tilted panel has no footprint of a shape of its own off the x axis"
            raise JobError("MF104", what, where="scene.tilt", cure="State a circle, or no tilt")
        corners = [(x / narrow, y - shear * x / narrow) for x, y in _corners(stop)]
        return Footprint(Stop.polygon(corners), moved, narrow, shear)


@dataclass(frozen=True)
class Footprint:
    """The stop as light cuts it out of the panel.

    Attributes:
        stop: its outline, in the panel's own plane.
        moved_um: by how much openings move to lie in front of it.
        narrow, shear: x = X narrow and y = Y + X shear are places in the lens's stop of those in the outline.
    """

    stop: Stop
    moved_um: tuple[float, float]
    narrow: float = 1.0
    shear: float = 0.0

    def waves(self, waves: Waves) -> Waves:
        """A phase over the lens's stop as one over the outline."""
        return lambda x_um, y_um: waves(x_um * self.narrow, y_um + self.shear * x_um)


def _corners(stop: Stop) -> list[tuple[float, float]]:
    """Corners of a stop; of a round one those of a polygon of the same area."""
    if not stop.round:
        return list(stop.corners_um)
    angle = 2 * np.pi * np.arange(_ROUND_SIDES) / _ROUND_SIDES
    larger = math.sqrt(2 * math.pi / _ROUND_SIDES / math.sin(2 * math.pi / _ROUND_SIDES))
    width, height = (larger * side / 2 for side in stop.sides_um)
    return list(zip((width * np.cos(angle)).tolist(), (height * np.sin(angle)).tolist(), strict=True))


_FADE, _EPSILON = 34.0, 1e-13
TAPER = 2 * math.ceil(_FADE / (math.pi * (1 - 1 / OVERSAMPLING)) + 1)
"""Samples beyond the outermost place over which :meth:`SensorWindow.of` lets a PSF fade: 2a / h."""

RESAMPLED = 1e-10
"""Bound of the relative L2 error of a PSF by :meth:`SensorWindow.of`."""


@dataclass(frozen=True, eq=False)
class SensorWindow:
    """A window on the sensor about an image point, as a PSF over even samples of direction cosines has it.

    Attributes:
        x_um, y_um: float64 [n, n], d (l' - l₀') and d (m' - m₀') of the light that lands on its samples.
        magnification: float64 [n, n], of areas there on the way to the sensor.
    """

    x_um: Floats
    y_um: Floats
    magnification: Floats

    @classmethod
    def about(cls, lens: Lens, image_um: tuple[float, float], step_um: float, half: int) -> SensorWindow:
        """The window of 2 half + 1 samples along a side. Raises JobError MF104 where the lens has no picture."""
        offset = step_um * np.arange(-half, half + 1, dtype=np.float64)
        across, up, area = lens.directions(*np.meshgrid(image_um[0] + offset, image_um[1] + offset))
        x, y = (lens.distance_um * (cosine - cosine[half, half]) for cosine in (across, up))
        return cls(x, y, 1 / (lens.distance_um**2 * area))

    def half(self, step_um: float) -> int:
        """Samples of that step on either side of the middle that the window takes of a PSF."""
        return math.ceil(max(float(abs(self.x_um).max()), float(abs(self.y_um).max())) / step_um) + TAPER

    def camera(self, camera: Camera, stop: Stop) -> Camera:
        """The camera of the PSF that the window takes: of a stop, its samples as fine as that asks for, and as wide."""
        finer = replace(camera, stop=stop)
        step = point_step_um(finer)
        return replace(finer, window_um=(2 * self.half(step) + 1) * step)

    def of(self, psf: Psf, step_um: float) -> Psf:
        r"""A PSF as the sensor gets it: I(q(p)) over the magnification, so that energy is kept.

        Args:
            psf: I, of :meth:`half` samples or more on either side, at least 1.15 to a period of its highest frequency
                B, which is the footprint's width over λd, and twice that for half a period.
            step_um: of this window's samples.

        Notes:
            I is known between samples h apart by the Fourier series of g = I w. Along either axis w is 1 over the
            window, and fades over 2a beyond it as the integral of Kaiser's I₀(β sqrt(1 - (x/a)²)), of transform K̂. The
            series errs at any place by twice the sum of its terms beyond half a cycle per sample, and these are ŵ's
            beyond Δ = 1 / 2h - B, with |ŵ(μ)| ≤ K̂(μ) / πμ and K̂(μ) ≤ 2β e^{-β} min(1, 1/x), x² = (2πaμ)² - β². From
            2πaΔ ≥ β on, the integral of both sides of that is 2 e^{-β}, and ∫ |Î| ≤ 2B ‖I‖ by Cauchy and Schwarz, so
            both axes err by 8B ‖I‖ 2e^{-β} at a place, and by 7n e^{-β} ‖I‖ over n samples a side: 1e-10 for 8000 of
            them at β = 34. Sums are good for 1e-13 (finufft: Barnett, Magland, af Klinteberg 2019).
        """
        import finufft

        count = psf.values.shape[0]
        fade = _fade(count)
        size = fast_length(count, (3, 5, 7))
        terms = scipy.fft.fft2(psf.values * (fade * fade[:, None]), (size, size), workers=1) / size**2
        sample = 2 * np.pi / size
        places = (sample * (at.ravel() / psf.step_um + count // 2) % (2 * np.pi) for at in (self.y_um, self.x_um))
        values = finufft.nufft2d2(*places, terms, isign=1, eps=_EPSILON, modeord=1, nthreads=1).real
        return Psf(values.reshape(self.x_um.shape) / self.magnification, step_um, psf.wavelength_nm, psf.kind)


@lru_cache(maxsize=16)
def _fade(count: int) -> Floats:
    """w, [count]: 0 to 1 over ``TAPER`` samples at either end."""
    across = np.linspace(-1, 1, 64 * TAPER + 1)
    rise = np.cumsum(np.i0(_FADE * np.sqrt(1 - across**2)))[::64]
    fade = np.ones(count)
    fade[: TAPER + 1] = fade[::-1][: TAPER + 1] = rise / rise[-1]
    fade.flags.writeable = False
    return fade
