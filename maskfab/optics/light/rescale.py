r"""The point spread function of a spectrum from one transform of the pupil.

At wavelength λ the PSF is |F(x / λf)|² / ((λf)² E), one function of frequency read at different scales. |F|² is the
transform of an autocorrelation that ends at lags of ±D along either axis, so samples closer than 1 / (2D) hold all of
it. Here they are twice as close, and the values in between come from a sinc under the window exp(β (√(1 - z²) - 1))
(Barnett, Magland, af Klinteberg 2019), separately in x and y.

Notes:
    Interpolating a plane wave of any admissible lag is at most ``INTERPOLATION_ERROR`` / 2 off along one axis.
    The autocorrelation of a transmission is nowhere negative, so an interpolated |F|² is at most
    ``INTERPOLATION_ERROR`` x F(0)² off: relative to the peak, not to the tail.
    Means over pixels are Gauss-Legendre sums folded into the interpolation, with two nodes for each cycle of the
    highest frequency and twelve more, whose remainder is below that error.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np
from numpy.polynomial.legendre import leggauss
from numpy.typing import NDArray

from maskfab.errors import InternalError
from maskfab.model import Camera, Psf, frozen
from maskfab.optics.field.parity import parity_field
from maskfab.optics.image.psf import cutoff, image_scale_um2, odd_samples, point_step_um
from maskfab.optics.image.spectrum import Spectrum
from maskfab.optics.pupil.pupil import Pupil

Floats = NDArray[np.float64]

INTERPOLATION_ERROR = 2e-10
"""Largest error of a rescaled PSF relative to its peak."""

_OVERSAMPLING = 2.0
_HALF_TAPS = 15
_SHAPE = 0.97 * math.pi * _HALF_TAPS * (1 - 1 / _OVERSAMPLING)
# Wide enough to keep matrix products efficient, narrow enough to multiply few zeros.
_ROWS_AT_ONCE = 32


@dataclass(frozen=True, eq=False)
class SampledPower:
    """|F|² on the half plane v >= 0 and a margin below it, fine enough to be read anywhere.

    Attributes:
        values: float64 [margin + n, 2 n - 1], ``values[margin, n - 1]`` at frequency 0.
        margin: rows below frequency 0.
        step: distance between samples, cycles per micrometre in the pupil plane.
    """

    values: Floats
    margin: int
    step: float

    def __post_init__(self) -> None:
        object.__setattr__(self, "values", frozen(self.values))

    def mean(self, frequency: Floats, weights: Floats) -> Floats:
        """Weighted sums of |F|² over nodes about each point of a square grid, its upper half.

        Args:
            frequency: float64 [n, nodes], n odd and symmetric about 0, cycles per micrometre.
            weights: float64 [nodes]; a single 1 for |F|² itself.

        Returns:
            float64 [(n + 1) / 2, n]; the lower half is this one turned by 180 degrees.

        Raises:
            InternalError: MF901 for a frequency beyond the samples.
        """
        middle = (self.values.shape[1] - 1) // 2
        upper = frequency.shape[0] // 2
        rows = _interpolated(self.values, frequency[upper:] / self.step + self.margin, weights)
        return _interpolated(rows.T, frequency / self.step + middle, weights).T


def sampled_power(pupil: Pupil, highest: float, lowest: float = 0.0) -> SampledPower:
    """Sample |F|² once for all wavelengths.

    Args:
        pupil: openings inside the stop.
        highest: largest frequency along an axis at which it will be read, cycles per micrometre.
        lowest: the same below the u axis, for nodes about points on it.
    """
    step = 1 / (2 * pupil.stop.diameter_um * _OVERSAMPLING)
    count = math.ceil(highest / step) + _HALF_TAPS + 2
    margin = min(count - 1, math.ceil(lowest / step) + _HALF_TAPS)
    frequency = step * np.arange(count, dtype=np.float64)
    return SampledPower(parity_field(pupil, frequency, frequency).intensity()[count - 1 - margin :], margin, step)


def polychromatic_psf(
    pupil: Pupil, camera: Camera, spectrum: Spectrum, kind: Literal["point", "pixel"] = "point"
) -> Psf:
    """PSF of a spectrum over the camera's window, each line weighted by its energy.

    Args:
        pupil: openings inside the stop.
        camera: gives focal length, pixel and window; its own wavelengths play no part.
        spectrum: the lines.
        kind: ``point`` samples at the step that the shortest line needs, ``pixel`` averages over pixels.

    Returns:
        A PSF whose ``wavelength_nm`` is the spectrum's centroid; its highest frequency is that of the shortest line.
    """
    camera = replace(camera, wavelengths_nm=tuple(spectrum.wavelengths_nm.tolist()))
    step = point_step_um(camera) if kind == "point" else camera.pixel_um
    offsets, weights = _pixel_nodes(camera) if kind == "pixel" else (np.zeros(1), np.ones(1))
    half = odd_samples(camera.window_um, step) // 2
    position = step * np.arange(-half, half + 1, dtype=np.float64)[:, None] + offsets
    scales = [image_scale_um2(camera, wavelength) for wavelength in camera.wavelengths_nm]
    power = sampled_power(pupil, abs(position).max() / min(scales), abs(offsets).max() / min(scales))
    upper = np.zeros((half + 1, 2 * half + 1))
    for scale, weight in zip(scales, spectrum.weights, strict=True):
        upper += power.mean(position / scale, weights) * (weight / (scale**2 * pupil.energy_um2))
    return Psf(np.concatenate([upper[:0:-1, ::-1], upper]), step, spectrum.centroid_nm, kind)


def _pixel_nodes(camera: Camera) -> tuple[Floats, Floats]:
    """Places and weights whose sum is the mean over a pixel for every frequency up to the cutoff."""
    cycles = camera.pixel_um * max(cutoff(camera, wavelength) for wavelength in camera.wavelengths_nm)
    nodes, weights = leggauss(12 + math.ceil(2 * cycles))
    return nodes * camera.pixel_um / 2, weights / 2


def _interpolated(values: Floats, place: Floats, weights: Floats) -> Floats:
    """Weighted sums of a band-limited function along axis 0, [n, columns] from places [n, nodes] in samples."""
    if place.min() < _HALF_TAPS - 1 or place.max() >= values.shape[0] - _HALF_TAPS:
        raise InternalError("MF901", f"samples {place.min():g} to {place.max():g} asked of {values.shape[0]}")
    result = np.empty((place.shape[0], values.shape[1]))
    for rows, first, matrix in _bands(place, weights):
        np.matmul(matrix, values[first : first + matrix.shape[1]], out=result[rows])
    return result


def _bands(place: Floats, weights: Floats) -> Iterator[tuple[slice, int, Floats]]:
    """Interpolation matrix in dense blocks: which rows, the first sample they need, and the block itself."""
    for start in range(0, place.shape[0], _ROWS_AT_ONCE):
        rows = slice(start, start + _ROWS_AT_ONCE)
        block = place[rows]
        nearest = np.floor(block).astype(np.intp)
        first = int(nearest.min()) - _HALF_TAPS + 1
        matrix = np.zeros((block.shape[0], int(nearest.max()) + _HALF_TAPS + 1 - first))
        taps = nearest[..., None] + np.arange(1 - _HALF_TAPS, _HALF_TAPS + 1)
        values = _kernel(block[..., None] - taps) * weights[:, None]
        row = np.broadcast_to(np.arange(block.shape[0])[:, None, None], taps.shape)
        np.add.at(matrix, (row, taps - first), values)
        yield rows, first, matrix


def _kernel(distance: Floats) -> Floats:
    """Windowed sinc at distances within the taps."""
    z = distance / _HALF_TAPS
    return np.asarray(np.sinc(distance) * np.exp(_SHAPE * (np.sqrt(np.clip(1 - z**2, 0, None)) - 1)))
