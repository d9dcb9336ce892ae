"""Openings drawn by rule, with the emitters of displays where they have some."""

from __future__ import annotations

from collections.abc import Mapping

from maskfab.api.lengths import Length, length_text
from maskfab.api.opening import Opening
from maskfab.base import __version__
from maskfab.base.checks import checked_arguments
from maskfab.base.errors import JobError
from maskfab.base.units import parse_pitch_um
from maskfab.job.values import check_name
from maskfab.mask import emitter_layouts
from maskfab.mask.opening import blobs, diamond_discs, stripe
from maskfab.mask.opening_file import dot_of_pitch

_DRAWN = ("stripe", "blobs", "diamond-discs")
_USUAL_DOTS, _USUAL_PITCH = 21, "168 um"


@checked_arguments
def shape(
    kind: str,
    *,
    dots: int | None = None,
    pitch: Length | None = None,
    clear_dots: int | None = None,
    width_dots: int = 5,
    size_ratio: float = 0.7,
    aspect: float = 1.25,
    exponent: float = 4.0,
    lengths: Mapping[str, int] | None = None,
    name: str | None = None,
    command: str | None = None,
) -> Opening:
    """Draw a parametric opening, or the opening of a display with its emitters.

    Examples:
        >>> import maskfab as mf
        >>> mf.shape("stripe", width_dots=6).clear_dots
        126

    Args:
        kind: one of :func:`shapes`.
        dots: along the side of a cell; by default 21, or a display's own.
        pitch: side of a cell; by default 168 um, or a display's own.
        clear_dots: number of clear dots; blobs and discs need it.
        width_dots: of a stripe.
        size_ratio: of blobs: size of the small ones relative to the large ones.
        aspect: of blobs: length over width.
        exponent: of blobs: 2 is an ellipse, larger is squarer.
        lengths: of displays: in dots, by name.
        name: of the opening; by default the kind.
        command: what reproduces it, for its provenance; by default this call.

    Raises:
        JobError: MF105 for an unknown kind or a missing number, MF102 for lengths that it does not have, MF104 to MF107
            for numbers, MF110 for the name.
        OpeningError: MF204 where so many dots cannot be clear.
    """
    if kind not in shapes():
        raise JobError("MF105", f"there is no shape {kind!r}", where="kind", cure=f"Use {', '.join(shapes())}")
    called = check_name(name or kind.replace("-", "_"), where="name")
    display = emitter_layouts.DISPLAYS.get(kind)
    changed = dots is not None or pitch is not None or bool(lengths)
    own_dots, own_pitch = (display.dots, display.pitch) if display else (_USUAL_DOTS, _USUAL_PITCH)
    dots = own_dots if dots is None else dots
    pitch_um = parse_pitch_um(own_pitch if pitch is None else length_text(pitch), where="pitch")
    dot_nm = dot_of_pitch(pitch_um, dots, where="pitch")
    made: dict[str, str | int | float] = {
        "author": "maskfab",
        "command": command or f"maskfab.shape({kind!r}, dots={dots}, pitch={pitch!r}, clear_dots={clear_dots})",
        "version": __version__,
    }
    emitters = None
    if display is not None:
        mask, emitters = display.draw(dots, dict(lengths or {}))
        made.update(emitter_layouts.source_facts(display, changed=changed))
    elif lengths:
        cure = f"Draw one of {', '.join(emitter_layouts.DISPLAYS)}"
        raise JobError("MF102", f"{kind} has no lengths", where="lengths", cure=cure)
    elif kind == "stripe":
        mask = stripe(dots, width_dots, clear_dots)
    elif clear_dots is None:
        raise JobError("MF105", f"{kind} needs a number of clear dots", where="clear_dots", cure="Add 90 clear dots")
    elif kind == "blobs":
        mask = blobs(dots, clear_dots, size_ratio=size_ratio, aspect=aspect, exponent=exponent)
    else:
        mask = diamond_discs(dots, clear_dots)
    return Opening(called, mask, dot_nm, made, emitters)


@checked_arguments
def shapes() -> tuple[str, ...]:
    """Every kind that :func:`shape` draws."""
    return (*_DRAWN, *emitter_layouts.DISPLAYS)
