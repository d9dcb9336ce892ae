"""Input and result that both methods of [design] share."""

from __future__ import annotations

import hashlib
from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from maskfab.base import __version__
from maskfab.base.errors import JobError
from maskfab.base.model import ORIENTATIONS, Camera, Opening, Tiling
from maskfab.camera.lens import F1, PhotoCamera, camera_line
from maskfab.camera.protocol import LEVELS
from maskfab.camera.scenes import Bundled, Photograph
from maskfab.designs.bounds.limits import Gap, bounds, optimality_gap
from maskfab.designs.model.conditions import SceneConditions
from maskfab.designs.model.expected_psnr import Surrogate
from maskfab.designs.model.statistics import F1_SETTINGS, CaptureSettings
from maskfab.designs.rules import constraints
from maskfab.designs.rules.constraints import Constraints
from maskfab.designs.rules.display_fit import DieFit, Display, of_display
from maskfab.designs.rules.rule import price_key
from maskfab.designs.search.account import Account, Alternatives, Prices
from maskfab.job.sections import DesignSection, RulesSection
from maskfab.mask.opening_file import dot_of_pitch
from maskfab.mask.panels import CellMap

if TYPE_CHECKING:
    from maskfab.designs.maps.orientation_map import DesignedMap
    from maskfab.designs.model.panel_error import SceneAppraisal
    from maskfab.designs.model.robustness import Robustness


Facts = dict[str, str | int | float]

LEVELS_OF_F1 = "another camera at the levels of F1"
"""In the place of a protocol's name."""


@dataclass(frozen=True, eq=False)
class Designed:
    """Result of a design.

    Attributes:
        opening: the best that keeps all rules.
        shape: how it was found: the family, size and place it came from, or the objectives that were descended.
        psnr: expected restored PSNR in dB, by level, cells turned at random (or not at all, if periodic); of a scene's
            depth the mean over its distances.
        head_room: by level, dB that no other opening of as many dots can gain over it in the picture's interior, in
            focus; None for a panel of two openings, and where the budget is shorter than bounds take.
        evaluated: openings that were judged.
        prices: what the rules cost among them, in dB of the weighted mean; None where they were judged otherwise.
        cells: the designed map; None if none was asked for.
        designed: how that went.
        map_head_room: by level, dB that no layout of as many dots and the map's own light can gain over it; None
            without a map, for one of two openings or of several distances, and as above.
        gap: the opening beside all its bounds; None for a panel of two, where there is no other opening, and as above.
        outer: the opening of the outer half of the stop; None unless the density was asked to differ.
        notes: what a user should know, as sentences.
        camera: lens, sensor and light that PSNRs are expected for, in words.
        levels: of light, dB.
        robust: the panel beside those that are made instead of it; None where the budget is shorter than bounds take,
            and for a descent.
        fit: of the display on a die; None where none must be held.
        scene: the panel in the conditions that it is designed for; None where nothing of a scene must be modelled, and
            where the budget is shorter than bounds take.
        cut: a budget cut the search short, so that it depends on the clock.
        account: how it was found.
        alternatives: openings of nearly its PSNR; None for a panel of two openings, for a descent, where openings were
            not judged in dB, and where the budget is shorter than bounds take.
    """

    opening: Opening
    shape: str
    psnr: tuple[float, ...]
    head_room: tuple[float, ...] | None
    evaluated: int
    prices: Prices | None = None
    cells: CellMap | None = None
    designed: DesignedMap | None = None
    map_head_room: tuple[float, ...] | None = None
    gap: Gap | None = None
    outer: Opening | None = None
    notes: tuple[str, ...] = ()
    cut: bool = False
    camera: str = ""
    levels: tuple[float, ...] = LEVELS
    robust: Robustness | None = None
    fit: DieFit | None = None
    scene: SceneDesign | None = None
    account: Account | None = None
    alternatives: Alternatives | None = None


@dataclass(frozen=True, eq=False)
class SceneDesign:
    """A design in the conditions of its scene.

    Attributes:
        seen: the conditions.
        panel: appraised in them.
        random: the same panel with its cells turned at random; None without a map of one opening.
    """

    seen: SceneConditions
    panel: SceneAppraisal
    random: SceneAppraisal | None


