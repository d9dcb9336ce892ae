"""Tables of the pages, from report.json alone, on one base: lines of cells under headings, and what is said of them.

Photographs tell who is best, and who cannot be told from it. The table of dies puts photographs first, then what
explains them. Others are of what a bias does to dies, of one die from drawing to plate (as drawn, as read back from the
file, and as its writer makes it), and of the models behind a die's numbers, with their time and error. A number has its
band over the displays made, where the process has a spread.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from types import MappingProxyType
from typing import Any, Generic, TypeVar

import numpy as np

from maskfab.camera.die_transfer import by_sentence
from maskfab.camera.scores import MeanDifference
from maskfab.findings.bands import BIAS_UM, SHARE
from maskfab.findings.photographs import middle_level
from maskfab.job.camera import median_nm
from maskfab.mask.writer import Reading
from maskfab.report.documents.shape import WORST, Record
from maskfab.report.text import rounded, short


@dataclass(frozen=True)
class Cell:
    """One number of a table.

    Attributes:
        made: edges of its band over the displays made; empty without.
        best: whether no other die is better for sure, and some are worse.
    """

    text: str
    full: str = ""
    failed: bool = False
    made: str = ""
    best: bool = False


@dataclass(frozen=True)
class Line:
    """One line of a table: a cell for each column, None where there is no such number."""

    name: str
    cells: tuple[Any, ...]
    unit: str = ""
    note: str = ""


@dataclass(frozen=True)
class DieLine(Line):
    """One die beside others: mean PSNR of restored photographs, dB; display verdict, None if none was asked for."""

    psnr: Cell = Cell("–")
    gain: Cell = Cell("–")
    display: str | None = None


AnyLine = TypeVar("AnyLine", bound=Line)


@dataclass(frozen=True)
class Table(Generic[AnyLine]):
    """Lines under headings; light of photographs or None; die that gains are over, if any."""

    columns: tuple[Any, ...]
    lines: tuple[AnyLine, ...]
    level_db: float | None = None
    reference: str | None = None
    notes: tuple[str, ...] = ()


def photograph_table(taken: Record) -> Table[Line]:
    """From the photographs of report.json, a column for each level of light; what refused a die is its note."""
    levels: list[float] = taken["levels_db"]
    best = {level: best_photographed(taken, level) for level in levels}
    lines = []
    for die in taken["dies"]:
        name = die["name"]
        cells = (
            Cell(f"{np.mean(own):.2f}", made=gain_words(taken, level, name), best=name in best[level])
            for level in levels
            if (own := scores(taken, level).get(name)) is not None
        )
        lines.append(Line(name, tuple(cells), note=die["refused"] or ""))
    left_out = {die["name"]: die["left_out"] for die in taken["dies"] if not die["refused"]}
    return Table(tuple(levels), tuple(lines), notes=tuple(by_sentence(left_out)))


def best_photographed(taken: Record, level_db: float) -> frozenset[str]:
    """The die of the highest mean, and those whose difference to it is a tie; none where there is nothing to choose."""
    by_die = scores(taken, level_db)
    if len(by_die) < 2:
        return frozenset()
    first = max(by_die, key=lambda name: mean_psnr(taken, level_db, name))
    leaders = {name for name in by_die if name == first or difference(taken, level_db, name, first).tie}
    return frozenset(leaders) if len(leaders) < len(by_die) else frozenset()


def scores(taken: Record, level_db: float) -> dict[str, list[float]]:
    """PSNR of every photograph in dB, by die, of those that were photographed."""
    return {
        die["name"]: level["psnr"] for die in taken["dies"] for level in die["levels"] if level["level_db"] == level_db
    }


def mean_psnr(taken: Record, level_db: float, name: str) -> float:
    """Mean PSNR over the photographs of a die, in dB."""
    return float(np.mean(scores(taken, level_db)[name]))


def difference(taken: Record, level_db: float, name: str, other: str) -> MeanDifference:
    """Difference of two dies' photographs, scene by scene, in dB."""
    by_die = scores(taken, level_db)
    return MeanDifference.of([one - two for one, two in zip(by_die[name], by_die[other], strict=True)])


