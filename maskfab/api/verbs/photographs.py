"""Photographs through the dies of a plate, restored and scored."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from maskfab.api.camera import Camera
from maskfab.api.folders import given_folder
from maskfab.api.jobs import AnyJob, dies_of, job_of
from maskfab.api.verbs.learning import LEARNED, learned_restorers, read_checkpoints
from maskfab.base.checks import checked_arguments
from maskfab.base.errors import JobError
from maskfab.base.model import Panel
from maskfab.base.work import Progress, one_thread, silent
from maskfab.camera import scenes as scene_sets
from maskfab.camera import scenes as surroundings
from maskfab.camera.die_transfer import by_sentence
from maskfab.camera.imaging import LARGE, Design
from maskfab.camera.lens import camera_line
from maskfab.camera.protocol import AUTO, evaluate
from maskfab.camera.record import Restorer
from maskfab.camera.restorers.wiener import Wiener
from maskfab.camera.scenes import Folder, Photograph
from maskfab.camera.scores import CONFIDENCE, Crop, Gain, Score, ScoreTable, Shot, truth_of
from maskfab.job.reference import unused
from maskfab.mask.job import Job
from maskfab.report.rows.photographs import Conditions, Light, ProtocolName, Surroundings, uses_of
from maskfab.report.rows.text import dataframe

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
        conditions: that they were taken under.
        left_out: sentences on what the photographs of every die leave out.
        refused: why dies that nobody named could not be photographed, by name.
        scenes: that were photographed.
        skipped: files of the folder that are no photographs.
        shown: part of the first scene by die, one shot for each level of light; empty unless they were kept.
    """

    table: ScoreTable
    reference: str
    conditions: Conditions
    left_out: Mapping[str, tuple[str, ...]]
    refused: Mapping[str, str]
    scenes: Sequence[Photograph]
    skipped: tuple[str, ...]
    shown: Mapping[str, Sequence[Shot]]

    def picture(self) -> bytes:
        """A PNG of the truth and each die, one row for each level of light.

        Raises:
            JobError: MF105 if no pictures were kept.
        """
        from maskfab.report.figures.scene import sheet

        if not self.shown:
            raise JobError("MF105", "no pictures were kept", where="simulate", cure="Call it with pictures=True")
        kind = self.conditions.protocol
        how = f"protocol {kind.name} {'in linear light' if kind.linear else 'in code values'}"
        return sheet(truth_of(self.scenes[0], _CROP), self.scenes[0].name, self.shown, how)

    def to_dict(self) -> dict[str, Any]:
        """Scores, gains over the reference, and what they were taken with."""
        return {
            "left_out": {name: list(told) for name, told in self.left_out.items()},
            "refused": dict(self.refused),
            **self.conditions.to_dict(),
            "reference": self.reference,
            "scenes": [scene.name for scene in self.scenes],
            "skipped": list(self.skipped),
            "scores": [_scored(self.table, score) for score in self.table.scores],
            "gains": [_document(gain) for gain in self.table.gains(self.reference)],
        }

    def to_dataframe(self) -> DataFrame:
        """One row for each die, level of light, restorer and scene.

        Raises:
            OutputError: MF431 without pandas.
        """
        return dataframe([vars(score) for score in self.table.scores])

    def __str__(self) -> str:
        many = len(self.scenes) > 1
        interval = f"± is the {CONFIDENCE:.0%} interval of the mean over {len(self.scenes)} scenes, by Student's t"
        below = [f"{interval}; a tie is one that holds 0." if many else "One scene: differences have no interval."]
        if self.skipped:
            below.append(f"Skipped, as no photographs: {', '.join(self.skipped)}.")
        below += [f"Not photographed: {name}, {reason}." for name, reason in self.refused.items()]
        table = _lines(self.table, self.reference)
        return "\n".join([*self.conditions.lines, *table, *below, *by_sentence(self.left_out)])

    def _repr_png_(self) -> bytes | None:
        return self.picture() if self.shown else None