def constraints_of(
    section: DesignSection,
    *,
    where: str = "design",
    display: Display | None = None,
) -> Constraints:
    """The section's rules.

    Args:
        section: of a job.
        where: it stands, for errors.
        display: that the opening must hold.

    Raises:
        JobError: MF104, MF106 or MF107 for a pitch that is no whole number of dots on the grid, or rules out of range;
            MF105 for a centroid without a display; MF117 or MF118 where its rules do not suit the pixel.
    """
    asked = section.rules
    dot_nm = dot_of_pitch(section.pitch, section.dots, where=f"{where}.pitch")
    if asked.centroid_px is not None and display is None:
        raise JobError(
            "MF105",
            "there are no emitters whose light could be centred",
            where=f"{where}.rules.centroid_px",
            cure="Set fit = true, with [emitters] in the job, or remove centroid_px",
        )
    stated = {
        rule.name: rule.read(getattr(asked, rule.name), section, where)
        for rule in constraints.RULES
        if issubclass(rule.section, RulesSection)
    }
    return Constraints(
        section.clear_dots,
        dots=section.dots,
        dot_nm=dot_nm,
        orientations=(0,) if section.tiling is Tiling.PERIODIC else tuple(range(ORIENTATIONS)),
        asked=stated,
        **({} if display is None else of_display(display)),
    )


def appraised(
    estimate: Surrogate, mask: NDArray[np.bool_], *, periodic: bool
) -> tuple[tuple[float, ...], Facts, tuple[float, ...], Gap | None]:
    """Expected restored PSNR of a unit by level, both as provenance, and what no other of as many dots can gain, in dB.

    That is of the picture's interior; the provenance has that of the whole frame too. Last all bounds, unless there is
    no other opening of as many dots.
    """
    if mask.all():
        # It is the only opening of its count.
        psnr, none = estimate(mask, periodic=periodic), (0.0,) * len(estimate.levels)
        facts = by_level("expected_psnr", psnr, estimate.levels) | by_level("head_room", none, estimate.levels)
        return psnr, facts, none, None
    limit = bounds(estimate, int(mask.sum()), periodic=periodic, any_layout=False)
    gap = optimality_gap(estimate, mask, periodic=periodic, known=limit)
    psnr = estimate(mask, periodic=periodic)
    facts = by_level("expected_psnr", psnr, estimate.levels) | by_level("head_room", gap.head_room, estimate.levels)
    return psnr, facts | by_level("head_room_frame", gap.head_room_frame, estimate.levels), gap.head_room, gap


def origin(section: DesignSection, command: str, made_for: Facts) -> Facts:
    """Who made it, how it is made again, and for which camera."""
    made: Facts = {"author": "maskfab", "command": command, "version": __version__, "seed": section.seed}
    return made | made_for


def camera_facts(
    camera: Camera | PhotoCamera, settings: CaptureSettings = F1_SETTINGS, seen: SceneConditions | None = None
) -> Facts:
    """The camera that an opening was designed for, as provenance; nothing for that of protocol F1.

    What says nothing was made for protocol F1, as all was before this was stated, and keeps its bytes.
    """
    told = camera_line(camera)
    scene: Facts = {} if seen is None else {"scene": seen.line}
    if not settings.is_f1:
        return {"camera": told, "protocol": settings.line, **scene}
    return scene if told == camera_line(F1) else {"camera": told, "protocol": LEVELS_OF_F1, **scene}


def made_for_line(
    camera: Camera | PhotoCamera, settings: CaptureSettings = F1_SETTINGS, seen: SceneConditions | None = None
) -> str:
    """Lens, sensor, light and scene that numbers are expected for, in words."""
    return f"{camera_line(camera)}; {settings.line}{'' if seen is None else f'; scene: {seen.line}'}"


def by_level(name: str, values: Sequence[float], levels: Sequence[float]) -> Facts:
    """Decibels as provenance: ``name_24`` and so on, rounded to what they are worth."""
    # A rounded loss of nothing must not be written as -0.0.
    return {f"{name}_{level:g}": round(value, 3) + 0.0 for level, value in zip(levels, values, strict=True)}


def of_prices(found: Prices) -> Facts:
    """Costs of the rules, as provenance."""
    facts: Facts = {"rules_cost_db": round(found.together, 3) + 0.0}
    facts.update({price_key(each.rule): round(each.last, 3) + 0.0 for each in found.each})
    return facts


def run_key(section: DesignSection, scenes: Sequence[Photograph], *more: object) -> str:
    """Key that tells the checkpoint of this run from every other."""
    told = hashlib.sha256(f"{__version__} {np.__version__} {section!r} {more!r}".encode())
    if isinstance(scenes, Bundled):
        told.update(f"{len(scenes)} bundled".encode())
        return told.hexdigest()
    for scene in scenes:
        told.update(f"{scene.name} {scene.number} {scene.values.shape}".encode())
        told.update(np.ascontiguousarray(scene.values).tobytes())
    return told.hexdigest()
