"""A picture as a sensor records it, and the light that falls on it, as a job states it.

    y = min(Poisson(L · light) + σ N + b N_row, full well / g) / L

with L the electrons of white, g the analog gain, σ the read noise at that gain, b the banding and N normal; a converter
then rounds to its codes. See :mod:`maskfab.job.camera` for the gain, which one photograph's exposures share. Banding is
one number for each row, in all colours, as rows are read one after the other. Under a mosaic each pixel records one
colour, and the two that it lacks are interpolated from its neighbours. Both correlate the noise that a restorer takes
for white.

Electrons of white behind a panel are stated as such, as a signal-to-noise ratio, or as a scene. White of L electrons
has the signal-to-noise ratio L / sqrt(L + σ²), σ the read noise before the amplifier: what a converter adds comes on
top, so a level is the same light at every gain. Levels are told in decibels of it behind the published
display, which lets 0.2072 of the stop's light through; a design that lets through more gets more. Electrons of a scene
are those of :func:`maskfab.job.camera.white_electrons`.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import lru_cache
from types import MappingProxyType

import numpy as np
import scipy
from numpy.typing import NDArray

from maskfab.base.arrays import Singles
from maskfab.base.errors import JobError
from maskfab.camera.frames.frame import Frame
from maskfab.camera.record import Noise, Record, interpolated, sampled
from maskfab.job.camera import REFERENCE_TRANSMISSION, USUAL_MAX_GAIN, Camera, Sensor, white_electrons
from maskfab.job.sections import ExposureSection

LEVELS = (24, 32, 40)


def record_light(
    sensor: Sensor, light: NDArray[np.float32], electrons: float, seed: int, *, gain: float | None = None
) -> Record:
    """Light in units of white, as a sensor records it.

    Args:
        light: on the pixels, [3, rows, columns], white is 1; what a transform left below 0 is dark.
        electrons: of white, g.
        seed: of ``numpy.random.default_rng``; the same seed gives the same record. It draws the same normal numbers
            whatever the light, so that a pixel's noise behind one design is paired with that behind another.
        gain: analog gain; None for that of the sensor in this light.
    """
    sensor = sensor.amplified(sensor.gain_for(electrons) if gain is None else gain)
    plane = light if sensor.mosaic == "none" else sampled(light)
    sizes = _draws(sensor, plane)
    draws = iter(_kept(seed, sizes)) if plane.size <= _MOST_KEPT else _normals(np.random.default_rng(seed), sizes)
    full = np.float32(sensor.full_well)
    if sensor.bits is None:
        counted = _counted(sensor, plane, electrons, draws)
    else:
        counted = _converted(sensor, _counted(sensor, plane, electrons, draws))
        counted *= np.float32(sensor.step)
        full = np.float32(2**sensor.bits - 1 - sensor.black_level) * np.float32(sensor.step)
    counted /= np.float32(electrons)
    values = counted if sensor.mosaic == "none" else interpolated(counted)
    # As it was rounded for the pixels, or none would be found clipped.
    ceiling = float(full / np.float32(electrons))
    dark = math.sqrt(sensor.early_variance) if sensor.banding else sensor.read_noise
    return Record(values, Noise(electrons, dark, sensor.step), ceiling, sensor.mosaic != "none")


def read_codes(sensor: Sensor, plane: Singles, electrons: float, draw: np.random.Generator) -> Singles:
    """Codes that the converter of an amplified sensor gives of light, less the black level: whole numbers.

    Args:
        plane: light on the pixels in units of white, [..., rows, columns].
        electrons: of white.
    """
    return _converted(sensor, _counted(sensor, plane, electrons, _normals(draw, _draws(sensor, plane))))


def _converted(sensor: Sensor, counted: Singles) -> Singles:
    """Codes of electrons, in their place."""
    assert sensor.bits is not None
    counted /= np.float32(sensor.step)
    np.rint(counted, out=counted)
    return np.clip(counted, -sensor.black_level, 2**sensor.bits - 1 - sensor.black_level, out=counted)


def _draws(sensor: Sensor, plane: Singles) -> tuple[tuple[int, ...], ...]:
    """Shapes of the normal numbers of a record, in their order: part by part, which takes little beside the record."""
    parts = tuple((min(_AT_ONCE, plane.size - start),) for start in range(0, plane.size, _AT_ONCE))
    return (*parts, *parts, *([(plane.shape[-2], 1)] if sensor.banding else []))


def _normals(draw: np.random.Generator, shapes: Iterable[tuple[int, ...]]) -> Iterator[Singles]:
    return (draw.standard_normal(shape, dtype=np.float32) for shape in shapes)


@lru_cache(maxsize=3)
def _kept(seed: int, shapes: tuple[tuple[int, ...], ...]) -> tuple[Singles, ...]:
    """Those of a seed; kept of as many as a scene has levels, for every die is photographed in the same noise."""
    return tuple(_normals(np.random.default_rng(seed), shapes))


def _counted(sensor: Sensor, plane: Singles, electrons: float, normals: Iterator[Singles]) -> Singles:
    """Electrons with their noise, cut at a full well."""
    counted: Singles = np.empty(plane.shape, dtype=np.float32)
    seen, flat = plane.ravel(), counted.reshape(-1)
    parts = [slice(start, min(start + _AT_ONCE, seen.size)) for start in range(0, seen.size, _AT_ONCE)]
    for part in parts:
        flat[part] = poisson_quantile(np.maximum(seen[part], 0) * np.float32(electrons), next(normals))
    for part in parts:
        flat[part] += np.float32(sensor.read_noise) * next(normals)
    if sensor.banding:
        counted += np.float32(sensor.banding) * next(normals)
    return np.minimum(counted, np.float32(sensor.full_well), out=counted)


_AT_ONCE = 1 << 16
_MOST_KEPT = 1 << 21
"""Pixels of a picture whose normal numbers are kept: of three such they take 50 MB."""
_SERIES_FROM = 4.0
"""Electrons from which on Poisson's quantile is taken from its series."""
_MOST_OF_FEW = 48
"""More than are counted of fewer than those, but for once in 10^34."""


