r"""One step of the published optimisation, without its pictures: the baseline that ours is timed against.

Three colours as published: the tiled square of cells is padded to λf / (dot x step) points, floored to an even number
(1524, 1324 and 1174, with primes of 127, 331 and 587 in them), cut by the stop, and sent through one complex FFT in
double precision; the PSF is added up over 4 x 4 samples, red and green are cut to the size of blue, and the
invertibility loss sorts all three colours' responses together. Gradients by automatic differentiation.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import torch
from numpy.typing import NDArray

from maskfab.base.model import orient
from maskfab.trials.race import published_size

WAVELENGTHS_NM = (610.0, 530.0, 470.0)
_FOCAL_UM, _DOT_UM, _STEP_UM, _DIAMETER_UM = 10_000.0, 8.0, 0.5, 4000.0
_POOLED = 4
_EPSILON, _WORST = 0.015, 0.3


@dataclass(frozen=True, eq=False)
class PublishedStep:
    """The published loss of a unit.

    Attributes:
        index: int64 [largest size, largest size], the unit's dot at every place.
        stop: float64, the same shape.
        sizes: of red, green, blue.
    """

    index: torch.Tensor
    stop: torch.Tensor
    sizes: tuple[int, ...]

    def psfs(self, unit: torch.Tensor) -> torch.Tensor:
        """[3, n, n], not normalised, on sensor pixels."""
        display = unit.flatten()[self.index] * self.stop
        pooled = []
        for size in self.sizes:
            first = (self.sizes[0] - size) // 2
            pupil = display[first : first + size, first : first + size].to(torch.complex128)
            power = torch.fft.fftshift(torch.fft.fft2(pupil)).abs() ** 2
            pooled.append(torch.nn.functional.avg_pool2d(power[None], _POOLED)[0] * _POOLED**2)
        last = pooled[-1].shape[0]
        cuts = [(len(p) - last) // 2 for p in pooled]
        return torch.stack([p[c : c + last, c : c + last] for p, c in zip(pooled, cuts, strict=True)])

    def loss(self, unit: torch.Tensor) -> torch.Tensor:
        """The invertibility loss, a scalar."""
        psfs = self.psfs(unit)
        power = torch.fft.fft2(psfs / psfs.sum((1, 2), keepdim=True)).abs() ** 2
        response = torch.sort((power / (power + _EPSILON)).flatten()).values
        return -response[: int(_WORST * response.numel())].mean()

    def gradient(self, unit: torch.Tensor) -> torch.Tensor:
        """Derivative of the loss by every dot, [dots, dots]."""
        leaf = unit.detach().to(torch.float64).requires_grad_()
        (found,) = torch.autograd.grad(self.loss(leaf), leaf)
        return found

    def modulation(self, unit: NDArray[np.bool_]) -> list[NDArray[np.float64]]:
        """Minimum of the modulation over rings one sample wide, up to half a cycle per pixel, for every colour."""
        with torch.no_grad():
            psfs = self.psfs(torch.from_numpy(unit.astype(np.float64)))
            otf = torch.fft.fft2(psfs / psfs.sum((1, 2), keepdim=True)).abs().numpy()
        n = otf.shape[1]
        frequency = np.fft.fftfreq(n, 1 / n)
        ring = np.rint(np.hypot(frequency[:, None], frequency)).astype(np.intp)
        lowest = np.full((len(otf), ring.max() + 1), np.inf)
        for colour, values in enumerate(otf):
            np.minimum.at(lowest[colour], ring, values)
        return [row[: n // 2 + 1] for row in lowest]

    def auc(self, unit: NDArray[np.bool_]) -> tuple[float, ...]:
        """The published figure of merit for red, green and blue: the mean over those rings.

        Only blue's is clean: red and green lose the outer part of their PSF before they are normalised.
        """
        return tuple(float(row.mean()) for row in self.modulation(unit))


def published_step(dots: int, orientations: NDArray[np.int8]) -> PublishedStep:
    """The published step for units of ``dots`` dots of 8 um in these cells, [rows, columns], centred on the stop."""
    sizes = tuple(published_size(nm, _FOCAL_UM, _DOT_UM, _STEP_UM) for nm in WAVELENGTHS_NM)
    index = np.arange(dots * dots).reshape(dots, dots)
    laid = np.block([[orient(index, int(k)) for k in row] for row in orientations])
    around = [((sizes[0] - n) // 2, sizes[0] - n - (sizes[0] - n) // 2) for n in laid.shape]
    away = (np.arange(sizes[0]) - (sizes[0] - 1) / 2) * _DOT_UM
    stop = away[:, None] ** 2 + away**2 <= (_DIAMETER_UM / 2) ** 2
    return PublishedStep(
        torch.from_numpy(np.pad(laid, around, mode="wrap")), torch.from_numpy(stop.astype(np.float64)), sizes
    )
