"""Lengths, wavelengths and units of drawings of callers, as a job file has them."""

from __future__ import annotations

from collections.abc import Mapping
from numbers import Real

from maskfab.base.errors import JobError
from maskfab.base.units import UM_PER_UNIT
from maskfab.job.values import AnySection, length_keys, um_text

Length = str | float
"""``"168 um"``, ``"0.168 mm"``, or 168.0 micrometres."""


Wavelength = str | float
"""``"530 nm"``, or 530.0 nanometres."""


_DRAWING_UNITS = ("nm", "um", "mm", "mil", "in")


def length_text(value: object) -> object:
    """A length as a job file has it; anything but a number is left to the job file's own checks."""
    return um_text(float(value)) if _is_number(value) else value  # type: ignore[arg-type]


def lengths_as_text(stated: Mapping[str, object], section: type[AnySection]) -> dict[str, object]:
    """Keys of a section of a job file, with its lengths as a job file has them."""
    lengths = length_keys(section)
    return {key: length_text(value) if key in lengths else value for key, value in stated.items()}


def wavelength_text(value: object) -> object:
    """A wavelength as a job file has it; anything but a number is left to the job file's own checks."""
    return f"{float(value):.15g} nm" if _is_number(value) else value  # type: ignore[arg-type]


def _is_number(value: object) -> bool:
    return isinstance(value, Real) and not isinstance(value, bool)


def drawing_unit_um(unit: str | float | None) -> float | None:
    """Micrometres of a drawing's unit, which is stated by its name or by them.

    Raises:
        JobError: MF105 for a name that none has.
    """
    if not isinstance(unit, str):
        return unit
    if unit not in _DRAWING_UNITS:
        cure = f"Use one of {', '.join(_DRAWING_UNITS)}"
        raise JobError("MF105", f"there is no unit {unit!r}", where="unit_um", cure=cure)
    return UM_PER_UNIT[unit]
