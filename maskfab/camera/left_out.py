"""Sentences on all of a job that does not reach its photographs, and why."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence

from maskfab.model import MaskBlank, Panel
from maskfab.optics.scene.plan import Plan
from maskfab.optics.scene.scene import Scene
from maskfab.units import UM_PER_MM

_OWN_WORDS = ("lens distortion", "curve of the rim", "field between places", "width of the bands")


def left_out(panel: Panel, scene: Scene, blank: MaskBlank, plan: Plan | None = None) -> tuple[str, ...]:
    """Sentences on what the photographs of a die leave out; none where they hold all that the job states.

    Args:
        panel: of the die.
        scene: of the job, the plate's glass in its gap.
        blank: of the plate.
        plan: that the transfer follows; None if it holds all of the scene.
    """
    return (*by_plan(scene, plan), *_of_lens(scene), *_of_plate(panel, scene, blank))


def by_sentence(left_out: Mapping[str, Sequence[str]]) -> list[str]:
    """Every sentence once, with the dies that it is about where these are not all.

    Args:
        left_out: by die, what its photographs leave out.
    """
    dies: dict[str, list[str]] = {}
    for name, told in left_out.items():
        for sentence in told:
            dies.setdefault(sentence, []).append(name)
    every = len(left_out)
    return [f"{'' if len(names) == every else ', '.join(names) + ': '}{sentence}." for sentence, names in dies.items()]


def by_plan(scene: Scene, plan: Plan | None) -> list[str]:
    """Sentences on what a plan leaves out of a scene; of none, on the shift that is then left out."""
    if plan is None:
        told = "the shift through the gap off the axis is left out: every place is seen as the axis is"
        return [told] if scene.gap_um and scene.field_um else []
    rows = [row for row in plan.ingredients if not row.modelled and row.error and row.name not in _OWN_WORDS]
    return [
        f"{row.name} is left out: without it the PSF errs by {row.error:.2g} at most, and the accuracy asked for is "
        f"{plan.accuracy:g}"
        for row in rows
    ]


def _of_lens(scene: Scene) -> list[str]:
    told = []
    if scene.distortion is not None and scene.distortion.ratio:
        told.append(
            f"lens distortion of {scene.distortion.ratio:.2g} is left out: photographs are compared as if rectified, "
            "and their PSF is that of a lens without it"
        )
    if scene.nearest_um != scene.farthest_um:
        near, far = (_distance(each) for each in (scene.nearest_um, scene.farthest_um))
        told.append(f"depth is left out: all of a photograph is at one distance between {near} and {far}")
    return told


def _of_plate(panel: Panel, scene: Scene, blank: MaskBlank) -> list[str]:
    told = []
    if blank.optical_density is not None:
        share = 10**-blank.optical_density
        told.append(
            f"light through the film is left out: it passes {share:.1g} of what falls on it, and is taken as opaque"
        )
    if blank.glass is not None:
        side = "its thickness counts as a gap" if blank.glass.gap_um else "behind it, it only dims"
        if blank.glass.gap_um and not scene.gap_um:
            side = "its thickness counts as a gap with a [scene] alone, and the job has none"
        told.append(f"reflections and absorption of the glass are left out: {side}")
    if panel.tracks:
        told.append("wires of the display are left out: the mask has none")
    return told


def _distance(length_um: float) -> str:
    return "infinity" if math.isinf(length_um) else f"{length_um / UM_PER_MM:.4g} mm"
