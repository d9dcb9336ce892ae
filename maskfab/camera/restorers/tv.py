r"""A restorer for scenes of edges and even parts, total variation, that solves for the light from outside the sensor.

    1/2 || S H x - y ||² + μ sum over pixels of |∇x|  is least,

|∇x| the root of the sum of squared differences to the right and down, over all three colours, so that edges stand in
one place (Rudin, Osher, Fatemi, Physica D 60, 259, 1992; Blomgren, Chan, IEEE Trans. Image Process. 7, 304, 1998). It
is found by alternating directions: the light z = H x is known on the sensor alone and the gradients d = ∇x are shrunk,
each pixel by itself, and x follows from both by a division of spectra, exactly (Almeida, Figueiredo, IEEE Trans. Image
Process. 22, 3074, 2013).

Notes:
    What ε means here. ε (f / 0.1)² is a penalty of κ |∇x|² with κ = ε / (0.2 π)², which is the prior that expects
    E |∇x|² = 6 σ² / κ of six differences in noise of variance σ²; the prior of μ |∇x| / σ² expects 42 σ⁴ / μ². Both are
    the same for μ = σ √(7 κ). Photographs have most of that square in few edges: half of this μ is taken, and the best
    ε of an opening made for it is then 0.01 to 0.02 from 24 to 40 dB.
    Pixels weigh the same, and full wells are at least what they read, as with
    :mod:`maskfab.camera.restorers.gradient`, whose answer for one middling ε is the start.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import scipy.fft
from numpy.typing import NDArray

from maskfab.base.arrays import Singles
from maskfab.camera.record import Record
from maskfab.camera.restorers.gradient import Smooth
from maskfab.camera.restorers.restorer import Blur
from maskfab.camera.restorers.unseen import Seen, Spectrum, spread
from maskfab.camera.restorers.wiener import MARGIN, PRIOR_CY_PER_PX

_START = 0.01
_WEAKEST = 1e-6
"""ε for less than that, for the constraint d = ∇x must pull a little."""
_SHARE = 0.5
_STIFFNESS = 2.0
"""Of the constraint d = ∇x, over κ; that of z = H x is 1, the weight of the pixels."""
_MOST_STEPS = 40
_STILL = 0.02
"""Of the noise: a step that moves the picture by less, root mean square on the sensor, is the last."""


@dataclass(frozen=True)
class TotalVariation:
    """Least squares with a penalty on gradients.

    Attributes:
        width: of the surroundings, pixels on every side; less than the sensor's sides.
    """

    width: int = MARGIN
    name: str = "tv"

    def prepare(self, record: Record, blur: Blur) -> Callable[[float], Singles]:
        """As every restorer, :meth:`maskfab.camera.restorers.restorer.Restorer.prepare`."""
        problem = Smooth.of(record, blur, self.width)
        start = problem.solve(_START)
        shown = np.minimum(record.values, 1)  # of merged exposures highlights have most of the noise
        noise = math.sqrt(float(record.noise.variance(shown).mean(dtype=np.float64)))

        def restored(epsilon: float) -> Singles:
            kappa = max(epsilon, _WEAKEST) / (2 * math.pi * PRIOR_CY_PER_PX) ** 2
            penalty = _SHARE * noise * math.sqrt(7 * kappa)
            descent = _Descent(problem.seen, problem.clipped, penalty, _STIFFNESS * kappa)
            return np.clip(descent.run(start, _STILL * noise), 0.0, 1.0)

        return restored


@dataclass(frozen=True, eq=False)
class _Descent:
    """Alternating directions.

    Attributes:
        seen: the record.
        clipped: of its values.
        penalty: μ.
        stiffness: of the constraint on gradients.
    """

    seen: Seen
    clipped: NDArray[np.bool_]
    penalty: float
    stiffness: float

    def run(self, scene: Spectrum, still: float) -> Singles:
        """The scene on the sensor, after a step that moves it by less than ``still``, root mean square.

        Args:
            scene: spectrum to start from, [3, rows, columns / 2 + 1] of the frame.
            still: in units of white.
        """
        margin, transfer = self.seen.margin, self.seen.transfer
        inverse, stiff = self._inverse(), np.float32(self.stiffness)
        picture, light = self._seen(scene)
        down, across = np.zeros_like(picture), np.zeros_like(picture)
        owed = np.zeros_like(light)
        for _ in range(_MOST_STEPS):
            before = margin.sensor(picture)
            slope = scipy.fft.rfft2(self._shrunk(picture, down, across), axes=(1, 2), workers=1)
            owed += light
            known = self._known(owed)
            owed -= known
            wide = scene * transfer + spread(margin, known - owed - light)  # beyond the sensor z is H x
            scene = (wide * transfer.conj() + slope * stiff) * inverse
            picture, light = self._seen(scene)
            if float(np.square(margin.sensor(picture) - before).mean(dtype=np.float64)) < still**2:
                break
        return margin.sensor(picture)

    def _seen(self, spectrum: Spectrum) -> tuple[Singles, Singles]:
        picture = scipy.fft.irfft2(spectrum, s=self.seen.margin.shape, axes=(1, 2), workers=1)
        return picture, self.seen.light(spectrum)

    def _inverse(self) -> Singles:
        rows, columns = self.seen.margin.shape
        y, x = scipy.fft.fftfreq(rows)[:, None], scipy.fft.rfftfreq(columns)
        square = 4 * (np.sin(np.pi * y) ** 2 + np.sin(np.pi * x) ** 2)
        below = abs(self.seen.transfer) ** 2 + (self.stiffness * square).astype(np.float32)
        return np.asarray(np.divide(1, below, out=np.zeros_like(below), where=below > 0))

    def _known(self, light: Singles) -> Singles:
        """The light on the sensor nearest to the record and to ``light``; of full wells what is above them."""
        seen = self.seen
        known = (seen.weight * seen.values + light) / (seen.weight + 1)
        return np.where(self.clipped, np.maximum(light, seen.values), known)

    def _shrunk(self, picture: Singles, down: Singles, across: Singles) -> Singles:
        """The divergence of d less what its constraint is owed, which is kept in ``down`` and ``across``."""
        down += np.roll(picture, -1, axis=1) - picture
        across += np.roll(picture, -1, axis=2) - picture
        length = np.sqrt((down * down + across * across).sum(axis=0))
        cut = np.minimum(np.float32(self.penalty / self.stiffness) / np.maximum(length, np.float32(1e-20)), 1)
        slope = np.zeros_like(picture)
        for axis, owed in ((1, down), (2, across)):
            kept = owed * (1 - 2 * cut)
            slope += np.roll(kept, 1, axis=axis) - kept
            np.multiply(owed, cut, out=owed)
        return slope
