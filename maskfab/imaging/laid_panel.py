"""A panel as protocol F1 sees it: the cells round the axis that cover the stop, 24 x 24 of 168 um, 48 x 48 of 84 um."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from maskfab.errors import JobError
from maskfab.imaging.transfer import MOST_DOTS, STOP_UM, Laid, Lattice, lattice, lay
from maskfab.model import Panel, Tiling, refined


@dataclass(frozen=True)
class _Finer:
    """Dots on which openings and gutters are whole numbers.

    Attributes:
        times: that many of them along one of the panel's dots.
        rim: that many on each side of the opening.
        room: the cells behind the stop.
        dot_nm: side of one.
    """

    times: int
    rim: int
    room: Lattice
    dot_nm: int


def laid_panel(name: str, panel: Panel) -> Laid:
    """The design that a panel is, for :func:`maskfab.imaging.protocol.evaluate`.

    A random tiling is drawn as the protocol draws it, so that designs differ by their openings alone; other tilings
    are taken from the panel's middle. A gutter becomes closed dots round the opening; where half of it is no whole
    number of dots, all dots are halved, or divided further, until it is one.

    Raises:
        JobError: MF122 for a hexagonal tiling, or fewer cells than cover the stop; MF115 for more than 2048 dots along
            the side of these; MF104 for dots that are too large.
    """
    if panel.tiling is Tiling.HEXAGONAL:
        raise JobError(
            "MF122",
            f"{name} has its cells on a hexagonal lattice; protocol F1 is about square cells",
            where=name,
            cure="Name dies with another tiling",
        )
    fine = _finer(name, panel)
    units = np.stack([np.pad(refined(opening.mask, fine.times), fine.rim) for opening in panel.openings])
    if panel.tiling is Tiling.RANDOM:
        return lay(name, units, dot_nm=fine.dot_nm)
    rows, columns = panel.orientations.shape
    cells = fine.room.cells
    if min(rows, columns) < cells:
        raise JobError(
            "MF122",
            f"{name} has {columns} x {rows} cells of {panel.pitch_nm / 1e3:g} um, fewer than the {cells} x {cells} "
            f"that cover a stop of {STOP_UM:g} um",
            where=name,
            cure=f"Use a die of at least {cells * panel.pitch_nm / 1e6:.3g} mm",
        )
    bottom, left = (rows - cells) // 2, (columns - cells) // 2
    middle = panel.orientations[bottom : bottom + cells, left : left + cells]
    return lay(name, units, middle, dot_nm=fine.dot_nm)


def _finer(name: str, panel: Panel) -> _Finer:
    half = panel.gutter_nm // 2
    dot_nm = math.gcd(panel.dot_nm, half) if half else panel.dot_nm
    times = panel.dot_nm // dot_nm
    dots = panel.pitch_nm // dot_nm
    try:
        return _Finer(times, half // dot_nm, lattice(dots, dot_nm, where=name), dot_nm)
    except JobError as error:
        if times == 1 or error.code != "MF115":
            raise
        raise JobError(
            "MF115",
            f"half a gutter of {half / 1e3:g} um and dots of {panel.dot_nm / 1e3:g} um are whole only on dots of "
            f"{dot_nm / 1e3:g} um, too many behind a stop of {STOP_UM:g} um; the limit is {MOST_DOTS} along a side",
            where=name,
            cure="Make the gutter an even number of dots wide",
        ) from error
