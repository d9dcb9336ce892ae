"""``maskfab simulate``: quality of restored photographs behind the dies of a job."""

from __future__ import annotations

import math
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from maskfab.cli.common.dies import check_dies
from maskfab.cli.common.options import JobFile, Json, Quiet
from maskfab.cli.common.printing import print_json
from maskfab.cli.common.watch import watched
from maskfab.errors import JobError

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

    from maskfab.camera.photo_camera import PhotoCamera
    from maskfab.camera.protocol import Score, Table

_PICTURE = (160, 200)
"""Rows and columns of the sensor that a picture shows of every photograph."""


def simulate(
    job: JobFile,
    die: Annotated[
        list[str] | None, typer.Option(help="Die of the job (repeatable); default: all that can be judged.")
    ] = None,
    reference: Annotated[str | None, typer.Option(help="Die to compare with; default: the first.")] = None,
    images: Annotated[Path | None, typer.Option(help="Folder of photographs; default: synthetic scenes.")] = None,
    protocol: Annotated[
        str | None, typer.Option(help="f1: use that protocol's camera; default: the job's. Light levels are F1's.")
    ] = None,
    picture: Annotated[
        Path | None, typer.Option(help="Write a PNG of the truth and each die, one row per light level.")
    ] = None,
    force: Annotated[bool, typer.Option("--force", help="Replace an existing picture.")] = False,
    as_json: Json = False,
    quiet: Quiet = False,
) -> None:
    """Simulate noisy photographs through each die, restore and score them: PSNR, SSIM, gain over a reference."""
    from maskfab.camera.laid_panel import laid_panel
    from maskfab.camera.photo_camera import F1, PhotoCamera, described
    from maskfab.camera.photographs import folder
    from maskfab.camera.protocol import ASSUMED, evaluate
    from maskfab.camera.scenes import bundled
    from maskfab.camera.shots import Crop, Shot, truth_of
    from maskfab.files.staging import check_file, write_bytes
    from maskfab.job import load

    if protocol not in (None, "f1"):
        raise JobError("MF105", f"there is no protocol {protocol!r}", where="--protocol", cure="Use f1")
    if picture is not None:
        check_file(picture, force=force)
    loaded = load(job)
    camera = F1 if protocol else PhotoCamera.of(loaded.camera, where=str(job), colours=True)
    panels = {each.name: each.panel for each in loaded.plate().dies}
    check_dies(die or (), list(panels))
    chosen = list(dict.fromkeys(die)) if die else list(panels)
    laid = []
    for name in chosen:
        try:
            laid.append(laid_panel(name, panels[name], camera))
        except JobError:
            if die:
                raise
    if not laid:
        raise JobError(
            "MF122",
            f"no die can be judged behind a camera of {described(camera)}",
            where=str(job),
            cure="Add --die NAME to see why",
        )
    names = [each.name for each in laid]
    check_dies([reference] if reference else (), names)
    scenes = bundled() if images is None else folder(images)
    crop = Crop(*_PICTURE)
    tables: list[Table] = []
    shown: dict[str, list[Shot]] = {name: [] for name in names}

    def show(score: Score, whole: NDArray[np.float32]) -> None:
        if picture is not None and score.scene == scenes[0].name:
            shown[score.design].append(Shot(score, crop.of(whole)))

    with watched(quiet) as progress:
        for done, each in enumerate(laid):
            progress("photographs", done, len(laid))
            tables.append(evaluate([each], scenes, scenes, show=show))
        progress("photographs", len(laid), len(laid))
    table = type(tables[0])(tuple(score for each in tables for score in each.scores))
    if picture is not None:
        from maskfab.report.plots.design_figures import sheet

        write_bytes(picture, sheet(truth_of(scenes[0], crop), scenes[0].name, shown), replace=force)
    base = reference or names[0]
    if as_json:
        print_json({"assumed": ASSUMED, **_document(table, base, camera, [scene.name for scene in scenes])})
        return
    if not camera.is_f1:
        typer.echo(f"camera: {described(camera)}; levels of light of protocol F1")
    for line in (*_lines(table, base), f"Assumed: {ASSUMED}."):
        typer.echo(line)


def _document(table: Table, reference: str, camera: PhotoCamera, scenes: list[str]) -> dict[str, Any]:
    from maskfab.camera.photo_camera import described

    return {
        "protocol": "f1" if camera.is_f1 else None,
        "camera": described(camera),
        "reference": reference,
        "scenes": scenes,
        "scores": [vars(score) for score in table.scores],
        "gains": [{key: _known(value) for key, value in vars(gain).items()} for gain in table.gains(reference)],
    }


def _known(value: object) -> object:
    """A single photograph has no standard error."""
    return None if isinstance(value, float) and math.isnan(value) else value


def _lines(table: Table, reference: str) -> list[str]:
    rows = [("die", "level", "PSNR", "inner", "SSIM", f"gain over {reference}", "inner")]
    gains = {(gain.design, gain.level_db): gain for gain in table.gains(reference)}
    for design, level in dict.fromkeys((score.design, score.level_db) for score in table.scores):
        own = [score for score in table.scores if (score.design, score.level_db) == (design, level)]
        mean = [sum(getattr(score, key) for score in own) / len(own) for key in ("psnr", "psnr_inner", "ssim")]
        gain = gains.get((design, level))
        told = ("", "") if gain is None else (
            f"{gain.psnr:+.2f} ± {gain.psnr_error:.2f} dB", f"{gain.psnr_inner:+.2f} ± {gain.psnr_inner_error:.2f} dB",
        )  # fmt: skip
        rows.append((design, f"{level} dB", f"{mean[0]:.2f} dB", f"{mean[1]:.2f} dB", f"{mean[2]:.3f}", *told))
    widths = [max(len(row[k]) for row in rows) for k in range(len(rows[0]))]
    return ["  ".join(cell.ljust(width) for cell, width in zip(row, widths, strict=True)).rstrip() for row in rows]
