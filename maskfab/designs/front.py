"""Points of a front: openings with the numbers that are traded against each other.

The designs of a front as files: an opening, its map, and a job that asks for as much.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from types import MappingProxyType
from typing import Any

from maskfab.base.arrays import Mask
from maskfab.base.model import Opening
from maskfab.camera.lens import F1, PhotoCamera
from maskfab.designs.model.statistics import F1_SETTINGS, CaptureSettings
from maskfab.designs.search.account import Alternatives, Prices
from maskfab.designs.search.result import Facts, by_level, camera_facts, origin
from maskfab.job.sections import JobSpec, SearchSection
from maskfab.job.toml import dumps
from maskfab.mask.panels import CellMap


@dataclass(frozen=True, eq=False)
class JudgedOpening:
    """An opening with its numbers.

    Attributes:
        shape: the family, size and place it came from, or the name of an opening that was given.
        unit: bool [dots, dots], True is clear, row 0 the lowest.
        value: expected restored PSNR in dB of cells that are turned at random, or all alike where the panel is
            periodic; weighted mean over the levels of light.
        psnr: the same by level.
        footprint: share of the pixel that each colour covers, mean over the emitters' ratio.
        lines: most opaque lines, of the numbers that were asked about, that cross every pixel each way.
    """

    shape: str
    unit: Mask
    value: float
    psnr: tuple[float, ...]
    footprint: float
    lines: int

    @property
    def clear_dots(self) -> int:
        return int(self.unit.sum())

    @property
    def open_ratio(self) -> float:
        return self.clear_dots / self.unit.size

    def betters(self, other: JudgedOpening) -> bool:
        """Whether it has at least as much of everything, and more of one."""
        mine, its = ((each.value, each.footprint, each.lines) for each in (self, other))
        return all(a >= b for a, b in zip(mine, its, strict=True)) and mine != its


@dataclass(frozen=True, eq=False)
class FrontPoint:
    """A design that fits: an opening, or two, on a panel, with emitters and wires.

    Attributes:
        judged: the opening; of two, the one on whose panel it passes as much light.
        shape: of what is laid, in words.
        units: bool [1 or 2, dots, dots], what is laid, the denser one first.
        uneven: keys of [design] that ask for light shared unevenly, with their values; none for one opening.
        footprint: share of the pixel that each colour covers, mean over the emitters' ratio, alike in all cells.
        lines: most opaque lines, of the numbers that were asked about, that cross every pixel each way.
        mapped: expected restored PSNR in dB by level on its panel, whose map had one descent; None without a map.
        value: of what is laid: weighted mean over the levels, mapped if there is a map.
        cells: its map, if there is one.
        grain: rms luminance contrast of an even white field up to 10 cycles per degree, seen from 300 mm.
    """

    judged: JudgedOpening
    shape: str
    units: Mask
    uneven: tuple[tuple[str, float], ...]
    footprint: float
    lines: int
    mapped: tuple[float, ...] | None
    value: float
    cells: CellMap | None
    grain: float

    @property
    def psnr(self) -> tuple[float, ...]:
        """By level, of what is laid."""
        return self.judged.psnr if self.mapped is None else self.mapped

    @property
    def densest(self) -> float:
        """Clear share of the densest cells; of one opening, its open ratio."""
        return float(self.units[0].mean())

    def betters(self, other: FrontPoint) -> bool:
        """Whether it has at least as much of everything that is wanted and as little grain, and is better in one."""
        mine, its = ((p.value, p.footprint, p.lines, -p.grain) for p in (self, other))
        return all(a >= b for a, b in zip(mine, its, strict=True)) and mine != its


@dataclass(frozen=True, eq=False)
class FrontCurve:
    """The designs of one number of clear dots.

    Attributes:
        clear_dots: in a cell.
        front: of one opening, PSNR falling; none that was judged betters one of them in PSNR, footprint and lines.
        denser: at the same light, of denser cells and sparser ones.
        evaluated: shapes whose PSNR was computed.
        measured: those whose footprint and lines were measured too.
        left_out: openings that none betters either, between those of ``front``; a curve holds only so many.
        misfits: why openings that none betters are not in ``front``: what their display's check says of the die.
        complete: whether no budget ended it.
        refusal: why there is no design of so many dots, where ``front`` is empty.
        asked: parts of the display that every design holds, the least of each, with what it asks.
        prices: what these cost among the shapes judged; None where there is no design, and where the budget is over.
        priced_among: shapes among which they are priced.
        alternatives: openings of nearly the PSNR of the best of ``front``; None as ``prices``.
    """

    clear_dots: int
    front: tuple[FrontPoint, ...]
    denser: tuple[FrontPoint, ...]
    evaluated: int
    measured: int
    left_out: int
    misfits: tuple[str, ...]
    complete: bool
    refusal: str | None = None
    asked: Mapping[str, str] = field(default_factory=lambda: MappingProxyType({}))
    prices: Prices | None = None
    priced_among: int = 0
    alternatives: Alternatives | None = None

    @property
    def points(self) -> tuple[FrontPoint, ...]:
        """Those of one opening, then those of two."""
        return (*self.front, *self.denser)


@dataclass(frozen=True, eq=False)
class Pareto:
    """Result of a sweep.

    Attributes:
        curves: one for each number of clear dots, rising.
        compared: the openings given, judged alike, in their order.
        dot_nm: side of a dot.
        levels: of light, dB.
        lines: numbers of lines that were asked about, rising.
        designed_for: camera, sensor and light, in words.
        seed: of the search.
        kept: rules of [design] that every opening keeps.
    """

    curves: tuple[FrontCurve, ...]
    compared: tuple[JudgedOpening, ...]
    dot_nm: int
    levels: tuple[float, ...]
    lines: tuple[int, ...]
    designed_for: str
    seed: int
    kept: tuple[str, ...] = ()

    @property
    def points(self) -> tuple[FrontPoint, ...]:
        """Those of all curves."""
        return tuple(point for curve in self.curves for point in curve.points)

    @property
    def best(self) -> tuple[FrontPoint, ...]:
        """Those that no other betters, whatever their clear dots."""
        every = self.points
        return tuple(each for each in every if not any(other.betters(each) for other in every))

    def gain_db(self, other: JudgedOpening) -> float | None:
        """Gain of the best opening found over another, both unmapped, at no less footprint, no fewer lines and no more
        clear dots; None where nothing found has them."""
        rivals = [
            each.judged.value
            for each in self.points
            if each.judged.clear_dots <= other.clear_dots
            and each.judged.footprint >= other.footprint - ROUNDING
            and each.judged.lines >= other.lines
        ]
        return max(rivals) - other.value if rivals else None


ROUNDING = 1e-9
"""Shares of a pixel that differ by less are equal."""


def spread(every: Sequence[JudgedOpening], most: int) -> tuple[JudgedOpening, ...]:
    """At most so many of a curve, its ends among them: evenly along it, PSNR falling."""
    last = len(every) - 1
    if len(every) <= most:
        return tuple(every)
    places = sorted({round(k * last / max(1, most - 1)) for k in range(most)})
    return tuple(every[k] for k in places)


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
    found: Pareto, spec: JobSpec, command: str, camera: PhotoCamera = F1, settings: CaptureSettings = F1_SETTINGS
) -> tuple[FrontDesign, ...]:
    """Every design on a curve, curve after curve.

    Args:
        found: by a sweep.
        spec: the job of that sweep, with [design], [emitters] and [pareto].
        command: how a user repeats it.
        camera, settings: of that sweep.
    """
    section = spec.design
    assert isinstance(section, SearchSection)
    named = []
    for curve in found.curves:
        for place, each in enumerate(curve.points, start=1):
            name = f"{section.name[:14]}_{curve.clear_dots}_{place}"
            facts: Facts = {
                **origin(section, command, camera_facts(camera, settings)),
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
