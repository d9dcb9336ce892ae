"""Descents: to a known optimum, in portions, from several starts, and with every way to end."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import pytest
import torch

from maskfab.base.errors import InputError, InternalError, SourceError
from maskfab.designs.descent.objective import AreaPenalty, Objective, Weighted
from maskfab.designs.descent.schedule import Descent, Outcome, RelaxStep, descend, iterations_within

DOTS = 6
HOW = Descent(dots=DOTS, clear_dots=9, iterations=40, seed=3)
PENALTY = AreaPenalty(0.25, 20.0)
AIM = torch.from_numpy(np.random.default_rng(5).permutation(36).reshape(6, 6) < 9).float()


@dataclass(frozen=True, eq=False)
class Distance(Objective):
    """Squared distance to a known unit, times a factor that may change from step to step."""

    correlation = None
    aim: torch.Tensor
    factor: float = 1.0
    spoilt_from: float = math.inf
    slope_only: bool = False

    def of_table(self, table: torch.Tensor, unit: torch.Tensor) -> torch.Tensor:
        value = self.factor * ((unit - self.aim) ** 2).sum()
        return torch.sqrt(value - value) if self.slope_only else value

    def at(self, iteration: int, iterations: int) -> Distance:
        if iteration < 0:
            return replace(self, factor=1.0)
        return replace(self, factor=math.nan if iteration >= self.spoilt_from else 1 + 0.1 * math.sin(iteration))


GOAL = Distance(AIM)


@pytest.mark.parametrize(
    "change",
    [
        {},
        {"precision": "float64"},
        {"judged_every": 0},
        {"starts": 2},
    ],
)
def test_reaches_the_known_optimum_with_the_exact_count(change: dict[str, object]) -> None:
    found = descend(GOAL, PENALTY, replace(HOW, iterations=100, **change))  # type: ignore[arg-type]
    assert torch.equal(found.unit.float(), AIM)
    assert found.loss == 0
    assert found.outcome is Outcome.FINISHED
    assert found.iterations == 100 * int(change.get("starts", 1))  # type: ignore[call-overload]


@pytest.mark.parametrize("clear_dots", [1, 35, 36])
def test_any_count_is_met(clear_dots: int) -> None:
    found = descend(GOAL, AreaPenalty(max(clear_dots, 1) / 36, 20.0), replace(HOW, clear_dots=clear_dots))
    assert int(found.unit.sum()) == clear_dots


@pytest.mark.parametrize("how", [HOW, replace(HOW, starts=2)])
def test_in_portions_ends_bit_for_bit_where_one_go_does(tmp_path: Path, how: Descent) -> None:
    whole = descend(GOAL, PENALTY, how)
    path = tmp_path / "state.npz"
    for _ in range(100):
        part = descend(GOAL, PENALTY, how, checkpoint=path, stop_after=7)
        if part.outcome is not Outcome.INTERRUPTED:
            break
    assert torch.equal(part.unit, whole.unit)
    assert torch.equal(part.relaxed, whole.relaxed)
    assert (part.loss, part.iterations, part.outcome) == (whole.loss, whole.iterations, whole.outcome)
    again = descend(GOAL, PENALTY, how, checkpoint=path)
    assert torch.equal(again.unit, whole.unit)
    assert again.iterations == whole.iterations


def test_a_kill_between_states_costs_steps_but_changes_nothing(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("maskfab.designs.descent.schedule.SAVED_EVERY", 10)
    path = tmp_path / "state.npz"

    def killed(step: RelaxStep) -> None:
        if step.iteration == 23:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        descend(GOAL, PENALTY, HOW, checkpoint=path, progress=killed)
    seen: list[int] = []
    resumed = descend(GOAL, PENALTY, HOW, checkpoint=path, progress=lambda step: seen.append(step.iteration))
    assert seen == list(range(20, 40))
    assert torch.equal(resumed.relaxed, descend(GOAL, PENALTY, HOW).relaxed)


@pytest.mark.parametrize(
    ("goal", "penalty", "how"),
    [
        (GOAL, PENALTY, replace(HOW, seed=4)),
        (GOAL, AreaPenalty(0.3, 20.0), HOW),
        (Distance(1 - AIM), PENALTY, HOW),
    ],
)
def test_a_checkpoint_of_another_run_is_refused(
    tmp_path: Path, goal: Objective, penalty: AreaPenalty, how: Descent
) -> None:
    path = tmp_path / "state.npz"
    descend(GOAL, PENALTY, HOW, checkpoint=path, stop_after=3)
    with pytest.raises(SourceError) as caught:
        descend(goal, penalty, how, checkpoint=path)
    assert caught.value.code == "MF304"


def test_the_best_of_several_starts_counts() -> None:
    how = replace(HOW, iterations=2, rate=0.01)
    alone = [descend(GOAL, None, replace(how, seed=3 + k)).loss for k in range(4)]
    assert len(set(alone)) > 1
    assert descend(GOAL, None, replace(how, starts=4)).loss == min(alone)


@pytest.mark.parametrize("logit", [0.0, 5.0, -5.0])
def test_an_even_start_is_said(logit: float) -> None:
    even = Weighted(((1.0, Distance(torch.full((DOTS, DOTS), 0.2))),))
    found = descend(even, None, replace(HOW, start_logit=logit, start_noise=0.0, iterations=3))
    assert len(found.notes) == 1
    assert "saddle" in found.notes[0]
    assert not descend(even, None, replace(HOW, iterations=3)).notes


@pytest.mark.parametrize("logit", [-1000.0, 1000.0])
def test_a_start_without_any_slope_is_refused(logit: float) -> None:
    with pytest.raises(InputError) as caught:
        descend(GOAL, PENALTY, replace(HOW, start_logit=logit, start_noise=0.0))
    assert caught.value.code == "MF104"
    assert "slope" in str(caught.value)


def test_not_a_number_keeps_the_best_before_it() -> None:
    found = descend(Distance(AIM, spoilt_from=15), PENALTY, HOW)
    assert found.outcome is Outcome.NOT_FINITE
    assert math.isfinite(found.loss)
    assert "iteration 15" in found.notes[0]
    assert int(found.unit.sum()) == 9


@pytest.mark.parametrize("goal", [Distance(AIM, spoilt_from=0), Distance(AIM, slope_only=True)])
def test_not_a_number_from_the_first_is_an_error(goal: Distance) -> None:
    """A loss that is not finite, and a finite loss whose gradient is not."""
    with pytest.raises(InternalError) as caught:
        descend(goal, PENALTY, HOW)
    assert caught.value.code == "MF901"


def test_a_budget_of_seconds_is_a_count_of_steps() -> None:
    count = iterations_within(GOAL, PENALTY, HOW, 0.5)
    assert 20 <= count <= 100_000
    assert iterations_within(GOAL, PENALTY, HOW, 1e-9) == 1
