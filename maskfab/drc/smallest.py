"""The narrowest places of a panel: exact, corner to corner included, and not hidden by corners that kiss."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Literal, TypeAlias

from maskfab.drc.panel_rules import panel_results
from maskfab.drc.raster_rules import smallest_runs
from maskfab.drc.rules import DesignRules
from maskfab.geometry.die_grid import die_edges_nm, die_raster
from maskfab.model import Box, Die

Tone: TypeAlias = Literal["clear", "opaque"]


@dataclass(frozen=True)
class Narrowest:
    """A width of what is clear, or a space between clear edges.

    Attributes:
        value_nm: Euclidian distance; inf where nothing faces anything.
        place: hull of the two edges, in plate nanometres; None where it was not asked for, or there is none.
    """

    value_nm: float
    place: Box | None = None


def narrowest(die: Die, tone: Tone, *, placed: bool = False) -> Narrowest:
    """The least clear width, or the least opaque space, of a die.

    Distances are those of :class:`DesignRules` with ``kissing=False``. The shortest run along x or y is one of them,
    so only what is less than it has to be looked for, and nothing that is no kiss is less than a dot or a gutter.

    Args:
        die: the die, alone.
        tone: "clear" for widths, "opaque" for spaces.
        placed: whether the place is asked for, too.
    """
    runs = smallest_runs(die_raster(die), *die_edges_nm(die))
    run = runs.clear if tone == "clear" else runs.opaque
    panel = die.panel
    if run <= min(panel.dot_nm, panel.gutter_nm or panel.dot_nm) and not placed:
        return Narrowest(run)
    # Where no row and no column has a run there are few edges, however far one looks.
    reach = run if math.isfinite(run) else math.hypot(*panel.size_nm)
    found = _below(die, tone, math.ceil(reach) + int(placed))
    if found.place is None or found.value_nm >= run:
        return Narrowest(run, found.place)
    return found if placed else Narrowest(found.value_nm)


def _below(die: Die, tone: Tone, limit_nm: int) -> Narrowest:
    """The narrowest place that breaks a limit, the first of its kind."""
    width, space = (limit_nm, None) if tone == "clear" else (None, limit_nm)
    results = panel_results(die, DesignRules(min_width_nm=width, min_space_nm=space, kissing=False), 1)
    (result,) = (each for each in results if each.rule == ("width" if tone == "clear" else "space"))
    if result.passed or not isinstance(result.value, int | float):
        return Narrowest(math.inf)
    return Narrowest(float(result.value), result.places[0])
