"""Gradient descent on relaxed dots, for any objective.

Every dot is a number, its logit, that a sigmoid maps to a transmission; the gain of the sigmoid grows until the
transmissions are nearly binary. The largest ones become clear dots, exactly as many as asked for, and every candidate
is judged after that, because a relaxed loss flatters grey.

Notes:
    A step depends on its number and the state before it alone: an interrupted run that goes on from its checkpoint
    ends bit for bit where an uninterrupted one does (on the CPU; on CUDA sums are added in any order).
    An even start, all clear or all closed, is a saddle: dots that the layout treats alike have one gradient for ever.
    What is left is the rim of the stop and rounding. Such a run goes on, and its result says so. So far out that the
    sigmoid is flat, or the loss of a closed unit is no number, it is refused.

Whole schedules by name. ``paper`` is the published one, kept as the baseline that others are measured against.

The target function of Yang & Sankaranarayanan 2021, section 4.2, with the constants that its authors ran:

    10 L_data + 0.01 L_inv + 10 |mean transmission - c|²,

L_data half the mean of the largest 10 % of the squared residuals, L_inv with ε = 0.015 over the worst 30 %, divided by
the PSF's own sum; c from 1 down by 0.05 every five epochs to 0.2, which epoch 80 of 150 reaches. Adam, rate 1, β1 =
0.5 (the text says gradient descent); every logit starts at +1, 0.73 open (the text says all open); the largest
transmissions become the clear dots.

What is not as published, and why:

* Pictures: 20 crops of 128 x 128 of the scenes given, one at a time; published were 240 photographs, 512 x 512, in
  batches of twelve. Both are twenty steps an epoch, 3000 in all.
* The transfer is the pupil's autocorrelation without a window, colours on one grid; published were FFTs whose sizes
  differ from colour to colour, with red and green cut to the size of blue. L_inv's worst share is taken in each
  colour's disc of frequencies, not over all squares together.
* The published filter's noise-to-signal ratio, 1e-4 / variance, stands beside a PSF whose sum is of the order of 1e7:
  it is nil, and the filter an inverse one. Here it is 1e-13 beside a PSF of sum 1, which takes double precision.
* The tiling is laid from the middle, by another generator than the authors'.

What is kept, though it is wrong: an even start is a saddle, which only the stop's rim and rounding, amplified by Adam,
leave; a PSF divided by its own sum makes darkness free, and grey better than any opening in both losses; no noise is
added; nothing lies beyond the sensor's edge, so that most of the largest residuals are the edge's.

Notes:
    Blue AUC as published, bundled scenes, one seed each: L2 + inv 0.108 for ``paper4`` and 0.082 periodic, L2 0.115 and
    0.086; the authors' masks have 0.119, 0.073, 0.129 and 0.065. Their L2 + inv mask has 0.111 in the very layout that
    ``paper4`` is here: most of that difference is the layout. It has the same L_data as ours there, 0.169 and 0.168
    with its weight. AUC tells little: masks drawn at random have 0.135 to 0.140.
    The end is no minimum: uniform grey has an L_data of 0.001, and its L_inv is twice as good. What the run ends on is
    how its dots froze, one by one, at steps of about one logit: with the inverse filter all but a few.
"""

from __future__ import annotations

import hashlib
import math
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from enum import StrEnum
from pathlib import Path

import numpy as np
import torch
from numpy.typing import NDArray

from maskfab.base.errors import InternalError, JobError
from maskfab.base.files import load_state, save_state
from maskfab.camera.scenes import Photograph
from maskfab.designs.descent.losses import top_residual
from maskfab.designs.descent.objective import (
    DTYPES,
    AreaPenalty,
    Objective,
    Precision,
    Weighted,
    cells_across,
    invertibility_of,
    tiled_stop,
)
from maskfab.job.camera import Camera
from maskfab.job.sections import RelaxSection
from maskfab.optics.tiling import orientations

