"""Scans and annealings: exact optima where they are known, the same answer every time, constraints at every step."""

from __future__ import annotations

import json

import numpy as np
import pytest
from asked_displays import asked_display

from maskfab.base.errors import InternalError, JobError, OpeningError
from maskfab.base.processes import SerialExecutor
from maskfab.base.work import Clock
from maskfab.designs.rules.constraints import Constraints
from maskfab.designs.rules.display_fit import of_display
from maskfab.designs.rules.families import Candidate, bars, discs
from maskfab.designs.search.annealing import MOVES, ExpectedPsnr, State, anneal, scan
from maskfab.designs.search.result import prices


def tightness(unit):
    """Less the mean squared distance from the centroid: discs are best."""
    place = np.argwhere(unit)
    return -float(((place - place.mean(axis=0)) ** 2).sum(axis=1).mean())


def leftness(unit):
    return -float(np.nonzero(unit)[1].mean())


def start(constraints):
    return scan(bars(constraints.dots, constraints.clear_dots), leftness, constraints).best.unit


def test_a_scan_ranks_all_that_may_be():
    held = Constraints(12, dots=7, rim_dots=1, kissing="cell")
    found = scan(bars(7, 12), tightness, held)
    values = [each.value for each in found.ranked]
    assert values == sorted(values, reverse=True)
    assert found.evaluated == len(values)
    assert all(held.allows(each.unit) for each in found.ranked)
    assert found.complete
    assert found.evaluated + sum(found.refused.values()) == len(list(bars(7, 12)))
    assert "3x4" in found.best.name or "4x3" in found.best.name


class Others(SerialExecutor):
    """Three processes, as far as a search can tell; counts what it is given."""

    processes = 3

    def __init__(self):
        self.given = []

    def run_all(self, calls, done=lambda _: None):
        self.given.append(len(calls))
        return super().run_all(calls, done)


def test_others_and_turns_change_nothing(monkeypatch):
    """Once it is known to take long, a batch is cut into two parts for each process."""
    monkeypatch.setattr("maskfab.designs.search.annealing.WORTH_SHARING_S", 0.0)
    held, others, shapes = Constraints(9, dots=6), Others(), list(discs(21, 88))
    once = scan(bars(6, 9), tightness, held)
    again = scan(bars(6, 9), tightness, held, turned_alike=True)
    alone = scan(shapes, tightness, Constraints(88), evaluations=200)
    shared = scan(shapes, tightness, Constraints(88), evaluations=200, executor=others)
    assert others.given == [6, 6, 4]
    assert [one.value for one in shared.ranked] == [one.value for one in alone.ranked]
    assert again.best.value == once.best.value
    assert again.evaluated + again.repeated == once.evaluated
    assert {each.value for each in again.ranked} == {each.value for each in once.ranked}


def test_a_budget_counts_evaluations():
    held = Constraints(9, dots=6)
    told = []
    every = list(bars(6, 9))
    found = scan(every, tightness, held, evaluations=7, progress=lambda *where: told.append(where))
    everything = scan(bars(6, 9), tightness, held, evaluations=10_000)
    assert (found.evaluated, found.complete) == (7, False)
    assert everything.complete
    assert told
    assert told[-1][1] <= told[-1][2] == len(every)
    short = scan(bars(21, 100), leftness, Constraints(100), clock=Clock(0.0))
    same = scan(bars(21, 100), leftness, Constraints(100), evaluations=short.evaluated)
    assert short.evaluated % 64 == 0
    assert same.best.unit.tobytes() == short.best.unit.tobytes()


def test_a_scan_without_an_answer_says_which_rules_stood_in_the_way():
    with pytest.raises(JobError, match=r"MF123[\s\S]*symmetry"):
        scan(bars(7, 12), tightness, Constraints(12, dots=7, symmetry="d4", keep_out=np.eye(7, dtype=np.bool_)))
    with pytest.raises(JobError, match="MF123"):
        scan([], tightness, Constraints(10, dots=7))
    with pytest.raises(OpeningError, match="MF204"):
        scan(bars(7, 3), tightness, Constraints(3, dots=7, min_feature_dots=2))
    with pytest.raises(InternalError, match="MF901"):
        scan(bars(7, 3), lambda _: float("nan"), Constraints(3, dots=7))


def test_annealing_finds_the_disc():
    held = Constraints(21, dots=9)
    best = scan(discs(9, 21), tightness, Constraints(21, dots=9)).best.value
    found = anneal(start(held), tightness, held, evaluations=3000, temperature=(0.5, 0.01), seed=2)
    assert found.value == pytest.approx(best)
    assert found.complete
    assert not found.stuck


@pytest.mark.parametrize(
    "held",
    [
        Constraints(24, dots=9, min_feature_dots=2, kissing="neighbours", min_space_dots=2),
        Constraints(24, dots=10, symmetry="rot180", rim_dots=1),
        Constraints(24, dots=10, **of_display(asked_display(required=0.08, lines=2))),
    ],
    ids=["mask", "symmetry", "display"],
)
def test_constraints_hold_at_every_step(held):
    seen = []

    def watched(unit):
        seen.append(held.allows(unit))
        return tightness(unit)

    shapes = discs(held.dots, 24, symmetry=held["symmetry"], free=held.free)
    first = scan(shapes, leftness, held, evaluations=1).best.unit
    found = anneal(first, watched, held, evaluations=30, seed=1, temperature=(1.0, 0.1))
    assert all(seen)
    assert len(seen) == 31
    assert held.violations(found.unit) == ()
    assert found.value >= tightness(first)


