"""A found panel in the conditions of its scene, beside one whose cells are turned at random."""

from __future__ import annotations

from maskfab.jobfile import SearchSection
from maskfab.model import Panel
from maskfab.optimiser.model.designed_panel import designed_panel
from maskfab.optimiser.model.scene_appraisal import appraise_over
from maskfab.optimiser.model.scene_conditions import SceneConditions, cells_across
from maskfab.optimiser.result import SceneDesign
from maskfab.optimiser.search.finish import Mapped, map_seed
from maskfab.optimiser.search.judges import Judges
from maskfab.plate.maps import CellMap
from maskfab.plate.tiling import orientations


def over_scene(section: SearchSection, laid: Mapped, dot_nm: int, judges: Judges, seen: SceneConditions) -> SceneDesign:
    """Appraise a panel in every condition.

    Args:
        section: of a job.
        laid: the panel.
        dot_nm: side of a dot.
        judges: of panels.
        seen: the conditions.

    Raises:
        JobError: as :func:`maskfab.optimiser.model.scene_appraisal.appraise_over`.
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
