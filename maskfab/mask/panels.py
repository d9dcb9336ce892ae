"""Panels: the cells of each die of a job, how they are turned, and what no panel can be.

Orientation maps are TOML files that say which way every cell round the optical axis is turned, a drawing with its facts
beside it::

    name = "bar_map"
    map = '''
    0415
    7726
    '''                        # elements of D4, 0 to 7 as in model.orient, the top row first, centred on the axis
    openings = '''
    0010
    0000
    '''                        # optional: which of a die's openings each cell holds, 0 to 9 and a to e
    shifts = [[0, 0], [2, 0]]  # optional: those openings are the die's one, moved right and up by so many dots
    beyond = [1, 0]            # optional: opening and element of D4 of every cell round the map
    [provenance]
    author = "..."             # any keys; text and numbers

The middle of a map is the middle of its panel, so a panel has an even number of rows if its map has, and an odd number
if its map has; columns alike. Cells round a map are those of a regular display where the map says what they hold.
Elsewhere, and in a random tiling, a seed draws how cells are turned, and wires laid across a die may find no way in
what it draws. A file names the seeds that were tried in its provenance: ``die_seeds_fit = "1 2"``, and
``die_seeds_unfit = "0"``. A die that states no seed takes the first that fits.

Turns by 60 degrees do not carry a square grid of dots into itself, so hexagonal cells are sampled as one sheet of dots
for a whole panel: a dot is clear where its middle, carried back into the unit, falls on a clear dot. Edges that lie off
the grid move by up to half a dot, and the clear area of a cell changes by a few dots from turn to turn."""

from __future__ import annotations

import math
import os
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from maskfab.base.arrays import Labels
from maskfab.base.cell_size import CellSize
from maskfab.base.checks import checked_arguments
from maskfab.base.errors import AtFault, Faults, JobError, SourceError
from maskfab.base.model import ORIENTATIONS, Opening, Panel, Scalar, Tiling, frozen
from maskfab.base.units import NM_PER_MM, NM_PER_UM, to_nm
from maskfab.job.camera import Stop
from maskfab.job.die import DieSection
from maskfab.job.values import check_name
from maskfab.mask.opening_file import at_key, facts_of, provenance_lines, provenance_of, quoted
from maskfab.mask.opening_masks import drawn_lines
from maskfab.optics.pupil import cut, panel_aperture
from maskfab.optics.tiling import MOST_OPENINGS, orientations

if TYPE_CHECKING:
    from maskfab.job.sections import JobSection, JobSpec, PlateSection

TURNS = 6


