"""The mean of paired differences, and how sure it is."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

CONFIDENCE = 0.95


@dataclass(frozen=True)
class MeanDifference:
    """Mean of differences over photographs, with its 95 % interval by Student's t.

    Attributes:
        mean: of the differences.
        half_width: of the interval, NaN for fewer than two photographs.
        count: photographs.

    Notes:
        The interval holds the mean over all photographs of the kind in 95 % of all draws of so many, if differences are
        about normal (Student, Biometrika 6, 1, 1908). Of another kind of photographs it says nothing.
    """

    mean: float
    half_width: float
    count: int

    @classmethod
    def of(cls, differences: Sequence[float]) -> MeanDifference:
        """From one difference for every photograph."""
        count = len(differences)
        mean = math.fsum(differences) / count
        if count < 2:
            return cls(mean, math.nan, count)
        from scipy.special import stdtrit  # slow to load, for pages that only name the confidence

        variance = math.fsum((each - mean) ** 2 for each in differences) / (count - 1)
        quantile = float(stdtrit(count - 1, (1 + CONFIDENCE) / 2))
        return cls(mean, quantile * math.sqrt(variance / count), count)

    @property
    def tie(self) -> bool:
        """Whether the interval holds 0, or is not known: nobody can tell which is better."""
        return not abs(self.mean) > self.half_width

    def told(self, unit: str = "dB", digits: int = 2) -> str:
        """In words: the mean with its sign, the interval if there is one, and whether it is a tie."""
        mean = f"{self.mean:+z.{digits}f}"
        if math.isnan(self.half_width):
            return f"{mean} {unit}".rstrip()
        return " ".join(
            [mean, f"± {self.half_width:.{digits}f}", *([unit] if unit else []), *(["tie"] if self.tie else [])]
        )
