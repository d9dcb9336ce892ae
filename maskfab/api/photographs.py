"""Photographs through the dies of a plate, restored and scored, and restorers that are learned from them."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, overload

import numpy as np
from numpy.typing import NDArray

from maskfab.api.asked import AnyJob, dies_of, given_folder, laid_out, refuse_stated
from maskfab.api.camera import Camera
from maskfab.api.pairs import PairSet
from maskfab.api.pairs import pairs as of_photographs
from maskfab.api.results import Asked, InPython, Result, Told, answers
from maskfab.base.checks import checked_arguments
from maskfab.base.errors import JobError
from maskfab.base.extras import require
from maskfab.base.folders import check_file, write_bytes
from maskfab.base.work import Clock, Progress, one_thread, silent
from maskfab.base.workers import Workers
from maskfab.camera import scenes as scene_sets
from maskfab.camera import scenes as surroundings
from maskfab.camera.die_transfer import by_sentence
from maskfab.camera.imaging import LARGE
from maskfab.camera.protocol import AUTO, evaluate
from maskfab.camera.record import Restorer
from maskfab.camera.restorers.wiener import Wiener
from maskfab.camera.scenes import Folder, Photograph
from maskfab.camera.scores import CONFIDENCE, Crop, Score, ScoreTable, Shot, truth_of
from maskfab.findings.photographs import (
    LEARNED,
    Conditions,
    Light,
    ProtocolName,
    Surroundings,
    learned_restorers,
    read_checkpoints,
    trade_of,
    uses_of,
)
from maskfab.job.reference import USES, in_words, unused
from maskfab.mask.job import Job
from maskfab.runs.pair_files import write_pairs

if TYPE_CHECKING:
    from maskfab.camera.learning import Checkpoint


_CROP = Crop(160, 200)
"""Part of the sensor that a picture shows of every photograph."""


@dataclass(frozen=True, eq=False, repr=False)
class Simulation(Result):
    """Restored photographs through every die.

    Attributes:
        table: all scores.
        reference: the die that gains are over.
        conditions: that they were taken under.
        left_out: sentences on what the photographs of every die leave out.
        refused: why dies that nobody named could not be photographed, by name.
        scenes: that were photographed.
        skipped: files of the folder that are no photographs.
        shown: part of the first scene by die, one shot for each level of light; empty if they were not kept.
        notes: what was assumed of dies.
    """

    table: ScoreTable
    reference: str
    conditions: Conditions
    left_out: Mapping[str, tuple[str, ...]]
    refused: Mapping[str, str]
    scenes: Sequence[Photograph]
    skipped: tuple[str, ...]
    shown: Mapping[str, Sequence[Shot]]
    notes: tuple[str, ...] = ()

    def picture(self) -> bytes:
        """A PNG of the truth and each die, one row for each level of light.

        Raises:
            JobError: MF105 if no pictures were kept.
        """
        from maskfab.report.figures.scene import sheet

        if not self.shown:
            raise JobError("MF105", "no pictures were kept", where="simulate", cure="Call it without pictures=False")
        kind = self.conditions.protocol
        how = f"protocol {kind.name} {'in linear light' if kind.linear else 'in code values'}"
        return sheet(truth_of(self.scenes[0], _CROP), self.scenes[0].name, self.shown, how)

    def to_dict(self) -> dict[str, Any]:
        """Scores, gains over the reference, and what they were taken with."""
        return {
            "left_out": {name: list(sentences) for name, sentences in self.left_out.items()},
            "refused": dict(self.refused),
            **self.conditions.to_dict(),
            "reference": self.reference,
            "scenes": [scene.name for scene in self.scenes],
            "skipped": list(self.skipped),
            **self.table.to_dict(self.reference),
            **({"notes": list(self.notes)} if self.notes else {}),
        }

    def rows(self) -> list[dict[str, Any]]:
        """Rows: one for each die, level of light, restorer and scene."""
        return [vars(score) for score in self.table.scores]

    def save(self, out: Annotated[str | Path, "PICTURE.png"], *, force: bool = False) -> list[Path]:
        """Write a PNG of the truth and each die, one row for each level of light.

        Args:
            out: PNG to write of the truth and each die, one row for each level of light.
            force: replace an existing picture.
        """
        write_bytes(Path(out), self.picture(), replace=force)
        return [Path(out)]

    def __str__(self) -> str:
        many = len(self.scenes) > 1
        interval = f"± is the {CONFIDENCE:.0%} interval of the mean over {len(self.scenes)} scenes, by Student's t"
        below = [f"{interval}; a tie is one that holds 0." if many else "One scene: differences have no interval."]
        below += self.table.noise_told
        if self.skipped:
            below.append(f"Skipped, as no photographs: {', '.join(self.skipped)}.")
        below += [f"Not photographed: {name}, {reason}." for name, reason in self.refused.items()]
        return "\n".join(
            [
                *self.conditions.lines,
                *self.table.lines(self.reference),
                *below,
                *by_sentence(self.left_out),
                *self.notes,
            ]
        )

    def _repr_png_(self) -> bytes | None:
        return self.picture() if self.shown else None


@overload
def simulate(
    job: AnyJob, camera: Camera | None = None, *, pairs: str | Path, count: int, images: str | Path,
    die: str | Sequence[str] | None = ..., levels: Sequence[float] | None = ..., white: float | None = ...,
    seed: int | None = ..., crop: int | None = ..., bits: int | None = ..., validation: float | None = ...,
    test: float | None = ..., workers: int | None = ..., progress: Progress = ...
) -> PairSet: ...  # fmt: skip
@overload
def simulate(
    job: AnyJob, camera: Camera | None = None, *, die: str | Sequence[str] | None = ..., reference: str | None = ...,
    images: str | Path | None = ..., white: float | None = ..., whole: bool = ..., protocol: ProtocolName = ...,
    light: Light | None = ..., levels: Sequence[float] | None = ..., brackets: Sequence[float] | None = ...,
    restore: str | Sequence[str] | None = ..., checkpoints: Sequence[str | Path] = ..., pictures: bool = ...,
    progress: Progress = ...
) -> Simulation: ...  # fmt: skip
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
    levels: Annotated[Sequence[float] | None, "DB"] = None,
    brackets: Sequence[float] | None = None,
    restore: str | Sequence[str] | None = None,
    checkpoints: Sequence[str | Path] = (),
    pairs: Annotated[str | Path | None, "FOLDER"] = None,
    count: int | None = None,
    seed: int | None = None,
    crop: Annotated[int | None, "PIXELS"] = None,
    bits: InPython[int | None] = None,
    workers: InPython[int | None] = None,
    validation: InPython[float | None] = None,
    test: InPython[float | None] = None,
    pictures: InPython[bool] = True,
    progress: Progress = silent,
) -> Simulation | PairSet:
    """Simulate noisy photographs through each die, restore and score them: PSNR, SSIM, gain over a reference.

    With pairs, write crops as they are and as the camera takes them, to train restorers on; cut off, the command goes
    on where it stood.

    Examples:
        $ maskfab simulate layouts/upc12.toml --die TOLED_P150 --die PINV_R150
        $ maskfab simulate job.toml --images photographs --reference TOLED_P150 --json
        $ maskfab simulate job.toml --images photographs --pairs build/pairs --count 10000

    Args:
        job: job file (.toml).
        camera: of a plate; by default its own. It has three wavelengths.
        die: die of the job; by default all that can be judged.
        reference: die to compare with; by default the first.
        images: folder of photographs; by default synthetic scenes.
        white: light that is white in photographs that hold light, EXR and HDR; it must be stated if they hold more
            than 1.
        whole: photograph whole pictures, 60 million pixels together at most, rather than their middle, on which
            restorers are tuned in either case; those of more than 8 million pixels are restored by the Wiener filter.
        protocol: conditions: camera for the job's camera, sensor, exposure and light, f1 or paper for that protocol's.
        light: linear, or code for code values taken for light; by default the protocol's own, linear for the camera.
        levels: signal-to-noise ratio of white behind the published display, dB; by default the job's, or 24, 32 and 40.
        brackets: exposure that is taken of every scene and merged, as the times by which its light is less than the
            level's, such as 1, 4 and 16; by default those of the job. The photographs are EXR or HDR with light above
            white; drawn scenes get lamps.
        restore: restorer: wiener, dct+wiener, gradient, dct+gradient or tv; by default wiener or the protocol's own.
            With auto the one for each photograph that its record speaks for, of those named beside it or of all.
        checkpoints: file of maskfab learn, one for each die: one more restorer, learned, beside those named.
        pairs: folder to write pairs into, of the photographs of images; one that holds a part of them is completed.
        count: number of pairs in all; it must be stated with pairs.
        seed: seed of the crops, dies, light, noise and splits of pairs; by default 0.
        crop: pixels along a side of pairs; by default 256.
        bits: bits of the camera's picture in pairs, 8 or 10; by default 8. RAW has those of [sensor].
        workers: processes that make pairs; by default as many as processors and memory bear. The files are the same.
        validation, test: shares of photographs whose pairs are not for training; by default 0.1 each.
        pictures: keep part of the photographs of the first scene, by the last restorer, for notebooks and files.
        progress: told where the work stands.

    Raises:
        JobError: MF105 for an unknown die or protocol, MF142 for pictures that take more memory than there should be,
            MF122 if no die can be judged, MF134 without three colours,
            MF140 or MF141 for a sensor or a light that cannot be, MF143 for brackets of scenes without highlights,
            MF148 for a checkpoint of another die, camera, sensor or light, or a die without one where some have.
        SourceError: MF301, MF303, MF304 for a checkpoint that is missing, damaged or none.
    """
    own: dict[str, Any] = {
        "count": count, "seed": seed, "crop": crop, "bits": bits, "validation": validation, "test": test,
    }  # fmt: skip
    if pairs is not None:
        others = {
            "reference": reference, "whole": whole or None, "light": light, "brackets": brackets, "restore": restore,
            "checkpoints": checkpoints or None, "protocol": None if protocol == "camera" else protocol,
        }  # fmt: skip
        refuse_stated(others, "pairs", "leave pairs out")
        if images is None or count is None:
            key, cure = ("images", "a folder of photographs") if images is None else ("count", "such as 10000")
            raise JobError("MF105", f"pairs are asked for, and no {key}", where=key, cure=f"Add {key}, {cure}")
        stated = {key: value for key, value in own.items() if value is not None}
        made = of_photographs(job, images, die=die, levels=levels, white=white, camera=camera, **stated)
        return PairSet(Path(pairs), write_pairs(made, Path(pairs), Workers(workers), progress), made.datasheet)
    refuse_stated({**own, "workers": workers}, "scores", "add pairs, a folder")
    conditions = partial(Conditions.of, protocol=protocol, levels=levels, light=light, brackets=brackets)
    loaded, panels = laid_out(job, Job.panels, conditions, camera=camera)
    asked = conditions(loaded)
    trained = read_checkpoints(checkpoints)
    restorers, choose = _restorers(asked, restore, learned=bool(trained))
    given = given_folder(images, white, whole=whole)
    if given is not None:
        kinds = [*(restorer.name for restorer in restorers), *([LEARNED] if trained else [])]
        _require_memory(given.photographs, kinds, brackets=bool(asked.protocol.brackets))
    for scene in given.photographs if given else ():
        asked.protocol.check(scene)
    wanted = dies_of(die, panels)
    if reference is not None:
        dies_of(reference, wanted)
    # The dies are looked at last, for that takes longest.
    chosen = {name: panels[name] for name in wanted}
    ready, refused = asked.designs(loaded, chosen, lambda *one: one, named=bool(die))
    designs = [design for design, _ in ready]
    dies = [one.name for one in designs]
    learned = learned_restorers(trained, loaded, asked, designs)
    base = dies[0] if reference is None else dies_of(reference, dies)[0]
    source = Folder(scene_sets.drawn(highlights=bool(asked.protocol.brackets)), ()) if given is None else given
    scenes = source.photographs
    middles = tuple(scene.middle for scene in scenes) if whole else scenes
    last = AUTO if choose else LEARNED if learned else restorers[-1].name
    shown: dict[str, list[Shot]] = {name: [] for name in dies} if pictures else {}

    def show(score: Score, whole: NDArray[np.float32]) -> None:
        if pictures and score.scene == scenes[0].name and score.restorer == last:
            shown[score.design].append(Shot(score, _CROP.of(whole)))

    scores: list[Score] = []
    assumed = {design.name: (*messages, *surroundings.messages(design, scenes)) for design, messages in ready}
    del ready
    for done in range(len(dies)):
        progress("photographs", done, len(dies))
        # Transfers over the field take half a gigabyte, and go with their die.
        lead = designs.pop(0)
        scores += evaluate(
            [lead], scenes, middles, asked.levels,
            protocol=asked.protocol, restorers=(*restorers, *learned.get(lead.name, ())), choose=choose, expected=True,
            show=show,
        ).scores  # fmt: skip
        assumed[lead.name] += lead.told
    progress("photographs", len(dies), len(dies))
    table = ScoreTable(tuple(scores))
    reasons = {name: f"{refusal.code} {refusal.what}" for name, refusal in refused.items()}
    asked = replace(asked, unused=unused(loaded.spec, *uses_of(loaded, protocol)))
    notes = loaded.assumptions(wanted)
    return Simulation(table, base, asked, assumed, reasons, scenes, source.skipped, shown, notes)


@answers(simulate)
def _simulate(asked: Asked) -> Told:
    """Pictures are kept where they are saved."""
    if "pairs" in asked.stated:
        refuse_stated({"out": asked.out, "force": asked.force or None}, "pairs", "leave pairs out")
    if asked.out is None:
        return Told.of(asked.found(pictures=False))
    check_file(asked.out, force=asked.force)
    simulation = asked.found()
    simulation.save(asked.out, force=asked.force)
    return Told.of(simulation)


def _require_memory(scenes: Sequence[Photograph], restorers: Sequence[str], *, brackets: bool) -> None:
    others = [f"restorer {name} keeps" for name in restorers if name != Wiener().name]
    others += ["brackets keep"] if brackets else []
    for scene in scenes:
        if others and scene.values[0].size > LARGE:
            what = (
                f"{others[0]} too much of {scene.values[0].size / 1e6:.3g} million pixels; the limit is "
                f"{LARGE / 1e6:g} million"
            )
            cure = "Take one exposure and restore it by wiener alone, or photograph the middle"
            raise JobError("MF142", what, where=scene.name, cure=cure)


def _restorers(
    asked: Conditions, names: str | Sequence[str] | None, *, learned: bool
) -> tuple[tuple[Restorer, ...], bool]:
    """Those that are named but learned ones, as :meth:`maskfab.findings.photographs.Conditions.restorers`."""
    given = (names,) if isinstance(names, str) else names
    if given is None or LEARNED not in given:
        return asked.restorers(given)
    if not learned:
        cure = "Train one with maskfab learn, and give it with --checkpoint FILE"
        raise JobError("MF105", "no checkpoint holds the restorer learned", where="restore", cure=cure)
    others = tuple(name for name in given if name != LEARNED)
    return asked.restorers(others) if others else ((), False)


@dataclass(frozen=True, eq=False, repr=False)
class Learning(Result):
    """A trained restorer.

    Attributes:
        path: of its checkpoint.
        checkpoint: what is in it.
        skipped: files of the folder that are no photographs.
        unused: keys and tables that the job states and the training does not depend on.
    """

    path: Path
    checkpoint: Checkpoint
    skipped: tuple[str, ...]
    unused: tuple[str, ...] = ()

    @property
    def gain(self) -> float:
        """Mean gain over total variation on scenes kept for validation, dB."""
        return float(self.checkpoint.history[-1]["gain"])

    def to_dict(self) -> dict[str, Any]:
        """Settings of the training, and its course."""
        return {
            "path": str(self.path),
            "skipped": list(self.skipped),
            "unused": list(self.unused),
            **self.checkpoint.about(),
        }

    def __str__(self) -> str:
        from maskfab.camera.learning import row_words

        checkpoint = self.checkpoint
        rows = [f"{row['minutes']:6.1f} min: {row_words(row)}" for row in checkpoint.history]
        skipped = [f"Skipped, as no photographs: {', '.join(self.skipped)}."] if self.skipped else []
        return "\n".join(
            [
                f"die {checkpoint.trade.die}: {checkpoint.trade.camera}",
                *rows,
                *skipped,
                *in_words(self.unused),
                str(self.path),
            ]
        )


@checked_arguments
def learn(
    job: AnyJob,
    camera: Camera | None = None,
    *,
    out: Annotated[str | Path, "FILE.npz"],
    die: str | None = None,
    images: str | Path | None = None,
    white: float | None = None,
    levels: Annotated[Sequence[float] | None, "DB"] = None,
    minutes: float = 15.0,
    seed: int = 0,
    device: str = "auto",
    force: bool = False,
    progress: Progress = silent,
) -> Learning:
    """Train a network that restores photographs through one die; simulate --checkpoint uses it.

    Photographs are those of the job's camera, sensor, exposure and light.

    Examples:
        $ maskfab learn job.toml --die TOLED --level 32 -o toled.npz
        $ maskfab learn job.toml --die TOLED --images photographs --minutes 60 -o toled.npz

    Args:
        job: job file (.toml).
        camera: of a plate; by default its own. It has three wavelengths.
        out: file of the checkpoint; if it exists, its training goes on.
        die: die of the job; by default its only one.
        images: folder of photographs to learn from, besides drawn scenes.
        white: light that is white in photographs that hold light, EXR and HDR; it must be stated if they hold more
            than 1.
        levels: signal-to-noise ratio of white behind the published display, dB; by default the job's, or 24, 32 and 40.
        minutes: time to train, kept within a fifth, on all cores.
        seed: seed of weights, scenes and noise.
        device: where to train: cpu, cuda, or auto for CUDA where there is any.
        force: train anew, and replace an existing file.
        progress: told where the work stands.

    Raises:
        JobError: MF105 for a die or device that is not there, or minutes that are none; MF150 for fewer minutes than
            setting up and 120 steps take here; MF148 for a checkpoint of another die, camera, sensor or light; MF152
            without torch; as :func:`maskfab.api.photographs.simulate` for the others.
        SourceError: MF301 without photographs in the folder; MF303, MF304 for a file that is no checkpoint.
        OutputError: MF401 where ``out`` cannot be written.
    """
    require("design", what="a restorer that learns")
    clock = Clock(60 * minutes, refuses=True)
    from maskfab.camera.learning import Checkpoint, Course, Run, device_of

    if not (math.isfinite(minutes) and minutes > 0):
        raise JobError("MF105", f"{minutes:g} minutes train nothing", where="minutes", cure="Give a number above 0")
    path, chosen = Path(out), device_of(device)
    check_file(path, force=True)
    before = Checkpoint.read(path) if path.exists() and not force else None
    conditions = partial(Conditions.of, protocol="camera", levels=levels)
    loaded, panels = laid_out(job, Job.panels, conditions, camera=camera)
    asked = conditions(loaded)
    name = _one(die, tuple(panels))
    given = given_folder(images, white) or Folder((), ())
    for scene in given.photographs:
        asked.protocol.check(scene)
    design, _ = asked.design(name, panels[name], Surroundings.of(loaded))
    uses = (*USES["learn"], *(() if loaded.scene is None else USES["simulate a scene"]))
    trade = trade_of(loaded, asked, design, tuple(photograph.name for photograph in given.photographs))
    if before is not None:
        before.require(trade, seed, str(path))
    run = Run.of(
        path,
        trade,
        asked.protocol,
        design,
        given.photographs,
        course=before.course if before else Course(seed=seed),
        device=chosen,
        before=before,
        clock=clock,
        progress=progress,
    )
    return Learning(path, run.trained(progress), given.skipped, unused(loaded.spec, *uses))


def _one(die: str | None, names: tuple[str, ...]) -> str:
    if die is None and len(names) > 1:
        what = f"the job has {len(names)} dies, and a network is trained behind one"
        raise JobError("MF105", what, where="die", cure=f"Name one of {', '.join(names)}")
    return dies_of(die, names)[0]
