"""``maskfab design``: an opening, and its map, as the job's [design] asks for it."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from maskfab.base.errors import JobError
from maskfab.cli.common.options import Budget, JobFile, Json, Quiet, named_as_options
from maskfab.cli.common.printing import print_json
from maskfab.cli.common.watch import watched

if TYPE_CHECKING:
    from maskfab.job.sections import JobSpec


def design(
    context: typer.Context,
    job: JobFile,
    out: Annotated[
        Path | None,
        typer.Option(
            "--out",
            "-o",
            help="Folder for a page, its numbers, the opening and its map; or file (.toml) for the opening, its map "
            "beside it. Default: the file design.output of the job.",
        ),
    ] = None,
    images: Annotated[
        Path | None, typer.Option(help="Folder of photographs to design for; default: synthetic scenes.")
    ] = None,
    budget: Budget = None,
    checkpoint: Annotated[
        Path | None, typer.Option(help="File that saves the state of the search; resumes from it if it exists.")
    ] = None,
    price_rules: Annotated[
        bool,
        typer.Option(
            "--price-rules",
            help="Anneal once more without each rule, to tell what it costs; for each about as long as the annealing.",
        ),
    ] = False,
    force: Annotated[bool, typer.Option("--force", help="Replace existing files.")] = False,
    as_json: Json = False,
    quiet: Quiet = False,
) -> None:
    """Find the opening through which photographs restore best, by shape search or gradient descent."""
    from maskfab.api.verbs.designing import design as design_job
    from maskfab.api.verbs.designing import is_folder
    from maskfab.base.folders import check_file, check_target, write_text
    from maskfab.designs.design import section_of
    from maskfab.job.read import read

    spec = read(job)
    folder = out if out is not None and is_folder(out) else None
    if folder is not None:
        section_of(spec, str(job))
        check_target(folder, force=force)
    targets = {} if folder is not None else _targets(spec, job, out)
    for each in targets.values():
        check_file(each, force=force)
    with named_as_options(context), watched(quiet) as progress:
        designed = design_job(
            job, images=images, budget=budget, checkpoint=checkpoint, price_rules=price_rules, progress=progress
        )
    if folder is not None:
        written = designed.save(folder, force=force)
        paths = {part: folder / name for part, name in designed.names.items()}
    else:
        paths = {part: targets[part] for part in designed.texts()}
        for part, text in designed.texts().items():
            write_text(paths[part], text, replace=force)
        written = list(paths.values())
    if as_json:
        print_json(designed.to_dict(paths))
        return
    from maskfab.report.rows.text import designed_lines

    for line in designed_lines(designed.found, designed.notes):
        typer.echo(line)
    for path in written:
        typer.echo(path)


def _targets(spec: JobSpec, job: Path, out: Path | None) -> dict[str, Path]:
    """Where the opening goes, and the outer one and the map where there will be any."""
    from maskfab.api.verbs.designing import beside
    from maskfab.designs.design import section_of
    from maskfab.job.sections import SearchSection

    section = section_of(spec, str(job))
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
        own = section.map_output is not None and out is None
        targets["map"] = job.parent / str(section.map_output) if own else beside(target)["map"]
        if section.density is not None or section.cluster is not None:
            targets["outer"] = beside(target)["outer"]
    return targets
