"""Photographs that openings are compared by, and the statistics of them that a surrogate is made of.

By protocol F1 code values are taken for light, and a pixel's noise is that of the scenes' mean. By protocol ``camera``
light is linear, and its scenes differ so much in brightness that each one's noise is scaled as its contrast is where
they are brought to one contrast: dim pictures have little of both.

The statistics, noise, mean spectrum and low-passed pictures, of the bundled scenes for protocol F1 are kept beside this
module, since to draw those scenes takes most of a second for each:
``python -m maskfab.designs.model.statistics`` writes that file anew.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from types import MappingProxyType
from typing import TYPE_CHECKING, Any, TypeVar

import numpy as np
import scipy
from numpy.typing import NDArray

from maskfab.base.arrays import Floats
from maskfab.base.errors import JobError
from maskfab.camera.protocol import F1, Protocol
from maskfab.camera.scenes import Bundled, Photograph, bundled
from maskfab.camera.sensor import ELECTRONS, LEVELS, sensor_words, told_gains
from maskfab.job.camera import REFERENCE_TRANSMISSION, Sensor

if TYPE_CHECKING:
    import torch


Value = TypeVar("Value", float, NDArray, "torch.Tensor")  # type: ignore[type-arg]


@dataclass(frozen=True)
class CaptureSettings:
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
        """Electrons of white behind the published display, by level; of protocol F1 at all of its levels."""
        if self.is_f1:
            return MappingProxyType({float(level): float(count) for level, count in ELECTRONS.items()})
        return MappingProxyType({level: self.protocol.exposure(level).electrons for level in self.levels})

    def read_noise(self, white: Value) -> Value | float:
        """Standard deviation of what a pixel adds to its light, rounding by the converter included, in electrons.

        Args:
            white: electrons of white, by which a gain is picked that is not stated.
        """
        sensor = self.protocol.sensor
        if not (sensor.late_variance or sensor.banding):
            return sensor.read_noise
        gain: Value = sensor.gain_for(white)
        noise: Value = (sensor.early_variance + sensor.late_variance / gain**2) ** 0.5
        return noise

    def require(self, levels: Sequence[float]) -> None:
        """Refuse levels whose light is not known. Raises JobError MF104."""
        if unknown := [level for level in levels if level not in self.electrons]:
            what = f"the level {unknown[0]:g} dB is not one of {', '.join(f'{level:g}' for level in self.electrons)}"
            raise JobError("MF104", what, where="design.levels", cure="Use levels from that list only")

    @property
    def line(self) -> str:
        """In words."""
        light = "linear light, scored as sRGB" if self.protocol.linear else "code values taken for light"
        levels = "/".join(f"{level:g}" for level in self.levels)
        parts = (f"{levels} dB", light, told_gains(self.protocol.sensor, self.levels))
        return "; ".join((f"protocol {self.protocol.name}: {sensor_words(self.protocol.sensor)}", *filter(None, parts)))


F1_SETTINGS = CaptureSettings()


@dataclass(frozen=True)
class PixelNoise:
    """Noise of a pixel before restoration, and the PSNR that an error of restored pictures stands for.

    Attributes:
        shot: mean of the scenes, white is 1: variance of the shot noise times the electrons of white.
        flat: the same of what a pixel adds, over its own square; 1 where all scenes count alike.
        coded_db: by level, what the PSNR of code values has above that of what errors are computed of.
    """

    settings: CaptureSettings
    shot: float
    flat: float = 1.0
    coded_db: Mapping[float, float] = field(default_factory=lambda: MappingProxyType({}))

    def white(self, level: float, open_share: float) -> float:
        """Electrons of white behind a panel of this open share."""
        return self.settings.electrons[level] * open_share / REFERENCE_TRANSMISSION

    def of_white(self, white: Value) -> Value:
        """σ² of a pixel with so many electrons of white, white is 1."""
        return self.shot / white + self.flat * (self.settings.read_noise(white) / white) ** 2

    def variance(self, level: float, open_share: float) -> float:
        """σ² of a pixel at a level of light behind a panel of this open share, white is 1."""
        return self.of_white(self.white(level, open_share))

    def added_db(self, level: float) -> float:
        """Decibels added to -10 log10 of a mean squared error; 0 for protocol F1."""
        return self.coded_db.get(level, 0.0)


ROWS, COLUMNS, FACTOR = 128, 192, 8
"""Of low-passed pictures, and how many pixels of a scene one of theirs is wide."""

WIDTH = 32
"""Of the margin round the sensor in low-passed pictures."""

LEAST_CONTRAST = 1e-4
"""A tenth of what the smallest step of eight bits is, evenly spread."""

KEPT = ((4, 2), (16, 2), (16, 8))
"""Numbers of bundled scenes, and of pictures that leak as much as they do, whose statistics are kept."""

_FILE = Path(__file__).with_name("bundled_scenes.npz")


@dataclass(frozen=True, eq=False)
class SceneStatistics:
    """Knowledge of a surrogate about its scenes, whatever cells they are seen through.

    Attributes:
        factor, power: c and p of their spectrum c f^-p.
        low: complex64 [scenes, 128, 97], low-passed scenes.
        pixels: of every scene, before it was brought to one contrast with the others, and by what factor it was; empty
            for protocol F1, which does not ask for them.
    """

    noise: PixelNoise
    factor: float
    power: float
    low: NDArray[np.complex64]
    pixels: tuple[tuple[Floats, float], ...]

    @classmethod
    def of(
        cls, scenes: Sequence[Photograph], *, leak_scenes: int = 2, settings: CaptureSettings = F1_SETTINGS
    ) -> SceneStatistics:
        """Statistics of scenes as :func:`scene_statistics` takes them; errors likewise."""
        pictures = _of_use(scenes)
        if settings.protocol.linear:
            pictures = [Photograph(s.name, s.number, np.minimum(s.light, 1)) for s in pictures]
        means, scales = [float(s.values.mean()) for s in pictures], _scales(pictures)
        if settings.protocol.linear:
            noise = PixelNoise(settings, float(np.mean(scales**2 * means)), float(np.mean(scales**2)))
        else:
            noise = PixelNoise(settings, float(np.mean([s.values.mean() for s in pictures])))
        own: tuple[tuple[Floats, float], ...] = ()
        if not settings.is_f1:
            # Some of the green pixels on the sensor.
            edge = WIDTH * FACTOR
            inner = (s.values[1, edge:-edge:FACTOR, edge:-edge:FACTOR].astype(np.float64) for s in pictures)
            own = tuple((pixels, float(k)) for pixels, k in zip(inner, scales, strict=True))
        pictures = [
            Photograph(s.name, s.number, s.values * np.float32(k)) for s, k in zip(pictures, scales, strict=True)
        ]
        factor, power = _spectrum(pictures)
        spectra = np.stack([scipy.fft.rfft2(values) for values in _mixed(pictures, leak_scenes)])
        rows = np.r_[0 : ROWS // 2, -ROWS // 2 : 0]
        cut = spectra[:, rows, : COLUMNS // 2 + 1] / FACTOR**2
        # The highest frequencies of an even grid stand for both signs; without them nothing is ambiguous.
        cut[:, ROWS // 2] = 0
        cut[:, :, -1] = 0
        return cls(noise, factor, power, cut.astype(np.complex64), own)

    @cached_property
    def low_truth(self) -> NDArray[np.float32]:
        """The low-passed scenes' own part on the sensor, float32 [scenes, 64, 128]."""
        small = scipy.fft.irfft2(self.low.astype(np.complex128), (ROWS, COLUMNS)).astype(np.float32)
        return np.asarray(small[:, WIDTH:-WIDTH, WIDTH:-WIDTH])


