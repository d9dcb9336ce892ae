"""The table of photographs on the page, from report.json alone: who is best, and who cannot be told from it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from maskfab.camera.intervals import CONFIDENCE, MeanDifference
from maskfab.camera.left_out import by_sentence

Document = Mapping[str, Any]


@dataclass(frozen=True)
class Cell:
    """One die at one level of light.

    Attributes:
        psnr: mean over the scenes, whole frame, dB.
        gain: as :func:`gain_words` tells it.
        best: whether no other die is better for sure.
    """

    psnr: float
    gain: str
    best: bool


@dataclass(frozen=True)
class Table:
    """All dies.

    Attributes:
        levels_db: of light, one column each.
        rows: by die, its cells; none where it was refused.
        refused: by die, why it was not photographed.
        left_out: sentences, with the dies that each is about where these are not all.
        confidence: of the intervals, a share.
    """

    levels_db: Sequence[float]
    rows: Mapping[str, Sequence[Cell]]
    refused: Mapping[str, str]
    left_out: Sequence[str]
    confidence: float


def photograph_table(taken: Document) -> Table:
    """From the photographs of report.json."""
    levels: list[float] = taken["levels_db"]
    best = {level: best_photographed(taken, level) for level in levels}
    rows = {}
    for die in taken["dies"]:
        name = die["name"]
        rows[name] = [
            Cell(
                float(np.mean(own)),
                gain_words(taken, level, name),
                name in best[level],
            )
            for level in levels
            if (own := scores(taken, level).get(name)) is not None
        ]
    left_out = {die["name"]: die["left_out"] for die in taken["dies"] if not die["refused"]}
    refused = {die["name"]: die["refused"] for die in taken["dies"] if die["refused"]}
    return Table(levels, rows, refused, by_sentence(left_out), CONFIDENCE)


def best_photographed(taken: Document, level_db: float) -> frozenset[str]:
    """The die of the highest mean, and those whose difference to it is a tie; none where there is nothing to choose."""
    known = scores(taken, level_db)
    if len(known) < 2:
        return frozenset()
    first = max(known, key=lambda name: mean_psnr(taken, level_db, name))
    found = {name for name in known if name == first or difference(taken, level_db, name, first).tie}
    return frozenset(found) if len(found) < len(known) else frozenset()


def scores(taken: Document, level_db: float) -> dict[str, list[float]]:
    """PSNR of every photograph in dB, by die, of those that were photographed."""
    return {
        die["name"]: level["psnr"] for die in taken["dies"] for level in die["levels"] if level["level_db"] == level_db
    }


def mean_psnr(taken: Document, level_db: float, name: str) -> float:
    """Over the photographs of a die, in dB."""
    return float(np.mean(scores(taken, level_db)[name]))


def difference(taken: Document, level_db: float, name: str, other: str) -> MeanDifference:
    """Of two dies' photographs, scene by scene, in dB."""
    known = scores(taken, level_db)
    return MeanDifference.of([one - two for one, two in zip(known[name], known[other], strict=True)])


def gain_words(taken: Document, level_db: float, name: str) -> str:
    """The gain over the reference with its interval; a word where the die is the reference, or there is none."""
    reference = taken["reference"]
    if reference is None or name == reference:
        return "–" if reference is None else "reference"
    return difference(taken, level_db, name, reference).told("")
