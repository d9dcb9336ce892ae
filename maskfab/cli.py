"""The command line: verbs, exit codes, and what goes where.

Results go to stdout, progress and errors to stderr. Every verb imports what it needs when it is called.
"""

from __future__ import annotations

import json
import os
import shlex
import sys
import traceback
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from maskfab import __version__, errors
from maskfab.errors import InternalError, JobError, MaskfabError

if TYPE_CHECKING:
    from maskfab.model import Opening, Quantity
    from maskfab.progress import Progress
    from maskfab.validate.accuracy import Workload

_EPILOG = "Exit codes: 0 all checks pass; 1 a check failed; 2 bad input, nothing written; 3 our own fault."

app = typer.Typer(
    name="maskfab",
    help="Photomask plates for under-panel cameras: openings, panels, mask files, and what the files do to a picture.",
    epilog=_EPILOG,
    add_completion=False,
    no_args_is_help=True,
    pretty_exceptions_enable=False,
    rich_markup_mode=None,
)

# Newer releases of typer carry a copy of click of their own, so that class is found through typer.
_UsageError: Any = next(kind for kind in typer.BadParameter.__mro__ if kind.__name__ == "ClickException")

JobFile = Annotated[Path, typer.Argument(metavar="JOB", help="A job file (.toml).")]
Json = Annotated[bool, typer.Option("--json", help="Print one JSON document on stdout and nothing else there.")]
_SHAPES = "stripe, blobs or diamond-discs; with emitters: rgb-stripe, pentile-diamond, delta, circular or window"
_OWN = "21; a display: its own"
_OWN_PITCH = "168 um; a display: its own"
Quiet = Annotated[bool, typer.Option("--quiet", help="No progress on stderr.")]


@app.callback(invoke_without_command=True)
def _common(
    version: Annotated[bool, typer.Option("--version", help="Print the version and leave.", is_eager=True)] = False,
) -> None:
    if version:
        typer.echo(f"maskfab {__version__}")
        raise typer.Exit


@app.command(epilog="Example: maskfab run layouts/upc12.toml --out build/upc12")
def run(
    job: JobFile,
    out: Annotated[Path, typer.Option(help="Output directory; it appears when everything in it is complete.")],
    force: Annotated[bool, typer.Option("--force", help="Replace an earlier result in --out.")] = False,
    as_json: Json = False,
    quiet: Quiet = False,
) -> None:
    """Make a plate: mask files, read back and measured, with a report."""
    from maskfab.layout.job import load
    from maskfab.pipeline import REPORT
    from maskfab.pipeline import run as run_job

    with _watched(quiet) as progress:
        result = run_job(load(job), out, force=force, progress=progress)
    report = result.report
    if not quiet:
        _tell_times(report.seconds)
    if as_json:
        typer.echo((result.directory / REPORT).read_text(encoding="utf-8"), nl=False)
    else:
        for path in sorted(result.directory.iterdir()):
            typer.echo(path)
        _summarise(report.checks)
    _leave(report.passed)


@app.command(epilog="Example: maskfab design layouts/design_inv_random.toml --out opening.toml")
def design(
    job: JobFile,
    out: Annotated[Path | None, typer.Option(help="Where the opening goes; default: design.output of the job.")] = None,
    force: Annotated[bool, typer.Option("--force", help="Replace an existing opening.")] = False,
    as_json: Json = False,
    quiet: Quiet = False,
) -> None:
    """Find an opening whose blur can be undone, by gradient descent."""
    from maskfab.design.job import find, settings
    from maskfab.export.staging import check_file, write_text
    from maskfab.layout.openings import dumps
    from maskfab.spec import read

    spec = read(job)
    wanted = settings(spec, where=str(job), command=f"maskfab design {job.as_posix()}")
    target = out or (job.parent / spec.design.output if spec.design and spec.design.output else None)
    if target is None:
        raise JobError("MF105", "the design has no output file", where=f"{job}: design.output", cure="Add it, or --out")
    check_file(target, force=force)
    with _watched(quiet) as progress:
        opening = find(wanted, progress)
    write_text(target, dumps(opening))
    _tell_opening(opening, target, as_json)


