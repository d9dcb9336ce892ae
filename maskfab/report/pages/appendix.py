"""The appendix of a report: every figure, every row and the list of methods, rendered from report.json alone.

What a reader signs is the report; here stands all else, die by die, and each way of finding a number once.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from functools import cache

from jinja2 import Template
from markupsafe import Markup

from maskfab.base.quantities import quantities, registered
from maskfab.base.resources import template
from maskfab.base.units import UM_PER_MM
from maskfab.camera.scores import CONFIDENCE
from maskfab.findings.bands import BIAS_UM
from maskfab.findings.scene import distance
from maskfab.job.camera import median_nm
from maskfab.optics.scene.model_bar import MODEL_BAR
from maskfab.report.documents.numbers import methods, rows_of
from maskfab.report.documents.shape import Record
from maskfab.report.figures import die as die_figures
from maskfab.report.pages.front import Best, best, shown_dies
from maskfab.report.pages.tables import band_of, decibels, die_table, model_table, photograph_table, ranked, stage_table
from maskfab.report.pages.template import ROW_FILTERS, WORDS, page_environment, references, style, where_linked
from maskfab.report.text import rounded, short

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


@cache
def _page() -> Template:
    """The template of the page, compiled once for all reports of a process."""
    environment = page_environment(**ROW_FILTERS)
    environment.tests["folded"] = _is_folded
    return environment.from_string(template("appendix.html.j2"))


def appendix_page(document: Record, pictures: Mapping[str, Mapping[str, str]], *, view: bool = False) -> str:
    """The appendix as one HTML page.

    Args:
        document: report.json, as :func:`maskfab.report.documents.report.to_document` makes it.
        pictures: ``<img>`` elements by die and figure, as :func:`maskfab.report.figures.report.pictures` makes them;
            a figure that is missing is left out.

    Equal documents and pictures give equal pages.
    """
    drawn = {place: {name: Markup(image) for name, image in images.items()} for place, images in pictures.items()}
    checks: Sequence[Record] = document["checks"]
    lines_nm = document["camera"]["wavelengths_nm"]
    middle_nm = median_nm(lines_nm)
    present = {registered(row["name"]).name for row in (*(row for _, row in rows_of(document)), *checks)}
    leader = best(document)
    listed = methods(document)
    return _page().render(
        style=style(),
        document=document,
        whole=drawn.get(die_figures.PLATE, {}),
        drawn=drawn,
        stressed=leader.shown if isinstance(leader, Best) else (),
        unfolded=(unfolded := shown_dies(document)),
        many=len(unfolded) < len(document["dies"]),
        most_failed=_MOST_FAILED,
        failures=any(not check["passed"] for check in checks),
        summary=by_name(checks),
        failed_dies={check["die"] for check in checks if not check["passed"] and "die" in check},
        table=die_table(document),
        photographs=photograph_table(document["photographs"]) if "photographs" in document else None,
        middle_nm=middle_nm,
        model_table=lambda die: model_table(die, document.get("photographs", {}).get("levels_db", [])),
        ranked=ranked(document),
        bias_um=BIAS_UM,
        confidence=CONFIDENCE,
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
        methods=listed.keys,
        remark=lambda row: listed.of(row)[1],
        refs=references(listed),
        view=view,
        where_linked=where_linked,
        quantities=[entry for name, entry in quantities().items() if name in present],
        words=WORDS,
    )


def _made(document: Record) -> Callable[[Record], str]:
    """Finds the edges of the band of a row, in words; empty where it has none."""
    dies = {die["name"]: die for die in document["dies"]} if "spread" in document else {}

    def made(row: Record) -> str:
        die = dies.get(row.get("die", ""))
        band = None if die is None else band_of(die, row)
        return "" if band is None else f"made {' to '.join(rounded(edge) for edge in band['between'])}"

    return made


def by_name(checks: Iterable[Record]) -> list[tuple[str, list[Record], Record]]:
    """Checks gathered by quantity: name, its rows, and the row to show, failed before passed, then the largest."""
    groups: dict[str, list[Record]] = {}
    for check in checks:
        groups.setdefault(check["name"], []).append(check)
    return [(name, rows, max(rows, key=lambda row: (not row["passed"], _value(row)))) for name, rows in groups.items()]


def _wavelengths(die: Record) -> list[float]:
    return list(dict.fromkeys(row["wavelength_nm"] for row in die["quantities"] if "wavelength_nm" in row))


def _lines(die: Record, folded: bool) -> list[tuple[Record, Record, tuple[Record | None, ...]]]:
    """A die's numbers that depend on the wavelength, folded or the others: the row shown and one a wavelength."""
    wavelengths = _wavelengths(die)
    groups: dict[str, dict[float, Record]] = {}
    for row in die["quantities"]:
        if "wavelength_nm" in row:
            groups.setdefault(row["name"], {})[row["wavelength_nm"]] = row
    lines = []
    for rows in groups.values():
        first = next(iter(rows.values()))
        judged = min(rows.values(), key=lambda row: (row["passed"] is not False, row["passed"] is None))
        if _is_folded(judged) == folded:
            lines.append((first, judged, tuple(rows.get(wavelength) for wavelength in wavelengths)))
    return lines


