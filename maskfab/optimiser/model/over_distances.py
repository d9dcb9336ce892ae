"""Expected error of a panel over the distances of a scene: the mean of decibels, each photograph restored by its own
blur."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from maskfab.base.arrays import Floats
from maskfab.camera.transfer import CellGrid
from maskfab.optimiser.model.layout_error import Judged, PupilError, Slope


@dataclass(frozen=True, eq=False)
class OverDistances:
    """Judgement of panels by the mean over distances; a :class:`maskfab.optimiser.model.layout_error.PanelError`.

    Attributes:
        errors: at every distance, of one lattice and alike in levels and weights.
    """

    errors: tuple[PupilError, ...]

    @property
    def lattice(self) -> CellGrid:
        """Of the cells behind the stop."""
        return self.errors[0].lattice

    @property
    def inside(self) -> NDArray[np.bool_]:
        """The stop."""
        return self.errors[0].inside

    @property
    def levels(self) -> tuple[float, ...]:
        """Of light, dB."""
        return self.errors[0].levels

    @property
    def weights(self) -> tuple[float, ...]:
        """Of the levels."""
        return self.errors[0].weights

    @property
    def dots(self) -> int:
        """Along the unit's side."""
        return self.lattice.dots

    @property
    def cells(self) -> int:
        """Along the panel's side."""
        return self.lattice.cells

    def laid(self, units: NDArray[np.bool_], orientations: NDArray[np.int8] | None = None, seed: int = 0) -> Floats:
        """The pupil of units laid on the cells."""
        return self.errors[0].laid(units, orientations, seed)

    def psnr(self, pupil: Floats) -> tuple[float, ...]:
        """Mean over the distances of the expected restored PSNR in dB, at each level."""
        return tuple(np.mean([each.psnr(pupil) for each in self.errors], axis=0).tolist())

    def epsilons(self, pupil: Floats) -> tuple[float, ...]:
        """The best ε of each level, distance by distance."""
        return tuple(epsilon for each in self.errors for epsilon in each.epsilons(pupil))

    def judge(self, pupil: Floats, epsilons: Sequence[float]) -> MeanJudged:
        """The mean loss of a pupil with the ε of :meth:`epsilons`."""
        count = len(self.levels)
        parts = (epsilons[start : start + count] for start in range(0, len(epsilons), count))
        return MeanJudged(tuple(each.judge(pupil, part) for each, part in zip(self.errors, parts, strict=True)))


@dataclass(frozen=True, eq=False)
class MeanJudged:
    """Mean over what judged one pupil."""

    judged: tuple[Judged, ...]

    @property
    def loss(self) -> float:
        """Minus the mean over levels and distances of the expected restored PSNR, dB."""
        return sum(each.loss for each in self.judged) / len(self.judged)

    def slope(self) -> Slope:
        """Mean of the slopes; to be asked for once."""
        slopes = [each.slope() for each in self.judged]
        return Slope(np.mean([each.near for each in slopes], axis=0), np.mean([each.field for each in slopes], axis=0))
