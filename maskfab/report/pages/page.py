"""The report a person reads: one HTML file, rendered from report.json and its pictures, that needs nothing else.

Two such pages are held against each other, perhaps made on two machines. Words must be equal to the letter. A picture
may differ by what the last bits of another machine's arithmetic make of a line or a shade, which nobody can see. Of a
photograph they may make another draw of its noise: then means of patches must be equal, grain as coarse, and words the
same but for tenths of a decibel.
"""

from __future__ import annotations

import base64
import io
import math
import re
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from functools import cache
from html import unescape
from itertools import zip_longest
from types import MappingProxyType
from urllib.parse import unquote

import numpy as np
from jinja2 import Template
from markupsafe import Markup
from matplotlib.image import imread
from numpy.typing import NDArray

from maskfab.base.quantities import quantities, registered
from maskfab.base.resources import template
from maskfab.base.units import UM_PER_MM
from maskfab.camera.scores import CONFIDENCE
from maskfab.optics.scene.model_bar import MODEL_BAR
from maskfab.report.documents.shape import Record
from maskfab.report.figures import die as die_figures
from maskfab.report.pages.front import assumed, best, crops, shown_dies, stamps
from maskfab.report.pages.tables import band_of, decibels, die_table, model_table, photograph_table, ranked, stage_table
from maskfab.report.pages.template import WORDS, page_environment, style
from maskfab.report.rows.bands import BIAS_UM
from maskfab.report.rows.scene import distance
from maskfab.report.rows.text import rounded, short

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


