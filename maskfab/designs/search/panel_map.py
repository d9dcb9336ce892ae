"""The map of a chosen opening: one opening turned and moved from cell to cell, or two of which one is denser."""

from __future__ import annotations

from dataclasses import dataclass
from functools import partial

import numpy as np

from maskfab.base.arrays import Floats, Mask
from maskfab.base.model import ORIENTATIONS
from maskfab.base.processes import SerialExecutor
from maskfab.base.work import Clock
from maskfab.designs.maps.alternation import joint, laid
from maskfab.designs.maps.light import Graded, graded
from maskfab.designs.maps.orientation_map import FIRST_STEPS, DesignedMap, MapMode
from maskfab.designs.maps.shares import Denser
from maskfab.designs.model.expected_psnr import Surrogate
from maskfab.designs.model.layouts_bound import layout_gap
from maskfab.designs.model.panel_judgement import MeanPanelError, PanelError
from maskfab.designs.rules.constraints import Constraints
from maskfab.designs.rules.display_fit import DieFit
from maskfab.designs.search.question import Prepared
from maskfab.designs.search.result import Facts, by_level
from maskfab.designs.search.shortlist import MOST_WORK, Listed
from maskfab.job.sections import SearchSection
from maskfab.mask.panels import CellMap

_LONGEST_NAME = 24

_KICKS = 3

_MOST_GUARDED = 32
"""Cells along a side of a map up to which it is looked after at every step: of 60, a look takes half a second."""


@dataclass(frozen=True, eq=False)
class Mapped:
    """A panel's opening and its map.

    Attributes:
        unit: bool [dots, dots]; of two, the denser one.
        cells, designed: the map; None where none was asked for.
        outer: the sparser one of two, bool [dots, dots].
        psnr: expected restored PSNR in dB by level of a panel of two; one is judged without its panel, and has None.
        head_room: by level, dB that no layout of as much light in every cell can gain over the map; None without one,
            for groups, over several distances, of many dots, and where the budget leaves no time for bounds.
        fit: of the display on a die, for a panel of two that must hold one.
    """

    unit: Mask
    cells: CellMap | None = None
    designed: DesignedMap | None = None
    outer: Mask | None = None
    psnr: tuple[float, ...] | None = None
    head_room: tuple[float, ...] | None = None
    notes: tuple[str, ...] = ()
    cut: bool = False
    fit: DieFit | None = None


def mapped(ready: Prepared, chosen: Listed) -> Mapped:
    """Lay the chosen opening out as the section says.

    A map whose time is over is taken as it is after its first steps, which bring most of the gain.

    Raises:
        JobError: MF115 for a map of too many cells, or of cells of too many dots; MF123 for openings that break the
            rules beside one another, or at the places that they were to be moved to.
    """
    section, error, unit, rules = ready.section, ready.panel, chosen.shape.unit, chosen.rules
    if section.map is None or error is None:
        return Mapped(unit)
    if section.density is not None:
        return _of_two(ready, unit, rules, error)
    return _of_one(ready, chosen, error, MapMode(section.map))


