"""The method search: from a job's section to an opening, its map, what rules cost; budget, checkpoint, any pitch."""

from __future__ import annotations

import time
from pathlib import Path

import numpy as np
import pytest
from asked_displays import asked_display
from estimates import surrogate
from once import leaves
from sweeps import sweep

from maskfab.base.errors import MaskfabError
from maskfab.base.processes import Call, SerialExecutor
from maskfab.base.work import Clock, silent
from maskfab.camera.scenes import Photograph
from maskfab.designs.maps.orientation_map import MapMode, design_map
from maskfab.designs.model.panel_error import pupil_error
from maskfab.designs.rules.constraints import Constraints
from maskfab.designs.rules.families import FAMILIES, Candidate, kind
from maskfab.designs.search import scan
from maskfab.designs.search import shortlist as quick_maps
from maskfab.designs.search.annealing import ExpectedPsnr, Ranked
from maskfab.designs.search.question import Question
from maskfab.designs.search.result import constraints_of
from maskfab.designs.search.scan import Best, scanned
from maskfab.designs.search.search import search
from maskfab.designs.search.shortlist import different, shortlisted
from maskfab.job.faults import parse_section
from maskfab.job.sections import SearchSection
from maskfab.mask import panels
from maskfab.mask.opening_file import opening_text, parse_opening

pytestmark = pytest.mark.usefixtures("bound_loosely")

PLAIN = {"name": "found", "dots": 6, "pitch": "336 um", "clear_dots": 9}
RULES = {"kissing": "neighbours", "min_feature_dots": 2, "rim_dots": 1}


@pytest.fixture(scope="module")
def scenes() -> tuple[Photograph, ...]:
    return (leaves(1),)


def section(**changed: object) -> SearchSection:
    return parse_section(SearchSection, {**PLAIN, **changed}, where="test")


@pytest.mark.usefixtures("bound_closely")
def test_a_search_is_exact_in_its_count_and_equal_runs_are_equal(scenes: tuple[Photograph, ...]) -> None:
    one, two = (search(Question(section(anneal=20, seed=3), scenes, "maskfab design x.toml")) for _ in range(2))
    assert one.opening.clear_dots == 9
    assert opening_text(one.opening) == opening_text(two.opening)
    assert one.head_room is not None
    assert min(one.head_room) >= 0
    assert one.notes == ()


@pytest.mark.usefixtures("bound_closely")
def test_the_provenance_says_what_was_found_and_what_it_cost(scenes: tuple[Photograph, ...]) -> None:
    found = search(Question(section(rules=RULES), scenes, "maskfab design x.toml"))
    facts = parse_opening(opening_text(found.opening)).provenance
    assert facts["command"] == "maskfab design x.toml"
    assert facts["shape"] == found.shape
    assert facts["evaluated"] == found.evaluated
    assert found.head_room is not None
    for level, psnr, room in zip((24, 32, 40), found.psnr, found.head_room, strict=True):
        assert facts[f"expected_psnr_{level}"] == pytest.approx(psnr, abs=1e-3)
        assert facts[f"head_room_{level}"] == pytest.approx(room, abs=1e-3)
    assert found.prices is not None
    assert facts["rules_cost_db"] == pytest.approx(found.prices.together, abs=1e-3)
    for each in found.prices.each:
        assert facts[f"price_{each.rule}_db"] == pytest.approx(each.last, abs=1e-3)


def test_rules_are_kept_and_priced(scenes: tuple[Photograph, ...]) -> None:
    free = search(Question(section(), scenes, "x"))
    ruled = search(Question(section(rules=RULES), scenes, "x"))
    mask = ruled.opening.mask
    assert not mask[[0, -1]].any()
    assert not mask[:, [0, -1]].any()
    assert np.mean(ruled.psnr) <= np.mean(free.psnr) + 1e-9
    assert ruled.prices is not None
    assert {price.rule for price in ruled.prices.each} >= {"kissing", "rim_dots"}
    assert ruled.prices.together >= 0


def test_a_map_is_designed_for_the_opening(scenes: tuple[Photograph, ...]) -> None:
    found = search(Question(section(map="equal_light", positions=2, shortlist=1), scenes, "x"))
    assert found.cells is not None
    assert found.cells.cells.shape == (12, 12)
    assert found.designed is not None
    assert min(found.designed.gain_db) > 0
    assert abs(found.designed.clear_dots / found.designed.start_clear_dots - 1) < 0.005
    assert len(found.cells.shifts) == 2
    facts = panels.parse_map(panels.map_text(found.cells)).provenance
    assert facts["mode"] == "equal_light"
    assert facts["gain_db_24"] == pytest.approx(found.designed.gain_db[0], abs=1e-3)
    assert abs(facts["light"]) < 0.005
    assert found.map_head_room is not None
    for level, room in zip((24, 32, 40), found.map_head_room, strict=True):
        assert facts[f"head_room_{level}"] == pytest.approx(room, abs=1e-3)
        assert room > 0


