"""Photographs that openings are compared by, and the noise of their pixels.

By protocol F1 code values are taken for light, and a pixel's noise is that of the scenes' mean. By protocol ``camera``
light is linear, and its scenes differ so much in brightness that each one's noise is scaled as its contrast is where
they are brought to one contrast: dim pictures have little of both.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from types import MappingProxyType
from typing import TYPE_CHECKING, TypeVar

from numpy.typing import NDArray

from maskfab.camera.exposure import ELECTRONS, REFERENCE_TRANSMISSION
from maskfab.camera.protocol import F1, LEVELS, Protocol
from maskfab.camera.stated_light import told
from maskfab.errors import JobError

if TYPE_CHECKING:
    import torch

Value = TypeVar("Value", float, NDArray, "torch.Tensor")  # type: ignore[type-arg]


@dataclass(frozen=True)
class Taking:
    """A protocol at levels of light.

    Attributes:
        protocol: F1, or one with a job's own sensor; without brackets.
        levels: signal-to-noise ratios of white behind the published display, dB.

    Raises:
        JobError: MF141 for a level without light, or above a full well.
    """

    protocol: Protocol = F1
    levels: tuple[float, ...] = LEVELS

    def __post_init__(self) -> None:
        _ = self.electrons

    @property
    def is_f1(self) -> bool:
        """Whether the photographs are protocol F1's, but perhaps for the lens."""
        return self.protocol == F1

    @cached_property
    def electrons(self) -> Mapping[float, float]:
        """Of white behind the published display, by level; of protocol F1 at all of its levels."""
        if self.is_f1:
            return MappingProxyType({float(level): float(count) for level, count in ELECTRONS.items()})
        return MappingProxyType({level: self.protocol.exposure(level).electrons for level in self.levels})

    @cached_property
    def read_noise(self) -> float:
        """Standard deviation of what a pixel adds to its light, rounding by the converter included, in electrons."""
        sensor = self.protocol.sensor
        if not sensor.step:
            return sensor.read_noise
        return float((sensor.read_noise**2 + sensor.step**2 / 12) ** 0.5)

    def require(self, levels: Sequence[float]) -> None:
        """Refuse levels whose light is not known.

        Raises:
            JobError: MF104.
        """
        if unknown := [level for level in levels if level not in self.electrons]:
            raise JobError(
                "MF104",
                f"the level {unknown[0]:g} dB is not one of {', '.join(f'{each:g}' for each in self.electrons)}",
                where="design.levels",
                cure="Use levels from that list only",
            )

    @property
    def line(self) -> str:
        """In words."""
        light = "linear light, scored as sRGB" if self.protocol.linear else "code values taken for light"
        levels = "/".join(f"{level:g}" for level in self.levels)
        return f"protocol {self.protocol.name}: {told(self.protocol.sensor)}; {levels} dB; {light}"


F1_TAKING = Taking()


@dataclass(frozen=True)
class PixelNoise:
    """Noise of a pixel before restoration, and the PSNR that an error of restored pictures stands for.

    Attributes:
        taking: of the photographs.
        shot: mean of the scenes, white is 1: variance of the shot noise times the electrons of white.
        flat: the same of what a pixel adds, over its own square; 1 where all scenes count alike.
        coded_db: by level, what the PSNR of code values has above that of what errors are computed of.
    """

    taking: Taking
    shot: float
    flat: float = 1.0
    coded_db: Mapping[float, float] = field(default_factory=lambda: MappingProxyType({}))

    def white(self, level: float, open_share: float) -> float:
        """Electrons of white behind a panel of this open share."""
        return self.taking.electrons[level] * open_share / REFERENCE_TRANSMISSION

    def of_white(self, white: Value) -> Value:
        """σ² of a pixel with so many electrons of white, white is 1."""
        return self.shot / white + self.flat * (self.taking.read_noise / white) ** 2

    def variance(self, level: float, open_share: float) -> float:
        """σ² of a pixel at a level of light behind a panel of this open share, white is 1."""
        return self.of_white(self.white(level, open_share))

    def added_db(self, level: float) -> float:
        """Decibels added to -10 log10 of a mean squared error; 0 for protocol F1."""
        return self.coded_db.get(level, 0.0)
