"""Bands of a report's numbers over the displays that are made, and the dies ranked by what a bias does to them."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from maskfab.measurement.process_spread import SHARE
from maskfab.measurement.tolerance import BIAS_UM
from maskfab.report.plots.number_text import rounded, short

Document = Mapping[str, Any]
Row = Mapping[str, Any]

_MORE_DECIMALS = 2


@dataclass(frozen=True)
class Sensitivity:
    """One die: change of the PSF's shape by a tenth of a micrometre of bias, and of the restored PSNR in dB; None where
    it was not photographed."""

    name: str
    shape: float
    psnr: float | None


@dataclass(frozen=True)
class Ranked:
    """Dies by what a bias does to the shape of their PSF, the most sensitive first, and what to say of them."""

    bias_um: float
    dies: Sequence[Sensitivity]
    told: Sequence[str]


def band_of(die: Document, row: Row) -> Row | None:
    """The band of a number, as a row of the same die; None if it has none."""
    places = [row.get(key) for key in ("wavelength_nm", "level_db")]
    for each in die["quantities"]:
        if each["name"] != f"band_{row['name']}" or each.get("between") is None:
            continue
        if all(
            place in (None, each.get(key)) for key, place in zip(("wavelength_nm", "level_db"), places, strict=True)
        ):
            return each  # type: ignore[no-any-return]
    return None


def edges(band: Row | None, scale: float = 1.0, decimals: int = 3, *, sign: bool = False) -> str:
    """From edge to edge, to as many decimals as the number has, or more where these would not show the band; nothing
    without one."""
    if band is None:
        return ""
    low, high = (scale * each for each in band["between"])
    needed = math.ceil(-math.log10(high - low)) if high > low else 0
    digits = max(decimals, needed) if needed <= decimals + _MORE_DECIMALS else decimals
    plus = "+" if sign else ""
    if low < 0:
        return f"{low:{plus}z.{digits}f} to {high:{plus}z.{digits}f}".replace("-", "−")
    return f"{low:{plus}.{digits}f}–{high:.{digits}f}"


def spread_words(document: Document) -> str:
    """The process and the spread that bands are over, or that there is none, in one clause."""
    process, spread = document.get("process"), document.get("spread")
    if process is None:
        return "dies as drawn: no [process] of the writer"
    rough = process["roughness"]
    uneven = f", edges rough by {short(rough['sigma_um'])} µm over {short(rough['correlation_um'])} µm" if rough else ""
    stated = f"corners of {short(process['corner_radius_um'])} µm, CD bias {short(process['cd_bias_um'])} µm{uneven}"
    if spread is None:
        return f"dies as drawn; “as written”: {stated}, without a spread ([process.spread])"
    said = [
        f"{what} ± {short(spread[key])} µm"
        for what, key in (("CD bias", "bias_um"), ("corner radius", "radius_um"))
        if spread[key]
    ]
    about = f"{100 * SHARE:g} % of displays about {stated}, standard deviations {', '.join(said)}"
    return f"dies as drawn; “made”: {about}"


def ranked(document: Document) -> Ranked | None:
    """From report.json; None without a spread of the bias."""
    found = [
        Sensitivity(die["name"], float(shape), _value(die, "sensitivity_restored_psnr"))
        for die in document["dies"]
        if (shape := _value(die, "sensitivity_psf_shape")) is not None
    ]
    if not found:
        return None
    dies = sorted(found, key=lambda each: -each.shape)
    photographed = sorted((each for each in found if each.psnr is not None), key=lambda each: -abs(each.psnr or 0.0))
    told = []
    if len(dies) > 1:
        told.append(
            f"{BIAS_UM:g} µm of CD bias changes the shape of the PSF most behind {dies[0].name} "
            f"({rounded(dies[0].shape, 3)}), least behind {dies[-1].name} ({rounded(dies[-1].shape, 3)})."
        )
    if len(photographed) > 1:
        most, least = photographed[0], photographed[-1]
        told.append(
            f"It changes restored photographs most behind {most.name} ({decibels(most.psnr)} dB), least behind "
            f"{least.name} ({decibels(least.psnr)} dB)."
        )
    return Ranked(BIAS_UM, dies, told)


def decibels(change: float | None) -> str:
    """With its sign; a dash for none."""
    return "–" if change is None else f"{change:+z.3f}".replace("-", "−")


def _value(die: Document, name: str) -> float | None:
    return next((each["value"] for each in die["quantities"] if each["name"] == name), None)
