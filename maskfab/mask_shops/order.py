"""An order to a mask house, key by key, and who decided each: the job, its design, or the house.

JobSpec + Plate + Shop -> Order -> order sheet, drawing, certificate and manifest, which all say it in these words.
"""

from __future__ import annotations

from dataclasses import dataclass
from datetime import date
from typing import Literal, TypeAlias

from maskfab.jobfile import JobSpec
from maskfab.jobfile.order import CdSection, ContactSection, DefectsSection, OrderSection, Touches
from maskfab.jobfile.shop_profile import Shop
from maskfab.mask_shops.adapt import ordered_blank
from maskfab.model import Plate
from maskfab.units import NM_PER_MM, UM_PER_MM

Source: TypeAlias = Literal["job", "design", "house", "nobody"]

BLANK = "________________"
_CONTACT = {
    "name": "contact",
    "organisation": "organisation",
    "address": "address",
    "email": "e-mail",
    "telephone": "telephone",
}
_NO_WISH = "the house's standard"


@dataclass(frozen=True)
class Answer:
    """One line of an order.

    Attributes:
        key: of [order], such as ``contact.name``.
        label: for people.
        text: the answer; :data:`BLANK` where nobody has given one.
        source: who gave it.
    """

    key: str
    label: str
    text: str
    source: Source


@dataclass(frozen=True)
class Order:
    """An order, complete or with blanks.

    Attributes:
        tone: of the data, in the words of the house's form.
        parity: reading of the data as they are sent.
        mirrored: whether those data are the mirror image of the design, which reads right through the glass.
        day: of the order; None if the job states none.
        answers: everything else, in the order of the sheet.
    """

    tone: str
    parity: str
    mirrored: bool
    day: date | None
    answers: tuple[Answer, ...]

    @property
    def missing(self) -> tuple[Answer, ...]:
        """Lines that nobody has answered, and that no house can do without."""
        return tuple(each for each in self.answers if each.source == "nobody")


def order_of(spec: JobSpec, plate: Plate, shop: Shop, corner_touches: int = 0) -> Order:
    """The order that a job makes.

    Args:
        spec: of the job.
        plate: laid out of it.
        shop: whose defaults answer what the job leaves out.
        corner_touches: places at which clear dots meet by a corner alone, for which the house must know what to do.
    """
    stated = spec.order or OrderSection()
    return Order(
        shop.order.tone_words.get(spec.tone, f"digitized data = {spec.tone}"),
        _parity(stated),
        stated.mirrored,
        stated.date,
        tuple(_answers(spec, stated, plate, shop, corner_touches)),
    )


def _parity(stated: OrderSection) -> str:
    """Reading of the data as they are sent, which the house keeps to."""
    if not stated.mirrored:
        return "right reading, chrome up: write the data as sent. The F on the plate reads right on the chrome side"
    return (
        "right reading, chrome up: write the data as sent, do not mirror them. The F on the plate is mirrored in them"
    )


def _answers(spec: JobSpec, stated: OrderSection, plate: Plate, shop: Shop, touches: int) -> list[Answer]:
    usual, wish = shop.order.default, _Wishes(stated, shop.order.default)
    blank = ordered_blank(spec)
    thickness = blank.glass_nm
    by_design: Source = "design" if stated.thickness is None else "job"
    rows = [
        wish.text("revision", "revision", "none stated"),
        wish.text("date", "date of the order", "none stated"),
        wish.text("purchase_number", "purchase number", "none stated"),
        wish.text("quantity", "plates"),
        wish.text("glass", "glass"),
        Answer("thickness", "thickness of the glass", f"{thickness / NM_PER_MM:g} mm", by_design)
        if thickness is not None
        else wish.length("thickness", "thickness of the glass"),
        wish.text("film", "film"),
        _density(spec, stated, usual),
        Answer("cd", "CD", *_cd(stated.cd, usual.cd, plate, published=bool(shop.tolerance.cd_um))),
        wish.length("registration", "registration", _NO_WISH, "within +-"),
        Answer("defects", "defects", *_defects(stated.defects, usual.defects)),
        _bias(spec, stated, usual),
        wish.text("protection", "pellicle or coat", "none"),
        *_touches(stated, usual, shop, touches),
        wish.text("delivery", "delivery", "by agreement"),
    ]
    contact = stated.contact or ContactSection()
    for key, label in _CONTACT.items():
        said = getattr(contact, key)
        if said is not None:
            rows.append(Answer(f"contact.{key}", label, said, "job"))
        elif key == "telephone":
            rows.append(Answer("contact.telephone", label, "none stated", "design"))
        else:
            rows.append(Answer(f"contact.{key}", label, BLANK, "nobody"))
    return rows


