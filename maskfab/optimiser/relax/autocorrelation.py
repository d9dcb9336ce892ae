r"""The autocorrelation of a tiled unit at the lags that a loss reads, and its gradient, by pruned transforms.

With A the transform of the pupil p on N x N points, the autocorrelation is the inverse transform of |A|² (Goodman,
Introduction to Fourier Optics, 6.3). |A|² is real, so the transform along y is a real one, and only rows of lags from
0 to the reach go on to the transform along x. The adjoint is written by hand: slopes g of a loss by the lags become

    ∂/∂p = 2 IFFT( Re FFT(g) · A ),

again with a real transform along y, which only the rows inside the pupil leave. Nothing but A is kept for it.

Notes:
    Lags are whole dots, so the table is exact for square dots; dots cut by the stop must be in or out.
    Sizes are even, because real transforms of odd length cost three times as much.
    On CUDA the scatter-add adds in any order, so gradients there repeat to rounding only; on the CPU they repeat.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray
from scipy.fft import next_fast_len

from maskfab.model import unit_dots


@dataclass(frozen=True, eq=False)
class Autocorrelation:
    """The constants of one layout and stop; a function of the unit's dots.

    Attributes:
        index: int64 [rows x columns], the unit's dot at each place of the pupil, flat; dots outside the stop have the
            number after the last dot.
        shape: dots of the pupil along y and x.
        dots: dots along the unit's side.
        size: points N of the transforms along each side.
        reach: longest lag along y, in dots; |x| of a lag may be as long.
    """

    index: torch.Tensor
    shape: tuple[int, int]
    dots: int
    size: int
    reach: int

    def pupil(self, unit: torch.Tensor) -> torch.Tensor:
        """The stop filled with oriented units, of that shape."""
        dots = torch.cat([unit.flatten(), unit.new_zeros(1)])
        return dots.index_select(0, self.index).view(self.shape)

    def __call__(self, unit: torch.Tensor) -> torch.Tensor:
        """Autocorrelation in dots, [reach + 1, size]; lag (y, x) at [y, x % size]. Differentiable once.

        Args:
            unit: amplitude of the unit's dots, [dots, dots], float32 or float64.
        """
        table: torch.Tensor = _Autocorrelation.apply(unit, self)  # type: ignore[no-untyped-call]
        return table


def autocorrelation(
    dots: int, orientations: NDArray[np.int8], inside: NDArray[np.bool_], reach: int
) -> Autocorrelation:
    """The autocorrelation of units of ``dots`` dots a side, laid in these orientations.

    Args:
        dots: dots along the unit's side.
        orientations: int8 [rows, columns], elements of D4, row 0 lowest.
        inside: bool [rows x dots, columns x dots], dots inside the stop.
        reach: longest lag in dots, shorter than the pupil.
    """
    # Twice a fast length is fast and even.
    size = 2 * int(next_fast_len((max(inside.shape) + reach + 1) // 2))
    flat = torch.from_numpy(np.where(inside, unit_dots(orientations, dots), dots * dots).ravel())
    return Autocorrelation(flat, (inside.shape[0], inside.shape[1]), dots, size, reach)


class _Autocorrelation(torch.autograd.Function):
    """Rows 0 to the reach of the autocorrelation table, with their adjoint."""

    @staticmethod
    def forward(ctx: Any, unit: torch.Tensor, layout: Autocorrelation) -> torch.Tensor:
        size = layout.size
        spectrum = torch.fft.rfft2(layout.pupil(unit), s=(size, size))
        power = torch.addcmul(spectrum.real * spectrum.real, spectrum.imag, spectrum.imag)
        rows = torch.fft.ihfft(power, dim=0)[: layout.reach + 1]
        ctx.layout = layout
        ctx.save_for_backward(spectrum)
        table: torch.Tensor = torch.fft.irfft(rows, n=size, dim=1)
        return table

    @staticmethod
    @torch.autograd.function.once_differentiable
    def backward(ctx: Any, slope: torch.Tensor) -> tuple[torch.Tensor, None]:
        layout: Autocorrelation = ctx.layout
        (spectrum,) = ctx.saved_tensors
        size, (height, width) = layout.size, layout.shape
        rows = torch.fft.rfft(slope, dim=1)
        # Row 0 holds both signs of its lags, the others stand for their mirror images too.
        rows[0] = 2 * rows[0].real
        weighted = spectrum * torch.fft.hfft(rows, n=size, dim=0)
        by_row = torch.fft.ifft(weighted, dim=0)[:height]
        by_dot = torch.fft.irfft(by_row, n=size, dim=1)[:, :width]
        home = by_dot.new_zeros(layout.dots**2 + 1)
        home.scatter_add_(0, layout.index, by_dot.flatten())
        return home[:-1].view(layout.dots, layout.dots), None
