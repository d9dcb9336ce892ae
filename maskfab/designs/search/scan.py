"""The best compact opening of some families, then annealed: the two stages of a search that take budget and checkpoint.

Both are pure in the section, the objective and the rules; only a budget lets the clock in. A scan judges shapes whether
or not they keep the rules, so that it prices them by the way. An annealing keeps every rule from its first step to its
last, and is repeated without each rule where their prices are asked for.

A given opening can be reduced to fewer clear dots, for comparing designs at equal light.
"""

from __future__ import annotations

import json
import time
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from functools import partial
from itertools import chain, islice
from typing import Any, get_args

import numpy as np
from numpy.typing import NDArray

from maskfab.base import __version__
from maskfab.base.arrays import Mask
from maskfab.base.errors import JobError
from maskfab.base.files import Kept
from maskfab.base.model import Opening, Tiling, frozen
from maskfab.base.processes import ALONE, SerialExecutor
from maskfab.base.work import Clock, Progress, silent
from maskfab.camera.scenes import Photograph
from maskfab.camera.stop_cells import PhotoCamera, lattice
from maskfab.designs.model.expected_psnr import surrogate_behind
from maskfab.designs.rules.constraints import Constraints
from maskfab.designs.rules.families import FAMILIES, Candidate, kind, orbits
from maskfab.designs.search.annealing import (
    Bettered,
    ExpectedPsnr,
    Objective,
    Ranked,
    State,
    anneal,
    nearest,
    nearest_notes,
    scan,
)
from maskfab.designs.search.held import Start, best_held, finer, thinned
from maskfab.designs.search.result import ANNEALING, WITHIN_DB, camera_facts
from maskfab.job.sections import SearchSection
from maskfab.job.values import Symmetry
from maskfab.mask.opening_masks import closed

PRICED = 200
"""Best openings of a scan among which rules are priced."""
SAVED_EVERY = 1024
"""Evaluations of an annealing between checkpoints."""

_SCAN_SHARE = 0.5
_AT_LEAST_S = 0.5


@dataclass(frozen=True, eq=False)
class Best:
    """State of a search and its best opening so far.

    Attributes:
        best: keeps the rules; its name says where it came from.
        looked: openings among which the rules are priced; empty where they are not judged in dB.
        near: openings judged that lie within reach of the best, whether or not they keep the rules; empty where
            ``looked`` is.
        bettered: evaluations made when the best that was judged was bettered, and its value; of a scan, whether or not
            it keeps the rules.
        stages: what was tried, and how often.
        held: the best of every kind that a display was found to fit.
    """

    best: Ranked
    looked: tuple[Candidate, ...]
    evaluated: int
    notes: tuple[str, ...] = ()
    cut: bool = False
    near: tuple[Ranked, ...] = ()
    bettered: Bettered = ()
    stages: tuple[tuple[str, int], ...] = ()
    held: tuple[Ranked, ...] = ()


def require_shapes(section: SearchSection, rules: Constraints) -> None:
    """Refuse a symmetry that no shape of the families has.

    Raises:
        JobError: MF123, with the symmetries that some have.
        OpeningError: MF204 for a count that no family can have.
    """
    symmetry: Symmetry | None = rules["symmetry"]
    if symmetry is None:
        return
    shapes = _shapes(section)
    units, named = np.stack([shape.unit for shape in shapes]), ", ".join(section.families)
    symmetric = {name: int(_symmetric(units, name).sum()) for name in get_args(Symmetry)}
    if symmetric[symmetry]:
        return
    some = " and ".join(f"{name} ({count} of them)" for name, count in symmetric.items() if count)
    what = (
        f"none of the {len(shapes)} shapes of {section.clear_dots} clear dots in families {named} has the symmetry "
        f"{symmetry}; {f'some have {some}' if some else 'none has any'}"
    )
    cure = "Add families such as discs, use another symmetry, or change clear_dots"
    raise JobError("MF123", what, where="design.rules.symmetry", cure=cure)