@dataclass(frozen=True)
class _Wishes:
    """Answers of the job, or else of the house, or else words for none; without those they are blanks."""

    stated: OrderSection
    usual: OrderSection

    def text(self, key: str, label: str, none: str | None = None) -> Answer:
        sources: tuple[tuple[OrderSection, Source], ...] = ((self.stated, "job"), (self.usual, "house"))
        for section, source in sources:
            said = getattr(section, key)
            if said is not None:
                return Answer(key, label, str(said), source)
        return Answer(key, label, BLANK, "nobody") if none is None else Answer(key, label, none, "house")

    def length(self, key: str, label: str, none: str | None = None, before: str = "") -> Answer:
        found = self.text(key, label, none)
        if found.source == "nobody" or found.text == none:
            return found
        value = float(found.text)
        shown = f"{value / UM_PER_MM:g} mm" if value >= UM_PER_MM else f"{value:g} um"
        return Answer(key, label, before + shown, found.source)


def _density(spec: JobSpec, stated: OrderSection, usual: OrderSection) -> Answer:
    of_plate = None if spec.plate is None else spec.plate.optical_density
    label = "optical density"
    if stated.optical_density is not None or of_plate is not None:
        return Answer("optical_density", label, f"at least {stated.optical_density or of_plate:g}", "job")
    if usual.optical_density is not None:
        return Answer("optical_density", label, f"{usual.optical_density:g}", "house")
    return Answer("optical_density", label, _NO_WISH, "house")


def _cd(stated: CdSection | None, usual: CdSection | None, plate: Plate, *, published: bool) -> tuple[str, Source]:
    section = stated or usual
    smallest = min(plate.gauges, key=lambda each: each.target_nm, default=None)
    if section is None or (section.tolerance is None and section.mean_to_target is None):
        text = "within the tolerance that the house publishes" if published else _NO_WISH
    else:
        parts = [
            f"every width within +-{section.tolerance:g} um" if section.tolerance is not None else "",
            f"mean within +-{section.mean_to_target:g} um of target" if section.mean_to_target is not None else "",
        ]
        text = ", ".join(filter(None, parts))
    feature = None if section is None else section.feature
    measured = feature or (None if smallest is None else smallest.name)
    where = f", measured on {measured}" if measured is not None else ""
    return text + where, "house" if stated is None else "job"


def _defects(stated: DefectsSection | None, usual: DefectsSection | None) -> tuple[str, Source]:
    section = stated or usual
    if section is None:
        return _NO_WISH, "house"
    most = f"at most {section.density:g} a square centimetre" if section.density else "none"
    return f"of {section.size:g} um or more: {most}", "house" if stated is None else "job"


def _bias(spec: JobSpec, stated: OrderSection, usual: OrderSection) -> Answer:
    change = 0.0 if spec.process is None else spec.process.cd_bias
    source: Source = "job" if stated.bias is not None or change else "design"
    if stated.bias == "house":
        text = f"to be made good by the house: clear widths come out {change:+g} um, and should as drawn"
    elif stated.bias == "data":
        text = (
            f"none: the data are already biased by {-change:+g} um per clear width; do not bias. Clear widths are "
            f"expected to come out {change:+g} um from the data, which is as designed"
        )
    elif stated.bias is None and not change and usual.bias == "house":
        text, source = "the house's own, made good by the house: clear widths should come out as drawn", "house"
    elif change:
        text = f"none: data as drawn; clear widths are expected to come out {change:+g} um"
    else:
        text = "none: data as drawn"
    return Answer("bias", "bias", text, source)


def _touches(stated: OrderSection, usual: OrderSection, shop: Shop, touches: int) -> list[Answer]:
    """Corners that meet, and the width of the neck or the gap there: no writer makes one of no width."""
    label = "corners that meet"
    if not touches:
        return [Answer("corner_touches", label, "none", "design")]
    told = f"clear shapes meet by a corner only in {touches} places"
    fate, width = (getattr(stated, key) or getattr(usual, key) for key in ("corner_touches", "corner_width"))
    source: Source = "house" if stated.corner_touches is None else "job"
    if fate is None and shop.polygons.corner_touches:
        return [Answer("corner_touches", label, f"{told}, which the house takes: {_NO_WISH}", "house")]
    if fate is None:
        return [
            Answer("corner_touches", label, f"{told}; join or stay apart: {BLANK}", "nobody"),
            _neck(None, width, shop),
        ]
    return [Answer("corner_touches", label, f"{told}: they must {fate}", source), _neck(fate, width, shop)]


def _neck(fate: Touches | None, width_um: float | None, shop: Shop) -> Answer:
    """The line of the width at corners that meet; without one a blank, with what the house writes as a proposal."""
    shapes: dict[Touches | None, tuple[str, float | None]] = {
        "join": ("a clear neck", shop.limits.min_feature_um),
        "stay apart": ("a gap of chrome", shop.limits.min_space_um or shop.limits.min_feature_um),
    }
    shape, least = shapes.get(fate, ("a neck or a gap", shop.limits.min_feature_um))
    if width_um is not None:
        return Answer("corner_width", "width at those corners", f"{shape} of {width_um:g} um", "job")
    proposed = f" (proposed: {least:g} um, the least that the house publishes)" if least is not None else ""
    return Answer("corner_width", "width at those corners", f"{shape} of {BLANK} um{proposed}", "nobody")
