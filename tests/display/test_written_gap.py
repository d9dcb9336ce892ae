"""Room that openings leave emitters as they are written, against areas by hand."""

from __future__ import annotations

import numpy as np
import pytest

from maskfab.display.emitters.emitter_rules import EmitterRules
from maskfab.display.emitters.measure import left_of_emitters
from maskfab.model import Emitters, Opening, Panel, Tiling

DOT_NM = 8000
RULES = EmitterRules(0, DOT_NM, DOT_NM)


def panel(rows: int, columns: int) -> Panel:
    """A slit along the left side of every pixel, and one colour in each of the other three columns of dots."""
    mask = np.zeros((4, 4), dtype=bool)
    mask[:, 0] = True
    labels = np.tile(np.array([0, 3, 2, 1], dtype=np.int8), (4, 1))
    cells = np.zeros((rows, columns), dtype=np.int8)
    return Panel(Opening("slit", mask, DOT_NM), DOT_NM, 0, cells, Tiling.PERIODIC, None, Emitters(labels, DOT_NM))


@pytest.mark.parametrize(("rows", "columns"), [(1, 1), (2, 3), (30, 20)])
def test_a_wider_opening_takes_from_its_own_pixel_and_from_the_next(rows, columns):
    red, green, blue = left_of_emitters(panel(rows, columns), RULES, 500)
    assert (red, green, blue) == pytest.approx((1 - 500 / DOT_NM, 1.0, 1 - 500 / DOT_NM))


def test_a_narrower_opening_takes_nothing():
    assert left_of_emitters(panel(4, 4), RULES, -500) == (1.0, 1.0, 1.0)