def poisson_quantile(mean: Singles, normal: Singles) -> Singles:
    """Poisson's counts with the probabilities at which normal numbers lie: of normal draws, Poisson's.

    From 4 electrons on a series in 1 / sqrt(m) (M. B. Giles, ACM Trans. Math. Softw. 42, 7, 2016) is rounded,

        n = m + sqrt(m) z + (z² - 1) / 6 - (z³ + 2 z) / (72 sqrt(m)) + (3 z⁴ + 7 z² - 16) / (810 m),

    which is the exact count but for every 400th pixel or fewer, there off by one; below, probabilities are summed.
    """
    bright = np.maximum(mean, np.float32(_SERIES_FROM))
    root, square = np.sqrt(bright), normal * normal
    counts = normal * (root - (square + np.float32(2)) / (np.float32(72) * root))
    counts += bright + (square - np.float32(1)) / np.float32(6)
    counts += ((np.float32(3) * square + np.float32(7)) * square - np.float32(16)) / (np.float32(810) * bright)
    np.maximum(np.rint(counts, out=counts), 0, out=counts)
    few = np.flatnonzero(mean < np.float32(_SERIES_FROM))
    left, within = mean[few], np.asarray(scipy.special.ndtr(normal[few]))
    chance = np.exp(-left)
    for count in range(_MOST_OF_FEW):
        counts[few] = count
        more = np.flatnonzero(within > chance)
        if not more.size:
            break
        few, left, within = few[more], left[more], within[more] - chance[more]
        chance = chance[more] * left / np.float32(count + 1)
    return np.asarray(counts)


_MOST_DB = 300.0
"""More light than any well holds, and little enough for a float."""