def _symmetric(units: NDArray[np.bool_], symmetry: Symmetry) -> NDArray[np.bool_]:
    """Which of the openings [units, dots, dots] have a symmetry."""
    flat = units.reshape(len(units), -1)
    uneven = (flat[:, orbit].any(axis=1) & ~flat[:, orbit].all(axis=1) for orbit in orbits(units.shape[1], symmetry))
    return np.asarray(~np.any(np.stack(list(uneven)), axis=0))


def first_shape(section: SearchSection) -> Mask:
    """The first shape that the section's families have, whatever its rules; MF204 for a count that none can have."""
    return next(FAMILIES[section.families[0]](section.dots, section.clear_dots)).unit


def scanned(
    section: SearchSection,
    rules: Constraints,
    objective: Objective,
    clock: Clock,
    store: Kept | None,
    progress: Progress,
    start: Start | None = None,
    *,
    executor: SerialExecutor = ALONE,
) -> Best:
    """The best of the section's families that keeps the rules; half of a budget where annealing follows.

    Args:
        objective: higher is better.
        start: of a search whose display keeps its rules before any map; None where openings are asked as they come.

    Raises:
        JobError: MF123 if none keeps the rules.
    """
    if store is not None and "scan_units" in store.state:
        return _restored(store.state)
    every = _shapes(section)
    shapes = every if start is None else thinned(every)
    share = _SCAN_SHARE if section.anneal else 1.0
    look = partial(scan, turned_alike=section.tiling is not Tiling.PERIODIC, executor=executor, progress=progress)
    free = Constraints(section.clear_dots, dots=section.dots, dot_nm=rules.dot_nm)
    looked_at = look(shapes, objective, free, clock=clock.part(share))
    if len(shapes) < len(every):
        between = finer(every, looked_at.ranked)
        looked_at = looked_at.with_more(look(between, objective, free, clock=clock.part(share)))
    evaluated, complete = looked_at.evaluated, looked_at.complete
    ruled, held = None, list[Ranked]()
    if start is None:
        best = next((opening for opening in looked_at.ranked if rules.allows(opening.unit)), None)
    else:
        held = best_held(looked_at.ranked, start, objective(start.first.unit), section.shortlist, clock)
        best = held[0]
    if best is None:
        ruled = look(shapes, objective, rules, clock=clock.part(share, _AT_LEAST_S))
        best, evaluated, complete = ruled.best, evaluated + ruled.evaluated, complete and ruled.complete
    looked = list(looked_at.ranked[:PRICED])
    looked += [opening for opening in held if all(opening.unit is not other.unit for other in looked)]
    if all(opening.unit is not best.unit for opening in looked):
        looked.append(best)
    if ruled is not None and section.map is not None:
        # A shortlist for the map wants several sizes that keep the rules.
        sizes = {kind(best.name, best.unit)}
        for opening in ruled.ranked:
            size = kind(opening.name, opening.unit)
            if len(sizes) < section.shortlist and size not in sizes:
                sizes.add(size)
                looked.append(opening)
    note = (
        f"{clock.ender} ended the scan when {evaluated + looked_at.repeated} of {len(shapes)} shapes had been judged."
    )
    # All that keep the rules were judged where the first look found none.
    last = looked_at if ruled is None else ruled
    made = Best(
        best,
        _candidates(looked),
        evaluated,
        () if complete else (note,),
        not complete,
        near=tuple(opening for opening in last.ranked if opening.value >= best.value - WITHIN_DB),
        bettered=last.bettered,
        stages=(("shapes judged", evaluated),),
        held=tuple(held),
    )
    if store is not None and complete:
        store.put(_stored(made))
    return made


def begun(unit: Mask, section: SearchSection, rules: Constraints, objective: Objective, progress: Progress) -> Best:
    """An opening of one's own, or the nearest one found that keeps the rules.

    Args:
        unit: bool [dots, dots].

    Raises:
        JobError, OpeningError: as :func:`maskfab.designs.search.annealing.nearest`.
    """
    progress("start", 0, 1)
    broken = () if rules.allows(unit) else sorted(rules.broken(unit))
    kept = nearest(unit, rules, seed=section.seed)
    progress("start", 1, 1)
    best = Ranked("start", kept, objective(kept))
    return Best(best, (), 1, nearest_notes("start", unit, kept, broken), near=(best,), stages=(("start judged", 1),))