EVEN = 1e-6  # spread of the start's transmissions below which it counts as even
PROBE_STEPS = 3
SAVED_EVERY = 50  # steps


class Outcome(StrEnum):
    """Reason for which a run ended."""

    FINISHED = "All steps were done."
    NOT_FINITE = "Stopped early: the loss or its gradient was not finite; the best before that is kept. Lower the rate."
    INTERRUPTED = "Stopped where it was told to; resume it from its checkpoint."


@dataclass(frozen=True)
class Descent:
    """Settings of a descent.

    Attributes:
        seed: of the first start; the k-th takes seed + k.
        starts: how many; the best result counts.
        rate: learning rate of Adam (Kingma & Ba 2015), on logits.
        momentum: its β1.
        start_logit: mean of the start; +1 is 0.73 open.
        settled: share of the steps after which the gain begins to grow.
        judged_every: steps between judgements of the binary unit; 0 takes the last one as it is.
        precision: of the logits; the objective's constants have their own.
        begin: whether each dot is clear at the start, row by row: its logit is the mean one or minus that; None for
            the mean everywhere.
    """

    dots: int
    clear_dots: int
    iterations: int
    seed: int = 0
    starts: int = 1
    rate: float = 0.2
    momentum: float = 0.9
    start_logit: float = 1.0
    start_noise: float = 0.5
    final_gain: float = 10.0
    settled: float = 0.4
    judged_every: int = 10
    precision: Precision = "float32"
    begin: tuple[bool, ...] | None = None

    def gain(self, iteration: int) -> float:
        """Gain of the sigmoid at a step: 1 until settled, then growing by an even factor."""
        done = iteration / max(self.iterations - 1, 1)
        if self.settled >= 1:
            return 1.0
        grown: float = self.final_gain ** max((done - self.settled) / (1 - self.settled), 0)
        return grown


@dataclass(frozen=True)
class RelaxStep:
    """Where the descent stands.

    Attributes:
        iteration: 0 to iterations - 1.
        loss: of the relaxed opening, without the area penalty.
        best_loss: loss of the best binary opening so far; infinite before the first.
    """

    iteration: int
    iterations: int
    loss: float
    open_ratio: float
    gain: float
    best_loss: float
    start: int = 0


@dataclass(frozen=True, eq=False)
class DescentResult:
    """Result of a run.

    Attributes:
        unit: float [dots, dots], 0 and 1, exactly as many clear as asked for; on the CPU.
        relaxed: the last start's last transmissions, [dots, dots].
        iterations: steps done, of all starts together.
    """

    unit: torch.Tensor
    loss: float
    relaxed: torch.Tensor
    iterations: int
    outcome: Outcome
    notes: tuple[str, ...]


def binarised(transmission: torch.Tensor, clear_dots: int) -> torch.Tensor:
    """The ``clear_dots`` largest transmissions set to one, the others to zero; of equals, the first ones."""
    order = torch.sort(transmission.flatten(), descending=True, stable=True).indices
    cell = torch.zeros_like(transmission.flatten())
    cell[order[:clear_dots]] = 1
    return cell.reshape(transmission.shape)


def descend(
    objective: Objective,
    penalty: AreaPenalty | None,
    how: Descent,
    *,
    progress: Callable[[RelaxStep], None] | None = None,
    checkpoint: Path | None = None,
    stop_after: int | None = None,
) -> DescentResult:
    """Descend from every start and keep the best binary unit.

    Args:
        objective: lower is better.
        penalty: leads the open ratio; the judgement of binary units is without it.
        checkpoint: file of the state; if it is there the run goes on from it, and it is kept up to date.
        stop_after: steps of this call, for a run in portions; the state is saved then.

    Raises:
        JobError: MF104 for a start on which nothing has any slope.
        SourceError: MF303, MF304 for a checkpoint that is damaged or another run's.
        OutputError: MF401 if the checkpoint cannot be written.
    """
    run = _Run(objective, penalty, how)
    key = run.key() if checkpoint is not None else ""
    if checkpoint is not None:
        state = load_state(checkpoint, key)
        if state is not None:
            run.restore(state)
    done = 0
    while run.start < how.starts:
        if stop_after is not None and done >= stop_after:
            run.outcome = Outcome.INTERRUPTED
            break
        if not run.ended:
            step = run.step()
            done += 1
            if progress is not None and step is not None:
                progress(step)
        if run.ended:
            run.next_start()
        if checkpoint is not None and (done % SAVED_EVERY == 0 or run.start == how.starts):
            save_state(checkpoint, key, run.state())
    if checkpoint is not None and run.outcome is Outcome.INTERRUPTED:
        save_state(checkpoint, key, run.state())
    return run.found()


