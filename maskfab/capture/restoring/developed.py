"""Restored light as a picture: balance, colour matrix, and as bright as asked; codes follow by sRGB's curve."""

from __future__ import annotations

import math

import numpy as np

from maskfab.base.arrays import Singles
from maskfab.capture.restoring.photo import Photo
from maskfab.errors import JobError

MOST_STOPS = 16.0


def developed(photo: Photo, light: Singles, stops: float = 0.0) -> Singles:
    """Linear sRGB within 0 to 1.

    Args:
        photo: that was restored.
        light: [3, rows, columns] in units of each colour's own white.
        stops: by which the picture is brightened, a factor of 2 each.

    Raises:
        JobError: MF104 for stops that are not finite, or beyond 16.
    """
    require_stops(stops)
    colours = np.tensordot(photo.matrix.astype(np.float32), balanced(photo, light), axes=1)
    return np.asarray(np.clip(colours * np.float32(2.0**stops), 0, 1))


def balanced(photo: Photo, light: Singles) -> Singles:
    """Light in colours of which equal ones are neutral, 1 at most."""
    # Where one colour is full the others could be above it: white there is that of the least, or it would be tinted.
    return np.asarray(np.minimum(light * np.array(photo.balance, dtype=np.float32)[:, None, None], 1))


def require_stops(stops: float) -> None:
    """Refuse a brightness that no picture has (MF104)."""
    if not (math.isfinite(stops) and abs(stops) <= MOST_STOPS):
        raise JobError(
            "MF104",
            f"{stops:g} stops are beyond {MOST_STOPS:g}",
            where="stops",
            cure="Give a number of stops such as 1.5",
        )
