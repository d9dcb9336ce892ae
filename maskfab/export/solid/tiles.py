"""Parts of the solids of a die: thicknesses, the glass, and the rigid placements of its cells.

A film centred on z = 0 is its own mirror image in z, so half a turn about an in-plane axis acts on it as a mirror does:
all eight orientations of an opening are rigid placements of one tile, and nothing needs a mirrored solid.

Coordinates are nanometres from the centre of the die's slot; z points away from the glass.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Literal

import numpy as np

from maskfab.base.arrays import Floats
from maskfab.errors import OutputError
from maskfab.geometry.polygonize import outline
from maskfab.geometry.unit_cell import unit_name
from maskfab.model import ORIENTATIONS, Die, Panel
from maskfab.units import UM_PER_NM

CHROME_RGB = (0.55, 0.56, 0.60)
GLASS_RGB = (0.70, 0.85, 0.90)
GLASS_ALPHA = 0.3
MOST_CAD_VERTICES, MOST_CAD_CELLS = 4_000, 40_000
"""Of exact solids: the cut of an outline takes 0.5 s for 230 vertices, 8 s for 2200; a thousand cells take 0.6 s."""
MOST_MESH_VERTICES = 1_500_000
"""Of the outlines of all cells: a mesh has four times as many triangles."""
_NARROWEST_CORNER_NM, _CORNER_SHARE, _WIDEST_CORNER_SHARE = 10.0, 0.1, 2 / 3
"""Of a gap or neck at a corner: what float32 millimetres keep apart, and shares of a dot, by default and at most."""


@dataclass(frozen=True)
class Stack:
    """Thicknesses of a mask.

    Attributes:
        chrome_nm: of the film.
        glass_nm: of the substrate.
        exaggeration: factor on the film's thickness, for viewers that cannot show 100 nm; files say so.
        corners: what openings that touch by a corner get in a mesh: a gap of chrome between them, or a neck that joins
            them. No closed surface has a corner of no width.
        corner_nm: width of that; a tenth of a dot if None.
    """

    chrome_nm: float = 100.0
    glass_nm: float = 2_300_000.0
    exaggeration: float = 1.0
    corners: Literal["gap", "neck"] = "gap"
    corner_nm: float | None = None

    @property
    def film_nm(self) -> float:
        """Thickness of the film as drawn, from -film/2 to film/2; the glass lies below it."""
        return self.chrome_nm * self.exaggeration

    def corner_leg_nm(self, die: Die) -> int:
        """Distance from a corner that touches to where its gap or neck ends on the sides of the openings.

        Raises:
            OutputError: MF436 for a gap or neck below 10 nm, or above two thirds of a dot, which would meet the next.
        """
        dot_nm = die.panel.dot_nm
        width = _CORNER_SHARE * dot_nm if self.corner_nm is None else self.corner_nm
        widest = math.floor(_WIDEST_CORNER_SHARE * dot_nm)
        if not _NARROWEST_CORNER_NM <= width <= widest:
            raise OutputError(
                "MF436",
                f"openings touch by a corner, and a {self.corners} of {width:g} nm there is not within "
                f"{_NARROWEST_CORNER_NM:g} nm and {widest} nm, two thirds of a dot",
                where=f"die {die.name}",
                cure="State one that is, or leave glb, 3mf and stl out of export.formats",
            )
        return round(width / math.sqrt(2))

    def touching_remark(self, die: Die, touches: int) -> tuple[str, ...]:
        """Remark of a mesh about so many corners that touched."""
        if not touches:
            return ()
        width_um = self.corner_leg_nm(die) * math.sqrt(2) * UM_PER_NM
        return (f"{touches} touching corners have a {self.corners} of {width_um:.3g} um",)

    def remarks(self) -> tuple[str, ...]:
        """Remarks of a file about its thicknesses."""
        said = f"chrome {self.chrome_nm:g} nm on {self.glass_nm / 1e6:g} mm of glass"
        return (said,) if self.exaggeration == 1 else (said, f"film drawn {self.exaggeration:g} times too thick")


def rotation(orientation: int) -> Floats:
    """float64 [3, 3] of determinant 1 that places a tile as :func:`maskfab.model.orient` turns its opening."""
    flip = np.diag([-1.0, 1.0, -1.0]) if orientation >= 4 else np.eye(3)
    quarter = np.array([[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])
    turn: Floats = np.linalg.matrix_power(quarter, orientation % 4) @ flip
    return turn


def units_in_use(panel: Panel) -> tuple[int, ...]:
    """Entries (8 u + k) of the cells in use, ascending."""
    return tuple(int(cell) for cell in np.unique(panel.orientations))


def openings_in_use(panel: Panel) -> tuple[int, ...]:
    """Indices into ``panel.openings`` of those that at least one cell holds, ascending."""
    return tuple(sorted({cell // ORIENTATIONS for cell in units_in_use(panel)}))


def unit_names(panel: Panel) -> dict[int, str]:
    """A name for every unit in use, no two alike, those of :func:`maskfab.geometry.unit_cell.unit_name` where they
    serve."""
    names: dict[int, str] = {}
    for cell in units_in_use(panel):
        name = "".join(unit_name(panel, cell))
        names[cell] = f"{name}_{cell // ORIENTATIONS}" if name in names.values() else name
    return names


def centres_nm(die: Die) -> Floats:
    """Centre of every cell, float64 [rows, columns, 2] of x, y from the slot's centre."""
    rows, columns = die.panel.orientations.shape
    x0, y0 = (origin - centre for origin, centre in zip(die.origin_nm, die.centre_nm, strict=True))
    x, y = ((np.arange(n) + 0.5) * die.panel.pitch_nm + low for n, low in ((columns, x0), (rows, y0)))
    return np.stack(np.meshgrid(x, y), axis=-1)


