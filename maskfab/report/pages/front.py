"""The front of the report: five verdicts, the best die, how sure that is, and what its numbers assume."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from types import MappingProxyType
from typing import Literal

from maskfab.base.errors import catalogue
from maskfab.base.resources import explained
from maskfab.base.units import UM_PER_MM
from maskfab.camera.scores import CONFIDENCE, MeanDifference
from maskfab.findings.photographs import middle_level
from maskfab.mask.judge.awake import PLANTED
from maskfab.report.documents.shape import Record
from maskfab.report.pages.breaches import breach_words, breaches, broken, judged_verdicts
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
from maskfab.report.text import short
from maskfab.report.verdicts import FITS, LIVES, LOOKS

Mood = Literal["good", "bad", "some", "open"]

_FEW, _CHOSEN = 32, 16
"""Dies that a page shows with figures, all of them; and of more, for which it would be too large for a browser."""
_MOST_NAMED = 2
"""Dies that a stamp names."""

_VERDICTS = (FITS, LOOKS, LIVES)
_KEEPS = MappingProxyType({FITS: "fits", LOOKS: "looks right", LIVES: "lives long enough"})
_LESS = 1 - 10**-0.1
"""Of the mean squared error, by which a decibel is less."""

_ADD = 'add a die as [[die]] to compare with, and name it in the job: [report] reference = "DIE"'


@dataclass(frozen=True)
class Stamp:
    """One verdict: of what, in a word, good or bad, of some dies alone, or open, and what it rests on."""

    name: str
    word: str
    mood: Mood
    basis: str

    @property
    def sign(self) -> str:
        """Tells it where colours do not."""
        return {"good": "✓", "bad": "✗", "some": "◐", "open": "?"}[self.mood]


@dataclass(frozen=True)
class Best:
    """The die of the highest mean PSNR of restored photographs, of those whose display keeps every limit.

    Where no die keeps all, it is the best without the verdicts that bind, and is not called best.

    Attributes:
        gain: over the reference; None where it is the reference, or there is none.
        reference: die that gains are over; None if there is none.
        stated: whether the job names the reference, which is else the first die.
        others: dies that it was chosen from, without itself.
        ties: of these, dies that cannot be told from it.
        open_ratio: of the stop behind it, as a row of the report.
        broken: verdicts that it breaks; empty unless no die keeps all.
        limits: what the limits cost, or which of them bind, in words; empty without displays.
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
    scenes: tuple[str, ...]
    others: int
    ties: tuple[str, ...]
    open_ratio: Record | None
    broken: tuple[str, ...]
    limits: str
    missing: str
    psnr_made: str
    gain_made: str
    open_ratio_made: str

    @property
    def shown(self) -> tuple[str, ...]:
        """The reference, if there is one, and the best die: those whose pictures stand for all."""
        return tuple(dict.fromkeys(name for name in (self.reference, self.name) if name is not None))

    @property
    def heading(self) -> str:
        """In place of its title: a die that breaks a limit is the best of none."""
        return "Best die" if not self.broken else f"No die keeps all limits; the best without {_and(self.broken)}"

    @property
    def of_scenes(self) -> str:
        """The photographs of its mean, in words."""
        count = len(self.scenes)
        return f"mean of {count} scenes" if count > 1 else f"one scene, {self.scenes[0]}"

    @property
    def gain_words(self) -> str:
        """Interval and photographs of the gain, in words."""
        if self.gain is None:
            return ""
        count = len(self.scenes)
        how = f"{100 * CONFIDENCE:g} % interval by Student's t of the paired differences over {count} scenes"
        sure = how if count > 1 else "one photograph, which gives no interval"
        tie = "; a tie, for the interval holds 0" if count > 1 and self.gain.tie else ""
        return f"{sure} ({', '.join(self.scenes)}), at {self.level_db:g} dB of light (signal-to-noise of white){tie}"

    @property
    def psnr_words(self) -> str:
        """Meaning of restored PSNR, for somebody who never heard of it, and what the gain means in grey levels."""
        what = (
            "Restored PSNR tells how near photographs through the display, sharpened again by computer, come to the "
            f"truth: the mean squared error in decibels. 1 dB more is {_LESS:.0%} less squared error"
        ).replace("%", " %")
        if self.gain is None:
            return (
                f"{what}; {self.psnr:.1f} dB is an error of {_levels(self.psnr)} of 255 grey levels, root mean square."
            )
        then, now = _levels(self.psnr - self.gain.mean), _levels(self.psnr)
        return (
            f"{what}. Here the error of a pixel goes from {then} to {now} of 255 grey levels, root mean square; one "
            "level is the finest step of an 8-bit picture."
        )

    @property
    def tie_words(self) -> str:
        """Dies that may be as good, in words."""
        if not self.others:
            return ""
        if not self.ties:
            kept = " that keeps the limits" if self.limits and not self.broken else ""
            return f"Every other die{kept} is worse: no interval of its paired difference holds 0."
        who = "all other dies" if len(self.ties) == self.others and self.others > 1 else ", ".join(self.ties)
        worse = self.others - len(self.ties)
        of = " that keep the limits" if self.limits and not self.broken else ""
        rest = f" The other {f'{worse} dies{of} are' if worse > 1 else 'one is'} worse." if worse else ""
        how = f"the {100 * CONFIDENCE:g} % interval of the paired difference includes 0"
        they = "It" if len(self.ties) == 1 else "They"
        return f"Tied with it: {who}. {they} may be as good, for {how}.{rest}"


