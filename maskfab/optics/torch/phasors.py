"""Cosines and sines of many phases: torch works out double ones many at a time, numpy (2.4) one by one."""

from __future__ import annotations

import numpy as np
import torch
from numpy.typing import NDArray

Floats = NDArray[np.float64]


def cosines_and_sines(position_um: Floats, frequency: Floats) -> Floats:
    """Cosines and sines of 2πux, [2, positions, frequencies], with phases reduced to half a cycle."""
    both = np.empty((2, position_um.size, frequency.size))
    cosines, sines = torch.from_numpy(both)
    torch.outer(torch.from_numpy(position_um), torch.from_numpy(frequency), out=sines)
    sines.sub_(sines.round()).mul_(2 * np.pi)
    torch.cos(sines, out=cosines)
    sines.sin_()
    return both
