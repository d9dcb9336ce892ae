"""[search]: from a job's section to an opening, its map, and what the rules cost."""

from __future__ import annotations

import numpy as np
import pytest

from maskfab.design.search import search
from maskfab.errors import MaskfabError
from maskfab.imaging.scenes import dead_leaves
from maskfab.layout.openings import dumps, parse
from maskfab.spec import SearchSection, parse_section

PLAIN = {"name": "found", "dots": 12, "pitch": "168 um", "clear_dots": 32}


@pytest.fixture(scope="module")
def scenes():  # type: ignore[no-untyped-def]
    return (dead_leaves(1),)


def section(**changed: object) -> SearchSection:
    return parse_section(SearchSection, {**PLAIN, **changed}, where="test")


def test_a_search_is_exact_in_its_count_and_equal_runs_are_equal(scenes) -> None:  # type: ignore[no-untyped-def]
    one, two = (search(section(anneal=60, seed=3), scenes, "maskfab design x.toml") for _ in range(2))
    assert one.opening.clear_dots == 32
    assert dumps(one.opening) == dumps(two.opening)
    assert parse(dumps(one.opening)).provenance["expected_psnr_24"] == pytest.approx(one.psnr[0], abs=1e-3)
    assert min(one.head_room) >= 0


def test_rules_are_kept_and_priced(scenes) -> None:  # type: ignore[no-untyped-def]
    free = search(section(), scenes, "x")
    ruled = search(section(rules={"kissing": "neighbours", "min_feature_dots": 2, "rim_dots": 1}), scenes, "x")
    mask = ruled.opening.mask
    assert not mask[[0, -1]].any()
    assert not mask[:, [0, -1]].any()
    assert np.mean(ruled.psnr) <= np.mean(free.psnr) + 1e-9
    assert {price.rule for price in ruled.prices.each} >= {"kissing", "rim_dots"}
    assert ruled.prices.together >= 0


def test_a_map_is_designed_for_the_opening(scenes) -> None:  # type: ignore[no-untyped-def]
    found = search(section(map="equal_light"), scenes, "x")
    assert found.cells is not None
    assert found.cells.cells.shape == (24, 24)
    assert found.designed is not None
    assert min(found.designed.gain_db) > 0
    assert abs(found.designed.clear_dots / found.designed.start_clear_dots - 1) < 0.005


def test_what_cannot_be_is_refused(scenes) -> None:  # type: ignore[no-untyped-def]
    for changed, code in (
        ({"clear_dots": 145}, "MF"),
        ({"clear_dots": 31, "rules": {"symmetry": "d4"}}, "MF"),
        ({"pitch": "168.1 um"}, "MF106"),
    ):
        with pytest.raises(MaskfabError, match=code):
            search(section(**changed), scenes, "x")
