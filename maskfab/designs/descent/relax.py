"""The method "relax": gradient descent on relaxed dots, then the nearest opening that keeps the rules.

A descent knows no rules but the count. Where the opening that it ends on breaks one, annealing starts from the nearest
opening found that keeps them all, and the result says so.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path

import numpy as np
import torch

from maskfab.base.arrays import Mask
from maskfab.base.errors import JobError
from maskfab.base.model import Opening, Tiling
from maskfab.base.work import NO_END, Clock, Progress, silent
from maskfab.camera.scenes import Photograph
from maskfab.camera.stop_cells import CellGrid, PhotoCamera, lattice
from maskfab.designs.descent.losses import expected_error, top_residual
from maskfab.designs.descent.objective import (
    AreaPenalty,
    Objective,
    Weighted,
    cells_across,
    invertibility_of,
    tiled_stop,
)
from maskfab.designs.descent.schedule import (
    Descent,
    DescentResult,
    Outcome,
    Recipe,
    RelaxStep,
    descend,
    iterations_within,
    paper,
)
from maskfab.designs.model.expected_psnr import Surrogate, surrogate_behind
from maskfab.designs.rules.constraints import Constraints
from maskfab.designs.search.annealing import Bettered, anneal, nearest, nearest_notes
from maskfab.designs.search.result import (
    ANNEALING,
    NO_BOUNDS,
    Account,
    Designed,
    Facts,
    Stages,
    appraised,
    asked_of,
    camera_facts,
    constraints_of,
    made_for_line,
    origin,
    stopped,
)
from maskfab.job.camera import Camera
from maskfab.job.sections import RelaxSection
from maskfab.optics.tiling import orientations

AREA_WEIGHT = 400.0
"""Holds the relaxed open ratio within 0.006 of its target against the pull of the invertibility loss."""

_PORTION = 25
_HOT, _COLD = 2e-3, 2e-5


def relax(
    section: RelaxSection,
    camera: Camera,
    scenes: Sequence[Photograph],
    command: str,
    progress: Progress = silent,
    *,
    clock: Clock = NO_END,
    checkpoint: Path | None = None,
    begin: Mask | None = None,
) -> Designed:
    """Descend as the section says.

    Args:
        clock: of the budget for the descent and what follows it. Without a checkpoint the schedule is made so short;
            with one the whole schedule is begun, and left to be gone on with.
        checkpoint: file of the descent to go on from, and to keep.
        begin: opening from which every start begins, bool [dots, dots]; None for even grey.

    Raises:
        JobError, OpeningError: MF104 to MF107, MF111, MF112 to MF115, MF121 for what cannot be; MF123, MF203, MF204 for
            rules that no opening keeps.
        SourceError, OutputError: MF303, MF304, MF401 for the checkpoint.
    """
    rules = constraints_of(section)
    rules.require_possible()
    progress("photographs", 0, 1)
    room, camera_note = _judging(section, rules, camera)
    estimate = surrogate_behind(scenes, room)
    progress("photographs", 1, 1)
    plan = schedule(section, rules, camera, scenes, estimate)
    if begin is not None:
        plan = replace(plan, descent=replace(plan.descent, begin=tuple(begin.ravel().tolist())))
    periodic = section.tiling is Tiling.PERIODIC
    clear = np.ones((section.dots, section.dots), dtype=np.bool_)
    stages = Stages.of(partial(estimate, periodic=periodic), clear, clock)
    result, bettered, notes = _descended(plan, stages.search, checkpoint, progress)
    mask, loss, more, unfinished = _ruled(result, plan, section, rules, stages.search, progress)
    if stages.bounded:
        progress("bounds", 0, 1)
        psnr, appraisal, head_room, gap = appraised(estimate, mask, periodic=periodic)
        progress("bounds", 1, 1)
    else:
        psnr, appraisal, head_room, gap = estimate(mask, periodic=periodic), Facts(), None, None
        more = (*more, NO_BOUNDS)
    evaluated = result.iterations + section.anneal
    facts: Facts = {
        **origin(section, command, camera_facts(camera)),
        "shape": plan.name,
        "tiling": section.tiling.value,
    }
    facts |= {} if section.tiling_seed is None else {"tiling_seed": section.tiling_seed}
    facts |= {"protocol": "F1"} if camera_note else {}
    facts |= {**appraisal, "evaluated": evaluated, "loss": round(loss, 6)}
    cut = bool(notes) or unfinished
    opening = Opening(section.name, mask, rules.dot_nm, facts)
    return Designed(
        opening,
        plan.name,
        psnr,
        head_room,
        evaluated,
        gap=gap,
        notes=(*result.notes, *notes, *more, *camera_note),
        cut=cut,
        camera=made_for_line(room.camera),
        account=Account(
            f"gradient descent of {plan.name}",
            section.seed,
            (
                ("starts", plan.descent.starts),
                ("steps of descent", result.iterations),
                *(((ANNEALING, section.anneal),) if section.anneal else ()),
            ),
            "loss of the best opening of clear and closed dots",
            bettered,
            stopped(cut),
            section.tiling,
            section.drawn_seed,
            asked_of(rules),
        ),
    )


def _judging(section: RelaxSection, rules: Constraints, camera: Camera) -> tuple[CellGrid, tuple[str, ...]]:
    """The cells behind which photographs are judged: protocol F1's camera stands in for one that they cannot have."""
    try:
        return lattice(section.dots, rules.dot_nm, camera=PhotoCamera.of(camera)), ()
    except JobError as refusal:
        note = f"Expected PSNRs are those behind the camera of protocol F1: {refusal.what}."
        return lattice(section.dots, rules.dot_nm), (note,)