@pytest.mark.slow
def test_opening_and_map_in_turns_never_lose(scenes: tuple[Photograph, ...]) -> None:
    wanted = {"pitch": "336 um", "map": "equal_light", "shortlist": 1, "rules": {"kissing": "neighbours"}}
    alone, both = (search(Question(section(**wanted, joint=rounds), scenes, "x")) for rounds in (0, 1))
    assert alone.designed is not None
    assert both.designed is not None
    assert np.mean(both.designed.psnr) >= np.mean(alone.designed.psnr) - 1e-9
    assert constraints_of(section(**wanted)).allows(both.opening.mask)


def test_a_denser_middle_has_two_openings_and_its_price(scenes: tuple[Photograph, ...]) -> None:
    found = search(Question(section(pitch="336 um", map="equal_light", density=0.35), scenes, "x", clock=Clock(1.0)))
    assert found.outer is not None
    assert found.cells is not None
    assert found.outer.clear_dots < 9 < found.opening.clear_dots == 13
    assert set(np.unique(found.cells.cells // 8)) == {0, 1}
    assert any("The display pays" in note for note in found.notes)
    assert 0 <= float(found.cells.provenance["emitter_share"]) <= 1


def test_a_map_of_another_pitch(scenes: tuple[Photograph, ...]) -> None:
    wanted = section(dots=4, pitch="336 um", clear_dots=5, map="equal_light", shortlist=1)
    found = search(Question(wanted, scenes, "x", clock=Clock(1e-3)))
    assert found.cells is not None
    assert found.cells.cells.shape == (12, 12)
    assert found.designed is not None
    assert min(found.designed.gain_db) > 0


def test_what_a_budget_leaves_to_be_done_is_no_longer_than_the_budget(scenes: tuple[Photograph, ...]) -> None:
    wanted = section(dots=4, pitch="336 um", clear_dots=5, map="equal_light", shortlist=1)
    # Of the processor, so that no other work on the machine counts.
    short, long = (
        search(Question(wanted, scenes, "x", clock=Clock(budget, now=time.process_time))) for budget in (1e-3, 60.0)
    )
    assert short.designed is not None
    assert long.designed is not None
    assert short.designed.fields <= 16 < long.designed.fields
    assert max(short.designed.gain_db) < max(long.designed.gain_db)
    assert short.head_room is short.map_head_room is short.gap is None
    assert "head_room_24" not in short.opening.provenance
    assert any("16 steps" in note for note in short.notes)
    assert long.head_room is not None
    assert long.map_head_room is not None


@pytest.mark.slow
def test_the_shortlist_takes_the_best_under_a_map(scenes: tuple[Photograph, ...]) -> None:
    """The longer list cannot end at a lower value, and what it chose is a shape of the scan that keeps the rules."""
    rules = Constraints(9, dots=6, kissing="cell")
    shapes = tuple(FAMILIES["bars"](6, 9))
    error, judge = pupil_error(surrogate(scenes, 6)), ExpectedPsnr(surrogate(scenes, 6))
    start = Best(Ranked(shapes[0].name, shapes[0].unit, 1.0), shapes, len(shapes))

    def best(most: int, clock: Clock | None = None) -> Best:
        chosen = clock or Clock()
        asked = {"judge": judge, "mode": MapMode.EQUAL_LIGHT, "seed": 0}
        return shortlisted(start, most, error, rules, chosen, silent, **asked)[0]

    listed = different(shapes, rules, 3)
    assert len({kind(each.name, each.unit) for each in listed}) == len(listed) == 2
    assert best(1) is start
    light = round(float(error.inside.sum()) * 9 / 36)
    values = [float(np.mean(design_map(each.unit, error, kicks=0, light=light).psnr)) for each in listed]
    found = best(3)
    assert found.best.name == listed[int(np.argmax(values))].name
    assert rules.allows(found.best.unit)
    assert not found.cut
    none = best(3, Clock(0.0))
    assert none.best.name == start.best.name
    assert none.cut
    assert "after 0 of 2 quick maps" in none.notes[0]


def test_a_halt_reaches_the_quick_map_that_is_being_made() -> None:
    asked, seen = Clock(), list[bool]()

    def made(clock: Clock) -> None:
        asked.halt.set()
        seen.append(clock.over)

    with SerialExecutor() as executor:
        assert executor.run_alike([Call(quick_maps._in_time, lambda: (made, asked))] * 2) == [None, None]
    assert seen == [True]


def test_the_shortlist_has_several_sizes_where_only_a_second_scan_keeps_the_rules(
    scenes: tuple[Photograph, ...],
) -> None:
    wanted = section(map="equal_light", rules={"rim_dots": 1, "min_feature_dots": 2, "kissing": "neighbours"})
    rules = constraints_of(wanted)
    expected = ExpectedPsnr(surrogate(scenes, 6))
    found = scanned(wanted, rules, expected, Clock(), None, silent)
    shapes = [each.unit for each in FAMILIES["bars"](6, 9) if rules.allows(each.unit)]
    sizes = {kind("bar", unit) for unit in shapes}
    listed = different([Candidate(found.best.name, found.best.unit), *found.looked], rules, 100)
    assert len(listed) >= min(len(sizes), wanted.shortlist)
    assert listed[0].name == found.best.name
    values = [expected(each.unit) for each in listed]
    assert values == sorted(values, reverse=True)


def test_circuits_are_kept_room_for(scenes: tuple[Photograph, ...]) -> None:
    asked = asked_display(circuit_um2=24_000.0, min_width_nm=112_000)
    found = search(Question(section(), scenes, "x", display=asked))
    assert constraints_of(section(), display=asked).allows(found.opening.mask)
    with pytest.raises(MaskfabError, match=r"MF123.*circuits"):
        search(Question(section(), scenes, "x", display=asked_display(circuit_um2=32_000.0, min_width_nm=112_000)))


def test_a_budget_ends_the_scan_and_says_how_far_it_came(scenes: tuple[Photograph, ...]) -> None:
    found = search(Question(section(dots=12, clear_dots=32, anneal=10_000), scenes, "x", clock=Clock(0.05)))
    scan, annealing, bounds = found.notes
    assert "shapes had been judged" in scan
    assert "of 10000 evaluations" in annealing
    assert "no headroom" in bounds
    assert found.head_room is None
    assert found.cut
    assert found.opening.clear_dots == 32


def test_a_budget_that_is_not_used_up_changes_nothing(scenes: tuple[Photograph, ...]) -> None:
    plain, bounded = (
        search(Question(section(anneal=20), scenes, "x", clock=Clock(budget))) for budget in (None, 600.0)
    )
    assert opening_text(plain.opening) == opening_text(bounded.opening)
    assert bounded.notes == ()


def test_interrupted_and_resumed_ends_where_uninterrupted_does(
    scenes: tuple[Photograph, ...], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(scan, "SAVED_EVERY", 64)
    wanted, path = section(anneal=160, seed=5), tmp_path / "state.npz"
    whole = search(Question(wanted, scenes, "x"))
    done: list[int] = []

    def cut(stage: str, step: int, total: int) -> None:
        if stage.startswith("anneal"):
            done.append(step)
            if len(done) == 2:
                raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        search(Question(wanted, scenes, "x", cut, checkpoint=path))
    steps: list[tuple[str, int]] = []
    resumed = search(Question(wanted, scenes, "x", lambda stage, step, _: steps.append((stage, step)), checkpoint=path))
    assert not any(stage.startswith("scan") for stage, _ in steps)
    assert min(step for stage, step in steps if stage.startswith("anneal")) > 64
    assert opening_text(resumed.opening) == opening_text(whole.opening)
    finished = search(Question(wanted, scenes, "x", checkpoint=path))
    assert opening_text(finished.opening) == opening_text(whole.opening)
    with pytest.raises(MaskfabError, match="MF304"):
        search(Question(section(anneal=161, seed=5), scenes, "x", checkpoint=path))


@pytest.mark.parametrize(
    ("dots", "pitch", "clear_dots"), sweep([(1, "14 um", 1), (2, "32 um", 1), (6, "84 um", 9), (20, "500 um", 399)], 3)
)
def test_any_pitch_and_number_of_dots(scenes: tuple[Photograph, ...], dots: int, pitch: str, clear_dots: int) -> None:
    found = search(Question(section(dots=dots, pitch=pitch, clear_dots=clear_dots), scenes, "x", clock=Clock(1.0)))
    assert found.opening.clear_dots == clear_dots
    assert np.isfinite(found.psnr).all()


def test_what_cannot_be_is_refused(scenes: tuple[Photograph, ...]) -> None:
    for changed, code in (
        ({"clear_dots": 37}, "MF204"),
        ({"clear_dots": 9, "rules": {"symmetry": "d4"}}, "MF204"),
        ({"pitch": "168.1 um"}, "MF106"),
        ({"pitch": "344 um", "dots": 86, "map": "equal_light"}, "MF115"),
        ({"map": "equal_light", "positions": 2, "rules": {"kissing": "neighbours"}}, "MF123"),
        ({"rules": {"centroid_px": 0.1}}, r"MF105.*design\.rules\.centroid_px"),
    ):
        with pytest.raises(MaskfabError, match=code):
            search(Question(section(**changed), scenes, "x"))
    grey = Photograph("grey", 1, np.full((3, 1024, 1536), 0.5, dtype=np.float32))
    with pytest.raises(MaskfabError, match="MF121"):
        search(Question(section(), (grey,), "x"))
