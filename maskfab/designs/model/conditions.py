"""The panel of a designed opening on a die: its map in the middle, all beyond it drawn as its tiling draws it.

Conditions that a design is for: what a job's [scene] has of distances and places, as far as its plan models it.

A photograph is of one distance, by the plan's ends of the depth and the focus between them, and shows the field. Means
over it are those of five points of a disc, exact up to third powers: its middle, by 1/4, and four at sqrt(2/3) of the
largest image height along the axes, by 3/16 each.

The plan is that of a stand-in, the first shape of the search on a random tiling, for no opening is known yet.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from maskfab.base.model import Camera, Opening, Panel, Tiling
from maskfab.base.units import NM_PER_UM
from maskfab.camera.die_transfer import die_transfer
from maskfab.camera.lens import CellGrid
from maskfab.camera.protocol import by_plan
from maskfab.job.values import distance_text, um_text
from maskfab.mask.panels import CellMap, panel_shape, placed, shifted_openings
from maskfab.optics.gap import AXIS, Place, gap_guard_um, shift_um
from maskfab.optics.phase import image_distance_um
from maskfab.optics.scene.plan import Plan, plan
from maskfab.optics.scene.point_images import phase_waves
from maskfab.optics.scene.scene import Scene
from maskfab.optics.stop import Waves
from maskfab.optics.tiling import orientations

_WHERE = "design"


def designed_panel(
    unit: NDArray[np.bool_],
    dot_nm: int,
    *,
    tiling: Tiling,
    seed: int,
    across: int,
    given: CellMap | None = None,
    outer: NDArray[np.bool_] | None = None,
) -> Panel:
    """Lay an opening, or two, on a die.

    Args:
        unit: bool [dots, dots].
        dot_nm: side of a dot.
        tiling: of the cells; where there is a map, of what is meant by it.
        seed: of all that is drawn.
        across: cells along the die's side.
        given: the map; None for a die of the tiling alone.
        outer: the sparser opening of two, bool [dots, dots].
    """
    openings = (Opening("unit", unit, dot_nm), *(() if outer is None else (Opening("outer", outer, dot_nm),)))
    if given is None:
        held = orientations(tiling, across, across, seed, openings=len(openings))
    else:
        openings = shifted_openings(given, openings, where=_WHERE)
        rows, columns = panel_shape(given, across, across)
        held = placed(given, rows, columns, seed, openings=len(openings), where=_WHERE)
    return Panel(openings[0], dot_nm, 0, held, tiling, seed, others=openings[1:])


_FIELD = ((AXIS, 1 / 4), ((1.0, 0.0), 3 / 16), ((-1.0, 0.0), 3 / 16), ((0.0, 1.0), 3 / 16), ((0.0, -1.0), 3 / 16))
_AT = math.sqrt(2 / 3)
_SAMPLES = 4
"""For each dot, over whose finest waves a panel shows what comes through a gap."""
_NOT_OF_SCENE = ("curve of the rim", "the layout itself")


@dataclass(frozen=True)
class Condition:
    """One place of one photograph.

    Attributes:
        object_um: distance of all that is photographed.
        image_um: place on the sensor, from the axis to the right and down the picture.
        weight: its share of all; they sum to 1.
    """

    object_um: float
    image_um: Place
    weight: float


@dataclass(frozen=True, eq=False)
class SceneConditions:
    """A job's scene before its camera, and what of it must be modelled.

    Attributes:
        camera: of the job.
        scene: of the job, the plate's glass in its gap.
        plan: of a stand-in.
    """

    camera: Camera
    scene: Scene
    plan: Plan

    @classmethod
    def planned(
        cls, camera: Camera, scene: Scene, accuracy: float, shape: NDArray[np.bool_], room: CellGrid
    ) -> SceneConditions:
        """Conditions by the plan for a shape, bool [dots, dots], whose cells are turned at random.

        Raises:
            JobError: as :func:`maskfab.optics.scene.plan.plan`, and :func:`maskfab.camera.die_transfer.die_transfer`
                for all that is photographed; MF115 for a phase that turns too much over a dot.
        """
        across = cells_across(camera, scene, room)
        dot_nm = round(room.dot_um * NM_PER_UM)
        panel = designed_panel(shape, dot_nm, tiling=Tiling.RANDOM, seed=0, across=across)
        made = cls(camera, scene, plan(panel, camera, scene, accuracy))
        for distance in made.distances_um if made.needed else ():
            waves = made.waves(distance, room.camera.middle_nm)
            if waves is not None:
                made.behind(room).turned(waves)
            die = die_transfer("the design", panel, camera, scene, made.plan, object_um=distance)
            for place, _ in made.places:
                die.at(place)
        return made

    @property
    def needed(self) -> bool:
        """Whether the plan models anything that openings are compared by."""
        choice = self.plan.choice
        return choice.scale or choice.defocus or choice.aberrations or choice.diffraction or choice.places > 1

    @cached_property
    def distances_um(self) -> tuple[float, ...]:
        """Of objects in photographs, ascending."""
        near, far, focus = self.scene.nearest_um, self.scene.farthest_um, self.scene.focus_um
        if not self.plan.choice.defocus:
            return (focus,)
        return tuple(sorted({near, far, *([focus] if near < focus < far else [])}))

    @cached_property
    def places(self) -> tuple[tuple[Place, float], ...]:
        """Of a photograph, each with its share; the axis first."""
        if self.plan.choice.places == 1:
            return ((AXIS, 1.0),)
        reach = _AT * self.scene.field_um
        return tuple(((reach * x, reach * y), share) for (x, y), share in _FIELD)

    def __iter__(self) -> Iterator[Condition]:
        """All of them, distance by distance."""
        for distance in self.distances_um:
            for place, share in self.places:
                yield Condition(distance, place, share / len(self.distances_um))

    @property
    def turns_light(self) -> bool:
        """Whether light at the axis has a phase, or a scale, of its own at any distance: a gap alone gives none."""
        choice = self.plan.choice
        return choice.scale or choice.defocus or choice.aberrations

    def waves(self, object_um: float, wavelength_nm: float) -> Waves | None:
        """Phase of light from a distance at the stop; None for none."""
        return phase_waves(self.plan.choice, self.camera, self.scene, wavelength_nm, object_um)

    def behind(self, room: CellGrid) -> CellGrid:
        """The cells before the camera as it is focused."""
        if not self.plan.choice.scale:
            return room
        distance = image_distance_um(self.camera.focal_um, self.scene.focus_um)
        return replace(room, camera=replace(room.camera, focal_um=distance))

    @property
    def modelled(self) -> tuple[str, ...]:
        """Names of what the plan models of the scene."""
        rows = self.plan.ingredients
        return tuple(row.name for row in rows if row.modelled and row.error and row.name not in _NOT_OF_SCENE)

    @property
    def line(self) -> str:
        """In words, exactly: the stated lengths, and what is modelled."""
        scene, told = self.scene, []
        if self.plan.choice.defocus or self.plan.choice.scale:
            near, far, focus = (distance_text(each) for each in (scene.nearest_um, scene.farthest_um, scene.focus_um))
            told.append(f"depth {near} to {far}, focus {focus}")
        if scene.gap_um:
            told.append(f"gap {um_text(scene.gap_um)}")
        if scene.gap_um and scene.field_um:
            told.append(f"field {um_text(scene.field_um)}")
        if self.plan.choice.aberrations:
            told.append(f"aberrations {', '.join(f'{waves:g} of {term}' for term, waves in scene.aberrations)}")
        return f"{'; '.join(told)}; modelled: {', '.join(self.modelled)}"

    @property
    def neglected(self) -> tuple[str, ...]:
        """Sentences on what the plan leaves out of the scene."""
        return tuple(by_plan(self.scene, self.plan))


def cells_across(camera: Camera, scene: Scene, room: CellGrid) -> int:
    """Cells along a panel that covers the stop from every place, with room for light that a gap spreads; even or odd as
    those of ``room`` are.
    """
    moved = max(shift_um(camera, scene.gap_um, (scene.field_um, 0.0)))
    finest = room.dot_um / _SAMPLES
    spread = min(scene.gap_um, gap_guard_um(scene.gap_um, max(camera.wavelengths_nm), finest))
    return room.cells + 2 * math.ceil((moved + spread) / (room.dots * room.dot_um))
