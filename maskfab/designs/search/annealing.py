"""Discrete search for openings: a scan of whole families, then annealing within the rules of the display.

A budget is a number of evaluations, so that the same seed gives the same opening on a slow machine as on a fast one. A
limit in seconds is there too; it stops at whole batches, and the result says how many evaluations were made, which as
a budget gives the same opening again.

Annealing also leads from an opening that breaks the rules to the nearest one found that keeps them.
"""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Callable, Collection, Iterable, Iterator, Mapping, Sequence, Sized
from contextlib import suppress
from dataclasses import dataclass, field
from functools import partial
from itertools import chain, islice, pairwise
from typing import Any, Literal, get_args

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from maskfab.base.arrays import Mask
from maskfab.base.errors import InternalError, JobError, OpeningError
from maskfab.base.model import ORIENTATIONS, frozen
from maskfab.base.processes import ALONE, WORTH_SHARING_S, Call, SerialExecutor
from maskfab.base.work import NO_END, Clock, Progress, silent
from maskfab.camera.sensor import LEVELS
from maskfab.designs.model.expected_psnr import Surrogate
from maskfab.designs.rules.constraints import Constraints
from maskfab.designs.rules.families import FAMILIES, Candidate, kind, turned_key
from maskfab.designs.search.mending import mended

Objective = Callable[[Mask], float]
"""Value of an opening, bool [dots, dots]; higher is better. In dB where it is an expected PSNR."""

Bettered = tuple[tuple[int, float], ...]
"""Evaluations made when a best value was bettered, and that value, each time."""

Move = Literal["swap", "border", "segment", "shift"]

MOVES: tuple[Move, ...] = get_args(Move)
"""Exchange any clear dot with any closed one; the same at the edge of what is clear; a straight run of dots with one
as long; push the whole opening by a dot."""

_BATCH = 64
_PARTS = 2
"""Of a batch for each process, so that none waits long for the last."""

_STUCK = 5000

_LONGEST_SEGMENT = 12

_AROUND = ndimage.generate_binary_structure(2, 1)

_EVALUATIONS = 400

_TRIED = 200


@dataclass(frozen=True, eq=False)
class ExpectedPsnr:
    """Weighted mean of the surrogate's restored PSNR over levels, in dB.

    Attributes:
        periodic: whether all cells are laid alike.
        weights: of the levels; equal if empty.
        distances: surrogates in whose place the mean over them counts; none for the one alone.

    Raises:
        JobError: MF105 if weights and levels differ in number; MF104 if weights are negative or all 0.
    """

    surrogate: Surrogate
    periodic: bool = False
    levels: tuple[float, ...] = LEVELS
    weights: tuple[float, ...] = ()
    distances: tuple[Surrogate, ...] = ()

    def __post_init__(self) -> None:
        weights = self.weights or (1.0,) * len(self.levels)
        if len(weights) != len(self.levels) or not weights:
            what = f"{len(weights)} weights for {len(self.levels)} levels"
            raise JobError("MF105", what, where="design.weights", cure="Give one weight per level")
        if not (all(math.isfinite(w) and w >= 0 for w in weights) and sum(weights) > 0):
            cure = "Give one weight of 0 or more per level, at least one above 0"
            raise JobError("MF104", f"the weights {weights} are not shares", where="design.weights", cure=cure)
        object.__setattr__(self, "weights", weights)

    def __call__(self, unit: Mask) -> float:
        return float(np.dot(self.by_level(unit), self.weights) / sum(self.weights))

    def by_level(self, unit: Mask) -> tuple[float, ...]:
        """Expected restored PSNR in dB at each level."""
        if not self.distances:
            return self.surrogate(unit, periodic=self.periodic, levels=self.levels)
        by_distance = [estimate(unit, periodic=self.periodic, levels=self.levels) for estimate in self.distances]
        return tuple(np.mean(by_distance, axis=0).tolist())


@dataclass(frozen=True, eq=False)
class Ranked:
    """An opening and what it is worth."""

    name: str
    unit: Mask
    value: float


