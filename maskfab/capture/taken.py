"""Captured light, as a fit takes it: pixels in micrometres about the light, and their noise."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from maskfab.base.arrays import Floats
from maskfab.capture.die_image import Pixels
from maskfab.capture.frames import Frame
from maskfab.capture.merge import Merged, Plane
from maskfab.errors import SourceError

_NEAR = 3


@dataclass(frozen=True, eq=False)
class Taken:
    """Signal of the pixels of one grid, with its noise.

    Attributes:
        pixels: which.
        light: their signal, [rows, columns], in any one unit of light.
        sigma: standard deviation of each, in the same unit.
        valid: bool, those that count.
        plane: that knows the noise of other light than was measured; None where sigma is the truth.
    """

    pixels: Pixels
    light: Floats
    sigma: Floats
    valid: NDArray[np.bool_]
    plane: Plane | None = None

    def expecting(self, light: Floats) -> Taken:
        """This signal with the noise of a model's light: that of what was measured favours what came out dark."""
        if self.plane is None:
            return self
        sigma = np.where(self.valid, np.sqrt(self.plane.variance(light)), np.inf)
        return replace(self, sigma=np.asarray(sigma))

    def within(self, half_um: float) -> Taken:
        """The pixels that lie no farther than so from the middle along both axes."""
        columns, rows = (abs(axis) <= half_um for axis in (self.pixels.x_um, self.pixels.y_um))
        held = np.ix_(rows, columns)
        pixels = Pixels(self.pixels.colour, self.pixels.x_um[columns], self.pixels.y_um[rows])
        return Taken(pixels, self.light[held], self.sigma[held], self.valid[held])


def taken_of(merged: Merged, pixel_um: float, middle: tuple[float, float]) -> tuple[Taken, ...]:
    """Every colour of merged exposures, seen from a place among their pixels.

    Args:
        merged: the exposures.
        pixel_um: side of a pixel of the sensor, of whatever colour.
        middle: row and column that is the origin.
    """
    return tuple(_of_plane(plane, pixel_um, middle) for plane in merged.planes)


def _of_plane(plane: Plane, pixel_um: float, middle: tuple[float, float]) -> Taken:
    rows, columns = plane.electrons_per_s.shape
    row = plane.first[0] + plane.step * np.arange(rows) - middle[0]
    column = plane.first[1] + plane.step * np.arange(columns) - middle[1]
    pixels = Pixels(plane.colour, np.asarray(pixel_um * column), np.asarray(-pixel_um * row))
    return Taken(pixels, plane.electrons_per_s, plane.sigma, plane.valid, plane)


def brightest(planes: Sequence[Plane]) -> tuple[float, float]:
    """Row and column of the centre of the light, to about a pixel: that of what is above half of the peak's height."""
    best: tuple[float, tuple[float, float]] = (-np.inf, (0.0, 0.0))
    for plane in planes:
        light = np.where(plane.valid, plane.electrons_per_s, 0.0)
        row, column = np.unravel_index(int(light.argmax()), light.shape)
        peak = float(light[row, column])
        if peak > best[0]:
            near = _around(light, int(row), int(column))
            weights = np.where(near >= peak / 2, near, 0.0)
            rows, columns = np.indices(weights.shape)
            total = weights.sum()
            top, left = max(0, int(row) - _NEAR), max(0, int(column) - _NEAR)
            place = (
                plane.first[0] + plane.step * (top + float((weights * rows).sum() / total)),
                plane.first[1] + plane.step * (left + float((weights * columns).sum() / total)),
            )
            best = (peak, place)
    return best[1]


def _around(light: Floats, row: int, column: int) -> Floats:
    return light[max(0, row - _NEAR) : row + _NEAR + 1, max(0, column - _NEAR) : column + _NEAR + 1]


def colours_of(taken: Sequence[Taken]) -> tuple[str, ...]:
    """Colours of the pixels, each once, sorted."""
    return tuple(sorted({each.pixels.colour for each in taken}))


def window_middle(place: tuple[int, int], frame: Frame, side: int) -> tuple[int, int]:
    """Row and column about which a square of ``side`` pixels lies in a frame, a place near its middle.

    Where the frame ends the square is moved, by up to a quarter of itself.

    Raises:
        SourceError: MF337 if the place is nearer to the frame's edge than that allows.
    """
    row, column = (min(max(at, side // 2), length - side // 2) for at, length in zip(place, frame.shape, strict=True))
    if max(abs(row - place[0]), abs(column - place[1])) > side // 4:
        nearest = min(min(at, length - at) for at, length in zip(place, frame.shape, strict=True))
        raise SourceError(
            "MF337",
            f"the light lies {nearest} pixels from the edge of {frame.name}, and a window of {side} pixels needs "
            f"{side // 4}",
            where=frame.name,
            cure="Put the light nearer the middle of the picture, or ask for a smaller window",
        )
    return row, column
