"""A die's display in report.json: verdict, proofs, placement, borders and wires."""

from __future__ import annotations

from typing import Any

from maskfab.display.circuit import NOT_PLACED
from maskfab.display.emitters.placement import Certificate, Verdict
from maskfab.display.feasibility import Feasibility
from maskfab.model import COLOURS
from maskfab.report.documents.schema_terms import closed_object, or_null
from maskfab.units import NM_PER_UM

Document = dict[str, Any]


def display_document(found: Feasibility) -> Document:
    """The answer about one panel; lengths in micrometres, areas in square micrometres, shares of a pixel."""
    footprint, borders = found.footprint, found.borders
    emitters = found.emitters
    return {
        "verdict": found.verdict.value,
        "required": found.required,
        "share": found.share,
        "found_share": footprint.found_share,
        "bound_share": footprint.bound_share,
        "rectangles_share": footprint.rectangles_share,
        "method": footprint.method,
        "emitters": None
        if emitters is None
        else {
            "cell_um": emitters.cell_nm / NM_PER_UM,
            "areas_um2": dict(zip(COLOURS, emitters.areas_um2, strict=True)),
            "centroid_px": found.centroid_px,
            "wander_px": found.wander_px,
            "circuit_rooms_um2": [room.area_um2 for room in found.own_rooms],
            "pieces": len(found.reaches),
            "stranded": len(found.stranded),
        },
        "circuits": {"room_um2": found.room.area_um2, "need_um2": found.room.need_um2, "not_modelled": NOT_PLACED},
        "borders": None
        if borders is None
        else {
            "side_pairs": borders.side_pairs,
            "side_violations": borders.side_violations,
            "diagonal_pairs": borders.diagonal_pairs,
            "diagonal_violations": borders.diagonal_violations,
            "worst_pair": None if borders.worst is None else borders.worst.pair,
            "sufficient_margin_um": borders.margin_nm / NM_PER_UM,
        },
        "wires": None
        if found.wiring is None
        else {
            "verdict": found.wiring.verdict.value,
            "wanted": found.wiring.wanted,
            "in_gutter": found.wiring.in_gutter,
            "through": found.wiring.through,
            "transparent": found.wiring.transparent,
            "laid": found.wiring.laid is not None,
            "lines": found.wiring.lines,
            "broken": [each.rule for each in found.wiring.broken],
        },
        "proofs": [_proof(certificate) for certificate in found.certificates],
        "bound_proof": None if footprint.certificate is None else _proof(footprint.certificate),
    }


def _proof(certificate: Certificate) -> Document:
    return {
        "proof": certificate.proof.value,
        "statement": certificate.statement,
        "numbers": dict(certificate.numbers),
    }


def display_schema() -> Document:
    """JSON Schema of :func:`display_document`."""
    number, integer, text = {"type": "number"}, {"type": "integer"}, {"type": "string"}
    pair = {"type": "array", "items": number, "minItems": 2, "maxItems": 2}
    proof = closed_object(
        {"proof": text, "statement": text, "numbers": {"type": "object", "additionalProperties": number}}
    )
    return closed_object(
        {
            "verdict": {"enum": [verdict.value for verdict in Verdict]},
            "required": number,
            "share": number,
            "found_share": number,
            "bound_share": number,
            "rectangles_share": number,
            "method": text,
            "emitters": or_null(
                closed_object(
                    {
                        "cell_um": number,
                        "areas_um2": closed_object(dict.fromkeys(COLOURS, number)),
                        "centroid_px": pair,
                        "wander_px": number,
                        "circuit_rooms_um2": {"type": "array", "items": number},
                        "pieces": integer,
                        "stranded": integer,
                    }
                )
            ),
            "circuits": closed_object(
                {"room_um2": number, "need_um2": number, "not_modelled": text}, optional=("not_modelled",)
            ),
            "borders": or_null(
                closed_object(
                    {
                        "side_pairs": integer,
                        "side_violations": integer,
                        "diagonal_pairs": integer,
                        "diagonal_violations": integer,
                        "worst_pair": or_null({"type": "array", "items": integer, "minItems": 2, "maxItems": 2}),
                        "sufficient_margin_um": number,
                    }
                )
            ),
            "wires": or_null(
                closed_object(
                    {
                        "verdict": {"enum": [verdict.value for verdict in Verdict]},
                        "wanted": integer,
                        "in_gutter": integer,
                        "through": pair,
                        "transparent": integer,
                        "laid": {"type": "boolean"},
                        "lines": pair,
                        "broken": {"type": "array", "items": text},
                    }
                )
            ),
            "proofs": {"type": "array", "items": proof},
            "bound_proof": or_null(proof),
        }
    )
