"""``maskfab render``: pictures on the panels, as the eye sees them."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from maskfab.cli.common.dies import check_dies
from maskfab.cli.common.options import JobFile, Json, Quiet
from maskfab.cli.common.printing import print_json, print_table
from maskfab.cli.common.watch import watched


def render(
    job: JobFile,
    image: Annotated[Path | None, typer.Argument(metavar="[IMAGE]", help="A photograph to show as well.")] = None,
    die: Annotated[
        list[str] | None, typer.Option(help="Die of the job (repeatable); default: all with emitters.")
    ] = None,
    dpi: Annotated[float | None, typer.Option(help="Scale the panels to this DPI; default: their own.")] = None,
    distance: Annotated[str, typer.Option(help="Viewing distance.")] = "300 mm",
    pixels: Annotated[
        int | None, typer.Option(help="Display pixels along a side; default: 100, or as many as the panel has.")
    ] = None,
    samples: Annotated[int, typer.Option(help="Samples along the side of a display pixel.")] = 21,
    with_jod: Annotated[bool, typer.Option("--jod", help="Also score with ColorVideoVDP; needs maskfab[eye].")] = False,
    out: Annotated[Path | None, typer.Option(help="Directory for the pictures and the results.")] = None,
    as_json: Json = False,
    quiet: Quiet = False,
) -> None:
    """Render pictures on the panels as the eye sees them, with S-CIELAB difference, grain and colour fringes."""
    from maskfab import units
    from maskfab.eye.display_light import emitters_of, has_emitters
    from maskfab.eye.picture import read
    from maskfab.eye.side_by_side import judge, pictures
    from maskfab.eye.viewing import Viewing
    from maskfab.job import load
    from maskfab.report import render_files as report

    if out is not None:
        from maskfab.files.staging import check_target

        check_target(out, force=False)
    distance_um = units.parse_length_um(distance, where="--distance", zero_allowed=True)
    pitch_um = None if dpi is None else units.parse_pitch_um(f"{dpi!r} dpi", where="--dpi")
    loaded = load(job)
    panels = {each.name: each.panel for each in loaded.displays().plate.dies}
    check_dies(die or (), panels)
    photograph = None if image is None else read(image)
    lit = [name for name, panel in panels.items() if has_emitters(panel)]
    shown = list(dict.fromkeys(die or lit or panels))
    for name in shown:
        emitters_of(panels[name])
    judged = []
    with watched(quiet) as progress:
        for done, name in enumerate(shown):
            progress("panels", done, len(shown))
            panel = panels[name]
            viewing = Viewing(pitch_um or panel.cell_size.pitch_um, distance_um)
            side = min(100, *panel.orientations.shape) if pixels is None else pixels
            judged.append(judge(name, panel, pictures(side, photograph), samples, viewing, with_jod=with_jod))
        progress("panels", len(shown), len(shown))
        paths = [] if out is None else report.write(out, judged, samples, loaded.digest, progress)
    if as_json:
        print_json(report.document(judged, samples, loaded.digest))
        return
    for each in judged:
        typer.echo(each.name)
        print_table(each.quantities)
    for path in paths:
        typer.echo(path)
