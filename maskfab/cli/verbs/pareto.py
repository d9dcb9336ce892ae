"""``maskfab pareto``: restored photographs against room for emitters, for several sizes of openings."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from maskfab.cli.common.options import Budget, JobFile, Json, Quiet
from maskfab.cli.common.printing import print_json
from maskfab.cli.common.watch import watched
from maskfab.errors import JobError

if TYPE_CHECKING:
    from maskfab.design.pareto import Judged, Pareto
    from maskfab.report.pareto_files import Named


def pareto(
    job: JobFile,
    out: Annotated[Path, typer.Option(help="Directory for the results, the openings and the figure.")],
    images: Annotated[
        Path | None, typer.Option(help="Folder of photographs to score with; default: synthetic scenes.")
    ] = None,
    budget: Budget = None,
    force: Annotated[bool, typer.Option("--force", help="Replace an earlier result.")] = False,
    as_json: Json = False,
    quiet: Quiet = False,
) -> None:
    """Find the Pareto front of restored PSNR against emitter footprint."""
    from maskfab import provenance
    from maskfab.camera.photo_camera import PhotoCamera
    from maskfab.camera.photographs import folder
    from maskfab.camera.scenes import bundled
    from maskfab.camera.transfer import lattice
    from maskfab.design.pareto import openings, rules_of, sweep
    from maskfab.display.feasibility import DisplayRules
    from maskfab.files.staging import check_target
    from maskfab.jobfile import SearchSection, read
    from maskfab.opening.openings import dumps, load
    from maskfab.report import pareto_files as report
    from maskfab.units import parse_time_s

    spec = read(job)
    if spec.pareto is None:
        raise JobError(
            "MF105",
            "the job has no [pareto] section",
            where=str(job),
            cure="Add a [pareto] section with clear_dots = [88, 100]",
        )
    section = spec.design
    if not isinstance(section, SearchSection):
        raise JobError(
            "MF105",
            "a sweep is among compact shapes, and the job has no [design] that searches them",
            where=f"{job}: design",
            cure='Add [design] with method = "search"',
        )
    camera = PhotoCamera.of(spec.camera.camera(), where=str(job))
    limit = None if budget is None else parse_time_s(budget, where="--budget")
    compared = [load(job.parent / path) for path in spec.pareto.compare]
    texts = {opening.name: dumps(opening) for opening in compared}
    if len(texts) < len(compared):
        raise JobError(
            "MF109",
            "two openings have one name",
            where=f"{job}: pareto.compare",
            cure="Give one of the openings another name in its file",
        )
    rules = None if spec.emitters is None else DisplayRules.of(spec.emitters, None, None, where=str(job)).emitters
    lattice(section.dots, rules_of(section, compared, rules).dot_nm, camera=camera, where=f"{job}: design.dots")
    place = check_target(out, force=force)
    command = f"maskfab pareto {job.as_posix()} --out {out.as_posix()}"
    command += "" if images is None else f" --images {images.as_posix()}"
    command += "" if budget is None else f" --budget '{budget}'"
    scenes = None if images is None else folder(images)
    with watched(quiet) as progress:
        found = sweep(
            spec.pareto,
            section,
            scenes or bundled(),
            compared=compared,
            emitters=rules,
            camera=camera,
            budget_s=limit,
            progress=progress,
        )
        progress("files", 0, 1)
        named = openings(found, section, command, camera)
        digest = provenance.job_hash(spec.model_copy(update={"openings": {**spec.openings, **texts}}).dump())
        paths = report.write(place, found, named, digest)
        progress("files", 1, 1)
    if as_json:
        print_json({**report.document(found, named, digest), "path": str(out)})
        return
    for line in _lines(found, named):
        typer.echo(line)
    for path in paths:
        typer.echo(path)


def _lines(found: Pareto, named: Named) -> list[str]:
    best = {id(each) for each in found.best}
    names = {id(judged): name for name, (judged, _) in named.items()}
    lines = []
    for curve in found.curves:
        if curve.refusal is not None:
            lines.append(f"{curve.clear_dots} clear dots: {curve.refusal}")
            continue
        cut = "" if curve.complete else "; the budget ended it"
        lines.append(
            f"{curve.clear_dots} clear dots ({curve.front[0].open_ratio:.1%} open): {curve.evaluated} openings "
            f"evaluated, {curve.measured} footprints measured{cut}"
        )
        lines += [
            f"  {'*' if id(each) in best else ' '} {_told(each)}  {names[id(each)]}: {each.shape}"
            for each in curve.front
        ]
    for each in found.compared:
        gain = found.gain_db(each)
        more = (
            "nothing found has that footprint at no more clear dots"
            if gain is None
            else f"the front is {gain:+.2f} dB better"
        )
        lines.append(f"    {_told(each)}  {each.shape}, {each.open_ratio:.1%} open; {more}")
    return lines


def _told(each: Judged) -> str:
    return f"{each.value:.2f} dB  {each.footprint:.2%}"
