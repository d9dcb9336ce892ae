"""A design that begins at an opening of one's own: as it is, made to keep rules, bettered, or refused."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
import torch
from sweeps import sweep

import maskfab as mf
from maskfab.base.errors import InputError
from maskfab.designs.descent.schedule import Descent, descend
from maskfab.designs.rules.constraints import Constraints
from maskfab.designs.search.annealing import nearest
from maskfab.designs.search.mending import mended

ALONE: dict[str, Any] = {"map": "none"}


def drawn() -> np.ndarray:
    """A block with a dot that stands alone."""
    mask = np.zeros((7, 7), dtype=np.bool_)
    mask[1:5, 2:5] = mask[6, 0] = True
    return mask


def test_an_opening_that_keeps_the_rules_stays_as_it_is() -> None:
    start = mf.Opening.of(drawn(), pitch="168 um", name="block")
    design = mf.design(start=start, **ALONE)
    assert np.array_equal(design.opening.mask, start.mask)
    assert design.opening.dot_nm == start.dot_nm
    assert "start: block, sha256" in str(design.opening.provenance["command"])


def test_rules_are_kept_by_an_opening_near_the_start() -> None:
    design = mf.design(start=torch.from_numpy(drawn()), pitch="168 um", rules={"min_feature_dots": 2}, **ALONE)
    assert design.opening.clear_dots == drawn().sum()
    assert int((design.opening.mask & drawn()).sum()) >= 11
    assert not design.opening.mask[6, 0]
    assert "The start breaks min_feature_dots" in design.notes[0]


def test_annealing_goes_on_from_the_start() -> None:
    design = mf.design(start=drawn(), pitch="168 um", anneal=60, **ALONE)
    assert design.found.shape == "start, annealed"
    assert design.psnr[24] > mf.design(start=drawn(), pitch="168 um", **ALONE).psnr[24]


def test_a_descent_begins_at_the_start() -> None:
    class Judge:
        correlation = None

        def at(self, iteration: int, iterations: int) -> Judge:
            return self

        def __call__(self, unit: torch.Tensor) -> torch.Tensor:
            return (unit**2).sum()

    how = Descent(7, 13, 1, start_noise=0.0, rate=1e-9, final_gain=1.0, begin=tuple(drawn().ravel().tolist()))
    found = descend(Judge(), None, how)  # type: ignore[arg-type]
    assert np.array_equal(found.unit.numpy() > 0.5, drawn())


@pytest.mark.parametrize(
    ("start", "more", "told"),
    [
        (torch.rand(7, 7, requires_grad=True), {}, r"MF202.*start > 0\.5"),
        (np.zeros((7, 7)), {}, "MF203"),
        (np.ones((7, 6)), {}, "MF201"),
        ("none", {}, "MF20"),
        (drawn(), {"pitch": None}, "MF105.*pitch"),
        (drawn(), {"dots": 8}, "MF105 the start has 7 x 7 dots"),
        (drawn(), {"density": 0.3}, "MF105.*density.*begins at no single opening"),
        (drawn(), {"rules": {"min_feature_dots": 7}}, "MF204"),
    ],
)
def test_starts_that_cannot_be_are_refused(start: Any, more: dict[str, Any], told: str) -> None:
    stated = {"pitch": "168 um", "map": "equal_light" if "density" in more else "none", **more}
    with pytest.raises(InputError, match=told):
        mf.design(start=start, **{key: value for key, value in stated.items() if value is not None})


@pytest.mark.parametrize(
    ("rules", "least"),
    sweep(
        [
            ({"symmetry": "rot180"}, 60),
            ({"min_feature_dots": 3, "rim_dots": 1}, 85),
            ({"min_feature_dots": 3}, 90),
            ({"min_feature_dots": 2, "min_space_dots": 2, "kissing": "cell"}, 95),
        ],
        1,
    ),
)
def test_an_opening_that_nearly_keeps_the_rules_is_mended(rules: dict[str, Any], least: int) -> None:
    """Two blocks at the cell's edge with ragged sides: no compact shape has as much in common with them."""
    mask = np.zeros((21, 21), dtype=np.bool_)
    mask[0:9, 1:8] = mask[12:20, 14:19] = True
    draw = np.random.default_rng(5)
    for row, column in draw.integers(0, 21, (12, 2)):
        mask[row, column] ^= True
    held = Constraints(int(mask.sum()), dots=21, **rules)
    found = nearest(mask, held)
    assert held.allows(found)
    assert int((found & mask).sum()) >= least


def test_a_mended_opening_has_the_count_that_is_asked_for() -> None:
    mask = np.zeros((21, 21), dtype=np.bool_)
    mask[3:12, 4:15] = True
    for count in (70, 99, 130):
        held = Constraints(count, dots=21, min_feature_dots=4)
        found = mended(mask, held)
        assert found is not None
        assert held.allows(found)
        assert int((found & mask).sum()) == min(count, 99)
