"""Photographs through the dies of a plate in report.json: how they were taken, every score, and what they leave out."""

from __future__ import annotations

from typing import Any

from maskfab.measurement.restored import Photographs
from maskfab.report.documents.schema_terms import closed_object

Document = dict[str, Any]


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