@dataclass(frozen=True)
class Exposure:
    """Light of white: its electrons, and their signal-to-noise ratio, behind the published display."""

    electrons: float
    level_db: float
    stated: str

    @classmethod
    def at(cls, level_db: float, sensor: Sensor, *, whole: bool = False) -> Exposure:
        """Light that gives white a signal-to-noise ratio behind the published display.

        Raises:
            JobError: MF141 if a full well cannot hold it, or for a level without light.
        """
        if not (math.isfinite(level_db) and level_db > 0):
            what = f"a level of {level_db:g} dB has no light to speak of"
            raise JobError("MF141", what, where="levels", cure="Give 10 to 40 dB")
        square = 10 ** (min(level_db, _MOST_DB) / 10)
        electrons = (square + math.sqrt(square**2 + 4 * square * sensor.read_noise**2)) / 2
        exposure = cls(round(electrons) if whole else electrons, level_db, f"{level_db:g} dB")
        exposure.check(sensor, lambda: _held_level(sensor))
        return exposure

    @classmethod
    def of_white(cls, electrons: float, sensor: Sensor) -> Exposure:
        """So many electrons of white behind the published display. Raises JobError MF141 as :meth:`at`."""
        stated = f"{electrons:g} electrons of white"
        return cls._of(electrons, sensor, stated, lambda: f"white = {sensor.ceiling:g} or less")

    @classmethod
    def of_scene(
        cls, luminance: float, time_s: float, efficiency: float, *, focal_ratio: float, pixel_um: float, sensor: Sensor
    ) -> Exposure:
        """White of a luminance in cd/m², for a time in seconds, on pixels of a quantum efficiency."""
        electrons = white_electrons(luminance, time_s, efficiency, focal_ratio, pixel_um)
        stated = f"white of {luminance:g} cd/m2 for {time_s:g} s at a quantum efficiency of {efficiency:g}"
        return cls._of(electrons, sensor, stated, lambda: _held_time(time_s * sensor.ceiling / electrons))

    @classmethod
    def _of(cls, electrons: float, sensor: Sensor, stated: str, holds: Callable[[], str]) -> Exposure:
        if not (math.isfinite(electrons) and electrons > 0):
            raise JobError("MF141", f"{stated} is no light", where="exposure", cure="Give the scene more light")
        exposure = cls(electrons, _level_db(electrons, sensor), stated)
        exposure.check(sensor, holds)
        return exposure

    def check(self, sensor: Sensor, holds: Callable[[], str]) -> None:
        """Refuse white that overflows a full well, or a stated gain, behind the published display."""
        if self.electrons > sensor.ceiling:
            gain = sensor.stated_gain or 1.0
            limit = f"the largest code at a gain of {gain:g}" if gain > 1 else "the full well"
            what = (
                f"{self.stated}: white is {self.electrons:.6g} electrons behind the published display, and {limit} is "
                f"{sensor.ceiling:g}"
            )
            well = f"a full well of {math.ceil(self.electrons * gain)} electrons or more"
            cure = f"Use {holds()}; or {'less gain, or ' if gain > 1 else ''}{well}"
            raise JobError("MF141", what, where="exposure", cure=cure)

    def behind(self, transmission: float) -> float:
        """Electrons of white behind a design that passes such a share of the stop's light, g."""
        if not 0 < transmission <= 1:
            what = f"a transmission of {transmission:g} is outside 0 to 1"
            raise JobError("MF104", what, cure="Open some of the stop")
        return self.electrons * transmission / REFERENCE_TRANSMISSION


def _held_level(sensor: Sensor) -> str:
    *_, most = held = _held_levels(sensor)
    return f"at most {most:g} dB, such as snr = [{', '.join(f'{level:g}' for level in held)}] in [exposure]"


def _held_levels(sensor: Sensor) -> tuple[float, ...]:
    """Protocol F1's levels that a full well holds, and the most that it does."""
    most = math.floor(10 * _level_db(sensor.ceiling, sensor)) / 10
    return (*(level for level in LEVELS if level < most), most)


def _held_time(most_s: float) -> str:
    step = 10.0 ** (math.floor(math.log10(most_s)) - 2)
    return f'time = "{math.floor(most_s / step) * step * 1e3:.3g} ms" or less'


def _level_db(electrons: float, sensor: Sensor) -> float:
    """Signal-to-noise ratio of so many electrons, dB: shot noise and read noise."""
    return 20 * math.log10(electrons / math.sqrt(electrons + sensor.read_noise**2))


F1_SENSOR = Sensor()
ELECTRONS: Mapping[int, int] = MappingProxyType(
    {level: int(Exposure.at(level, F1_SENSOR, whole=True).electrons) for level in (24, 28, 32, 36, 40)}
)
"""Electrons of white behind the published display at the levels of protocol F1, dB."""


def stated_light(section: ExposureSection | None, sensor: Sensor, camera: Camera) -> tuple[tuple[float, ...], str]:
    """Levels of [exposure] in dB, and how it states them; protocol F1's where it states none.

    Of those, a full well that is smaller than protocol F1's holds less: its most stands for what it does not hold.
    """
    if section is None or (section.snr, section.white, section.luminance) == (None, None, None):
        held = _held_levels(sensor)
        if held[-1] >= LEVELS[-1]:
            return LEVELS, in_decibels(LEVELS)
        return held, f"{in_decibels(held)}, the most that a full well of {sensor.ceiling:g} electrons holds"
    if section.snr is not None:
        return section.snr, in_decibels(section.snr)
    if section.white is not None:
        light = Exposure.of_white(section.white, sensor)
    else:
        assert section.luminance is not None
        assert section.time is not None
        assert section.quantum_efficiency is not None
        light = Exposure.of_scene(
            section.luminance,
            section.time,
            section.quantum_efficiency,
            focal_ratio=camera.focal_um / camera.stop.diameter_um,
            pixel_um=camera.pixel_um,
            sensor=sensor,
        )
    return (light.level_db,), f"{light.stated}, {light.electrons:.0f} electrons behind the published display"


