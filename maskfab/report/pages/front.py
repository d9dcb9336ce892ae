"""The front of the report: three verdicts, the best die, how sure that is, and what its numbers assume."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Literal

from maskfab.base.errors import CATALOGUE
from maskfab.base.resources import explained
from maskfab.base.units import UM_PER_MM
from maskfab.camera.scores import CONFIDENCE, MeanDifference
from maskfab.display.emitter_rules import Verdict
from maskfab.report.documents.shape import Record
from maskfab.report.pages.tables import (
    band_of,
    die_table,
    difference,
    edges,
    mean_psnr,
    photograph_bands,
    scores,
    spread_words,
)
from maskfab.report.rows.photographs import middle_level
from maskfab.report.rows.text import short

Mood = Literal["good", "bad", "open"]

_FEW, _CHOSEN = 32, 16
"""Dies that a page shows with figures, all of them; and of more, for which it would be too large for a browser."""

_ADD = 'add a die as [[die]] to compare with, and name it in the job: [report] reference = "DIE"'


@dataclass(frozen=True)
class Stamp:
    """One verdict: of what, in a word, good or bad or open, and what it rests on."""

    name: str
    word: str
    mood: Mood
    basis: str

    @property
    def sign(self) -> str:
        """Tells it where colours do not."""
        return {"good": "✓", "bad": "✗", "open": "?"}[self.mood]


@dataclass(frozen=True)
class Best:
    """The die of the highest mean PSNR of restored photographs.

    Attributes:
        name, label: of it.
        level_db: of light.
        psnr: its mean, in dB.
        gain: over the reference; None where it is the reference, or there is none.
        reference: die that gains are over; None if there is none.
        stated: whether the job names the reference, which is else the first die.
        scenes: photographs of each die.
        others: dies that were photographed beside it.
        ties: dies that cannot be told from it.
        open_ratio: of the stop behind it, as a row of the report.
        display: verdict on its display; None if none was asked for.
        psnr_made, gain_made, open_ratio_made: bands over the displays made; empty without.
        missing: what is needed for a gain; empty where there is one.
    """

    name: str
    label: str
    level_db: float
    psnr: float
    gain: MeanDifference | None
    reference: str | None
    stated: bool
    scenes: int
    others: int
    ties: tuple[str, ...]
    open_ratio: Record | None
    display: str | None
    missing: str
    psnr_made: str
    gain_made: str
    open_ratio_made: str

    @property
    def shown(self) -> tuple[str, ...]:
        """The reference, if there is one, and the best die: those whose pictures stand for all."""
        return tuple(dict.fromkeys(name for name in (self.reference, self.name) if name is not None))

    @property
    def gain_words(self) -> str:
        """Interval and photographs of the gain, in words."""
        if self.gain is None:
            return ""
        count = f"{self.scenes} photographs" if self.scenes > 1 else "one photograph, which gives no interval"
        how = f"{100 * CONFIDENCE:g} % interval by Student's t of the paired differences over "
        sure = how if self.scenes > 1 else ""
        tie = "; a tie, for the interval holds 0" if self.scenes > 1 and self.gain.tie else ""
        return f"{sure}{count}, at {self.level_db:g} dB of light{tie}"

    @property
    def tie_words(self) -> str:
        """Dies that may be as good, in words."""
        if not self.others:
            return ""
        if not self.ties:
            return "Every other die is worse: no interval of its paired difference holds 0."
        who = "all other dies" if len(self.ties) == self.others and self.others > 1 else ", ".join(self.ties)
        worse = self.others - len(self.ties)
        rest = f" The other {f'{worse} dies are' if worse > 1 else 'die is'} worse." if worse else ""
        how = f"the {100 * CONFIDENCE:g} % interval of the paired difference includes 0"
        they = "It" if len(self.ties) == 1 else "They"
        return f"Tied with it: {who}. {they} may be as good, for {how}.{rest}"


def stamps(document: Record) -> tuple[Stamp, Stamp, Stamp]:
    """Verdicts on files, optics and displays."""
    verdicts = document["verdicts"]
    shops = sorted({row["name"] for row in document["checks"] if row["name"].startswith("shop_")})
    house = f"{len(shops)} rules of the mask house" if shops else "no mask house chosen"
    return (
        _of_checks("FILES", verdicts["files"], ("CAN BE ORDERED", "DO NOT ORDER"), f"; {house}"),
        _of_checks("OPTICS", verdicts["optics"], ("PROVED", "NOT PROVED"), " on the files read back"),
        _of_displays(verdicts["display"]),
    )


def best(document: Record) -> Best | str:
    """The best die; in its place a sentence that says what is missing, and what to add."""
    taken = document.get("photographs")
    if taken is None or not document["dies"]:
        return "No photographs: the plate has no die that could be photographed. Add one as [[die]]."
    level = middle_level(taken["levels_db"])
    by_die = scores(taken, level)
    if not by_die:
        return f"No photographs: {_refusal(next(die['refused'] for die in taken['dies']))}"
    name = max(by_die, key=lambda candidate: mean_psnr(taken, level, candidate))
    die = next(row for row in document["dies"] if row["name"] == name)
    reference, stated = taken["reference"], taken["reference_stated"]
    compared = reference is not None and reference != name
    open_ratio = next((row for row in die["quantities"] if row["name"] == "stop_open_ratio"), None)
    psnr_made, gain_made = photograph_bands(die, level)
    return Best(
        name=name,
        label=die["label"],
        level_db=level,
        psnr=mean_psnr(taken, level, name),
        gain=difference(taken, level, name, reference) if compared else None,
        reference=reference,
        stated=stated is not None,
        scenes=len(taken["scenes"]),
        others=len(by_die) - 1,
        ties=tuple(other for other in by_die if other != name and difference(taken, level, other, name).tie),
        open_ratio=open_ratio,
        display=die["display"]["verdict"] if "display" in die else None,
        missing=_missing(taken, name, len(by_die)),
        psnr_made=psnr_made,
        gain_made=gain_made,
        open_ratio_made="" if open_ratio is None else edges(band_of(die, open_ratio)),
    )


def shown_count(dies: int) -> int:
    """Dies of so many that the page shows with figures."""
    return dies if dies <= _FEW else _CHOSEN


def shown_dies(document: Record) -> tuple[str, ...]:
    """Dies that the page shows with figures and all their numbers: all, or of more than 32 the reference and the best,
    then those that failed a check, then those that photographs find best."""
    names: list[str] = [die["name"] for die in document["dies"]]
    if (count := shown_count(len(names))) == len(names):
        return tuple(names)
    leader = best(document)
    failed = {check["die"] for check in document["checks"] if not check["passed"] and "die" in check}
    first = () if isinstance(leader, str) else leader.shown
    ranked = [line.name for line in die_table(document).lines]
    chosen = list(dict.fromkeys([*first, *(name for name in names if name in failed), *ranked]))[:count]
    return tuple(name for name in names if name in chosen)


def assumed(document: Record) -> str:
    """Camera, light, spectrum and restorer that the numbers of the front rest on, in one line."""
    camera = document["camera"]
    focal, stop = camera["focal_um"], camera["stop"]["diameter_um"]
    lines = ", ".join(f"{line:g}" for line in camera["wavelengths_nm"])
    lens = f"f = {short(focal / UM_PER_MM)} mm, f/{short(focal / stop, 2)}"
    said = [f"camera: {lens}, pixel {short(camera['pixel_um'])} µm"]
    taken = document.get("photographs")
    if taken is None:
        return f"Assumed: {'; '.join([*said, f'spectrum: lines of {lines} nm', spread_words(document)])}."
    scene = taken["scene"]
    said += [sentence for sentence in taken["told"] if sentence.startswith(("sensor", "light"))]
    spectrum = f"as [scene] says ({scene['spectrum']})" if "spectrum" in scene else f"lines of {lines} nm"
    said += [f"spectrum: {spectrum}", "restorer: Wiener filter", f"{len(taken['scenes'])} drawn scenes"]
    rest = [key for key in scene if key not in {"spectrum", "accuracy"}]
    said.append(f"[scene]: {', '.join(rest)}" if rest else "objects in focus, on the axis")
    said.append(spread_words(document))
    return f"Assumed: {'; '.join(said)}."


def crops(document: Record, leader: Best | str) -> Iterator[tuple[str, str]]:
    """Dies whose restored photograph the front shows, each with its caption."""
    if isinstance(leader, str):
        return
    taken = document["photographs"]
    for name in leader.shown:
        role = "reference" if name == leader.reference else "best"
        yield name, f"{name} ({role}): {scores(taken, leader.level_db)[name][0]:.1f} dB"


def _of_checks(name: str, tally: Record, words: tuple[str, str], rest: str) -> Stamp:
    if tally["passed"] is None:
        return Stamp(name, "NOT CHECKED", "open", "no check was made")
    if tally["passed"]:
        return Stamp(name, words[0], "good", f"{tally['checks']} checks pass{rest}")
    return Stamp(name, words[1], "bad", f"{tally['failed']} of {tally['checks']} checks failed{rest}")


def _of_displays(counts: Record) -> Stamp:
    verdict, dies = counts["verdict"], counts["dies"]
    if verdict is None:
        return Stamp("DISPLAY", "NOT JUDGED", "open", "the job has no [emitters]")
    circuits = [counts["circuits"]] if "circuits" in counts else []
    rest = [
        f"{number} {words[number != 1]}"
        for key, words in (("does_not_fit", ("does not fit", "do not fit")), ("unknown", ("is unknown", "are unknown")))
        if (number := counts[key])
    ]
    if verdict == Verdict.FITS:
        return Stamp("DISPLAY", "FITS", "good", "; ".join([f"on {counts['fits']} of {dies} dies", *circuits]))
    mood: Mood = "bad" if verdict == Verdict.DOES_NOT_FIT else "open"
    return Stamp("DISPLAY", f"{counts['fits']} OF {dies} FIT", mood, "; ".join([", ".join(rest), *circuits]))


def _missing(taken: Record, name: str, photographed: int) -> str:
    stated = taken["reference_stated"]
    if taken["reference"] is None and stated is not None:
        why = next(die["refused"] for die in taken["dies"] if die["name"] == stated)
        return f"No gain: the reference {stated} was not photographed. {_refusal(why)}"
    if photographed == 1:
        return f"No gain, for no other die was photographed: {_ADD}."
    if taken["reference"] == name:
        return "It is the reference itself: no die has a higher mean."
    return ""


def _refusal(why: str) -> str:
    """A refusal with its cure."""
    code, _, what = why.partition(" ")
    return f"{what}. {explained(code).cure}" if code in CATALOGUE else f"{why}."
