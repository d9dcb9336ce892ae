"""Parts of a die in report.json: its design as files state it, photographs through it, and what was measured of it.

Provenance is somebody else's text. What is missing or is no number is told as missing; numbers are never recomputed
from it, and nothing that is measured here depends on it.

A measure.json that lies beside a job is a file from outside too. What does not read as a measurement is refused before
any work; one of an edge, or of another job, is left out, the latter with a note.
"""

from __future__ import annotations

import json
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any, Literal

import numpy as np
from pydantic import Field, ValidationError, model_validator

from maskfab.base.errors import SourceError
from maskfab.base.model import Opening, Quantity
from maskfab.base.units import NM_PER_UM
from maskfab.camera.stop_cells import F1, camera_line
from maskfab.designs.rules.rule import priced_rule
from maskfab.findings.photographs import Photographs, Restored
from maskfab.mask import panels
from maskfab.mask.job import Job
from maskfab.report.documents.shape import DieName, Document, Part, Text, optional, written
from maskfab.report.text import USEFUL_DB

Facts = Mapping[str, object]

_NAMES = frozenset({"shape", "rules_cost_db", "evaluated"})
_STARTS = ("expected_psnr_", "head_room_", "price_", "gain_db_")
_MOST_CHARACTERS = 300
_MOST_PRICES = 40


@dataclass(frozen=True)
class Stated:
    """Design facts stated in the files of one die; ``cells`` is its map's provenance, None if it has none."""

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
    """One die's design, PSNRs and their differences in dB; ``restored`` behind the die, None if not known."""
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
            name=said.cells_name, **{key: _text(cells, key) for key in ("mode", *texts)}, light=_number(cells, "light")
        ),
        levels=[
            _DesignLevel.document(
                level_db=level,
                stated_psnr=_number(opening, f"expected_psnr_{level:g}"),
                head_room=_useful(_number(opening, f"head_room_{level:g}")),
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


def _useful(head_room: float | None) -> float | None:
    return None if head_room is None or head_room > USEFUL_DB else head_room


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
    gain: float | None = optional("analog gain over base gain; stated, as all that follow")
    iso: float | None = optional()
    base_iso: float | None = optional()
    max_gain: float | None = optional()
    converter_noise: float | None = optional()
    banding: float | None = optional()


class PhotographsPart(Part):
    """Photographs through all dies; PSNRs in dB, one for each scene in the order of ``scenes``."""

    protocol: str = written()
    camera: str = written()
    sensor: _Sensor = written()
    light: str = written()
    brackets: list[float] = written()
    linear: bool = written()
    levels_db: Annotated[list[float], Field(min_length=1)]
    analog_gains: list[float] | None = optional("those that the levels pick behind the published display")
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


DOCUMENT = "measure.json"
_MOST_BYTES = 50_000_000
_CURVES = ("captured", "expected", "low", "high")
_OF_A_DIE = "hypotheses"
"""Key that measurements of a die have, and those of an edge do not."""


class _MtfRow(Part):
    colour: str
    frequency_cy_per_mm: float
    captured: float
    expected: float
    low: float
    high: float


class MeasuredPart(Part):
    """The measurement of a die in report.json."""

    verdict: list[str]
    mtf: list[_MtfRow]


class _Curve(Part):
    minimum: list[float]


class _Band(Part):
    colour: Annotated[str, Field(max_length=40)]
    frequency_per_mm: Annotated[list[float], Field(min_length=2)]
    captured: _Curve
    expected: _Curve
    low: _Curve
    high: _Curve

    @model_validator(mode="after")
    def _of_one_length(self) -> _Band:
        rings = self.frequency_per_mm
        if any(len(getattr(self, name).minimum) != len(rings) for name in _CURVES) or np.any(np.diff(rings) <= 0):
            raise ValueError("curves and their rising frequencies differ in number")
        return self


_Sentence = Annotated[str, Field(max_length=2000)]


class _Verdict(Part):
    answer: Literal["ACCEPT", "REJECT", "CANNOT TELL"]
    reason: _Sentence


class _Measured(Part):
    job_hash: str
    die: str | None
    verdict: _Verdict
    sentences: list[_Sentence]
    mtf: list[_Band]


@dataclass(frozen=True)
class Beside:
    """The measurement that lies beside a job.

    Attributes:
        die: that it is of; None if that could not be told.
        verdict: sentences on it, the answer first.
        rows: by colour and frequency, the MTF in its worst direction as captured and as expected.
    """

    content: bytes
    job_hash: str
    die: str | None
    verdict: tuple[str, ...]
    rows: tuple[Document, ...]

    def of_die(self, name: str, digest: str) -> Document | None:
        """Part of the report of a die; None of any but the one that was measured, and of another job."""
        if name != self.die or digest != self.job_hash:
            return None
        return MeasuredPart.document(self, verdict=list(self.verdict), mtf=list(self.rows))

    def note(self, digest: str) -> tuple[Quantity, ...]:
        """Why it is left out, where it is."""
        if digest == self.job_hash and self.die is not None:
            return ()
        why = "it is of another job" if digest != self.job_hash else "it could not tell which die it is of"
        return (Quantity("measurement_left_out", why, f"{DOCUMENT} beside the job is not shown with a die"),)


def measured_beside(job: Job) -> Beside | None:
    """The measurement of a die beside the job's file; None if there is none. Raises SourceError MF303 for a file of
    that name that is damaged, or larger than 50 MB."""
    path = Path(job.where).parent / DOCUMENT
    if not (Path(job.where).is_file() and path.is_file()):
        return None
    try:
        if path.stat().st_size > _MOST_BYTES:
            raise ValueError(f"it is larger than {_MOST_BYTES / 1e6:g} MB")
        content = path.read_bytes()
        document = json.loads(content)
        if not isinstance(document, dict):
            raise TypeError("it is no table")
        if _OF_A_DIE not in document:
            return None
        measured = _Measured.model_validate(document)
    except (OSError, ValueError, TypeError, RecursionError) as error:
        reason = error.errors()[0]["msg"] if isinstance(error, ValidationError) else str(error)
        what = f"{path} cannot be read as a measurement: {reason[:200]}"
        cure = "Measure the plate again with maskfab measure, or move the file out of the job's folder"
        raise SourceError("MF303", what, where=str(path), cure=cure) from error
    rows = [row for band in measured.mtf for row in _rows(band, job.spec.frequencies_cy_per_mm)]
    said = f"{measured.verdict.answer}: {measured.verdict.reason}", *measured.sentences
    return Beside(content, measured.job_hash, measured.die, said, tuple(rows))


def _rows(band: _Band, frequencies_cy_per_mm: tuple[float, ...]) -> list[Document]:
    rings = band.frequency_per_mm
    return [
        {
            "colour": band.colour,
            "frequency_cy_per_mm": frequency,
            **{name: float(np.interp(frequency, rings, getattr(band, name).minimum)) for name in _CURVES},
        }
        for frequency in frequencies_cy_per_mm
        if rings[0] <= frequency <= rings[-1]
    ]
