"""Layers of a mask file as its readers have them, and on them what these draw otherwise."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from matplotlib.figure import Figure

from maskfab.mask.comparison.readings import View
from maskfab.report.figures.sheet import Drawing, place, styled

_PAPER, _DRAWN, _UNLIKE = (np.array(colour) for colour in ((255, 255, 255), (0, 114, 178), (213, 94, 0)))
"""Two colours of Okabe and Ito, which nobody takes for one another."""
_SIDE_IN, _ROOM_IN, _COLUMNS = 2.6, 0.65, 3


@styled
def readers(views: Sequence[View], names: Sequence[str]) -> Drawing:
    """The views side by side, axes in micrometres; ``names`` are the readers, the first of whom draws them."""
    columns, rows = min(_COLUMNS, max(1, len(views))), -(-len(views) // _COLUMNS)
    step = _SIDE_IN + _ROOM_IN
    figure = Figure(figsize=(columns * step + 0.2, rows * step + 0.6))
    for number, view in enumerate(views):
        row, column = divmod(number, _COLUMNS)
        at = column * step + _ROOM_IN, (rows - 1 - row) * step + _ROOM_IN + 0.25
        axes = place(figure, (*at, _SIDE_IN, _SIDE_IN - 0.3))
        shares = _PAPER + view.drawn[..., None] * (_DRAWN - _PAPER)
        picture = np.where(_about(view.unlike > 0)[..., None], _UNLIKE, shares.round()).astype(np.uint8)
        left, bottom, right, top = view.box_um
        axes.imshow(picture, origin="lower", extent=(left, right, bottom, top), interpolation="none")
        axes.set_title(f"{view.cell}, {view.layer}: {view.unlike_um2:.4g} um$^2$ otherwise".replace("$^2$", "²"))
        axes.set_xlabel("x (um)")
    others = f"\norange: otherwise by {' or '.join(names[1:])}" if len(names) > 1 else ""
    figure.text(0.1, 0.08, f"blue: as {names[0]} reads it{others}" if names else "", transform=figure.dpi_scale_trans)
    return Drawing(figure, f"{len(views)} layers as {', '.join(names)} read them")


def _about(unlike: np.ndarray[tuple[int, ...], np.dtype[np.bool_]]) -> np.ndarray[tuple[int, ...], np.dtype[np.bool_]]:
    """Squares with their neighbours: a sliver of one square would hardly be seen."""
    wide = np.pad(unlike, 1)
    wide[1:-1] |= wide[:-2] | wide[2:]
    wide[:, 1:-1] |= wide[:, :-2] | wide[:, 2:]
    return wide[1:-1, 1:-1]
