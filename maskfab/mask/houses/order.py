"""Orders to a mask house, key by key: who decided each, what the house offers, and answers to what is left blank.

JobSpec + Plate + Shop -> Order -> order sheet, drawing, certificate and manifest, which all say it in these words.
JobSpec + Plate + Shop -> OrderForm -> answers, each checked as it is given -> lines of the job file."""

from __future__ import annotations

import shutil
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from datetime import date
from pathlib import Path
from typing import Any, Literal, TypeAlias, get_args

from maskfab.base.errors import JobError, SourceError
from maskfab.base.files import partial
from maskfab.base.model import Plate
from maskfab.base.units import NM_PER_MM, NM_PER_UM, UM_PER_MM
from maskfab.job.faults import parse_section
from maskfab.job.order import ContactSection, Film, Glass, OrderSection, Protection, Touches
from maskfab.job.read import check_order, validate
from maskfab.job.read import read as read_spec
from maskfab.job.sections import JobSpec
from maskfab.job.shop import Shop
from maskfab.job.toml import inserted, loads
from maskfab.mask.houses.adaptation import fitted, ordered_blank
from maskfab.mask.houses.findings import Finding, PlateFacts, corner_touches, sourced, span_text
from maskfab.mask.marks import plate_template, template_names

Source: TypeAlias = Literal["job", "design", "house", "nobody"]

BLANK = "________________"
_CONTACT = {"name": "contact", "organisation": "organisation", "address": "address", "email": "e-mail",
            "telephone": "telephone"}  # fmt: skip
_NO_WISH = "the house's standard"


@dataclass(frozen=True)
class Answer:
    """One line of an order: its key in [order], such as ``contact.name``, and its text, :data:`BLANK` if unanswered."""

    key: str
    label: str
    text: str
    source: Source