def gain_words(taken: Record, level_db: float, name: str) -> str:
    """The gain over the reference with its interval; a word where the die is the reference, or there is none."""
    reference = taken["reference"]
    if reference is None or name == reference:
        return "–" if reference is None else "reference"
    return difference(taken, level_db, name, reference).told("")


_MORE_DECIMALS = 2


def band_of(die: Record, row: Record) -> Record | None:
    """The band of a number, as a row of the same die; None if it has none."""
    places = [row.get(key) for key in ("wavelength_nm", "level_db")]
    for quantity in die["quantities"]:
        if quantity["name"] != f"band_{row['name']}" or quantity.get("between") is None:
            continue
        if all(
            place in (None, quantity.get(key)) for key, place in zip(("wavelength_nm", "level_db"), places, strict=True)
        ):
            return quantity  # type: ignore[no-any-return]
    return None


def edges(band: Record | None, scale: float = 1.0, decimals: int = 3, *, sign: bool = False) -> str:
    """From edge to edge, to the number's decimals or more if these hid the band; nothing without a band."""
    if band is None:
        return ""
    low, high = (scale * edge for edge in band["between"])
    needed = math.ceil(-math.log10(high - low)) if high > low else 0
    digits = max(decimals, needed) if needed <= decimals + _MORE_DECIMALS else decimals
    plus = "+" if sign else ""
    if low < 0:
        return f"{low:{plus}z.{digits}f} to {high:{plus}z.{digits}f}".replace("-", "−")
    return f"{low:{plus}.{digits}f}–{high:.{digits}f}"


def spread_words(document: Record) -> str:
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


def ranked(document: Record) -> Table[Line] | None:
    """Dies by what a bias does to the shape of their PSF, the most sensitive first; None without a spread of the bias.

    Cells are the changes, by a tenth of a micrometre of bias, of the PSF's shape and of the restored PSNR in dB, None
    where the die was not photographed.
    """
    changes = {
        die["name"]: (float(shape), _value(die, "sensitivity_restored_psnr"))
        for die in document["dies"]
        if (shape := _value(die, "sensitivity_psf_shape")) is not None
    }
    if not changes:
        return None
    shapes = sorted(changes, key=lambda name: -changes[name][0])
    psnrs = {name: psnr for name, (_, psnr) in changes.items() if psnr is not None}
    notes = []
    if len(shapes) > 1:
        most, least = (f"{name} ({rounded(changes[name][0], 3)})" for name in (shapes[0], shapes[-1]))
        notes.append(
            f"{BIAS_UM:g} µm of CD bias changes the shape of the PSF most behind {most}, least behind {least}."
        )
    if len(psnrs) > 1:
        photographed = sorted(psnrs, key=lambda name: -abs(psnrs[name]))
        most, least = (f"{name} ({decibels(psnrs[name])} dB)" for name in (photographed[0], photographed[-1]))
        notes.append(f"It changes restored photographs most behind {most}, least behind {least}.")
    return Table((), tuple(Line(name, changes[name]) for name in shapes), notes=tuple(notes))


def decibels(change: float | None) -> str:
    """With its sign; a dash for none."""
    return "–" if change is None else f"{change:+z.3f}".replace("-", "−")


def _value(die: Record, name: str) -> float | None:
    return next((quantity["value"] for quantity in die["quantities"] if quantity["name"] == name), None)


def die_table(document: Record) -> Table[DieLine]:
    """Dies of report.json, the highest mean PSNR first, those without photographs last.

    Columns are headings, each in lines, of the numbers that any die has.
    """
    dies, taken = document["dies"], document.get("photographs")
    columns = {
        heading: cells
        for heading, find in _columns(document).items()
        if any((cells := {die["name"]: find(die) for die in dies}).values())
    }
    level = None if taken is None else middle_level(taken["levels_db"])
    means: dict[str, float] = {}
    best = frozenset[str]()
    if taken is not None and level is not None:
        means = {name: mean_psnr(taken, level, name) for name in scores(taken, level)}
        best = best_photographed(taken, level)
    lines = []
    for die in dies:
        name = die["name"]
        display = die["display"]["verdict"] if "display" in die else None
        line = DieLine(name, tuple(cells[name] for cells in columns.values()), display=display)
        if taken is not None and level is not None and name in means:
            psnr_made, gain_made = photograph_bands(die, level)
            psnr = Cell(f"{means[name]:.2f}", made=psnr_made, best=name in best)
            line = replace(line, psnr=psnr, gain=Cell(gain_words(taken, level, name), made=gain_made))
        lines.append(line)
    lines.sort(key=lambda line: -means.get(line.name, float("-inf")))
    return Table(tuple(columns), tuple(lines), level if means else None, taken["reference"] if taken else None)


