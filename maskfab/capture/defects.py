"""Pixels that tell something else than the light: hot ones, dust, and those that stand alone among their neighbours."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from maskfab.base.arrays import Floats
from maskfab.capture.beside import mean_beside
from maskfab.capture.frames import Frame, Lattice
from maskfab.errors import SourceError

Marks = NDArray[np.bool_]

_HOT, _ALONE = 6.0, 8.0
_MAD = 1.4826
_DUST, _PROVEN = 0.05, 5.0
_SURROUNDINGS = 31
_BLIND = 0.5
_ALIKE = 2.0


@dataclass(frozen=True, eq=False)
class Dark:
    """The dark of one colour.

    Attributes:
        hot: [rows, columns] pixels far above the others.
        level: mean counts above black of the others, for each second where ``per_second``.
        per_second: whether the exposures of the dark frames are known.
    """

    hot: Marks
    level: float
    per_second: bool

    def counts(self, exposure_s: float) -> float:
        """Level in an exposure."""
        return self.level * exposure_s if self.per_second else self.level


@dataclass(frozen=True, eq=False)
class Response:
    """Response of one colour's pixels to even light, from a flat field.

    Attributes:
        share: [rows, columns] of their mean.
        error: of the share, as a share of it.
        dust: pixels that are darker than their surroundings.
        blind: pixels that are too dark to be divided by their share.
    """

    share: Floats
    error: Floats
    dust: Marks
    blind: Marks


def dark_of(frames: Sequence[Frame], place: int, lattice: Lattice) -> Dark:
    """Hot pixels and level of one colour in dark frames: six robust standard deviations above the median.

    Args:
        frames: without light; all with an exposure time, or their level is that of every exposure.
        place: of the lattice among those of a frame.
        lattice: of the colour.
    """
    stack = np.stack([lattice.of(frame.counts).astype(np.float64) - frame.black[place] for frame in frames])
    middle = np.median(stack, axis=0)
    usual = float(np.median(middle))
    spread = max(_MAD * float(np.median(np.abs(middle - usual))), 1 / np.sqrt(12))
    hot = middle > usual + _HOT * spread
    times = [frame.exposure_s for frame in frames if frame.exposure_s is not None]
    levels = stack[:, ~hot].mean(axis=1)
    if len(times) == len(frames):
        return Dark(hot, float(levels.sum() / sum(times)), per_second=True)
    return Dark(hot, float(levels.mean()), per_second=False)


def response_of(
    frames: Sequence[Frame], place: int, lattice: Lattice, electrons_per_count: float, dark_e2: float
) -> Response:
    """Response of one colour from frames of even light, its mean 1.

    Args:
        frames: of the flat field, none of them full.
        place: of the lattice among those of a frame.
        lattice: of the colour.
        electrons_per_count: gain.
        dark_e2: variance without light, in electrons squared.

    Raises:
        SourceError: MF334 if a flat field is dark, or a twentieth of it is full.
    """
    full = np.any([frame.full for frame in frames], axis=0)[
        lattice.first[0] :: lattice.step, lattice.first[1] :: lattice.step
    ]
    electrons = electrons_per_count * np.sum(
        [lattice.of(frame.counts).astype(np.float64) - frame.black[place] for frame in frames], axis=0
    )
    mean = float(electrons[~full].mean()) if not full.all() else 0.0
    if full.mean() > _DUST or mean < _HOT * np.sqrt(dark_e2 * len(frames)):
        raise SourceError(
            "MF334",
            f"the flat field {frames[0].name} is {100 * full.mean():.0f} % full and has {mean:.3g} electrons a pixel",
            where=frames[0].name,
            cure="Expose an evenly lit surface to half of the white level",
        )
    share = electrons / mean
    error = np.sqrt(np.maximum(electrons, 0.0) + dark_e2 * len(frames)) / np.maximum(electrons, 1.0)
    around = ndimage.uniform_filter(share, _SURROUNDINGS, mode="nearest")
    dust = share < (1 - _DUST) * around - _PROVEN * error * around
    return Response(share, error, dust, (share < _BLIND * around) | full)


def alone(light: Floats, sigma: Floats, valid: Marks) -> Marks:
    """Pixels eight standard deviations from neighbours that agree among themselves: dust, a hot pixel, or a fine peak.

    Args:
        light: [rows, columns] of one colour.
        sigma: its standard deviation.
        valid: pixels that are looked at.
    """
    beside = mean_beside(light, valid)
    expected = mean_beside(np.where(valid, sigma, 0.0) ** 2, valid)
    agreed = mean_beside(light**2, valid) - beside**2 < _ALIKE**2 * expected
    own = np.where(valid, sigma, 0.0) ** 2
    return np.asarray(valid & agreed & ((light - beside) ** 2 > _ALONE**2 * (own + expected / 8)))