def iterations_within(objective: Objective, penalty: AreaPenalty | None, how: Descent, seconds: float) -> int:
    """Steps per start in about so many seconds, by a few; at least one. Stored, the count repeats on any clock."""
    run = _Run(objective, penalty, how)
    run.step()
    begun = time.perf_counter()
    for _ in range(PROBE_STEPS):
        run.step()
    step_s = (time.perf_counter() - begun) / PROBE_STEPS
    return max(1, int(seconds / max(step_s, 1e-6) / how.starts))


class _Run:
    """A run's state: it is what a checkpoint holds."""

    def __init__(self, objective: Objective, penalty: AreaPenalty | None, how: Descent) -> None:
        self.objective, self.penalty, self.how = objective, penalty, how
        self.dtype = DTYPES[how.precision]
        self.device = _device(objective)
        self.judge = objective.at(-1, how.iterations)
        self.outcome = Outcome.FINISHED
        self.notes: list[str] = []
        self.overall: torch.Tensor | None = None
        self.overall_loss = math.inf
        self.total = 0
        self.start = 0
        self._begin()

    def _begin(self) -> None:
        how = self.how
        noise = np.random.default_rng(how.seed + self.start).standard_normal((how.dots, how.dots))
        even = 1.0 if how.begin is None else np.where(np.reshape(how.begin, noise.shape), 1.0, -1.0)
        values = how.start_logit * even + how.start_noise * noise
        self.logits = torch.tensor(values, dtype=self.dtype, device=self.device, requires_grad=True)
        self.optimiser = torch.optim.Adam([self.logits], lr=how.rate, betas=(how.momentum, 0.999))
        self.iteration = 0
        self.ended = False
        self.best, self.best_loss = binarised(self.logits.detach(), how.clear_dots), math.inf

    def step(self) -> RelaxStep | None:
        """One step; None if it came to nothing finite."""
        how, iteration = self.how, self.iteration
        gain = how.gain(iteration)
        transmission = torch.sigmoid(gain * self.logits)
        value, area = self.objective.at(iteration, how.iterations)(transmission), transmission.mean()
        total = value
        if self.penalty is not None:
            total = value + self.penalty.at(iteration, how.iterations)(transmission)
        self.optimiser.zero_grad()
        total.backward()  # type: ignore[no-untyped-call]
        slope = self.logits.grad
        assert slope is not None
        if not (math.isfinite(value.item()) and bool(torch.isfinite(slope).all())):
            if self.total == 0:
                self._look_for_flat(transmission.detach(), EVEN)
            self._not_finite(value.item())
            return None
        if iteration == 0:
            self._look_at_start(transmission.detach(), slope)
        self.optimiser.step()
        self.iteration += 1
        self.total += 1
        last = self.iteration == how.iterations
        if last or (how.judged_every and iteration % how.judged_every == how.judged_every - 1):
            self._judge(last)
        self.ended = self.ended or last
        return RelaxStep(iteration, how.iterations, value.item(), area.item(), gain, self.best_loss, self.start)

    def _judge(self, last: bool) -> None:
        candidate = binarised(self.logits.detach(), self.how.clear_dots)
        with torch.no_grad():
            loss = float(self.judge(candidate))
        if not math.isfinite(loss) and last:
            self._not_finite(loss)
            return
        if loss < self.best_loss or (last and not self.how.judged_every):
            self.best, self.best_loss = candidate, loss

    def _look_at_start(self, transmission: torch.Tensor, slope: torch.Tensor) -> None:
        self._look_for_flat(transmission)
        largest = float(slope.abs().max())
        if largest == 0:
            what = f"the objective has no slope at the start, {float(transmission.mean()):.3g} open: no dot changes it"
            raise JobError("MF104", what, where="design.objectives", cure="Weigh an objective that looks at the dots")
        if float(transmission.max() - transmission.min()) <= EVEN:
            spread = float(slope.max() - slope.min()) / largest
            self.notes.append(
                f"Start {self.start} is even, {float(transmission.mean()):.3g} open, which is a saddle: the slopes of "
                f"its dots differ by {spread:.1e} of their size."
            )

    def _look_for_flat(self, transmission: torch.Tensor, least: float = 0.0) -> None:
        """Refuse a start on which the sigmoid has no slope, or hardly any."""
        if float((transmission * (1 - transmission)).max()) <= least:
            what = (
                f"a start of logit {self.how.start_logit:g} has no slope at all: its transmissions are "
                f"{float(transmission.min()):.3g} to {float(transmission.max()):.3g}"
            )
            raise JobError("MF104", what, where="design.start_logit", cure="Start with noise, and nearer to 0")

    def _not_finite(self, value: float) -> None:
        if math.isinf(self.best_loss) and math.isinf(self.overall_loss) and not self._kept_what_is():
            what = f"the design's loss is {value} at iteration {self.iteration}; it and its gradient must be finite"
            raise InternalError("MF901", what, where="design", cure="Report it with the job file")
        self.outcome, self.ended = Outcome.NOT_FINITE, True
        self.notes.append(f"Start {self.start} was not finite at iteration {self.iteration}.")

    def _kept_what_is(self) -> bool:
        """Whether some step was done and its binary unit has a loss; it is kept then."""
        if self.iteration == 0:
            return False
        candidate = binarised(self.logits.detach(), self.how.clear_dots)
        with torch.no_grad():
            loss = float(self.judge(candidate))
        if math.isfinite(loss):
            self.best, self.best_loss = candidate, loss
        return math.isfinite(loss)

    def next_start(self) -> None:
        """Keep the best of this start, and begin the next one if there is any."""
        if self.overall is None or self.best_loss < self.overall_loss:
            self.overall, self.overall_loss = self.best, self.best_loss
        self.start += 1
        if self.start < self.how.starts:
            self._begin()

    def found(self) -> DescentResult:
        best, loss = self.best, self.best_loss
        if self.overall is not None and not loss < self.overall_loss:
            best, loss = self.overall, self.overall_loss
        gain = self.how.gain(max(self.iteration - 1, 0))
        relaxed = torch.sigmoid(gain * self.logits.detach()).cpu()
        return DescentResult(best.cpu(), loss, relaxed, self.total, self.outcome, tuple(self.notes))

    def key(self) -> str:
        """Key that tells this run from others: its settings, and the bits of the first loss."""
        with torch.no_grad():
            unit = torch.sigmoid(self.logits)
            first = float(self.objective.at(0, self.how.iterations)(unit)).hex()
        words = f"{self.how!r} {self.penalty!r} {type(self.objective).__name__} {first} {torch.__version__}"
        return hashlib.sha256(words.encode()).hexdigest()

    def state(self) -> dict[str, NDArray[np.generic]]:
        overall = self.best if self.overall is None else self.overall
        numbers = np.array([self.start, self.iteration, self.total, self.ended, self.overall is not None])
        moments = self.optimiser.state_dict()["state"].get(0, {})
        return {
            "numbers": numbers.astype(np.int64),
            "losses": np.array([self.best_loss, self.overall_loss]),
            "logits": self.logits.detach().cpu().numpy(),
            "best": self.best.cpu().numpy(),
            "overall": overall.cpu().numpy(),
            "outcome": np.array(self.outcome.name),
            "notes": np.array(self.notes, dtype=np.str_),
            **{f"moment_{name}": value.cpu().numpy() for name, value in moments.items() if value is not None},
        }

    def restore(self, state: Mapping[str, NDArray[np.generic]]) -> None:
        start, iteration, total, ended, has_overall = (int(v) for v in state["numbers"])
        self.start = start
        self._begin()
        self.iteration, self.total, self.ended = iteration, total, bool(ended)
        self.best_loss, self.overall_loss = (float(v) for v in state["losses"])
        with torch.no_grad():
            self.logits.copy_(torch.from_numpy(state["logits"]))
        self.best = torch.from_numpy(state["best"]).to(self.device)
        self.overall = torch.from_numpy(state["overall"]).to(self.device) if has_overall else None
        outcome = Outcome[str(state["outcome"])]
        self.outcome = Outcome.FINISHED if outcome is Outcome.INTERRUPTED else outcome
        self.notes = [str(note) for note in state["notes"]]
        moments = {name[7:]: torch.from_numpy(v) for name, v in state.items() if name.startswith("moment_")}
        if moments:
            groups = self.optimiser.state_dict()["param_groups"]
            self.optimiser.load_state_dict({"state": {0: moments}, "param_groups": groups})


