"""One plate at several houses: which take it, drawn how, and why the others refuse.

JobSpec + Plate + Shops -> Bids, judged as their packages would be.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

from maskfab.export.cell_polygons import PolygonOptions
from maskfab.jobfile import JobSpec
from maskfab.jobfile.shop_profile import Format, Shop
from maskfab.mask_shops.adapt import extent_nm, fitted, kept_grid_nm
from maskfab.mask_shops.judge import Finding, PlateFacts, accepted
from maskfab.mask_shops.order import order_of
from maskfab.mask_shops.package_rules import check_package, package_options
from maskfab.model import Plate
from maskfab.progress import Progress, silent
from maskfab.units import NM_PER_UM

_HOLES = {"keyhole": "holes as keyholes", "trapezoids": "holes as trapezoids", "layer": "holes on a layer of their own"}


@dataclass(frozen=True)
class Bid:
    """A house's answer to a plate, as far as its published rules give one.

    Attributes:
        shop: name of its profile.
        title: the house.
        format: of the file that would be sent.
        findings: its rules.
        changes: in which the data differ from those for a house without rules, a phrase each.
        blanks: keys of [order] that nobody has answered.
    """

    shop: str
    title: str
    format: Format
    findings: tuple[Finding, ...]
    changes: tuple[str, ...]
    blanks: tuple[str, ...]

    @property
    def taken(self) -> bool:
        """Whether no rule is broken."""
        return accepted(self.findings)

    @property
    def refusals(self) -> tuple[Finding, ...]:
        """Rules that the plate breaks."""
        return tuple(each for each in self.findings if each.passed is False)

    @property
    def agreed(self) -> tuple[Finding, ...]:
        """Questions to agree with the house before it starts."""
        left = (each for each in self.findings if each.passed is None)
        return tuple(each for each in left if each.rule != "corner_touches" or each.rule in self.blanks)


def compare_shops(spec: JobSpec, plate: Plate, shops: Sequence[Shop], progress: Progress = silent) -> tuple[Bid, ...]:
    """Judge a composed plate by the rules of several houses; nothing is written. A second or less for each.

    Args:
        spec: of the job.
        plate: laid out of it.
        shops: to compare.
        progress: told where the work stands.
    """
    bids, facts = [], PlateFacts()
    for done, shop in enumerate(shops):
        progress("rules", done, len(shops))
        bids.append(_bid(spec, plate, shop, facts))
    progress("rules", len(shops), len(shops))
    return tuple(bids)


def _bid(spec: JobSpec, plate: Plate, shop: Shop, facts: PlateFacts) -> Bid:
    drawn, sent = fitted(plate, shop), shop.formats[0]
    options = package_options(spec, drawn, shop)
    findings = check_package(spec, plate, shop, (sent,), facts)
    touches = next((int(each.value) for each in findings if each.rule == "corner_touches"), 0)
    order = order_of(spec, drawn, shop, touches)
    changes = tuple(_changes(drawn, shop, options, sent))
    return Bid(shop.name, shop.title, sent, findings, changes, tuple(each.key for each in order.missing))


def _changes(drawn: Plate, shop: Shop, options: PolygonOptions, sent: Format) -> Iterator[str]:
    if sent.startswith("dxf") and shop.accepts.drawing_unit == "mm":
        yield "drawn in mm"
    if options.bias_nm:
        yield f"data biased by {-options.bias_nm / NM_PER_UM:+g} um"
    if options.hierarchy != "cells":
        yield "openings merged across cells" if options.hierarchy == "merged" else "without cells"
    if options.max_references is not None:
        yield "two pixels share a cell"
    if options.holes in _HOLES:
        yield _HOLES[options.holes]
    if options.corners == "joined":
        yield "corners that meet in one outline"
    if shop.polygons.shared_boundaries is False:
        yield "marks as stencils"
    grid = kept_grid_nm(drawn, shop)
    if grid > 1:
        yield f"marks on a grid of {grid} nm"
    if extent_nm(shop) is not None and shop.plate.corner_square_um is not None:
        yield "squares at its corners"
    if shop.names.layers:
        yield "layers renamed"
