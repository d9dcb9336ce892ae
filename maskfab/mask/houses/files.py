"""Files of a plate as a job or a mask house asks for them, the layout that each must show, and how far a plotter's dots
move edges: a width has two edges, so that each may be off by half of what the width may."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from klayout import db

from maskfab.base import __version__
from maskfab.base.arrays import Floats, Ints
from maskfab.base.errors import JobError
from maskfab.base.model import Die, Mark, Plate, Quantity
from maskfab.base.units import MOST_DPI, NM_PER_UM, UM_PER_INCH
from maskfab.job.sections import ExportSection, JobSpec
from maskfab.job.shop import Shop
from maskfab.job.values import PICTURES, PLATE_BITMAPS, FileFormat, ShopFormat
from maskfab.mask.dots import NM_PER_INCH, DotGrid, die_edges_nm, die_raster
from maskfab.mask.figures import Figures, PolygonOptions, draw
from maskfab.mask.formats.format import FileSettings, Product, Stack
from maskfab.mask.formats.table import products
from maskfab.mask.houses.adaptation import (
    as_ordered,
    blank_of,
    drawing_options,
    drawing_style,
    fitted,
    ordered_blank,
    suited,
    written_formats,
    written_options,
)
from maskfab.mask.houses.findings import Finding, PlateFacts, check_shop, sourced
from maskfab.mask.houses.order import check_ordered
from maskfab.mask.judge.verdict import Asked, asked
from maskfab.mask.layout import drawn_region, plate_layout

_ROUNDING = 1e-9


@dataclass(frozen=True)
class EdgeError:
    """Errors of the edges along x and y of a die, or of marks.

    Attributes:
        judged: whether its widths count: those of dies and CD structures, and not of letters, codes and test figures.
        rms_um: root of the mean square, each edge by its length.
    """

    of: str
    die: str | None
    judged: bool
    largest_um: float
    rms_um: float


@dataclass(frozen=True)
class DotEdges:
    """Errors of all edges of a plate's bitmap, and what they may be.

    Attributes:
        limit_um: most that an edge may be off; None where neither job nor house says.
        limit_by: who says so.
        even_dpi: fewest dots per inch, no fewer than these, of which no judged edge is moved; None beyond what a
            plotter may have.
    """

    dpi: int
    errors: tuple[EdgeError, ...]
    limit_um: float | None
    limit_by: str
    even_dpi: int | None

    @property
    def worst(self) -> EdgeError:
        """The largest error of those that are judged, the first of equal ones."""
        judged = (error for error in self.errors if error.judged)
        return max(judged, key=lambda error: error.largest_um, default=EdgeError("the plate", None, True, 0.0, 0.0))

    def quantities(self) -> tuple[Quantity, ...]:
        """Rows of the report."""
        rows, side = [], UM_PER_INCH / self.dpi
        dots = f"dots of {side:g} um ({self.dpi} dpi), each in an opening if its centre is"
        for error in self.errors:
            about = f"edges along x and y of {error.of}; {dots}; edges at an angle are stairs of such dots"
            passed, limit = None, None
            if self.limit_um is not None and error.judged:
                passed, limit = error.largest_um <= self.limit_um + _ROUNDING, self.limit_um
                about += f"; limit: half of {self.limit_by}" + ("" if passed else f". {self._cure()}")
            rows.append(Quantity("dot_edge_error", error.largest_um, about, limit=limit, passed=passed, die=error.die))
            about = f"edges along x and y of {error.of}, each by its length"
            rows.append(Quantity("dot_edge_error_rms", error.rms_um, about, die=error.die))
        return tuple(rows)

    def finding(self) -> Finding:
        """The largest error as a rule of a house; a note where no limit is stated."""
        worst, passed = self.worst, None
        if self.limit_um is not None:
            passed = worst.largest_um <= self.limit_um + _ROUNDING
        value, limit = round(worst.largest_um, 6), None if self.limit_um is None else round(self.limit_um, 6)
        return Finding("edge_error", passed, value, limit, "um", worst.of, "" if passed is not False else self._cure())

    def said(self) -> str:
        """Both errors and the limit in words, for an order."""
        limit = "" if self.limit_um is None else f"; at most {self.limit_um:g} um, half of {self.limit_by}"
        rms = max((error.rms_um for error in self.errors if error.judged), default=0.0)
        return f"at most {self.worst.largest_um:.3g} um from where they are drawn, rms {rms:.3g} um{limit}"

    def _cure(self) -> str:
        # No edge is farther from a border of dots than half a dot.
        assert self.limit_um is not None  # without it nothing is too far
        fine = math.ceil(UM_PER_INCH / (2 * self.limit_um) - _ROUNDING)
        even = "" if self.even_dpi is None else f"at {self.even_dpi} dpi, of which no edge is moved, or "
        return f"Plot {even}at {fine} dpi or more; or send polygons"


def plotted_dpi(section: ExportSection | None, shop: Shop | None) -> int | None:
    """Dots per inch of a plate's bitmap: the job's, or the finest that the house states; None if neither does."""
    stated = None if section is None else section.dpi
    if stated is not None or shop is None or shop.accepts.dpi is None:
        return stated
    return max(shop.accepts.dpi)


def dot_edges(
    plate: Plate, spec: JobSpec, shop: Shop | None, formats: Sequence[str], dpi: int | None
) -> DotEdges | None:
    """Errors of the edges of a plate's bitmap, by the house's and job's tolerances; None if no bitmap is made."""
    if dpi is None or not set(PLATE_BITMAPS) & set(formats):
        return None
    grid = DotGrid.of(plate, dpi)
    marks = [mark for mark in plate.marks if mark.layer.written]
    edges: list[tuple[str, str | None, bool, tuple[Ints, Floats]]] = [
        *((f"die {die.name}", die.name, True, _of_die(die)) for die in plate.dies),
        ("CD structures", None, True, _of_marks([mark for mark in marks if mark.kind == "cd"])),
        ("other marks", None, False, _of_marks([mark for mark in marks if mark.kind != "cd"])),
    ]
    errors = []
    for of, name, is_judged, (places_nm, lengths_nm) in edges:
        if places_nm.size:
            off = np.abs(grid.lines_nm(grid.first(places_nm)) - places_nm) / NM_PER_UM
            rms = math.sqrt(float(np.average(off**2, weights=lengths_nm)))
            errors.append(EdgeError(of, name, is_judged, float(off.max()), rms))
    limit, by = _limit(plate, spec, shop)
    judged = np.concatenate(
        [np.empty(0, dtype=np.int64), *(places for _, _, is_judged, (places, _) in edges if is_judged)]
    )
    return DotEdges(dpi, tuple(errors), limit, by, _even_dpi(judged, plate, dpi))


