"""The structure that a die leaves in photographs' power, beside that of the fitted one."""

from __future__ import annotations

import numpy as np
from matplotlib.figure import Figure

from maskfab.base.arrays import Floats
from maskfab.camera.inspection.photo_bench import SIDE, PhotoBench
from maskfab.report.figures.sheet import Drawing, place, styled

_SIDE, _LEFT, _UP, _GAP = 3.0, 0.6, 0.5, 0.3
_DECADES = 3.0


@styled
def structure_drawing(found: PhotoBench) -> Drawing:
    """Power of green light over that of smooth scenes, and |H|², in decades of its most, over cycles per pixel."""
    figure = Figure(figsize=(_LEFT + 2 * _SIDE + 2 * _GAP, _SIDE + 2 * _UP), dpi=120)
    seen, fitted = found.structure()
    # Both by one measure: single powers scatter as much as they are.
    most = float(np.nanmax(fitted))
    for column, (values, name) in enumerate(((seen, "seen"), (fitted, "fitted"))):
        axes = place(figure, (_LEFT + column * (_SIDE + _GAP), _UP, _SIDE, _SIDE))
        axes.imshow(
            _decades(values / most), cmap="magma", vmin=-_DECADES, vmax=0, extent=(0, 0.5, -0.5, 0.5), aspect="auto"
        )
        axes.set_title(name, fontsize=8)
        axes.set_xlabel("cycles per pixel")
        if column:
            axes.set_yticklabels([])
    return Drawing(figure, f"power of {found.squares} squares of {SIDE} pixels over their scenes', and |H|² fitted")


def _decades(values: Floats) -> Floats:
    with np.errstate(invalid="ignore", divide="ignore"):
        return np.asarray(np.log10(np.maximum(values, 1e-6)))
