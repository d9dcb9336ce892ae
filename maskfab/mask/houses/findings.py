"""Check of a plate against the published rules of a mask house: for each rule its value, limit, place and cure.

What a package would send is judged by :func:`check_shop`, what a job writes by :func:`check_written`.
"""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from itertools import chain
from typing import Any, Literal, TypeAlias, TypeVar

from klayout import db

from maskfab.base.errors import OutputError
from maskfab.base.model import CLEAR, NOTE, Box, Die, Layer, Plate, Quantity
from maskfab.base.units import NM_PER_MM, NM_PER_UM, UM_PER_INCH, UM_PER_MM
from maskfab.job.order import Tone as DataTone
from maskfab.job.shop import Shop
from maskfab.job.values import SHOP_FORMATS, FileFormat, ShopFormat
from maskfab.mask.design_rules import DesignRules, RuleResult, flat_results, merged
from maskfab.mask.figures import Figures, PolygonOptions, draw
from maskfab.mask.formats import table
from maskfab.mask.houses import adaptation
from maskfab.mask.houses.adaptation import Blank, drawing_options, drawing_style, extent_nm, kept_grid_nm, written_box
from maskfab.mask.layout import drawn_region, plate_layout, plate_names, region
from maskfab.mask.marks import PlateTemplate, plate_template, template_names
from maskfab.mask.panel_rules import Narrowest, Tone, narrowest
from maskfab.mask.plate_rules import FINE_ON_PURPOSE, Smallest, check_plate, dies_apart, smallest_of_plate
from maskfab.mask.writer import biased_data

_BLANK_TOLERANCE_NM = 500_000
_KISSING = DesignRules(no_corner_touch=True)
_LEVELS = 3
"""Plate, die, unit cell: references are never nested deeper."""
_UNBIASED = 'Set order.bias = "house" or "none", or use coarser dots, whose biased data keep the rule'
_PACKAGE = "send what maskfab order pack makes for the house"


@dataclass(frozen=True)
class Finding:
    """One rule of a house on one plate.

    Attributes:
        rule: format, tone, drawing_unit, text, text_charset, text_style, text_layer, one_mask_per_layer, blank, chrome,
            glass, plot_area, extent, coordinates, min_feature, min_space, grid, vertices, references, depth, layers,
            layer_number, biased_format, unwritten_layers, flashes, drawing, name, layer_name, block_name,
            block_transforms, self_crossing, self_touching, doubled_vertices, shared_boundaries or corner_touches.
        passed: whether the plate keeps it; None where the house decides, or publishes nothing to judge by.
        place: where it is broken first, in words.
        cure: what to do about it; empty where nothing needs to be done.
        question: to the house, where it has to be asked before anybody knows whether it takes the plate; else empty.
    """

    rule: str
    passed: bool | None
    value: float | int | str
    limit: float | int | str | None
    unit: str = ""
    place: str = ""
    cure: str = ""
    source: str = ""
    question: str = ""

    @classmethod
    def judged(
        cls,
        rule: str,
        kept: bool,
        value: float | str,
        limit: float | str,
        unit: str = "",
        place: str = "",
        cure: str = "",
    ) -> Finding:
        """A rule that is kept or broken; place and cure are told where it is broken alone."""
        return cls(rule, kept, value, limit, unit, "" if kept else place, "" if kept else cure)

    @property
    def value_text(self) -> str:
        """Value and limit alone, without place and cure."""
        limit = "" if self.limit is None else f", {_shown(self.limit)} {self.unit}".rstrip() + " taken"
        return f"{self.rule}: {_shown(self.value)} {self.unit}".rstrip() + limit

    def quantity(self, shop: str) -> Quantity:
        """The finding as a row of a report; the house by its name, whose pages would fill a table."""
        published = f"A rule of {shop}, whose pages `maskfab order list {shop}` names"
        method = ". ".join(
            text for text in (self.place and f"at {self.place}", self.cure, self.question, published) if text
        )
        return Quantity(f"shop_{self.rule}", self.value, method, detail=self.unit, limit=self.limit, passed=self.passed)

    def __str__(self) -> str:
        verdict = {True: "PASS", False: "REFUSED", None: "ASK" if self.question else "note"}[self.passed]
        place = f" at {self.place}" if self.place else ""
        return ". ".join(text for text in (f"{verdict} {self.value_text}{place}", self.cure, self.question) if text)


Fact = TypeVar("Fact")


