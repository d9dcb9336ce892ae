"""The published schedule: its constants, its flaws, and that it can be cut off and resumed."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import torch
from once import leaves

from maskfab.base.errors import InputError
from maskfab.camera.scenes import Photograph
from maskfab.designs.descent.losses import LARGEST, TopResidual
from maskfab.designs.descent.objective import Invertibility, Weighted
from maskfab.designs.descent.schedule import DescentResult, Recipe, descend, paper
from maskfab.job.camera import Camera, Stop
from maskfab.job.faults import parse_section
from maskfab.job.sections import RelaxSection

SMALL = Camera(1000.0, Stop("circle", 400.0), (610.0, 530.0, 470.0), 2.0, 256.0)


def scenes() -> tuple[Photograph, ...]:
    return (leaves(1, 512, 512),)


def small(photographs: tuple[Photograph, ...] | None = None, **change: object) -> Recipe:
    stated = {
        "name": "published",
        "method": "relax",
        "recipe": "paper-l2+inv",
        "dots": 7,
        "pitch": "56 um",
        "clear_dots": 10,
        "epochs": 2,
        "tiling": "paper4",
        "tiling_seed": 10,
    }
    section = parse_section(RelaxSection, {**stated, **change}, where="test")
    return paper(section, 8000, SMALL, scenes() if photographs is None else photographs)


def followed(plan: Recipe, checkpoint: Path | None = None, stop_after: int | None = None) -> DescentResult:
    return descend(plan.objective, plan.penalty, plan.descent, checkpoint=checkpoint, stop_after=stop_after)


@pytest.fixture
def few_pictures(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("maskfab.designs.descent.schedule._CROPS", 2)


def test_the_constants_are_the_published_ones() -> None:
    recipe = small(epochs=150)
    how = recipe.descent
    assert (how.rate, how.momentum) == (1.0, 0.5)
    assert (how.start_logit, how.start_noise, how.final_gain) == (1.0, 0.0, 1.0)
    assert how.iterations == 150 * 20
    assert isinstance(recipe.objective, Weighted)
    (data_weight, data), (inverse_weight, inverse) = recipe.objective.terms
    assert isinstance(data, TopResidual)
    assert isinstance(inverse, Invertibility)
    assert (data_weight, inverse_weight, recipe.penalty.weight) == (10.0, 0.01, 10.0)
    assert (LARGEST, data.dark) == (0.1, True)
    assert (inverse.epsilon, inverse.worst_fraction, inverse.own_sum) == (0.015, 0.3, True)
    assert [round(recipe.penalty.wanted(20 * e, 3000), 2) for e in (0, 4, 5, 79, 80, 149)] == [
        1,
        1,
        0.95,
        0.25,
        0.2,
        0.2,
    ]


@pytest.mark.usefixtures("few_pictures")
@pytest.mark.parametrize("tiling", ["periodic", "paper4", "random"])
@pytest.mark.parametrize("recipe", ["paper-l2", "paper-l2+inv"])
def test_every_kind_gives_a_unit_and_owns_up_to_its_saddle(tiling: str, recipe: str) -> None:
    seed = {} if tiling == "periodic" else {"tiling_seed": 10}
    found = followed(small(recipe=recipe, tiling=tiling, **{"tiling_seed": None, **seed}))
    assert int(found.unit.sum()) == 10
    assert found.iterations == 4
    assert len(found.notes) == 1
    assert "saddle" in found.notes[0]


@pytest.mark.usefixtures("few_pictures")
def test_repeats_and_resumes_bit_for_bit(tmp_path: Path) -> None:
    whole = followed(small(epochs=3))
    path = tmp_path / "state.npz"
    followed(small(epochs=3), path, stop_after=4)
    resumed = followed(small(epochs=3), path)
    assert torch.equal(resumed.relaxed, whole.relaxed)
    assert torch.equal(resumed.unit, whole.unit)
    assert resumed.loss == whole.loss


def test_constant_pictures_are_refused() -> None:
    grey = Photograph("grey", 1, np.full((3, 512, 512), 0.5, dtype=np.float32))
    with pytest.raises(InputError, match="MF121"):
        small((grey,))


def test_no_pictures_are_refused() -> None:
    with pytest.raises(InputError, match="MF105"):
        small(())
