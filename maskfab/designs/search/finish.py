"""Judgement of a search's openings and panels: by its photographs, its camera, its light and its scene.

In focus it is a surrogate, and the error of panels by it. Over the distances of a scene it is the mean over one of each
for every distance, each photograph restored by its own blur.

The panel of a found opening: map, places inside the cell, turns of both, density.

A found panel in the conditions of its scene, beside one whose cells are turned at random.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

from maskfab.base.arrays import Mask
from maskfab.base.model import Panel, Tiling
from maskfab.base.work import Clock, Progress
from maskfab.camera.lens import CellGrid, lattice
from maskfab.camera.scenes import Photograph
from maskfab.designs.bounds.limits import map_gap
from maskfab.designs.maps.alternation import joint, laid
from maskfab.designs.maps.light import Graded, Groups, clustered, graded, most_dots
from maskfab.designs.maps.orientation_map import DesignedMap, MapMode, require_size
from maskfab.designs.model.conditions import SceneConditions, cells_across, designed_panel
from maskfab.designs.model.expected_psnr import Surrogate, surrogate_of
from maskfab.designs.model.panel_error import OverDistances, PanelError, PupilError, appraise_over, pupil_error
from maskfab.designs.model.statistics import CaptureSettings, SceneStatistics, scene_statistics
from maskfab.designs.rules.constraints import Constraints
from maskfab.designs.rules.display_fit import DieFit
from maskfab.designs.search.annealing import ExpectedPsnr
from maskfab.designs.search.result import Facts, SceneDesign, by_level
from maskfab.job.sections import SearchSection
from maskfab.mask.panels import CellMap
from maskfab.optics.tiling import orientations

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
        settings: of the photographs.
        seen: conditions of the scene; None where nothing of it must be modelled.
        leak_scenes: pictures that the leak is computed on.

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
        """Of openings, in focus."""
        return surrogate_of(self._known, self.room)

    @cached_property
    def expected(self) -> ExpectedPsnr:
        """Of openings, over the distances of the scene."""
        periodic = self.section.tiling is Tiling.PERIODIC
        return ExpectedPsnr(
            self.estimate, periodic, self.settings.levels, self.section.weights or (), self._at_distances
        )

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
        return scene_statistics(self.scenes, leak_scenes=self.leak_scenes, settings=self.settings)

    @cached_property
    def _at_distances(self) -> tuple[Surrogate, ...]:
        if self.seen is None or not self.seen.turns_light:
            return ()
        there, line = self.seen.behind(self.room), self.room.camera.middle_nm
        waves = (self.seen.waves(each, line) for each in self.seen.distances_um)
        # Code values and light lie apart by what they do in focus, so that distances compare as their errors do.
        return tuple(replace(surrogate_of(self._known, there, each), noise=self.estimate.noise) for each in waves)


_KICKS = 3
_LONGEST = 20


@dataclass(frozen=True, eq=False)
class Mapped:
    """A panel's opening and its map.

    Attributes:
        unit: bool [dots, dots]; of two, the denser one.
        cells, designed: the map; None where none was asked for.
        outer: the sparser one of two, bool [dots, dots].
        psnr: expected restored PSNR in dB by level of a panel of two; one is judged without its panel, and has None.
        head_room: by level, dB that no layout of as many dots and as much light can gain over the map; None without a
            map, for a panel of two, over several distances, and where the budget leaves no time for bounds.
        notes: what a user should know, as sentences.
        cut: the budget cut it short.
        fit: of the display on a die, for a panel of two that must hold one.
    """

    unit: Mask
    cells: CellMap | None = None
    designed: DesignedMap | None = None
    outer: Mask | None = None
    psnr: tuple[float, ...] | None = None
    head_room: tuple[float, ...] | None = None
    notes: tuple[str, ...] = ()
    cut: bool = False
    fit: DieFit | None = None


def mapped(
    section: SearchSection,
    unit: Mask,
    rules: Constraints,
    estimate: Surrogate,
    error: PanelError | None,
    facts: Facts,
    find: Callable[[int], Iterable[Mask]],
    clock: Clock,
    progress: Progress,
    groups: Groups | None = None,
    *,
    bounded: bool = True,
) -> Mapped:
    """Lay the unit out as the section says.

    Args:
        section: of a job.
        unit: bool [dots, dots].
        rules: that every opening keeps.
        estimate: of the scenes.
        error: of panels, the same scenes; None where no map is wanted.
        facts: provenance of the map, to which its own is added.
        find: gives openings of so many clear dots, the best first, for a panel of two.
        clock: a map whose time is over is taken as it is after its first steps, which bring most of the gain.
        progress: told where the work stands.
        groups: how groups of pixels are judged; None unless they share their light.
        bounded: prove what no other map gains.

    Raises:
        JobError: MF115 for a map of too many cells, or of cells of too many dots; MF123 for openings that break the
            rules beside one another, or at the places that they were to be moved to.
    """
    if section.map is None or error is None:
        return Mapped(unit)
    mode, seed = MapMode(section.map), map_seed(section)
    kicks = 0 if clock.over else _KICKS
    notes = ("The budget left the maps one descent each.",) if clock.over else ()
    if section.density is not None:
        made = graded(unit, error, section.density, find, constraints=rules, seed=seed, kicks=kicks, progress=progress)
        return _of_two(section, made, error, facts, "middle", notes)
    if groups is not None:
        most = most_dots(section)
        made = clustered(unit, error, most, find, groups, constraints=rules, seed=seed, kicks=kicks, progress=progress)
        return _of_two(section, made, error, facts, "pixels of a group", notes)
    both = joint(
        unit,
        error,
        rules,
        rounds=section.joint,
        seed=seed,
        mode=mode,
        kicks=kicks,
        positions=section.positions,
        clock=clock,
        progress=progress,
    )
    told = f"The budget ended the map after {both.designed.fields} steps of its last descent."
    notes = (told,) if clock.over else ()
    room = None
    # What bounds a panel in focus bounds no mean over distances.
    if isinstance(error, PupilError) and bounded:
        pupil = laid(both.unit, both.designed, error)
        room = map_gap(estimate, pupil, int(both.unit.sum()), both.designed.psnr).head_room
        facts = {**facts, **by_level("head_room", room, error.levels)}
    cells = map_of(section, error, both.designed, facts)
    return Mapped(both.unit, cells, both.designed, head_room=room, notes=notes, cut=bool(notes))


def map_seed(section: SearchSection) -> int:
    """Of the random map that a map starts from."""
    return section.seed if section.tiling_seed is None else section.tiling_seed


def _of_two(
    section: SearchSection, made: Graded, error: PanelError, facts: Facts, denser: str, notes: tuple[str, ...]
) -> Mapped:
    """Two openings at equal light, and what the display pays for them."""
    price = made.price
    known: Facts = {
        **facts,
        **by_level("graded_gain_db", made.gain_db, error.levels),
        "emitter_share_uniform": round(price.uniform_share, 4),
        "emitter_share": round(price.share, 4),
        "emitter_life_ratio": round(price.life_ratio, 4),
    }
    told = (
        f"The display pays for the denser {denser}: emitters, alike in all cells, of {price.share:.1%} of the pixel in "
        f"each colour instead of {price.uniform_share:.1%}, which live {price.life_ratio:.2f} as long at equal "
        "luminance."
    )
    if price.lines is not None:
        known["lines"] = price.lines
        told += f" {price.lines} lines each way pass both openings."
    cells = map_of(section, error, made.designed, known)
    dense, sparse = made.units
    known_psnr, said = made.designed.psnr, (*notes, told)
    return Mapped(dense, cells, made.designed, sparse, known_psnr, notes=said, cut=bool(notes), fit=made.fit)


def map_of(section: SearchSection, error: PanelError, designed: DesignedMap, facts: Facts) -> CellMap:
    """A designed map under its name, with its provenance added to that of its opening."""
    light = round(designed.clear_dots / designed.start_clear_dots - 1, 5) + 0.0
    known: Facts = {
        **facts,
        "mode": designed.mode.value,
        **by_level("gain_db", designed.gain_db, error.levels),
        "light": light,
    }
    return CellMap(f"{section.name[:_LONGEST]}_map", designed.orientations, known, designed.shifts)


def groups_of(panels: Judges, dot_nm: int) -> Groups | None:
    """Judgement of groups of pixels by the judges of single ones; None where they share no light."""
    section = panels.section
    if section.cluster is None:
        return None
    room = lattice(section.cluster * section.dots, dot_nm, camera=panels.room.camera)
    require_size(room)
    groups = replace(panels, room=room)
    return Groups(groups.expected, groups.panel)


def over_scene(section: SearchSection, laid: Mapped, dot_nm: int, judges: Judges, seen: SceneConditions) -> SceneDesign:
    """Appraise a panel in every condition.

    Args:
        section: of a job.
        laid: the panel.
        dot_nm: side of a dot.
        judges: of panels.
        seen: the conditions.

    Raises:
        JobError: as :func:`maskfab.designs.model.panel_error.appraise_over`.
    """
    errors = judges.by_distance or (judges.in_focus,)
    seed, across = map_seed(section), cells_across(seen.camera, seen.scene, judges.room)

    def panel(given: CellMap | None) -> Panel:
        return designed_panel(
            laid.unit, dot_nm, tiling=section.tiling, seed=seed, across=across, given=given, outer=laid.outer
        )

    found = appraise_over(panel(laid.cells), seen, errors)
    if laid.cells is None or laid.outer is not None:
        return SceneDesign(seen, found, None)
    drawn = orientations(section.tiling, judges.room.cells, judges.room.cells, seed)
    return SceneDesign(seen, found, appraise_over(panel(CellMap("random", drawn)), seen, errors))