@dataclass(frozen=True)
class PlateFacts:
    """Facts of one plate that every house's rules ask for, each found once, however many houses there are.

    Dies are told apart by name, for what a house is sent differs only in what is not written; marks and their grid, and
    the options of drawing, are those of most houses too.
    """

    facts: dict[tuple[object, ...], Any] = field(default_factory=dict)

    def _once(self, find: Callable[[], Fact], *key: object) -> Fact:
        if key not in self.facts:
            self.facts[key] = find()
        fact: Fact = self.facts[key]
        return fact

    def smallest_of(self, plate: Plate) -> tuple[Smallest, ...]:
        """As :func:`maskfab.mask.plate_rules.smallest_of_plate`."""
        return self._once(lambda: smallest_of_plate(plate, self.narrowest), "smallest", plate.marks)

    def narrowest(self, die: Die, tone: Tone, *, placed: bool = False) -> Narrowest:
        """As :func:`maskfab.mask.panel_rules.narrowest`."""
        return self._once(lambda: narrowest(die, tone, placed=placed), "narrowest", die.name, tone, placed)

    def design(self, plate: Plate) -> db.Layout:
        """As :func:`maskfab.mask.layout.plate_layout`."""
        return self._once(lambda: plate_layout(plate), "design", plate.marks, plate.snapped)

    def drawn(self, plate: Plate, options: PolygonOptions) -> Figures:
        """As :func:`maskfab.mask.figures.draw`."""
        return self._once(lambda: draw(plate, options), "drawn", plate.marks, plate.snapped, options)

    def touching(self, plate: Plate) -> list[RuleResult]:
        """Where clear shapes meet by a corner only, die by die and then on the marks."""
        rules = _KISSING
        if not dies_apart(plate, rules.reach_nm):
            return list(check_plate(plate, rules))

        def on_die(die: Die) -> list[RuleResult]:
            alone = check_plate(replace(plate, dies=(die,), marks=()), rules)
            return [result for result in alone if result.die is not None]

        on_dies = [self._once(partial(on_die, die), "touching", die.name) for die in plate.dies]
        on_marks = self._once(lambda: check_plate(replace(plate, dies=()), rules), "touching", plate.marks)
        return [*chain.from_iterable(on_dies), *on_marks]


Taken: TypeAlias = Literal["takes it", "ask first", "does not"]


def accepted(findings: Sequence[Finding]) -> bool:
    """Whether no rule is broken."""
    return all(finding.passed is not False for finding in findings)


def answer_of(findings: Sequence[Finding]) -> Taken:
    """Whether a house takes a plate, as far as it publishes what it takes."""
    if not accepted(findings):
        return "does not"
    return "ask first" if any(finding.question for finding in findings) else "takes it"


def mail_of(plate: str, findings: Sequence[Finding]) -> str:
    """The questions to a house as one text to paste into a mail; empty where there are none."""
    asked = [finding.question for finding in findings if finding.question]
    if not asked:
        return ""
    numbered = [f"{number}. {question}" for number, question in enumerate(asked, 1)]
    opening = (
        f"We would like to order the photomask {plate} from you. Your pages leave open what follows; please tell us:"
    )
    return "\n".join([opening, *numbered])


def check_shop(
    drawn: Plate,
    shop: Shop,
    formats: Sequence[ShopFormat] = (),
    options: PolygonOptions | None = None,
    blank: Blank | None = None,
    *,
    facts: PlateFacts | None = None,
) -> tuple[Finding, ...]:
    """Judge what a package of a plate would hold by every rule that a house publishes; nothing is written.

    Args:
        drawn: the plate, with all its layers, :func:`maskfab.mask.houses.adaptation.fitted` for the house; only what is
            written is looked at.
        formats: what is to be sent; the house's first format if empty.
        options: how polygons are drawn; None chooses as a package does.
        blank: what the job says of chrome and glass; None leaves them to the order.
        facts: of this plate, shared by the houses that it is judged by: then places of a die that are too narrow are
            not counted, which takes longest. None counts them.
    """
    sent = tuple(formats) or shop.formats[:1]
    names = plate_names(drawn)
    cells = {names.top, *names.dies, *names.marks, *names.units.values()}
    drawn_by = options or drawing_options(drawn, shop)
    figures, refusal = _drawn(drawn, shop, drawn_by, facts or PlateFacts())
    layers = [drawn_by.layer] if figures is None else [layer for layer in figures.layers if layer.written]
    findings = (
        *_of_files(shop, drawn, sent, drawn_by.tone, noted=False),
        *_of_plate(drawn, shop),
        *_of_blank(blank or Blank(None, None), shop),
        *_of_features(drawn, shop, facts, figures),
        *(refusal if figures is None else _of_figures(figures, shop, layers, facts)),
        *_of_names(drawn.name, sorted(cells), [*layers, *_texted(drawn, shop, sent)], shop),
    )
    return sourced(findings, shop)


