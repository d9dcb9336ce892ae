"""``maskfab shape``: openings drawn from a few numbers."""

from __future__ import annotations

import shlex
from pathlib import Path
from typing import Annotated

import typer

from maskfab.cli.common.options import Json, named_as_options
from maskfab.cli.common.printing import tell_opening

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
    from maskfab.api.verbs.shapes import shape as drawn
    from maskfab.base.folders import check_file, write_text
    from maskfab.mask import emitter_layouts as display_layouts
    from maskfab.mask.opening_file import opening_text

    check_file(out, force=force)
    with named_as_options(context):
        opening = drawn(
            kind,
            dots=dots,
            pitch=pitch,
            clear_dots=clear_dots,
            width_dots=width_dots,
            size_ratio=size_ratio,
            aspect=aspect,
            exponent=exponent,
            lengths=display_layouts.read_lengths(lengths or ()),
            name=name or out.stem,
            command=shlex.join(["maskfab", *(word for word in context.obj if word not in {"--force", "--json"})]),
        )
    write_text(out, opening_text(opening), replace=force)
    tell_opening(opening, out, as_json)
