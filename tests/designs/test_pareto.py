"""Designs for a display: dominance, the bound on footprints, exact curves, and what is refused."""

from __future__ import annotations

import numpy as np
import pytest
from asked_displays import asked_display
from hypothesis import given
from hypothesis import strategies as st
from once import leaves
from sweeps import examples

from maskfab.base.errors import MaskfabError
from maskfab.base.model import Opening, Tiling
from maskfab.base.work import Clock
from maskfab.base.workers import Workers
from maskfab.camera.scenes import Photograph
from maskfab.camera.stop_cells import F1, lattice
from maskfab.designs.design import display_of, stated_display
from maskfab.designs.front import (
    FrontCurve,
    JudgedOpening,
    Pareto,
    lines_of,
    require_uneven,
    rules_of,
    sought,
    spread,
    stair,
    sweep,
)
from maskfab.designs.front_designs import FrontDesign, designs
from maskfab.designs.maps.light import Middle
from maskfab.designs.maps.shares import Shares
from maskfab.designs.model.expected_psnr import surrogate_behind
from maskfab.designs.model.statistics import F1_SETTINGS
from maskfab.designs.rules.constraints import Constraints
from maskfab.designs.rules.display_fit import Display, Footprints
from maskfab.designs.rules.families import bars
from maskfab.designs.search.annealing import ExpectedPsnr
from maskfab.display.emitter_rules import EmitterRules, Verdict
from maskfab.job.faults import parse_section
from maskfab.job.read import validate
from maskfab.job.sections import JobSpec, ParetoSection, RulesSection, SearchSection
from maskfab.job.toml import loads
from maskfab.mask.opening_file import opening_text, parse_opening
from maskfab.report.pages.pareto import pareto_drawing, svg

DOTS, DOT_NM = 8, 21000
RULES = EmitterRules(DOT_NM, DOT_NM, DOT_NM)
SHOWN = asked_display(
    to_opening_nm=DOT_NM, colour_gap_nm=DOT_NM, min_width_nm=DOT_NM, wire_nm=8000, clearance_nm=1000, lines=3, across=4
)
EVEN = asked_display(to_opening_nm=DOT_NM, colour_gap_nm=DOT_NM, min_width_nm=DOT_NM, across=4, tiling=Tiling.PERIODIC)
LINES = (1, 3)
PLAIN = {"name": "found", "dots": DOTS, "pitch": "168 um", "clear_dots": 12}


@pytest.fixture(scope="module")
def scenes() -> tuple[Photograph, ...]:
    return (leaves(1),)


@pytest.fixture(scope="module")
def free(scenes: tuple[Photograph, ...]) -> Pareto:
    """All bars beside which one line passes, without a least footprint."""
    return swept(asked(12, lines=[1], points=100), section(), scenes)


def section(**changed: object) -> SearchSection:
    return parse_section(SearchSection, {**PLAIN, **changed}, where="test")


def asked(*counts: int, **more: object) -> ParetoSection:
    return parse_section(ParetoSection, {"clear_dots": list(counts), **more}, where="test")


def swept(pareto: ParetoSection, of: SearchSection, scenes: tuple[Photograph, ...], **more: object) -> Pareto:
    return sweep(pareto, of, scenes, SHOWN, **more)


def covers(wide: Pareto, narrow: Pareto) -> bool:
    """Whether every design of one has an equal or a better in the other."""
    return all(
        any(w.value >= n.value - 1e-12 and w.footprint >= n.footprint and w.lines >= n.lines for w in wide.points)
        for n in narrow.points
    )


@given(st.lists(st.tuples(st.integers(0, 4), st.integers(0, 4), st.integers(0, 2)), max_size=20))
def test_bettering_is_having_no_less_of_all_and_more_of_one(numbers: list[tuple[int, int, int]]) -> None:
    each = [JudgedOpening("x", np.ones((2, 2), dtype=np.bool_), float(a), (), float(b), c) for a, b, c in numbers]
    for one, mine in zip(each, numbers, strict=True):
        for other, its in zip(each, numbers, strict=True):
            assert one.betters(other) is (all(a >= b for a, b in zip(mine, its, strict=True)) and mine != its)


