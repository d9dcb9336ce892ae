"""The answers about the displays of a job as one JSON document, and its schema.

The answer about one display as lines of text: a title, then one line for each thing that was asked.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from types import MappingProxyType
from typing import Any

from maskfab.base.model import COLOURS, Die, Quantity
from maskfab.base.units import NM_PER_UM
from maskfab.display.drive import BY_AREA, NOT_PLACED
from maskfab.display.feasibility import Feasibility, PlateWithDisplays
from maskfab.display.placement import LargestGap
from maskfab.display.polygon_check import Violation
from maskfab.report.documents.die import closed_object, display_document, display_schema, or_null
from maskfab.report.documents.report import schema
from maskfab.report.rows.display import display_quantities
from maskfab.report.rows.text import quantity_document

Document = dict[str, Any]


def check_document(
    built: PlateWithDisplays,
    gaps: Mapping[str, LargestGap],
    digest: str,
    unused: Sequence[str] = (),
    notes: Mapping[str, Quantity] = MappingProxyType({}),
    *,
    passed: bool,
) -> Document:
    """Every die with the answer about it; ``display`` is null where a sheet has no pixels, ``unused`` names what of the
    job the answer does not depend on."""
    return {
        "job_hash": digest,
        "verdict": "pass" if passed else "fail",
        "dies": [
            _die(die, built.displays.get(die.name), gaps.get(die.name), notes.get(die.name)) for die in built.plate.dies
        ],
        "unused": list(unused),
    }


def _die(die: Die, found: Feasibility | None, gap: LargestGap | None, note: Quantity | None) -> Document:
    if found is None:
        return {"name": die.name, "display": None, "quantities": [], **dict.fromkeys(_PARTS)}
    return {
        "name": die.name,
        "display": display_document(found),
        "quantities": [
            *map(quantity_document, display_quantities(die, found)),
            *([quantity_document(note)] if note else []),
        ],
        "broken": [
            {"rule": each.rule, "area_um2": each.area_um2, "place_um": [along / NM_PER_UM for along in each.place_nm]}
            for each in found.broken
        ],
        "circuits": {
            "room_um2": found.room.area_um2,
            "closed_um2": found.room.closed_um2,
            "need_um2": found.room.need_um2,
            "not_modelled": NOT_PLACED,
        },
        "light": _light(found),
        "largest_gap": None
        if gap is None
        else {
            "found_um": None if gap.found_nm is None else gap.found_nm / NM_PER_UM,
            "excluded_um": None if gap.excluded_nm is None else gap.excluded_nm / NM_PER_UM,
        },
    }


def _light(found: Feasibility) -> Document | None:
    if found.density_ma_per_cm2 is None or found.life is None:
        return None
    return {
        "density_ma_per_cm2": dict(zip(COLOURS, found.density_ma_per_cm2, strict=True)),
        "relative_life": dict(zip(COLOURS, found.life, strict=True)),
        "centroid_px": list(found.centroid_px),
        "wander_px": found.wander_px,
    }


def check_schema() -> Document:
    """The JSON Schema (draft 2020-12) of what ``maskfab check --json`` prints."""
    number, text = {"type": "number"}, {"type": "string"}
    pair = {"type": "array", "items": number, "minItems": 2, "maxItems": 2}
    colours = closed_object(dict.fromkeys(COLOURS, number))
    broken = closed_object({"rule": text, "area_um2": number, "place_um": pair})
    parts = {
        "broken": {"type": "array", "items": broken},
        "circuits": closed_object({"room_um2": number, "closed_um2": number, "need_um2": number, "not_modelled": text}),
        "light": closed_object(
            {"density_ma_per_cm2": colours, "relative_life": colours, "centroid_px": pair, "wander_px": number}
        ),
        "largest_gap": closed_object(
            {"found_um": {"type": ["number", "null"]}, "excluded_um": {"type": ["number", "null"]}}
        ),
    }
    die = closed_object(
        {
            "name": text,
            "display": or_null(display_schema()),
            "quantities": {"type": "array", "items": {"$ref": "#/$defs/quantity"}},
            **{name: or_null(part) for name, part in parts.items()},
        }
    )
    return {
        "$schema": "https://json-schema.org/draft/2020-12/schema",
        "title": "maskfab check",
        **closed_object(
            {
                "job_hash": text,
                "verdict": {"enum": ["pass", "fail"]},
                "dies": {"type": "array", "items": die},
                "unused": {"type": "array", "items": text},
            }
        ),
        "$defs": {"quantity": schema()["$defs"]["quantity"]},
    }


_PARTS = ("broken", "circuits", "light", "largest_gap")


Line = tuple[str, str]


def display_lines(
    name: str, found: Feasibility | None, gap: LargestGap | None, seed: Quantity | None = None
) -> Iterator[str]:
    """The lines for one die; None stands for a sheet that has no pixels, ``seed`` is a note on the die's."""
    if found is None:
        yield f"{name}: no pixels to place emitters in"
        return
    yield f"{name}: {found.verdict}; {BY_AREA}"
    for part in (_footprint, _placement, _circuits, _wires, _light_text, _proofs):
        for label, text in part(found):
            yield f"  {label:<16} {text}"
    if seed is not None:
        yield f"  {'note':<16} {seed.method}"
    if gap is not None:
        yield f"  {'widest gap':<16} {_gap(gap)}"