def check_plotter(plate: Plate, spec: JobSpec, shop: Shop, formats: Sequence[str]) -> tuple[Finding, ...]:
    """Judge a bitmap that a house is sent: its dots per inch by those that the house states, and what they do to edges.

    Nothing where no bitmap is sent, or nobody states dots per inch.
    """
    dpi, offered = plotted_dpi(spec.export, shop), shop.accepts.dpi
    edges = dot_edges(plate, spec, shop, formats, dpi)
    if edges is None:
        return ()
    findings = [edges.finding()]
    if offered is not None:
        listed = " ".join(map(str, sorted(offered)))
        cure = f'Set dpi = "{max(offered)} dpi" in [export]'
        findings.append(Finding.judged("dpi", dpi in offered, edges.dpi, listed, "dpi", cure=cure))
    return sourced(findings, shop)


def _limit(plate: Plate, spec: JobSpec, shop: Shop | None) -> tuple[float | None, str]:
    """Half of what widths may be off: as ordered, as the house orders by itself, or as it promises the narrowest."""
    asked = [] if spec.order is None else [(spec.order.cd, "the job's tolerance of widths")]
    if shop is not None:
        asked.append((shop.order.default.cd, f"what {shop.name} makes by itself"))
    for cd, by in asked:
        if cd is not None and cd.tolerance is not None:
            return cd.tolerance / 2, f"{by}, {cd.tolerance:g} um"
    widths = [die.panel.dot_nm for die in plate.dies] + [gauge.target_nm for gauge in plate.gauges]
    if shop is None or not widths:
        return None, ""
    promised = shop.tolerance.of_width(min(widths) / NM_PER_UM)
    return (None, "") if promised is None else (promised / 2, f"what {shop.name} promises, {promised:g} um")


