"""Lines across a panel where nothing is open: no chain of openings, and no refusal for lack of one."""

from __future__ import annotations

import numpy as np
import pytest
from asked_displays import asked_display

DOTS, DOT_NM = 5, 8000


@pytest.mark.parametrize(("lines", "kept"), [(6, True), (20, False)])
def test_a_closed_panel_holds_as_many_lines_as_its_width_does(lines: int, kept: bool) -> None:
    nothing = np.zeros((DOTS, DOTS), dtype=np.bool_)
    assert (asked_display(lines=lines).unwired(nothing, DOT_NM) is None) is kept
