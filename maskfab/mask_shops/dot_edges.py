"""Displacement of edges by a plotter's dots: how far each lies from where it is drawn, and how far it may.

A width has two edges, so that each may be off by half of what the width may.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from klayout import db

from maskfab.base.arrays import Floats, Ints
from maskfab.geometry.die_grid import die_edges_nm, die_raster
from maskfab.geometry.dot_grid import NM_PER_INCH, DotGrid
from maskfab.geometry.plate_layout import simple_polygon
from maskfab.jobfile import PLATE_BITMAPS, ExportSection, JobSpec
from maskfab.jobfile.shop_profile import Shop
from maskfab.mask_shops.judge import Finding
from maskfab.model import Die, Furniture, Plate, Quantity
from maskfab.units import MOST_DPI, NM_PER_UM, UM_PER_INCH

_ROUNDING = 1e-9


@dataclass(frozen=True)
class EdgeError:
    """Errors of the edges along x and y of a die, or of marks.

    Attributes:
        of: the die, or which marks, in words.
        die: its name; None for marks.
        judged: whether its widths count: those of dies and CD structures, and not of letters, codes and test figures.
        largest_um: of any.
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
        dpi: dots per inch.
        found: of dies and marks.
        limit_um: most that an edge may be off; None where neither job nor house says.
        limit_by: who says so.
        even_dpi: fewest dots per inch, no fewer than these, of which no judged edge is moved; None beyond what a
            plotter may have.
    """

    dpi: int
    found: tuple[EdgeError, ...]
    limit_um: float | None
    limit_by: str
    even_dpi: int | None

    @property
    def worst(self) -> EdgeError:
        """The largest error of those that are judged, the first of equal ones."""
        judged = (each for each in self.found if each.judged)
        return max(judged, key=lambda each: each.largest_um, default=EdgeError("the plate", None, True, 0.0, 0.0))

    def quantities(self) -> tuple[Quantity, ...]:
        """Rows of the report."""
        rows = []
        for each in self.found:
            about = f"edges along x and y of {each.of}; {self._dots()}"
            passed, limit = None, None
            if self.limit_um is not None and each.judged:
                passed, limit = each.largest_um <= self.limit_um + _ROUNDING, self.limit_um
                about += f"; limit: half of {self.limit_by}" + ("" if passed else f". {self._cure()}")
            rows += [
                Quantity("dot_edge_error", each.largest_um, about, limit=limit, passed=passed, die=each.die),
                Quantity(
                    "dot_edge_error_rms",
                    each.rms_um,
                    f"edges along x and y of {each.of}, each by its length",
                    die=each.die,
                ),
            ]
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
        rms = max((each.rms_um for each in self.found if each.judged), default=0.0)
        return f"at most {self.worst.largest_um:.3g} um from where they are drawn, rms {rms:.3g} um{limit}"

    def _dots(self) -> str:
        dots = f"dots of {UM_PER_INCH / self.dpi:g} um ({self.dpi} dpi), each in an opening if its centre is"
        return f"{dots}; edges at an angle are stairs of such dots"

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
    """Errors of the edges of a plate's bitmap; None if none is among the formats.

    Args:
        plate: what is plotted.
        spec: of its job, whose [order] may state a tolerance of widths.
        shop: the house, which may have published one.
        formats: of the files.
        dpi: dots per inch of the plotter.
    """
    if dpi is None or not set(PLATE_BITMAPS) & set(formats):
        return None
    grid = DotGrid.of(plate, dpi)
    marks = [mark for mark in plate.furniture if mark.layer.written]
    edges = [
        *(_of_die(die) for die in plate.dies),
        _of_marks([mark for mark in marks if mark.kind == "cd"], "CD structures", judged=True),
        _of_marks([mark for mark in marks if mark.kind != "cd"], "other marks", judged=False),
    ]
    found = tuple(each.error(grid) for each in edges if each.places_nm.size)
    limit, by = _limit(plate, spec, shop)
    judged = np.concatenate([np.empty(0, dtype=np.int64), *(each.places_nm for each in edges if each.judged)])
    return DotEdges(dpi, found, limit, by, _even_dpi(judged, plate, dpi))


def check_plotter(plate: Plate, spec: JobSpec, shop: Shop, formats: Sequence[str]) -> tuple[Finding, ...]:
    """Judge a bitmap that a house is sent: its dots per inch by those that the house states, and what they do to edges.

    Nothing where no bitmap is sent, or nobody states dots per inch.

    Args:
        plate: what is plotted.
        spec: of its job.
        shop: the house.
        formats: of the files.
    """
    dpi, offered = plotted_dpi(spec.export, shop), shop.accepts.dpi
    edges = dot_edges(plate, spec, shop, formats, dpi)
    if edges is None:
        return ()
    found = [edges.finding()]
    if offered is not None:
        known = " ".join(map(str, sorted(offered)))
        cure = "" if dpi in offered else f'Set dpi = "{max(offered)} dpi" in [export]'
        found.append(Finding("dpi", dpi in offered, edges.dpi, known, "dpi", cure=cure))
    source = " ".join(shop.sources)
    return tuple(replace(each, source=source) for each in found)


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


@dataclass(frozen=True, eq=False)
class _Edges:
    """Edges along x and y.

    Attributes:
        of: whose.
        die: its name; None for marks.
        judged: as in :class:`EdgeError`.
        places_nm: of upright ones along x, of level ones along y.
        lengths_nm: of each.
    """

    of: str
    die: str | None
    judged: bool
    places_nm: Ints
    lengths_nm: Floats

    def error(self, grid: DotGrid) -> EdgeError:
        off = np.abs(grid.lines_nm(grid.first(self.places_nm)) - self.places_nm) / NM_PER_UM
        rms = math.sqrt(float(np.average(off**2, weights=self.lengths_nm)))
        return EdgeError(self.of, self.die, self.judged, float(off.max()), rms)


def _of_die(die: Die) -> _Edges:
    x, y = die_edges_nm(die)
    clear = np.pad(die_raster(die), 1)
    inner = slice(1, -1)
    across = np.diff(y) @ (clear[inner, 1:] != clear[inner, :-1])
    upwards = (clear[1:, inner] != clear[:-1, inner]) @ np.diff(x)
    places, lengths = np.concatenate([x, y]), np.concatenate([across, upwards])
    used = lengths > 0
    return _Edges(f"die {die.name}", die.name, True, np.rint(places[used]).astype(np.int64), lengths[used])


def _of_marks(marks: Sequence[Furniture], of: str, *, judged: bool) -> _Edges:
    drawn = db.Region([db.Polygon(simple_polygon(polygon)) for mark in marks for polygon in mark.polygons])
    edges = [each for each in drawn.merged(True, 1).edges().each() if each.x1 == each.x2 or each.y1 == each.y2]
    places = np.array([each.x1 if each.x1 == each.x2 else each.y1 for each in edges], dtype=np.int64)
    return _Edges(of, None, judged, places, np.array([each.length() for each in edges], dtype=np.float64))


def _even_dpi(places_nm: Ints, plate: Plate, dpi: int) -> int | None:
    """Fewest dots per inch from ``dpi`` on of which a border of dots lies at every place; None beyond what there is."""
    step = NM_PER_INCH // math.gcd(NM_PER_INCH, int(np.gcd.reduce(places_nm, initial=0)))
    for each in range(-(-dpi // step) * step, MOST_DPI + 1, step):
        # With an odd number of dots the plate's centre lies in one.
        if DotGrid.of(plate, each).side % 2 == 0:
            return each
    return None