@dataclass(frozen=True)
class Order:
    """An order, complete or with blanks.

    Attributes:
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
        return tuple(answer for answer in self.answers if answer.source == "nobody")


def order_of(spec: JobSpec, plate: Plate, shop: Shop, corner_touches: int = 0) -> Order:
    """The order that a job makes.

    Args:
        shop: whose defaults answer what the job leaves out.
        corner_touches: places at which clear dots meet by a corner alone, for which the house must know what to do.
    """
    stated = spec.order or OrderSection()
    # Reading of the data as they are sent, which the house keeps to.
    parity = (
        "right reading, chrome up: write the data as sent, do not mirror them. The F on the plate is mirrored in them"
        if stated.mirrored
        else "right reading, chrome up: write the data as sent. The F on the plate reads right on the chrome side"
    )
    return Order(
        shop.order.tone_words.get(spec.tone, f"digitized data = {spec.tone}"),
        parity,
        stated.mirrored,
        stated.date,
        tuple(_answers(spec, stated, plate, shop, corner_touches)),
    )


def _answers(spec: JobSpec, stated: OrderSection, plate: Plate, shop: Shop, touches: int) -> list[Answer]:
    usual, thickness_nm = shop.order.default, ordered_blank(spec).glass_nm
    by_design: Source = "design" if stated.thickness is None else "job"

    def wish(key: str, label: str, none: str | None = None, shown: Callable[[Any], str] = str) -> Answer:
        """The answer of the job, or else of the house, or else words for none; without those it is blank."""
        sources: tuple[tuple[OrderSection, Source], ...] = ((stated, "job"), (usual, "house"))
        for section, source in sources:
            value = getattr(section, key)
            if value is not None:
                return Answer(key, label, shown(value), source)
        return Answer(key, label, BLANK, "nobody") if none is None else Answer(key, label, none, "house")

    rows = [
        wish("revision", "revision", "none stated"),
        wish("date", "date of the order", "none stated"),
        wish("purchase_number", "purchase number", "none stated"),
        wish("quantity", "plates"),
        wish("glass", "glass"),
        Answer("thickness", "thickness of the glass", f"{thickness_nm / NM_PER_MM:g} mm", by_design)
        if thickness_nm is not None
        else wish("thickness", "thickness of the glass", shown=_length),
        wish("film", "film"),
        _density(spec, stated, usual),
        _cd(stated, usual, plate, published=bool(shop.tolerance.cd_um)),
        wish("registration", "registration", _NO_WISH, lambda value: f"within +-{_length(value)}"),
        _defects(stated, usual),
        _bias(spec, stated, usual),
        wish("protection", "pellicle or coat", "none"),
        *_touches(stated, usual, shop, touches),
        wish("delivery", "delivery", "by agreement"),
    ]
    contact = stated.contact or ContactSection()
    for key, label in _CONTACT.items():
        lacking: tuple[str, Source] = ("none stated", "design") if key == "telephone" else (BLANK, "nobody")
        text = getattr(contact, key)
        rows.append(Answer(f"contact.{key}", label, *(lacking if text is None else (text, "job"))))
    return rows


def _length(length_um: float) -> str:
    return f"{length_um / UM_PER_MM:g} mm" if length_um >= UM_PER_MM else f"{length_um:g} um"


def _density(spec: JobSpec, stated: OrderSection, usual: OrderSection) -> Answer:
    of_plate = None if spec.plate is None else spec.plate.optical_density
    if stated.optical_density is not None or of_plate is not None:
        return Answer("optical_density", "optical density", f"at least {stated.optical_density or of_plate:g}", "job")
    text = _NO_WISH if usual.optical_density is None else f"{usual.optical_density:g}"
    return Answer("optical_density", "optical density", text, "house")


def _cd(stated: OrderSection, usual: OrderSection, plate: Plate, *, published: bool) -> Answer:
    section = stated.cd or usual.cd
    smallest = min(plate.gauges, key=lambda gauge: gauge.target_nm, default=None)
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
    return Answer("cd", "CD", text + where, "house" if stated.cd is None else "job")


def _defects(stated: OrderSection, usual: OrderSection) -> Answer:
    section, text = stated.defects or usual.defects, _NO_WISH
    if section is not None:
        most = f"at most {section.density:g} a square centimetre" if section.density else "none"
        text = f"of {section.size:g} um or more: {most}"
    return Answer("defects", "defects", text, "house" if stated.defects is None else "job")


def _bias(spec: JobSpec, stated: OrderSection, usual: OrderSection) -> Answer:
    change = 0.0 if spec.process is None else spec.process.cd_bias_um
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
    places = f"clear shapes meet by a corner only in {touches} places"
    fate, width = (getattr(stated, key) or getattr(usual, key) for key in ("corner_touches", "corner_width"))
    source: Source = "house" if stated.corner_touches is None else "job"
    if fate is None and shop.polygons.corner_touches:
        return [Answer("corner_touches", label, f"{places}, which the house takes: {_NO_WISH}", "house")]
    if fate is None:
        return [
            Answer("corner_touches", label, f"{places}; join or stay apart: {BLANK}", "nobody"),
            _neck(None, width, shop),
        ]
    return [Answer("corner_touches", label, f"{places}: they must {fate}", source), _neck(fate, width, shop)]


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


_CHOICES = (("parity", "parities"), ("chrome", "chromes"), ("glass", "glasses"), ("film", "films"),
            ("protection", "protections"))  # fmt: skip


def check_ordered(
    findings: Sequence[Finding], spec: JobSpec, plate: Plate, drawn: Plate, shop: Shop, facts: PlateFacts | None = None
) -> tuple[Finding, ...]:
    """Findings of a house's rules in a plate, and of its offers in the order; none asks what the order answers."""
    touches = (None if spec.order is None else spec.order.corner_touches) or shop.order.default.corner_touches
    cure = f"By the order they must {touches}"
    offers = (*check_offers(spec, plate, shop), *unpublished(spec, drawn, shop, facts or PlateFacts()))
    twice = {"glass"} if any(offer.rule == "order_thickness" for offer in offers) else set()
    amended = (
        replace(finding, cure=cure)
        if finding.rule == "corner_touches" and finding.passed is None and touches
        else finding
        for finding in findings
        if finding.rule not in twice
    )
    return (*amended, *offers)


