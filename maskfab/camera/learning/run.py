"""A run of training: it ends by the clock, judges what it has by scenes that are not taught, and keeps it in a file."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from maskfab.camera.design import Design
from maskfab.camera.learning.checkpoint import Checkpoint, Trade
from maskfab.camera.learning.lessons import Lesson, Lessons, kept_for_validation
from maskfab.camera.learning.network import COLOURS
from maskfab.camera.learning.training import Course, Training
from maskfab.camera.learning.view import View, light_of
from maskfab.camera.photographs import Photograph
from maskfab.camera.protocol import Protocol, evaluate
from maskfab.camera.quality import psnr
from maskfab.camera.restorers.dct import Dct
from maskfab.camera.restorers.learned import Learned
from maskfab.clock import Clock
from maskfab.optics.numbers.colour import code_of_light
from maskfab.progress import Progress

LOOKS = 10
"""Times that a run judges and keeps what it has."""

SET_UP = "the scenes that training is judged by"


@dataclass
class Run:
    """A training, and how it went so far.

    Attributes:
        path: of the checkpoint.
        trade: the die, camera and light.
        design: of the die.
        training: where it stands.
        view: of records.
        scenes: that it is judged by.
        history: as of :class:`maskfab.camera.learning.checkpoint.Checkpoint`.
        clock: of the budget, from the beginning of the command's work.
        earlier_s: seconds that it took before.
    """

    path: Path
    trade: Trade
    design: Design
    training: Training
    view: View
    scenes: Sequence[Lesson]
    history: list[Mapping[str, float]] = field(default_factory=list)
    clock: Clock = field(default_factory=Clock)
    earlier_s: float = 0.0

    @classmethod
    def of(
        cls,
        path: Path,
        trade: Trade,
        protocol: Protocol,
        design: Design,
        photographs: Sequence[Photograph],
        *,
        course: Course,
        device: str,
        before: Checkpoint | None,
        clock: Clock,
        progress: Progress,
    ) -> Run:
        """One that begins, or goes on from a checkpoint.

        Raises:
            JobError: MF150 for a clock that refuses what it cannot keep, as soon as the scenes done show it.
        """
        levels = trade.levels
        # What is to come takes no less than what made the die ready.
        clock.require(clock.spent, SET_UP, "minutes")
        kept, others = kept_for_validation(photographs, max(2, len(levels)), lamps=bool(protocol.brackets))
        progress("scenes to judge by", 0, len(kept))
        view = before.view if before else fitted(protocol, design, levels, kept, clock)
        lessons = Lessons(protocol, design, levels, view, others, course.seed)
        scenes = []
        begun = clock.spent
        for done, scene in enumerate(kept, start=1):
            scenes.append(lessons.of(scene, levels[(done - 1) % len(levels)]))
            progress("scenes to judge by", done, len(kept))
            clock.require((clock.spent - begun) / done * (len(kept) - done), SET_UP, "minutes")
        made = cls(path, trade, design, Training(course, lessons, device), view, scenes, clock=clock)
        if before is not None:
            made.training.restore(before.state)
            made.history.extend(before.history)
            made.earlier_s = before.seconds
        return made

    def trained(self, progress: Progress) -> Checkpoint:
        """Train as long as the budget, one step at least; the last look, which takes as long as one before, is in it.

        Raises:
            JobError: MF150 for a clock that refuses what it cannot keep, if the first step and look show it.
            OutputError: MF401 if the checkpoint cannot be written.
        """
        seconds = math.inf if self.clock.budget_s is None else self.clock.budget_s
        losses, looks, step, look = list[float](), 0, 0.0, 0.0
        while True:
            begun = self.clock.spent
            losses.append(self.training.advance())
            spent = self.clock.spent
            step = max(step, spent - begun)
            if not look:
                self.clock.require(0.0, f"{SET_UP}, and a step", "minutes")
            over = spent + step + look >= seconds
            # The first look tells how long the last one takes.
            if over or not look or spent / seconds >= (looks + 1) / LOOKS:
                looks = int(spent / seconds * LOOKS)
                found = self._kept(float(np.mean(losses)))
                look = max(look, self.clock.spent - spent, 1e-9)
                over = over or self.clock.spent + step + look > seconds
                losses.clear()
                progress(told(self.history[-1]), LOOKS if over else looks, LOOKS)
                if over:
                    return found

    def _kept(self, loss: float) -> Checkpoint:
        seconds = self.earlier_s + self.clock.spent
        self.history.append({"minutes": seconds / 60, "step": self.training.step, "loss": loss, **self.gains()})
        training = self.training
        found = Checkpoint(self.trade, training.course, self.view, seconds, tuple(self.history), training.state())
        found.write(self.path)
        return found

    def gains(self) -> dict[str, float]:
        """Mean gains over both pictures that are shown, dB, on scenes that are not taught."""
        restorer, rows = Learned(self.training.mean, self.view), []
        for scene in self.scenes:
            pictures = scene.shown[:COLOURS], scene.shown[COLOURS : 2 * COLOURS]
            before = [psnr(code_of_light(light_of(each)), scene.true) for each in pictures]
            now = psnr(code_of_light(restorer.restored(scene.shown, self.design)), scene.true)
            rows.append([now - each for each in before])
        over_tv, over_filter = np.mean(rows, axis=0)
        return {"gain": float(over_tv), "gain_over_filter": float(over_filter)}


def told(row: Mapping[str, float]) -> str:
    """A row of a history in words."""
    gains = f"{row['gain']:+.2f} dB over tv, {row['gain_over_filter']:+.2f} dB over dct+wiener"
    return f"{row['step']:.0f} steps, loss {row['loss']:.3f}, {gains}"


def fitted(
    protocol: Protocol, design: Design, levels: Sequence[float], scenes: Sequence[Photograph], clock: Clock
) -> View:
    """The view whose second picture suits the scenes best, on average at every level.

    Raises:
        JobError: MF150 as :meth:`Run.of`.
    """
    strengths, begun = {}, clock.spent
    for done, level in enumerate(levels, start=1):
        table = evaluate([design], scenes, scenes, [level], protocol=protocol, restorers=(Dct(),), details=False)
        strengths[protocol.exposure(level).behind(design.transmission)] = table.scores[0].epsilon
        clock.require((clock.spent - begun) / done * (len(levels) - done), SET_UP, "minutes")
    return View(strengths)
