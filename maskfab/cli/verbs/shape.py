"""``maskfab shape``: openings drawn from a few numbers."""

from __future__ import annotations

import shlex
from pathlib import Path
from typing import Annotated

import typer

from maskfab import __version__
from maskfab.cli.common.options import Json
from maskfab.cli.common.printing import tell_opening
from maskfab.errors import JobError

SHAPES = "stripe, blobs or diamond-discs; with emitters: rgb-stripe, pentile-diamond, delta, circular or window"
_OWN = "21; a display: its own"
_OWN_PITCH = "168 um; a display: its own"


def shape(
    context: typer.Context,
    kind: Annotated[str, typer.Argument(metavar="KIND", help=SHAPES)],
    out: Annotated[Path, typer.Option(help="File for the opening.")],
    dots: Annotated[int | None, typer.Option(help="Dots along the side of a cell.", show_default=_OWN)] = None,
    pitch: Annotated[str | None, typer.Option(help="Side of a cell.", show_default=_OWN_PITCH)] = None,
    clear_dots: Annotated[int | None, typer.Option(help="Number of clear dots.")] = None,
    width_dots: Annotated[int, typer.Option(help="stripe: width in dots.")] = 5,
    size_ratio: Annotated[float, typer.Option(help="blobs: size of the small blobs relative to the large ones.")] = 0.7,
    aspect: Annotated[float, typer.Option(help="blobs: aspect ratio, length over width.")] = 1.25,
    exponent: Annotated[
        float, typer.Option(help="blobs: superellipse exponent; 2 is an ellipse, larger is squarer.")
    ] = 4.0,
    lengths: Annotated[
        list[str] | None,
        typer.Option("--length", metavar="KEY=DOTS", help="displays: set a length, in dots (repeatable)."),
    ] = None,
    name: Annotated[str | None, typer.Option(help="Name of the opening; default: the file's stem.")] = None,
    force: Annotated[bool, typer.Option("--force", help="Replace an existing file.")] = False,
    as_json: Json = False,
) -> None:
    """Draw a parametric opening, or the opening of a display with its emitters."""
    from maskfab.files.staging import check_file, write_text
    from maskfab.jobfile import check_name
    from maskfab.model import Opening
    from maskfab.opening import display_layouts, shapes
    from maskfab.opening.openings import dot_of_pitch, dumps
    from maskfab.units import parse_pitch_um

    check_file(out, force=force)
    check_name(name or out.stem, where="--name")
    display = display_layouts.DISPLAYS.get(kind)
    changed = dots is not None or pitch is not None or bool(lengths)
    own_dots, own_pitch = (display.dots, display.pitch) if display else (21, "168 um")
    dots = own_dots if dots is None else dots
    dot_nm = dot_of_pitch(parse_pitch_um(own_pitch if pitch is None else pitch, where="--pitch"), dots, where="--pitch")
    facts: dict[str, str | int | float] = {}
    emitters = None
    if display is not None:
        mask, emitters = display.draw(dots, display_layouts.read_lengths(lengths or ()))
        facts.update(display_layouts.facts(display, changed=changed))
    elif lengths:
        raise JobError(
            "MF102",
            f"{kind} has no lengths",
            where="--length",
            cure=f"Draw one of {', '.join(display_layouts.DISPLAYS)}",
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
        raise JobError("MF105", f"there is no shape {kind!r}", where="KIND", cure=f"Use {SHAPES}")
    command = shlex.join(["maskfab", *(word for word in context.obj if word not in {"--force", "--json"})])
    provenance = {"author": "maskfab", "command": command, "version": __version__, **facts}
    opening = Opening(name or out.stem, mask, dot_nm, provenance, emitters)
    write_text(out, dumps(opening), replace=force)
    tell_opening(opening, out, as_json)
