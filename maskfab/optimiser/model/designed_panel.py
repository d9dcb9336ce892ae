"""The panel of a designed opening on a die: its map in the middle, all beyond it drawn as its tiling draws it."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from maskfab.model import Opening, Panel, Tiling
from maskfab.plate.maps import CellMap, panel_shape, placed, shifted_openings
from maskfab.plate.tiling import orientations

_WHERE = "design"


def designed_panel(
    unit: NDArray[np.bool_],
    dot_nm: int,
    *,
    tiling: Tiling,
    seed: int,
    across: int,
    given: CellMap | None = None,
    outer: NDArray[np.bool_] | None = None,
) -> Panel:
    """Lay an opening, or two, on a die.

    Args:
        unit: bool [dots, dots].
        dot_nm: side of a dot.
        tiling: of the cells; where there is a map, of what is meant by it.
        seed: of all that is drawn.
        across: cells along the die's side.
        given: the map; None for a die of the tiling alone.
        outer: the sparser opening of two, bool [dots, dots].
    """
    openings = (Opening("unit", unit, dot_nm), *(() if outer is None else (Opening("outer", outer, dot_nm),)))
    if given is None:
        held = orientations(tiling, across, across, seed, openings=len(openings))
    else:
        openings = shifted_openings(given, openings, where=_WHERE)
        rows, columns = panel_shape(given, across, across)
        held = placed(given, rows, columns, seed, openings=len(openings), where=_WHERE)
    return Panel(openings[0], dot_nm, 0, held, tiling, seed, others=openings[1:])
