"""The cells that cover a camera's stop, and the lags that a sensor can tell apart behind it."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from maskfab.cell_size import CellSize
from maskfab.model import Stop
from maskfab.units import NM_PER_UM

MAX_SIDE = 4096
"""Dots across the stop; one step of a descent then takes seconds and a gigabyte."""


def cells_across(stop: Stop, dots: int, dot_nm: int) -> int:
    """Cells along the side of the smallest square of cells that covers the stop."""
    return math.ceil(stop.diameter_um * NM_PER_UM / CellSize(dots, dot_nm).pitch_nm - 1e-9)


def lags_within(reach: float, table: int) -> NDArray[np.int64]:
    """Flat table indices of the integer lags with 0 < |lag| <= reach in the half plane y > 0, or y = 0 and x > 0."""
    whole = math.floor(reach)
    y, x = np.mgrid[0 : whole + 1, -whole : whole + 1]
    wanted = (x**2 + y**2 <= reach**2) & ((y > 0) | (x > 0))
    return np.asarray(y[wanted] * table + x[wanted] % table, dtype=np.int64)