@app.command(
    epilog="Examples: maskfab analyse layouts/openings/toled.toml --tiling random --seed 1 | "
    "maskfab analyse plate.gds --cell TOLED_P150 --json | maskfab analyse photo.png --pitch '168 um' | "
    "maskfab analyse layouts/openings/toled.toml --stop '1 mm' --depth '0.3 m, inf' --accuracy draft"
)
def analyse(
    file: Annotated[Path, typer.Argument(metavar="FILE", help="An opening (.toml .txt .png .tif .exr .npy) or a mask "
                                         "(.gds .oas .dxf).")],
    pitch: Annotated[str | None, typer.Option(help="Side of a cell, such as '168 um' or '150 dpi'.")] = None,
    dot: Annotated[str | None, typer.Option(help="Side of a dot, such as '8 um'.")] = None,
    gutter: Annotated[str, typer.Option(help="Opaque space round every cell.")] = "0 um",
    tiling: Annotated[str | None, typer.Option(help="periodic, random or paper4. For a mask file: it holds one "
                                               "opening.")] = None,
    seed: Annotated[int | None, typer.Option(help="Seed of a random tiling.")] = None,
    layer: Annotated[str | None, typer.Option(help="Layer of a mask file, such as 1/0 or CLEAR.")] = None,
    cell: Annotated[str | None, typer.Option(help="Cell of a mask file; default: its only top cell.")] = None,
    stop: Annotated[str, typer.Option(help="Diameter of the lens stop.")] = "4 mm",
    stop_shape: Annotated[str, typer.Option(help="circle or square.")] = "circle",
    focal: Annotated[str, typer.Option(help="Focal length.")] = "10 mm",
    wavelengths: Annotated[str, typer.Option(help="Lines, separated by commas.")] = "610 nm, 530 nm, 470 nm",
    pixel: Annotated[str, typer.Option(help="Side of a sensor pixel.")] = "2 um",
    window: Annotated[str, typer.Option(help="Side of the PSF's window.")] = "256 um",
    gap: Annotated[str | None, typer.Option(help="Scene: from the panel to the stop, such as '1 mm'.")] = None,
    field: Annotated[str | None, typer.Option(help="Scene: largest image height.")] = None,
    depth: Annotated[str | None, typer.Option(help="Scene: nearest and farthest object, such as '0.3 m, inf'.")] = None,
    focus: Annotated[str | None, typer.Option(help="Scene: what is in focus; default: infinity.")] = None,
    aberration: Annotated[list[str] | None, typer.Option(help="Scene: Noll's number and waves, such as '4:0.05'; "
                                                         "as often as needed.")] = None,
    spectrum: Annotated[str | None, typer.Option(help="Scene: lines, rgb or a table (.csv).")] = None,
    illuminant: Annotated[str | None, typer.Option(help="Scene: equal, a temperature such as '6500 K' or a table "
                                                   "(.csv).")] = None,
    accuracy: Annotated[str | None, typer.Option(help="Scene: draft, standard, certify or a number.")] = None,
    out: Annotated[Path | None, typer.Option(help="Directory for the PSFs as EXR and pictures.")] = None,
    as_json: Json = False,
    quiet: Quiet = False,
) -> None:  # fmt: skip
    """PSF, MTF and invariants of an opening or a mask file."""
    from maskfab import units
    from maskfab.analysis import Request, described_scene
    from maskfab.analysis import analyse as analyse_file
    from maskfab.model import Tiling
    from maskfab.spec import CameraSection, SceneSection, parse_section

    described = {
        "focal": focal,
        "stop": {"shape": stop_shape, "diameter": stop},
        "wavelengths": [line.strip() for line in wavelengths.split(",")],
        "pixel": pixel,
        "window": window,
    }
    if tiling is not None and tiling not in set(Tiling):
        raise JobError("MF105", f"there is no tiling {tiling!r}", where="--tiling", cure=f"Use {', '.join(Tiling)}")
    asked = {
        "gap": gap,
        "field": field,
        "depth": None if depth is None else [end.strip() for end in depth.split(",")],
        "focus": focus,
        "aberrations": [_aberration(pair) for pair in aberration] if aberration else None,
        "spectrum": spectrum,
        "illuminant": illuminant,
        "accuracy": None if accuracy is None else _ratio(accuracy),
    }
    stated = {key: value for key, value in asked.items() if value is not None}
    section = parse_section(SceneSection, stated, where="the command line")
    request = Request(
        camera=parse_section(CameraSection, described, where="the command line").camera(),
        pitch_um=None if pitch is None else units.parse_pitch_um(pitch, where="--pitch"),
        dot_um=None if dot is None else units.parse_length_um(dot, where="--dot"),
        gutter_um=units.parse_length_um(gutter, where="--gutter", zero_allowed=True),
        tiling=None if tiling is None else Tiling(tiling),
        seed=seed,
        layer=layer,
        cell=cell,
        scene=described_scene(section, "the command line") if stated else None,
        accuracy=section.accuracy,
    )
    if out is not None:
        from maskfab.export.staging import check_target

        check_target(out, force=False)
    with _watched(quiet) as progress:
        analysis = analyse_file(file, request, progress)
    if out is not None:
        from maskfab.report.analysis import write

        paths = write(analysis, out)
    if as_json:
        from maskfab.report.data import quantity_document

        _print_json({"name": analysis.name, "quantities": [quantity_document(q) for q in analysis.quantities]})
    else:
        _print_table(analysis.quantities)
        for path in paths if out is not None else ():
            typer.echo(path)
    _leave(analysis.passed)


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


