"""Widths that a mask house promised, and whether what was measured keeps to them."""

from __future__ import annotations

from dataclasses import dataclass

from maskfab.jobfile.shop_profile import Shop


@dataclass(frozen=True)
class Promise:
    """Of the job and of the house that it names.

    Attributes:
        bias_um: by which clear features are wider than drawn, as [process] of the job states it.
        shop: the house; None where the job names none.
    """

    bias_um: float = 0.0
    shop: Shop | None = None

    def tolerance_um(self, width_um: float) -> float | None:
        """Largest deviation from the drawn width that the house promises; None where nobody promises any."""
        return None if self.shop is None else self.shop.tolerance.of_width(width_um)

    def kept(self, width_um: float, bias_um: float, half_um: float) -> bool | None:
        """Whether a bias with its interval lies within the promise; None where it may lie on either side, or none is.

        Args:
            width_um: of the narrowest features, for which the promise is strictest.
            bias_um: as it was measured.
            half_um: half of its interval.
        """
        most = self.tolerance_um(width_um)
        if most is None or abs(abs(bias_um) - most) < half_um:
            return None
        return abs(bias_um) < most

    def told(self, width_um: float, bias_um: float, half_um: float) -> str:
        """A sentence on whether a measured bias is within the promise.

        Args:
            width_um, bias_um, half_um: as of :meth:`kept`.
        """
        if self.shop is None:
            return "The job names no mask house ([export] shop) whose tolerance it could be held against."
        most = self.tolerance_um(width_um)
        if most is None:
            return f"{self.shop.title} publishes no CD tolerance that it could be held against."
        promised = f"the ±{most:g} um that {self.shop.title} promises of features of {width_um:g} um"
        kept = self.kept(width_um, bias_um, half_um)
        if kept is None:
            return f"Whether that is within {promised} cannot be told: the interval holds the limit."
        return f"That is within {promised}." if kept else f"That is beyond {promised}."
