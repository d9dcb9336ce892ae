"""Models that a scene needs."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from maskfab.api.jobs import AnyJob, dies_of, job_of
from maskfab.base.checks import checked_arguments
from maskfab.base.model import UNSTATED
from maskfab.job.reference import USES, in_words, unused
from maskfab.job.sections import SceneSection
from maskfab.optics.scene import plan as plans
from maskfab.optics.scene.model_bar import Omission, bar_of_scene, weighed, weighed_table
from maskfab.optics.scene.plan import Plan
from maskfab.optics.scene.scene import Scene

if TYPE_CHECKING:
    from maskfab.api.camera import Camera


@dataclass(frozen=True, eq=False, repr=False)
class Plans:
    """The model of every die, and what is left out whatever is asked for.

    Attributes:
        accuracy: admissible relative L2 error of the PSF.
        plans: by die.
        omissions: by die; none where neither scene nor blank is stated.
        unused: keys and tables that the job states and the plan does not depend on.
    """

    accuracy: float
    plans: Mapping[str, Plan]
    omissions: Mapping[str, Sequence[Omission]]
    unused: tuple[str, ...] = ()

    def __getitem__(self, die: str) -> Plan:
        return self.plans[die]

    def to_dict(self) -> dict[str, Any]:
        """Plain data; lengths in micrometres, times in seconds."""
        dies = [
            {**plans.plan_document(name, found), "not_modelled": weighed(self.omissions[name], self.accuracy)}
            for name, found in self.plans.items()
        ]
        return {"accuracy": self.accuracy, "dies": dies, "unused": list(self.unused)}

    def __str__(self) -> str:
        lines = [
            line
            for name, found in self.plans.items()
            for line in [*plans.plan_table(name, found), *weighed_table(self.omissions[name], self.accuracy)]
        ]
        return "\n".join([*lines, *in_words(self.unused)])


@checked_arguments
def plan(job: AnyJob, camera: Camera | None = None, *, die: str | Sequence[str] | None = None) -> Plans:
    """Plan the model of the job's [scene]: effects to include, error of those omitted, time and memory.

    Args:
        job: a plate, a loaded job, or the path of a job file.
        camera: of a plate; by default its own.
        die: one or several; by default all.

    Raises:
        JobError: MF105 for a die that the job does not have; MF114 or MF115 if a scene cannot be modelled.
    """
    loaded = job_of(job, camera)
    loaded.check_window()
    section = loaded.spec.scene or SceneSection()
    panels = loaded.panels()
    panels = {name: panels[name] for name in dies_of(die, panels)}
    found = {
        name: plans.plan(panel, loaded.camera, loaded.scene or Scene(), section.accuracy)
        for name, panel in panels.items()
    }
    # A job that asks for no scene and says nothing of its plate has its bars in the report.
    asked = loaded.scene is not None or loaded.blank != UNSTATED
    field_um = 0.0 if loaded.scene is None else loaded.scene.field_um
    bars = {
        name: bar_of_scene(panel, loaded.camera, loaded.blank, field_um) if asked else ()
        for name, panel in panels.items()
    }
    return Plans(section.accuracy, found, bars, unused(loaded.spec, *USES["plan"]))
