"""The record of a scene by a sensor, and the noise that it is known to have."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from maskfab.base.arrays import Singles


@dataclass(frozen=True)
class Noise:
    """Noise of a record in units of white.

    Attributes:
        electrons: of white, g.
        read_noise: its standard deviation, in electrons.
        step: of the converter, in electrons; 0 for none.
    """

    electrons: float
    read_noise: float
    step: float = 0.0

    @property
    def floor(self) -> float:
        """Variance in the dark: read noise and rounding."""
        return (self.read_noise**2 + self.step**2 / 12) / self.electrons**2

    def variance(self, light: Singles) -> Singles:
        """Of every pixel, for the light that falls on it."""
        return np.asarray(np.maximum(light, 0) / np.float32(self.electrons) + np.float32(self.floor))

    def times(self, factor: float) -> Noise:
        """Noise of so many times the variance, at every light."""
        return Noise(self.electrons / factor, self.read_noise / factor**0.5, self.step / factor**0.5)

    @property
    def zones(self) -> tuple[tuple[float, Noise], ...]:
        """Light up to which there is which noise: itself, whatever the light."""
        return ((math.inf, self),)


@dataclass(frozen=True)
class MergedNoise:
    """Noise of the mean of several exposures with weights 1 / variance, full wells left out.

    Attributes:
        exposures: each one's noise and full well, in units of white, the longest first.
    """

    exposures: tuple[tuple[Noise, float], ...]

    @property
    def electrons(self) -> float:
        """Of white, in all exposures that hold it; the shortest's where none does."""
        return next(noise.electrons for top, noise in self.zones if top > 1)

    def variance(self, light: Singles) -> Singles:
        """Of every pixel; where all are at their full wells, the shortest's."""
        precision = np.zeros_like(light)
        for noise, ceiling in self.exposures[:-1]:
            precision += (light < np.float32(ceiling)) / noise.variance(light)
        return np.asarray(1 / (precision + 1 / self.exposures[-1][0].variance(light)))

    def times(self, factor: float) -> MergedNoise:
        """As :meth:`Noise.times`."""
        return MergedNoise(tuple((noise.times(factor), ceiling) for noise, ceiling in self.exposures))

    @property
    def zones(self) -> tuple[tuple[float, Noise], ...]:
        """Light up to which there is which noise, in rising order.

        Of each zone it is that of one exposure with the electrons of all, and with their variance in the dark: between
        dark and bright that is up to a twentieth too little.
        """
        found = []
        for first, (_, ceiling) in enumerate(self.exposures):
            open_still = [noise for noise, _ in self.exposures[first:]]
            electrons = sum(noise.electrons for noise in open_still)
            floors = [noise.floor for noise in open_still]
            floor = 0.0 if min(floors) == 0 else 1 / sum(1 / each for each in floors)
            found.append((ceiling, Noise(electrons, electrons * floor**0.5)))
        return (*found[:-1], (math.inf, found[-1][1]))


@dataclass(frozen=True, eq=False)
class Record:
    """A photograph as recorded, black level taken off and colours complete.

    Attributes:
        values: float32 [3, rows, columns], white is 1, row 0 on top; below 0 where noise of the dark made it so.
        noise: of every pixel.
        ceiling: what a full well reads, in units of white; infinite if nothing clips.
        interpolated: whether two colours of every pixel were found from its neighbours, so that noise is correlated as
            :func:`maskfab.camera.mosaic.interpolated` makes it.
    """

    values: Singles
    noise: Noise | MergedNoise
    ceiling: float = math.inf
    interpolated: bool = False

    @property
    def variance(self) -> Singles:
        """Of every pixel, [3, rows, columns]."""
        return self.noise.variance(self.values)

    @property
    def clipped(self) -> NDArray[np.bool_]:
        """Pixels that a full well cut off."""
        return np.asarray(self.values >= np.float32(self.ceiling))
