"""Rules of the eye: how even a field looks on the display whose emitters fit round an opening.

Both are judged of the emitters that the display's check would draw, in the closed form of
:mod:`maskfab.display.evenness`: pixels turned at random, as often as those before the stop are. A map may look
otherwise, by some per cent. Where a colour may lie in pieces, a search tries openings with those that are found in a
tenth of the time, which seldom look as even as those that are drawn.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from functools import partial

from maskfab.base.arrays import Mask
from maskfab.base.units import NM_PER_UM, UM_PER_MM
from maskfab.designs.rules.display_fit import Display, footprints_of
from maskfab.designs.rules.rule import Constrained, Rule
from maskfab.display.emitter_pieces import in_pieces, look
from maskfab.display.evenness import Evenness
from maskfab.display.feasibility import feasibility

_MOVES = 8_000

Judged = Callable[[Constrained, Mask], Evenness | None]


def _drawn(constraints: Constrained, unit: Mask) -> Evenness | None:
    """Evenness of what would be drawn; None where nothing would be."""
    display: Display = constraints["emitters"]
    answer = feasibility(display.panel(unit, constraints.dot_nm), replace(display.rules, wires=None))
    return None if answer is None else answer.even


def _tried(constraints: Constrained, unit: Mask) -> Evenness | None:
    """Evenness of pieces that are found quickly; of what would be drawn where emitters are one area each."""
    display: Display = constraints["emitters"]
    rules = display.rules
    if not rules.pieces or len(constraints.orientations) == 1:
        return _drawn(constraints, unit)
    asked = footprints_of(constraints, rules.emitters)
    viewing = rules.eye.viewing(asked.grid.pitch_nm / NM_PER_UM)
    least = max(rules.keep * asked(unit), rules.emitters.required) / asked.share_of_cell
    used, ratio = constraints.orientations, rules.emitters.ratio
    placed = in_pieces(
        constraints.opening(unit), asked.grid, used, ratio, least, viewing, limits=rules.eye.limits, moves=_MOVES
    )
    return None if placed is None else look(placed, asked.grid.pitch_nm, used, viewing)


def _uneven(constraints: Constrained, unit: Mask, *, judged: Judged, rule: str, told: str) -> str | None:
    limit, seen = constraints[rule], judged(constraints, unit)
    if seen is None:
        return "no emitters were found that could be looked at"
    value, display = getattr(seen, rule), constraints["emitters"]
    away = f"from {display.rules.eye.looks.distance / UM_PER_MM:g} mm, at most {limit:g}"
    return None if value <= limit else f"an even field has {told.format(value)} {away}"


def _rule(name: str, told: str) -> Rule:
    check, quick = (partial(_uneven, judged=judged, rule=name, told=told) for judged in (_drawn, _tried))
    return Rule(name, "", check, quick=quick, one_place=lambda _: True, slow=True)


GRAIN, DELTA_E = _rule("grain", "grain {:.4f}"), _rule("delta_e", "ΔE {:.2f}")

EYE_RULES = GRAIN, DELTA_E
"""In the order in which they are judged."""
