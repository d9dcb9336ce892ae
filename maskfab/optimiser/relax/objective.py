r"""The interface of objectives, and their weighted sum.

An objective is a frozen object that turns a relaxed unit, float [dots, dots] within 0 to 1, into a scalar: **lower is
better**, gradients go through. Most read nothing but the autocorrelation of the stop filled with oriented units, so a
sum of them transforms the pupil once.

Notes:
    An objective may differ from step to step (an area that is led down, another batch of pictures). ``at`` gives the
    one of a step as a function of the step's number alone; that is why runs can be resumed.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import dataclass

import torch

from maskfab.errors import JobError
from maskfab.optimiser.relax.autocorrelation import Autocorrelation


class Objective(ABC):
    """A loss of one relaxed unit.

    Attributes:
        correlation: the pupil whose autocorrelation it reads; None if it reads the unit alone.
    """

    correlation: Autocorrelation | None

    @abstractmethod
    def of_table(self, table: torch.Tensor, unit: torch.Tensor) -> torch.Tensor:
        """The loss, a scalar, from the table that ``correlation`` makes of the unit (the unit itself without one)."""

    def __call__(self, unit: torch.Tensor) -> torch.Tensor:
        """The loss of a unit, float [dots, dots] in 0 to 1: a scalar, lower is better."""
        return self.of_table(unit if self.correlation is None else self.correlation(unit), unit)

    def at(self, iteration: int, iterations: int) -> Objective:
        """The objective of one step out of so many; iteration -1 stands for the judgement of a finished unit."""
        return self


@dataclass(frozen=True, eq=False)
class Weighted(Objective):
    r"""Σ α_k L_k: the target function of Yang & Sankaranarayanan 2021, section 4.2, with any losses in it.

    Attributes:
        terms: (weight α, objective) pairs. Those that share one ``correlation`` share its transform.
    """

    terms: tuple[tuple[float, Objective], ...]
    correlation: Autocorrelation | None = None

    def __post_init__(self) -> None:
        if not self.terms:
            raise JobError(
                "MF105",
                "a sum of objectives has no terms",
                where="design.objectives",
                cure="Give at least one objective with its weight",
            )

    def __call__(self, unit: torch.Tensor) -> torch.Tensor:
        """Σ α L; every table is made once."""
        tables: dict[int, torch.Tensor] = {}
        total = unit.new_zeros(())
        for weight, term in self.terms:
            if term.correlation is None:
                value = term(unit)
            else:
                key = id(term.correlation)
                if key not in tables:
                    tables[key] = term.correlation(unit)
                value = term.of_table(tables[key], unit)
            total = total + weight * value
        return total

    def of_table(self, table: torch.Tensor, unit: torch.Tensor) -> torch.Tensor:
        """The objective from a given table; its terms make their own tables."""
        return self(unit)

    def at(self, iteration: int, iterations: int) -> Weighted:
        """Every term as it is at that step."""
        return Weighted(tuple((weight, term.at(iteration, iterations)) for weight, term in self.terms))


@dataclass(frozen=True)
class AreaPenalty(Objective):
    r"""weight (mean transmission - c)², with c led from 1 down to the target: the αarea term of the target function.

    Good for keeping a relaxed unit on the way to a count; a binary unit has its count anyway.

    Attributes:
        target: final open ratio.
        weight: α.
        settled: share of the run after which c is the target; on the way there it falls evenly.
        stair: height of the published stairs, 0 for an even slope. Steps are then even in time too.
        now: c of this step; None before ``at``, which means the target.
    """

    target: float
    weight: float
    settled: float = 0.4
    stair: float = 0.0
    now: float | None = None
    correlation = None

    def wanted(self, iteration: int, iterations: int) -> float:
        """c at a step."""
        done = iteration / max(iterations - 1, 1)
        if self.stair > 0:
            stairs = max(round((1 - self.target) / self.stair), 1)
            return max(self.target, 1 - self.stair * int(iteration / max(iterations, 1) / self.settled * stairs + 1e-9))
        return 1 + (self.target - 1) * min(done / self.settled, 1)

    def at(self, iteration: int, iterations: int) -> AreaPenalty:
        """The penalty with the c of that step."""
        now = self.target if iteration < 0 else self.wanted(iteration, iterations)
        return AreaPenalty(self.target, self.weight, self.settled, self.stair, now)

    def of_table(self, table: torch.Tensor, unit: torch.Tensor) -> torch.Tensor:
        """The penalty of a unit."""
        return self.weight * (unit.mean() - (self.target if self.now is None else self.now)) ** 2
