"""Every rule and offer of a house on what its package would hold, as a package, a check and a comparison judge it."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

from maskfab.export.cell_polygons import PolygonOptions
from maskfab.jobfile import PLATE_BITMAPS, JobSpec
from maskfab.jobfile.shop_profile import Format, Shop
from maskfab.mask_shops.adapt import as_ordered, drawing_options, fitted, ordered_blank
from maskfab.mask_shops.dot_edges import check_plotter
from maskfab.mask_shops.judge import Finding, PlateFacts, check_shop
from maskfab.mask_shops.offers import check_ordered
from maskfab.model import Plate


def check_package(
    spec: JobSpec, plate: Plate, shop: Shop, formats: Sequence[Format] = (), facts: PlateFacts | None = None
) -> tuple[Finding, ...]:
    """The house's rules, what its plotter does to the plate, and what it offers.

    Args:
        spec: of the job.
        plate: laid out of it.
        shop: the house.
        formats: of the mask files; the house's first if empty.
        facts: as of :func:`maskfab.mask_shops.judge.check_shop`.
    """
    sent = tuple(formats) or shop.formats[:1]
    drawn = fitted(plate, shop, spec.tone)
    found = check_shop(drawn, shop, sent, package_options(spec, drawn, shop), ordered_blank(spec), facts=facts)
    plotted = check_plotter(drawn, spec, shop, sent)
    return check_ordered((*found, *_of_dots(spec, sent), *plotted), spec, plate, drawn, shop, facts)


def _of_dots(spec: JobSpec, formats: Sequence[str]) -> Iterator[Finding]:
    """A plotter's dots are far coarser than a bias that they should be short of."""
    for each in PLATE_BITMAPS if spec.data_bias_nm else ():
        if each in formats:
            cure = 'Send polygons, or set order.bias = "house" or "none"'
            yield Finding("biased_format", False, each, "polygons, for the data are biased", cure=cure)


def package_options(spec: JobSpec, plate: Plate, shop: Shop) -> PolygonOptions:
    """Drawing of a package for a plate that is :func:`maskfab.mask_shops.adapt.fitted`."""
    return as_ordered(drawing_options(plate, shop, tone=spec.tone), spec)
