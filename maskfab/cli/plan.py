"""``maskfab plan``: what a scene needs modelled."""

from __future__ import annotations

from typing import Annotated

import typer

from maskfab.cli.dies import check_dies
from maskfab.cli.options import JobFile, Json
from maskfab.cli.printing import print_json


def plan(
    job: JobFile,
    die: Annotated[str | None, typer.Option(help="Which die of the job; default: all.")] = None,
    as_json: Json = False,
) -> None:
    """Say what the job's [scene] needs modelled, what may be left out, and what computing it takes."""
    from maskfab.layout.job import load
    from maskfab.optics.plan import document, table
    from maskfab.optics.plan import plan as plan_scene
    from maskfab.optics.scene import Scene
    from maskfab.spec import SceneSection

    loaded = load(job)
    section = loaded.spec.scene or SceneSection()
    panels = {each.name: each.panel for each in loaded.plate().dies}
    if die is not None:
        check_dies([die], panels)
        panels = {die: panels[die]}
    plans = {
        name: plan_scene(panel, loaded.camera, loaded.scene or Scene(), section.accuracy)
        for name, panel in panels.items()
    }
    if as_json:
        print_json({"accuracy": section.accuracy, "dies": [document(name, found) for name, found in plans.items()]})
        return
    for name, found in plans.items():
        for line in table(name, found):
            typer.echo(line)