def scene_statistics(
    scenes: Sequence[Photograph], *, leak_scenes: int = 2, settings: CaptureSettings = F1_SETTINGS
) -> SceneStatistics:
    """Statistics of scenes of 1024 x 1536 pixels (others are left out); of bundled ones as they are kept.

    Raises:
        JobError: MF121 if no scene has that size, or one is the same grey everywhere.
    """
    plain = settings.is_f1 or settings.protocol.linear
    if plain and isinstance(scenes, Bundled) and (len(scenes), leak_scenes) in KEPT:
        return _kept(len(scenes), leak_scenes, settings)
    return SceneStatistics.of(scenes, leak_scenes=leak_scenes, settings=settings)


def keep(path: Path = _FILE) -> None:
    """Write the statistics of the bundled scenes: in code values for protocol F1, in linear light for every other."""
    arrays: dict[str, Any] = {}
    for settings in (F1_SETTINGS, CaptureSettings(Protocol("camera", Sensor()))):
        kind = _kind(settings)
        for count, leak_scenes in KEPT:
            statistics = SceneStatistics.of(bundled(count), leak_scenes=leak_scenes, settings=settings)
            noise = statistics.noise
            arrays[f"{kind}_{count}_{leak_scenes}"] = statistics.low
            numbers = [noise.shot, noise.flat, statistics.factor, statistics.power]
            arrays[f"{kind}_{count}_numbers"] = np.array(numbers)
            if statistics.pixels:
                # Light is in single precision, so nothing is lost.
                arrays[f"{kind}_{count}_pixels"] = np.stack([pixels for pixels, _ in statistics.pixels]).astype("f4")
                arrays[f"{kind}_{count}_scales"] = np.array([scale for _, scale in statistics.pixels])
    np.savez_compressed(path, **arrays)


