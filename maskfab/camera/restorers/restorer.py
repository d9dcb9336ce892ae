"""A restorer: one function of a record, the transfer it was taken through, and its noise."""

from __future__ import annotations

from collections.abc import Callable
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from maskfab.base.arrays import Singles
from maskfab.camera.record import Record

Transfer = NDArray[np.float32] | NDArray[np.complex64]


class Blur(Protocol):
    """The blur of a scene by lens, panel and pixels."""

    def on(self, shape: tuple[int, int]) -> Transfer:
        """H at the frequencies of ``rfft2`` of pictures of that shape, [3, rows, columns / 2 + 1], 1 at frequency 0.

        Real where the point spread is the same turned by 180 degrees, complex otherwise. Kept for every shape.
        """


class Restorer(Protocol):
    """A way to undo the blur."""

    @property
    def name(self) -> str:
        """In tables and options."""

    def prepare(self, record: Record, blur: Blur) -> Callable[[float], Singles]:
        """Do once all that does not depend on the strength.

        Returns:
            A function of the strength epsilon of the 1/f² prior that gives the restored light on the sensor,
            float32 [3, rows, columns] within 0 to 1.
        """