def photograph_bands(die: Record, level_db: float | None) -> tuple[str, str]:
    """Edges of the bands of a die's PSNR and gain at a level of light; empty where it has none."""
    of_psnr, of_gain = (
        band_of(die, {"name": name, "level_db": level_db}) for name in ("restored_psnr", "restored_gain")
    )
    return edges(of_psnr, decimals=2), edges(of_gain, decimals=2, sign=True)


OPEN_IN_STOP = ("Open ratio", "in the stop")
"""Heading of the first column, as no page calls the open ratio of a cell."""
_FREQUENCY_DIGITS = 3


def _few_digits(frequencies: Sequence[str]) -> Iterator[tuple[str, str]]:
    """Frequencies in their order, rounded as far as all can still be told apart, each with its name."""
    every = sorted(map(float, frequencies))
    digits = next(n for n in range(_FREQUENCY_DIGITS, 18) if len({f"{one:.{n}g}" for one in every}) == len(every))
    named = {float(text): f"{WORST}{text}" for text in frequencies}
    yield from ((short(one, digits), named[one]) for one in every)


def _columns(document: Record) -> dict[tuple[str, ...], Callable[[Record], Cell | None]]:
    lines = document["camera"]["wavelengths_nm"]
    middle = median_nm(lines)
    names = dict.fromkeys(row["name"] for die in document["dies"] for row in die["quantities"])
    worst = [name for name in names if name.startswith(WORST)]
    at = f"{middle:g} nm"
    return {
        OPEN_IN_STOP: _number("stop_open_ratio"),
        **{
            ("MTF, worst", f"{frequency} cy/mm"): _number(name, middle)
            for frequency, name in _few_digits([name.removeprefix(WORST) for name in worst])
        },
        ("Halo, %", at): _number("halo_energy", middle, scale=100.0, decimals=1),
        ("Emitters, %", "(margin)"): _footprint,
        ("Wires", "x, y"): _wires,
        ("Edge", "colour, ΔE"): _number("edge_colour_difference", decimals=1),
        # A number that is told for its history has no band.
        ("AUC", at): _number("auc_radial_min", middle, banded=False),
    }


def _number(
    name: str, wavelength_nm: float | None = None, scale: float = 1.0, decimals: int = 3, *, banded: bool = True
) -> Callable[[Record], Cell | None]:
    def find(die: Record) -> Cell | None:
        for row in die["quantities"]:
            if row["name"] == name and row.get("wavelength_nm", wavelength_nm) == wavelength_nm:
                return _cell(row, scale, decimals, edges(band_of(die, row) if banded else None, scale, decimals))
        return None

    return find


def _cell(row: Record, scale: float, decimals: int, made: str) -> Cell | None:
    value = row["value"]
    if not isinstance(value, int | float):
        return None
    error = f" ± {row['uncertainty']!r}" if row["uncertainty"] else ""
    return Cell(f"{scale * value:.{decimals}f}", f"{value!r}{error}", row["passed"] is False, made)


def _footprint(die: Record) -> Cell | None:
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


def _wires(die: Record) -> Cell | None:
    wires = die.get("display", {}).get("wires")
    if wires is None:
        return None
    lines, wanted = wires["lines"], wires["wanted"]
    return Cell(f"{lines[0]:g}, {lines[1]:g} / {wanted}", "", min(lines) < wanted)


_AGAINST = ("readback_psf_difference", "strehl_invariant_error", "mtf_volume_invariant_error")
"""Comparisons of the optics of every die with an independent path, and with what holds for every mask."""


@dataclass(frozen=True)
class ModelLine:
    """One model.

    Attributes:
        seconds: that one thread is expected to take for the die; None where nothing is computed.
        error: of it; None where it is not known.
        at_most: whether the truth may lie far below the error.
    """

    title: str
    seconds: float | None
    error: float | None
    at_most: bool
    unit: str
    note: str


