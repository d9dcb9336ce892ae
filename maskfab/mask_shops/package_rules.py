"""Every rule and offer of a house on what its package would hold, as a package, a check and a comparison judge it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

from maskfab.export.cell_polygons import PolygonOptions
from maskfab.jobfile import JobSpec
from maskfab.jobfile.shop_profile import Format, Shop
from maskfab.mask_shops.adapt import drawing_options, fitted, ordered_blank
from maskfab.mask_shops.dot_edges import check_plotter
from maskfab.mask_shops.judge import DieFacts, Finding, check_shop
from maskfab.mask_shops.offers import check_ordered
from maskfab.model import Plate


def check_package(
    spec: JobSpec, plate: Plate, shop: Shop, formats: Sequence[Format] = (), facts: DieFacts | None = None
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
    options = package_options(spec, fitted(plate, shop), shop)
    found = check_shop(plate, shop, sent, options, ordered_blank(spec), facts=facts)
    plotted = check_plotter(fitted(plate, shop), spec, shop, sent)
    return check_ordered((*found, *plotted), spec, plate, shop)


def package_options(spec: JobSpec, plate: Plate, shop: Shop) -> PolygonOptions:
    """Drawing of a package for a plate that is :func:`maskfab.mask_shops.adapt.fitted`."""
    return replace(drawing_options(plate, shop), tone=spec.tone)
