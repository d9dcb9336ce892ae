"""Photographs through the dies of a plate, restored and scored by protocol ``camera``: what a report says of them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cache, cached_property

import numpy as np
from numpy.typing import NDArray

from maskfab.camera import scenes as scene_sets
from maskfab.camera.intervals import CONFIDENCE
from maskfab.camera.photographs import Photograph
from maskfab.camera.protocol import evaluate
from maskfab.camera.scores import Gain, Score, ScoreTable
from maskfab.camera.shots import Crop, Shot, truth_of
from maskfab.errors import JobError
from maskfab.measurement.conditions import Conditions, Surroundings
from maskfab.model import Panel, Quantity

CROP = Crop(144, 192)
"""Part of the photographs that is shown."""
NOISE_DB = 0.05
"""By which another draw of the noise changes a mean over the scenes at most."""


@dataclass(frozen=True, eq=False)
class Restored:
    """Photographs behind one die.

    Attributes:
        scores: of every scene at every level of light; none if it cannot be photographed.
        left_out: sentences on what the photographs leave out.
        refused: why the die cannot be photographed; None if it can.
        scene: of the photographs that are shown; None if none are.
        truth: part of that scene, float32 [3, rows, columns], row 0 on top; None likewise.
        shots: the same part of its restored photographs, at levels of light.
    """

    scores: tuple[Score, ...] = ()
    left_out: tuple[str, ...] = ()
    refused: str | None = None
    scene: str | None = None
    truth: NDArray[np.float32] | None = None
    shots: tuple[Shot, ...] = ()

    def psnr(self, level_db: float) -> float:
        """Mean over the scenes, whole frame, in dB."""
        own = [score.psnr for score in self.scores if score.level_db == level_db]
        return float(np.mean(own))


@dataclass(frozen=True, eq=False)
class Photographs:
    """Photographs behind the dies of one plate.

    Attributes:
        conditions: that they were taken under.
        dies: by name, in the plate's order.
        stated: the die that the job wants gains to be over; None if it names none.
    """

    conditions: Conditions
    dies: Mapping[str, Restored]
    stated: str | None = None

    @cached_property
    def table(self) -> ScoreTable:
        """Scores of all dies."""
        return ScoreTable(tuple(score for die in self.dies.values() for score in die.scores))

    @property
    def reference(self) -> str | None:
        """The die that gains are over: the one that the job names, or the first, if it can be photographed."""
        asked = self.dies if self.stated is None else (self.stated,)
        return next((name for name in asked if self.dies[name].scores), None)

    @cached_property
    def gains(self) -> Mapping[str, tuple[Gain, ...]]:
        """Paired gains over the reference, by die, of those that were photographed."""
        reference = self.reference
        every = () if reference is None else self.table.gains(reference)
        return {name: tuple(gain for gain in every if gain.design == name) for name in self.dies}

    def quantities(self, name: str) -> tuple[Quantity, ...]:
        """Rows of a die: its PSNR and its gain at every level of light, or why there is none."""
        die = self.dies[name]
        if die.refused is not None:
            told = "photographs behind this die are not taken, for this reason"
            return (Quantity("photographs_refused", die.refused, told, die=name),)
        scenes = len({score.scene for score in die.scores})
        how = f"{'; '.join(self.conditions.lines)}; {scenes} drawn scenes, restored by the Wiener filter"
        means = [
            Quantity(
                "restored_psnr",
                die.psnr(level),
                f"mean over the scenes: {how}; error: another draw of the noise; other scenes have other means, see "
                "the paired gain",
                uncertainty=NOISE_DB,
                die=name,
                level_db=level,
            )
            for level in self.conditions.levels
        ]
        gains = [
            Quantity(
                "restored_gain",
                gain.psnr.mean,
                f"mean of the differences to {self.reference}, scene by scene: {how}; error: half the {CONFIDENCE:.0%} "
                f"interval by Student's t; {'a tie, for it holds 0' if gain.psnr.tie else 'it does not hold 0'}",
                uncertainty=gain.psnr.half_width,
                die=name,
                level_db=gain.level_db,
            )
            for gain in self.gains[name]
        ]
        return (*means, *gains)


def middle_level(levels_db: Sequence[float]) -> float:
    """The level of light that stands for all where there is room for one."""
    return sorted(levels_db)[len(levels_db) // 2]


def photograph_die(conditions: Conditions, around: Surroundings, name: str, panel: Panel, shown: bool) -> Restored:
    """Photograph the drawn scenes through one die.

    Args:
        conditions: of the job.
        around: what lies about the die.
        name: of the die.
        panel: of it.
        shown: keep part of the first scene in least light and in most, not at the middle level alone.
    """
    scenes, shots = drawn_scenes(highlights=bool(conditions.protocol.brackets)), list[Shot]()
    levels = {middle_level(conditions.levels)}
    if shown:
        levels |= {min(conditions.levels), max(conditions.levels)}

    def keep(score: Score, whole: NDArray[np.float32]) -> None:
        if score.scene == scenes[0].name and score.level_db in levels:
            shots.append(Shot(score, CROP.of(whole)))

    try:
        design, told = conditions.design(name, panel, around)
        table = evaluate(
            [design], scenes, scenes, conditions.levels, protocol=conditions.protocol, details=False, show=keep
        )
    except JobError as refusal:
        return Restored(refused=f"{refusal.code} {refusal.what}")
    told += design.told
    return Restored(table.scores, told, None, scenes[0].name, truth_of(scenes[0], CROP), tuple(shots))


@cache
def drawn_scenes(*, highlights: bool) -> tuple[Photograph, ...]:
    """The scenes, and with them their spectra, for all dies of a process."""
    return scene_sets.drawn(highlights=highlights)
