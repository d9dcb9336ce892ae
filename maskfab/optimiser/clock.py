"""The time left of a design's budget."""

from __future__ import annotations

import time
from dataclasses import dataclass, field


@dataclass(frozen=True)
class Clock:
    """Counts from when it was made.

    Attributes:
        budget_s: seconds in all; None for as many as it takes.
    """

    budget_s: float | None = None
    _begun: float = field(default_factory=time.monotonic, repr=False, compare=False)

    def left(self, share: float = 1.0) -> float | None:
        """Seconds of this share of what is left, never below 0; None without a budget."""
        if self.budget_s is None:
            return None
        return max(0.0, share * (self.budget_s - (time.monotonic() - self._begun)))

    def shorter_than(self, seconds: float) -> bool:
        """Whether the whole budget is less than so much time."""
        return self.budget_s is not None and self.budget_s < seconds

    @property
    def over(self) -> bool:
        """Whether nothing is left."""
        return self.left() == 0.0
