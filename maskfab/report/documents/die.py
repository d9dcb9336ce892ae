"""Parts of a die in report.json: its design as files state it, and photographs through it.

Provenance is somebody else's text. What is missing or is no number is told as missing; numbers are never recomputed
from it, and nothing that is measured here depends on it.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Annotated, Any, Literal

from pydantic import Field, model_validator

from maskfab.base.model import Opening, Quantity
from maskfab.base.units import NM_PER_UM
from maskfab.camera.lens import F1, camera_line
from maskfab.designs.rules.rule import priced_rule
from maskfab.mask import panels
from maskfab.mask.job import Job
from maskfab.report.documents.shape import DieName, Document, Part, Text, written
from maskfab.report.rows.photographs import Photographs, Restored

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
    """Statements of files on dies whose opening or map was designed, by die."""
    statements = {}
    for die in job.spec.die:
        opening: Opening = job.openings[die.name][0]
        cells = None if die.map is None else panels.parse_map(job.spec.maps[die.map])
        facts = None if cells is None else cells.provenance
        if _designed(opening.provenance) or (facts is not None and _designed(facts)):
            statements[die.name] = Stated(opening.provenance, opening.dot_nm / NM_PER_UM, facts, die.map)
    return statements


def camera_notes(job: Job) -> dict[str, Quantity]:
    """Notes, by die, where its opening or its map was designed for another camera than the job's."""
    here = camera_line(job.camera)
    notes = {}
    for name, said in stated(job).items():
        others = [camera for camera in (_camera(said.opening), _camera(said.cells or {})) if camera not in (None, here)]
        if others:
            note = f"camera that this die was designed for; the job's is: {here}. What its files state holds there"
            notes[name] = Quantity("designed_for", _plain(str(others[0])), note, die=name)
    return notes


def _camera(facts: Facts) -> object:
    """The camera that a file was designed for; what states none was made for that of protocol F1, unless a descent for
    a camera that former versions did not name."""
    if "camera" in facts:
        return facts["camera"]
    return camera_line(F1) if facts.get("author") == "maskfab" and "loss" not in facts else None


class _Price(Part):
    rule: str
    price: float


class _Map(Part):
    name: str | None
    mode: str | None
    command: str | None
    version: str | None
    seed: str | None
    light: float | None


class _Shot(Part):
    psnr: float
    psnr_inner: float
    epsilon: float


class _DesignLevel(Part):
    level_db: float
    stated_psnr: float | None
    head_room: float | None
    head_room_frame: float | None
    map_gain: float | None
    restored_psnr: float | None
    photograph: _Shot | None


class DesignPart(Part):
    """One die's design; all PSNRs and their differences in dB."""

    shape: str | None
    command: str | None
    version: str | None
    seed: str | None
    protocol: str | None
    evaluated: float | None
    dot_um: float
    rules_cost: float | None
    prices: list[_Price]
    map: _Map | None
    levels: list[_DesignLevel]
    scene: str | None


def stated_design(said: Stated, levels_db: Sequence[float], restored: Restored | None = None) -> Document:
    """One die's design; all PSNRs and their differences in dB.

    Args:
        said: by its files.
        levels_db: of light.
        restored: photographs behind the die; None if it is not known.
    """
    opening, cells = said.opening, said.cells or {}
    shots = {} if restored is None else {shot.score.level_db: shot.score for shot in restored.shots}
    photographed = restored is not None and bool(restored.scores)
    texts = ("command", "version", "seed")
    rules = {key: rule for key in map(str, opening) if (rule := priced_rule(key)) is not None}
    prices = [(rule.replace("_", " "), _number(opening, key)) for key, rule in list(rules.items())[:_MOST_PRICES]]
    return DesignPart.document(
        restored,
        **{key: _text(opening, key) for key in ("shape", *texts, "protocol")},
        evaluated=_number(opening, "evaluated"),
        dot_um=said.dot_um,
        rules_cost=_number(opening, "rules_cost_db"),
        prices=[{"rule": _plain(rule), "price": price} for rule, price in prices if price is not None],
        map=None
        if said.cells is None
        else _Map.document(
            name=said.cells_name,
            **{key: _text(cells, key) for key in ("mode", *texts)},
            light=_number(cells, "light"),
        ),
        levels=[
            _DesignLevel.document(
                level_db=level,
                stated_psnr=_number(opening, f"expected_psnr_{level:g}"),
                head_room=_number(opening, f"head_room_{level:g}"),
                head_room_frame=_number(opening, f"head_room_frame_{level:g}"),
                map_gain=_number(cells, f"gain_db_{level:g}"),
                restored_psnr=restored.psnr(level) if restored is not None and photographed else None,
                photograph=_Shot.document(shots[level]) if level in shots else None,
            )
            for level in levels_db
        ],
    )


def _designed(facts: Facts) -> bool:
    return any(str(key) in _NAMES or str(key).startswith(_STARTS) for key in facts)


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


class _Level(Part):
    level_db: float
    epsilon: float = written()
    psnr: list[float]
    psnr_inner: list[float] = written()


class _PhotographedDie(Part):
    name: DieName
    refused: Text | None
    left_out: list[str] = written()
    levels: list[_Level]


class _Sensor(Part):
    full_well: float
    read_noise: float
    bits: int | None
    black_level: int
    mosaic: Literal["none", "rggb"]


class PhotographsPart(Part):
    """Photographs through all dies; PSNRs in dB, one for each scene in the order of ``scenes``."""

    protocol: str = written()
    camera: str = written()
    sensor: _Sensor = written()
    light: str = written()
    brackets: list[float] = written()
    linear: bool = written()
    levels_db: Annotated[list[float], Field(min_length=1)]
    scene: dict[str, Any] = written()
    unused: list[str] = written()
    told: list[str] = written()
    reference: DieName | None = Field(description="die that gains are over")
    reference_stated: str | None = written("the one that the job names")
    scenes: list[Text]
    dies: list[_PhotographedDie]

    @model_validator(mode="after")
    def _of_the_same_scenes(self) -> PhotographsPart:
        for die in self.dies:
            if die.refused is None and [level.level_db for level in die.levels] != self.levels_db:
                raise ValueError(f"die {die.name} has not the levels of light that the report has")
            if any(len(level.psnr) != len(self.scenes) for level in die.levels):
                raise ValueError(f"die {die.name} has not one number for each scene")
        if self.reference is not None and self.reference not in {die.name for die in self.dies}:
            raise ValueError(f"the reference {self.reference} has no photographs")
        return self


def photographs_document(taken: Photographs) -> Document:
    """Photographs: how they were taken, every score, and what they leave out."""

    def levels(die: Restored) -> list[Document]:
        rows = [
            (level, [score for score in die.scores if score.level_db == level]) for level in taken.conditions.levels
        ]
        return [
            _Level.document(
                level_db=level,
                epsilon=scores[0].epsilon,
                psnr=[score.psnr for score in scores],
                psnr_inner=[score.psnr_inner for score in scores],
            )
            for level, scores in rows
            if scores
        ]

    return {
        **taken.conditions.to_dict(),
        "told": list(taken.conditions.lines),
        "reference": taken.reference,
        "reference_stated": taken.stated,
        "scenes": list(dict.fromkeys(score.scene for score in taken.table.scores)),
        "dies": [
            _PhotographedDie.document(die, name=name, left_out=list(die.left_out), levels=levels(die))
            for name, die in taken.dies.items()
        ],
    }