def _device(objective: Objective) -> torch.device:
    """Where an objective's constants are; of a sum, those of its first term that has any."""
    if objective.correlation is not None:
        return objective.correlation.index.device
    for _, term in getattr(objective, "terms", ()):
        if term.correlation is not None:
            return _device(term)
    return torch.device("cpu")


EPOCHS = 150
_DATA, _INVERSION, _AREA = 10.0, 0.01, 10.0
_STAIR, _EPOCHS_PER_STAIR = 0.05, 5
_RATIO = 1e-13
_FALL, _TARGET = 0.8, 0.2
_CROPS, _SIDE = 20, 128


@dataclass(frozen=True, eq=False)
class Recipe:
    """An objective with its schedule; ``penalty`` leads the open ratio, None leaves it alone."""

    name: str
    objective: Objective
    penalty: AreaPenalty | None
    descent: Descent


def paper(section: RelaxSection, dot_nm: int, camera: Camera, scenes: Sequence[Photograph]) -> Recipe:
    """The published schedule, as the section's recipe and epochs have it; the stairs of the area are as many epochs
    wide, in proportion.

    Raises:
        JobError: MF104, MF105, MF111, MF115 as of its parts.
    """
    across = cells_across(camera.stop, section.dots, dot_nm)
    turned = orientations(section.tiling, across, across, section.tiling_seed, where="design.tiling_seed")
    stop = tiled_stop(section.dots, dot_nm, turned, camera, precision="float64")
    # Half a picture is dark margin on every side.
    data = top_residual(
        stop, scenes, side=_SIDE, margin=_SIDE // 2, crops=_CROPS, batch=1, beyond="dark", nsr=_RATIO, seed=section.seed
    )
    terms: list[tuple[float, Objective]] = [(_DATA, data)]
    if section.recipe == "paper-l2+inv":
        terms.append((_INVERSION, invertibility_of(stop, own_sum=True)))
    settled = _FALL / _STAIR * _EPOCHS_PER_STAIR / EPOCHS
    return Recipe(
        str(section.recipe),
        Weighted(tuple(terms)),
        AreaPenalty(_TARGET, _AREA, settled, _STAIR),
        Descent(
            dots=section.dots,
            clear_dots=section.clear_dots,
            iterations=section.epochs * data.batches,
            seed=section.seed,
            rate=1.0,
            momentum=0.5,
            start_noise=0.0,
            final_gain=1.0,
            judged_every=0,
            precision="float64",
        ),
    )
