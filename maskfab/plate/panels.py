"""The panel of each die of a job: its cells, how they are turned, and what no panel can be."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from maskfab.cell_size import CellSize
from maskfab.errors import JobError, SourceError
from maskfab.jobfile import DieSection, JobSection, JobSpec, PlateSection
from maskfab.model import Opening, Panel, Stop, Tiling
from maskfab.optics.pupil.aperture import panel_aperture
from maskfab.optics.pupil.pupil import cut
from maskfab.plate import maps
from maskfab.plate.hexagonal import hexagonal_sheet
from maskfab.plate.tiling import orientations
from maskfab.units import NM_PER_UM, to_nm

_MOST_CELLS_ACROSS = 1000
_MOST_DOTS_ACROSS = 10_000


def laid_out(spec: JobSpec, *, where: str) -> tuple[JobSection, PlateSection]:
    """[job] and [plate] of a job that has dies to lay out.

    Raises:
        JobError: MF105 if either or every [[die]] is missing.
    """
    section, heading = spec.plate, spec.job
    if section is None or heading is None or not spec.die:
        missing = "[job]" if heading is None else "[plate]" if section is None else "[[die]]"
        raise JobError("MF105", f"the job has no {missing} section", where=where, cure=f"Add {missing}")
    return heading, section


def die_panels(spec: JobSpec, openings: Mapping[str, tuple[Opening, ...]], *, where: str) -> dict[str, Panel]:
    """The panel of every die, by the die's name.

    Args:
        spec: a validated job with [plate] and at least one [[die]].
        openings: the openings of every die, by the die's name.
        where: the job file, for errors.

    Raises:
        JobError: MF105 if there is nothing to lay out; MF106 or MF107 if a die's pitch is not its dots and gutter, or
            off the grid; MF108 if no cell fits a die; MF114 if a stop is wider than its panel; MF115 for too many dots.
        SourceError: MF309 if nothing is clear inside the stop.
    """
    _, section = laid_out(spec, where=where)
    slot_nm = to_nm(section.die_size, where=f"{where}: plate.die_size", name="die_size")
    stop = spec.camera.camera().stop
    panels = {}
    for i, die in enumerate(spec.die):
        place = f"{where}: die[{i}]"
        given = None if die.map is None else maps.parse_map(spec.maps[die.map], f"{place}.map")
        panel = tiled(die, openings[die.name], _side_nm(die, slot_nm, place), given, where=place)
        check_cover(panel, stop, f"die {die.name!r}", where=place)
        panels[die.name] = panel
    return panels


def _side_nm(die: DieSection, slot_nm: int, where: str) -> int:
    """Side of a die's panel, at most that of its slot."""
    side_nm = slot_nm if die.size is None else to_nm(die.size, where=f"{where}.size", name="size")
    if side_nm > slot_nm:
        raise JobError(
            "MF108",
            f"die {die.name!r} is {side_nm / NM_PER_UM:g} um wide, more than its slot of {slot_nm / NM_PER_UM:g} um",
            where=f"{where}.size",
            cure=f'Use size = "{slot_nm / NM_PER_UM:g} um" or less, or a larger plate.die_size',
        )
    return side_nm


