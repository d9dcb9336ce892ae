"""``maskfab design``: an opening by gradient descent, or by a search among shapes."""

from __future__ import annotations

import math
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from maskfab.cli.options import JobFile, Json, Quiet
from maskfab.cli.printing import print_json, tell_opening
from maskfab.cli.watch import watched
from maskfab.errors import JobError

if TYPE_CHECKING:
    from maskfab.design.search import Searched
    from maskfab.spec import JobSpec, SearchSection


def design(
    job: JobFile,
    out: Annotated[Path | None, typer.Option(help="Where the opening goes; default: the output of the job.")] = None,
    images: Annotated[
        Path | None, typer.Option(help="Photographs that [search] judges by; default: drawn scenes.")
    ] = None,
    force: Annotated[bool, typer.Option("--force", help="Replace an existing opening.")] = False,
    as_json: Json = False,
    quiet: Quiet = False,
) -> None:
    """Find an opening whose blur can be undone: [design] by gradient descent, [search] among compact shapes."""
    from maskfab.spec import read

    spec = read(job)
    if spec.search is not None:
        _search(spec.search, job, out, images, force=force, as_json=as_json, quiet=quiet)
    else:
        _descend(spec, job, out, force=force, as_json=as_json, quiet=quiet)


def _descend(spec: JobSpec, job: Path, out: Path | None, *, force: bool, as_json: bool, quiet: bool) -> None:
    from maskfab.design.job import find, settings
    from maskfab.export.staging import check_file, write_text
    from maskfab.layout.openings import dumps

    wanted = settings(spec, where=str(job), command=f"maskfab design {job.as_posix()}")
    target = out or (job.parent / spec.design.output if spec.design and spec.design.output else None)
    if target is None:
        raise JobError("MF105", "the design has no output file", where=f"{job}: design.output", cure="Add it, or --out")
    check_file(target, force=force)
    with watched(quiet) as progress:
        opening = find(wanted, progress)
    write_text(target, dumps(opening))
    tell_opening(opening, target, as_json)


def _search(
    section: SearchSection, job: Path, out: Path | None, images: Path | None, *, force: bool, as_json: bool, quiet: bool
) -> None:
    from maskfab.design.search import search
    from maskfab.export.staging import check_file, write_text
    from maskfab.imaging.photographs import folder
    from maskfab.imaging.scenes import bundled
    from maskfab.layout import maps
    from maskfab.layout.openings import dumps

    target = out or (None if section.output is None else job.parent / section.output)
    if target is None:
        raise JobError("MF105", "the search has no output file", where=f"{job}: search.output", cure="Add it, or --out")
    map_target = None if section.map_output is None else job.parent / section.map_output
    if section.map is not None and map_target is None:
        raise JobError("MF105", "the map has no output file", where=f"{job}: search.map_output", cure="Add it")
    for each in (target, map_target):
        if each is not None:
            check_file(each, force=force)
    command = f"maskfab design {job.as_posix()}" + ("" if images is None else f" --images {images.as_posix()}")
    with watched(quiet) as progress:
        found = search(section, bundled() if images is None else folder(images), command, progress)
    write_text(target, dumps(found.opening))
    if found.cells is not None and map_target is not None:
        write_text(map_target, maps.dumps(found.cells))
    if as_json:
        print_json(_document(found, target, map_target))
        return
    for line in _lines(found):
        typer.echo(line)
    for each in (target, map_target if found.cells is not None else None):
        if each is not None:
            typer.echo(each)


def _lines(found: Searched) -> list[str]:
    levels = ", ".join(f"{value:.2f} dB at {level}" for level, value in _by_level(found.psnr))
    lines = [f"{found.shape}: {found.opening.clear_dots} clear dots, expected restored PSNR {levels}"]
    room = ", ".join(f"{value:.2f} dB at {level}" for level, value in _by_level(found.head_room))
    lines.append(f"no opening of as many dots gains more, in the picture's interior, than {room}")
    lines.append(f"rules together cost {_db(found.prices.together)}, of {found.evaluated} openings")
    lines += [f"  {price.rule}: alone {_db(price.alone)}, last {_db(price.last)}" for price in found.prices.each]
    if found.designed is not None:
        gains = ", ".join(f"{value:+.2f} dB at {level}" for level, value in _by_level(found.designed.gain_db))
        light = found.designed.clear_dots / found.designed.start_clear_dots - 1
        lines.append(f"designed map, against a random one: {gains}; light {light:+.2%}")
    return lines


def _document(found: Searched, target: Path, map_target: Path | None) -> dict[str, object]:
    designed = found.designed
    return {
        "name": found.opening.name,
        "path": str(target),
        "shape": found.shape,
        "clear_dots": found.opening.clear_dots,
        "open_ratio": found.opening.open_ratio,
        "expected_psnr_db": {str(level): value for level, value in _by_level(found.psnr)},
        "head_room_db": {str(level): value for level, value in _by_level(found.head_room)},
        "evaluated": found.evaluated,
        "rules_cost_db": _finite(found.prices.together),
        "prices_db": {
            each.rule: {"alone": _finite(each.alone), "last": _finite(each.last)} for each in found.prices.each
        },
        "map": None
        if designed is None
        else {
            "path": str(map_target),
            "gain_db": {str(level): value for level, value in _by_level(designed.gain_db)},
            "clear_dots": designed.clear_dots,
            "random_clear_dots": designed.start_clear_dots,
        },
    }


def _by_level(values: tuple[float, ...]) -> list[tuple[int, float]]:
    from maskfab.imaging.protocol import LEVELS

    return list(zip(LEVELS, values, strict=True))


def _db(value: float) -> str:
    return f"{value:.3f} dB" if math.isfinite(value) else "everything: nothing seen keeps it"


def _finite(value: float) -> float | None:
    return value if math.isfinite(value) else None
