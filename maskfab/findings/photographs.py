"""Photographs through the dies of a plate, restored and scored: their conditions, and what a report says of them.

Conditions are the camera, sensor and light of a job or of a protocol. Restorers that were learned behind a die are held
against the conditions that they were learned under.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cache, cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal, TypeVar

import numpy as np
from numpy.typing import NDArray

from maskfab.base.errors import JobError
from maskfab.base.extras import require
from maskfab.base.model import Panel, Quantity
from maskfab.camera import scenes as scene_sets
from maskfab.camera.die_transfer import DieTransfer, die_transfer, left_out
from maskfab.camera.field_transfer import OverField
from maskfab.camera.imaging import Design
from maskfab.camera.protocol import ASSUMED, AUTO, F1, PAPER, WIENER, Protocol, evaluate
from maskfab.camera.record import Restorer
from maskfab.camera.restorers import named
from maskfab.camera.scenes import Photograph
from maskfab.camera.scores import CONFIDENCE, MEAN_OVER_NOISE, Crop, Gain, Score, ScoreTable, Shot, truth_of
from maskfab.camera.sensor import LEVELS, in_decibels, picked_gains, sensor_words, stated_light, told_gains
from maskfab.camera.stop_cells import F1 as F1_CAMERA
from maskfab.camera.stop_cells import PhotoCamera, camera_line, laid_panel
from maskfab.job.camera import Camera, Sensor
from maskfab.job.process import MaskBlank
from maskfab.job.reference import USES, Keys, unused
from maskfab.job.sections import JobSpec
from maskfab.mask.job import Job
from maskfab.optics.scene.plan import plan
from maskfab.optics.scene.scene import Scene

if TYPE_CHECKING:
    from maskfab.camera.learning import Checkpoint, Trade
    from maskfab.camera.restorers.network import Learned

ProtocolName = Literal["camera", "f1", "paper"]
Light = Literal["linear", "code"]
Taken = TypeVar("Taken")

_FIXED = {"f1": F1, "paper": PAPER}
_ELSEWHERE = tuple(set(JobSpec.model_fields) - {"camera", "sensor", "exposure", "scene", "process"})
"""Tables that no photograph is expected to depend on, whatever else is made of the job."""


@dataclass(frozen=True)
class Surroundings:
    """Of a job, everything that lies between a die and the lens.

    Attributes:
        scene: of the camera; None for a job without one.
        accuracy: to which it is asked for; None likewise.
    """

    scene: Scene | None
    accuracy: float | None
    blank: MaskBlank

    @classmethod
    def of(cls, job: Job) -> Surroundings:
        """Surroundings of a job."""
        section = job.spec.scene
        return cls(job.scene, None if section is None else section.accuracy, job.blank)


@dataclass(frozen=True)
class Conditions:
    """Camera, sensor and light that photographs are taken with.

    Attributes:
        camera: lens, pixels and wavelengths; of a fixed protocol where it is a :class:`PhotoCamera`.
        levels: of light, signal-to-noise ratios of white behind the published display, dB.
        stated: how the light was asked for.
        scene: keys of the job's [scene] that it states, as a job file writes them; what of them is left out, every die
            says for itself.
        unused: of camera, sensor, light, scene and process of the job, what the photographs have no use for: they are
            taken through dies as drawn.
    """

    protocol: Protocol
    camera: Camera | PhotoCamera
    levels: tuple[float, ...]
    stated: str
    scene: Mapping[str, Any] = field(default_factory=dict)
    unused: tuple[str, ...] = ()

    @classmethod
    def of(
        cls,
        job: Job,
        protocol: ProtocolName,
        levels: Sequence[float] | None = None,
        light: Light | None = None,
        brackets: Sequence[float] | None = None,
    ) -> Conditions:
        """Of a protocol for a job.

        Args:
            job: whose camera, sensor and exposure protocol "camera" takes; "f1" and "paper" have their own.
            light: scenes as linear light or as code values; None for the protocol's own.

        Raises:
            JobError: MF105 for an unknown protocol, or light that is not the protocol's; MF140, MF141 for a sensor or a
                light that cannot be, MF143 for brackets that cannot.
        """
        if protocol in _FIXED:
            if brackets is not None:
                what = f"protocol {protocol} takes one exposure"
                raise JobError("MF143", what, where="brackets", cure="Use protocol camera")
            if light == "linear":
                what = f"protocol {protocol} takes code values for light"
                raise JobError("MF105", what, where="light", cure="Use protocol camera")
            chosen = tuple(LEVELS if levels is None else levels)
            left = unused(job.spec, *uses_of(job, protocol), *_ELSEWHERE)
            return cls(_lit(_FIXED[protocol], chosen), F1_CAMERA, chosen, in_decibels(chosen), unused=left)
        if protocol != "camera":
            what = f"there is no protocol {protocol!r}"
            raise JobError("MF105", what, where="protocol", cure="Use camera, f1 or paper")
        if light not in (None, "linear", "code"):
            raise JobError("MF105", f"there is no light {light!r}", where="light", cure="Use linear or code")
        sensor = job.spec.sensor or Sensor()
        chosen, notes = (
            stated_light(job.spec.exposure, sensor, job.camera)
            if levels is None
            else (tuple(levels), in_decibels(levels))
        )
        section = job.spec.scene
        scene = {} if section is None else section.model_dump(mode="json", exclude_defaults=True)
        if brackets is None:
            brackets = (None if job.spec.exposure is None else job.spec.exposure.brackets) or ()
        kind = _lit(Protocol("camera", sensor, linear=light != "code", brackets=tuple(brackets)), chosen)
        left = unused(job.spec, *uses_of(job, protocol), *_ELSEWHERE)
        return cls(kind, job.camera, chosen, notes + _merging(kind.brackets), scene, left)

    def restorers(self, names: str | Sequence[str] | None) -> tuple[tuple[Restorer, ...], bool]:
        """Restorers that are asked for, and whether one of them is to be chosen for each photograph.

        Args:
            names: of restorers, and :data:`maskfab.camera.protocol.AUTO`, which alone is of all; None for those that
                the protocol has, or the Wiener filter.

        Raises:
            JobError: MF105 for an unknown name, or for any under a protocol that has its own.
        """
        own = self.protocol.restorers
        if names is None:
            return own or WIENER, False
        if own:
            listed = ", ".join(restorer.name for restorer in own)
            what = f"protocol {self.protocol.name} restores by its own {listed}"
            raise JobError("MF105", what, where="restore", cure="Name no restorer, or use protocol camera or f1")
        given = (names,) if isinstance(names, str) else tuple(names)
        others = tuple(name for name in given if name != AUTO)
        return named(others), AUTO in given

    def design(self, name: str, panel: Panel, around: Surroundings) -> tuple[Design, tuple[str, ...]]:
        """A die as it is photographed, and sentences on what the photographs leave out."""
        if isinstance(self.camera, PhotoCamera):
            return laid_panel(name, panel, self.camera), (f"assumed: {ASSUMED}",)
        scene = around.scene or Scene()
        if around.accuracy is None:
            return die_transfer(name, panel, self.camera, scene), left_out(panel, scene, around.blank)
        chosen = plan(panel, self.camera, scene, around.accuracy)
        seen: DieTransfer = die_transfer(name, panel, self.camera, scene, chosen)
        notes = left_out(panel, scene, around.blank, chosen)
        return (OverField(seen, chosen) if chosen.choice.places > 1 else seen), notes

    def designs(
        self, job: Job, panels: Mapping[str, Panel], take: Callable[[Design, tuple[str, ...]], Taken], *, named: bool
    ) -> tuple[list[Taken], dict[str, JobError]]:
        """All that is made of each die and its sentences, one after the other; and why others cannot be photographed.

        Raises:
            JobError: that of a die that is named; MF122, or what all have in common, if none can be judged.
        """
        ready, refused = list[Taken](), dict[str, JobError]()
        for name, panel in panels.items():
            try:
                ready.append(take(*self.design(name, panel, Surroundings.of(job))))
            except JobError as refusal:
                refused[name] = refusal
                if named:
                    raise
        if not ready:
            if len({refusal.code for refusal in refused.values()}) == 1:
                raise next(iter(refused.values()))
            what = f"no die can be judged behind a camera of {camera_line(self.camera)}"
            raise JobError("MF122", what, where=job.where, cure="Name one die to see why")
        return ready, refused

    @property
    def lines(self) -> tuple[str, ...]:
        """In words, one line each."""
        scenes = (
            "linear light of sRGB scenes, scored as sRGB" if self.protocol.linear else "code values taken for light"
        )
        return (
            f"protocol {self.protocol.name}: {camera_line(self.camera)}",
            f"sensor: {sensor_words(self.protocol.sensor)}",
            f"light: {self.stated}; {scenes}",
            *([gains] if (gains := told_gains(self.protocol.sensor, self.levels)) else []),
            *self._published,
            *([f"scene: {', '.join(f'{key} {value}' for key, value in self.scene.items())}"] if self.scene else []),
            *([f"not used of the job: {', '.join(self.unused)}"] if self.unused else []),
        )

    @property
    def _published(self) -> list[str]:
        kind = self.protocol
        if not kind.restorers:
            return []
        notes = ["darkness round the sensor"] if kind.dark else []
        notes += ["pictures scored as bright as the die leaves them"] if kind.dimmed else []
        notes += [f"restored by {restorer.name}, epsilon {kind.strengths[0]:.4f}" for restorer in kind.restorers]
        return ["; ".join(notes)]

    def to_dict(self) -> dict[str, Any]:
        """As data."""
        return {
            "protocol": self.protocol.name,
            "camera": camera_line(self.camera),
            "sensor": self.protocol.sensor.facts,
            "light": self.stated,
            "linear": self.protocol.linear,
            "levels_db": list(self.levels),
            **({"analog_gains": gains} if (gains := picked_gains(self.protocol.sensor, self.levels)) else {}),
            "brackets": list(self.protocol.brackets),
            "scene": dict(self.scene),
            "unused": list(self.unused),
        }


def uses_of(job: Job, protocol: str = "camera") -> Keys:
    """Keys of a job that photographs by a protocol depend on."""
    if protocol != "camera":
        return USES["simulate --protocol"]
    return (*USES["simulate"], *(() if job.spec.scene is None else USES["simulate a scene"]))


def _lit(protocol: Protocol, levels: Sequence[float]) -> Protocol:
    for level in levels:
        protocol.exposure(level)
    return protocol


def _merging(brackets: Sequence[float]) -> str:
    if not brackets:
        return ""
    return f"; exposures of {', '.join('1' if cut == 1 else f'1/{cut:g}' for cut in brackets)} of it, merged"


CROP = Crop(144, 192)
"""Part of the photographs that is shown."""
NOISE_DB = 0.05
"""By which a draw of the noise changes a mean over the scenes at most, and one over the noise differs from it."""


@dataclass(frozen=True, eq=False)
class Restored:
    """Photographs behind one die.

    Attributes:
        scores: of every scene at every level of light; none if it cannot be photographed.
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
        return float(np.mean([score.psnr for score in self._at(level_db)]))

    def drawn(self, level_db: float) -> bool:
        """Whether that is of one draw of the noise."""
        return any(score.drawn for score in self._at(level_db))

    def error_told(self, level_db: float) -> str:
        """Words of what its error, :data:`NOISE_DB`, is of."""
        if self.drawn(level_db):
            return "error: another draw of the noise"
        return "error: a draw of the noise, and the rows that are not scored"

    def _at(self, level_db: float) -> list[Score]:
        return [score for score in self.scores if score.level_db == level_db]


