"""Budgets by a clock that the tests turn: every stage leaves the later ones their time, and too little is refused."""

from __future__ import annotations

import math
import pickle
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from maskfab.base.errors import JobError
from maskfab.base.work import NO_END, Clock
from maskfab.camera.learning import Run
from maskfab.designs.search.result import Stages

UNIT = np.ones((3, 3), dtype=np.bool_)


@dataclass
class Hand:
    """Time that goes by when something is done."""

    s: float = 0.0

    def __call__(self) -> float:
        return self.s

    def spend(self, seconds: float) -> None:
        self.s += seconds


def test_a_budget_is_counted_from_when_its_clock_was_made() -> None:
    hand = Hand(100.0)
    clock = Clock(10.0, now=hand)
    early = clock.before(4.0)
    hand.spend(3.0)
    assert (clock.spent, clock.left(), clock.left(0.5), early.left()) == (3.0, 7.0, 3.5, 3.0)
    assert clock.affords(6.9)
    assert not clock.affords(7.1)
    hand.spend(3.0)
    assert (clock.over, early.over) == (False, True)
    assert NO_END.left() is None
    assert NO_END.before(5.0).left() is None
    assert NO_END.affords(math.inf)
    assert not NO_END.over


def test_another_process_gets_a_clock_of_what_is_left() -> None:
    hand = Hand()
    clock = Clock(10.0, refuses=True, now=hand)
    hand.spend(4.0)
    assert pickle.loads(pickle.dumps(clock)) == Clock(6.0, refuses=True)
    assert pickle.loads(pickle.dumps(NO_END)).left() is None
    clock.halt.set()
    assert pickle.loads(pickle.dumps(clock)).over


def test_a_large_die_is_left_the_time_of_its_look_however_fast_openings_are_judged() -> None:
    """13 s of 59 x 59 pixels; a budget of a minute took more by nearly as much."""
    searched = []
    for die_s in (0.0, 13.0):
        hand = Hand()
        stages = Stages.of(lambda _, hand=hand: hand.spend(1e-3), UNIT, Clock(60.0, now=hand), fitted=True, die_s=die_s)
        searched.append(stages.search.left())
    assert searched[0] - searched[1] == pytest.approx(13 - 1.8)


def test_a_budget_that_cannot_be_kept_is_refused_with_the_least_that_can() -> None:
    hand = Hand()
    clock = Clock(10.0, refuses=True, now=hand)
    hand.spend(8.0)
    clock.require(3.9, "steps", "minutes")
    with pytest.raises(JobError) as caught:
        clock.require(4.1, "steps", "minutes")
    assert caught.value.code == "MF150"
    assert "10 s is too short: steps take until 12 s" in caught.value.what
    assert caught.value.cure == "Give 15 s or more"
    Clock(1.0, now=hand).require(99.0, "steps", "minutes")


def test_what_has_part_of_a_budget_tells_the_whole_that_it_needs():
    hand = Hand()
    with pytest.raises(JobError) as caught:
        Clock(60.0, refuses=True, now=hand).before(24.0).require(135.0, "openings", "budget")
    assert "60 s is too short: openings take until 140 s from the beginning, and have 36 s of it" in caught.value.what
    assert caught.value.cure == "Give 270 s or more"
    with pytest.raises(JobError, match="0 s is too short"):
        Clock(0.0, refuses=True, now=hand).require(1.0, "openings", "budget")


@given(st.floats(1e-4, 1.0), st.floats(0.1, 1e4), st.booleans(), st.booleans())
def test_the_stages_of_a_design_leave_time_to_those_after_them(
    judgement_s: float, budget_s: float, mapped: bool, fitted: bool
) -> None:
    hand = Hand()
    clock = Clock(budget_s, refuses=True, now=hand)
    try:
        stages = Stages.of(lambda _: hand.spend(judgement_s), UNIT, clock, mapped=mapped, fitted=fitted)
    except JobError:
        # Not even the first openings would have kept it.
        assert budget_s < 3000 * judgement_s
        return
    search, design, left = stages.search.left(), stages.map.left(), clock.left()
    assert search is not None
    assert design is not None
    assert left is not None
    assert search <= design <= left
    assert (search < design) == (mapped and design > 0)
    assert not stages.bounded or design + stages.bounds_s <= left
    # A budget of hours is spent on the search, and proves its bounds.
    assert budget_s < 2e4 * judgement_s or (stages.bounded and search > 0.3 * budget_s)


def test_a_budget_costs_no_judgement_where_there_is_none() -> None:
    assert Stages.of(lambda _: pytest.fail("judged"), UNIT, NO_END, mapped=True) == Stages(NO_END, NO_END)


class Lessons:
    """A training whose steps take a time."""

    def __init__(self, hand: Hand, step_s: float) -> None:
        self.hand, self.step_s, self.step = hand, step_s, 0

    def get_ready(self) -> None:
        """Lessons are part of what was set up."""

    def advance(self) -> float:
        self.hand.spend(self.step_s)
        self.step += 1
        return 1.0


@given(
    st.floats(1.0, 1000.0), st.floats(0, 1.3), st.floats(1e-3, 0.5), st.floats(1e-3, 0.3), st.sampled_from([1, 3, 90])
)
def test_a_training_keeps_its_minutes_within_a_fifth_or_is_refused(
    budget_s: float, set_up: float, step: float, look: float, fewest: int
) -> None:
    """Set-up, steps and looks as shares of the budget; steps and looks take as long each time."""
    hand = Hand()
    clock = Clock(budget_s, refuses=True, now=hand)
    hand.spend(set_up * budget_s)
    lessons: Any = Lessons(hand, step * budget_s)
    nothing: Any = None
    run = Run(Path("none"), nothing, nothing, lessons, nothing, (), clock=clock, fewest=fewest)

    def kept(loss: float) -> str:
        hand.spend(look * budget_s)
        run.history.append({"step": lessons.step, "loss": loss, "gain": 0.0, "gain_over_filter": 0.0})
        return "found"

    run._kept = kept  # type: ignore[method-assign, assignment]
    try:
        run.trained(lambda *_: None)
    except JobError as refusal:
        assert set_up + fewest * step > 1.2 - 1e-9
        what = refusal.what
        assert f"and {fewest} steps of" in what
        assert not run.history
        return
    least = set_up + step + look
    assert hand.s <= max(1.0, least) * budget_s * (1 + 1e-9)
    assert run.history[-1]["step"] == lessons.step
    # What is left at the end is less than another step and look would take.
    assert lessons.step == 1 or hand.s >= (1 - step - look) * budget_s * (1 - 1e-9)
