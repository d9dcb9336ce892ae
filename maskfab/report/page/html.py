"""The report a person reads: one HTML file, rendered from report.json and its pictures, that needs nothing else."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from functools import cache
from types import MappingProxyType
from typing import Any

from jinja2 import Template
from markupsafe import Markup

from maskfab.measurement.scene_result import distance
from maskfab.optics.scene.model_bar import MODEL_BAR
from maskfab.quantities import QUANTITIES, Entry, registered
from maskfab.report.page.bands import band_of, decibels, ranked
from maskfab.report.page.die_table import die_table
from maskfab.report.page.environment import page_environment
from maskfab.report.page.front import assumed, best, crops, shown_dies, stamps
from maskfab.report.page.glossary import WORDS
from maskfab.report.page.model_table import model_table
from maskfab.report.page.photograph_table import photograph_table
from maskfab.report.page.stage_table import stage_table
from maskfab.report.plots import die_figures
from maskfab.report.plots.number_text import rounded, short
from maskfab.resources import template
from maskfab.units import UM_PER_MM

Row = Mapping[str, Any]


@dataclass(frozen=True)
class Line:
    """One quantity of a die at all its wavelengths.

    Attributes:
        first: the row of the first wavelength that has one; name, symbol, unit and method are its.
        judged: the row whose limit and verdict are shown: one that failed, else the first that was judged, else any.
        rows: one for each wavelength, None where there is none.
    """

    first: Row
    judged: Row
    rows: tuple[Row | None, ...]


_RARELY_READ = frozenset(
    {
        "mtf50_per_pixel",
        "mtf30_per_pixel",
        "mtf10_per_pixel",
        "mtf_phase_range",
        "energy_normalised_strehl",
        "first_side_lobe",
        "order_zero_incident",
        "order_zero_transmitted",
        "orders_lowest_five_incident",
    }
)
"""Rows that the page folds, unless they failed."""

_MOST_FAILED = 300
"""Failed checks that the page of many dies lists one by one."""

_RARELY_READ_FAMILIES = ("band_", "bitmap_", "drawn_", "psf_file_", "sensitivity_", "solid_", "written_")
"""Prefixes of further rows that it folds: a die has such rows for every file of its own."""

_UNITS: Mapping[str, str] = MappingProxyType({"1": "", "um": "µm", "um^2": "µm²"})


@cache
def _page() -> Template:
    """The template of the page, compiled once for all reports of a process."""
    environment = page_environment(
        number=rounded,
        short=short,
        amount=amount,
        full=full,
        plusminus=plusminus,
        unit=unit,
        limit=limit_text,
        term=registered,
        verdict=verdict,
        where=where,
    )
    environment.tests["folded"] = _is_folded
    return environment.from_string(template("report.html.j2"))


@cache
def style() -> Markup:
    """The look of every page."""
    return Markup(template("page.css"))


def html_page(document: Mapping[str, Any], pictures: Mapping[str, Mapping[str, str]]) -> str:
    """The report as one HTML page.

    Args:
        document: report.json, as :func:`maskfab.report.documents.report_data.to_document` makes it.
        pictures: ``<img>`` elements by die and figure, as :func:`maskfab.report.plots.die_figures.pictures` makes them;
            a figure that is missing is left out.

    Equal documents and pictures give equal pages.
    """
    drawn = {place: {name: Markup(image) for name, image in images.items()} for place, images in pictures.items()}
    checks: Sequence[Row] = document["checks"]
    lines_nm = document["camera"]["wavelengths_nm"]
    middle_nm = lines_nm[len(lines_nm) // 2]
    return _page().render(
        style=style(),
        document=document,
        whole=drawn.get(die_figures.PLATE, {}),
        drawn=drawn,
        stamps=stamps(document),
        best=(found := best(document)),
        crops=list(crops(document, found)),
        assumed=assumed(document),
        unfolded=(unfolded := shown_dies(document)),
        many=len(unfolded) < len(document["dies"]),
        most_failed=_MOST_FAILED,
        failures=_by_name(check for check in checks if not check["passed"]),
        summary=_by_name(checks),
        failed_dies={check["die"] for check in checks if not check["passed"] and "die" in check},
        table=die_table(document),
        photographs=photograph_table(document["photographs"]) if "photographs" in document else None,
        middle_nm=middle_nm,
        model_table=lambda die: model_table(die, document.get("photographs", {}).get("levels_db", [])),
        ranked=ranked(document),
        decibels=decibels,
        made=_made(document),
        stage_table=lambda die: stage_table(die, middle_nm),
        wavelengths=_wavelengths,
        lines=_lines,
        plain=_plain,
        left_out=_left_out,
        asked=_asked,
        modelled=_modelled,
        takes=_takes,
        not_shown=_not_shown,
        quantities=_glossary(document),
        words=WORDS,
    )


def _made(document: Mapping[str, Any]) -> Callable[[Row], str]:
    """Finds the edges of the band of a row, in words; empty where it has none."""
    dies = {die["name"]: die for die in document["dies"]} if "spread" in document else {}

    def made(row: Row) -> str:
        die = dies.get(row.get("die", ""))
        band = None if die is None else band_of(die, row)
        return "" if band is None else f"made {' to '.join(rounded(edge) for edge in band['between'])}"

    return made


def plusminus(row: Row) -> str:
    """The error bar with its sign, to two digits; nothing where the value is exact."""
    error = row["uncertainty"]
    return f"± {rounded(float(error), 2)}" if error else ""


def unit(row: Row) -> str:
    """The unit as a reader writes it; a plain number has none."""
    return _UNITS.get(row["unit"], row["unit"])


def amount(text: str, row: Row) -> str:
    """A number's text with the unit of its row, if it has one."""
    return f"{text} {unit(row)}".rstrip()


