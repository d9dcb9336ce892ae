"""The recipe that under-panel camera papers publish, with gradients as they publish them: the baseline for timings.

The unit is tiled, cut by a stop of whole dots, zero-padded to λf / (dot x step) points, floored to an even number,
and transformed; the PSF is the squared modulus cropped to the window, and the OTF is the transform of the PSF. Its
known faults stay in on purpose, since the engine is measured against them: dots are points, the rim is a staircase,
the even size stands for another wavelength than asked for, and the window truncates the OTF.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
import torch
from numpy.typing import NDArray

from maskfab.model import orient


@dataclass(frozen=True)
class Recipe:
    """One wavelength of the published workload.

    Attributes:
        wavelength_nm, focal_um, diameter_um, dot_um: the camera and the dots.
        step_um: wanted distance between PSF samples.
        points: samples along the window's side.
        pixel_um: sensor pixel; the loss counts frequencies up to half a cycle per pixel.
    """

    wavelength_nm: float = 530.0
    focal_um: float = 10_000.0
    diameter_um: float = 4000.0
    dot_um: float = 8.0
    step_um: float = 0.5
    points: int = 512
    pixel_um: float = 2.0

    @property
    def size(self) -> int:
        """Points of the FFT along a side: λf / (dot x step), floored to an even number."""
        return 2 * math.floor(self.wavelength_nm * 1e-3 * self.focal_um / (self.dot_um * self.step_um) / 2 + 1e-9)

    @property
    def effective_wavelength_nm(self) -> float:
        """The wavelength at which an FFT of that size has the wanted step."""
        return self.size * self.dot_um * self.step_um / self.focal_um * 1e3


def stop_of_dots(recipe: Recipe, side: int) -> NDArray[np.bool_]:
    """Dots whose middles lie inside the stop, bool [side, side]."""
    away = (np.arange(side) - (side - 1) / 2) * recipe.dot_um
    return np.asarray(away[:, None] ** 2 + away**2 <= (recipe.diameter_um / 2) ** 2)


def published_psf(unit: NDArray[np.float64], orientations: NDArray[np.int8], recipe: Recipe) -> NDArray[np.float64]:
    """The PSF of a tiled unit, float64 [points, points] with sum 1; the axis is at sample points // 2."""
    tiled = np.block([[orient(unit, int(k)) for k in row] for row in orientations])
    pupil = np.zeros((recipe.size, recipe.size), dtype=np.complex128)
    pupil[: len(tiled), : len(tiled)] = tiled * stop_of_dots(recipe, len(tiled))
    power = np.abs(np.fft.fftshift(np.fft.fft2(pupil))) ** 2
    first = recipe.size // 2 - recipe.points // 2
    window = power[first : first + recipe.points, first : first + recipe.points]
    return np.asarray(window / window.sum())


@dataclass(frozen=True, eq=False)
class PublishedAutograd:
    """The same in torch as it is usually written: whole complex arrays, gradients by automatic differentiation.

    Attributes:
        index: int64 [side, side], the unit's dot at every place of the pupil.
        stop: bool [side, side].
        counted: bool [points, points], frequencies of the loss, in the order of an FFT.
    """

    recipe: Recipe
    index: torch.Tensor
    stop: torch.Tensor
    counted: torch.Tensor

    def psf(self, unit: torch.Tensor) -> torch.Tensor:
        """The PSF with sum 1, [points, points], of a unit [dots, dots]."""
        size, points = self.recipe.size, self.recipe.points
        surplus = size - self.index.shape[0]
        pupil = torch.nn.functional.pad(unit.flatten()[self.index] * self.stop, (0, surplus, 0, surplus))
        field = torch.fft.fftshift(torch.fft.fft2(pupil.to(unit.dtype.to_complex())))
        first = size // 2 - points // 2
        window = field.abs()[first : first + points, first : first + points] ** 2
        return window / window.sum()

    def loss(self, unit: torch.Tensor) -> torch.Tensor:
        """The invertibility loss of the PSF's window, a scalar."""
        otf = torch.fft.fft2(torch.fft.ifftshift(self.psf(unit)))
        return worst_response(otf[self.counted].abs() ** 2)

    def gradient(self, unit: torch.Tensor) -> torch.Tensor:
        """Derivative of the loss by every dot, [dots, dots]."""
        leaf = unit.detach().clone().requires_grad_()
        (found,) = torch.autograd.grad(self.loss(leaf), leaf)
        return found


def published_autograd(dots: int, orientations: NDArray[np.int8], recipe: Recipe) -> PublishedAutograd:
    """The baseline for units of ``dots`` dots; the unit's dtype is that of the computation."""
    index = np.arange(dots * dots).reshape(dots, dots)
    laid = np.block([[orient(index, int(k)) for k in row] for row in orientations])
    frequency = np.fft.fftfreq(recipe.points, recipe.step_um)
    radius = np.hypot(frequency[:, None], frequency)
    counted = (radius > 0) & (radius <= 0.5 / recipe.pixel_um)
    return PublishedAutograd(
        recipe, torch.from_numpy(laid), torch.from_numpy(stop_of_dots(recipe, len(laid))), torch.from_numpy(counted)
    )


def worst_response(power: torch.Tensor, epsilon: float = 0.015, worst_fraction: float = 0.3) -> torch.Tensor:
    """Minus the mean of the smallest Wiener responses |O|² / (|O|² + epsilon): equation 9 of the design paper."""
    response = (power / (power + epsilon)).flatten()
    count = math.ceil(worst_fraction * response.numel())
    return -torch.topk(response, count, largest=False, sorted=False).values.mean()
