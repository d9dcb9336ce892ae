"""The dies of a plate with the emitters and wires of its job, and the obstacles to either."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

from maskfab.display.emitters.borders import meetings
from maskfab.display.emitters.fit import LargestGap
from maskfab.display.feasibility import DisplayRules, Feasibility, feasibility, widest_gap
from maskfab.display.wires.panel_routing import PanelLines
from maskfab.model import WIRES, Die, Furniture, Panel, Plate
from maskfab.processes import Alone, Given
from maskfab.progress import Progress, silent


@dataclass(frozen=True, eq=False)
class Populated:
    """A plate with its displays, and what was found of each, by die; nothing of dies that have no pixels."""

    plate: Plate
    found: Mapping[str, Feasibility]


def populate(
    plate: Plate,
    rules: DisplayRules,
    progress: Progress = silent,
    *,
    crew: Alone | None = None,
) -> Populated:
    """Emitters and wires for every die; dies of equal pixels, in which equal orientations meet, are worked on once.

    Wires that every pixel has alike are drawn with it, those that are laid across a die are furniture of the plate.

    Args:
        plate: laid out, without emitters.
        rules: the maker's.
        progress: told how many dies are done, of those that differ.
        crew: who works on the dies; what is found does not show who did.

    Raises:
        JobError: MF117, MF118 as :func:`maskfab.display.feasibility.feasibility`.
    """
    dies: list[Die] = []
    lines: list[Furniture] = []
    found: dict[str, Feasibility] = {}
    keys = [(_key(die.panel), None if rules.wires is None else die.panel.orientations.tobytes()) for die in plate.dies]
    panels = {key: die.panel for key, die in zip(reversed(keys), reversed(plate.dies), strict=True)}
    distinct = list(dict.fromkeys(keys))
    calls = [(feasibility, _arguments(panels[key], rules)) for key in distinct]
    progress("emitters", 0, len(calls))
    tasks = (crew or Alone()).each(calls, lambda done: progress("emitters", done, len(calls)))
    known = {key: task.result() for key, task in zip(distinct, tasks, strict=True)}
    for key, die in zip(keys, plate.dies, strict=True):
        answer = known[key]
        if answer is None:
            dies.append(die)
            continue
        found[die.name] = answer
        tracks = () if answer.wiring is None else answer.wiring.tracks
        if answer.wiring is not None and answer.wiring.laid is not None and rules.wires is not None:
            lines += [_drawn(die, each, rules.wires.rules.line_nm) for each in answer.wiring.laid]
        dies.append(replace(die, panel=replace(die.panel, emitters=answer.emitters, tracks=tracks)))
    return Populated(replace(plate, dies=tuple(dies), furniture=(*plate.furniture, *lines)), found)


def widest_gaps(plate: Plate, rules: DisplayRules, progress: Progress = silent) -> dict[str, LargestGap]:
    """Widest gaps between colours, by die; dies without pixels are left out.

    Raises:
        JobError: MF117, MF118 as :func:`maskfab.display.feasibility.feasibility`.
    """
    known: dict[object, LargestGap | None] = {}
    found: dict[str, LargestGap] = {}
    for done, die in enumerate(plate.dies):
        progress("colour gaps", done, len(plate.dies))
        key = _key(die.panel)
        if key not in known:
            known[key] = widest_gap(die.panel, rules)
        answer = known[key]
        if answer is not None:
            found[die.name] = answer
    progress("colour gaps", len(plate.dies), len(plate.dies))
    return found


def _arguments(panel: Panel, rules: DisplayRules) -> Given:
    return lambda: (panel, rules)


def _drawn(die: Die, laid: PanelLines, line_nm: int) -> Furniture:
    """Lines across a die, where they lie on the plate."""
    x0, y0 = die.origin_nm
    outlines = tuple(
        tuple((point.x + x0, point.y + y0) for point in outline.each_point_hull()) for outline in laid.polygons(line_nm)
    )
    return Furniture(f"{die.name}_WIRES_{laid.axis.upper()}", "wires", WIRES[laid.axis == "y"], outlines)


def _key(panel: Panel) -> object:
    masks = tuple(opening.mask.tobytes() for opening in panel.openings)
    drawn = panel.opening.emitters
    given = None if drawn is None else drawn.tobytes()
    return masks, given, panel.dot_nm, panel.gutter_nm, meetings(panel.orientations)
