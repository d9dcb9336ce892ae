"""Profiles of mask shops: the data they accept, as published, with the pages that each was read on.

A profile states facts only. What it leaves out the house does not publish, so nothing is judged by it.
"""

from __future__ import annotations

import os
import re
import warnings
from datetime import date, timedelta
from pathlib import Path
from typing import Annotated, Literal, TypeAlias

from pydantic import AfterValidator, Field, ValidationError

from maskfab.base.errors import OutputError
from maskfab.base.model import CHROME, LAYERS
from maskfab.base.units import MOST_DPI
from maskfab.job.faults import problems
from maskfab.job.order import ChromeSide, Film, Glass, OrderSection, Protection, Reading, Tone
from maskfab.job.toml import dumps, loads
from maskfab.job.values import Section, ShopFormat

OrderField: TypeAlias = Literal[
    "mask_name",
    "tone",
    "parity",
    "min_cd_and_location",
    "grid",
    "blank",
    "centred",
    "units",
    "design_layers",
    "display_work",
    "comments",
]

_LASTING = timedelta(days=730)
"""For which what a house publishes is taken to hold."""


def _listed(minimum: int = 0) -> object:
    """TOML has lists where the model has tuples."""
    return Field(strict=False, min_length=minimum)


def _expression(text: str) -> str:
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("error")  # Python warns of what it will read otherwise one day
            re.compile(text)
    except (re.error, FutureWarning) as error:
        raise ValueError(f"no regular expression: {error}") from error
    return text


def _address(text: str) -> str:
    if not re.match(r"https?://\S+$", text):
        raise ValueError("no address of a page")
    return text


_LAYERS = (CHROME.name, "CUT", *(layer.name for layer in LAYERS))
_LAYER_NAME = re.compile(r"[A-Za-z0-9_$-]{1,31}")


def _layer(name: str) -> str:
    if name not in _LAYERS:
        raise ValueError(f"there is no such layer; there are {', '.join(_LAYERS)}")
    return name


def _layer_name(name: str) -> str:
    if not _LAYER_NAME.fullmatch(name) or name.upper() in ("0", "DEFPOINTS"):
        raise ValueError(f"{name!r} is no name for a layer: 1 to 31 letters, digits, _, $ or -, not 0 nor DEFPOINTS")
    return name


Pattern = Annotated[str, AfterValidator(_expression)]
Address = Annotated[str, AfterValidator(_address)]
LayerKey = Annotated[str, AfterValidator(_layer)]
LayerName = Annotated[str, AfterValidator(_layer_name)]
Positive = Annotated[float, Field(gt=0, allow_inf_nan=False)]
UpTo = Annotated[float, Field(gt=0)]
Count = Annotated[int, Field(gt=0)]
Sides = Annotated[tuple[Positive, Positive], Field(strict=False)]
# What no plate has room for would take any check on it for ever.
Extent = Annotated[float, Field(gt=0, le=2000, allow_inf_nan=False)]
Width = Annotated[float, Field(gt=0, le=10_000, allow_inf_nan=False)]
Grid = Annotated[int, Field(gt=0, le=1_000_000)]


class Accepts(Section):
    """[accepts]: files that the house takes.

    Attributes:
        formats: those that maskfab writes, the one to send first; None where the house publishes no list.
        ruled: without a list, formats that its rules speak of, the one to send first.
        others: further formats that it takes and maskfab does not write.
        versions: by format, what is said about its versions.
        drawing_unit: what one unit of a DXF drawing must be; it is drawn so.
        dpi: dots per inch at which it plots bitmaps.
        one_mask_per_layer: whether every mask must have a layer of its own.
    """

    formats: Annotated[tuple[ShopFormat, ...], _listed(1)] | None = None
    ruled: Annotated[tuple[ShopFormat, ...], _listed()] = ()
    others: Annotated[tuple[str, ...], _listed()] = ()
    versions: dict[str, str] = Field(default_factory=dict)
    drawing_unit: Literal["um", "mm"] | None = None
    dpi: Annotated[tuple[Annotated[int, Field(gt=0, le=MOST_DPI)], ...], _listed(1)] | None = None
    one_mask_per_layer: bool | None = None


class ShopLimits(Section):
    """[limits]: numbers that data must keep to.

    Attributes:
        max_references: definitions, and references, of one file.
        max_flashes: rectangles that a pattern generator exposes one by one.
        min_feature_on_request_um: widths from here to ``min_feature_um`` are made after asking.
        grid_nm: grids of which the data must keep one.
    """

    max_vertices: Annotated[int, Field(ge=4)] | None = None
    max_references: Count | None = None
    max_depth: Count | None = None
    max_layers: Count | None = None
    max_layer_number: Count | None = None
    max_flashes: Count | None = None
    max_coordinate_mm: Positive | None = None
    min_feature_um: Width | None = None
    min_feature_on_request_um: Width | None = None
    min_space_um: Width | None = None
    grid_nm: Annotated[tuple[Grid, ...], _listed(1)] | None = None


