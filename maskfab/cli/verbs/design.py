"""``maskfab design``: an opening, and its map, as the job's [design] asks for it."""

from __future__ import annotations

import os
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from maskfab.cli.common.budget import Budget, seconds
from maskfab.cli.common.design_text import document, lines
from maskfab.cli.common.options import JobFile, Json, Quiet
from maskfab.cli.common.printing import print_json
from maskfab.cli.common.watch import watched
from maskfab.errors import JobError, OutputError

if TYPE_CHECKING:
    from maskfab.camera.photographs import Scene
    from maskfab.design.result import Designed
    from maskfab.jobfile import JobSpec
    from maskfab.progress import Progress

_SCENES_OF_MAPS = 16


def design(
    job: JobFile,
    out: Annotated[
        Path | None,
        typer.Option(help="File for the opening, its map beside it; default: design.output of the job."),
    ] = None,
    images: Annotated[
        Path | None, typer.Option(help="Folder of photographs to design for; default: synthetic scenes.")
    ] = None,
    budget: Budget = None,
    checkpoint: Annotated[
        Path | None, typer.Option(help="File that saves the state of the search; resumes from it if it exists.")
    ] = None,
    force: Annotated[bool, typer.Option("--force", help="Replace existing files.")] = False,
    as_json: Json = False,
    quiet: Quiet = False,
) -> None:
    """Find the opening through which photographs restore best, by shape search or gradient descent."""
    from maskfab.files.staging import check_file, write_text
    from maskfab.jobfile import read
    from maskfab.opening.openings import dumps
    from maskfab.plate import maps

    spec = read(job)
    limit_s = seconds(budget)
    targets = _targets(spec, job, out)
    for each in targets.values():
        check_file(each, force=force)
    if checkpoint is not None and not os.path.isdir(checkpoint.absolute().parent):
        raise OutputError(
            "MF401",
            f"there is no directory for the checkpoint {checkpoint}",
            cure="Create that directory, or give a path in one that exists",
        )
    _check_rules(spec, job)
    command = f"maskfab design {job.as_posix()}" + ("" if images is None else f" --images {images.as_posix()}")
    with watched(quiet) as progress:
        scenes = _scenes(images, for_map=getattr(spec.design, "map", None) is not None)
        found = _found(spec, scenes, command, progress, limit_s, checkpoint)
    written = {"opening": dumps(found.opening)}
    if found.outer is not None:
        written["outer"] = dumps(found.outer)
    if found.cells is not None:
        written["map"] = maps.dumps(found.cells)
    for name, text in written.items():
        write_text(targets[name], text, replace=force)
    paths = {name: targets[name] for name in written}
    notes = [*found.notes]
    if found.cut:
        notes.append("A run that its budget cut short is not repeated bit for bit.")
    if as_json:
        print_json(document(found, paths, notes))
        return
    for line in lines(found, notes):
        typer.echo(line)
    for path in paths.values():
        typer.echo(path)


def _targets(spec: JobSpec, job: Path, out: Path | None) -> dict[str, Path]:
    """Where the opening goes, and the outer one and the map where there will be any."""
    from maskfab.jobfile import SearchSection

    section = spec.design
    if section is None:
        raise JobError(
            "MF105",
            "the job has no [design] section",
            where=str(job),
            cure="Add a [design] section, as in layouts/design_bar.toml",
        )
    target = out or (None if section.output is None else job.parent / section.output)
    if target is None:
        raise JobError(
            "MF105",
            "the design has no output file",
            where=f"{job}: design.output",
            cure='Add output = "openings/x.toml" to [design], or give --out x.toml',
        )
    targets = {"opening": target}
    if isinstance(section, SearchSection) and section.map is not None:
        if section.map_output is None and out is None:
            raise JobError(
                "MF105",
                "the map has no output file",
                where=f"{job}: design.map_output",
                cure='Add map_output = "maps/x.toml" to [design]',
            )
        # The job's own map belongs to the opening that it names.
        beside = target.with_name(f"{target.stem}_map.toml")
        targets["map"] = beside if section.map_output is None or out is not None else job.parent / section.map_output
        if section.density is not None:
            targets["outer"] = target.with_name(f"{target.stem}_outer{target.suffix}")
    return targets


def _check_rules(spec: JobSpec, job: Path) -> None:
    """Refuse rules that no opening keeps, and a camera that no search knows, before anything is read or drawn."""
    from maskfab.camera.photo_camera import PhotoCamera
    from maskfab.camera.transfer import lattice
    from maskfab.design.result import constraints_of
    from maskfab.jobfile import RelaxSection

    assert spec.design is not None
    rules = constraints_of(spec.design, where=f"{job}: design")
    rules.require_possible()
    if not isinstance(spec.design, RelaxSection):
        camera = PhotoCamera.of(spec.camera.camera(), where=str(job))
        lattice(spec.design.dots, rules.dot_nm, camera=camera, where=f"{job}: design.dots")


def _scenes(images: Path | None, *, for_map: bool) -> Sequence[Scene]:
    """Maps fit the very pictures they are designed on, so they get more of them."""
    from maskfab.camera.photographs import folder
    from maskfab.camera.scenes import bundled

    if images is not None:
        return folder(images)
    return bundled(_SCENES_OF_MAPS) if for_map else bundled()


def _found(
    spec: JobSpec,
    scenes: Sequence[Scene],
    command: str,
    progress: Progress,
    limit_s: float | None,
    checkpoint: Path | None,
) -> Designed:
    from maskfab.jobfile import RelaxSection

    assert spec.design is not None
    camera = spec.camera.camera()
    if isinstance(spec.design, RelaxSection):
        from maskfab.design.relax.relax import relax

        return relax(spec.design, camera, scenes, command, progress, budget_s=limit_s, checkpoint=checkpoint)
    from maskfab.camera.photo_camera import PhotoCamera
    from maskfab.design.search.search import search

    seen = PhotoCamera.of(camera)
    return search(spec.design, scenes, command, progress, camera=seen, budget_s=limit_s, checkpoint=checkpoint)