def check_offers(spec: JobSpec, plate: Plate, shop: Shop) -> tuple[Finding, ...]:
    """Judge a job's [order] by what a house publishes that it offers; what either leaves out is not judged."""
    return sourced((*_choices(spec, shop), *_numbers(spec, plate, shop)), shop)


def unpublished(spec: JobSpec, drawn: Plate, shop: Shop, facts: PlateFacts) -> tuple[Finding, ...]:
    """Rules without which nobody knows whether the house makes a plate, and on which it publishes nothing: to ask.

    These are the substrate and the film that the order names, the size of a blank for which there is no template, the
    smallest feature, and the format, which :func:`maskfab.mask.houses.findings.check_shop` asks for. Of all else a
    wrong guess spoils no plate: tone and parity are settled by the data as they are sent, and by words on the sheet;
    data that break a limit of the house's software are refused there in minutes; and what the order leaves to the house
    is the house's standard.
    """
    nothing = "The house publishes nothing on it"
    asked = (
        Finding(rule, None, value, None, unit, cure=nothing, question=question)
        for rule, value, unit, question in _open_questions(spec, drawn, shop, facts)
    )
    return sourced(asked, shop)


def _open_questions(
    spec: JobSpec, drawn: Plate, shop: Shop, facts: PlateFacts
) -> Iterator[tuple[str, str | float, str, str]]:
    order, usual = spec.order, shop.order.default
    glass, film = (None if order is None else getattr(order, key) or getattr(usual, key) for key in ("glass", "film"))
    if glass is not None and shop.offers.glasses is None:
        thickness = ordered_blank(spec).glass_nm
        thick = "" if thickness is None else f" of {thickness / NM_PER_MM:g} mm"
        yield "order_glass", glass, "", f"Do you make masks on {glass}{thick}?"
    if film is not None and shop.offers.films is None:
        yield "order_film", film, "", f"Do you make masks of {film}?"
    sizes, side, room = shop.plate, drawn.blank_nm / NM_PER_MM, drawn.writable_nm / NM_PER_MM
    standard = any(plate_template(name).blank_nm == drawn.blank_nm for name in template_names())
    if not (standard or sizes.blanks_in or sizes.largest_mm or sizes.plot_area_mm or sizes.extent_mm):
        asked = f"Do you make plates of {side:g} x {side:g} mm, {room:g} x {room:g} mm of it written?"
        yield "blank", side, "mm", asked
    if shop.limits.min_feature_um is None:
        kinds = [smallest for smallest in facts.smallest_of(drawn) if not smallest.fine]
        least = min((kind.least_um for kind in kinds), default=0.0)
        listed = "; ".join(f"{kind.of}: {kind}" for kind in kinds)
        yield "min_feature", least, "um", f"Do you write the smallest features of this plate ({listed})?"


def _choices(spec: JobSpec, shop: Shop) -> Iterator[Finding]:
    for key, offered in _CHOICES if spec.order is not None else ():
        wish, kinds = getattr(spec.order, key), getattr(shop.offers, offered)
        if wish is not None and kinds is not None:
            cure = f'Set order.{key} = "{kinds[0]}", or choose another house'
            yield Finding.judged(f"order_{key}", wish in kinds, wish, ", ".join(kinds), cure=cure)
    if spec.order is not None and spec.order.bias == "house" and shop.offers.biased is not None:
        cure = 'Set order.bias = "none", or choose another house'
        yield Finding.judged("order_bias", shop.offers.biased, "by the house", "not made", cure=cure)
    # Where a house makes its bias good by itself, the job's process may not have one too.
    stated = None if spec.order is None else spec.order.bias
    biased = shop.order.default.bias == "house" and spec.process is not None and spec.process.cd_bias_um
    if biased and stated in (None, "data"):
        value = "in the data" if stated else "not said by whom"
        cure = 'Set order.bias = "house", or "none" for data as drawn; or choose another house'
        yield Finding("order_bias", False, value, "by the house, unless the order says otherwise", cure=cure)


