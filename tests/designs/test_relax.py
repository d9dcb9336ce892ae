"""The method relax: every objective, the recipes, rules after the threshold, budget and checkpoint."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import torch
from estimates import surrogate
from once import leaves
from sweeps import sweep

from maskfab.base.errors import MaskfabError
from maskfab.base.work import Clock
from maskfab.camera.scenes import Photograph
from maskfab.designs.descent.relax import relax, schedule
from maskfab.designs.model.expected_psnr import Surrogate
from maskfab.designs.rules.families import FAMILIES
from maskfab.designs.search.annealing import nearest
from maskfab.designs.search.result import NO_BOUNDS, Designed, constraints_of
from maskfab.job.camera import Camera, Stop
from maskfab.job.faults import parse_section
from maskfab.job.sections import RelaxSection
from maskfab.mask.opening_file import opening_text, parse_opening

pytestmark = pytest.mark.usefixtures("bound_loosely")

PLAIN = {
    "name": "found",
    "method": "relax",
    "dots": 7,
    "pitch": "56 um",
    "clear_dots": 14,
    "tiling": "periodic",
    "iterations": 30,
    "seed": 1,
}
LENS = Camera(1000.0, Stop("circle", 400.0), (610.0, 530.0, 470.0), 2.0, 256.0)
JUDGED = (
    "Expected PSNRs are those behind the camera of protocol F1: the stop of 400 um is 50 dots of 8 um across; "
    "photographs are judged through whole dots, of which it must be 64.",
)
"""So small a stop takes no photographs."""


@pytest.fixture(scope="module")
def scenes() -> tuple[Photograph, ...]:
    return (leaves(1),)


@pytest.fixture(scope="module")
def estimate(scenes: tuple[Photograph, ...]) -> Surrogate:
    return surrogate(scenes, 7, dot_nm=8000)


def section(**changed: object) -> RelaxSection:
    return parse_section(RelaxSection, {**PLAIN, **changed}, where="test")


def found(scenes: tuple[Photograph, ...], **changed: object) -> Designed:
    return relax(section(**changed), LENS, scenes, "maskfab design x.toml")


def judged(
    wanted: RelaxSection, scenes: tuple[Photograph, ...], estimate: Surrogate, *masks: np.ndarray
) -> list[float]:
    """The loss of each at the end of the schedule."""
    plan = schedule(wanted, constraints_of(wanted), LENS, scenes, estimate)
    loss = plan.objective.at(-1, plan.descent.iterations)
    return [float(loss(torch.from_numpy(mask.astype(np.float32)))) for mask in masks]


@pytest.mark.parametrize("tiling", sweep([{"tiling": "periodic"}, {"tiling": "random", "tiling_seed": 2}], 1))
def test_beats_every_random_mask_of_its_count(
    scenes: tuple[Photograph, ...], estimate: Surrogate, tiling: dict
) -> None:  # type: ignore[type-arg]
    wanted = section(**tiling, iterations=40, anneal=100)
    opening = relax(wanted, LENS, scenes, "maskfab design x.toml").opening
    assert opening.clear_dots == 14
    (reached,) = judged(wanted, scenes, estimate, opening.mask)
    facts = parse_opening(opening_text(opening)).provenance
    assert facts["loss"] == pytest.approx(reached, abs=1e-6)
    assert facts["command"] == "maskfab design x.toml"
    assert facts.get("tiling_seed") == tiling.get("tiling_seed")
    draw = np.random.default_rng(0)
    chance = [(draw.permutation(49) < 14).reshape(7, 7) for _ in range(50)]
    assert reached < min(judged(wanted, scenes, estimate, *chance))


@pytest.mark.parametrize("name", sweep(["invertibility", "top_residual", "expected_error"], 1))
def test_every_objective_gives_the_same_opening_twice(scenes: tuple[Photograph, ...], name: str) -> None:
    wanted = {"objectives": {name: 2.0}, "iterations": 2, "tiling": "random", "tiling_seed": 1}
    one, two = (found(scenes, **wanted) for _ in range(2))
    assert one.opening.clear_dots == 14
    assert opening_text(one.opening) == opening_text(two.opening)
    assert one.shape == f"2 {name}"
    assert np.isfinite(one.psnr).all()


def test_weights_scale_and_add(scenes: tuple[Photograph, ...], estimate: Surrogate) -> None:
    unit = np.random.default_rng(0).random((7, 7))
    (one,), (other,) = (
        judged(section(objectives={name: 1.0}), scenes, estimate, unit) for name in ("invertibility", "expected_error")
    )
    (both,) = judged(
        section(objectives={"invertibility": 3.0, "expected_error": 0.5, "area": 9.0}), scenes, estimate, unit
    )
    assert both == pytest.approx(3 * one + 0.5 * other, rel=1e-5)


def test_the_area_is_led_with_its_own_weight_or_not_at_all(scenes: tuple[Photograph, ...], estimate: Surrogate) -> None:
    cases: tuple[tuple[float | None, float | None], ...] = ((None, 400.0), (7.0, 7.0), (0.0, None))
    for weight, expected in cases:
        objectives = {"invertibility": 1.0} | ({} if weight is None else {"area": weight})
        wanted = section(objectives=objectives)
        penalty = schedule(wanted, constraints_of(wanted), LENS, scenes, estimate).penalty
        assert (None if penalty is None else penalty.weight) == expected


@pytest.mark.usefixtures("bound_closely")
def test_options_reach_the_descent(scenes: tuple[Photograph, ...], estimate: Surrogate) -> None:
    wanted = section(starts=3)
    how = schedule(wanted, constraints_of(wanted), LENS, scenes, estimate).descent
    assert (how.starts, how.iterations, how.seed) == (3, 30, 1)
    result = relax(wanted, LENS, scenes, "x")
    assert result.opening.clear_dots == 14


@pytest.mark.parametrize("recipe", sweep(["paper-l2", "paper-l2+inv"], 1))
def test_recipes_run_from_the_section_and_own_up_to_their_saddle(scenes: tuple[Photograph, ...], recipe: str) -> None:
    values = {key: value for key, value in PLAIN.items() if key != "iterations"}
    wanted = parse_section(
        RelaxSection, {**values, "recipe": recipe, "epochs": 1, "tiling": "paper4", "tiling_seed": 10}, where="test"
    )
    result = relax(wanted, LENS, scenes, "x")
    assert result.opening.clear_dots == 14
    assert result.shape == recipe
    assert any("saddle" in note for note in result.notes)


def test_rules_hold_after_the_threshold_and_the_way_there_is_told(scenes: tuple[Photograph, ...]) -> None:
    rules = {"kissing": "neighbours", "min_feature_dots": 2, "rim_dots": 1}
    free, ruled, better = (found(scenes, **wanted) for wanted in ({}, {"rules": rules}, {"rules": rules, "anneal": 30}))
    kept = constraints_of(section(rules=rules))
    assert not kept.allows(free.opening.mask)
    for result in (ruled, better):
        assert kept.allows(result.opening.mask)
        assert any("nearest" in note for note in result.notes)
    losses = [float(result.opening.provenance["loss"]) for result in (free, better, ruled)]
    assert losses[0] <= losses[1] <= losses[2]


def test_the_nearest_opening_shares_more_than_any_compact_one() -> None:
    rules = constraints_of(section(rules={"rim_dots": 1, "min_feature_dots": 2}))
    draw = np.random.default_rng(3)
    mask = np.zeros(49, dtype=np.bool_)
    mask[draw.permutation(49)[:14]] = True
    mask = mask.reshape(7, 7)
    near = nearest(mask, rules)
    assert rules.allows(near)
    assert nearest(near, rules) is near
    compact = [each.unit for name in ("bars", "discs", "l_shapes", "crosses") for each in FAMILIES[name](7, 14)]
    shared = [np.count_nonzero(unit & mask) for unit in compact if rules.allows(unit)]
    # Within the rim, 14 of 25 dots; a compact one shares the expected 14 x 14 / 49 = 4 at least.
    assert np.count_nonzero(near & mask) > max(shared) >= 4


def test_a_budget_shortens_the_schedule_and_says_so(scenes: tuple[Photograph, ...]) -> None:
    wanted = section(iterations=100_000)
    result = relax(wanted, LENS, scenes, "x", clock=Clock(0.6))
    assert result.notes[1:] == (NO_BOUNDS, *JUDGED)
    assert "instead of 100000" in result.notes[0]
    assert result.cut


def test_a_budget_that_is_not_used_up_changes_nothing(scenes: tuple[Photograph, ...]) -> None:
    plain, bounded = (relax(section(), LENS, scenes, "x", clock=Clock(budget)) for budget in (None, 600.0))
    assert opening_text(plain.opening) == opening_text(bounded.opening)
    assert bounded.notes == JUDGED
    assert not bounded.cut


def test_interrupted_and_resumed_ends_where_uninterrupted_does(scenes: tuple[Photograph, ...], tmp_path: Path) -> None:
    wanted, path = section(iterations=40, starts=2), tmp_path / "state.npz"
    whole = relax(wanted, LENS, scenes, "x")
    cut = relax(wanted, LENS, scenes, "x", clock=Clock(0.01), checkpoint=path)
    assert "goes on from the checkpoint" in cut.notes[0]
    assert cut.evaluated < whole.evaluated
    resumed = relax(wanted, LENS, scenes, "x", checkpoint=path)
    assert resumed.notes == JUDGED
    assert opening_text(resumed.opening) == opening_text(whole.opening)
    with pytest.raises(MaskfabError, match="MF304"):
        relax(section(iterations=41, starts=2), LENS, scenes, "x", checkpoint=path)


@pytest.mark.parametrize(
    ("code", "change"),
    [
        ("MF204", {"clear_dots": 50}),
        ("MF106", {"pitch": "56.001 um"}),
        ("MF123", {"rules": {"ports": 20}}),
    ],
)
def test_refused(scenes: tuple[Photograph, ...], code: str, change: dict[str, object]) -> None:
    with pytest.raises(MaskfabError, match=code) as caught:
        found(scenes, **change)
    assert caught.value.where
    assert caught.value.cure
