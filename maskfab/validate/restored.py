"""Restored photographs behind a die: the surrogate's prediction, and photographs simulated through it."""

from __future__ import annotations

import os
from collections.abc import Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from types import MappingProxyType

import numpy as np
from numpy.typing import NDArray

from maskfab.design.surrogate import Surrogate, surrogate
from maskfab.errors import JobError
from maskfab.imaging.laid_panel import laid_panel
from maskfab.imaging.photographs import Scene
from maskfab.imaging.protocol import ASSUMED, LEVELS
from maskfab.imaging.scenes import bundled
from maskfab.imaging.shots import Crop, Shot, shots, truth_of
from maskfab.imaging.transfer import PANEL_UM, STOP_UM, Laid
from maskfab.model import Die, Panel, Quantity, Tiling, refined
from maskfab.units import NM_PER_UM

SHOWN_LEVELS = (24, 40)
"""Levels at which photographs are taken, dB: little light and much."""
CROP = Crop(144, 192)
"""Part of the photographs that is shown."""

_SAME_UM = 1e-6

RESIDUAL_DB: Mapping[int, float] = MappingProxyType({24: 0.7, 32: 0.5, 40: 1.0})
"""Largest difference, by level, of the prediction from protocol F1 run on the four bundled scenes (mean of their PSNRs,
ε the best for all four): twelve dies, cells of 84, 92 and 168 um, repeated, turned at random, and by a designed map.
"""


@dataclass(frozen=True, eq=False)
class Restored:
    """Quality of the photographs behind one die.

    Attributes:
        quantities: ``restored_psnr`` at every level of light.
        scene: of the photographs; None if none were taken.
        truth: part of the scene, float32 [3, rows, columns], row 0 on top; None likewise.
        shots: the same part of every restored photograph, by rising level.
    """

    quantities: tuple[Quantity, ...]
    scene: str | None = None
    truth: NDArray[np.float32] | None = None
    shots: tuple[Shot, ...] = ()


@dataclass(frozen=True, eq=False)
class Photographer:
    """Everything that does not depend on the die.

    Attributes:
        laid: every die that the protocol can judge, as it sees it, by name.
        scenes: photographs that are averaged over.
        estimates: surrogates by the dots of a cell and their side in nanometres.
    """

    laid: Mapping[str, Laid]
    scenes: tuple[Scene, ...]
    estimates: Mapping[tuple[int, int], Surrogate]

    def __call__(self, die: Die, *, photographs: bool) -> Restored:
        """Predict the PSNR of one of ``laid``, and with ``photographs`` take some of the first scene through it."""
        quantities = tuple(self._predicted(die))
        if not photographs:
            return Restored(quantities)
        scene = self.scenes[0]
        taken = shots(self.laid[die.name], scene, SHOWN_LEVELS, CROP)
        return Restored(quantities, scene.name, truth_of(scene, CROP), taken)

    def _predicted(self, die: Die) -> list[Quantity]:
        panel, laid = die.panel, self.laid[die.name]
        estimate = self.estimates[_cell(panel, laid)]
        if not panel.others and panel.tiling in (Tiling.PERIODIC, Tiling.RANDOM):
            found = estimate(_unit(panel, laid), periodic=panel.tiling is Tiling.PERIODIC)
            how = "all random layouts" if panel.tiling is Tiling.RANDOM else "the repeated opening"
        elif abs(estimate.lattice.side * estimate.lattice.dot_um - PANEL_UM) > _SAME_UM:
            return []  # the error of one layout is only known of panels of the protocol's own side
        else:
            # It brings torch along, which takes longer to start than most plates take to check.
            from maskfab.design.pupil_error import pupil_error

            found = pupil_error(estimate).psnr(laid.pupil)
            how = "this very layout"
        return [
            Quantity(
                "restored_psnr",
                "PSNR",
                value,
                "dB",
                f"expected: surrogate of protocol F1 over the bundled scenes, for {how}; error: its largest difference "
                f"from the protocol itself, run on these scenes for twelve dies; assumed: {ASSUMED}",
                uncertainty=RESIDUAL_DB[level],
                die=die.name,
                level_db=level,
            )
            for level, value in zip(LEVELS, found, strict=True)
        ]


def photographer(dies: Sequence[Die], scenes: Sequence[Scene] | None = None) -> Photographer | None:
    """Prepare for the dies that cover the stop of protocol F1 and that it can judge; None if there are none.

    Args:
        dies: of a plate.
        scenes: of 1024 x 1536 pixels; None for the bundled ones.
    """
    laid: dict[str, Laid] = {}
    for die in dies:
        if min(die.panel.size_nm) < STOP_UM * NM_PER_UM:
            continue
        try:
            laid[die.name] = laid_panel(die.name, die.panel)
        except JobError:
            continue
    if not laid:
        return None
    known = tuple(scenes) if scenes is not None else bundled()
    cells = sorted({_cell(die.panel, laid[die.name]) for die in dies if die.name in laid})
    with ThreadPoolExecutor(os.cpu_count() or 1) as pool:
        made = pool.map(lambda cell: surrogate(known, cell[0], dot_nm=cell[1]), cells)
        return Photographer(laid, known, dict(zip(cells, made, strict=True)))


def _cell(panel: Panel, laid: Laid) -> tuple[int, int]:
    """Dots along a cell's side, its gutter included, and their side in nanometres, as the protocol divides it."""
    dot_nm = round(1000 * (laid.dot_um or PANEL_UM / len(laid.pupil)))
    return panel.pitch_nm // dot_nm, dot_nm


def _unit(panel: Panel, laid: Laid) -> NDArray[np.bool_]:
    """The opening on these dots, its gutter round it."""
    dots, dot_nm = _cell(panel, laid)
    fine = refined(panel.opening.mask, panel.dot_nm // dot_nm)
    return np.pad(fine, (dots - len(fine)) // 2)
