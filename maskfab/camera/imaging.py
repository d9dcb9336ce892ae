"""The blur of a scene by panel, lens and pixels: what lies on the sensor, and what a restorer takes the blur for."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Protocol

import numpy as np
import scipy
from numpy.typing import NDArray

from maskfab.base.arrays import Singles

Transfer = NDArray[np.float32] | NDArray[np.complex64]


class Blur(Protocol):
    """The blur of a scene by lens, panel and pixels."""

    def on(self, shape: tuple[int, int]) -> Transfer:
        """H at the frequencies of ``rfft2`` of pictures of that shape, [3, rows, columns / 2 + 1], 1 at frequency 0.

        Real where the point spread is the same turned by 180 degrees, complex otherwise. Kept for every shape.
        """

    def __hash__(self) -> int:
        """Of the object: what is computed for a blur is kept for it alone."""


MARGIN = 256
"""Pixels of scene, and of mirrored record, round the sensor."""

_AT_A_TIME = 128
"""Rows or columns that are transformed of a large picture."""
LARGE = 8_000_000
"""Pixels of a picture from which on nothing is kept that can be computed again."""


@dataclass(frozen=True, eq=False)
class Margin:
    """Where the sensor lies in the scene, [3, rows, columns], and the transforms that spare the rest.

    Attributes:
        width: pixels from its edge to the sensor's, less than the sensor's sides.
    """

    shape: tuple[int, int]
    width: int = MARGIN

    @classmethod
    def around(cls, sensor: Singles, width: int = MARGIN) -> Margin:
        """A margin round a picture of the sensor, [3, rows, columns]."""
        rows, columns = sensor.shape[1:]
        return cls((rows + 2 * width, columns + 2 * width), width)

    @property
    def large(self) -> bool:
        """Whether nothing is kept of such pictures that can be computed again."""
        rows, columns = self.shape
        return rows * columns > LARGE

    @property
    def _cut(self) -> tuple[slice, slice]:
        rows, columns = self.shape
        return slice(self.width, rows - self.width), slice(self.width, columns - self.width)

    def sensor(self, scene: Singles) -> Singles:
        """The part of a scene that lies on the sensor."""
        return scene[:, *self._cut]

    def dark(self, picture: Singles) -> Singles:
        """A picture on the sensor with darkness round it, [3, rows, columns] of the scene."""
        around = (self.width, self.width)
        return np.pad(picture, [(0, 0), around, around])

    def blurred(self, spectrum: NDArray[np.complex64], transfer: Transfer) -> Singles:
        """Light on the sensor: the scene's ``rfft2`` [3, rows, half], times H, back on the sensor's pixels."""
        lines = scipy.fft.ifft(spectrum * transfer, axis=1, overwrite_x=True, workers=1)
        rows, columns = self._cut
        wide = scipy.fft.irfft(lines[:, rows], n=self.shape[1], axis=2, workers=1)
        return np.asarray(wide[:, :, columns])

    def rows(self, spectrum: NDArray[np.complex64], transfer: Transfer, step: int) -> Singles:
        """Every so many-th row of :meth:`blurred`, where the step divides its sides and the margin's width.

        Of every k-th row the spectrum is the sum of the k parts of the whole one, over k, so that little is
        transformed.
        """
        few = self.shape[0] // step
        lines = spectrum[:, :few] * transfer[:, :few]
        part = np.empty_like(lines)
        for start in range(few, self.shape[0], few):
            lines += np.multiply(spectrum[:, start : start + few], transfer[:, start : start + few], out=part)
        lines /= np.float32(step)
        lines = scipy.fft.ifft(lines, axis=1, overwrite_x=True, workers=1)
        taken = lines[:, self.width // step : few - self.width // step]
        return np.asarray(scipy.fft.irfft(taken, n=self.shape[1], axis=2, workers=1)[:, :, self._cut[1]])

    def through(self, light: Singles, transfer: Transfer) -> Singles:
        """Light on the sensor of a scene [3, rows, columns] whose points all spread alike, by H as of :class:`Blur`."""
        seen = np.empty_like(self.sensor(light))
        # Colour by colour, so that a large scene's spectrum takes a third of the memory.
        for colour in range(len(light)):
            one = slice(colour, colour + 1)
            spectrum = np.asarray(scipy.fft.rfft2(light[one], axes=(1, 2), workers=1))
            seen[one] = self.blurred(spectrum, transfer[one])
        return seen

    def mirrored(self, record: Singles) -> NDArray[np.complex64]:
        """``rfft2`` of a record [3, sensor rows, sensor columns] mirrored at its edges (their pixels not doubled)."""
        around = [(0, 0), (0, 0), (self.width, self.width)]
        lines = scipy.fft.rfft(np.pad(record, around, mode="reflect"), axis=2, workers=1)
        tall = np.pad(lines, [(0, 0), (self.width, self.width), (0, 0)], mode="reflect")
        return np.asarray(scipy.fft.fft(tall, axis=1, overwrite_x=True, workers=1))

    def filtered(self, plane: Singles, factor: Callable[[slice], Transfer]) -> Singles:
        """One colour [rows, columns] of :meth:`blurred` of :meth:`mirrored`, with little beyond it held at a time.

        Args:
            factor: [rows, columns] of some columns of ``rfft2``.
        """
        (rows, columns), half = self._cut, self.shape[1] // 2 + 1
        lines, around = np.empty((len(plane), half), dtype=np.complex64), (self.width, self.width)
        for first in range(0, len(plane), _AT_A_TIME):
            part = slice(first, first + _AT_A_TIME)
            lines[part] = scipy.fft.rfft(np.pad(plane[part], [(0, 0), around], mode="reflect"), axis=1, workers=1)
        for first in range(0, half, _AT_A_TIME):
            part = slice(first, first + _AT_A_TIME)
            tall = np.pad(lines[:, part], [around, (0, 0)], mode="reflect")
            waves = scipy.fft.fft(tall, axis=0, overwrite_x=True, workers=1) * factor(part)
            lines[:, part] = scipy.fft.ifft(waves, axis=0, overwrite_x=True, workers=1)[rows]
        seen = np.empty_like(plane)
        for first in range(0, len(plane), _AT_A_TIME):
            part = slice(first, first + _AT_A_TIME)
            seen[part] = scipy.fft.irfft(lines[part], n=self.shape[1], axis=1, workers=1)[:, columns]
        return seen


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

    def blurred(self, light: Singles, margin: Margin) -> Singles:
        """Light of a scene as it falls on the sensor, float32 [3, rows, columns] of the sensor, white is 1."""


@dataclass(frozen=True, eq=False)
class KeptBlur(ABC):
    """A blur whose transfers are kept for later scenes."""

    _kept: dict[tuple[int, int], Transfer] = field(default_factory=dict, init=False, repr=False)

    @abstractmethod
    def _transfer(self, shape: tuple[int, int]) -> Transfer:
        """See :meth:`on`."""

    def on(self, shape: tuple[int, int]) -> Transfer:
        """H at the frequencies of ``rfft2`` of pictures of that shape, [3, rows, columns / 2 + 1], 1 at frequency 0.

        float32 without a phase: the point spread is the same turned by 180 degrees; complex64 with one. Read-only, and
        kept for every shape but large ones.
        """
        if shape in self._kept:
            return self._kept[shape]
        transfer = self._transfer(shape)
        transfer.flags.writeable = False
        if not Margin(shape).large:
            self._kept[shape] = transfer
        return transfer


@dataclass(frozen=True, eq=False)
class MadeBlur(KeptBlur):
    """A blur that is made where it is asked for, and of which nothing is kept but transfers."""

    make: Callable[[], Blur]

    def _transfer(self, shape: tuple[int, int]) -> Transfer:
        return self.make().on(shape).copy()


@dataclass(frozen=True, eq=False)
class Isoplanatic(KeptBlur):
    """A design through which every point of a scene spreads alike."""

    name: str

    @property
    @abstractmethod
    def transmission(self) -> float:
        """Share of the stop's light that passes."""

    @property
    def told(self) -> tuple[str, ...]:
        """None: one transfer is all there is."""
        return ()

    def blurred(self, light: Singles, margin: Margin) -> Singles:
        return margin.through(light, self.on(margin.shape))


@dataclass(frozen=True, eq=False)
class RestoredBy:
    """A design that is photographed as it is, and restored by the blur of another.

    So a photograph of something near is deblurred as if it were far: with ``near`` and ``far`` from
    :func:`maskfab.camera.die_transfer.die_transfer` at different ``object_um``, ``RestoredBy(near, far)`` costs what
    knowing no distance does; ``RestoredBy(die, other)``, what calibrating by another die does. Light, noise and scores
    are those of ``seen``.
    """

    seen: Design
    known: Blur

    @property
    def name(self) -> str:
        return self.seen.name

    @property
    def transmission(self) -> float:
        return self.seen.transmission

    @property
    def told(self) -> tuple[str, ...]:
        return self.seen.told

    def blurred(self, light: Singles, margin: Margin) -> Singles:
        return self.seen.blurred(light, margin)

    def on(self, shape: tuple[int, int]) -> Transfer:
        return self.known.on(shape)
