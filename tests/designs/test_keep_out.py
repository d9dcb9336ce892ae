"""Dots that a job wants closed stay closed."""

from __future__ import annotations

import numpy as np
import pytest

from maskfab.base.errors import InputError, JobError
from maskfab.designs.search.result import constraints_of
from maskfab.job.sections import RulesSection, SearchSection


def section(keep_out: str) -> SearchSection:
    return SearchSection(name="kept", dots=3, pitch="24 um", clear_dots=2, rules=RulesSection(keep_out=keep_out))


def test_the_top_row_of_the_drawing_is_the_top_of_the_cell() -> None:
    rules = constraints_of(
        section("""
        xx.
        ...
        ..x
    """)
    )
    free = np.array([[1, 1, 0], [1, 1, 1], [0, 0, 1]], dtype=np.bool_)
    assert np.array_equal(rules.free, free)
    top_left = np.zeros((3, 3), dtype=np.bool_)
    top_left[2, :2] = True
    assert not rules.allows(top_left)
    assert rules.allows(top_left[::-1])


def test_too_much_kept_out_is_refused_with_the_rules_to_blame() -> None:
    with pytest.raises(InputError) as caught:
        constraints_of(section("xxx\nxxx\nxx.")).require_possible()
    assert caught.value.code == "MF204"
    assert "keep_out" in str(caught.value)


@pytest.mark.parametrize("drawing", ["", "xx.\n...", "xx.\n...\n..#", "xx..\n...\n..x"])
def test_a_drawing_that_is_not_the_cell_is_refused(drawing: str) -> None:
    with pytest.raises(JobError) as caught:
        constraints_of(section(drawing))
    assert caught.value.code == "MF105"
    assert "keep_out" in caught.value.where