def full(row: Row) -> str:
    """The value with every digit that report.json has."""
    error = f" ± {row['uncertainty']!r}" if row["uncertainty"] else ""
    return f"{row['value']!r}{error} {unit(row)}".rstrip()


def limit_text(row: Row) -> str:
    """The limit with the side on which a value must lie, as far as value and verdict tell it."""
    bound, value = row["limit"], row["value"]
    if bound is None:
        return "–"
    if isinstance(bound, str) or isinstance(value, str) or value is None or abs(value) == bound:
        return short(bound)
    return f"{'≤' if (abs(value) < bound) == bool(row['passed']) else '≥'} {short(bound)}"


def verdict(row: Row) -> str:
    """Pass or fail in words, since colour alone does not reach everybody; a dash where nothing was required."""
    return "–" if row["passed"] is None else "✓ pass" if row["passed"] else "✗ FAIL"


def where(row: Row) -> str:
    """Die, wavelength and level of light of a row, as far as it has them."""
    places = [row["die"]] if "die" in row else []
    places += [f"{row['wavelength_nm']:g} nm"] if "wavelength_nm" in row else []
    return ", ".join(places + ([f"{row['level_db']:g} dB"] if "level_db" in row else []))


def _glossary(document: Mapping[str, Any]) -> list[Entry]:
    """The registered quantities that the document has, families once."""
    rows = [*document["plate"], *document["checks"]]
    for die in document["dies"]:
        rows += [*die["quantities"], *die.get("scene", {}).get("quantities", ())]
    present = {registered(row["name"]).name for row in rows}
    return [entry for name, entry in QUANTITIES.items() if name in present]


def _by_name(checks: Iterable[Row]) -> list[tuple[str, list[Row], Row]]:
    """Checks gathered by quantity: name, its rows, and the row to show, failed before passed, then the largest."""
    groups: dict[str, list[Row]] = {}
    for check in checks:
        groups.setdefault(check["name"], []).append(check)
    return [(name, rows, max(rows, key=lambda row: (not row["passed"], _value(row)))) for name, rows in groups.items()]


def _wavelengths(die: Mapping[str, Any]) -> list[float]:
    """The wavelengths at which a die has numbers, in their order of appearance."""
    return list(dict.fromkeys(row["wavelength_nm"] for row in die["quantities"] if "wavelength_nm" in row))


def _lines(die: Mapping[str, Any], folded: bool) -> list[Line]:
    """A die's numbers that depend on the wavelength, each in one line; those that are folded, or the others."""
    wavelengths = _wavelengths(die)
    groups: dict[str, dict[float, Row]] = {}
    for row in die["quantities"]:
        if "wavelength_nm" in row:
            groups.setdefault(row["name"], {})[row["wavelength_nm"]] = row
    found = []
    for rows in groups.values():
        first = next(iter(rows.values()))
        judged = min(rows.values(), key=lambda row: (row["passed"] is not False, row["passed"] is None))
        if _is_folded(judged) == folded:
            found.append(Line(first, judged, tuple(rows.get(wavelength) for wavelength in wavelengths)))
    return found


def _plain(die: Mapping[str, Any], folded: bool) -> list[Row]:
    """A die's numbers that do not depend on the wavelength; those that are folded, or the others."""
    return [
        row
        for row in die["quantities"]
        if "wavelength_nm" not in row and _is_folded(row) == folded and not row["name"].startswith(MODEL_BAR)
    ]