def in_decibels(levels: Sequence[float]) -> str:
    """Levels of light in words."""
    return (
        f"signal-to-noise ratio of white behind the published display {', '.join(f'{level:g}' for level in levels)} dB"
    )


def sensor_words(sensor: Sensor) -> str:
    """A sensor in words."""
    converter = "" if sensor.bits is None else f", {sensor.bits} bits, black level {sensor.black_level}"
    mosaic = "" if sensor.mosaic == "none" else f", mosaic {sensor.mosaic}"
    late = f", {sensor.converter_noise:g} after the amplifier" if sensor.converter_noise else ""
    rows = f", banding {sensor.banding:g} electrons" if sensor.banding else ""
    iso = "" if sensor.iso is None else f" (ISO {sensor.iso:g})"
    gain = "" if sensor.stated_gain is None else f", analog gain {sensor.stated_gain:g}{iso}"
    return (
        f"full well {sensor.full_well:g} electrons, read noise {sensor.read_noise:g} electrons"
        f"{late}{rows}{converter}{mosaic}{gain}"
    )


def picked_gains(sensor: Sensor, levels: Sequence[float]) -> list[float]:
    """Analog gains that levels of light pick behind the published display; none where it is stated, or idle."""
    if sensor.stated_gain is not None or not sensor.amplifies:
        return []
    return [float(sensor.gain_for(Exposure.at(level, sensor).electrons)) for level in levels]


def told_gains(sensor: Sensor, levels: Sequence[float]) -> str:
    """Those gains in words; empty where there are none."""
    if not (gains := picked_gains(sensor, levels)):
        return ""
    listed = ", ".join(f"{gain:.3g} at {level:g} dB" for gain, level in zip(gains, levels, strict=True))
    most = sensor.max_gain or USUAL_MAX_GAIN
    return (
        f"analog gain: picked so that white fits the converter, at most {most:g}: {listed} behind the published "
        "display, less behind a die that passes more light"
    )


_ISO_ALIKE = 0.05
"""Share by which ISO speeds may differ that say the same: cameras round theirs to thirds of a stop."""


def gain_of_file(sensor: Sensor, name: str, iso: float | None) -> float | None:
    """Analog gain that a file was taken at: as [sensor] states it, or the file's ISO over that of base gain.

    Returns:
        None where neither tells.

    Raises:
        JobError: MF185 for an ISO that is not the one stated, or below that of base gain.
    """
    stated, base = sensor.stated_gain, sensor.base_iso
    if iso is None or base is None:
        return stated
    if stated is not None and abs(iso / (stated * base) - 1) > _ISO_ALIKE:
        what = f"{name} says that it was taken at ISO {iso:g}, and [sensor] states ISO {stated * base:g}"
        cure = f"State iso = {iso:g}, or give a picture of ISO {stated * base:g}"
        raise JobError("MF185", what, where="sensor.iso", cure=cure)
    if iso < (1 - _ISO_ALIKE) * base:
        what = f"{name} says that it was taken at ISO {iso:g}, below the base_iso of {base:g} of [sensor]"
        raise JobError("MF185", what, where="sensor.base_iso", cure=f"State base_iso = {iso:g} or less")
    return max(iso / base, 1.0) if stated is None else stated


def counted(sensor: Sensor | None, frame: Frame) -> tuple[float, float] | None:
    """Electrons for each count of a frame, and the noise of a pixel in the dark in electrons, where [sensor] tells.

    A full well over the analog gain is white above black, in counts of the file, whatever it scales them by:

        electrons for each count = full well / g / (white - black)

    Returns:
        None without a converter, a gain, or counts of white.
    """
    gain = None if sensor is None else gain_of_file(sensor, frame.name, frame.sensitivity)
    if sensor is None or gain is None or sensor.bits is None or not math.isfinite(frame.white):
        return None
    taken = sensor.amplified(gain)
    return taken.full_well / (frame.white - float(np.mean(frame.black))), math.sqrt(taken.early_variance)