class ShopPlate(Section):
    """[plate]: blanks and how much of them is written; sides in millimetres, width before height.

    Attributes:
        blanks_in: square blanks in stock, by side in inches.
        plot_area_mm: area that can be written.
        extent_mm: what the drawing must span exactly.
        corner_square_um: side of the squares that mark the corners of that extent.
        chrome_nm: thickness of the chrome, least and most.
        glass_mm: thickness of the glass, least and most.
    """

    blanks_in: Annotated[tuple[Positive, ...], _listed(1)] | None = None
    largest_mm: Sides | None = None
    plot_area_mm: Sides | None = None
    extent_mm: Annotated[tuple[Extent, Extent], Field(strict=False)] | None = None
    corner_square_um: Width | None = None
    chrome_nm: Sides | None = None
    glass_mm: Sides | None = None


class ShopNames(Section):
    """[names]: names of plates, cells and layers; patterns match whole names, ``forbidden`` any part in any case.

    Attributes:
        layers: what layers are called in DXF and OASIS, by their names on the plate, such as CLEAR; others keep theirs.
    """

    pattern: Pattern | None = None
    max_length: Count | None = None
    forbidden: Annotated[tuple[str, ...], _listed()] = ()
    layer_pattern: Pattern | None = None
    layer_max_length: Count | None = None
    forbidden_layers: Annotated[tuple[str, ...], _listed()] = ()
    block_equals_layer: bool | None = None
    layers: dict[LayerKey, LayerName] = Field(default_factory=dict)


class ShopBlocks(Section):
    """[blocks]: what references may do to what they place."""

    mirrored: bool | None = None
    scaled: bool | None = None
    rotation_step_deg: Positive | None = None


class ShopText(Section):
    """[text]: formats in which text is taken, and what it may be; None where nothing is said.

    Attributes:
        allowed_in: formats; in others maskfab writes none.
        charset: letters that it may have.
        separate_layer: whether it should have a layer of its own.
    """

    allowed_in: Annotated[tuple[ShopFormat, ...], _listed()] | None = None
    charset: Literal["ascii"] | None = None
    italic: bool | None = None
    separate_layer: bool | None = None


class ShopPolygons(Section):
    """[polygons]: what outlines may do, and how maskfab draws for this house.

    Attributes:
        hierarchy: cells with references, or outlines merged across cells.
        holes: how a hole is drawn, for formats without holes.
        max_vertices: of an outline as maskfab writes it; the house may allow more.
        shared_boundaries: whether two figures may share a piece of edge.
        corner_touches: whether two figures may meet by a corner only.
    """

    hierarchy: Literal["cells", "flat", "merged"] = "cells"
    holes: Literal["bisect", "keyhole", "trapezoids", "layer"] = "bisect"
    max_vertices: Annotated[int, Field(ge=4, le=8191)] = 4094
    self_crossing: bool | None = None
    self_touching: bool | None = None
    doubled_vertices: bool | None = None
    shared_boundaries: bool | None = None
    corner_touches: bool | None = None


class ShopTolerance(Section):
    """[tolerance]: what the house promises of the finished mask, for the order sheet.

    Attributes:
        cd_um: rows of (widths up to, deviation).
        defect_um: largest defects, typical and least.
    """

    cd_um: Annotated[tuple[Annotated[tuple[UpTo, Positive], Field(strict=False)], ...], _listed()] = ()
    defect_um: Sides | None = None
    short_um: Positive | None = None
    long_um: Positive | None = None

    def of_width(self, width_um: float) -> float | None:
        """Largest deviation of a width, a short distance where widths have no rows; None without a promise."""
        rows = sorted(self.cd_um)
        return next((deviation for most, deviation in rows if width_um <= most), None if rows else self.short_um)


class ShopOffers(Section):
    """[offers]: what can be ordered; what is left out the house does not publish, and any choice is agreed with it.

    Thickness and sizes of blanks are those of [plate], widths and defects those of [tolerance].

    Attributes:
        chromes: sides from which the plate is read.
        densities: optical density of the film, least and most.
        registration_um: best that is kept.
        biased: whether the house changes widths on request.
        most: plates of one order.
    """

    parities: Annotated[tuple[Reading, ...], _listed(1)] | None = None
    chromes: Annotated[tuple[ChromeSide, ...], _listed(1)] | None = None
    glasses: Annotated[tuple[Glass, ...], _listed(1)] | None = None
    films: Annotated[tuple[Film, ...], _listed(1)] | None = None
    densities: Sides | None = None
    registration_um: Positive | None = None
    protections: Annotated[tuple[Protection, ...], _listed(1)] | None = None
    biased: bool | None = None
    most: Count | None = None


