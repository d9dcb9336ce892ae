"""A restored photograph at the places of another one's pixels, and what is left between both."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from maskfab.base.arrays import Singles
from maskfab.capture.restoring.registration import Registration, registered

Flags = NDArray[np.bool_]

_ORDER = 5
"""Of the splines: of a wave of 0.3 cycles per pixel they keep 0.99, of 0.4 they keep 0.92."""
_REACH = 4
"""Pixels from a full one, or from an edge, that it touches."""


@dataclass(frozen=True, eq=False)
class Brought:
    """A picture brought onto another.

    Attributes:
        name: of its file, without suffix.
        onto: name of the other.
        registration: how it lay against that.
        picture: float32 [3, rows, columns] of the other's shape, within 0 to 1; 0 beyond its own edges.
        gain, offset: of each colour, by which the other's light becomes this one's in the mean.
        difference: root of the mean squared difference that they leave, over pixels that both show and that are full in
            neither, by the gain in light of the other, whose white is 1.
    """

    name: str
    onto: str
    registration: Registration
    picture: Singles
    gain: tuple[float, ...]
    offset: tuple[float, ...]
    difference: float

    def to_dict(self) -> dict[str, Any]:
        """All but the picture."""
        return {
            "name": self.name,
            "onto": self.onto,
            **self.registration.to_dict(),
            "gain": list(self.gain),
            "offset": list(self.offset),
            "rms_difference": self.difference,
        }

    def __str__(self) -> str:
        return (
            f"{self.name} against {self.onto}: {self.registration}; {self.difference:.4f} of white root mean square "
            f"difference after gain and offset"
        )


def brought(names: tuple[str, str], first: Singles, first_full: Flags, second: Singles, second_full: Flags) -> Brought:
    """The second picture, resampled once, at the places of the first one's pixels.

    Args:
        names: of both.
        first, second: linear light within 0 to 1, [3, rows, columns].
        first_full, second_full: [rows, columns], pixels that were full.

    Raises:
        SourceError: as :func:`maskfab.capture.restoring.registration.registered`.
    """
    found = registered(first, first_full, second, second_full, names[1])
    where, shape = found.where, (first.shape[1], first.shape[2])
    taken = np.stack([where.taken(plane, shape, order=_ORDER) for plane in second])
    inner = np.zeros(second.shape[1:], dtype=np.float32)
    inner[_REACH:-_REACH, _REACH:-_REACH] = 1
    counted = where.taken(np.where(second_full, np.float32(0), inner), shape, order=1) > 0.99
    counted &= ~first_full
    gains, offsets, squares = [], [], 0.0
    for one, two in zip(first, taken, strict=True):
        a, b = one[counted].astype(np.float64), two[counted].astype(np.float64)
        gain = float(np.cov(a, b)[0, 1] / a.var(ddof=1))
        gains.append(gain)
        offsets.append(float(b.mean() - gain * a.mean()))
        squares += float(np.square((b - offsets[-1]) / gain - a).mean()) / len(first)
    there = where.taken(np.ones(second.shape[1:], dtype=np.float32), shape, order=1) > 0.5
    return Brought(
        names[1],
        names[0],
        found,
        np.where(there, np.clip(taken, 0, 1), np.float32(0)),
        tuple(gains),
        tuple(offsets),
        squares**0.5,
    )
