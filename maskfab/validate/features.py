"""The smallest features of a die, and the limits that a job sets for them."""

from __future__ import annotations

import math
from dataclasses import replace

from maskfab.geometry.drc import DesignRules
from maskfab.geometry.rules import smallest_runs
from maskfab.model import Die, Quantity
from maskfab.spec import LimitsSection
from maskfab.units import NM_PER_UM
from maskfab.validate.roundtrip import die_edges_nm, die_raster


def smallest_features(die: Die) -> tuple[Quantity, Quantity]:
    """Shortest clear and shortest opaque run along x or y over the whole panel, in micrometres; exact."""
    runs = smallest_runs(die_raster(die), *die_edges_nm(die))

    def shortest(name: str, symbol: str, length_nm: float, tone: str) -> Quantity:
        method = f"shortest {tone} run along x or y over all cells of the panel, neighbours included; exact"
        value = length_nm / NM_PER_UM if math.isfinite(length_nm) else None
        return Quantity(name, symbol, value, "um", method, die=die.name)

    return shortest("min_feature", "w", runs.clear, "clear"), shortest("min_space", "s", runs.opaque, "opaque")


def limits_as_rules(limits: LimitsSection) -> DesignRules:
    """Width and space by the job's limits, and no corners that only touch."""
    width, space = (
        None if limit is None else round(limit * NM_PER_UM) for limit in (limits.min_feature, limits.min_space)
    )
    return DesignRules(min_width_nm=width, min_space_nm=space, no_corner_touch=True)


def judged(quantity: Quantity, limits: LimitsSection) -> Quantity:
    """The quantity with the job's limit and verdict, where the job sets one."""
    limit = {
        "corner_touches": limits.corner_touches,
        "min_feature": limits.min_feature,
        "min_space": limits.min_space,
    }.get(quantity.name)
    if limit is None or isinstance(quantity.value, str):
        return quantity
    if quantity.value is None:
        return replace(quantity, limit=limit, passed=True)
    kept = quantity.value <= limit if quantity.name == "corner_touches" else quantity.value >= limit
    return replace(quantity, limit=limit, passed=kept)
