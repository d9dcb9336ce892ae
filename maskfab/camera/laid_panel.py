"""A panel as a camera sees it: the cells round the axis that cover the stop, 24 x 24 of 168 um for protocol F1."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from maskfab.camera.photo_camera import F1, PhotoCamera
from maskfab.camera.transfer import MOST_DOTS, CellGrid, Laid, lattice, lay
from maskfab.errors import JobError
from maskfab.model import Panel, Tiling, refined
from maskfab.units import NM_PER_UM


@dataclass(frozen=True)
class _Finer:
    """Dots on which openings and gutters are whole numbers.

    Attributes:
        times: that many of them along one of the panel's dots.
        rim: that many on each side of the opening.
        room: the cells behind the stop.
    """

    times: int
    rim: int
    room: CellGrid


def laid_panel(name: str, panel: Panel, camera: PhotoCamera = F1) -> Laid:
    """The design that a panel is, for :func:`maskfab.camera.protocol.evaluate`.

    A random tiling is drawn as the protocol draws it, so that designs differ by their openings alone; other tilings
    are taken from the panel's middle, which is the axis; protocol F1 has its axis where four cells meet, so a panel of
    an odd number of cells is seen half a cell off its middle there. A gutter becomes closed dots round the opening;
    where half of it is no whole number of dots, all dots are halved, or divided further, until it is one.

    Raises:
        JobError: MF122 for a hexagonal tiling, fewer cells than cover the stop, or an axis that is in the middle of a
            cell along one side alone; MF115 for more than 2048 dots along the side of these; MF104, MF135 for dots
            that are too large or too small.
    """
    if panel.tiling is Tiling.HEXAGONAL:
        raise JobError(
            "MF122",
            f"{name} has its cells on a hexagonal lattice; photographs are judged through square cells",
            where=name,
            cure="Name dies with another tiling",
        )
    rows, columns = panel.orientations.shape
    drawn = panel.tiling is Tiling.RANDOM
    if not (drawn or camera.is_f1 or rows % 2 == columns % 2):
        raise JobError(
            "MF122",
            f"{name} has {columns} x {rows} cells: the axis is in the middle of a cell along one side only",
            where=name,
            cure="Use even numbers of both, or odd ones",
        )
    fine = _finer(name, panel, camera, odd=bool(rows % 2) and not (drawn or camera.is_f1))
    units = np.stack([np.pad(refined(opening.mask, fine.times), fine.rim) for opening in panel.openings])
    if drawn:
        return lay(name, units, room=fine.room)
    cells = fine.room.cells
    if min(rows, columns) < cells:
        raise JobError(
            "MF122",
            f"{name} has {columns} x {rows} cells of {panel.cell_size.pitch_um:g} um, fewer than the {cells} x {cells} "
            f"that cover a stop of {camera.stop.diameter_um:g} um",
            where=name,
            cure=f"Use a die of at least {cells * panel.pitch_nm / 1e6:.3g} mm",
        )
    bottom, left = (rows - cells) // 2, (columns - cells) // 2
    middle = panel.orientations[bottom : bottom + cells, left : left + cells]
    return lay(name, units, middle, room=fine.room)


def _finer(name: str, panel: Panel, camera: PhotoCamera, *, odd: bool) -> _Finer:
    half = panel.gutter_nm // 2
    dot_nm = math.gcd(panel.dot_nm, half) if half else panel.dot_nm
    times = panel.dot_nm // dot_nm
    dots = panel.pitch_nm // dot_nm
    try:
        return _Finer(times, half // dot_nm, lattice(dots, dot_nm, camera=camera, odd=odd, where=name))
    except JobError as error:
        if times == 1 or error.code != "MF115":
            raise
        raise JobError(
            "MF115",
            f"half a gutter of {half / NM_PER_UM:g} um and dots of {panel.dot_nm / NM_PER_UM:g} um are whole only on "
            f"dots of {dot_nm / NM_PER_UM:g} um, too many behind a stop of {camera.stop.diameter_um:g} um; the limit "
            f"is {MOST_DOTS} along a side",
            where=name,
            cure="Make the gutter an even number of dots wide",
        ) from error
