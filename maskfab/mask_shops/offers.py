"""An order against what its house offers: for every key what it does not have, and what it has."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace

from maskfab.jobfile import JobSpec
from maskfab.jobfile.shop_profile import Shop
from maskfab.mask_shops.adapt import ordered_blank
from maskfab.mask_shops.judge import Finding, PlateFacts, span_text
from maskfab.model import Plate
from maskfab.plate.marks.template import plate_template, template_names
from maskfab.units import NM_PER_MM, NM_PER_UM, UM_PER_MM

_CHOICES = (("parity", "parities"), ("chrome", "chromes"), ("glass", "glasses"), ("film", "films"),
            ("protection", "protections"))  # fmt: skip


def check_ordered(
    found: Sequence[Finding], spec: JobSpec, plate: Plate, drawn: Plate, shop: Shop, facts: PlateFacts | None = None
) -> tuple[Finding, ...]:
    """Findings of a house's rules in a plate, and of its offers in the order; none asks what the order answers.

    Args:
        found: by :func:`maskfab.mask_shops.judge.check_shop`.
        spec: of the job.
        plate: laid out of it.
        drawn: the plate :func:`maskfab.mask_shops.adapt.fitted` for the shop.
        shop: whose rules they are.
        facts: of the plate, shared by houses.
    """
    touches = (None if spec.order is None else spec.order.corner_touches) or shop.order.default.corner_touches
    told = f"By the order they must {touches}"
    offers = (*check_offers(spec, plate, shop), *unpublished(spec, drawn, shop, facts or PlateFacts()))
    twice = {"glass"} if any(each.rule == "order_thickness" for each in offers) else set()
    known = (
        replace(each, cure=told) if each.rule == "corner_touches" and each.passed is None and touches else each
        for each in found
        if each.rule not in twice
    )
    return (*known, *offers)


def check_offers(spec: JobSpec, plate: Plate, shop: Shop) -> tuple[Finding, ...]:
    """Judge a job's [order] by what a house publishes that it offers; what either leaves out is not judged."""
    source = " ".join(shop.sources)
    return tuple(replace(each, source=source) for each in (*_choices(spec, shop), *_numbers(spec, plate, shop)))


def unpublished(spec: JobSpec, drawn: Plate, shop: Shop, facts: PlateFacts) -> tuple[Finding, ...]:
    """Rules without which nobody knows whether the house makes a plate, and on which it publishes nothing: to ask.

    These are the substrate and the film that the order names, the size of a blank for which there is no template, the
    smallest feature, and the format, which :func:`maskfab.mask_shops.judge.check_shop` asks for. Of all else a wrong
    guess spoils no plate: tone and parity are settled by the data as they are sent, and by words on the sheet; data
    that break a limit of the house's software are refused there in minutes; and what the order leaves to the house is
    the house's standard.
    """
    source = " ".join(shop.sources)
    asked = (*_unpublished_material(spec, shop), *_unpublished_sizes(drawn, shop, facts))
    return tuple(
        Finding(
            rule, None, value, None, unit, cure="The house publishes nothing on it", source=source, question=question
        )
        for rule, value, unit, question in asked
    )


def _unpublished_material(spec: JobSpec, shop: Shop) -> Iterator[tuple[str, str | float, str, str]]:
    """Rule, value, unit and question."""
    order, usual = spec.order, shop.order.default
    glass, film = (None if order is None else getattr(order, key) or getattr(usual, key) for key in ("glass", "film"))
    if glass is not None and shop.offers.glasses is None:
        thickness = ordered_blank(spec).glass_nm
        thick = "" if thickness is None else f" of {thickness / NM_PER_MM:g} mm"
        yield "order_glass", glass, "", f"Do you make masks on {glass}{thick}?"
    if film is not None and shop.offers.films is None:
        yield "order_film", film, "", f"Do you make masks of {film}?"


def _unpublished_sizes(drawn: Plate, shop: Shop, facts: PlateFacts) -> Iterator[tuple[str, str | float, str, str]]:
    """As :func:`_unpublished_material`."""
    sizes, side, room = shop.plate, drawn.blank_nm / NM_PER_MM, drawn.writable_nm / NM_PER_MM
    standard = any(plate_template(name).blank_nm == drawn.blank_nm for name in template_names())
    if not (standard or sizes.blanks_in or sizes.largest_mm or sizes.plot_area_mm or sizes.extent_mm):
        asked = f"Do you make plates of {side:g} x {side:g} mm, {room:g} x {room:g} mm of it written?"
        yield "blank", side, "mm", asked
    if shop.limits.min_feature_um is None:
        kinds = [each for each in facts.smallest_of(drawn) if not each.fine]
        least = min((each.least_um for each in kinds), default=0.0)
        told = "; ".join(f"{each.of}: {each}" for each in kinds)
        yield "min_feature", least, "um", f"Do you write the smallest features of this plate ({told})?"


