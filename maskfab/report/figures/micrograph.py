"""Outlines that were read of a microscope picture: over the mean cell, and over the picture itself."""

from __future__ import annotations

import numpy as np
from matplotlib.figure import Figure

from maskfab.base.arrays import Floats
from maskfab.base.model import Opening
from maskfab.display.micrograph import SeenCell
from maskfab.report.figures.sheet import Drawing, styled

_MOST = 700
"""Pixels of the picture along a side that are shown."""
_OUTLINE, _DOTS = "#d55e00", "#0072b2"


@styled
def outlines(picture: Floats, seen: SeenCell, opening: Opening) -> Drawing:
    """The mean cell with its outline and the written dots, beside the picture with the outline in every cell."""
    figure = Figure(figsize=(9.6, 4.7))
    cell, whole = figure.subplots(1, 2, width_ratios=(1, 1.1))
    size, side = len(seen.clear), opening.cell_size.pitch_um
    step = max(1, size // 1000)
    at = (np.arange(0, size, step) + 0.5) / size
    clear = seen.clear[::step, ::step]
    cell.imshow(seen.values, origin="lower", cmap="gray", extent=(0, side, 0, side), vmin=-0.1, vmax=1.1)
    cell.contour(at * side, at * side, clear, [0.5], colors=_OUTLINE, linewidths=0.9)
    dots = (np.arange(8 * opening.dots) + 0.5) / (8 * opening.dots) * side
    cell.contour(dots, dots, np.kron(opening.mask, np.ones((8, 8))), [0.5], colors=_DOTS, linewidths=0.4)
    cell.set(title="mean cell, outline and dots", xlabel="um", ylabel="um")
    rows, columns = picture.shape
    thin = max(1, -(-max(rows, columns) // _MOST))
    whole.imshow(picture[::thin, ::thin], cmap="gray", extent=(-0.5, columns - 0.5, rows - 0.5, -0.5))
    u0, u1, v0, v1 = seen.lattice.view(picture.shape)
    for u, v in np.ndindex(u1 - u0, v1 - v0):
        x, y = seen.lattice.pixels(*np.meshgrid(at + u + u0, at + v + v0))
        if x.max() > 0 and y.max() > 0 and x.min() < columns and y.min() < rows:
            whole.contour(x, y, clear, [0.5], colors=_OUTLINE, linewidths=0.5)
    whole.set(xlim=(-0.5, columns - 0.5), ylim=(rows - 0.5, -0.5), title="picture", xlabel="pixels")
    figure.subplots_adjust(left=0.06, right=0.99, bottom=0.11, top=0.93, wspace=0.16)
    return Drawing(figure, f"Outline of {opening.name} over the mean cell and over the picture")
