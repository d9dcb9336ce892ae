"""Lines that pass beside openings at most: no fewer than all chains of a panel let through."""

from __future__ import annotations

import numpy as np
import pytest

from maskfab.base.model import Opening, Panel, Tiling
from maskfab.designs.rules.display_fit import most_beside
from maskfab.display.panel_lines import panel_cut
from maskfab.display.pixel_lines import WireRules

RULES = WireRules(3000, 4000, 2500)


def random_units(count: int, seed: int) -> np.ndarray:
    """Rectangles, some with a hole or a second piece."""
    draw = np.random.default_rng(seed)
    units = np.zeros((count, 11, 11), dtype=np.bool_)
    for unit in units:
        height, width = draw.integers(1, 9, 2)
        y, x = draw.integers(0, 12 - height), draw.integers(0, 12 - width)
        unit[y : y + height, x : x + width] = True
        unit[tuple(draw.integers(0, 11, 2))] ^= True
        unit[5, 5] = True
    return units


@pytest.mark.parametrize("seed", range(4))
def test_no_more_lines_pass_than_the_chains_of_a_panel_allow(seed: int) -> None:
    cells = np.random.default_rng(seed).integers(8, size=(4, 5)).astype(np.int8)
    units = random_units(6, seed)
    for unit, most in zip(units, most_beside(units, cells, 8000, RULES), strict=True):
        panel = Panel(Opening("unit", unit, 8000), 8000, 0, cells, Tiling.RANDOM, 0)
        assert any(panel_cut(panel, RULES, int(most) + 1, axis) is not None for axis in ("x", "y"))


def test_squares_in_a_row_let_through_what_their_gaps_hold() -> None:
    unit = np.zeros((1, 10, 10), dtype=np.bool_)
    unit[0, 3:7, 2:6] = True
    cells = np.zeros((3, 3), dtype=np.int8)
    # Gaps of 48 um, and 96 um and 112 um to the first and the last pixel's lines' ends.
    gap, first, last = ((free + 4 - edges * 2.5) // 7 for free, edges in ((48, 2), (96, 1), (112, 1)))
    assert most_beside(unit, cells, 8000, RULES)[0] == (first + 2 * gap + last) // 3
