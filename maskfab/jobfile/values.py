"""Values of a job file and their types: lengths and wavelengths with their units, names, text on the plate."""

from __future__ import annotations

import re
from typing import Annotated

from pydantic import BeforeValidator, PlainSerializer

from maskfab import units
from maskfab.errors import JobError
from maskfab.jobfile.problems import refusing

_NAME = re.compile(r"[A-Za-z][A-Za-z0-9_]{0,23}")
_DEVICE = re.compile(r"(?i)con|prn|aux|nul|(?:com|lpt)[0-9]")
_LONGEST_UM = 1e9
_LARGEST_PLATE_UM = 2e6


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


def um_text(value: float) -> str:
    """Micrometres as a job file writes them."""
    return f"{value:.15g} um"


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
Name = Annotated[str, BeforeValidator(lambda v: refusing(check_name, v))]
