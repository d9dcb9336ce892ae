"""What a sensor, a lamp and a lens do to exposures of a point light, one fault at a time, of a strength of its own.

A simulator that knows nothing of how the package looks for them: electrons of every pixel are drawn and then counted.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from capture_simulator import Dots, Optics, lamp_picture
from capture_simulator import picture as point_picture
from numpy.typing import NDArray
from scipy import ndimage

from maskfab.camera.frames.frame import Frame

Floats = NDArray[np.float64]
READ_NOISE_E, GAIN, BLACK, WHITE = 4.87, 1.3, 512.0, 65535.0


@dataclass(frozen=True, eq=False)
class Bench:
    """A die before a lens, and exposures of it.

    Attributes:
        peak_e: electrons of the brightest pixel in an exposure of time 1, which lasts a millisecond.
        mosaic: lines of light that red, green and blue pixels see, of a mosaic RGGB; None of a sensor without colours.
    """

    die: Dots
    optics: Optics
    times: tuple[float, ...] = (1.0, 4.0, 16.0, 64.0)
    peak_e: float = 1e4
    mosaic: dict[str, float] | None = None

    def light(
        self, optics: Optics | None = None, at_um: tuple[float, float] = (0.0, 0.0), wide_um: float = 0.0
    ) -> Floats:
        """Share of the light in every pixel, of a point or of a disc."""
        optics = optics or self.optics

        def picture(die: Dots, optics: Optics, at_um: tuple[float, float]) -> Floats:
            return lamp_picture(die, optics, wide_um, at_um) if wide_um else point_picture(die, optics, at_um)

        if self.mosaic is None:
            return picture(self.die, optics, at_um)
        seen = {
            colour: picture(self.die, replace(optics, lines=_about(line, optics)), at_um)
            for colour, line in self.mosaic.items()
        }
        rows, columns = np.indices(seen["G"].shape)
        return np.choose(rows % 2 + columns % 2, [seen["R"], seen["G"], seen["B"]])

    def frames(self, kind: str, strength: float, seed: int) -> list[Frame]:
        """Exposures with one fault; of strength 0 without any."""
        random = np.random.default_rng([seed, sum(map(ord, kind))])
        light = _OF_LIGHT[kind](self, strength, random) if kind in _OF_LIGHT and strength else self.light()
        unit = self.peak_e / light.max()
        made = _OF_SENSOR[kind](light.shape, strength, random) if kind in _OF_SENSOR and strength else _Plain()
        frames = []
        for place, time in enumerate(self.times):
            charge = made.light(unit * light + 1.0, place, random) * time
            electrons = made.electrons(random.poisson(np.clip(charge, 0, None)).astype(np.float64), time, random)
            electrons = electrons + random.normal(0, READ_NOISE_E, charge.shape)
            counts = np.clip(np.rint(made.counts(electrons / GAIN) + BLACK), 0, WHITE).astype(np.float32)
            pattern = None if self.mosaic is None else (("R", "G"), ("G", "B"))
            black = (BLACK,) * (1 if pattern is None else 4)
            frames.append(Frame(f"{time:g}.tif", counts, black, WHITE, pattern, 1e-3 * time))
        return frames


def _about(line: float, optics: Optics) -> dict[str, float]:
    """The band of a bench about another line."""
    first = next(iter(optics.lines))
    return {line + each - first: weight for each, weight in optics.lines.items()}


class _Plain:
    """A sensor without a fault."""

    def light(self, rate_e: Floats, place: int, random: np.random.Generator) -> Floats:
        return rate_e

    def electrons(self, electrons: Floats, time: float, random: np.random.Generator) -> Floats:
        return electrons

    def counts(self, counts: Floats) -> Floats:
        return counts


class _Black(_Plain):
    def __init__(self, shape: tuple[int, ...], strength: float, random: np.random.Generator) -> None:
        self.by = strength * random.choice((-1.0, 1.0))

    def counts(self, counts: Floats) -> Floats:
        return counts + self.by


class _Gamma(_Plain):
    def __init__(self, shape: tuple[int, ...], strength: float, random: np.random.Generator) -> None:
        self.power = 1 + strength * random.choice((-1.0, 1.0))

    def counts(self, counts: Floats) -> Floats:
        most = WHITE - BLACK
        return np.where(counts > 0, most * (np.maximum(counts, 1e-9) / most) ** self.power, counts)


class _SoftClip(_Plain):
    """Beyond 60 % of white counts grow by less, by a share that grows evenly up to the strength."""

    def __init__(self, shape: tuple[int, ...], strength: float, random: np.random.Generator) -> None:
        self.share = strength

    def counts(self, counts: Floats) -> Floats:
        knee, most = 0.6 * (WHITE - BLACK), WHITE - BLACK
        return counts - self.share * np.maximum(counts - knee, 0.0) ** 2 / (2 * (most - knee))


class _Response(_Plain):
    """Pixels that differ in their response, drawn normally."""

    def __init__(self, shape: tuple[int, ...], strength: float, random: np.random.Generator) -> None:
        self.response = 1 + strength * random.standard_normal(shape)

    def light(self, rate_e: Floats, place: int, random: np.random.Generator) -> Floats:
        return rate_e * self.response


class _Dead(_Response):
    """A share of the pixels that see next to nothing."""

    def __init__(self, shape: tuple[int, ...], strength: float, random: np.random.Generator) -> None:
        self.response = np.where(random.random(shape) < strength, 0.05, 1.0)


class _Shading(_Response):
    """Light that falls by a share to the window's edge, with the square of the distance from a place in it."""

    def __init__(self, shape: tuple[int, ...], strength: float, random: np.random.Generator) -> None:
        rows, columns = np.indices(shape)
        middle = np.array(shape) / 2 + random.uniform(-8, 8, 2)
        self.response = 1 - strength * ((rows - middle[0]) ** 2 + (columns - middle[1]) ** 2) / (shape[0] / 2) ** 2