def model_table(die: Record, levels_db: list[float]) -> list[ModelLine]:
    """From a die of report.json, and the levels of light of its photographs; none where nothing is foretold of it."""
    seconds: Mapping[str, float] = die.get("expected_seconds", {})
    return list(_lines(die, seconds, levels_db)) if seconds else []


def _lines(die: Record, seconds: Mapping[str, float], levels_db: list[float]) -> Iterator[ModelLine]:
    if "optics" in seconds:
        error = _largest(_rows(die, *_AGAINST), "value")
        meaning = (
            "largest distance from the PSF of an independent path, and from the invariants of Strehl and MTF volume"
        )
        yield ModelLine("PSF and MTF on the axis", seconds["optics"], error, False, "1", meaning)
    if "written" in seconds:
        rows = [row for row in die["quantities"] if row["name"].startswith("written_psf_difference")]
        meaning = "of the relative L2 difference between the PSF as written and as drawn"
        yield ModelLine(
            "PSF and MTF as written", seconds["written"], _largest(rows, "uncertainty"), False, "1", meaning
        )
    if "scene" in die:
        plan = die["scene"]["plan"]
        meaning = "of the PSF in the scene of the job, relative L2, by the plan that was chosen for it"
        yield ModelLine("PSF in the scene", plan["predicted_seconds"], plan["error"], True, "1", meaning)
    if "photographs" in seconds and levels_db:
        level = middle_level(levels_db)
        rows = [row for row in _rows(die, "restored_psnr") if row["level_db"] == level]
        meaning = f"of the mean PSNR at {level:g} dB of light, from its method; scenes differ by more, see its interval"
        yield ModelLine(
            "Restored photographs", seconds["photographs"], _largest(rows, "uncertainty"), False, "dB", meaning
        )
    left_out = _largest(_rows(die, "model_bar"), "value")
    if left_out is not None:
        meaning = "sum of what no model here has, relative L2 of the PSF; listed by size below"
        yield ModelLine("Left out by all", None, left_out, False, "1", meaning)


def _rows(die: Record, *names: str) -> list[Record]:
    return [row for row in die["quantities"] if row["name"] in names]


def _largest(rows: list[Record], key: str) -> float | None:
    return max((float(row[key]) for row in rows if isinstance(row[key], int | float)), default=None)


_HEADINGS: Mapping[str, str] = MappingProxyType(
    {Reading.FUSED: "As written, touching dots fused", Reading.OPEN: "As written, touching dots apart"}
)
_NUMBERS = (
    ("Open ratio in the stop", "stop_open_ratio", "open_ratio"),
    ("Area under the radial-minimum MTF", "auc_radial_min", "auc_radial_min"),
    ("MTF50", "mtf50", "mtf50"),
)
"""Heading, name as read back, and as written."""


def stage_table(die: Record, wavelength_nm: float) -> Table[Line] | None:
    """One die from drawing to plate, stages as columns; numbers that depend on the light are those at one wavelength.

    A drawing has the numbers of the file that is read back where no area tells them apart. None for a die that was
    not read back.
    """

    def value(name: str) -> float | None:
        numbers = [
            float(row["value"])
            for row in die["quantities"]
            if row["name"] == name
            and row.get("wavelength_nm", wavelength_nm) == wavelength_nm
            and isinstance(row["value"], int | float)
        ]
        return max(numbers, default=None)

    xor = value("readback_xor_area")
    if xor is None:
        return None
    readings = [heading for heading in _HEADINGS if value(f"written_psf_difference_{heading}") is not None]

    units = {row["name"]: row["unit"] for row in die["quantities"]}

    def line(title: str, drawn: float | None, read: str, written: str) -> Line:
        return Line(
            title,
            (drawn, value(read), *(value(f"written_{written}_{reading}") for reading in readings)),
            units.get(read, "1"),
        )

    lines = [
        line("Area that differs from the drawing", 0.0, "readback_xor_area", "xor_area"),
        line("PSF that differs from the drawing's", 0.0, "readback_psf_difference", "psf_difference"),
        *(line(title, None if xor else value(read), read, written) for title, read, written in _NUMBERS),
    ]
    return Table(("Drawn", "Read back", *(_HEADINGS[reading] for reading in readings)), tuple(lines))