def _left_out(die: Mapping[str, Any]) -> list[Row]:
    """Effects not modelled for a die, the largest first."""
    return [row for row in die["quantities"] if row["name"].startswith(MODEL_BAR)]


def _asked(asked: Row) -> list[tuple[str, str]]:
    """Settings of a scene, by name; those at their default are left out."""
    said = []
    near, far, focus = (_distance(asked[key]) for key in ("nearest_um", "farthest_um", "focus_um"))
    if near != far or far != focus:
        said.append(("Depth", f"objects from {near} to {far}, in focus at {focus}" if near != far else near))
    elif near != "infinity":
        said.append(("Depth", f"{near}, in focus"))
    if asked["field_um"]:
        said.append(("Field", f"up to {short(asked['field_um'] / UM_PER_MM)} mm from the axis on the sensor"))
    if asked["gap_um"]:
        said.append(("Gap", f"{short(asked['gap_um'] / UM_PER_MM)} mm between panel and stop"))
    if asked["aberrations"]:
        waves = ", ".join(f"Z{term:g} {short(size)}" for term, size in asked["aberrations"])
        said.append(("Aberrations", f"{waves} (waves at the first wavelength, Noll's numbers)"))
    if "distortion" in asked:
        ratio, height = asked["distortion"]["ratio"], asked["distortion"]["height_um"] / UM_PER_MM
        said.append(("Distortion", f"{ratio:+.3g} of the image height at {short(height)} mm"))
    if asked["bands"]:
        bands = ", ".join(f"{band['name']} {band['low_nm']:g} to {band['high_nm']:g} nm" for band in asked["bands"])
        said.append(("Light", bands))
    if asked["saturation"]:
        said.append(("Saturation", "highlights clip"))
    return said or [("Asked for", "nothing beyond the standard")]


def _distance(length_um: float | None) -> str:
    return distance(math.inf if length_um is None else length_um)


def _modelled(plan: Row) -> str:
    rim = "grey" if plan["grey_rim"] else "exact"
    counts = [(plan[f"{kind}s"], kind) for kind in ("wavelength", "depth", "place")]
    told = ", ".join(f"{count} {kind}{'s' * (count > 1)}" for count, kind in counts)
    psfs = math.prod(count for count, _ in counts)
    return (
        f"{plan['path']}, {plan['precision']} precision, {rim} rim; {rounded(psfs)} PSF{'s' * (psfs > 1)} of "
        f"{plan['samples']} x {plan['samples']} samples ({told})"
    )


def _takes(plan: Row) -> str:
    return (
        f"predicted {rounded(plan['predicted_seconds'], 2)} s on one thread and "
        f"{rounded(plan['predicted_bytes'] / 1e6, 2)} MB"
    )


def _not_shown(scene: Row) -> list[str]:
    """Why a scene has no figure over its field or its depth."""
    asked, errors = scene["asked"], {row["name"]: row["error_if_left_out"] for row in scene["plan"]["ingredients"]}
    reasons = []
    if not scene["field"]:
        if not asked["field_um"]:
            reasons.append("No PSFs over the field: the scene asks for the axis only.")
        elif not (asked["gap_um"] or asked.get("distortion", {}).get("ratio")):
            reasons.append(
                "No PSFs over the field: without a gap between panel and stop, and without a distortion of the lens, "
                "every place on the sensor has one PSF."
            )
        else:
            causes = ("shift through the gap", "lens distortion")
            left = ", and ".join(
                f"the {cause} out, for an error of {rounded(errors[cause], 2)}" for cause in causes if errors[cause]
            )
            reasons.append(f"No PSFs over the field: the plan leaves {left}.")
    if not scene["depth"]:
        if asked["nearest_um"] == asked["farthest_um"] == asked["focus_um"]:
            reasons.append("No PSFs over the depth: the scene asks for objects in focus only.")
        else:
            left = rounded(errors["defocus over the depth"], 2)
            reasons.append(f"No PSFs over the depth: the plan leaves defocus out, for an error of {left}.")
    return reasons


def _is_folded(row: Row) -> bool:
    name = row["name"]
    return (name in _RARELY_READ or name.startswith(_RARELY_READ_FAMILIES)) and row["passed"] is not False


def _value(row: Row) -> float:
    return float(row["value"]) if _is_number(row["value"]) else -math.inf


def _is_number(value: object) -> bool:
    return isinstance(value, int | float) and not isinstance(value, bool)