def check_written(
    figures: Figures, shop: Shop, formats: Sequence[FileFormat], blank: Blank | None = None
) -> tuple[Finding, ...]:
    """Judge the layouts that a job writes by every rule that a house publishes, with all that is in them.

    Args:
        formats: of the files; those that no house is sent, SVG, solids and pictures, are not looked at.
    """
    sent, plate = tuple(form for form in SHOP_FORMATS if form in formats), figures.plate
    layers = [*figures.layers, *([NOTE] if figures.notes and NOTE not in figures.layers else [])]
    cells = [figures.top]
    if figures.options.hierarchy == "cells":
        below = {*figures.cells, *(die.name for die in figures.dies), *(mark.name for mark in figures.marks)}
        cells += sorted(below)
    texted = [layer for layer in _texted(plate, shop, sent) if layer not in layers]
    unwritten, others = [], [layer.name for layer in layers if not layer.written]
    if others:
        cure = f"Order {CLEAR.name} {CLEAR.number}/{CLEAR.datatype} alone, or {_PACKAGE}, which has no other layer"
        unwritten = [Finding("unwritten_layers", None, " ".join(others), None, cure=cure)]
    findings = (
        *_of_files(shop, plate, sent, figures.options.tone, noted=bool(figures.notes)),
        *_of_plate(plate, shop, _reach(plate)),
        *_of_blank(blank or Blank(None, None), shop),
        *_of_features(plate, shop, None, figures),
        *_of_figures(figures, shop, layers),
        *unwritten,
        *_of_names(plate.name, cells, [*layers, *texted], shop),
    )
    return sourced((_as_written(finding, shop) for finding in findings), shop)


def _texted(plate: Plate, shop: Shop, sent: Sequence[ShopFormat]) -> list[Layer]:
    return [NOTE] if _unit_texts(plate, shop, sent) else []


def _unit_texts(plate: Plate, shop: Shop, sent: Sequence[ShopFormat]) -> list[ShopFormat]:
    versions = drawing_style(plate, shop).unit_text
    return [form for form in sent if form.startswith("dxf") and form.removeprefix("dxf_").upper() in versions]


def sourced(findings: Iterable[Finding], shop: Shop) -> tuple[Finding, ...]:
    """The findings with the pages on which the house publishes its rules."""
    source = " ".join(shop.sources)
    return tuple(replace(finding, source=source) for finding in findings)


def _as_written(finding: Finding, shop: Shop) -> Finding:
    """The finding with the cure of what a job cannot write and a package can."""
    if finding.passed is not False:
        return finding
    listed = " ".join(shop.formats)
    cures = {
        "format": f"Keep to {listed} in formats, or leave it out; or {_PACKAGE}",
        "extent": f"{_PACKAGE.capitalize()}, which adds marks for the corners, with dies that leave room for them",
        "layers": f"{_PACKAGE.capitalize()}, which has what is written alone",
    }
    if shop.polygons.holes == "layer":
        cures["shared_boundaries"] = f"{finding.cure}; or {_PACKAGE}, which gives holes a layer of their own"
    return replace(finding, cure=cures.get(finding.rule, finding.cure))


def _of_files(
    shop: Shop, plate: Plate, sent: Sequence[ShopFormat], tone: DataTone, *, noted: bool
) -> Iterator[Finding]:
    formats = shop.accepts.formats
    for form in sent:
        if formats is None:
            ruled = shop.accepts.ruled
            if form in ruled:
                yield Finding("format", True, form, f"{' '.join(ruled)}, of which its rules speak,")
                continue
            about = "" if not ruled else f", and its rules speak of {' '.join(ruled)}"
            cure = f"The house publishes no list of formats{about}"
            question = f"Do you take {table.FORMATS[form].title} files? If not, which formats do you take?"
            yield Finding("format", None, form, None, cure=cure, question=question)
        else:
            yield Finding.judged("format", form in formats, form, " ".join(formats), cure=f"Send {formats[0]}")
    tones, words = shop.order.tones, " ".join(shop.order.tones)
    cure = f'Set tone = "{tones[0]}" in [order], or choose another house'
    yield Finding.judged("tone", tone in tones, tone, words, cure=cure)
    if shop.accepts.drawing_unit is not None and any(name.startswith("dxf") for name in sent):
        unit = shop.accepts.drawing_unit  # drawings are made in it
        yield Finding("drawing_unit", True, unit, unit)
    if shop.accepts.one_mask_per_layer is not None:
        yield Finding("one_mask_per_layer", True, 1, 1, "masks on a layer")
    yield from _of_texts(shop, plate, sent, noted=noted)


