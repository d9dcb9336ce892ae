r"""The blur by a die as it stands before the camera, for pictures whose first row is the top.

A die's own transfer H has y upwards, as its drawing has. A picture shows at (x, y) what the die as drawn has at
R⁻¹(x, y), so that with rows downwards H'(ν_x, ν_y) = H(R⁻¹(ν_x, -ν_y)), and H(-ν) is the conjugate of H(ν).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from maskfab.camera.restorers.restorer import Blur, Transfer


@dataclass(frozen=True, eq=False)
class StandingBlur:
    """Blur by a die one way round.

    Attributes:
        drawn: by the die as drawn, y upwards.
        way_round: one of :data:`maskfab.capture.stands.STANDS`.
    """

    drawn: Blur
    way_round: int = 0

    def on(self, shape: tuple[int, int]) -> Transfer:
        """See :class:`maskfab.camera.restorers.restorer.Blur`."""
        rows, columns = shape
        mirrored = self.way_round >= 4
        if self.way_round % 2 == 0:
            known = self.drawn.on(shape)
            return known.conj() if mirrored else known[:, -np.arange(rows) % rows]
        # Turned, ν_x is along the drawing's y, and ν_y along its x, of which half is kept.
        known = self.drawn.on((columns, rows))
        up = np.arange(columns // 2 + 1)
        right = np.arange(rows // 2 + 1)
        left = np.arange(rows - rows // 2 - 1, 0, -1)
        here, there = (up, -up % columns) if not mirrored else (-up % columns, up)
        ahead = known[:, here[:, None], right]
        behind = known[:, there[:, None], left].conj()
        whole = np.concatenate([ahead, behind], axis=2).transpose(0, 2, 1)
        return np.ascontiguousarray(whole if mirrored else whole.conj())
