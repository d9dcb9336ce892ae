"""Limits of displays, as report.json tells them: which verdicts a die breaks and by which number.

A display is held against three verdicts: FITS, whether it can be placed and wired; LOOKS, limits of the eye; LIVES,
limits of life and power. A die that breaks one is never called best. Documents of earlier versions lack the last two.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from types import MappingProxyType

from maskfab.display.emitter_rules import Verdict
from maskfab.display.eye_and_life import AT_LEAST, TITLES
from maskfab.report.documents.shape import Record
from maskfab.report.text import rounded, short
from maskfab.report.verdicts import BROKEN, FITS, LIVES, LOOKS

_PARTS: Mapping[str, str] = MappingProxyType({LOOKS: "looks", LIVES: "lives"})
NOTHING = 1e-9
"""Of contrast, and of colour differences, which floating point makes of displays that are even."""


@dataclass(frozen=True)
class LimitLine:
    """One number of a display beside the maker's layout and its limit, "" for none; None if none is required."""

    verdict: str
    name: str
    title: str
    value: str
    reference: str
    limit: str
    unit: str
    source: str
    stated: bool
    passed: bool | None

    @property
    def sentence(self) -> str:
        """In words, of one that breaks its limit."""
        return f"{self.title} {self.value}, limit {self.limit}" if self.limit else self.value


def limit_lines(die: Record) -> tuple[LimitLine, ...]:
    """Every number of a die's display that a verdict rests on, FITS first; none for a die without a display."""
    display = die.get("display")
    if display is None:
        return ()
    fits = display["verdict"]
    share = 100 * float(display["share"])
    maker = display.get("reference", {}).get("emitter_share")
    verdict = LimitLine(FITS, "fits", "placed and wired", fits.lower(), "", "", "1", "", True, fits == Verdict.FITS)
    emitters = LimitLine(
        FITS,
        "emitters",
        "emitters",
        f"{share:.1f}",
        "" if maker is None else f"{100 * maker:.1f}",
        f"≥ {short(100 * display['required'])}" if display["required"] else "",
        "%",
        "keep of [emitters]" if display["required"] else "",
        True,
        display["share"] >= display["required"] - 1e-12 if display["required"] else None,
    )
    more = [
        _line(verdict, number)
        for verdict, part in _PARTS.items()
        for number in (display.get(part) or {}).get("numbers", ())
    ]
    return (verdict, emitters, *more)


def _line(verdict: str, number: Record) -> LimitLine:
    bound, side = number["limit"], "≥" if number["name"] in AT_LEAST else "≤"
    return LimitLine(
        verdict,
        number["name"],
        TITLES.get(number["name"], number["name"].replace("_", " ")),
        _three_digits(number["value"]),
        _three_digits(number["reference"]),
        "" if bound is None else f"{side} {short(bound, 3)}",
        number["unit"],
        number["source"],
        bool(number["stated"]),
        number["passed"],
    )


def _three_digits(value: float | None) -> str:
    """To three digits: what an eye tells apart, or a lifetime, is not known better. Rounding alone is nothing."""
    return "" if value is None else "0" if abs(value) < NOTHING else rounded(float(value), 3)


def broken(die: Record) -> tuple[str, ...]:
    """Verdicts that a die's display does not keep; none for a die without a display.

    A display of which it is not known whether it fits does not keep FITS: nobody can promise it.
    """
    display = die.get("display")
    if display is None:
        return ()
    names = [FITS] if display["verdict"] != Verdict.FITS else []
    names += [name for name, part in _PARTS.items() if (display.get(part) or {}).get("verdict") == BROKEN]
    return tuple(names)


def judged_verdicts(die: Record) -> tuple[str, ...]:
    """Verdicts that a die's display has."""
    display = die.get("display")
    if display is None:
        return ()
    return (FITS, *(name for name, part in _PARTS.items() if (display.get(part) or {}).get("verdict")))


def breaches(die: Record, verdicts: Sequence[str] = (FITS, LOOKS, LIVES)) -> tuple[LimitLine, ...]:
    """Numbers by which a die's display breaks some verdicts."""
    return tuple(line for line in limit_lines(die) if line.passed is False and line.verdict in verdicts)


def breach_words(lines: Sequence[LimitLine]) -> str:
    """Limits that some numbers break, by verdict, and whose the limits are."""
    words = [
        f"{name} ({'; '.join(line.sentence for line in lines if line.verdict == name)})"
        for name in dict.fromkeys(line.verdict for line in lines)
    ]
    limits = [line.stated for line in lines if line.limit]
    whose = "" if all(limits) else "; these limits are defaults" if not any(limits) else "; some limits are defaults"
    return (" and ".join([", ".join(words[:-1]), words[-1]] if len(words) > 1 else words)) + whose
