"""The record of a scene by a sensor, and the noise that it is known to have."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Singles = NDArray[np.float32]


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


@dataclass(frozen=True, eq=False)
class Record:
    """A photograph as recorded, black level taken off and colours complete.

    Attributes:
        values: float32 [3, rows, columns], white is 1, row 0 on top; below 0 where noise of the dark made it so.
        noise: of every pixel.
        ceiling: what a full well reads, in units of white; infinite if nothing clips.
        merged: variance of every pixel, of the same shape, where exposures were merged; None where it is the noise's.
    """

    values: Singles
    noise: Noise
    ceiling: float = float("inf")
    merged: Singles | None = None

    @property
    def variance(self) -> Singles:
        """Of every pixel, [3, rows, columns]."""
        return self.noise.variance(self.values) if self.merged is None else self.merged

    @property
    def clipped(self) -> NDArray[np.bool_]:
        """Pixels that a full well cut off."""
        return np.asarray(self.values >= np.float32(self.ceiling))