class ShopOrder(Section):
    """[order]: what its order form asks for, in which words, and what it makes where an order says nothing.

    Attributes:
        fields: what is asked for, in the order of the form; empty where the house publishes no form.
        tones: tones of digitized data that can be ordered.
        tone_words: how the form names each of them.
        default: answers for keys that a job's [order] leaves out, as the house publishes them.
    """

    fields: Annotated[tuple[OrderField, ...], _listed()] = ()
    tones: Annotated[tuple[Tone, ...], _listed(1)] = ("clear", "dark")
    tone_words: dict[Tone, str] = Field(default_factory=dict)
    default: OrderSection = OrderSection()


class Shop(Section):
    """One house, or one machine of it.

    Attributes:
        sources: pages on which the facts were read; empty for a profile that stands for no house.
        read_on: day on which they, or stored copies of them, were read last, such as 2026-09-30; None where nobody has
            written it down.
        third_party: keys that were read elsewhere than on a page of the house.
    """

    name: str
    title: str
    sources: Annotated[tuple[Address, ...], _listed()]
    read_on: date | None = None
    third_party: Annotated[tuple[str, ...], _listed()] = ()
    accepts: Accepts = Accepts()
    limits: ShopLimits = ShopLimits()
    plate: ShopPlate = ShopPlate()
    names: ShopNames = ShopNames()
    blocks: ShopBlocks = ShopBlocks()
    text: ShopText = ShopText()
    polygons: ShopPolygons = ShopPolygons()
    tolerance: ShopTolerance = ShopTolerance()
    offers: ShopOffers = ShopOffers()
    order: ShopOrder = ShopOrder()

    @property
    def formats(self) -> tuple[ShopFormat, ...]:
        """Formats to choose from, the first to be sent; GDSII and DXF where the house publishes none at all."""
        return self.accepts.formats or self.accepts.ruled or ("gdsii", "dxf_r12")

    def outdated(self, day: date) -> bool:
        """Whether its rules were read more than two years before a day; not so where nobody wrote down when."""
        return self.read_on is not None and day - self.read_on > _LASTING

    @property
    def layer_names(self) -> dict[str, str]:
        """Names of the layers in DXF and OASIS, by their names on the plate."""
        return {name: self.names.layers.get(name, name) for name in _LAYERS}


def read_shop(path: Path, where: str = "") -> Shop:
    """A profile from its file; it is called as the file is. ``where`` is the key that names the file.

    Raises:
        OutputError: MF420 if there is no such file; MF421 if it is malformed.
    """
    if not os.path.isfile(path):
        cure = "Give the path of a profile (.toml), or a name that maskfab order list lists"
        raise OutputError("MF420", f"there is no profile {path}", where=where, cure=cure)
    try:
        text = path.read_bytes().decode("utf-8-sig")
    except (OSError, UnicodeDecodeError) as error:
        what = f"the profile {path} cannot be read: {error}"
        raise OutputError("MF421", what, cure="Save the profile as UTF-8 text") from error
    return parse_shop(text, path.stem, where=str(path))


def parse_shop(text: str, name: str, *, where: str) -> Shop:
    """A profile from the text of its file.

    Raises:
        OutputError: MF421 for the first thing that is wrong: no TOML, an unknown key, a value of the wrong type.
    """
    try:
        shop = Shop.model_validate({**loads(text), "name": name})
    except ValidationError as error:
        problem, *others = problems(error, Shop, loads(text), where)
        more = f"; {len(others)} more follow{'s' if len(others) == 1 else ''}" if others else ""
        raise OutputError("MF421", problem.what + more, where=problem.where, cure=problem.cure) from error
    except (ValueError, RecursionError) as error:
        cure = "Correct the TOML there: close quotes and brackets, give every key one value"
        raise OutputError("MF421", f"the profile is not valid TOML: {error}", where=where, cure=cure) from error
    if shop.order.default.bias == "data":
        what = 'the default of bias is "data", and the data are the job\'s'
        cure = 'Set bias = "house" where the house makes its bias good by itself, else leave it out'
        raise OutputError("MF421", what, where=f"{where}: order.default.bias", cure=cure)
    return shop


def dump_shop(shop: Shop) -> str:
    """The profile as TOML text, defaults and all: equal profiles have equal texts, however their files are laid out.

    Of that text and the same name ``parse_shop`` makes an equal profile.
    """
    said = shop.model_dump(mode="python", exclude={"name"}, exclude_none=True)
    return dumps(said)
