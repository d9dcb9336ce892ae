"""What a camera took, as a fit takes it: pixels in micrometres about the light, and their noise."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from maskfab.capture.die_image import Pixels
from maskfab.capture.frames import Frame
from maskfab.capture.merge import Merged, Plane
from maskfab.errors import SourceError

Floats = NDArray[np.float64]

_NEAR = 3
_STANDS_OUT, _LEAST_COUNTS = 12.0, 0.5
_SIGMA_PER_MAD = 1.4826


@dataclass(frozen=True, eq=False)
class Taken:
    """What the pixels of one grid took, with its noise.

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
        """The same with the noise of a model's light: that of what was measured favours what came out dark."""
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


def middle_of_light(frames: Sequence[Frame], side: int) -> tuple[int, int]:
    """Row and column about which a square of ``side`` pixels with the light in it lies in the frames.

    The light is the brightest place of the shortest exposure in which it stands out of the noise; the square is moved
    by up to a quarter of itself where the frame ends.

    Raises:
        SourceError: MF334 if there is no light that stands out, MF337 if it lies too near the frame's edge.
    """
    for frame in sorted(frames, key=lambda each: each.exposure_s or 0.0):
        counts = frame.counts.mean(axis=0) if frame.counts.ndim == 3 else frame.counts
        # Of every four neighbours, so that all colours of a mosaic are in each mean.
        even = counts[: counts.shape[0] // 2 * 2, : counts.shape[1] // 2 * 2].astype(np.float64)
        means = even.reshape(even.shape[0] // 2, 2, -1, 2).mean(axis=(1, 3))
        middle = float(np.median(means))
        noise = _SIGMA_PER_MAD * float(np.median(abs(means - middle)))
        if means.max() - middle < _STANDS_OUT * max(noise, _LEAST_COUNTS):
            continue
        row, column = (2 * int(k) for k in np.unravel_index(int(means.argmax()), means.shape))
        return _fitting(row, frame.shape[0], side, frame), _fitting(column, frame.shape[1], side, frame)
    raise SourceError(
        "MF334",
        f"nothing stands out of the noise in {len(frames)} frames by {_STANDS_OUT:g} standard deviations",
        where=frames[0].name,
        cure="Expose longer, or put a point light before the plate",
    )


def _fitting(at: int, length: int, side: int, frame: Frame) -> int:
    held = min(max(at, side // 2), length - (side - side // 2))
    if abs(held - at) > side // 4:
        raise SourceError(
            "MF337",
            f"the light lies {min(at, length - at)} pixels from the edge of the picture, and a window of {side} pixels "
            f"needs {side // 4}",
            where=frame.name,
            cure="Put the light nearer the middle of the picture, or ask for a smaller window",
        )
    return held
