"""Verdicts on the narrowest places: of a job's limits and of a house, whether or not corners kiss elsewhere."""

from __future__ import annotations

import math

import numpy as np
import pytest
from house_plates import checked
from hypothesis import given
from hypothesis import strategies as st

from maskfab.base.model import Die, Opening, Panel, Plate, Tiling
from maskfab.job.sections import LimitsSection
from maskfab.mask.houses.profiles import load_shop
from maskfab.mask.plate_rules import check_plate, judged, limits_as_rules, smallest_features

CORNERS = np.zeros((7, 7), dtype=np.bool_)
CORNERS[0, 0] = CORNERS[6, 6] = True
KISSING = CORNERS.copy()
KISSING[3, 3] = KISSING[4, 4] = True


def plate_of(mask, gutter_nm, dot_nm=8000, cells=4):
    panel = Panel(
        Opening("o", mask, dot_nm), dot_nm, gutter_nm, np.zeros((cells, cells), np.int64), Tiling.PERIODIC, None
    )
    die = Die("HOLE", "hole", panel, (0, 0), max(panel.size_nm) + 2)
    return Plate("plate", "", 101_600_000, 90_000_000, (die,), (), (), ())


@pytest.mark.parametrize("mask", [CORNERS, KISSING], ids=["apart", "kissing"])
def test_a_house_is_told_of_corners_across_a_gutter(mask):
    findings = {each.rule: each for each in checked(plate_of(mask, 600), load_shop("generic-chrome"))}
    space = findings["min_space"]
    assert space.passed is False
    assert space.value == pytest.approx(0.6 * math.sqrt(2))
    assert "die HOLE, 18 in all" in space.place
    assert findings["min_feature"].passed


@pytest.mark.parametrize("mask", [CORNERS, KISSING], ids=["apart", "kissing"])
def test_a_jobs_limit_and_its_markers_agree(mask):
    plate, limits = plate_of(mask, 600), LimitsSection.model_validate({"min_space": "1 um", "min_feature": "1 um"})
    feature, space = (judged(each, limits) for each in smallest_features(plate.dies[0]))
    markers = {each.rule: each for each in check_plate(plate, limits_as_rules(limits)) if each.die}
    assert feature.passed
    assert markers["width"].passed
    assert not space.passed
    assert space.value == pytest.approx(markers["space"].value / 1000)


@given(st.integers(0, 2**32 - 1), st.sampled_from((0, 600, 2000, 20_000)), st.sampled_from((0.9, 1.0, 3.0, 8.5, 12.0)))
def test_verdict_and_markers_never_differ(seed, gutter_nm, limit_um):
    mask = np.random.default_rng(seed).random((5, 5)) < 0.3
    mask[2, 2] = True
    plate = plate_of(mask, gutter_nm, cells=3)
    limits = LimitsSection.model_validate({"min_space": f"{limit_um} um", "min_feature": f"{limit_um} um"})
    found = [judged(each, limits) for each in smallest_features(plate.dies[0])]
    markers = {each.rule: each for each in check_plate(plate, limits_as_rules(limits)) if each.die}
    assert [each.passed for each in found] == [markers["width"].passed, markers["space"].passed]
    for each, marker in zip(found, (markers["width"], markers["space"]), strict=True):
        assert marker.passed or each.value == pytest.approx(marker.value / 1000, abs=1e-3)
