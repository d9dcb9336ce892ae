"""Designs: what a scene is photographed through, and what a restorer takes that for."""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import dataclass, field
from typing import Protocol

import numpy as np
import scipy

from maskfab.base.arrays import Singles
from maskfab.camera.record import Blur, Transfer
from maskfab.camera.restorers.wiener import Margin


@dataclass(frozen=True, eq=False)
class SceneLight:
    """Light of a scene, and where the sensor lies in it.

    Attributes:
        values: float32 [3, rows, columns], white is 1.
        margin: of the scene.
    """

    values: Singles
    margin: Margin

    def through(self, transfer: Transfer) -> Singles:
        """Light on the sensor where every point spreads alike, by H [3, rows, columns / 2 + 1]."""
        found = np.empty_like(self.margin.sensor(self.values))
        # Colour by colour, so that a large scene's spectrum takes a third of the memory.
        for colour in range(len(self.values)):
            each = slice(colour, colour + 1)
            spectrum = np.asarray(scipy.fft.rfft2(self.values[each], axes=(1, 2), workers=1))
            found[each] = self.margin.blurred(spectrum, transfer[each])
        return found


class Design(Blur, Protocol):
    """A panel that lets light through to the sensor; ``on`` is what a restorer takes its blur for."""

    @property
    def name(self) -> str:
        """In tables."""

    @property
    def transmission(self) -> float:
        """Share of the stop's light that passes."""

    @property
    def told(self) -> tuple[str, ...]:
        """Sentences on how its blur errs, once a scene was blurred."""

    def blurred(self, light: SceneLight) -> Singles:
        """Light of a scene as it falls on the sensor, float32 [3, rows, columns] of the sensor, white is 1."""


@dataclass(frozen=True, eq=False)
class Isoplanatic(ABC):
    """A design through which every point of a scene spreads alike; its transfers are kept for the scenes that follow.

    Attributes:
        name: in tables.
    """

    name: str
    _kept: dict[tuple[int, int], Transfer] = field(default_factory=dict, init=False, repr=False)

    @property
    @abstractmethod
    def transmission(self) -> float:
        """Share of the stop's light that passes."""

    @property
    def told(self) -> tuple[str, ...]:
        """None: one transfer is all there is."""
        return ()

    @abstractmethod
    def _transfer(self, shape: tuple[int, int]) -> Transfer:
        """See :meth:`on`."""

    def on(self, shape: tuple[int, int]) -> Transfer:
        """H at the frequencies of ``rfft2`` of pictures of that shape, [3, rows, columns / 2 + 1], 1 at frequency 0.

        float32 without a phase: the point spread is the same turned by 180 degrees; complex64 with one. Read-only, and
        kept for every shape.
        """
        if shape not in self._kept:
            found = self._transfer(shape)
            found.flags.writeable = False
            self._kept[shape] = found
        return self._kept[shape]

    def blurred(self, light: SceneLight) -> Singles:
        """See :class:`Design`."""
        return light.through(self.on(light.margin.shape))


@dataclass(frozen=True, eq=False)
class RestoredBy:
    """A design that is photographed as it is, and restored by the blur of another.

    So a photograph of something near is deblurred as if it were far: with ``near`` and ``far`` from
    :func:`maskfab.camera.die_transfer.die_transfer` at different ``object_um``, ``RestoredBy(near, far)`` costs what
    knowing no distance does; ``RestoredBy(die, other)``, what calibrating by another die does. Light, noise and scores
    are those of ``seen``.

    Attributes:
        seen: what is photographed.
        known: whose transfer restorers are given.
    """

    seen: Design
    known: Blur

    @property
    def name(self) -> str:
        """Of what is photographed."""
        return self.seen.name

    @property
    def transmission(self) -> float:
        """Of what is photographed."""
        return self.seen.transmission

    @property
    def told(self) -> tuple[str, ...]:
        """Of what is photographed."""
        return self.seen.told

    def blurred(self, light: SceneLight) -> Singles:
        """As what is photographed does."""
        return self.seen.blurred(light)

    def on(self, shape: tuple[int, int]) -> Transfer:
        """H of what is known."""
        return self.known.on(shape)
