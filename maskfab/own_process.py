"""Settings of a process that maskfab has to itself, as a command or as the second of two."""

from __future__ import annotations

import gc
import os

_VARIABLES = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS")
_OBJECTS = 10_000
"""Made before the youngest are looked through: polygons and drawings are many, and hardly ever form cycles."""


def settle() -> None:
    """Limit every numerical library that is not loaded yet to one thread, unless the environment says otherwise, and
    look for unreachable objects seldom."""
    for name in _VARIABLES:
        os.environ.setdefault(name, "1")
    gc.set_threshold(_OBJECTS)
