"""``maskfab plan``: what a scene needs modelled."""

from __future__ import annotations

from typing import Annotated

import typer

from maskfab.cli.common.dies import check_dies
from maskfab.cli.common.options import JobFile, Json
from maskfab.cli.common.printing import print_json


def plan(
    job: JobFile,
    die: Annotated[str | None, typer.Option(help="Die of the job; default: all.")] = None,
    as_json: Json = False,
) -> None:
    """Plan the model of the job's [scene]: effects to include, error of those omitted, time and memory."""
    from maskfab.job import load
    from maskfab.jobfile import SceneSection
    from maskfab.model import UNSTATED
    from maskfab.optics.scene.model_bar import bar_of_scene, weighed, weighed_table
    from maskfab.optics.scene.plan import document, table
    from maskfab.optics.scene.plan import plan as plan_scene
    from maskfab.optics.scene.scene import Scene

    loaded = load(job)
    section = loaded.spec.scene or SceneSection()
    panels = loaded.panels()
    if die is not None:
        check_dies([die], panels)
        panels = {die: panels[die]}
    plans = {
        name: plan_scene(panel, loaded.camera, loaded.scene or Scene(), section.accuracy)
        for name, panel in panels.items()
    }
    # A job that asks for no scene and says nothing of its plate has its bars in the report.
    asked = loaded.scene is not None or loaded.blank != UNSTATED
    field_um = 0.0 if loaded.scene is None else loaded.scene.field_um
    bars = {
        name: bar_of_scene(panel, loaded.camera, loaded.blank, field_um) if asked else ()
        for name, panel in panels.items()
    }
    if as_json:
        dies = [
            {**document(name, found), "not_modelled": weighed(bars[name], section.accuracy)}
            for name, found in plans.items()
        ]
        print_json({"accuracy": section.accuracy, "dies": dies})
        return
    for name, found in plans.items():
        for line in [*table(name, found), *weighed_table(bars[name], section.accuracy)]:
            typer.echo(line)
