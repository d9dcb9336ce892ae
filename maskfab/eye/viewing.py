"""From where a display is looked at."""

from __future__ import annotations

import math
from dataclasses import dataclass

from maskfab.errors import JobError
from maskfab.units import UM_PER_MM

TELEPHONE_UM = 300_000.0
"""From the eye to a telephone that is held as usual."""
_NEAREST_UM, _FARTHEST_UM = 1e4, 1e8


@dataclass(frozen=True)
class Viewing:
    """A display's pixels and an eye in front of them.

    Attributes:
        pitch_um: from pixel to pixel.
        distance_um: from the eye to the display, 10 mm to 100 m.

    Raises:
        JobError: MF121 if nothing can be seen from there, MF104 if the pitch is not finite and positive.
    """

    pitch_um: float
    distance_um: float

    def __post_init__(self) -> None:
        if not (math.isfinite(self.pitch_um) and self.pitch_um > 0):
            raise JobError("MF104", f"the pitch is {self.pitch_um:g} um", cure="Give a finite, positive pitch")
        if not _NEAREST_UM <= self.distance_um <= _FARTHEST_UM:
            raise JobError(
                "MF121",
                f"a viewing distance of {self.distance_um / UM_PER_MM:g} mm is outside {_NEAREST_UM / UM_PER_MM:g} mm "
                f"to {_FARTHEST_UM / 1e6:g} m",
                where="distance",
                cure=f"A telephone is held at about {TELEPHONE_UM / UM_PER_MM:g} mm",
            )

    @property
    def pixels_per_degree(self) -> float:
        """On the axis, where one degree is the distance times pi / 180."""
        return math.radians(self.distance_um) / self.pitch_um
