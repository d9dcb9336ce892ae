"""The five verdicts on a plate: whether its files can be ordered and its numbers hold, and whether displays fit it,
look right and live long enough.

A report has a die that the others are compared with, often today's display, which may be meant to fail. Where there are
others, verdicts on displays count those, and tell of the reference in words.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import asdict, dataclass
from operator import attrgetter
from typing import Literal, TypeAlias

from maskfab.base.model import Quantity
from maskfab.base.quantities import Subject, registered
from maskfab.display.drive import BY_AREA
from maskfab.display.emitter_rules import Verdict
from maskfab.display.eye_and_life import Limited, kept
from maskfab.display.feasibility import Feasibility
from maskfab.mask.judge.awake import PLANTED

FITS, LOOKS, LIVES = "FITS", "LOOKS", "LIVES"
"""Verdicts on displays, by name."""
LimitVerdict: TypeAlias = Literal["KEPT", "BROKEN"]
KEPT: LimitVerdict = "KEPT"
BROKEN: LimitVerdict = "BROKEN"


@dataclass(frozen=True)
class Tally:
    """Checks of one subject."""

    checks: int
    failed: int

    @property
    def passed(self) -> bool | None:
        """Whether none failed; None where none was made."""
        return self.failed == 0 if self.checks else None


@dataclass(frozen=True)
class Displays:
    """Answers on the displays of a plate's dies.

    Attributes:
        dies: on the plate, less the reference where it is not counted; 0 where files alone were looked at.
        does_not_fit: dies whose display provably does not, or breaks a rule.
        unknown: dies for which neither is known.
        aside: words on the reference, where it is not counted.
    """

    dies: int
    fits: int
    does_not_fit: int
    unknown: int
    circuits: str = BY_AREA
    aside: str = ""

    @property
    def asked(self) -> bool:
        """Whether the job asks for displays."""
        return self.fits + self.does_not_fit + self.unknown > 0

    @property
    def verdict(self) -> Verdict | None:
        """The worst answer of all; None where none was asked for."""
        if not self.asked:
            return None
        if self.does_not_fit:
            return Verdict.DOES_NOT_FIT
        return Verdict.UNKNOWN if self.unknown else Verdict.FITS

    @property
    def words(self) -> str:
        """In words, with how circuits were judged."""
        if not self.asked:
            return "the job has no [emitters]" if self.dies else "maskfab check JOB tells what fits"
        rest = [(self.does_not_fit, "do not" if self.does_not_fit != 1 else "does not"), (self.unknown, "unknown")]
        counts = [f"{count} {words}" for count, words in rest if count]
        fit = "fits" if self.fits == 1 else "fit"
        return f"{', '.join([f'{self.fits} of {self.dies} {fit}', *counts])}; {self.circuits}{self.aside}"


@dataclass(frozen=True)
class Limits:
    """Limits of one kind, of the eye or of life, on the displays of a plate.

    Attributes:
        dies: whose displays were held against them, less the reference where it is not counted.
        stated: whether the job states any of them, which are else defaults.
        aside: words on the reference, where it is not counted.
    """

    dies: int
    kept: int
    stated: bool
    names: tuple[str, ...] = ()
    aside: str = ""

    @property
    def broken(self) -> int:
        """Dies that break one."""
        return self.dies - self.kept

    @property
    def verdict(self) -> LimitVerdict | None:
        """BROKEN if any die breaks one; None where there is nothing to judge."""
        if not self.dies:
            return None
        return BROKEN if self.broken else KEPT

    @property
    def words(self) -> str:
        """In words, with whose the limits are."""
        if not self.dies:
            return "nothing to hold against limits"
        whose = "limits of the job" if self.stated else "default limits, for the job states none"
        which = f": {', '.join(self.names)}" if self.names else ""
        keep = "keeps" if self.kept == 1 else "keep"
        return f"{self.kept} of {self.dies} {keep} them{which}; {whose}{self.aside}"


_OF_A_HOUSE = ("shop_", "manifest_shop")
"""Checks by the rules of a mask house, or of a package against its profile."""
NO_LIMITS = Limits(0, 0, stated=False)


@dataclass(frozen=True)
class Verdicts:
    """Findings on a plate, by subject: files by design and house; planted faults tried, empty if none."""

    files: Tally
    optics: Tally
    display: Displays
    looks: Limits = NO_LIMITS
    lives: Limits = NO_LIMITS
    house: bool = False
    tried: str = ""

    @classmethod
    def of(
        cls,
        checks: Iterable[Quantity],
        displays: Mapping[str, Feasibility],
        dies: int,
        reference: str | None = None,
        *,
        house: bool = False,
    ) -> Verdicts:
        """From the checks of a plate, and what was found of the displays of those of its ``dies`` that have one.

        Args:
            reference: die that the others are compared with, which is counted only where it is the only one.
            house: whether the rules of a mask house were asked elsewhere; else the checks tell.
        """
        judged = [check for check in checks if check.passed is not None]
        aside = displays.get(reference) if reference is not None and len(displays) > 1 else None
        counted = {name: display for name, display in displays.items() if aside is None or name != reference}
        answers = [feasibility.verdict for feasibility in counted.values()]
        fits, not_fitting, unknown = (
            answers.count(verdict) for verdict in (Verdict.FITS, Verdict.DOES_NOT_FIT, Verdict.UNKNOWN)
        )
        how = next((feasibility.circuits_by for feasibility in displays.values()), BY_AREA)
        said = "" if aside is None else f"; the reference {reference}: {aside.verdict.value}"
        found = Displays(dies - (aside is not None), fits, not_fitting, unknown, how, said)
        seen, lived = (
            _limits(
                [numbers_of(own) for display in counted.values() if (own := display.judged) is not None],
                () if aside is None or aside.judged is None else numbers_of(aside.judged),
                reference or "",
            )
            for numbers_of in (attrgetter("looks"), attrgetter("lives"))
        )
        asked = house or any(check.name.startswith(_OF_A_HOUSE) for check in judged)
        tried = "".join(
            f"; {check.value} of {check.limit} planted faults caught" for check in judged if check.name == PLANTED
        )
        return cls(_tally(judged, Subject.FILES), _tally(judged, Subject.OPTICS), found, seen, lived, asked, tried)

    @property
    def lines(self) -> tuple[str, ...]:
        """One line for each subject; one for all of displays where there is none to judge."""
        verdict = "NOT JUDGED" if self.display.verdict is None else self.display.verdict.value
        passes = "can be ordered" if self.house else "files check; no mask house chosen"
        seen, lived = (f"{limits.verdict or 'NOT JUDGED'}: {limits.words}" for limits in (self.looks, self.lives))
        displays = (f"{FITS}: {verdict}: {self.display.words}", f"{LOOKS}: {seen}", f"{LIVES}: {lived}")
        return (
            _line("FILES", self.files, (passes, "do not order")) + self.tried,
            _line("OPTICS", self.optics, ("proved from the files", "not proved")),
            *(displays if self.display.asked else (f"{FITS}, {LOOKS}, {LIVES}: NOT JUDGED: {self.display.words}",)),
        )

    def to_dict(self) -> dict[str, dict[str, int | bool | str | None]]:
        """As report.json has them."""
        verdict, display = self.display.verdict, asdict(self.display)
        circuits, _ = display.pop("circuits"), display.pop("aside")
        return {
            "files": {**asdict(self.files), "passed": self.files.passed},
            "optics": {**asdict(self.optics), "passed": self.optics.passed},
            "display": {
                **display,
                "verdict": None if verdict is None else verdict.value,
                **({} if verdict is None else {"circuits": circuits}),
            },
            **{
                name: {
                    "dies": limits.dies,
                    "kept": limits.kept,
                    "broken": limits.broken,
                    "verdict": limits.verdict,
                    "stated": limits.stated,
                }
                for name, limits in (("looks", self.looks), ("lives", self.lives))
            },
        }


def _limits(numbers: list[tuple[Limited, ...]], aside: tuple[Limited, ...], reference: str) -> Limits:
    """Count displays that keep their limits; ``aside`` are the numbers of the reference, which is not counted."""
    held = [own for own in numbers if own]
    said = f"; the reference {reference}: {KEPT if kept(aside) else BROKEN}" if aside else ""
    stated = any(number.stated for own in (*held, aside) for number in own)
    failed = (number for own in held for number in own if number.passed is False)
    broken = dict.fromkeys(f"{one.title} (a default)" if stated and not one.stated else one.title for one in failed)
    return Limits(len(held), sum(kept(own) for own in held), stated, tuple(broken), said)


def _tally(checks: Iterable[Quantity], subject: Subject) -> Tally:
    own = [check for check in checks if registered(check.name).subject is subject]
    return Tally(len(own), sum(check.passed is False for check in own))


def _line(name: str, tally: Tally, said: tuple[str, str]) -> str:
    if tally.passed is None:
        return f"{name}: NOT CHECKED"
    verdict, words = ("PASS", said[0]) if tally.passed else ("FAIL", said[1])
    return f"{name}: {verdict}, {words}: {tally.checks - tally.failed} of {tally.checks} checks pass"
