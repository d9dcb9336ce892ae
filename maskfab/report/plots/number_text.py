"""Numbers as a reader wants them: few digits, thin spaces between thousands, powers of ten where they help."""

from __future__ import annotations

import math

_SUPERSCRIPTS = str.maketrans("-0123456789", "⁻⁰¹²³⁴⁵⁶⁷⁸⁹")


def rounded(value: float | str | None, digits: int = 4) -> str:
    """A value with that many significant digits, two fewer beside a power of ten; text stays as it is."""
    if value is None:
        return "–"
    if isinstance(value, bool | str):
        return str(value)
    if isinstance(value, int) or (value.is_integer() and abs(value) < 1e15):
        text = f"{int(value):,}".replace(",", "\u202f")
    elif 1e-3 <= abs(value) < 1e6:
        text = f"{value:.{max(0, digits - 1 - math.floor(math.log10(abs(value))))}f}"
    else:
        mantissa, exponent = f"{value:.{max(digits - 2, 0)}e}".split("e")
        text = f"{mantissa} × 10{str(int(exponent)).translate(_SUPERSCRIPTS)}"
    return text.replace("-", "−")


def short(value: float | str | None, digits: int = 4) -> str:
    """As :func:`rounded`, without zeros that say nothing: for limits and settings, which are exact."""
    text = rounded(value, digits)
    if isinstance(value, str) or "." not in text:
        return text
    mantissa, power, exponent = text.partition(" × ")
    mantissa = mantissa.rstrip("0").rstrip(".")
    return exponent if mantissa == "1" and power else mantissa + power + exponent
