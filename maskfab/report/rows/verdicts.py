"""The three verdicts on a plate: whether it can be ordered, whether its numbers hold, and whether displays fit it."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import asdict, dataclass

from maskfab.base.model import Quantity
from maskfab.base.quantities import Subject, registered
from maskfab.display.drive import BY_AREA
from maskfab.display.emitter_rules import Verdict
from maskfab.display.feasibility import Feasibility


@dataclass(frozen=True)
class Tally:
    """Checks of one subject.

    Attributes:
        checks: how many were made.
        failed: how many of them failed.
    """

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
        dies: on the plate; 0 where files alone were looked at.
        fits: dies whose display fits.
        does_not_fit: dies whose display provably does not, or breaks a rule.
        unknown: dies for which neither is known.
        circuits: how those of displays were judged.
    """

    dies: int
    fits: int
    does_not_fit: int
    unknown: int
    circuits: str = BY_AREA

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
        return f"{', '.join([f'{self.fits} of {self.dies} {fit}', *counts])}; {self.circuits}"


@dataclass(frozen=True)
class Verdicts:
    """Findings on a plate, by subject.

    Attributes:
        files: checks of the files, against the design and against a mask house's rules.
        optics: checks of what was measured in the files.
        display: what fits.
    """

    files: Tally
    optics: Tally
    display: Displays

    @classmethod
    def of(cls, checks: Iterable[Quantity], displays: Mapping[str, Feasibility], dies: int) -> Verdicts:
        """From the checks of a plate, and what was found of the displays of those of its ``dies`` that have one."""
        judged = [check for check in checks if check.passed is not None]
        answers = [feasibility.verdict for feasibility in displays.values()]
        fits, not_fitting, unknown = (
            answers.count(verdict) for verdict in (Verdict.FITS, Verdict.DOES_NOT_FIT, Verdict.UNKNOWN)
        )
        how = next((feasibility.circuits_by for feasibility in displays.values()), BY_AREA)
        found = Displays(dies, fits, not_fitting, unknown, how)
        return cls(_tally(judged, Subject.FILES), _tally(judged, Subject.OPTICS), found)

    @property
    def lines(self) -> tuple[str, str, str]:
        """One line for each subject."""
        verdict = "NOT JUDGED" if self.display.verdict is None else self.display.verdict.value
        return (
            _line("FILES", self.files, ("can be ordered", "do not order")),
            _line("OPTICS", self.optics, ("proved from the files", "not proved")),
            f"DISPLAY: {verdict}: {self.display.words}",
        )

    def to_dict(self) -> dict[str, dict[str, int | bool | str | None]]:
        """As report.json has them."""
        verdict, display = self.display.verdict, asdict(self.display)
        circuits = display.pop("circuits")
        return {
            "files": {**asdict(self.files), "passed": self.files.passed},
            "optics": {**asdict(self.optics), "passed": self.optics.passed},
            "display": {
                **display,
                "verdict": None if verdict is None else verdict.value,
                **({} if verdict is None else {"circuits": circuits}),
            },
        }


def _tally(checks: Iterable[Quantity], subject: Subject) -> Tally:
    own = [check for check in checks if registered(check.name).subject is subject]
    return Tally(len(own), sum(check.passed is False for check in own))


def _line(name: str, tally: Tally, said: tuple[str, str]) -> str:
    if tally.passed is None:
        return f"{name}: NOT CHECKED"
    verdict, words = ("PASS", said[0]) if tally.passed else ("FAIL", said[1])
    return f"{name}: {verdict}, {words}: {tally.checks - tally.failed} of {tally.checks} checks pass"
