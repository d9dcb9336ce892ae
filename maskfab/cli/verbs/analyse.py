"""``maskfab analyse``: what an opening or a mask file does to a picture."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any

import typer

from maskfab.base.errors import JobError
from maskfab.cli.common.options import Json, Quiet, Unit, named_as_options, unit_um
from maskfab.cli.common.printing import leave, print_json, print_methods, print_table, tell_notes
from maskfab.cli.common.watch import watched


def analyse(
    context: typer.Context,
    file: Annotated[Path, typer.Argument(metavar="FILE", help="An opening (.toml .txt .png .tif .exr .npy) or a mask "
                                         "(.gds .oas .dxf).")],
    pitch: Annotated[str | None, typer.Option(help="Side of a cell, such as '168 um' or '150 dpi'.")] = None,
    dot: Annotated[str | None, typer.Option(help="Side of a dot, such as '8 um'.")] = None,
    gutter: Annotated[str, typer.Option(help="Opaque border around each cell.")] = "0 um",
    tiling: Annotated[str | None, typer.Option(help="periodic, random or paper4. With a mask file: tile its one "
                                               "opening.")] = None,
    seed: Annotated[int | None, typer.Option(help="Seed of a random tiling.")] = None,
    layer: Annotated[str | None, typer.Option(help="Layer of a mask file, such as 1/0 or CLEAR.")] = None,
    cell: Annotated[str | None, typer.Option(help="Cell of a mask file; default: its only top cell.")] = None,
    unit: Unit = None,
    stop: Annotated[str, typer.Option(help="Diameter of the lens stop, or a table as in a job: "
                                      "'{ shape = \"ellipse\", width = \"4 mm\", height = \"3.9 mm\" }'.")] = "4 mm",
    stop_shape: Annotated[str, typer.Option(help="circle or square.")] = "circle",
    plate: Annotated[str | None, typer.Option(help="Chrome and glass as in a job's [plate]: '{ optical_density = 4, "
                                              "film_phase = 0.4, glass = { thickness = \"2.3 mm\", index = 1.46, "
                                              "chrome = \"lens\" } }'.")] = None,
    focal: Annotated[str, typer.Option(help="Focal length.")] = "10 mm",
    wavelengths: Annotated[str, typer.Option(help="Wavelengths, separated by commas.")] = "610 nm, 530 nm, 470 nm",
    pixel: Annotated[str, typer.Option(help="Side of a sensor pixel.")] = "2 um",
    window: Annotated[str, typer.Option(help="Side of the PSF window.")] = "256 um",
    gap: Annotated[str | None, typer.Option(help="Scene: distance from panel to stop, such as '1 mm'.")] = None,
    field: Annotated[str | None, typer.Option(help="Scene: largest image height, such as '1 mm'.")] = None,
    depth: Annotated[str | None, typer.Option(help="Scene: nearest and farthest object, such as '0.3 m, inf'.")] = None,
    focus: Annotated[str | None, typer.Option(help="Scene: focus distance; default: infinity.")] = None,
    aberration: Annotated[list[str] | None, typer.Option(help="Scene: Zernike term (Noll) and waves, such as "
                                                         "'4:0.05' (repeatable).")] = None,
    distortion: Annotated[str | None, typer.Option(help="Scene: relative displacement at an image height, positive for "
                                                   "a pincushion, such as '0.02:2 mm'.")] = None,
    spectrum: Annotated[str | None, typer.Option(help="Scene: lines, rgb or a table (.csv).")] = None,
    illuminant: Annotated[str | None, typer.Option(help="Scene: equal, a temperature such as '6500 K' or a table "
                                                   "(.csv).")] = None,
    accuracy: Annotated[str | None, typer.Option(help="Scene: draft, standard, certify or a number.")] = None,
    out: Annotated[Path | None, typer.Option(help="Directory for the PSFs, as EXR and PNG.")] = None,
    as_json: Json = False,
    quiet: Quiet = False,
) -> None:  # fmt: skip
    """Compute PSF, MTF and invariants of an opening or a mask file."""
    from maskfab.api.camera import Camera
    from maskfab.api.verbs.analysing import analyse as analyse_file
    from maskfab.job.read import parse_section
    from maskfab.job.sections import CameraSection
    from maskfab.optics.metrics import fast_lens
    from maskfab.optics.scene.model_bar import MODEL_BAR

    described = {
        "focal": focal,
        "stop": _table(stop, "--stop") if stop.lstrip().startswith("{") else {"shape": stop_shape, "diameter": stop},
        "wavelengths": [line.strip() for line in wavelengths.split(",")],
        "pixel": pixel,
        "window": window,
    }
    camera = Camera.of_section(parse_section(CameraSection, described, where="the command line"))
    scene = {
        "gap": gap,
        "field": field,
        "depth": None if depth is None else [end.strip() for end in depth.split(",")],
        "focus": focus,
        "aberrations": [_aberration(pair) for pair in aberration] if aberration else None,
        "distortion": None if distortion is None else _distortion(distortion),
        "spectrum": spectrum,
        "illuminant": illuminant,
        "accuracy": None if accuracy is None else _ratio(accuracy),
    }
    if out is not None:
        from maskfab.base.folders import check_target

        check_target(out, force=False)
    with named_as_options(context), watched(quiet) as progress:
        analysis = analyse_file(
            file,
            camera,
            pitch=pitch,
            dot=dot,
            gutter=gutter,
            tiling=tiling,
            seed=seed,
            layer=layer,
            cell=cell,
            unit_um=unit_um(unit),
            scene={key: value for key, value in scene.items() if value is not None},
            plate=None if plate is None else _table(plate, "--plate"),
            progress=progress,
        )
    if out is not None:
        from maskfab.base import __version__
        from maskfab.base.provenance import sha256_of_file
        from maskfab.mask.formats.exr import camera_header
        from maskfab.report.pages.pictures import write_analysis

        laid_out = {"pitch": pitch, "dot": dot, "gutter": gutter, "tiling": tiling, "layer": layer, "cell": cell}
        laid_out["seed"] = None if seed is None else str(seed)
        facts: dict[str, str | float] = {
            **camera_header(camera.model),
            "source": file.name,
            "source_sha256": sha256_of_file(file),
            "maskfab_version": __version__,
            **{name: value for name, value in laid_out.items() if value is not None},
        }
        paths = write_analysis(analysis, out, facts)
    if as_json:
        print_json(analysis.to_dict())
    else:
        print_table([q for q in analysis.quantities if not q.name.startswith(MODEL_BAR)])
        left_out = [q for q in analysis.quantities if q.name.startswith(MODEL_BAR)]
        print_methods("not modelled, by size", sorted(left_out, key=lambda q: -float(q.value or 0)))
        tell_notes(fast_lens(camera.model))
        for path in paths if out is not None else ():
            typer.echo(path)
    leave(analysis.passed)


def _table(text: str, option: str) -> dict[str, Any]:
    """An inline table as a job file has it."""
    from maskfab.job.toml import loads

    try:
        found = loads(f"{option[2:]} = {text}")[option[2:]]
    except (ValueError, RecursionError) as error:
        raise JobError(
            "MF101",
            f"{text!r} is not a TOML table",
            where=option,
            cure="Write it as --help shows",
        ) from error
    if not isinstance(found, dict):
        raise JobError("MF105", f"{text!r} is not a table", where=option, cure="Write it as --help shows")
    return found


def _distortion(pair: str) -> dict[str, float | str]:
    try:
        ratio, height = pair.split(":")
        return {"ratio": float(ratio), "height": height.strip()}
    except ValueError as error:
        raise JobError(
            "MF105",
            f"{pair!r} is not a ratio and an image height",
            where="--distortion",
            cure="Write 0.02:2 mm for a displacement of 2 % at 2 mm",
        ) from error


def _aberration(pair: str) -> list[int | float]:
    term, _, waves = pair.partition(":")
    try:
        return [int(term), float(waves)]
    except ValueError as error:
        raise JobError(
            "MF105",
            f"{pair!r} is not Noll's number and waves",
            where="--aberration",
            cure="Write it as 4:0.05",
        ) from error


def _ratio(text: str) -> float | str:
    """A number, or a name for one."""
    try:
        return float(text)
    except ValueError:
        return text
