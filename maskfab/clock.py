"""Time left of a budget, counted from the beginning of a command's work."""

from __future__ import annotations

import math
import time
from collections.abc import Callable
from dataclasses import dataclass, field, replace

from maskfab.errors import JobError

SLACK = 0.2
"""Share of itself by which a budget may be passed."""


@dataclass(frozen=True)
class Clock:
    """Counts from when it was made.

    Attributes:
        budget_s: seconds in all; None for as many as it takes.
        refuses: whether :meth:`require` refuses; a search on its own does what it can.
        now: seconds that have gone by since any moment.
    """

    budget_s: float | None = None
    refuses: bool = False
    now: Callable[[], float] = field(default=time.monotonic, repr=False, compare=False)
    _begun: float = field(default=math.nan, repr=False, compare=False)

    def __post_init__(self) -> None:
        if math.isnan(self._begun):
            object.__setattr__(self, "_begun", self.now())

    @property
    def spent(self) -> float:
        """Seconds since it was made."""
        return self.now() - self._begun

    def left(self, share: float = 1.0) -> float | None:
        """Seconds of this share of what is left, never below 0; None without a budget."""
        if self.budget_s is None:
            return None
        return max(0.0, share * (self.budget_s - self.spent))

    @property
    def over(self) -> bool:
        """Whether nothing is left."""
        return self.left() == 0.0

    def affords(self, seconds: float) -> bool:
        """Whether so much more time keeps the budget, but for half of its slack."""
        return self.budget_s is None or self.spent + seconds <= (1 + SLACK / 2) * self.budget_s

    def before(self, seconds: float) -> Clock:
        """The clock of what must leave so many seconds to what follows."""
        return self if self.budget_s is None else replace(self, budget_s=self.budget_s - seconds)

    def require(self, seconds: float, what: str, where: str) -> None:
        """Refuse a budget that so much more time, the least that is useful, does not keep.

        Args:
            seconds: that are needed from now on.
            what: takes them, in the plural.
            where: the budget is stated.

        Raises:
            JobError: MF150.
        """
        least = self.spent + seconds
        if self.refuses and self.budget_s is not None and least > (1 + SLACK) * self.budget_s:
            raise JobError(
                "MF150",
                f"a budget of {self.budget_s:.3g} s is too short: {what} take until {least:.2g} s from the beginning",
                where=where,
                cure=f"Give {math.ceil(1.2 * least):d} s or more",
            )


NO_END = Clock()
"""As much time as it takes."""
