"""Sensor and light that a job states, for all that takes its photographs or expects what they will be."""

from __future__ import annotations

from collections.abc import Sequence

from maskfab.camera.exposure import Exposure
from maskfab.camera.protocol import LEVELS
from maskfab.camera.sensor import Sensor
from maskfab.jobfile.sections import ExposureSection, SensorSection
from maskfab.model import Camera


def stated_sensor(section: SensorSection | None) -> Sensor:
    """The sensor of [sensor]; protocol F1's without one.

    Raises:
        JobError: MF140 for a sensor that cannot be.
    """
    return Sensor() if section is None else Sensor(**dict(section))


def stated_light(section: ExposureSection | None, sensor: Sensor, camera: Camera) -> tuple[tuple[float, ...], str]:
    """Levels of [exposure] in dB, and how it states them; protocol F1's where it states none.

    Raises:
        JobError: MF141 for a light that cannot be.
    """
    if section is None or (section.snr, section.white, section.luminance) == (None, None, None):
        return LEVELS, in_decibels(LEVELS)
    if section.snr is not None:
        return section.snr, in_decibels(section.snr)
    if section.white is not None:
        found = Exposure.of_white(section.white, sensor)
    else:
        assert section.luminance is not None
        assert section.time is not None
        assert section.quantum_efficiency is not None
        found = Exposure.of_scene(
            section.luminance,
            section.time,
            section.quantum_efficiency,
            focal_ratio=camera.focal_um / camera.stop.diameter_um,
            pixel_um=camera.pixel_um,
            sensor=sensor,
        )
    return (found.level_db,), f"{found.stated}, {found.electrons:.0f} electrons behind the published display"


def in_decibels(levels: Sequence[float]) -> str:
    """Levels of light in words."""
    return f"signal-to-noise ratio of white behind the published display {', '.join(f'{each:g}' for each in levels)} dB"


def told(sensor: Sensor) -> str:
    """A sensor in words."""
    converter = "" if sensor.bits is None else f", {sensor.bits} bits, black level {sensor.black_level}"
    mosaic = "" if sensor.mosaic == "none" else f", mosaic {sensor.mosaic}"
    return f"full well {sensor.full_well:g} electrons, read noise {sensor.read_noise:g} electrons{converter}{mosaic}"
