"""The light of a display as the eye's optics and nerves take it: a Fourier series up to what they pass."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
import scipy.fft
from numpy.typing import NDArray

from maskfab.base.arrays import Floats
from maskfab.errors import JobError
from maskfab.eye.display_light import EmittedLight
from maskfab.eye.viewing import Viewing

MOST_SEEN = 1 << 20
"""Samples of a picture as the eye takes it in."""


@dataclass(frozen=True, eq=False)
class Series:
    """Coefficients c(k) of L(r) = sum over k of c(k) exp(2 pi i k r), for light that repeats beyond its edges.

    Attributes:
        coefficients: complex128 [3, y, x]; y runs from -K to K, x from 0 to K (the rest is their conjugate).
        y_cpd, x_cpd: the frequencies, cycles per degree.
        pixels: rows and columns of pixels.
        pitch_um: from pixel to pixel.
        pixel_deg: the same as an angle.
    """

    coefficients: NDArray[np.complex128]
    y_cpd: Floats
    x_cpd: Floats
    pixels: tuple[int, int]
    pitch_um: float
    pixel_deg: float

    @property
    def radius_cpd(self) -> Floats:
        """[y, x] length of the frequency vector."""
        radius: Floats = np.hypot(self.y_cpd[:, None], self.x_cpd)
        return radius

    def filtered(self, gain: Callable[[Floats], Floats], mix: Floats | None = None) -> Series:
        """The light after ``mix`` [n, 3] of its colours and a gain [n, y, x] (or [y, x]) of the frequency."""
        mixed = self.coefficients if mix is None else np.tensordot(mix, self.coefficients, axes=1)
        return replace(self, coefficients=mixed * gain(self.radius_cpd))

    def displaced(self, x_px: float, y_px: float) -> Series:
        """The light displaced right and up by a distance in pixels."""
        degrees_y, degrees_x = (self.pixel_deg * shift for shift in (y_px, x_px))
        turn = np.exp(-2j * np.pi * degrees_y * self.y_cpd)[:, None] * np.exp(-2j * np.pi * degrees_x * self.x_cpd)
        return replace(self, coefficients=self.coefficients * turn)

    def values(self, samples: int) -> Floats:
        """[3, y, x] the series at the middles of ``samples`` squares along each pixel, which must carry its band.

        Raises:
            JobError: MF115 if that is too many samples: an eye near the display resolves too much of it.
        """
        rows, columns = (count * samples for count in self.pixels)
        _refuse_too_many(rows, columns)
        most_y, most_x = len(self.y_cpd) // 2, len(self.x_cpd) - 1
        if 2 * most_y >= rows or 2 * most_x >= columns:
            raise ValueError(f"{samples} samples per pixel cannot carry {most_x} cycles on {columns} samples")
        spectrum = np.zeros((len(self.coefficients), rows, columns // 2 + 1), dtype=np.complex128)
        y, x = np.arange(-most_y, most_y + 1), np.arange(most_x + 1)
        phase = np.exp(1j * np.pi * y / rows)[:, None] * np.exp(1j * np.pi * x / columns)
        spectrum[:, y % rows, : most_x + 1] = self.coefficients * phase
        found: Floats = scipy.fft.irfft2(spectrum, s=(rows, columns), overwrite_x=True) * (rows * columns)
        return found


def series(light: EmittedLight, viewing: Viewing, highest_cpd: float) -> Series:
    """The Fourier series of light up to ``highest_cpd`` along x and along y.

    Raises:
        JobError: MF115 if these are too many: an eye near the display resolves too much of it.

    Notes:
        The samples are squares of constant light, so their series is their discrete transform, which repeats, times
        the sinc of a square: exact at every frequency, also above the grid's own Nyquist frequency.
    """
    rows, columns = light.rgb.shape[1:]
    high, wide = light.pixels
    degrees = high / viewing.pixels_per_degree, wide / viewing.pixels_per_degree
    most_y, most_x = (math.floor(highest_cpd * side) for side in degrees)
    _refuse_too_many(2 * most_y + 1, 2 * most_x + 1)
    y, x = np.arange(-most_y, most_y + 1), np.arange(most_x + 1)
    # exp(-i pi k / n) moves the origin from the middle of sample 0 to its corner.
    weight_y = np.sinc(y / rows) * np.exp(-1j * np.pi * y / rows) / rows
    weight_x = np.sinc(x / columns) * np.exp(-1j * np.pi * x / columns) / columns
    found = np.empty((3, len(y), len(x)), dtype=np.complex128)
    for colour in range(3):
        if 2 * x[-1] <= columns:
            lines = scipy.fft.rfft(light.rgb[colour], axis=1)[:, : len(x)]
        else:
            lines = scipy.fft.fft(light.rgb[colour], axis=1)[:, x % columns]
        found[colour] = scipy.fft.fft(lines, axis=0)[y % rows]
    found *= weight_y[:, None] * weight_x
    return Series(found, y / degrees[0], x / degrees[1], light.pixels, light.pitch_um, 1.0 / viewing.pixels_per_degree)


def _refuse_too_many(rows: int, columns: int) -> None:
    if rows * columns > MOST_SEEN:
        raise JobError(
            "MF115",
            f"from this distance the eye resolves {columns} x {rows} samples of the picture, more than {MOST_SEEN}",
            where="distance, pixels",
            cure="Look from farther away, or show fewer pixels",
        )