class _Dust(_Response):
    def __init__(self, shape: tuple[int, ...], strength: float, random: np.random.Generator) -> None:
        self.response = np.ones(shape)
        for _ in range(3):
            row, column = random.integers(4, shape[0] - 8, 2)
            self.response[row : row + 4, column : column + 4] = 1 - strength


class _Hot(_Plain):
    """A share of .3 % of the pixels that fill by so many electrons a millisecond."""

    def __init__(self, shape: tuple[int, ...], strength: float, random: np.random.Generator) -> None:
        self.rate = np.where(random.random(shape) < 0.003, strength * random.lognormal(0, 0.5, shape), 0.0)

    def light(self, rate_e: Floats, place: int, random: np.random.Generator) -> Floats:
        return rate_e + self.rate


class _Lines(_Plain):
    """Rows (or columns) with offsets of their own in every exposure, in electrons."""

    axis = 0

    def __init__(self, shape: tuple[int, ...], strength: float, random: np.random.Generator) -> None:
        self.strength = strength
        self.shape = (shape[0], 1) if self.axis == 0 else (1, shape[1])

    def electrons(self, electrons: Floats, time: float, random: np.random.Generator) -> Floats:
        return electrons + random.normal(0, self.strength, self.shape)


class _Columns(_Lines):
    axis = 1


class _Flicker(_Plain):
    """Light that changes from exposure to exposure."""

    def __init__(self, shape: tuple[int, ...], strength: float, random: np.random.Generator) -> None:
        self.strength = strength

    def light(self, rate_e: Floats, place: int, random: np.random.Generator) -> Floats:
        return rate_e * max(0.1, 1 + self.strength * random.standard_normal())


def _glare(bench: Bench, strength: float, random: np.random.Generator) -> Floats:
    """A share of the light in a skirt that falls with the square of the distance, within 200 pixels."""
    light = bench.light()
    axis = np.arange(-200, 201)
    skirt = 1 / (np.hypot(axis[:, None], axis) ** 2 + 4.0)
    middle = ndimage.center_of_mass(light)
    rows, columns = np.indices(light.shape)
    at = 1 / ((rows - middle[0]) ** 2 + (columns - middle[1]) ** 2 + 4.0) / skirt.sum()
    return (1 - strength) * light + strength * light.sum() * at


def _lamp_size(bench: Bench, strength: float, random: np.random.Generator) -> Floats:
    """A disc of light, of so many um across on the sensor."""
    return bench.light(wide_um=strength)


def _band(bench: Bench, strength: float, random: np.random.Generator) -> Floats:
    """A light of a band of so many nm (full width at half maximum of a Gaussian) in place of a line."""
    first = next(iter(bench.optics.lines))
    off = np.linspace(-1.4, 1.4, 9) * strength / 2
    lines = {first + float(each): float(np.exp(-4 * np.log(2) * (each / strength) ** 2)) for each in off}
    return bench.light(replace(bench.optics, lines=lines))


def _second_lamp(bench: Bench, strength: float, random: np.random.Generator) -> Floats:
    far, angle = random.uniform(15, 50), random.uniform(0, 2 * np.pi)
    return bench.light() + strength * bench.light(at_um=(float(far * np.cos(angle)), float(far * np.sin(angle))))


_OF_LIGHT: dict[str, Callable[[Bench, float, np.random.Generator], Floats]] = {
    "glare": _glare,
    "lamp size": _lamp_size,
    "bandwidth": _band,
    "second lamp": _second_lamp,
}
_OF_SENSOR: dict[str, type] = {
    "black": _Black,
    "gamma": _Gamma,
    "soft clip": _SoftClip,
    "response": _Response,
    "dead": _Dead,
    "shading": _Shading,
    "dust": _Dust,
    "hot": _Hot,
    "rows": _Lines,
    "columns": _Columns,
    "flicker": _Flicker,
}
KINDS = (*_OF_LIGHT, *_OF_SENSOR)
