"""The table that sets the dies side by side: photographs first, then what explains them."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from typing import Any

from maskfab.measurement.restored import middle_level
from maskfab.report.page.bands import band_of, edges
from maskfab.report.page.photograph_table import best_photographed, gain_words, mean_psnr, scores

Document = Mapping[str, Any]
Row = Mapping[str, Any]

WORST = "mtf_worst_"
"""At the start of the names of MTFs in their worst direction, before the frequency in cycles per millimetre."""


@dataclass(frozen=True)
class Cell:
    """One number of a die: as it is printed, with all its digits, whether its check failed, and its band."""

    text: str
    full: str = ""
    failed: bool = False
    made: str = ""


@dataclass(frozen=True)
class Line:
    """One die.

    Attributes:
        name: of it.
        psnr: mean of its restored photographs, dB.
        gain: over the reference, with its interval.
        best: whether no other die is better for sure, and some are worse.
        display: verdict; None where no display was asked for.
        cells: one for each column of the table, None where the die has no such number.
        psnr_made, gain_made: bands of both over the displays made; empty without.
    """

    name: str
    psnr: str
    gain: str
    best: bool
    display: str | None
    cells: tuple[Cell | None, ...]
    psnr_made: str = ""
    gain_made: str = ""


@dataclass(frozen=True)
class Table:
    """All dies, the highest mean PSNR first, those without photographs last.

    Attributes:
        columns: headings beside those that every table has, each in lines.
        lines: of the dies.
        level_db: light of the photographs; None without any.
        reference: die that gains are over; None if there is none.
    """

    columns: tuple[tuple[str, ...], ...]
    lines: tuple[Line, ...]
    level_db: float | None
    reference: str | None


def die_table(document: Document) -> Table:
    """From report.json."""
    dies, taken = document["dies"], document.get("photographs")
    columns = {
        heading: cells
        for heading, find in _columns(document).items()
        if any((cells := {die["name"]: find(die) for die in dies}).values())
    }
    level = None if taken is None else middle_level(taken["levels_db"])
    means: dict[str, float] = {}
    if taken is not None and level is not None:
        means = {name: mean_psnr(taken, level, name) for name in scores(taken, level)}
    best = frozenset[str]() if taken is None or level is None else best_photographed(taken, level)
    lines = [
        Line(
            name := die["name"],
            f"{means[name]:.2f}" if name in means else "–",
            gain_words(taken, level, name) if taken is not None and level is not None and name in means else "–",
            name in best,
            die["display"]["verdict"] if "display" in die else None,
            tuple(cells[name] for cells in columns.values()),
            *(photograph_bands(die, level) if name in means else ()),
        )
        for die in dies
    ]
    lines.sort(key=lambda line: -means.get(line.name, float("-inf")))
    return Table(tuple(columns), tuple(lines), level if means else None, taken["reference"] if taken else None)


def photograph_bands(die: Document, level_db: float | None) -> tuple[str, str]:
    """Edges of the bands of a die's PSNR and gain at a level of light; empty where it has none."""
    of_psnr, of_gain = (
        band_of(die, {"name": name, "level_db": level_db}) for name in ("restored_psnr", "restored_gain")
    )
    return edges(of_psnr, decimals=2), edges(of_gain, decimals=2, sign=True)


def _columns(document: Document) -> dict[tuple[str, ...], Callable[[Document], Cell | None]]:
    """Functions that find the cell of a die, by heading."""
    lines = document["camera"]["wavelengths_nm"]
    middle = lines[len(lines) // 2]
    names = dict.fromkeys(row["name"] for die in document["dies"] for row in die["quantities"])
    worst = [name for name in names if name.startswith(WORST)]
    at = f"{middle:g} nm"
    return {
        ("Open", "ratio"): _number("stop_open_ratio"),
        **{
            ("MTF, worst", f"{name.removeprefix(WORST)} cy/mm"): _number(name, middle)
            for name in sorted(worst, key=lambda each: float(each.removeprefix(WORST)))
        },
        ("Halo, %", at): _number("halo_energy", middle, scale=100.0, decimals=1),
        ("Emitters, %", "(margin)"): _footprint,
        ("Wires", "x, y"): _wires,
        ("Edge", "colour, ΔE"): _number("edge_colour_difference", decimals=1),
        ("AUC", at): _bare(_number("auc_radial_min", middle)),
    }


def _number(
    name: str, wavelength_nm: float | None = None, scale: float = 1.0, decimals: int = 3
) -> Callable[[Document], Cell | None]:
    def find(die: Document) -> Cell | None:
        for row in die["quantities"]:
            if row["name"] == name and row.get("wavelength_nm", wavelength_nm) == wavelength_nm:
                return _cell(row, scale, decimals, edges(band_of(die, row), scale, decimals))
        return None

    return find


def _cell(row: Row, scale: float, decimals: int, made: str) -> Cell | None:
    value = row["value"]
    if not isinstance(value, int | float):
        return None
    error = f" ± {row['uncertainty']!r}" if row["uncertainty"] else ""
    return Cell(f"{scale * value:.{decimals}f}", f"{value!r}{error}", row["passed"] is False, made)


def _bare(find: Callable[[Document], Cell | None]) -> Callable[[Document], Cell | None]:
    """Without bands, for numbers that are told for their history."""

    def found(die: Document) -> Cell | None:
        cell = find(die)
        return None if cell is None else replace(cell, made="")

    return found


def _footprint(die: Document) -> Cell | None:
    """Share of the pixel that one colour of the emitters covers, and by how much that is more than required."""
    if "display" not in die:
        return None
    display = die["display"]
    share, required = display["share"], display["required"]
    if display["emitters"] is None:
        return Cell("none", f"none drawn; at most {display['bound_share']!r}")
    margin = f" ({100 * (share - required):+.1f})".replace("-", "−") if required else ""
    made = edges(band_of(die, {"name": "led_footprint"}), 100.0, 1)
    return Cell(f"{100 * share:.1f}{margin}", f"{share!r}, required {required!r}", share < required, made)


def _wires(die: Document) -> Cell | None:
    wires = die.get("display", {}).get("wires")
    if wires is None:
        return None
    lines, wanted = wires["lines"], wires["wanted"]
    return Cell(f"{lines[0]:g}, {lines[1]:g} / {wanted}", "", min(lines) < wanted)
