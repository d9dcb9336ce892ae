"""The models behind a die's numbers in one table: the time that each is expected to take, and how far it errs."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Any

from maskfab.measurement.restored import middle_level

Document = Mapping[str, Any]
Row = Mapping[str, Any]

_AGAINST = ("readback_psf_difference", "strehl_invariant_error", "mtf_volume_invariant_error")
"""Comparisons of the optics of every die with an independent path, and with what holds for every mask."""


@dataclass(frozen=True)
class Line:
    """One model.

    Attributes:
        title: of it, in words.
        seconds: that one thread is expected to take for the die; None where nothing is computed.
        error: of it; None where it is not known.
        at_most: whether the truth may lie far below the error.
        unit: of the error, as report.json spells it.
        told: what the error is.
    """

    title: str
    seconds: float | None
    error: float | None
    at_most: bool
    unit: str
    told: str


def model_table(die: Document, levels_db: list[float]) -> list[Line]:
    """From a die of report.json, and the levels of light of its photographs; none where nothing is foretold of it."""
    seconds: Mapping[str, float] = die.get("expected_seconds", {})
    return list(_lines(die, seconds, levels_db)) if seconds else []


def _lines(die: Document, seconds: Mapping[str, float], levels_db: list[float]) -> Iterator[Line]:
    if "optics" in seconds:
        error = _largest(_rows(die, *_AGAINST), "value")
        told = "largest distance from the PSF of an independent path, and from the invariants of Strehl and MTF volume"
        yield Line("PSF and MTF on the axis", seconds["optics"], error, False, "1", told)
    if "written" in seconds:
        rows = [row for row in die["quantities"] if row["name"].startswith("written_psf_difference")]
        told = "of the relative L2 difference between the PSF as written and as drawn"
        yield Line("PSF and MTF as written", seconds["written"], _largest(rows, "uncertainty"), False, "1", told)
    if "scene" in die:
        plan = die["scene"]["plan"]
        told = "of the PSF in the scene of the job, relative L2, by the plan that was chosen for it"
        yield Line("PSF in the scene", plan["predicted_seconds"], plan["error"], True, "1", told)
    if "photographs" in seconds and levels_db:
        level = middle_level(levels_db)
        rows = [row for row in _rows(die, "restored_psnr") if row["level_db"] == level]
        told = f"of the mean PSNR at {level:g} dB of light, from its method; scenes differ by more, see its interval"
        yield Line("Restored photographs", seconds["photographs"], _largest(rows, "uncertainty"), False, "dB", told)
    left_out = _largest(_rows(die, "model_bar"), "value")
    if left_out is not None:
        told = "sum of what no model here has, relative L2 of the PSF; listed by size below"
        yield Line("Left out by all", None, left_out, False, "1", told)


def _rows(die: Document, *names: str) -> list[Row]:
    return [row for row in die["quantities"] if row["name"] in names]


def _largest(rows: list[Row], key: str) -> float | None:
    return max((float(row[key]) for row in rows if isinstance(row[key], int | float)), default=None)