def _numbers(spec: JobSpec, plate: Plate, shop: Shop) -> Iterator[Finding]:
    order, offers = spec.order, shop.offers
    if order is None:
        return
    if order.quantity is not None and offers.most is not None:
        fits, cure = order.quantity <= offers.most, f"Order at most {offers.most:g}"
        yield Finding.judged("order_quantity", fits, order.quantity, offers.most, "plates", cure=cure)
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
        listed = ", ".join(sorted(gauge.name for gauge in plate.gauges)) or "none"
        cure = f"The plate's CD structures are {listed}"
        yield Finding.judged("order_cd_feature", bool(widths), order.cd.feature, listed, cure=cure)
    if order.cd is not None and order.cd.tolerance is not None and widths:
        promised = [deviation for width, deviation in shop.tolerance.cd_um if min(widths) <= width]
        if promised:
            yield _least("cd", order.cd.tolerance, promised[0])


def _least(key: str, wish: float, best_um: float) -> Finding:
    cure = f'Ask for "{best_um:g} um" or more in order.{key}, or choose another house'
    return Finding.judged(f"order_{key}", wish >= best_um - 1e-9, wish, best_um, "um", cure=cure)


def _between(key: str, wish: float, limits: tuple[float, float], unit: str) -> Finding:
    fits = limits[0] - 1e-9 <= wish <= limits[1] + 1e-9
    limit = span_text(limits)
    cure = f"Set order.{key} to {limit} {unit}".rstrip() + ", or choose another house"
    return Finding.judged(f"order_{key}", fits, wish, limit, unit, cure=cure)


_KINDS: Mapping[str, tuple[str, ...]] = {
    "glass": get_args(Glass),
    "film": get_args(Film),
    "protection": get_args(Protection),
    "corner_touches": get_args(Touches),
}
_HINTS: Mapping[str, str] = {
    "quantity": "a whole number",
    "thickness": 'a length such as "2.3 mm"',
    "corner_width": 'of the neck or the gap there, such as "2 um"',
    "contact.name": "whom the house asks",
    "contact.organisation": "firm or institute that pays",
    "contact.address": "to which the plate is sent, in one line",
    "contact.email": "address of mail",
}


@dataclass(frozen=True)
class Question:
    """A line of an order that nobody has answered, its key such as ``contact.name``; choices, empty for any."""

    key: str
    label: str
    choices: tuple[str, ...]
    hint: str

    def __str__(self) -> str:
        return f"{self.label} ({' | '.join(self.choices) or self.hint})"


@dataclass(frozen=True, eq=False)
class OrderForm:
    """An order as far as it is filled in for a house; ``touches``: clear shapes that meet by a corner only."""

    spec: JobSpec
    plate: Plate
    shop: Shop
    touches: int

    @classmethod
    def of(cls, spec: JobSpec, plate: Plate, shop: Shop) -> OrderForm:
        """The form of a job; its plate is drawn as a package would hold it, for corners that meet."""
        return cls(spec, plate, shop, corner_touches(fitted(plate, shop, spec.tone)))

    @property
    def order(self) -> Order:
        return order_of(self.spec, self.plate, self.shop, self.touches)

    @property
    def questions(self) -> tuple[Question, ...]:
        """Lines without an answer, in the order of the sheet."""
        return tuple(self._question(answer) for answer in self.order.missing)

    @property
    def refused(self) -> tuple[Finding, ...]:
        """Wishes that the house does not offer."""
        return tuple(offer for offer in check_offers(self.spec, self.plate, self.shop) if offer.passed is False)

    def _question(self, line: Answer) -> Question:
        glasses, films, protections = self.shop.offers.glasses, self.shop.offers.films, self.shop.offers.protections
        offered = {"glass": glasses, "film": films, "protection": protections}.get(line.key)
        hint, sides = _HINTS.get(line.key, ""), self.shop.plate.glass_mm
        if line.key == "thickness" and sides is not None:
            hint = f'"{sides[0]:g} mm" to "{sides[1]:g} mm"'
        label = line.label
        if line.key == "corner_touches":
            label = f"clear shapes meet by a corner only in {self.touches} places; they must"
        return Question(line.key, label, offered or _KINDS.get(line.key, ()), hint)

    def answered(self, key: str, text: str, where: str = "") -> OrderForm:
        """The form with one more line.

        Raises:
            JobError: MF102 to MF110 for an answer that no job may hold, MF105 for a key that has one, MF128 for one
                that contradicts the job or that the house does not offer.
        """
        stated = {} if self.spec.order is None else self.spec.order.model_dump(mode="json", exclude_none=True)
        section = _section_with(stated, key.split("."), text, where or f"order.{key}")
        spec = self.spec.model_copy(update={"order": section})
        check_order(spec, where or "the answer")
        form = OrderForm(spec, self.plate, self.shop, self.touches)
        rules = (f"order_{key.replace('.', '_')}", f"order_{key.partition('.')[0]}")
        for refusal in form.refused:
            if refusal.rule in rules:
                what = f"{self.shop.name} offers {refusal.limit} {refusal.unit}".rstrip() + f", not {refusal.value}"
                raise JobError("MF128", what, where=where, cure=refusal.cure)
        if key == "tone" and section.tone not in self.shop.order.tones:
            tones = " and ".join(self.shop.order.tones)
            raise JobError("MF128", f"{self.shop.name} writes data that are {tones}", where=where, cure=f"Set {tones}")
        return form


