"""From [search] to an opening and a map: scan families, anneal the best, turn the cells, and say what that brought."""

from __future__ import annotations

import os
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import chain

from maskfab import __version__
from maskfab.design.bounds import optimality_gap
from maskfab.design.constraints import Constraints
from maskfab.design.discrete import ExpectedPsnr, Prices, Ranked, anneal, prices, scan
from maskfab.design.families import FAMILIES, Candidate
from maskfab.design.orientation_map import DesignedMap, MapMode, design_map
from maskfab.design.pupil_error import pupil_error
from maskfab.design.surrogate import surrogate
from maskfab.imaging.photographs import Scene
from maskfab.imaging.protocol import LEVELS
from maskfab.layout.maps import CellMap
from maskfab.layout.openings import dot_of_pitch
from maskfab.layout.subpixels.rules import EmitterRules
from maskfab.model import Opening
from maskfab.progress import Progress, silent
from maskfab.spec import SearchSection

_PRICED = 200
"""Best openings of a scan among which the rules are priced."""


@dataclass(frozen=True, eq=False)
class Searched:
    """What a search has found.

    Attributes:
        opening: the best that keeps all rules.
        shape: the family, size and place it came from.
        psnr: expected restored PSNR in dB, by level, cells turned at random (or not at all, if periodic).
        head_room: by level, dB that no other opening of as many dots can gain over it in the picture's interior.
        evaluated: openings that were judged.
        prices: what the rules cost among them, in dB of the weighted mean.
        cells: the designed map; None if none was asked for.
        designed: how that went.
    """

    opening: Opening
    shape: str
    psnr: tuple[float, ...]
    head_room: tuple[float, ...]
    evaluated: int
    prices: Prices
    cells: CellMap | None
    designed: DesignedMap | None


def search(section: SearchSection, scenes: Sequence[Scene], command: str, progress: Progress = silent) -> Searched:
    """Search as the section says.

    Args:
        section: of a job.
        scenes: photographs whose spectrum and edges count.
        command: for the provenance.
        progress: told where the work stands.

    Raises:
        JobError, OpeningError: MF104, MF106, MF107 for numbers; MF123, MF203, MF204 for rules that no opening keeps.
    """
    dot_nm = dot_of_pitch(f"{section.pitch:.15g} um", section.dots, where="search.pitch")
    rules = _constraints(section, dot_nm)
    rules.require_possible()
    periodic = section.tiling == "periodic"
    progress("photographs", 0, 1)
    estimate = surrogate(scenes, section.dots)
    progress("photographs", 1, 1)
    objective = ExpectedPsnr(estimate, periodic, LEVELS, section.weights)
    shapes = list(chain.from_iterable(FAMILIES[name](section.dots, section.clear_dots) for name in section.families))
    plain = Constraints(section.clear_dots, dots=section.dots, dot_nm=dot_nm)
    workers = os.cpu_count() or 1
    found = scan(shapes, objective, plain, turned_alike=not periodic, workers=workers, progress=progress)
    kept = next((each for each in found.ranked if rules.allows(each.unit)), None)
    best = kept or scan(shapes, objective, rules, turned_alike=not periodic, workers=workers, progress=progress).best
    looked = list(found.ranked[:_PRICED])
    evaluated = found.evaluated
    if section.anneal:
        walked = anneal(best.unit, objective, rules, evaluations=section.anneal, seed=section.seed, progress=progress)
        evaluated += section.anneal
        if walked.value > best.value:
            best = Ranked(f"{best.name}, annealed", walked.unit, walked.value)
    if all(each.unit is not best.unit for each in looked):
        looked.append(best)
    priced = prices((Candidate(each.name, each.unit) for each in looked), objective, rules)
    psnr = estimate(best.unit, periodic=periodic)
    progress("bounds", 0, 1)
    gap = optimality_gap(estimate, best.unit, periodic=periodic)
    progress("bounds", 1, 1)
    facts: dict[str, str | int | float] = {
        "author": "maskfab",
        "command": command,
        "version": __version__,
        "seed": section.seed,
    }
    expected = {f"expected_psnr_{level}": round(value, 3) for level, value in zip(LEVELS, psnr, strict=True)}
    opening = Opening(section.name, best.unit, dot_nm, {**facts, "shape": best.name, **expected})
    cells = designed = None
    if section.map is not None:
        mode = MapMode(section.map)
        designed = design_map(best.unit, pupil_error(estimate), mode=mode, seed=section.seed, progress=progress)
        gains = {f"gain_db_{level}": round(gain, 3) for level, gain in zip(LEVELS, designed.gain_db, strict=True)}
        cells = CellMap(f"{section.name[:20]}_map", designed.orientations, {**facts, "mode": mode.value, **gains})
    return Searched(opening, best.name, psnr, gap.head_room, evaluated, priced, cells, designed)


def _constraints(section: SearchSection, dot_nm: int) -> Constraints:
    asked = section.rules
    return Constraints(
        section.clear_dots,
        dots=section.dots,
        dot_nm=dot_nm,
        min_feature_dots=asked.min_feature_dots,
        min_space_dots=asked.min_space_dots,
        kissing=asked.kissing,
        rim_dots=asked.rim_dots,
        orientations=(0,) if section.tiling == "periodic" else tuple(range(8)),
        symmetry=asked.symmetry,
        emitters=EmitterRules(0, 8000, 2 * dot_nm),
        footprint=asked.footprint,
        wire_flow=asked.wire_flow,
        ports=asked.ports,
        centroid_px=asked.centroid_px,
    )