def stamps(document: Record) -> tuple[Stamp, ...]:
    """Verdicts on files, optics, and displays: whether they fit, look right, and live."""
    verdicts = document["verdicts"]
    shops = sorted({row["name"] for row in document["checks"] if row["name"].startswith("shop_")})
    passed = "CAN BE ORDERED" if shops else "AS DESIGNED"
    house = f"{len(shops)} rules of the mask house" if shops else "no mask house chosen, so its rules were not checked"
    tried = next((row for row in document["checks"] if row["name"] == PLANTED), None)
    awake = "" if tried is None else f"; {tried['value']} of {tried['limit']} planted faults caught"
    return (
        _of_checks("FILES", verdicts["files"], (passed, "DO NOT ORDER"), f"{awake}; {house}"),
        _of_checks("OPTICS", verdicts["optics"], ("PROVED", "NOT PROVED"), " on the files read back"),
        *(_of_displays(document, name) for name in (FITS, LOOKS, LIVES)),
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
    dies = {die["name"]: die for die in document["dies"] if die["name"] in by_die}
    means = {name: mean_psnr(taken, level, name) for name in by_die}
    free = max(means, key=lambda name: means[name])
    field = _candidates(dies, means)
    name = max(field, key=lambda candidate: means[candidate])
    die, missed = dies[name], broken(dies[name])
    reference, stated = taken["reference"], taken["reference_stated"]
    compared = reference is not None and reference != name
    open_ratio = next((row for row in die["quantities"] if row["name"] == "stop_open_ratio"), None)
    psnr_made, gain_made = photograph_bands(die, level)
    return Best(
        name=name,
        label=die["label"],
        level_db=level,
        psnr=means[name],
        gain=difference(taken, level, name, reference) if compared else None,
        reference=reference,
        stated=stated is not None,
        scenes=tuple(taken["scenes"]),
        others=len(field) - 1,
        ties=tuple(other for other in field if other != name and difference(taken, level, other, name).tie),
        open_ratio=open_ratio,
        broken=missed,
        limits=_limit_words(dies, name, free, difference(taken, level, free, name)),
        missing=_missing(taken, name, len(by_die)),
        psnr_made=psnr_made,
        gain_made=gain_made,
        open_ratio_made="" if open_ratio is None else edges(band_of(die, open_ratio)),
    )


def decision(document: Record, leader: Best | str) -> str:
    """Answer of the report in one sentence: what to build, what it gains, what its display does, and the order."""
    if isinstance(leader, str):
        return ""
    if leader.broken:
        return f"Build none of these: no die keeps FITS, LOOKS and LIVES. {leader.name} comes nearest."
    dies = {die["name"]: die for die in document["dies"]}
    head, said = f"Build {leader.name}: ", []
    if leader.gain is not None and leader.gain.tie and len(leader.scenes) > 1:
        head = f"Nothing here is surely better than {leader.reference}: "
        said.append(f"{leader.name} is ahead in the mean")
    elif leader.gain is not None:
        said.append(
            f"photographs through it restore {leader.gain.told(digits=1).lstrip('+')} better than {leader.reference}'s"
        )
    if judged := judged_verdicts(dies[leader.name]):
        said.append("its display " + _and([_KEEPS[verdict] for verdict in judged]))
    files = document["verdicts"]["files"]
    house = any(row["name"].startswith("shop_") for row in document["checks"])
    if files["passed"] is False:
        said.append(f"do not order, for {files['failed']} checks of the files failed")
    else:
        said.append("the files keep the mask house's rules" if house else "before an order choose a mask house")
    return f"{head}{'; '.join(said)}."


def _candidates(dies: Mapping[str, Record], means: Mapping[str, float]) -> list[str]:
    """Dies that keep every limit; if none does, those that break the fewest verdicts, and of these the ones without
    which the best photographs would be had."""
    missed = {name: broken(die) for name, die in dies.items()}
    fewest = min(len(verdicts) for verdicts in missed.values())
    near = [name for name, verdicts in missed.items() if len(verdicts) == fewest]
    first = max(near, key=lambda name: means[name])
    return [name for name in near if missed[name] == missed[first]]


def _limit_words(dies: Mapping[str, Record], name: str, free: str, cost: MeanDifference) -> str:
    missed = broken(dies[name])
    if all("display" not in die for die in dies.values()):
        return ""
    if missed:
        kept = [verdict for verdict in _VERDICTS if verdict not in missed]
        rest = f" {name} keeps {_and(kept)}." if kept else ""
        return f"No die keeps FITS, LOOKS and LIVES. What binds is {breach_words(breaches(dies[name]))}.{rest}"
    if name == free:
        return "The limits of the display cost nothing: no die that breaks one has a higher mean."
    amount = cost.told(digits=1).lstrip("+")
    why = breach_words(breaches(dies[free]))
    return f"The limits of the display cost {amount}: {free} restores better by that, but breaks {why}."


def _levels(psnr: float) -> str:
    """Root mean square error of a PSNR, in levels of an 8-bit picture."""
    return f"{255 * 10 ** (-psnr / 20):.0f}"


def _and(words: Sequence[str]) -> str:
    return " and ".join([", ".join(words[:-1]), words[-1]] if len(words) > 1 else words)


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


def assumptions(document: Record) -> list[tuple[str, str]]:
    """Camera, light, spectrum, restorer and process that the numbers of the report rest on, by name."""
    camera = document["camera"]
    focal, stop = camera["focal_um"], camera["stop"]["diameter_um"]
    lines = ", ".join(f"{line:g}" for line in camera["wavelengths_nm"])
    lens = f"f = {short(focal / UM_PER_MM)} mm, f/{short(focal / stop, 2)}, pixel {short(camera['pixel_um'])} µm"
    said = [("Camera", lens)]
    taken = document.get("photographs")
    if taken is None:
        return [*said, ("Spectrum", f"lines of {lines} nm"), ("Dies", spread_words(document))]
    scene = taken["scene"]
    for sentence in taken["told"]:
        name, _, rest = sentence.partition(": ")
        if name in ("sensor", "light"):
            said.append((name.capitalize(), rest))
    said.append(
        ("Spectrum", f"as [scene] says ({scene['spectrum']})" if "spectrum" in scene else f"lines of {lines} nm")
    )
    said.append(("Photographs", f"drawn scenes {', '.join(taken['scenes'])}, restored by a Wiener filter"))
    rest = [key for key in scene if key not in {"spectrum", "accuracy"}]
    said.append(("Scene", f"[scene]: {', '.join(rest)}" if rest else "objects in focus, on the axis"))
    return [*said, ("Dies", spread_words(document))]


def crops(document: Record, leader: Best | str) -> Iterator[tuple[str, str]]:
    """Dies whose restored photograph the front shows, each with its caption."""
    if isinstance(leader, str):
        return
    taken = document["photographs"]
    for name in leader.shown:
        role = "reference" if name == leader.reference else "best" if not leader.broken else "best without a limit"
        own = scores(taken, leader.level_db)[name][0]
        yield name, f"{name} ({role}), scene {leader.scenes[0]} alone: {own:.1f} dB"


def _of_checks(name: str, tally: Record, words: tuple[str, str], rest: str) -> Stamp:
    if tally["passed"] is None:
        return Stamp(name, "NOT CHECKED", "open", "no check was made")
    if tally["passed"]:
        return Stamp(name, words[0], "good", f"{tally['checks']} checks pass{rest}")
    return Stamp(name, words[1], "bad", f"{tally['failed']} of {tally['checks']} checks failed{rest}")


def _of_displays(document: Record, name: str) -> Stamp:
    """A verdict on the displays of all dies. The reference, which may be there to break limits, makes none bad."""
    judged = [die for die in document["dies"] if name in judged_verdicts(die)]
    if not judged:
        return Stamp(name, "NOT JUDGED", "open", "the job has no [emitters]")
    reference = document.get("photographs", {}).get("reference")
    others = [die for die in judged if die["name"] != reference or len(judged) == 1]
    missed = [die["name"] for die in others if name in broken(die)]
    mood: Mood = "good" if not missed else "bad" if len(missed) == len(others) else "some"
    basis = [_whose(document, name)]
    if missed:
        more = f" and {len(missed) - _MOST_NAMED} more" if len(missed) > _MOST_NAMED else ""
        basis.append(f"not {', '.join(missed[:_MOST_NAMED])}{more}")
    if any(die["name"] == reference and name in broken(die) for die in judged if die not in others):
        basis.append("nor the reference" if missed else f"not the reference {reference}")
    kept = f"{len(others) - len(missed)} OF {len(others)} {'DIE' if len(others) == 1 else 'DIES'}"
    return Stamp(name, kept, mood, "; ".join(basis))


def _whose(document: Record, name: str) -> str:
    verdicts = document["verdicts"]
    if name == FITS:
        return str(verdicts["display"].get("circuits", "placed and wired"))
    stated = verdicts.get(name.lower(), {}).get("stated", False)
    what = {LOOKS: "limits of the eye", LIVES: "limits of life"}[name]
    return f"{what}: {'as the job states' if stated else 'defaults'}"


def _missing(taken: Record, name: str, photographed: int) -> str:
    stated = taken["reference_stated"]
    if taken["reference"] is None and stated is not None:
        why = next(die["refused"] for die in taken["dies"] if die["name"] == stated)
        return f"No gain: the reference {stated} was not photographed. {_refusal(why)}"
    if photographed == 1:
        return f"No gain, for no other die was photographed: {_ADD}."
    if taken["reference"] == name:
        return "It is the reference itself: no die to choose from has a higher mean."
    return ""


def _refusal(why: str) -> str:
    code, _, what = why.partition(" ")
    return f"{what}. {explained(code).cure}" if code in catalogue() else f"{why}."