@app.command(epilog="Example: maskfab verify build/upc12")
def verify(
    directory: Annotated[Path, typer.Argument(metavar="DIR", help="The --out of a finished run.")],
    as_json: Json = False,
    quiet: Quiet = False,
) -> None:
    """Read a finished output directory again and repeat every check."""
    from maskfab.verification import verify as verify_directory

    with _watched(quiet) as progress:
        checks = verify_directory(directory, progress)
    passed = all(check.passed for check in checks)
    if as_json:
        from maskfab.report.data import quantity_document

        _print_json({"verdict": "pass" if passed else "fail", "checks": [quantity_document(q) for q in checks]})
    else:
        _summarise(checks)
    _leave(passed)


@app.command(
    epilog="Examples: maskfab shape stripe --dots 21 --pitch '168 um' --width-dots 5 --clear-dots 90 --out s.toml | "
    "maskfab shape circular --length diameter=18 --out ring.toml"
)
def shape(
    context: typer.Context,
    kind: Annotated[str, typer.Argument(metavar="KIND", help=_SHAPES)],
    out: Annotated[Path, typer.Option(help="Where the opening goes.")],
    dots: Annotated[int | None, typer.Option(help="Dots along the side of a cell.", show_default=_OWN)] = None,
    pitch: Annotated[str | None, typer.Option(help="Side of a cell.", show_default=_OWN_PITCH)] = None,
    clear_dots: Annotated[int | None, typer.Option(help="How many dots are clear.")] = None,
    width_dots: Annotated[int, typer.Option(help="stripe: its width.")] = 5,
    size_ratio: Annotated[float, typer.Option(help="blobs: small ones over large ones.")] = 0.7,
    aspect: Annotated[float, typer.Option(help="blobs: their length over their width.")] = 1.25,
    exponent: Annotated[float, typer.Option(help="blobs: 2 is an ellipse, larger is squarer.")] = 4.0,
    lengths: Annotated[
        list[str] | None, typer.Option("--length", metavar="KEY=DOTS", help="Displays: another length, in dots.")
    ] = None,
    name: Annotated[str | None, typer.Option(help="Name of the opening; default: the file's stem.")] = None,
    force: Annotated[bool, typer.Option("--force", help="Replace an existing file.")] = False,
    as_json: Json = False,
) -> None:
    """Draw a parametric opening, or a display's opening with its emitters."""
    from maskfab.export.staging import check_file, write_text
    from maskfab.layout import displays, shapes
    from maskfab.layout.openings import dot_of_pitch, dumps
    from maskfab.model import Opening
    from maskfab.spec import check_name

    check_file(out, force=force)
    check_name(name or out.stem, where="--name")
    display = displays.DISPLAYS.get(kind)
    changed = dots is not None or pitch is not None or bool(lengths)
    own_dots, own_pitch = (display.dots, display.pitch) if display else (21, "168 um")
    dots = own_dots if dots is None else dots
    dot_nm = dot_of_pitch(own_pitch if pitch is None else pitch, dots, where="--pitch")
    facts: dict[str, str | int | float] = {}
    emitters = None
    if display is not None:
        mask, emitters = display.draw(dots, displays.read_lengths(lengths or ()))
        facts.update(displays.facts(display, changed=changed))
    elif lengths:
        raise JobError(
            "MF102", f"{kind} has no lengths", where="--length", cure=f"Draw one of {', '.join(displays.DISPLAYS)}"
        )
    elif kind == "stripe":
        mask = shapes.stripe(dots, width_dots, clear_dots)
    elif clear_dots is None:
        raise JobError(
            "MF105", f"{kind} needs a number of clear dots", where="--clear-dots", cure="Add --clear-dots 90"
        )
    elif kind == "blobs":
        mask = shapes.blobs(dots, clear_dots, size_ratio=size_ratio, aspect=aspect, exponent=exponent)
    elif kind == "diamond-discs":
        mask = shapes.diamond_discs(dots, clear_dots)
    else:
        raise JobError("MF105", f"there is no shape {kind!r}", where="KIND", cure=f"Use {_SHAPES}")
    command = shlex.join(["maskfab", *(word for word in context.obj if word not in {"--force", "--json"})])
    provenance = {"author": "maskfab", "command": command, "version": __version__, **facts}
    opening = Opening(name or out.stem, mask, dot_nm, provenance, emitters)
    write_text(out, dumps(opening))
    _tell_opening(opening, out, as_json)