def _section_with(stated: Mapping[str, Any], path: list[str], text: str, where: str) -> OrderSection:
    """[order] with one more value: the text itself, or the number that it writes where a number is meant."""
    values: dict[str, Any] = {key: dict(value) if isinstance(value, dict) else value for key, value in stated.items()}
    table: Any = values
    for name in path[:-1]:
        table = table.setdefault(name, {})
        if not isinstance(table, dict):
            raise JobError("MF105", f"order.{path[0]} has no parts", where=where, cure=f"Set {path[0]} itself")
    if path[-1] in table:
        what = f"order.{'.'.join(path)} is stated already: {table[path[-1]]}"
        raise JobError("MF105", what, where=where, cure="Change it in the job itself")
    meanings: list[str | int | float] = [text]
    for kind in (int, float):
        with suppress(ValueError):
            meanings.append(kind(text))
    problems = []
    for value in meanings:
        table[path[-1]] = value
        try:
            return parse_section(OrderSection, values, where=where)
        except JobError as error:
            problems.append(error)
    # A number out of its range is a number; else what is wrong is wrong with the text.
    raise next((problem for problem in problems if problem.code == "MF104"), problems[0])


def write_answers(path: Path, answers: Mapping[str, str], form: OrderForm, shop: str, day: date) -> tuple[str, ...]:
    """Put answers into a job file, and the day and the house where the job names none; nothing else in it changes.

    Args:
        answers: to keys of [order], as they were typed; the form has them already.

    Returns:
        The keys that were written, with their tables.

    Raises:
        SourceError: MF308 for a job that is no TOML file.
    """
    if path.suffix != ".toml":
        raise SourceError("MF308", f"{path} is no TOML file, into which lines can be put", cure="Name a job in TOML")
    said = (form.spec.order or OrderSection()).model_dump(mode="json", exclude_none=True)
    values: dict[str, object] = {
        f"order.{key}": _as_written(said, key.split("."), text) for key, text in answers.items()
    }
    if "date" not in said:
        values["order.date"] = day
    spec = read_spec(path)
    if spec.export is None or spec.export.shop is None:
        values["export.shop"] = shop
    longer = path.read_bytes().decode("utf-8")
    for key, value in values.items():
        longer = inserted(longer, key, value, where=str(path))
    validate(loads(longer.removeprefix("\ufeff")), where=str(path))
    with partial(path) as aside:
        aside.write_bytes(longer.encode())
        shutil.copymode(path, aside)
    return tuple(values)


def _as_written(said: Any, path: list[str], text: str) -> str | int | float:
    for name in path:
        said = said[name]
    return text.strip() if isinstance(said, str) else said
