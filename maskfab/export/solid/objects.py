"""Dies as objects of solid modellers, to go on with: an assembly of cadquery, a scene of trimesh. Both in millimetres.

The file formats have writers of their own, whose bytes are the same in every run.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from maskfab.base.arrays import Floats
from maskfab.export.solid.film import Mesh, box_mesh, film
from maskfab.export.solid.tiles import (
    CHROME_RGB,
    GLASS_ALPHA,
    GLASS_RGB,
    MOST_CAD_CELLS,
    MOST_CAD_VERTICES,
    Stack,
    cells,
    check_mesh_size,
    check_solid_size,
    glass,
    holes_nm,
    openings_in_use,
    rotation,
)
from maskfab.model import ORIENTATIONS, Die, Panel
from maskfab.units import MM_PER_NM

if TYPE_CHECKING:
    import cadquery
    import trimesh

_CHROME, _GLASS = (*CHROME_RGB, 1.0), (*GLASS_RGB, GLASS_ALPHA)


def cadquery_assembly(die: Die, stack: Stack | None = None) -> cadquery.Assembly:
    """A die as an assembly: ``GLASS``, and the film of each cell, ``R0C0`` onwards, under its rigid placement.

    Args:
        die: what to model; the centre of its slot is the origin, chrome lies round z = 0.
        stack: thicknesses; 100 nm of chrome on 2.3 mm of glass if None.

    Raises:
        OutputError: MF410 or MF412 as :func:`maskfab.export.solid.tiles.check_solid_size`.
    """
    stack = stack or Stack()
    check_solid_size(die, "cadquery assembly", MOST_CAD_VERTICES, MOST_CAD_CELLS)
    import cadquery

    low, high = glass(die, stack)
    size = (high - low) * MM_PER_NM
    substrate = cadquery.Workplane(obj=cadquery.Solid.makeBox(*size.tolist()))
    whole = cadquery.Assembly(name=die.name)
    whole.add(substrate, name="GLASS", loc=_location(low), color=cadquery.Color(*_GLASS))
    tiles = {opening: _film(die.panel, opening, stack) for opening in openings_in_use(die.panel)}
    for name, cell, centre in cells(die):
        opening, turn = divmod(cell, ORIENTATIONS)
        whole.add(tiles[opening], name=name, loc=_location(centre, turn), color=cadquery.Color(*_CHROME))
    return whole


def trimesh_scene(die: Die, stack: Stack | None = None) -> trimesh.Scene:
    """A die as a scene of two closed meshes, ``GLASS`` and ``FILM``: see :func:`maskfab.export.solid.film.film`.

    Args:
        die: what to model; the centre of its slot is the origin, chrome lies round z = 0.
        stack: thicknesses; 100 nm of chrome on 2.3 mm of glass if None.

    Raises:
        OutputError: MF410 or MF412 as :func:`maskfab.export.solid.tiles.check_mesh_size`; MF436 as
            :func:`maskfab.export.solid.film.film`.
    """
    stack = stack or Stack()
    check_mesh_size(die, "trimesh scene")
    import trimesh

    scene = trimesh.Scene(base_frame=die.name)
    scene.units = "millimeters"
    for name, mesh, colour in (("GLASS", box_mesh(*glass(die, stack)), _GLASS), ("FILM", film(die, stack)[0], _CHROME)):
        scene.add_geometry(_trimesh(mesh, colour), node_name=name, geom_name=name)
    return scene


def _film(panel: Panel, opening: int, stack: Stack) -> cadquery.Workplane:
    """The chrome of one cell, not turned: a box less a prism for each outline."""
    import cadquery

    side, thick = panel.pitch_nm * MM_PER_NM, stack.film_nm * MM_PER_NM
    box = cadquery.Solid.makeBox(side, side, thick, cadquery.Vector(-side / 2, -side / 2, -thick / 2))
    prisms = []
    for hole in holes_nm(panel, opening):
        corners = [cadquery.Vector(x, y, -thick) for x, y in (hole * MM_PER_NM).tolist()]
        outline = cadquery.Wire.makePolygon(corners, close=True)
        prisms.append(cadquery.Solid.extrudeLinear(outline, [], cadquery.Vector(0, 0, 2 * thick)))
    return cadquery.Workplane(obj=box.cut(*prisms) if prisms else box)


def _location(place_nm: Floats, orientation: int = 0) -> cadquery.Location:
    import cadquery
    from OCP.gp import gp_Trsf

    to = gp_Trsf()
    to.SetValues(*np.column_stack([rotation(orientation), place_nm * MM_PER_NM]).ravel().tolist())
    return cadquery.Location(to)


def _trimesh(mesh: Mesh, colour: tuple[float, float, float, float]) -> trimesh.Trimesh:
    import trimesh

    made = trimesh.Trimesh(mesh.vertices_nm * MM_PER_NM, mesh.triangles, process=False)
    made.visual.face_colors = [round(255 * part) for part in colour]
    return made
