"""Maps of a display whose lines bend round its openings: mended where lines find no way, then looked after.

Most maps let lines pass as they are designed. Where one does not, a chain of openings that too few lines pass names
the cells between which they do not. Cells beyond a map are laid alike, and lines pass those; laid alike, the named
cells let lines through again, so the map is mended chain by chain. As it is bettered from there, a turn that makes such
a chain is refused. Lines are drawn at last, on the whole die.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from maskfab.base.arrays import Labels, Mask
from maskfab.designs.rules.display_fit import Display
from maskfab.display.emitter_rules import Certificate
from maskfab.display.panel_lines import AXES, panel_cut

_MARGIN = 2
"""Regular cells on each side of a map that is looked at: lines bend at most a pixel aside."""

_MENDED = 200
"""Chains that are taken out of a random map before all of its cells are laid alike."""


@dataclass(frozen=True, eq=False)
class Guard:
    """The lines of a display in a map of one opening, bool [dots, dots]; they pass where all cells are laid alike."""

    display: Display
    unit: Mask
    dot_nm: int

    def __call__(self, cells: Labels) -> bool:
        """Whether no chain of openings keeps lines from passing a map, int8 [rows, columns]."""
        return self._cut(cells) is None

    def mended(self, cells: Labels) -> Labels:
        """The map with as few cells laid alike as chains name, so that lines pass."""
        whole = np.array(cells)
        for _ in range(_MENDED):
            cut = self._cut(whole)
            if cut is None:
                return whole
            before = whole.copy()
            for across, along in cut.chain_nm:
                row, column = (int(nm // (len(self.unit) * self.dot_nm)) - _MARGIN for nm in (along, across))
                if 0 <= row < whole.shape[0] and 0 <= column < whole.shape[1]:
                    whole[row, column] = 0
            if np.array_equal(before, whole):
                break
        return np.zeros_like(whole)

    def _cut(self, cells: Labels) -> Certificate | None:
        wires = self.display.rules.wires
        if wires is None:
            return None
        panel = self.display.panel(self.unit, self.dot_nm, np.pad(cells, _MARGIN))
        cuts = (panel_cut(panel, wires.rules, self.display.opaque_lines, axis) for axis in AXES)
        return next((cut for cut in cuts if cut is not None), None)
