"""Lessons for a network: photographs through one die, as it is shown them, beside the truth.

Photographs are whole frames with light from outside the sensor, taken by the protocol that scores them. Every second
one is of a picture that is given, if any is, mirrored by chance; the others are dead leaves that no other protocol
draws: of four, one bright and one indoors are smooth, and the other two have a texture, as few things in life are
even.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
import scipy.fft

from maskfab.base.arrays import Singles
from maskfab.camera.design import Design
from maskfab.camera.learning.view import View
from maskfab.camera.photographs import LONG, SHORT, Photograph
from maskfab.camera.protocol import Protocol, SensorScene
from maskfab.camera.scenes import dead_leaves, indoors, lit

_FIRST, _APART = 10_000_000, 100_000
"""Numbers of scenes of seed 0, and of the next."""


@dataclass(frozen=True, eq=False)
class Lesson:
    """One photograph.

    Attributes:
        shown: of its record, [planes, rows, columns].
        true: code values, [3, rows, columns].
    """

    shown: Singles
    true: Singles


@dataclass(frozen=True, eq=False)
class Lessons:
    """All lessons behind a design, by their number; the same every time.

    Attributes:
        protocol: that photographs are taken by, in linear light.
        design: that they are taken through.
        levels: of light, one of which is drawn for each, dB.
        view: of their records.
        photographs: that are given.
        seed: of all that is drawn.
        shape: rows and columns of drawn scenes.
    """

    protocol: Protocol
    design: Design
    levels: tuple[float, ...]
    view: View
    photographs: Sequence[Photograph] = ()
    seed: int = 0
    shape: tuple[int, int] = (SHORT, LONG)

    def __call__(self, number: int) -> Lesson:
        """One of them."""
        turn = number // 2 if self.photographs else number
        own = _FIRST + _APART * self.seed + number
        level = float(np.random.default_rng([own, 2]).choice(self.levels))
        if self.photographs and number % 2:
            scene = mirrored(self.photographs[turn % len(self.photographs)], own)
        else:
            scene = drawn(own, turn, self.shape, lamps=bool(self.protocol.brackets))
        return self.of(scene, level)

    def of(self, scene: Photograph, level: float) -> Lesson:
        """The lesson that a scene is at a level of light."""
        known = SensorScene.of(scene)
        record = self.protocol.photograph(self.design, known, level)
        return Lesson(self.view.planes(record, self.design), known.true)


def drawn(seed: int, turn: int, shape: tuple[int, int] = (SHORT, LONG), *, lamps: bool = False) -> Photograph:
    """Dead leaves, indoors and textured in turns of four, with lamps if exposures are merged."""
    scene = dead_leaves(seed, *shape)
    if turn % 4 >= 2:
        scene = textured(scene)
    if turn % 2:
        scene = indoors(scene)
    return lit(scene) if lamps else scene


def textured(scene: Photograph) -> Photograph:
    """The scene times a pattern that is log-normal, of a random contrast, and of a power that falls as f^-2 to f^-3."""
    draw = np.random.default_rng([scene.number, 1])
    rows, columns = scene.values.shape[1:]
    slope, contrast = draw.uniform(1.0, 1.5), draw.uniform(0.1, 0.6)
    y, x = scipy.fft.fftfreq(rows)[:, None], scipy.fft.rfftfreq(columns)
    frequency = np.hypot(y, x)
    frequency[0, 0] = np.inf
    grain = scipy.fft.rfft2(draw.standard_normal((rows, columns), dtype=np.float32), workers=1)
    pattern = scipy.fft.irfft2(grain * frequency**-slope, s=(rows, columns), workers=1)
    pattern *= contrast / pattern.std()
    values = scene.values * np.exp(pattern - contrast**2 / 2).astype(np.float32)
    return replace(scene, values=np.clip(values, 0, 1))


def mirrored(scene: Photograph, seed: int) -> Photograph:
    """A photograph turned left to right, upside down, both or neither, in noise of its own."""
    down, across = (slice(None, None, int(step)) for step in np.random.default_rng(seed).choice((-1, 1), 2))
    measured = None if scene.measured is None else np.ascontiguousarray(scene.measured[:, down, across])
    values = np.ascontiguousarray(scene.values[:, down, across])
    return replace(scene, number=seed, values=values, measured=measured)


def kept_for_validation(
    photographs: Sequence[Photograph], count: int, shape: tuple[int, int] = (SHORT, LONG), *, lamps: bool = False
) -> tuple[list[Photograph], Sequence[Photograph]]:
    """Scenes that nothing is learned from, so many of them drawn, and the photographs that are left to learn from.

    The last photograph is kept where there are several.
    """
    kept = [drawn(_FIRST - 1 - k, 3 * k, shape, lamps=lamps) for k in range(count)]
    if len(photographs) < 2:
        return kept, photographs
    return [*kept, photographs[-1]], photographs[:-1]
