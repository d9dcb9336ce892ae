"""Designs of a front under their names, each with a job that asks for it."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Any

from maskfab.base.model import Opening
from maskfab.camera.stop_cells import F1, PhotoCamera
from maskfab.designs.front import FrontPoint, Pareto, sought
from maskfab.designs.model.statistics import F1_SETTINGS, CaptureSettings
from maskfab.designs.search.result import Facts, by_level, camera_facts, origin
from maskfab.job.sections import JobSpec, SearchSection
from maskfab.job.toml import dumps
from maskfab.mask.panels import CellMap

_SECTIONS = ("design", "camera", "sensor", "exposure", "emitters", "circuits", "wires", "light")

_DIGITS = 1e4

_OF_ONE_OPENING = {"positions": 1, "joint": 0, "shortlist": 1}
"""Keys of [design] that two openings have no use for, as if they were not stated."""


@dataclass(frozen=True, eq=False)
class FrontDesign:
    """A design of a front with its name.

    Attributes:
        opening: with its provenance; of two, the denser one.
        outer: the sparser one; None for one opening.
        map: of its cells, if it has one.
        job: text of a job whose [design] asks for this light, these emitters and lines.
    """

    name: str
    point: FrontPoint
    opening: Opening
    outer: Opening | None
    map: CellMap | None
    job: str


def designs(
    pareto: Pareto, spec: JobSpec, command: str, camera: PhotoCamera = F1, settings: CaptureSettings = F1_SETTINGS
) -> tuple[FrontDesign, ...]:
    """Every design on a curve, curve after curve."""
    section = spec.design
    assert isinstance(section, SearchSection)
    named = []
    for curve in pareto.curves:
        for place, point in enumerate(curve.points, start=1):
            name = f"{section.name[:14]}_{curve.clear_dots}_{place}"
            facts: Facts = {
                **origin(section, command, camera_facts(camera, settings)),
                "shape": point.shape,
                **by_level("expected_psnr", point.psnr, pareto.levels),
                "footprint": round(point.footprint, 6),
                "lines": point.lines,
                "evaluated": curve.evaluated,
            }
            opening = Opening(name, point.units[0], pareto.dot_nm, facts)
            outer = None if len(point.units) == 1 else Opening(f"{name}_outer", point.units[1], pareto.dot_nm, facts)
            held = point.cells and replace(point.cells, name=f"{name}_map", provenance=facts)
            named.append(FrontDesign(name, point, opening, outer, held, _job(spec, section, point, name)))
    return tuple(named)


def _job(spec: JobSpec, section: SearchSection, point: FrontPoint, name: str) -> str:
    """A job that asks of a search what this design has, and of its emitters as much as is kept of the largest."""
    asked: dict[str, Any] = {
        "name": name,
        "clear_dots": point.judged.clear_dots,
        "fit": True,
        "output": f"{name}_designed.toml",
    }
    if section.map is not None:
        asked["map_output"] = f"{name}_designed_map.toml"
    assert spec.emitters is not None
    if point.uneven:
        asked |= {**dict(point.uneven), **_OF_ONE_OPENING}
    if sought(point.uneven):
        eye = {"slow_grain": math.ceil(_DIGITS * point.grain) / _DIGITS, "centroid_px": None}
        asked["rules"] = section.rules.model_copy(update=eye)
    kept = 0.0 if sought(point.uneven) else spec.emitters.keep * point.footprint
    footprint = math.floor(_DIGITS * kept) / _DIGITS
    emitters = spec.emitters.model_copy(update={"required": max(footprint, spec.emitters.required)})
    wires = None
    if spec.wires is not None and point.lines:
        wires = spec.wires.model_copy(update={"lines": point.lines})
    held = {"design": section.model_copy(update=asked), "emitters": emitters, "wires": wires}
    changed = spec.model_copy(update=held)
    plain = changed.model_dump(mode="json", exclude_none=True, exclude_defaults=True)
    # A section that is stated asks for something, though all that it states are defaults.
    return dumps({key: plain.get(key, {}) for key in _SECTIONS if getattr(changed, key) is not None})
