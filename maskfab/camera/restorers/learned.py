"""A network that was trained behind one die as a restorer; without training there is none."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import torch
from numpy.typing import NDArray

from maskfab.camera.learning.network import Network
from maskfab.camera.learning.view import View, light_of
from maskfab.camera.record import Record
from maskfab.camera.restorers.restorer import Blur

Singles = NDArray[np.float32]


@dataclass(frozen=True, eq=False)
class Learned:
    """A network, and how records are shown to it.

    Attributes:
        network: that mends them.
        view: of records.
    """

    network: Network
    view: View
    name: str = "learned"

    def prepare(self, record: Record, blur: Blur) -> Callable[[float], Singles]:
        """As every restorer, :meth:`maskfab.camera.restorers.restorer.Restorer.prepare`; ε changes nothing, for the
        strength of the prior was learned."""
        picture = self.mended(self.view.planes(record, blur))
        return lambda _: picture

    def mended(self, planes: Singles) -> Singles:
        """Restored light of what is shown, float32 [3, rows, columns] within 0 to 1."""
        where = next(self.network.parameters()).device
        with torch.inference_mode():
            found = self.network(torch.from_numpy(planes)[None].to(where, memory_format=torch.channels_last))
        return np.clip(light_of(found[0].cpu().numpy()), 0, 1)