def test_interrupted_is_as_uninterrupted_through_a_file():
    held = Constraints(20, dots=9, kissing="cell")
    walk = {"evaluations": 200, "temperature": (0.5, 0.01)}
    whole = anneal(start(held), tightness, held, seed=4, **walk)
    part = anneal(start(held), tightness, held, seed=4, until=100, **walk)
    assert (part.complete, part.state.evaluations) == (False, 100)
    for until in (101, 150, None):
        saved = json.dumps(part.state.plain())
        part = anneal(State.of(json.loads(saved)), tightness, held, seed=99, until=until, **walk)
    assert part.complete
    assert part.value == whole.value
    assert part.state.plain() == whole.state.plain()
    paused = anneal(start(held), tightness, held, seed=4, clock=Clock(0.0), **walk)
    assert paused.state.evaluations == 64
    resumed = anneal(paused.state, tightness, held, **walk)
    np.testing.assert_array_equal(resumed.unit, whole.unit)


def test_the_seed_decides():
    held = Constraints(20, dots=9)
    first, again, other = (
        anneal(start(held), tightness, held, evaluations=50, seed=seed).state.plain() for seed in (1, 1, 2)
    )
    assert first == again != other


@pytest.mark.parametrize("move", MOVES)
def test_every_move_keeps_the_count_and_goes_somewhere(move):
    held = Constraints(15, dots=8)
    first = np.zeros((8, 8), dtype=np.bool_)
    first[2:5, 1:6] = True
    found = anneal(first, lambda _: 0.0, held, evaluations=30, moves=[move])
    assert found.state.unit.sum() == 15
    assert (found.state.unit != first).any()
    np.testing.assert_array_equal(found.unit, first)


@pytest.mark.parametrize(("dots", "clear"), [(1, 1), (3, 9)])
def test_one_opening_only_is_said_to_be_stuck(dots, clear):
    held = Constraints(clear, dots=dots)
    found = anneal(np.ones((dots, dots), dtype=np.bool_), tightness, held, evaluations=10)
    assert found.stuck
    assert not found.complete
    assert found.state.evaluations == 0


@pytest.mark.parametrize(("dots", "clear"), [(2, 1), (2, 3), (5, 1), (5, 24), (13, 168), (64, 1)])
def test_one_dot_goes_where_it_is_best(dots, clear):
    held = Constraints(clear, dots=dots)
    one_dot = scan(discs(dots, clear), leftness, held, evaluations=20).best.unit
    found = anneal(one_dot, leftness, held, evaluations=400, temperature=(1e-3, 1e-4), seed=1)
    order = np.sort(np.tile(np.arange(dots), dots))[:clear]
    assert found.value == pytest.approx(-order.mean())


def test_bad_input():
    held = Constraints(4, dots=4)
    unit = next(bars(4, 4)).unit
    for wrong in ({"moves": ()}, {"moves": ("jump",)}):
        with pytest.raises(JobError, match="MF105"):
            anneal(unit, tightness, held, evaluations=1, **wrong)
    for cooling in ((0.1, 0.2), (0.0, 0.0), (float("inf"), 1.0), (float("nan"), 0.1)):
        with pytest.raises(JobError, match="MF104"):
            anneal(unit, tightness, held, evaluations=1, temperature=cooling)
    with pytest.raises(JobError, match=r"MF123[\s\S]*clear_dots"):
        anneal(np.ones((4, 4), dtype=np.bool_), tightness, held, evaluations=1)
    with pytest.raises(JobError, match="MF105"):
        State.of({"unit": [[1]]})
    with pytest.raises(OpeningError, match="MF203"):
        anneal(np.zeros((4, 4), dtype=np.bool_), tightness, Constraints(0, dots=4), evaluations=1)


def test_prices_are_differences_of_bests():
    units = {"a": [0, 1], "b": [0, 4], "c": [5, 6], "d": [0, 5]}
    worth = {"a": 4.0, "b": 3.0, "c": 2.0, "d": 1.0}
    made = {}
    for name, places in units.items():
        unit = np.zeros(9, dtype=np.bool_)
        unit[places] = True
        made[name] = unit.reshape(3, 3)
    value = {unit.tobytes(): worth[name] for name, unit in made.items()}
    keep_out = np.zeros((3, 3), dtype=np.bool_)
    keep_out[0, 1] = True
    held = Constraints(2, dots=3, keep_out=keep_out, kissing="cell")
    broken = {name: held.broken(unit) for name, unit in made.items()}
    assert broken == {"a": {"keep_out"}, "b": {"kissing"}, "c": set(), "d": set()}
    found = prices([Candidate(n, u) for n, u in made.items()], lambda unit: value[unit.tobytes()], held)
    assert found.together == 2.0
    assert {price.rule: (price.alone, price.last) for price in found.each} == {
        "keep_out": (1.0, 2.0),
        "kissing": (0.0, 1.0),
    }
    with pytest.raises(JobError, match="MF105"):
        prices([], tightness, held)


class Levels:
    """A surrogate whose answer is its level."""

    def __call__(self, unit, *, periodic=False, levels=()):
        return tuple(float(level) for level in levels)


def test_levels_are_weighed():
    unit = np.ones((2, 2), dtype=np.bool_)
    assert ExpectedPsnr(Levels())(unit) == pytest.approx((24 + 32 + 40) / 3)
    assert ExpectedPsnr(Levels(), levels=(24, 40), weights=(1, 3))(unit) == pytest.approx(36)
    for weights, code in (((1.0,), "MF105"), ((0.0, 0.0), "MF104"), ((-1.0, 2.0), "MF104")):
        with pytest.raises(JobError, match=code):
            ExpectedPsnr(Levels(), levels=(24, 40), weights=weights)