def _of_die(die: Die) -> tuple[Ints, Floats]:
    """Places of edges in nm, of upright ones along x and of level ones along y, and the length of each."""
    x, y = die_edges_nm(die)
    clear = np.pad(die_raster(die), 1)
    inner = slice(1, -1)
    across = np.diff(y) @ (clear[inner, 1:] != clear[inner, :-1])
    upwards = (clear[1:, inner] != clear[:-1, inner]) @ np.diff(x)
    places, lengths = np.concatenate([x, y]), np.concatenate([across, upwards])
    used = lengths > 0
    return np.rint(places[used]).astype(np.int64), lengths[used]


def _of_marks(marks: Sequence[Mark]) -> tuple[Ints, Floats]:
    """Places and lengths, as of a die, of edges along x and y of marks when they are merged."""
    drawn = drawn_region(polygon for mark in marks for polygon in mark.polygons)
    edges = [edge for edge in drawn.merged(True, 1).edges().each() if edge.x1 == edge.x2 or edge.y1 == edge.y2]
    places = np.array([edge.x1 if edge.x1 == edge.x2 else edge.y1 for edge in edges], dtype=np.int64)
    return places, np.array([edge.length() for edge in edges], dtype=np.float64)


def _even_dpi(places_nm: Ints, plate: Plate, dpi: int) -> int | None:
    """Fewest dots per inch from ``dpi`` on of which a border of dots lies at every place; None beyond what there is."""
    step = NM_PER_INCH // math.gcd(NM_PER_INCH, int(np.gcd.reduce(places_nm, initial=0)))
    for even in range(-(-dpi // step) * step, MOST_DPI + 1, step):
        # With an odd number of dots the plate's centre lies in one.
        if DotGrid.of(plate, even).side % 2 == 0:
            return even
    return None


def check_package(
    spec: JobSpec, plate: Plate, shop: Shop, formats: Sequence[ShopFormat] = (), facts: PlateFacts | None = None
) -> tuple[Finding, ...]:
    """The house's rules of the mask files (its first if empty), what its plotter does, and what it offers."""
    sent = tuple(formats) or shop.formats[:1]
    drawn = fitted(plate, shop, spec.tone)
    findings = check_shop(drawn, shop, sent, package_options(spec, drawn, shop), ordered_blank(spec), facts=facts)
    plotted = check_plotter(drawn, spec, shop, sent)
    # A plotter's dots are far coarser than a bias that they should be short of.
    limit, cure = "polygons, for the data are biased", 'Send polygons, or set order.bias = "house" or "none"'
    dots = [bitmap for bitmap in PLATE_BITMAPS if bitmap in sent] if spec.data_bias_nm else []
    coarse = [Finding("biased_format", False, dot, limit, cure=cure) for dot in dots]
    return check_ordered((*findings, *coarse, *plotted), spec, plate, drawn, shop, facts)


def package_options(spec: JobSpec, plate: Plate, shop: Shop) -> PolygonOptions:
    """Drawing of a package for a plate that is :func:`maskfab.mask.houses.adaptation.fitted`."""
    return as_ordered(drawing_options(plate, shop, tone=spec.tone), spec)


_MB = 1_000_000


@dataclass(frozen=True, eq=False)
class PlateFiles:
    """A plate, the layout that its files must show, and the files as writers draw them.

    Attributes:
        plate: the plate, its marks as the house takes them.
        design: the plate as :func:`maskfab.mask.layout.plate_layout` builds it. It is made from the plate and
            not from the figures, so that a fault of what draws them shows when files are read back.
        edges: what a plotter's dots make of edges; None where no file is of dots.
        asked: what the job asks for, derived without the plate; None of a plate that no job has laid out.
    """

    plate: Plate
    design: db.Layout
    figures: Figures
    products: tuple[Product, ...]
    settings: FileSettings
    formats: tuple[FileFormat, ...]
    edges: DotEdges | None = None
    asked: Asked | None = None

    def account(self) -> tuple[Quantity, ...]:
        """Changes made to draw what formats and readers accept, as rows of the report."""
        said = self.figures.account
        counts = {
            "drawn_holes": (said.holed, f"outlines with holes, drawn by {self.figures.options.holes}"),
            "drawn_parted": (said.parted, "outlines parted where they touched themselves"),
            "drawn_split": (said.split, f"outlines cut for more than {self.figures.options.max_vertices} vertices"),
        }
        if said.snapped is not None:
            counts["drawn_snapped"] = said.snapped.vertices, str(said.snapped)
        rows = tuple(Quantity(name, count, method) for name, (count, method) in counts.items())
        return rows if self.edges is None else (*rows, *self.edges.quantities())


def files_of_job(plate: Plate, spec: JobSpec, comments: Sequence[str], shop: Shop | None = None) -> PlateFiles:
    """Draw a plate as the job's [export] asks, or as cells in GDSII, OASIS and DXF if it asks for nothing.

    What it leaves to the ``shop`` that it names is chosen by :mod:`maskfab.mask.houses.adaptation`, and marks are drawn
    as the house takes them.

    Raises:
        OutputError: MF413, MF416 for drawings that cannot be made.
        JobError: MF105 for a bitmap of the plate without its dots per inch.
    """
    section = spec.export or ExportSection()
    formats = written_formats(section, shop)
    glass_nm = blank_of(spec).glass_nm
    dpi = plotted_dpi(section, shop)
    check_stated(dpi, formats)
    settings = FileSettings(
        Stack(
            section.chrome * NM_PER_UM,
            Stack().glass_nm if glass_nm is None else glass_nm,
            section.exaggeration,
            "neck" if spec.order is not None and spec.order.corner_touches == "join" else "gap",
            None if spec.order is None or spec.order.corner_width is None else spec.order.corner_width * NM_PER_UM,
        ),
        round(section.stl_limit_mb * _MB),
        section.dots_per_um,
        dpi,
        drawing_style(plate, shop),
    )
    options = as_ordered(written_options(plate, section, shop, spec.tone), spec)
    taken = plate if shop is None else suited(plate, shop, options.holes)
    figures = draw(taken, options)
    made = products(figures, formats, comments, settings)
    edges = dot_edges(taken, spec, shop, formats, dpi)
    return PlateFiles(taken, plate_layout(taken), figures, made, settings, formats, edges)


def check_stated(dpi: int | None, formats: Sequence[FileFormat]) -> None:
    """Refuse bitmaps of a plate without dots per inch. Raises JobError MF105."""
    asked = [form for form in formats if form in PLATE_BITMAPS]
    if asked and dpi is None:
        what = f"{asked[0]} is made of a plotter's dots, and nobody says how many there are to the inch"
        cure = 'Set dpi = "25400 dpi" or what your house plots at in [export], or leave the format out'
        raise JobError("MF105", what, where="export.dpi", cure=cure)


def check_polygons(spec: JobSpec, formats: Sequence[FileFormat], where: str) -> None:
    """Refuse biased data as pictures, whose dots are far coarser than a bias. Raises JobError MF128."""
    dots = [form for form in formats if form in (*PLATE_BITMAPS, *PICTURES)]
    if spec.data_bias_nm and dots:
        what = f"{dots[0]} is made of dots, which are far coarser than the bias that the data should be short of"
        cure = f'Leave {" and ".join(dots)} out of formats, or let the house make it good: order.bias = "house"'
        raise JobError("MF128", what, where=f"{where}: export.formats", cure=cure)


def files_for_shop(
    plate: Plate,
    shop: Shop,
    formats: Sequence[ShopFormat],
    comments: Sequence[str],
    stem: str,
    spec: JobSpec,
    facts: PlateFacts | None = None,
    *,
    file: Path | None = None,
    version: str = __version__,
) -> PlateFiles:
    """Draw a plate of :func:`maskfab.mask.houses.adaptation.fitted` as its house takes it; the judge reads ``file``."""
    dpi = plotted_dpi(spec.export, shop)
    check_stated(dpi, formats)
    settings = FileSettings(dpi=dpi, drawing=drawing_style(plate, shop))
    options = package_options(spec, plate, shop)
    figures = draw(plate, options) if facts is None else facts.drawn(plate, options)
    made = products(figures, formats, comments, settings, stem)
    edges = dot_edges(plate, spec, shop, formats, dpi)
    design = plate_layout(plate) if facts is None else facts.design(plate)
    wanted = asked(spec, shop, file=file, sent=True, version=version)
    return PlateFiles(plate, design, figures, made, settings, tuple(formats), edges, wanted)
