"""Values of a job file and their types: lengths and areas with their units, names, text, formats, counts, colours."""

from __future__ import annotations

import math
import re
from itertools import islice
from typing import Annotated, Literal, TypeAlias, get_args

from pydantic import AfterValidator, BaseModel, BeforeValidator, Field, PlainSerializer

from maskfab import units
from maskfab.errors import JobError
from maskfab.jobfile.problems import refusing

_NAME = re.compile(r"[A-Za-z][A-Za-z0-9_]{0,23}")
_DEVICE = re.compile(r"(?i)con|prn|aux|nul|(?:com|lpt)[0-9]")
_AREA = re.compile(r"\s*(\S+?)\s*(nm|um|µm|mm)(?:\^2|2|²)\s*")
_LONGEST_UM = 1e9
_LARGEST_PLATE_UM = 2e6
_MOST_COUNTS = 64

Method = Literal["search", "relax"]
METHODS: tuple[str, ...] = get_args(Method)
Symmetry = Literal["d4", "mirror", "rot180"]
Kissing = Literal["allowed", "cell", "neighbours"]
ObjectiveName = Literal["invertibility", "top_residual", "expected_error", "boundary_leak", "mtf_auc", "area"]
Weight = Annotated[float, Field(ge=0, le=1e9, allow_inf_nan=False)]

FileFormat: TypeAlias = Literal[
    "gdsii",
    "oasis",
    "dxf_r12",
    "dxf_r2010",
    "gerber",
    "cif",
    "svg",
    "step",
    "glb",
    "3mf",
    "stl",
    "png",
    "tiff",
    "exr",
    "plate_tiff",
    "plate_bmp",
]
MASK_FORMATS: tuple[FileFormat, ...] = ("gdsii", "oasis", "dxf_r12", "dxf_r2010")
"""Default formats of a plate."""

MEASURED_FORMATS: tuple[FileFormat, ...] = (*MASK_FORMATS, "cif")
"""Formats from which a plate's optics can be measured."""

PlateBitmap: TypeAlias = Literal["plate_tiff", "plate_bmp"]
PLATE_BITMAPS: tuple[PlateBitmap, ...] = get_args(PlateBitmap)
"""Formats of a whole plate as a plotter's dots."""

MOST_DOTS_PER_UM = 100
"""Pixels of a PNG or a TIFF in a micrometre."""


def check_name(name: object, *, where: str = "") -> str:
    """Refuse a name that mask houses would refuse in a GDSII library.

    Raises:
        JobError: MF110. A name has 1 to 24 letters, digits and underscores, a letter first (files carry suffixes
            within the 32 characters of GDSII), and nowhere "main", which mask houses keep for their own top cell. Nor
            is it a device of Windows, where no file can have its name.
    """
    if not isinstance(name, str):
        raise JobError("MF105", f"{name!r} is not text", where=where, cure='Write a name such as "TOLED_150"')
    if "main" in name.lower():
        problem = f'the name {name!r} holds "main", which mask houses refuse'
        raise JobError("MF110", problem, where=where, cure='Choose a name without "main", such as "TOLED_150"')
    if _DEVICE.fullmatch(name):
        problem = f"the name {name!r} is that of a device, and Windows has no file called so"
        raise JobError("MF110", problem, where=where, cure='Choose another name, such as "TOLED_150"')
    if not _NAME.fullmatch(name):
        raise JobError(
            "MF110",
            f"the name {name!r} of {len(name)} characters is not a letter followed by at most 23 letters, digits or "
            "underscores",
            where=where,
            cure='Use a name such as "TOLED_150"; the name of a file is its stem unless one is given',
        )
    return name


def _listed(value: object) -> object:
    return [value] if isinstance(value, str) else value


def um_text(value: float) -> str:
    """Micrometres as a job file writes them."""
    return f"{value:.15g} um"


def distance_text(value: float) -> str:
    """A distance, which may be infinite, as a job file writes it."""
    return "inf" if math.isinf(value) else um_text(value)


def _nm_text(value: float) -> str:
    return f"{value:.15g} nm"


def length_um(value: object, *, zero_allowed: bool = False) -> float:
    """Micrometres of a length written with its unit, at most 1 km.

    Raises:
        JobError: MF103 for a missing or wrong unit, MF104 for a length out of range.
    """
    return _in_range(units.parse_length_um(value, zero_allowed=zero_allowed), value)


def _in_range(length: float, value: object) -> float:
    if length > _LONGEST_UM:
        raise JobError("MF104", f"{value!r} is longer than the limit of 1 km", cure="Give a length of at most 1 km")
    return length


def _pitch(value: object) -> float:
    return _in_range(float(f"{units.parse_pitch_um(value):.15g}"), value)  # densities give more digits than are meant


def _on_plate(value: object) -> float:
    length = length_um(value)
    if length > _LARGEST_PLATE_UM:
        raise JobError(
            "MF104",
            f"{value!r} is more than 2 m, beyond what the coordinates of GDSII reach in steps of 1 nm",
            cure="Give a length of at most 2 m",
        )
    return length


def _drawn(text: object) -> object:
    """Text that the plate shows in letters of its own; its type is checked elsewhere."""
    lacking = sorted({c for c in text if not " " <= c <= "~"}) if isinstance(text, str) else []
    if lacking:
        raise JobError(
            "MF110",
            f"the plate's font has no {', '.join(map(repr, lacking))} for the text {text!r}",
            cure="Use ASCII letters, digits and punctuation",
        )
    return text