def _of_texts(shop: Shop, plate: Plate, sent: Sequence[ShopFormat], *, noted: bool) -> Iterator[Finding]:
    lines = _unit_texts(plate, shop, sent)
    texted = [form for form in sent if form in lines or (noted and table.FORMATS[form].notes)]
    rules, formats = shop.text, shop.accepts.formats
    if rules.allowed_in is not None:
        lettered = [form for form in texted if form not in rules.allowed_in]
        untexted = [form for form in formats or () if form not in texted]
        has = f"{'notes' if noted else 'one line'} in {' '.join(texted)}" if texted else "none"
        taken = f"in {' '.join(rules.allowed_in)}" if rules.allowed_in else "none"
        cure = f"Send {untexted[0] if untexted else 'another format'}, in which all text is polygons"
        yield Finding.judged("text", not lettered, has, taken, cure=cure)
    if rules.charset is not None:
        strange = next((note.text for note in plate.notes if not note.text.isascii()), None) if noted else None
        cure = "Rename what has such letters"
        yield Finding.judged("text_charset", strange is None, strange or "ascii", rules.charset, cure=cure)
    if rules.italic is False:
        yield Finding("text_style", True, "upright", "upright")
    if rules.separate_layer:
        yield Finding("text_layer", True, NOTE.name if texted else "no text", "a layer of its own")


def _reach(plate: Plate) -> Box:
    visible = tuple(replace(mark, layer=CLEAR) for mark in plate.marks)
    return written_box(replace(plate, marks=visible))


def _of_plate(plate: Plate, shop: Shop, spanned: Box | None = None) -> Iterator[Finding]:
    """``spanned`` is the box of everything in the files; what is written by default."""
    sizes, blank_mm = shop.plate, plate.blank_nm / NM_PER_MM
    if sizes.blanks_in is not None:
        sides_nm = [inches * 25_400_000 for inches in sizes.blanks_in]
        fits = any(abs(plate.blank_nm - side) <= _BLANK_TOLERANCE_NM for side in sides_nm)
        offered = " ".join(f"{inches * UM_PER_INCH / UM_PER_MM:g}" for inches in sizes.blanks_in)
        cure = _by_template(
            lambda template: any(abs(template.blank_nm - side) <= _BLANK_TOLERANCE_NM for side in sides_nm),
            f'set plate.blank to "{sizes.blanks_in[0]:g} in" where the plate has no template',
        )
        yield Finding.judged("blank", fits, blank_mm, offered, "mm", cure=cure)
    if sizes.largest_mm is not None:
        largest = min(sizes.largest_mm)
        without = f'set plate.blank to at most "{largest:g} mm" where the plate has no template'
        cure = _by_template(lambda template: template.blank_nm <= largest * NM_PER_MM, without)
        yield Finding.judged("blank", blank_mm <= largest, blank_mm, _by(sizes.largest_mm), "mm", cure=cure)
    x0, y0, x1, y1 = written_box(plate)
    if sizes.plot_area_mm is not None:
        area = sizes.plot_area_mm
        reach = 2 * max(-x0, x1) / NM_PER_MM, 2 * max(-y0, y1) / NM_PER_MM
        fits = reach[0] <= area[0] and reach[1] <= area[1]
        without = f'set plate.writable to at most "{min(area):g} mm" without one, or use fewer dies'
        cure = _by_template(lambda template: template.writable_nm <= min(area) * NM_PER_MM, without)
        yield Finding.judged("plot_area", fits, _by(reach), _by(area), "mm", _spanned((x0, y0, x1, y1)), cure)
    asked = extent_nm(shop)
    if asked is not None:
        yield extent(spanned or (x0, y0, x1, y1), asked)
    if shop.limits.max_coordinate_mm is not None:
        farthest = max(abs(x0), abs(y0), abs(x1), abs(y1)) / NM_PER_MM
        most = shop.limits.max_coordinate_mm
        yield Finding.judged("coordinates", farthest <= most, farthest, most, "mm", cure="Use a smaller plate")


