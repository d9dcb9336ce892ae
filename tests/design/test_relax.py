"""The optimiser: exact counts, the same opening from the same seed, and better than chance."""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import torch

from maskfab.design import relax
from maskfab.design.relax import RelaxSettings, RelaxStep, binarised, loss_of, optimise
from maskfab.errors import InputError, InternalError
from maskfab.layout.openings import load
from maskfab.model import Stop, Tiling

OPENINGS = Path(__file__).parents[2] / "layouts" / "openings"

QUICK = RelaxSettings(
    name="quick",
    dots=9,
    dot_nm=8000,
    open_ratio=0.2,
    tiling=Tiling.PERIODIC,
    tiling_seed=None,
    focal_um=1000.0,
    stop=Stop("circle", 400.0),
    wavelengths_nm=(530.0,),
    pixel_um=2.0,
    seed=1,
    iterations=60,
    command="maskfab design quick.toml",
)
RANDOM = replace(QUICK, tiling=Tiling.RANDOM, tiling_seed=2)


def judged(settings: RelaxSettings, mask: np.ndarray) -> float:
    return float(loss_of(settings)(torch.from_numpy(mask.astype(np.float32))))


@pytest.mark.parametrize("settings", [QUICK, RANDOM])
def test_beats_every_random_mask_of_its_count(settings: RelaxSettings) -> None:
    opening = optimise(settings)
    assert opening.clear_dots == round(0.2 * 81) == 16
    assert (opening.name, opening.dots, opening.dot_nm) == ("quick", 9, 8000)
    reached = judged(settings, opening.mask)
    assert opening.provenance["loss"] == pytest.approx(reached, abs=1e-6)
    assert opening.provenance["command"] == "maskfab design quick.toml"
    assert opening.provenance.get("tiling_seed") == settings.tiling_seed
    draw = np.random.default_rng(0)
    chance = []
    for _ in range(50):
        mask = np.zeros(81, dtype=bool)
        mask[draw.permutation(81)[:16]] = True
        chance.append(judged(settings, mask.reshape(9, 9)))
    assert reached < min(chance)


def test_same_seed_same_opening() -> None:
    first, again, other = optimise(RANDOM), optimise(RANDOM), optimise(replace(RANDOM, seed=7))
    np.testing.assert_array_equal(first.mask, again.mask)
    assert first.provenance == again.provenance
    assert not np.array_equal(first.mask, other.mask)


def test_progress_reports_every_step() -> None:
    steps: list[RelaxStep] = []
    opening = optimise(replace(QUICK, iterations=200), steps.append)
    assert [step.iteration for step in steps] == list(range(200))
    assert steps[0].gain == 1.0
    assert steps[-1].gain == pytest.approx(relax.FINAL_GAIN)
    assert steps[-1].open_ratio == pytest.approx(16 / 81, abs=0.03)
    assert math.isinf(steps[0].best_loss)
    assert opening.provenance["loss"] <= steps[-1].best_loss


def test_global_state_is_left_alone() -> None:
    threads, state = torch.get_num_threads(), torch.random.get_rng_state()
    optimise(replace(QUICK, iterations=2))
    assert torch.get_num_threads() == threads
    assert torch.equal(torch.random.get_rng_state(), state)


def test_binarised_has_exactly_the_largest() -> None:
    values = torch.tensor([[0.5, 0.5], [0.5, 0.9]])
    assert binarised(values, 2).tolist() == [[1.0, 0.0], [0.0, 1.0]]
    assert binarised(values, 4).tolist() == [[1.0, 1.0], [1.0, 1.0]]


def test_all_clear_is_a_legitimate_wish() -> None:
    assert optimise(replace(QUICK, open_ratio=1.0, iterations=2)).open_ratio == 1.0


@pytest.mark.parametrize("tiling", list(Tiling)[:2])
def test_the_shipped_openings_are_as_good_as_they_say(tiling: Tiling) -> None:
    opening = load(OPENINGS / f"inv_{tiling}.toml")
    tiling_seed = opening.provenance.get("tiling_seed")
    camera = {"focal_um": 1e4, "stop": Stop("circle", 4000.0), "wavelengths_nm": (530.0,), "pixel_um": 2.0}
    settings = RelaxSettings(opening.name, 21, 8000, 0.1995, tiling, tiling_seed, **camera)  # type: ignore[arg-type]
    assert opening.clear_dots == 88
    assert judged(settings, opening.mask) == pytest.approx(opening.provenance["loss"], abs=1e-5)


@pytest.mark.parametrize(
    ("code", "change"),
    [
        ("MF203", {"open_ratio": 0.0}),
        ("MF204", {"open_ratio": 1.01}),
        ("MF204", {"open_ratio": -0.1}),
        ("MF204", {"open_ratio": float("nan")}),
        ("MF204", {"open_ratio": 0.001}),
        ("MF104", {"dots": 1}),
        ("MF104", {"dot_nm": 0}),
        ("MF104", {"iterations": 0}),
        ("MF104", {"epsilon": float("nan")}),
        ("MF104", {"epsilon": 0.0}),
        ("MF104", {"worst_fraction": 1.5}),
        ("MF104", {"seed": -1}),
        ("MF104", {"focal_um": float("nan")}),
        ("MF104", {"focal_um": 1.0}),
        ("MF104", {"pixel_um": 0.0}),
        ("MF104", {"stop": Stop("circle", float("inf"))}),
        ("MF105", {"wavelengths_nm": ()}),
        ("MF112", {"wavelengths_nm": (530.0, 20.0)}),
        ("MF110", {"name": "domain"}),
        ("MF111", {"tiling": Tiling.RANDOM}),
        ("MF115", {"stop": Stop("circle", 40_000.0)}),
    ],
)
def test_refused(code: str, change: dict[str, object]) -> None:
    with pytest.raises(InputError) as caught:
        optimise(replace(QUICK, **change))  # type: ignore[arg-type]
    assert caught.value.code == code, str(caught.value)
    assert caught.value.where
    assert caught.value.cure


def test_a_loss_that_is_not_a_number_is_our_fault(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(relax, "AREA_WEIGHT", float("nan"))
    with pytest.raises(InternalError) as caught:
        optimise(QUICK)
    assert caught.value.code == "MF901"
