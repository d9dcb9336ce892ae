"""Terms of the JSON Schemas of documents.

A die's display in report.json: verdict, proofs, placement, borders and wires.

The design of a die's opening in report.json: as stated in its provenance, beside what was computed here.

Provenance is somebody else's text. What is missing or is no number is told as missing; numbers are never recomputed
from it, and nothing that is measured here depends on it.

Photographs through the dies of a plate in report.json: how they were taken, every score, and what they leave out.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from maskfab.base.model import COLOURS, Opening, Quantity
from maskfab.base.units import NM_PER_UM
from maskfab.camera.lens import F1, camera_line
from maskfab.designs.rules.rule import priced_rule
from maskfab.display.drive import NOT_PLACED
from maskfab.display.emitter_rules import Certificate, Verdict
from maskfab.display.feasibility import Feasibility
from maskfab.mask import panels
from maskfab.mask.job import Job
from maskfab.report.rows.photographs import Photographs, Restored

Document = dict[str, Any]


def closed_object(properties: Mapping[str, Any], optional: Sequence[str] = ()) -> Document:
    """An object of these properties alone, all required but the ``optional`` ones."""
    return {
        "type": "object",
        "properties": dict(properties),
        "required": [name for name in properties if name not in optional],
        "additionalProperties": False,
    }


def or_null(schema: Document) -> Document:
    """The schema, or null in its place."""
    return {"anyOf": [schema, {"type": "null"}]}


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


Facts = Mapping[str, object]

_NAMES = frozenset({"shape", "rules_cost_db", "evaluated"})
_STARTS = ("expected_psnr_", "head_room_", "price_", "gain_db_")
_MOST_CHARACTERS = 300
_MOST_PRICES = 40


@dataclass(frozen=True)
class Stated:
    """Design facts stated in the files of one die.

    Attributes:
        opening: provenance of the die's first opening.
        dot_um: side of a dot that it was designed for.
        cells: provenance of the die's map; None if it has none.
        cells_name: of that map.
    """

    opening: Facts
    dot_um: float
    cells: Facts | None = None
    cells_name: str | None = None


def stated(job: Job) -> dict[str, Stated]:
    """By die, what its files say, of dies whose opening or map says that it was designed."""
    found = {}
    for die in job.spec.die:
        opening: Opening = job.openings[die.name][0]
        cells = None if die.map is None else panels.parse_map(job.spec.maps[die.map])
        facts = None if cells is None else cells.provenance
        if _designed(opening.provenance) or (facts is not None and _designed(facts)):
            found[die.name] = Stated(opening.provenance, opening.dot_nm / NM_PER_UM, facts, die.map)
    return found


def camera_notes(job: Job) -> dict[str, Quantity]:
    """By die, a note where its opening or its map says that it was designed for another camera than the job's."""
    here = camera_line(job.camera)
    notes = {}
    for name, said in stated(job).items():
        others = [each for each in (_camera(said.opening), _camera(said.cells or {})) if each not in (None, here)]
        if others:
            told = f"camera that this die was designed for; the job's is: {here}. What its files state holds there"
            notes[name] = Quantity("designed_for", _plain(str(others[0])), told, die=name)
    return notes


def _camera(facts: Facts) -> object:
    """The camera that a file was designed for; what states none was made for that of protocol F1, unless a descent for
    a camera that former versions did not name."""
    if "camera" in facts:
        return facts["camera"]
    return camera_line(F1) if facts.get("author") == "maskfab" and "loss" not in facts else None


def design_document(said: Stated, levels_db: Sequence[float], restored: Restored | None = None) -> Document:
    """One die's design; all PSNRs and their differences in dB.

    Args:
        said: by its files.
        levels_db: of light.
        restored: photographs behind the die; None if it is not known.
    """
    opening, cells = said.opening, said.cells or {}
    shots = {} if restored is None else {shot.score.level_db: shot.score for shot in restored.shots}
    levels = []
    for level in levels_db:
        score = shots.get(level)
        levels.append(
            {
                "level_db": level,
                "stated_psnr": _number(opening, f"expected_psnr_{level:g}"),
                "head_room": _number(opening, f"head_room_{level:g}"),
                "head_room_frame": _number(opening, f"head_room_frame_{level:g}"),
                "map_gain": _number(cells, f"gain_db_{level:g}"),
                "restored_psnr": restored.psnr(level) if restored is not None and restored.scores else None,
                "photograph": None
                if score is None
                else {"psnr": score.psnr, "psnr_inner": score.psnr_inner, "epsilon": score.epsilon},
            }
        )
    return {
        "shape": _text(opening, "shape"),
        "command": _text(opening, "command"),
        "version": _text(opening, "version"),
        "seed": _text(opening, "seed"),
        "protocol": _text(opening, "protocol"),
        "evaluated": _number(opening, "evaluated"),
        "dot_um": said.dot_um,
        "rules_cost": _number(opening, "rules_cost_db"),
        "prices": _prices(opening),
        "map": None
        if said.cells is None
        else {
            "name": said.cells_name,
            **{key: _text(cells, key) for key in ("mode", "command", "version", "seed")},
            "light": _number(cells, "light"),
        },
        "levels": levels,
        "scene": None if restored is None else restored.scene,
    }