def tiled(die: DieSection, held: tuple[Opening, ...], side_nm: int, given: maps.CellMap | None, *, where: str) -> Panel:
    """The panel of a die, whatever camera looks through it.

    Args:
        die: how it is tiled.
        held: its openings.
        side_nm: of the square that it may fill.
        given: its map, for the tiling of that name.
        where: the die, for errors.

    Raises:
        JobError: as :func:`die_panels`, but for the stop.
    """
    opening, *others = held
    size = CellSize(opening.dots, to_nm(die.dot), to_nm(die.gutter))
    if die.pitch is not None:
        size.require_pitch(die.pitch, where=f"{where}.pitch")
    dot_nm, pitch_nm = size.dot_nm, size.pitch_nm
    cells = side_nm // pitch_nm
    if cells < 1:
        raise JobError(
            "MF108",
            f"die {die.name!r}: one cell of {pitch_nm / NM_PER_UM:g} um does not fit a die of "
            f"{side_nm / NM_PER_UM:g} um",
            where=where,
            cure="Use a larger plate.die_size or a finer dot",
        )
    check_panel_size(cells, opening.dots, f"die {die.name!r}", where=where)
    rows, columns = (cells, cells) if given is None else maps.panel_shape(given, cells, cells)
    if die.tiling is Tiling.HEXAGONAL:
        opening, rows, columns = hexagonal_sheet(opening, side_nm // dot_nm, die.seed or 0), 1, 1
    if given is None:
        chosen = orientations(die.tiling, rows, columns, die.seed, openings=len(held), where=f"{where}.seed")
    else:
        chosen = maps.placed(given, rows, columns, die.seed, openings=len(held), where=f"{where}.map")
    return Panel(opening, dot_nm, size.gutter_nm, chosen, die.tiling, die.seed, others=tuple(others))


def check_cover(panel: Panel, stop: Stop, what: str, *, where: str) -> None:
    """Refuse a panel narrower than the stop behind it, or with nothing clear in front of it (MF114, MF309)."""
    side_um = min(panel.size_nm) / NM_PER_UM
    if side_um < stop.diameter_um:
        raise JobError(
            "MF114",
            f"{what} is {side_um:g} um wide, less than the stop of {stop.diameter_um:g} um",
            where=where,
            cure="Use a larger plate.die_size or a smaller camera.stop",
        )
    check_light(panel, stop, where=where)


def check_panel_size(cells: int, dots: int, what: str, *, where: str) -> None:
    """Refuse a panel of more cells or dots than can be drawn and compared (MF115)."""
    if cells > _MOST_CELLS_ACROSS or cells * dots > _MOST_DOTS_ACROSS:
        raise JobError(
            "MF115",
            f"{what} is {cells} cells or {cells * dots} dots across; the limits are {_MOST_CELLS_ACROSS} cells and "
            f"{_MOST_DOTS_ACROSS} dots",
            where=where,
            cure="Use a smaller panel, or a coarser dot",
        )


def check_light(panel: Panel, stop: Stop, *, where: str) -> None:
    """Refuse a stop, centred on the panel, that nothing clear lies in (MF309)."""
    if stop.shape not in ("circle", "square"):
        if cut(panel_aperture(panel, stop.diameter_um / 2), stop).energy_um2 > 0:
            return
        raise SourceError(
            "MF309",
            f"nothing of the opening {panel.opening.name!r} is clear inside a stop, the {stop.shape} of "
            f"{stop.diameter_um:g} um",
            where=where,
            cure="Increase camera.stop until a clear dot lies in it",
        )
    pitch_um = panel.cell_size.pitch_um
    if stop.diameter_um >= 3 * pitch_um:
        return  # it holds a whole cell, wherever it lies
    rows, columns = panel.orientations.shape
    gaps = []
    for row in range(max(0, rows // 2 - 3), min(rows, rows // 2 + 3)):
        for column in range(max(0, columns // 2 - 3), min(columns, columns // 2 + 3)):
            mask = panel.pattern(int(panel.orientations[row, column]))
            up, right = (
                (cell - cells / 2) * pitch_um + (panel.gutter_nm / 2 + index * panel.dot_nm) / NM_PER_UM
                for cell, cells, index in zip((row, column), (rows, columns), np.nonzero(mask), strict=True)
            )
            dot_um = panel.dot_nm / NM_PER_UM
            away = [np.maximum(0.0, np.maximum(low, -low - dot_um)) for low in (up, right)]
            gaps.append(float((np.hypot(*away) if stop.shape == "circle" else np.maximum(*away)).min()))
    if min(gaps) >= stop.diameter_um / 2:
        raise SourceError(
            "MF309",
            f"nothing of the opening {panel.opening.name!r} is clear inside a stop of {stop.diameter_um:g} um; the "
            f"nearest clear dot is {min(gaps):g} um from its centre",
            where=where,
            cure="Increase camera.stop until a clear dot lies in it",
        )