@given(st.integers(1, 30), st.integers(1, 8))
def test_a_curve_is_thinned_evenly_and_keeps_its_ends(count: int, most: int) -> None:
    every = [JudgedOpening(f"{k}", np.ones((2, 2), dtype=np.bool_), -k, (), k, 0) for k in range(count)]
    kept = [int(each.shape) for each in spread(every, most)]
    assert kept == sorted(set(kept))
    assert len(kept) == min(count, most)
    assert kept[0] == 0
    assert most == 1 or kept[-1] == count - 1


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
            rules = Constraints(12, dots=DOTS, dot_nm=DOT_NM, emitters=SHOWN.asking(required=wanted, lines=0))
            assert rules.allows(candidate.unit) is kept


@pytest.mark.parametrize("shown", [pytest.param(SHOWN, marks=pytest.mark.slow), EVEN], ids=["random", "periodic"])
def test_curves_are_exact_among_all_shapes(scenes: tuple[Photograph, ...], shown: Display) -> None:
    lines = LINES if shown is SHOWN else (0,)
    of = section(tiling=shown.tiling.value)
    found = sweep(asked(12, lines=lines, points=100), of, scenes, shown)
    periodic = shown is EVEN
    worth = ExpectedPsnr(surrogate_behind(scenes, lattice(DOTS, DOT_NM, camera=F1), settings=F1_SETTINGS), periodic)
    footprints = Footprints(RULES, DOTS, DOT_NM, (0,) if periodic else tuple(range(8)))
    for curve in found.curves:
        units = [candidate.unit for candidate in bars(DOTS, curve.clear_dots)]
        every: list[tuple[float, float, int]] = []
        for value, unit in sorted(((round(worth(unit), 9), unit) for unit in units), key=lambda each: -each[0]):
            if every and value < every[0][0] - 0.5:
                break
            wired = [n for n in lines if shown.asking(required=0.0, lines=n).unwired(unit, DOT_NM) is None]
            if wired:
                every.append((value, round(footprints(unit), 9), max(wired)))
        best = {p for p in every if not any(all(a >= b for a, b in zip(q, p, strict=True)) and q != p for q in every)}
        told = {(round(p.judged.value, 9), round(p.judged.footprint, 9), p.judged.lines) for p in curve.front}
        assert told == best
        assert not curve.misfits
        assert 0 < curve.measured <= curve.evaluated <= len(units)
        assert curve.complete
    assert set(found.best) <= set(found.points)


def test_every_design_fits_its_display_and_its_job_asks_for_it(scenes: tuple[Photograph, ...]) -> None:
    spec = job()
    of = spec.design
    assert isinstance(of, SearchSection)
    stated = stated_display(spec, of, "job", key="pareto")
    found = sweep(asked(12, lines=LINES, points=1), of, scenes, stated)
    made = designs(found, spec, "maskfab design x.toml --front --out y")
    assert len(made) == len(found.points) > 0
    for each in made:
        again = validate(loads(each.job), where="job")
        shown = display_of(again, "job")
        assert shown is not None
        held = shown.on(shown.die(each.opening.mask, DOT_NM, each.map, None))
        assert held is not None
        assert held.verdict is Verdict.FITS
        assert again.design is not None
        assert again.design.clear_dots == each.point.judged.clear_dots
        assert shown.rules.emitters.required == pytest.approx(each.point.judged.footprint, abs=1e-4)
        assert shown.rules.wires is not None
        assert shown.rules.wires.lines == each.point.judged.lines
        assert each.point.mapped is not None
        assert each.map is not None


