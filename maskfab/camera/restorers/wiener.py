r"""The Wiener filter whose prior falls as 1 / f²; protocol F1 has no denoiser.

    G = H / (H² + ε (f / 0.1)²),        f = |ν| in cycles per pixel,

the Wiener filter of a scene with a power spectrum of 1 / f² in white noise (Field, J. Opt. Soc. Am. A 4, 2379, 1987).
The sensor sees the middle of the scene: light from beyond its edge reaches it, as it does in life. The filter knows
nothing of that light: the record is mirrored at its edges by the margin, filtered circularly, and cut back.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
import scipy
from numpy.typing import NDArray

from maskfab.base.arrays import Singles
from maskfab.camera.imaging import MARGIN, Blur, Margin, Transfer, upright
from maskfab.camera.record import Record
from maskfab.optics.restoration import wiener_filter

PRIOR_CY_PER_PX = 0.1


def prior(shape: tuple[int, int]) -> Singles:
    """(f / 0.1)² at the frequencies of ``rfft2``, float32 [rows, columns / 2 + 1]; read-only."""
    return (_prior.__wrapped__ if Margin(shape).large else _prior)(shape)


@lru_cache(maxsize=2)
def _prior(shape: tuple[int, int]) -> Singles:
    y, x = scipy.fft.fftfreq(shape[0])[:, None], scipy.fft.rfftfreq(shape[1])
    falling = upright((y.size, x.size), np.float32)
    falling[:] = (y**2 + x**2) / PRIOR_CY_PER_PX**2
    falling.flags.writeable = False
    return falling


def wiener(transfer: Transfer, inverse_prior: Singles, epsilon: float) -> Transfer:
    """G for H of any shape. Without noise, ε = 0, it is 1 / H; where H is 0 as well it is 0."""
    return wiener_filter(transfer, np.float32(epsilon) * inverse_prior)


def restore(mirrored: NDArray[np.complex64], filtered: Transfer, margin: Margin) -> Singles:
    """The restored picture on the sensor, [3, rows, columns] within 0 to 1."""
    return np.clip(margin.blurred(mirrored, filtered), 0.0, 1.0)


@dataclass(frozen=True, eq=False)
class Ready:
    """A record that is transformed, for every strength; colour by colour, so that a large picture takes a third.

    Attributes:
        spectra: mirrored, of every colour; None where they are made again.
    """

    record: Singles
    blur: Blur
    margin: Margin
    spectra: tuple[NDArray[np.complex64], ...] | None

    def __call__(self, epsilon: float) -> Singles:
        picture = np.empty_like(self.record)
        if self.spectra is None:
            self._by_columns(epsilon, picture)
        else:
            for colour, both in enumerate(self._filtered(epsilon)):
                picture[colour] = restore(*both, self.margin)[0]
        return picture

    def _by_columns(self, epsilon: float, picture: Singles) -> None:
        """Restore a picture into one; some columns of its spectrum and filter are held at a time."""
        shape, large = self.margin.shape, self.margin.large
        y, x = scipy.fft.fftfreq(shape[0])[:, None], scipy.fft.rfftfreq(shape[1])
        for plane, seen, transfer in zip(picture, self.record, self.blur.on(shape), strict=True):

            def filtered(part: slice, transfer: Transfer = transfer) -> Transfer:
                falling = (
                    ((y**2 + x[part] ** 2) / PRIOR_CY_PER_PX**2).astype(np.float32) if large else prior(shape)[:, part]
                )
                return wiener(transfer[:, part], falling, epsilon)

            np.clip(self.margin.filtered(seen, filtered), 0.0, 1.0, out=plane)

    def sampled(self, epsilon: float, step: int) -> Singles:
        """Every so many-th pixel of it both ways, see :meth:`Margin.blurred`."""
        colours = [self.margin.blurred(*both, step)[:, :, ::step] for both in self._filtered(epsilon)]
        return np.clip(np.concatenate(colours), 0.0, 1.0)

    def _filtered(self, epsilon: float) -> Iterator[tuple[NDArray[np.complex64], Transfer]]:
        """Spectrum and filter of every colour, [1, rows, half]."""
        shape, large = self.margin.shape, self.margin.large
        filters = self.blur.on(shape) if large else _filters(self.blur, shape, epsilon)
        for colour in range(len(self.record)):
            one = slice(colour, colour + 1)
            mirrored = self.margin.mirrored(self.record[one]) if self.spectra is None else self.spectra[colour]
            yield mirrored, wiener(filters[one], prior(shape), epsilon) if large else filters[one]


@lru_cache(maxsize=3)
def _filters(blur: Blur, shape: tuple[int, int], epsilon: float) -> Transfer:
    """G of all colours, for the scenes that are restored one after the other; kept of a peak and its neighbours."""
    return wiener(blur.on(shape), prior(shape), epsilon)


@dataclass(frozen=True)
class Wiener:
    """The filter as a restorer."""

    width: int = MARGIN
    name: str = "wiener"

    def prepare(self, record: Record, blur: Blur) -> Ready:
        margin = Margin.around(record.values, self.width)
        colours = (record.values[colour : colour + 1] for colour in range(len(record.values)))
        spectra = None if margin.large else tuple(map(margin.mirrored, colours))
        return Ready(record.values, blur, margin, spectra)

    def once(self, record: Record, blur: Blur) -> Ready:
        """As :meth:`prepare`, for a single strength: nothing is kept for others."""
        return Ready(record.values, blur, Margin.around(record.values, self.width), None)


RESTORERS = (Wiener(),)
