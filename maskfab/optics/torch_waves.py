"""Cosines and sines of many phases: torch works out double ones many at a time, numpy (2.4) one by one."""

from __future__ import annotations

import numpy as np
import torch
from numpy.typing import NDArray

Floats = NDArray[np.float64]


def cosines_and_sines(position_um: Floats, frequency: Floats) -> Floats:
    """Cosines and sines of 2πux, [2, positions, frequencies], with phases reduced to half a cycle."""
    cycles = torch.outer(torch.from_numpy(position_um), torch.from_numpy(frequency))
    cycles.sub_(cycles.round()).mul_(2 * np.pi)
    both = cycles.new_empty(2, *cycles.shape)
    torch.cos(cycles, out=both[0])
    torch.sin(cycles, out=both[1])
    return both.numpy()
