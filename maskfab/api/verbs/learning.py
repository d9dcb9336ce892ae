"""A restorer that is learned from photographs through one die."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from maskfab.api.camera import Camera
from maskfab.api.folders import given_folder
from maskfab.api.jobs import AnyJob, dies_of, job_of
from maskfab.base.checks import checked_arguments
from maskfab.base.errors import JobError
from maskfab.base.folders import check_file
from maskfab.base.work import Clock, Progress, silent
from maskfab.camera.imaging import Design
from maskfab.camera.lens import camera_line
from maskfab.camera.scenes import Folder
from maskfab.job.reference import USES, in_words, unused
from maskfab.mask.job import Job
from maskfab.report.rows.photographs import Conditions, Surroundings

if TYPE_CHECKING:
    from maskfab.camera.learning import Checkpoint, Trade
    from maskfab.camera.restorers.network import Learned


LEARNED = "learned"
"""Name of the restorer that a checkpoint holds."""


@dataclass(frozen=True, eq=False, repr=False)
class Learning:
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
        from maskfab.camera.learning import told

        found = self.checkpoint
        rows = [f"{each['minutes']:6.1f} min: {told(each)}" for each in found.history]
        skipped = [f"Skipped, as no photographs: {', '.join(self.skipped)}."] if self.skipped else []
        return "\n".join(
            [f"die {found.trade.die}: {found.trade.camera}", *rows, *skipped, *in_words(self.unused), str(self.path)]
        )


@checked_arguments
def learn(
    job: AnyJob,
    camera: Camera | None = None,
    *,
    out: str | Path,
    die: str | None = None,
    images: str | Path | None = None,
    white: float | None = None,
    levels: Sequence[float] | None = None,
    minutes: float = 15.0,
    seed: int = 0,
    device: str = "auto",
    force: bool = False,
    progress: Progress = silent,
) -> Learning:
    """Train a network that restores photographs behind one die, by the job's camera, sensor, exposure and light.

    Args:
        job: a plate, a loaded job, or the path of a job file.
        camera: of a plate; by default its own. It has three wavelengths.
        out: file of the checkpoint. If it exists, its training goes on.
        die: by name; of a job with one die, that.
        images: folder of photographs to learn from, besides drawn scenes.
        white: light that is white in photographs that hold light, EXR and HDR; it must be stated if they hold more
            than 1.
        levels: signal-to-noise ratios of white behind the published display, dB; by default those of the job.
        minutes: that the call takes, kept within a fifth.
        seed: of weights, scenes and noise.
        device: ``"cpu"``, ``"cuda"``, or ``"auto"`` for CUDA where there is any.
        force: train anew, and replace ``out``.
        progress: told where the work stands.

    Raises:
        JobError: MF105 for a die or device that is not there, or minutes that are none; MF150 for fewer minutes than
            setting up and a step take; MF148 for a checkpoint of
            another die, camera, sensor or light; as :func:`maskfab.api.verbs.photographs.simulate` for the others.
        SourceError: MF301 without photographs in the folder; MF303, MF304 for a file that is no checkpoint.
        OutputError: MF401 where ``out`` cannot be written.
    """
    clock = Clock(60 * minutes, refuses=True)
    from maskfab.camera.learning import Checkpoint, Course, Run, device_of

    if not (math.isfinite(minutes) and minutes > 0):
        raise JobError("MF105", f"{minutes:g} minutes train nothing", where="minutes", cure="Give a number above 0")
    path, chosen = Path(out), device_of(device)
    check_file(path, force=True)
    before = Checkpoint.read(path) if path.exists() and not force else None
    loaded = job_of(job, camera)
    asked = Conditions.of(loaded, "camera", levels)
    panels = loaded.panels()
    name = _one(die, tuple(panels))
    given = given_folder(images, white) or Folder((), ())
    for scene in given.photographs:
        asked.protocol.check(scene)
    design, _ = asked.design(name, panels[name], Surroundings.of(loaded))
    uses = (*USES["learn"], *(() if loaded.scene is None else USES["simulate a scene"]))
    trade = trade_of(loaded, asked, design, tuple(each.name for each in given.photographs))
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


def read_checkpoints(paths: Sequence[str | Path]) -> list[tuple[Path, Checkpoint]]:
    """Files of :func:`learn`, in the order that they are named.

    Raises:
        SourceError: MF301, MF303, MF304 for one that is missing, damaged or none.
    """
    if not paths:
        return []
    # torch takes a second to load.
    from maskfab.camera.learning import Checkpoint

    return [(Path(path), Checkpoint.read(Path(path))) for path in paths]


def learned_restorers(
    trained: Sequence[tuple[Path, Checkpoint]], job: Job, asked: Conditions, designs: Sequence[Design]
) -> dict[str, tuple[Learned]]:
    """The restorer of every die, by its name; none where nothing is trained.

    Raises:
        JobError: MF105 for two of one die; MF148 for one of another die, camera, sensor or light, or a die without.
    """
    if not trained:
        return {}
    # torch takes a second to load, and a fifth of a gigabyte.
    from maskfab.camera.learning import another

    names = [design.name for design in designs]
    by_die: dict[str, tuple[Path, Checkpoint]] = {}
    for path, found in trained:
        if found.trade.die in by_die:
            raise JobError(
                "MF105",
                f"{by_die[found.trade.die][0]} and {path} are both of die {found.trade.die}",
                where="checkpoint",
                cure="Give one of them",
            )
        by_die[found.trade.die] = path, found
    for die, (path, _) in by_die.items():
        if die not in names:
            raise another(f"die {die}", ", ".join(names), str(path))
    restorers: dict[str, tuple[Learned]] = {}
    for design in designs:
        if design.name not in by_die:
            raise another(f"die {', '.join(by_die)}", design.name, "checkpoint")
        path, found = by_die[design.name]
        found.trade.require(trade_of(job, asked, design), str(path))
        restorers[design.name] = (found.restorer(),)
    return restorers


def trade_of(job: Job, asked: Conditions, design: Design, images: tuple[str, ...] = ()) -> Trade:
    """Everything that photographs of a die depend on, by which checkpoints are told apart."""
    from maskfab.camera.learning import Trade, probe

    light = "linear light" if asked.protocol.linear else "code values taken for light"
    if asked.protocol.brackets:
        light += f", brackets of {', '.join(f'{cut:g}' for cut in asked.protocol.brackets)}"
    sensor = ", ".join(f"{key.replace('_', ' ')} {value}" for key, value in asdict(asked.protocol.sensor).items())
    return Trade(
        job.where,
        job.digest,
        design.name,
        camera_line(asked.camera),
        sensor,
        light,
        asked.levels,
        images,
        probe(design),
    )


def _one(die: str | None, names: tuple[str, ...]) -> str:
    if die is None and len(names) > 1:
        raise JobError(
            "MF105",
            f"the job has {len(names)} dies, and a network is trained behind one",
            where="die",
            cure=f"Name one of {', '.join(names)}",
        )
    return dies_of(die, names)[0]
