r"""The Wiener filter whose prior falls as 1 / f²; protocol F1 has no denoiser.

    G = H / (H² + ε (f / 0.1)²),        f = |ν| in cycles per pixel,

the Wiener filter of a scene with a power spectrum of 1 / f² in white noise (Field, J. Opt. Soc. Am. A 4, 2379, 1987).
The sensor sees the middle of the scene: light from beyond its edge reaches it, as it does in life. The filter knows
nothing of that light: the record is mirrored at its edges by the margin, filtered circularly, and cut back.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property, lru_cache

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
    falling = upright((shape[0], shape[1] // 2 + 1), np.float32)
    falling[:] = _prior_of(shape, slice(None))
    falling.flags.writeable = False
    return falling


def _prior_of(shape: tuple[int, int], part: slice) -> Singles:
    """Some columns of :func:`prior`."""
    y, x = scipy.fft.fftfreq(shape[0])[:, None], scipy.fft.rfftfreq(shape[1])[part]
    return np.asarray((y**2 + x**2) / PRIOR_CY_PER_PX**2, dtype=np.float32)


def wiener(transfer: Transfer, inverse_prior: Singles, epsilon: float) -> Transfer:
    """G for H of any shape. Without noise, ε = 0, it is 1 / H; where H is 0 as well it is 0."""
    return wiener_filter(transfer, np.float32(epsilon) * inverse_prior)


@dataclass(frozen=True, eq=False)
class Ready:
    """A record, for every strength; colour by colour, so that a large picture takes a third."""

    record: Singles
    blur: Blur
    margin: Margin

    def __call__(self, epsilon: float) -> Singles:
        shape, large = self.margin.shape, self.margin.large
        known = self.blur.on(shape) if large else filters(self.blur, shape, epsilon)
        picture = np.empty_like(self.record)
        for plane, seen, of_all in zip(picture, self.record, known, strict=True):

            def factor(part: slice, of_all: Transfer = of_all) -> Transfer:
                return wiener(of_all[:, part], _prior_of(shape, part), epsilon) if large else of_all[:, part]

            np.clip(self.margin.filtered(seen, factor), 0.0, 1.0, out=plane)
        return picture

    def sampled(self, epsilon: float, step: int) -> Singles:
        """Every so many-th pixel of it both ways, see :meth:`Margin.blurred`."""
        shape, large = self.margin.shape, self.margin.large
        known = self.blur.on(shape) if large else filters(self.blur, shape, epsilon)
        picture = np.empty_like(self.record[:, ::step, ::step])
        for colour, (plane, of_all) in enumerate(zip(picture, known, strict=True)):
            spectrum = self._mirrored(colour) if large else self._spectra[colour]
            gains = wiener(of_all, prior(shape), epsilon) if large else of_all
            plane[:] = self.margin.blurred(spectrum, gains[None], step)[0, :, ::step]
        return np.clip(picture, 0.0, 1.0, out=picture)

    @cached_property
    def _spectra(self) -> tuple[NDArray[np.complex64], ...]:
        return tuple(map(self._mirrored, range(len(self.record))))

    def _mirrored(self, colour: int) -> NDArray[np.complex64]:
        return self.margin.mirrored(self.record[colour : colour + 1])


@lru_cache(maxsize=3)
def filters(blur: Blur, shape: tuple[int, int], epsilon: float) -> Transfer:
    """G of all colours, for the scenes that are restored one after the other; kept of a peak and its neighbours."""
    return wiener(blur.on(shape), prior(shape), epsilon)


@dataclass(frozen=True)
class Wiener:
    """The filter as a restorer."""

    width: int = MARGIN
    name: str = "wiener"

    def prepare(self, record: Record, blur: Blur) -> Ready:
        return Ready(record.values, blur, Margin.around(record.values, self.width))


RESTORERS = (Wiener(),)
