r"""Blur a scene, and undo the blur by a Wiener filter whose prior falls as 1 / f²; protocol F1 has no denoiser.

    G = H / (H² + ε (f / 0.1)²),        f = |ν| in cycles per pixel,

the Wiener filter of a scene with a power spectrum of 1 / f² in white noise (Field, J. Opt. Soc. Am. A 4, 2379, 1987).
The sensor sees the middle of the scene: light from beyond its edge reaches it, as it does in life. The filter knows
nothing of that light: the record is mirrored at its edges by the margin, filtered circularly, and cut back.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import scipy
from numpy.typing import NDArray

from maskfab.base.arrays import Singles
from maskfab.camera.record import Blur, Record, Transfer
from maskfab.optics.restoration import wiener_filter

MARGIN = 256
"""Pixels of scene, and of mirrored record, round the sensor."""
PRIOR_CY_PER_PX = 0.1
LARGE = 8_000_000
"""Pixels of a picture from which on nothing is kept that can be computed again."""


@dataclass(frozen=True, eq=False)
class Margin:
    """Where the sensor lies in the scene, [3, rows, columns], and the transforms that spare the rest.

    Attributes:
        shape: rows and columns of the scene.
        width: pixels from its edge to the sensor's, less than the sensor's sides.
    """

    shape: tuple[int, int]
    width: int = MARGIN

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

    def mirrored(self, record: Singles) -> NDArray[np.complex64]:
        """``rfft2`` of a record [3, sensor rows, sensor columns] mirrored at its edges (their pixels not doubled)."""
        around = [(0, 0), (0, 0), (self.width, self.width)]
        lines = scipy.fft.rfft(np.pad(record, around, mode="reflect"), axis=2, workers=1)
        tall = np.pad(lines, [(0, 0), (self.width, self.width), (0, 0)], mode="reflect")
        return np.asarray(scipy.fft.fft(tall, axis=1, overwrite_x=True, workers=1))


def prior(shape: tuple[int, int]) -> Singles:
    """(f / 0.1)² at the frequencies of ``rfft2``, float32 [rows, columns / 2 + 1]."""
    y, x = scipy.fft.fftfreq(shape[0])[:, None], scipy.fft.rfftfreq(shape[1])
    return np.asarray((y**2 + x**2) / PRIOR_CY_PER_PX**2, dtype=np.float32)


def wiener(transfer: Transfer, inverse_prior: Singles, epsilon: float) -> Transfer:
    """G for H of any shape. Without noise, ε = 0, it is 1 / H; where H is 0 as well it is 0."""
    return wiener_filter(transfer, np.float32(epsilon) * inverse_prior)


def restore(mirrored: NDArray[np.complex64], filtered: Transfer, margin: Margin) -> Singles:
    """The restored picture on the sensor, [3, rows, columns] within 0 to 1.

    Args:
        mirrored: of :meth:`Margin.mirrored`.
        filtered: G of :func:`wiener`, [3, rows, half].
        margin: of the scene.
    """
    return np.clip(margin.blurred(mirrored, filtered), 0.0, 1.0)


def spectral_error(
    mirrored: NDArray[np.complex64], true: NDArray[np.complex64], transfer: Transfer, noise_to_signal: Singles
) -> float:
    """Squared error of what the Wiener filter restores, by Parseval's theorem: needs no transform, clips nothing.

    Args:
        mirrored: spectrum of the record, of :meth:`Margin.mirrored`.
        true: spectrum of the true picture, mirrored likewise.
        transfer: H at the same frequencies.
        noise_to_signal: ε (f / 0.1)² at them.
    """
    missed = mirrored * wiener_filter(transfer, noise_to_signal)
    missed -= true
    return float(np.vdot(missed, missed).real)


@dataclass(frozen=True)
class Wiener:
    """The filter as a restorer.

    Attributes:
        width: pixels by which the record is mirrored beyond its edges.
    """

    width: int = MARGIN
    name: str = "wiener"

    def prepare(self, record: Record, blur: Blur) -> Callable[[float], Singles]:
        """See :class:`maskfab.camera.record.Restorer`."""
        rows, columns = record.values.shape[1:]
        margin = Margin((rows + 2 * self.width, columns + 2 * self.width), self.width)
        transfer, inverse_prior = blur.on(margin.shape), prior(margin.shape)
        # Colour by colour, so that a large picture takes a third of the memory.
        colours = [slice(colour, colour + 1) for colour in range(len(record.values))]
        kept = None if margin.large else [margin.mirrored(record.values[each]) for each in colours]

        def restored(epsilon: float) -> Singles:
            found = np.empty_like(record.values)
            for colour, each in enumerate(colours):
                mirrored = margin.mirrored(record.values[each]) if kept is None else kept[colour]
                found[each] = restore(mirrored, wiener(transfer[each], inverse_prior, epsilon), margin)
            return found

        return restored
