r"""Scenes for those who have no photographs: dead leaves, whose spectrum falls as a power of f, as nature's does.

Discs of random colours fall on each other; a radius r is drawn with density r^-3 between two limits, which makes the
picture look the same at every scale (Lee, Mumford, Huang, Int. J. Comput. Vision 41, 35, 2001). Every scene follows
from its seed. From 0.02 to 0.4 cycles per pixel its power falls as f^-2.9, as that of a sharp photograph in daylight.

Photographs taken indoors are dimmer and softer, and what restores them best differs: of three at hand, one has a mean
of 0.40 of white and a power of f^-2.7, the others 0.10 and 0.11, and f^-3.5 and f^-3.7. So every second scene is dim
and soft too: 0.10 and f^-3.5.

For highlights, lamps hang in front of them: discs of 2 to 100 times white.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import overload

import numpy as np
import scipy.fft

from maskfab.camera.photographs import LONG, SHORT, Photograph
from maskfab.optics.numbers.colour import code_of_light

_SMALLEST, _LARGEST = 3.0, 300.0
_DISCS = 6000
_DIM, _SOFTER, _SOFT_FROM = 0.3, 0.3, 0.01
_LAMPS, _LAMP_RADII, _LAMP_LIGHT = 24, (1.5, 9.0), (2.0, 100.0)


def dead_leaves(seed: int, rows: int = SHORT, columns: int = LONG) -> Photograph:
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
        cover = np.hypot(up, across)
        np.subtract(np.float32(radius + 0.5), cover, out=cover)
        np.minimum(np.maximum(cover, 0, out=cover), 1, out=cover)
        change = colour[:, None, None] - part
        change *= cover
        part += change
    return Photograph(f"leaves{seed}", seed, np.clip(values, 0, 1))


def indoors(scene: Photograph) -> Photograph:
    """The scene at 0.3 of its light, softened: amplitudes fall by another f^-0.3 beyond 0.01 cycles per pixel."""
    rows, columns = scene.values.shape[1:]
    frequency = np.hypot(np.arange(rows)[:, None] / (2 * rows), np.arange(columns) / (2 * columns))
    softened = (1 + (frequency / _SOFT_FROM) ** 2) ** (-_SOFTER / 2)
    values = scipy.fft.idctn(scipy.fft.dctn(scene.values, axes=(1, 2)) * softened, axes=(1, 2))
    return replace(scene, name=f"{scene.name}_dim", values=np.clip(_DIM * values, 0, 1).astype(np.float32))


def lit(scene: Photograph) -> Photograph:
    """The scene with 24 lamps, 1.5 to 9 pixels in radius and of 2 to 100 times white; edges one pixel soft."""
    rows, columns = scene.values.shape[1:]
    draw = np.random.default_rng(scene.number)
    light = scene.light.copy()
    y, x = np.arange(rows, dtype=np.float32)[:, None], np.arange(columns, dtype=np.float32)
    for _ in range(_LAMPS):
        top, left = draw.uniform(0, rows), draw.uniform(0, columns)
        radius = draw.uniform(*_LAMP_RADII)
        bright = np.exp(draw.uniform(*np.log(_LAMP_LIGHT)))
        cover = np.clip(np.float32(radius + 0.5) - np.hypot(y - np.float32(top), x - np.float32(left)), 0, 1)
        light += cover * (np.float32(bright) - light)
    return Photograph(f"{scene.name}_lit", scene.number, code_of_light(light), light)


class Bundled(Sequence[Photograph]):
    """The scenes used where no photographs are given: dead leaves of seeds 1 to ``count``, every second one indoors.

    Each is drawn when it is first asked for.
    """

    def __init__(self, count: int) -> None:
        self._drawn: list[Photograph | None] = [None] * count

    def __len__(self) -> int:
        return len(self._drawn)

    @overload
    def __getitem__(self, place: int) -> Photograph: ...

    @overload
    def __getitem__(self, place: slice) -> tuple[Photograph, ...]: ...

    def __getitem__(self, place: int | slice) -> Photograph | tuple[Photograph, ...]:
        if isinstance(place, slice):
            return tuple(self[k] for k in range(len(self))[place])
        number = range(1, len(self) + 1)[place]
        found = self._drawn[place]
        if found is None:
            scene = dead_leaves(number)
            found = self._drawn[place] = scene if number % 2 else indoors(scene)
        return found


def bundled(count: int = 4) -> Bundled:
    """So many scenes for those who have no photographs."""
    return Bundled(count)


def drawn(count: int = 4, *, highlights: bool) -> tuple[Photograph, ...]:
    """Bundled scenes, with lamps in them where ``highlights`` are wanted."""
    return tuple(map(lit, bundled(count)) if highlights else bundled(count))
