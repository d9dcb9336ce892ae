r"""The restoration of the published protocol: a denoiser, then a Wiener filter that takes all spectra for white.

    G = H* / (|H|² + ε)

with one ε whatever the light, of a record with darkness round it. The published evaluation denoises by BM3D, whose
licence is not commercial, with a variance fixed for each level; here noise goes by cosine transforms (see
:mod:`maskfab.camera.restorers.dct`) and the record's own variance.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import scipy.fft

from maskfab.base.arrays import Singles
from maskfab.camera.record import Record
from maskfab.camera.restorers.dct import denoised
from maskfab.camera.restorers.restorer import Blur
from maskfab.camera.restorers.wiener import MARGIN, Margin
from maskfab.optics.numbers.wiener import wiener_filter

EPSILON = (20 / 35) ** 10
"""Noise to signal of the published evaluation, 0.0037; the paper's text has ten times as much."""


@dataclass(frozen=True)
class Published:
    """The restoration of the published protocol.

    Attributes:
        width: pixels of darkness round the record.
    """

    width: int = MARGIN
    name: str = "published"

    def prepare(self, record: Record, blur: Blur) -> Callable[[float], Singles]:
        """See :class:`maskfab.camera.restorers.restorer.Restorer`; as published, light above white is left."""
        rows, columns = record.values.shape[1:]
        margin = Margin((rows + 2 * self.width, columns + 2 * self.width), self.width)
        calm = margin.dark(denoised(record))
        spectrum = np.asarray(scipy.fft.rfft2(calm, axes=(1, 2), workers=1))
        transfer = blur.on(margin.shape)

        def restored(epsilon: float) -> Singles:
            return np.maximum(margin.blurred(spectrum, wiener_filter(transfer, np.float32(epsilon))), 0)

        return restored
