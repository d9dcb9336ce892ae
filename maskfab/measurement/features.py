"""The smallest features of a die, and the limits that a job sets for them."""

from __future__ import annotations

import math
from dataclasses import replace

from maskfab.drc.panel_rules import Tone, narrowest
from maskfab.drc.rules import DesignRules
from maskfab.jobfile import LimitsSection
from maskfab.model import Die, Process, Quantity
from maskfab.units import NM_PER_UM


def smallest_features(die: Die) -> tuple[Quantity, Quantity]:
    """Least clear width and least opaque space of the whole panel, corner to corner included, in micrometres; exact."""
    return _smallest(die, "min_feature", "clear"), _smallest(die, "min_space", "opaque")


def _smallest(die: Die, name: str, tone: Tone) -> Quantity:
    what = "width of what is clear" if tone == "clear" else "chrome between clear edges"
    method = f"least {what} over the panel, corner to corner too; corners that kiss are counted apart; exact"
    length_nm = narrowest(die, tone).value_nm
    value = length_nm / NM_PER_UM if math.isfinite(length_nm) else None
    return Quantity(name, value, method, die=die.name)


def written_features(drawn: tuple[Quantity, Quantity], process: Process) -> tuple[Quantity, ...]:
    """The smallest features as drawn, and as a process writes straight edges: wider by its bias, spaces narrower."""
    told = "less" if process.cd_bias_um < 0 else "more"
    found = []
    for quantity, sign in zip(drawn, (1, -1), strict=True):
        value = quantity.value
        found.append(
            replace(
                quantity,
                name=f"written_{quantity.name}",
                value=value + sign * process.cd_bias_um if isinstance(value, float) else None,
                method=f"{quantity.name} by a bias of {abs(process.cd_bias_um):g} um, {told} of what is clear",
            )
        )
    return (*drawn, *found)


def limits_as_rules(limits: LimitsSection) -> DesignRules:
    """Width and space by the job's limits, and no corners that only touch, which are no width or space of nothing."""
    width, space = (
        None if limit is None else round(limit * NM_PER_UM) for limit in (limits.min_feature, limits.min_space)
    )
    return DesignRules(min_width_nm=width, min_space_nm=space, no_corner_touch=True, kissing=False)


def judged(quantity: Quantity, limits: LimitsSection) -> Quantity:
    """The quantity with the job's limit and verdict, where the job sets one."""
    limit = {
        "corner_touches": limits.corner_touches,
        "min_feature": limits.min_feature,
        "min_space": limits.min_space,
        "written_min_feature": limits.min_feature,
        "written_min_space": limits.min_space,
    }.get(quantity.name)
    if limit is None or isinstance(quantity.value, str):
        return quantity
    if quantity.value is None:
        return replace(quantity, limit=limit, passed=True)
    kept = quantity.value <= limit if quantity.name == "corner_touches" else quantity.value >= limit
    return replace(quantity, limit=limit, passed=kept)
