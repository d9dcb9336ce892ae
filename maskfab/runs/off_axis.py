"""Light off the axis, and the display's distance to the lens, where an answer models neither: by how much they tell."""

from __future__ import annotations

from maskfab.base.errors import JobError
from maskfab.base.units import UM_PER_MM
from maskfab.base.work import NO_END, Clock
from maskfab.findings.optics import plate_as_seen
from maskfab.job.sections import SceneSection
from maskfab.mask.job import Job
from maskfab.optics.scene.plan import plan
from maskfab.optics.scene.scene import Scene
from maskfab.report.pages.advice import Caveat

_OFF_AXIS = frozenset({"oblique light", "shift through the gap", "diffraction over the gap"})
"""Rows of a plan that gap and field alone bring about."""
_TAKES_S = 5.0


def off_axis(job: Job, name: str, gap_um: float, field: float | str | None, clock: Clock = NO_END) -> Caveat:
    """Parts of a lens that are not modelled, and by how much they change the image of a point behind a die at most, as
    ``check --optics`` estimates it.

    Args:
        name: of the die.
        gap_um: from the display to the lens.
        field: largest image height, um, or angle off the axis; None for the axis alone.
        clock: nothing is estimated where it leaves no time.
    """
    asked = SceneSection().model_copy(update={"gap": gap_um, "field": field or 0.0})
    reach = f"{field / UM_PER_MM:g} mm" if isinstance(field, float) else field
    off = f"and a field of {reach} " if field else ""
    what = f"a gap of {gap_um / UM_PER_MM:g} mm {off}{'are' if field else 'is'} not modelled"
    words = f"judged along the axis, with the display at the lens: {what}"
    if not clock.affords(_TAKES_S):
        return Caveat(f"{words}; with them in [scene] of the job, check --optics tells what that changes")
    panel = next(die.panel for die in plate_as_seen(job, job.plate()).dies if die.name == name)
    try:
        scene = Scene.of(asked, camera=job.camera, where="answers")
        rows = plan(panel, job.camera, scene, asked.accuracy).ingredients
    except JobError as refusal:
        return Caveat(f"{words}, and by how much that tells is not known: {refusal.what}")
    told = [f"{row.error:.2g} ({row.name})" for row in rows if row.name in _OFF_AXIS and row.error]
    change = f"change{'' if field else 's'} the image of a point by at most {', '.join(told) or '0'} in relative L2"
    return Caveat(f"{words}, which {change}")
