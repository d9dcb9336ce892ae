"""Lines laid across a panel measured again from their polygons, by KLayout's own geometry, on the whole panel."""

from __future__ import annotations

from collections.abc import Sequence

from klayout import db

from maskfab.display.emitters.measure import SQUARE, Violation, told_of, whole_panel
from maskfab.display.wires.gutter import WireRules
from maskfab.display.wires.panel_routing import PanelLines
from maskfab.model import CLEAR, Panel


def line_violations(panel: Panel, laid: Sequence[PanelLines], rules: WireRules) -> tuple[Violation, ...]:
    """Every rule that lines break: their width, the space between and within them, their distance to openings.

    Distances are Chebyshev's, and lines that touch are told as lines that are not apart. Space is measured from edge to
    edge: KLayout compares a polygon with each that its box meets, edge by edge, and boxes of lines meet most others'.
    """
    clear = whole_panel(panel, (CLEAR,))[CLEAR]
    beside = db.Region(db.Box(0, 0, *panel.size_nm).enlarged(panel.pitch_nm))
    found = []
    for lines in laid:
        drawn = db.Region(lines.polygons(rules.line_nm))
        count, drawn = drawn.count(), drawn.merged()
        found += [
            ("line far outside the panel", drawn - beside),
            ("clearance of lines", drawn.sized(rules.clearance_nm, SQUARE) & clear),
            ("width of lines", drawn.width_check(rules.line_nm).polygons()),
            ("space between lines", drawn.edges().space_check(rules.space_nm, False, db.Region.Square).polygons()),
            ("lines that touch", drawn if drawn.count() != count else db.Region()),
        ]
    return tuple(told_of(rule, shapes) for rule, shapes in found if not shapes.is_empty())