@dataclass(frozen=True, eq=False)
class Scan:
    """Result of a scan of candidates.

    Attributes:
        ranked: everything evaluated, the best first; equals in the order in which they came.
        refused: how many candidates broke each rule first.
        repeated: candidates that had been seen, in this or another orientation.
        bettered: how often it had been asked when the best was bettered, and by what value, each time.
    """

    ranked: tuple[Ranked, ...]
    refused: Mapping[str, int]
    repeated: int
    evaluated: int
    complete: bool
    bettered: Bettered = ()

    @property
    def best(self) -> Ranked:
        return self.ranked[0]

    def with_more(self, other: Scan) -> Scan:
        """Both scans as one, this one first."""
        ranked = sorted((*self.ranked, *other.ranked), key=lambda shape: -shape.value)
        refused = Counter(self.refused)
        refused.update(other.refused)
        later = ((self.evaluated + number, value) for number, value in other.bettered if value > self.best.value)
        return Scan(
            tuple(ranked),
            dict(refused),
            self.repeated + other.repeated,
            self.evaluated + other.evaluated,
            self.complete and other.complete,
            (*self.bettered, *later),
        )


def scan(
    candidates: Iterable[Candidate],
    objective: Objective,
    constraints: Constraints,
    *,
    turned_alike: bool = False,
    evaluations: int | None = None,
    clock: Clock = NO_END,
    executor: SerialExecutor = ALONE,
    progress: Progress = silent,
) -> Scan:
    """Rank every candidate that keeps the constraints.

    Args:
        candidates: from :mod:`maskfab.designs.rules.families`, in the order in which they are looked at; drawn as
            they are needed. In a list, progress knows how many there are.
        objective: pure, so that other processes may ask it.
        turned_alike: evaluate only the first of those that one of the eight orientations maps onto each other; for
            objectives and constraints to which these are the same, as in a random tiling.
        evaluations: most of them; None has no limit.
        clock: stop when it is over, at a whole batch of 64.

    Raises:
        OpeningError, JobError: MF203, MF204, MF123 for constraints that contradict each other, MF123 if no candidate
            keeps them.
    """
    constraints.require_possible()
    expected = len(candidates) if isinstance(candidates, Sized) else 0
    refused: Counter[str] = Counter()
    seen: set[bytes] = set()
    ranked: list[Ranked] = []
    done, repeated, complete = 0, 0, True

    turns = range(ORIENTATIONS) if turned_alike else range(1)

    def kept() -> Iterator[Candidate]:
        nonlocal done, repeated
        for candidate in candidates:
            done += 1
            key = turned_key(candidate.unit, turns)
            if key in seen:
                repeated += 1
                continue
            seen.add(key)
            if (rule := constraints.first_broken(candidate.unit)) is None:
                yield candidate
            else:
                refused[rule] += 1

    source, shared, seconds = kept(), ALONE, 0.0
    while True:
        size = _BATCH if evaluations is None else min(_BATCH, evaluations - len(ranked))
        if size <= 0 or (ranked and clock.over):
            complete = next(source, None) is None
            break
        batch = list(islice(source, size))
        if not batch:
            break
        part = -(-len(batch) // (_PARTS * shared.processes))
        units = [candidate.unit for candidate in batch]
        parts = [units[k : k + part] for k in range(0, len(units), part)]
        tasks = shared.run_all([Call(_judged, partial(tuple, (objective, some))) for some in parts])
        values = chain.from_iterable(task.result() for task in tasks)
        for candidate, value in zip(batch, values, strict=True):
            ranked.append(Ranked(candidate.name, candidate.unit, _number(value)))
        best = max(shape.value for shape in ranked)
        progress(f"scan, best {best:.3f}", done, max(expected, done))
        seconds += sum(task.seconds for task in tasks)
        if seconds / done * (expected - done) > WORTH_SHARING_S:
            shared = executor
    if not ranked:
        tally = ", ".join(f"{rule} {count}" for rule, count in refused.most_common())
        what = f"none of {done} openings keeps all constraints; broken first: {tally or 'none was given'}"
        raise JobError("MF123", what, where="design", cure="Add families, or relax what is broken most often")
    bettered = rises(shape.value for shape in ranked)
    ranked.sort(key=lambda shape: -shape.value)
    return Scan(tuple(ranked), dict(refused), repeated, len(ranked), complete, bettered)


def _judged(objective: Objective, units: Sequence[Mask]) -> list[float]:
    return [objective(unit) for unit in units]


def rises(values: Iterable[float]) -> Bettered:
    """Where a sequence of values exceeds all before, counted from 1, and what it reaches there."""
    best, steps = -math.inf, []
    for number, value in enumerate(values, start=1):
        if value > best:
            best = value
            steps.append((number, value))
    return tuple(steps)


@dataclass(frozen=True, eq=False)
class State:
    """Where an annealing stands; enough to go on as if it had not stopped.

    Attributes:
        unit, value: the opening it is at.
        best, best_value: the best it has been at.
        evaluations: made so far; the start's is not counted.
        refused: moves in a row that broke a constraint or changed nothing.
        generator: of the random numbers, :attr:`numpy.random.BitGenerator.state`.
        bettered: as of :class:`Scan`, from the start's 0 on.
        visited: the best opening of every size (shorter and longer side of what is clear) that it has been at, with its
            value, in the order in which the sizes were reached.
    """

    unit: Mask
    value: float
    best: Mask
    best_value: float
    evaluations: int
    refused: int
    generator: Mapping[str, Any] = field(repr=False)
    bettered: Bettered = ()
    visited: tuple[tuple[float, Mask], ...] = field(default=(), repr=False)

    def __post_init__(self) -> None:
        for name in ("unit", "best"):
            object.__setattr__(self, name, frozen(np.asarray(getattr(self, name), dtype=np.bool_)))

    def plain(self) -> dict[str, Any]:
        """Lists, numbers and strings only, for JSON."""
        rows = {name: getattr(self, name).astype(int).tolist() for name in ("unit", "best")}
        numbers = {name: getattr(self, name) for name in ("value", "best_value", "evaluations", "refused")}
        visited = [[value, unit.astype(int).tolist()] for value, unit in self.visited]
        bettered = [list(step) for step in self.bettered]
        return {**rows, **numbers, "generator": dict(self.generator), "bettered": bettered, "visited": visited}

    @classmethod
    def of(cls, plain: Mapping[str, Any]) -> State:
        """From what :meth:`plain` gave. Raises JobError MF105 if something is missing or of another kind."""
        try:
            fields = {name: plain[name] for name in cls.__dataclass_fields__}
            fields["bettered"] = tuple((int(number), float(value)) for number, value in fields["bettered"])
            fields["visited"] = tuple((float(value), np.array(unit, np.bool_)) for value, unit in fields["visited"])
            made = cls(**fields)
            whole = made.unit.ndim == 2 and made.unit.shape == made.best.shape and made.evaluations >= 0
            np.random.default_rng().bit_generator.state = dict(made.generator)
        except KeyError as missing:
            what = f"the saved annealing has no {missing}"
            raise JobError("MF105", what, where="design", cure="Delete the checkpoint and start again") from missing
        except (TypeError, ValueError) as error:
            what = f"the saved annealing is damaged: {error}"
            raise JobError("MF105", what, where="design", cure="Delete the checkpoint and start again") from error
        if not (whole and math.isfinite(made.value) and math.isfinite(made.best_value)):
            what = "the saved annealing's openings or values are damaged"
            raise JobError("MF105", what, where="design", cure="Delete the checkpoint and start again")
        return made


@dataclass(frozen=True, eq=False)
class Annealed:
    """The best opening of an annealing.

    Attributes:
        unit, value: the best it has been at.
        complete: whether all evaluations were made; otherwise it was interrupted, or ``stuck``.
        stuck: no move that keeps the constraints was found in 5000 in a row.
    """

    unit: Mask
    value: float
    state: State
    complete: bool
    stuck: bool


def anneal(
    start: Mask | State,
    objective: Objective,
    constraints: Constraints,
    *,
    evaluations: int,
    seed: int = 0,
    moves: Sequence[Move] = MOVES,
    temperature: tuple[float, float] = (0.05, 0.0005),
    until: int | None = None,
    clock: Clock = NO_END,
    progress: Progress = silent,
) -> Annealed:
    """Walk from opening to opening, each of which keeps the constraints, uphill and ever less often downhill.

    A move to a value lower by d is taken with the chance exp(-d / T) (Metropolis and others, J. Chem. Phys. 21, 1087,
    1953); T falls geometrically with the evaluations. Moves take whole orbits of the symmetry.

    Args:
        start: an opening, or where a former annealing with the same arguments stopped.
        objective: higher is better.
        evaluations: of the whole annealing; they set the pace at which it cools.
        seed: of the walk; not looked at when it goes on.
        temperature: first and last, in the objective's unit.
        until: stop after so many evaluations, to go on later.
        clock: stop when it is over, at a multiple of 64 evaluations, to go on later.
        progress: told at every multiple of 64 evaluations.

    Raises:
        OpeningError, JobError: MF203, MF204, MF123 for constraints that contradict each other, MF123 for a start that
            breaks them, MF105 for no or other moves, MF104 for temperatures that are not positive and falling.
    """
    _check(moves, temperature, evaluations)
    constraints.require_possible()
    rng = np.random.default_rng(seed)
    state = start if isinstance(start, State) else None
    unit = np.asarray(start if state is None else state.unit, dtype=np.bool_)
    if broken := constraints.violations(unit):
        cure = "Start from the best of a scan under the same constraints"
        raise JobError("MF123", f"the start breaks constraints: {'; '.join(broken)}", where="design.start", cure=cure)
    if state is None:
        value = _number(objective(unit))
        state = State(unit, value, unit, value, 0, 0, rng.bit_generator.state, ((0, value),), ((value, unit),))
    rng.bit_generator.state = dict(state.generator)
    proposals = _Proposals(constraints)
    last = evaluations if until is None else min(until, evaluations)
    hot, cold = temperature
    value, best, best_value, made, refused = state.value, state.best, state.best_value, state.evaluations, state.refused
    bettered, visited = list(state.bettered), {_size(unit): (value, unit) for value, unit in state.visited}
    paused = False
    while made < last and refused < _STUCK and not paused:
        trial = proposals.propose(moves[int(rng.integers(len(moves)))], unit, rng)
        if trial is None or not constraints.allows(trial):
            refused += 1
            continue
        refused = 0
        new = _number(objective(trial))
        heat = hot * (cold / hot) ** (made / evaluations)
        made += 1
        if rng.random() < math.exp(min(0.0, (new - value) / heat)):
            unit, value = trial, new
            size = _size(unit)
            if size not in visited or value > visited[size][0]:
                visited[size] = value, unit
            if value > best_value:
                best, best_value = unit, value
                bettered.append((made, value))
        if made % _BATCH == 0:
            progress(f"anneal, best {best_value:.3f}", made, evaluations)
            paused = clock.over
    generator, been = rng.bit_generator.state, tuple(visited.values())
    state = State(unit, value, best, best_value, made, refused, generator, tuple(bettered), been)
    return Annealed(best, best_value, state, made >= evaluations, refused >= _STUCK)


def _size(unit: Mask) -> tuple[int, int]:
    _, short, long = kind("annealed", unit)
    return short, long


class _Proposals:
    """Moves that keep the count and the symmetry; whether they keep the rest is judged by others."""

    def __init__(self, constraints: Constraints) -> None:
        self._orbits = constraints.orbits
        self._orbit_of = np.empty(constraints.dots**2, dtype=np.intp)
        for k, orbit in enumerate(self._orbits):
            self._orbit_of[orbit] = k
        self._free = constraints.free

    def propose(self, move: Move, unit: Mask, rng: np.random.Generator) -> Mask | None:
        """Another opening of the same count; None where the draw gave none."""
        if move == "shift":
            axis, step = int(rng.integers(2)), int(rng.integers(2)) * 2 - 1
            leaving = unit.take(-1 if step > 0 else 0, axis=axis)
            return None if leaving.any() else np.roll(unit, step, axis)
        closable, openable = unit, ~unit & self._free
        if move != "swap":
            openable = openable & ndimage.binary_dilation(unit, _AROUND)
        if move == "border":
            closable = unit & ~ndimage.binary_erosion(unit, _AROUND)
        if not (closable.any() and openable.any()):
            return None
        length = int(rng.integers(1, _LONGEST_SEGMENT + 1)) if move == "segment" else 1
        close = _run(closable, unit, length, rng)
        opened = _run(openable, ~unit & self._free, length, rng)
        if close is None or opened is None:
            return None
        trial = unit.ravel().copy()
        trial[self._whole(close)] = False
        trial[self._whole(opened)] = True
        return trial.reshape(unit.shape) if trial.sum() == unit.sum() else None

    def _whole(self, places: NDArray[np.intp]) -> NDArray[np.intp]:
        return np.concatenate([self._orbits[k] for k in np.unique(self._orbit_of[places])])


def _run(starts: Mask, within: Mask, length: int, rng: np.random.Generator) -> NDArray[np.intp] | None:
    """Flat indices of a straight run from one of the starts, along a row or a column; None if it leaves ``within``."""
    places = np.flatnonzero(starts)
    first = int(places[int(rng.integers(places.size))])
    if length == 1:
        return np.array([first], dtype=np.intp)
    n = within.shape[0]
    upwards = bool(rng.integers(2))
    y, x = divmod(first, n)
    if (y if upwards else x) + length > n:
        return None
    run = first + (n if upwards else 1) * np.arange(length, dtype=np.intp)
    return run if within.ravel()[run].all() else None


def _number(value: float) -> float:
    if math.isnan(value):
        what = "the objective of an opening is not a number"
        raise InternalError("MF901", what, where="design", cure="Report it with the job file")
    return float(value)


def _check(moves: Sequence[Move], temperature: tuple[float, float], evaluations: int) -> None:
    if not moves or not set(moves) <= set(MOVES):
        what = f"the moves {moves} are not known"
        raise JobError("MF105", what, where="design.moves", cure=f"Use {', '.join(MOVES)}")
    falling = all(first >= second > 0 for first, second in pairwise(temperature))
    if not (falling and math.isfinite(temperature[0]) and evaluations >= 0):
        what = f"temperatures {temperature} and {evaluations} evaluations do not cool"
        cure = "Give positive temperatures, the first the higher, and a number of evaluations"
        raise JobError("MF104", what, where="design", cure=cure)


def nearest(unit: Mask, constraints: Constraints, *, seed: int = 0) -> Mask:
    """An opening that keeps the constraints and has as many dots as possible in common with this one.

    The opening mended, or where that leads nowhere the compact shape that shares most dots with it and keeps the rules,
    is changed dot by dot towards it, rules kept at every step. Not proven to be the nearest.

    Args:
        unit: bool [dots, dots].
        constraints: to be kept; their count need not be the unit's.

    Raises:
        OpeningError, JobError: MF203, MF204, MF123 if no opening keeps them, or no shape at hand does.
    """
    if constraints.allows(unit):
        return unit
    constraints.require_possible()

    def shared(other: Mask) -> float:
        return float(np.count_nonzero(unit & other))

    if (close := mended(unit, constraints)) is not None:
        return anneal(close, shared, constraints, evaluations=_EVALUATIONS, seed=seed).unit
    shapes = sorted(_shapes(constraints), key=lambda shape: -shared(shape.unit))
    # The closest ones, then a few of all the others: rules on emitters take their time.
    few = chain(shapes[:_TRIED], shapes[_TRIED :: max(1, len(shapes) // _TRIED)])
    start = next((shape.unit for shape in few if constraints.allows(shape.unit)), None)
    if start is None:
        what = f"none of {len(shapes)} compact shapes keeps all rules: {', '.join(constraints.active)}"
        raise JobError("MF123", what, where="design.rules", cure="Relax one of these rules, or change clear_dots")
    return anneal(start, shared, constraints, evaluations=_EVALUATIONS, seed=seed).unit


def nearest_notes(what: str, unit: Mask, kept: Mask, broken: Collection[str]) -> tuple[str, ...]:
    """Sentence on an opening that :func:`nearest` was asked for, where it breaks rules."""
    if not broken:
        return ()
    shared = np.count_nonzero(kept & unit)
    return (
        f"The {what} breaks {', '.join(broken)}; what follows begins at the nearest opening found that keeps all "
        f"rules, which shares {shared} of its {np.count_nonzero(unit)} clear dots.",
    )


def _shapes(constraints: Constraints) -> Iterator[Candidate]:
    for name in ("bars", "discs", "l_shapes", "crosses"):
        with suppress(OpeningError):
            yield from FAMILIES[name](constraints.dots, constraints.clear_dots)