def uneven(scenes: tuple[Photograph, ...], **more: object) -> tuple[FrontCurve, tuple[FrontDesign, ...]]:
    """The curve of openings beside which one line passes, with light shared so, and its designs."""
    spec = job()
    of = spec.design
    assert isinstance(of, SearchSection)
    stated = stated_display(spec, of, "job", key="pareto")
    found = sweep(asked(12, lines=[1], points=1, **more), of, scenes, stated)
    (curve,) = found.curves
    return curve, designs(found, spec, "x")


@pytest.mark.slow
def test_uneven_light_is_that_of_its_curve_and_fits(
    scenes: tuple[Photograph, ...], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("maskfab.designs.maps.light._TRIED", 3)
    curve, made = uneven(scenes, density=[0.25, 0.9])
    (denser,) = curve.denser
    assert denser.uneven == (("density", 0.25),)
    assert denser.densest == 16 / DOTS**2 > denser.units[1].mean()
    assert denser.value > curve.front[0].value
    assert denser.footprint < curve.front[0].footprint
    assert [each for each in curve.misfits if each.startswith("density 0.9, 1 lines: MF1")]
    design = next(each for each in made if each.point is denser)
    assert design.outer is not None
    again = validate(loads(design.job), where="job")
    assert isinstance(again.design, SearchSection)
    assert again.design.density == 0.25
    assert again.design.clear_dots == 12
    shown = display_of(again, "job")
    assert shown is not None
    assert shown.broken_on(shown.die(design.opening.mask, DOT_NM, design.map, design.outer.mask)) is None


@pytest.mark.parametrize(
    ("density", "changed", "code"), [(0.5, {"map": None}, "MF105"), (0.1, {}, "MF104"), (0.9, {}, "MF123")]
)
def test_densities_that_cannot_be_are_refused(density: float, changed: dict[str, object], code: str) -> None:
    of = section(**{"map": "equal_light", **changed})
    with pytest.raises(MaskfabError, match=code):
        require_uneven(asked(12, density=[density]), of, SHOWN.asking(required=0.05, lines=1))


def job() -> JobSpec:
    return validate(
        {
            "design": {**PLAIN, "map": "equal_light"},
            "camera": {
                "focal": "10 mm",
                "stop": {"shape": "circle", "diameter": "4 mm"},
                "wavelengths": ["610 nm", "530 nm", "470 nm"],
                "pixel": "2 um",
            },
            "emitters": {
                "gap_to_opening": "21 um",
                "colour_gap": "21 um",
                "min_width": "21 um",
                "circuit": "1 um^2",
            },
            "wires": {"line": "8 um", "space": "8 um", "clearance": "1 um", "lines": 3},
        },
        where="test",
    )


@pytest.mark.slow
def test_more_shapes_and_annealing_never_lose(scenes: tuple[Photograph, ...], free: Pareto) -> None:
    few = {"lines": [1], "points": 100}
    wide = swept(asked(12, **few), section(families=["bars", "l_shapes"]), scenes)
    walked = swept(asked(12, anneal=8, **few), section(seed=4), scenes)
    assert covers(wide, free)
    assert covers(walked, free)
    assert walked.curves[0].evaluated > free.curves[0].evaluated


def test_the_display_is_priced_by_the_best_shape_without_it(scenes: tuple[Photograph, ...], free: Pareto) -> None:
    expected = ExpectedPsnr(surrogate_behind(scenes, lattice(DOTS, DOT_NM, camera=F1)))
    values = [expected(each.unit) for each in bars(DOTS, 12)]
    (curve,) = free.curves
    assert curve.prices is not None
    assert curve.prices.together == pytest.approx(max(values) - curve.front[0].judged.value, abs=1e-9)
    assert {each.rule: curve.asked[each.rule] for each in curve.prices.each}.keys() == {"circuits", "emitters", "wires"}
    assert curve.asked["wires"] == "1 lines each way"
    assert all(
        0 <= each.last <= each.alone + 1e-12 or each.alone <= curve.prices.together for each in curve.prices.each
    )


def test_alternatives_of_a_front_hold_the_display(scenes: tuple[Photograph, ...]) -> None:
    (curve,) = swept(asked(12, lines=[1], points=1), section(families=["bars", "l_shapes"]), scenes).curves
    near = curve.alternatives
    assert near is not None
    assert near.own_emitters
    assert np.array_equal(near.chosen.unit, curve.front[0].judged.unit)
    held = rules_of(section(), SHOWN.asking(required=SHOWN.rules.emitters.required, lines=1))
    assert near.others
    for each in near.others:
        assert held.allows(each.unit)
        assert abs(each.value - near.chosen.value) <= 0.1


def test_a_least_footprint_cuts_the_curve_where_it_is(scenes: tuple[Photograph, ...], free: Pareto) -> None:
    least = free.curves[0].front[-1].judged.footprint
    ruled = sweep(asked(12, lines=[1]), section(), scenes, SHOWN.asking(required=least, lines=1))
    assert [each.value for each in ruled.curves[0].front] == [free.curves[0].front[-1].value]


def test_sizes_that_cannot_be_are_told_and_none_at_all_is_refused(scenes: tuple[Photograph, ...]) -> None:
    found = swept(asked(12, 64, 65, lines=[1]), section(rules={"rim_dots": 1}), scenes)
    assert [bool(curve.front) for curve in found.curves] == [True, False, False]
    assert [curve.refusal is None for curve in found.curves] == [True, False, False]
    assert "MF204" in str(found.curves[2].refusal)
    with pytest.raises(MaskfabError, match="MF204"):
        swept(asked(65, 66), section(), scenes)


def test_a_given_opening_is_judged_as_those_found(scenes: tuple[Photograph, ...]) -> None:
    found = swept(asked(12, lines=LINES), section(), scenes)
    given = [Opening(f"given{k}", each.judged.unit, DOT_NM) for k, each in enumerate(found.points)]
    again = swept(asked(12, lines=LINES), section(), scenes, compared=given)
    for point, other in zip(found.points, again.compared, strict=True):
        mine = point.judged
        assert (mine.value, mine.psnr, mine.footprint, mine.lines) == (
            other.value,
            other.psnr,
            other.footprint,
            other.lines,
        )
        assert again.gain_db(other) == 0
    roomier = JudgedOpening("x", given[0].mask, 0.0, (0.0,) * 3, 1.0, 0)
    assert found.gain_db(roomier) is None


@pytest.mark.slow
def test_no_number_of_processes_shows_in_a_front(
    scenes: tuple[Photograph, ...], monkeypatch: pytest.MonkeyPatch
) -> None:
    for module in ("base.processes", "designs.search.annealing"):
        monkeypatch.setattr(f"maskfab.{module}.WORTH_SHARING_S", 0.0)
    of = section(families=["bars", "l_shapes"], map="equal_light", positions=2)
    asked_for = asked(12, lines=[0, *LINES], points=3), of, scenes
    alone, shared = (swept(*asked_for, workers=Workers(number)) for number in (1, 2))
    assert len(alone.points) == 3
    for one, other in zip(alone.points, shared.points, strict=True):
        for name in ("units", "psnr", "value", "footprint", "lines", "grain", "centroid_px"):
            assert np.array_equal(getattr(one, name), getattr(other, name)), name


def test_openings_say_where_they_come_from(scenes: tuple[Photograph, ...]) -> None:
    found = swept(asked(9, 12, lines=[1], points=2), section(), scenes)
    named: tuple[FrontDesign, ...] = designs(found, job(), "maskfab design x.toml --front --out y")
    assert len(named) == len(found.points)
    for each in named:
        back = parse_opening(opening_text(each.opening))
        assert back.name == each.name
        assert np.array_equal(back.mask, each.point.judged.unit)
        assert back.provenance["command"] == "maskfab design x.toml --front --out y"
        assert back.provenance["shape"] == each.point.judged.shape
        assert back.provenance["lines"] == 1
        assert back.provenance["footprint"] == pytest.approx(each.point.judged.footprint, abs=1e-6)
        assert back.provenance["expected_psnr_32"] == pytest.approx(each.point.psnr[1], abs=1e-3)


def test_a_budget_stops_the_look_and_is_told(scenes: tuple[Photograph, ...]) -> None:
    found = swept(asked(9, 12, lines=[1]), section(families=["bars", "discs"]), scenes, clock=Clock(1e-6))
    assert not found.curves[0].complete
    assert all(curve.front and curve.evaluated <= 64 for curve in found.curves)


def test_what_does_not_suit_the_grid_is_refused() -> None:
    other = Opening("other", np.eye(7, dtype=np.bool_), 24000)
    for compared, shown, code in (
        ((other,), SHOWN, "MF105"),
        ((), asked_display(colour_gap_nm=10**6, min_width_nm=DOT_NM), "MF117"),
        ((), asked_display(colour_gap_nm=1, min_width_nm=DOT_NM), "MF118"),
    ):
        with pytest.raises(MaskfabError, match=code):
            rules_of(section(), shown, compared)
    with pytest.raises(MaskfabError, match=r"MF105.*\[wires\]"):
        lines_of(asked(9, lines=[2]), EVEN)
    assert lines_of(asked(9), EVEN) == (0,)
    assert lines_of(asked(9), SHOWN) == (3,)
    assert lines_of(asked(9, lines=[4, 0, 4]), SHOWN) == (0, 4)


def middle(value: float, grain: float) -> Middle:
    nothing = np.zeros((2, DOTS, DOTS), dtype=np.bool_)
    return Middle(nothing, Shares(1, 1, nothing[0]), value, grain, 0.0)


def test_a_stair_of_middles_has_less_grain_with_every_step_down() -> None:
    looked = [middle(5, 0.1), middle(4.5, 0.2), middle(4, 0.05), middle(3, 0.0495), middle(2, 0.01), middle(1, 0.02)]
    assert [(one.value, one.grain) for one in stair(looked)] == [(5, 0.1), (4, 0.05), (2, 0.01)]


@pytest.mark.slow
def test_a_front_of_middles_is_laid_drawn_and_asked_for(scenes: tuple[Photograph, ...]) -> None:
    """Limits of the eye are told, and not kept by middles that are sought, whose jobs ask for their own grain."""
    spec = job()
    assert isinstance(spec.design, SearchSection)
    of = spec.design.model_copy(update={"rules": RulesSection(slow_grain=0.001)})
    assert spec.emitters is not None
    spec = spec.model_copy(update={"design": of, "emitters": spec.emitters.model_copy(update={"required": 0.04})})
    stated = stated_display(spec, of, "job", key="pareto")
    found = sweep(asked(12, lines=[1], points=1, density=["search"]), of, scenes, stated)
    (curve,) = found.curves
    assert dict(found.limits) == {"slow_grain": 0.001}
    assert curve.denser, curve.misfits
    for point in curve.denser:
        assert sought(point.uneven)
        assert point.grain > 0.001
        assert point.value > curve.front[0].value
        assert point.units[0].sum() > 12 > point.units[1].sum()
    for each in (each for each in designs(found, spec, "x") if each.outer is not None):
        again = validate(loads(each.job), where="job").design
        assert isinstance(again, SearchSection)
        assert isinstance(again.density, float)
        assert again.outer_dots == each.point.units[1].sum()
        assert round(again.density * DOTS**2) == each.point.units[0].sum()
        assert again.rules.slow_grain == pytest.approx(each.point.grain, abs=1e-4)
    assert "against grain and centroid" in pareto_drawing(found).words
    assert "slow_grain, at most 0.001" in svg(found)
