r"""A restorer with the Wiener filter's own prior, small gradients, that solves for the light from outside the sensor.

    1/2 || S H x - y ||² + ε/2 || (f / 0.1) x ||²  is least,        S the cut to the sensor,

of :mod:`maskfab.camera.restorers.unseen`, starting from the Wiener filter, which it is where nothing is unseen.

Notes:
    All pixels that are not clipped weigh the same, although those in bright light are noisier. Weights of 1 / variance
    would be right if scenes had the same contrast everywhere; but contrast grows with the light as noise does.
    A full well says that there was at least so much light. Such pixels are left out at first, and then held at the
    full well where the answer is darker.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from maskfab.base.arrays import Singles
from maskfab.camera.record import Record
from maskfab.camera.restorers.restorer import Blur
from maskfab.camera.restorers.unseen import Seen, Spectrum, on_sensor
from maskfab.camera.restorers.wiener import MARGIN, Margin, prior
from maskfab.optics.numbers.wiener import wiener_filter

_MOST_ROUNDS = 4


@dataclass(frozen=True)
class Gradient:
    """Least squares with a penalty on squared gradients.

    Attributes:
        width: of the surroundings, pixels on every side; less than the sensor's sides.
    """

    width: int = MARGIN
    name: str = "gradient"

    def prepare(self, record: Record, blur: Blur) -> Callable[[float], Singles]:
        """As every restorer, :meth:`maskfab.camera.restorers.restorer.Restorer.prepare`."""
        problem = Smooth.of(record, blur, self.width)
        return lambda epsilon: np.clip(on_sensor(problem.seen.margin, problem.solve(epsilon)), 0.0, 1.0)


@dataclass(frozen=True, eq=False)
class Smooth:
    """A record on a wider frame, ready to be solved for a smooth scene.

    Attributes:
        seen: all colours; clipped pixels weigh 0.
        clipped: of its values.
        mirrored: spectrum of the record mirrored at its edges, [3, rows, columns / 2 + 1] of the frame.
        prior: (f / 0.1)² at the same frequencies.
    """

    seen: Seen
    clipped: NDArray[np.bool_]
    mirrored: Spectrum
    prior: Singles

    @classmethod
    def of(cls, record: Record, blur: Blur, width: int) -> Smooth:
        """A record with surroundings of a width in pixels."""
        rows, columns = record.values.shape[1:]
        margin = Margin((rows + 2 * width, columns + 2 * width), width)
        clipped = record.clipped
        seen = Seen(margin, blur.on(margin.shape), record.values, (~clipped).astype(np.float32))
        return cls(seen, clipped, margin.mirrored(record.values), prior(margin.shape))

    def solve(self, epsilon: float) -> Spectrum:
        """Spectrum of the scene on the whole frame, [3, rows, columns / 2 + 1]."""
        penalty = np.float32(epsilon) * self.prior
        colours = range(len(self.mirrored))
        return np.concatenate([self._colour(slice(c, c + 1), penalty) for c in colours])

    def _colour(self, one: slice, penalty: Singles) -> Spectrum:
        seen, clipped = self.seen.colour(one), self.clipped[one]
        scene = seen.solve(penalty, self.mirrored[one] * wiener_filter(seen.transfer, penalty))
        held = np.zeros_like(clipped)
        for _ in range(_MOST_ROUNDS if clipped.any() else 0):
            darker = clipped & (seen.light(scene) < seen.values)
            if not (darker & ~held).any():
                break
            held |= darker
            seen = replace(seen, weight=np.where(held, np.float32(1), self.seen.weight[one]))
            scene = seen.solve(penalty, scene)
        return scene
