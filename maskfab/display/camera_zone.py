"""Pixels over the camera beside those of the display around them: how many share a circuit, and how many are left out.

Makers lower the resolution over a camera in two ways. Pixels share their circuits, and show one value together; or
pixels of the display around are left out, so that one of the zone stands for a square of those, and the zone's pitch
is that many times theirs. Circuits per area are told as the local resolution, in pixels per inch.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

from maskfab.base.errors import JobError
from maskfab.base.units import NM_PER_UM, UM_PER_INCH

_WHOLE = 0.01
"""Share by which the zone's pitch may differ from a whole multiple of the pitch around."""


@dataclass(frozen=True)
class CameraZone:
    """Pixels over the camera, which may share circuits; ``normal_nm`` is the pitch around, None if the zone's own."""

    sharing: int = 1
    normal_nm: int | None = None

    def around_nm(self, pitch_nm: int) -> int:
        """Pitch of the display around a zone of a pitch."""
        return pitch_nm if self.normal_nm is None else round(pitch_nm / self.across(pitch_nm))

    def across(self, pitch_nm: int) -> int:
        """Pixels of the display around along one of the zone; MF105 where that is no whole number."""
        if self.normal_nm is None:
            return 1
        ratio = pitch_nm / self.normal_nm
        across = max(1, round(ratio))
        if abs(ratio / across - 1) > _WHOLE:
            what = (
                f"a pixel of {pitch_nm / NM_PER_UM:g} um is {ratio:.3g} of those around, which are "
                f"{self.normal_nm / NM_PER_UM:g} um, and no whole number of them"
            )
            cure = f"Set normal to {UM_PER_INCH * NM_PER_UM * across / pitch_nm:.4g} dpi, or change the pitch"
            raise JobError("MF105", what, where="display.normal", cure=cure)
        return across

    def resolution_ppi(self, pitch_nm: int) -> float:
        """Pixels per inch that have circuits of their own, as if they lay in a square grid."""
        return UM_PER_INCH * NM_PER_UM / pitch_nm / math.sqrt(self.sharing)

    def told(self, pitch_nm: int) -> str:
        """Words on what is shared and left out."""
        across = self.across(pitch_nm)
        shared = (
            "every pixel has circuits of its own" if self.sharing == 1 else f"{self.sharing} pixels share a circuit"
        )
        left = "" if across == 1 else f", and {across**2 - 1} of {across**2} pixels of the display around are left out"
        around = UM_PER_INCH * NM_PER_UM / self.around_nm(pitch_nm)
        return f"{shared}{left}; {around:.0f} ppi around"
