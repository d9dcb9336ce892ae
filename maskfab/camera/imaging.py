"""The blur of a scene by panel, lens and pixels: what lies on the sensor, and what a restorer takes the blur for."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from typing import Any, Protocol

import numpy as np
import scipy
from numpy.typing import NDArray

from maskfab.base.arrays import Singles

Transfer = NDArray[np.float32] | NDArray[np.complex64]


def upright(shape: tuple[int, ...], dtype: type[np.generic]) -> NDArray[Any]:
    """Room for pictures or spectra [..., rows, columns], each column in one piece, as it is transformed."""
    return np.empty((*shape[:-2], shape[-1], shape[-2]), dtype=dtype).swapaxes(-1, -2)


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

_AT_A_TIME = 64
"""Columns that are transformed at a time."""
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

    def blurred(self, spectrum: NDArray[np.complex64], transfer: Transfer, step: int = 1) -> Singles:
        """Light on the sensor: the scene's ``rfft2`` [3, rows, half], times H, back on the sensor's pixels.

        Args:
            step: from one row to the next that is wanted; it divides its sides and the margin's width. Of every k-th
                row the spectrum is the mean of the k parts of the whole one, so that little is transformed.
        """
        few, cut = self.shape[0] // step, slice(self.width // step, (self.shape[0] - self.width) // step)
        spectrum, transfer = np.broadcast_arrays(spectrum, transfer)
        lines = upright((len(spectrum), cut.stop - cut.start, self.shape[1] // 2 + 1), np.complex64)
        for colour, line in enumerate(lines):
            for part in self._parts():
                waves = spectrum[colour, :few, part] * transfer[colour, :few, part]
                for start in range(few, self.shape[0], few):
                    more = slice(start, start + few)
                    waves += spectrum[colour, more, part] * transfer[colour, more, part]
                line[:, part] = scipy.fft.ifft(waves, axis=0, overwrite_x=True, workers=1)[cut]
        seen = np.asarray(scipy.fft.irfft(lines, n=self.shape[1], axis=2, workers=1)[:, :, self._cut[1]])
        if step > 1:
            seen *= np.float32(1 / step)
        return seen

    def _parts(self) -> Iterator[slice]:
        """Few columns of ``rfft2`` after each other, all of them: so many fit a processor's own memory."""
        half = self.shape[1] // 2 + 1
        return (slice(first, min(first + _AT_A_TIME, half)) for first in range(0, half, _AT_A_TIME))

    def few(self, waves: NDArray[np.complex64], step: int) -> Singles:
        """Every so many-th pixel of the sensor both ways, [rows, columns], by the ``rfft2`` of every so many-th row.

        Args:
            waves: [columns / 2 + 1, rows], sums over the frequencies that are one then.
            step: even; it divides a quarter of both sides.
        """
        columns, rows = self.shape[1] // step, np.arange(waves.shape[1])
        down, across = (slice(self.width // step, (side - self.width) // step) for side in self.shape)
        half = np.arange(columns // 2 + 1)
        total = sum(waves[k * columns + half] for k in range(step // 2))
        for k in range(step // 2, step):
            # Those of the other half are their opposites', conjugate.
            total += waves[self.shape[1] - k * columns - half][:, -rows].conj()
        lines = scipy.fft.ifft(total, axis=1, overwrite_x=True, workers=1)[:, down]
        seen = scipy.fft.irfft(lines, n=columns, axis=0, workers=1)[across].T
        return np.asarray(seen * np.float32(step**-2))

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
        waves = upright((len(record), self.shape[0], self.shape[1] // 2 + 1), np.complex64)
        for plane, wave in zip(record, waves, strict=True):
            for part, tall in self._mirrored(plane):
                wave[:, part] = tall
        return waves

    def _mirrored(self, plane: Singles) -> Iterator[tuple[slice, NDArray[np.complex64]]]:
        """Columns of :meth:`mirrored` of one colour, few at a time, and which they are."""
        around = (self.width, self.width)
        lines = scipy.fft.rfft(np.pad(plane, [(0, 0), around], mode="reflect"), axis=1, workers=1)
        rows = np.pad(np.arange(len(plane)), around, mode="reflect")
        for part in self._parts():
            tall = upright((self.shape[0], part.stop - part.start), np.complex64)
            tall[:] = lines[rows, part]
            yield part, scipy.fft.fft(tall, axis=0, overwrite_x=True, workers=1)

    def filtered(self, plane: Singles, factor: Callable[[slice], Transfer]) -> Singles:
        """One colour [rows, columns] of :meth:`blurred` of :meth:`mirrored`, with little beyond it held at a time.

        Args:
            factor: [rows, columns] of some columns of ``rfft2``.
        """
        rows, columns = self._cut
        lines = upright((len(plane), self.shape[1] // 2 + 1), np.complex64)
        for part, tall in self._mirrored(plane):
            lines[:, part] = scipy.fft.ifft(tall * factor(part), axis=0, overwrite_x=True, workers=1)[rows]
        return np.asarray(scipy.fft.irfft(lines, n=self.shape[1], axis=1, workers=1)[:, columns])


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
        if not Margin(shape).large:
            made, transfer = transfer, upright(transfer.shape, transfer.dtype.type)
            transfer[:] = made
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
