"""The camera that photographs are taken with: all of a job's [camera] that their transfer depends on."""

from __future__ import annotations

import math
from dataclasses import dataclass

from maskfab.errors import JobError
from maskfab.model import Camera, Stop
from maskfab.units import NM_PER_UM

COLOURS = 3
_SHAPES = ("circle", "square", "annulus")


@dataclass(frozen=True)
class PhotoCamera:
    """A lens behind the panel, and the sensor's pixels.

    Attributes:
        focal_um: focal length.
        stop: alike under the eight elements of D4, as the cells are turned and mirrored.
        pixel_um: side of a pixel, which is sensitive all over.
        wavelengths_nm: the longest first; three are red, green and blue.

    Raises:
        JobError: MF133 for a stop that is not alike when turned by 90 degrees or mirrored.
    """

    focal_um: float
    stop: Stop
    pixel_um: float
    wavelengths_nm: tuple[float, ...]

    def __post_init__(self) -> None:
        if self.stop.shape not in _SHAPES or len(set(self.stop.sides_um)) > 1:
            raise JobError(
                "MF133",
                f"photographs are judged behind stops that look the same turned by 90 degrees or mirrored, and this is "
                f"the {self.stop.shape} of {self.stop.diameter_um:g} um",
                where="camera.stop",
                cure="Give a circle, a square or an annulus; run, analyse, plan, simulate and design with method = "
                '"relax" take other shapes',
            )
        object.__setattr__(self, "wavelengths_nm", tuple(sorted(self.wavelengths_nm, reverse=True)))

    @classmethod
    def of(cls, camera: Camera, *, where: str = "", colours: bool = False) -> PhotoCamera:
        """The parts of a job's camera that photographs depend on.

        Args:
            camera: of a job.
            where: of the job, for errors.
            colours: photographs are to be taken, in red, green and blue.

        Raises:
            JobError: MF133 as for the type; MF134 for other than three wavelengths where colours are wanted.
        """
        try:
            found = cls(camera.focal_um, camera.stop, camera.pixel_um, camera.wavelengths_nm)
            _ = colours and found.colours_nm
        except JobError as error:
            place = f"{where}: {error.where}" if where else error.where
            raise JobError(error.code, error.what, where=place, cure=error.cure) from None
        return found

    @property
    def middle_nm(self) -> float:
        """The wavelength that stands for all where one must: green of three, the longer of two."""
        return self.wavelengths_nm[(len(self.wavelengths_nm) - 1) // 2]

    @property
    def shortest_nm(self) -> float:
        """Blue of three."""
        return self.wavelengths_nm[-1]

    @property
    def colours_nm(self) -> tuple[float, ...]:
        """Of red, green and blue.

        Raises:
            JobError: MF134 unless there are three.
        """
        if len(self.wavelengths_nm) != COLOURS:
            raise JobError(
                "MF134",
                f"photographs have red, green and blue, and the camera has {len(self.wavelengths_nm)} wavelengths",
                where="camera.wavelengths",
                cure="Give three",
            )
        return self.wavelengths_nm

    @property
    def is_f1(self) -> bool:
        """Whether it is the camera of protocol F1.

        What its sampling folds back is taken from the nearest whole lag, as the protocol defines its numbers. Behind
        other cameras it is interpolated, which is exact for square dots.
        """
        return self == F1

    def cycle_um(self, wavelength_nm: float) -> float:
        """The lag in the stop's plane of one cycle per pixel, λf / pixel."""
        return wavelength_nm / NM_PER_UM * self.focal_um / self.pixel_um

    def reach(self, wavelength_nm: float) -> float:
        """The highest frequency that the stop passes along an axis, cycles per pixel."""
        return self.stop.diameter_um / self.cycle_um(wavelength_nm)

    def orders(self, wavelength_nm: float) -> int:
        """Most multiples of the sampling frequency from which anything is folded back to half a cycle per pixel."""
        return max(0, math.ceil(self.reach(wavelength_nm) + 0.5) - 1)


def camera_line(camera: Camera | PhotoCamera) -> str:
    """Lens, stop, pixel and wavelengths in one line, the same for cameras that take the same photographs."""
    lines = "/".join(f"{nm:.15g}" for nm in sorted(camera.wavelengths_nm, reverse=True))
    stop = f"{camera.stop.shape} {_sides(camera.stop)} um"
    return f"focal {camera.focal_um:.15g} um, stop {stop}, pixel {camera.pixel_um:.15g} um, {lines} nm"


def _sides(stop: Stop) -> str:
    if stop.outline_um:
        return ", ".join(f"{x:.15g} {y:.15g}" for x, y in stop.outline_um)
    sides = " x ".join(f"{side:.15g}" for side in dict.fromkeys(stop.sides_um))
    return f"{sides} less {stop.inner_share:.12g}" if stop.inner_share else sides


F1 = PhotoCamera(10_000.0, Stop("circle", 4000.0), 2.0, (610.0, 530.0, 470.0))
"""The camera of protocol F1, of red, green and blue."""
