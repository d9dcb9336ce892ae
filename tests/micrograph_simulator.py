"""Microscope pictures of known openings: a renderer that shares nothing with the package but how a file is written.

Every pixel is the mean of points that look up the cell through a projective map; then come blur, uneven light, dirt,
noise and, where asked, the losses of JPEG.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

Floats = NDArray[np.float64]
Cell = Callable[[Floats, Floats], NDArray[np.bool_]]
"""Whether a place is clear, x to the right and y upwards in pitches, of a whole panel."""


def of_mask(mask: NDArray[np.bool_]) -> Cell:
    """Dots [rows, columns] of one cell in every cell, row 0 the lowest."""
    rows, columns = mask.shape

    def clear(x: Floats, y: Floats) -> NDArray[np.bool_]:
        return mask[np.floor(y % 1 * rows).astype(int) % rows, np.floor(x % 1 * columns).astype(int) % columns]

    return clear


def rounded(width: float = 0.55, height: float = 0.4, radius: float = 0.15, notch: float = 0.1) -> Cell:
    """A rounded rectangle with a straight cut at its upper right corner, in pitches."""

    def clear(x: Floats, y: Floats) -> NDArray[np.bool_]:
        u, v = x % 1 - 0.5, y % 1 - 0.5
        over_x = np.maximum(np.abs(u) - width / 2 + radius, 0)
        over_y = np.maximum(np.abs(v) - height / 2 + radius, 0)
        return (np.hypot(over_x, over_y) < radius) & (u + v < (width + height) / 2 - radius - notch / 2)

    return clear


def mirrored(cell: Cell, *, across: bool = True, up: bool = False) -> Cell:
    """Every second cell mirrored from left to right, from top to bottom, or both."""

    def clear(x: Floats, y: Floats) -> NDArray[np.bool_]:
        u = np.where(across & (np.floor(x) % 2 == 1), 1 - x % 1, x % 1)
        v = np.where(up & (np.floor(y) % 2 == 1), 1 - y % 1, y % 1)
        return cell(u, v)

    return clear


@dataclass(frozen=True)
class Microscope:
    """A picture's faults.

    Attributes:
        px_per_um: along a row of pixels.
        turn_deg: of the panel in the picture, anticlockwise.
        perspective: relative change of scale from one side of the picture to the other, along both axes.
        blur_px: sigma of the blur.
        uneven: light at the corners relative to the middle, less one, half of it a slope.
        noise: sigma, of full white.
        dirt: specks in the picture, each of up to 6 % of its height.
        transmitted: whether openings are bright.
        quality: of a JPEG; 0 writes PNG.
    """

    px_per_um: float = 4.0
    turn_deg: float = 1.0
    perspective: float = 0.0
    blur_px: float = 0.8
    uneven: float = 0.15
    noise: float = 0.02
    dirt: int = 3
    transmitted: bool = False
    quality: int = 0
    bright: float = 0.6
    dark: float = 0.08

    def light(self, cell: Cell, pitch_um: float, shape: tuple[int, int], rng: np.random.Generator) -> Floats:
        """Linear light [rows, columns] of 0 to 1, row 0 on top."""
        rows, columns = shape
        number = 3
        fine_y, fine_x = ((np.arange(length * number) + 0.5) / number - 0.5 - length / 2 for length in (rows, columns))
        turn, offset = np.deg2rad(self.turn_deg), rng.uniform(0, 1, 2)
        share = np.zeros(shape)
        for top in range(0, rows, 64):
            y, x = np.meshgrid(-fine_y[top * number : (top + 64) * number], fine_x, indexing="ij")
            depth = 1 + self.perspective * (0.7 * x / columns + 0.5 * y / rows)
            x, y = x / depth, y / depth
            u = (np.cos(turn) * x + np.sin(turn) * y) / (self.px_per_um * pitch_um) + offset[0]
            v = (np.cos(turn) * y - np.sin(turn) * x) / (self.px_per_um * pitch_um) + offset[1]
            clear = cell(u, v).astype(np.float32)
            share[top : top + 64] = clear.reshape(-1, number, columns, number).mean((1, 3))
        share = share if self.transmitted else 1 - share
        light = ndimage.gaussian_filter(self.dark + (self.bright - self.dark) * share, self.blur_px)
        y, x = np.meshgrid(np.linspace(-1, 1, rows), np.linspace(-1, 1, columns), indexing="ij")
        light *= 1 + self.uneven * (0.5 * x - 0.3 * y - 0.35 * (x**2 + y**2))
        for _ in range(self.dirt):
            centre, size = rng.uniform(0, 1, 2) * shape, rng.uniform(0.01, 0.03) * rows
            far = np.hypot(np.arange(rows)[:, None] - centre[0], np.arange(columns) - centre[1])
            light[far < size] *= rng.uniform(0.3, 0.8)
        return np.clip(light + self.noise * rng.standard_normal(shape), 0, 1)

    def photograph(
        self, path: Path, cell: Cell, pitch_um: float, shape: tuple[int, int], rng: np.random.Generator
    ) -> Path:
        """Write the picture, in sRGB codes of 8 bits."""
        import OpenImageIO as oiio  # noqa: N813 - its customary name

        light = self.light(cell, pitch_um, shape, rng)
        code = np.where(light <= 0.0031308, 12.92 * light, 1.055 * light ** (1 / 2.4) - 0.055)
        target = path.with_suffix(".jpg" if self.quality else ".png")
        spec = oiio.ImageSpec(shape[1], shape[0], 3, "uint8")
        if self.quality:
            spec.attribute("CompressionQuality", self.quality)
        out = oiio.ImageOutput.create(str(target))
        assert out.open(str(target), spec)
        assert out.write_image(np.repeat(np.rint(255 * code).astype(np.uint8)[:, :, None], 3, axis=2))
        out.close()
        return target