def _footprint(found: Feasibility) -> Iterator[Line]:
    footprint = found.footprint
    required = f"; required {_percent(found.required)}" if found.required else ""
    method = f" ({footprint.method})" if footprint.found is not None else ""
    yield "footprint", f"{_percent(footprint.found_share)}{method}, at most {_percent(footprint.bound_share)}{required}"
    yield "rectangles", _percent(footprint.rectangles_share)


def _placement(found: Feasibility) -> Iterator[Line]:
    if found.emitters is None:
        return
    yield (
        "areas",
        ", ".join(f"{letter} {area:.10g}" for letter, area in zip("RGB", found.emitters.areas_um2, strict=True))
        + " um^2",
    )
    borders = found.borders
    if borders is not None:
        yield (
            "borders",
            f"{borders.side_violations} of {borders.side_pairs} pairs at sides and {borders.diagonal_violations} of "
            f"{borders.diagonal_pairs} at corners are too close; {borders.margin_nm / NM_PER_UM:g} um of clearance "
            "along all sides would suit any neighbour",
        )
    if not found.broken:
        yield "rules broken", "none, measured from the polygons"
    for each in found.broken:
        yield "rules broken", _broken(each)


def _broken(each: Violation) -> str:
    x, y = (along / NM_PER_UM for along in each.place_nm)
    return f"{each.rule}: {each.area_um2:g} um^2 near ({x:g}, {y:g}) um"


def _circuits(found: Feasibility) -> Iterator[Line]:
    room = found.room
    yield "circuits", f"{_round(room.area_um2)} um^2 available, {_round(room.need_um2)} um^2 needed"
    yield "not modelled", NOT_PLACED


def _wires(found: Feasibility) -> Iterator[Line]:
    wires = found.wiring
    if wires is None:
        return
    if wires.laid is not None:
        drawn = f"{wires.wanted - wires.transparent} laid across the panel each way"
    else:
        along_x, along_y = wires.through
        drawn = f"{wires.in_gutter} in the gutter, {along_x} along x and {along_y} along y through closed area"
    yield "wires", f"{wires.verdict}: of {wires.wanted} lines {wires.transparent} transparent, {drawn}"
    for each in wires.broken:
        yield "rules broken", _broken(each)


def _light_text(found: Feasibility) -> Iterator[Line]:
    if found.emitters is None:
        return
    x, y = found.centroid_px
    yield "light", f"centroid at ({x:.4f}, {y:.4f}) px; shifts by {found.wander_px:.4f} px RMS between orientations"
    if found.density_ma_per_cm2 is not None:
        yield "current density", f"{_colours(found.density_ma_per_cm2)} mA/cm2"
    if found.life is not None:
        yield "relative life", _colours(found.life)


def _proofs(found: Feasibility) -> Iterator[Line]:
    for certificate in found.certificates:
        yield "proof", certificate.statement
    bound = found.footprint.certificate
    if bound is not None and bound not in found.certificates:
        yield "bound", bound.statement


def _gap(gap: LargestGap) -> str:
    fits = "no placement was found at any gap" if gap.found_nm is None else f"{gap.found_nm / NM_PER_UM:g} um fits"
    if gap.excluded_nm is None:
        return f"{fits}; no gap within the pixel is proven impossible"
    return f"{fits}; {gap.excluded_nm / NM_PER_UM:g} um is proven impossible"


def _percent(share: float) -> str:
    return f"{100 * share:.2f} %"


def _colours(values: Iterable[float]) -> str:
    return ", ".join(f"{letter} {value:.4g}" for letter, value in zip("RGB", values, strict=True))


def _round(area_um2: float) -> str:
    return f"{area_um2:.0f}"