@checked_arguments
@one_thread
def simulate(
    job: AnyJob,
    camera: Camera | None = None,
    *,
    die: str | Sequence[str] | None = None,
    reference: str | None = None,
    images: str | Path | None = None,
    white: float | None = None,
    whole: bool = False,
    protocol: ProtocolName = "camera",
    light: Light | None = None,
    levels: Sequence[float] | None = None,
    brackets: Sequence[float] | None = None,
    restore: str | Sequence[str] | None = None,
    checkpoints: Sequence[str | Path] = (),
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
        white: light that is white in photographs that hold light, EXR and HDR; it must be stated if they hold more
            than 1.
        whole: photograph whole pictures, 60 million pixels together at most, rather than their middle, on which
            restorers are tuned in either case; those of more than 8 million pixels are restored by the Wiener filter.
        protocol: ``"camera"`` for the job's camera, sensor, exposure and light, ``"f1"`` or ``"paper"`` for that
            protocol's.
        light: ``"linear"`` or ``"code"`` values taken for light; by default the protocol's own, linear for the camera.
        levels: signal-to-noise ratios of white behind the published display, dB; by default those of the job.
        brackets: exposures that are taken of every scene and merged, as the times by which their light is less than
            the level's, such as 1, 4 and 16; by default those of the job. The photographs are EXR or HDR with light
            above ``white``; drawn scenes get lamps.
        restore: one or several restorers, by default ``"wiener"`` or the protocol's own; ``"auto"`` takes for each
            photograph the one that its record alone speaks for, of those named beside it or of all of
            :data:`maskfab.camera.restorers.FILES`.
        checkpoints: files of :func:`maskfab.api.verbs.learning.learn`, one for each die: one more restorer,
            ``"learned"``, beside those named.
        pictures: keep part of the photographs of the first scene, by the last restorer.
        progress: told where the work stands.

    Raises:
        JobError: MF105 for an unknown die or protocol, MF142 for pictures that take more memory than there should be,
            MF122 if no die can be judged, MF134 without three colours,
            MF140 or MF141 for a sensor or a light that cannot be, MF143 for brackets of scenes without highlights,
            MF148 for a checkpoint of another die, camera, sensor or light, or a die without one where some have.
        SourceError: MF301, MF303, MF304 for a checkpoint that is missing, damaged or none.
    """
    loaded = job_of(job, camera)
    asked = Conditions.of(loaded, protocol, levels, light, brackets)
    trained = read_checkpoints(checkpoints)
    restorers, choose = _restorers(asked, restore, learned=bool(trained))
    given = given_folder(images, white, whole=whole)
    if given is not None:
        kinds = [*(each.name for each in restorers), *([LEARNED] if trained else [])]
        _require_memory(given.photographs, kinds, brackets=bool(asked.protocol.brackets))
    for scene in given.photographs if given else ():
        asked.protocol.check(scene)
    panels = loaded.panels()
    wanted = dies_of(die, panels)
    if reference is not None:
        dies_of(reference, wanted)
    # The dies are looked at last, for that takes longest.
    found, refused = _designs(loaded, asked, {name: panels[name] for name in wanted}, named=bool(die))
    designs = [design for design, _ in found]
    dies = [each.name for each in designs]
    learned = learned_restorers(trained, loaded, asked, designs)
    base = dies[0] if reference is None else dies_of(reference, dies)[0]
    source = Folder(scene_sets.drawn(highlights=bool(asked.protocol.brackets)), ()) if given is None else given
    scenes = source.photographs
    middles = tuple(each.middle for each in scenes) if whole else scenes
    last = AUTO if choose else LEARNED if learned else restorers[-1].name
    shown: dict[str, list[Shot]] = {name: [] for name in dies} if pictures else {}

    def show(score: Score, whole: NDArray[np.float32]) -> None:
        if pictures and score.scene == scenes[0].name and score.restorer == last:
            shown[score.design].append(Shot(score, _CROP.of(whole)))

    scores: list[Score] = []
    assumed = {design.name: (*told, *surroundings.messages(design, scenes)) for design, told in found}
    del found
    for done in range(len(dies)):
        progress("photographs", done, len(dies))
        # Transfers over the field take half a gigabyte, and go with their die.
        each = designs.pop(0)
        scores += evaluate(
            [each], scenes, middles, asked.levels,
            protocol=asked.protocol, restorers=(*restorers, *learned.get(each.name, ())), choose=choose, show=show,
        ).scores  # fmt: skip
        assumed[each.name] += each.told
    progress("photographs", len(dies), len(dies))
    table = ScoreTable(tuple(scores))
    reasons = {name: f"{refusal.code} {refusal.what}" for name, refusal in refused.items()}
    asked = replace(asked, unused=unused(loaded.spec, *uses_of(loaded, protocol)))
    return Simulation(table, base, asked, assumed, reasons, scenes, source.skipped, shown)


def _require_memory(scenes: Sequence[Photograph], restorers: Sequence[str], *, brackets: bool) -> None:
    """Refuse what takes more memory than a large picture leaves."""
    others = [f"restorer {name} keeps" for name in restorers if name != Wiener().name]
    others += ["brackets keep"] if brackets else []
    for scene in scenes:
        if others and scene.values[0].size > LARGE:
            raise JobError(
                "MF142",
                f"{others[0]} too much of {scene.values[0].size / 1e6:.3g} million pixels; the limit is "
                f"{LARGE / 1e6:g} million",
                where=scene.name,
                cure="Take one exposure and restore it by wiener alone, or photograph the middle",
            )


def _restorers(
    asked: Conditions, names: str | Sequence[str] | None, *, learned: bool
) -> tuple[tuple[Restorer, ...], bool]:
    """Those that are named but learned ones, as :meth:`maskfab.report.rows.photographs.Conditions.restorers`.

    Raises:
        JobError: MF105 for a learned one that nothing holds, or as there.
    """
    given = (names,) if isinstance(names, str) else names
    if given is None or LEARNED not in given:
        return asked.restorers(given)
    if not learned:
        raise JobError(
            "MF105",
            "no checkpoint holds the restorer learned",
            where="restore",
            cure="Train one with maskfab learn, and give it with --checkpoint FILE",
        )
    others = tuple(name for name in given if name != LEARNED)
    return asked.restorers(others) if others else ((), False)


def _designs(
    job: Job, asked: Conditions, panels: Mapping[str, Panel], *, named: bool
) -> tuple[list[tuple[Design, tuple[str, ...]]], dict[str, JobError]]:
    """Dies as they are photographed, with sentences on what is left out; and why others cannot be.

    Raises:
        JobError: for the first that cannot be where dies are ``named``; where none can, as the first if all are refused
            for one reason, MF122 for several.
    """
    found, refused = [], dict[str, JobError]()
    for name, panel in panels.items():
        try:
            found.append(asked.design(name, panel, Surroundings.of(job)))
        except JobError as refusal:
            refused[name] = refusal
            if named:
                raise
    if not found:
        if len({refusal.code for refusal in refused.values()}) == 1:
            raise next(iter(refused.values()))
        raise JobError(
            "MF122",
            f"no die can be judged behind a camera of {camera_line(asked.camera)}",
            where=job.where,
            cure="Name one die to see why",
        )
    return found, refused


def _scored(table: ScoreTable, score: Score) -> dict[str, Any]:
    """A score as data, with its regret where a restorer was chosen."""
    return vars(score) | ({"regret": table.regret(score)} if score.chosen else {})


def _document(gain: Gain) -> dict[str, Any]:
    """A gain as data; a single photograph has no interval."""
    means = {key: getattr(gain, key) for key in ("psnr", "psnr_inner", "ssim", "delta_e")}
    return {
        "design": gain.design,
        "level_db": gain.level_db,
        "restorer": gain.restorer,
        "scenes": gain.psnr.count,
        **{
            key: {
                "mean": found.mean,
                "half_width_95": None if math.isnan(found.half_width) else found.half_width,
                "tie": found.tie,
            }
            for key, found in means.items()
        },
    }


def _lines(table: ScoreTable, reference: str) -> list[str]:
    rows = [("die", "level", "restorer", "PSNR", "inner", "SSIM", "S-CIELAB", f"gain over {reference}", "inner")]
    gains = {(gain.design, gain.level_db, gain.restorer): gain for gain in table.gains(reference)}
    for case in dict.fromkeys((score.design, score.level_db, score.restorer) for score in table.scores):
        own = [score for score in table.scores if (score.design, score.level_db, score.restorer) == case]
        mean = [
            sum(getattr(score, key) for score in own) / len(own) for key in ("psnr", "psnr_inner", "ssim", "delta_e")
        ]
        gain = gains.get(case)
        told = ("", "") if gain is None else (gain.psnr.told(), gain.psnr_inner.told())
        design, level, _ = case
        rows.append(
            (
                design,
                f"{level:.4g} dB",
                table.winners(own),
                f"{mean[0]:.2f} dB",
                f"{mean[1]:.2f} dB",
                f"{mean[2]:.3f}",
                f"{mean[3]:.2f}",
                *told,
            )
        )
    widths = [max(len(row[k]) for row in rows) for k in range(len(rows[0]))]
    return ["  ".join(cell.ljust(width) for cell, width in zip(row, widths, strict=True)).rstrip() for row in rows]
