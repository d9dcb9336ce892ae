"""Bands of restored photographs over the displays that are made: of a die's PSNR, and of its gain.

The scenes of the report are photographed through the die as full cases of its process make it, in the same noise, and
restored by the filter of the die as drawn, which is all that the maker of a camera knows of a display. The mean PSNR is
expanded as every number is, see :mod:`maskfab.measurement.process_spread`. Dies of one plate are written alike, so that
the gain is the difference of two expansions.

Notes:
    Where the light changes a little, draws of Poisson's distribution are others from some pixel on, and the mean of the
    scenes changes by more than a bias does. Electrons are therefore counted by normal distributions here, and only
    the change from the die as drawn is kept, which is added to the PSNR of the report.
    Edges that move by a share of a part of a dot make it grey. Parts of another width tell the error of that, which
    falls at least as their width does.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from maskfab.camera.design import Design, RestoredBy
from maskfab.camera.die_transfer import MOST_ACROSS, DieTransfer
from maskfab.camera.over_field import OverField
from maskfab.camera.protocol import Protocol, evaluate
from maskfab.errors import JobError
from maskfab.measurement.as_written import parts_about_edges, written_openings
from maskfab.measurement.conditions import Conditions, Surroundings
from maskfab.measurement.process_spread import CORNER, FULL_CASES, Cases, Expansion, ProcessSpread
from maskfab.measurement.restored import Photographs, drawn_scenes, middle_level
from maskfab.measurement.scene_rows import scene_reach_um
from maskfab.measurement.tolerance import Band, sensitivity
from maskfab.model import Camera, Die, Process, Quantity
from maskfab.units import NM_PER_UM

DRAWN = Process(0.0)


@dataclass(frozen=True, eq=False)
class _Photographed:
    """A die whose processes are photographed, each restored by the filter of the die as drawn.

    Attributes:
        die: in front of the camera.
        camera: of the job.
        drawn: the die as drawn.
        conditions: of the photographs.
        half_width_um: of the openings that light comes through; None for those in front of the stop.
        parts: of a dot.
    """

    die: Die
    camera: Camera
    drawn: DieTransfer | OverField
    conditions: Conditions
    half_width_um: float | None
    parts: int

    @cached_property
    def _level_db(self) -> float:
        return middle_level(self.conditions.levels)

    @cached_property
    def _protocol(self) -> Protocol:
        """In noise that follows the light, and with the strength that suits the die as drawn."""
        smooth = replace(self.conditions.protocol, smooth=True)
        return replace(smooth, strengths=(self._scored(smooth, self.drawn)[0],))

    def psnr(self, process: Process, parts: int | None = None) -> float:
        """Mean over the scenes in dB, by so many parts of a dot, or the usual number."""
        parts = parts or self.parts
        openings = written_openings(self.die, self.camera, process, parts, self.half_width_um)
        seen = self.drawn.through(openings, parts)
        return self._scored(self._protocol, RestoredBy(seen, self.drawn))[1]

    def _scored(self, protocol: Protocol, design: Design) -> tuple[float, float]:
        scenes = drawn_scenes(highlights=bool(protocol.brackets))
        found = evaluate([design], scenes, scenes, [self._level_db], protocol=protocol, details=False).scores
        return found[0].epsilon, float(np.mean([score.psnr for score in found]))


def restored_expansion(
    conditions: Conditions, around: Surroundings, die: Die, process: Process, spread: ProcessSpread, where: str = ""
) -> Expansion | str:
    """The change of a die's restored PSNR from the drawing to what the process makes of it, in dB.

    Args:
        conditions: of the job's photographs, by protocol ``camera``.
        around: what lies about the die.
        die: the drawing.
        process: the writer's, as stated.
        spread: of it.
        where: the job's key, for errors.

    Returns:
        The expansion, at the middle level of light; missed are a case wider and rounder, and what the width of
        parts of dots makes of it. A sentence, with its code, where the die cannot be photographed, its dots cannot be
        divided, or they do not bear the spread.
    """
    camera, scene = conditions.camera, around.scene
    assert isinstance(camera, Camera)
    reach = None if scene is None or not scene.gap_um else scene_reach_um(camera, scene)
    try:
        drawn, _ = conditions.design(die.name, die.panel, around)
        parts, others = parts_about_edges(die, camera, spread.moved(process, 2, 0), where)
        across = max(parts, others) * camera.stop.diameter_um / (die.panel.dot_nm / NM_PER_UM)
        if across > MOST_ACROSS:
            return f"the stop is {across:.0f} parts of dots across, photographs take {MOST_ACROSS} at most"
        assert isinstance(drawn, DieTransfer | OverField)
        seen = _Photographed(die, camera, drawn, conditions, reach, parts)
        stated = seen.psnr(process)
    except JobError as refusal:
        return f"{refusal.code} {refusal.what}"
    corner = spread.moved(process, *CORNER)
    cases = Cases.about(process, spread, seen.psnr, stated)
    found = cases.expansion(np.array)
    by_others = seen.psnr(corner, others) - seen.psnr(process, others)
    # As of an error in proportion to the width of parts.
    by_parts = others / (parts - others) * (cases.corner - stated - by_others)
    drawn_psnr = stated if process == DRAWN else seen.psnr(DRAWN)
    return Expansion(stated - drawn_psnr, found.terms, (*found.missed, by_parts))


def restored_bands(
    photographs: Photographs, name: str, changes: Mapping[str, Expansion | str], process: Process, spread: ProcessSpread
) -> Iterator[Quantity]:
    """The bands of a die's PSNR and gain, and its sensitivity, as rows of a report.

    Args:
        photographs: of the report.
        name: of the die.
        changes: of every die, of :func:`restored_expansion`.
        process: the writer's, as stated.
        spread: of it.
    """
    own, level = changes[name], middle_level(photographs.conditions.levels)
    if isinstance(own, str):
        yield Quantity("band_restored_psnr", None, f"not found: {own}", die=name, level_db=level)
        return
    how = (
        f"expansion to second order from {FULL_CASES} full cases about the process stated, kissing corners fused, "
        "photographed in the same noise and restored by the filter of the die as drawn; error: what it misses of a "
        "case wider and rounder, and what the width of the parts of dots makes of it"
    )
    band = _band("band_restored_psnr", photographs.dies[name].psnr(level), own, process, spread)
    yield band.row(name, spread, how, level)
    if spread.bias_um:
        yield sensitivity("sensitivity_restored_psnr", band, name, spread, level)
    reference = photographs.reference
    of_reference = None if reference is None else changes.get(reference)
    for gain in photographs.gains[name]:
        if gain.level_db == level and isinstance(of_reference, Expansion):
            band = _band("band_restored_gain", gain.psnr.mean, own - of_reference, process, spread)
            yield band.row(name, spread, f"{how}; {reference} is written alike", level)


def _band(name: str, drawn: float, change: Expansion, process: Process, spread: ProcessSpread) -> Band:
    """The band of a number of the die as drawn that changes."""
    return Band.of(name, None, replace(change, nominal=drawn + change.nominal), process, spread)