def design_schema() -> Document:
    """JSON Schema of :func:`design_document`."""
    text = {"type": ["string", "null"]}
    number = {"type": ["number", "null"]}
    photograph = closed_object({key: {"type": "number"} for key in ("psnr", "psnr_inner", "epsilon")})
    level = {
        "level_db": {"type": "number"},
        **dict.fromkeys(("stated_psnr", "head_room", "head_room_frame", "map_gain", "restored_psnr"), number),
        "photograph": or_null(photograph),
    }
    cells = {"name": text, **dict.fromkeys(("mode", "command", "version", "seed"), text), "light": number}
    return closed_object(
        {
            **dict.fromkeys(("shape", "command", "version", "seed", "protocol"), text),
            "evaluated": number,
            "dot_um": {"type": "number"},
            "rules_cost": number,
            "prices": {
                "type": "array",
                "items": closed_object({"rule": {"type": "string"}, "price": {"type": "number"}}),
            },
            "map": or_null(closed_object(cells)),
            "levels": {"type": "array", "items": closed_object(level)},
            "scene": text,
        }
    )


def _designed(facts: Facts) -> bool:
    return any(str(key) in _NAMES or str(key).startswith(_STARTS) for key in facts)


def _prices(facts: Facts) -> list[Document]:
    """Costs of the rules, in the order in which they are stated."""
    rules = {key: rule for key in map(str, facts) if (rule := priced_rule(key)) is not None}
    priced = [(rule, _number(facts, key)) for key, rule in list(rules.items())[:_MOST_PRICES]]
    return [{"rule": _plain(rule.replace("_", " ")), "price": price} for rule, price in priced if price is not None]


def _number(facts: Facts, key: str) -> float | int | None:
    value = facts.get(key)
    if isinstance(value, bool) or not isinstance(value, int | float) or not math.isfinite(value):
        return None
    return value


def _text(facts: Facts, key: str) -> str | None:
    value = facts.get(key)
    return None if value is None or isinstance(value, bool) else _plain(str(value)) or None


def _plain(text: str) -> str:
    """One short line that can be printed."""
    line = " ".join("".join(c if c.isprintable() else " " for c in text[: 2 * _MOST_CHARACTERS]).split())
    return line if len(line) <= _MOST_CHARACTERS else line[: _MOST_CHARACTERS - 1] + "…"


def photographs_document(taken: Photographs) -> Document:
    """Of all dies; PSNRs in dB, one for each scene in the order of ``scenes``."""
    scores = taken.table.scores
    return {
        **taken.conditions.to_dict(),
        "told": list(taken.conditions.lines),
        "reference": taken.reference,
        "reference_stated": taken.stated,
        "scenes": list(dict.fromkeys(score.scene for score in scores)),
        "dies": [
            {
                "name": name,
                "refused": die.refused,
                "left_out": list(die.left_out),
                "levels": [
                    {
                        "level_db": level,
                        "epsilon": own[0].epsilon,
                        "psnr": [score.psnr for score in own],
                        "psnr_inner": [score.psnr_inner for score in own],
                    }
                    for level in taken.conditions.levels
                    if (own := [score for score in die.scores if score.level_db == level])
                ],
            }
            for name, die in taken.dies.items()
        ],
    }


def photographs_schema() -> Document:
    """JSON Schema of :func:`photographs_document`."""
    text, number, flag = {"type": "string"}, {"type": "number"}, {"type": "boolean"}
    texts, numbers = {"type": "array", "items": text}, {"type": "array", "items": number}
    level = {"level_db": number, "epsilon": number, "psnr": numbers, "psnr_inner": numbers}
    die = {
        "name": text,
        "refused": {"type": ["string", "null"]},
        "left_out": texts,
        "levels": {"type": "array", "items": closed_object(level)},
    }
    sensor = {
        "full_well": number,
        "read_noise": number,
        "bits": {"type": ["integer", "null"]},
        "black_level": {"type": "integer"},
        "mosaic": {"enum": ["none", "rggb"]},
    }
    return closed_object(
        {
            "protocol": text,
            "camera": text,
            "sensor": closed_object(sensor),
            "light": text,
            "brackets": numbers,
            "linear": flag,
            "levels_db": numbers,
            "scene": {"type": "object", "additionalProperties": {}},
            "unused": texts,
            "told": texts,
            "reference": {"type": ["string", "null"], "description": "die that gains are over"},
            "reference_stated": {"type": ["string", "null"], "description": "the one that the job names"},
            "scenes": texts,
            "dies": {"type": "array", "items": closed_object(die)},
        }
    )
