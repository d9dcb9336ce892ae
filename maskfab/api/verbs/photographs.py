"""Photographs through the dies of a plate, restored and scored."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

import numpy as np
from numpy.typing import NDArray

from maskfab.api.camera import Camera
from maskfab.api.jobs import AnyJob, dies_of, job_of
from maskfab.camera import scenes as scene_sets
from maskfab.camera.laid_panel import laid_panel
from maskfab.camera.photo_camera import F1, PhotoCamera, camera_line
from maskfab.camera.photographs import Photograph, folder
from maskfab.camera.protocol import ASSUMED, Score, ScoreTable, evaluate
from maskfab.camera.shots import Crop, Shot, truth_of
from maskfab.errors import JobError
from maskfab.progress import Progress, silent
from maskfab.report.quantities import dataframe
from maskfab.threads import one_thread

if TYPE_CHECKING:
    from pandas import DataFrame

_CROP = Crop(160, 200)
"""Part of the sensor that a picture shows of every photograph."""


@dataclass(frozen=True, eq=False, repr=False)
class Simulation:
    """Restored photographs through every die.

    Attributes:
        table: all scores.
        reference: the die that gains are over.
        camera: that took them.
        scenes: that were photographed.
        shown: part of the first scene by die, one shot for each level of light; empty unless they were kept.
    """

    table: ScoreTable
    reference: str
    camera: PhotoCamera
    scenes: Sequence[Photograph]
    shown: Mapping[str, Sequence[Shot]]

    def picture(self) -> bytes:
        """A PNG of the truth and each die, one row for each level of light.

        Raises:
            JobError: MF105 if no pictures were kept.
        """
        from maskfab.report.plots.design_figures import sheet

        if not self.shown:
            raise JobError("MF105", "no pictures were kept", where="simulate", cure="Call it with pictures=True")
        return sheet(truth_of(self.scenes[0], _CROP), self.scenes[0].name, self.shown)

    def to_dict(self) -> dict[str, Any]:
        """Scores, gains over the reference, and what they were taken with."""
        return {
            "assumed": ASSUMED,
            "protocol": "f1" if self.camera.is_f1 else None,
            "camera": camera_line(self.camera),
            "reference": self.reference,
            "scenes": [scene.name for scene in self.scenes],
            "scores": [vars(score) for score in self.table.scores],
            "gains": [
                {key: _known(value) for key, value in vars(gain).items()} for gain in self.table.gains(self.reference)
            ],
        }

    def to_dataframe(self) -> DataFrame:
        """One row for each die, level of light and scene.

        Raises:
            OutputError: MF431 without pandas.
        """
        return dataframe([vars(score) for score in self.table.scores])

    def __str__(self) -> str:
        camera = [] if self.camera.is_f1 else [f"camera: {camera_line(self.camera)}; levels of light of protocol F1"]
        return "\n".join([*camera, *_lines(self.table, self.reference), f"Assumed: {ASSUMED}."])

    def _repr_png_(self) -> bytes | None:
        return self.picture() if self.shown else None


@one_thread
def simulate(
    job: AnyJob,
    camera: Camera | None = None,
    *,
    die: str | Sequence[str] | None = None,
    reference: str | None = None,
    images: str | Path | None = None,
    protocol: Literal["f1"] | None = None,
    pictures: bool = False,
    progress: Progress = silent,
) -> Simulation:
    """Simulate noisy photographs through each die, restore and score them.

    Args:
        job: a plate, a loaded job, or the path of a job file.
        camera: of a plate; by default its own. It has three wavelengths.
        die: one or several; by default all that can be judged.
        reference: die to compare with; by default the first.
        images: folder of photographs; synthetic scenes if None.
        protocol: ``"f1"`` for the camera of that protocol in place of the job's.
        pictures: keep part of the photographs of the first scene.
        progress: told where the work stands.

    Raises:
        JobError: MF105 for an unknown die or protocol, MF122 if no die can be judged, MF134 without three wavelengths.
    """
    if protocol not in (None, "f1"):
        raise JobError("MF105", f"there is no protocol {protocol!r}", where="protocol", cure="Use f1")
    loaded = job_of(job, camera)
    seen = F1 if protocol else PhotoCamera.of(loaded.camera, where=loaded.where, colours=True)
    panels = {each.name: each.panel for each in loaded.plate().dies}
    laid = []
    for name in dies_of(die, panels):
        try:
            laid.append(laid_panel(name, panels[name], seen))
        except JobError:
            if die:
                raise
    if not laid:
        raise JobError(
            "MF122",
            f"no die can be judged behind a camera of {camera_line(seen)}",
            where=loaded.where,
            cure="Name one die to see why",
        )
    names = [each.name for each in laid]
    base = names[0] if reference is None else dies_of(reference, names)[0]
    scenes = scene_sets.bundled() if images is None else folder(Path(images))
    shown: dict[str, list[Shot]] = {name: [] for name in names} if pictures else {}

    def show(score: Score, whole: NDArray[np.float32]) -> None:
        if pictures and score.scene == scenes[0].name:
            shown[score.design].append(Shot(score, _CROP.of(whole)))

    scores: list[Score] = []
    for done, each in enumerate(laid):
        progress("photographs", done, len(laid))
        scores += evaluate([each], scenes, scenes, show=show).scores
    progress("photographs", len(laid), len(laid))
    return Simulation(ScoreTable(tuple(scores)), base, seen, scenes, shown)


def _known(value: object) -> object:
    """A single photograph has no standard error."""
    return None if isinstance(value, float) and math.isnan(value) else value


def _lines(table: ScoreTable, reference: str) -> list[str]:
    rows = [("die", "level", "PSNR", "inner", "SSIM", f"gain over {reference}", "inner")]
    gains = {(gain.design, gain.level_db): gain for gain in table.gains(reference)}
    for design, level in dict.fromkeys((score.design, score.level_db) for score in table.scores):
        own = [score for score in table.scores if (score.design, score.level_db) == (design, level)]
        mean = [sum(getattr(score, key) for score in own) / len(own) for key in ("psnr", "psnr_inner", "ssim")]
        gain = gains.get((design, level))
        told = ("", "") if gain is None else (
            f"{gain.psnr:+.2f} ± {gain.psnr_error:.2f} dB", f"{gain.psnr_inner:+.2f} ± {gain.psnr_inner_error:.2f} dB",
        )  # fmt: skip
        rows.append((design, f"{level} dB", f"{mean[0]:.2f} dB", f"{mean[1]:.2f} dB", f"{mean[2]:.3f}", *told))
    widths = [max(len(row[k]) for row in rows) for k in range(len(rows[0]))]
    return ["  ".join(cell.ljust(width) for cell, width in zip(row, widths, strict=True)).rstrip() for row in rows]
