r"""The transfer function of a PSF window at low frequencies, from its quadrants, in torch.

A PSF I of a real amplitude is equal to itself turned by half a turn, so its transform is real, and with the samples at
(x, y) and (-x, y) called I_same and I_opposite,

    O(ν_x, ±ν_y) = Σ c cos(2πν_x x) cos(2πν_y y) (I_same + I_opposite)
                 ∓ Σ c sin(2πν_x x) sin(2πν_y y) (I_same - I_opposite),

c counting how many quadrants a sample belongs to. The few frequencies below half a cycle per pixel are two thin real
products each, where an FFT would work out all of them. The samples may be those of the window, or the fewer nodes that
have the same sums (window_nodes.py); then c is the nodes' weight.

Notes:
    A window truncates the PSF: at 256 µm this moves the modulation by up to 0.05. Where a loss can do without
    a window, autocorrelate the pupil instead.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import torch
from numpy.typing import NDArray

from maskfab.errors import InternalError
from maskfab.optics.torch.phasors import cosines_and_sines
from maskfab.optics.torch.window_nodes import WindowNodes

Floats = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class WindowTransfer:
    """The constants of one window and grid of frequencies.

    Attributes:
        along_y: [2, m, n], cosines and sines, weighted.
        along_x: [2, n, m], the same transposed.
    """

    along_y: torch.Tensor
    along_x: torch.Tensor

    def __call__(self, quadrants: torch.Tensor) -> torch.Tensor:
        """The transform at (ν_x, ν_y) and at (-ν_x, ν_y), [2, m, m] from [2, n, n]; real, not normalised."""
        same, opposite = quadrants.unbind(0)
        even = self.along_y[0] @ (same + opposite) @ self.along_x[0]
        odd = self.along_y[1] @ (same - opposite) @ self.along_x[1]
        return torch.stack([even - odd, even + odd])


def window_transfer(
    nodes: WindowNodes,
    frequency: Floats,
    *,
    dtype: torch.dtype = torch.float64,
    device: torch.device | None = None,
) -> WindowTransfer:
    """The transform of a square window whose quadrant has samples at these nodes along both axes.

    Args:
        nodes: sensor positions, [n], as of ``TiledField.intensity``, and their weights.
        frequency: non-negative frequencies in cycles per micrometre of sensor, [m].
        dtype: float32 or float64.
        device: that of the quadrants; the CPU by default.

    Raises:
        InternalError: MF901 for a negative frequency.
    """
    if frequency.min() < 0:
        raise InternalError("MF901", "frequencies of a quadrant must not be negative")
    # The weights are those of half a window along either axis, and the half planes' pairs of quadrants are two.
    along_y = torch.from_numpy(np.sqrt(2) * cosines_and_sines(frequency, nodes.position_um) * nodes.weight).to(
        device=device, dtype=dtype
    )
    return WindowTransfer(along_y, along_y.mT.contiguous())
