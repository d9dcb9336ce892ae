r"""Scenes for those who have no photographs: dead leaves, whose spectrum falls as a power of f, as nature's does.

Discs of random colours fall on each other; a radius r is drawn with density r^-3 between two limits, which makes the
picture look the same at every scale (Lee, Mumford, Huang, Int. J. Comput. Vision 41, 35, 2001). Every scene follows
from its seed. From 0.02 to 0.4 cycles per pixel its power falls as f^-2.9; that of three soft photographs as f^-3.0.
"""

from __future__ import annotations

import numpy as np

from maskfab.imaging.photographs import LONG, SHORT, Scene

_SMALLEST, _LARGEST = 3.0, 300.0
_DISCS = 6000


def dead_leaves(seed: int, rows: int = SHORT, columns: int = LONG) -> Scene:
    """One scene of 6000 discs of radius 3 to 300 pixels, the last on top, edges one pixel soft."""
    draw = np.random.default_rng(seed)
    share = draw.random(_DISCS)
    radii = 1 / np.sqrt(share / _LARGEST**2 + (1 - share) / _SMALLEST**2)
    # Few large leaves fall; the ground is laid first with them so that no place stays bare.
    radii[: _DISCS // 50] = np.maximum(radii[: _DISCS // 50], draw.uniform(80, _LARGEST, _DISCS // 50))
    middles = draw.random((_DISCS, 2)) * (rows, columns)
    brightness = draw.random(_DISCS) ** 2
    colours = np.clip(brightness[:, None] * draw.uniform(0.6, 1.4, (_DISCS, 3)), 0.01, 1).astype(np.float32)
    values = np.full((3, rows, columns), 0.2, dtype=np.float32)
    for (y, x), radius, colour in zip(middles, radii, colours, strict=True):
        top, left = max(0, int(y - radius) - 1), max(0, int(x - radius) - 1)
        part = values[:, top : int(y + radius) + 3, left : int(x + radius) + 3]
        up = np.arange(top, top + part.shape[1], dtype=np.float32)[:, None] - np.float32(y)
        across = np.arange(left, left + part.shape[2], dtype=np.float32) - np.float32(x)
        cover = np.clip(np.float32(radius + 0.5) - np.hypot(up, across), 0, 1)
        part += cover * (colour[:, None, None] - part)
    return Scene(f"leaves{seed}", seed, np.clip(values, 0, 1))


def bundled(count: int = 4) -> tuple[Scene, ...]:
    """The scenes used where no photographs are given: dead leaves of seeds 1 to ``count``."""
    return tuple(dead_leaves(seed) for seed in range(1, count + 1))
