"""A die as an object of cadquery and of trimesh: the same solids in the same places, made by two libraries."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from maskfab.base.errors import OutputError
from maskfab.base.model import Die, Opening, Panel, Tiling
from maskfab.mask.formats.format import Stack
from maskfab.mask.formats.step import cadquery_assembly, trimesh_scene

STACK = Stack(chrome_nm=20_000.0)


def die(mask: np.ndarray) -> Die:
    orientations = np.array([[0, 1, 2, 3], [4, 5, 6, 7]])
    panel = Panel(Opening("LOPSIDED", mask, 8000), 8000, 2000, orientations, Tiling.RANDOM, 1)
    return Die("D1", "a die", panel, (3_000_000, -2_000_000), 400_000)


@pytest.fixture(scope="module")
def lopsided() -> Die:
    """Two dots that meet at a corner, and a bar, so that no orientation looks like another."""
    mask = np.zeros((5, 5), dtype=np.bool_)
    mask[0, 0] = mask[1, 1] = True
    mask[3, 1:4] = True
    return die(mask)


def test_two_libraries_hold_the_same_solids_in_the_same_places(lopsided: Die) -> None:
    """Volume and centre of mass of glass and film; a cell turned wrongly would move the film's."""
    stack = replace(STACK, corner_nm=10.0)
    assembly, scene = cadquery_assembly(lopsided, stack), trimesh_scene(lopsided, stack)
    solids = {child.name: child.obj.val().moved(child.loc) for child in assembly.children}
    assert solids.keys() == {"GLASS", *(f"R{r}C{c}" for r in (0, 1) for c in range(4))}
    assert set(scene.graph.nodes_geometry) == {"GLASS", "FILM"}
    tiles = [solid for name, solid in solids.items() if name != "GLASS"]
    for name, parts in (("GLASS", [solids["GLASS"]]), ("FILM", tiles)):
        place, geometry = scene.graph[name]
        mesh = scene.geometry[geometry].copy().apply_transform(place)
        assert mesh.is_watertight
        assert all(part.isValid() for part in parts)
        volumes = np.array([part.Volume() for part in parts])
        centres = np.array([part.Center().toTuple() for part in parts])
        # A gap of 10 nm in the place of each corner that touches is all that differs.
        assert mesh.volume == pytest.approx(volumes.sum(), rel=1e-7)
        np.testing.assert_allclose(volumes @ centres / volumes.sum(), mesh.center_mass, atol=1e-7)
    panel = lopsided.panel
    film_mm3 = 20e-3 * (panel.pitch_nm**2 - 5 * panel.dot_nm**2) * 1e-12
    assert solids["R0C0"].Volume() == pytest.approx(film_mm3, rel=1e-9)


def test_a_cell_without_chrome_is_refused_by_both() -> None:
    clear = die(np.ones((5, 5), dtype=np.bool_))
    bare = Die(
        "D1", "a die", Panel(clear.panel.opening, 8000, 0, clear.panel.orientations, Tiling.RANDOM, 1), (0, 0), 400_000
    )
    for made in (cadquery_assembly, trimesh_scene):
        with pytest.raises(OutputError, match="MF410"):
            made(bare, STACK)