def schedule(
    section: RelaxSection, rules: Constraints, camera: Camera, scenes: Sequence[Photograph], estimate: Surrogate
) -> Recipe:
    """The section's objectives, weighted, or its recipe; arguments and errors as of :func:`relax`."""
    if section.recipe is not None:
        return paper(section, rules.dot_nm, camera, scenes)
    target = section.clear_dots / section.dots**2
    weights = {name: weight for name, weight in section.objectives.items() if name != "area" and weight > 0}
    makers = _objectives(section, rules, camera, scenes, estimate)
    terms = tuple((weight, makers[name]()) for name, weight in weights.items())
    area = section.objectives.get("area", AREA_WEIGHT)
    descent = Descent(
        dots=section.dots,
        clear_dots=section.clear_dots,
        iterations=section.iterations,
        seed=section.seed,
        starts=section.starts,
    )
    name = " + ".join(name if weight == 1 else f"{weight:g} {name}" for name, weight in weights.items())
    penalty = AreaPenalty(target, area, descent.settled) if area > 0 else None
    return Recipe(name, Weighted(terms), penalty, descent)


def _objectives(
    section: RelaxSection, rules: Constraints, camera: Camera, scenes: Sequence[Photograph], estimate: Surrogate
) -> dict[str, Callable[[], Objective]]:
    """Factories of the objectives, by their name in the section; those of one stop share its autocorrelation."""
    across = cells_across(camera.stop, section.dots, rules.dot_nm)
    seed, where = section.tiling_seed, "design.tiling_seed"
    stop = tiled_stop(
        section.dots, rules.dot_nm, orientations(section.tiling, across, across, seed, where=where), camera
    )
    cells = estimate.lattice.cells
    laid = orientations(section.tiling, cells, cells, seed, where=where)
    target = section.clear_dots / section.dots**2
    return {
        "invertibility": lambda: invertibility_of(stop, target),
        "top_residual": lambda: top_residual(stop, scenes, seed=section.seed),
        "expected_error": lambda: expected_error(estimate, laid),
    }


def _descended(
    plan: Recipe, clock: Clock, checkpoint: Path | None, progress: Progress
) -> tuple[DescentResult, Bettered, tuple[str, ...]]:
    """The descent, within the budget, and the steps of this call at which the best loss was bettered."""
    how = plan.descent
    bettered: list[tuple[int, float]] = []

    def watch(step: RelaxStep) -> None:
        done, total = step.start * how.iterations + step.iteration + 1, how.starts * how.iterations
        if step.best_loss < (bettered[-1][1] if bettered else math.inf):
            bettered.append((done, step.best_loss))
        progress(f"design, best loss {step.best_loss:.4f}", done, total)

    left = clock.left()
    if left is None:
        return descend(plan.objective, plan.penalty, how, progress=watch, checkpoint=checkpoint), tuple(bettered), ()
    if checkpoint is None:
        steps = iterations_within(plan.objective, plan.penalty, how, max(left, 1e-3))
        shorter = replace(how, iterations=min(steps, how.iterations))
        result = descend(plan.objective, plan.penalty, shorter, progress=watch)
        note = f"The budget made the descent {steps} steps long instead of {how.iterations}."
        return result, tuple(bettered), (note,) if steps < how.iterations else ()
    while True:
        result = descend(plan.objective, plan.penalty, how, progress=watch, checkpoint=checkpoint, stop_after=_PORTION)
        if result.outcome is not Outcome.INTERRUPTED or clock.over:
            break
    note = (
        f"The budget ended the descent after {result.iterations} steps; the same command goes on from the checkpoint."
    )
    return result, tuple(bettered), (note,) if result.outcome is Outcome.INTERRUPTED else ()


def _ruled(
    result: DescentResult, plan: Recipe, section: RelaxSection, rules: Constraints, clock: Clock, progress: Progress
) -> tuple[Mask, float, tuple[str, ...], bool]:
    """The opening under the rules, annealed if that was asked for, with its loss, and whether time was too short."""
    judge = plan.objective.at(-1, plan.descent.iterations)
    like = result.relaxed

    def worth(mask: Mask) -> float:
        with torch.no_grad():
            return -float(judge(torch.tensor(mask, dtype=like.dtype)))

    mask = np.asarray(result.unit.numpy() > 0.5, dtype=np.bool_)
    broken = sorted(rules.broken(mask))
    start, notes = mask, list[str]()
    if broken:
        start = nearest(mask, rules, seed=section.seed)
        notes.extend(nearest_notes("thresholded descent", mask, start, broken))
    if not section.anneal:
        return start, -worth(start), tuple(notes), False
    # Losses have scales of their own: what counts is a share of where they stand.
    scale = max(abs(worth(start)), 1e-6)
    walked = anneal(
        start,
        worth,
        rules,
        evaluations=section.anneal,
        seed=section.seed,
        temperature=(_HOT * scale, _COLD * scale),
        clock=clock,
        progress=progress,
    )
    if not walked.complete:
        notes.append(f"The annealing ended after {walked.state.evaluations} of {section.anneal} evaluations.")
    return walked.unit, -walked.value, tuple(notes), not (walked.complete or walked.stuck)
