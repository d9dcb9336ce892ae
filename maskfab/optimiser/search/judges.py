"""Judgement of a search's openings and panels: by its photographs, its camera, its light and its scene.

In focus it is a surrogate, and the error of panels by it. Over the distances of a scene it is the mean over one of each
for every distance, each photograph restored by its own blur.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

from maskfab.camera.photographs import Photograph
from maskfab.camera.transfer import CellGrid
from maskfab.jobfile import SearchSection
from maskfab.model import Tiling
from maskfab.optimiser.model.expected_psnr import Surrogate, surrogate_of
from maskfab.optimiser.model.layout_error import PanelError, PupilError, pupil_error
from maskfab.optimiser.model.over_distances import OverDistances
from maskfab.optimiser.model.scene_conditions import SceneConditions
from maskfab.optimiser.model.scene_statistics import SceneStatistics, scene_statistics
from maskfab.optimiser.model.taking import Taking
from maskfab.optimiser.rules.discrete import ExpectedPsnr

MAP_LEAK_SCENES = 8
"""Scenes whose leak a map is designed on: on fewer it fits the very edges of those, and gains a tenth of a decibel less
on any others."""


@dataclass(frozen=True, eq=False)
class Judges:
    """Each judge is made when it is first asked for.

    Attributes:
        section: of a job.
        scenes: photographs whose spectrum and edges count.
        room: cells before the stop.
        taking: of the photographs.
        seen: conditions of the scene; None where nothing of it must be modelled.
        leak_scenes: pictures that the leak is computed on.

    Raises:
        JobError: MF121 for scenes without a spectrum; MF104, MF105 for weights that are none, when a judge is made.
    """

    section: SearchSection
    scenes: Sequence[Photograph]
    room: CellGrid
    taking: Taking
    seen: SceneConditions | None = None
    leak_scenes: int = 2

    @cached_property
    def estimate(self) -> Surrogate:
        """Of openings, in focus."""
        return surrogate_of(self._known, self.room)

    @cached_property
    def expected(self) -> ExpectedPsnr:
        """Of openings, over the distances of the scene."""
        periodic = self.section.tiling is Tiling.PERIODIC
        return ExpectedPsnr(self.estimate, periodic, self.taking.levels, self.section.weights or (), self._at_distances)

    @cached_property
    def in_focus(self) -> PupilError:
        """Of panels, in focus."""
        return pupil_error(self.estimate, weights=self.section.weights)

    @cached_property
    def by_distance(self) -> tuple[PupilError, ...]:
        """Of panels at every distance of the scene; none where light has no phase nor scale of its own at any."""
        return tuple(pupil_error(each, weights=self.section.weights) for each in self._at_distances)

    @property
    def panel(self) -> PanelError:
        """Of panels, over the distances of the scene."""
        return OverDistances(self.by_distance) if self.by_distance else self.in_focus

    @cached_property
    def _known(self) -> SceneStatistics:
        return scene_statistics(self.scenes, leak_scenes=self.leak_scenes, taking=self.taking)

    @cached_property
    def _at_distances(self) -> tuple[Surrogate, ...]:
        if self.seen is None or not self.seen.turns_light:
            return ()
        there, line = self.seen.behind(self.room), self.room.camera.middle_nm
        waves = (self.seen.waves(each, line) for each in self.seen.distances_um)
        # Code values and light lie apart by what they do in focus, so that distances compare as their errors do.
        return tuple(replace(surrogate_of(self._known, there, each), noise=self.estimate.noise) for each in waves)
