r"""A picture as the sensor records it: shot noise, read noise, full well; the noise of protocol F1.

    y = min(Poisson(g · blur) + 4.87 N, 15506) / g,        g = L r / 0.2072,

with L the electrons of white behind the published display at a level, r the design's share of open stop, and N normal:
a design that lets less light through is noisier, and gets no more for being dark.
"""

from __future__ import annotations

from collections.abc import Mapping
from types import MappingProxyType

import numpy as np
from numpy.typing import NDArray

from maskfab.errors import JobError

FULL_WELL = 15506.0
READ_NOISE = 4.87
"""Both in electrons."""
REFERENCE_SHARE = 0.2072
"""Open share of the stop behind the published display."""

ELECTRONS: Mapping[int, int] = MappingProxyType({24: 273, 28: 654, 32: 1608, 36: 4005, 40: 10024})
"""Electrons of white behind the published display, by signal-to-noise ratio in dB."""


def gain(level_db: int, open_share: float) -> float:
    """Electrons of white behind a design, g.

    Raises:
        JobError: MF104 for a level without a number of electrons, or a share outside (0, 1].
    """
    if level_db not in ELECTRONS:
        raise JobError(
            "MF104", f"there is no level of {level_db} dB", where="levels", cure=f"Use {', '.join(map(str, ELECTRONS))}"
        )
    if not 0 < open_share <= 1:
        raise JobError("MF104", f"an open share of {open_share:g} is outside 0 to 1", cure="Open some of the stop")
    return ELECTRONS[level_db] * open_share / REFERENCE_SHARE


def capture(blurred: NDArray[np.float32], electrons: float, seed: int) -> NDArray[np.float32]:
    """Record light as a sensor does, back in units of white.

    Args:
        blurred: light on the pixels, any shape, white is 1; what a transform left below 0 is dark.
        electrons: of white, g.
        seed: of ``numpy.random.default_rng``; the same seed gives the same picture.

    Raises:
        JobError: MF104 for electrons that are not positive and finite.
    """
    if not (np.isfinite(electrons) and electrons > 0):
        raise JobError("MF104", f"{electrons:g} electrons of white are not above 0", cure="Give the scene more light")
    draw = np.random.default_rng(seed)
    counted = draw.poisson(np.maximum(blurred, 0) * electrons).astype(np.float32)
    counted += READ_NOISE * draw.standard_normal(blurred.shape, dtype=np.float32)
    return np.asarray(np.minimum(counted, FULL_WELL) / electrons, dtype=np.float32)
