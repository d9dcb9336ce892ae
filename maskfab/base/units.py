"""Lengths, wavelengths and pitches as a user writes them: ``"168 um"``, ``"530 nm"``, ``"300 dpi"``.

Inside maskfab lengths are float micrometres (``_um``), wavelengths float nanometres (``_nm``),
and polygon coordinates integer nanometres, one database unit each.
"""

from __future__ import annotations

import math
import re
from collections.abc import Mapping
from types import MappingProxyType

from maskfab.base.errors import JobError

UM_PER_INCH = 25400.0
NM_PER_UM = 1000
UM_PER_NM = 1e-3
"""To multiply by, which differs from a division by 1000 in the last bit."""
UM_PER_MM = 1000
NM_PER_MM = NM_PER_UM * UM_PER_MM
MM_PER_NM = 1e-6
"""To multiply by."""
DBU_NM = 1

UM_PER_UNIT: Mapping[str, float] = MappingProxyType(
    {"nm": 1e-3, "um": 1.0, "µm": 1.0, "μm": 1.0, "mm": 1e3, "cm": 1e4, "m": 1e6, "in": UM_PER_INCH, "mil": 25.4}
)
MOST_DPI = 254_000
_LONGEST_NM = 2.0**53
_SHORTEST_UM, _LONGEST_UM = 1e-6, 1e18
"""Lengths between a picometre and the outer planets, whose powers and ratios a float holds."""
_QUANTITY = re.compile(
    r"\s*([-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?|[-+]?(?:nan|inf(?:inity)?))\s*(\S*)\s*", re.IGNORECASE
)

_SECONDS: Mapping[str, float] = MappingProxyType({"us": 1e-6, "ms": 1e-3, "s": 1.0, "min": 60.0, "h": 3600.0})
_TIME = re.compile(r"\s*([-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?|nan|inf)\s*([a-z]*)\s*", re.IGNORECASE)


def parse_length_um(text: object, *, where: str = "", zero_allowed: bool = False) -> float:
    """Micrometres of a length written with its unit.

    Raises:
        JobError: MF103 if there is no unit or it is no unit of length; MF104 if the length is not
            positive (or zero where that is allowed), or not from 1e-6 to 1e18 um.
    """
    number, unit = _split(text, where)
    if unit not in UM_PER_UNIT:
        listed = ", ".join(dict.fromkeys(u for u in UM_PER_UNIT if u.isascii()))
        problem = f"{text!r} has no unit" if not unit else f"{text!r} has the unit {unit!r}, which is no unit of length"
        raise JobError("MF103", problem, where=where, cure=f'Write it as "168 um"; units: {listed}')
    value = _decimal_scale(number, UM_PER_UNIT[unit])
    if not math.isfinite(value) or value < 0 or (value == 0 and not zero_allowed):
        limit = "at least 0" if zero_allowed else "positive"
        what = f"{text!r} must be a finite length, {limit}"
        raise JobError("MF104", what, where=where, cure='Write a number with its unit, such as "168 um"')
    if value and not _SHORTEST_UM <= value <= _LONGEST_UM:
        what = f"{text!r} is not within {_SHORTEST_UM:g} um to {_LONGEST_UM:g} um"
        raise JobError("MF104", what, where=where, cure="Check the unit and the exponent")
    return value


def parse_pitch_um(text: object, *, where: str = "") -> float:
    """Micrometres of a pitch, written as a length or as a pixel density (``"300 dpi"``)."""
    number, unit = _split(text, where)
    if unit.lower() not in {"dpi", "ppi"}:
        return parse_length_um(text, where=where)
    if not (math.isfinite(number) and 0 < number <= MOST_DPI * NM_PER_UM and UM_PER_INCH / number <= _LONGEST_UM):
        what = f"{text!r} must be a positive density, of at most {MOST_DPI * NM_PER_UM} dpi"
        raise JobError("MF104", what, where=where, cure='Write a positive density, such as "300 dpi"')
    return UM_PER_INCH / number


def parse_dpi(text: object, *, where: str = "") -> int:
    """Whole dots per inch of a plotter, written as ``"25400 dpi"``.

    Raises:
        JobError: MF103 without that unit; MF104 if they are not whole, positive and at most 254000, which are dots of
            .1 um.
    """
    number, unit = _split(text, where)
    if unit.lower() != "dpi":
        raise JobError("MF103", f"{text!r} is not in dots per inch", where=where, cure='Write it as "25400 dpi"')
    if not (math.isfinite(number) and 1 <= number <= MOST_DPI and number == int(number)):
        what = f"{text!r} is not a whole number of dots per inch from 1 to {MOST_DPI}"
        raise JobError("MF104", what, where=where, cure='Write what the plotter has, such as "25400 dpi"')
    return int(number)