def _kept(count: int, leak_scenes: int, settings: CaptureSettings) -> SceneStatistics:
    kind = _kind(settings)
    with np.load(_FILE) as arrays:
        shot, flat, factor, power = (float(number) for number in arrays[f"{kind}_{count}_numbers"])
        own: tuple[tuple[Floats, float], ...] = ()
        if not settings.is_f1:
            pixels, scales = arrays[f"{kind}_{count}_pixels"], arrays[f"{kind}_{count}_scales"]
            own = tuple((light.astype(np.float64), float(k)) for light, k in zip(pixels, scales, strict=True))
        noise = PixelNoise(settings, shot, flat)
        return SceneStatistics(noise, factor, power, arrays[f"{kind}_{count}_{leak_scenes}"], own)


def _kind(settings: CaptureSettings) -> str:
    return "f1" if settings.is_f1 else "linear"


def _of_use(scenes: Sequence[Photograph]) -> list[Photograph]:
    usable = [s for s in scenes if s.values.shape[1:] == (ROWS * FACTOR, COLUMNS * FACTOR)]
    if not usable:
        what = "no scene has 1536 x 1024 pixels"
        raise JobError("MF121", what, where="scenes", cure="Give photographs of 1536 x 1024 pixels or more")
    for scene in usable:
        contrast = float(scene.values[1].std(dtype=np.float64))
        if not contrast >= LEAST_CONTRAST:
            what = (
                f"the picture {scene.name} is the same grey everywhere: its green values deviate by {contrast:.2g} of "
                f"white, least {LEAST_CONTRAST:g}; it has no spectrum to design for"
            )
            raise JobError("MF121", what, where=f"scenes.{scene.name}", cure="Take it away, or give a photograph")
    return usable


def _scales(scenes: Sequence[Photograph]) -> Floats:
    """Factors that bring the scenes' contrasts to their geometric mean, as a mean over decibels weighs them alike."""
    contrast = np.array([float(s.values[1].std(dtype=np.float64)) for s in scenes])
    return np.asarray(np.exp(np.log(np.maximum(contrast, 1e-6)).mean()) / np.maximum(contrast, 1e-6))


def _mixed(scenes: Sequence[Photograph], most: int) -> list[Floats]:
    """At most so many pictures that leak as much as all: randomly signed sums over the root of their number."""
    green = np.stack([s.values[1] for s in scenes]).astype(np.float64)
    if len(scenes) <= most:
        return list(green)
    signs = np.random.default_rng(0).choice([-1.0, 1.0], size=(most, len(scenes))) / np.sqrt(len(scenes))
    return list(np.tensordot(signs, green, axes=1))


def _spectrum(scenes: Sequence[Photograph]) -> tuple[float, float]:
    """c and p of the green channels' power c f^-p, per pixel of variance."""
    rows, columns = scenes[0].values.shape[1:]
    window = np.hanning(rows)[:, None] * np.hanning(columns)
    power = np.mean([abs(scipy.fft.rfft2((s.values[1] - s.values[1].mean()) * window)) ** 2 for s in scenes], axis=0)
    power /= (window**2).sum()
    distance = np.hypot(scipy.fft.fftfreq(rows)[:, None], scipy.fft.rfftfreq(columns))
    edges = np.geomspace(0.02, 0.4, 13)
    ring = np.digitize(distance, edges)
    middle = np.sqrt(edges[:-1] * edges[1:])
    level = [power[ring == k].mean() for k in range(1, len(edges))]
    slope, offset = np.polyfit(np.log(middle), np.log(level), 1)
    return float(np.exp(offset)), float(-slope)


if __name__ == "__main__":
    keep()
