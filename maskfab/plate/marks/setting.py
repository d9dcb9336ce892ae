"""Texts of the marks, and the sizes they are laid out to."""

from __future__ import annotations

from dataclasses import dataclass

from maskfab.model import Die


@dataclass(frozen=True, eq=False)
class Setting:
    """A plate before its marks.

    Attributes:
        title: of the plate.
        signature: who made it from what.
        digest: hexadecimal hash of the resolved job.
        blank_nm: side of the blank.
        writable_nm: side of the writable area.
        die_pitch_nm: from die to die.
        dies: at their places.
        feature_nm: the smallest feature, of which test figures are multiples.
    """

    title: str
    signature: str
    digest: str
    blank_nm: int
    writable_nm: int
    die_pitch_nm: int
    dies: tuple[Die, ...]
    feature_nm: int