@app.command(
    epilog="Examples: maskfab bench --out bench | maskfab bench layouts/upc12.toml --die TOLED_R150 | "
    "maskfab bench --hard"
)
def bench(
    job: Annotated[Path | None, typer.Argument(metavar="[JOB]", help="A job; default: a standard panel.")] = None,
    die: Annotated[str | None, typer.Option(help="Which die of the job; default: its first.")] = None,
    hard: Annotated[bool, typer.Option("--hard", help="Run the hard cases instead.")] = False,
    rounds: Annotated[int, typer.Option(min=2, max=1000, help="Timed rounds.")] = 9,
    out: Annotated[Path | None, typer.Option(help="Directory for the figure and the numbers.")] = None,
    as_json: Json = False,
    quiet: Quiet = False,
) -> None:
    """Time every way to a PSF side by side and hold each against the exact one, or run the hard cases."""
    from maskfab.report import bench as report
    from maskfab.validate import accuracy
    from maskfab.validate.cases import CASES
    from maskfab.validate.cases import run as run_cases

    if hard:
        outcomes = []
        for line in report.case_table(outcomes.append(o) or o for o in run_cases(CASES)):  # type: ignore[func-returns-value]
            if not as_json:
                typer.echo(line)
        if as_json:
            _print_json(report.case_document(outcomes))
        _leave(all(outcome.passed for outcome in outcomes))
        return
    workload = accuracy.standard_workload() if job is None else _workload(job, die)
    if out is not None:
        from maskfab.export.staging import check_target

        check_target(out, force=False)
    with _watched(quiet) as progress:
        timings = accuracy.race(workload, rounds, progress)
    bound = accuracy.gemm_bound_ms(workload)
    document = report.race_document(timings, bound)
    if as_json:
        _print_json(document)
    else:
        for line in report.race_table(timings, bound):
            typer.echo(line)
    if out is not None:
        for path in report.write(out, document, report.race_figure(timings)):
            typer.echo(path, err=as_json)


def _workload(path: Path, die: str | None) -> Workload:
    from maskfab.layout.job import load
    from maskfab.validate.accuracy import workload_of

    job = load(path)
    panels = {each.name: each.panel for each in job.plate().dies}
    if die is not None and die not in panels:
        raise JobError("MF105", f"the job has no die {die!r}", where="--die", cure=f"Use one of {', '.join(panels)}")
    return workload_of(panels[die or next(iter(panels))], job.camera)


@app.command(epilog="Examples: maskfab plan layouts/upc12.toml | maskfab plan job.toml --die TOLED_R150 --json")
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
    panels = {each.name: each.panel for each in loaded.plate().dies if die in (None, each.name)}
    if not panels:
        names = ", ".join(each.name for each in loaded.spec.die)
        raise JobError("MF105", f"the job has no die {die!r}", where="--die", cure=f"Use one of {names}")
    plans = {
        name: plan_scene(panel, loaded.camera, loaded.scene or Scene(), section.accuracy)
        for name, panel in panels.items()
    }
    if as_json:
        _print_json({"accuracy": section.accuracy, "dies": [document(name, found) for name, found in plans.items()]})
        return
    for name, found in plans.items():
        for line in table(name, found):
            typer.echo(line)