def _choices(spec: JobSpec, shop: Shop) -> Iterator[Finding]:
    for key, offered in _CHOICES if spec.order is not None else ():
        wish, kinds = getattr(spec.order, key), getattr(shop.offers, offered)
        if wish is not None and kinds is not None:
            cure = "" if wish in kinds else f'Set order.{key} = "{kinds[0]}", or choose another house'
            yield Finding(f"order_{key}", wish in kinds, wish, ", ".join(kinds), cure=cure)
    if spec.order is not None and spec.order.bias == "house" and shop.offers.biased is not None:
        cure = "" if shop.offers.biased else 'Set order.bias = "none", or choose another house'
        yield Finding("order_bias", shop.offers.biased, "by the house", "not made", cure=cure)
    yield from _bias_twice(spec, shop)


def _bias_twice(spec: JobSpec, shop: Shop) -> Iterator[Finding]:
    """A bias of the job's process at a house that makes its bias good by itself: only one of them may."""
    if shop.order.default.bias != "house" or spec.process is None or not spec.process.cd_bias:
        return
    stated = None if spec.order is None else spec.order.bias
    if stated in (None, "data"):
        value = "in the data" if stated else "not said by whom"
        cure = 'Set order.bias = "house", or "none" for data as drawn; or choose another house'
        yield Finding("order_bias", False, value, "by the house, unless the order says otherwise", cure=cure)


def _numbers(spec: JobSpec, plate: Plate, shop: Shop) -> Iterator[Finding]:
    order, offers = spec.order, shop.offers
    if order is None:
        return
    if order.quantity is not None and offers.most is not None:
        yield _most("quantity", order.quantity, offers.most, "plates")
    if order.thickness is not None and shop.plate.glass_mm is not None:
        yield _between("thickness", order.thickness / UM_PER_MM, shop.plate.glass_mm, "mm")
    least = max(shop.limits.min_feature_um or 0, shop.limits.min_space_um or 0)
    if order.corner_width is not None and least:
        yield _least("corner_width", order.corner_width, least)
    if order.optical_density is not None and offers.densities is not None:
        yield _between("optical_density", order.optical_density, offers.densities, "")
    if order.registration is not None and offers.registration_um is not None:
        yield _least("registration", order.registration, offers.registration_um)
    if order.defects is not None and shop.tolerance.defect_um is not None:
        yield _least("defects", order.defects.size, min(shop.tolerance.defect_um))
    widths = [gauge.target_nm / NM_PER_UM for gauge in plate.gauges]
    if order.cd is not None and order.cd.feature is not None:
        widths = [gauge.target_nm / NM_PER_UM for gauge in plate.gauges if gauge.name == order.cd.feature]
        known = ", ".join(sorted(gauge.name for gauge in plate.gauges)) or "none"
        cure = "" if widths else f"The plate's CD structures are {known}"
        yield Finding("order_cd_feature", bool(widths), order.cd.feature, known, cure=cure)
    if order.cd is not None and order.cd.tolerance is not None and widths:
        promised = [deviation for width, deviation in shop.tolerance.cd_um if min(widths) <= width]
        if promised:
            yield _least("cd", order.cd.tolerance, promised[0])


def _least(key: str, wish: float, best_um: float) -> Finding:
    fits = wish >= best_um - 1e-9
    cure = "" if fits else f'Ask for "{best_um:g} um" or more in order.{key}, or choose another house'
    return Finding(f"order_{key}", fits, wish, best_um, "um", cure=cure)


def _most(key: str, wish: float, most: float, unit: str) -> Finding:
    fits = wish <= most
    return Finding(f"order_{key}", fits, wish, most, unit, cure="" if fits else f"Order at most {most:g}")


def _between(key: str, wish: float, limits: tuple[float, float], unit: str) -> Finding:
    fits = limits[0] - 1e-9 <= wish <= limits[1] + 1e-9
    limit = span_text(limits)
    cure = "" if fits else f"Set order.{key} to {limit} {unit}".rstrip() + ", or choose another house"
    return Finding(f"order_{key}", fits, wish, limit, unit, cure=cure)
