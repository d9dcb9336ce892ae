"""The best shapes of a scan, each under one quick map, and which of them goes on.

A scan judges openings turned at random. A map gains most where the halo that it can take away is strongest, and thick
shapes gain more than slender ones, so the best under a map need not be the best of the scan. The best shapes that
differ in family or size are each given one descent of a map, and the best of these goes on.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass, replace
from functools import partial
from itertools import islice

import numpy as np

from maskfab.base.processes import ALONE, Call, SerialExecutor
from maskfab.base.work import Clock, Progress
from maskfab.designs.maps.orientation_map import DesignedMap, MapMode, design_map
from maskfab.designs.model.panel_judgement import PanelError
from maskfab.designs.rules.constraints import Constraints
from maskfab.designs.rules.families import Candidate, kind
from maskfab.designs.search.annealing import Objective, Ranked
from maskfab.designs.search.guard import Guard
from maskfab.designs.search.held import Start
from maskfab.designs.search.scan import Best

MOST_WORK = 60_000_000
"""Dots of all pupils together that a map of a display is judged by, once its first steps are made."""

_QUICK_FIELDS = 16
"""Fields of a quick map of an opening that a display fits: they bring most of the gain."""

_WORSE_DB = 0.25
"""Openings that much worse, turned at random, are tried under no quick map: maps differ by less."""

_BESIDE, _ASKED, _BETTER_DB = 2, 60, 0.01
"""Kinds of openings whose lines depend on the map that are tried, of so many that are better by so much."""


@dataclass(frozen=True, eq=False)
class Listed:
    """An opening that a map is designed for.

    Attributes:
        rules: that it keeps; of a display, in the kind of panel that suits it.
        guard: of its map; None where no map breaks what it must hold.
        alike: whether all cells are laid alike, for want of another map in which lines are found.
        begun: its quick map to go on from; None where there is none.
    """

    shape: Ranked
    rules: Constraints
    guard: Guard | None = None
    begun: DesignedMap | None = None
    alike: bool = False


def shortlisted(
    state: Best,
    most: int,
    error: PanelError,
    rules: Constraints,
    clock: Clock,
    progress: Progress,
    *,
    judge: Objective,
    mode: MapMode,
    seed: int,
    positions: int = 1,
    start: Start | None = None,
    executor: SerialExecutor = ALONE,
) -> tuple[Best, tuple[Listed, ...]]:
    """The openings of a list as quick maps rank them, the best first, and the search with that as its best.

    Where a display is held, openings round which lines run alike are on the list, and beside these the best of those
    whose lines depend on the map; maps then go on from the quick ones. Of equals the earlier is the better.

    Args:
        state: its best is on the list, then those that were looked at, best first.
        most: openings on the list; 1 leaves everything as it is.
        error: of panels of such units; the levels weigh in it as they do in the scan.
        clock: no further map is begun or compared when its time is over.
        judge: of openings whose cells are turned at random.
        start: of a search for a display; None for any other.

    Raises:
        JobError: as ``design_map``.
    """
    if start is not None:
        # Where pupils are large, maps take their time: the best opening alone has it.
        most = min(most, max(1, MOST_WORK // (_QUICK_FIELDS * error.lattice.side**2)))
    listed = _listed(state, most, rules, judge, start)
    if len(listed) < 2:
        return state, listed
    # A random map's light differs by chance, and more of it is no merit of a shape: all have what is expected.
    count = int(listed[0].shape.unit.sum())
    light = round(float(error.inside.sum()) * count / error.dots**2)

    quick_map = partial(
        design_map,
        error=error,
        mode=mode,
        seed=seed,
        kicks=0,
        positions=positions,
        light=light,
        steps=None if start is None else _QUICK_FIELDS,
    )

    def call(one: Listed) -> Call[DesignedMap | None]:
        # No rule is asked where the unit stays in its place.
        made = partial(quick_map, one.shape.unit, **({"allows": one.rules.allows} if positions > 1 else {}))
        return Call(_in_time, lambda: (made, clock))

    calls = [call(one) for one in listed]
    maps: list[DesignedMap] = []
    for quick in executor.run_alike(calls, lambda done: progress("shortlist", done, len(listed))):
        if quick is None:
            break
        maps.append(quick)
    cut = len(maps) < len(listed)
    notes = [f"{clock.ender} ended the shortlist after {len(maps)} of {len(listed)} quick maps."] if cut else []
    values = [float(np.dot(error.weights, quick.psnr)) for quick in maps]
    order = sorted(range(len(values)), key=lambda k: (-values[k], k)) or [0]
    first, best = listed[0].shape, listed[order[0]].shape
    if order[0]:
        better = values[order[0]] - values[0]
        turned = "" if listed[order[0]].guard else ", which is the better one turned at random"
        notes.append(f"Under quick maps, {best.name} restores {better:.3f} dB better than {first.name}{turned}.")
    found = replace(
        state,
        best=replace(best, value=best.value if start is not None else state.best.value),
        notes=(*state.notes, *notes),
        cut=state.cut or cut,
        stages=(*state.stages, ("quick maps", len(values))),
    )
    if start is None or not maps:
        return found, (replace(listed[order[0]], shape=found.best),)
    return found, tuple(replace(listed[k], begun=maps[k]) for k in order)


def _in_time(made: Callable[..., DesignedMap], clock: Clock) -> DesignedMap | None:
    """A map for which there is time; one that was ended early is not compared with others."""
    if clock.over:
        return None
    quick = made(clock=clock)
    return None if clock.over else quick


def _listed(state: Best, most: int, rules: Constraints, judge: Objective, start: Start | None) -> tuple[Listed, ...]:
    shapes = [Candidate(state.best.name, state.best.unit), *state.looked]
    if start is None:
        kinds = different(shapes, rules, most)
        return tuple(Listed(Ranked(one.name, one.unit, state.best.value), rules) for one in kinds)
    own = []
    for one in different(shapes, rules, most):
        value = judge(one.unit)
        if value >= state.best.value - _WORSE_DB:
            own.append(Listed(Ranked(one.name, one.unit, value), rules, start.guard(one.unit)))
    if not start.any_map or most < 2:
        return tuple(own)
    better = (Candidate(one.name, one.unit) for one in state.near if one.value >= state.best.value + _BETTER_DB)
    laid = start.laid_alike
    for one in different(islice(better, _ASKED), laid.rules, _BESIDE):
        own.append(Listed(Ranked(one.name, one.unit, judge(one.unit)), laid.rules, laid.guard(one.unit)))
    return tuple(own)


def different(candidates: Iterable[Candidate], rules: Constraints, most: int) -> tuple[Candidate, ...]:
    """At most so many that keep the rules: of every family and size, turned or not, the first."""
    first: dict[tuple[str, int, int], Candidate] = {}
    for shape in candidates:
        if len(first) >= most:
            break
        key = kind(shape.name, shape.unit)
        if key not in first and rules.allows(shape.unit):
            first[key] = shape
    return tuple(first.values())