@app.command(
    epilog="Examples: maskfab render job.toml --out seen | maskfab render job.toml photo.jpg --die TOLED_R300 --json"
)
def render(
    job: JobFile,
    image: Annotated[Path | None, typer.Argument(metavar="[IMAGE]", help="A photograph to show too.")] = None,
    die: Annotated[
        list[str] | None, typer.Option(help="Which die, or dies, of the job; default: all with emitters.")
    ] = None,
    dpi: Annotated[float | None, typer.Option(help="Look at the panels scaled to it; default: as they are.")] = None,
    distance: Annotated[str, typer.Option(help="From the eye to the display.")] = "300 mm",
    pixels: Annotated[int | None, typer.Option(help="Along a side; default: 100, or all there are.")] = None,
    samples: Annotated[int, typer.Option(help="Along the side of a pixel.")] = 21,
    with_jod: Annotated[bool, typer.Option("--jod", help="Ask ColorVideoVDP too; needs maskfab[eye].")] = False,
    out: Annotated[Path | None, typer.Option(help="Directory for the pictures and the numbers.")] = None,
    as_json: Json = False,
    quiet: Quiet = False,
) -> None:
    """Show pictures on the panels, and say what the eye sees of emitters and openings."""
    from maskfab import units
    from maskfab.imaging.display import emitters_of, has_emitters
    from maskfab.imaging.picture import read
    from maskfab.imaging.score import judge, pictures
    from maskfab.imaging.viewing import Viewing
    from maskfab.layout.job import load
    from maskfab.report import render as report

    if out is not None:
        from maskfab.export.staging import check_target

        check_target(out, force=False)
    distance_um = units.parse_length_um(distance, where="--distance", zero_allowed=True)
    pitch_um = None if dpi is None else units.parse_pitch_um(f"{dpi!r} dpi", where="--dpi")
    loaded = load(job)
    panels = {each.name: each.panel for each in loaded.plate().dies}
    for name in die or ():
        if name not in panels:
            listed = ", ".join(panels)
            raise JobError("MF105", f"the job has no die {name!r}", where="--die", cure=f"Use one of {listed}")
    photograph = None if image is None else read(image)
    lit = [name for name, panel in panels.items() if has_emitters(panel)]
    shown = list(dict.fromkeys(die or lit or panels))
    for name in shown:
        emitters_of(panels[name])
    judged = []
    with _watched(quiet) as progress:
        for done, name in enumerate(shown):
            progress("panels", done, len(shown))
            panel = panels[name]
            viewing = Viewing(pitch_um or panel.pitch_nm / units.NM_PER_UM, distance_um)
            side = min(100, *panel.orientations.shape) if pixels is None else pixels
            judged.append(judge(name, panel, pictures(side, photograph), samples, viewing, with_jod=with_jod))
        progress("panels", len(shown), len(shown))
        paths = [] if out is None else report.write(out, judged, samples, loaded.digest, progress)
    if as_json:
        _print_json(report.document(judged, samples, loaded.digest))
        return
    for each in judged:
        typer.echo(each.name)
        _print_table(each.quantities)
    for path in paths:
        typer.echo(path)


@app.command(epilog="Example: maskfab explain MF106")
def explain(
    code: Annotated[str, typer.Argument(metavar="CODE", help="A code such as MF106.")], as_json: Json = False
) -> None:
    """Say what an error code means."""
    known = errors.CATALOGUE.get(code.upper())
    if known is None:
        listed = ", ".join(errors.CATALOGUE)
        raise JobError("MF105", f"there is no code {code!r}", cure=f"The codes are {listed}")
    if as_json:
        _print_json({"code": code.upper(), "meaning": known})
    else:
        typer.echo(f"{code.upper()} {known}")


def run_command_line(arguments: Sequence[str]) -> int:
    """Run one command; every failure becomes an exit code and one message."""
    try:
        command = typer.main.get_command(app)
        code = command.main(list(arguments), prog_name="maskfab", standalone_mode=False, obj=list(arguments))
        return code if isinstance(code, int) else 0
    except typer.Exit as leaving:
        return leaving.exit_code
    except typer.Abort:
        return 130
    except _UsageError as wrong:
        wrong.show()
        if "--json" in arguments:
            cure = "See maskfab --help"
            _print_error(JobError("MF105", wrong.format_message(), where="the command line", cure=cure))
        return 2
    except MaskfabError as error:
        return _tell(error, "--json" in arguments)
    except BrokenPipeError:
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return 0
    except Exception as fault:
        traceback.print_exc()
        problem = InternalError(
            "MF901", f"{type(fault).__name__}: {fault}", cure="Please report this with the job file"
        )
        return _tell(problem, "--json" in arguments)


