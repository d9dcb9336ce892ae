"""Conditions of photographs: the camera, sensor and light of a job or of a protocol, and the dies behind them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, field
from typing import Any, Literal

from maskfab.camera.design import Design
from maskfab.camera.die_transfer import DieTransfer, die_transfer
from maskfab.camera.laid_panel import laid_panel
from maskfab.camera.left_out import left_out
from maskfab.camera.over_field import OverField
from maskfab.camera.photo_camera import F1 as F1_CAMERA
from maskfab.camera.photo_camera import PhotoCamera, camera_line
from maskfab.camera.protocol import ASSUMED, AUTO, F1, LEVELS, PAPER, WIENER, Protocol
from maskfab.camera.restorers.named import RESTORERS, named
from maskfab.camera.restorers.restorer import Restorer
from maskfab.camera.stated_light import in_decibels, stated_light, stated_sensor
from maskfab.camera.stated_light import told as sensor_told
from maskfab.errors import JobError
from maskfab.job import Job
from maskfab.jobfile import JobSpec
from maskfab.jobfile.uses import USES, Keys, unused
from maskfab.model import Camera, MaskBlank, Panel
from maskfab.optics.scene.plan import plan
from maskfab.optics.scene.scene import Scene

ProtocolName = Literal["camera", "f1", "paper"]
Light = Literal["linear", "code"]

_FIXED = {"f1": F1, "paper": PAPER}
_ELSEWHERE = tuple(set(JobSpec.model_fields) - {"camera", "sensor", "exposure", "scene", "process"})
"""Tables that no photograph is expected to depend on, whatever else is made of the job."""


@dataclass(frozen=True)
class Surroundings:
    """Of a job, everything that lies between a die and the lens.

    Attributes:
        scene: of the camera; None for a job without one.
        accuracy: to which it is asked for; None likewise.
        blank: the mask blank.
    """

    scene: Scene | None
    accuracy: float | None
    blank: MaskBlank

    @classmethod
    def of(cls, job: Job) -> Surroundings:
        """Of a job."""
        section = job.spec.scene
        return cls(job.scene, None if section is None else section.accuracy, job.blank)


@dataclass(frozen=True)
class Conditions:
    """Camera, sensor and light that photographs are taken with.

    Attributes:
        protocol: how they are taken and scored.
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
            protocol: by name.
            levels: in place of those that the job states.
            light: scenes as linear light or as code values; None for the protocol's own.
            brackets: in place of those that the job states.

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
        sensor = stated_sensor(job.spec.sensor)
        chosen, told = (
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
        return cls(kind, job.camera, chosen, told + _merging(kind.brackets), scene, left)

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
            told = ", ".join(each.name for each in own)
            raise JobError(
                "MF105",
                f"protocol {self.protocol.name} restores by its own {told}",
                where="restore",
                cure="Name no restorer, or use protocol camera or f1",
            )
        given = (names,) if isinstance(names, str) else tuple(names)
        others = tuple(name for name in given if name != AUTO)
        return named(others or tuple(RESTORERS)), AUTO in given

    def design(self, name: str, panel: Panel, around: Surroundings) -> tuple[Design, tuple[str, ...]]:
        """A die as it is photographed, and sentences on what the photographs leave out.

        Raises:
            JobError: as :func:`maskfab.camera.laid_panel.laid_panel` for a fixed protocol, else as
                :func:`maskfab.camera.die_transfer.die_transfer`.
        """
        if isinstance(self.camera, PhotoCamera):
            return laid_panel(name, panel, self.camera), (f"assumed: {ASSUMED}",)
        scene = around.scene or Scene()
        if around.accuracy is None:
            return die_transfer(name, panel, self.camera, scene), left_out(panel, scene, around.blank)
        chosen = plan(panel, self.camera, scene, around.accuracy)
        seen: DieTransfer = die_transfer(name, panel, self.camera, scene, chosen)
        told = left_out(panel, scene, around.blank, chosen)
        return (OverField(seen, chosen) if chosen.choice.places > 1 else seen), told

    @property
    def lines(self) -> tuple[str, ...]:
        """In words, one line each."""
        scenes = (
            "linear light of sRGB scenes, scored as sRGB" if self.protocol.linear else "code values taken for light"
        )
        return (
            f"protocol {self.protocol.name}: {camera_line(self.camera)}",
            f"sensor: {sensor_told(self.protocol.sensor)}",
            f"light: {self.stated}; {scenes}",
            *self._published,
            *([f"scene: {', '.join(f'{key} {value}' for key, value in self.scene.items())}"] if self.scene else []),
            *([f"not used of the job: {', '.join(self.unused)}"] if self.unused else []),
        )

    @property
    def _published(self) -> list[str]:
        kind = self.protocol
        if not kind.restorers:
            return []
        told = ["darkness round the sensor"] if kind.dark else []
        told += ["pictures scored as bright as the die leaves them"] if kind.dimmed else []
        told += [f"restored by {each.name}, epsilon {kind.strengths[0]:.4f}" for each in kind.restorers]
        return ["; ".join(told)]

    def to_dict(self) -> dict[str, Any]:
        """As data."""
        return {
            "protocol": self.protocol.name,
            "camera": camera_line(self.camera),
            "sensor": asdict(self.protocol.sensor),
            "light": self.stated,
            "linear": self.protocol.linear,
            "levels_db": list(self.levels),
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
    """The protocol, if it has light of all these levels."""
    for level in levels:
        protocol.exposure(level)
    return protocol


def _merging(brackets: Sequence[float]) -> str:
    if not brackets:
        return ""
    return f"; exposures of {', '.join('1' if cut == 1 else f'1/{cut:g}' for cut in brackets)} of it, merged"
