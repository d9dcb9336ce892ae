"""The design of a die's opening in report.json: as stated in its provenance, beside what was computed here.

Provenance is somebody else's text. What is missing or is no number is told as missing; numbers are never recomputed
from it, and nothing that is measured here depends on it.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from maskfab.camera.photo_camera import F1, camera_line
from maskfab.job import Job
from maskfab.measurement.restored import Restored
from maskfab.model import Opening, Quantity
from maskfab.optimiser.rules.rule import priced_rule
from maskfab.plate import maps
from maskfab.report.documents.schema_terms import closed_object, or_null
from maskfab.units import NM_PER_UM

Document = dict[str, Any]
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
        cells = None if die.map is None else maps.parse_map(job.spec.maps[die.map])
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
