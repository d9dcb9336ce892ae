"""The smallest features of a die, and the limits that a job sets for them."""

from __future__ import annotations

from dataclasses import replace

from maskfab.geometry.rules import smallest_runs
from maskfab.model import Die, Quantity
from maskfab.spec import LimitsSection
from maskfab.units import NM_PER_UM
from maskfab.validate.roundtrip import die_edges_nm, die_raster


def smallest_features(die: Die) -> tuple[Quantity, Quantity]:
    """Shortest clear and shortest opaque run along x or y over the whole panel, in micrometres; exact."""
    runs = smallest_runs(die_raster(die), *die_edges_nm(die))
    clear = [run for run in (runs.clear_x, runs.clear_y) if run is not None]
    opaque = [run for run in (runs.opaque_x, runs.opaque_y) if run is not None]
    method = "shortest {} run along x or y over all cells of the panel, neighbours included; exact"
    return (
        Quantity("min_feature", "w", min(clear) / NM_PER_UM if clear else None, "um", method.format("clear"), die=die.name),
        Quantity("min_space", "s", min(opaque) / NM_PER_UM if opaque else None, "um", method.format("opaque"), die=die.name),
    )


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
