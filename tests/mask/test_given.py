"""Emitters drawn by hand in an opening's file."""

from __future__ import annotations

import numpy as np
import pytest

from maskfab.base.errors import JobError
from maskfab.mask.opening_file import opening_text, parse_opening

TEXT = '''
name = "small"
pitch = "32 um"
dots = 4
grid = """
#...
#...
#...
#...
"""
emitters = """
{rows}
"""
'''
GOOD = [".RGB"] * 4


def text(rows: list[str]) -> str:
    return TEXT.format(rows="\n".join(rows))


def test_emitters_are_read_and_written() -> None:
    opening = parse_opening(text(GOOD))
    assert opening.emitters is not None
    assert np.array_equal(opening.emitters[0], [0, 1, 2, 3])
    again = parse_opening(opening_text(opening))
    assert again.emitters is not None
    assert np.array_equal(again.emitters, opening.emitters)


def test_the_top_line_is_the_highest_row() -> None:
    opening = parse_opening(text(["...R", *([".G.B"] * 3)]))
    assert opening.emitters is not None
    assert np.array_equal(opening.emitters[3], [0, 0, 0, 1])


def test_cells_may_be_finer_than_dots() -> None:
    opening = parse_opening(text(["..RRGGBB"] * 8))
    assert opening.emitters is not None
    assert opening.emitters.shape == (8, 8)


@pytest.mark.parametrize(
    ("rows", "told"),
    [
        (
            ["R.GB", *GOOD[1:]],
            "red emitter lies on the opening in 1 cells, first in line 1, column 1, at the ! of !.GB",
        ),
        ([".RG."] * 4, "no blue emitter"),
        ([".RGX"] * 4, "'X'"),
        ([".RGB"] * 3, "3 lines"),
        ([".RGB."] * 5, "5 cells a side"),
        ([""], "0 lines"),
    ],
)
def test_a_wrong_drawing_is_refused_with_its_place(rows: list[str], told: str) -> None:
    with pytest.raises(JobError, match="MF119") as refused:
        parse_opening(text(rows), "file.toml")
    assert told in str(refused.value)
    assert "file.toml: emitters" in str(refused.value)
