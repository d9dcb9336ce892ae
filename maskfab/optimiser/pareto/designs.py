"""The designs of a front as files: an opening, its map, and a job that asks for as much."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

from maskfab.camera.photo_camera import F1, PhotoCamera
from maskfab.jobfile import JobSpec, SearchSection
from maskfab.jobfile.toml import dumps
from maskfab.model import Opening
from maskfab.optimiser.model.taking import F1_TAKING, Taking
from maskfab.optimiser.pareto.front import FrontPoint, Pareto
from maskfab.optimiser.result import Facts, by_level, camera_facts, origin
from maskfab.plate.maps import CellMap

_SECTIONS = ("design", "camera", "sensor", "exposure", "emitters", "wires", "light")
_DIGITS = 1e4
_OF_ONE_OPENING = {"positions": 1, "joint": 0, "shortlist": 1}
"""Keys of [design] that two openings have no use for, as if they were not stated."""


@dataclass(frozen=True, eq=False)
class FrontDesign:
    """A design of a front with its name.

    Attributes:
        name: the job's, the clear dots and its place in the curve.
        point: its numbers.
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
    found: Pareto, spec: JobSpec, command: str, camera: PhotoCamera = F1, taking: Taking = F1_TAKING
) -> tuple[FrontDesign, ...]:
    """Every design on a curve, curve after curve.

    Args:
        found: by a sweep.
        spec: the job of that sweep, with [design], [emitters] and [pareto].
        command: how a user repeats it.
        camera, taking: of that sweep.
    """
    section = spec.design
    assert isinstance(section, SearchSection)
    named = []
    for curve in found.curves:
        for place, each in enumerate(curve.points, start=1):
            name = f"{section.name[:14]}_{curve.clear_dots}_{place}"
            facts: Facts = {
                **origin(section, command, camera_facts(camera, taking)),
                "shape": each.shape,
                **by_level("expected_psnr", each.psnr, found.levels),
                "footprint": round(each.footprint, 6),
                "lines": each.lines,
                "evaluated": curve.evaluated,
            }
            opening = Opening(name, each.units[0], found.dot_nm, facts)
            outer = None if len(each.units) == 1 else Opening(f"{name}_outer", each.units[1], found.dot_nm, facts)
            held = None if each.cells is None else CellMap(f"{name}_map", each.cells.cells, facts, each.cells.shifts)
            named.append(FrontDesign(name, each, opening, outer, held, _job(spec, section, each, name)))
    return tuple(named)


def _job(spec: JobSpec, section: SearchSection, each: FrontPoint, name: str) -> str:
    """A job that asks of a search what this design has, and of its emitters as much as is kept of the largest."""
    asked: dict[str, Any] = {
        "name": name,
        "clear_dots": each.judged.clear_dots,
        "fit": True,
        "output": f"{name}_designed.toml",
    }
    if section.map is not None:
        asked["map_output"] = f"{name}_designed_map.toml"
    assert spec.emitters is not None
    if each.uneven:
        asked |= {**dict(each.uneven), **_OF_ONE_OPENING}
    footprint = math.floor(_DIGITS * spec.emitters.keep * each.footprint) / _DIGITS
    emitters = spec.emitters.model_copy(update={"required": max(footprint, spec.emitters.required)})
    wires = None
    if spec.wires is not None and each.lines:
        wires = spec.wires.model_copy(update={"lines": each.lines})
    held = {"design": section.model_copy(update=asked), "emitters": emitters, "wires": wires}
    changed = spec.model_copy(update=held)
    plain = changed.model_dump(mode="json", exclude_none=True, exclude_defaults=True)
    # A section that is stated asks for something, though all that it states are defaults.
    return dumps({key: plain.get(key, {}) for key in _SECTIONS if getattr(changed, key) is not None})