def parse_wavelength_nm(text: object, *, where: str = "") -> float:
    """Nanometres of a vacuum wavelength between 200 and 2000 nm (MF112 outside)."""
    number, unit = _split(text, where)
    if not unit:
        cure = f'Write it with its unit, such as "{number:g} nm"' if 200 <= number <= 2000 else 'Write it as "530 nm"'
        raise JobError("MF103", f"the wavelength {text!r} has no unit", where=where, cure=cure)
    value = round(parse_length_um(text, where=where) * NM_PER_UM, 9)
    if not 200.0 <= value <= 2000.0:
        cure = "Give a wavelength that silica passes and a camera sees, such as 530 nm"
        raise JobError("MF112", f"wavelength {value:g} nm is outside 200 nm to 2000 nm", where=where, cure=cure)
    return value


def parse_time_s(text: object, *, where: str = "") -> float:
    """Seconds of a time written with its unit, us, ms, s, min or h.

    Raises:
        JobError: MF103 if there is no unit or it is no unit of time; MF104 if the time is not finite and positive.
    """
    match = _TIME.fullmatch(text) if isinstance(text, str) else None
    if match is None or match[2] not in _SECONDS:
        what = f"{text!r} is not a time with a unit"
        raise JobError("MF103", what, where=where, cure='Write it as "60 s", "5 min" or "1 h"')
    value = float(match[1]) * _SECONDS[match[2]]
    if not (math.isfinite(value) and value > 0):
        what = f"{text!r} must be a finite time above 0"
        raise JobError("MF104", what, where=where, cure='Give a positive time, such as "60 s"')
    return value


def parse_frequency_cy_per_mm(text: object, *, where: str = "") -> float:
    """Cycles per millimetre of a frequency written with its unit, cy/mm or lp/mm.

    Raises:
        JobError: MF103 if there is no unit or it is no unit of frequency; MF104 if it is not finite and positive.
    """
    number, unit = _split(text, where)
    if unit not in {"cy/mm", "lp/mm"}:
        what = f"{text!r} is not a spatial frequency with its unit"
        raise JobError("MF103", what, where=where, cure='Write it as "60 cy/mm"')
    if not (math.isfinite(number) and number > 0):
        what = f"{text!r} must be a finite frequency above 0"
        raise JobError("MF104", what, where=where, cure='Give a positive frequency, such as "60 cy/mm"')
    return number


def to_nm(value_um: float, *, where: str = "", name: str = "length") -> int:
    """Integer nanometres of a length that must lie on the database grid (MF107 otherwise).

    Raises:
        JobError: MF104 for a length beyond which a float no longer tells one nanometre from the next; MF107 as above.
    """
    exact = value_um * NM_PER_UM
    if not abs(exact) <= _LONGEST_NM:
        what = f"{name} {value_um:g} um is too long; the limit is {_LONGEST_NM / NM_PER_UM:g} um"
        raise JobError("MF104", what, where=where, cure="Give a shorter length")
    nearest = round(exact)
    if abs(exact - nearest) > 1e-6:
        what = f"{name} {value_um:.6f} um is off the database grid of {DBU_NM} nm by {exact - nearest:+.3f} nm"
        raise JobError("MF107", what, where=where, cure=f"Use {nearest / NM_PER_UM:g} um")
    return nearest


def decimals_of(error: float) -> int:
    """Decimals that an error above 0 allows a number; below 0 for errors of tens, hundreds and so on.

    Of an error's first three digits 100 to 354 keep two, 355 to 949 one, and those above are a thousand, with two: the
    rule of the Particle Data Group (Review of Particle Physics, introduction, rounding).
    """
    mantissa, exponent = f"{error:.2e}".split("e")
    leading = float(mantissa)
    more = 1 if leading < 3.55 else 0
    return more - int(exponent) if leading < 9.5 else -int(exponent)


def dpi(pitch_um: float) -> float:
    """Pixels per inch of a pitch in micrometres."""
    return UM_PER_INCH / pitch_um


def _split(text: object, where: str) -> tuple[float, str]:
    if isinstance(text, int | float) and not isinstance(text, bool):
        text = repr(text)
    match = _QUANTITY.fullmatch(text) if isinstance(text, str) else None
    if match is None:
        raise JobError("MF103", f"{text!r} is not a number with a unit", where=where, cure='Write it as "168 um"')
    return float(match.group(1)), match.group(2)


def _decimal_scale(number: float, scale: float) -> float:
    """number x scale, rounded to 15 significant digits so that 0.168 mm equals 168 um."""
    value = number * scale
    return float(f"{value:.15g}") if math.isfinite(value) else value