def _tell(error: MaskfabError, as_json: bool) -> int:
    typer.echo(f"error: {error}", err=True)
    if as_json:
        _print_error(error)
    return error.exit_code


def _print_error(error: MaskfabError) -> None:
    told = {"code": error.code, "what": error.what, "where": error.where, "cure": error.cure}
    _print_json({"error": told})


def _leave(passed: bool) -> None:
    if not passed:
        raise typer.Exit(1)


def _print_json(document: dict[str, Any]) -> None:
    typer.echo(json.dumps(document, indent=1, ensure_ascii=False, allow_nan=False))


def _tell_opening(opening: Opening, path: Path, as_json: bool) -> None:
    if as_json:
        facts = {"name": opening.name, "path": str(path), "clear_dots": opening.clear_dots}
        _print_json({**facts, "open_ratio": opening.open_ratio, "provenance": dict(opening.provenance)})
    else:
        typer.echo(path)


def _summarise(checks: Sequence[Quantity]) -> None:
    failed = [check for check in checks if check.passed is False]
    for check in failed:
        place = f" [{check.die}]" if check.die else ""
        typer.echo(
            f"FAIL {check.name}{place} = {check.value} {check.unit} (limit {check.limit}): {check.method}", err=True
        )
    verdict = "FAIL" if failed else "PASS"
    typer.echo(f"{verdict}: {len(checks) - len(failed)} of {len(checks)} checks pass", err=True)


def _tell_times(seconds: Mapping[str, float]) -> None:
    """What the optics of every die took."""
    for stage, took in seconds.items():
        kind, _, die = stage.partition(" ")
        if kind == "optics" and die:
            scene = seconds.get(f"scene {die}")
            more = "" if scene is None else f", scene {scene:.2f} s"
            typer.echo(f"{die}: optics {took:.2f} s{more}", err=True)


def _print_table(quantities: Iterable[Quantity]) -> None:
    rows = [("quantity", "line", "value", "error", "unit", "limit")]
    for q in quantities:
        line = "" if q.wavelength_nm is None else f"{q.wavelength_nm:g} nm"
        value = "-" if q.value is None else f"{q.value:.6g}" if isinstance(q.value, float) else str(q.value)
        error = "" if not q.uncertainty else f"± {q.uncertainty:.1e}"
        limit = "" if q.passed is None else f"{'pass' if q.passed else 'FAIL'} ({q.limit})"
        rows.append((q.name, line, value, error, q.unit, limit))
    widths = [max(len(row[k]) for row in rows) for k in range(len(rows[0]))]
    for row in rows:
        typer.echo("  ".join(cell.ljust(width) for cell, width in zip(row, widths, strict=True)).rstrip())


class _watched:  # noqa: N801 - reads as a word in a with statement
    """A progress bar on a terminal, plain lines elsewhere, on stderr."""

    def __init__(self, quiet: bool) -> None:
        self._quiet = quiet
        self._bar: Any = None
        self._tasks: dict[str, Any] = {}

    def __enter__(self) -> Progress:
        from maskfab.progress import silent

        if self._quiet:
            return silent
        if not sys.stderr.isatty():
            return _plain_line
        from rich.console import Console
        from rich.progress import Progress as Bar

        self._bar = Bar(console=Console(stderr=True), transient=False)
        self._bar.start()
        return self._advance

    def __exit__(self, *_: object) -> None:
        if self._bar is not None:
            self._bar.stop()

    def _advance(self, stage: str, done: int, total: int) -> None:
        if stage not in self._tasks:
            self._tasks[stage] = self._bar.add_task(stage, total=total)
        self._bar.update(self._tasks[stage], completed=done, total=total)


def _plain_line(stage: str, done: int, total: int) -> None:
    """One line a stage begun and ended, and one at each tenth of a long one."""
    tenth = max(1, total // 10)
    if done in (0, total) or done % tenth == 0:
        typer.echo(f"{stage}: {done}/{total}", err=True)
