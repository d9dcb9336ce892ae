"""The answers about the displays of a job as one JSON document, and its schema."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from types import MappingProxyType
from typing import Any

from maskfab.display.circuit import NOT_PLACED
from maskfab.display.emitters.fit import LargestGap
from maskfab.display.feasibility import Feasibility
from maskfab.display.place import Populated
from maskfab.measurement.display_rows import display_quantities
from maskfab.model import COLOURS, Die, Quantity
from maskfab.report.documents.display_data import display_document, display_schema
from maskfab.report.documents.report_data import schema
from maskfab.report.documents.schema_terms import closed_object, or_null
from maskfab.report.quantity_table import quantity_document
from maskfab.units import NM_PER_UM

Document = dict[str, Any]


def check_document(
    built: Populated,
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
            _die(die, built.found.get(die.name), gaps.get(die.name), notes.get(die.name)) for die in built.plate.dies
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
