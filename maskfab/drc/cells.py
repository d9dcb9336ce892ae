"""The distinct cells of a panel as rasters."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from klayout import db
from numpy.typing import NDArray

from maskfab.base.arrays import Ints
from maskfab.model import Panel


@dataclass(frozen=True, eq=False)
class PanelCells:
    """Contents of the cells of a panel.

    Attributes:
        panel: the panel.
        held: the distinct entries of its orientations, ascending.
        codes: int64 [rows, columns], index into ``held``.
    """

    panel: Panel
    held: tuple[int, ...]
    codes: Ints

    @classmethod
    def of(cls, panel: Panel) -> PanelCells:
        """The cells of a panel."""
        held, codes = np.unique(panel.orientations, return_inverse=True)
        return cls(panel, tuple(held.tolist()), codes.reshape(panel.orientations.shape).astype(np.int64))

    @cached_property
    def clear(self) -> NDArray[np.bool_]:
        """bool [held, n, n]: the dots of each, with a ring of gutter round them where the panel has one."""
        ring = int(self.panel.gutter_nm > 0)
        return np.stack([np.pad(self.panel.pattern(each), ring) for each in self.held])

    @cached_property
    def edges_nm(self) -> Ints:
        """int64 [n + 1], where the rows and columns of ``clear`` end."""
        return self.panel.cell_size.edges_nm

    @cached_property
    def origins_nm(self) -> Ints:
        """int64 [rows * columns, 2], lower left corners from the panel's."""
        rows, columns = np.indices(self.codes.shape).reshape(2, -1)
        return np.stack([columns, rows], axis=1) * self.panel.pitch_nm

    def region(self, raster: NDArray[np.bool_]) -> db.Region:
        """The clear dots of one cell's raster, bool [n, n], from the cell's corner; one box for each run."""
        return self.regions(np.where(raster, 0, -1)).get(0, db.Region())

    def regions(self, labels: Ints) -> dict[int, db.Region]:
        """Regions by label of one cell's raster, int64 [n, n], from the cell's corner; -1 is left out."""
        edges = self.edges_nm.tolist()
        regions: dict[int, db.Region] = {}
        n = labels.shape[1]
        steps = labels[:, 1:] != labels[:, :-1]
        ones = np.ones((len(labels), 1), dtype=np.bool_)
        rows, starts = np.nonzero(np.concatenate([ones, steps], axis=1))
        stops = np.append(starts[1:], 0)
        stops[stops == 0] = n
        every = zip(labels[rows, starts].tolist(), rows.tolist(), starts.tolist(), stops.tolist(), strict=True)
        for name, y, left, right in every:
            if name >= 0:
                box = db.Box(edges[left], edges[y], edges[right], edges[y + 1])
                regions.setdefault(name, db.Region()).insert(box)
        return regions
