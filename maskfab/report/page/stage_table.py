"""One die from drawing to plate in one table: as drawn, as read back from the file, and as its writer makes it."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from types import MappingProxyType
from typing import Any

from maskfab.geometry.writer_model import Reading

Document = Mapping[str, Any]

_HEADINGS: Mapping[str, str] = MappingProxyType(
    {Reading.FUSED: "As written, touching dots fused", Reading.OPEN: "As written, touching dots apart"}
)
_NUMBERS = (
    ("Open ratio in the stop", "stop_open_ratio", "open_ratio"),
    ("Area under the radial-minimum MTF", "auc_radial_min", "auc_radial_min"),
    ("MTF50", "mtf50", "mtf50"),
)
"""Heading, name as read back, and as written."""


@dataclass(frozen=True)
class Line:
    """One number of the die at every stage, in the unit that report.json spells; None where it has none."""

    title: str
    unit: str
    cells: tuple[float | None, ...]


@dataclass(frozen=True)
class Table:
    """Stages from left to right, and the numbers at each."""

    stages: tuple[str, ...]
    lines: tuple[Line, ...]


def stage_table(die: Document, wavelength_nm: float) -> Table | None:
    """From a die of report.json; numbers that depend on the light are those at one wavelength.

    A drawing has the numbers of the file that is read back where no area tells them apart. None for a die that was
    not read back.
    """
    value = _finder(die, wavelength_nm)
    xor = value("readback_xor_area")
    if xor is None:
        return None
    readings = [each for each in _HEADINGS if value(f"written_psf_difference_{each}") is not None]

    units = {row["name"]: row["unit"] for row in die["quantities"]}

    def line(title: str, drawn: float | None, read: str, written: str) -> Line:
        return Line(
            title,
            units.get(read, "1"),
            (drawn, value(read), *(value(f"written_{written}_{each}") for each in readings)),
        )

    lines = [
        line("Area that differs from the drawing", 0.0, "readback_xor_area", "xor_area"),
        line("PSF that differs from the drawing's", 0.0, "readback_psf_difference", "psf_difference"),
        *(line(title, None if xor else value(read), read, written) for title, read, written in _NUMBERS),
    ]
    return Table(("Drawn", "Read back", *(_HEADINGS[each] for each in readings)), tuple(lines))


def _finder(die: Document, wavelength_nm: float) -> Callable[[str], float | None]:
    """Finds the largest value of a name, at the wavelength where there are several."""

    def value(name: str) -> float | None:
        numbers = [
            float(row["value"])
            for row in die["quantities"]
            if row["name"] == name
            and row.get("wavelength_nm", wavelength_nm) == wavelength_nm
            and isinstance(row["value"], int | float)
        ]
        return max(numbers, default=None)

    return value
