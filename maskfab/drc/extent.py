"""Extent of the written data."""

from __future__ import annotations

from collections.abc import Iterable

from maskfab.drc.results import RuleResult
from maskfab.model import Box


def checked_extent(boxes: Iterable[Box], extent_nm: tuple[int, int]) -> RuleResult:
    """Boxes that leave a box about the origin; the value is how far the worst sticks out, in nm.

    Args:
        boxes: of everything that is written, in plate coordinates.
        extent_nm: width and height of the box that should hold them.
    """
    width, height = extent_nm
    out = []
    for x0, y0, x1, y1 in boxes:
        beyond = max(max(-x0, x1) - width / 2, max(-y0, y1) - height / 2)
        if beyond > 0:
            out.append((y0, x0, y1, x1, beyond))
    places = tuple((x0, y0, x1, y1) for y0, x0, y1, x1, _ in sorted(out))
    worst = max((beyond for *_, beyond in out), default=None)
    return RuleResult("extent", f"{width} x {height}", "nm", worst, len(out), places)