def _plain(die: Record, folded: bool) -> list[Record]:
    """A die's numbers that do not depend on the wavelength; those that are folded, or the others."""
    return [
        row
        for row in die["quantities"]
        if "wavelength_nm" not in row and _is_folded(row) == folded and not row["name"].startswith(MODEL_BAR)
    ]


def _left_out(die: Record) -> list[Record]:
    return [row for row in die["quantities"] if row["name"].startswith(MODEL_BAR)]


def _asked(asked: Record) -> list[tuple[str, str]]:
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
    if "projection" in asked:
        said.append(("Projection", asked["projection"]))
    if "tilt_deg" in asked:
        said.append(("Tilt", f"panel {short(asked['tilt_deg'])} degrees about y, its +x side away from the lens"))
    if asked["bands"]:
        bands = ", ".join(f"{band['name']} {band['low_nm']:g} to {band['high_nm']:g} nm" for band in asked["bands"])
        said.append(("Light", bands))
    if asked["saturation"]:
        said.append(("Saturation", "highlights clip"))
    return said or [("Asked for", "nothing beyond the standard")]


def _distance(length_um: float | None) -> str:
    return distance(math.inf if length_um is None else length_um)


def _modelled(plan: Record) -> str:
    rim = "grey" if plan["grey_rim"] else "exact"
    counts = [(plan[f"{kind}s"], kind) for kind in ("wavelength", "depth", "place")]
    sizes = ", ".join(f"{count} {kind}{'s' * (count > 1)}" for count, kind in counts)
    psfs = math.prod(count for count, _ in counts)
    return (
        f"{plan['path']}, {plan['precision']} precision, {rim} rim; {rounded(psfs)} PSF{'s' * (psfs > 1)} of "
        f"{plan['samples']} x {plan['samples']} samples ({sizes})"
    )


def _takes(plan: Record) -> str:
    return (
        f"predicted {rounded(plan['predicted_seconds'], 2)} s on one thread and "
        f"{rounded(plan['predicted_bytes'] / 1e6, 2)} MB"
    )


def _not_shown(scene: Record) -> list[str]:
    """Why a scene has no figure over its field or its depth."""
    asked, errors = scene["asked"], {row["name"]: row["error_if_left_out"] for row in scene["plan"]["ingredients"]}
    reasons = []
    if not scene["field"]:
        if not asked["field_um"]:
            reasons.append("No PSFs over the field: the scene asks for the axis only.")
        else:
            causes = ("shift through the gap", "oblique light")
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


def _is_folded(row: Record) -> bool:
    name = row["name"]
    return (name in _RARELY_READ or name.startswith(_RARELY_READ_FAMILIES)) and row["passed"] is not False


def _value(row: Record) -> float:
    return float(row["value"]) if _is_number(row["value"]) else -math.inf


def _is_number(value: object) -> bool:
    return isinstance(value, int | float) and not isinstance(value, bool)
