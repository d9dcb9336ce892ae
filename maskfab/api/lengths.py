"""Lengths, wavelengths and units of drawings of callers, as a job file has them."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from numbers import Real
from types import MappingProxyType
from typing import Any, NamedTuple, TypeAlias, get_args

import numpy as np
from numpy.typing import NDArray

from maskfab.base.errors import JobError
from maskfab.base.units import UM_PER_UNIT, parse_length_um, parse_wavelength_nm
from maskfab.job.values import AnySection, DrawingUnit, length_keys, sections_of, um_text

Length = str | float
"""``"168 um"``, ``"0.168 mm"``, or 168.0 micrometres."""

Wavelength = str | float
"""``"530 nm"``, or 530.0 nanometres."""
Wavelengths: TypeAlias = "Sequence[Wavelength] | NDArray[Any]"
"""Several wavelengths, each as text with its unit or as a number of nanometres; an array has one dimension."""


class Usual(NamedTuple):
    """Range of the things of a name, beyond which a number without a unit is taken for a slip."""

    name: str
    least: str
    most: str
    example: str

    def holds(self, number: float, unit: str) -> bool:
        """Whether a number of a unit lies in the range."""
        least, most = (parse_length_um(end) for end in (self.least, self.most))
        # A decimal number times its unit errs by rounding.
        return least * (1 - 1e-12) <= number * UM_PER_UNIT[unit] <= most * (1 + 1e-12)


USUAL: Mapping[str, Usual] = MappingProxyType(
    {
        "focal": Usual("focal length", "0.1 mm", "2 m", "5.6 mm"),
        "stop": Usual("stop", "10 um", "1 m", "3 mm"),
        "pixel": Usual("sensor pixel", "0.1 um", "200 um", "2 um"),
        "window": Usual("window of a PSF", "1 um", "100 mm", "256 um"),
        "pitch": Usual("pitch", "2 um", "20 mm", "168 um"),
        "dot": Usual("dot", "50 nm", "2 mm", "8 um"),
        "size": Usual("side of a panel", "10 um", "1 m", "4.4 mm"),
        "blank": Usual("side of a blank", "5 mm", "1 m", "127 mm"),
        "distance": Usual("viewing distance", "1 mm", "100 m", "300 mm"),
        "glass": Usual("thickness of glass", "10 um", "100 mm", "2.3 mm"),
        "wavelength": Usual("wavelength", "200 nm", "2 um", "530 nm"),
    }
)
"""Lengths that callers state, by what they are of; wide on purpose, for a refusal must be sure."""
_MEANT = ("mm", "um", "m", "nm", "cm", "in", "mil")
"""Units that a number may have been meant in, the likeliest first."""

_DRAWING_UNITS = get_args(DrawingUnit)


def length_text(value: object, of: str = "", where: str = "") -> object:
    """A length as a job file has it; anything but a number is left to the job file's own checks.

    Args:
        value: the length.
        of: what it is of, a key of :data:`USUAL`.
        where: place of the argument, for the refusal.

    Raises:
        JobError: MF156 for a number that makes no sense in micrometres.
    """
    if not _is_number(value):
        return value
    if of:
        _require_usual(float(value), "um", of, where or of)  # type: ignore[arg-type]
    return um_text(float(value))  # type: ignore[arg-type]


def lengths_as_text(stated: Mapping[str, object], section: type[AnySection]) -> dict[str, object]:
    """Keys of a section of a job file, with its lengths as a job file has them."""
    lengths = length_keys(section)
    return {key: length_text(value) if key in lengths else value for key, value in stated.items()}


def sections_as_text(stated: Mapping[str, object]) -> dict[str, object]:
    """Sections of a job file, with their lengths as a job file has them; what is no mapping, or none, as it is."""
    from maskfab.job.sections import JobSpec  # slow to load, and lengths need none

    made = dict(stated)
    for name, held in stated.items():
        field = JobSpec.model_fields.get(name)
        kinds = () if field is None or not isinstance(held, Mapping) else tuple(sections_of(field))
        if len(kinds) == 1 and isinstance(held, Mapping):
            made[name] = lengths_as_text(held, kinds[0])
    return made


def wavelength_text(value: object, where: str = "wavelength") -> object:
    """A wavelength as a job file has it; anything but a number is left to the job file's own checks. Raises JobError
    MF156 for a number that is no wavelength in nanometres."""
    if not _is_number(value):
        return value
    _require_usual(float(value), "nm", "wavelength", where)  # type: ignore[arg-type]
    return f"{float(value):.15g} nm"  # type: ignore[arg-type]


def wavelength_nm(value: object, where: str) -> float:
    """Nanometres of one wavelength. Raises JobError MF103 without a unit, MF104, MF112 or MF156 for what is no
    wavelength."""
    if isinstance(value, np.ndarray | np.generic) and np.ndim(value) == 0:
        value = value.item()
    return parse_wavelength_nm(wavelength_text(value, where), where=where)


def is_one(value: object) -> bool:
    """Whether a caller states one wavelength, and not several."""
    return isinstance(value, str) or _is_number(value) or (isinstance(value, np.ndarray) and value.ndim == 0)


def wavelengths_nm(value: object, where: str) -> tuple[float, ...]:
    """Nanometres of several wavelengths, in their order; of one, that alone. Raises JobError MF105 for none, or an
    array of more dimensions than one; else as :func:`wavelength_nm`."""
    if is_one(value):
        return (wavelength_nm(value, where),)
    if not isinstance(value, Sequence | np.ndarray) and hasattr(value, "__array__"):
        value = np.asarray(value)
    if isinstance(value, np.ndarray) and value.ndim > 1:
        what = f"an array of shape {value.shape} is no list of wavelengths"
        raise JobError("MF105", what, where=where, cure="Give one dimension: wavelengths.ravel()")
    if not isinstance(value, Sequence | np.ndarray):
        cure = 'Write "530 nm", 530, or a list of them'
        raise JobError("MF105", f"a {type(value).__name__} is no wavelength", where=where, cure=cure)
    every = value.tolist() if isinstance(value, np.ndarray) else value
    if not len(every):
        raise JobError("MF105", "the list of wavelengths is empty", where=where, cure='Give one or more: ["530 nm"]')
    return tuple(wavelength_nm(line, f"{where}[{number}]") for number, line in enumerate(every))


def _require_usual(number: float, unit: str, of: str, where: str) -> None:
    """Refuse a number that is far from all things of its kind; one that is no length is refused by who parses it."""
    usual = USUAL[of]
    if not (math.isfinite(number) and number > 0) or usual.holds(number, unit):
        return
    meant = next((f"{number:g} {other}" for other in _MEANT if usual.holds(number, other)), None)
    likely = "" if meant is None else f"; did you mean {meant!r}?"
    what = f"a {usual.name} of {number:g} {unit} is not {usual.least} to {usual.most}{likely}"
    cure = f'Write it with its unit, such as "{meant or usual.example}"'
    raise JobError("MF156", what, where=where, cure=cure)


def _is_number(value: object) -> bool:
    return isinstance(value, Real) and not isinstance(value, bool)


def drawing_unit_um(unit: str | float | None) -> float | None:
    """Micrometres of a drawing's unit, which is stated by its name or by them. Raises JobError MF105 for a name that
    none has."""
    if not isinstance(unit, str):
        return unit
    if unit not in _DRAWING_UNITS:
        cure = f"Use one of {', '.join(_DRAWING_UNITS)}"
        raise JobError("MF105", f"there is no unit {unit!r}", where="unit_um", cure=cure)
    return UM_PER_UNIT[unit]
