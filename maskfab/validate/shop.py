"""A plate against what a mask house publishes: one finding for each of its rules, with value, limit, place and cure.

What a package would send is judged by :func:`check_shop`, what a job writes by :func:`check_written`.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Literal

from maskfab.errors import OutputError
from maskfab.export import tally
from maskfab.export.figures import DieFigures, Figures, PolygonOptions, draw
from maskfab.export.fitting import drawing_options, extent_nm, fitted, written_box
from maskfab.geometry.drc import DesignRules, RuleResult, check_plate
from maskfab.geometry.region import plate_names
from maskfab.geometry.rules import smallest_runs
from maskfab.model import CLEAR, NOTE, Die, Layer, Plate, Quantity
from maskfab.spec import FileFormat
from maskfab.spec.shop import FORMATS, Format, Shop
from maskfab.units import NM_PER_UM
from maskfab.validate.roundtrip import die_edges_nm, die_raster

_NM_PER_MM = 1000 * NM_PER_UM
_BLANK_TOLERANCE_NM = 500_000
_FINE_ON_PURPOSE = ("resolution", "code")
_LEVELS = 3
"""Plate, die, unit cell: references are never nested deeper."""
_PACKAGE = "send what maskfab package makes for the house"


@dataclass(frozen=True)
class Finding:
    """One rule of a shop on one plate.

    Attributes:
        rule: format, tone, drawing_unit, text, blank, plot_area, extent, coordinates, min_feature, min_space, grid,
            vertices, references, depth, layers, layer_number, unwritten_layers, flashes, drawing, name, layer_name,
            block_name, block_transforms, self_crossing, self_touching, doubled_vertices, shared_boundaries or
            corner_touches.
        passed: whether the plate keeps it; None where the house decides, or publishes nothing to judge by.
        value: what the plate has.
        limit: what the house takes.
        unit: of both.
        place: where it is broken first, in words.
        cure: what to do about it; empty where nothing needs to be done.
        source: the pages where the house publishes it.
    """

    rule: str
    passed: bool | None
    value: float | int | str
    limit: float | int | str | None
    unit: str = ""
    place: str = ""
    cure: str = ""
    source: str = ""

    def quantity(self) -> Quantity:
        """The finding as a row of a report."""
        method = ". ".join(text for text in (self.place and f"at {self.place}", self.cure, self.source) if text)
        return Quantity(f"shop_{self.rule}", "", self.value, self.unit, method, limit=self.limit, passed=self.passed)

    def __str__(self) -> str:
        verdict = {True: "PASS", False: "REFUSED", None: "note"}[self.passed]
        limit = "" if self.limit is None else f", {self.limit} {self.unit}".rstrip() + " taken"
        text = f"{verdict} {self.rule}: {self.value} {self.unit}".rstrip() + limit
        place = f" at {self.place}" if self.place else ""
        return text + place + (f". {self.cure}" if self.cure else "")


def accepted(findings: Sequence[Finding]) -> bool:
    """Whether no rule is broken."""
    return all(finding.passed is not False for finding in findings)


def check_shop(
    plate: Plate, shop: Shop, formats: Sequence[Format] = (), options: PolygonOptions | None = None
) -> tuple[Finding, ...]:
    """Judge what a package of a composed plate would hold by every rule that a shop publishes; nothing is written.

    Args:
        plate: the plate, with all its layers; only what is written is looked at.
        shop: the profile.
        formats: what is to be sent; the shop's first format if empty.
        options: how polygons are drawn; None chooses as a package does.
    """
    sent, drawn = tuple(formats) or shop.formats[:1], fitted(plate, shop)
    names = plate_names(drawn)
    cells = {names.top, *names.dies, *names.marks, *names.units.values()}
    findings = (
        *_of_files(shop, sent, noted=False),
        *_of_plate(drawn, shop),
        *_of_features(drawn, shop),
        *_of_drawing(drawn, shop, options or drawing_options(drawn, shop)),
        *_of_names((plate.name, *sorted(cells)), (CLEAR.name,), shop),
    )
    return _sourced(findings, shop)


def check_written(figures: Figures, shop: Shop, formats: Sequence[FileFormat]) -> tuple[Finding, ...]:
    """Judge the layouts that a job writes by every rule that a shop publishes, with all that is in them.

    Args:
        figures: the plate as its files draw it, layers for orientation included.
        shop: the profile.
        formats: of the files; those that no house is sent, SVG, solids and pictures, are not looked at.
    """
    sent, plate = tuple(each for each in FORMATS if each in formats), figures.plate
    layers = [*figures.layers, *([NOTE] if figures.notes and NOTE not in figures.layers else [])]
    cells = [figures.top]
    if figures.options.hierarchy == "cells":
        below = {*figures.cells, *(die.name for die in figures.dies), *(mark.name for mark in figures.marks)}
        cells += sorted(below)
    findings = (
        *_of_files(shop, sent, noted=bool(figures.notes)),
        *_of_plate(plate, shop),
        *_of_features(plate, shop),
        *_of_figures(figures, shop, layers),
        *_unwritten(layers),
        *_of_names((plate.name, *cells), [layer.name for layer in layers], shop),
    )
    return _sourced((_as_written(each, shop) for each in findings), shop)


def _sourced(findings: Iterable[Finding], shop: Shop) -> tuple[Finding, ...]:
    source = " ".join(shop.sources)
    return tuple(replace(each, source=source) for each in findings)


def _unwritten(layers: Sequence[Layer]) -> Iterator[Finding]:
    others = [layer.name for layer in layers if not layer.written]
    if others:
        cure = f"Order {CLEAR.name} {CLEAR.number}/{CLEAR.datatype} alone, or {_PACKAGE}, which has no other layer"
        yield Finding("unwritten_layers", None, " ".join(others), None, cure=cure)


def _as_written(finding: Finding, shop: Shop) -> Finding:
    """The finding with the cure of what a job cannot write and a package can."""
    if finding.passed is not False:
        return finding
    known = " ".join(shop.formats)
    cures = {
        "format": f"Keep to {known} in formats, or leave it out; or {_PACKAGE}",
        "extent": f"{_PACKAGE.capitalize()}, which adds marks for the corners, with dies that leave room for them",
        "layers": f"{_PACKAGE.capitalize()}, which has what is written alone",
    }
    if shop.polygons.holes == "layer":
        cures["shared_boundaries"] = f"{finding.cure}; or {_PACKAGE}, which gives holes a layer of their own"
    return replace(finding, cure=cures.get(finding.rule, finding.cure))


def _of_files(shop: Shop, sent: Sequence[Format], *, noted: bool) -> Iterator[Finding]:
    known = shop.accepts.formats
    for each in sent:
        if known is None:
            yield Finding("format", None, each, None, cure="The house publishes no list of formats: ask before sending")
        else:
            taken = each in known
            cure = "" if taken else f"Send {known[0]}"
            yield Finding("format", taken, each, " ".join(known), cure=cure)
    tones, words = shop.order.tones, " ".join(shop.order.tones)
    cure = "" if "clear" in tones else "Choose another house: what maskfab draws is clear"
    yield Finding("tone", "clear" in tones, "clear", words, cure=cure)
    drawings = [each for each in sent if each.startswith("dxf")]
    if shop.accepts.drawing_unit is not None and drawings:
        unit = shop.accepts.drawing_unit
        others = [each for each in known or () if not each.startswith("dxf")]
        cure = "" if unit == "um" else f"Send {others[0]}, which carries its unit" if others else "Ask the house"
        yield Finding("drawing_unit", unit == "um", "um", unit, cure=cure)
    if shop.text.allowed_in is not None:
        texted = [each for each in sent if each in drawings or (noted and each in ("gdsii", "oasis"))]
        lettered = [each for each in texted if each not in shop.text.allowed_in]
        kept = [each for each in known or () if each not in texted]
        yield Finding(
            "text",
            not lettered,
            f"{'notes' if noted else 'one line'} in {' '.join(texted)}" if texted else "none",
            f"in {' '.join(shop.text.allowed_in)}" if shop.text.allowed_in else "none",
            cure=f"Send {kept[0] if kept else 'another format'}, in which all text is polygons" if lettered else "",
        )


def _of_plate(plate: Plate, shop: Shop) -> Iterator[Finding]:
    sizes, blank_mm = shop.plate, plate.blank_nm / _NM_PER_MM
    if sizes.blanks_in is not None:
        fits = any(abs(plate.blank_nm - inches * 25_400_000) <= _BLANK_TOLERANCE_NM for inches in sizes.blanks_in)
        offered = " ".join(f"{inches * 25.4:g}" for inches in sizes.blanks_in)
        cure = "" if fits else f'Set plate.blank to "{sizes.blanks_in[0]:g} in"'
        yield Finding("blank", fits, blank_mm, offered, "mm", cure=cure)
    elif sizes.largest_mm is not None:
        fits = blank_mm <= min(sizes.largest_mm)
        cure = "" if fits else f'Set plate.blank to at most "{min(sizes.largest_mm):g} mm"'
        yield Finding("blank", fits, blank_mm, _by(sizes.largest_mm), "mm", cure=cure)
    x0, y0, x1, y1 = written_box(plate)
    width, height = (x1 - x0) / _NM_PER_MM, (y1 - y0) / _NM_PER_MM
    if sizes.plot_area_mm is not None:
        reach = 2 * max(-x0, x1) / _NM_PER_MM, 2 * max(-y0, y1) / _NM_PER_MM
        fits = reach[0] <= sizes.plot_area_mm[0] and reach[1] <= sizes.plot_area_mm[1]
        cure = "" if fits else f'Set plate.writable to at most "{min(sizes.plot_area_mm):g} mm", or use fewer dies'
        place = "" if fits else _corner(plate)
        yield Finding("plot_area", fits, _by(reach), _by(sizes.plot_area_mm), "mm", place, cure)
    asked = extent_nm(shop)
    if asked is not None:
        fits = (x1 - x0, y1 - y0) == asked and (x0, y0) == (-asked[0] // 2, -asked[1] // 2)
        cure = "" if fits else "Use smaller or fewer dies: marks for the corners are added by the package"
        limit = _by((asked[0] / _NM_PER_MM, asked[1] / _NM_PER_MM))
        yield Finding("extent", fits, _by((width, height)), limit, "mm", "" if fits else _corner(plate), cure)
    if shop.limits.max_coordinate_mm is not None:
        farthest = max(abs(x0), abs(y0), abs(x1), abs(y1)) / _NM_PER_MM
        fits = farthest <= shop.limits.max_coordinate_mm
        cure = "" if fits else "Use a smaller plate"
        yield Finding("coordinates", fits, farthest, shop.limits.max_coordinate_mm, "mm", cure=cure)


def _of_features(plate: Plate, shop: Shop) -> Iterator[Finding]:
    limits = shop.limits
    least = limits.min_feature_um
    if least is not None:
        yield _feature(plate, least, limits.min_feature_on_request_um)
    space = limits.min_space_um if limits.min_space_um is not None else least
    if space is not None:
        yield _space(plate, space, limits.min_feature_on_request_um)
    if limits.grid_nm is not None:
        yield _grid(plate, limits.grid_nm)


def _feature(plate: Plate, least_um: float, on_request_um: float | None) -> Finding:
    worst = _worst(plate, DesignRules(min_width_nm=_nm(least_um)), "clear")
    return _narrow("min_feature", "clear", worst, least_um, on_request_um)


def _space(plate: Plate, least_um: float, on_request_um: float | None) -> Finding:
    worst = _worst(plate, DesignRules(min_space_nm=_nm(least_um)), "opaque")
    return _narrow("min_space", "opaque", worst, least_um, on_request_um)


def _worst(plate: Plate, rules: DesignRules, tone: Literal["clear", "opaque"]) -> tuple[float, str] | None:
    """The narrowest place in micrometres, and where; None where nothing is too narrow.

    Corners that kiss are a rule of their own. As a width or a space of nothing they would hide every other, so a die
    that has them is judged by its runs along x and y; so is one whose cells are smaller than twice the limit, for
    there every cell meets its neighbours' neighbours. Test figures and codes have corners that kiss on purpose.
    """
    least = rules.reach_nm
    plate = replace(plate, furniture=tuple(mark for mark in plate.furniture if mark.kind not in _FINE_ON_PURPOSE))
    small = [die for die in plate.dies if die.panel.pitch_nm < 2 * least]
    found = [_run(die, tone) for die in small]
    others = {die.name: die for die in plate.dies if die not in small}
    for result in check_plate(replace(plate, dies=tuple(others.values())), rules):
        if not result.passed:
            value = _number(result.value)
            kissing = value == 0 and result.die is not None
            found.append(_run(others[result.die or ""], tone) if kissing else (value, _place(result)))
    value, place = min(found, default=(float("inf"), ""))
    return (value / NM_PER_UM, place) if value < least else None


def _run(die: Die, tone: Literal["clear", "opaque"]) -> tuple[float, str]:
    """The shortest run of a die along x or y, in nanometres."""
    runs = smallest_runs(die_raster(die), *die_edges_nm(die))
    return (runs.clear if tone == "clear" else runs.opaque), f"die {die.name}"


def _narrow(
    rule: str, tone: str, worst: tuple[float, str] | None, least_um: float, on_request_um: float | None
) -> Finding:
    if worst is None:
        return Finding(rule, True, f"at least {least_um:g}", least_um, "um")
    value, place = worst
    if on_request_um is not None and value >= on_request_um:
        cure = f"Made on request down to {on_request_um:g} um: ask before ordering"
        return Finding(rule, None, value, least_um, "um", place, cure)
    cure = f"Use a coarser dot or a wider gutter, so that nothing {tone} is narrower than {least_um:g} um"
    return Finding(rule, False, value, least_um, "um", place, cure)


def _grid(plate: Plate, grids_nm: Sequence[int]) -> Finding:
    offered = " ".join(map(str, grids_nm))
    if min(grids_nm) == 1:
        return Finding("grid", True, 1, offered, "nm")
    bad: RuleResult | None = None
    for grid in sorted(grids_nm, reverse=True):
        broken = [result for result in check_plate(plate, DesignRules(grid_nm=grid)) if not result.passed]
        if not broken:
            return Finding("grid", True, grid, offered, "nm")
        bad = broken[0]
    cure = f"Use dots, gutters and die centres that are multiples of {min(grids_nm)} nm"
    return Finding("grid", False, 1, offered, "nm", "" if bad is None else _place(bad), cure)


def _of_drawing(plate: Plate, shop: Shop, options: PolygonOptions) -> Iterator[Finding]:
    """The findings of a plate that is not drawn yet."""
    merging = options.hierarchy == "merged" and shop.polygons.shared_boundaries is False
    try:
        figures = draw(plate, replace(options, hierarchy="cells") if merging else options)
        if merging and not {*tally.cut_cells(figures)} & {*figures.cells}:
            # Joining openings across pixels takes minutes on large plates, and mends no cell that is cut within.
            figures = draw(plate, options)
    except OutputError as refusal:
        yield Finding("drawing", False, refusal.what, None, cure=refusal.cure)
        return
    yield from _of_figures(figures, shop, [layer for layer in figures.layers if layer.written])


def _of_figures(figures: Figures, shop: Shop, layers: Sequence[Layer]) -> Iterator[Finding]:
    limits, outlines, options, plate = shop.limits, shop.polygons, figures.options, figures.plate
    if limits.max_vertices is not None:
        most = tally.longest(figures)
        fits = most <= limits.max_vertices
        cure = "" if fits else f"Set max_vertices to at most {limits.max_vertices}"
        yield Finding("vertices", fits, most, limits.max_vertices, cure=cure)
    if limits.max_references is not None:
        yield _references(figures, limits.max_references)
    if limits.max_depth is not None:
        depth = _LEVELS if options.hierarchy == "cells" else 1
        cure = "" if depth <= limits.max_depth else 'Use hierarchy = "flat"'
        yield Finding("depth", depth <= limits.max_depth, depth, limits.max_depth, "levels", cure=cure)
    if limits.max_layers is not None:
        yield Finding("layers", len(layers) <= limits.max_layers, len(layers), limits.max_layers)
    if limits.max_layer_number is not None:
        highest = max((layer.number for layer in layers), default=0)
        yield Finding("layer_number", highest <= limits.max_layer_number, highest, limits.max_layer_number)
    if limits.max_flashes is not None:
        count = tally.flashes(plate)
        cure = "" if count <= limits.max_flashes else "Use fewer cells, or a house whose writer draws polygons"
        yield Finding("flashes", count <= limits.max_flashes, count, limits.max_flashes, "rectangles", cure=cure)
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
    yield _touches(plate, outlines.corner_touches)


def _references(figures: Figures, most: int) -> Finding:
    count = tally.references(figures)
    fits = count <= most
    place = "" if fits else max(figures.dies, key=_placed).name
    cure = "" if fits else 'Use max_references for cells of two pixels, hierarchy = "flat", or fewer random dies'
    return Finding("references", fits, count, most, "", place and f"die {place}", cure)


def _placed(die: DieFigures) -> int:
    return sum(int(grid.index.size) if len(grid.cells) > 1 else 1 for grid in die.grids)


def _boundaries(plate: Plate, figures: Figures) -> Finding:
    marks = {mark.name for mark in figures.marks}
    every = tally.cut_cells(figures)
    cut = [name for name in every if name not in marks]
    for die in plate.dies if not cut and figures.options.hierarchy != "merged" else ():
        count = tally.facing_dots(die)
        if count:
            cure = 'Give the cells a gutter, or use hierarchy = "merged"'
            return Finding("shared_boundaries", False, count, 0, "dots", f"the cells of die {die.name}", cure)
    if every and not cut:
        # Letters are ours to draw, and no change to a job would mend them.
        note = "A letter that touches itself is parted there: ask whether the house minds"
        return Finding("shared_boundaries", None, len(every), 0, "marks", f"mark {every[0]}", note)
    cure = "Use an opening without holes and without clear dots that meet by corners: it is cut there" if cut else ""
    return Finding("shared_boundaries", not cut, len(cut), 0, "cells", f"cell {cut[0]}" if cut else "", cure)


def _touches(plate: Plate, allowed: bool | None) -> Finding:
    results = check_plate(plate, DesignRules(no_corner_touch=True))
    count = sum(result.count for result in results)
    bad = next((result for result in results if not result.passed), None)
    if allowed is False:
        cure = "Use openings whose clear dots meet by sides only, or a gutter" if count else ""
        return Finding("corner_touches", count == 0, count, 0, "", "" if bad is None else _place(bad), cure)
    note = "The house publishes no rule: writers round corners, so say whether they should join" if count else ""
    place = "" if bad is None else _place(bad)
    return Finding("corner_touches", True if allowed or not count else None, count, None, "", place, note)


def _of_names(every: Sequence[str], layers: Sequence[str], shop: Shop) -> Iterator[Finding]:
    """Names of the plate and its cells, and of its layers."""
    rules = shop.names
    if rules.pattern is not None:
        yield _names("name", rules.pattern, [each for each in every if not re.fullmatch(rules.pattern, each)])
    if rules.max_length is not None:
        limit = f"at most {rules.max_length} characters"
        yield _names("name", limit, [each for each in every if len(each) > (rules.max_length or 0)])
    for part in rules.forbidden:
        yield _names("name", f"no {part!r}", [each for each in every if part.casefold() in each.casefold()])
    if rules.layer_pattern is not None:
        bad = [each for each in layers if not re.fullmatch(rules.layer_pattern, each)]
        yield _names("layer_name", rules.layer_pattern, bad)
    if rules.layer_max_length is not None:
        bad = [each for each in layers if len(each) > (rules.layer_max_length or 0)]
        yield _names("layer_name", f"at most {rules.layer_max_length} characters", bad)
    if rules.forbidden_layers:
        bad = [each for each in layers if each in rules.forbidden_layers]
        yield _names("layer_name", "not " + " ".join(rules.forbidden_layers), bad)
    if rules.block_equals_layer is False:
        taken = {each.casefold() for each in layers}
        yield _names("block_name", "no layer's name", [each for each in every if each.casefold() in taken])
    blocks = shop.blocks
    if False in (blocks.mirrored, blocks.scaled) or blocks.rotation_step_deg is not None:
        yield Finding("block_transforms", True, "none", "no mirrors, no scales, quarter turns")


def _names(rule: str, limit: str, bad: Sequence[str]) -> Finding:
    if not bad:
        return Finding(rule, True, "all", limit)
    return Finding(rule, False, bad[0], limit, place=f"{len(bad)} of its names", cure=f"Rename {bad[0]!r}")


def _number(value: float | int | str | None) -> float:
    return float(value) if isinstance(value, int | float) else 0.0


def _place(result: RuleResult) -> str:
    owner = "the marks" if result.die is None else f"die {result.die}"
    if not result.places:
        return owner
    x, y = (value / NM_PER_UM for value in result.places[0][:2])
    return f"({x:.3f}, {y:.3f}) um in {owner}, {result.count} in all"


def _corner(plate: Plate) -> str:
    x0, y0, x1, y1 = (value / _NM_PER_MM for value in written_box(plate))
    return f"({x0:.6g}, {y0:.6g}) to ({x1:.6g}, {y1:.6g}) mm"


def _by(sides: tuple[float, float]) -> str:
    return f"{sides[0]:.6g} x {sides[1]:.6g}"


def _nm(length_um: float) -> int:
    return round(length_um * NM_PER_UM)
