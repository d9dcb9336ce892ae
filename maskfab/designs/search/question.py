"""A search's question and what answers it: judges of openings and panels, rules, a first opening, and clocks of stages.

Judges in focus are a surrogate, and the error of panels by it. Over the distances of a scene the mean over one of each
for every distance counts, each photograph restored by its own blur.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING

from maskfab.base.arrays import Mask
from maskfab.base.errors import JobError
from maskfab.base.files import Kept
from maskfab.base.model import Tiling
from maskfab.base.processes import ALONE, SerialExecutor
from maskfab.base.work import NO_END, Clock, Progress, silent
from maskfab.camera.scenes import Photograph
from maskfab.camera.stop_cells import F1, CellGrid, PhotoCamera, lattice
from maskfab.designs.maps.alternation import require_places
from maskfab.designs.maps.orientation_map import require_size
from maskfab.designs.model.appraisal import EXACT, SceneConditions, Spread
from maskfab.designs.model.expected_psnr import Surrogate, surrogate_of
from maskfab.designs.model.panel_judgement import MeanPanelError, PanelError
from maskfab.designs.model.statistics import F1_SETTINGS, CaptureSettings, SceneStatistics, scene_statistics
from maskfab.designs.rules.constraints import Constraints
from maskfab.designs.rules.display_fit import OF_THE_EYE, Display
from maskfab.designs.search.annealing import ExpectedPsnr
from maskfab.designs.search.die_look import DieLook
from maskfab.designs.search.held import EASE, Start, require_held, start_of
from maskfab.designs.search.result import Facts, Stages, camera_facts, constraints_of, origin, run_key
from maskfab.designs.search.scan import allowed, first_shape
from maskfab.job.sections import SearchSection

if TYPE_CHECKING:
    from maskfab.designs.model.panel_error import PupilError


MAP_LEAK_SCENES = 8
"""Scenes whose leak a map is designed on: on fewer it fits the very edges of those, and gains a tenth of a decibel less
on any others."""


@dataclass(frozen=True, eq=False)
class Question:
    """Everything that a search is asked.

    Attributes:
        command: that asked it, for the provenance of what is found.
        display: that the opening must hold; None for any or none.
        spread: over which the panel is appraised.
        clock: ends every stage in time for those after it; bounds, appraisals and alternatives are left out where
            they would take most of what is left.
        checkpoint: file to go on from, and to keep.
        price_rules: anneal once more without each rule, beyond the budget.
        begin: opening that the search begins at in place of a scan of families, bool [dots, dots].
        executor: shares with others what takes long: the judging of shapes, quick maps and bounds.
    """

    section: SearchSection
    scenes: Sequence[Photograph]
    command: str
    progress: Progress = silent
    camera: PhotoCamera = F1
    settings: CaptureSettings = F1_SETTINGS
    display: Display | None = None
    spread: Spread = EXACT
    seen: SceneConditions | None = None
    clock: Clock = NO_END
    checkpoint: Path | None = None
    price_rules: bool = False
    begin: Mask | None = None
    executor: SerialExecutor = ALONE

    @property
    def made_for(self) -> Facts:
        """The camera and the light, as provenance."""
        return camera_facts(self.camera, self.settings, self.seen)

    @property
    def kept(self) -> Kept | None:
        """The checkpoint, under the key of this question."""
        if self.checkpoint is None:
            return None
        begun = () if self.begin is None else (self.begin.tobytes(),)
        return Kept(self.checkpoint, run_key(self.section, self.scenes, *self.made_for.values(), *begun))


@dataclass(frozen=True, eq=False)
class Judges:
    """Judges of a search's openings and panels, each made when it is first asked for.

    Attributes:
        seen: conditions of the scene; None where nothing of it must be modelled.

    Raises:
        JobError: MF121 for scenes without a spectrum; MF104, MF105 for weights that are none, when a judge is made.
    """

    section: SearchSection
    scenes: Sequence[Photograph]
    room: CellGrid
    settings: CaptureSettings
    seen: SceneConditions | None = None
    leak_scenes: int = 2

    @cached_property
    def estimate(self) -> Surrogate:
        """Surrogate of openings, in focus."""
        return surrogate_of(self._statistics, self.room)

    @cached_property
    def expected(self) -> ExpectedPsnr:
        """Judge of openings, over the distances of the scene."""
        periodic = self.section.tiling is Tiling.PERIODIC
        return ExpectedPsnr(
            self.estimate, periodic, self.settings.levels, self.section.weights or (), self._at_distances
        )

    @cached_property
    def in_focus(self) -> PupilError:
        """Judge of panels, in focus."""
        from maskfab.designs.model.panel_error import pupil_error

        return pupil_error(self.estimate, weights=self.section.weights)

    @cached_property
    def by_distance(self) -> tuple[PupilError, ...]:
        """Judges of panels at the distances of the scene; none where light has no phase nor scale of its own there."""
        from maskfab.designs.model.panel_error import pupil_error

        return tuple(pupil_error(estimate, weights=self.section.weights) for estimate in self._at_distances)

    @property
    def panel(self) -> PanelError:
        """Judge of panels, over the distances of the scene."""
        return MeanPanelError(self.by_distance) if self.by_distance else self.in_focus

    @cached_property
    def _statistics(self) -> SceneStatistics:
        return scene_statistics(self.scenes, leak_scenes=self.leak_scenes, settings=self.settings)

    @cached_property
    def _at_distances(self) -> tuple[Surrogate, ...]:
        if self.seen is None or not self.seen.turns_light:
            return ()
        room, line = self.seen.behind(self.room), self.room.camera.middle_nm
        phases = (self.seen.waves(distance, line) for distance in self.seen.distances_um)
        # Code values and light lie apart by what they do in focus, so that distances compare as their errors do.
        return tuple(
            replace(surrogate_of(self._statistics, room, waves), noise=self.estimate.noise) for waves in phases
        )


@dataclass(frozen=True, eq=False)
class Prepared:
    """A question made ready: what every stage of the search works with.

    Attributes:
        section, rules: as the search goes on with them.
        room: the cells before the stop.
        map_judges: of panels, by the scenes that maps are designed on.
        panel: the judge of panels; None where no map is asked for.
        start: the first opening that the display fits; None where none is sought.
        look: at a die that ends the design; None without a display.
    """

    question: Question
    section: SearchSection
    rules: Constraints
    room: CellGrid
    judges: Judges
    map_judges: Judges
    panel: PanelError | None
    start: Start | None
    stages: Stages
    look: DieLook | None

    @property
    def made(self) -> Facts:
        """Provenance of what is found."""
        return origin(self.section, self.question.command, self.question.made_for)

    def of_count(self, clear_dots: int) -> Iterator[Mask]:
        """Openings of so many clear dots, the best first, for a panel of two."""
        other, sought = self.section.model_copy(update={"clear_dots": clear_dots}), self.section.density == "search"
        held = replace(self.rules.on_any_map.without(*OF_THE_EYE) if sought else self.rules, clear_dots=clear_dots)
        return allowed(other, held, self.judges.expected, self.stages.map, self.question.progress, once=sought)


def prepare(question: Question) -> Prepared:
    """Judges, rules and clocks of a question; errors as of :func:`maskfab.designs.search.search.search`."""
    progress, clock, display = question.progress, question.clock, question.display
    rules = constraints_of(question.section, display=display)
    room = room_of(question.section, rules, question.camera)
    section, rules, start = started(question.section, rules, display, clock, progress, begun=question.begin is not None)
    progress("photographs", 0, 1)
    judges = Judges(section, question.scenes, room, question.settings, question.seen)
    expected = judges.expected
    progress("photographs", 1, 1)
    map_judges = judges if section.map is None else replace(judges, leak_scenes=MAP_LEAK_SCENES)
    # Made before the stages have their time, for it takes some.
    panel = None if section.map is None else map_judges.panel
    stages, look = _stages(section, rules, expected, display, start, clock)
    return Prepared(question, section, rules, room, judges, map_judges, panel, start, stages, look)


def for_any_map(section: SearchSection) -> bool:
    """Whether a map of one opening is designed, by photographs."""
    return section.map is not None and section.density is None


def started(
    section: SearchSection,
    rules: Constraints,
    display: Display | None,
    clock: Clock,
    progress: Progress,
    *,
    begun: bool = False,
) -> tuple[SearchSection, Constraints, Start | None]:
    """The section and its rules as the search goes on with them, and the first opening that a display fits.

    That is sought where a map of one opening is designed; elsewhere openings are asked as they come, unless none fits
    of those that a scan would judge. There is no scan where the search has ``begun`` at an opening.

    Raises:
        JobError, OpeningError: MF123, MF203, MF204 for rules that contradict each other, and for a display that was
            found to fit openings of no number of dots.
    """
    if display is None or not for_any_map(section):
        rules.require_possible()
        if display is not None and not begun:
            require_held(rules, section.families, clock, progress)
        return section, rules, None
    start = start_of(rules, section.families, clock, progress)
    if start is None:
        rules.require_possible()
        what = f"no opening of 1 to {section.clear_dots} clear dots was found beside which the display fits"
        raise JobError("MF123", what, where="design.fit", cure=EASE)
    counted = {"clear_dots": start.rules.clear_dots, "families": start.families}
    return section.model_copy(update=counted), start.rules, start


def room_of(section: SearchSection, rules: Constraints, camera: PhotoCamera, *, where: str = "dots") -> CellGrid:
    """The cells before the stop, refused where no map of them can be designed as asked."""
    room = lattice(section.dots, rules.dot_nm, camera=camera, where=where)
    if section.map is not None:
        require_size(room)
    if section.positions > 1:
        require_places(rules)
    return room


def _stages(
    section: SearchSection,
    rules: Constraints,
    expected: ExpectedPsnr,
    display: Display | None,
    start: Start | None,
    clock: Clock,
) -> tuple[Stages, DieLook | None]:
    """Clocks of the stages of a design, and the look at a die that ends it, if a display must fit one."""
    unit = first_shape(section)
    first = unit if start is None else start.first.unit
    look = None if display is None else DieLook.of(display, clock, first, rules.dot_nm)
    die_s = 0.0 if look is None else look.seconds
    mapped, fitted = section.map is not None, look is not None
    return Stages.of(expected, unit, clock, mapped=mapped, fitted=fitted, die_s=die_s), look