@dataclass(frozen=True, eq=False)
class Photographs:
    """Photographs behind the dies of one plate.

    Attributes:
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
            method = "photographs behind this die are not taken, for this reason"
            return (Quantity("photographs_refused", die.refused, method, die=name),)
        scenes = len({score.scene for score in die.scores})
        how = f"{'; '.join(self.conditions.lines)}; {scenes} drawn scenes, restored by the Wiener filter, "
        means = [
            Quantity(
                "restored_psnr",
                die.psnr(level),
                f"mean over the scenes: {how}{noise_told(level, die)}; {die.error_told(level)}; other scenes have "
                "other means, see the paired gain",
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
                f"mean of the differences to {self.reference}, scene by scene: {how}"
                f"{noise_told(gain.level_db, die, self.dies[str(self.reference)])}; error: half the {CONFIDENCE:.0%} "
                f"interval by Student's t; {'a tie, for it holds 0' if gain.psnr.tie else 'it does not hold 0'}",
                uncertainty=gain.psnr.half_width,
                die=name,
                level_db=gain.level_db,
            )
            for gain in self.gains[name]
        ]
        return (*means, *gains)


def noise_told(level_db: float, *dies: Restored) -> str:
    """Words of how dies of a level are scored."""
    every = {die.drawn(level_db) for die in dies}
    if every == {True}:
        return "one draw of the noise"
    return MEAN_OVER_NOISE if every == {False} else f"of one die {MEAN_OVER_NOISE}, of the other one draw of it"


def middle_level(levels_db: Sequence[float]) -> float:
    """The level of light that stands for all where there is room for one."""
    return sorted(levels_db)[len(levels_db) // 2]


def photograph_die(conditions: Conditions, around: Surroundings, name: str, panel: Panel, shown: bool) -> Restored:
    """Photograph the drawn scenes through one die.

    Args:
        shown: keep part of the first scene in least light and in most, not at the middle level alone.
    """
    protocol, levels = conditions.protocol, {middle_level(conditions.levels)}
    if shown:
        levels |= {min(conditions.levels), max(conditions.levels)}
    try:
        design, notes = conditions.design(name, panel, around)
        first, *_ = scenes = drawn_scenes(highlights=bool(protocol.brackets))
        seen = {scene.name: protocol.seen(design, scene) for scene in scenes}
        given = [design], scenes, scenes, conditions.levels
        table = evaluate(*given, protocol=protocol, details=False, expected=True, seen=seen)
    except JobError as refusal:
        return Restored(refused=f"{refusal.code} {refusal.what}. {refusal.cure}")
    shots = tuple(
        Shot(score, protocol.restored(seen[first.name], design, first, score.level_db, score.epsilon, CROP))
        for score in table.scores
        if score.scene == first.name and score.level_db in levels
    )
    return Restored(table.scores, notes + design.told, None, first.name, truth_of(first, CROP), shots)


@cache
def drawn_scenes(*, highlights: bool) -> tuple[Photograph, ...]:
    """The scenes, and with them their spectra, for all dies of a process."""
    return scene_sets.drawn(highlights=highlights)


LEARNED = "learned"
"""Name of the restorer that a checkpoint holds."""


def read_checkpoints(paths: Sequence[str | Path]) -> list[tuple[Path, Checkpoint]]:
    """Checkpoints of learned restorers, in the order that they are named.

    Raises:
        SourceError: MF301, MF303, MF304 for one that is missing, damaged or none.
        MissingPackageError: MF152 without torch.
    """
    if not paths:
        return []
    require("design", what="a restorer that learned", where="checkpoint", otherwise="use other restorers")
    # torch takes a second to load.
    from maskfab.camera.learning import Checkpoint

    return [(Path(path), Checkpoint.read(Path(path))) for path in paths]


def learned_restorers(
    trained: Sequence[tuple[Path, Checkpoint]], job: Job, asked: Conditions, designs: Sequence[Design]
) -> dict[str, tuple[Learned]]:
    """The restorer of every die, by its name; none where nothing is trained. Raises JobError MF105 for two of one die;
    MF148 for one of another die, camera, sensor or light, or a die without."""
    if not trained:
        return {}
    # torch takes a second to load, and a fifth of a gigabyte.
    from maskfab.camera.learning import another

    names = [design.name for design in designs]
    by_die: dict[str, tuple[Path, Checkpoint]] = {}
    for path, checkpoint in trained:
        if checkpoint.trade.die in by_die:
            what = f"{by_die[checkpoint.trade.die][0]} and {path} are both of die {checkpoint.trade.die}"
            raise JobError("MF105", what, where="checkpoint", cure="Give one of them")
        by_die[checkpoint.trade.die] = path, checkpoint
    for die, (path, _) in by_die.items():
        if die not in names:
            raise another(f"die {die}", ", ".join(names), str(path))
    restorers: dict[str, tuple[Learned]] = {}
    for design in designs:
        if design.name not in by_die:
            raise another(f"die {', '.join(by_die)}", design.name, "checkpoint")
        path, checkpoint = by_die[design.name]
        checkpoint.trade.require(trade_of(job, asked, design), str(path))
        restorers[design.name] = (checkpoint.restorer(),)
    return restorers


def trade_of(job: Job, asked: Conditions, design: Design, images: tuple[str, ...] = ()) -> Trade:
    """Everything that photographs of a die depend on, by which checkpoints are told apart."""
    from maskfab.camera.learning import Trade, probe

    light = "linear light" if asked.protocol.linear else "code values taken for light"
    if asked.protocol.brackets:
        light += f", brackets of {', '.join(f'{cut:g}' for cut in asked.protocol.brackets)}"
    sensor = ", ".join(f"{key.replace('_', ' ')} {value}" for key, value in asked.protocol.sensor.facts.items())
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
