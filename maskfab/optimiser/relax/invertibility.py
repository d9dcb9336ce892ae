"""The paper's first loss: how well the worst spatial frequencies survive a Wiener filter."""

from __future__ import annotations

import math
from dataclasses import dataclass

import torch

from maskfab.optimiser.relax.autocorrelation import Autocorrelation
from maskfab.optimiser.relax.objective import Objective


@dataclass(frozen=True, eq=False)
class Invertibility(Objective):
    """Survival of the worst spatial frequencies under a Wiener filter, with photons counted.

    The OTF at the frequency nu is the pupil's autocorrelation AC at the lag lambda f nu (Goodman, Introduction to
    Fourier Optics, 6.4). With it

        O = AC / (clear area of the bare stop x target open ratio),  H = O^2 / (O^2 + epsilon),
        loss = -mean of the smallest ``worst_fraction`` of H,

    over all lags of at least one dot up to half a cycle per sensor pixel (Yang & Sankaranarayanan 2021, equation 9
    and L_inv; thirty percent is meant where the text once says ten).

    O is divided by the light that a pattern of the target's open ratio passes, not by the PSF's own sum. With the
    latter a grey filter is free of charge: its O is that of the bare stop however dark it is, holes of the open ratio
    r have r times that on average, and the optimum is uniform grey. With photons counted, grey of the share r has
    r times the bare stop's O as well; all it keeps is its evenness, which binarisation takes away.

    Good for worst cases whatever the picture. It knows neither the picture's spectrum nor the sensor's edge: for
    photographs use :class:`maskfab.optimiser.relax.expected_error.ExpectedError`.

    Attributes:
        correlation: autocorrelation of the stop filled with oriented cells, far enough for these lags.
        lags: per wavelength, int64 flat indices into the autocorrelation table: integer lags of a half plane (the
            other half is its mirror image).
        light: clear area of the stop, in dots, x target open ratio: AC(0) of an opening that meets the target.
        epsilon: noise-to-signal ratio of the Wiener filter.
        worst_fraction: share of the lags that counts.
        own_sum: divide by the PSF's own sum, AC(0), as published, so that darkness is free; its optimum is grey.
    """

    correlation: Autocorrelation
    lags: tuple[torch.Tensor, ...]
    light: float
    epsilon: float
    worst_fraction: float
    own_sum: bool = False

    def of_table(self, table: torch.Tensor, unit: torch.Tensor) -> torch.Tensor:
        """The loss from the unit's autocorrelation table; a scalar between -1 and 0."""
        autocorrelation = table.flatten()
        light = autocorrelation[0] if self.own_sum else self.light
        worst = []
        for lags in self.lags:
            otf = autocorrelation.index_select(0, lags) / light
            kept = otf**2 / (otf**2 + self.epsilon)
            count = math.ceil(self.worst_fraction * lags.numel())
            worst.append(torch.topk(kept, count, largest=False, sorted=False).values.mean())
        return -torch.stack(worst).mean()
