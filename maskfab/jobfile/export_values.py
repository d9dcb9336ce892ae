"""Values of [export] and [process]."""

from __future__ import annotations

from typing import Annotated, Literal, TypeAlias

from pydantic import AfterValidator, BeforeValidator, Field, PlainSerializer

from maskfab.errors import JobError
from maskfab.jobfile.problems import refusing
from maskfab.jobfile.values import length_um, um_text

FileFormat: TypeAlias = Literal[
    "gdsii", "oasis", "dxf_r12", "dxf_r2010", "gerber", "svg", "step", "glb", "3mf", "stl", "png", "tiff", "exr"
]
MASK_FORMATS: tuple[FileFormat, ...] = ("gdsii", "oasis", "dxf_r12", "dxf_r2010")
"""Default formats of a plate, and those from which its optics can be measured."""

MOST_DOTS_PER_UM = 100
"""Pixels of a PNG or a TIFF in a micrometre."""


def checked_formats(formats: tuple[FileFormat, ...]) -> tuple[FileFormat, ...]:
    """Refuse formats of which the first is no layout, or one is named twice.

    Raises:
        JobError: MF105.
    """
    if formats[0] not in MASK_FORMATS:
        raise JobError(
            "MF105",
            f"{list(formats)}: the optics are measured from the first file, and {formats[0]} cannot be measured",
            cure=f"Put one of {', '.join(MASK_FORMATS)} first",
        )
    if len(set(formats)) < len(formats):
        raise JobError("MF105", f"{list(formats)}: a format is named twice", cure="Name each once")
    return formats


def signed_length_um(value: object) -> float:
    """Micrometres of a length that may be negative; raises as :func:`maskfab.jobfile.values.length_um`."""
    if not (isinstance(value, str) and value.strip().startswith("-")):
        return length_um(value, zero_allowed=True)
    try:
        return -length_um(value.strip()[1:], zero_allowed=True)
    except JobError as error:
        what = f"{value!r} is no finite length of at most 1 km, with one sign and a unit"
        raise JobError(error.code, what, cure='Write it as "-0.1 um"') from error


SignedLength = Annotated[float, BeforeValidator(lambda v: refusing(signed_length_um, v)), PlainSerializer(um_text)]
Formats = Annotated[
    tuple[FileFormat, ...],
    Field(min_length=1, strict=False),
    AfterValidator(lambda v: refusing(checked_formats, v)),
]
