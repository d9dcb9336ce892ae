"""A run of training: it ends by the clock, judges what it has by scenes that are not taught, and keeps it in a file."""

from __future__ import annotations

import time
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
from maskfab.optics.numbers.colour import code_of_light
from maskfab.progress import Progress

LOOKS = 10
"""Times that a run judges and keeps what it has."""


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
        earlier_s: seconds that it took before.
        begun_s: of ``time.monotonic``.
    """

    path: Path
    trade: Trade
    design: Design
    training: Training
    view: View
    scenes: Sequence[Lesson]
    history: list[Mapping[str, float]] = field(default_factory=list)
    earlier_s: float = 0.0
    begun_s: float = field(default_factory=time.monotonic)

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
        progress: Progress,
    ) -> Run:
        """One that begins, or goes on from a checkpoint."""
        begun, levels = time.monotonic(), trade.levels
        kept, others = kept_for_validation(photographs, max(2, len(levels)), lamps=bool(protocol.brackets))
        progress("scenes to judge by", 0, len(kept))
        view = before.view if before else fitted(protocol, design, levels, kept)
        lessons = Lessons(protocol, design, levels, view, others, course.seed)
        scenes = []
        for done, scene in enumerate(kept):
            scenes.append(lessons.of(scene, levels[done % len(levels)]))
            progress("scenes to judge by", done + 1, len(kept))
        made = cls(path, trade, design, Training(course, lessons, device), view, scenes, begun_s=begun)
        if before is not None:
            made.training.restore(before.state)
            made.history.extend(before.history)
            made.earlier_s = before.seconds
        return made

    def until(self, seconds: float, progress: Progress) -> Checkpoint:
        """Train so many seconds from the beginning, one step at least.

        Raises:
            OutputError: MF401 if the checkpoint cannot be written.
        """
        losses, looks = list[float](), 0
        while True:
            losses.append(self.training.advance())
            share = (time.monotonic() - self.begun_s) / seconds
            if share >= (looks + 1) / LOOKS:
                looks = min(LOOKS, int(share * LOOKS))
                found = self._kept(float(np.mean(losses)))
                losses.clear()
                progress(told(self.history[-1]), looks, LOOKS)
                if looks == LOOKS:
                    return found

    def _kept(self, loss: float) -> Checkpoint:
        seconds = self.earlier_s + time.monotonic() - self.begun_s
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


def fitted(protocol: Protocol, design: Design, levels: Sequence[float], scenes: Sequence[Photograph]) -> View:
    """The view whose second picture suits the scenes best, on average at every level."""
    strengths = {}
    for level in levels:
        table = evaluate([design], scenes, scenes, [level], protocol=protocol, restorers=(Dct(),), details=False)
        strengths[protocol.exposure(level).behind(design.transmission)] = table.scores[0].epsilon
    return View(strengths)
