r"""The Wiener filter whose prior falls as 1 / f²; protocol F1 has no denoiser.

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
from maskfab.camera.imaging import MARGIN, Blur, Margin, Transfer
from maskfab.camera.record import Record
from maskfab.optics.restoration import wiener_filter

PRIOR_CY_PER_PX = 0.1


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
        spectra = None if margin.large else [margin.mirrored(record.values[one]) for one in colours]

        def restored(epsilon: float) -> Singles:
            picture = np.empty_like(record.values)
            for colour, one in enumerate(colours):
                mirrored = margin.mirrored(record.values[one]) if spectra is None else spectra[colour]
                picture[one] = restore(mirrored, wiener(transfer[one], inverse_prior, epsilon), margin)
            return picture

        return restored


RESTORERS = (Wiener(),)
