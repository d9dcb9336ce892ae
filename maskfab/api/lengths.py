"""Lengths as a notebook states them: text with a unit, or a number of micrometres; of wavelengths, nanometres."""

from __future__ import annotations

from collections.abc import Mapping
from numbers import Real

from pydantic import BaseModel

from maskfab.job.values import length_keys, um_text

Length = str | float
"""``"168 um"``, ``"0.168 mm"``, or 168.0 micrometres."""
Wavelength = str | float
"""``"530 nm"``, or 530.0 nanometres."""


def length_text(value: object) -> object:
    """A length as a job file has it; anything but a number is left to the job file's own checks."""
    return um_text(float(value)) if _is_number(value) else value  # type: ignore[arg-type]


def lengths_as_text(stated: Mapping[str, object], section: type[BaseModel]) -> dict[str, object]:
    """Keys of a section of a job file, with its lengths as a job file has them."""
    lengths = length_keys(section)
    return {key: length_text(value) if key in lengths else value for key, value in stated.items()}


def wavelength_text(value: object) -> object:
    """A wavelength as a job file has it; anything but a number is left to the job file's own checks."""
    return f"{float(value):.15g} nm" if _is_number(value) else value  # type: ignore[arg-type]


def _is_number(value: object) -> bool:
    return isinstance(value, Real) and not isinstance(value, bool)