def extent(box_nm: Box, asked_nm: tuple[int, int]) -> Finding:
    """Whether a box, of a plate or of everything in a file, is what a drawing must span, centred on the plate."""
    x0, y0, x1, y1 = box_nm
    fits = (x1 - x0, y1 - y0) == asked_nm and (x0, y0) == (-asked_nm[0] // 2, -asked_nm[1] // 2)
    cure = "Use smaller or fewer dies: marks for the corners are added by the package"
    width, height = (x1 - x0) / NM_PER_MM, (y1 - y0) / NM_PER_MM
    limit = _by((asked_nm[0] / NM_PER_MM, asked_nm[1] / NM_PER_MM))
    return Finding.judged("extent", fits, _by((width, height)), limit, "mm", _spanned(box_nm), cure)


def _by_template(fits: Callable[[PlateTemplate], bool], otherwise: str) -> str:
    """A cure: one of the templates that fit, or what to do without one."""
    named = [f'"{name}"' for name in template_names() if fits(plate_template(name))]
    cure = f"set plate.template to {' or '.join(named)}, or {otherwise}" if named else otherwise
    return cure[0].upper() + cure[1:]


def _of_blank(blank: Blank, shop: Shop) -> Iterator[Finding]:
    chrome, glass = shop.plate.chrome_nm, shop.plate.glass_mm
    if chrome is not None:
        cure = f'Set export.chrome to between "{chrome[0]:g} nm" and "{chrome[1]:g} nm"'
        yield _within("chrome", blank.chrome_nm, chrome, "nm", cure)
    if glass is not None:
        thickness = None if blank.glass_nm is None else blank.glass_nm / NM_PER_MM
        without = f"set order.thickness to {span_text(glass)} mm, if the plate may be of such glass"
        cure = _by_template(lambda template: glass[0] <= template.thickness / 1000 <= glass[1], without)
        yield _within("glass", thickness, glass, "mm", cure)


def span_text(limits: tuple[float, float]) -> str:
    """Least and most, or the one number that both are."""
    least, most = limits
    return f"{least:g}" if least == most else f"{least:g} to {most:g}"


def _within(rule: str, value: float | None, limits: tuple[float, float], unit: str, cure: str) -> Finding:
    limit = span_text(limits)
    if value is None:
        return Finding(rule, None, "not stated by the job", f"{limit} {unit}", cure="State it in the order")
    return Finding.judged(rule, limits[0] - 1e-9 <= value <= limits[1] + 1e-9, value, limit, unit, cure=cure)


def _of_features(
    plate: Plate, shop: Shop, facts: PlateFacts | None = None, figures: Figures | None = None
) -> Iterator[Finding]:
    """Widths, spaces and grid: of the plate, or of the figures where they are biased data."""
    limits = shop.limits
    biased = figures is not None and figures.options.bias_nm is not None
    coarse = None
    if figures is not None and biased:
        fine = (mark for mark in figures.plate.marks if mark.kind in FINE_ON_PURPOSE and mark.layer.written)
        coarse = _biased_clear(figures) - drawn_region(polygon for mark in fine for polygon in mark.polygons)
    least = limits.min_feature_um
    apart = limits.min_space_um if limits.min_space_um is not None else least
    wanted: tuple[tuple[str, Tone, float | None], ...] = (
        ("min_feature", "clear", least),
        ("min_space", "opaque", apart),
    )
    for rule, tone, least_um in wanted:
        if least_um is None:
            continue
        clear = tone == "clear"
        least_nm = round(least_um * NM_PER_UM)
        width, space = (least_nm, None) if clear else (None, least_nm)
        rules = DesignRules(min_width_nm=width, min_space_nm=space, kissing=False)
        worst = _worst(plate, rules, tone, facts, coarse)
        narrow = _narrow(rule, tone, worst, least_um, limits.min_feature_on_request_um)
        refused = coarse is not None and narrow.passed is False
        yield replace(narrow, cure=_UNBIASED) if refused else narrow
    if limits.grid_nm is not None:
        yield _grid(plate, shop, limits.grid_nm)


def _biased_clear(figures: Figures) -> db.Region:
    layout = plate_layout(figures.plate)
    return biased_data(region(layout, CLEAR), figures.plate, figures.options.bias_nm or 0)


def _worst(
    plate: Plate, rules: DesignRules, tone: Tone, facts: PlateFacts | None, biased: db.Region | None
) -> tuple[float, str] | None:
    """The narrowest place, µm, and where, kisses and test figures aside; None where nothing is too narrow."""
    marks = tuple(mark for mark in plate.marks if mark.kind not in FINE_ON_PURPOSE)
    coarse = replace(plate, marks=marks)
    if biased is not None:
        results = _too_narrow(flat_results(merged(biased), (), rules, 1))
        widths = [(value, place.replace("the marks", "the data")) for value, place in results]
    elif dies_apart(coarse, rules.reach_nm):
        widths = [width for die in plate.dies for width in _of_die(die, plate, rules, tone, facts)]
        widths += _too_narrow(check_plate(replace(coarse, dies=()), rules))
    else:
        widths = list(_too_narrow(check_plate(coarse, rules)))
    value, place = min(widths, default=(math.inf, ""))
    return (value / NM_PER_UM, place) if widths else None


def _of_die(
    die: Die, plate: Plate, rules: DesignRules, tone: Tone, facts: PlateFacts | None
) -> Iterator[tuple[float, str]]:
    """The narrowest place of a die, in nanometres, if it breaks the rule."""
    least = rules.reach_nm
    plate_facts = facts or PlateFacts()
    if plate_facts.narrowest(die, tone).value_nm >= least:
        return
    if facts is None and 2 * least < die.panel.pitch_nm:
        yield from _too_narrow(check_plate(replace(plate, dies=(die,), marks=()), rules))
        return
    # Where every cell meets its neighbours' neighbours, counting all places takes minutes.
    worst = plate_facts.narrowest(die, tone, placed=True)
    at = "" if worst.place is None else f"({worst.place[0] / NM_PER_UM:.3f}, {worst.place[1] / NM_PER_UM:.3f}) um in "
    yield worst.value_nm, f"{at}die {die.name}"


def _too_narrow(results: Iterable[RuleResult]) -> Iterator[tuple[float, str]]:
    for result in results:
        if not result.passed:
            yield float(result.value) if isinstance(result.value, int | float) else 0.0, _place(result)


def _narrow(
    rule: str, tone: str, worst: tuple[float, str] | None, least_um: float, on_request_um: float | None
) -> Finding:
    if worst is None:
        return Finding(rule, True, f"at least {least_um:g}", least_um, "um")
    value, place = worst
    if on_request_um is not None and value >= on_request_um:
        cure = f"Made on request down to {on_request_um:g} um"
        question = (
            f"Your pages offer widths below {least_um:g} um on request. Do you make this plate, whose narrowest "
            f"{'clear' if tone == 'clear' else 'chrome'} width is {value:g} um, and at what price?"
        )
        return Finding(rule, None, value, least_um, "um", place, cure, question=question)
    cure = f"Use a coarser dot or a wider gutter, so that nothing {tone} is narrower than {least_um:g} um"
    return Finding(rule, False, value, least_um, "um", place, cure)


def _grid(plate: Plate, shop: Shop, grids_nm: Sequence[int]) -> Finding:
    offered, grid_nm = " ".join(map(str, grids_nm)), kept_grid_nm(plate, shop)
    if grid_nm in grids_nm and (grid_nm == 1 or not _off_grid(plate, grid_nm)):
        return Finding("grid", True, grid_nm, offered, "nm")
    least = min(grids_nm)
    bad = [*_off_grid(replace(plate, marks=()), least), *_off_grid(plate, least)]
    marks = bool(bad) and bad[0].die is None
    cure = f"Use dots, gutters and die centres that are multiples of {least} nm"
    if marks:
        cure = f"These are maskfab's own marks: {_PACKAGE}, which lays them on the grid"
    return Finding("grid", False, 1, offered, "nm", _place(bad[0]) if bad else "", cure)


def _off_grid(plate: Plate, grid_nm: int) -> list[RuleResult]:
    return [result for result in check_plate(plate, DesignRules(grid_nm=grid_nm)) if not result.passed]


def _drawn(
    plate: Plate, shop: Shop, options: PolygonOptions, facts: PlateFacts
) -> tuple[Figures | None, tuple[Finding, ...]]:
    """A plate that is not drawn yet, drawn; or why it cannot be."""
    merging = options.hierarchy == "merged" and shop.polygons.shared_boundaries is False and not options.bias_nm
    merging = merging and options.tone == "clear"  # chrome that is cut within a cell may be whole across cells
    try:
        figures = facts.drawn(plate, replace(options, hierarchy="cells") if merging else options)
        if merging and not {*adaptation.cut_cells(figures)} & {*figures.cells}:
            # Joining openings across pixels takes minutes on large plates, and mends no cell that is cut within.
            figures = facts.drawn(plate, options)
    except OutputError as refusal:
        return None, (Finding("drawing", False, refusal.what, None, cure=refusal.cure),)
    return figures, ()


def _of_figures(
    figures: Figures, shop: Shop, layers: Sequence[Layer], facts: PlateFacts | None = None
) -> Iterator[Finding]:
    limits, outlines, options, plate = shop.limits, shop.polygons, figures.options, figures.plate

    def crowded() -> str:
        most = max(figures.dies, key=lambda die: sum(g.index.size if len(g.cells) > 1 else 1 for g in die.grids))
        return f"die {most.name}"

    fewer = 'Use max_references for cells of two pixels, hierarchy = "flat", or fewer random dies'
    bounds: tuple[tuple[str, int | None, Callable[[], int], str, str, Callable[[], str]], ...] = (
        ("vertices", limits.max_vertices, lambda: adaptation.longest(figures), "",
         f"Set max_vertices to at most {limits.max_vertices}", str),
        ("references", limits.max_references, lambda: adaptation.references(figures), "", fewer, crowded),
        ("depth", limits.max_depth, lambda: _LEVELS if options.hierarchy == "cells" else 1, "levels",
         'Use hierarchy = "flat"', str),
        ("layers", limits.max_layers, lambda: len(layers), "", "", str),
        ("layer_number", limits.max_layer_number, lambda: max((layer.number for layer in layers), default=0), "", "",
         str),
        ("flashes", limits.max_flashes, lambda: adaptation.flashes(figures), "rectangles",
         "Use fewer cells, or a house whose writer draws polygons", str),
    )  # fmt: skip
    for rule, most, count, unit, cure, place in bounds:
        if most is not None:
            kept = (value := count()) <= most
            yield Finding.judged(rule, kept, value, most, unit, "" if kept else place(), cure)
    if outlines.self_crossing is False:
        yield Finding("self_crossing", True, "none", "none")
    if outlines.self_touching is not None:
        touching = options.corners == "joined" or options.holes == "keyhole"
        taken = "allowed" if outlines.self_touching else "none"
        cure = "" if outlines.self_touching or not touching else 'Use corners = "apart" and holes = "bisect"'
        have = "where corners meet and at keyholes" if touching else "none"
        yield Finding("self_touching", outlines.self_touching or not touching, have, taken, cure=cure)
    if outlines.doubled_vertices is False:
        yield Finding("doubled_vertices", True, "none", "none")
    if outlines.shared_boundaries is False:
        yield _boundaries(plate, figures)
    if options.bias_nm:
        yield _touches(flat_results(merged(_biased_clear(figures)), (), _KISSING, 1), outlines.corner_touches)
    else:
        yield _touches((facts or PlateFacts()).touching(plate), outlines.corner_touches)


def _boundaries(plate: Plate, figures: Figures) -> Finding:
    """Judged by the figures as they are written."""
    shared = adaptation.shared_edges(figures)
    if not shared and figures.options.hierarchy != "merged" and figures.options.tone == "dark" and plate.dies:
        die = plate.dies[0]
        around = 2 * sum(die.panel.size_nm) / NM_PER_UM
        cure = 'Use hierarchy = "merged"'
        return Finding("shared_boundaries", False, around, 0, "um", f"die {die.name}, round it", cure)
    for die in plate.dies if not shared and figures.options.hierarchy != "merged" else ():
        count = adaptation.facing_dots(die)
        if count:
            cure = 'Give the cells a gutter, or use hierarchy = "merged"'
            return Finding("shared_boundaries", False, count, 0, "dots", f"the cells of die {die.name}", cure)
    if not shared:
        return Finding("shared_boundaries", True, 0, 0, "um")
    first = shared[0]
    x, y = (value / NM_PER_UM for value in first.first_nm)
    place = f"({x:.3f}, {y:.3f}) um in {f'cell {first.cell} of ' if first.cell else ''}{first.owner}"
    length = sum(edge.length_nm for edge in shared) / NM_PER_UM
    cure = "Use an opening without holes and without clear dots that meet by corners: it is cut there"
    if first.owner.startswith("mark"):
        cure = f"This is a mark of maskfab's own: {_PACKAGE}, which draws it as a stencil"
    elif figures.options.holes == "layer":
        cure = "Use an opening without clear dots inside its holes, or that meet by corners: it is cut there"
    more = f", and in {len(shared) - 1} more" if len(shared) > 1 else ""
    return Finding("shared_boundaries", False, length, 0, "um", place + more, cure)


def corner_touches(plate: Plate) -> int:
    """Places of a plate at which clear shapes meet by a corner only."""
    return sum(result.count for result in PlateFacts().touching(plate))


def _touches(results: Sequence[RuleResult], allowed: bool | None) -> Finding:
    count = sum(result.count for result in results)
    bad = next((result for result in results if not result.passed), None)
    if allowed is False:
        cure = "Use openings whose clear dots meet by sides only, or a gutter" if count else ""
        return Finding("corner_touches", count == 0, count, 0, "", "" if bad is None else _place(bad), cure)
    note = "The house publishes no rule: writers round corners, so say whether they should join" if count else ""
    place = "" if bad is None else _place(bad)
    return Finding("corner_touches", True if allowed or not count else None, count, None, "", place, note)


def _of_names(plate: str, cells: Sequence[str], used: Sequence[Layer], shop: Shop) -> Iterator[Finding]:
    rules, every = shop.names, (plate, *cells)
    called = {shop.layer_names[layer.name]: layer.name for layer in used}
    layers = list(called)
    if rules.pattern is not None:
        yield _names("name", rules.pattern, [name for name in every if not re.fullmatch(rules.pattern, name)])
    if rules.max_length is not None:
        limit = f"at most {rules.max_length} characters"
        yield _names("name", limit, [name for name in every if len(name) > (rules.max_length or 0)])
    for part in rules.forbidden:
        yield _names("name", f"no {part!r}", [layer for layer in every if part.casefold() in layer.casefold()])
    if rules.layer_pattern is not None:
        bad = [layer for layer in layers if not re.fullmatch(rules.layer_pattern, layer)]
        yield _layer_names(rules.layer_pattern, bad, called)
    if rules.layer_max_length is not None:
        bad = [layer for layer in layers if len(layer) > (rules.layer_max_length or 0)]
        yield _layer_names(f"at most {rules.layer_max_length} characters", bad, called)
    if rules.forbidden_layers:
        forbidden = {layer.casefold() for layer in rules.forbidden_layers}
        bad = [layer for layer in layers if layer.casefold() in forbidden]
        yield _layer_names("not " + " ".join(rules.forbidden_layers), bad, called)
    if rules.block_equals_layer is False:
        taken = {layer.casefold() for layer in layers}
        yield _names("block_name", "no layer's name", [name for name in every if name.casefold() in taken])
    blocks = shop.blocks
    if False in (blocks.mirrored, blocks.scaled) or blocks.rotation_step_deg is not None:
        yield Finding("block_transforms", True, "none", "no mirrors, no scales, quarter turns")


def _names(rule: str, limit: str, bad: Sequence[str]) -> Finding:
    if not bad:
        return Finding(rule, True, "all", limit)
    cure = f"Rename {bad[0]!r}: names are those of the job, its dies, its openings and the plate template's marks"
    return Finding(rule, False, bad[0], limit, place=f"{len(bad)} of its names", cure=cure)


def _layer_names(limit: str, bad: Sequence[str], called: Mapping[str, str]) -> Finding:
    """``called`` holds the plate's own names of layers by those in the files."""
    finding = _names("layer_name", limit, bad)
    if finding.passed:
        return finding
    cure = f'Name it otherwise by [names] layers = {{ {called[bad[0]]} = "..." }} in a profile of your own'
    return replace(finding, cure=cure)


def _shown(value: float | int | str | None) -> str:
    return f"{value:.6g}" if isinstance(value, float) else str(value)


def _place(result: RuleResult) -> str:
    owner = "the marks" if result.die is None else f"die {result.die}"
    if not result.places:
        return owner
    x, y = (value / NM_PER_UM for value in result.places[0][:2])
    return f"({x:.3f}, {y:.3f}) um in {owner}, {result.count} in all"


def _spanned(box_nm: Box) -> str:
    x0, y0, x1, y1 = (value / NM_PER_MM for value in box_nm)
    return f"({x0:.6g}, {y0:.6g}) to ({x1:.6g}, {y1:.6g}) mm"


def _by(sides: tuple[float, float]) -> str:
    return f"{sides[0]:.6g} x {sides[1]:.6g}"
