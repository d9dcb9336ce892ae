r"""Images of black and white edges, and the colour that three wavelengths give them.

An edge along y is a step of the scene; its image is the integral of the line spread function, the transform of the OTF
along x (Goodman, Fourier Optics, 6.2). From lags it is known without a window. From pixels in a window it is known
within half of what falls outside, for a PSF that is alike on opposite sides.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from itertools import product

import numpy as np
from numpy.polynomial.legendre import leggauss

from maskfab.base.arrays import Floats
from maskfab.errors import InternalError
from maskfab.model import Camera, Psf, Quantity, frozen
from maskfab.optics.image.axis_lags import AxisLags
from maskfab.optics.image.lag_table import LagTable
from maskfab.optics.image.psf import cutoff, image_scale_um2, odd_samples
from maskfab.optics.numbers.colour import delta_e_1976, lab_of_linear_srgb

_FEWEST_NODES = 5
_QUADRATURE_ERROR = 1e-8


@dataclass(frozen=True, eq=False)
class EdgeSpread:
    """The image of a step from 0 to 1 along x, then along y, where pixels meet.

    Attributes:
        values: float64 [2, n], n even, the step between the middle two.
        error: float64 [n], bound of the error of each.
        outside: share of the light of which it is not known where it falls.
        wavelength_nm: the line.
    """

    values: Floats
    error: Floats
    outside: float
    wavelength_nm: float

    def __post_init__(self) -> None:
        for name in ("values", "error"):
            object.__setattr__(self, name, frozen(getattr(self, name)))


def edge_spread(lags: tuple[AxisLags, AxisLags], table: LagTable, camera: Camera, wavelength_nm: float) -> EdgeSpread:
    """The image of an edge over the camera's window, from lags, whatever falls outside.

    Args:
        lags: along x and along y.
        table: of the same pupil; gives energy and error bound.
        camera: gives focal length, stop, pixel and window.
        wavelength_nm: the line.

    Notes:
        An error of the OTF by ε(ν) moves the image at x by ∫ ε |sin 2πνx| / (πν) dν at most.
    """
    scale, half_pixel = image_scale_um2(camera, wavelength_nm), camera.pixel_um / 2
    pixels = odd_samples(camera.window_um, camera.pixel_um)
    highest = cutoff(camera, wavelength_nm)
    nodes, weights = leggauss(_FEWEST_NODES + math.ceil(1.5 * np.pi * highest * half_pixel))
    # From the axis on, in steps of half a pixel: pixels meet at every other one.
    starts, within = half_pixel * np.arange(pixels, dtype=np.float64), half_pixel * (1 + nodes) / 2
    sides = []
    for axis in lags:
        line = axis.transform(starts / scale, within / scale) / (scale * table.energy_um2)
        sides.append(np.cumsum(line @ weights * (half_pixel / 2))[::2])
    meet = half_pixel + starts[::2]
    near, beyond = table.coarse_errors
    error = near * _wave_mean(meet * table.near_um / scale) + beyond * _wave_mean(meet * highest) + _QUADRATURE_ERROR
    return EdgeSpread(0.5 + _odd(np.array(sides)), _even(error), 0.0, wavelength_nm)


def _wave_mean(cycles: Floats) -> Floats:
    """Bound of ∫ |sin 2πνx| / (πν) dν up to so many cycles νx: of sines below their arguments, then of half waves."""
    turn = 2 * np.pi * cycles
    return np.minimum(turn, 2 + 2 / np.pi * np.log(np.maximum(turn / np.pi, 1.0))) / np.pi


def _even(side: Floats) -> Floats:
    return np.concatenate([side[..., ::-1], side], axis=-1)


def _odd(side: Floats) -> Floats:
    return np.concatenate([-side[..., ::-1], side], axis=-1)


def edge_in_window(pixels: Psf) -> EdgeSpread:
    """Edge spread from pixel means in a window; half of what lies outside is taken to fall on either side."""
    outside = max(0.0, 1 - pixels.energy_in_window)
    sides = []
    for along in (0, 1):
        share = np.cumsum(pixels.values.sum(axis=along)) * pixels.step_um**2
        sides.append(np.concatenate([[0.0], share]) + (1 - share[-1]) / 2)
    values = np.array(sides)
    return EdgeSpread(values, np.full(values.shape[1], outside / 2), outside, pixels.wavelength_nm)


def edge_colour_difference(red: EdgeSpread, green: EdgeSpread, blue: EdgeSpread, die: str | None = None) -> Quantity:
    """Largest ΔE (CIE 1976) along a black and white edge imaged in three colours, against the same edge in grey.

    The edge is imaged along x and along y, white being (1, 1, 1) in linear sRGB; the grey edge has the mean of the
    three as all its channels.

    Raises:
        InternalError: MF901 if they do not share a grid.
    """
    edges = (red, green, blue)
    if len({edge.values.shape for edge in edges}) > 1:
        raise InternalError("MF901", "edges on different grids were compared")
    channels = np.stack([edge.values for edge in edges], axis=-1)
    errors = np.stack([edge.error for edge in edges], axis=-1)
    largest = float(_colour(channels).max())
    # Each colour may be off either way at each place, and the largest difference lie elsewhere.
    moved = np.stack([_colour(channels + errors * signs) for signs in product((-1, 1), repeat=3)])
    least, most = float(moved.min(axis=0).max()), float(moved.max())
    outside = max(edge.outside for edge in edges)
    known = (
        f"up to {outside:.2g} of a colour's light lies outside the window, and the error bar is what it could change"
        if outside
        else "from the lags, all light included"
    )
    return Quantity(
        "edge_colour_difference",
        largest,
        "largest CIE 1976 colour difference of a black and white edge, along x or y, in linear sRGB under D65, from "
        f"the same edge in grey; {known}",
        uncertainty=max(most - largest, largest - least),
        die=die,
    )


def _colour(channels: Floats) -> Floats:
    grey = np.repeat(channels.mean(axis=-1, keepdims=True), 3, axis=-1)
    return delta_e_1976(lab_of_linear_srgb(channels), lab_of_linear_srgb(grey))