def cells(die: Die) -> Iterator[tuple[str, int, Floats]]:
    """Name, unit and centre (nm, z = 0) of every cell, row by row from below."""
    rows = zip(centres_nm(die), die.panel.orientations.tolist(), strict=True)
    for row, (centres, units) in enumerate(rows):
        for column, (centre, unit) in enumerate(zip(centres, units, strict=True)):
            yield f"R{row}C{column}", unit, np.append(centre, 0.0)


def holes_nm(panel: Panel, opening: int) -> list[Floats]:
    """Outlines of an opening, float64 [n, 2] each, from the cell's centre, not turned."""
    shift = (panel.gutter_nm - panel.pitch_nm) / 2
    return [np.array(polygon) + shift for polygon in outline(panel.openings[opening].mask, panel.dot_nm)]


def glass(die: Die, stack: Stack) -> tuple[Floats, Floats]:
    """Lower and upper corner of the substrate under a panel, float64 [3] each."""
    x0, y0, x1, y1 = die.box_nm
    x, y = die.centre_nm
    top = -stack.film_nm / 2
    return np.array([x0 - x, y0 - y, top - stack.glass_nm]), np.array([x1 - x, y1 - y, top])


def check_solid_size(die: Die, kind: str, most_vertices: int, most_cells: int) -> None:
    """Refuse what a solid modeller cannot make, or not in reasonable time, before any work starts.

    Raises:
        OutputError: MF410 if a cell has no chrome at all; MF412 if the outlines of the openings in use have more than
            ``most_vertices`` vertices together, or the panel more than ``most_cells`` cells.
    """
    _check_chrome(die, kind)
    size = die.panel.orientations.size
    if size > most_cells:
        raise _too_large(die, kind, f"{size} cells are more than the {most_cells}")
    vertices = sum(_vertices(die.panel, opening) for opening in openings_in_use(die.panel))
    if vertices > most_vertices:
        raise _too_large(die, kind, f"outlines of {vertices} vertices are more than the {most_vertices}")


def check_mesh_size(die: Die, kind: str) -> None:
    """As :func:`check_solid_size`, of a mesh, which repeats the outlines of every cell.

    Raises:
        OutputError: MF410 if a cell has no chrome at all; MF412 for more than :data:`MOST_MESH_VERTICES`.
    """
    _check_chrome(die, kind)
    used, times = np.unique(die.panel.orientations // ORIENTATIONS, return_counts=True)
    vertices = sum(_vertices(die.panel, opening) * n for opening, n in zip(used.tolist(), times.tolist(), strict=True))
    if vertices > MOST_MESH_VERTICES:
        what = f"outlines of {vertices} vertices in all cells are more than the {MOST_MESH_VERTICES}"
        raise _too_large(die, kind, what, ", use step, which places every cell")


def _vertices(panel: Panel, opening: int) -> int:
    return sum(map(len, outline(panel.openings[opening].mask, panel.dot_nm)))


def _check_chrome(die: Die, kind: str) -> None:
    panel = die.panel
    for opening in openings_in_use(panel):
        if panel.gutter_nm == 0 and panel.openings[opening].mask.all():
            raise OutputError(
                "MF410",
                f"opening {panel.openings[opening].name} is clear all over its cell, so no chrome is left for a {kind}",
                where=f"die {die.name}",
                cure=f"Leave {kind} out of export.formats, or give the panel a gutter",
            )


def _too_large(die: Die, kind: str, what: str, instead: str = "") -> OutputError:
    cure = f"Leave {kind} out of export.formats for this die{instead}, or lay out a smaller panel"
    return OutputError("MF412", f"{what} of a {kind}", where=f"die {die.name}", cure=cure)
