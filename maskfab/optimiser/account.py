"""Account of a design: what was tried, in what order it got better, and what ended it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from types import MappingProxyType

from maskfab.model import Tiling
from maskfab.optimiser.rules.constraints import Constraints
from maskfab.optimiser.rules.discrete import Bettered
from maskfab.optimiser.rules.fit_rule import Display

ANNEALING = "steps of annealing"
"""The stage that changes openings dot by dot."""


@dataclass(frozen=True)
class Without:
    """Searches once more without each rule.

    Attributes:
        gain_db: over the best that was found, by the rule that was left out; 0 or more.
        processor_s: seconds that they took.
    """

    gain_db: Mapping[str, float]
    processor_s: float


@dataclass(frozen=True)
class Account:
    """The way to a design.

    Attributes:
        method: by which it was searched, in words.
        seed: of its random numbers.
        stages: what was tried, and how often, in the order in which it was.
        value: what the values of ``bettered`` are, with their unit; empty where there are none.
        bettered: evaluations made when the best value was bettered, and that value.
        stopped: what ended it.
        tiling, tiling_seed: of the panel; with a map, of the cells that it does not design.
        asked: the rules that were asked for, with what each asks.
        budget_s: seconds; None without a budget.
        scenes: photographs that it was judged by, in words.
        priced_among: openings among which the rules are priced.
        without: searches once more without each rule; None where these were not asked for, or are not made.
    """

    method: str
    seed: int
    stages: tuple[tuple[str, int], ...]
    value: str
    bettered: Bettered
    stopped: str
    tiling: Tiling
    tiling_seed: int
    asked: Mapping[str, str] = field(default_factory=lambda: MappingProxyType({}))
    budget_s: float | None = None
    scenes: str = ""
    priced_among: int = 0
    without: Without | None = None


def asked_of(rules: Constraints) -> dict[str, str]:
    """Rules that ask for something, with what each asks in words; empty words where its value is a picture."""
    told = {}
    for rule in rules.rules:
        value = rules[rule.name]
        plain = isinstance(value, str | int | float) and not isinstance(value, bool)
        unit = rule.unit.removesuffix("s") if plain and value == 1 else rule.unit
        told[rule.name] = f"{value} {unit}".strip() if plain else ""
        if isinstance(value, Display):
            told[rule.name] = value.asks(rule.name)
    return told


def stopped(cut: bool) -> str:
    """The end of a search, that a budget ``cut`` short or did not."""
    return "the budget" if cut else "everything that was asked for was tried"
