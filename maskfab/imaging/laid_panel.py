"""A panel as protocol F1 sees it: the 24 x 24 cells round the axis."""

from __future__ import annotations

import numpy as np

from maskfab.errors import JobError
from maskfab.imaging.transfer import CELLS, PANEL_UM, Laid, lay
from maskfab.model import Panel, Tiling

_CELL_NM = round(1000 * PANEL_UM / CELLS)


def laid_panel(name: str, panel: Panel) -> Laid:
    """The design that a panel is, for :func:`maskfab.imaging.protocol.evaluate`.

    A random tiling is drawn as the protocol draws it, so that designs differ by their openings alone; other tilings
    are taken from the panel's middle. A gutter becomes closed dots round the opening.

    Raises:
        JobError: MF122 for a cell of another pitch, a gutter that is no even number of dots, or fewer than 24 x 24
            cells.
    """
    rim, rest = divmod(panel.gutter_nm // 2, panel.dot_nm)
    rows, columns = panel.orientations.shape
    if panel.pitch_nm != _CELL_NM or rest:
        raise JobError(
            "MF122",
            f"{name} has cells of {panel.pitch_nm / 1e3:g} um with a gutter of {panel.gutter_nm / 1e3:g} um; protocol "
            f"F1 is about cells of {_CELL_NM / 1e3:g} um, gutters of whole dots",
            where=name,
            cure=f"Name dies with a pitch of {_CELL_NM / 1e3:g} um",
        )
    units = np.stack([np.pad(opening.mask, rim) for opening in panel.openings])
    if panel.tiling is Tiling.RANDOM:
        return lay(name, units)
    if min(rows, columns) < CELLS:
        raise JobError(
            "MF122",
            f"{name} has {columns} x {rows} cells, fewer than the {CELLS} x {CELLS} of protocol F1",
            where=name,
            cure="Use a larger die",
        )
    bottom, left = (rows - CELLS) // 2, (columns - CELLS) // 2
    return lay(name, units, panel.orientations[bottom : bottom + CELLS, left : left + CELLS])
