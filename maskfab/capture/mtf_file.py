"""An MTF that was measured elsewhere, as a table of comma-separated values."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from maskfab.base.arrays import Floats
from maskfab.errors import JobError, SourceError
from maskfab.model import frozen
from maskfab.optics.light.response import curves_text, numeric_table
from maskfab.units import UM_PER_MM

PER_PIXEL, PER_MM = "cycles/pixel", "cycles/mm"
"""Names of the first column."""

_OTHERS = ("mtf", "low", "high")
_HIGHEST = 2.0
_COLUMNS = f"{PER_PIXEL} or {PER_MM}, mtf, and low and high where there is a band"


@dataclass(frozen=True, eq=False)
class MtfCurve:
    """A measured MTF.

    Attributes:
        name: of its file.
        pixel_um: side of the sensor pixel that its frequencies refer to.
        frequency_cy_per_px: float64 [n >= 2], ascending.
        mtf: float64 [n].
        low, high: float64 [n], ends of its band; None if the file has none.
        normal_deg: direction of its waves, from the picture's x axis (right) towards its y axis (up).
    """

    name: str
    pixel_um: float
    frequency_cy_per_px: Floats
    mtf: Floats
    low: Floats | None
    high: Floats | None
    normal_deg: float = 0.0

    def __post_init__(self) -> None:
        for name in ("frequency_cy_per_px", "mtf", "low", "high"):
            value = getattr(self, name)
            object.__setattr__(self, name, None if value is None else frozen(value))

    @property
    def frequency_cy_per_mm(self) -> Floats:
        return np.asarray(self.frequency_cy_per_px * (UM_PER_MM / self.pixel_um))

    @property
    def title(self) -> str:
        """Which curve it is, in words."""
        return f"waves at {self.normal_deg:g}° of".replace("-", "−") + f" {self.name}"


def read_mtf(path: Path, pixel_um: float, normal_deg: float = 0.0) -> MtfCurve:
    """A curve from a table whose header is ``cycles/pixel`` or ``cycles/mm``, ``mtf``, and perhaps ``low``, ``high``.

    Args:
        path: a .csv; lines that begin with ``#`` are skipped.
        pixel_um: side of the sensor's pixel.
        normal_deg: direction of its waves, from right towards up.

    Raises:
        SourceError: MF308 for another suffix, MF301 missing, MF302 empty, MF304 not text; MF303 for a header, row or
            number that is damaged, or frequencies out of order.
        JobError: MF104 for a value that is negative, not finite, above 2, or a band that does not hold the curve.
    """
    where = str(path)
    header, numbers = numeric_table(curves_text(path, where, _COLUMNS), where, (PER_PIXEL, PER_MM))
    if header[1:] not in (list(_OTHERS[:1]), list(_OTHERS)):
        raise SourceError(
            "MF303", f"the columns are {', '.join(header)}", where=where, cure=f"Name the columns {_COLUMNS}"
        )
    frequency, values = numbers[:, 0], numbers[:, 1:]
    if not np.isfinite(frequency).all() or frequency[0] < 0 or (np.diff(frequency) <= 0).any():
        raise SourceError(
            "MF303",
            f"the {header[0]} do not ascend from 0 or more",
            where=where,
            cure="Sort the rows by frequency, each frequency once",
        )
    wrong = ~((values >= 0) & (values <= _HIGHEST))
    if wrong.any():
        raise JobError(
            "MF104",
            f"a modulation of {values[wrong][0]:g} is not 0 to {_HIGHEST:g}",
            where=where,
            cure="Write shares, not per cent: 0.5 for one half",
        )
    if values.shape[1] > 1 and ((values[:, 1] > values[:, 0]) | (values[:, 0] > values[:, 2])).any():
        raise JobError(
            "MF104", "the band does not hold the curve", where=where, cure="Give low <= mtf <= high in every row"
        )
    low, high = (values[:, 1], values[:, 2]) if values.shape[1] > 1 else (None, None)
    per_px = frequency if header[0] == PER_PIXEL else frequency * (pixel_um / UM_PER_MM)
    return MtfCurve(path.name, pixel_um, per_px, values[:, 0], low, high, normal_deg)