def html_page(document: Record, pictures: Mapping[str, Mapping[str, str]]) -> str:
    """The report as one HTML page.

    Args:
        document: report.json, as :func:`maskfab.report.documents.report.to_document` makes it.
        pictures: ``<img>`` elements by die and figure, as :func:`maskfab.report.figures.die.pictures` makes them;
            a figure that is missing is left out.

    Equal documents and pictures give equal pages.
    """
    drawn = {place: {name: Markup(image) for name, image in images.items()} for place, images in pictures.items()}
    checks: Sequence[Record] = document["checks"]
    lines_nm = document["camera"]["wavelengths_nm"]
    middle_nm = lines_nm[len(lines_nm) // 2]
    rows = [*document["plate"], *checks]
    for die in document["dies"]:
        rows += [*die["quantities"], *die.get("scene", {}).get("quantities", ())]
    present = {registered(row["name"]).name for row in rows}
    return _page().render(
        style=style(),
        document=document,
        whole=drawn.get(die_figures.PLATE, {}),
        drawn=drawn,
        stamps=stamps(document),
        best=(leader := best(document)),
        crops=list(crops(document, leader)),
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


def plusminus(row: Record) -> str:
    """The error bar with its sign, to two digits; nothing where the value is exact."""
    error = row["uncertainty"]
    return f"± {rounded(float(error), 2)}" if error else ""


def unit(row: Record) -> str:
    """The unit as a reader writes it; a plain number has none."""
    return _UNITS.get(row["unit"], row["unit"])


def amount(text: str, row: Record) -> str:
    """A number's text with the unit of its row, if it has one."""
    return f"{text} {unit(row)}".rstrip()


def full(row: Record) -> str:
    """The value with every digit that report.json has."""
    error = f" ± {row['uncertainty']!r}" if row["uncertainty"] else ""
    return f"{row['value']!r}{error} {unit(row)}".rstrip()


def limit_text(row: Record) -> str:
    """The limit with the side on which a value must lie, as far as value and verdict tell it."""
    bound, value = row["limit"], row["value"]
    if bound is None:
        return "–"
    if isinstance(bound, str) or isinstance(value, str) or value is None or abs(value) == bound:
        return short(bound)
    return f"{'≤' if (abs(value) < bound) == bool(row['passed']) else '≥'} {short(bound)}"


def verdict(row: Record) -> str:
    """Pass or fail in words, since colour alone does not reach everybody; a dash where nothing was required."""
    return "–" if row["passed"] is None else "✓ pass" if row["passed"] else "✗ FAIL"


def where(row: Record) -> str:
    """Die, wavelength and level of light of a row, as far as it has them."""
    places = [row["die"]] if "die" in row else []
    places += [f"{row['wavelength_nm']:g} nm"] if "wavelength_nm" in row else []
    return ", ".join(places + ([f"{row['level_db']:g} dB"] if "level_db" in row else []))


def _by_name(checks: Iterable[Record]) -> list[tuple[str, list[Record], Record]]:
    """Checks gathered by quantity: name, its rows, and the row to show, failed before passed, then the largest."""
    groups: dict[str, list[Record]] = {}
    for check in checks:
        groups.setdefault(check["name"], []).append(check)
    return [(name, rows, max(rows, key=lambda row: (not row["passed"], _value(row)))) for name, rows in groups.items()]


def _wavelengths(die: Record) -> list[float]:
    """The wavelengths at which a die has numbers, in their order of appearance."""
    return list(dict.fromkeys(row["wavelength_nm"] for row in die["quantities"] if "wavelength_nm" in row))


def _lines(die: Record, folded: bool) -> list[tuple[Record, Record, tuple[Record | None, ...]]]:
    """A die's numbers that depend on the wavelength; those that are folded, or the others.

    Of each the row of the first wavelength that has one, the row whose limit and verdict are shown (one that failed,
    else the first that was judged, else any), and a row for each wavelength, None where there is none.
    """
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
    """Effects not modelled for a die, the largest first."""
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


def _is_folded(row: Record) -> bool:
    name = row["name"]
    return (name in _RARELY_READ or name.startswith(_RARELY_READ_FAMILIES)) and row["passed"] is not False


def _value(row: Record) -> float:
    return float(row["value"]) if _is_number(row["value"]) else -math.inf


def _is_number(value: object) -> bool:
    return isinstance(value, int | float) and not isinstance(value, bool)


_PICTURE = re.compile(r"""<img class="\w+" src='[^']*' alt="[^"]*">""")
_EMBEDDED = re.compile(r"data:image/png;base64,([A-Za-z0-9+/=]+)")
_COORDINATE = re.compile(r"-?\d+\.\d+")
_WORDS = re.compile(r">[^<]+<")
_SHIFT = 0.05
"""Of a line, in points: paths are written to .01."""
_SHADE = 0.05
"""Of a pixel, of 1."""
_PATCH = 24
"""Side in pixels of a photograph's patches."""
_PATCH_SHADE = 0.05
"""Of a patch's mean, of 1."""
_GRAIN_SHARE = 0.05
"""Of the mean step from pixel to pixel, which sharpness and noise make."""
DECIBELS = 0.2
"""Of a restored photograph, from one draw of its noise to another."""
TEXT = "text"
NOISE = "the noise of photographs"
_NOISY = re.compile(r" (design_\d+|front)$")


def differences(then: str, now: str, pictures: Mapping[str, Mapping[str, str]]) -> Iterator[str]:
    """Differences between two pages: :data:`TEXT`, the names of pictures, as ``die figure``, or :data:`NOISE`.

    Args:
        then: the page that is there.
        now: the page made again.
        pictures: those that ``now`` was made with.
    """
    if _PICTURE.split(then) != _PICTURE.split(now):
        yield TEXT
    names = {drawn: f"{place} {name}" for place, images in pictures.items() for name, drawn in images.items()}
    for old, new in zip_longest(_PICTURE.findall(then), _PICTURE.findall(now), fillvalue=""):
        if old == new or _alike(old, new):
            continue
        name = names.get(new, "a picture that does not belong there")
        yield NOISE if _NOISY.search(name) and _alike_but_for_noise(old, new) else name


def _alike(one: str, other: str) -> bool:
    """Whether two pictures of a page show the same: equal words and shapes, and images with equal shades."""
    one, other = (unquote(unescape(picture)) for picture in (one, other))
    images = [_EMBEDDED.findall(picture) for picture in (one, other)]
    if len(images[0]) != len(images[1]):
        return False
    drawn = [_EMBEDDED.sub("", picture) for picture in (one, other)]
    if _WORDS.findall(drawn[0]) != _WORDS.findall(drawn[1]) or len({_COORDINATE.sub("", words) for words in drawn}) > 1:
        return False
    places = [np.array([float(number) for number in _COORDINATE.findall(words)]) for words in drawn]
    if places[0].size and np.abs(places[0] - places[1]).max() > _SHIFT:
        return False
    return all(alike_images(*(base64.b64decode(image) for image in pair)) for pair in zip(*images, strict=True))


def _alike_but_for_noise(one: str, other: str) -> bool:
    """Whether two photographs show the same, each in noise of its own."""
    one, other = (unquote(unescape(picture)) for picture in (one, other))
    images = [_EMBEDDED.findall(picture) for picture in (one, other)]
    words = [_EMBEDDED.sub("", picture) for picture in (one, other)]
    if [len(image) for image in images] != [1, 1] or len({_COORDINATE.sub("", text) for text in words}) > 1:
        return False
    numbers = [np.array([float(number) for number in _COORDINATE.findall(word)]) for word in words]
    if np.abs(numbers[0] - numbers[1]).max(initial=0.0) > DECIBELS:
        return False
    first, second = (_pixels(base64.b64decode(image)) for (image,) in images)
    return first is not None and second is not None and first.shape == second.shape and _one_scene(first, second)


def _one_scene(first: NDArray[np.float64], second: NDArray[np.float64]) -> bool:
    """Whether photographs of one size are alike in the means of patches, and in grain."""
    grain = _grain(first), _grain(second)
    if (np.abs(grain[0] - grain[1]) > _GRAIN_SHARE * np.maximum(*grain)).any():
        return False
    rows, columns = (np.arange(0, size, _PATCH) for size in first.shape[:2])
    sums = np.add.reduceat(np.add.reduceat(first - second, rows), columns, axis=1)
    high, wide = np.diff(rows, append=first.shape[0]), np.diff(columns, append=first.shape[1])
    return bool(np.abs(sums / np.outer(high, wide)[..., None]).max(initial=0.0) <= _PATCH_SHADE)


def _grain(pixels: NDArray[np.float64]) -> NDArray[np.float64]:
    """Root mean square of the step from pixel to pixel, down and across, [2, channels]."""
    return np.stack([np.sqrt((np.diff(pixels, axis=axis) ** 2).mean(axis=(0, 1))) for axis in (0, 1)])


def alike_images(one: bytes, other: bytes) -> bool:
    """Whether two PNG files show the same."""
    if one == other:
        return True
    first, second = (_pixels(image) for image in (one, other))
    if first is None or second is None or first.shape != second.shape:
        return False
    return bool(np.abs(first - second).max(initial=0.0) <= _SHADE)


def _pixels(image: bytes) -> NDArray[np.float64] | None:
    """A PNG file as float64 [rows, columns, channels], 0 to 1; None if it is none."""
    try:
        pixels = np.asarray(imread(io.BytesIO(image), format="png"), dtype=np.float64)
    except (OSError, ValueError, SyntaxError):
        return None
    return pixels.reshape(*pixels.shape[:2], -1)
