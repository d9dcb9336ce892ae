"""Values of [scene] and their types: distances, accuracies, aberrations, spectra and illuminants."""

from __future__ import annotations

import math
import re
from collections.abc import Mapping
from pathlib import Path
from types import MappingProxyType
from typing import Annotated

from pydantic import BeforeValidator, PlainSerializer

from maskfab.errors import JobError
from maskfab.jobfile.problems import refusing
from maskfab.jobfile.values import distance_text, length_um, um_text

COLDEST_K, HOTTEST_K = 1000.0, 100_000.0
"""Temperatures of black bodies, kelvins."""

ACCURACIES: Mapping[str, float] = MappingProxyType({"draft": 1e-2, "standard": 1e-3, "certify": 1e-6})
"""Admissible relative L2 error of the PSF, by name."""

MOST_DISTORTION = 0.3
"""Beyond it a barrel folds the picture within the height at which it is stated."""

_TEMPERATURE = re.compile(r"\s*([-+]?(?:(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?|nan|inf))\s*(\S*)\s*")
_HIGHEST_NOLL = 66


def _distance(value: object) -> float:
    """Micrometres of a length, or infinity for ``"inf"``."""
    return math.inf if value == "inf" else length_um(value)


def _depth(value: object) -> tuple[float, float]:
    if not isinstance(value, list | tuple) or len(value) != 2:
        raise JobError("MF105", f"{value!r} is not a pair of distances", cure='Write it as ["1 m", "inf"]')
    nearest, farthest = (_distance(each) for each in value)
    if nearest > farthest:
        raise JobError(
            "MF104", f"{value!r} has the nearest object beyond the farthest", cure="Swap them: the nearest comes first"
        )
    return nearest, farthest


def _accuracy(value: object) -> float:
    """Admissible relative L2 error of the PSF, by name or as a number in (0, 1)."""
    if isinstance(value, str) and value in ACCURACIES:
        return ACCURACIES[value]
    names = ", ".join(f'"{name}"' for name in ACCURACIES)
    if isinstance(value, bool) or not isinstance(value, int | float):
        raise JobError("MF105", f"{value!r} is not an accuracy", cure=f"Use {names} or a number between 0 and 1")
    if not 0 < value < 1:
        raise JobError("MF104", f"{value!r} is outside 0 to 1", cure=f"Use {names} or a ratio such as 1e-3")
    return float(value)


def _aberrations(value: object) -> tuple[tuple[int, float], ...]:
    cure = "Write pairs of Noll's number and waves: [[4, 0.05], [11, 0.02]]"
    if not isinstance(value, list | tuple):
        raise JobError("MF105", f"{value!r} is not a list of pairs", cure=cure)
    found: list[tuple[int, float]] = []
    for pair in value:
        if not isinstance(pair, list | tuple) or len(pair) != 2:
            raise JobError("MF105", f"{pair!r} is not a pair", cure=cure)
        term, waves = pair
        if type(term) is not int or type(waves) not in (int, float):
            raise JobError("MF105", f"{pair!r} is not a whole number and a number", cure=cure)
        if not 1 <= term <= _HIGHEST_NOLL:
            raise JobError("MF104", f"{pair!r} has a Noll index outside 1 to {_HIGHEST_NOLL}", cure=cure)
        if not math.isfinite(waves):
            raise JobError("MF104", f"{pair!r} has a coefficient that is not finite", cure=cure)
        if term in (known for known, _ in found):
            raise JobError("MF105", f"{pair!r} repeats Noll's term {term}", cure="Give every term once")
        found.append((term, float(waves)))
    return tuple(found)


def _distortion(value: object) -> tuple[float, float]:
    """Relative displacement, and the image height where it was measured, in micrometres."""
    cure = 'Write it as { ratio = 0.02, height = "2 mm" }'
    if not isinstance(value, Mapping) or set(value) != {"ratio", "height"}:
        raise JobError("MF105", f"{value!r} is not a distortion and the image height where it was measured", cure=cure)
    ratio = value["ratio"]
    if type(ratio) not in (int, float):
        raise JobError("MF105", f"{ratio!r} is not a ratio", cure=cure)
    if not abs(ratio) <= MOST_DISTORTION:
        raise JobError("MF104", f"a distortion of {ratio!r} is beyond {MOST_DISTORTION:g}", cure="Write 0.02 for 2 %")
    return float(ratio), length_um(value["height"])


def is_table(name: str) -> bool:
    """Whether a text names a file of curves."""
    return Path(name).suffix.lower() == ".csv"


def _spectrum(value: object) -> str:
    if not isinstance(value, str) or not (value in ("lines", "rgb") or is_table(value)):
        raise JobError(
            "MF105", f"{value!r} is not a spectrum", cure='Use "lines", "rgb" or a file such as "camera.csv"'
        )
    return value


def _illuminant(value: object) -> str | float:
    """``"equal"``, the name of a file of one curve, or a black body's temperature in kelvins."""
    if isinstance(value, str) and (value == "equal" or is_table(value)):
        return value
    cure = 'Use "equal", a temperature such as "6500 K" or a file such as "light.csv"'
    found = None if isinstance(value, bool) else _TEMPERATURE.fullmatch(str(value))
    if found is None:
        raise JobError("MF105", f"{value!r} is not an illuminant", cure=cure)
    if found[2] != "K":
        problem = "no unit" if not found[2] else f"the unit {found[2]!r}, which is no kelvin"
        raise JobError("MF103", f"{value!r} has {problem}", cure=cure)
    # As with lengths: 15 digits, which are written out and read again as they are.
    kelvins = float(f"{float(found[1]):.15g}")
    if not COLDEST_K <= kelvins <= HOTTEST_K:
        raise JobError(
            "MF104", f"{value!r} is outside {COLDEST_K:g} K to {HOTTEST_K:g} K", cure="Daylight is about 6500 K"
        )
    return kelvins


Spectrum = Annotated[str, BeforeValidator(lambda v: refusing(_spectrum, v))]
Illuminant = Annotated[
    str | float,
    BeforeValidator(lambda v: refusing(_illuminant, v)),
    PlainSerializer(lambda v: f"{v:.15g} K" if isinstance(v, float) else v),
]
Distance = Annotated[float, BeforeValidator(lambda v: refusing(_distance, v)), PlainSerializer(distance_text)]
Depth = Annotated[
    tuple[float, float],
    BeforeValidator(lambda v: refusing(_depth, v)),
    PlainSerializer(lambda v: [distance_text(each) for each in v]),
]
Accuracy = Annotated[float, BeforeValidator(lambda v: refusing(_accuracy, v))]
Aberrations = Annotated[tuple[tuple[int, float], ...], BeforeValidator(lambda v: refusing(_aberrations, v))]
LensDistortion = Annotated[
    tuple[float, float],
    BeforeValidator(lambda v: refusing(_distortion, v)),
    PlainSerializer(lambda v: {"ratio": v[0], "height": um_text(v[1])}),
]
