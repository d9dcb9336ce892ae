"""KLayout's checks that the rules on distances are made of."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from klayout import db

from maskfab.drc.rules import DesignRules

Check = Callable[[db.Region], db.EdgePairs]
"""Pairs of edges that face each other too closely, of a region merged with kissing corners apart."""


def distance_checks(rules: DesignRules) -> dict[str, tuple[int, Check]]:
    """Limit and check of the rules on width, space and notch that are set, by their names."""
    # Corners that kiss are edges that touch at a distance of nothing.
    options: dict[str, Any] = {} if rules.kissing else {"zero_distance_mode": db.Region.NeverIncludeZeroDistance}
    checks: dict[str, tuple[int, Check]] = {}
    if (width := rules.min_width_nm) is not None:
        checks["width"] = width, lambda region: region.width_check(width, **options)
    if (space := rules.min_space_nm) is not None:
        checks["space"] = space, lambda region: region.space_check(space, **options)
    if (notch := rules.min_notch_nm) is not None:
        checks["notch"] = notch, lambda region: region.notch_check(notch, **options)
    return checks
