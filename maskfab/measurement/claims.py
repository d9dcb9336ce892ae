"""Claims of a study, held against its numbers: each agrees, does not, or cannot be told from so many photographs."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from enum import StrEnum
from itertools import product

from maskfab.camera.intervals import MeanDifference
from maskfab.camera.scores import Score
from maskfab.jobfile import ClaimSection

OPTICAL = frozenset({"auc_radial_min", "open_ratio", "psf_difference"})
"""Measures that need no photographs."""


class Verdict(StrEnum):
    """Outcome of a claim."""

    AGREES = "agrees"
    DISAGREES = "does not agree"
    OPEN = "cannot be told"


def verdict(found: MeanDifference, at_least: float | None, at_most: float | None) -> Verdict:
    """Whether an interval lies within limits, outside them, or across one; across one too where it is not known."""
    if math.isnan(found.half_width):
        return Verdict.OPEN
    least, most = -math.inf if at_least is None else at_least, math.inf if at_most is None else at_most
    low, high = found.mean - found.half_width, found.mean + found.half_width
    if least <= low and high <= most:
        return Verdict.AGREES
    return Verdict.DISAGREES if high < least or most < low else Verdict.OPEN


def worst(verdicts: Sequence[Verdict]) -> Verdict:
    """Of several that must all agree."""
    order = (Verdict.DISAGREES, Verdict.OPEN, Verdict.AGREES)
    return min(verdicts, key=order.index)


@dataclass(frozen=True)
class Take:
    """Everything that a score is of, but for the scene."""

    protocol: str
    case: str
    die: str
    level_db: float
    restorer: str


@dataclass(frozen=True)
class Finding:
    """A number that a claim is about.

    Attributes:
        of: the photographs, or the die alone for a number of the optics.
        over: those that they are compared with; None for a number that stands alone.
        wavelength_nm: of a number of the optics.
        found: the mean difference, or mean, with its 95 % interval; of the optics, with its error, and no photographs.
        verdict: of the claim's limits.
    """

    of: Take
    over: Take | None
    wavelength_nm: float | None
    found: MeanDifference
    verdict: Verdict


@dataclass(frozen=True)
class Claim:
    """A claim and its numbers."""

    stated: ClaimSection
    findings: tuple[Finding, ...]

    @property
    def verdicts(self) -> Mapping[str, Verdict]:
        """By protocol; of the optics under an empty name."""
        names = dict.fromkeys(each.of.protocol for each in self.findings)
        return {name: worst([each.verdict for each in self.findings if each.of.protocol == name]) for name in names}


def pairs(claim: ClaimSection) -> Iterator[tuple[str, str | None]]:
    """Every die of a claim with the one that it is compared with."""
    over: Sequence[str | None] = claim.over or (None,)
    yield from zip(claim.die, over if len(over) == len(claim.die) else [over[0]] * len(claim.die), strict=True)


def of_photographs(claim: ClaimSection, scores: Mapping[Take, Sequence[Score]]) -> Claim:
    """A claim about scores, for everything that it does not name."""
    findings = []
    kinds = [
        dict.fromkeys(getattr(take, key) for take in scores) for key in ("protocol", "case", "level_db", "restorer")
    ]
    asked = (
        claim.protocols or kinds[0],
        kinds[1] if claim.case is None else (claim.case,),
        claim.levels or kinds[2],
        kinds[3] if claim.restorer is None else (claim.restorer,),
    )
    for (die, over), protocol, case, level, restorer in product(pairs(claim), *asked):
        take = Take(protocol, case, die, level, restorer)
        if take not in scores:
            continue
        other = Take(protocol, claim.over_case or case, over or die, level, claim.over_restorer or restorer)
        mine = [getattr(each, claim.measure) for each in scores[take]]
        if other != take:
            mine = [a - getattr(b, claim.measure) for a, b in zip(mine, scores[other], strict=True)]
        found = MeanDifference.of(mine)
        judged = verdict(found, claim.at_least, claim.at_most)
        findings.append(Finding(take, None if other == take else other, None, found, judged))
    return Claim(claim, tuple(findings))


def of_optics(claim: ClaimSection, numbers: Mapping[tuple[str, float | None], tuple[float, float]]) -> Claim:
    """A claim about numbers of the optics.

    Args:
        claim: about one of :data:`OPTICAL`, but for the difference of PSFs.
        numbers: value and error, by die and wavelength.
    """
    findings = []
    for die, over in pairs(claim):
        for (name, wavelength), (value, error) in numbers.items():
            if name != die:
                continue
            base, more = (0.0, 0.0) if over is None else numbers[over, wavelength]
            findings.append(
                finding_of_optics(claim, die, over, wavelength, MeanDifference(value - base, error + more, 0))
            )
    return Claim(claim, tuple(findings))


def finding_of_optics(
    claim: ClaimSection, die: str, over: str | None, wavelength_nm: float | None, found: MeanDifference
) -> Finding:
    """One number of the optics, judged."""
    mine, other = (None if name is None else Take("", "", name, math.nan, "") for name in (die, over))
    assert mine is not None
    return Finding(mine, other, wavelength_nm, found, verdict(found, claim.at_least, claim.at_most))