def allowed(
    section: SearchSection,
    rules: Constraints,
    objective: Objective,
    clock: Clock,
    progress: Progress,
    *,
    once: bool = False,
) -> Iterator[Mask]:
    """Openings of the section's families that keep the rules, the best first; looked at as they are asked for.

    Args:
        once: end where no shape keeps the rules, rather than look for some that are nearest to them.

    Raises:
        JobError: MF123 if none keeps the rules.
    """
    alike = section.tiling is not Tiling.PERIODIC
    look = partial(scan, _shapes(section), objective, turned_alike=alike, clock=clock, progress=progress)
    any_allowed = False
    for opening in look(Constraints(section.clear_dots, dots=section.dots, dot_nm=rules.dot_nm)).ranked:
        if rules.allows(opening.unit):
            any_allowed = True
            yield opening.unit
    if not any_allowed and not once:
        yield from (opening.unit for opening in look(rules).ranked)


def annealed(
    state: Best,
    section: SearchSection,
    rules: Constraints,
    objective: Objective,
    clock: Clock,
    store: Kept | None,
    progress: Progress,
) -> Best:
    """The best changed dot by dot for the section's evaluations, if that betters it."""
    if not section.anneal:
        return state
    # An annealing from where the clock ended the scan is no part of the run that another call could go on with.
    store = None if state.cut else store
    start: Any = state.best.unit
    if store is not None and "anneal" in store.state:
        plain = json.loads(str(store.state["anneal"]))
        start = State.of({**plain, **{name: np.array(plain[name], dtype=np.bool_) for name in ("unit", "best")}})
    while True:
        made = start.evaluations if isinstance(start, State) else 0
        walked = anneal(
            start,
            objective,
            rules,
            evaluations=section.anneal,
            seed=section.seed,
            until=None if store is None else made + SAVED_EVERY,
            clock=clock,
            progress=progress,
        )
        start = walked.state
        if store is not None:
            store.put({"anneal": np.array(json.dumps(start.plain()))})
        if walked.complete or walked.stuck or clock.over:
            break
    notes = list(state.notes)
    if not walked.complete:
        why = "No move that keeps the rules was left" if walked.stuck else f"{clock.ender} ended the annealing"
        notes.append(f"{why} after {start.evaluations} of {section.anneal} evaluations.")
    name = f"{state.best.name}, annealed"
    state = replace(
        state,
        evaluated=state.evaluated + start.evaluations,
        notes=tuple(notes),
        cut=state.cut or not (walked.complete or walked.stuck),
        near=(*state.near, *(Ranked(name, unit, value) for value, unit in start.visited)),
        bettered=(*state.bettered, *((state.evaluated + made, value) for made, value in start.bettered)),
        stages=(*state.stages, (ANNEALING, start.evaluations)),
    )
    if not walked.value > state.best.value:
        return state
    best = Ranked(name, walked.unit, walked.value)
    return replace(state, best=best, looked=(*state.looked, *_candidates([best])))


def _shapes(section: SearchSection) -> list[Candidate]:
    return list(chain.from_iterable(FAMILIES[name](section.dots, section.clear_dots) for name in section.families))


def _candidates(ranked: list[Ranked]) -> tuple[Candidate, ...]:
    return tuple(Candidate(opening.name, opening.unit) for opening in ranked)


def _stored(state: Best) -> dict[str, np.ndarray[Any, Any]]:
    place = next(k for k, opening in enumerate(state.looked) if opening.unit is state.best.unit)
    return {
        "scan_names": np.array([opening.name for opening in state.looked], dtype=np.str_),
        "scan_units": np.stack([opening.unit for opening in state.looked]),
        "scan_numbers": np.array([place, state.evaluated], dtype=np.int64),
        "scan_value": np.array([state.best.value]),
        "near_names": np.array([opening.name for opening in state.near], dtype=np.str_),
        "near_units": np.stack([opening.unit for opening in state.near]),
        "near_values": np.array([opening.value for opening in state.near]),
        "bettered": np.array(state.bettered),
    }


