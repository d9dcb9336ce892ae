"""Openings within a tenth of a decibel of the best of a search: which are told, and what is said of them."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from asked_displays import asked_display
from hypothesis import given
from hypothesis import strategies as st

from maskfab.base.arrays import Mask
from maskfab.base.model import orient
from maskfab.designs.model.appraisal import Spread, moved_by_bias, robustness
from maskfab.designs.model.panel_error import PupilError
from maskfab.designs.rules.constraints import Constraints
from maskfab.designs.rules.display_fit import of_display
from maskfab.designs.rules.families import FAMILIES
from maskfab.designs.search.annealing import Ranked, State, anneal, rises
from maskfab.designs.search.result import WITHIN_DB, alternatives, asked_of, rim_dots

DOTS, CLEAR = 6, 9
RULES = Constraints(CLEAR, dots=DOTS, kissing="cell")


def worth(unit: Mask) -> float:
    """Some value that turns do not change: rounder is better, a tenth of a decibel for a dot of moment."""
    rows, columns = np.nonzero(unit)
    return 30 - 0.1 * float(rows.var() + columns.var())


BARS = [Ranked(each.name, each.unit, worth(each.unit)) for each in FAMILIES["bars"](DOTS, CLEAR)]
BEST = max(BARS, key=lambda each: each.value)


def test_one_of_each_kind_stands_for_all_within_reach() -> None:
    found = alternatives(BEST, BARS, RULES, moved=None, bias_um=0.1)
    within = [each for each in BARS if each.value >= BEST.value - WITHIN_DB]
    turned = {min(orient(each.unit, k).tobytes() for k in range(8)) for each in within}
    assert found.within == len(turned) - 1
    assert 0 < len(found.others) <= found.kinds
    assert found.chosen.alike + sum(each.alike for each in found.others) <= found.within + 1
    for each in found.others:
        assert found.chosen.value - WITHIN_DB <= each.value <= found.chosen.value
        assert RULES.allows(each.unit)
        assert each.rim_um == rim_dots(each.unit) * 8
        assert not any(np.array_equal(orient(each.unit, k), BEST.unit) for k in range(8))
    assert [each.value for each in found.others] == sorted((each.value for each in found.others), reverse=True)


def test_rules_are_kept_and_what_is_turned_or_out_of_reach_is_none() -> None:
    rimmed = RULES.asking(rim_dots=1)
    inside = max((each for each in BARS if rimmed.allows(each.unit)), key=lambda each: each.value)
    found = alternatives(inside, BARS, rimmed, moved=None, bias_um=0.1)
    assert all(rim_dots(each.unit) >= 1 for each in found.others)
    twins = [Ranked("bar turned", orient(BEST.unit, k), BEST.value) for k in range(8)]
    far = Ranked("bar far", BARS[0].unit, BEST.value - WITHIN_DB - 1e-9)
    alone = alternatives(BEST, [*twins, far], RULES, moved=None, bias_um=0.1)
    assert (alone.within, alone.kinds, alone.others) == (0, 0, ())


def test_what_an_alternative_is_better_at_is_what_it_has_more_of() -> None:
    found = alternatives(BEST, BARS, RULES, moved=lambda unit: 1 / (1 + rim_dots(unit)), bias_um=0.1)
    assert found.chosen.moved_db == 1 / (1 + rim_dots(BEST.unit))
    own = replace(found.chosen, emitters=0.1, moved_db=0.02)
    assert own.better_at(own) == ()
    assert replace(own, value=own.value + 0.05).better_at(own) == ("psnr",)
    more = replace(own, value=own.value - 0.05, emitters=0.12, rim_um=own.rim_um + 8, moved_db=0.01)
    assert more.better_at(own) == ("emitters", "rim", "bias")
    assert replace(own, emitters=None, moved_db=None).better_at(own) == ()


def test_a_bias_moves_what_the_appraisal_of_a_panel_says(coarse: PupilError) -> None:
    unit = np.zeros((coarse.dots, coarse.dots), dtype=np.bool_)
    unit[1:5, 2:4] = True
    kinds = np.zeros((coarse.cells, coarse.cells), dtype=np.int8)
    appraised = robustness(unit[None], kinds, coarse, spread=Spread(bias_um=2.0), seed=0, periodic=True, mapped=False)
    assert appraised.bias is not None
    narrow, wide = (np.dot(coarse.weights, psnr) for psnr in appraised.bias.psnr)
    assert moved_by_bias(unit, kinds, coarse, 2.0) == pytest.approx((wide - narrow) / 2, abs=1e-12)
    assert wide > narrow


@given(st.lists(st.integers(-5, 5)))
def test_rises_are_where_a_running_maximum_rises(values: list[int]) -> None:
    highest = np.maximum.accumulate(values) if values else np.array([])
    first = [k for k in range(len(values)) if k == 0 or highest[k] > highest[k - 1]]
    assert rises(map(float, values)) == tuple((k + 1, float(values[k])) for k in first)


def test_an_annealing_that_goes_on_has_been_where_one_without_a_stop_has() -> None:
    whole = anneal(BEST.unit, worth, RULES, evaluations=60, seed=3).state
    half = anneal(BEST.unit, worth, RULES, evaluations=60, seed=3, until=25).state
    rest = anneal(State.of(half.plain()), worth, RULES, evaluations=60, seed=3).state
    assert rest.bettered == whole.bettered
    assert [value for value, _ in rest.visited] == [value for value, _ in whole.visited]
    assert all(RULES.allows(unit) and worth(unit) == value for value, unit in whole.visited)
    assert max(value for value, _ in whole.visited) == whole.best_value


def test_rules_are_told_with_what_they_ask() -> None:
    held = asked_display(lines=3, wire_nm=8000, clearance_nm=1000, min_width_nm=8000)
    drawn = np.zeros((DOTS, DOTS), dtype=np.bool_)
    drawn[0, 0] = True
    rules = Constraints(CLEAR, dots=DOTS, rim_dots=1, keep_out=drawn, kissing="cell", **of_display(held))
    told = asked_of(rules)
    assert told.keys() == set(rules.active)
    assert (told["rim_dots"], told["keep_out"], told["kissing"]) == ("1 dot", "", "cell")
    assert told["wires"] == "3 lines each way"
    assert told["emitters"].endswith("% of the pixel for each colour")
