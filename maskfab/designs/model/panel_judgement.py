"""Judgement of realised panels, by which orientation maps are designed: the loss of a pupil, and its slopes.

:mod:`maskfab.designs.model.panel_error` computes it, on torch's tensors; maps need to know no more than this.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from maskfab.base.arrays import Floats, Labels, Mask, Singles
from maskfab.base.model import Scalar
from maskfab.camera.stop_cells import CellGrid, lay


@dataclass(frozen=True, eq=False)
class Slope:
    """Slope of the loss, to first order in the autocorrelation.

    Attributes:
        near: g at the lags within a unit, float64 [2 dots - 1, 2 dots - 1], lag 0 in the middle; dB per dot.
        field: ∂loss/∂p, float32 like the pupil; dB per dot.
    """

    near: Floats
    field: Singles


@dataclass(frozen=True, eq=False)
class Judged:
    """Loss of one pupil, minus the mean expected restored PSNR, dB; its slopes are to be asked for once."""

    loss: float
    slope: Callable[[], Slope]


class PanelError(ABC):
    """Judgement of panels of cells, by which maps are designed.

    Attributes:
        weights: of the levels in the loss; they sum to 1.
        stride: dots from one lag that counts to the next.
    """

    lattice: CellGrid
    levels: tuple[float, ...]
    weights: tuple[float, ...]
    stride: int = 1

    @cached_property
    def inside(self) -> Mask:
        """The stop, bool [side, side], side = ``lattice.side``."""
        return self.lattice.stop

    @property
    def of_steps(self) -> PanelError:
        """Judgement that tells the steps of a map apart, and may be the quicker for it."""
        return self

    @property
    def dots(self) -> int:
        """Number along the unit's side."""
        return self.lattice.dots

    @property
    def cells(self) -> int:
        """Number along the panel's side: 24 of 168 µm."""
        return self.lattice.cells

    def laid(self, units: Mask, orientations: Labels | None = None, seed: int = 0) -> Floats:
        """The pupil of units laid on these cells, [side, side] of 0 and 1, as :func:`maskfab.camera.stop_cells.lay`."""
        return lay("panel", units, orientations, seed, room=self.lattice).pupil

    @abstractmethod
    def psnr(self, pupil: Floats) -> tuple[float, ...]:
        """Expected restored PSNR in dB at each level, each with its best ε; pupil [side, side] as of :meth:`laid`."""

    @abstractmethod
    def epsilons(self, pupil: Floats) -> tuple[float, ...]:
        """The best ε of each level."""

    @abstractmethod
    def judge(self, pupil: Floats, epsilons: Sequence[float]) -> Judged:
        """The loss of a pupil with the ε of :meth:`epsilons`."""


class MeanPanelError(PanelError):
    """Judgement of panels by the mean over distances."""

    def __init__(self, errors: tuple[PanelError, ...]) -> None:
        self.errors = errors
        self.lattice, self.levels, self.weights = errors[0].lattice, errors[0].levels, errors[0].weights

    def psnr(self, pupil: Floats) -> tuple[float, ...]:
        return tuple(np.mean([error.psnr(pupil) for error in self.errors], axis=0).tolist())

    def epsilons(self, pupil: Floats) -> tuple[float, ...]:
        """The best ε of each level, distance by distance."""
        return tuple(epsilon for error in self.errors for epsilon in error.epsilons(pupil))

    def judge(self, pupil: Floats, epsilons: Sequence[float]) -> Judged:
        count = len(self.levels)
        parts = (epsilons[start : start + count] for start in range(0, len(epsilons), count))
        judged = [error.judge(pupil, part) for error, part in zip(self.errors, parts, strict=True)]

        def slope() -> Slope:
            slopes = [one.slope() for one in judged]
            return Slope(np.mean([one.near for one in slopes], axis=0), np.mean([one.field for one in slopes], axis=0))

        return Judged(sum(one.loss for one in judged) / len(judged), slope)


def parted(values: NDArray[Scalar], stride: int) -> NDArray[Scalar]:
    """Dots [.., side, side] that lie whole strides apart, together: [.., stride², m, m], 0 beyond the side."""
    beyond = -values.shape[-1] % stride
    padded = np.pad(values, [(0, 0)] * (values.ndim - 2) + [(0, beyond)] * 2)
    count = padded.shape[-1] // stride
    split = padded.reshape(*values.shape[:-2], count, stride, count, stride)
    return np.moveaxis(split, (-3, -1), (-4, -3)).reshape(*values.shape[:-2], stride**2, count, count)