def _restored(state: dict[str, Any]) -> Best:
    pairs = zip(state["scan_names"], state["scan_units"], strict=True)
    looked = tuple(Candidate(str(name), unit) for name, unit in pairs)
    place, evaluated = (int(v) for v in state["scan_numbers"])
    best = Ranked(looked[place].name, looked[place].unit, float(state["scan_value"][0]))
    near = zip(state["near_names"], state["near_units"], state["near_values"], strict=True)
    return Best(
        best,
        looked,
        evaluated,
        near=tuple(Ranked(str(name), unit, float(value)) for name, unit, value in near),
        bettered=tuple((int(number), float(value)) for number, value in state["bettered"]),
        stages=(("shapes judged", evaluated),),
    )


def annealed_without(
    state: Best, section: SearchSection, rules: Constraints, objective: Objective, progress: Progress
) -> tuple[dict[str, float], float]:
    """Gains of annealings without each rule over the best found, dB by the rule left out, and the seconds they took.

    Each annealing is as long as the search's own, has its seed, and begins at the best opening that keeps the others.
    """
    gains, begun_s = {}, time.process_time()
    for left_out in rules.active:
        others = rules.without(left_out)
        # The best shapes come first, whether or not they keep any rule.
        first = islice((shape.unit for shape in state.looked if others.allows(shape.unit)), 1)
        start = max((state.best.unit, *first), key=objective)
        walked = anneal(
            start,
            objective,
            others,
            evaluations=section.anneal,
            seed=section.seed,
            progress=lambda stage, done, total, rule=left_out: progress(f"without {rule}: {stage}", done, total),  # type: ignore[misc]
        )
        gains[left_out] = max(walked.value - state.best.value, 0.0)
    return gains, time.process_time() - begun_s


def reduced_opening(
    opening: Opening,
    clear_dots: int,
    camera: PhotoCamera,
    scenes: Sequence[Photograph],
    command: str,
    *,
    periodic: bool = False,
    progress: Progress = silent,
) -> Opening:
    """The opening with those dots closed that photographs, restored, miss least.

    Args:
        opening: what to reduce; its emitters are left out, as they may lie where there was light.
        periodic: whether all cells are laid alike; otherwise each is turned at random.

    Raises:
        JobError, OpeningError: as :func:`reduced`; MF104, MF106, MF121, MF135 as a search for such an opening.
    """
    estimate = surrogate_behind(scenes, lattice(opening.dots, opening.dot_nm, camera=camera, where=opening.name))
    mask = reduced(opening.mask, clear_dots, ExpectedPsnr(estimate, periodic), progress)
    made = {"author": "maskfab", "command": command, "version": __version__, "from": opening.name}
    return Opening(f"{opening.name}_{clear_dots}", mask, opening.dot_nm, made | camera_facts(camera))


def reduced(
    unit: NDArray[np.bool_], clear_dots: int, objective: Objective, progress: Progress = silent
) -> NDArray[np.bool_]:
    """Close the least useful dots of an opening one after the other, each where the objective loses least.

    Args:
        unit: bool [dots, dots].
        objective: higher is better; asked for every clear dot at every step.

    Raises:
        JobError, OpeningError: as :func:`require_count`.
    """
    require_count(unit, clear_dots)
    mask = np.array(unit, dtype=np.bool_)
    surplus = int(mask.sum()) - clear_dots
    for step in range(surplus):
        progress("dots", step, surplus)
        worths = []
        places = np.argwhere(mask)
        for row, column in places:
            mask[row, column] = False
            worths.append(objective(mask))
            mask[row, column] = True
        row, column = places[int(np.argmax(worths))]
        mask[row, column] = False
        progress("dots", step + 1, surplus)
    return frozen(mask)


def require_count(unit: NDArray[np.bool_], clear_dots: int) -> None:
    """Refuse to leave no dot clear, or more than there are.

    Raises:
        OpeningError: MF203 for no clear dots.
        JobError: MF104 for more clear dots than the opening has.
    """
    where, count = "clear_dots", int(unit.sum())
    if clear_dots < 1:
        raise closed(clear_dots, unit.size, where=where)
    if clear_dots > count:
        what = f"{clear_dots} dots are to be clear, and the opening has {count}"
        raise JobError("MF104", what, where=where, cure=f"Set clear_dots to {count} or fewer")