def _area(value: object) -> float:
    """Square micrometres of an area such as ``"1985 um^2"``."""
    match = _AREA.fullmatch(value) if isinstance(value, str) else None
    if match is None:
        raise JobError("MF103", f"{value!r} is not an area with its unit", cure='Write it as "1985 um^2"')
    # A number times a unit squared is a length in that unit, times the unit once more.
    once = units.parse_length_um(f"{match[1]} {match[2]}", zero_allowed=True)
    return float(f"{once * units.parse_length_um(f'1 {match[2]}'):.15g}")


def _area_text(value: float) -> str:
    return f"{value:.15g} um^2"


def _three(value: object) -> tuple[float, float, float]:
    """Three finite positive numbers, for red, green and blue."""
    parts = value if isinstance(value, list | tuple) else ()
    numbers = [part for part in parts if isinstance(part, int | float) and not isinstance(part, bool)]
    if len(parts) != 3 or len(numbers) != 3 or not all(math.isfinite(part) and part > 0 for part in numbers):
        raise JobError(
            "MF116", f"{value!r} is not three positive numbers", cure="Give red, green and blue, such as [1, 1, 2]"
        )
    red, green, blue = (float(part) for part in numbers)
    return red, green, blue


def length_keys(section: type[BaseModel]) -> frozenset[str]:
    """Keys of a job file's section that hold one length each: those that are written as lengths."""
    return frozenset(
        key
        for key, field in section.model_fields.items()
        for each in (*field.metadata, *(mark for kind in get_args(field.annotation) for mark in get_args(kind)[1:]))
        if isinstance(each, PlainSerializer) and each.func in (um_text, distance_text)
    )


def checked_formats(formats: tuple[FileFormat, ...]) -> tuple[FileFormat, ...]:
    """Refuse formats of which the first is no layout, or one is named twice.

    Raises:
        JobError: MF105.
    """
    if formats[0] not in MEASURED_FORMATS:
        raise JobError(
            "MF105",
            f"{list(formats)}: the optics are measured from the first file, and {formats[0]} cannot be measured",
            cure=f"Put one of {', '.join(MEASURED_FORMATS)} first",
        )
    if len(set(formats)) < len(formats):
        raise JobError("MF105", f"{list(formats)}: a format is named twice", cure="Name each once")
    return formats


def signed_length_um(value: object) -> float:
    """Micrometres of a length that may be negative; raises as :func:`length_um`."""
    if not (isinstance(value, str) and value.strip().startswith("-")):
        return length_um(value, zero_allowed=True)
    try:
        return -length_um(value.strip()[1:], zero_allowed=True)
    except JobError as error:
        what = f"{value!r} is no finite length of at most 1 km, with one sign and a unit"
        raise JobError(error.code, what, cure='Write it as "-0.1 um"') from error


def _listed_counts(value: object) -> object:
    """A table of ``from``, ``to`` and ``step`` as the list that it stands for; anything else as it is."""
    if not isinstance(value, dict):
        return value
    asked = {"step": 1, **value}
    if (
        asked.keys() != {"from", "to", "step"}
        or not all(type(each) is int for each in asked.values())
        or not 1 <= asked["from"] <= asked["to"]
        or asked["step"] < 1
    ):
        raise JobError(
            "MF105",
            f"{value!r} is not a range of whole numbers from 1 upwards",
            cure="Write { from = 60, to = 110, step = 10 }, or a list",
        )
    # One more than may be is enough to be refused.
    return list(islice(range(asked["from"], asked["to"] + 1, asked["step"]), _MOST_COUNTS + 1))


Length = Annotated[float, BeforeValidator(lambda v: refusing(length_um, v)), PlainSerializer(um_text)]
LengthOrZero = Annotated[
    float,
    BeforeValidator(lambda v: refusing(length_um, v, zero_allowed=True)),
    PlainSerializer(um_text),
]
PlateLength = Annotated[float, BeforeValidator(lambda v: refusing(_on_plate, v)), PlainSerializer(um_text)]
Pitch = Annotated[float, BeforeValidator(lambda v: refusing(_pitch, v)), PlainSerializer(um_text)]
Wavelength = Annotated[
    float, BeforeValidator(lambda v: refusing(units.parse_wavelength_nm, v)), PlainSerializer(_nm_text)
]
DrawnText = Annotated[str, BeforeValidator(lambda v: refusing(_drawn, v))]
Frequency = Annotated[
    float,
    BeforeValidator(lambda v: refusing(units.parse_frequency_cy_per_mm, v)),
    PlainSerializer(lambda v: f"{v:.15g} cy/mm"),
]
"""On the sensor, in cycles per millimetre."""
Names = Annotated[tuple[str, ...], BeforeValidator(_listed), Field(min_length=1, strict=False)]
Name = Annotated[str, BeforeValidator(lambda v: refusing(check_name, v))]
Area = Annotated[float, BeforeValidator(lambda v: refusing(_area, v)), PlainSerializer(_area_text)]
ThreeColours = Annotated[tuple[float, float, float], BeforeValidator(lambda v: refusing(_three, v))]
SignedLength = Annotated[float, BeforeValidator(lambda v: refusing(signed_length_um, v)), PlainSerializer(um_text)]
Time = Annotated[
    float, BeforeValidator(lambda v: refusing(units.parse_time_s, v)), PlainSerializer(lambda v: f"{v:.15g} s")
]
"""Seconds."""
Dpi = Annotated[int, BeforeValidator(lambda v: refusing(units.parse_dpi, v)), PlainSerializer(lambda v: f"{v} dpi")]
"""Dots per inch of a plotter."""
Formats = Annotated[
    tuple[FileFormat, ...],
    Field(min_length=1, strict=False),
    AfterValidator(lambda v: refusing(checked_formats, v)),
]
Counts = Annotated[
    tuple[Annotated[int, Field(ge=1)], ...],
    Field(min_length=1, max_length=_MOST_COUNTS, strict=False),
    BeforeValidator(lambda v: refusing(_listed_counts, v)),
]
