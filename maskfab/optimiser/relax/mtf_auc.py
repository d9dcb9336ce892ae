r"""The area under the radial minimum of the MTF, the figure of merit of the literature, smoothed so that it has slopes.

    loss = -(1 / 147) Σ_r softmin_τ { MTF(ν) : ν on ring r },     softmin_τ(m) = -τ log mean exp(-m / τ),

over rings one sample wide from 0 to half a cycle per pixel, averaged over the wavelengths (Yang & Sankaranarayanan
2021, figure 7). τ -> 0 is the minimum itself, which hands all of a ring's slope to one frequency.

Notes:
    Good for comparing with published curves, not for pictures: openings that are best in AUC restore photographs up to
    6 dB worse, since half a ring may be ruined for the sake of its lowest point.
    The modulation is divided by the design's own light: a darker opening is not worse.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import torch

from maskfab.errors import JobError
from maskfab.optics.image.mtf import RINGS
from maskfab.optimiser.relax.autocorrelation import Autocorrelation
from maskfab.optimiser.relax.objective import Objective
from maskfab.optimiser.relax.tiled_stop import PointTransfer, TiledStop


@dataclass(frozen=True, eq=False)
class MtfAuc(Objective):
    """The smoothed AUC, negative.

    Attributes:
        correlation: of the pupil.
        points: per wavelength, the transfer at the points of all rings, ring by ring, filled up to equal length.
        filled: bool [rings, longest], places that are no point.
        count: [rings], points of each.
        temperature: τ, in units of modulation.
    """

    correlation: Autocorrelation
    points: tuple[PointTransfer, ...]
    filled: torch.Tensor
    count: torch.Tensor
    temperature: float

    def of_table(self, table: torch.Tensor, unit: torch.Tensor) -> torch.Tensor:
        """Minus the smoothed AUC, between -1 and 0."""
        areas = []
        for points in self.points:
            modulation = points(table).abs().view(self.filled.shape)
            cold = (-modulation / self.temperature).masked_fill(self.filled, -torch.inf)
            lowest = -self.temperature * (torch.logsumexp(cold, dim=1) - self.count.log())
            areas.append(lowest.mean())
        return -torch.stack(areas).mean()

    def auc(self, unit: torch.Tensor) -> tuple[float, ...]:
        """The AUC itself at every wavelength: true minima."""
        if self.correlation is None:
            return ()
        with torch.no_grad():
            table = self.correlation(unit)
            found = []
            for points in self.points:
                modulation = points(table).abs().view(self.filled.shape).masked_fill(self.filled, torch.inf)
                found.append(float(modulation.amin(1).mean()))
        return tuple(found)


def mtf_auc(stop: TiledStop, temperature: float = 0.01) -> MtfAuc:
    """The AUC of units in a stop.

    Raises:
        JobError: MF104 for a temperature that is not above 0.
    """
    if not temperature > 0:
        raise JobError(
            "MF104", f"temperature = {temperature:g} is not above 0", where="design.temperature", cure="Use 0.01"
        )
    axis = np.arange(-RINGS + 1, RINGS)
    across, up = np.meshgrid(axis, axis[RINGS - 1 :])
    ring = np.rint(np.hypot(across, up)).astype(np.int64)
    inside = (ring < RINGS) & ((up > 0) | (across >= 0))
    across, up, ring = across[inside], up[inside], ring[inside]
    count = np.bincount(ring, minlength=RINGS)
    order = np.argsort(ring, kind="stable")
    first = np.cumsum(count) - count
    place = np.arange(count.max())
    filled = place[None, :] >= count[:, None]
    picked = order[np.where(filled, first[:, None], first[:, None] + place[None, :])].ravel()
    step = 0.5 / (RINGS - 1)
    points = tuple(
        stop.at_points(nm, step * up[picked].astype(np.float64), step * across[picked].astype(np.float64))
        for nm in stop.camera.wavelengths_nm
    )
    return MtfAuc(stop.correlation, points, stop.here(filled), stop.here(count.astype(np.float64)), temperature)
