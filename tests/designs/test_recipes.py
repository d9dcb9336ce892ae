"""The published schedule: its constants, its flaws, and that it can be cut off and resumed."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import torch
from once import leaves

from maskfab.base.errors import InputError
from maskfab.base.model import Tiling
from maskfab.camera.scenes import Photograph
from maskfab.designs.descent.losses import TopResidual
from maskfab.designs.descent.objective import Invertibility, Weighted
from maskfab.designs.descent.schedule import PAPER_CAMERA, Recipe, paper
from maskfab.job.camera import Stop

SMALL = replace(PAPER_CAMERA, focal_um=1000.0, stop=Stop("circle", 400.0))


def scenes() -> tuple[Photograph, ...]:
    return (leaves(1, 512, 512),)


def small(**change: object) -> Recipe:
    options = {
        "scenes": scenes(),
        "camera": SMALL,
        "dots": 7,
        "clear_dots": 10,
        "crops": 2,
        "batch": 1,
        "epochs": 2,
        **change,
    }
    return paper(**options)  # type: ignore[arg-type]


def test_the_constants_are_the_published_ones() -> None:
    recipe = paper(scenes(), losses="l2+inv")
    how = recipe.descent
    assert (how.rate, how.momentum) == (1.0, 0.5)
    assert (how.start_logit, how.start_noise, how.final_gain) == (1.0, 0.0, 1.0)
    assert how.iterations == 150 * 20
    assert isinstance(recipe.objective, Weighted)
    (data_weight, data), (inverse_weight, inverse) = recipe.objective.terms
    assert isinstance(data, TopResidual)
    assert isinstance(inverse, Invertibility)
    assert (data_weight, inverse_weight, recipe.penalty.weight) == (10.0, 0.01, 10.0)
    assert (data.share, data.dark) == (0.1, True)
    assert (inverse.epsilon, inverse.worst_fraction, inverse.own_sum) == (0.015, 0.3, True)
    assert [round(recipe.penalty.wanted(20 * e, 3000), 2) for e in (0, 4, 5, 79, 80, 149)] == [
        1,
        1,
        0.95,
        0.25,
        0.2,
        0.2,
    ]
    assert set(np.unique(recipe.orientations)) == set(np.unique(small().orientations))
    assert len(np.unique(recipe.orientations)) == 4


@pytest.mark.parametrize("tiling", [Tiling.PERIODIC, Tiling.PAPER4, Tiling.RANDOM])
@pytest.mark.parametrize("losses", ["l2", "l2+inv"])
def test_every_kind_gives_a_unit_and_owns_up_to_its_saddle(tiling: Tiling, losses: str) -> None:
    found = small(losses=losses, tiling=tiling).run()
    assert int(found.unit.sum()) == 10
    assert found.iterations == 4
    assert len(found.notes) == 1
    assert "saddle" in found.notes[0]


def test_repeats_and_resumes_bit_for_bit(tmp_path: Path) -> None:
    whole = small(epochs=3).run()
    path = tmp_path / "state.npz"
    small(epochs=3).run(checkpoint=path, stop_after=4)
    resumed = small(epochs=3).run(checkpoint=path)
    assert torch.equal(resumed.relaxed, whole.relaxed)
    assert torch.equal(resumed.unit, whole.unit)
    assert resumed.loss == whole.loss


def test_constant_pictures_are_refused() -> None:
    grey = Photograph("grey", 1, np.full((3, 512, 512), 0.5, dtype=np.float32))
    with pytest.raises(InputError, match="MF121"):
        small(scenes=(grey,))


@pytest.mark.parametrize(
    ("code", "change"),
    [
        ("MF105", {"losses": "l3"}),
        ("MF105", {"scenes": ()}),
        ("MF111", {"tiling_seed": None}),
        ("MF104", {"clear_dots": 50}),
        ("MF105", {"device": "abacus"}),
    ],
)
def test_refused(code: str, change: dict[str, object]) -> None:
    with pytest.raises(InputError) as caught:
        small(**change).run()  # type: ignore[arg-type]
    assert caught.value.code == code
    assert caught.value.cure