def hexagonal_sheet(opening: Opening, dots: int, seed: int) -> Opening:
    """A square sheet of hexagonal cells as one opening.

    Cells are as wide from flat to flat as the opening; rows are sqrt(3)/2 of that apart, every other one shifted by
    half a cell. A dot belongs to the nearest cell's centre; what the unit has outside the hexagon is never seen.

    Args:
        dots: along a side of the sheet.
        seed: of ``numpy.random.default_rng``, which draws every cell's turn.
    """
    width = opening.dots
    rise = width * math.sqrt(3) / 2
    rows, columns = math.ceil(dots / rise) + 3, math.ceil(dots / width) + 3
    turn = np.random.default_rng(seed).integers(TURNS, size=(rows, columns))
    middle = np.arange(dots) + 0.5 - dots / 2
    x, y = np.broadcast_to(middle, (dots, dots)), np.broadcast_to(middle[:, None], (dots, dots))
    best = np.full((dots, dots), np.inf)
    right, up, cell_turn = (np.zeros((dots, dots)) for _ in range(3))
    # The nearest centre is in the row below or above a dot.
    below = np.floor(y / rise)
    for row in (below, below + 1):
        shift = width / 2 * (row % 2)
        column = np.rint((x - shift) / width)
        away_x, away_y = x - shift - column * width, y - row * rise
        distance = away_x**2 + away_y**2
        nearer = distance < best
        best[nearer] = distance[nearer]
        chosen = turn[(row.astype(int) + rows // 2) % rows, (column.astype(int) + columns // 2) % columns]
        for nearest, other in ((right, away_x), (up, away_y), (cell_turn, chosen)):
            nearest[nearer] = other[nearer]
    angle = -np.pi / 3 * cell_turn
    unit_x = np.floor(right * np.cos(angle) - up * np.sin(angle) + width / 2).astype(int)
    unit_y = np.floor(right * np.sin(angle) + up * np.cos(angle) + width / 2).astype(int)
    inside = (unit_x >= 0) & (unit_x < width) & (unit_y >= 0) & (unit_y < width)
    mask = np.zeros((dots, dots), dtype=np.bool_)
    mask[inside] = opening.mask[unit_y[inside], unit_x[inside]]
    provenance = {**opening.provenance, "sheet": f"hexagonal lattice, seed {seed}"}
    return Opening(f"{opening.name[:18]}_HEX", mask, opening.dot_nm, provenance)


_FIT, _UNFIT = "die_seeds_fit", "die_seeds_unfit"


@dataclass(frozen=True)
class DieSeeds:
    """Seeds that were tried of a die, ascending by fit and unfit."""

    fit: tuple[int, ...]
    unfit: tuple[int, ...] = ()

    @classmethod
    def of(cls, facts: Mapping[str, object]) -> DieSeeds | None:
        """Seeds by the provenance of a map or an opening; None where it names none that fits."""
        fit, unfit = (_seeds(facts.get(key)) for key in (_FIT, _UNFIT))
        return cls(fit, unfit) if fit else None

    @property
    def facts(self) -> dict[str, str]:
        """Provenance that names them."""
        named = {_FIT: self.fit, _UNFIT: self.unfit}
        return {key: " ".join(map(str, sorted(seeds))) for key, seeds in named.items() if seeds}

    def against(self, seed: int, name: str) -> str | None:
        """Sentence on a die of another seed; None for one that fits, and where every seed that was tried does."""
        if seed in self.fit or not self.unfit:
            return None
        tried = "does not fit" if seed in self.unfit else "was not tried on"
        return (
            f"the display {tried} a die of seed {seed}: by {name} it fits with {_listed(self.fit)}, and not with "
            f"{_listed(self.unfit)}"
        )


def _seeds(value: object) -> tuple[int, ...]:
    """Whole numbers of a text; none of anything else, since provenance may hold any text."""
    words = str(value).split() if value is not None else []
    return tuple(sorted({int(word) for word in words})) if all(word.isdecimal() for word in words) else ()


def _listed(seeds: Iterable[int]) -> str:
    *first, last = map(str, seeds)
    return f"{', '.join(first)} and {last}" if first else last


_KEYS = ("name", "map", "openings", "shifts", "beyond", "provenance")
_ELEMENTS = "01234567"
_OPENINGS = "0123456789abcde"[:MOST_OPENINGS]
_MOST_CELLS = 1000
_LONGEST_NAME = 24

Shift = tuple[int, int]
"""Right and up, in whole dots."""


@dataclass(frozen=True, eq=False, repr=False)
class CellMap:
    """Orientation map: contents of the cells round the axis.

    Attributes:
        cells: int8 [rows, columns], 8 u + k for a die's opening u under element k of D4, row 0 the lowest.
        provenance: who made it, with which command, seed and version.
        shifts: (right, up) in dots for every opening of the map, which is the die's one opening moved by that; empty
            where the openings are the die's own.
        beyond: what every cell round the map holds, 8 u + k; None where a seed draws it.
    """

    name: str
    cells: Labels
    provenance: Mapping[str, str | int | float] = field(default_factory=dict)
    shifts: tuple[Shift, ...] = ()
    beyond: int | None = None

    def __post_init__(self) -> None:
        object.__setattr__(self, "cells", frozen(np.asarray(self.cells, dtype=np.int8)))

    def __repr__(self) -> str:
        rows, columns = self.cells.shape
        return f"<CellMap {self.name}: {columns} x {rows} cells>"


@checked_arguments
def read_map(path: str | Path) -> CellMap:
    """The map held by a TOML file.

    Raises:
        SourceError: MF301 missing, MF302 empty, MF304 not text, MF308 another suffix.
    """
    path = Path(path)
    where = str(path)
    if not os.path.isfile(path):
        what = "the map's file does not exist"
        raise SourceError("MF301", what, where=where, cure="Give the path of a map (.toml), relative to the job file")
    if path.suffix.lower() != ".toml":
        raise SourceError("MF308", f"no map is read from a {path.suffix} file", where=where, cure="A map ends in .toml")
    content = path.read_bytes()
    if not content.strip():
        cure = "Write the map again; layouts/maps/bar.toml shows how one looks"
        raise SourceError("MF302", f"{len(content)} bytes and no content", where=where, cure=cure)
    try:
        text = content.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        raise SourceError("MF304", f"the file is not text: {error}", where=where, cure="Save it as UTF-8") from None
    return parse_map(text, where)


def parse_map(text: str, where: str = "") -> CellMap:
    """The map that a TOML text describes; ``where`` names the text in errors.

    Raises:
        JobError: MF101 no TOML, MF102 an unknown key, MF105 a missing one or one of the wrong type, MF110 a refused
            name, MF115 too large, MF122 a drawing with another digit or with rows of different lengths.
    """
    facts = facts_of(text, "A map", _KEYS, where)
    name = _text(facts, "name", where)
    check_name(name, where=at_key(where, "name"))
    cells = _digits(_text(facts, "map", where), _ELEMENTS, at_key(where, "map"))
    if "openings" in facts:
        place = at_key(where, "openings")
        held = _digits(_text(facts, "openings", where), _OPENINGS, place)
        if held.shape != cells.shape:
            what = (
                f"{held.shape[0]} rows of {held.shape[1]} openings for a map of {cells.shape[0]} rows of "
                f"{cells.shape[1]} cells"
            )
            raise JobError("MF122", what, where=place, cure="Give as many rows and columns as the map has cells")
        cells = cells + ORIENTATIONS * held
    shifts = _shifts(facts.get("shifts", []), at_key(where, "shifts"))
    beyond = _beyond(facts.get("beyond"), at_key(where, "beyond"))
    most = max(int(cells.max()), beyond or 0) // ORIENTATIONS
    if shifts and most >= len(shifts):
        what = f"the map asks for opening {most}, counted from 0, and there are {len(shifts)} shifts"
        cure = "Give one for each opening, [0, 0] for one that stays"
        raise JobError("MF122", what, where=at_key(where, "shifts"), cure=cure)
    return CellMap(name, cells, provenance_of(facts, where), shifts, beyond)


def map_text(cells: CellMap) -> str:
    """The map as TOML text; ``parse(dumps(m))`` is equal in all parts."""
    held, turned = np.divmod(cells.cells, ORIENTATIONS)
    lines = [f"name = {quoted(cells.name)}", 'map = """', *drawn_lines(turned, _ELEMENTS), '"""']
    if held.any():
        lines += ['openings = """', *drawn_lines(held, _OPENINGS), '"""']
    if cells.shifts:
        lines.append(f"shifts = {[list(shift) for shift in cells.shifts]}")
    if cells.beyond is not None:
        lines.append(f"beyond = {list(divmod(cells.beyond, ORIENTATIONS))}")
    return "\n".join([*lines, *provenance_lines(cells.provenance)]) + "\n"


def panel_shape(cells: CellMap, rows: int, columns: int) -> tuple[int, int]:
    """Rows and columns of a panel about this map: those that there is room for, or one less."""
    have = cells.cells.shape
    return rows - (rows - have[0]) % 2, columns - (columns - have[1]) % 2


def shifted(pattern: NDArray[Scalar], shift: Shift) -> NDArray[Scalar]:
    """The pattern [dots, dots] moved right and up; what leaves the cell is lost, and what comes in is 0."""
    right, up = shift
    rows, columns = pattern.shape
    moved = np.zeros_like(pattern)
    (low, low_from), (left, left_from) = ((max(0, step), max(0, -step)) for step in (up, right))
    high, wide = max(0, rows - abs(up)), max(0, columns - abs(right))
    moved[low : low + high, left : left + wide] = pattern[low_from : low_from + high, left_from : left_from + wide]
    return moved


def shifted_openings(cells: CellMap, held: tuple[Opening, ...], *, where: str) -> tuple[Opening, ...]:
    """The openings that a map chooses among: those of its die, or the die's one moved by each of the map's shifts.

    A moved one has the name of the first with its number behind it.

    Raises:
        JobError: MF122 if a map with shifts belongs to a die of several openings, or moves a clear dot out of its cell;
            MF119 if it moves an opening with drawn emitters.
    """
    if not cells.shifts:
        return held
    opening, *others = held
    if others:
        what = f"the map {cells.name!r} moves one opening, and the die has {len(held)}"
        raise JobError("MF122", what, where=where, cure="Remove the die's key others, or the map's shifts")
    if opening.emitters is not None and any(shift != (0, 0) for shift in cells.shifts):
        what = f"the map {cells.name!r} moves the opening {opening.name!r}, whose emitters are drawn where it stands"
        raise JobError("MF119", what, where=where, cure="Use an opening without emitters, or a map without shifts")
    openings = []
    for number, shift in enumerate(cells.shifts):
        if shift == (0, 0):
            openings.append(opening)
            continue
        mask = shifted(opening.mask, shift)
        if mask.sum() < opening.clear_dots:
            right, up = shift
            what = (
                f"the map {cells.name!r} moves {opening.clear_dots - int(mask.sum())} clear dots of {opening.name!r} "
                f"out of the cell: {right} right, {up} up"
            )
            raise JobError("MF122", what, where=where, cure="Use the opening that the map was made for")
        suffix = f"_{number}"
        name = opening.name[: _LONGEST_NAME - len(suffix)] + suffix
        openings.append(replace(opening, name=name, mask=mask))
    return tuple(openings)


def placed(cells: CellMap, rows: int, columns: int, seed: int | None, *, openings: int, where: str) -> Labels:
    """Contents of each cell of a panel, int8 [rows, columns]: the map in the middle, round it what the map says.

    Where it says nothing, that is drawn at random. A map larger than the panel loses its rim.

    Args:
        rows: of the panel; :func:`panel_shape` has the right ones.

    Raises:
        JobError: MF111 without a seed that is needed; MF122 if the map and the panel cannot share their middle, or the
            map has more openings than the die.
    """
    for have, room, what in zip(cells.cells.shape, (rows, columns), ("rows", "columns"), strict=True):
        if (have - room) % 2 or room < 1:
            raise JobError(
                "MF122",
                f"the map {cells.name!r} has {have} {what} and the panel {room}: its middle would not be on the axis",
                where=where,
                cure=f"Use a panel of {have} {what}, or of an even number more",
            )
    most = max(int(cells.cells.max()), cells.beyond or 0) // ORIENTATIONS
    if most >= openings:
        raise JobError(
            "MF122",
            f"the map {cells.name!r} asks for opening {most}, counted from 0, and the die has {openings}",
            where=where,
            cure="Name the others in the die's key others, or draw a map of fewer",
        )
    if cells.beyond is None:
        panel = orientations(Tiling.RANDOM, rows, columns, seed, openings=openings, where=where).copy()
    else:
        panel = np.full((rows, columns), cells.beyond, dtype=np.int8)
    (bottom, low), (left, first) = (
        (max(0, (room - have) // 2), max(0, (have - room) // 2))
        for have, room in zip(cells.cells.shape, (rows, columns), strict=True)
    )
    part = cells.cells[low : low + rows, first : first + columns]
    panel[bottom : bottom + part.shape[0], left : left + part.shape[1]] = part
    return panel


def _digits(text: str, digits: str, where: str) -> Labels:
    rows = [(number, line.strip()) for number, line in enumerate(text.splitlines(), start=1) if line.strip()]
    if not rows:
        what = "the map has 0 rows"
        raise JobError("MF122", what, where=where, cure=f"Draw it in digits {digits[0]} to {digits[-1]}")
    width = len(rows[0][1])
    for number, row in rows:
        wrong = next((place for place, character in enumerate(row) if character not in digits), None)
        if wrong is not None:
            what = f"line {number}, column {wrong + 1}: {row[wrong]!r} is none of {digits}"
            raise JobError("MF122", what, where=where, cure="Replace it by one of these digits")
        if len(row) != width:
            what = f"line {number} has {len(row)} cells where the first has {width}"
            raise JobError("MF122", what, where=where, cure=f"Give every line {width} digits")
    if max(len(rows), width) > _MOST_CELLS:
        what = f"the map is {len(rows)} x {width} cells; the limit is {_MOST_CELLS} along a side"
        raise JobError("MF115", what, where=where, cure="Draw only the cells over the stop")
    return np.array([[digits.index(character) for character in row] for _, row in reversed(rows)], dtype=np.int8)


def _text(facts: Mapping[str, Any], key: str, where: str) -> str:
    value = facts.get(key)
    if not isinstance(value, str):
        what = f"{key} = {value!r} is not text" if key in facts else f"the key {key!r} is missing"
        raise JobError("MF105", what, where=at_key(where, key), cure=f"A map has: {', '.join(_KEYS)}")
    return value


def _shifts(stated: object, where: str) -> tuple[Shift, ...]:
    def whole(value: object) -> bool:
        return isinstance(value, int) and not isinstance(value, bool)

    if not isinstance(stated, list) or any(
        not isinstance(pair, list) or len(pair) != 2 or not all(map(whole, pair)) for pair in stated
    ):
        what = "shifts is not a list of pairs of whole numbers"
        raise JobError("MF105", what, where=where, cure="Write [[0, 0], [2, 0]]")
    if len(stated) > MOST_OPENINGS:
        raise JobError("MF122", f"{len(stated)} shifts are more than {MOST_OPENINGS}", where=where, cure="Use fewer")
    return tuple((right, up) for right, up in stated)


def _beyond(stated: object, where: str) -> int | None:
    """Opening and element of D4 as one number."""
    if stated is None:
        return None
    if not isinstance(stated, list) or [type(number) for number in stated] != [int, int]:
        cure = "Write [0, 0] for the first opening, not turned"
        raise JobError("MF105", "beyond is not a pair of whole numbers", where=where, cure=cure)
    held, turn = stated
    if not (0 <= held < MOST_OPENINGS and 0 <= turn < ORIENTATIONS):
        what = (
            f"beyond = {stated} is no opening of 0 to {MOST_OPENINGS - 1} under an element of 0 to {ORIENTATIONS - 1}"
        )
        raise JobError("MF122", what, where=where, cure="Write [0, 0] for the first opening, not turned")
    return int(ORIENTATIONS * held + turn)


_MOST_CELLS_ACROSS = 1000
_MOST_DOTS_ACROSS = 10_000


def laid_out(spec: JobSpec, *, where: str) -> tuple[JobSection, PlateSection]:
    """[job] and [plate] of a job that has dies to lay out.

    Raises:
        JobError: MF105 if either or every [[die]] is missing.
    """
    section, heading = spec.plate, spec.job
    if section is None or heading is None or not spec.die:
        parts = {"[job]": heading, "[plate]": section, "[[die]]": spec.die}
        missing = ", ".join(name for name, part in parts.items() if not part)
        raise JobError("MF105", f"the job has no {missing} section", where=where, cure=f"Add {missing}")
    return heading, section


def die_panels(spec: JobSpec, openings: Mapping[str, tuple[Opening, ...]], *, where: str) -> dict[str, Panel]:
    """The panel of every die, by the die's name.

    Raises:
        JobError: MF105 if there is nothing to lay out; MF106 or MF107 if a die's pitch is not its dots and gutter, or
            off the grid; MF108 if no cell fits a die; MF114 if a stop is wider than its panel, or
            than a map that shares light between openings; MF115 for too many dots.
        SourceError: MF309 if nothing is clear inside the stop.
    """
    _, section = laid_out(spec, where=where)
    slot_nm = to_nm(section.die_size, where=f"{where}: plate.die_size", name="die_size")
    stop = spec.camera.stop
    panels, faults = {}, Faults()
    for i, die in enumerate(spec.die):
        with faults:
            place = f"{where}: die[{i}]"
            given = None if die.map is None else parse_map(spec.maps[die.map], f"{place}.map")
            panel = tiled(die, openings[die.name], _side_nm(die, slot_nm, place), given, where=place)
            check_cover(panel, stop, f"die {die.name!r}", where=place)
            if given is not None and die.others is not None:
                check_map(given, panel, stop, f"die {die.name!r}", where=f"{place}.map")
            panels[die.name] = panel
    faults.refuse()
    if len(panels) < len(spec.die):
        raise AtFault
    return panels


def _side_nm(die: DieSection, slot_nm: int, where: str) -> int:
    side_nm = slot_nm if die.size is None else to_nm(die.size, where=f"{where}.size", name="size")
    if side_nm > slot_nm:
        what = f"die {die.name!r} is {side_nm / NM_PER_UM:g} um wide, more than its slot of {slot_nm / NM_PER_UM:g} um"
        cure = f'Use size = "{slot_nm / NM_PER_UM:g} um" or less, or a larger plate.die_size'
        raise JobError("MF108", what, where=f"{where}.size", cure=cure)
    return side_nm


def check_alike(held: tuple[Opening, ...], where: str) -> None:
    """Cells that choose among openings are of one size."""
    for opening in held[1:]:
        if opening.dots != held[0].dots:
            what = (
                f"the opening {opening.name!r} has {opening.dots} dots a side, and {held[0].name!r} has {held[0].dots}"
            )
            raise JobError("MF122", what, where=where, cure="Choose among openings of one size")


def tiled(die: DieSection, held: tuple[Opening, ...], side_nm: int, given: CellMap | None, *, where: str) -> Panel:
    """The panel of a die, whatever camera looks through it.

    Args:
        side_nm: of the square that it may fill.
    """
    opening, *others = held
    size = CellSize(opening.dots, to_nm(die.dot), to_nm(die.gutter))
    if die.pitch is not None:
        size.require_pitch(die.pitch, where=f"{where}.pitch")
    dot_nm, pitch_nm = size.dot_nm, size.pitch_nm
    cells = side_nm // pitch_nm
    if cells < 1:
        what = (
            f"die {die.name!r}: one cell of {pitch_nm / NM_PER_UM:g} um does not fit a die of "
            f"{side_nm / NM_PER_UM:g} um"
        )
        raise JobError("MF108", what, where=where, cure="Use a larger plate.die_size or a finer dot")
    check_panel_size(cells, opening.dots, pitch_nm, f"die {die.name!r}", where=where)
    rows, columns = (cells, cells) if given is None else panel_shape(given, cells, cells)
    if die.tiling is Tiling.HEXAGONAL:
        opening, rows, columns = hexagonal_sheet(opening, side_nm // dot_nm, die.seed or 0), 1, 1
    if given is None:
        chosen = orientations(die.tiling, rows, columns, die.seed, openings=len(held), where=f"{where}.seed")
    else:
        chosen = placed(given, rows, columns, die.seed, openings=len(held), where=f"{where}.map")
    return Panel(opening, dot_nm, size.gutter_nm, chosen, die.tiling, die.seed, others=tuple(others))


def laid_over(opening: Opening, stop: Stop) -> Panel:
    """An opening that was given alone: all its cells alike, an even number of them, over a stop."""
    size = opening.cell_size
    cells = 2 * math.ceil(stop.diameter_um * NM_PER_UM / 2 / size.pitch_nm)
    return Panel(opening, size.dot_nm, size.gutter_nm, np.zeros((cells, cells), np.int8), Tiling.PERIODIC, None)


def periodic_note(opening: str, size_um: float | None) -> str:
    """Tiling of an opening that was given alone, and how to get another."""
    size = "" if size_um is None else f", size='{size_um:g} um'"
    way = f"Panel.tile(opening, tiling='random', seed=1{size})"
    return f"{opening} is tiled periodically, all its pixels alike; {way} turns them"


def lacks_pitch(given: NDArray[Any], where: str) -> JobError:
    """The refusal of an array in place of a panel."""
    what = f"an array of shape {given.shape} states neither pitch nor tiling"
    cure = 'Lay it out: Panel.tile(array, pitch="168 um", size="4.4 mm")'
    return JobError("MF105", what, where=where, cure=cure)


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


def check_map(given: CellMap, panel: Panel, stop: Stop, what: str, *, where: str) -> None:
    """Refuse a map of several openings that is smaller than the stop: it says who has how much of the light (MF114)."""
    side_um = min(given.cells.shape) * panel.pitch_nm / NM_PER_UM
    if side_um < stop.diameter_um:
        raise JobError(
            "MF114",
            f"the map of {what}, which shares light between {len(panel.openings)} openings, is {side_um:g} um wide, "
            f"less than the stop of {stop.diameter_um:g} um",
            where=where,
            cure="Design the map for this camera, or use a smaller camera.stop",
        )


def check_panel_size(cells: int, dots: int, pitch_nm: int, what: str, *, where: str) -> None:
    """Refuse a panel of more cells or dots than can be drawn and compared (MF115)."""
    most = min(_MOST_CELLS_ACROSS, _MOST_DOTS_ACROSS // dots)
    if cells > most:
        raise JobError(
            "MF115",
            f"{what} is {cells} cells or {cells * dots} dots across; the limits are {_MOST_CELLS_ACROSS} cells and "
            f"{_MOST_DOTS_ACROSS} dots",
            where=where,
            cure=f"Use a panel of at most {most} cells, which is {most * pitch_nm / NM_PER_MM:g} mm, or a coarser dot",
        )


def check_light(panel: Panel, stop: Stop, *, where: str) -> None:
    """Refuse a stop, centred on the panel, that nothing clear lies in (MF309)."""
    if stop.shape not in ("circle", "square"):
        if cut(panel_aperture(panel, stop.diameter_um / 2), stop).energy_um2 > 0:
            return
        what = (
            f"nothing of the opening {panel.opening.name!r} is clear inside a stop, the {stop.shape} of "
            f"{stop.diameter_um:g} um"
        )
        raise SourceError("MF309", what, where=where, cure="Increase camera.stop until a clear dot lies in it")
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
        what = (
            f"nothing of the opening {panel.opening.name!r} is clear inside a stop of {stop.diameter_um:g} um; the "
            f"nearest clear dot is {min(gaps):g} um from its centre"
        )
        raise SourceError("MF309", what, where=where, cure="Increase camera.stop until a clear dot lies in it")
