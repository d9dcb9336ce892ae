"""``maskfab design``: an opening, and its map, as the job's [design] asks for it."""

from __future__ import annotations

import os
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from maskfab.cli.common.options import Budget, JobFile, Json, Quiet
from maskfab.cli.common.printing import print_json
from maskfab.cli.common.watch import watched
from maskfab.errors import JobError, OutputError
from maskfab.report.design_text import document, lines

if TYPE_CHECKING:
    from maskfab.jobfile import JobSpec


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
    from maskfab.design.design import design as design_job
    from maskfab.files.staging import check_file, write_text
    from maskfab.jobfile import read
    from maskfab.opening.openings import dumps
    from maskfab.plate import maps
    from maskfab.units import parse_time_s

    spec = read(job)
    limit_s = None if budget is None else parse_time_s(budget, where="--budget")
    targets = _targets(spec, job, out)
    for each in targets.values():
        check_file(each, force=force)
    if checkpoint is not None and not os.path.isdir(checkpoint.absolute().parent):
        raise OutputError(
            "MF401",
            f"there is no directory for the checkpoint {checkpoint}",
            cure="Create that directory, or give a path in one that exists",
        )
    command = f"maskfab design {job.as_posix()}" + ("" if images is None else f" --images {images.as_posix()}")
    with watched(quiet) as progress:
        found = design_job(
            spec,
            command,
            where=str(job),
            images=images,
            progress=progress,
            budget_s=limit_s,
            checkpoint=checkpoint,
        )
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
