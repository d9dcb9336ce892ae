"""Restored photographs against emitters: dominance, the bound on footprints, exact curves, and what is refused."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from once import leaves
from sweeps import examples

from maskfab.camera.photographs import Photograph
from maskfab.display.emitters.emitter_rules import EmitterRules
from maskfab.errors import MaskfabError
from maskfab.jobfile import ParetoSection, SearchSection, parse_section
from maskfab.model import Opening
from maskfab.opening.openings import opening_text, parse_opening
from maskfab.optimiser.model.expected_psnr import surrogate
from maskfab.optimiser.pareto import Footprints, JudgedOpening, Pareto, non_dominated, openings, rules_of, sweep
from maskfab.optimiser.rules.constraints import Constraints
from maskfab.optimiser.rules.discrete import ExpectedPsnr
from maskfab.optimiser.rules.families import bars

DOTS, DOT_NM = 8, 21000
RULES = EmitterRules(DOT_NM, DOT_NM, DOT_NM)
PLAIN = {"name": "found", "dots": DOTS, "pitch": "168 um", "clear_dots": 12}


@pytest.fixture(scope="module")
def scenes() -> tuple[Photograph, ...]:
    return (leaves(1),)


def section(**changed: object) -> SearchSection:
    return parse_section(SearchSection, {**PLAIN, **changed}, where="test")


def asked(*counts: int, **more: object) -> ParetoSection:
    return parse_section(ParetoSection, {"clear_dots": list(counts), **more}, where="test")


def covers(wide: Pareto, narrow: Pareto) -> bool:
    """Whether every opening of one has an equal or a better in the other."""
    return all(any(w.value >= n.value - 1e-12 and w.footprint >= n.footprint for w in wide.best) for n in narrow.best)


LEVELS_OF = st.integers(0, 6).map(float)


@given(st.lists(st.tuples(LEVELS_OF, LEVELS_OF), max_size=40))
def test_what_is_kept_is_dominated_by_none_and_covers_all(pairs: list[tuple[float, float]]) -> None:
    kept = non_dominated([a for a, _ in pairs], [b for _, b in pairs])
    chosen = [pairs[k] for k in kept]
    assert chosen == sorted(set(chosen), reverse=True)
    for a, b in chosen:
        assert not any(c >= a and d >= b and (c, d) != (a, b) for c, d in pairs)
    for a, b in pairs:
        assert any(c >= a and d >= b for c, d in chosen)
    assert all(pairs.index(pairs[k]) == k for k in kept)


@examples(40)
@given(st.integers(0, 2**32 - 1), st.integers(0, 2), st.integers(0, 3), st.integers(1, 3), st.floats(0.02, 0.6))
def test_no_footprint_exceeds_its_bound(seed: int, to_opening: int, gap: int, width: int, share: float) -> None:
    unit = np.random.default_rng(seed).random((DOTS, DOTS)) < share
    rules = EmitterRules(to_opening * DOT_NM, gap * DOT_NM, width * DOT_NM, (1.0, 1.0, 1.0 + seed % 3))
    footprints = Footprints(rules, DOTS, DOT_NM)
    assert footprints(unit) <= footprints.bounds(unit[None])[0] + 1e-12


def test_the_bound_is_reached_where_nothing_parts_the_colours() -> None:
    footprints = Footprints(EmitterRules(0, 0, DOT_NM), 9, DOT_NM)
    closed = np.zeros((9, 9), dtype=np.bool_)
    assert footprints(closed) == pytest.approx(1 / 3, abs=1e-12)
    assert footprints.bounds(closed[None])[0] == pytest.approx(1 / 3, abs=1e-12)


def test_the_footprint_is_the_one_that_rules_of_a_design_judge() -> None:
    for candidate in list(bars(DOTS, 12))[::9]:
        found = Footprints(RULES, DOTS, DOT_NM)(candidate.unit)
        for wanted, kept in ((found, True), (found + 1e-6, False)):
            rules = Constraints(12, dots=DOTS, dot_nm=DOT_NM, emitters=RULES, footprint=wanted)
            assert rules.allows(candidate.unit) is kept


@pytest.mark.parametrize("tiling", ["random", "periodic"])
def test_curves_are_exact_among_all_shapes(scenes: tuple[Photograph, ...], tiling: str) -> None:
    found = sweep(asked(9, 12), section(tiling=tiling), scenes, emitters=RULES)
    periodic = tiling == "periodic"
    worth = ExpectedPsnr(surrogate(scenes, DOTS), periodic)
    footprints = Footprints(RULES, DOTS, DOT_NM, (0,) if periodic else tuple(range(8)))
    for curve in found.curves:
        units = [candidate.unit for candidate in bars(DOTS, curve.clear_dots)]
        values, rooms = [worth(unit) for unit in units], [footprints(unit) for unit in units]
        best = [(values[k], rooms[k]) for k in non_dominated(np.round(values, 9).tolist(), np.round(rooms, 9).tolist())]
        told = [(each.value, each.footprint) for each in curve.front]
        assert told == [pytest.approx(pair, abs=1e-9) for pair in best]
        assert all(each.clear_dots == curve.clear_dots for each in curve.front)
        assert 0 < curve.measured <= curve.evaluated <= len(units)
        assert curve.complete
    every = [each for curve in found.curves for each in curve.front]
    assert set(found.best) <= set(every)
    assert len(found.best) == len(non_dominated([e.value for e in every], [e.footprint for e in every]))


def test_more_shapes_more_sizes_and_annealing_never_lose(scenes: tuple[Photograph, ...]) -> None:
    narrow = sweep(asked(12), section(), scenes, emitters=RULES)
    wide = sweep(asked(12), section(families=["bars", "l_shapes"]), scenes, emitters=RULES)
    sizes = sweep(asked(9, 12, 15), section(), scenes, emitters=RULES)
    walked = sweep(asked(12, anneal=30, points=2), section(seed=4), scenes, emitters=RULES)
    assert covers(wide, narrow)
    assert covers(sizes, narrow)
    assert covers(walked, narrow)
    assert walked.curves[0].evaluated > narrow.curves[0].evaluated


def test_a_least_footprint_cuts_the_curve_where_it_is(scenes: tuple[Photograph, ...]) -> None:
    free = sweep(asked(12), section(), scenes, emitters=RULES)
    least = free.curves[0].front[-1].footprint
    ruled = sweep(asked(12), section(rules={"footprint": least}), scenes, emitters=RULES)
    assert [each.value for each in ruled.curves[0].front] == [free.curves[0].front[-1].value]


def test_sizes_that_cannot_be_are_told_and_none_at_all_is_refused(scenes: tuple[Photograph, ...]) -> None:
    found = sweep(asked(12, 64, 65), section(rules={"rim_dots": 1}), scenes, emitters=RULES)
    assert [bool(curve.front) for curve in found.curves] == [True, False, False]
    assert [curve.refusal is None for curve in found.curves] == [True, False, False]
    assert "MF204" in str(found.curves[2].refusal)
    with pytest.raises(MaskfabError, match="MF204"):
        sweep(asked(65, 66), section(), scenes, emitters=RULES)


def test_a_given_opening_is_judged_as_those_found(scenes: tuple[Photograph, ...]) -> None:
    found = sweep(asked(12), section(), scenes, emitters=RULES)
    named = openings(found, section(), "maskfab pareto x.toml --out y")
    given = [opening for _, opening in named.values()]
    again = sweep(asked(12), section(), scenes, compared=given, emitters=RULES)
    for (judged, _), other in zip(named.values(), again.compared, strict=True):
        assert (judged.value, judged.psnr, judged.footprint) == (other.value, other.psnr, other.footprint)
        assert again.gain_db(other) == 0
    roomier = JudgedOpening("x", given[0].mask, 0.0, (0.0,) * 3, 1.0)
    assert found.gain_db(roomier) is None


def test_openings_say_where_they_come_from(scenes: tuple[Photograph, ...]) -> None:
    found = sweep(asked(9, 12), section(seed=7), scenes, emitters=RULES)
    named = openings(found, section(seed=7), "maskfab pareto x.toml --out y")
    assert len(named) == sum(len(curve.front) for curve in found.curves)
    for name, (judged, opening) in named.items():
        back = parse_opening(opening_text(opening))
        assert back.name == name
        assert np.array_equal(back.mask, judged.unit)
        assert back.provenance["command"] == "maskfab pareto x.toml --out y"
        assert back.provenance["shape"] == judged.shape
        assert back.provenance["footprint"] == pytest.approx(judged.footprint, abs=1e-6)
        assert back.provenance["expected_psnr_32"] == pytest.approx(judged.psnr[1], abs=1e-3)


def test_a_budget_stops_the_look_and_is_told(scenes: tuple[Photograph, ...]) -> None:
    found = sweep(asked(9, 12), section(families=["bars", "discs"]), scenes, emitters=RULES, budget_s=1e-6)
    assert not found.curves[0].complete
    assert all(curve.front and curve.evaluated <= 64 for curve in found.curves)


def test_what_does_not_suit_the_grid_is_refused() -> None:
    other = Opening("other", np.eye(7, dtype=np.bool_), 24000)
    for compared, emitters, code in (
        ((other,), RULES, "MF105"),
        ((), EmitterRules(0, 10**6, DOT_NM), "MF117"),
        ((), EmitterRules(0, 1, DOT_NM), "MF118"),
    ):
        with pytest.raises(MaskfabError, match=code):
            rules_of(section(), compared, emitters)