def _of_one(ready: Prepared, chosen: Listed, error: PanelError, mode: MapMode) -> Mapped:
    """A map of one opening, going on from its quick map if there is one."""
    section, rules, guard, begun = ready.section, chosen.rules, chosen.guard, chosen.begun
    clock, executor = ready.stages.map, ready.question.executor
    limit = max(FIRST_STEPS, MOST_WORK // error.lattice.side**2)
    lay_out = partial(
        joint,
        chosen.shape.unit,
        error,
        rules,
        rounds=section.joint if guard is None else 0,
        seed=section.drawn_seed,
        mode=mode,
        positions=section.positions,
        clock=clock,
        progress=ready.question.progress,
    )
    if chosen.alike:
        start = np.zeros((error.cells, error.cells), dtype=np.int8)
        both = lay_out(kicks=0, start=start, holds=lambda cells: not cells.any(), steps=1)
    else:
        both = lay_out(
            kicks=_kicks(rules, clock),
            start=None if begun is None else begun.orientations,
            shifts=() if begun is None else begun.shifts,
            steps=limit if rules["emitters"] else None,
        )
    if guard is not None and not guard(both.designed.orientations):
        mended = guard.mended(both.designed.orientations)
        steps = limit if error.cells <= _MOST_GUARDED else FIRST_STEPS
        both = lay_out(kicks=0, start=mended, holds=guard, steps=steps)
    cut = f"{clock.ender} ended the map after {both.designed.fields} steps of its last descent."
    notes = (cut,) if clock.over else ()
    if chosen.alike:
        notes = (*notes, "In no other map that was designed were all lines found: all cells are laid alike.")
    pupil, bounded = laid(both.unit, both.designed, error), ready.stages.bounded
    room = _head_room(ready.judges.estimate, error, pupil, executor) if bounded else None
    facts = {**ready.made, **({} if room is None else by_level("head_room", room, error.levels))}
    cells = map_of(section, error, both.designed, facts)
    return Mapped(both.unit, cells, both.designed, head_room=room, notes=notes, cut=clock.over)


def _kicks(rules: Constraints, clock: Clock) -> int:
    return 0 if clock.over else 1 if rules["emitters"] else _KICKS


def _of_two(ready: Prepared, unit: Mask, rules: Constraints, error: PanelError) -> Mapped:
    """A map of two openings, the denser one in the middle."""
    section, clock, progress = ready.section, ready.stages.map, ready.question.progress
    kicks, seed = _kicks(rules, clock), section.drawn_seed
    notes = ("Time ran out: each map got one pass of its search.",) if clock.over else ()
    room = None
    assert section.density is not None
    asked = Denser(section.density, section.outer_dots)
    kept = rules.on_any_map if asked.sought else rules
    made = graded(unit, error, asked, ready.of_count, constraints=kept, seed=seed, kicks=kicks, progress=progress)
    if ready.stages.bounded:
        pupil = error.laid(made.units, made.designed.orientations)
        room = _head_room(ready.judges.estimate, error, pupil, ready.question.executor)
    return _priced_by_the_display(ready, made, error, notes, room)


def _priced_by_the_display(
    ready: Prepared, made: Graded, error: PanelError, notes: tuple[str, ...], room: tuple[float, ...] | None
) -> Mapped:
    section = ready.section
    facts = {
        **ready.made,
        **by_level("graded_gain_db", made.gain_db, error.levels),
        "emitter_share_uniform": round(made.uniform_share, 4),
        "emitter_share": round(made.share, 4),
        "emitter_life_ratio": round(made.life_ratio, 4),
    }
    price = (
        f"The display pays for the denser middle: emitters, alike in all cells, of {made.share:.1%} of the pixel in "
        f"each colour instead of {made.uniform_share:.1%}, which live {made.life_ratio:.2f} as long at equal luminance."
    )
    if made.denser_cells:
        facts["denser_cells"] = made.denser_cells
        inner, outer = (int(unit.sum()) for unit in made.units)
        price = f"{made.denser_cells} cells behind the stop hold {inner} dots, the others {outer}. {price}"
    if made.grain is not None:
        facts["slow_grain"] = round(made.grain, 4)
        price += f" The slow grain of an even field is {made.grain:.3f}, its pixels turned at random."
    if made.lines is not None:
        facts["lines"] = made.lines
        price += f" {made.lines} lines each way pass both openings."
    facts |= {} if room is None else by_level("head_room", room, error.levels)
    cells = map_of(section, error, made.designed, facts)
    dense, sparse = made.units
    notes, cut = (*notes, price), bool(notes)
    return Mapped(dense, cells, made.designed, sparse, made.designed.psnr, room, notes, cut=cut, fit=made.fit)


def _head_room(
    estimate: Surrogate, error: PanelError, pupil: Floats, executor: SerialExecutor
) -> tuple[float, ...] | None:
    """Decibels by level that no layout of as much light in every cell gains; None where no bound is known."""
    # What bounds a panel in focus bounds no mean over distances.
    gap = None if isinstance(error, MeanPanelError) else layout_gap(estimate, pupil, executor=executor)
    return None if gap is None else gap.head_room


def map_of(section: SearchSection, error: PanelError, designed: DesignedMap, facts: Facts) -> CellMap:
    """A designed map under its name, with its provenance added to that of its opening."""
    light = round(designed.clear_dots / designed.start_clear_dots - 1, 5) + 0.0
    facts = {
        **facts,
        "mode": designed.mode.value,
        **by_level("gain_db", designed.gain_db, error.levels),
        "light": light,
    }
    # Round it lies a regular display, of the opening that lies at its rim: wires go straight on, and none is drawn.
    beyond = 0 if designed.shifts else int(designed.orientations.max()) // ORIENTATIONS * ORIENTATIONS
    return CellMap(named(section, "_map"), designed.orientations, facts, designed.shifts, beyond)


def named(section: SearchSection, part: str) -> str:
    """Name of a part of a design, no longer than names are."""
    return section.name[: _LONGEST_NAME - len(part)] + part
