"""Dies as objects of solid modellers, to go on with: an assembly of cadquery, a scene of trimesh. Both in millimetres.

The file formats have writers of their own, whose bytes are the same in every run.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from maskfab.export.solid.tiles import (
    CHROME_RGB,
    GLASS_ALPHA,
    GLASS_RGB,
    MOST_CAD_CELLS,
    MOST_CAD_VERTICES,
    MOST_MESH_CELLS,
    MOST_MESH_VERTICES,
    Floats,
    Mesh,
    Stack,
    box_mesh,
    cells,
    check_solid_size,
    films,
    glass,
    holes_nm,
    openings_in_use,
    rotation,
    unit_names,
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
    """A die as a scene: one closed mesh for each orientation in use, one node for each cell, and the glass.

    Args:
        die: what to model; the centre of its slot is the origin, chrome lies round z = 0.
        stack: thicknesses; 100 nm of chrome on 2.3 mm of glass if None.

    Raises:
        OutputError: MF410 or MF412 as :func:`maskfab.export.solid.tiles.check_solid_size`.
    """
    stack = stack or Stack()
    check_solid_size(die, "trimesh scene", MOST_MESH_VERTICES, MOST_MESH_CELLS)
    import trimesh

    names = unit_names(die.panel)
    scene = trimesh.Scene(base_frame=die.name)
    scene.units = "millimeters"
    scene.add_geometry(_trimesh(box_mesh(*glass(die, stack)), _GLASS), node_name="GLASS", geom_name="GLASS")
    chrome = {cell: _trimesh(mesh, _CHROME) for cell, mesh in films(die.panel, stack).items()}
    for name, cell, centre in cells(die):
        place = np.eye(4)
        place[:3, 3] = centre * MM_PER_NM
        scene.add_geometry(chrome[cell], node_name=name, geom_name=names[cell], transform=place)
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
